"""Verdict on the search, its reasons, and its probability.

The rules are in `concepts.md`: verdict, identifiability, odds. A cable that comes off,
a clamp that slips or a sensor that freezes begins at a moment, so it is no effect of
the library and hardly shows in the error of all data: `worst_stretch` looks for it.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.datasets import _channels as channels
from cc_mujoco.diagnosis._fit import problem as fitting
from cc_mujoco.diagnosis._fit.intervals import IMPLAUSIBLE_PREFIX, plausible_size
from cc_mujoco.diagnosis._fit.problem import CrossValidation, Masks, Problem
from cc_mujoco.diagnosis._fit.trials import extreme_condition
from cc_mujoco.diagnosis._phrases import (
    capitalise,
    channel_name,
    class_statement,
    describe_mode,
    effect_name,
    effect_names,
    format_number,
    format_odds,
    format_share,
    format_size,
    plain_name,
)
from cc_mujoco.diagnosis._rig import simulation
from cc_mujoco.diagnosis._rig.records import Arrays
from cc_mujoco.diagnosis._search import candidates as screening
from cc_mujoco.diagnosis._search.candidates import Candidate, Changes, Round
from cc_mujoco.diagnosis._search.search import Found, Search
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import (
    Alternative,
    Confounded,
    Deviating,
    Diagnosis,
    NotTestable,
    RunnerUp,
    Verdict,
    VerdictOdds,
)
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.diagnosis.effects._causes import CLASSES, CauseClass
from cc_mujoco.diagnosis.effects._effect import Effect
from cc_mujoco.estimation._least_squares import Estimate, Tuned
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words


class Stretch(NamedTuple):
    trial: str  # its name
    start: float  # time as recorded [s]
    end: float  # time as recorded [s]
    channel: str  # torque with the largest error
    size: float  # RMS error over the noise
    error: float  # RMS error [N m]
    idle: bool  # whether both torques are next to nothing, though the model's are not
    rest: float  # misfit of all other samples
    # Declared condition of which the trial is the only extreme one, where most of it is
    # off; else ""
    extreme: str = ""

    @property
    def statement(self) -> str:
        when = f"from {self.start:.1f} s to {self.end:.1f} s"
        verb = "transmits nothing" if self.idle else "is off"
        return (
            f"{self.trial} {verb} {when}: the {channel_name(self.channel)} is "
            f"{format_number(self.error)} N m RMS off, {format_number(self.size)} "
            f"times the noise floor, and all other data {format_number(self.rest)} "
            "times."
        )

    @property
    def question(self) -> str:
        what = "came off" if self.idle else "came off, slipped or was changed"
        advice = (
            "Judge the rest without these seconds: leave them out of `valid` in "
            f"dataset.toml ([trials.{self.trial!r}])."
        )
        if self.extreme:
            advice = (
                f"Keep the trial, as no other has such a {self.extreme}; another one "
                f"like it tells whether the {self.extreme} does that."
            )
        return (
            f"{self.statement} Is there a cable or a clamp that {what}, or a sensor "
            f"that failed? {advice}"
        )


def worst_stretch(problem: Problem, x: FloatArray, torques: Arrays) -> Stretch | None:
    """Return the stretch of time whose error exceeds its limit by most, or None.

    Its error and the misfit of all other data come from a fit without it. `torques` are
    predictions (rows, samples) of every record [N m].
    """
    worst: tuple[float, int, int, slice] | None = None
    records, names = problem.plant.records, problem.plant.instruments.channels
    swing = Limit.friction_swing * problem.values(x).get("motor_friction", 0.0)
    masks = [record.counts.copy() for record in records]
    for place, (error, noise) in enumerate(_squares(problem, torques, masks)):
        record, counts = records[place], records[place].counts
        if not counts.any():
            continue
        window = max(1, round(fitting.BOOTSTRAP_BLOCK / record.dt))
        for row, channel in enumerate(names):
            own = swing if channel == channels.MOTOR_TORQUE else 0.0
            free = np.where(counts, own / problem.floor[place][row], 0.0) ** 2
            limits = Limit.stretch_limit, Limit.trial_limit
            quiet, whole = (noise[row] + free / limit**2 for limit in limits)
            over, middle = _largest_ratio(error[row], quiet, counts, window)
            sizes = over / limits[0], _rms_ratio(error[row], whole) / limits[1]
            if max(sizes) > max(1.0, worst[0] if worst else 0.0):
                least = 0.5 * math.hypot(limits[0], math.sqrt(float(free.max())))
                part = _edges(error[row], middle, record.dt, least)
                if over < limits[0]:
                    first, last = np.flatnonzero(counts)[[0, -1]]
                    part = slice(int(first), int(last) + 1)
                worst = max(sizes), place, row, part
    if worst is None:
        return None
    _, place, row, part = worst
    masks[place][part] = False
    if not any(mask.any() for mask in masks):
        return None
    there = problem.torques(fitting.fit(problem, x, masks).x)
    errors, noises = zip(*_squares(problem, there, masks), strict=True)
    rest = [fitting.huber_residual(np.sqrt(error)) ** 2 for error in errors]
    record, shown = records[place], there[place][:, part]
    measured, floor = record.measured[:, part], problem.floor[place][row, part]
    off = (measured - shown)[row]
    mostly = 2 * np.count_nonzero(record.counts[part]) > np.count_nonzero(record.counts)
    usual, expected = (np.median(np.abs(each), axis=1) for each in (measured, shown))
    return Stretch(
        record.trial,
        float(record.time[part][0]),
        float(record.time[part][-1]),
        names[row],
        _rms_ratio((off / floor) ** 2, (problem.sensed[place][row, part] / floor) ** 2),
        math.sqrt(float(np.mean(off**2))),
        bool((usual < Limit.max_idle_share * expected).all()),
        _rms_ratio(
            fitting.kept_samples(rest, masks), fitting.kept_samples(noises, masks)
        ),
        extreme_condition(problem, (record.trial,)) if mostly else "",
    )


def _squares(
    problem: Problem, torques: Arrays, masks: Masks
) -> list[tuple[FloatArray, FloatArray]]:
    records, sensed = problem.plant.records, problem.sensed
    found, pairs = [], zip(problem.floor, masks, strict=True)
    for k, (floor, mask) in enumerate(pairs):
        error, noise = (records[k].measured - torques[k]) / floor, sensed[k] / floor
        found.append((np.where(mask, error, 0.0) ** 2, np.where(mask, noise, 0.0) ** 2))
    return found


def _largest_ratio(
    error: FloatArray, noise: FloatArray, counts: NDArray[np.bool_], window: int
) -> tuple[float, int]:
    """Return the largest ratio of RMS in a window, and its middle, from squares."""
    box = np.ones(min(window, counts.size))
    signals = error, noise, counts.astype(np.float64)
    errors, noises, number = (np.convolve(each, box, "valid") for each in signals)
    full = number > 0.8 * box.size
    if not full.any():
        return 0.0, 0
    ratios = np.where(full, errors / np.maximum(noises, 1e-300), 0.0)
    most = int(np.argmax(ratios))
    return math.sqrt(float(ratios[most])), most + box.size // 2


def _edges(error: FloatArray, middle: int, dt: float, smallest: float) -> slice:
    """Return the samples around `middle` where the squared `error` stays large."""
    width = max(1, round(0.1 / dt))
    local = np.sqrt(np.convolve(error, np.full(width, 1.0 / width), "same"))
    near = slice(max(0, middle - 5 * width), middle + 5 * width)
    least = max(Limit.edge_share * float(local[near].max()), smallest)
    large = np.flatnonzero(local > min(least, float(local[near].max()) * 0.999))
    gaps = np.flatnonzero(np.diff(large) > 1.0 / dt)  # of a second
    starts = large[np.concatenate([[0], gaps + 1])]
    ends = large[np.concatenate([gaps, [large.size - 1]])]
    own = int(np.argmin(np.maximum(starts - middle, 0) + np.maximum(middle - ends, 0)))
    return slice(int(starts[own]), int(ends[own]) + 1)


def _rms_ratio(error: FloatArray, noise: FloatArray) -> float:
    return math.sqrt(float(error.sum() / max(float(noise.sum()), 1e-300)))


class EffectChange(NamedTuple):
    """Changes of the residuals by plausible sizes of an effect."""

    effect: Effect  # effect of the library
    sizes: Mapping[str, float]  # plausible sizes on the rig, by name of the parameter
    # (residuals, sizes) change over the floor without retuning; its length is the RMS
    made: FloatArray


class Testability(NamedTuple):
    """Evidence that the data could show effects that the accepted model lacks."""

    problem: Problem  # model with the noise of the sensors as its floor
    x: FloatArray  # fitted parameters
    # (residuals, parameters) changes by each parameter, over the noise floor
    slopes: FloatArray
    tangent: FloatArray  # (residuals, k) orthonormal basis of the changes by tuning
    changes: tuple[EffectChange, ...]  # changes by effects
    least: float  # RMS change over the noise from which on a search finds an effect

    def left(self, change: FloatArray) -> FloatArray:
        """Return the part of changes (residuals, ...) that tuning cannot make."""
        return change - self.tangent @ (self.tangent.T @ change)


def detectability(
    problem: Problem, x: FloatArray, ids: Sequence[str], known: Changes
) -> Testability:
    """Return the changes of the accepted model's residuals by each effect of `ids`."""
    records = problem.plant.records
    masks = [record.free for record in records]
    # Torques are compared up to a band: so many of the samples are independent.
    sizes = np.array([int(mask.sum()) for mask in masks])
    shares = np.array([min(1.0, 2.0 * r.band * r.dt) for r in records])
    floor = tuple(floor / problem.inflation for floor in problem.floor)
    weight = float(np.sqrt(np.sum(shares * sizes) / np.sum(sizes)))
    quiet = replace(problem, floor=floor, inflation=1.0, weight=weight)
    rows = len(records[0].measured)
    scale = quiet.weight * math.sqrt(rows * int(np.sum(sizes)))
    slopes = fitting.jacobian(quiet, x, masks, explained=True) / scale
    size = np.linalg.norm(slopes, axis=0)
    tangent, _ = np.linalg.qr(slopes[:, size > 0.0] / size[size > 0.0])
    made = screening.changes_by_effects(quiet, x, masks, ids, known)
    changes = []
    for name, columns in made.items():
        effect = problem.plant.library.effects[name]
        parameters = screening.effect_amplitudes(effect)
        plausible = {p.name: plausible_size(p, problem, x) for p in parameters}
        factors = np.array([plausible[p.name] / p.typical for p in parameters])
        changes.append(EffectChange(effect, plausible, columns * factors / scale))
    # Up to the error at which a search begins all beyond the noise may be one effect.
    start = Limit.floor_misfit if rows > 1 else Limit.max_misfit
    least = math.sqrt(start**2 - 1.0)
    return Testability(quiet, x, slopes, tangent, tuple(changes), least)


