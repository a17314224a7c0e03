"""Definition of a model of hysteresis from motor angle to joint angle.

    model = SmoothBacklash.fit(trial)
    state = model.rest(1)
    motor = model.invert(state, np.array([0.1]))      # rad, for a joint at 0.1 rad

Angles are those from rest, in the neutral pose, and that of the motor is taken at the
joint: without friction and stretch both are equal. Models are frozen dataclasses of
numbers and tuples of numbers, so that they can be written to a file.
"""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco.errors import CableError

Array = NDArray[np.float64]

LEAST_SAMPLES = 50
"""Fewest samples of a trial."""
_LEAD = 0.05
"""Area by which the joint may lead the motor, over that of both ranges."""


@dataclass(frozen=True)
class HysteresisTrial:
    """Slow course of a motor and of its joint, for a fit.

    It begins at rest in the neutral pose and covers the range in use, back and forth,
    best in loops of several sizes.
    """

    motor_angle: Array
    """Angle of the motor from the start, over the ratio (samples,) [rad]."""
    joint_angle: Array
    """Angle of the joint from the start (samples,) [rad]."""

    @classmethod
    def of(
        cls,
        motor_angle: ArrayLike,
        joint_angle: ArrayLike,
        ratio: float,
        samples: int = 1500,
    ) -> HysteresisTrial:
        """Return a trial of measured angles, thinned to about a number of samples.

        Args:
            motor_angle: (n,) [rad].
            joint_angle: (n,) [rad].
            ratio: Motor angle per joint angle of an unstretched cable [-].
            samples: About as many are kept.

        Raises:
            CableError: There are too few samples, they are not finite, or one of the
                two does not move.
        """
        both = [np.asarray(one, dtype=float) for one in (motor_angle, joint_angle)]
        if both[0].ndim != 1 or both[0].shape != both[1].shape:
            raise CableError(
                "a trial needs as many motor angles as joint angles, (n,) each, not "
                f"{both[0].shape} and {both[1].shape}."
            )
        if both[0].size < LEAST_SAMPLES or not all(np.isfinite(b).all() for b in both):
            raise CableError(
                f"a trial needs at least {LEAST_SAMPLES} samples of finite numbers; "
                f"this has {both[0].size}."
            )
        every = max(1, both[0].size // samples)
        motor, joint = (one[::every] - one[0] for one in both)
        for name, one in (("motor", motor), ("joint", joint)):
            if np.ptp(one) == 0.0:
                raise CableError(f"the {name} does not move in this trial.")
        if np.sum(np.diff(motor / ratio) * np.diff(joint)) <= 0.0:
            raise CableError(
                "the joint turns against the motor in this trial; change the sign of "
                "one of the two angles."
            )
        wound = motor / ratio
        loops = np.sum(wound[:-1] * joint[1:] - wound[1:] * joint[:-1])
        if loops < -_LEAD * np.ptp(wound) * np.ptp(joint):
            raise CableError(
                "the joint leads the motor in this trial; are the two angles swapped, "
                "or the rows in another order than that of time?"
            )
        return cls(wound, joint)

    @property
    def weights(self) -> Array:
        """Weight of each sample in a fit of motor angles (samples,).

        It is the motion of the joint per motion of the motor: while the motor crosses
        the backlash its error does not matter to the joint.
        """
        moved = np.abs(np.diff(self.joint_angle, prepend=self.joint_angle[0]))
        turned = np.abs(np.diff(self.motor_angle, prepend=self.motor_angle[0]))
        scale = np.ptp(self.motor_angle) / np.ptp(self.joint_angle)
        weights: Array = np.minimum(scale * moved / np.maximum(turned, 1e-12), 1.0)
        return weights


@dataclass(frozen=True)
class HysteresisModel(ABC):
    """Model of hysteresis that can be inverted; subclasses are frozen dataclasses."""

    @classmethod
    @abstractmethod
    def fit(cls, trial: HysteresisTrial) -> Self:
        """Return the model that fits a trial best."""

    @abstractmethod
    def rest(self, count: int) -> Array:
        """Return the state of n inverses at rest, (n, numbers)."""

    @abstractmethod
    def invert(self, state: Array, joint: Array) -> Array:
        """Return the motor angles for the next joint angles.

        The course between two calls is monotone.

        Args:
            state: As of `rest`; changed.
            joint: Desired joint angles (n,) [rad].

        Returns:
            Motor angles (n,) [rad].
        """

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters as numbers and lists of numbers."""
        fields = dataclasses.asdict(self)
        return {n: list(v) if isinstance(v, tuple) else v for n, v in fields.items()}

    @classmethod
    def from_dict(cls, name: str, given: Mapping[str, Any]) -> Self:
        """Return the model of the parameters of `to_dict`; `name` is for errors."""
        kinds = {f.name: f.type for f in dataclasses.fields(cls)}
        for key in given:
            if key not in kinds:
                raise CableError.unknown(f"parameter of {name!r}", key, kinds)
        values: dict[str, Any] = {}
        for key, kind in kinds.items():
            if key not in given:
                raise CableError(f"the model {name!r} needs a parameter {key!r}.")
            value = given[key]
            listed = "tuple" in str(kind)
            numbers = np.asarray(value)
            if numbers.dtype.kind not in "fiu" or numbers.ndim != int(listed):
                what = "a list of numbers" if listed else "a number"
                raise CableError(f"{name!r}, {key} must be {what}, not {value!r}.")
            if not np.isfinite(numbers).all():
                raise CableError(f"{name!r}, {key} must be finite, not {value!r}.")
            values[key] = tuple(map(float, value)) if listed else float(value)
        return cls(**values)
