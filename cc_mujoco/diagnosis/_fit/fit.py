"""Fit of the scene to data, which refuses data that allow no conclusion.

A rig whose readings are in another unit can still be fitted, with another pretension,
friction and stiffness, and effects named then are worthless.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._channels import TORQUE
from cc_mujoco.datasets._trials import Dataset
from cc_mujoco.diagnosis._fit.baseline import BaselineFit, fit_baseline, plant_of
from cc_mujoco.diagnosis._fit.fitting import Problem
from cc_mujoco.diagnosis._fit.start_values import prepare_start
from cc_mujoco.diagnosis._fit.trials import exchanged_torques
from cc_mujoco.diagnosis._phrases import (
    Progress,
    capitalise,
    channel_name,
    format_number,
)
from cc_mujoco.diagnosis._rig.bench_simulation import SimulatedRig, Values
from cc_mujoco.diagnosis._rig.motions import CataloguedTrial
from cc_mujoco.diagnosis._rig.records import Record
from cc_mujoco.diagnosis._thresholds import Limit, Thresholds
from cc_mujoco.diagnosis._verdict import Diagnosis, Evidence
from cc_mujoco.diagnosis.effects import EFFECTS, Effect, EffectError
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words


@dataclass(frozen=True)
class Options:
    """Choices that a diagnosis is made with, besides data and scene."""

    ids: Sequence[str] | None = None
    """Effects to consider; by default all but the rare ones that are not `requested`,
    which are considered where the others leave the error unexplained."""
    requested: Sequence[str] = ()
    """Effects that the user requested, rare ones included."""
    thresholds: Thresholds = Thresholds()  # noqa: RUF009
    """Thresholds of the decisions."""
    seed: int = 0
    """Seed of bootstraps and noise draws."""


@dataclass(frozen=True)
class DiagnosisResult:
    """Diagnosis with the model, evidence and fits behind it."""

    diagnosis: Diagnosis
    """Verdict, in numbers and sentences."""
    bench: Bench
    """Rig as the scene has it."""
    evidence: Evidence = field(default_factory=Evidence)
    """Signals and maps that the report draws."""
    problem: Problem | None = None
    """Final model, or None where there is none."""
    x: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Parameters of the final model."""
    baseline_fit: BaselineFit | None = None
    """Fit of the baseline, or None where there is none."""
    motion: CataloguedTrial | None = None
    """Motion of the proposed trial, or None."""


def fit_scene(
    dataset: Dataset, bench: Bench, settings: Options, progress: Progress
) -> BaselineFit | DiagnosisResult:
    """Fit the baseline and its noise floor, or return a diagnosis that ends here.

    `bench` is the rig as the scene has it, with what is known of it.
    """
    start, records, filtering = prepare_start(dataset, bench)
    if useless := _excitation_problem(records):
        return _refused(bench, useless)
    plant = plant_of(dataset, start.bench, records, start.given)
    # Without a pretension a scene predicts nothing.
    given = bench if bench.cables[0].pretension > 0.0 else start.bench
    if wrong := unit_or_sign_error(replace(plant, bench=given), plant, start.values):
        return _refused(bench, wrong)
    progress(0.01, "checking the effects")
    notes = check_effects(plant, start.values, settings.requested)
    progress(0.02, "fitting the baseline")
    found = fit_baseline(dataset, plant, filtering, settings.seed)
    plant = found.problem.plant
    if found.change > Limit.max_numerical_error:
        statement = (
            f"A simulation with {2 * plant.segments} segments or {2 * plant.substeps} "
            "steps per sample "
            f"differs by {format_number(found.change)} times the noise floor, more "
            f"than {Limit.max_numerical_error:g}: what would be named could be the "
            "numerics. "
            f"Record faster than {1.0 / plant.records[0].dt:.0f} Hz, or reduce the "
            "wrap."
        )
        diagnosis = Diagnosis("fix-numerics", statement, problems=(statement,))
        return DiagnosisResult(diagnosis, bench, baseline_fit=found)
    if wrong := exchanged_torques(found.problem, found.whole.x):
        return _refused(bench, wrong)
    temperatures = {
        trial.name: float(np.nanmean(trial.temperature))
        for trial in dataset.trials
        if trial.temperature is not None and np.any(np.isfinite(trial.temperature))
    }
    return replace(found, notes=notes, temperatures=temperatures)


