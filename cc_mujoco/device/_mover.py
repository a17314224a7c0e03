"""Actuators of motors and wearer: impedance, control and limits at their joints."""

import math
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.human import Wearer

FILTERS = (mujoco.mjtDyn.mjDYN_FILTER.value, mujoco.mjtDyn.mjDYN_FILTEREXACT.value)
"""Types of the dynamics of a motor whose torque lags behind its control."""


def joint_actuators(model: mujoco.MjModel, joints: Any) -> NDArray[np.bool_]:
    """Return the mask (nu,) of actuators on one or several joints, except cables."""
    on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    own = model.actuator_plugin < 0
    return np.asarray(on_joint & own & np.isin(model.actuator_trnid[:, 0], joints))


def _control_range(model: mujoco.MjModel, actuator: int) -> tuple[float, float]:
    """Return the least and largest control of an actuator, infinite without a limit."""
    if not model.actuator_ctrllimited[actuator]:
        return -math.inf, math.inf
    low, high = model.actuator_ctrlrange[actuator].tolist()
    return low, high


class Mover(NamedTuple):
    """Actuator of the wearer at a joint: a spring and a damper towards its command."""

    wearer: Wearer  # impedance at the joint
    control: int  # index in `ctrl`
    out: int  # index in `actuator_force`
    gear: float  # torque at the joint per force of the actuator
    scale: float  # control per angle of the joint; 1 where it is that angle
    offset: float  # control at an angle of 0
    low: float  # least control; infinite where there is no limit
    high: float

    @classmethod
    def of(cls, model: mujoco.MjModel, name: str) -> "Mover":
        actuator = int(model.actuator(name).id)
        gear = float(model.actuator_gear[actuator, 0])
        gain = float(model.actuator_gainprm[actuator, 0])
        bias = model.actuator_biasprm[actuator]
        stiffness = gear * gear * -float(bias[1])
        wearer = Wearer(stiffness, gear * gear * -float(bias[2]))
        control = int(model.actuator_ctrladr[actuator])
        out, scale = int(model.actuator_outadr[actuator]), stiffness / (gear * gain)
        limits = _control_range(model, actuator)
        return cls(
            wearer, control, out, gear, scale, 0.0 - float(bias[0]) / gain, *limits
        )

    def command(self, angle: Any, velocity: Any) -> Any:
        """Return the control for a reference [rad], [rad/s]: a number or (n,)."""
        aim = self.scale * self.wearer.command(angle, velocity) + self.offset
        return np.clip(aim, self.low, self.high)

    def impose(self, actuator: Any, wearer: Wearer) -> "Mover":
        """Write another impedance into an actuator; its control keeps its scale."""
        share = self.gear * self.gear
        gain = wearer.stiffness / share
        # The control keeps its meaning.
        actuator.gainprm[0] = gain / (self.scale * self.gear)
        rest = 0.0 - self.offset * actuator.gainprm[0]
        actuator.biasprm[:3] = rest, -gain, -wearer.damping / share
        return self._replace(wearer=wearer)


class MotorLimits(NamedTuple):
    """Largest control and torques of an actuator that is a source of torque."""

    control: float  # of the largest positive torque; infinite without a limit
    torque: float  # largest, either way [N m]
    torques: tuple[float, float]  # at both ends of its range [N m]

    @classmethod
    def of(cls, model: mujoco.MjModel, actuator: int) -> "MotorLimits":
        gain = float(model.actuator_gainprm[actuator, 0])
        gear = float(model.actuator_gear[actuator, 0])
        low, high = _control_range(model, actuator)
        limits = []
        if model.actuator_forcelimited[actuator]:
            limits.append(model.actuator_forcerange[actuator] / gain)
        joint = int(model.actuator_trnid[actuator, 0])
        if model.jnt_actfrclimited[joint]:
            limits.append(model.jnt_actfrcrange[joint] / (gain * gear))
        for ends in limits:
            low, high = max(low, float(min(ends))), min(high, float(max(ends)))
        control = max(-low, high)
        torques = low * gain * gear, high * gain * gear
        sign = math.copysign(1.0, gain * gear)
        return cls(sign * control, control * abs(gain) * abs(gear), torques)
