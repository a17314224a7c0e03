"""Values of fitted parameters with 95 % intervals, and what the data do not tell."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.inference.disagreement import disagreement, parts_of
from cc_mujoco.diagnosis.inference.fitting import Masks, Problem
from cc_mujoco.diagnosis.inference.form import controls_of, form_error
from cc_mujoco.diagnosis.inference.jacobian import TorqueDerivatives, jacobian
from cc_mujoco.diagnosis.inference.plausibility import amplitudes, shapes
from cc_mujoco.estimation.least_squares import Estimate, covariance, estimate, untold

_WIDEST = 7.0
"""Logarithm of the largest factor of an interval in proportion."""
UNTOLD = 1.0
"""Deviation in units of priors from which on the data say less than was known."""


class Spread(NamedTuple):
    """Uncertainty of the place of a fit.

    Attributes:
        covariance: (parameters, parameters).
        freedom: (parameters,) degrees of freedom with which its diagonal is known, see
            `least_squares.estimate`.
    """

    covariance: FloatArray
    freedom: FloatArray


def narrowest(problem: Problem, x: FloatArray, masks: Masks) -> Spread:
    """The part of `spread` that noise makes: at most all of it."""
    found: FloatArray = covariance(jacobian(problem, x, masks))
    return Spread(found, np.full(x.size, np.inf))


def spread(problem: Problem, x: FloatArray, masks: Masks) -> Spread:
    """Covariance of where a fit ends: of noise, of trials that disagree, of form.

    A model that is a little wrong fits every trial otherwise, and all of them a little
    off, which noise does not tell. Noise makes B; a parameter about which trials
    disagree by a factor f of that (`disagreement`) has f B_kk; and errors that all
    trials share add what they shift (`form_error`). Only the second is known from so
    few numbers that it takes Student's t: its degrees of freedom are over the square of
    its share of the variance (Satterthwaite, Biometrics Bulletin 2, 1946).

    Args:
        problem: the model.
        x: where it was fitted to all data, see `fitting.settled`.
        masks: samples that took part.
    """
    fresh = replace(problem, slopes=TorqueDerivatives())
    slopes = jacobian(fresh, x, masks)
    residual = fresh.residual(x, masks)
    # The weights of the errors already count what is independent.
    noise = covariance(slopes)
    apart = disagreement(slopes, residual, parts_of(problem.plant.records, masks))
    beyond = np.sqrt(np.maximum(apart.factor - 1.0, 0.0))
    trials = noise * (1.0 + np.outer(beyond, beyond))
    controls = controls_of(fresh, x, masks)
    data = len(controls)
    form = form_error(slopes[:data], residual[:data], noise, controls)
    share = np.diag(trials) / np.diag(trials + form)
    freedom = np.where(beyond > 0.0, apart.freedom / share**2, np.inf)
    return Spread(trials + form, freedom)


def estimates(problem: Problem, x: FloatArray, spread: Spread) -> dict[str, Estimate]:
    """Value and interval of every parameter.

    An interval over more than six powers of ten says nothing and is NaN: the data do
    not determine that parameter.

    Args:
        problem: the model.
        x: where it was fitted.
        spread: of that.
    """
    deviations = np.sqrt(np.diag(spread.covariance))
    found = {
        parameter.name: estimate(parameter, place, deviation, freedom)
        for parameter, place, deviation, freedom in zip(
            problem.tuned,
            x.tolist(),
            deviations.tolist(),
            spread.freedom.tolist(),
            strict=True,
        )
    }
    for parameter in problem.tuned:
        if parameter.factor and _spans(found[parameter.name]) > 2.0 * _WIDEST:
            nothing = replace(found[parameter.name], ci95=(math.nan, math.nan))
            found[parameter.name] = nothing
    for name in problem.effects:
        for index in amplitudes(problem, [name]):
            tuned = problem.tuned[index]
            if tuned.low * tuned.scale + tuned.start != 0.0:
                continue
            if shapes(problem, name) and x[index] > 0.0:
                found[tuned.name] = _positive(found[tuned.name])
            else:  # no size is below 0
                told = found[tuned.name]
                within = max(told.ci95[0], 0.0), told.ci95[1]
                found[tuned.name] = replace(told, ci95=within)
    return found


def _spans(found: Estimate) -> float:
    """Return the logarithm of the factor between the ends of an interval."""
    low, high = found.ci95
    return math.log(high / low) if low > 0.0 else math.inf


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
