"""Samples of sensors on a cable, checked one by one, and rows of recordings."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco._utils.arguments import MAX_FORCE, numbers
from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._conduit import packed_parameters
from cc_mujoco.cable._kernel import segment_angles
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray


class EstimateTrack(NamedTuple):
    """Estimates over a recording, one per sample."""

    value: FloatArray  # after every sample (samples,), of p parameters (samples, p)
    deviation: FloatArray  # standard deviation of their errors, in the same shape


def wrap_angles(cable: Cable) -> FloatArray:
    """Return the wrap angle from the proximal end to every node (n + 1,) [rad]."""
    angles = segment_angles(packed_parameters(cable), cable.segments)
    return np.concatenate([[0.0], np.cumsum(angles)])


def checked_sample(
    reading: ArrayLike,
    direction: ArrayLike,
    sensors: int,
    segments: int,
    leading: tuple[int, ...] = (),
) -> tuple[FloatArray, FloatArray]:
    """Return readings (*leading, m) and directions of slip (*leading, n), checked."""
    tensions = numbers("reading", reading, (*leading, sensors), MAX_FORCE, "N")
    sign = numbers("direction", direction, (*leading, segments))
    if not np.all((sign == 0.0) | (np.abs(sign) == 1.0)):
        wrong = float(sign[(sign != 0.0) & (np.abs(sign) != 1.0)][0])
        raise CableError(f"direction is {wrong:g}; every one must be -1, 0 or 1")
    return tensions, sign


class NoisySensors:
    """Base of the estimators that weight sensors by their noise."""

    sensors: Sensors

    @property
    def noise(self) -> FloatArray:
        """Standard deviation of the sensors (m,) [N], which may be set at any time."""
        return self._noise

    @noise.setter
    def noise(self, deviation: ArrayLike) -> None:
        count = len(self.sensors.nodes)
        noise = numbers("noise", deviation, (count,), MAX_FORCE, "N")
        if not np.all(noise > 0.0):
            raise CableError(
                f"noise is {noise.tolist()} N; it must be {count} positive numbers, "
                "one per sensor"
            )
        self._noise = noise.copy()


def rows(**columns: ArrayLike) -> Iterator[tuple[FloatArray, ...]]:
    """Yield the samples of recorded columns as tuples, after a check of lengths."""
    arrays = {name: numbers(name, column) for name, column in columns.items()}
    for name, array in arrays.items():
        if array.ndim == 0:
            raise CableError(f"{name} is {array}; it must have one row per sample")
    if len(set(map(len, arrays.values()))) > 1:
        listing = ", ".join(f"{name} {len(array)}" for name, array in arrays.items())
        raise CableError(f"samples are unequal in number: {listing}")
    return zip(*arrays.values(), strict=True)