def confounded_effects(shown: Testability) -> tuple[Confounded, ...]:
    """Return the effects that would show if tuning a parameter did not hide them."""
    size = np.linalg.norm(shown.slopes, axis=0)
    free = np.flatnonzero(size > 0.0)
    scaled = shown.slopes[:, free] / size[free]
    least = shown.least
    found = []
    for each in shown.changes:
        if not each.made.any():
            continue
        mix = _best_hidden_mix(each.made, shown.tangent)
        change = each.made @ mix
        left, whole = (float(np.linalg.norm(c)) for c in (shown.left(change), change))
        if left > least or whole < Limit.hidden_clarity * least:
            continue
        shifts = np.linalg.lstsq(scaled, change)[0]
        most = int(np.argmax(np.abs(shifts)))
        shift, index = float(shifts[most] / size[free[most]]), int(free[most])
        parameter, place = shown.problem.tuned[index], float(shown.x[index])
        found.append(_confounded_effect(each, mix, parameter, shift, place))
    return tuple(found)


def _best_hidden_mix(changes: FloatArray, tangent: FloatArray) -> FloatArray:
    """Return factors (k,) on the columns of `changes` whose sum tuning imitates best.

    `changes` is (residuals, k), `tangent` (residuals, t) an orthonormal basis of what
    tuning can do. The factor that is largest in size is 1.
    """
    lengths = np.linalg.norm(changes, axis=0)
    lengths[lengths == 0.0] = 1.0
    plain = changes / lengths
    left = plain - tangent @ (tangent.T @ plain)
    values, axes = np.linalg.eigh(plain.T @ plain)
    kept = values > 1e-9 * values[-1]
    white = axes[:, kept] / np.sqrt(values[kept])
    _, vectors = np.linalg.eigh(white.T @ (left.T @ left) @ white)
    mix = (white @ vectors[:, 0]) / lengths
    return np.asarray(mix / mix[np.argmax(np.abs(mix))])


