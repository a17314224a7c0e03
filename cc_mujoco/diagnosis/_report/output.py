"""Results folder of a diagnosis: written whole, and read to be continued.

The page is self-contained; the figures are also PNG files next to it.
"""

from __future__ import annotations

import hashlib
import os
import platform
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from math import cos, sin
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from cc_mujoco._utils import atomic_io
from cc_mujoco._utils.atomic_io import replacing_folder
from cc_mujoco._utils.parsing import parse_json
from cc_mujoco._utils.user_code import named_in_file
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._columns import DATASET_FILE
from cc_mujoco.datasets._dataset_file import read_dataset_file
from cc_mujoco.datasets._folders import MOTION_FILE, data_files, find_dataset_file
from cc_mujoco.datasets._trials import TORQUE_SENSORS, Dataset
from cc_mujoco.device import load_device
from cc_mujoco.device._description import ENDING
from cc_mujoco.device._device_files import locate
from cc_mujoco.device._report import write_description
from cc_mujoco.diagnosis import _phrases as words
from cc_mujoco.diagnosis._fit.problem import Problem
from cc_mujoco.diagnosis._learn.residual import classes_of, file_text
from cc_mujoco.diagnosis._propose.experiment import CataloguedTrial, write_motion
from cc_mujoco.diagnosis._report import drawings, sections
from cc_mujoco.diagnosis._report.drawer import NO_DRAWER, RECORDING_FILE, Drawer
from cc_mujoco.diagnosis._rig import simulation
from cc_mujoco.diagnosis._rig.records import low_pass, shift_signal
from cc_mujoco.diagnosis._scene import realisation
from cc_mujoco.diagnosis._scene.repair import repair_scene, rollout
from cc_mujoco.diagnosis._scene.repair import write as write_scene
from cc_mujoco.diagnosis._search.search import Found
from cc_mujoco.diagnosis._verdict import Diagnosis, Evidence, NextExperiment
from cc_mujoco.diagnosis.effects import EFFECTS, effects_in_use
from cc_mujoco.diagnosis.effects._drive_effects import JOINT_DELAY
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.native import FloatArray
from cc_mujoco.report import _html as html
from cc_mujoco.report._html import Html
from cc_mujoco.report._html import sections as page_sections

VERDICT_FILE = "verdict.json"


class Earlier(NamedTuple):
    """Inputs and results of an earlier diagnosis, read from its folder."""

    data: tuple[Path, ...]  # its trials
    scene: Path  # MJCF file of the rig
    dataset: Path | None  # file with the meaning of the columns, or None
    axis: str | None = None  # recorded axis; None for a device with one
    effects: tuple[str, ...] = ()  # requested effects, as they were named
    proposed: Path | None = None  # dataset.toml with the proposed trials

    @classmethod
    def of(cls, folder: str | os.PathLike[str]) -> Earlier:
        """Read the inputs of a diagnosis from its folder; none may have changed."""
        place = Path(folder) / VERDICT_FILE
        try:
            verdict = parse_json(place.read_text(encoding="utf-8"))
            known = verdict["provenance"]
            data = {str(path): str(digest) for path, digest in known["data"].items()}
            scene, dataset = known["scene"], known["dataset"]
            several, occasions = known["several_files"], known.get("occasions", ())
            base = os.path.join(os.path.realpath(folder), known["folder"])
            planned = verdict.get("next_experiment") or {}
            first = next(iter(planned.get("trials", ())), "")  # proposed
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as wrong:
            raise CableError(
                f"{folder} holds no diagnosis that can be continued ({place}: {wrong})."
            ) from None
        if several:
            raise CableError(
                f"{folder} is of trials in several files each ({several[0]}); diagnose "
                "the folder of all data anew."
            )
        if occasions:
            raise CableError(
                f"{folder} is of several occasions ({', '.join(occasions)}); diagnose "
                "their folders anew, with the new trials (and, of a proposed one, "
                "its dataset.toml) in the folder of their occasion."
            )
        here = {}
        trials = [{"path": path, "sha256": digest} for path, digest in data.items()]
        for file in (*trials, scene, dataset):
            if not (path := file["path"]):
                continue
            here[path] = now = _relative_path(base, path)
            try:
                digest = hashlib.sha256(now.read_bytes()).hexdigest()
            except OSError:
                raise CableError(f"{now}, which {place} names, is not there.") from None
            if digest != file["sha256"]:
                raise CableError(
                    f"{now} has changed since {place} was written; diagnose all data "
                    "anew."
                )
        proposed = Path(folder, f"next_{first}", DATASET_FILE)
        effects = known.get("effects", ())
        code = [named_in_file(str(each), place, "effects") for each in effects]
        known_data = tuple(here[path] for path in data)
        files = known_data, here[scene["path"]], here.get(dataset["path"])
        more = proposed if proposed.is_file() else None
        return cls(*files, scene.get("axis"), tuple(code), more)

    def with_more(self, data: Sequence[str | os.PathLike[str]]) -> Path | None:
        """Return the `dataset.toml` of the earlier and the new trials; None without.

        For the proposed trials it is the one written with them. One next to other new
        trials would be ignored and is refused.
        """
        files = data_files(data)
        own = find_dataset_file(files)
        if self.proposed is not None:
            motions = self.proposed.parent.glob(MOTION_FILE.format("*"))
            trials = sorted(path.stem.replace("motion", "trial") for path in motions)
            both = self.proposed, own or self.proposed
            facts = [
                (file.columns, file.rig, [*map(file.facts.get, trials)])
                for file in map(read_dataset_file, both)
            ]
            if facts[0] == facts[1] and sorted(file.stem for file in files) == trials:
                return self.proposed
        if own is None or (self.dataset is not None and own.samefile(self.dataset)):
            return self.dataset
        first = f"{self.dataset} of the" if self.dataset else "none of the"
        raise CableError(
            f"there are {own} and {first} earlier trials; write one file that speaks "
            "of all trials and give it with --dataset."
        )


