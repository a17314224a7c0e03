"""Workflow of a diagnosis: from a scene and data to verdict, report and repair."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._data_findings import DataFinding, errors
from cc_mujoco.datasets._trials import Dataset
from cc_mujoco.diagnosis._checks.mechanics import check_lead
from cc_mujoco.diagnosis._checks.readings import (
    check_bench,
    check_known_torques,
    check_load_cells,
)
from cc_mujoco.diagnosis._fit.fit import Options, fit_scene, floor_ratios
from cc_mujoco.diagnosis._fit.intervals import undetermined
from cc_mujoco.diagnosis._judge import judge, undecidable_sentence
from cc_mujoco.diagnosis._loading import load
from cc_mujoco.diagnosis._locate import locate_error
from cc_mujoco.diagnosis._partial.loss import diagnose_loss
from cc_mujoco.diagnosis._partial.motion import describe_mode, diagnose_motion
from cc_mujoco.diagnosis._phrases import DATA_PREFIX, Progress, no_progress
from cc_mujoco.diagnosis._propose.experiment import propose
from cc_mujoco.diagnosis._report.output import (
    DiagnosisResult,
    preload_drawing,
    require_ours,
    write,
)
from cc_mujoco.diagnosis._scene.repair import existing_effects, require_repairable
from cc_mujoco.diagnosis._search.candidates import Round
from cc_mujoco.diagnosis._search.search import search_effects
from cc_mujoco.diagnosis._verdict import Baseline, Diagnosis, RunnerUp
from cc_mujoco.diagnosis.effects import EFFECTS, effects_in_use
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.estimation._least_squares import single_threaded_blas
from cc_mujoco.report._html import list_words


def diagnose(
    scene: str | os.PathLike[str],
    data: Iterable[str | os.PathLike[str]] | str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    axis: str | None = None,
    dataset_toml: str | os.PathLike[str] | None = None,
    command: str = "",
    seed: int = 0,
    effects: Sequence[Any] = (),
    progress: Progress = no_progress,
) -> Diagnosis:
    """Diagnose trials against a scene and write report, verdict, scene and recording.

    Args:
        scene: MJCF file of the rig, or name of a built-in scene.
        data: trial files (see `_utils.tables.ENDINGS`) or folders of them; a
            single one need not be in a list. Several folders are several occasions of
            one rig, in order: effects are shared, friction, pretension, stiffness,
            offsets and clocks are fitted to each.
        out: folder for the results; `verdict.json` is written first, and the rest
            whole or not at all.
        axis: the axis that was recorded, of a device with several.
        dataset_toml: what the columns mean and what is known, see `dataset_file`.
        command: how it was called, for the report.
        seed: of bootstraps and noise draws.
        effects: effects to consider besides the usual ones: classes of your own,
            `FILE.py:CLASS`, `MODULE:CLASS`, or ids of rare effects of the library.
        progress: called with the share done and the present step.

    Raises:
        CableError: an effect that cannot be used, no data, a wrong dataset file, a
            scene that is no bench or cannot be repaired (see `repair`), or a
            folder with the scene, with the diagnosis of other data or with other files
            that would be replaced.
    """
    if not isinstance(scene, str | os.PathLike) or Path(scene).is_dir():
        raise CableError(
            "diagnose takes the scene first: diagnose(scene, data, out), with an MJCF "
            f"file or a name, not {scene!r}."
        )
    with effects_in_use(effects) as requested:
        bench = Bench.of(Path(scene), axis)
        given = _paths(data)
        require_ours(Path(out), bench.path, given)
        preload_drawing()
        result, dataset = infer(
            bench,
            given,
            dataset_toml=dataset_toml,
            seed=seed,
            effects=requested,
            progress=progress,
        )
        names = [name for name in effects if isinstance(name, str)]
        return write(result, dataset, Path(out), command, seed, names)


def infer(
    bench: Bench,
    data: Iterable[str | os.PathLike[str]] | str | os.PathLike[str],
    *,
    dataset_toml: str | os.PathLike[str] | None = None,
    seed: int = 0,
    effects: Sequence[Any] = (),
    progress: Progress = no_progress,
) -> tuple[DiagnosisResult, Dataset]:
    """Diagnose as `diagnose` does, but write no files.

    Arguments as in `diagnose`, but `bench` is that of the scene.

    Raises:
        CableError: an effect that cannot be used, no data, a wrong dataset file or a
            scene that cannot be repaired.
    """
    with effects_in_use(effects) as requested:
        return _infer(_paths(data), bench, dataset_toml, seed, requested, progress)


def _infer(
    data: Sequence[Path],
    bench: Bench,
    dataset_toml: str | os.PathLike[str] | None,
    seed: int,
    requested: Sequence[str],
    progress: Progress,
) -> tuple[DiagnosisResult, Dataset]:
    """Return what `infer` does, with effects that are in the library."""
    if present := existing_effects(bench.path):
        raise CableError(
            f"scene {bench.path} has {', '.join(present)} outside its cables from an "
            "earlier diagnosis, which no baseline tunes; give the scene before it"
        )
    require_repairable(bench)
    progress(0.0, "reading the data")
    columns = {column for effect in EFFECTS.values() for column in effect.columns}
    dataset, findings = load(data, dataset_toml, bench, sorted(columns))
    for finding in findings:
        if finding.severity == "doubt":
            warnings.warn(finding.statement, CableWarning, stacklevel=4)
    known = bench.known(dataset.constants)
    if dataset.has_motor_angle:
        findings += check_bench(dataset.trials, known)
        if not errors(findings):
            findings += check_lead(dataset.trials, known)
    findings += check_known_torques(dataset) + check_load_cells(dataset, known)
    wrong = errors(findings)
    notes = [f.statement for f in sorted(findings, key=lambda each: each not in wrong)]
    if wrong or not dataset.trials:
        statements = [finding.statement for finding in wrong] or [
            "No trial can be read."
        ]
        more = len(statements) - 1
        statement = f"{DATA_PREFIX}: {statements[0]}"
        if more:
            statement += f" The report lists {more} more."
        diagnosis = Diagnosis(
            "fix-data", statement, problems=tuple(notes or statements)
        )
        return DiagnosisResult(diagnosis, bench), dataset
    if not dataset.has_motor_angle:
        diagnosis = diagnose_loss(dataset, known, seed)
        return _noted(DiagnosisResult(diagnosis, bench), findings), dataset
    if not dataset.instruments.rows:
        diagnosis = diagnose_motion(dataset, known)
        return _noted(DiagnosisResult(diagnosis, bench), findings), dataset
    with single_threaded_blas():
        result = run_inference(
            dataset, bench, Options(seed=seed, requested=requested), progress
        )
    return _noted(result, findings), dataset


def run_inference(
    dataset: Dataset,
    bench: Bench,
    settings: Options = Options(),  # noqa: B008
    progress: Progress = no_progress,
) -> DiagnosisResult:
    """Return the verdict on checked trials, without any file.

    Args:
        dataset: trials of `_loading.load`, without anything to fix.
        bench: rig as the scene has it.
        settings: choices besides data and scene.
        progress: called with the share done and the present step.
    """
    bench = replace(bench.known(dataset.constants), ends_held=dataset.ends_held)
    fitted = fit_scene(dataset, bench, settings, progress)
    if isinstance(fitted, Diagnosis):
        return DiagnosisResult(fitted, bench)
    if fitted.refusal:
        return DiagnosisResult(fitted.refusal, bench, baseline_fit=fitted)
    found = search_effects(fitted, settings, progress)
    judged = judge(found)
    proposal = propose(found)
    located = locate_error(fitted, found, judged, settings.seed)
    progress(0.95, "writing it down")
    statement = judged.statement
    if found.ties and proposal is None:
        statement += undecidable_sentence(found.ties[0])
    baseline, search = fitted.problem, found.search
    counts = [record.counts for record in found.problem.plant.records]
    diagnosis = Diagnosis(
        judged.verdict,
        statement,
        effects=found.effects,
        ties=found.ties,
        not_testable=judged.not_testable,
        next_experiment=proposal.experiment if proposal else None,
        where=located.where,
        gap=found.held.gap,
        problems=(*_never_held_out_note(found.held.never), *fitted.notes),
        baseline=Baseline(
            {p.name: found.estimated[p.name] for p in baseline.tuned},
            undetermined(baseline, fitted.whole.x, counts),
        ),
        runner_ups=tuple(_runner_ups(step) for step in search.rounds),
        trials=located.trials,
        question=located.question,
        deviating=judged.deviating,
        confounded=judged.confounded,
        remaining=floor_ratios(found.held.gap)[1],
        instruments=describe_mode(
            dataset.instruments, dataset.ends_held, bool(bench.arm)
        ),
        occasions=found.occasions,
        interrupted=search.interrupted,
        belief=judged.belief,
    )
    return DiagnosisResult(
        diagnosis,
        bench,
        located.evidence,
        found.problem,
        found.x,
        fitted,
        proposal.motion if proposal else None,
    )


def _never_held_out_note(trials: Sequence[str]) -> tuple[str, ...]:
    """Return a note that names the trials that are in every training part."""
    if not trials:
        return ()
    one = len(trials) == 1
    return (
        f"{list_words(trials)} {'is the only trial' if one else 'are the only trials'} "
        f"of {'its' if one else 'their'} kind (side held, pretension, tilt, weights), "
        f"so {'it is' if one else 'they are'} in every fit and the held-out error is "
        "that of the others; record more like it to check it.",
    )


def _runner_ups(step: Round) -> tuple[RunnerUp, ...]:
    return tuple(
        RunnerUp(
            c.id,
            c.reduction,
            c.z,
            not c.reason,
            c.reason,
            {
                parameter.name: c.crossed.problem.values(c.crossed.fits[0].x).get(
                    parameter.name, 0.0
                )
                for parameter in c.crossed.problem.plant.library.effects[
                    c.id
                ].parameters
            },
        )
        for c in step.candidates
    )


def _paths(
    data: Iterable[str | os.PathLike[str]] | str | os.PathLike[str],
) -> list[Path]:
    """Return the paths; a single one need not be in a list."""
    if isinstance(data, str | os.PathLike):
        return [Path(data)]
    paths = []
    for path in data:
        if not isinstance(path, str | os.PathLike):
            raise CableError(
                f"data must be a path or a list of paths, but holds {path!r}, a "
                f"{type(path).__name__}."
            )
        paths.append(Path(path))
    return paths


def _noted(result: DiagnosisResult, findings: Sequence[DataFinding]) -> DiagnosisResult:
    """Return the result with the findings on the data added."""
    doubts = [found.statement for found in findings if found.severity == "doubt"]
    question = " ".join([*doubts, result.diagnosis.question]).strip()
    notes = (finding.statement for finding in findings)
    problems = (*result.diagnosis.problems, *notes)
    diagnosis = replace(result.diagnosis, question=question, problems=problems)
    return replace(result, diagnosis=diagnosis)