def _confounded_effect(
    change: EffectChange, mix: FloatArray, parameter: Tuned, shift: float, place: float
) -> Confounded:
    first = screening.effect_amplitudes(change.effect)[int(np.argmax(np.abs(mix)))]
    size = change.sizes[first.name]
    moved, usual = (_with_unit(parameter.value(e), parameter) for e in (shift, 0.0))
    statement = (
        f"{format_size(first.name, size, first.unit)} looks like "
        f"{plain_name(parameter.name)} {moved} in place of {usual}"
    )
    share, most = place / shift if shift else math.inf, Limit.max_size_ratio
    least = 0.0 if first.parameter.low == 0.0 else -most
    explains = ""
    far = abs(place) > Limit.max_prior_sigmas * parameter.prior
    if far and least < share < most:
        explains = f"about {format_size(first.name, share * size, first.unit)}"
    # Parameters of effects that are in the model have no remedy of their own.
    record = f"record {change.effect.required_excitation}"
    remedy = simulation.REMEDIES.get(simulation.base_name(parameter.name), record)
    return Confounded(change.effect.id, parameter.name, statement, explains, remedy)


def deviating_parameters(
    problem: Problem,
    x: FloatArray,
    estimated: Mapping[str, Estimate],
    hidden: Sequence[Confounded],
) -> tuple[Deviating, ...]:
    """Return the parameters tuned further from the scene than priors allow."""
    found = []
    for parameter, place in zip(problem.tuned, x.tolist(), strict=True):
        name, known, home = parameter.name, parameter.prior, 0.0  # place of the given
        apart = (*simulation.TORQUE_OFFSETS, *simulation.CLOCK_PARAMETERS)
        if name not in simulation.REMEDIES or name in apart:
            # It is of one occasion, or of an effect.
            continue  # reported as such
        if not math.isfinite(known) and name in ("friction", "axial_stiffness"):
            known = 0.4 / parameter.scale  # of the logarithm, where none is declared
        lever = name == "joint_angle_offset" and problem.plant.bench.lever is not None
        if lever:
            known = Limit.zero_angle_deviation / parameter.scale
            home = -parameter.start / parameter.scale
        if not math.isfinite(known) or name == "motor_wind_up":  # which is never given
            continue
        deviation = abs(place - home) / known
        given, tuned = parameter.value(home), parameter.value(place)
        if (scene := problem.plant.given.get(name)) is not None:
            if name == "pretension":  # a fit that replaces it believes in nothing
                known = Limit.pretension_deviation / parameter.scale
            given, deviation = scene, math.inf
            if scene > 0.0:
                off = abs(math.log(tuned / scene))
                deviation = off / parameter.scale / known
        if deviation < Limit.max_prior_sigmas or estimated[name].holds(given):
            continue
        able = [each for each in hidden if each.parameter == name and each.explains]
        others = [f"{effect_name(each.id)} ({each.explains})" for each in able]
        statement = (
            f"{plain_name(name)} had to be tuned to {_with_unit(tuned, parameter)}, "
            f"where {_with_unit(given, parameter)} is given: either it is so"
        )
        if name == "axial_stiffness" and (unit := _suspected_unit(tuned / given)):
            statement += f", or angles in {unit} were taken for another unit"
        if others:
            statement += f", or these data hide {list_words(others, 'or')}"
        else:
            statement += ", or something that is not in the model looks like it"
        remedy = simulation.REMEDIES[name]
        if lever:
            remedy = (
                "the arm of the cable hangs on that angle, so let motor and joint read "
                "0 where the scene's are, and declare the offset of the column that "
                "does not"
            )
        statement += f"; {remedy}."
        found.append(Deviating(name, given, estimated[name], deviation, statement))
    return tuple(found)


