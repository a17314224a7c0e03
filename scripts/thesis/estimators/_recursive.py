r"""Recursive least squares that forgets only where something new is learnt.

    fit = RecursiveLeastSquares(start=[0.2], spread=[0.2], memory=500)
    fit.update(information, target)      # of one sample, see `update`
    fit.value, fit.deviation

Plain exponential forgetting loses what it knew wherever the data are silent: the
covariance winds up and the next bit of noise moves the estimate. Here the information
of the data, S in addition to that of the start :math:`R_0`, fades only in the
directions V in which the new sample informs (after Cao and Schwartz, Automatica 36,
2000),

.. math::
    S' = S - (1 - \lambda) S V (V^T (R_0 + S) V)^{-1} V^T S,

and the information of the start never fades, which bounds the gain. It does not pull
the estimate to the start. Since a gain that forgets is not that of least variance, its
inverse is not the covariance of the estimate. That is carried along separately: exact
for white noise of the stated size and a truth that is constant or drifts at a constant
rate, of which the standard deviation is given. The estimate lags by what the truth
drifts in `memory` samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco._utils.arguments import MAX_FORCE, numbers
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._recursive import update_estimate
from cc_mujoco.native import FloatArray


class RecursiveLeastSquares:
    """Parameters of linear equations that arrive one after another.

    Attributes:
        value: the estimate (p,).
        covariance: covariance of its error (p, p).
    """

    def __init__(
        self, start: ArrayLike, spread: ArrayLike, memory: float, drift: ArrayLike = 0.0
    ) -> None:
        """Start from a guess.

        Args:
            start: the guess (p,).
            spread: standard deviation of its error (p,), or its covariance (p, p).
            memory: informative samples after which one has faded to 1/e.
            drift: standard deviation of the rate of drift per informative sample, (p,)
                or one for all.

        Raises:
            CableError: a memory shorter than one sample, a spread that is none, or a
                negative drift.
        """
        if not memory >= 1.0:
            raise CableError(f"memory is {memory!r} samples; it must be at least 1")
        self._start = numbers("start", start, high=MAX_FORCE)
        given = numbers("spread of the start", spread, high=MAX_FORCE)
        count = self._start.size
        if given.shape not in ((count,), (count, count)):
            raise CableError(
                f"spread of the start has shape {given.shape}; it must be ({count},), "
                f"or ({count}, {count}) of a covariance"
            )
        self._spread = np.diag(given**2) if given.ndim == 1 else given
        positive = np.all(np.diag(self._spread) > 0.0)
        if not positive or (given.ndim == 1 and np.any(given < 0.0)):
            raise CableError(
                f"spread of the start is {given.tolist()}; it must be positive"
            )
        each = numbers("drift", drift, high=MAX_FORCE)
        if each.shape not in ((), (1,), (count,)):
            raise CableError(f"drift has shape {each.shape}; it must be ({count},)")
        rate = np.broadcast_to(each, (count,))
        if not np.all(rate >= 0.0):
            raise CableError(f"drift is {rate.tolist()}; it must be 0 or more")
        self._rate = np.diag(rate**2)
        self._least = np.linalg.inv(self._spread)
        self._fading = 1.0 - float(np.exp(-1.0 / memory))
        self.reset()

    def reset(self) -> None:
        self.value = self._start.copy()
        self.covariance = self._spread.copy()
        self._information_matrix = np.zeros_like(self._spread)
        self._with_rate = np.zeros_like(self._spread)

    @property
    def deviation(self) -> FloatArray:
        """Standard deviation of the error of `value` (p,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    def update(self, information: FloatArray, target: FloatArray) -> None:
        r"""Take the equations :math:`\Phi\theta = y` of a sample, noise of variance 1.

        The information is :math:`\Phi^T \Phi` (p, p), the target :math:`\Phi^T y` (p,).
        """
        if self.value.size == 1:
            if not information[0, 0] > 0.0:
                return
            matrices = self.covariance, self._information_matrix, self._with_rate
            known = np.array([each.item() for each in (self.value, *matrices)])
            update_estimate(
                known, self._least.item(), self._fading, self._rate.item(),
                float(information[0, 0]), float(target[0]),
            )  # fmt: skip
            self.value, found = known[:1].copy(), known[1:].reshape(3, 1, 1)
            self.covariance, self._information_matrix, self._with_rate = found
            return
        size, axes = np.linalg.eigh(information)
        # A direction is silent below 1e-9 of the largest information.
        informed = axes[:, size > 1e-9 * max(float(size[-1]), 0.0)]
        if informed.shape[1] == 0 or not size[-1] > 0.0:
            return
        seen = self._information_matrix @ informed
        within = informed.T @ ((self._least + self._information_matrix) @ informed)
        learnt = self._information_matrix - self._fading * seen @ np.linalg.solve(
            within, seen.T
        )
        self._information_matrix = 0.5 * (learnt + learnt.T) + information
        gain = np.linalg.inv(self._least + self._information_matrix)
        self.value = self.value + gain @ (target - information @ self.value)
        kept = np.eye(self.value.size) - gain @ information
        # The truth has moved on by its rate; then Joseph's form, right for any gain.
        cross = self._with_rate
        ahead = self.covariance - cross - cross.T + self._rate
        self._with_rate = kept @ (cross - self._rate)
        self.covariance = kept @ ahead @ kept.T + gain @ information @ gain
