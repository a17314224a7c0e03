r"""Backlash with a smooth transition, and its inverse in closed form.

G. Tao, P. V. Kokotović, "Adaptive control of systems with backlash", Automatica 29,
1993: a joint that is moved up lies on one line, moved down on another, and stays while
the motor goes from one to the other. The inverse leaps between the lines. Here it goes
over within a distance \(\delta\) of the joint, as the friction of P. Dahl, "A solid
friction model", Aerospace Corporation TOR-158, 1968, does:

\[ \theta = \tfrac{1 + z}{2} (a_+ q + c_+) + \tfrac{1 - z}{2} (a_- q + c_-), \qquad
   \frac{dz}{dq} = \frac{\operatorname{sign}(\dot q) - z}{\delta}
   \operatorname{sign}(\dot q) \]
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco._validation import require_parameter
from cc_mujoco.control._hysteresis import Array, HysteresisModel, HysteresisTrial
from cc_mujoco.errors import CableError

TRANSITIONS = np.geomspace(0.003, 0.5, 24)
"""Transitions that a fit tries, as shares of the range of the joint."""
CURVES = 40
"""Halvings with which the operator is evaluated."""


class _Fit(NamedTuple):
    error: float
    model: SmoothBacklash


@dataclass(frozen=True)
class SmoothBacklash(HysteresisModel):
    """Backlash between two lines; see the module."""

    slope_up: float
    """Motor angle per joint angle while the joint moves up, a+ [-]."""
    slope_down: float
    """Motor angle per joint angle while the joint moves down, a- [-]."""
    offset_up: float
    """Motor angle at joint angle 0 on the way up, c+ [rad]."""
    offset_down: float
    """Motor angle at joint angle 0 on the way down, c- [rad]."""
    transition: float
    """Distance of the joint over which one line goes over into the other [rad]."""

    def __post_init__(self) -> None:
        """Refuse lines that turn the joint against the motor."""
        require_parameter(self, "transition", 1e-6, 100.0, "rad")
        require_parameter(self, "slope_up", 1e-6, 1e6, "")
        require_parameter(self, "slope_down", 1e-6, 1e6, "")

    @classmethod
    def fit(cls, trial: HysteresisTrial) -> SmoothBacklash:
        """Return the lines of least squares, of the transition that fits best."""
        joint, weights = trial.joint_angle, trial.weights
        best: _Fit | None = None
        for transition in np.ptp(joint) * TRANSITIONS:
            z = _blend(joint, float(transition))
            up, down = 0.5 * (1.0 + z), 0.5 * (1.0 - z)
            columns = np.stack([up * joint, down * joint, up, down], axis=1)
            found = np.linalg.lstsq(
                columns * weights[:, None], trial.motor_angle * weights, rcond=None
            )[0]
            error = float(
                np.sum((weights * (columns @ found - trial.motor_angle)) ** 2)
            )
            if min(found[:2]) > 1e-6 and (best is None or error < best.error):
                up_slope, down_slope, up_offset, down_offset = found.tolist()
                model = cls(
                    up_slope, down_slope, up_offset, down_offset, float(transition)
                )
                best = _Fit(error, model)
        if best is None:
            raise CableError(
                "no backlash fits this trial: the joint does not follow the motor in "
                "both directions."
            )
        return best.model

    def rest(self, count: int) -> Array:
        """Return joint angle and blend z; see `HysteresisModel.rest`."""
        return np.zeros((count, 2))

    def invert(self, state: Array, joint: Array) -> Array:
        """Return the motor angles [rad]; see `HysteresisModel.invert`."""
        state[:, 1] = self._blended(state[:, 0], state[:, 1], joint)
        state[:, 0] = joint
        return self._motor(joint, state[:, 1])

    def course(self, motor: ArrayLike) -> Array:
        """Return the course of the joint for a course of the motor (samples,) [rad].

        The operator that `invert` inverts, by bisection between monotone samples.
        """
        angles = np.asarray(motor, dtype=float)
        joint, z, found = 0.0, 0.0, np.empty(angles.size)
        for place, angle in enumerate(angles):
            way = float(np.sign(angle - self._motor(joint, z)))
            if way:
                near, far = 0.0, self.transition
                while self._left(joint, z, way * far, angle, way) > 0.0:
                    near, far = far, 2.0 * far
                for _ in range(CURVES + 10):
                    middle = 0.5 * (near + far)
                    if self._left(joint, z, way * middle, angle, way) > 0.0:
                        near = middle
                    else:
                        far = middle
                after = joint + way * 0.5 * (near + far)
                z = float(self._blended(joint, z, after))
                joint = after
            found[place] = joint
        return found

    def _left(
        self, joint: float, z: float, step: float, motor: float, way: float
    ) -> float:
        """Return how far a motor still is behind a step of the joint [rad]."""
        after = joint + step
        return float(way * (motor - self._motor(after, self._blended(joint, z, after))))

    def _blended(self, before: ArrayLike, z: ArrayLike, joint: ArrayLike) -> Array:
        moved = np.asarray(joint) - np.asarray(before)
        way = np.sign(moved)
        return np.asarray(way + (z - way) * np.exp(-np.abs(moved) / self.transition))

    def _motor(self, joint: ArrayLike, z: ArrayLike) -> Array:
        at, blend = np.asarray(joint), np.asarray(z)
        up = self.slope_up * at + self.offset_up
        down = self.slope_down * at + self.offset_down
        return np.asarray(0.5 * ((1.0 + blend) * up + (1.0 - blend) * down))


def _blend(joint: Array, transition: float) -> Array:
    """Return the blend z along a course of the joint (samples,)."""
    moved = np.diff(joint, prepend=joint[0])
    kept = np.exp(-np.abs(moved) / transition).tolist()
    ways, z, found = np.sign(moved).tolist(), 0.0, np.empty(joint.size)
    for place, (way, share) in enumerate(zip(ways, kept, strict=True)):
        z = way + (z - way) * share if way else z
        found[place] = z
    return found
