"""The setting of the thesis's simulations (4.3): a device without any inertia.

The motor is an ideal source of torque, the wearer an ideal source of position; the
cables stand between them. One step passes between a measurement and its effect.

    log = InertiaFree(drive).run(controller("model", drive), angle, desired)
    log["joint_torque_nm"]
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._layout import tensions
from cc_mujoco.control import Controller
from cc_mujoco.device._drive import Drive
from cc_mujoco.native import FloatArray
from cc_mujoco.simulation._loop import Columns, Trace, run


class InertiaFree:
    """Cables between a torque source and a position source; a `DrivenDevice`."""

    prefixes: tuple[str, ...] = ("",)

    def __init__(self, drive: Drive) -> None:
        """Prepare a device with the cables of a drive."""
        cables = [(s.cable, s.proximal, s.distal) for s in drive.cables]
        self.cables = stepper.make_cables(*zip(*cables, strict=True))
        self._work, self._period = stepper.scratch(self.cables), drive.period

    def run(
        self, controller: Controller, angle: FloatArray, desired: FloatArray
    ) -> dict[str, FloatArray]:
        """Simulate a controller that drives the device through a joint motion.

        The controller is made for the drive, or for one with other cables; angle [rad]
        and desired torque [N m] are the joint's, (samples,). Returns columns,
        (samples,) each; the motor torque of a sample is computed from that sample.
        """
        self._angle, self._desired, self.steps = angle, desired, angle.size - 1
        trace = Trace(
            ("motor_angle_rad", "motor_torque_nm", "joint_torque_nm"), self.steps
        )

        def observe(step: int, columns: Columns, torque: FloatArray) -> None:
            trace.keep(step, {**columns, "motor_torque_nm": torque}, torque)

        run(self, controller, observe)
        return trace.columns

    def start(self) -> Columns:
        """Start at rest in the pretension, with the joint at its first angle."""
        self._at, self.motor_angle = 0, 0.0
        self._state = stepper.rest_states(self.cables, 0.0, float(self._angle[0]))
        self._new = np.zeros_like(self._state)
        return self._columns(0.0)

    def advance(self, torque: FloatArray) -> Columns:
        """Advance a period with a motor torque [N m]."""
        before = self.motor_angle
        self._at += 1
        self.motor_angle = stepper.balance(
            self.cables, self._state, False, float(self._angle[self._at]), before,
            stepper.NO_LOAD._replace(torque=float(torque)), self._period, self._new,
            self._work,
        )  # fmt: skip
        self._state[:] = self._new
        return self._columns(before)

    def tension(self, cable: int) -> FloatArray:
        node = tensions(self._state[cable], int(self.cables.n[cable]))
        return np.maximum(node, 0.0)

    def _columns(self, motor_before: float) -> Columns:
        at, period = self._at, self._period
        now, before = float(self._angle[at]), float(self._angle[max(at - 1, 0)])
        torque = stepper.torque(self.cables, self._state, True, 0.0)[0]
        return {
            "motor_angle_rad": self.motor_angle,
            "motor_velocity_rad_s": (self.motor_angle - motor_before) / period,
            "joint_angle_rad": now,
            "joint_velocity_rad_s": (now - before) / period,
            "joint_torque_nm": float(torque),
            "desired_torque_nm": float(self._desired[at]),
        }
