r"""Recursive estimate of one parameter that forgets only as new information arrives.

    fit = RecursiveEstimate(start=0.2, spread=0.2, memory=500)
    fit.update(information, target)      # of one sample, see `update`
    fit.value, fit.deviation

Plain exponential forgetting loses information while the data have none: the variance
winds up, and the next noise moves the estimate. Here the information S of the data, in
addition to the :math:`R_0` of the start, fades only with a sample that has information
(after Cao and Schwartz, Automatica 36, 2000),

.. math:: S' = S - (1 - \lambda) S^2 / (R_0 + S).

The information of the start never fades, which bounds the gain; it does not pull the
estimate to the start. Since a gain with forgetting does not minimise the variance, its
inverse is not the variance of the estimate. That is propagated separately. It is exact
for white noise of the stated size and a true value that is constant or drifts at a
constant rate of given standard deviation. The estimate lags by the drift over `memory`
samples.
"""

import numpy as np

from cc_mujoco._utils.arguments import MAX_FORCE, numbers
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray, compiled

ESTIMATE, VARIANCE, INFORMATION, DRIFT_COVARIANCE = range(4)
"""Numbers of one parameter: the estimate, the variance of its error, the information of
the data, and the covariance of the error with the rate of drift."""


@compiled
def update_estimate(
    known: FloatArray,
    least: float,
    fading: float,
    rate: float,
    information: float,
    target: float,
) -> None:
    """Update an estimate with the equations of one sample, which has noise 1.

    `known` (4,) is changed, see `ESTIMATE`. `least` is the information of the start,
    `fading` the share of the data's information that a sample takes away, and `rate`
    the variance of the rate of drift, per sample.
    """
    learnt = known[INFORMATION]
    learnt += information - fading * learnt * learnt / (least + learnt)
    gain = 1.0 / (least + learnt)
    known[INFORMATION] = learnt
    known[ESTIMATE] += gain * (target - information * known[ESTIMATE])
    kept = 1.0 - gain * information
    # The truth has moved on by its rate; then Joseph's form, right for any gain.
    lagging = known[DRIFT_COVARIANCE]
    ahead = known[VARIANCE] - 2.0 * lagging + rate
    known[DRIFT_COVARIANCE] = kept * (lagging - rate)
    known[VARIANCE] = kept * ahead * kept + gain * information * gain


class RecursiveEstimate:
    """Parameter that is estimated from linear equations, sample by sample."""

    def __init__(
        self, start: float, spread: float, memory: float, drift: float = 0.0
    ) -> None:
        """Start from the guess `start` of standard deviation `spread`.

        A sample's weight falls to 1/e after `memory` more that have information;
        `drift` is the standard deviation of the true value's rate of change per such
        sample.
        """
        if not memory >= 1.0:
            raise CableError(f"memory is {memory!r} samples; it must be at least 1")
        given = "start", "spread of the start", "drift"
        each = zip(given, (start, spread, drift), strict=True)
        guess, size, rate = (
            float(numbers(name, value, (), MAX_FORCE)) for name, value in each
        )
        if not size > 0.0:
            raise CableError(f"spread of the start is {size}; it must be positive")
        if not rate >= 0.0:
            raise CableError(f"drift is {rate}; it must be 0 or more")
        self._start = np.array([guess, size**2, 0.0, 0.0])
        self._settings = 1.0 / size**2, 1.0 - float(np.exp(-1.0 / memory)), rate**2
        self.reset()

    def reset(self) -> None:
        self._known = self._start.copy()

    @property
    def value(self) -> FloatArray:
        """Present estimate (1,)."""
        return self._known[:1].copy()

    @property
    def deviation(self) -> FloatArray:
        """Standard deviation of the error of `value` (1,)."""
        return np.asarray(np.sqrt(np.maximum(self._known[VARIANCE:][:1], 0.0)))

    def update(self, information: FloatArray, target: FloatArray) -> None:
        r"""Update the estimate by equations :math:`\Phi\theta = y` with noise 1.

        `information` is :math:`\Phi^T \Phi` (1, 1), `target` :math:`\Phi^T y` (1,).
        """
        gained, wanted = information.item(), target.item()
        if gained > 0.0:
            update_estimate(self._known, *self._settings, gained, wanted)
