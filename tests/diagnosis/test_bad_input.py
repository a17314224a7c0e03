"""Invalid input of `cc-mujoco diagnose`: one sentence, no traceback."""

from __future__ import annotations

import errno
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cc_mujoco import cli
from cc_mujoco._utils.atomic_io import checksum_line
from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.datasets._data_findings import DataFinding, errors
from cc_mujoco.datasets._run_log import RUN_MARK
from cc_mujoco.diagnosis import EFFECTS, load, repair_scene, write
from cc_mujoco.diagnosis._checks.readings import check_bench
from cc_mujoco.diagnosis._report.output import OPTIONAL_FILES
from cc_mujoco.diagnosis._rig.simulation import baseline_parameters
from cc_mujoco.diagnosis._scene.realisation import REALISATIONS, is_realisable
from cc_mujoco.diagnosis._scene.repair import existing_effects
from cc_mujoco.diagnosis.effects._effect import RigGeometry
from cc_mujoco.errors import CableError
from diagnosis import recorded
from diagnosis.bench import RATIO, Columns, recording
from diagnosis.bench import write as record

BENCH = recorded.BENCH


def diagnose(data: Path, out: Path, *more: str, scene: str | Path = "bench") -> int:
    """Run the command and return its exit code."""
    return cli.main(["diagnose", str(scene), str(data), "--out", str(out), *more])


def files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def first(folder: Path, columns: Columns) -> DataFinding:
    """Return the first error of a trial."""
    record(folder / "run.csv", columns)
    return errors(load(folder)[1])[0]


def cut(seconds: float) -> Callable[[Columns], Columns]:
    return lambda c: {name: value[: round(500 * seconds)] for name, value in c.items()}


def milli(columns: Columns) -> Columns:
    return {**columns, "time_s": 1e3 * columns["time_s"]}


def misnamed(columns: Columns) -> Columns:
    return {
        "time_ms": columns["time_s"],
        **{n: values for n, values in columns.items() if n != "time_s"},
    }


def millionfold(columns: Columns) -> Columns:
    return {**columns, "time_s": 1e6 * columns["time_s"]}


def seldom(columns: Columns) -> Columns:
    return {name: values[::500][:5] for name, values in columns.items()}


def torn(columns: Columns) -> Columns:
    torque = columns["joint_torque_nm"].copy()
    torque[::15] = np.nan
    return {**columns, "joint_torque_nm": torque}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (cut(0.1), "lasts 0.098 s; a trial needs at least 0.2 s"),
        (cut(0.004), "lasts 0.002 s"),
        (milli, "declare [columns.time_s] unit = 'ms'"),
        (
            misnamed,
            "declare [columns.time_s] unit = 's' if that is what time_ms holds",
        ),
        (torn, "without a gap or a missing reading"),
    ],
)
def test_the_sentence_says_what_is_wrong(
    tmp_path: Path, change: Callable[[Columns], Columns], message: str
) -> None:
    found = first(tmp_path, change(recording(5.0)))
    assert message in found.statement
    assert "run.csv" in found.statement


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("motor_radius = -0.02", "at least 0, not -0.02"),
        ("joint_radius = 0", "more than 0"),
        ("pretension = -5", "at least 0"),
        ("motor_radius = { value = 0.02, uncertainty = 5 }", "no larger"),
    ],
)
def test_rig_constants_that_no_rig_has(tmp_path: Path, text: str, message: str) -> None:
    record(tmp_path / "run.csv", recording(1.0))
    (tmp_path / "dataset.toml").write_text(f"[rig]\n{text}\n", encoding="utf-8")
    with pytest.raises(CableError, match=message):
        load(tmp_path)


def geared(ratio: float) -> Bench:
    """Return a bench whose motor turns `ratio` times as far as its joint."""
    return replace(BENCH, joint_radius=ratio * BENCH.motor_radius)


def test_torques_that_no_cable_carries_are_in_other_units() -> None:
    trials = recorded.dataset().trials
    assert check_bench(trials, BENCH) == []
    large = replace(trials[0], motor_torque=1e3 * trials[0].motor_torque)
    (found,) = errors(check_bench([large], BENCH))
    assert found.channel == "motor_torque_nm"
    assert "trial_0.csv, column motor_torque_nm" in found.statement
    assert "'mNm'" in found.statement