def untestable_effects(
    shown: Testability, hidden: Sequence[Confounded]
) -> tuple[NotTestable, ...]:
    """Return the effects that would not show at a plausible size, and why."""
    confused = {each.id: each for each in hidden}
    reasons = shown.problem.plant.library.hidden.items()
    found = [NotTestable(name, why) for name, why in reasons if not EFFECTS[name].rare]
    for each in shown.changes:
        left = np.linalg.norm(shown.left(each.made), axis=0)
        most = int(np.argmax(left))
        if float(left[most]) >= shown.least:
            continue
        size = screening.effect_amplitudes(each.effect)[most]
        plausible = format_size(size.name, each.sizes[size.name], size.unit)
        share, seen = float(left[most]) / shown.least, "only"
        if share * Limit.max_size_ratio > 1.0:
            limit = format_size(size.name, each.sizes[size.name] / share, size.unit)
            seen = f"and less than {limit} cannot be seen"
        why = f"it shows only with {each.effect.required_excitation}"
        if other := confused.get(each.effect.id):
            why = f"tuning {plain_name(other.parameter)} hides it: {other.remedy}"
        statement = (
            f"once all is tuned, a plausible size ({plausible}) would change the "
            f"torques by {float(left[most]):.2f} times the noise floor, {seen}; {why}"
        )
        found.append(NotTestable(each.effect.id, statement))
    return tuple(found)


