"""Values of fitted parameters with 95 % intervals, and those the data do not determine.

Three things make a parameter uncertain: noise, disagreement between parts of the data,
and errors of form that all parts share.

*Disagreement* between parts of the data exceeds that by noise. Every trial is left out
in turn, by one Gauss-Newton step from the fit: its Jacobian and residuals are at hand,
so nothing is fitted again. The move of a parameter is divided by the move that noise
would make, so that a trial which alone determines a parameter counts as one of many,
whatever its leverage: the parameter moves far without it, and noise would do that, too.

*Form*: a rig has what its scene has not, such as ends and seals that give or hold a
little (the effects of ordinary size), and forms that are not those of the library. All
trials share that, so they agree about parameters that are off. But a wrong model errs
in directions beside those of its parameters as well, and there the residuals show it:
the sizes that they show of effects of which a rig has none, or hardly any, are the size
of such errors, as negative controls measure a bias (Schuemie et al., Stat. Med. 33,
2014).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis._fit.fitting import Masks, Problem, TorqueDerivatives, jacobian
from cc_mujoco.diagnosis._fit.plausibility import (
    amplitude_indices,
    max_ordinary_size,
    shape_indices,
)
from cc_mujoco.diagnosis._rig.records import Record
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.estimation._least_squares import (
    Estimate,
    covariance,
    estimate,
    undetermined_directions,
)
from cc_mujoco.native import FloatArray


class Spread(NamedTuple):
    """Uncertainty of the place of a fit.

    Attributes:
        covariance: (parameters, parameters).
        freedom: (parameters,) degrees of freedom with which its diagonal is known, see
            `estimation._least_squares.estimate`.
    """

    covariance: FloatArray
    freedom: FloatArray


def noise_covariance(problem: Problem, x: FloatArray, masks: Masks) -> Spread:
    """Return the covariance by noise alone, a lower bound of `fit_covariance`."""
    found: FloatArray = covariance(jacobian(problem, x, masks))
    return Spread(found, np.full(x.size, np.inf))


def fit_covariance(problem: Problem, x: FloatArray, masks: Masks) -> Spread:
    """Return the covariance of a fit by noise, disagreement of trials and form.

    A model that is a little wrong fits every trial differently, and all of them a
    little off, which noise does not show. Noise makes B; a parameter about which trials
    disagree by a factor f of that (`disagreement`) has f B_kk; and errors that all
    trials share add their shifts (`form_error`). Only the second comes from so few
    numbers that it takes Student's t: its degrees of freedom are over the square of its
    share of the variance (Satterthwaite, Biometrics Bulletin 2, 1946).
    """
    fresh = replace(problem, slopes=TorqueDerivatives())
    slopes = jacobian(fresh, x, masks)
    residual = fresh.residual(x, masks)
    # The weights of the errors already count independent samples only.
    noise = covariance(slopes)
    moved = disagreement(slopes, residual, parts_of(problem.plant.records, masks))
    beyond = np.sqrt(np.maximum(moved.factor - 1.0, 0.0))
    trials = noise * (1.0 + np.outer(beyond, beyond))
    controls = controls_of(fresh, x, masks)
    data = len(controls)
    form = form_error(slopes[:data], residual[:data], noise, controls)
    share = np.diag(trials) / np.diag(trials + form)
    freedom = np.where(beyond > 0.0, moved.freedom / share**2, np.inf)
    return Spread(trials + form, freedom)


def estimates(problem: Problem, x: FloatArray, spread: Spread) -> dict[str, Estimate]:
    """Return the value and interval of every parameter.

    An interval over more than six powers of ten says nothing and is NaN: the data do
    not determine that parameter.
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
        if (
            parameter.factor
            and _log_span(found[parameter.name]) > 2.0 * Limit.max_log_factor
        ):
            nothing = replace(found[parameter.name], ci95=(math.nan, math.nan))
            found[parameter.name] = nothing
    for name in problem.effects:
        for index in amplitude_indices(problem, [name]):
            tuned = problem.tuned[index]
            if tuned.low * tuned.scale + tuned.start != 0.0:
                continue
            if shape_indices(problem, name) and x[index] > 0.0:
                found[tuned.name] = _proportional_interval(found[tuned.name])
            else:  # no size is below 0
                interval_found = found[tuned.name]
                within = max(interval_found.ci95[0], 0.0), interval_found.ci95[1]
                found[tuned.name] = replace(interval_found, ci95=within)
    return found


