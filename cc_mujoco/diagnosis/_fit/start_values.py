"""Start values of the fit, where those of the scene contradict the data.

A fit of friction and stiffness finds its way from a few times their size, but not from
a hundred, and nothing starts from a pretension of 0. The mean tension of a cable is its
stiffness times its stretch, whatever its friction; so a line through torques and
stretch gives the stiffness, and a coarse grid of simulations the rest. Where nothing on
the grid is much better than the scene, the scene is the start.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._trials import Dataset
from cc_mujoco.diagnosis._fit.fitting import Problem, fit
from cc_mujoco.diagnosis._rig.bench_simulation import (
    MAX_FITTED_STIFFNESS,
    SimulatedRig,
    baseline_parameters,
)
from cc_mujoco.diagnosis._rig.records import Filtering, Record, prepare
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.native import FloatArray

_FREE_PARAMETERS = ("friction", "axial_stiffness")
"""Parameters that a scene may give with any value."""
_ESTIMATED_PARAMETERS = (*_FREE_PARAMETERS, "pretension")
_MAX_EVALUATIONS = 12


class Start(NamedTuple):
    """Starting point of the fit of the baseline.

    Attributes:
        bench: with estimates in place of values that the data contradict.
        given: those values of the scene, by name.
        values: that the estimates come with; empty where the scene is the start.
    """

    bench: Bench
    given: Mapping[str, float]
    values: Mapping[str, float]


def prepare_start(
    dataset: Dataset, bench: Bench
) -> tuple[Start, tuple[Record, ...], Filtering]:
    """Return the start, and records with the samples that count by its values.

    `bench` is that of the scene, with what `[rig]` declares. Estimates by which no
    motion would carry the cable along, though by the scene it does, are not used: they
    fit something that the scene lacks.
    """
    records, filtering = prepare(dataset, bench)
    start = estimate_start(dataset, bench, records)
    if start.bench is bench:
        return start, records, filtering
    again = prepare(dataset, start.bench)
    if _count(again[0]) < Limit.min_counted_samples <= _count(records) and start.given:
        return Start(bench, {}, {}), records, filtering
    return start, *again


def _count(records: Sequence[Record]) -> int:
    return sum(int(record.counts.sum()) for record in records)


def estimate_start(dataset: Dataset, bench: Bench, records: Sequence[Record]) -> Start:
    """Return the start: the scene, with estimates where the data contradict it.

    Declarations of `[rig]` are not replaced. The records may count any samples.
    """
    hooked = [trial for trial in dataset.trials if not trial.facts.unhooked]
    declared = [t.facts.pretension for t in hooked if t.facts.pretension is not None]
    # Trials have their own pretension, of which that of the scene is the unit.
    if 0 < len(declared) == len(hooked) or (
        declared and bench.cables[0].pretension == 0.0
    ):
        bench = _with_usual_pretension(bench, declared)
    thin = [
        _thin_record(record)
        for record in records
        if not record.unhooked and record.load_cell is None
    ]
    if _count(thin) < Limit.start_values_min_samples:
        return Start(bench, {}, {})
    known = bool(declared) or "pretension" in dataset.constants
    best = _best_values(dataset, bench, thin, known)
    scene = bench.cables[0]
    least = {name: Limit.off_factor for name in _FREE_PARAMETERS} | {
        "pretension": Limit.pretension_off_factor
    }
    given = {
        name: getattr(scene, name)
        for name in _ESTIMATED_PARAMETERS
        if name in best
        and _factor_between(best[name], getattr(scene, name)) > least[name]
    }
    if not given:
        return Start(bench, {}, {})
    return Start(
        _with_parameters(bench, {name: best[name] for name in given}), given, best
    )


def _with_usual_pretension(bench: Bench, declared: Sequence[float]) -> Bench:
    """Return the bench with the usual pretension of the trials.

    A pretension of the scene that is about that of some trial is kept.
    """
    scene = bench.cables[0].pretension
    if any(
        _factor_between(each, scene) < Limit.pretension_off_factor for each in declared
    ):
        return bench
    return _with_parameters(bench, {"pretension": float(np.median(declared))})


def _with_parameters(bench: Bench, values: Mapping[str, float]) -> Bench:
    cables = tuple(cable.replace(**values) for cable in bench.cables)
    return replace(bench, cables=cables)


def _factor_between(one: float, other: float) -> float:
    return max(one / other, other / one) if other > 0.0 else math.inf


def _thin_record(record: Record) -> Record:
    """Return a record with fewer samples, of which all but the first part count."""
    every = max(1, round(Limit.thinned_step / record.dt))
    moved = np.abs(np.diff(record.motor_angle)) + np.abs(np.diff(record.joint_angle))
    travel = np.concatenate([[0.0], np.cumsum(moved)])
    counts = (travel > Limit.start_values_settling_share * travel[-1]) & (
        record.split != "test"
    )
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
    """Line of the cable tension, agonist less antagonist, over the lead of the motor.

    Attributes:
        slope: tension per lead at the motor's rim [N/m].
        start: tension without lead [N].
        spread: standard deviation of the tension [N].
    """

    slope: float
    start: float
    spread: float

    def offset(self, bench: Bench, pretension: float) -> float:
        """Return the joint's angle at which the cables have their pretension [rad]."""
        rest = pretension if len(bench.cables) == 1 else 0.0
        return (rest - self.start) / (self.slope * bench.joint_radius)


