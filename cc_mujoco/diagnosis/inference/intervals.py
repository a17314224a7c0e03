"""Values of fitted parameters with 95 % intervals, and what the data do not tell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.inference.fitting import Masks, Problem
from cc_mujoco.diagnosis.inference.jacobian import Slopes, jacobian
from cc_mujoco.diagnosis.inference.plausibility import amplitudes, shapes
from cc_mujoco.estimation.least_squares import Estimate, covariance, estimate, untold

LEAST = 3
"""Trials from which on they tell how much they disagree."""
_WIDEST = 7.0
"""Logarithm of the largest factor of an interval in proportion."""
UNTOLD = 1.0
"""Deviation in units of priors from which on the data say less than was known."""


def narrowest(problem: Problem, x: FloatArray, masks: Masks) -> FloatArray:
    """The part of `spread` that noise makes, for its arguments: at most all of it."""
    found: FloatArray = covariance(jacobian(problem, x, masks))
    return found


def spread(
    problem: Problem,
    x: FloatArray,
    masks: Masks,
    places: Sequence[FloatArray] = (),
) -> FloatArray:
    """Covariance (parameters, parameters) of where a fit ends.

    Args:
        problem: the model.
        x: where it was fitted to all data.
        masks: samples that took part.
        places: where it was fitted with a part of the trials left out in turn. A model
            that is a little wrong fits every trial otherwise, and noise does not tell
            how much: the jackknife does. Without such fits the trials' pulls on the
            parameters tell (cluster-robust: Liang and Zeger, Biometrika 73, 1986).
    """
    fresh = replace(problem, slopes=Slopes())
    slopes = jacobian(fresh, x, masks)
    # The weights of the errors already count what is independent.
    found = covariance(slopes)
    if len(places) > 1:
        apart = np.array(places) - np.mean(places, axis=0)
        disagreement: FloatArray = (1.0 - 1.0 / len(places)) * (apart.T @ apart)
        return found + disagreement
    moved = _pulls(fresh, x, masks, slopes) @ found
    count = len(moved)
    if count < LEAST:
        return found
    disagreement = count / (count - 1.0) * (moved.T @ moved)
    return found + disagreement


def _pulls(
    problem: Problem, x: FloatArray, masks: Masks, slopes: FloatArray
) -> FloatArray:
    """Slope of the cost by the errors of each trial (trials, parameters)."""
    residual = problem.residual(x, masks)
    trials: dict[str, FloatArray] = {}
    nothing = np.zeros(x.size)
    first = 0
    for record, mask in zip(problem.plant.records, masks, strict=True):
        rows = slice(first, first + len(record.measured) * int(np.sum(mask)))
        first = rows.stop
        if rows.stop > rows.start:
            own = slopes[rows].T @ residual[rows]
            trials[record.group] = trials.get(record.group, nothing) + own
    return np.array(list(trials.values()))


def estimates(
    problem: Problem, x: FloatArray, covariance: FloatArray
) -> dict[str, Estimate]:
    """Value and interval of every parameter.

    Args:
        problem: the model.
        x: where it was fitted.
        covariance: of that, see `spread`.
    """
    deviations = np.sqrt(np.diag(covariance)).tolist()
    found = {
        parameter.name: estimate(parameter, place, deviation)
        for parameter, place, deviation in zip(
            problem.tuned, x.tolist(), deviations, strict=True
        )
    }
    for name in problem.effects:
        if not shapes(problem, name):
            continue
        for index in amplitudes(problem, [name]):
            tuned = problem.tuned[index]
            if tuned.low * tuned.scale + tuned.start == 0.0 < x[index]:
                found[tuned.name] = _positive(found[tuned.name])
    return found


def _positive(found: Estimate) -> Estimate:
    """With an interval in proportion, for a size that is not 0 whatever its shape."""
    low, high = found.ci95
    reach = math.exp(min(0.5 * (high - low) / found.value, _WIDEST))
    return Estimate(found.value, found.unit, (found.value / reach, found.value * reach))


def undetermined(problem: Problem, x: FloatArray, masks: Masks) -> tuple[str, ...]:
    """A sentence for each combination of parameters that only priors determine."""
    found = []
    whole = jacobian(problem, x, masks)
    priors = sum(math.isfinite(parameter.prior) for parameter in problem.tuned)
    data = whole[: whole.shape[0] - priors]
    for shares in untold(covariance(data), UNTOLD):
        parts = [
            parameter.name
            for parameter, share in zip(problem.tuned, shares, strict=True)
            if abs(share) > 0.3
        ]
        names = " against ".join(parts)
        if len(parts) == 1:
            found.append(f"{names} hardly changes the outputs; its value is a guess.")
        else:
            found.append(
                f"{names}: changed together these hardly change the outputs; only what "
                "was known before tells them apart."
            )
    found.append(
        "friction counts only times the wrap angle; the wrap of the scene is taken."
    )
    return tuple(found)
