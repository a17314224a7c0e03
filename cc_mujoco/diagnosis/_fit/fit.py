"""Fit of the scene to data, or a refusal of data that allow no conclusion.

A rig whose readings are in another unit can still be fitted, with another pretension,
friction and stiffness; effects found then are worthless, so units are checked before.

A fit converges from friction and stiffness a few times off, not a hundred, and never
from a pretension of 0. The mean tension of a cable is its stiffness times its stretch,
whatever its friction: a line through torques and stretch gives the stiffness, and a
coarse grid of simulations the rest. Where no point of the grid is much better than the
scene, the scene is the start.

The baseline, the model without effects, has every uncertain parameter of the scene
free. It is fitted first, by a simulation as fine as the noise floor requires.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._channels import TORQUE
from cc_mujoco.datasets._trials import Dataset
from cc_mujoco.diagnosis import _phrases as words
from cc_mujoco.diagnosis._fit import problem as fitting
from cc_mujoco.diagnosis._fit.noise_floor import noise_floor
from cc_mujoco.diagnosis._fit.problem import CrossValidation, Problem, TorqueDerivatives
from cc_mujoco.diagnosis._fit.trials import exchanged_torques
from cc_mujoco.diagnosis._rig import simulation
from cc_mujoco.diagnosis._rig.records import Arrays, Filtering, Record, prepare
from cc_mujoco.diagnosis._rig.simulation import SimulatedRig, Values
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import Diagnosis, Verdict
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.diagnosis.effects._effect import Effect, EffectError
from cc_mujoco.estimation._least_squares import Fit
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words


class Start(NamedTuple):
    bench: Bench  # with estimates or declarations in place of contradicted values
    given: Values = MappingProxyType({})  # scene's values replaced by estimates
    # All values of the fit that gave the estimates; empty without estimates
    values: Values = MappingProxyType({})


def prepare_start(
    dataset: Dataset, bench: Bench, thinned: bool = False
) -> tuple[Start, tuple[Record, ...], Filtering]:
    """Return the start of the fit, and the records and filters prepared for it.

    Which samples count depends on the start. `bench` includes what `[rig]` declares.
    Estimates by which the motor would no longer move the whole cable imitate something
    that the scene lacks, and are discarded.
    """
    records, filtering = prepare(dataset, bench, thinned)
    start = _estimate_start(dataset, bench, records)
    if start.bench is bench:
        return start, records, filtering
    again = prepare(dataset, start.bench, thinned)
    least = Limit.min_counted_samples
    if start.given and _count(again[0]) < least <= _count(records):
        return Start(bench), records, filtering
    return start, *again


def _count(records: Iterable[Record]) -> int:
    return sum(int(record.counts.sum()) for record in records)


def _estimate_start(dataset: Dataset, bench: Bench, records: Sequence[Record]) -> Start:
    """Return the scene, with estimates of parameters where the data contradict it."""
    hooked = [trial for trial in dataset.trials if not trial.facts.unhooked]
    declared = [t.facts.pretension for t in hooked if t.facts.pretension is not None]
    scene = bench.cables[0]
    # Trials have their own pretension, of which that of the scene is the unit.
    if declared and (len(declared) == len(hooked) or scene.pretension == 0.0):
        # A pretension of the scene that is about that of some trial is kept.
        factors = [_factor_between(e, scene.pretension) for e in declared]
        if min(factors) >= Limit.pretension_off_factor:
            bench = _with_parameters(bench, {"pretension": float(np.median(declared))})
            scene = bench.cables[0]
    whole = [r for r in records if not r.unhooked and r.load_cell is None]
    thin = [_thin_record(record) for record in whole]
    if _count(thin) < Limit.start_values_min_samples:
        return Start(bench)
    known = bool(declared) or "pretension" in dataset.constants
    best = _Grid(dataset, bench, thin).best(known)
    least = dict.fromkeys(("friction", "axial_stiffness"), Limit.off_factor)
    least["pretension"] = Limit.pretension_off_factor
    stated = {name: getattr(scene, name) for name in least if name in best}
    off = {name: _factor_between(best[name], stated[name]) for name in stated}
    given = {name: stated[name] for name in stated if off[name] > least[name]}
    if not given:
        return Start(bench)
    near = _with_parameters(bench, {name: best[name] for name in given})
    return Start(near, given, best)


def _with_parameters(bench: Bench, values: Mapping[str, float]) -> Bench:
    cables = tuple(cable.replace(**values) for cable in bench.cables)
    return replace(bench, cables=cables)


def _factor_between(one: float, other: float) -> float:
    return max(one / other, other / one) if other > 0.0 else math.inf


def _thin_record(record: Record) -> Record:
    """Thin a record to 25 Hz; unreserved samples count after a tenth of its travel."""
    every = max(1, round(0.04 / record.dt))
    moved = np.abs(np.diff(record.motor_angle)) + np.abs(np.diff(record.joint_angle))
    travel = np.concatenate([[0.0], np.cumsum(moved)])
    settled = travel > Limit.start_values_settling_share * travel[-1]
    counts = settled & (record.split != "test")
    return replace(
        record,
        dt=every * record.dt,
        time=record.time[::every],
        motor_angle=record.motor_angle[::every].copy(),
        joint_angle=record.joint_angle[::every].copy(),
        read=record.read[:, ::every],
        measured=record.measured[:, ::every].copy(),
        counts=counts[::every],
        path=None if record.path is None else record.path.thinned(every),
    )


class _Line(NamedTuple):
    """Regression of the cables' tension on the motor's travel beyond the joint's."""

    slope: float  # tension per lead at the motor's rim [N/m]
    start: float  # tension without lead [N]
    spread: float  # standard deviation of the tension [N]

    def offset(self, bench: Bench, pretension: float) -> float:
        """Return what to add to joint angles for cables at rest without lead [rad]."""
        rest = pretension if len(bench.cables) == 1 else 0.0
        return (rest - self.start) / (self.slope * bench.joint_radius)


