"""Samples of a cable that runs: checked one by one, and the rows of recordings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.cable._conduit import packed_parameters
from cc_mujoco.cable._kernel import segment_angles
from cc_mujoco.cable._parameters import Cable
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray


class EstimateTrack(NamedTuple):
    """Estimates followed over a recording.

    Attributes:
        value: after every sample (samples,), of p parameters (samples, p).
        deviation: standard deviation of their errors, in the same shape.
    """

    value: FloatArray
    deviation: FloatArray


def wrap_angles(cable: Cable) -> FloatArray:
    """Wrap angle from the proximal end to every node (n + 1,) [rad]."""
    n = cable.segments
    return np.concatenate(
        [[0.0], np.cumsum(segment_angles(packed_parameters(cable), n))]
    )


def checked_sample(
    reading: ArrayLike, direction: ArrayLike, sensors: int, segments: int
) -> tuple[FloatArray, FloatArray]:
    """Return the readings (m,) and the signs of the directions (n,) as arrays.

    Raises:
        CableError: other shapes, or a number that is not finite.
    """
    tensions = np.asarray(reading, dtype=float)
    sign = np.sign(np.asarray(direction, dtype=float))
    for name, array, size in (
        ("reading", tensions, sensors),
        ("direction", sign, segments),
    ):
        if array.shape != (size,):
            raise CableError(f"{name} has shape {array.shape}; it must be {(size,)}")
        if not np.all(np.isfinite(array)):
            raise CableError(f"{name} is {array.tolist()}; all must be finite")
    return tensions, sign


def checked_noise(deviation: ArrayLike, sensors: int) -> FloatArray:
    """Return the standard deviations of the sensors as a new array (m,) [N].

    Raises:
        CableError: not one positive number per sensor.
    """
    noise = np.array(deviation, dtype=float)
    if noise.shape != (sensors,) or not np.all((noise > 0.0) & np.isfinite(noise)):
        raise CableError(
            f"noise is {noise.tolist()} N; it must be {sensors} positive numbers, one "
            "per sensor"
        )
    return noise


def rows(**columns: ArrayLike) -> Iterator[tuple[FloatArray, ...]]:
    """Return an iterator over the samples of recorded columns.

    Raises:
        CableError: columns of unequal length.
    """
    arrays = {name: np.asarray(column) for name, column in columns.items()}
    lengths = {name: len(array) for name, array in arrays.items()}
    if len(set(lengths.values())) > 1:
        listing = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise CableError(f"samples are unequal in number: {listing}")
    return zip(*arrays.values(), strict=True)