def _suspected_unit(ratio: float) -> str:
    size = abs(math.log(max(ratio, 1e-300)))
    units = {"degrees or radians": math.degrees(1.0), "turns": math.tau}
    for unit, factor in units.items():
        if abs(size - math.log(factor)) < Limit.unit_tolerance:
            return unit
    return ""


def _with_unit(value: float, parameter: Tuned) -> str:
    text = format_number(value) if value else "0"
    return f"{text} {parameter.unit}".removesuffix(" 1")


_HINT_CAVEAT = " The layout of a rig alone can cause as much: this is a hint only."


def judge(found: Found) -> Diagnosis:
    """Return the verdict on the result of a search, with its reasons and odds."""
    problem, x, search = found.problem, found.x, found.search
    plant, never = problem.plant, found.held.never
    tied = {rival for effect in found.effects for rival in effect.rivals}
    beside = {*problem.effects, *tied}
    others = [sign.id for sign in search.signatures if sign.id not in beside]
    shown_by = detectability(problem, x, others, search.changes)
    hidden = confounded_effects(shown_by)
    beyond = deviating_parameters(problem, x, found.estimated, hidden)
    stretch = worst_stretch(problem, x, found.held.after)
    unhooked = {r.trial for r in plant.records if r.unhooked} & set(found.misfits)
    most = max((found.misfits[name] for name in unhooked), default=0.0)
    reported = [*found.missing, *(name for tie in found.ties for name in tie)]
    reported += [each.parameter for each in beyond]
    classes = cause_classes([*reported, *problem.names])
    stated = [each for each in classes if each.name in reported]
    kind, statement = verdict_of(found, beyond, stretch, most, stated)
    statement += declared_sentence(plant.library.declared)
    left = fitting.floor_ratios(found.held.gap)[1]
    belief = None
    if search.interrupted:
        if not found.effects:
            kind = "unknown"
            statement = (
                "the error of the tuned scene is "
                f"{format_number(search.before.misfit)} times the noise floor, and no "
                "effect had been added."
            )
        statement = f"Stopped before all effects were tried: {statement}"
    elif kind == "unknown" and one_time(stretch, found.by_trial):
        text = (
            "How often such a verdict is right is not known: on no study rig did "
            "something happen once, or differ from trial to trial at random."
        )
        belief = VerdictOdds(math.nan, text, ())
    else:
        belief = belief_in_verdict(search, kind, found.missing, found.ties, left)
    question, problems = "", found.fitted.notes
    if kind == "unknown" and stretch and stretch.rest <= Limit.max_explained_error:
        question = stretch.question
    if never:
        only, its, it = "are the only trials", "their", "they are"
        if len(never) == 1:
            only, its, it = "is the only trial", "its", "it is"
        note = (
            f"{list_words(never)} {only} of {its} kind (side held, pretension, tilt, "
            f"weights), so {it} in every fit and the held-out error is that of the "
            "others; record more like it to check it."
        )
        problems = (note, *problems)
    return Diagnosis(
        kind,
        statement,
        effects=found.effects,
        ties=found.ties,
        not_testable=untestable_effects(shown_by, hidden),
        gap=found.held.gap,
        problems=problems,
        runner_ups=tuple(tuple(map(_runner_up, r.candidates)) for r in search.rounds),
        question=question,
        deviating=beyond,
        classes=classes,
        confounded=hidden,
        remaining=left,
        instruments=describe_mode(
            plant.instruments, plant.bench.ends_held, bool(plant.bench.arm)
        ),
        occasions=found.occasions,
        interrupted=search.interrupted,
        belief=belief,
    )


def _runner_up(c: Candidate) -> RunnerUp:
    values = c.crossed.problem.values(c.crossed.fits[0].x)
    own = c.crossed.problem.plant.library.effects[c.id].parameters
    sizes = {p.name: values.get(p.name, 0.0) for p in own}
    return RunnerUp(c.id, c.reduction, c.z, not c.reason, c.reason, sizes)


def one_time(stretch: Stretch | None, by_trial: str) -> bool:
    """Return whether one stretch makes the error, or trials differ at random."""
    alone = stretch is not None and stretch.rest <= Limit.max_misfit
    return alone or bool(by_trial)


