"""Intake of files into a dataset, with everything noticed on the way.

>>> from cc_mujoco.diagnosis._loading import load
>>> dataset, findings = load(["data"], "dataset.toml")    # doctest: +SKIP
>>> for finding in findings:                              # doctest: +SKIP
...     print(finding.severity, finding.statement)
"""

import hashlib
import os
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from cc_mujoco.assets import SCENES, scene_path
from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets import _folders as data_folders
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._clock import SampledTrack, decimate, find_segments, sort_rows
from cc_mujoco.datasets._data_findings import DataFinding, error, errors, warning
from cc_mujoco.datasets._dataset_file import (
    DatasetFile,
    TrialFile,
    group_files,
    read_dataset_file,
)
from cc_mujoco.datasets._glitches import drop_glitches
from cc_mujoco.datasets._reading import Recording, read
from cc_mujoco.datasets._run_log import is_log, other_scene, truncation_reason
from cc_mujoco.datasets._torques import OtherAxes, add_derived_torques, derived_noise
from cc_mujoco.datasets._trials import Dataset, Trial, TrialFacts
from cc_mujoco.diagnosis._checks import readings
from cc_mujoco.diagnosis._checks.content import noise_of, wrong_repeats
from cc_mujoco.diagnosis._rig.records import compared_band
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words


def load(
    paths: Iterable[str | os.PathLike[str]] | str | os.PathLike[str],
    dataset_toml: str | os.PathLike[str] | None = None,
    bench: Bench | None = None,
    columns: Collection[str] = (),
) -> tuple[Dataset, list[DataFinding]]:
    """Read and check trials.

    Args:
        paths: files (see `_utils.tables.ENDINGS`) or folders; their order
            is kept, folders are sorted by name. Several folders are occasions.
        dataset_toml: meaning of the columns; without it, the `dataset.toml` in the
            folder of the data, if there is one.
        bench: bench of the scene, by which load cells become torques.
        columns: further columns that effects take, where the files have them.

    Returns:
        The dataset, without the trials that cannot be read, and findings. If
        any finding is of severity `error`, nothing should be concluded from the data.

    Raises:
        CableError: there are no data files, or the `dataset.toml` is wrong.
    """
    paths = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
    files = data_folders.data_files(paths)
    folders = data_folders.occasion_folders(paths)
    if dataset_toml is None:
        files_of = [data_folders.data_files([folder]) for folder in folders.values()]
        declared = [data_folders.find_dataset_file(own) for own in files_of]
        if sum(path is not None for path in declared) > 1:
            return _load_each(folders, bench, columns)
    findings: list[DataFinding] = []
    given = None if dataset_toml is None else Path(dataset_toml)
    toml = given or data_folders.find_dataset_file(files)
    file = DatasetFile() if toml is None else read_dataset_file(toml)
    if toml is not None and dataset_toml is None:
        findings.append(warning(f"The columns are read as {toml} declares them."))
    axis = bench.axis if bench else ""
    others: Mapping[str, str] = {}
    strange = bench.other_axes if bench else ()
    alone = bench is not None and len(bench.cables) == 1
    if bench is not None:
        others = bench.recorded_angles(file.source(channels.JOINT_TORQUE).measured)
        other_axes = OtherAxes(bench)
    names, parts = _trials_by_file(files, file)
    nearby = data_folders.nearby_data_files(files, file.path)
    findings += file.check_trials(names, nearby)
    trials: list[Trial] = []
    known: dict[str, Path] = {}
    for path, name in names.items():
        facts = file.facts_of(path, names)
        if facts.exclude:
            continue
        try:
            trial = parts.get(path, path)
            recording = read(trial, file, name, axis, others, columns, strange)
        except CableError as wrong:
            findings.append(error(str(wrong), name))
            continue
        twin = known.setdefault(_readings(recording), path)
        if twin != path:
            message = (
                f"{path} has the readings of {twin} and is left out; a copy is no "
                "repeat."
            )
            findings.append(warning(message, name))
            continue
        if not facts.occasion:
            facts = replace(facts, occasion=data_folders.occasion_of(path, folders))
        findings += _check_origin(recording, bench)
        recording.findings = findings
        ordered = sort_rows(recording)
        if ordered is None:
            continue
        recording = drop_glitches(ordered, alone)
        if bench is not None and is_log(path):
            _count_as_data(recording, bench, file)
        track = find_segments(recording, facts, file)
        if track is None:
            continue
        if why := truncation_reason(path).rstrip("."):
            message = (
                f"{path} is what there is of a run that was cut short ({why}); record "
                "it again if it lacks what it was to show."
            )
            findings.append(warning(message, name))
        readings.check_recording(recording, facts, file)
        track = decimate(recording, track)
        if bench is not None:
            other_axes.take_off(recording, track)
        trials.append(_trial(recording, track, facts))
    known_bench = bench.known(file.rig) if bench else None
    trials, instruments, found = add_derived_torques(trials, file, known_bench)
    measured = file.source(channels.MOTOR_ANGLE).measured
    if not measured:
        found.append(warning("The motor's angle is not measured."))
    elif bench is not None and bench.others:  # the ends do not turn by one ratio
        found += readings.check_motions(trials)
    else:
        found += readings.check_trials(trials, alone)
    findings += found
    dataset = Dataset(
        trials=tuple(trials),
        constants=file.rig,
        name=file.name,
        notes=file.notes,
        path=file.path,
        sha256=file.sha256,
        instruments=instruments,
    )
    noise = noise_of(dataset, file)
    if bench is not None and channels.JOINT_TORQUE in noise:
        rate = min(trial.rate for trial in trials)
        passed = min(1.0, 2.0 * compared_band(rate) / rate)
        own = noise[channels.JOINT_TORQUE]
        noise[channels.JOINT_TORQUE] = other_axes.noise(own, passed)
    noise |= derived_noise(noise, instruments, file.rig, known_bench)
    findings += wrong_repeats(dataset.trials) if measured else []
    findings += data_folders.check_occasions(dataset.trials)
    return replace(dataset, noise=noise), findings


