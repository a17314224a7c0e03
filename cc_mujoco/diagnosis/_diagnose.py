"""The whole workflow: data and a scene in, a verdict, a report and a better scene out.

from cc_mujoco.diagnosis import diagnose

diagnosis = diagnose("bench.xml", ["data"], "out")
diagnosis.verdict, diagnosis.effects, diagnosis.gap
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._data_findings import DataFinding, errors
from cc_mujoco.datasets._trials import Dataset
from cc_mujoco.diagnosis._checks.lead_check import check_lead
from cc_mujoco.diagnosis._checks.run import (
    check_bench,
    check_known_torques,
    check_load_cells,
)
from cc_mujoco.diagnosis._loading import load
from cc_mujoco.diagnosis._partial.loss_only import diagnose_loss
from cc_mujoco.diagnosis._partial.motion_only import diagnose_motion
from cc_mujoco.diagnosis._phrases import DATA_PREFIX
from cc_mujoco.diagnosis._pipeline import run_inference, unanswered_diagnosis
from cc_mujoco.diagnosis._progress import Progress, no_progress
from cc_mujoco.diagnosis._report.output import preload_drawing, require_ours, write
from cc_mujoco.diagnosis._result import DiagnosisResult, Options
from cc_mujoco.diagnosis._scene.repair import existing_effects
from cc_mujoco.diagnosis._scene.requirements import require_repairable
from cc_mujoco.diagnosis._verdict import Diagnosis
from cc_mujoco.diagnosis.effects import EFFECTS, effects_in_use
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._least_squares import single_threaded_blas


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
        out: folder for what is found; `verdict.json` is written first, and the rest
            whole or not at all.
        axis: the axis that was recorded, of a device with several.
        dataset_toml: what the columns mean and what is known, see `dataset_file`.
        command: how it was called, for the report.
        seed: of bootstraps and noise draws.
        effects: effects to consider besides the usual ones: classes of your own,
            `FILE.py:CLASS`, `MODULE:CLASS`, or ids of rare effects of the library.
        progress: called with the share done and what is being done.

    Raises:
        CableError: an effect that cannot be used, no data, a wrong dataset file, a
            scene that is no bench or cannot be repaired (see `requirements`), or a
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
    """Return all of `diagnose` but the files: from data and a scene to a verdict.

    Args:
        bench: of the scene.
        data: as in `diagnose`.
        dataset_toml: as in `diagnose`.
        seed: as in `diagnose`.
        effects: as in `diagnose`.
        progress: as in `diagnose`.

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
        return unanswered_diagnosis(diagnosis, bench), dataset
    if not dataset.has_motor_angle:
        diagnosis = diagnose_loss(dataset, known, seed)
        return _noted(unanswered_diagnosis(diagnosis, bench), findings), dataset
    if not dataset.instruments.rows:
        diagnosis = diagnose_motion(dataset, known)
        return _noted(unanswered_diagnosis(diagnosis, bench), findings), dataset
    with single_threaded_blas():
        result = run_inference(
            dataset, bench, Options(seed=seed, requested=requested), progress
        )
    return _noted(result, findings), dataset


def _paths(
    data: Iterable[str | os.PathLike[str]] | str | os.PathLike[str],
) -> list[Path]:
    """Return the paths of files and folders, of which there may be a single one.

    Raises:
        CableError: something in their place is no path.
    """
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
    """Return a result that also lists what was found about the data."""
    doubts = [found.statement for found in findings if found.severity == "doubt"]
    question = " ".join([*doubts, result.diagnosis.question]).strip()
    notes = (finding.statement for finding in findings)
    problems = (*result.diagnosis.problems, *notes)
    diagnosis = replace(result.diagnosis, question=question, problems=problems)
    return replace(result, diagnosis=diagnosis)
