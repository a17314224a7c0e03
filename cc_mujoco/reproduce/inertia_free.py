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

from cc_mujoco.compiled import FloatArray
from cc_mujoco.control import Controller, Drive
from cc_mujoco.transmission import stepper
from cc_mujoco.transmission.packing import tensions

COLUMNS = (
    "motor_angle_rad",
    "motor_torque_nm",
    "joint_angle_rad",
    "joint_torque_nm",
    "desired_torque_nm",
)


class InertiaFree:
    """Cables between a torque and a position, stepped by a controller."""

    def __init__(self, drive: Drive) -> None:
        """Prepare.

        Args:
            drive: Its cables are those of the device.
        """
        self.drive = drive
        strands = drive.cables
        near, far = [s.near for s in strands], [s.far for s in strands]
        self.cables = stepper.between([s.cable for s in strands], near, far)
        self._work = stepper.scratch(self.cables)
        self.reset(0.0)

    def reset(self, joint_angle: float) -> None:
        """Rest in the pretension, with the joint at an angle [rad]."""
        self.motor_angle = 0.0
        self._state = stepper.at_rest(self.cables, self.motor_angle, joint_angle)
        self._new = np.zeros_like(self._state)

    @property
    def joint_torque(self) -> float:
        """Torque of the cables on the joint [Nm]."""
        return float(stepper.torque(self.cables, self._state, True, 0.0)[0])

    @property
    def motor_torque(self) -> float:
        """Torque that the motor puts into the cables [Nm]."""
        found, _ = stepper.torque(self.cables, self._state, False, self.motor_angle)
        return float(found)

    def tension(self, cable: int) -> FloatArray:
        """Tension of every node of a cable [N]."""
        node = tensions(self._state[cable], int(self.cables.n[cable]))
        return np.maximum(node, 0.0)

    def step(self, motor_torque: float, joint_angle: float) -> None:
        """Advance one period with a motor torque [Nm] and a joint angle [rad]."""
        self.motor_angle = stepper.balance(
            self.cables,
            self._state,
            False,
            joint_angle,
            self.motor_angle,
            stepper.FREE._replace(torque=motor_torque),
            self.drive.period,
            self._new,
            self._work,
        )
        self._state[:] = self._new

    def run(
        self,
        controller: Controller,
        angle: FloatArray,
        desired: FloatArray,
        progress: Callable[[int], None] = lambda step: None,
    ) -> dict[str, FloatArray]:
        """Let a controller drive the device through a motion of the joint.

        Args:
            controller: Made for the drive, or for one with other cables.
            angle: Of the joint (samples,) [rad].
            desired: Torque at the joint (samples,) [Nm].
            progress: Called with every sample.

        Returns:
            `COLUMNS`, (samples,) each; the torque of the motor is that which follows
            from the sample.
        """
        self.reset(float(angle[0]))
        controller.reset()
        rows = np.empty((len(COLUMNS), angle.size))
        torque, before, motor_before = 0.0, float(angle[0]), self.motor_angle
        for i in range(angle.size):
            now = float(angle[i])
            if i > 0:
                self.step(torque, now)
            period = self.drive.period
            observation = {
                "motor_angle_rad": self.motor_angle,
                "motor_velocity_rad_s": (self.motor_angle - motor_before) / period,
                "joint_angle_rad": now,
                "joint_velocity_rad_s": (now - before) / period,
                "joint_torque_nm": self.joint_torque,
                "desired_torque_nm": float(desired[i]),
            }
            before, motor_before = now, self.motor_angle
            torque = controller.torque(observation)
            rows[:, i] = [observation.get(name, torque) for name in COLUMNS]
            progress(i)
        return dict(zip(COLUMNS, rows, strict=True))