def test_the_trial_closest_to_the_scene_counts(tmp_path: Path) -> None:
    # In one trial the joint is nearly locked: the cable only winds up.
    for name, share in (("free", 1.0), ("locked", 0.02)):
        columns = recording(8.0, seed=len(name))
        columns["joint_angle_rad"] = share * columns["joint_angle_rad"]
        record(tmp_path / f"{name}.csv", columns)
    data, _ = load(tmp_path)
    assert check_bench(data.trials, geared(RATIO)) == []
    (distal,) = check_bench(data.trials, geared(10.0 * RATIO))
    assert distal.severity == "error"
    assert "free.csv" in distal.statement
    (proximal,) = check_bench(data.trials, geared(4.0 * RATIO))
    assert proximal.severity == "warning"


@pytest.mark.parametrize("ratio", [0.5, 0.8, 1.25, 3.0])
def test_a_ratio_that_is_the_inverse_of_the_scene_s_is_a_swap(ratio: float) -> None:
    trials = [
        replace(
            trial,
            joint_angle=trial.joint_angle / ratio,
            joint_torque=trial.joint_torque * ratio,
        )
        for trial in recorded.dataset(chosen=(0, 2)).trials
    ]
    assert check_bench(trials, geared(ratio)) == []
    (wrong,) = check_bench(trials, geared(1.0 / ratio))
    assert wrong.severity == "error" and "swapped with the joint's" in wrong.statement
    turned = replace(
        trials[0],
        name="turned",
        motor_angle=trials[0].joint_angle,
        joint_angle=trials[0].motor_angle,
        motor_torque=trials[0].joint_torque,
        joint_torque=trials[0].motor_torque,
    )
    found = errors(check_bench([turned, *trials], geared(ratio)))
    assert [each.trial for each in found] == ["turned"]


def test_friction_stays_what_a_cable_can_have() -> None:
    records, _ = recorded_records()
    most = {t.name: t.value(t.high) for t in baseline_parameters(BENCH, records, {})}
    cable = BENCH.cables[0].replace(friction=1.3 * most["friction"])
    assert cable.friction > 4.0


def recorded_records() -> Any:
    from cc_mujoco.diagnosis import prepare

    return prepare(recorded.dataset(duration=2.0), BENCH)


def test_bad_data_are_a_verdict_a_report_and_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, out = tmp_path / "data", tmp_path / "out"
    data.mkdir()
    record(data / "run.csv", cut(0.1)(recording(1.0)))
    (data / "empty.csv").touch()
    out.mkdir()
    for name in (*OPTIONAL_FILES, "verdict.json", "mine.txt"):
        (out / name).touch()
    assert diagnose(data, out) == 2
    said = capsys.readouterr().err  # no verdict of ours
    assert "which no such run wrote" in said
    (out / "verdict.json").write_text('{"verdict": "none", "provenance": {}}')
    assert diagnose(data, out) == 2
    said = capsys.readouterr().err
    assert "cc-mujoco: fix-data: The data must be put right first: " in said
    assert "empty.csv is empty" in said
    assert "1 more" in said
    # What an earlier verdict came with is gone; what is not ours stays.
    assert files(out) == ["mine.txt", "report.html", "verdict.json"]
    verdict = json.loads((out / "verdict.json").read_text(encoding="utf-8"))
    assert verdict["verdict"] == "fix-data"
    assert len(verdict["problems"]) == 2
    assert files(tmp_path) == ["data", "out"]


