"""Fitted values: possible, significant, larger than ordinary; with 95 % intervals.

Plausible sizes are those of the bench, scaled to the rig. `EffectParameter.typical` is
for a bench of `Limit.tension`, `Limit.radius`, `Limit.length` and `Limit.stiffness`. On
another rig forces scale with the tension, torques with tension and radius, stretches
with the stretch of the cable.

Noise, disagreement between trials and errors of form make a parameter uncertain
(`concepts.md`, Intervals). A trial is left out by a Gauss-Newton step, so nothing is
fitted again; moves are divided by those that noise would make, so a trial which alone
determines a parameter counts as one of many. Trials that share an error of form agree
about parameters that are off; but a wrong model errs in other directions as well, and
there the residuals show the size of such errors, as negative controls measure a bias
(Schuemie et al., Stat. Med. 33, 2014).
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis._fit.problem import Masks, Problem, TorqueDerivatives, jacobian
from cc_mujoco.diagnosis._rig.records import Record
from cc_mujoco.diagnosis._rig.simulation import plausible_range
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.diagnosis.effects._effect import ANTAGONIST, EffectParameter
from cc_mujoco.estimation import _least_squares as least_squares
from cc_mujoco.estimation._least_squares import Estimate
from cc_mujoco.native import FloatArray

IMPLAUSIBLE_PREFIX = "fits only with"
"""Beginning of the reason not to name an effect whose size is impossible."""


class Spread(NamedTuple):
    covariance: FloatArray  # (parameters, parameters)
    freedom: FloatArray  # (parameters,) degrees of freedom of its diagonal
    # (parameters,) variance of effects' values by the laws of the others, which decides
    # about none of them
    laws: FloatArray | float = 0.0


def implausibility(problem: Problem, x: FloatArray) -> str:
    values = problem.values(x)
    for name in problem.effects:
        for parameter in problem.plant.library.effects[name].parameters:
            low, high = plausible_range(parameter, problem.plant)
            value = values[parameter.name]
            slack = 1e-3 * parameter.typical
            if not low - slack <= value <= high + slack:
                unit = f" {parameter.unit}".removesuffix(" 1")
                return (
                    f"{IMPLAUSIBLE_PREFIX} {parameter.name} {value:.3g}{unit}, which "
                    f"is beyond {low:.3g} to {high:.3g}{unit}"
                )
        together = problem.plant.library.effects[name].implausible
        if together is not None and (reason := together(values)):
            return f"{IMPLAUSIBLE_PREFIX} {reason}"
    return ""


def doubtful_effects(
    problem: Problem, x: FloatArray, covariance: FloatArray, freedom: FloatArray
) -> list[str]:
    """Return the effects of the model whose size may be 0, given all others.

    Their joint confidence interval contains 0 (F distribution). The fit's `covariance`
    (parameters, parameters) has `freedom` (parameters,) degrees of freedom.
    """
    found = []
    for name in problem.effects:
        index = amplitude_indices(problem, [name])
        size = x[index]
        # Where an undetermined shape makes the size uncertain, a large size with one
        # shape is a small one with another, and none is 0: the test is of the size at
        # its shape, and allows for the choice of the shape.
        shape = shape_indices(problem, name)
        part = covariance[np.ix_(index, index)]
        if shape:
            across = covariance[np.ix_(index, shape)]
            within = covariance[np.ix_(shape, shape)]
            part = part - across @ np.linalg.solve(within, across.T)
        if _over_limit(size, part, freedom[index], len(shape)) < 1.0:
            found.append(name)
    return found


def _over_limit(
    move: FloatArray, covariance: FloatArray, freedom: FloatArray, chosen: int = 0
) -> float:
    """Return the squared length of a move over that of 95 % of moves by chance.

    Its `covariance` has `freedom` (parameters,) degrees of freedom (F distribution);
    `chosen` parameters beside it had their best values.
    """
    from scipy.special import fdtri

    contrast = np.linalg.solve(covariance, move).astype(np.float64)
    count = move.size + chosen
    # Freedom of a sum of sizes with these weights (Satterthwaite, see above).
    shares = contrast**2 * np.diag(covariance)
    total, known = float(np.sum(shares)), least_squares.MAX_FREEDOM
    if total > 0.0:
        spread = max(float(np.sum(shares**2 / freedom)), 1e-300)
        known = min(total**2 / spread, least_squares.MAX_FREEDOM)
    least = count * float(fdtri(count, known, Limit.nonzero_confidence))
    return float(move @ contrast) / least


def is_ordinary(
    problem: Problem, x: FloatArray, name: str, spread: Spread | None = None
) -> bool:
    """Return whether an effect may be no larger than any real rig may have it.

    At each cable its sizes add up to one at most, or such sizes lie in the confidence
    region by the `spread` of the fit.
    """
    from scipy.optimize import nnls

    values = problem.values(x)
    own = problem.plant.library.effects[name].parameters
    if not all(parameter.ordinary for parameter in own):
        return False
    usual = np.array([ordinary_size(problem, x, p) for p in own])
    sizes = np.abs([values[p.name] for p in own]) / usual
    second = np.array([ANTAGONIST in p.name for p in own])
    sides = np.array([~second, second], dtype=np.float64)
    if spread is None or (sides @ sizes).max() <= 1.0:
        return bool((sides @ sizes).max() <= 1.0)
    index = [problem.names.index(p.name) for p in own]
    scales = np.array([problem.tuned[k].scale for k in index]) / usual
    part = spread.covariance[np.ix_(index, index)] * np.outer(scales, scales)
    squares, axes = np.linalg.eigh(part)
    white = axes.T / np.sqrt(np.maximum(squares, 1e-12 * squares[-1]))[:, None]
    # The nearest such sizes, each with what it lacks of an ordinary one at its cable
    firm = 1e4 * np.abs(white).max()
    sums = firm * np.hstack([sides, np.eye(2)])
    rows = np.vstack([np.pad(white, ((0, 0), (0, 2))), sums])
    nearest = nnls(rows, np.append(white @ sizes, [firm, firm]))[0][: len(own)]
    return _over_limit(sizes - nearest, part, spread.freedom[index]) < 1.0


def ordinary_size(problem: Problem, x: FloatArray, parameter: EffectParameter) -> float:
    cables = problem.plant.cables(problem.values(x), problem.effects)
    references = {
        "cable": [c.length / c.axial_stiffness for c in cables],
        "pretension": [c.pretension for c in cables],
        "pretension per length": [c.pretension / c.length for c in cables],
    }[parameter.ordinary_of or "pretension"]
    return max(min(parameter.ordinary * each for each in references), 1e-12)


def shape_indices(problem: Problem, name: str) -> list[int]:
    own = {p.name for p in EFFECTS[name].parameters if not p.linear}
    return [k for k, parameter in enumerate(problem.tuned) if parameter.name in own]


def amplitude_indices(problem: Problem, names: Sequence[str]) -> list[int]:
    parameters = [p for name in names for p in EFFECTS[name].parameters]
    off = {parameter.name for parameter in parameters if parameter.size}
    return [k for k, parameter in enumerate(problem.tuned) if parameter.name in off]


def plausible_size(
    parameter: EffectParameter, problem: Problem, x: FloatArray
) -> float:
    bench = problem.plant.bench
    cable = problem.plant.cables(problem.values(x), problem.effects)[0]
    tension = cable.pretension / Limit.tension
    length = cable.length / Limit.length
    soft = Limit.stiffness / cable.axial_stiffness
    ends = ("motor_", "cogging_", "eccentricity_", "ovality_")
    at_motor = parameter.name.startswith(ends)
    radius = (bench.motor_radius if at_motor else bench.joint_radius) / Limit.radius
    torques = ("N m", "N m/s", "N m/rad", "kg m^2")
    scales = dict.fromkeys(torques, tension * radius)
    scales |= {"N": tension, "N/m": tension / length, "m/N": soft * length, "m": radius}
    scales |= {"N s/m^2": tension / length / radius}
    scales |= {"1/J": 1.0 / max(tension * radius, 1e-300)}
    scale = scales.get(parameter.unit, 1.0)
    if parameter.name == "bristle_length":
        scale = tension * soft * length
    elif parameter.name.startswith("bedding_strain"):
        scale = tension * soft
    return parameter.typical * scale


def noise_covariance(problem: Problem, x: FloatArray, masks: Masks) -> Spread:
    """Return the covariance of a fit due to sensor noise, at most `fit_covariance`."""
    found: FloatArray = least_squares.covariance(jacobian(problem, x, masks))
    return Spread(found, np.full(x.size, np.inf))


def fit_covariance(problem: Problem, x: FloatArray, masks: Masks) -> Spread:
    """Return the covariance of a fit: noise, disagreement of trials, errors of form.

    Noise makes B; trials that disagree by factors f_k make f_k B_kk of its diagonal,
    with few degrees of freedom; `form_error` and `law_error` add theirs. The
    degrees are divided by the squared share of B and trials (Satterthwaite, Biometrics
    Bulletin 2, 1946).
    """
    fresh = replace(problem, slopes=TorqueDerivatives())
    slopes = jacobian(fresh, x, masks)
    residual = fresh.residual(x, masks)
    # The weights of the errors already count independent samples only.
    noise = least_squares.covariance(slopes)
    moved = disagreement(slopes, residual, parts_of(problem.plant.records, masks))
    beyond = np.sqrt(np.maximum(moved.factor - 1.0, 0.0))
    trials = noise * (1.0 + np.outer(beyond, beyond))
    controls = controls_of(fresh, x, masks)
    data = len(controls)
    form = form_error(slopes[:data], residual[:data], noise, controls)
    laws = _law_errors(fresh, x, masks, slopes, residual)
    own = {p.name for name in problem.effects for p in EFFECTS[name].parameters}
    base = np.array([name not in own for name in problem.names])
    form += np.where(np.outer(base, base), laws, 0.0)
    share = np.diag(trials) / np.diag(trials + form)
    freedom = np.where(beyond > 0.0, moved.freedom / share**2, np.inf)
    return Spread(trials + form, freedom, np.where(base, 0.0, np.diag(laws)))


def estimates(problem: Problem, x: FloatArray, spread: Spread) -> dict[str, Estimate]:
    """Return values and 95 % intervals by name; NaN if a logarithm's is too wide."""
    found = {}
    deviations = np.sqrt(np.diag(spread.covariance) + spread.laws).tolist()
    uncertain = zip(x.tolist(), deviations, spread.freedom.tolist(), strict=True)
    for parameter, known in zip(problem.tuned, uncertain, strict=True):
        own = found[parameter.name] = least_squares.estimate(parameter, *known)
        low, high = own.ci95
        sure = low > 0.0 and math.log(high / low) <= 2.0 * Limit.max_log_factor
        if parameter.factor and not sure:
            found[parameter.name] = replace(own, ci95=(math.nan, math.nan))
    for name in problem.effects:
        for index in amplitude_indices(problem, [name]):
            tuned = problem.tuned[index]
            if tuned.low * tuned.scale + tuned.start != 0.0:
                continue
            own = found[tuned.name]
            low, high = own.ci95
            if shape_indices(problem, name) and x[index] > 0.0:  # in proportion
                half = min(0.5 * (high - low) / own.value, Limit.max_log_factor)
                within = own.value / math.exp(half), own.value * math.exp(half)
            else:  # no size is below 0
                within = max(low, 0.0), high
            found[tuned.name] = replace(own, ci95=within)
    return found


