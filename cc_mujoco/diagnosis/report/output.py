"""Results folder of a diagnosis: one folder, written whole."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from importlib.metadata import version
from math import cos, sin
from pathlib import Path
from threading import Thread
from typing import Any

import mujoco
import numpy as np

from cc_mujoco import files
from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.data.instruments import TORQUE_SENSORS
from cc_mujoco.diagnosis.data.trials import Dataset
from cc_mujoco.diagnosis.earlier import VERDICT
from cc_mujoco.diagnosis.effects import EFFECTS, JOINT_DELAY
from cc_mujoco.diagnosis.inference.passing import low_passed
from cc_mujoco.diagnosis.inference.plant import CLOCKS
from cc_mujoco.diagnosis.inference.replays import shifted
from cc_mujoco.diagnosis.inference.result import DiagnosisResult
from cc_mujoco.diagnosis.report.drawings import STEMS
from cc_mujoco.diagnosis.report.report import write_report
from cc_mujoco.diagnosis.scene.realisation import REALISATIONS, has, why_not
from cc_mujoco.diagnosis.scene.repair import repaired
from cc_mujoco.diagnosis.scene.repair import write as write_scene
from cc_mujoco.diagnosis.scene.rollout import rollout
from cc_mujoco.diagnosis.verdict import Diagnosis
from cc_mujoco.diagnosis.wording import NO_SCENE, NOT_IN_SCENE
from cc_mujoco.errors import CableError
from cc_mujoco.files import replacing_folder

SCENE = "scene.xml"
SOMETIMES = (SCENE, "evidence.rrd", *(f"{stem}.png" for stem in STEMS))
"""Files that only some verdicts come with."""
_DRAWN_WITH = (
    "matplotlib.backends.backend_agg",
    "cc_mujoco.diagnosis.report.recording",
    "scipy.cluster.hierarchy",
)


def require_ours(out: Path, scene: Path, data: Sequence[Path]) -> None:
    """See to it that nothing is replaced but an earlier diagnosis of these data.

    Args:
        out: folder to write to.
        scene: file of the scene.
        data: files of trials, or folders of them.

    Raises:
        CableError: the folder holds the scene, the diagnosis of trials none of which
            is among the data, or a repaired scene that was changed since; see also
            `files.require_ours`.
    """
    names = (VERDICT, "report.html", *SOMETIMES)
    if scene.resolve() in {(out / name).resolve() for name in names}:
        raise CableError(
            f"the scene {scene} lies where the diagnosis writes its own; name another "
            "folder to write to."
        )
    files.require_ours(out, names, lambda folder: _provenance(folder) is not None)
    earlier = _provenance(out) or {}
    files.require_untouched(out, [SCENE], str(earlier.get("written", "")))
    base = os.path.join(os.path.realpath(out), str(earlier.get("folder", "")))
    before = [Path(base, path).resolve() for path in earlier.get("data", ())]
    now = {path.resolve() for path in data}
    if before and not any(now & {path, *path.parents} for path in before):
        raise CableError(
            f"{out} holds the diagnosis of other data ({before[0]}); name another "
            "folder to write to, or remove that one."
        )


def _provenance(folder: Path) -> Mapping[str, Any] | None:
    """Return the provenance of the diagnosis in a folder; None without one."""
    try:
        found = json.loads((folder / VERDICT).read_text(encoding="utf-8"))
        return dict(found["provenance"]) if "verdict" in found else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def prepare() -> None:
    """Load what `write` draws with, in a thread of its own beside what computes."""

    def load() -> None:
        for name in _DRAWN_WITH:
            with suppress(Exception):  # told where it is used
                import_module(name)

    Thread(target=load).start()


def write(
    result: DiagnosisResult, dataset: Dataset, out: Path, command: str, seed: int
) -> Diagnosis:
    """Write everything to a folder and return the diagnosis with its provenance."""
    from cc_mujoco.diagnosis.report.recording import write_recording

    diagnosis = replace(
        result.diagnosis, provenance=provenance(result, dataset, out, command, seed)
    )
    titles = {name: effect.title for name, effect in EFFECTS.items()}
    with replacing_folder(out) as place:
        if result.problem is not None:
            try:
                said = scene(result, place / SCENE)
                as_written = files.as_written(place / SCENE)
                known = {**diagnosis.provenance, "written": as_written}
                diagnosis = replace(diagnosis, provenance=known)
            except CableError as error:  # the verdict stands without it
                said = [f"{NO_SCENE}: {error}."]
            diagnosis = replace(diagnosis, problems=(*diagnosis.problems, *said))
            write_recording(place / "evidence.rrd", result.evidence, titles)
        write_report(place, diagnosis, result.evidence, titles)
        diagnosis.write(place / VERDICT)
        written = {file.name for file in place.iterdir()}
    for name in SOMETIMES:
        if name not in written:  # of an earlier diagnosis with another verdict
            (out / name).unlink(missing_ok=True)
    return diagnosis


def provenance(
    result: DiagnosisResult, dataset: Dataset, out: Path, command: str, seed: int
) -> Mapping[str, Any]:
    """Return the provenance; relative paths are from `folder`, seen from `out`."""
    return {
        "command": command,
        "seed": seed,
        "scene": {"path": str(result.bench.path), "sha256": result.bench.sha256},
        "data": {trial.path: trial.sha256 for trial in dataset.trials},
        "folder": os.path.relpath(os.getcwd(), os.path.realpath(out)),
        "several_files": [
            trial.path
            for trial in dataset.trials
            if set(trial.paths.values()) - {trial.path}
        ],
        "dataset": {"path": dataset.path, "sha256": dataset.sha256},
        "versions": {
            "cc_mujoco": version("cc_mujoco"),
            "mujoco": mujoco.__version__,
            "numpy": np.__version__,
            "python": platform.python_version(),
        },
    }


def scene(result: DiagnosisResult, path: Path) -> list[str]:
    """Write the scene with the effects; compare its rollout with the replay."""
    problem = result.problem
    assert problem is not None
    values = problem.values(result.x)
    cables = problem.plant.cables(values, problem.effects)
    proximal, distal = problem.plant.radii(values)
    bench = replace(result.bench, motor_radius=proximal, joint_radius=distal)
    found = {
        name: {
            parameter.name: values.get(parameter.name, 0.0)
            for parameter in EFFECTS[name].parameters
        }
        for name in problem.effects
    }
    effects = {name: found[name] for name in _writable(result)}
    left_out = {name: own for name, own in found.items() if name not in effects}
    said = [
        f"{NOT_IN_SCENE} {EFFECTS[name].title}, which was found: "
        f"{why_not(result.bench, name)}. Take its values from verdict.json."
        for name in left_out
    ]
    if bench.lever is None:
        _at_scene_angle(effects, values.get("joint_angle_offset", 0.0))
    write_scene(path, repaired(bench, cables, effects, left_out))
    try:
        apart, size = compared(result, path)
    except CableError as error:
        return [*said, f"scene.xml is written, but cannot be compared: {error}."]
    return [
        *said,
        f"scene.xml, played by MuJoCo along the first seconds of {apart[0]}, differs "
        f"from the replay by {apart[1]:.2g} N m RMS, with torques of {size:.2g} N m "
        "RMS.",
    ]


def _at_scene_angle(effects: dict[str, dict[str, float]], offset: float) -> None:
    """Have what was found by the measured angle act by that of the scene.

    The scene's is the measured one and the offset.
    """
    if "joint_gravity" in effects:
        weight = effects["joint_gravity"]
        sine, cosine = weight["gravity_sine"], weight["gravity_cosine"]
        weight["gravity_sine"] = sine * cos(offset) + cosine * sin(offset)
        weight["gravity_cosine"] = cosine * cos(offset) - sine * sin(offset)
    if "joint_stiffness" in effects:
        spring = effects["joint_stiffness"]
        spring["joint_stiffness_moment"] -= spring["joint_stiffness"] * offset


def _writable(result: DiagnosisResult) -> list[str]:
    """Effects that the scene can have."""
    assert result.problem is not None
    return [name for name in result.problem.effects if has(result.bench, name)]


def compared(result: DiagnosisResult, path: Path) -> tuple[tuple[str, float], float]:
    """RMS difference of scene and replay on the first seconds of a record [Nm]."""
    problem = result.problem
    assert problem is not None
    record = problem.plant.records[0]
    values = problem.values(result.x)
    short = min(record.time.size, round(4.0 / record.dt))
    offset = values.get("joint_angle_offset", 0.0)
    proximal, distal = problem.plant.radii(values)
    ahead = values.get(JOINT_DELAY, 0.0) / record.dt
    joint = shifted(record.joint_angle, ahead)[:short] + offset
    time = record.start + record.dt * np.arange(short)
    shown = np.array(
        rollout(
            path,
            time,
            record.motor_angle[:short],
            joint,
            lead_in=distal / proximal,
            tilt=record.tilt,
        )
    )
    quiet = {
        **values,
        "motor_torque_offset": 0.0,
        "joint_torque_offset": 0.0,
        **dict.fromkeys(CLOCKS, 0.0),
    }
    # The sensors of a scene show both torques, whatever those of the rig do.
    whole = replace(problem.plant, instruments=TORQUE_SENSORS)
    shows = _writable(result)
    if result.bench.lever is not None:  # MuJoCo shows of it what the cable does
        shows = [name for name in shows if name not in REALISATIONS]
    played: FloatArray = whole.simulate(quiet, shows, only=(0,))[0]
    edge = round(1.0 / record.band / record.dt)
    passed = low_passed(shown, record.band, 1.0 / record.dt)
    error = (passed - played[:, :short])[:, edge:-edge]
    return (record.trial, float(np.sqrt(np.mean(error**2)))), float(
        np.sqrt(np.mean(played[:, :short] ** 2))
    )