def _relative_path(base: str, path: str) -> Path:
    whole = os.path.normpath(os.path.join(base, path))
    inside = os.path.relpath(whole)
    outside = os.path.isabs(path) or inside.startswith(os.pardir)
    return Path(whole if outside else inside)


@dataclass(frozen=True)
class DiagnosisResult:
    """Diagnosis, with the model, evidence and fits that it is based on."""

    diagnosis: Diagnosis  # verdict, in numbers and sentences
    bench: Bench  # rig as the scene has it
    evidence: Evidence = field(default_factory=Evidence)  # that the report draws
    problem: Problem | None = None  # final model, or None where there is none
    x: FloatArray = field(default_factory=lambda: np.zeros(0))  # where it is fitted
    found: Found | None = None  # what the search found, or None where nothing was
    motions: tuple[CataloguedTrial, ...] = ()  # of the proposed trials


REPORT_PAGE = "report.html"


def write_report(
    folder: str | os.PathLike[str],
    diagnosis: Diagnosis,
    evidence: Evidence,
    drawer: Drawer = NO_DRAWER,
) -> None:
    """Write `report.html` and its figures, all or none, and delete older figures.

    What a `drawer` has drawn is moved to the folder.
    """
    with replacing_folder(folder) as partial:
        drawer.finish(partial)
        names = drawings.save_figures(partial, diagnosis, evidence)
        text = _page(diagnosis, evidence, partial)
        (partial / REPORT_PAGE).write_text(text, encoding="utf-8")
    for name in {*_FIGURES} - {*names}:
        (Path(folder) / name).unlink(missing_ok=True)


