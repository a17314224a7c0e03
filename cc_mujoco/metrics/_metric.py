"""Definition of a metric, and of the episode record from which it is computed."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray as Array

Better = Literal["low", "high", ""]
Test = Literal["episode", "backdrive", "backlash", "bandwidth", "parts"]
"""Episode that a metric is computed from; `parts` is none: it follows from a design."""


class Key:
    """Keys of an episode's metadata that metrics read."""

    RATIO = "ratio"  # joint angle per motor angle of an unstretched cable (signed)
    DRIVEN = "driven"  # names of the cables that the motor winds; all where missing
    PULL_PULL = "pull_pull"  # whether two cables pull against each other
    SPRING = "spring"  # whether the task asks for a spring
    STRENGTH = "strength"  # breaking load of each cable by name [N]
    SAFE_TORQUE = "safe_torque"  # largest joint torque that is safe [N m]
    # Data sheet of the motor
    CONTINUOUS_TORQUE = "continuous_torque"  # [N m]
    WINDING_RESISTANCE = "winding_resistance"  # [ohm]
    TORQUE_CONSTANT = "torque_constant"  # [N m/A]
    GEARING = "gearing"  # turns of its rotor per turn of its pulley
    PACE = "pace"  # `Pace` of the walk
    MOMENT_RATIO = "moment_ratio"  # moments of the wearer over those of the scene's
    GAIT_JOINT = "gait_joint"  # the `GaitJoint` that the device drives


class LogLike(Protocol):
    """Record of one episode: an `EpisodeLog`, or a row of a batch as `ArrayLog`."""

    @property
    def cables(self) -> tuple[str, ...]:
        """Names of the cables."""

    @property
    def metadata(self) -> Mapping[str, Any]:
        """Constants of the device and the episode, by name."""

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column of the episode log, (T, ...) for T samples."""

    def pieces(self, name: str) -> Iterator[NDArray[Any]]:
        """Yield a column's rows in order, in pieces that fit into memory."""


@dataclass(frozen=True, eq=False)
class ArrayLog:
    """`LogLike` of arrays in memory, such as views of a batch."""

    columns: Mapping[str, NDArray[Any]]
    cables: tuple[str, ...] = ()
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self.columns:
            raise CableError.unknown("column", name, self.columns)
        return self.columns[name]

    def pieces(self, name: str) -> Iterator[NDArray[Any]]:
        """Yield all rows of a column at once."""
        yield self[name]


@dataclass(frozen=True)
class Metric:
    """A number of an episode or of a design.

        PEAK_ANGLE = Metric("peak_angle", "rad", "largest |joint angle|",
                            lambda log: abs(log["joint_angle_rad"]).max())

    It has the same definition in `play`, what-if studies and the benchmark.
    """

    name: str
    """Name of its column; `{cable}` stands for the name of a cable."""
    unit: str
    """SI unit, `1` for a pure number."""
    meaning: str
    """One line for a reader."""
    compute: Callable[..., float]
    """Function of a `LogLike`, and of `cable` where the name has one.

    It gives NaN where the episode has no such number.
    """
    better: Better = "low"
    """Direction that is better; empty where neither is."""
    test: Test = "episode"
    needs: tuple[str, ...] = ()
    """Metadata keys without which there is no such number, and that not every device
    has."""
    whole: bool = False
    """True if it is of the device as a whole; otherwise each axis has one."""

    @property
    def high(self) -> bool:
        """Return whether a higher value is better."""
        return self.better == "high"

    @property
    def driven(self) -> bool:
        """Return whether the metric depends on the controller."""
        return self.test in ("episode", "bandwidth")

    @property
    def per_cable(self) -> bool:
        """Return whether every cable has its own value."""
        return "{cable}" in self.name

    @property
    def of_axis(self) -> bool:
        """Return whether each axis of a device has its own value."""
        return not (self.whole or self.per_cable)

    def of(self, cable: str) -> "Metric":
        """Return the metric of one cable, named in place of `{cable}`."""
        return replace(
            self,
            name=self.name.format(cable=cable),
            meaning=self.meaning.format(cable=cable),
            compute=partial(self.compute, cable=cable),
            whole=True,
        )


def driven_cables(log: LogLike) -> tuple[str, ...]:
    """Return the names of the cables that a motor winds."""
    return tuple(log.metadata.get(Key.DRIVEN, log.cables))


def metadata_constant(log: LogLike, key: str) -> float:
    """Return a number of the metadata, NaN if it is missing."""
    return float(log.metadata.get(key, math.nan))


def value_text(value: float) -> str:
    """Return the text of a value in a table, `-` for NaN."""
    return f"{value:.4g}" if math.isfinite(value) else "-"


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def peak(values: Array) -> float:
    return float(np.max(np.abs(values)))