def cause_classes(names: Sequence[str]) -> tuple[CauseClass, ...]:
    """Return the classes of `names`; one that several share only if all are there."""
    known = [CLASSES[name] for name in dict.fromkeys(names) if name in CLASSES]
    shared = Counter(each.causes for each in CLASSES.values())
    here = Counter(each.causes for each in known)
    found = {e.causes: e for e in known if shared[e.causes] == here[e.causes]}
    return tuple(found.values())


def declared_sentence(declared: Mapping[str, str]) -> str:
    facts = [f"{effect_name(name)} ({fact})" for name, fact in declared.items()]
    return f" Limited by what [rig] declares: {list_words(facts)}." if facts else ""


def verdict_of(
    found: Found,
    deviating: Sequence[Deviating] = (),
    stretch: Stretch | None = None,
    unhooked: float = 0.0,
    classes: Sequence[CauseClass] = (),
) -> tuple[Verdict, str]:
    """Return the verdict as one word and as a few sentences.

    `deviating` are parameters far beyond their priors, `stretch` exceeds its limit,
    `unhooked` is the largest error over noise of trials with the cables off. `classes`
    are those of what is named or deviates.
    """
    if found.effects:
        kind, statement = _verdict(found, stretch, unhooked)
    else:
        kind, statement = _no_effect_verdict(found.search.before, found, stretch)
    also = (capitalise(each.statement) for each in deviating)
    return kind, " ".join([statement, *also, *map(class_statement, classes)])


def _verdict(
    found: Found, stretch: Stretch | None, unhooked: float
) -> tuple[Verdict, str]:
    search, gap, missing = found.search, found.held.gap, found.missing
    misfit, left = search.before.misfit, search.after.misfit
    model = _model_statement(found, stretch)
    if not missing:
        if not any(
            e.disputed and not (e.refinement or e.ordinary) for e in found.effects
        ):
            kind, nothing = _no_effect_verdict(search.after, found, stretch)
            return kind, f"{nothing} {model}"
        return "unknown", (
            "Something is missing, and parts of these data name different effects for "
            f"it{_describe_implausible(search)}. {closest_sentence(search)} {model}"
        )
    explained = 1.0 - (left - 1.0) / (misfit - 1.0) if misfit > 1.0 else 1.0
    # A model that stays far off is wrong in form, and large errors show that.
    little = explained < Limit.min_explained_share or left > Limit.max_explained_error
    named = effect_names(missing)
    takes = f"takes {format_share(explained)} of the RMS error above the noise"
    closed = fitting.overall_share(gap)
    if left > Limit.max_misfit and little and closed < Limit.min_gap_closed:
        return "unknown", (
            f"Something is missing{_describe_implausible(search)}. What comes closest "
            f"is {named}: it {takes} and leaves {format_number(left)} times the "
            f"noise floor, so it does not reach the noise. {model}"
        )
    if unhooked > Limit.trial_limit and all(
        EFFECTS[name].where == "conduit" for name in missing
    ):
        return "unknown", (
            "Something is missing at motor, joint or sensors: with the cables off the "
            f"error is {format_number(unhooked)} times the noise floor, which "
            f"no cable causes. {capitalise(named)} {takes}. {model}"
        )
    if misfit < Limit.hint_error:
        model += (
            f" The error of the tuned scene is only {format_number(misfit)} times the "
            f"noise floor.{_HINT_CAVEAT}"
        )
    tied = {name for tie in found.ties for name in tie}
    if tied:
        sure = [name for name in missing if name not in tied]
        groups = [effect_names(sure)] if sure else []
        groups += [effect_names(tie, "or") for tie in found.ties]
        every = ", and ".join(groups)
        return "tie", f"Missing: {every}. These data do not show which. {model}"
    verb = "is" if len(missing) == 1 else "are"
    return "named", f"{capitalise(named)} {verb} missing. {model}"