def _log_span(found: Estimate) -> float:
    low, high = found.ci95
    return math.log(high / low) if low > 0.0 else math.inf


def _proportional_interval(found: Estimate) -> Estimate:
    low, high = found.ci95
    reach = math.exp(min(0.5 * (high - low) / found.value, Limit.max_log_factor))
    return Estimate(found.value, found.unit, (found.value / reach, found.value * reach))


def undetermined(problem: Problem, x: FloatArray, masks: Masks) -> tuple[str, ...]:
    """Return a sentence for each parameter combination that only priors determine."""
    found = []
    whole = jacobian(problem, x, masks)
    priors = sum(math.isfinite(parameter.prior) for parameter in problem.tuned)
    data = whole[: whole.shape[0] - priors]
    for shares in undetermined_directions(
        covariance(data), Limit.undetermined_deviation
    ):
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
                "was known before distinguishes them."
            )
    found.append(
        "Friction enters only as its product with the wrap angle, which is the scene's."
    )
    return tuple(found)


def form_error(
    slopes: FloatArray, residual: FloatArray, spread: FloatArray, controls: FloatArray
) -> FloatArray:
    r"""Covariance (parameters, parameters) by errors of form, beside that of noise.

    The error is taken as a sum of the controls' signatures, isotropic in their span:
    with an orthonormal basis Q of it, r = J b + Q c + noise, c of variance v each. Of
    that the residuals of a fit keep M Q c, M = I - J H^-1 J^T. So their square along
    the q directions of M Q has the mean q + v tr(Q^T M Q), which gives v (moments, as
    of DerSimonian and Laird, Control. Clin. Trials 7, 1986), and the fit is off by
    H^-1 J^T Q c. Along no direction is v more than the largest of the controls makes:
    what is larger than any rig has is no form but something that is missing.

    Args:
        slopes: (data, parameters) J, those of priors left out.
        residual: (data,) in units of their noise.
        spread: (parameters, parameters) H^-1, priors included.
        controls: (data, controls) changes of the residuals by each, as large as a rig
            may have it.
    """
    nothing = np.zeros_like(spread)
    size = np.linalg.norm(controls, axis=0)
    controls = controls[:, size > 0.0] / size[size > 0.0]
    if not controls.size:
        return nothing
    base = _basis(controls)
    into = base.T @ slopes @ spread
    beside = base - slopes @ into.T
    kept = float(np.sum(base * beside))
    shown = _basis(beside) if np.linalg.norm(beside) > Limit.new else beside[:, :0]
    if not shown.size:
        return nothing
    along = shown.T @ residual
    excess = float(along @ along) - shown.shape[1]
    most = float(np.max(size)) ** 2
    found: FloatArray = min(max(excess, 0.0) / kept, most) * (into.T @ into)
    return found