def _refused(bench: Bench, statement: str) -> DiagnosisResult:
    diagnosis = Diagnosis("fix-data", statement, problems=(statement,))
    return DiagnosisResult(diagnosis, bench)


def _excitation_problem(records: Sequence[Record]) -> str:
    """Return the reason why nothing can be compared or tested, or ""."""
    still = "the motor never moves enough to carry the whole cable along"
    if sum(int(r.counts.sum()) for r in records) < Limit.min_counted_samples:
        return (
            f"{capitalise(still)}, so nothing can be compared; record larger motions."
        )
    if sum(int(r.free.sum()) for r in records) < Limit.min_counted_samples:
        return (
            f"In the trials that are not reserved (split = 'test') {still}; leave "
            "some of those that move for fitting."
        )
    tests = [r for r in records if r.split == "test"]
    if tests and sum(int(r.reserved.sum()) for r in tests) < Limit.min_counted_samples:
        names = list_words(sorted({r.trial for r in tests}))
        return (
            f"In what is reserved (split = 'test': {names}) {still}; reserve trials "
            "that move, or none."
        )
    return ""


def check_effects(
    plant: SimulatedRig, values: Mapping[str, float], ids: Sequence[str]
) -> tuple[str, ...]:
    """Check effects on the data, and return a sentence for each that they cannot show.

    An effect is refused if it is not off where its sizes are 0, if its torques are not
    finite, or if they have no derivative with respect to a size at 0.
    """
    notes = []
    effects = plant.library.effects
    few = plant.limited(plant.records[: Limit.max_checked_records])
    plain = few.simulate(values) if ids else []
    for name in ids:
        if name not in effects:
            library = plant.library
            why = library.hidden.get(name) or library.declared.get(name, "")
            notes.append(f"Effect {name!r} is not looked for: {why}.")
        elif not _check(effects[name], few, values, plain) and not _check(
            effects[name], plant, values, plant.simulate(values)
        ):
            notes.append(
                f"Effect {name!r} changes nothing in these data; it takes "
                f"{EFFECTS[name].required_excitation}."
            )
    return tuple(notes)


def _check(
    effect: Effect,
    plant: SimulatedRig,
    values: Mapping[str, float],
    plain: Sequence[FloatArray],
) -> bool:
    """Check one effect; return whether a typical size changes a torque."""
    shows = False
    least = Limit.rounding * float(
        np.linalg.norm(np.concatenate([p.ravel() for p in plain]))
    )
    for start in effect.starts:
        sizes = [p for p in effect.parameters if p.linear]
        off = {**values, **start, **{p.name: 0.0 for p in sizes}}
        for record, before, after in zip(
            plant.records, plain, plant.simulate(off, (effect.id,)), strict=True
        ):
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
                _change(effect, plant, plain, {**off, parameter.name: share * full})
                for share in (Limit.small_share, 2.0 * Limit.small_share, 1.0)
            )
            small = float(np.linalg.norm(second - first)) / Limit.small_share
            large = float(np.linalg.norm(whole - first))
            shows |= large > least and parameter.size
            if parameter.size and large > least:
                _require_slope(effect, parameter.name, small / large)
    return shows


def _change(
    effect: Effect,
    plant: SimulatedRig,
    plain: Sequence[FloatArray],
    values: Mapping[str, float],
) -> FloatArray:
    """Return the change of all torques by an effect [N m]."""
    changes = []
    for record, before, after in zip(
        plant.records, plain, plant.simulate(values, (effect.id,)), strict=True
    ):
        if not np.isfinite(after).all():
            raise EffectError(
                f"effect {effect.id!r} makes a torque that is not finite in trial "
                f"{record.trial}"
            )
        changes.append((after - before).ravel())
    return np.concatenate(changes)


def _require_slope(effect: Effect, name: str, ratio: float) -> None:
    """Refuse a size whose derivative at 0 is infinite or 0."""
    if 0.01 <= ratio <= Limit.max_slope_ratio:
        return
    what = "infinite" if ratio > 1.0 else "0"
    advice = "its root" if ratio < 1.0 else "a power of it"
    raise EffectError(
        f"effect {effect.id!r}: the derivative of the torques with respect to "
        f"{name!r} is {what} where that is 0, so no fit finds it; use {advice} as the "
        "size, so that the change begins in proportion to it"
    )