def _model_statement(found: Found, stretch: Stretch | None) -> str:
    before, after = fitting.floor_ratios(found.held.gap)
    changes = [
        f"the {channel_name(name)} "
        f"{'falls' if g.rmse_after <= g.rmse_before else 'rises'} from "
        f"{format_number(g.rmse_before)} to {format_number(g.rmse_after)} N m "
        f"(noise floor {format_number(g.noise_floor)})"
        for name, g in found.held.gap.items()
    ]
    text = (
        f"On held-out data the error of the repaired model is {after:.1f} times the "
        f"noise floor, that of the tuned scene {before:.1f} times. The weighted RMS "
        f"error of {list_words(changes)}."
    )
    if stretch is not None and stretch.size > Limit.stretch_limit:
        text += f" One stretch is left: {stretch.statement}"
    usual = [each.id for each in found.effects if each.ordinary]
    others = [each for each in found.effects if not each.ordinary]
    refining = [(each.id, *each.rivals) for each in others if each.refinement]
    if refining:
        either = capitalise(list_words(effect_names(e, "or") for e in refining))
        text += (
            f" {either} refines the model, but explains too little to be called "
            "missing."
        )
    if usual:
        text += (
            f" {capitalise(effect_names(usual))} is in the model, but may be no "
            "larger than uneven bends and loose ends of any conduit make."
        )
    disputed = [
        f"{effect_name(each.id)} is supported by {format_share(each.agreement)} of the "
        "parts of the data only"
        for each in others
        if each.disputed and not each.refinement
    ]
    if disputed:
        words = capitalise(list_words(disputed))
        text += f" {words}, so it may stand in for something else."
    return text


def _no_effect_verdict(
    model: CrossValidation, found: Found, stretch: Stretch | None
) -> tuple[Verdict, str]:
    if stretch is not None and stretch.rest <= Limit.max_misfit:
        return "unknown", (
            f"The data disagree with the simulation in one stretch: {stretch.statement}"
        )
    if found.by_trial:
        return "unknown", found.by_trial
    misfit = format_number(model.misfit)
    scene = "tuned scene" if model is found.search.before else "model"
    off = f"on held-out data the error of the {scene} is {misfit} times the noise floor"
    usual = f"rigs without any hidden effect reach up to {Limit.max_misfit:g} times"
    if stretch is None and model.misfit <= Limit.max_misfit:
        return "none", f"Nothing is missing: {off}; {usual}."
    if stretch is None and fitting.excess(model) < Limit.min_z:
        return "none", (
            f"Nothing is missing that these data could show: {off}. "
            f"{capitalise(usual)}, but here a few moments make that error, which is "
            "no evidence."
        )
    caveat = _HINT_CAVEAT if model.misfit < Limit.hint_error else ""
    most = f" The largest error: {stretch.statement}" if stretch else ""
    return "unknown", (
        f"Something is missing (error {misfit} times the noise floor). "
        f"{closest_sentence(found.search)} See where the error lies.{caveat}{most}"
    )


def closest_sentence(found: Search) -> str:
    tried = [(c, step.before) for step in found.rounds for c in step.candidates]
    tried = [(c, before) for c, before in tried if c.reason and c.crossed is not before]
    if not tried:
        return "To first order no effect of the library takes enough of it."
    closest, before = max(tried, key=lambda each: each[0].reduction)
    left = closest.crossed.misfit_by(before.problem.inflation)
    share = 1.0 - (left - 1.0) / max(before.misfit - 1.0, 1e-9)
    if share < 0.01:
        return "No effect of the library that was refitted takes 1 % of it."
    return (
        f"What comes closest is {effect_name(closest.id)}: it takes "
        f"{format_share(share)} of the RMS error above the noise and leaves "
        f"{format_number(left)} times the noise floor, but is refused: "
        f"{closest.reason}."
    )


def _describe_implausible(found: Search) -> str:
    last = [c for step in found.rounds[-1:] for c in step.candidates]
    able = [c for c in last if c.reason.startswith(IMPLAUSIBLE_PREFIX)]
    statements = [f"{effect_name(c.id)} {c.reason}" for c in able]
    return f"; {list_words(statements)}" if statements else ""


STUDIED: Mapping[Verdict, tuple[float, float]] = {
    "named": (0.95, 19.4),
    "tie": (0.89, 19.4),
    "none": (0.94, 1.7),
    "unknown": (0.91, 39.3),
}
"""Share of right verdicts, and the largest error over the floor that they left.

The share is that of the 247 rigs of the fourteenth sealed set, printed by
`scripts/diagnosis_study/diagnose_benchmark.py`; on new rigs with the standard trials
verdicts were right at least as often. Beyond the error no rate is known.
"""


def probabilities(z: Mapping[str, float]) -> dict[str, float]:
    """Return the probability of a model, "", and of rivals, by its z over each."""
    normal = NormalDist()
    weights = {name: normal.cdf(-each) / normal.cdf(each) for name, each in z.items()}
    weights[""] = 1.0
    total = sum(weights.values())
    return {name: weight / total for name, weight in weights.items()}


