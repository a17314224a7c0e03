"""Static friction crossed at once: Listing 4.1 of the thesis on top of the model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.checks import number
from cc_mujoco.control import compensation
from cc_mujoco.control.drive import Drive
from cc_mujoco.control.model_based import Mismatch, ModelBased


class StictionCompensation(ModelBased):
    r"""Model-based with stiction compensation: partial motion is crossed at once.

    As long as part of a cable stands still, the motor gives the torque at which
    equation 2.7 fails at every node that does, so that the whole cable follows at once
    (Listing 4.1). Which way it shall follow, the thesis does not say. Here it is the
    sign of

    \[ \tau_d - \tau_j + \kappa\, h\, \dot\theta_j \]

    the torque that is lacking and the motion of the joint that the motor must keep up
    with, ahead by the time h, with the stiffness \(\kappa\) of all cables at the joint.
    The sense turns only when that passes the tolerance the other way: a motor that must
    cross the whole backlash for every bit of noise would chatter.
    """

    def __init__(
        self,
        drive: Drive,
        proportional: float = 1.0,
        integral: float = 2.0,
        mismatch: Mismatch = 0.0,
        settling: float = 0.03,
        preview: float = 0.02,
        tolerance: float | None = None,
    ) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device to be driven; its `cable_drives` must be known.
            proportional: Kp [-].
            integral: Ki [1/s].
            mismatch: See `ModelBased`.
            settling: See `ModelBased`.
            preview: h [s].
            tolerance: Torque at the joint below which the sense does not turn [Nm];
                1 % of the greatest by default.

        Raises:
            CableError: As `ModelBased`, or a preview or tolerance that is negative.
        """
        super().__init__(drive, proportional, integral, mismatch, settling)
        most = abs(drive.ratio) * max(abs(drive.low), abs(drive.high))
        self.preview = preview
        self.tolerance = 0.01 * most if tolerance is None else tolerance
        number("preview", self.preview, 0.0, 10.0, "s")
        number("tolerance", self.tolerance, 0.0, 1e6, "Nm")
        self._sense: Any = 0.0
        self._turned: Any = False

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Start at rest in the pretension; see `Controller.reset`."""
        super().reset(where)
        self._sense = 0.0 if where is None else np.where(where, 0.0, self._sense)

    def unanswered(self, error: Any) -> Any:
        """The part of the error [Nm] that is left to the feedback.

        None when the sense has just turned: what is fed forward answers it.
        """
        return np.where(self._turned, 0.0, error)

    def feedforward(
        self, observation: Mapping[str, Any], desired: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Motor torque that is fed forward (rows,) [Nm]."""
        lack = desired - observation["joint_torque_nm"]
        motion = self.stiffness * self.preview * observation["joint_velocity_rad_s"]
        # Positive at the motor is what winds towards a positive ratio.
        wanted = np.sign(self.drive.ratio) * (lack + motion)
        turns = wanted * np.where(self._sense == 0.0, np.sign(wanted), -self._sense)
        self._turned = turns > self.tolerance
        self._sense = np.where(self._turned, np.sign(wanted), self._sense)
        model = self.model
        found: NDArray[np.float64] = compensation.whole(
            model.packed,
            model.segments,
            model.arm,
            model.distal,
            model.state,
            np.atleast_1d(self._sense),
            desired,
        )
        return found