def _fit_line(dataset: Dataset, bench: Bench, records: Sequence[Record]) -> _Line:
    """Fit the line by least squares; its slope is not positive without a stretch."""
    rows, tensions = [], []
    for place, record in enumerate(records):
        used = record.counts
        along = bench.motor_radius * bench.following(record.joint_angle, record.path)
        lead = bench.motor_radius * record.motor_angle - along
        row = np.zeros((record.time.size, 2 + len(records)))
        row[:, 0], row[:, 2 + place] = lead, 1.0
        row[:, 1] = np.gradient(along, record.dt)  # clocks that differ
        rows.append(row[used])
        tensions.append(_mean_tension(dataset, bench, record)[used])
    table, tension = np.concatenate(rows), np.concatenate(tensions)
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    slope, _, *starts = np.linalg.lstsq(table / size, tension)[0] / size
    return _Line(float(slope), float(np.median(starts)), float(np.std(tension)))


def _mean_tension(dataset: Dataset, bench: Bench, record: Record) -> FloatArray:
    """Return the mean tension of the cables, agonist less antagonist (samples,) [N]."""
    shown = dict(zip(dataset.instruments.rows, record.measured, strict=True))
    ends = [shown[0] / bench.motor_radius] if 0 in shown else []
    if 1 in shown and bench.lever is None:
        ends.append(shown[1] / bench.joint_radius)
    elif not ends:
        arm = bench.share(record.joint_angle, record.path)
        ends.append(shown[1] / (bench.joint_radius * np.maximum(arm, Limit.min_arm)))
    found: FloatArray = np.mean(ends, axis=0)
    return found


class _Fitted(NamedTuple):
    values: dict[str, float]
    cost: float