def _page(diagnosis: Diagnosis, evidence: Evidence, figures: Path) -> str:
    def drawn(stem: str, words: str) -> Html:
        path = figures / f"{stem}.png"
        return html.embed_picture(path, words) if path.exists() else Html()

    def fold(title: str, content: Html | None) -> Html:
        return html.folded(title, content) if content else Html()

    seconds = None
    if shown := drawings.excerpts(evidence):
        most, usual = shown
        worst = drawn("traces", sections.excerpt_caption(most, True))
        ordinary = drawn("traces_ordinary", sections.excerpt_caption(usual, False))
        seconds = html.join_pieces([worst, fold("Ordinary seconds", ordinary)])
    maps = drawn(
        "maps", "Mean error, measured minus simulated, over what it lies along."
    )
    learned = sections.learned(diagnosis)
    curves = drawn("learned", "Learned curves: what is added to the torque.")
    figure = drawn(
        "isolability",
        "Left: similarity of the changes that two effects make to the signals, once "
        "the baseline is retuned (1: the same, 0: nothing in common). Right: size of a "
        "plausible effect over the noise, grey where it is smaller.",
    )
    whole = fold("All effects", html.scrolled(figure) if figure else None)
    likeness = html.illustrated(sections.effect_similarity(evidence), whole)
    known = diagnosis.provenance
    listed = sections.nested_table(known) if known else None
    inputs = fold("Inputs, versions and settings", listed)
    parts = {  # in their usual order
        "unknown": ("What is known of it", sections.unknown(diagnosis)),
        "traces": ("Measured and simulated", seconds),
        "gap": ("How large the gap is", sections.gap(diagnosis)),
        "occasions": ("What changed between occasions", sections.occasions(diagnosis)),
        "trials": ("How far off every trial is", sections.trials(diagnosis)),
        "where": ("Where the error lies", sections.error_location(diagnosis)),
        "maps": ("Maps of the error", html.illustrated(sections.maps(evidence), maps)),
        "learned": ("What curves take", html.illustrated(learned, curves)),
        "candidates": ("What was tried", sections.candidates(diagnosis)),
        "likeness": ("What these data can distinguish", likeness),
        "untested": ("What these data hide", sections.untested_effects(diagnosis)),
        "next": ("What to run next", sections.experiment(diagnosis)),
        "parameters": ("Fitted parameters", sections.parameters(diagnosis)),
        "problems": ("Data and numerics", sections.problems(diagnosis)),
        "provenance": ("Provenance", inputs or None),
    }
    if diagnosis.verdict != "unknown":
        del parts["unknown"]
    # The section that comes first, by verdict
    named = {"fix-data": "problems", "fix-numerics": "problems", "tie": "next"}
    first = named.get(diagnosis.verdict, "trials" if diagnosis.question else "")
    order = sorted(parts, key=lambda key: key != first)
    there = {key: part for key in order if (part := parts[key][1]) is not None}
    absent = [f"“{title}”" for title, part in parts.values() if part is None]
    omitted = f"Left out, as there was nothing to show: {html.list_words(absent)}."
    gap = drawn("gap", "Weighted RMS error on held-out data, beside the noise floor.")
    titles = {key: title for key, (title, _) in parts.items()}
    head, body = sections.header(diagnosis, gap), page_sections(titles, there)
    foot = html.paragraph(omitted, kind="small") if absent else Html()
    return html.page(words.headline(diagnosis), diagnosis.verdict, head, body, foot)


SCENE_FILE, LEARNED_FILE = "scene.xml", "learned.py"
_FIGURES = [f"{stem}.png" for stem in drawings.FIGURE_STEMS]
OPTIONAL_FILES = (SCENE_FILE, LEARNED_FILE, RECORDING_FILE, *_FIGURES)
"""Files that only some verdicts have."""


def require_ours(out: Path, scene: Path, data: Sequence[Path]) -> None:
    """Require that at most an earlier diagnosis of these data is replaced.

    The folder must not hold the scene, the diagnosis of other trials, or a repaired
    scene that was changed since; see also `_utils.atomic_io.require_ours`.
    """
    names = (VERDICT_FILE, REPORT_PAGE, *OPTIONAL_FILES)
    if scene.resolve() in {(out / name).resolve() for name in names}:
        raise CableError(
            f"the scene {scene} lies where the diagnosis writes its own; name another "
            "folder to write to."
        )
    atomic_io.require_ours(out, lambda folder: _provenance(folder) is not None)
    earlier = _provenance(out) or {}
    atomic_io.require_unmodified(out, [SCENE_FILE], str(earlier.get("written", "")))
    base = os.path.join(os.path.realpath(out), str(earlier.get("folder", "")))
    before = [Path(base, path).resolve() for path in earlier.get("data", ())]
    now = {path.resolve() for path in data}
    if before and not any(now & {path, *path.parents} for path in before):
        raise CableError(
            f"{out} holds the diagnosis of other data ({before[0]}); name another "
            "folder to write to, or remove that one."
        )