def belief_in_verdict(
    found: Search, kind: Verdict, missing: Sequence[str],
    ties: Sequence[Sequence[str]], left: float,
) -> VerdictOdds:  # fmt: skip
    """Return the probability that a verdict is right, and its alternatives.

    A named effect is right if it, or another cause of its class, acts; a tie if one of
    its effects, or of their causes, does. The first of each of `ties` is in the model;
    `left` is the model's error over the noise.
    """
    reliable, most = STUDIED[kind]
    if left > most:
        return VerdictOdds(
            math.nan,
            f"How often such a verdict is right is not known: it leaves "
            f"{format_number(left)} times the noise floor, and such verdicts on study "
            f"rigs left at most {most:g} times.",
            (),
        )
    if kind in ("none", "unknown"):  # a rate: no models are compared
        names, meaning = ["small"], "nothing was missing"
        if kind == "unknown":
            names = [*missing]
            meaning = "something acted that the library does not have"
        share, rest = format_share(reliable), 1.0 - reliable
        instead = tuple(Alternative(name, rest / len(names)) for name in names)
        text = f"On study rigs {share} of such verdicts were right: {meaning}."
        return VerdictOdds(reliable, text, instead)
    if left > Limit.max_explained_error:
        reliable = (Limit.far_off_right + 1) / (Limit.far_off_names + 2)
    groups = {group[0]: set(group) for group in ties}
    whole, others = reliable, [Alternative("outside", 1.0 - reliable)]
    for step in found.rounds:
        leader = next((n for n in missing if n in (step.added, *step.parted)), None)
        if leader is None or (leader != step.added and step.added in missing):
            continue
        group = groups.get(leader, set()) | {leader}
        shares = probabilities(_alternatives(found, step, leader, group))
        whole *= shares.pop("")
        others += [Alternative(name, reliable * each) for name, each in shares.items()]
    classes = cause_classes([*{*missing}.union(*ties)])
    return _worded(kind, whole, others, left, classes)


def _alternatives(
    found: Search, step: Round, leader: str, group: set[str]
) -> dict[str, float]:
    """Return `comparison_z` of `leader` with "nothing" and ids not in `group`."""
    beside = {*found.after.problem.effects, *group}
    tried = [c for c in step.candidates if c.crossed is not step.before]
    errors = {c.id: fitting.blocks(c.crossed) for c in tried}
    best, start = errors[leader], fitting.blocks(step.before)
    before = float(start.sum())
    found_z = {"nothing": screening.comparison_z(best, start, before)}
    for c in step.candidates:
        implausible = c.reason.startswith(IMPLAUSIBLE_PREFIX)
        if implausible or c.id in beside or c.id not in errors:
            continue
        if group.intersection(EFFECTS[c.id].generalises):  # it contains the finding
            continue
        meet = EFFECTS[leader].forms_meet(EFFECTS[c.id])
        share = Limit.meeting_form_share if meet else None
        found_z[c.id] = screening.comparison_z(best, errors[c.id], before, share)
    return found_z


def _worded(
    kind: Verdict,
    probability: float,
    others: Sequence[Alternative],
    left: float,
    classes: Sequence[CauseClass] = (),
) -> VerdictOdds:
    shown = [each for each in others if each.probability >= Limit.min_shown]
    shown = sorted(shown, key=lambda each: -each.probability)[:3]
    words = {"nothing": "nothing is missing", "outside": "something else acts"}
    names = [words.get(each.id) or effect_name(each.id) for each in shown]
    rest = names
    if len(shown) != 1 or not math.isclose(
        shown[0].probability, 1.0 - probability, abs_tol=Limit.min_shown
    ):
        odds = [format_odds(each.probability) for each in shown]
        rest = [f"{name} (odds {o})" for name, o in zip(names, odds, strict=True)]
    complete = not left > Limit.max_explained_error
    cause = ", by any of its causes," if classes else ""
    subject = f"one of the tied effects{cause} acts"
    if kind == "named":
        subject = f"this{cause}{' and nothing else' if complete else ''} is missing"
    statement = f"The odds are {format_odds(probability)} that {subject}"
    if rest:
        statement += f"; otherwise {list_words(rest, 'or')}"
    if not complete:
        statement += (
            f". They are lower as {format_number(left)} times the noise floor is left: "
            f"on study rigs only {Limit.far_off_names} names left more than "
            f"{Limit.max_explained_error:g} times, of which {Limit.far_off_right} were "
            "right"
        )
    return VerdictOdds(probability, f"{statement}.", tuple(shown))
