"""The question `fit`: how well does the tuned scene explain the data?

It refuses data from which nothing can be concluded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._trials import Dataset
from cc_mujoco.diagnosis._fit.baseline import BaselineFit, fit_baseline, plant_of
from cc_mujoco.diagnosis._fit.fitting import Problem
from cc_mujoco.diagnosis._fit.prerequisites import check_effects, unit_or_sign_error
from cc_mujoco.diagnosis._fit.start_values import prepare_start
from cc_mujoco.diagnosis._fit.trials import exchanged_torques
from cc_mujoco.diagnosis._phrases import Progress, capitalise, format_number
from cc_mujoco.diagnosis._rig.motions import CataloguedTrial
from cc_mujoco.diagnosis._rig.records import Record
from cc_mujoco.diagnosis._thresholds import Limit, Thresholds
from cc_mujoco.diagnosis._verdict import Diagnosis, Evidence
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
    """A diagnosis with everything that belongs to it."""

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
    """Fit the baseline and its noise floor.

    Args:
        dataset: trials of `_loading.load`, without anything to fix.
        bench: rig as the scene has it, with what is known of it.
        settings: choices besides data and scene.
        progress: called with the share done and what is being done.

    Returns:
        The fit, or a diagnosis that ends here.
    """
    start, records, filtering = prepare_start(dataset, bench)
    if useless := _excitation_problem(records):
        return _refused(bench, useless)
    plant = plant_of(dataset, start.bench, records, start.given)
    # Without a pretension a scene foretells nothing.
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
    """Return why nothing can be compared or tested, or ""."""
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
