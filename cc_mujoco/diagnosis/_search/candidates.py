"""Effects that could explain the error: screening, acceptance and ties.

The signature of an effect is its change of the simulated torques, less the part that
the free parameters could make as well (the score test of its presence). It costs a
simulation or two, and shows how much of the error an effect could explain, whether the
data could show it at all, and which effects are confounded. `concepts.md` has the odds
of two models, and the rules of acceptance and of ties.
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis._fit import problem as fitting
from cc_mujoco.diagnosis._fit.intervals import amplitude_indices, implausibility
from cc_mujoco.diagnosis._fit.problem import CrossValidation, Fold, Masks, Problem
from cc_mujoco.diagnosis._phrases import format_number
from cc_mujoco.diagnosis._rig.records import Record
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.diagnosis.effects._effect import Effect, EffectError, EffectParameter
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._least_squares import in_threads
from cc_mujoco.native import FloatArray

_Key = tuple[str, tuple[float, ...], str]
"""Effect, its start and name of a parameter."""


class Signature(NamedTuple):
    """Contribution of an effect, from one of its starts, to explaining the error."""

    id: str  # of the effect
    start: dict[str, float]  # where it would explain most, amplitudes solved for
    explained: float  # share of the squared error that it would explain, to first order
    # The same of the held-out error: fitted to each fold's part, tested on its other
    foreseen: float
    visible: float  # RMS change by a typical size over the floor, after retuning
    basis: FloatArray  # (residuals, k) orthonormal, of its signatures
    changes: FloatArray  # (residuals, amplitudes) by typical sizes, nothing retuned


class Changes:
    """Cache of torque changes due to effects, by record and simulated torque."""

    def __init__(self) -> None:
        # By record the torques (2, samples) of models [N m], and by effect, start and
        # parameter the changes (1, 2, samples) by a typical size there [N m]
        self._kept: dict[Record, list[tuple[FloatArray, dict[_Key, FloatArray]]]] = {}

    def at(self, record: Record, torque: FloatArray) -> dict[_Key, FloatArray]:
        """Return the changes cached for about this `torque`, to be extended."""
        kept = self._kept.setdefault(record, [])
        off = [float(np.sum((torque - known) ** 2)) for known, _ in kept]
        least = int(np.argmin(off)) if off else -1
        if off and off[least] <= Limit.max_model_change**2 * float(np.sum(torque**2)):
            kept.append(kept.pop(least))  # the one used last goes last
        else:
            kept.append((torque, {}))
            del kept[:-3]  # models used longest ago
        return kept[-1][1]


class _Place:
    """Fitted model at which effects are linearised.

    If `explained`, its errors are taken as small, so that Huber's loss is quadratic.
    """

    def __init__(
        self, problem: Problem, x: FloatArray, masks: Masks, changes: Changes,
        explained: bool = False,
    ) -> None:  # fmt: skip
        self.problem, self.x = problem, x
        self._seen = [k for k, mask in enumerate(masks) if mask.any()]
        here, records = problem.torques(x, self._seen), problem.plant.records
        # Change of the residual by the torques
        torques = None if explained else here
        self._steep = fitting.residual_slopes(problem, torques, masks)
        self._base = problem.coarse.torques(x, self._seen)
        self._priors = sum(math.isfinite(p.prior) for p in problem.tuned)
        self._known = [  # changes of these records by effects
            changes.at(records[k], torque)
            for k, torque in zip(self._seen, here, strict=True)
        ]

    def start(self, name: str, number: int) -> dict[str, float]:
        """Return start `number` of an effect, with shapes as other effects set them.

        Two effects may share a length of slip, which a small effect must not change.
        """
        plant, values = self.problem.plant, self.problem.values(self.x)
        effect = plant.library.effects[name]
        start = dict(effect.starts[number])
        shapes = [p for p in effect.parameters if not p.linear and p.name in start]
        if not shapes:
            return start
        both = self.problem.effects, ()
        here, bare = (plant.cables(values, effects)[0] for effects in both)
        for shape in shapes:
            own = getattr(here, shape.name, None)
            if own is not None and own != getattr(bare, shape.name):
                low, high = shape.parameter.low, shape.parameter.high
                start[shape.name] = min(max(own, low), high)
        return start

    def columns(self, name: str, number: int) -> FloatArray | None:
        """Return residual changes (residuals, amplitudes) by typical sizes, or None."""
        effect = self.problem.plant.library.effects[name]
        start = self.start(name, number)
        wider = self.problem.coarse.with_effect(name, start)
        columns = []
        for parameter in filter(lambda each: each.linear, effect.parameters):
            size = start[parameter.name] / parameter.typical
            key = (name, tuple(start.values()), parameter.name)
            new = [k for k, known in enumerate(self._known) if key not in known]
            if new:
                own = parameter.name
                places = [size if p.name == own else 0.0 for p in wider.tuned]
                places[: self.x.size] = self.x.tolist()
                seen = [self._seen[k] for k in new]
                try:
                    moved = wider.torques(np.array(places), seen)
                except EffectError:
                    raise
                except CableError:
                    return None
                for k, torque in zip(new, moved, strict=True):
                    self._known[k][key] = (torque - self._base[k])[None] / size
            torques = [known[key] for known in self._known]
            (made,) = fitting.residual_changes(self._steep, torques)
            columns.append(np.append(made, np.zeros(self._priors)))
        return np.array(columns).T


class _Screen(_Place):
    def __init__(
        self, problem: Problem, x: FloatArray, masks: Masks, changes: Changes,
        division: Sequence[Fold],
    ) -> None:  # fmt: skip
        super().__init__(problem, x, masks, changes)
        self._error = error = problem.residual(x, masks)
        slopes = fitting.jacobian(problem, x, masks)
        size = np.linalg.norm(slopes, axis=0)
        # Parameters without influence and those at a bound are left out.
        margin = 1e-3
        places = zip(problem.tuned, x, strict=True)
        inside = np.array([p.low + margin < at < p.high - margin for p, at in places])
        free = inside & (size > 0.0)
        scaled = slopes[:, free] / size[free]
        # Orthonormal basis of the changes by tuning, and the rest of the error then
        self._tangent, _ = np.linalg.qr(scaled)
        self._rest = error - self._tangent @ (self._tangent.T @ error)
        rows = len(problem.plant.records[0].measured)
        samples = rows * sum(int(mask.sum()) for mask in masks)
        priors = np.zeros(error.size - samples, dtype=bool)

        def residuals(part: Masks, of_priors: NDArray[np.bool_]) -> NDArray[np.bool_]:
            pairs = zip(part, masks, strict=True)
            own = [np.tile(some[mask], rows) for some, mask in pairs]
            return np.concatenate([*own, of_priors])

        folds = [(fold.train, fold.test) for fold in division]
        self._halves = [(residuals(a, ~priors), residuals(b, priors)) for a, b in folds]
        self._parts = [[(scaled[r], error[r]) for r in half] for half in self._halves]
        self._before = self._left(scaled[:, :0])

    def signature(self, name: str, number: int) -> Signature | None:
        """Return the signature of start `number`; None if it cannot be simulated."""
        changes = self.columns(name, number)
        if changes is None:
            return None
        problem, error, rest = self.problem, self._error, self._rest
        parameters = problem.plant.library.effects[name].parameters
        linear = [parameter for parameter in parameters if parameter.linear]
        start = self.start(name, number)
        signature = changes - (self._tangent @ (self._tangent.T @ changes))
        lengths = np.linalg.norm(signature, axis=0)
        sizes = np.array([parameter.size for parameter in linear])
        own, seen = float(lengths[sizes].max()), changes[:, sizes]
        visible = own / np.sqrt(error.size) / problem.weight
        if own <= Limit.min_square_share:
            nothing = np.zeros((error.size, 0))
            return Signature(name, start, 0.0, 0.0, 0.0, nothing, seen)
        kept = lengths > Limit.min_square_share
        solved = np.zeros(len(linear))
        wider = problem.with_effect(name, start).tuned[self.x.size :]
        known = [k for k in wider if k.name in {p.name for p in linear}]
        priors = np.diag([1.0 / k.prior for k in known])[:, kept]
        both = ([getattr(k, side) for k in known] for side in ("low", "high"))
        low, high = (np.array(each)[kept] for each in both)
        table = np.concatenate([signature[:, kept], priors])
        wanted = -np.concatenate([rest, np.zeros(len(known))])
        limits = np.maximum(low, -20.0), np.minimum(high, 20.0)
        solved[kept] = bounded_least_squares(table, wanted, *limits)
        left = rest + signature @ solved
        beyond = max(float(error @ error), 1e-300)
        gained = (float(rest @ rest) - float(left @ left)) / beyond
        for parameter, amount in zip(linear, solved.tolist(), strict=True):
            start[parameter.name] = amount * parameter.typical
        # A companion of an effect is tuned with it and does not identify it.
        along, _ = np.linalg.qr(signature[:, kept & ~sizes])
        alone = signature[:, kept & sizes]
        basis, _ = np.linalg.qr(alone - along @ (along.T @ alone))
        foreseen = 0.0
        if self._halves and gained > 0:
            after = self._left(changes[:, kept] / lengths[kept])
            foreseen = 1.0 - after / max(self._before, 1e-300)
        return Signature(name, start, max(gained, 0.0), foreseen, visible, basis, seen)

    def _left(self, changes: FloatArray) -> float:
        """Return the held-out squared error if `changes` (rows, k) are fitted, too."""
        total = 0.0
        for half, known in zip(self._halves, self._parts, strict=True):
            (train, error), (test, unseen) = known
            more, other = (changes[rows] for rows in half)
            cross = train.T @ more
            square = np.block([[train.T @ train, cross], [cross.T, more.T @ more]])
            slope = np.concatenate([train.T @ error, more.T @ error])
            step = np.linalg.lstsq(square, -slope, 1e-9)[0]
            own, added = np.split(step, [train.shape[1]])
            total += float(np.sum((unseen + test @ own + other @ added) ** 2))
        return total


def exceeds_effects(
    problem: Problem, x: FloatArray, masks: Masks, changes: Sequence[FloatArray]
) -> bool:
    """Return whether changes take more of the squared error than any other effect.

    `changes` (count, 2, samples) [N m], of which the best multiples count, are of the
    torques of every record with a mask. Effects count at their first start, and none
    takes more than `Limit.sure_event_share`.
    """
    place = _Screen(problem, x, masks, Changes(), ())
    made = fitting.residual_changes(place._steep, changes)
    own = np.pad(made, ((0, 0), (0, place._priors))).T
    own = own - place._tangent @ (place._tangent.T @ own)
    own /= np.maximum(np.linalg.norm(own, axis=0), 1e-300)
    taken = own @ np.linalg.lstsq(own, place._rest, 1e-9)[0]
    share = float(taken @ taken) / float(place._error @ place._error)
    if share > Limit.sure_event_share:
        return True
    able = [n for n in problem.plant.library.effects if n not in problem.effects]
    every = in_threads(lambda name: place.signature(name, 0), able)
    return all(found is None or share > found.explained for found in every)


def screen(
    problem: Problem,
    x: FloatArray,
    masks: Masks,
    ids: Sequence[str],
    division: Sequence[Fold] = (),
    changes: Changes | None = None,
    starts: int | None = None,
) -> list[Signature]:
    """Return the signature of each effect at its best start, most helpful first.

    Without a `division` into folds the held-out gain is 0. `starts` is the largest
    number of starts per effect (default all), `changes` the cache of earlier rounds.
    """
    given = _Screen(problem, x, masks, changes or Changes(), division)
    library = problem.plant.library.effects

    def best(name: str) -> Signature | None:
        numbers = range(len(library[name].starts))[:starts]
        able = filter(None, [given.signature(name, k) for k in numbers])
        return max(able, key=lambda s: s.explained, default=None)

    every = in_threads(best, [name for name in ids if name in library])
    found = [signature for signature in every if signature is not None]
    return sorted(found, key=lambda signature: -signature.explained)


def effect_amplitudes(effect: Effect) -> list[EffectParameter]:
    """Return the sizes of an effect, not its shape and companion parameters."""
    return [parameter for parameter in effect.parameters if parameter.size]


def changes_by_effects(
    problem: Problem, x: FloatArray, masks: Masks, ids: Sequence[str], changes: Changes
) -> dict[str, FloatArray]:
    """Return the changes of the residuals (residuals, amplitudes) by effect.

    They are for typical sizes at the first start, as if the model explained the data.
    Effects that cannot be simulated are left out.
    """
    place = _Place(problem, x, masks, changes, explained=True)
    library = problem.plant.library.effects
    able = [name for name in ids if name in library]
    made = in_threads(lambda name: place.columns(name, 0), able)
    found = [(n, own) for n, own in zip(able, made, strict=True) if own is not None]
    sizes = {n: [p.size for p in library[n].parameters if p.linear] for n, _ in found}
    return {name: columns[:, sizes[name]] for name, columns in found}


def bounded_least_squares(
    columns: FloatArray, wanted: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """Solve bounded least squares approximately; violated bounds become active."""
    found = np.zeros(low.size)
    open_ = np.ones(low.size, dtype=bool)
    while open_.any():
        left = wanted - columns[:, ~open_] @ found[~open_]
        found[open_] = np.linalg.lstsq(columns[:, open_], left, rcond=1e-6)[0]
        beyond = open_ & ((found < low) | (found > high))
        found = np.clip(found, low, high)
        if not beyond.any():
            break
        open_ &= ~beyond
    return found


def signature_cosine(one: Signature, other: Signature) -> float:
    """Return the largest cosine between the signatures of two effects, 0 to 1."""
    if one.basis.shape[1] == 0 or other.basis.shape[1] == 0:
        return 0.0
    cosines = np.linalg.svd(one.basis.T @ other.basis, compute_uv=False)
    return float(min(cosines[0], 1.0))


class Candidate(NamedTuple):
    id: str  # of the effect
    crossed: CrossValidation  # the wider model
    reduction: float  # of the held-out squared error, relative
    z: float  # of the comparison with the model so far
    reason: str  # why it may not be named, or empty


class Round(NamedTuple):
    candidates: tuple[Candidate, ...]  # refitted, the best first
    added: str | None  # the one that was added, or None
    rivals: tuple[str, ...]  # ids that do as well as the one added, itself first
    confidence: float  # share of bootstraps that the added one wins
    before: CrossValidation  # the model without it
    parted: tuple[str, ...] = ()  # rivals that still helped when it had been added

    def tied(self, effects: Sequence[str], added: Sequence[str]) -> tuple[str, ...]:
        """Return the tied effects, the one in the model first; () if none is in it.

        A rival that still helped was added, too, and is not tied. But if two were added
        and one was removed again, either may be the one that acts.
        """
        both = [name for name in added if name in (self.added, *self.parted)]
        kept = [name for name in both if name in effects]
        gone = [name for name in both if name not in effects]
        return (kept[0], *gone, *self.rivals[1:]) if kept else ()


def comparison_z(
    better: FloatArray, worse: FloatArray, before: float, share: float | None = None
) -> float:
    """Return z of the difference of two models, by squared errors in blocks.

    `better` (blocks,) has the smaller sum, `before` is the squared error without
    either. The standard deviation is of noise and of a form error: `share` times
    `before`, by default the usual share, at most the rest of the better model.
    """
    difference = worse - better
    noise = fitting.block_sum_deviation(difference)
    left = float(np.sum(better))
    form = (
        min(Limit.form_error_share * before, left) if share is None else share * before
    )
    z = float(np.sum(difference)) / max(math.hypot(noise, form), 1e-300)
    return min(max(z, -Limit.max_z), Limit.max_z)


def are_confusable(one: Signature, other: Signature) -> bool:
    alike = signature_cosine(one, other) > Limit.lookalike_cosine
    return alike or other.id in EFFECTS[one.id].confounded_with


def rejection_reason(crossed: CrossValidation, name: str, gain: float, z: float) -> str:
    if z < Limit.min_z:
        taken = round(gain, 2) + 0.0  # no minus before a zero
        return (
            f"takes {taken:.0%} of the error, {format_number(z, 1.0)} standard errors "
            f"of noise and model form; {Limit.min_z:g} are needed"
        )
    effect = crossed.problem.plant.library.effects[name]
    parameters = {parameter.name: parameter for parameter in effect.parameters}
    index = amplitude_indices(crossed.problem, [name])
    sizes = np.array([fit.x[index] for fit in crossed.fits])
    spread = float(np.linalg.norm(sizes[0] - sizes[-1]))
    mean = float(np.linalg.norm(sizes.mean(axis=0)))
    # Where more than a size is fitted, one parameter may stand in for another.
    alone = sum(not parameter.beside for parameter in parameters.values()) == 1
    if alone and spread > Limit.max_fold_spread * mean:
        return "its size differs between the halves of the data"
    for tuned, x in zip(crossed.problem.tuned, crossed.fits[0].x, strict=True):
        if tuned.name in parameters and parameters[tuned.name].linear:
            if x >= tuned.high * 0.999:
                return f"{tuned.name} runs to its bound"
    return implausibility(crossed.problem, crossed.x)


def decide(
    now: CrossValidation, candidates: list[Candidate], signatures: Sequence[Signature]
) -> Round:
    """Return the round that adds the best acceptable candidate; sort `candidates`."""
    candidates.sort(key=lambda candidate: -candidate.reduction)
    able = [candidate for candidate in candidates if not candidate.reason]
    if not able:
        return Round(tuple(candidates), None, (), 0.0, now)
    best = able[0]
    rivals, lookalikes = [best], []
    sign = {signature.id: signature for signature in signatures}
    for other in able[1:]:
        confused = are_confusable(sign[best.id], sign[other.id])
        pair = best.id, other.id
        why = tie_reason(now, best.crossed, other.crossed, pair, confused)
        if why == "noise":
            rivals.append(other)
        elif why == "form":
            lookalikes.append(other)
    # Where the data do not decide, the one with fewer parameters comes first; a form
    # error is no reason to have the worse one in the model.
    rivals.sort(key=lambda rival: len(EFFECTS[rival.id].parameters))
    rivals += lookalikes
    tied = {rival.id for rival in rivals}
    leader, *others = (rival.id for rival in rivals)
    wider = {name for name in others if tied.intersection(EFFECTS[name].generalises)}
    names = tuple(rival.id for rival in rivals if rival.id not in wider)
    sums = {c.id: fitting.blocks(c.crossed) for c in able if c.id not in wider}
    return Round(tuple(candidates), leader, names, confidence(sums, leader), now)


def tie_reason(
    now: CrossValidation, best: CrossValidation, other: CrossValidation,
    names: tuple[str, str], confused: bool,
) -> Literal["", "noise", "form"]:  # fmt: skip
    """Return "noise" or "form" if two effects are tied, "" if they are not.

    They are not if one explains the data and the other does not, even if few moments
    show it, unless one takes the form of the other on some rigs.
    """
    one, two = (EFFECTS[name] for name in names)
    far = other.misfit > Limit.max_explained_error and not one.forms_meet(two)
    if far and best.misfit <= Limit.max_misfit:
        return ""
    difference = fitting.blocks(other) - fitting.blocks(best)
    error = fitting.block_sum_deviation(difference)
    if difference.sum() < Limit.rival_sigmas * error:
        return "noise"
    return "form" if confused and parted_by_form(now, best, other) else ""


def parted_by_form(
    now: CrossValidation, best: CrossValidation, other: CrossValidation
) -> bool:
    """Return whether two effects differ by at most errors of form, in every trial.

    Such a difference may be significant: a spring may soften, and pull like a weight.
    """
    sums: dict[str, FloatArray] = {}
    for place, record in enumerate(now.problem.plant.records):
        left = [float(np.nansum(c.errors[place] ** 2)) for c in (now, best, other)]
        sums[record.group] = sums.get(record.group, np.zeros(3)) + left
    table = np.array(list(sums.values()))
    taken, difference = table[:, 0] - table[:, 1], table[:, 2] - table[:, 1]
    # A trial in which the effects hardly show tolerates next to no difference.
    usual = Limit.form_error_share * np.maximum(taken, taken.mean())
    return bool(np.all(difference <= usual))


def confidence(sums: dict[str, FloatArray], name: str) -> float:
    """Return the share of block bootstraps of `sums` (blocks,) in which `name` wins."""
    random = np.random.default_rng(0)
    table = np.array(list(sums.values()))
    place = list(sums).index(name)
    draws = random.integers(0, table.shape[1], (400, table.shape[1]))
    totals = table[:, draws].sum(axis=2)
    return float(np.mean(np.argmin(totals, axis=0) == place))
