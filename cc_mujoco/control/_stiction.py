"""Static friction crossed at once: Listing 4.1 of the thesis, with the model."""

from __future__ import annotations

import dataclasses

import numpy as np

from cc_mujoco._validation import require_number
from cc_mujoco.cable._stepper import Counts
from cc_mujoco.control import _compiled_laws as compiled_laws
from cc_mujoco.control._model_based import Mismatch, ModelBased
from cc_mujoco.device._drive import Drive
from cc_mujoco.native import FloatArray, FloatCube, FloatMatrix, compiled


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
            drive: The device to be driven; its `cables` must be known.
            proportional: Kp [-].
            integral: Ki [1/s].
            mismatch: See `ModelBased`.
            settling: See `ModelBased`.
            preview: h [s].
            tolerance: Torque at the joint below which the sense does not turn [N m];
                1 % of the greatest by default.

        Raises:
            CableError: As `ModelBased`, or a preview or tolerance that is negative.
        """
        super().__init__(drive, proportional, integral, mismatch, settling)
        most = abs(drive.ratio) * max(abs(drive.low), abs(drive.high))
        self.preview = preview
        self.tolerance = 0.01 * most if tolerance is None else tolerance
        require_number("preview", self.preview, 0.0, 10.0, "s")
        require_number("tolerance", self.tolerance, 0.0, 1e6, "N m")

    @property
    def gains(self) -> compiled_laws.FeedbackGains:
        return dataclasses.replace(
            super().gains, preview=self.preview, tolerance=self.tolerance
        )

    def answer(self, seen: FloatArray) -> FloatArray:
        model, rows = self.model, len(seen)
        found = np.empty(rows)
        _torques(
            self.gains.packed,
            self.spring,
            model.packed,
            model.segments,
            model.distal,
            model.arm,
            model.state,
            self.memory(rows),
            seen,
            model.scratch,
            found,
        )
        return found


@compiled
def _torques(
    gains: FloatArray,
    spring: FloatArray,
    prm: FloatCube,
    n: Counts,
    distal: FloatArray,
    arm: FloatMatrix,
    state: FloatCube,
    memory: FloatMatrix,
    seen: FloatMatrix,
    scratch: FloatMatrix,
    found: FloatArray,
) -> None:
    for row in range(found.size):
        found[row] = compiled_laws.stiction(
            gains, spring, prm[row], n, distal, arm[row], state[row],
            memory[row], seen[row], scratch,
        )  # fmt: skip