def _fit_line(dataset: Dataset, bench: Bench, records: Sequence[Record]) -> _Line:
    """Fit the line by least squares; without stretch its slope may be negative."""
    rows, tensions = [], []
    for place, record in enumerate(records):
        used = record.counts
        along = bench.motor_radius * bench.following(record.joint_angle, record.path)
        lead = bench.motor_radius * record.motor_angle - along
        row = np.zeros((record.time.size, 2 + len(records)))
        row[:, 0], row[:, 2 + place] = lead, 1.0
        row[:, 1] = np.gradient(along, record.dt)  # clocks that differ
        rows.append(row[used])
        tensions.append(mean_tension(dataset, bench, record)[used])
    table, tension = np.concatenate(rows), np.concatenate(tensions)
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    slope, _, *starts = np.linalg.lstsq(table / size, tension)[0] / size
    return _Line(float(slope), float(np.median(starts)), float(np.std(tension)))


def mean_tension(dataset: Dataset, bench: Bench, record: Record) -> FloatArray:
    """Return agonist less antagonist tension by the measured torques (samples,) [N]."""
    shown = dict(zip(dataset.instruments.rows, record.measured, strict=True))
    ends = [shown[0] / bench.motor_radius] if 0 in shown else []
    if 1 in shown and bench.lever is None:
        ends.append(shown[1] / bench.joint_radius)
    elif not ends:
        arm = bench.share(record.joint_angle, record.path)
        ends.append(shown[1] / (bench.joint_radius * np.maximum(arm, 0.1)))
    return np.asarray(np.mean(ends, axis=0))


