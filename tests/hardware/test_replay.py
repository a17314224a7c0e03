"""The log of a run shown as an episode: measured, and what a model makes of it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest

from cc_mujoco import cli
from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.datasets._run_log import RUN_MARK, page_of
from cc_mujoco.errors import CableError
from cc_mujoco.hardware import Readings, RunLog, RunOutcome
from cc_mujoco.hardware._replay import as_episode, read_rows
from cc_mujoco.hardware._run_log import RUN_COLUMNS
from cc_mujoco.hardware._run_report import ReportedRun, write_run_report
from hardware.fakes import LIMITS, add_row

BENCH = Bench.of(scene_path("bench"))


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Return a noise-free log of the bench: its motor swings, its joint is held."""
    period = 0.002
    time = period * np.arange(400)
    motor = 0.05 * np.sin(8.0 * time)
    played = BENCH.transmission.replay(
        period, motor_angle=motor, joint_angle=np.zeros(time.size)
    )
    log = RunLog(tmp_path / "run", {}, 50)
    for k, now in enumerate(time.tolist()):
        joint = float(played.joint_torque[k])
        seen = Readings(5.0 + now, float(motor[k]), 0.0, 0.0, 0.0, joint)
        desired = np.nan if k > 390 else 0.5
        add_row(log, seen, float(played.motor_torque[k]), desired)
    log.close({})
    return tmp_path / "run" / "log.csv"


@pytest.mark.parametrize("torque", [0.0, -8.0])
def test_a_slack_cable_is_no_wrong_scene_and_a_taut_one_that_drifts_is(
    torque: float,
) -> None:
    """The motor of an axis that one cable pulls may pay out more than the joint."""
    rows = {name: np.zeros(50) for name in RUN_COLUMNS}
    rows["time_s"] = 1e-3 * np.arange(50)
    rows["motor_angle_rad"] = np.linspace(0.0, -6.0, 50)
    rows["joint_torque_nm"] = np.full(50, torque)
    if torque:
        with pytest.raises(CableError, match=r"drift 1\.2 rad apart"):
            as_episode(rows, "ankle", Path("log.csv"))
    else:
        as_episode(rows, "ankle", Path("log.csv"))