_NO_VALUES: Values = {}


def unit_or_sign_error(
    plant: SimulatedRig, start: SimulatedRig | None = None, values: Values = _NO_VALUES
) -> str:
    """Return in what the torques contradict this scene by unit or sign, or "".

    A generic scene may be off by any factor. Only the factor of a unit is reported, and
    only if no other friction, stiffness or pretension explains the readings. `start` is
    the plant with estimates in place of values that the data contradict; `values` are
    those that come with the estimates.
    """
    contradictions: list[str] = []
    units: set[str] = set()
    played = plant.simulate({})
    better = start.simulate(values) if start and values else None
    for row, name in enumerate(plant.instruments.channels):
        if plant.instruments[plant.instruments.rows[row]] != "torque sensor":
            continue
        measured, simulated = _torque_pairs(plant, played, row)
        times = _torque_factor(measured, simulated)
        if better is not None and _other_values_explain(
            measured, simulated, times, _torque_pairs(plant, better, row)[1]
        ):
            continue
        alone = len(plant.bench.cables) == 1
        if (alone and _would_push(measured, simulated)) or (
            times is not None and _is_near_one(-times)
        ):
            contradictions.append(f"the {channel_name(name)} is the negative of")
        elif times is None:
            continue
        elif other := [
            u for u, si in TORQUE.factors.items() if _is_near_one(times * si)
        ]:
            if "Nm" not in other:
                contradictions.append(
                    f"the {channel_name(name)} is {format_number(times)} times"
                )
                units.update(other)
    if not contradictions:
        return ""
    guess = f"; readings in {list_words(sorted(units), 'or')} would be" if units else ""
    return capitalise(
        f"{list_words(contradictions)} what the scene predicts before anything is "
        f"tuned{guess}. Declare unit or sign of the columns in dataset.toml, or put "
        "pretension, friction and pulleys of the scene right."
    )


def _other_values_explain(
    measured: Sequence[FloatArray],
    simulated: Sequence[FloatArray],
    times: float | None,
    better: Sequence[FloatArray],
) -> bool:
    """Return whether other values explain a torque better than the scene in a unit."""
    scaled = [(times or 0.0) * torque for torque in simulated]
    return _residual_square(
        measured, better
    ) < Limit.alternative_error_ratio * _residual_square(measured, scaled)


def _residual_square(
    measured: Sequence[FloatArray], simulated: Sequence[FloatArray]
) -> float:
    return sum(
        float(np.sum((one - other - np.mean(one - other)) ** 2))
        for one, other in zip(measured, simulated, strict=True)
    )


def _torque_pairs(
    plant: SimulatedRig, played: Sequence[FloatArray], row: int
) -> tuple[list[FloatArray], list[FloatArray]]:
    kept = [
        (record.measured[row, record.free], torque[row, record.free])
        for record, torque in zip(plant.records, played, strict=True)
        if np.count_nonzero(record.free) > 1
        and not record.unhooked
        and record.load_cell is None
    ]
    return [measured for measured, _ in kept], [simulated for _, simulated in kept]


def _torque_factor(
    measured: Sequence[FloatArray], simulated: Sequence[FloatArray]
) -> float | None:
    """Return measured over simulated torque during sliding, None if dissimilar."""
    if not measured:
        return None
    one = np.concatenate([torque - torque.mean() for torque in measured])
    other = np.concatenate([torque - torque.mean() for torque in simulated])
    scale = math.sqrt(float(one @ one) * float(other @ other))
    if (
        not scale > 0.0
        or abs(float(one @ other)) < Limit.prerequisites_min_correlation * scale
    ):
        return None
    return math.copysign(
        math.sqrt(float(one @ one) / float(other @ other)), float(one @ other)
    )


def _would_push(
    measured: Sequence[FloatArray], simulated: Sequence[FloatArray]
) -> bool:
    if not measured:
        return False
    side = float(np.sign(np.concatenate(simulated).sum()))
    return bool(np.mean(side * np.concatenate(measured) < 0.0) > Limit.push_share)


def _is_near_one(times: float) -> bool:
    return 1.0 / Limit.max_torque_factor < times < Limit.max_torque_factor
