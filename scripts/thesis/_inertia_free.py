"""The setting of the thesis's simulations (4.3): a device without any inertia.

The motor is an ideal source of torque, the wearer an ideal source of position; the
cables stand between them. One step passes between a measurement and its effect.

    device = InertiaFree(drive)
    log = device.run(controller("model", drive), angle, desired)
    log["joint_torque_nm"]
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cc_mujoco._utils.exclusive import exclusive
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._layout import tensions
from cc_mujoco.control import Controller
from cc_mujoco.device._drive import Drive
from cc_mujoco.native import FloatArray
from cc_mujoco.simulation._loop import Columns, Trace, run

COLUMNS = (
    "motor_angle_rad", "motor_torque_nm", "joint_angle_rad", "joint_torque_nm",
    "desired_torque_nm",
)  # fmt: skip


class InertiaFree:
    """Cables between a torque and a position, stepped by a controller."""

    def __init__(self, drive: Drive) -> None:
        """Prepare a device with the cables of a drive."""
        self.drive = drive
        cables = [(s.cable, s.proximal, s.distal) for s in drive.cables]
        self.cables = stepper.make_cables(*zip(*cables, strict=True))
        self._work = stepper.scratch(self.cables)
        self.reset(0.0)

    @exclusive
    def reset(self, joint_angle: float) -> None:
        """Rest in the pretension, with the joint at an angle [rad]."""
        self.motor_angle = 0.0
        self._state = stepper.rest_states(self.cables, self.motor_angle, joint_angle)
        self._new = np.zeros_like(self._state)

    @property
    def joint_torque(self) -> float:
        """Torque of the cables on the joint [N m]."""
        return float(stepper.torque(self.cables, self._state, True, 0.0)[0])

    @property
    def motor_torque(self) -> float:
        """Torque that the motor puts into the cables [N m]."""
        found, _ = stepper.torque(self.cables, self._state, False, self.motor_angle)
        return float(found)

    def tension(self, cable: int) -> FloatArray:
        node = tensions(self._state[cable], int(self.cables.n[cable]))
        return np.maximum(node, 0.0)

    @exclusive
    def step(self, motor_torque: float, joint_angle: float) -> None:
        """Advance one period with a motor torque [N m] and a joint angle [rad]."""
        self.motor_angle = stepper.balance(
            self.cables, self._state, False, joint_angle, self.motor_angle,
            stepper.NO_LOAD._replace(torque=motor_torque), self.drive.period,
            self._new, self._work,
        )  # fmt: skip
        self._state[:] = self._new

    def run(
        self,
        controller: Controller,
        angle: FloatArray,
        desired: FloatArray,
        progress: Callable[[int], None] = lambda step: None,
    ) -> dict[str, FloatArray]:
        """Let a controller drive the device through a motion of the joint.

        The controller is made for the drive, or for one with other cables; angle [rad]
        and desired torque [N m] are the joint's, (samples,). Returns `COLUMNS`,
        (samples,) each; the torque of the motor is that which follows from the sample.
        """
        motion = _Motion(self, angle, desired)
        trace = Trace(COLUMNS, motion.steps)

        def observe(step: int, columns: Columns, torque: FloatArray) -> None:
            trace.keep(step, {**columns, "motor_torque_nm": torque}, torque)
            progress(step)

        run(motion, controller, observe)
        return trace.columns


class _Motion:
    """A motion of the joint, as a `DrivenDevice`."""

    def __init__(
        self, device: InertiaFree, angle: FloatArray, desired: FloatArray
    ) -> None:
        self._device, self._angle, self._desired = device, angle, desired
        self.steps = angle.size - 1
        self.prefixes: tuple[str, ...] = ("",)
        self._at = 0

    def start(self) -> Columns:
        self._at = 0
        self._device.reset(float(self._angle[0]))
        return self._columns(self._device.motor_angle)

    def advance(self, torque: FloatArray) -> Columns:
        before = self._device.motor_angle
        self._at += 1
        self._device.step(float(torque), float(self._angle[self._at]))
        return self._columns(before)

    def _columns(self, motor_before: float) -> Columns:
        device, at = self._device, self._at
        now, before = float(self._angle[at]), float(self._angle[max(at - 1, 0)])
        period = device.drive.period
        return {
            "motor_angle_rad": device.motor_angle,
            "motor_velocity_rad_s": (device.motor_angle - motor_before) / period,
            "joint_angle_rad": now,
            "joint_velocity_rad_s": (now - before) / period,
            "joint_torque_nm": device.joint_torque,
            "desired_torque_nm": float(self._desired[at]),
        }
