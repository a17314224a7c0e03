"""Position control that measures the joint: an upper bound for those that do not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._validation import require_number
from cc_mujoco.control._hysteresis import Array, HysteresisModel
from cc_mujoco.control._hysteresis_models import Line, SmoothBacklash
from cc_mujoco.control._position import BANDWIDTH, PositionController
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError

AHEAD = "backlash_inverse"
"""Parameters that are fed forward if the device has them."""


class DistalFeedback(PositionController):
    """Inverse of a smooth backlash, and integral feedback of the measured joint angle.

    Without parameters of the backlash the ideal ratio is fed forward. It needs a sensor
    that an endoscope does not have.
    """

    def __init__(
        self, drive: Drive, bandwidth: float = BANDWIDTH, gain: float = 20.0
    ) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device to be driven, with a sensor at the joint.
            bandwidth: Of the servo, see `PositionController` [rad/s].
            gain: Integral gain of the joint angle's error [1/s].

        Raises:
            CableError: The joint is not measured, or the gain is out of range.
        """
        super().__init__(drive, bandwidth)
        if not drive.joint_sensor:
            raise CableError(
                "controller 'distal_feedback' reads the angle of the joint, which this "
                "device does not measure; set joint_sensor = true in [sensors], or "
                "take another controller."
            )
        require_number("gain", gain, 0.0, 1e3, "1/s")
        self.gain = gain
        self._model: HysteresisModel = Line(1.0, 0.0)
        if AHEAD in drive.hysteresis:
            self._model = SmoothBacklash.from_dict(AHEAD, drive.hysteresis[AHEAD])
        self._state, self._correction = self._model.rest(0), np.zeros(0)

    def begin(self, rows: NDArray[np.intp], count: int) -> None:
        if len(self._state) != count:
            self._state, self._correction = self._model.rest(count), np.zeros(count)
        self._state[rows] = self._model.rest(rows.size)
        self._correction[rows] = 0.0

    def motor_angle(self, joint: Array, observation: Mapping[str, Any]) -> Array:
        error = joint + self.joint_start - observation["joint_angle_rad"]
        self._correction = self._correction + self.gain * self.drive.period * error
        ahead = self._model.invert(self._state, joint)
        found: Array = self.drive.ratio * (ahead + error + self._correction)
        return found