def undetermined(problem: Problem, x: FloatArray, masks: Masks) -> tuple[str, ...]:
    """Return sentences on friction and on combinations that only priors determine."""
    found = []
    whole = jacobian(problem, x, masks)
    priors = sum(math.isfinite(parameter.prior) for parameter in problem.tuned)
    known = least_squares.covariance(whole[: whole.shape[0] - priors])
    limit = Limit.undetermined_deviation
    for shares in least_squares.undetermined_directions(known, limit):
        pairs = zip(problem.names, shares, strict=True)
        parts = [name for name, share in pairs if abs(share) > 0.3]
        text = " hardly changes the outputs; its value is a guess."
        if len(parts) > 1:
            text = (
                ": changed together these hardly change the outputs; only what was "
                "known before distinguishes them."
            )
        found.append(f"{' against '.join(parts)}{text}")
    found.append(
        "Friction enters only as its product with the wrap angle, which is the scene's."
    )
    return tuple(found)


def form_error(
    slopes: FloatArray, residual: FloatArray, spread: FloatArray, controls: FloatArray
) -> FloatArray:
    """Return the covariance (parameters, parameters) of a fit due to errors of form.

    Controls are changes by ordinary sizes of effects that the model lacks; Q is their
    orthonormal basis. The residual is r = J b + Q c + noise, c of variance v each; a
    fit leaves M Q c, M = I - J H^-1 J^T. Its square along the q directions of M Q has
    the mean q + v tr(Q^T M Q), which gives v (method of moments, as DerSimonian and
    Laird, Control. Clin. Trials 7, 1986). The fit is off by H^-1 J^T Q c. Along no
    direction is v larger than the largest control makes: a larger error is a missing
    effect.

    `slopes` (data, parameters) are J without priors, `residual` (data,) in units of the
    noise, `spread` H^-1 with priors, `controls` (data, controls) changes by each.
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
    return np.asarray(min(max(excess, 0.0) / kept, most) * (into.T @ into))


def law_error(
    slopes: FloatArray, priors: int, change: FloatArray, excess: float
) -> FloatArray:
    """Return the covariance of a fit due to the law of an effect in the model.

    The effect's `change` d of the residual (data,) is known up to a share: a fit of all
    other parameters leaves M d of it, and `excess`, the squared residual that noise
    does not explain, is that share of |M d|^2. Of the rest of d, which moves those
    parameters by H^-1 J^T d, as large a share may be wrong.

    `slopes` (data and priors, parameters) are J of the other parameters.
    """
    data = slopes[: len(slopes) - priors]
    moved = least_squares.covariance(slopes) @ data.T @ change
    beside = change - data @ moved
    wrong = min(excess / max(float(beside @ beside), 1e-300), 1.0)
    return np.asarray(wrong * np.outer(moved, moved))


def _law_errors(
    problem: Problem, x: FloatArray, masks: Masks, slopes: FloatArray,
    residual: FloatArray,
) -> FloatArray:  # fmt: skip
    """Return the covariance due to the laws of effects, of all but their own values."""
    found = np.zeros((x.size, x.size))
    ratio = problem.misfit(range(len(problem.floor)), problem.deviations(x))
    priors = sum(math.isfinite(parameter.prior) for parameter in problem.tuned)
    data = residual[: residual.size - priors]
    excess = float(np.sum(data**2)) * max(0.0, 1.0 - ratio**-2)
    for effect in problem.effects:
        slim = problem.without(effect)
        rest = [k for k, own in enumerate(problem.tuned) if own in slim.tuned]
        change = slim.residual(x[rest], masks)[: data.size] - data
        found[np.ix_(rest, rest)] += law_error(slopes[:, rest], priors, change, excess)
    return found


def _basis(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis (rows, k) of columns whose lengths are at most 1."""
    left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return left[:, sizes > Limit.new]