def _provenance(folder: Path) -> Mapping[str, Any] | None:
    try:
        found = parse_json((folder / VERDICT_FILE).read_text(encoding="utf-8"))
        return dict(found["provenance"]) if "verdict" in found else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def write(
    result: DiagnosisResult,
    dataset: Dataset,
    out: Path,
    command: str,
    seed: int,
    effects: Sequence[str] = (),
    drawer: Drawer = NO_DRAWER,
) -> Diagnosis:
    """Write all results to a folder and return the diagnosis with its provenance.

    The verdict, which took a search, is written first, and stays if the rest fails.
    """
    bench, trials, found = result.bench, dataset.trials, result.diagnosis
    known: dict[str, Any] = {
        "command": command,
        "seed": seed,
        "scene": {
            "path": str(bench.path),
            "sha256": bench.sha256,
            **({"axis": bench.axis} if bench.axis else {}),
        },
        "data": {trial.path: trial.sha256 for trial in trials},
        # From which relative paths are, as seen from the results
        "folder": os.path.relpath(os.getcwd(), os.path.realpath(out)),
        "effects": list(effects),
        "occasions": list(found.occasions.names) if found.occasions else [],
        "several_files": [t.path for t in trials if {*t.paths.values()} - {t.path}],
        "dataset": {"path": dataset.path, "sha256": dataset.sha256},
        "versions": {
            "cc_mujoco": version("cc_mujoco"),
            "mujoco": mujoco.__version__,
            "numpy": np.__version__,
            "python": platform.python_version(),
        },
    }
    diagnosis = replace(found, provenance=known)
    before = {"written": (_provenance(out) or {}).get("written", "")}
    with replacing_folder(out) as place:
        replace(diagnosis, provenance=known | before).write(place / VERDICT_FILE)
    try:
        with replacing_folder(out) as place:
            if result.problem is not None:
                try:
                    with effects_in_use(classes_of(diagnosis.learned)):
                        problems = write_and_compare_scene(result, place / SCENE_FILE)
                    written = {"written": atomic_io.checksum_line(place / SCENE_FILE)}
                    diagnosis = replace(diagnosis, provenance=known | written)
                except CableError as error:  # the verdict stands without it
                    problems = [f"{words.NO_SCENE_PREFIX}: {error}."]
                noticed = (*diagnosis.problems, *problems)
                diagnosis = replace(diagnosis, problems=noticed)
            if (curves := diagnosis.learned) and curves.curves:
                (place / LEARNED_FILE).write_text(file_text(curves), encoding="utf-8")
            write_report(place, diagnosis, result.evidence, drawer)
            recording = place / RECORDING_FILE
            if result.problem is not None and not recording.exists():
                from cc_mujoco.diagnosis._report.recording import write_recording

                write_recording(recording, result.evidence)
            diagnosis.write(place / VERDICT_FILE)
            there = {file.name for file in place.iterdir()}
    except CableError as error:
        raise CableError(f"{error} The verdict is in {out / VERDICT_FILE}.") from error
    if SCENE_FILE in there:
        carry_description(bench.path, out / SCENE_FILE)
    for name in set(OPTIONAL_FILES) - there:  # of a diagnosis with another verdict
        (out / name).unlink(missing_ok=True)
    return diagnosis


def add_proposal(result: DiagnosisResult, dataset: Dataset, out: Path) -> None:
    """Add the proposal to the folder, page and verdict of a diagnosis."""
    diagnosis = result.diagnosis
    if (planned := diagnosis.next_experiment) is not None:
        write_proposed(out / planned.folder, planned, result.motions, dataset.path)
    with replacing_folder(out) as place:
        text = _page(diagnosis, result.evidence, out)
        (place / REPORT_PAGE).write_text(text, encoding="utf-8")
        diagnosis.write(place / VERDICT_FILE)


def write_proposed(
    folder: Path,
    planned: NextExperiment,
    motions: Sequence[CataloguedTrial],
    dataset_toml: str,
) -> None:
    """Write the proposed motions, and `dataset.toml` with their facts last."""
    known = Path(dataset_toml).read_text(encoding="utf-8") if dataset_toml else ""
    facts = [*([known.rstrip(), ""] if known.strip() else []), *planned.facts, ""]
    names = [MOTION_FILE.format(t.removeprefix("trial_")) for t in planned.trials]
    with replacing_folder(folder) as place:
        for name, motion in zip(names, motions, strict=True):
            write_motion(place / name, motion)
        (place / DATASET_FILE).write_text("\n".join(facts), encoding="utf-8")
    for file in folder.glob(MOTION_FILE.format("*")):
        if file.name not in names:  # of an earlier, longer proposal
            file.unlink()