def test_a_log_becomes_a_recording_and_a_figure_beside_it(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = log.read_bytes()
    for _ in range(2):  # its own files are replaced
        assert cli.main(["play", "bench", "--replay", str(log)]) == 0
    assert f"rerun {log.with_name('recording.rrd')}" in capsys.readouterr().out
    assert log.with_name("summary.png").read_bytes()[:4] == b"\x89PNG"
    assert log.with_name("recording.rrd").read_bytes()[:4] == b"RRF2"
    assert log.read_bytes() == before


def test_tensions_are_those_that_explain_what_was_measured(log: Path) -> None:
    """Those of the model, and the sum of their pulls is the motor's torque."""
    rows = read_rows(log)
    _, episode = as_episode(rows, "bench", log)
    pull = BENCH.motor_radius * (
        episode["tension_agonist_proximal_n"] - episode["tension_antagonist_proximal_n"]
    )
    measured = rows["motor_torque_nm"]
    assert pull[1:] == pytest.approx(measured[1:], abs=0.02 * np.ptp(measured))
    assert np.array_equal(episode["joint_torque_nm"], rows["joint_torque_nm"])
    assert set(np.unique(episode["slip_agonist_direction"])) >= {-1, 1}
    assert np.isnan(episode["wearer_torque_nm"]).all()  # nobody measured it


@pytest.mark.parametrize("cut", [1, 30])
def test_a_line_that_was_not_written_whole_is_left_out(log: Path, cut: int) -> None:
    whole = read_rows(log)
    log.write_bytes(log.read_bytes()[:-cut])
    for name, values in read_rows(log).items():
        np.testing.assert_array_equal(values, whole[name][:-1])


def test_parquet_says_the_same(log: Path, tmp_path: Path) -> None:
    table = pyarrow.csv.read_csv(log)
    pyarrow.parquet.write_table(table, tmp_path / "log.parquet")
    one, other = read_rows(log), read_rows(tmp_path / "log.parquet")
    assert all(np.array_equal(one[k], other[k], equal_nan=True) for k in one)


def spoilt(log: Path, old: str, new: str) -> None:
    log.write_text(log.read_text().replace(old, new, 1))


@pytest.mark.parametrize(
    ("scene", "old", "new", "said"),
    [
        ("bench", "joint_torque_nm", "torque", "has no column joint_torque_nm"),
        ("bench", "\n0.0,0.0,", "\n0.0,nan,", "line 2, column motor_angle_rad"),
        ("bench", "\n0.0,0.0,", "\n0.0,x,", "column motor_angle_rad"),
        ("bench", "\n0.0,", "\n7.0,", "line 3, column time_s: time must rise"),
        ("bench", "\n0.0,0.0,", "\n0.0,3.0,", "does not fit scene bench"),
        ("exosuit", "", "", "device 'exosuit' has the axes hip, ankle; name one."),
        ("bnch", "", "", "did you mean 'bench'"),
    ],
)
def test_what_cannot_be_shown_is_said_in_one_sentence(
    log: Path,
    capsys: pytest.CaptureFixture[str],
    scene: str,
    old: str,
    new: str,
    said: str,
) -> None:
    spoilt(log, old, new)
    assert cli.main(["play", scene, "--replay", str(log)]) == 2
    error = capsys.readouterr().err
    assert said in error and len(error.splitlines()) == 1
    assert not log.with_name("recording.rrd").exists()


def test_a_log_of_another_scene_is_refused(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = {**RUN_MARK, "rig": 'scene = "bench"', "outcome": "", "exit_code": 0}
    page_of(log).write_text(json.dumps(page))
    assert cli.main(["play", "wrist", "--replay", str(log)]) == 2
    assert "was recorded with scene 'bench', not 'wrist'" in capsys.readouterr().err
    assert cli.main(["play", "bench", "--replay", str(log)]) == 0


def test_other_options_and_other_logs_are_refused(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["play", "bench", "--replay", str(log)]
    assert cli.main([*words, "--seed", "3"]) == 2
    assert "--seed does not go with --replay" in capsys.readouterr().err
    theirs = log.with_name("summary.png")
    theirs.write_text("mine")
    (log.parent / "run.json").unlink()
    assert cli.main(words) == 2
    assert theirs.read_text() == "mine"
    with pytest.raises(CableError, match="cannot read"):
        read_rows(tmp_path / "none.csv")
    empty = pa.table({"time_s": pa.array([], pa.float64())})
    pyarrow.csv.write_csv(empty, tmp_path / "empty.csv")
    with pytest.raises(CableError, match="has no column motor_angle_rad"):
        read_rows(tmp_path / "empty.csv")


@pytest.mark.parametrize(
    ("outcome", "words"),
    [
        (
            RunOutcome("the 0.8 s are over.", cycles=400),
            ["missed the desired one by {:.3g} N m RMS", "no limit was reached", "ask"],
        ),
        (
            RunOutcome("the 0.8 s are over.", cycles=400, limited=100),
            ["it reached its torque limit in 25% of the cycles", "cc-mujoco diagnose"],
        ),
        (
            RunOutcome("the joint is at 9 rad.", code=3, cycles=400),
            ["ended after 0.798 s: the joint is at 9 rad.", "--replay"],
        ),
    ],
)
def test_the_page_of_a_run_says_how_it_went_and_what_comes_next(
    log: Path, outcome: RunOutcome, words: list[str]
) -> None:
    run = ReportedRun(log, outcome, "pi", "bench", 0.002, {"": LIMITS})
    text = write_run_report(run).read_text("utf-8")
    rows = read_rows(log)
    counted = rows["time_s"] >= LIMITS.soft_start
    counted &= np.isfinite(rows["desired_torque_nm"])
    off = (rows["joint_torque_nm"] - rows["desired_torque_nm"])[counted]
    for each in words:
        assert each.format(np.sqrt(np.mean(off**2))) in text
    assert text.index("<h1") < text.index("<img") < text.index("<code")
    assert "nan" not in re.sub(r"base64,[\w+/=]*", "", text)