def controls_of(problem: Problem, x: FloatArray, masks: Masks) -> FloatArray:
    """Return residual changes (data, controls) by ordinary sizes of absent effects."""
    rows = len(problem.plant.instruments.rows)
    count = rows * sum(int(mask.sum()) for mask in masks)
    wider, sizes = problem, []
    for name, effect in problem.plant.library.effects.items():
        if name in problem.effects:
            continue
        if all(parameter.ordinary > 0.0 for parameter in effect.parameters):
            wider = wider.with_effect(name, {})
            sizes += [ordinary_size(problem, x, p) for p in effect.parameters]
            place = np.concatenate([x, np.zeros(len(wider.tuned) - x.size)])
            # One after another: derivatives that are known are taken over.
            slopes = jacobian(wider, place, masks)
    if wider is problem:
        return np.zeros((count, 0))
    scales = [each.scale for each in wider.tuned[x.size :]]
    return np.asarray(slopes[:count, x.size :] * np.array(sizes) / scales)


class Disagreement(NamedTuple):
    # (parameters,) mean square of the moves over that of noise; 1 if not known
    factor: FloatArray
    freedom: FloatArray  # (parameters,) its degrees of freedom; infinite if not known


def disagreement(
    slopes: FloatArray, residual: FloatArray, parts: NDArray[np.int64]
) -> Disagreement:
    """Compare the moves of a fit, as each part of the data is left out, with noise.

    With H = J^T J and H_g, s_g = J_g^T r_g of part g, the fit moves by d_g = (H -
    H_g)^-1 s_g without it (Cook 1977), of which noise makes the variance (H - H_g)^-1 -
    H^-1. The factor is the mean of d_g^2 / variance (Birge, Phys. Rev. 40, 1932;
    Hartung and Knapp, Stat. Med. 20, 2001), its freedom G^2 over the sum of squared
    correlations of the G moves (Bell and McCaffrey, Survey Methodology 28, 2002).

    `slopes` (residuals, parameters) are J, priors last, `residual` (residuals,) in
    units of the noise; `parts` (data,) number the part of each, without the priors.
    """
    whole = least_squares.covariance(slopes)
    every = [np.flatnonzero(parts == part) for part in np.unique(parts)]
    # A triangle has the same square as the rows, which may be many.
    root = [np.asarray(np.linalg.qr(slopes[rows], mode="r")) for rows in every]
    pull = [slopes[rows].T @ residual[rows] for rows in every]
    square = [each.T @ each for each in root]
    known = slopes[parts.size :]
    others = [[*root[:k], *root[k + 1 :], known] for k in range(len(root))]
    without = [least_squares.covariance(np.concatenate(each)) for each in others]
    factor = np.ones(slopes.shape[1])
    freedom = np.full(slopes.shape[1], np.inf)
    for k in range(factor.size):
        row = [each[k] for each in without]
        pairs = (zip(row, other, strict=True) for other in (square, pull))
        shares, moved = (np.array([a @ b for a, b in each]) for each in pairs)
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


def parts_of(records: Sequence[Record], masks: Masks) -> NDArray[np.int64]:
    """Return the index of the part of the data that each residual is of (data,).

    A part is a group of repeats or, of few groups, a piece of a record.
    """
    pairs = list(zip(records, masks, strict=True))
    groups = sorted({record.group for record, mask in pairs if mask.any()})
    found = []
    for place, (record, mask) in enumerate(pairs):
        count = int(np.sum(mask))
        piece = np.arange(count) * Limit.record_pieces // max(count, 1)
        own = place * Limit.record_pieces + piece
        if len(groups) >= Limit.least:
            own = np.full(count, groups.index(record.group) if count else 0)
        found.append(np.tile(own, len(record.measured)))
    return np.concatenate(found).astype(np.int64)
