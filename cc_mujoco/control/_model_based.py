"""Friction compensation by a model of the cables, with feedback (thesis 4.2, Fig. 4.3).

>>> from cc_mujoco.device._drive import Drive, CableDrive
>>> from cc_mujoco.control import ModelBased
>>> from cc_mujoco.cable import Cable, Section
>>> cable = Cable(friction=0.1, conduit=(Section(2.0, 0.5),))
>>> pair = (CableDrive(cable, -0.02, -0.1), CableDrive(cable, 0.02, 0.1))
>>> law = ModelBased(Drive(5.0, -1.0, 1.0, 0.001, cables=pair))
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._validation import require_number
from cc_mujoco.cable._stepper import Counts
from cc_mujoco.control import _compiled_laws as compiled_laws
from cc_mujoco.control._cable_model import CableModel
from cc_mujoco.control._controller import as_round_pulley, readings
from cc_mujoco.control._proportional_integral import (
    ProportionalIntegral,
    stable_settling_time,
)
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray, FloatCube, FloatMatrix, compiled

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

    A step of the torque would throw a motor with inertia through the backlash and
    beyond. So its speed relative to the joint is damped, by the stiffness of the cables
    at the motor times T, so that it settles in about that time. The thesis has no
    inertia and needs none of this.
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
            drive: The device to be driven; its `cables` must be known.
            proportional: Kp [-].
            integral: Ki [1/s].
            mismatch: Deliberate relative error of the model's friction, above -1; or a
                function of the time since the reset [s] that gives it.
            settling: T [s]; 0 where the motor has no inertia. It is less where the
                damping, times period and motor lag, would exceed 0.8 of a known
                inertia: with a delay of one period, 1 is the edge of stability.

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
        require_number("settling", settling, 0.0, 10.0, "s")
        self.mismatch = mismatch
        self.settling = stable_settling_time(drive, self.spring, settling)
        self.model = CableModel(drive)
        self._calls: Any = 0

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        super().reset(where)
        self.model.reset(where)
        self._calls = 0 if where is None else np.where(where, 0, self._calls)

    def torque(self, observation: Mapping[str, Any]) -> Any:
        seen = readings(
            as_round_pulley(observation, self.drive), compiled_laws.LAW_INPUTS
        )
        self.admit(seen)
        self.follow(seen)
        found = self.answer(seen)
        numbers = np.ndim(observation["desired_torque_nm"]) == 0
        return float(found[0]) if numbers else found

    def follow(self, seen: FloatArray) -> None:
        """Update the model by the measurements (rows, `_compiled_laws.LAW_INPUTS`)."""
        self.model.follow(seen[:, compiled_laws.ANGLE], seen[:, compiled_laws.TORQUE])
        error = self.mismatch
        if callable(error):
            error = error(self._calls * self.drive.period)
        self._calls = self._calls + 1
        self.model.scale_friction(np.reshape(1.0 + error, (-1, 1)))

    def answer(self, seen: FloatArray) -> FloatArray:
        """Return the motor torque (rows,) [N m], after the model was updated."""
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
            model.slip_direction,
            model.gain,
            np.full(rows, self.disturbance(), dtype=float),
            self.memory(rows),
            seen,
            model.scratch,
            found,
        )
        return found

    def disturbance(self) -> Any:
        """Return the motor torque that is added to the feed-forward [N m]: none."""
        return 0.0


@compiled
def _torques(
    gains: FloatArray,
    spring: FloatArray,
    prm: FloatCube,
    n: Counts,
    distal: FloatArray,
    arm: FloatMatrix,
    state: FloatCube,
    slip_direction: FloatMatrix,
    gain: FloatMatrix,
    disturbance: FloatArray,
    memory: FloatMatrix,
    seen: FloatMatrix,
    scratch: FloatMatrix,
    found: FloatArray,
) -> None:
    for row in range(found.size):
        found[row] = compiled_laws.model_based(
            gains, spring, prm[row], n, distal, arm[row], state[row],
            slip_direction[row], gain[row], disturbance[row], memory[row], seen[row],
            scratch,
        )  # fmt: skip