@pytest.mark.parametrize("earlier", [True, False])
def test_what_is_not_ours_is_not_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], earlier: bool
) -> None:
    """Neither a scene at the output path nor files of the same names are replaced."""
    scene = tmp_path / "scene.xml"
    scene.write_text(scene_path("bench").read_text())
    if earlier:
        (tmp_path / "verdict.json").touch()
    record(tmp_path / "run.csv", cut(0.1)(recording(1.0)))
    before = files(tmp_path)
    assert diagnose(tmp_path / "run.csv", tmp_path, scene=scene) == 2
    assert "lies where the diagnosis writes" in capsys.readouterr().err
    assert files(tmp_path) == before
    if not earlier:
        assert diagnose(tmp_path / "run.csv", tmp_path) == 2
        assert "scene.xml, which no such run wrote" in capsys.readouterr().err
        assert files(tmp_path) == before


def test_a_repaired_scene_that_was_changed_is_not_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, out = tmp_path / "run.csv", tmp_path / "out"
    record(data, cut(0.1)(recording(1.0)))
    out.mkdir()
    scene = out / "scene.xml"
    scene.write_text("<mujoco/>")
    known = {"data": {str(data): ""}, "written": checksum_line(scene)}
    kept = json.dumps({"verdict": "none", "provenance": known})
    (out / "verdict.json").write_text(kept)
    scene.write_text("<mujoco><!-- mine --></mujoco>")
    assert diagnose(data, out) == 2
    assert "scene.xml is not as an earlier run wrote it" in capsys.readouterr().err
    assert files(out) == ["scene.xml", "verdict.json"]
    scene.write_text("<mujoco/>")  # as a diagnosis left it
    assert diagnose(data, out) == 2
    assert capsys.readouterr().err.startswith("cc-mujoco: fix-data")


def test_the_diagnosis_of_other_data_is_not_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        record(tmp_path / name / "run.csv", cut(0.1)(recording(1.0)))
    out = tmp_path / "out"
    out.mkdir()
    earlier = {"data": {str(tmp_path / "a" / "run.csv"): ""}}
    kept = json.dumps({"verdict": "none", "provenance": earlier})
    (out / "verdict.json").write_text(kept)
    assert diagnose(tmp_path / "b" / "run.csv", out) == 2
    said = capsys.readouterr().err
    assert f"{out} holds the diagnosis of other data ({tmp_path / 'a'}" in said
    assert (out / "verdict.json").read_text() == kept
    diagnose(tmp_path / "a", out)  # by its folder, it is the same
    assert "other data" not in capsys.readouterr().err