class _Grid:
    """Fits from the best points of a grid of simulations."""

    def __init__(
        self, dataset: Dataset, bench: Bench, records: Sequence[Record]
    ) -> None:
        self._dataset, self._bench, self._records = dataset, bench, records
        self._line = line = _fit_line(dataset, bench, records)
        scene = bench.cables[0]
        wrap = max(scene.wrap, Limit.min_wrap)
        stiff = line.slope * scene.length / len(bench.cables)
        if not (stiff > 0.0 and line.spread > 0.0):
            stiff = scene.axial_stiffness
        self._points = {
            "friction": [
                min(each / wrap, Limit.max_fitted_friction)
                for each in Limit.friction_grid
            ],
            "axial_stiffness": [
                min(each * stiff, MAX_FITTED_STIFFNESS) for each in Limit.stiffness_grid
            ],
            "pretension": [
                each * max(line.spread, 1e-3) for each in Limit.pretension_grid
            ],
        }
        self._masks = [record.counts for record in records]
        self._size = len(dataset.instruments.rows) * sum(
            int(mask.sum()) for mask in self._masks
        )

    def fitted(self, names: Sequence[str], coarse: bool = False) -> _Fitted | None:
        """Return the best fit of the baseline, with the parameters of these names free.

        It is None where the scene's own values are not much worse than the best point,
        or where the residuals say that none of these values explain the data. If
        `coarse`, the grid has only the stiffness of the line.
        """
        tried = {
            name: each
            for name, each in self._points.items()
            if name in names and name not in self._dataset.constants
        }
        centre = {name: each[len(each) // 2] for name, each in tried.items()}
        if coarse and "axial_stiffness" in tried:
            tried["axial_stiffness"] = [centre["axial_stiffness"]]
        problem = self._problem(centre)
        grid = [
            self._place(problem, dict(zip(tried, values, strict=True)))
            for values in product(*tried.values())
        ]
        costs = [self._cost(problem, x) for x in grid]
        scene = self._bench.cables[0]
        known = scene.pretension > 0.0
        given = {name: getattr(scene, name) for name in tried}
        if known and min(costs) > Limit.max_cost_ratio * self._cost(
            problem, self._place(problem, given)
        ):
            return None
        order = np.argsort(costs)[: Limit.refined_points]
        fits = [fit(problem, grid[k], self._masks, _MAX_EVALUATIONS) for k in order]
        best = min(fits, key=lambda each: each.cost).x
        cost = self._cost(problem, best)
        if known and cost > Limit.max_mean_square * self._size:
            return None
        return _Fitted(problem.values(best), cost)

    def of_scene(self, names: Sequence[str]) -> float:
        """Return the cost of a fit from the scene's values, these parameters free."""
        scene = self._bench.cables[0]
        given = {name: getattr(scene, name) for name in names}
        problem = self._problem(given)
        start = self._place(problem, given)
        return self._cost(problem, fit(problem, start, self._masks, _MAX_EVALUATIONS).x)

    def _problem(self, values: Mapping[str, float]) -> Problem:
        bench = _with_parameters(self._bench, values)
        return _rough_problem(self._dataset, bench, self._records, values)

    def _place(self, problem: Problem, values: Mapping[str, float]) -> FloatArray:
        taut = values.get("pretension", self._bench.cables[0].pretension)
        known = dict(values)
        if self._line.slope > 0.0:
            known["joint_angle_offset"] = self._line.offset(self._bench, taut)
        return problem.place(known)

    def _cost(self, problem: Problem, x: FloatArray) -> float:
        error = problem.residual(x, self._masks)
        return float(error @ error)


def _best_values(
    dataset: Dataset, bench: Bench, records: Sequence[Record], declared: bool
) -> dict[str, float]:
    """Return the best values; none where the scene's are not much worse.

    A pretension that nobody declared may be wrong, too. Its prior is a tenth, so one
    that the data contradict distorts the fit of all else.
    """
    grid = _Grid(dataset, bench, records)
    if bench.cables[0].pretension == 0.0:
        found = grid.fitted(_ESTIMATED_PARAMETERS)
        return found.values if found else {}
    found = grid.fitted(_FREE_PARAMETERS)
    if not declared and (taut := grid.fitted(_ESTIMATED_PARAMETERS, coarse=True)):
        off = _factor_between(taut.values["pretension"], bench.cables[0].pretension)
        usual = found.cost if found else grid.of_scene(_FREE_PARAMETERS)
        if (
            off > Limit.pretension_off_factor
            and taut.cost < Limit.max_cost_ratio * usual
        ):
            return taut.values
    return found.values if found else {}


def _rough_problem(
    dataset: Dataset, bench: Bench, records: Sequence[Record], guessed: Collection[str]
) -> Problem:
    known, constants = dataset.instruments, dataset.constants
    plant = SimulatedRig(
        bench, tuple(records), 4, instruments=known, constants=constants
    )
    whole = np.concatenate([record.measured for record in records], axis=1)
    size = Limit.error_scale * np.std(whole, axis=1, keepdims=True) + 1e-9
    floor = tuple(np.broadcast_to(size, record.measured.shape) for record in records)
    free = baseline_parameters(bench, records, constants, known, guessed)
    return Problem(plant, free, (), floor, floor)