class _Grid:
    def __init__(self, dataset: Dataset, bench: Bench, records: list[Record]) -> None:
        self._dataset, self._bench, self._records = dataset, bench, records
        self._line = line = _fit_line(dataset, bench, records)
        self._scene = scene = bench.cables[0]
        stiff = line.slope * scene.length / len(bench.cables)
        if not (stiff > 0.0 and line.spread > 0.0):
            stiff = scene.axial_stiffness
        wrap = max(scene.wrap, 0.1)
        friction = np.divide((0.01, 0.03, 0.1, 0.3, 1.0, 3.0), wrap)
        stiffest = simulation.MAX_FITTED_STIFFNESS
        stiff_ones = np.multiply((0.25, 0.5, 1.0, 2.0, 4.0), stiff)
        taut = np.multiply((0.1, 0.3, 1.0, 3.0, 10.0), max(line.spread, 1e-3))
        points = {
            "friction": np.minimum(friction, Limit.max_fitted_friction),
            "axial_stiffness": np.minimum(stiff_ones, stiffest),
            "pretension": taut,
        }
        known = dataset.constants
        self._points = {n: p.tolist() for n, p in points.items() if n not in known}
        self._masks = [record.counts for record in records]

    def best(self, declared: bool) -> dict[str, float]:
        """Return the fitted values by name; {} where those of the scene are kept.

        An undeclared pretension may be wrong, too, and distorts the fit of all else.
        """
        free = ("friction", "axial_stiffness")
        if self._scene.pretension == 0.0:
            return self._fitted((*free, "pretension"))[0]
        found, usual = self._fitted(free)
        if declared:
            return found
        taut, cost = self._fitted((*free, "pretension"), coarse=True)
        if taut:
            off = _factor_between(taut["pretension"], self._scene.pretension)
            if not found:  # a fit from the scene's values
                given = {name: getattr(self._scene, name) for name in free}
                _, usual = self._refined(self._problem(given), [given])
            far = off > Limit.pretension_off_factor
            if far and cost < Limit.max_cost_ratio * usual:
                return taut
        return found

    def _fitted(
        self, names: Sequence[str], coarse: bool = False
    ) -> tuple[dict[str, float], float]:
        """Return values and cost of the best fit from a grid of the parameters `names`.

        They are {} and infinity if a taut scene is about as good as the best grid
        point, or no fit explains the data. A `coarse` grid has the line's stiffness.
        """
        tried = {name: each for name, each in self._points.items() if name in names}
        centre = {name: each[len(each) // 2] for name, each in tried.items()}
        if coarse and "axial_stiffness" in tried:
            tried["axial_stiffness"] = [centre["axial_stiffness"]]
        problem = self._problem(centre)
        grid = [dict(zip(tried, at, strict=True)) for at in product(*tried.values())]
        costs = [self._cost(problem, self._place(problem, each)) for each in grid]
        known = self._scene.pretension > 0.0
        given = {name: getattr(self._scene, name) for name in tried}
        plain = self._cost(problem, self._place(problem, given))
        if known and min(costs) > Limit.max_cost_ratio * plain:
            return {}, math.inf
        order = np.argsort(costs)[:3]
        best, cost = self._refined(problem, [grid[k] for k in order])
        size = len(self._dataset.instruments.rows) * _count(self._records)
        if known and cost > Limit.max_mean_square * size:
            return {}, math.inf
        return problem.values(best), cost

    def _refined(
        self, problem: Problem, starts: Sequence[Mapping[str, float]]
    ) -> tuple[FloatArray, float]:
        """Return the parameter vector and cost of the best fit from these starts."""
        places = [self._place(problem, start) for start in starts]
        fits = [fitting.fit(problem, place, self._masks, 12) for place in places]
        best = min(fits, key=lambda each: each.cost).x
        return best, self._cost(problem, best)

    def _problem(self, values: Mapping[str, float]) -> Problem:
        bench, records = _with_parameters(self._bench, values), self._records
        known, constants = self._dataset.instruments, self._dataset.constants
        plant = SimulatedRig(bench, tuple(records), 4, 1, known, constants)
        whole = np.concatenate([record.measured for record in records], axis=1)
        size = Limit.error_scale * np.std(whole, axis=1, keepdims=True) + 1e-9
        floor = tuple(np.broadcast_to(size, r.measured.shape) for r in records)
        free = simulation.baseline_parameters(bench, records, constants, known, values)
        return Problem(plant, free, (), floor, floor)

    def _place(self, problem: Problem, values: Mapping[str, float]) -> FloatArray:
        known = dict(values)
        if self._line.slope > 0.0:
            taut = values.get("pretension", self._scene.pretension)
            known["joint_angle_offset"] = self._line.offset(self._bench, taut)
        return problem.place(known)

    def _cost(self, problem: Problem, x: FloatArray) -> float:
        error = problem.residual(x, self._masks)
        return float(error @ error)


@dataclass(frozen=True)
class Options:
    """Effects to consider in a diagnosis, and its random seed."""

    # Effects to consider; by default all, rare ones only if `requested`, if they
    # resemble an accepted one, or where the others leave the error unexplained
    ids: Sequence[str] | None = None
    requested: Sequence[str] = ()  # effects that the user requested, rare ones included
    seed: int = 0  # seed of bootstraps and noise draws
    thinned: bool = False  # whether long trials are thinned, see `records.prepare`


@dataclass(frozen=True)
class BaselineFit:
    """Fitted baseline (the model without added effects), ready for the search."""

    problem: Problem
    whole: Fit
    crossed: CrossValidation
    change: float  # RMS change by a finer simulation, over the floor
    settings: Options = Options()
    notes: tuple[str, ...] = ()  # on requested effects that the data cannot show
    # Mean temperature of trials by name, where it is known [degC]
    temperatures: Mapping[str, float] = field(default_factory=dict)
    whole_records: tuple[Record, ...] = ()  # with all samples, where some are thinned

    def resolves(self, problem: Problem, x: FloatArray) -> bool:
        """Return whether thinning is harmless to a model of its records at `x`.

        It is as a coarse simulation is, by the change of the torques.
        """
        if not self.whole_records:
            return True
        pairs = list(zip(problem.plant.records, self.whole_records, strict=True))
        fine = replace(problem.plant, records=self.whole_records)
        there = fine.simulate(problem.values(x), problem.effects)
        here, counts = problem.torques(x), [record.counts for record, _ in pairs]
        changes = [
            fitting.huber_residual((own - other[:, :: round(r.dt / w.dt)]) / floor)
            for own, other, floor, (r, w) in zip(
                here, there, problem.floor, pairs, strict=True
            )
        ]
        sizes = changes, problem.errors(x)
        kept = (fitting.kept_samples(each, counts) for each in sizes)
        change, left = (float(np.sqrt(np.mean(each**2))) for each in kept)
        return change <= Limit.max_numerical_share * left


def plant_of(
    dataset: Dataset,
    bench: Bench,
    records: tuple[Record, ...],
    given: Mapping[str, float] | None = None,
) -> SimulatedRig:
    """Return the simulated rig at its coarsest resolution.

    `given` holds the scene's values that estimates have replaced, see `SimulatedRig`.
    """
    known, constants = dataset.instruments, dataset.constants
    least = Limit.min_segments
    return SimulatedRig(bench, records, least, 1, known, constants, given or {})


def fit_baseline(
    dataset: Dataset, plant: SimulatedRig, filtering: Filtering, seed: int
) -> BaselineFit:
    """Fit the baseline by the coarsest accurate simulation, or the finest allowed."""
    records = plant.records
    known = dataset.constants, dataset.instruments, plant.given
    free = simulation.baseline_parameters(plant.bench, records, *known)
    counts = [record.free for record in records]
    starts, slopes = [np.zeros(len(free))], TorqueDerivatives()
    # Of an unknown pretension, fits end in minima with or without a slack side.
    for k, p in enumerate(free):
        if p.name == "pretension" and p.scale > 0.3:
            for factor in (0.1, 0.3, 3.0):
                starts.append(np.zeros(len(free)))
                starts[-1][k] = math.log(factor) / p.scale
    while True:
        spreads = [0.02 * float(np.std(record.measured)) + 1e-9 for record in records]
        pairs = zip(records, spreads, strict=True)
        flat = tuple(np.full(r.measured.shape, spread) for r, spread in pairs)
        problem = Problem(plant, free, (), flat, flat, 0.2, slopes=slopes)
        tried = [fitting.fit(problem, start, counts) for start in starts]
        x = min(tried, key=lambda found: found.cost).x
        floor = noise_floor(dataset, plant, filtering, problem.values(x), seed=seed)
        problem = replace(
            problem, noise=floor.noise, floor=floor.tolerance, scatter=floor.scatter
        )
        problem = problem.with_inflated_noise(x, counts)
        x = fitting.fit(problem, x, counts).x
        weight = fitting.independence_weight(problem.errors(x), counts)
        problem = replace(problem, weight=weight)
        whole = fitting.fit(problem, x, counts)
        every = [record.counts for record in records]
        change, finer = fitting.refinement_change(problem, whole.x, every)
        if change <= Limit.max_numerical_error or finer is None:
            break
        plant, starts = finer, [whole.x]
        slopes = TorqueDerivatives(problem.slopes)
    division = fitting.interleaved_folds(records)
    crossed = fitting.cross_validate(problem, division, [whole.x] * len(division))
    return BaselineFit(problem, whole, crossed, change)


def fit_scene(
    dataset: Dataset, bench: Bench, settings: Options, progress: words.Progress
) -> BaselineFit | Diagnosis:
    """Return the fitted baseline, or a diagnosis if the data or numerics forbid one.

    Long trials are thinned if `settings` request it and it is harmless.
    """
    found = _fit_records(dataset, bench, settings, progress)
    if not settings.thinned:
        return found
    if isinstance(found, Diagnosis) or not found.resolves(found.problem, found.whole.x):
        return _fit_records(dataset, bench, replace(settings, thinned=False), progress)
    return found


def _fit_records(
    dataset: Dataset, bench: Bench, settings: Options, progress: words.Progress
) -> BaselineFit | Diagnosis:
    def refused(statement: str, verdict: Verdict = "fix-data") -> Diagnosis:
        return Diagnosis(verdict, statement, problems=(statement,))

    start, records, filtering = prepare_start(dataset, bench, settings.thinned)
    if useless := _excitation_problem(records):
        return refused(useless)
    plant = plant_of(dataset, start.bench, records, start.given)
    # Without a pretension a scene predicts nothing.
    given = bench if bench.cables[0].pretension > 0.0 else start.bench
    if wrong := unit_or_sign_error(replace(plant, bench=given), plant, start.values):
        return refused(wrong)
    progress(0.01, "checking the effects")
    notes = check_effects(plant, start.values, settings.requested)
    progress(0.02, "fitting the baseline")
    found = fit_baseline(dataset, plant, filtering, settings.seed)
    plant = found.problem.plant
    if found.change > Limit.max_numerical_error:
        return refused(
            f"A simulation with {2 * plant.segments} segments or {2 * plant.substeps} "
            f"steps per sample differs by {words.format_number(found.change)} times "
            f"the noise floor, more than {Limit.max_numerical_error:g}: what would be "
            "named could be the numerics. "
            f"Record faster than {1.0 / plant.records[0].dt:.0f} Hz, or reduce the "
            "wrap.",
            "fix-numerics",
        )
    if wrong := exchanged_torques(found.problem, found.whole.x):
        return refused(wrong)
    temperatures = {
        trial.name: float(np.nanmean(trial.temperature))
        for trial in dataset.trials
        if trial.temperature is not None and np.any(np.isfinite(trial.temperature))
    }
    whole = prepare(dataset, start.bench)[0] if settings.thinned else ()
    return replace(
        found,
        settings=settings,
        notes=notes,
        temperatures=temperatures,
        whole_records=whole,
    )


def _excitation_problem(records: Sequence[Record]) -> str:
    still = "the motor never moves enough to carry the whole cable along"
    reserved = [r for r in records if r.split == "test"]
    if _count(records) < Limit.min_counted_samples:
        return words.capitalise(
            f"{still}, so nothing can be compared; record larger motions."
        )
    if _count(r for r in records if r.split != "test") < Limit.min_counted_samples:
        return (
            f"In the trials that are not reserved (split = 'test') {still}; leave "
            "some of those that move for fitting."
        )
    if reserved and _count(reserved) < Limit.min_counted_samples:
        names = list_words(sorted({r.trial for r in reserved}))
        return (
            f"In what is reserved (split = 'test': {names}) {still}; reserve trials "
            "that move, or none."
        )
    return ""


def check_effects(
    plant: SimulatedRig, values: Mapping[str, float], ids: Sequence[str]
) -> tuple[str, ...]:
    """Return a sentence for each effect of `ids` that the data cannot show.

    Raises:
        EffectError: an effect makes a torque that is not finite, or is not off or not
            differentiable where its sizes are 0.
    """
    notes = []
    effects = plant.library.effects
    few = plant.limited(plant.records[:3])
    for name in ids:
        if name not in effects:
            library = plant.library
            why = library.hidden.get(name) or library.declared.get(name, "")
            notes.append(f"Effect {name!r} is not looked for: {why}.")
        elif not any(_check(effects[name], each, values) for each in (few, plant)):
            notes.append(
                f"Effect {name!r} changes nothing in these data; it takes "
                f"{EFFECTS[name].required_excitation}."
            )
    return tuple(notes)


def _check(effect: Effect, plant: SimulatedRig, values: Mapping[str, float]) -> bool:
    """Check one effect; return whether a typical size of it changes a torque."""
    shows, plain = False, plant.simulate(values)
    every = np.concatenate([torque.ravel() for torque in plain])
    least = Limit.rounding * float(np.linalg.norm(every))

    def changes(given: Mapping[str, float]) -> list[FloatArray]:
        with_it = plant.simulate(given, (effect.id,))
        for record, after in zip(plant.records, with_it, strict=True):
            if not np.isfinite(after).all():
                raise EffectError(
                    f"effect {effect.id!r} makes a torque that is not finite in trial "
                    f"{record.trial}"
                )
        pairs = zip(plain, with_it, strict=True)
        return [(after - before).ravel() for before, after in pairs]

    for start in effect.starts:
        sizes = [p for p in effect.parameters if p.linear]
        off = {**values, **start, **{p.name: 0.0 for p in sizes}}
        played = plant.simulate(off, (effect.id,))
        for record, before, after in zip(plant.records, plain, played, strict=True):
            if not np.array_equal(before, after):
                most = np.abs(after - before).max()
                raise EffectError(
                    f"effect {effect.id!r} is not off where its sizes are 0: it "
                    f"changes trial {record.trial} by {most:.3g} N m; "
                    "return the signals or cables unchanged there"
                )
        for parameter in sizes:
            full = start[parameter.name]
            # At 0 itself the kernel may change from one way of solving to another.
            first, second, whole = (
                np.concatenate(changes({**off, parameter.name: share * full}))
                for share in (Limit.small_share, 2.0 * Limit.small_share, 1.0)
            )
            small = float(np.linalg.norm(second - first)) / Limit.small_share
            large = float(np.linalg.norm(whole - first))
            if not (parameter.size and large > least):
                continue
            shows = True
            if not 0.01 <= (ratio := small / large) <= Limit.max_slope_ratio:
                what, advice = "0", "its root"
                if ratio > 1.0:
                    what, advice = "infinite", "a power of it"
                raise EffectError(
                    f"effect {effect.id!r}: the derivative of the torques with respect "
                    f"to {parameter.name!r} is {what} where that is 0, so no fit finds "
                    f"it; use {advice} as the size, so that the change begins in "
                    "proportion to it"
                )
    return shows


def unit_or_sign_error(
    plant: SimulatedRig,
    start: SimulatedRig | None = None,
    values: Values = MappingProxyType({}),
) -> str:
    """Return a sentence if torques contradict this scene by a unit or sign; "" if not.

    A scene may be off by any factor. The factor of a unit or a sign counts only if
    `values`, simulated by `start`, do not explain the readings much better.
    """
    wrong: list[str] = []
    units: set[str] = set()
    played = plant.simulate({})
    better = start.simulate(values) if start and values else played
    hooked = [not (r.unhooked or r.load_cell is not None) for r in plant.records]
    counts = [np.count_nonzero(record.free) > 1 for record in plant.records]
    used = np.flatnonzero(np.logical_and(hooked, counts)).tolist()
    known = plant.instruments
    for place, (row, channel) in enumerate(
        zip(known.rows, known.channels, strict=True)
    ):
        if known[row] != "torque sensor" or not used:
            continue
        sets = [r.measured for r in plant.records], played, better
        kept = [(k, plant.records[k].free) for k in used]
        measured, simulated, others = ([t[k][place, m] for k, m in kept] for t in sets)
        times = _torque_factor(measured, simulated)
        if better is not played:
            scaled = [(times or 0.0) * torque for torque in simulated]
            left = _residual_square(measured, others)
            most = Limit.alternative_error_ratio * _residual_square(measured, scaled)
            if left < most:  # other values explain it better than another unit
                continue
        pushes = False
        if len(plant.bench.cables) == 1:
            side = float(np.sign(np.concatenate(simulated).sum()))
            against = side * np.concatenate(measured) < 0.0
            pushes = bool(np.mean(against) > Limit.push_share)
        name = words.channel_name(channel)
        if pushes or (times is not None and _is_near_one(-times)):
            wrong.append(f"the {name} is the negative of")
        elif times is not None:
            factors = TORQUE.factors.items()
            other = [unit for unit, si in factors if _is_near_one(times * si)]
            if other and "Nm" not in other:
                wrong.append(f"the {name} is {words.format_number(times)} times")
                units.update(other)
    if not wrong:
        return ""
    guess = f"; readings in {list_words(sorted(units), 'or')} would be" if units else ""
    return words.capitalise(
        f"{list_words(wrong)} what the scene predicts before anything is "
        f"tuned{guess}. Declare unit or sign of the columns in dataset.toml, or put "
        "pretension, friction and pulleys of the scene right."
    )


def _residual_square(measured: Arrays, simulated: Arrays) -> float:
    pairs = zip(measured, simulated, strict=True)
    left = (one - other for one, other in pairs)
    return sum(float(np.sum((each - np.mean(each)) ** 2)) for each in left)


def _torque_factor(measured: Arrays, simulated: Arrays) -> float | None:
    """Return measured over simulated RMS torque, with sign; None if uncorrelated."""
    pair = measured, simulated
    one, other = (np.concatenate([t - t.mean() for t in torques]) for torques in pair)
    own, its, both = float(one @ one), float(other @ other), float(one @ other)
    scale = math.sqrt(own * its)
    if not scale > 0.0 or abs(both) < Limit.prerequisites_min_correlation * scale:
        return None
    return math.copysign(math.sqrt(own / its), both)


def _is_near_one(times: float) -> bool:
    return 1.0 / Limit.max_torque_factor < times < Limit.max_torque_factor