def _basis(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis (rows, k) of columns of length 1 at most."""
    left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    found: FloatArray = left[:, sizes > Limit.new]
    return found


def controls_of(problem: Problem, x: FloatArray, masks: Masks) -> FloatArray:
    """Return changes of residuals (data, controls) by effects of ordinary size.

    Effects that the model has are fitted and left out here.
    """
    count = sum(
        len(record.measured) * int(np.sum(mask))
        for record, mask in zip(problem.plant.records, masks, strict=True)
    )
    wider, sizes = problem, []
    for name, effect in problem.plant.library.effects.items():
        if name in problem.effects:
            continue
        if all(parameter.ordinary > 0.0 for parameter in effect.parameters):
            wider = wider.with_effect(name, {})
            sizes += [
                max_ordinary_size(problem, x, parameter)
                for parameter in effect.parameters
            ]
            place = np.concatenate([x, np.zeros(len(wider.tuned) - x.size)])
            # One after another: derivatives that are known are taken over.
            slopes = jacobian(wider, place, masks)
    if wider is problem:
        return np.zeros((count, 0))
    scales = [each.scale for each in wider.tuned[x.size :]]
    found: FloatArray = slopes[:count, x.size :] * np.array(sizes) / scales
    return found


class Disagreement(NamedTuple):
    """Result of leaving out parts of the data.

    Attributes:
        factor: (parameters,) mean square of the moves over what noise makes of it; 1
            where noise is all there is.
        freedom: (parameters,) degrees of freedom with which that is known.
    """

    factor: FloatArray
    freedom: FloatArray


def disagreement(
    slopes: FloatArray, residual: FloatArray, parts: NDArray[np.int64]
) -> Disagreement:
    r"""Return moves of a least-squares fit whose parts are left out in turn.

    With J the Jacobian of the residuals r, H = J^T J, and H_g, s_g = J_g^T r_g those of
    a part, the fit moves by d_g = (H - H_g)^-1 s_g without it (Cook 1977), of which
    noise makes the variance (H - H_g)^-1 - H^-1. The factor is the mean of
    d_g^2 / variance, an overdispersion as of Birge (Phys. Rev. 40, 1932), and of
    Hartung and Knapp (Stat. Med. 20, 2001) where trials give one number each. Its
    freedom is Satterthwaite's, G^2 over the sum of the squared correlations of the
    moves (Bell and McCaffrey, Survey Methodology 28, 2002): G - 1 for G equal parts.

    Args:
        slopes: (residuals, parameters) of the residuals, priors last.
        residual: (residuals,) in units of their noise.
        parts: (data,) number of the part of each residual; those of priors have none.
    """
    whole = covariance(slopes)
    root: list[FloatArray] = []
    pull: list[FloatArray] = []
    for part in np.unique(parts):
        rows = np.flatnonzero(parts == part)
        # A triangle has the same square as the rows, which may be many.
        root.append(np.asarray(np.linalg.qr(slopes[rows], mode="r")))
        pull.append(slopes[rows].T @ residual[rows])
    square = [each.T @ each for each in root]
    known = slopes[parts.size :]
    without = [
        covariance(np.concatenate([*root[:place], *root[place + 1 :], known]))
        for place in range(len(root))
    ]
    factor = np.ones(slopes.shape[1])
    freedom = np.full(slopes.shape[1], np.inf)
    for k in range(factor.size):
        row = [each[k] for each in without]
        shares = np.array([a @ b for a, b in zip(row, square, strict=True)])
        moved = np.array([a @ b for a, b in zip(row, pull, strict=True)])
        joint = -shares @ whole @ shares.T
        joint[np.diag_indices_from(joint)] += np.sum(shares * np.array(row), axis=1)
        size = np.diag(joint)
        counted = size > Limit.min_variance_share * whole[k, k]
        if np.sum(counted) < 2:
            continue
        deviation = np.sqrt(size[counted])
        correlation = joint[np.ix_(counted, counted)] / np.outer(deviation, deviation)
        factor[k] = float(np.mean((moved[counted] / deviation) ** 2))
        freedom[k] = deviation.size**2 / float(np.sum(correlation**2))
    return Disagreement(factor, freedom)


def parts_of(
    records: Sequence[Record], masks: Sequence[NDArray[np.bool_]]
) -> NDArray[np.int64]:
    """Return the group of each residual (data,): its trial and its repetitions.

    With fewer trials than `Limit.least` it is one of the pieces of every record.
    """
    used = [bool(mask.any()) for mask in masks]
    groups = sorted({r.group for r, some in zip(records, used, strict=True) if some})
    found = []
    for place, (record, mask) in enumerate(zip(records, masks, strict=True)):
        count = int(np.sum(mask))
        if len(groups) >= Limit.least:
            own = np.full(count, groups.index(record.group) if count else 0)
        else:
            own = place * Limit.record_pieces + np.arange(
                count
            ) * Limit.record_pieces // max(count, 1)
        found.append(np.tile(own, len(record.measured)))
    return np.concatenate(found).astype(np.int64)
