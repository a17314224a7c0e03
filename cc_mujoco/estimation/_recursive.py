r"""Recursive estimate of one parameter that forgets only as new information arrives.

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
