"""Workflow of a diagnosis: from a scene and data to verdict, report and repair.

Six steps follow each other: `fit_scene`, `search_effects`, `judge`, `locate_error`,
`learn_residual` and `propose`. Each is one function, whose result holds all that the
next ones need; the last three complete the diagnosis of `judge`. The report is written
before a trial is proposed, and again with it.
"""

import os
import warnings
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cc_mujoco.assets import SCENES
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._data_findings import errors, statements
from cc_mujoco.datasets._trials import Dataset
from cc_mujoco.diagnosis._checks import readings
from cc_mujoco.diagnosis._checks.mechanics import check_lead
from cc_mujoco.diagnosis._events import find_events, leave_out, sized
from cc_mujoco.diagnosis._fit.dead_zone import dead_zones, describe_dead_zones
from cc_mujoco.diagnosis._fit.fit import BaselineFit, Options, fit_scene
from cc_mujoco.diagnosis._fit.intervals import undetermined
from cc_mujoco.diagnosis._judge import judge
from cc_mujoco.diagnosis._learn.residual import learn_residual
from cc_mujoco.diagnosis._loading import load
from cc_mujoco.diagnosis._locate import evidence_of, locate_error
from cc_mujoco.diagnosis._partial.loss import diagnose_loss
from cc_mujoco.diagnosis._partial.motion import diagnose_motion
from cc_mujoco.diagnosis._phrases import (
    DATA_PREFIX,
    PROPOSAL_FOLLOWS,
    Progress,
    no_progress,
)
from cc_mujoco.diagnosis._propose.experiment import propose
from cc_mujoco.diagnosis._report import output
from cc_mujoco.diagnosis._report.drawer import NO_DRAWER, Drawer
from cc_mujoco.diagnosis._report.output import DiagnosisResult
from cc_mujoco.diagnosis._scene.repair import existing_effects, require_repairable
from cc_mujoco.diagnosis._search.search import Found, search_effects
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import Baseline, Diagnosis, Event
from cc_mujoco.diagnosis.effects import EFFECTS, effects_in_use
from cc_mujoco.errors import CableError, CableWarning
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
    reported: Callable[[Diagnosis], object] = lambda _: None,
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
        dataset_toml: meaning of the columns and known facts, see `dataset_file`.
        command: command line, for the report.
        seed: seed of bootstraps and noise draws.
        effects: effects to consider besides the usual ones: classes of your own,
            `FILE.py:CLASS`, `MODULE:CLASS`, or ids of rare effects of the library.
        progress: called with the share done and the present step.
        reported: called with the diagnosis once all is written; only the trial that
            would separate a tie follows, and is added to what is written. An
            interrupt meanwhile leaves it out.

    Raises:
        CableError: an effect that cannot be used, no data, a wrong dataset file, a
            scene that is no bench or cannot be repaired (see `repair`), or a
            folder with the scene, with the diagnosis of other data or with other files
            that would be replaced.
    """
    named = isinstance(scene, str | os.PathLike)
    if not named or (Path(scene).is_dir() and str(scene) not in SCENES):
        raise CableError(
            "diagnose takes the scene first: diagnose(scene, data, out), with an MJCF "
            f"file or a name, not {scene!r}."
        )
    with effects_in_use(effects) as requested, Drawer() as drawer:
        bench = Bench.of(Path(scene), axis)
        given = _paths(data)
        output.require_ours(Path(out), bench.path, given)
        drawer.start()
        known: Any = {"dataset_toml": dataset_toml, "seed": seed, "progress": progress}
        known |= {"effects": requested, "proposing": False, "drawer": drawer}
        result, dataset = infer(bench, given, **known)
        names = [name for name in effects if isinstance(name, str)]
        statement = result.diagnosis.statement
        tied = result.found is not None and bool(result.found.ties)
        if tied:
            text = f"{statement} {PROPOSAL_FOLLOWS}"
            begun = replace(result.diagnosis, statement=text)
            result = replace(result, diagnosis=begun)
        found = output.write(result, dataset, Path(out), command, seed, names, drawer)
        reported(found)
        if tied:
            with suppress(KeyboardInterrupt):  # what is written stays
                judged = replace(found, statement=statement)
                result = with_proposal(replace(result, diagnosis=judged))
                output.add_proposal(result, dataset, Path(out))
                return result.diagnosis
        return found


def infer(
    bench: Bench,
    data: Iterable[str | os.PathLike[str]] | str | os.PathLike[str],
    *,
    dataset_toml: str | os.PathLike[str] | None = None,
    seed: int = 0,
    effects: Sequence[Any] = (),
    progress: Progress = no_progress,
    proposing: bool = True,
    drawer: Drawer = NO_DRAWER,
) -> tuple[DiagnosisResult, Dataset]:
    """Diagnose as `diagnose` does, with the bench of the scene, and write no files.

    Return the result and the dataset that was read. Without `proposing` no trial is
    designed that would separate a tie; `with_proposal` does that. A `drawer` begins
    once there is evidence.

    Raises:
        CableError: an effect that cannot be used, no data, a wrong dataset file or a
            scene that cannot be repaired.
    """
    with effects_in_use(effects) as requested:
        paths = _paths(data)
        if present := existing_effects(bench.path):
            raise CableError(
                f"scene {bench.path} has {', '.join(present)} outside its cables from "
                "an earlier diagnosis, which no baseline tunes; give the scene before "
                "it"
            )
        require_repairable(bench)
        progress(0.0, "reading the data")
        columns = {column for effect in EFFECTS.values() for column in effect.columns}
        dataset, findings = load(paths, dataset_toml, bench, sorted(columns))
        for finding in findings:
            if finding.severity == "doubt":
                warnings.warn(finding.statement, CableWarning, stacklevel=3)
        known = bench.known(dataset.constants)
        if dataset.has_motor_angle:
            findings += readings.check_bench(dataset.trials, known)
            if not errors(findings):
                findings += check_lead(dataset.trials, known)
        findings += readings.check_known_torques(dataset)
        findings += readings.check_load_cells(dataset, known)
        wrong = errors(findings)
        if wrong or not dataset.trials:
            first = wrong[0].statement if wrong else "No trial can be read."
            statement = f"{DATA_PREFIX}: {first}"
            if wrong[1:]:
                statement += f" The report lists {len(wrong) - 1} more."
            ranked = sorted(findings, key=lambda finding: finding not in wrong)
            notes = tuple(finding.statement for finding in ranked) or (first,)
            diagnosis = Diagnosis("fix-data", statement, problems=notes)
            return DiagnosisResult(diagnosis, bench), dataset
        if not dataset.has_motor_angle:
            result = DiagnosisResult(diagnose_loss(dataset, known, seed), bench)
        elif not dataset.instruments.rows:
            result = DiagnosisResult(diagnose_motion(dataset, known), bench)
        else:
            settings = Options(seed=seed, requested=requested)
            with single_threaded_blas():
                result = run_inference(dataset, bench, settings, progress, drawer)
        found = result.diagnosis
        doubts = statements(each for each in findings if each.severity == "doubt")
        notes = statements(findings)
        diagnosis = replace(
            found,
            question=" ".join([*doubts, found.question]).strip(),
            problems=(*found.problems, *notes),
        )
        result = replace(result, diagnosis=diagnosis)
        return with_proposal(result) if proposing else result, dataset


def run_inference(
    dataset: Dataset,
    bench: Bench,
    settings: Options = Options(),  # noqa: B008
    progress: Progress = no_progress,
    drawer: Drawer = NO_DRAWER,
) -> DiagnosisResult:
    """Return the diagnosis of trials in which `load` finds no error, no proposal."""
    bench = replace(bench.known(dataset.constants), ends_held=dataset.ends_held)
    found, events = _search_without_events(dataset, bench, settings, progress)
    if isinstance(found, Diagnosis):
        return DiagnosisResult(found, bench)
    evidence = evidence_of(found)
    drawer.begin(found.held.gap, evidence)
    progress(0.9, "locating what is left")
    diagnosis = locate_error(found, judge(found), evidence.maps)
    diagnosis, problem, x = learn_residual(found, diagnosis)
    progress(0.95, "writing it down")
    baseline = found.fitted.problem
    counts = [record.counts for record in found.problem.plant.records]
    values = {p.name: found.estimated[p.name] for p in baseline.tuned}
    open_ones = undetermined(baseline, found.fitted.whole.x, counts)
    happened = tuple(sized(event, found.estimated) for event in events)
    records = found.fitted.whole_records or found.problem.plant.records
    zones = dead_zones(dataset, bench, records)
    diagnosis = replace(
        diagnosis,
        baseline=Baseline(values, open_ones),
        events=happened,
        statement=diagnosis.statement + describe_dead_zones(zones, len(dataset.trials)),
        problems=(*diagnosis.problems, *(zone.statement for zone in zones)),
    )
    return DiagnosisResult(diagnosis, bench, evidence, problem, x, found)


def _search_without_events(
    dataset: Dataset, bench: Bench, settings: Options, progress: Progress
) -> tuple[Found | Diagnosis, list[Event]]:
    """Return the search in all data but events, or why none is made; and the events.

    They are looked for in the tuned scene, and again in the model that was found. Long
    trials are thinned until a model needs all samples; then all begins again.
    """
    events, whole = list[Event](), dataset
    long = any(np.ptp(trial.time) > Limit.long_trial for trial in dataset.trials)
    settings = replace(settings, thinned=long)
    fitted = fit_scene(dataset, bench, settings, progress)
    while not isinstance(fitted, Diagnosis):
        more = len(events) < Limit.max_events
        happened = find_events(fitted.problem, fitted.whole.x, dataset) if more else []
        rests = _without_events(dataset, happened, bench, settings, progress)
        if not rests:
            found = search_effects(fitted, progress)
            if found.search.interrupted:
                return found, events
            if not fitted.resolves(found.problem, found.x):
                settings, dataset = replace(settings, thinned=False), whole
                events.clear()
                fitted = fit_scene(dataset, bench, settings, progress)
                continue
            off = found.problem.effects or fitted.crossed.misfit > Limit.layout_error
            if not (more and off):
                return found, events
            model = found.problem, found.x
            happened = find_events(*model, dataset, any_motion=True)
            rests = _without_events(dataset, happened, bench, settings, progress)
        if not rests:  # no event, or too little left without it
            return found, events
        # Of two sides the larger stays unless the smaller fits much better.
        worse = Limit.max_remaining_ratio * rests[-1][0] < rests[0][0]
        _, event, dataset, fitted = rests[-1 if worse else 0]
        events.append(event)
    return fitted, events


def _without_events(
    dataset: Dataset, events: Sequence[Event], bench: Bench, settings: Options,
    progress: Progress,
) -> list[tuple[float, Event, Dataset, BaselineFit]]:  # fmt: skip
    """Return misfit, remaining data and fit without each event that leaves enough."""
    rests = []
    for event in events:
        rest = leave_out(dataset, event)
        again = fit_scene(rest, bench, settings, progress)
        if not isinstance(again, Diagnosis):
            rests.append((again.crossed.misfit, event, rest, again))
    return rests


def with_proposal(result: DiagnosisResult) -> DiagnosisResult:
    """Return the result with the trials that would separate its first tie, if any."""
    if result.found is None or not result.found.ties:
        return result
    with single_threaded_blas():
        diagnosis, motions = propose(result.found, result.diagnosis)
    return replace(result, diagnosis=diagnosis, motions=motions)


def _paths(
    data: Iterable[str | os.PathLike[str]] | str | os.PathLike[str],
) -> list[Path]:
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