def _readings(recording: Recording) -> str:
    digest = hashlib.sha256()
    for channel, values in recording.values.items():
        if channel != channels.TIME:
            digest.update(channel.encode() + np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def _load_each(
    folders: Mapping[str, Path], bench: Bench | None, columns: Collection[str]
) -> tuple[Dataset, list[DataFinding]]:
    parts, findings = {}, []
    for name, folder in folders.items():
        part, found = load(folder, None, bench, columns)
        facts = [(t, t.facts.occasion or name) for t in part.trials]
        own = [replace(t, facts=replace(t.facts, occasion=day)) for t, day in facts]
        parts[name] = replace(part, trials=tuple(own))
        findings += found
    if errors(findings):
        return next(iter(parts.values())), findings
    return data_folders.join_occasions(parts), findings


def _check_origin(recording: Recording, bench: Bench | None) -> list[DataFinding]:
    if bench is None:
        return []
    cables = [*bench.names, *bench.strangers]
    found = [
        error(
            f"{recording.column(channel)} is of cable {cable!r}, and {bench.path} has "
            f"{list_words(cables, 'and')}; give the scene of these data, take the "
            "column out, or say which is which: [columns."
            f"{channel.replace(f'_{cable}_', f'_{bench.names[0]}_')}] name = "
            f"'{recording.labels[channel]}'.",
            recording.name,
            channel,
        )
        for channel in recording.values
        if channels.is_tension(channel)
        and (cable := channels.cable_end(channel)[0]) not in ("", *cables)
    ]
    scene = next((name for name in SCENES if scene_path(name) == bench.path), "")
    if ran := other_scene(recording.path, scene):
        message = f"{recording.path} was recorded with scene {ran!r}, not {scene!r}"
        found.append(error(f"{message}; give that one.", recording.name))
    return found


def _count_as_data(recording: Recording, bench: Bench, file: DatasetFile) -> None:
    """Make the joint's quantities in a log positive where the cable pulls."""
    if bench.lever is None or bench.lever.sign > 0.0:
        return
    for channel in (channels.JOINT_ANGLE, channels.JOINT_TORQUE):
        if channel in recording.values and file.source(channel).sign > 0.0:
            recording.values[channel] = -recording.values[channel]


def _trials_by_file(
    files: list[Path], file: DatasetFile
) -> tuple[dict[Path, str], dict[Path, tuple[TrialFile, ...]]]:
    """Return trial names by their first file, and the files of multi-file trials."""
    alone, several = group_files(files, file)
    names = data_folders.trial_names(alone)
    if twins := set(names.values()) & set(several):
        raise CableError(
            f"{file.path}, [files]: {min(twins)!r} is also the name of a file that is "
            "a trial by itself; call one of them otherwise."
        )
    parts = {own[0].path: own for own in several.values()}
    names |= {own[0].path: name for name, own in several.items()}
    return {path: names[path] for path in files if path in names}, parts


def _trial(recording: Recording, track: SampledTrack, facts: TrialFacts) -> Trial:
    values = track.values
    temperature = values.get(channels.TEMPERATURE)
    if temperature is None and facts.temperature is not None:
        temperature = np.full(len(track.time), facts.temperature)

    def named(is_one: Callable[[str], bool]) -> dict[str, FloatArray]:
        return {name: value for name, value in values.items() if is_one(name)}

    further = named(channels.is_further).items()
    columns = {channels.further_column(name): value for name, value in further}
    if temperature is not None:
        columns[channels.TEMPERATURE] = temperature
    return Trial(
        name=recording.name,
        time=track.time,
        motor_angle=values.get(channels.MOTOR_ANGLE, np.empty(0)),
        motor_torque=values.get(channels.MOTOR_TORQUE),
        joint_angle=values[channels.JOINT_ANGLE],
        joint_torque=values.get(channels.JOINT_TORQUE),
        segments=track.segments,
        step=track.step,
        tensions=named(channels.is_tension),
        others=named(channels.is_other_angle),
        temperature=temperature,
        motor_current=values.get(channels.MOTOR_CURRENT),
        facts=facts,
        path=str(recording.path),
        sha256=recording.sha256,
        labels=recording.labels,
        paths={channel: str(path) for channel, path in recording.paths.items()},
        digits=track.digits,
        columns=columns,
    )
