"""Friction compensation by a model of the cables, with feedback (thesis 4.2, Fig. 4.3).

>>> from cc_mujoco.control import Drive, ModelBased, CableDrive
>>> from cc_mujoco.transmission import Cable, Section
>>> cable = Cable(friction=0.1, conduit=(Section(2.0, 0.5),))
>>> pair = (CableDrive(cable, -0.02, -0.1), CableDrive(cable, 0.02, 0.1))
>>> law = ModelBased(Drive(5.0, -1.0, 1.0, 0.001, cable_drives=(pair,)))
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.checks import number
from cc_mujoco.control import compensation
from cc_mujoco.control.drive import Drive
from cc_mujoco.control.model import CableModel
from cc_mujoco.control.proportional_integral import ProportionalIntegral
from cc_mujoco.errors import CableError

Mismatch = float | Callable[[Any], Any]


class ModelBased(ProportionalIntegral):
    r"""Model-based: friction of the moving cables is fed forward; with PI feedback.

    \[ \tau_m = -\sum_i r_i\, C_i T_i + \frac{1}{\rho}
       \Bigl( K_p e + K_i \int e \, dt \Bigr) \]

    with the distal tensions \(T_i\) that make the desired torque, the arms \(r_i\) of
    the proximal ends [m/rad], signed, and the factor \(C_i\) of proximal to distal
    tension when cable i last slipped as a whole, by the model that follows the device
    (`CableModel`). Friction is in proportion to tension, so it multiplies instead of
    being added (thesis 4.2). Until the whole cable has turned, \(C_i\) keeps its value:
    partial motion is left to the feedback.

    A torque that suddenly changes would throw a motor with inertia through the backlash
    and beyond. So its speed relative to the joint is damped, by the stiffness of the
    cables at the motor times T, which makes it settle in about that time. The thesis
    has no inertia and needs none of this.
    """

    def __init__(
        self,
        drive: Drive,
        proportional: float = 1.0,
        integral: float = 2.0,
        mismatch: Mismatch = 0.0,
        settling: float = 0.03,
    ) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device to be driven; its `cable_drives` must be known.
            proportional: Kp [-].
            integral: Ki [1/s].
            mismatch: Relative error of the model's friction on purpose, above -1; or a
                function of the time since the reset [s] that gives it.
            settling: T [s]; 0 where the motor has no inertia.

        Raises:
            CableError: If the cables are not known, a gain is negative, or a constant
                mismatch makes friction negative.
        """
        super().__init__(drive, proportional, integral)
        if not (callable(mismatch) or (np.isfinite(mismatch) and mismatch > -1.0)):
            raise CableError(
                f"mismatch is {mismatch!r}; it must be a number above -1 or a function "
                "of time"
            )
        number("settling", settling, 0.0, 10.0, "s")
        self.mismatch = mismatch
        self.settling = settling
        self.stiffness = np.array(
            [
                sum(
                    cable_drive.distal**2
                    * cable_drive.cable.axial_stiffness
                    / cable_drive.cable.length
                    for cable_drive in row
                )
                for row in drive.cable_drives
            ]
        )
        """Of all cables at the joint, one for all environments or one each [Nm/rad]."""
        self.model = CableModel(drive)
        self._calls: Any = 0

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Start at rest in the pretension; see `Controller.reset`."""
        super().reset(where)
        self.model.reset(where)
        self._calls = 0 if where is None else np.where(where, 0, self._calls)

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Torque of the motor [Nm]; see `Controller.torque`."""
        desired = observation["desired_torque_nm"]
        torque = observation["joint_torque_nm"]
        self.follow(observation, torque)
        feedforward = self.feedforward(
            observation, np.atleast_1d(np.asarray(desired, dtype=float))
        )
        feedforward = feedforward - self._damping(observation)
        self._calls = self._calls + 1
        error = self.unanswered(desired - torque)
        if np.ndim(desired) == 0:
            return self.closed(float(feedforward[0]), float(np.ravel(error)[0]))
        return self.closed(feedforward, error)

    def follow(self, observation: Mapping[str, Any], joint_torque: Any) -> None:
        """Have the model follow the device."""
        self.model.follow(observation["motor_angle_rad"], joint_torque)
        error = self.mismatch
        if callable(error):
            error = error(self._calls * self.drive.period)
        self.model.scale_friction(np.reshape(1.0 + error, (-1, 1)))

    def unanswered(self, error: Any) -> Any:
        """The part of the error [Nm] that is left to the feedback: all of it."""
        return error

    def _damping(self, observation: Mapping[str, Any]) -> Any:
        """Torque against the motor's running ahead of the joint [Nm]."""
        ratio = self.drive.ratio
        keeping_up = ratio * observation["joint_velocity_rad_s"]
        relative_velocity = observation["motor_velocity_rad_s"] - keeping_up
        return self.settling * self.stiffness / ratio**2 * relative_velocity

    def feedforward(
        self, observation: Mapping[str, Any], desired: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Motor torque that is fed forward (rows,) [Nm]."""
        model = self.model
        found: NDArray[np.float64] = compensation.dynamic(
            model.packed,
            model.segments,
            model.arm,
            model.distal,
            model.slip_direction,
            model.gain,
            desired,
        )
        return found