def test_a_scene_with_other_pulleys_is_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    columns = recording(5.0)
    columns["motor_angle_rad"] *= 2.0
    columns["motor_torque_nm"] *= 0.5
    record(tmp_path / "run.csv", columns)
    assert diagnose(tmp_path / "run.csv", tmp_path / "out") == 2
    assert "but 1 in the scene" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty file"),
        ("hello", "does not load: it is no XML: syntax error: line 1"),
        ("<html/>", "html"),
        ("<mujoco/>", "has no cable: give"),
        ("<mujoco", "XML"),
    ],
)
def test_a_scene_that_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    record(tmp_path / "run.csv", recording(1.0))
    scene = tmp_path / "scene.xml"
    scene.write_text(text, encoding="utf-8")
    assert diagnose(tmp_path / "run.csv", tmp_path / "out", scene=scene) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not said.rstrip().endswith(":")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--seed", "-1"), "--seed is -1"),
        (("--dataset", "none.toml"), "cannot read none.toml"),
    ],
)
def test_options_that_cannot_be(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    more: tuple[str, ...],
    message: str,
) -> None:
    record(tmp_path / "run.csv", recording(1.0))
    assert diagnose(tmp_path / "run.csv", tmp_path / "out", *more) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_interrupt_while_writing_leaves_nothing(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("cc_mujoco.diagnosis._verdict.Diagnosis.write", stop)
    (tmp_path / "run.csv").touch()
    assert diagnose(tmp_path / "run.csv", tmp_path / "out") == 130
    assert "nothing was written" in capsys.readouterr().err
    assert files(tmp_path) == ["run.csv"]


@pytest.mark.parametrize(
    ("error", "code", "says"),
    [
        (KeyboardInterrupt(), 130, "unless a verdict was reached"),
        (OSError(errno.ENOSPC, "No space left on device"), 2, "The verdict is in "),
    ],
)
def test_the_verdict_is_kept_whatever_happens_to_the_report(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    code: int,
    says: str,
) -> None:
    def stop(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("cc_mujoco.diagnosis._report.output.write_report", stop)
    (tmp_path / "run.csv").touch()
    for _ in range(2):  # the second one replaces the first
        assert diagnose(tmp_path / "run.csv", tmp_path / "out") == code
        assert says in capsys.readouterr().err
        assert [path.name for path in (tmp_path / "out").iterdir()] == ["verdict.json"]
        page = json.loads((tmp_path / "out" / "verdict.json").read_text())
        assert page["verdict"] == "fix-data"


@pytest.mark.parametrize("name", [n for n in EFFECTS if is_realisable(BENCH, n)])
def test_a_repaired_scene_is_a_bench_again(tmp_path: Path, name: str) -> None:
    effect, path = EFFECTS[name], tmp_path / "scene.xml"
    values = dict(effect.starts[0])
    cables = tuple(cable.replace(friction=0.13) for cable in BENCH.cables)
    if effect.cables is not None:
        cables = effect.cables(cables, values, RigGeometry(0.05, 0.05, math.pi))
    write(path, repair_scene(BENCH, cables, {name: values}))
    again = Bench.of(path)
    assert (again.motor, again.joint) == ("motor", "joint")
    assert again.cables == cables
    assert (again.motor_radius, again.joint_radius) == (0.05, 0.05)
    if name not in REALISATIONS:
        assert existing_effects(path) == ()
        repair_scene(again, cables, {})
    else:
        assert existing_effects(path) == (name,)


def test_a_scene_repaired_outside_its_cables_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene.xml"
    write(scene, repair_scene(BENCH, BENCH.cables, {"backlash": {"backlash": 0.02}}))
    record(tmp_path / "run.csv", recording(1.0))
    assert diagnose(tmp_path / "run.csv", tmp_path / "out", scene=scene) == 2
    assert "has backlash outside its cables" in capsys.readouterr().err
    assert existing_effects(scene_path("bench")) == ()


def test_a_run_that_was_cut_short_is_told_of(tmp_path: Path) -> None:
    for name, code in ("trial_01", 143), ("trial_02", 0):
        record(tmp_path / f"{name}.csv", recording())
        told = {"cc_mujoco": "run", "outcome": "stopped by SIGTERM.", "exit_code": code}
        (tmp_path / f"{name}.json").write_text(json.dumps(told))
    (found,) = [f for f in load(tmp_path)[1] if "cut short" in f.statement]
    assert (found.severity, found.trial) == ("warning", "trial_01")
    assert "trial_01.csv is what there is of a run" in found.statement
    assert "(stopped by SIGTERM)" in found.statement


@pytest.mark.parametrize(
    ("start", "more", "ran", "said"),
    [
        ("elbow.", {}, "", "has columns of other axes alone"),
        ("", {"tension_flexor_distal_n": 80.0}, "", "is of cable 'flexor'"),
        ("", {}, "wrist", "was recorded with scene 'wrist', not 'bench'"),
        ("", {}, "bench", ""),
        ("", {"tension_agonist_distal_n": 80.0}, "", ""),
        ("shoulder.", {}, "", ""),
    ],
)
def test_data_of_another_cable_are_refused(
    tmp_path: Path, start: str, more: dict[str, float], ran: str, said: str
) -> None:
    columns = {f"{start}{n}" if n != "time_s" else n: c for n, c in recording().items()}
    scatter = 1.0 + 0.01 * np.sin(np.arange(len(columns["time_s"])))
    columns |= {name: value * scatter for name, value in more.items()}
    record(tmp_path / "run.csv", columns)
    if ran:
        page = {**RUN_MARK, "rig": f'scene = "{ran}"', "outcome": "", "exit_code": 0}
        (tmp_path / "run.json").write_text(json.dumps(page))
    axes = replace(BENCH, axis="shoulder", angle_columns={"e": "elbow.joint_angle_rad"})
    found = errors(load(tmp_path, bench=axes if start else BENCH)[1])
    assert (said in found[0].statement) if said else not found, found
