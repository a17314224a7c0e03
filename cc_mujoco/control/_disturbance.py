"""Disturbance observer: it compensates errors of the model (Fig. 4.2)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._validation import require_number
from cc_mujoco.control import _compiled_laws as compiled_laws
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._model_based import Mismatch, ModelBased
from cc_mujoco.device._drive import Drive
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal

_KNOWN, _TORQUE, LACK_SIZE = range(3)
"""Places in the memory of the lacking torque, and its size: whether a torque was
applied; the disturbance [N m]."""


class DisturbanceObserver(ModelBased):
    r"""Model-based with a disturbance observer: input not explained by the model.

    \[ \tau_m = u_r + \frac{\omega_c}{s + \omega_c}
       \bigl( \tau_m - \hat\tau_m \bigr) \]

    with the torque \(u_r\) of `ModelBased`, the torque \(\tau_m\) applied before and
    the torque \(\hat\tau_m\) that the model needs to explain motor angle and joint
    torque. Their difference is the friction beyond the model, and the torque that
    accelerates the rotor; the low-pass suppresses sensor noise (thesis 4.2, Fig. 4.2).
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
            drive: The device to be driven; its `cables` must be known.
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
        self.share = -math.expm1(-2.0 * math.pi * cutoff * drive.period)
        """Share of a new value in the disturbance."""
        self._lack: FloatArray = np.zeros((0, LACK_SIZE))

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        super().reset(where)
        if where is None:
            self._lack = np.zeros((0, LACK_SIZE))
        elif len(self._lack):
            self._lack[where] = 0.0

    def disturbance(self) -> FloatArray:
        """Return the motor torque that is added to the feed-forward (rows,) [N m].

        While the guard releases the joint, nothing is learned and the estimate is
        reset: it may be the reason of the release.
        """
        load = self.model.motor_torque()
        if len(self._lack) != len(load):
            self._lack = np.zeros((len(load), LACK_SIZE))
        found = np.empty(len(load))
        _learn_all(self.share, load, self.memory(len(load)), self._lack, found)
        return found


@internal
def learn_lack(
    share: float, load: float, memory: FloatArray, lack: FloatArray
) -> float:
    """Return the motor torque that the model lacks, with that of the last step [N m].

    `share` is the weight of the new value, `load` the motor torque that the model
    explains [N m]; `lack` (`LACK_SIZE`,), 0 at the start, is updated.
    """
    if memory[compiled_laws.RELEASED] != 0.0:
        lack[:] = 0.0
    unexplained = 0.0
    if lack[_KNOWN] != 0.0:
        unexplained = memory[compiled_laws.GUARD + guard.COMMAND] - load
    lack[_KNOWN] = 1.0
    lack[_TORQUE] += share * (unexplained - lack[_TORQUE])
    return float(lack[_TORQUE])


@compiled
def _learn_all(
    share: float,
    load: FloatArray,
    memory: FloatMatrix,
    lack: FloatMatrix,
    found: FloatArray,
) -> None:
    for row in range(found.size):
        found[row] = learn_lack(share, load[row], memory[row], lack[row])
