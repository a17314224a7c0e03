r"""The model of distributed friction, inverted: motor angles for a course of the joint.

The kernel of the package (`cable._stepper`) with a spring at the joint. At a joint
angle the spring defines the torque of the cables, and the motor turns to the nearest
angle at which they make it. Partial motion, and a backlash that grows with the load,
come with the friction.

Angles alone determine no force: a spring, a rope and a pretension that are all twice as
strong move alike. So the axial stiffness stays that of the data sheet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cc_mujoco._utils.exclusive import exclusive
from cc_mujoco._validation import require_parameter
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.control._cable_model import joint_stiffness
from cc_mujoco.control._hysteresis import Array, HysteresisTrial
from cc_mujoco.control._rollout import joint_torque
from cc_mujoco.device._drive import CableDrive, Drive
from cc_mujoco.errors import CableError

STEP = 0.01
"""Time of a step of the course [s], for terms of friction that depend on speed."""
TOLERANCE = 1e-7
"""Tolerance of the motor angle [rad]."""
MAX_LEAP = 20.0
"""Largest turn of the motor in one step, in angles of the joint [rad]."""
FIT_SAMPLES = 500
"""Samples of a trial that a fit uses."""


@dataclass(frozen=True)
class CableParameters:
    """Parameters of the cables and of the joint's spring, identified from a trial."""

    friction: float
    """Friction coefficient over that of the data sheet [-]."""
    pretension: float
    """Pretension over that of the data sheet [-]."""
    joint_stiffness: float
    """Stiffness of the spring at the joint [N m/rad]."""

    def __post_init__(self) -> None:
        require_parameter(self, "friction", 0.0, 100.0, "")
        require_parameter(self, "pretension", 0.0, 100.0, "")
        require_parameter(self, "joint_stiffness", 1e-9, 1e6, "N m/rad")


class CableCourse:
    """Cables and a spring along a course of the joint, from rest."""

    def __init__(
        self, cables: Sequence[CableDrive], parameters: CableParameters
    ) -> None:
        """Prepare at rest; `cables` are those of the data sheet."""
        own = [
            one.cable.replace(
                friction=parameters.friction * one.cable.friction,
                static_friction=parameters.friction * one.cable.static_friction,
                pretension=parameters.pretension * one.cable.pretension,
            )
            for one in cables
        ]
        proximal = [one.proximal for one in cables]
        distal = [one.distal for one in cables]
        self._cables = stepper.make_cables(own, proximal, distal)
        self._ratio = distal[0] / proximal[0]
        self._stiffness = parameters.joint_stiffness
        self._state = stepper.rest_states(self._cables, 0.0, 0.0)
        self._preload = stepper.torque(self._cables, self._state, True, 0.0)[0]
        self._new = self._state.copy()
        self._work = stepper.scratch(self._cables)
        self._motor, self._joint, self._reach = 0.0, 0.0, 1e-3

    @exclusive
    def advance(self, joint: float) -> float:
        """Return the motor angle, over the ratio, for the next joint angle [rad].

        It is the nearest in the direction of the joint's motion at which the cables
        make the torque of the spring, so the motor rests where they already make more.
        """
        from scipy.optimize import brentq

        turned = joint - self._joint
        if turned == 0.0:
            return self._motor / self._ratio
        way, sense = float(np.sign(turned * self._ratio)), float(np.sign(turned))
        wanted = self._preload + self._stiffness * joint

        def lack(beyond: float) -> float:
            motor = self._motor + way * beyond
            stepper.move(
                self._cables, self._state, motor, joint, STEP, self._new, self._work
            )
            return sense * (wanted - joint_torque(self._cables, self._new, motor))

        low, high = 0.0, self._reach
        if lack(low) > 0.0:
            while lack(high) > 0.0:
                if high > MAX_LEAP * abs(self._ratio):
                    raise CableError(
                        f"no motor angle bends the joint to {joint:.4g} rad in the "
                        "model of the cables; its stiffness or friction is wrong."
                    )
                low, high = high, 2.0 * high
            beyond = float(brentq(lack, low, high, xtol=TOLERANCE))
            lack(beyond)
            self._motor += way * beyond
            self._reach = max(1.5 * beyond, 2.0 * TOLERANCE)
        else:
            lack(low)
        self._state[:] = self._new
        self._joint = joint
        return self._motor / self._ratio


def course_of(
    cables: Sequence[CableDrive], parameters: CableParameters, joint: Array
) -> Array:
    """Return the course of the motor, over the ratio, for one of the joint [rad]."""
    course = CableCourse(cables, parameters)
    return np.array([course.advance(float(angle)) for angle in joint])


def fit_cable(trial: HysteresisTrial, drive: Drive) -> CableParameters:
    """Return friction, pretension and spring of least squares, from a slow course."""
    from scipy.optimize import least_squares

    require_cables(drive)
    every = max(1, trial.joint_angle.size // FIT_SAMPLES)
    motor, joint = trial.motor_angle[::every], trial.joint_angle[::every]
    weights = HysteresisTrial(motor, joint).weights
    cables = joint_stiffness(drive.cables)

    def parameters(logs: Array) -> CableParameters:
        friction, pretension, spring = np.exp(np.clip(logs, -6.0, 4.0)).tolist()
        return CableParameters(friction, pretension, spring * cables)

    def residual(logs: Array) -> Array:
        found = course_of(drive.cables, parameters(logs), joint)
        return np.asarray(weights * (found - motor))

    # Without friction, slope - 1 is the stiffness of the spring over that of the
    # cables.
    slope = np.polyfit(joint, motor, 1, w=weights)[0]
    start = np.log([1.0, 1.0, min(max(slope - 1.0, 0.02), 5.0)])
    found = least_squares(residual, start, diff_step=1e-3, xtol=1e-4, ftol=1e-5)
    return parameters(found.x)


def require_cables(drive: Drive) -> None:
    if not drive.cables:
        raise CableError(
            "controller 'cable_inverse' needs to know the cables; this Drive has no "
            "cable drives."
        )
