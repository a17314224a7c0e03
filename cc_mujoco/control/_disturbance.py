"""Disturbance observer: it compensates what a model cannot explain (Fig. 4.2)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._validation import require_number
from cc_mujoco.control import _compiled_laws as compiled_laws
from cc_mujoco.control._model_based import Mismatch, ModelBased
from cc_mujoco.device._drive import Drive


class DisturbanceObserver(ModelBased):
    r"""Model-based with a disturbance observer: input not explained by the model.

    \[ \tau_m = u_r + \frac{\omega_c}{s + \omega_c}
       \bigl( \tau_m - \hat\tau_m \bigr) \]

    with the torque \(u_r\) of `ModelBased`, the torque \(\tau_m\) applied before and
    the torque \(\hat\tau_m\) that the model needs to explain motor angle and joint
    torque. Their difference is what friction takes beyond the model, and what
    accelerates the rotor; the low-pass keeps sensor noise out (thesis 4.2, Fig. 4.2).
    """

    def __init__(
        self,
        drive: Drive,
        proportional: float = 1.0,
        integral: float = 2.0,
        mismatch: Mismatch = 0.0,
        settling: float = 0.03,
        cutoff: float = 3.0,
    ) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device to be driven; its `cable_drives` must be known.
            proportional: Kp [-].
            integral: Ki [1/s].
            mismatch: See `ModelBased`.
            settling: See `ModelBased`.
            cutoff: Of the low-pass [Hz].

        Raises:
            CableError: As `ModelBased`, or a cut-off that is not positive.
        """
        super().__init__(drive, proportional, integral, mismatch, settling)
        require_number("cutoff", cutoff, 1e-6, 0.5 / drive.period, "Hz")
        self._share = -math.expm1(-2.0 * math.pi * cutoff * drive.period)
        self._disturbance: Any = 0.0
        self._applied: Any = 0.0
        self._known: Any = False

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Reset the disturbance; see `Controller.reset`."""
        super().reset(where)
        keep = False if where is None else ~where
        self._disturbance = np.where(keep, self._disturbance, 0.0)
        self._known = np.where(keep, self._known, False)

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Return the torque of the motor [N m]; see `Controller.torque`."""
        self._applied = super().torque(observation)
        self._known = np.ones(np.shape(self._applied), dtype=np.bool_)
        return self._applied

    def disturbance(self) -> Any:
        """Return the motor torque that is added to the feed-forward [N m].

        While the guard lets the joint go, nothing is learned and what was learned is
        forgotten: it may be why the joint was let go.
        """
        released = self._memory[:, compiled_laws.RELEASED] != 0.0
        self._disturbance = np.where(released, 0.0, self._disturbance)
        self._known = self._known & ~released
        unexplained = np.where(
            self._known, self._applied - self.model.motor_torque(), 0.0
        )
        self._disturbance = self._disturbance + self._share * (
            unexplained - self._disturbance
        )
        return self._disturbance