def write_and_compare_scene(result: DiagnosisResult, path: Path) -> list[str]:
    """Write the repaired scene; return sentences on it and on what it lacks.

    Learned curves have to be in use.
    """
    problem = result.problem
    assert problem is not None
    values = problem.values(result.x)
    cables = problem.plant.cables(values, problem.effects)
    proximal, distal = problem.plant.radii(values)
    bench = replace(result.bench, motor_radius=proximal, joint_radius=distal)
    effects: dict[str, dict[str, float]] = {}
    left_out: dict[str, dict[str, float]] = {}
    statements = []
    for name in problem.effects:
        own = {p.name: values.get(p.name, 0.0) for p in EFFECTS[name].parameters}
        if reason := realisation.unrealisable_reason(result.bench, name):
            left_out[name] = own
            statements.append(
                f"{words.NOT_IN_SCENE_PREFIX} {words.effect_name(name)}, which was "
                f"found: {reason}. Take its values from verdict.json."
            )
        else:
            effects[name] = own
    if bench.arm:
        statements.append(
            f"{words.NOT_IN_SCENE_PREFIX} the moment arm of [rig] angle_pairs; its "
            "joint has a round pulley of the radius at 0."
        )
    if bench.lever is None:
        _use_scene_angle(effects, values.get("joint_angle_offset", 0.0))
    write_scene(path, repair_scene(bench, cables, effects, left_out))
    try:
        trial, difference, size = rollout_difference(result, path)
    except CableError as error:
        return [*statements, f"scene.xml is written, but cannot be compared: {error}."]
    sizes = f"{difference:.2g} N m RMS, with torques of {size:.2g} N m RMS."
    played = f"scene.xml, played by MuJoCo along the first seconds of {trial}, "
    return [*statements, f"{played}differs from the replay by {sizes}"]


def carry_description(scene: Path, repaired: Path) -> None:
    """Write the scene's description beside the repaired scene, if none is there.

    Without it the repaired scene would have other limits, such as its safe torque.
    """
    beside = repaired.with_suffix(ENDING)
    if locate(scene)[2] is None or beside.exists():
        return
    try:
        write_description(load_device(scene).variant(repaired), beside)
    except CableError as error:
        warnings.warn(f"{beside} is not written: {error}", CableWarning, stacklevel=2)


def _use_scene_angle(effects: dict[str, dict[str, float]], offset: float) -> None:
    """Convert effects of the measured joint angle to the scene's angle, in place."""
    if "joint_gravity" in effects:
        weight = effects["joint_gravity"]
        sine, cosine = weight["gravity_sine"], weight["gravity_cosine"]
        weight["gravity_sine"] = sine * cos(offset) + cosine * sin(offset)
        weight["gravity_cosine"] = cosine * cos(offset) - sine * sin(offset)
    for name, values in effects.items():
        if EFFECTS[name].edit_spec is not None:
            values["joint_angle_offset"] = offset
    if "joint_stiffness" in effects:
        spring = effects["joint_stiffness"]
        spring["joint_stiffness_moment"] -= spring["joint_stiffness"] * offset


def rollout_difference(result: DiagnosisResult, path: Path) -> tuple[str, float, float]:
    """Return a trial, its RMS difference of scene and replay, and RMS torque [N m]."""
    problem = result.problem
    assert problem is not None
    records, lever = problem.plant.records, result.bench.lever
    last = problem.plant.occasions[-1]  # of which the scene is
    first = next(k for k, each in enumerate(records) if each.occasion == last)
    record = records[first]
    values = problem.values(result.x)
    short = min(record.time.size, round(4.0 / record.dt))
    proximal, distal = problem.plant.radii(values)
    ahead = values.get(JOINT_DELAY, 0.0) / record.dt
    offset = values.get("joint_angle_offset", 0.0)
    others = {}
    if record.path is not None:
        angles = record.path.angles[:, :short]
        others = dict(zip(record.path.others, angles, strict=True))
    clock = record.start + record.dt * np.arange(short)
    joint = shift_signal(record.joint_angle, ahead)[:short] + offset
    motion = clock, record.motor_angle[:short], joint
    own: Any = {"cables": result.bench.names, "driven": result.bench.joint}
    own |= {"lead_in": distal / proximal, "tilt": record.tilt, "others": others}
    shown = rollout(path, *motion, **own)
    zero = (*simulation.TORQUE_OFFSETS, *simulation.CLOCK_PARAMETERS)
    quiet = values | dict.fromkeys(zero, 0.0)
    # The sensors of a scene show both torques, even if those of the rig do not.
    whole = replace(problem.plant, instruments=TORQUE_SENSORS)
    whole = whole.limited([replace(each, load_cell=None) for each in records])
    whole = replace(whole, bench=replace(whole.bench, arm=()))
    shows = [n for n in problem.effects if realisation.is_realisable(result.bench, n)]
    if lever is not None:  # MuJoCo shows of it what the cable does
        shows = [name for name in shows if name not in realisation.realisations()]
    played: FloatArray = whole.simulate(quiet, shows, only=(first,))[0][:, :short]
    edge = round(1.0 / record.band / record.dt)
    passed = low_pass(np.array(shown), record.band, 1.0 / record.dt)
    error = (passed - played)[:, edge:-edge]
    off, size = (float(np.sqrt(np.mean(each**2))) for each in (error, played))
    return record.trial, off, size
