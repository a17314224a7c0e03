"""The trials of a plan on a rig: the motor follows, the folder is data."""

from __future__ import annotations

import dataclasses
import json
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from driven import Bench, Lockstep

from cc_mujoco import cli
from cc_mujoco.control import controller
from cc_mujoco.datasets._dataset_file import read_dataset_file
from cc_mujoco.datasets._folders import data_files
from cc_mujoco.datasets._run_log import truncation_reason
from cc_mujoco.device import Drive
from cc_mujoco.errors import CableError
from cc_mujoco.hardware import (
    APPROACH_TIME,
    DrivenAxis,
    Limits,
    Loop,
    Readings,
    RunLog,
    Servo,
    Status,
    Stiffness,
    Watchdog,
)
from cc_mujoco.hardware._references import read_plan
from hardware.fakes import Rows, add_row
from hardware.peers import Peer, toml
from rig import make_rig

PERIOD = 0.001
DRIVE = Drive(1.0, -10.0, 10.0, PERIOD, inertia=3e-4, delay=1)
LIMITS = Limits(10.0, 1000.0, 100.0, (-3.0, 3.0), soft_start=0.1)


def written(folder: Path, reach: float = 0.05, seconds: float = 0.2) -> Path:
    """Return a plan of two short trials."""
    folder.mkdir()
    facts = []
    for k in (1, 2):
        times = np.linspace(0.0, seconds, 11)
        motor = reach * np.sin(np.pi * times / seconds)
        rows = np.stack([times, motor, 0.5 * motor], axis=1)
        np.savetxt(
            folder / f"motion_{k:02d}.csv", rows, delimiter=",", comments="",
            header="time_s,motor_angle_rad,joint_angle_rad",
        )  # fmt: skip
        facts.append(f'[trials."trial_{k:02d}"]\npretension = {40 * k}\nnotes = "n{k}"')
    (folder / "dataset.toml").write_text("\n".join(facts))
    return folder


def words(folder: Path, rig: str, *more: str, trials: Path | None = None) -> list[str]:
    (folder / "rig.toml").write_text(toml(rig), encoding="utf-8")
    plan = str(trials or folder / "plan")
    where = ["--rig", str(folder / "rig.toml"), "--out", str(folder / "out")]
    return ["run", *where, "--plan", plan, *more]


def recorded(folder: Path) -> dict[str, float | None]:
    """Pretension of every log, as its folder's `dataset.toml` has it [N]."""
    facts = read_dataset_file(folder / "dataset.toml")
    logs = data_files([folder])
    # That of the bench: the logs have the torque that its rotor was given.
    assert facts.rig["rotor_inertia"].value == pytest.approx(3e-4)
    assert set(tomllib.loads((folder / "dataset.toml").read_text())["trials"]) == {
        path.stem for path in logs
    }
    return {path.stem: facts.facts_of(path).pretension for path in logs}


def test_a_motor_in_cables_follows_its_course() -> None:
    bench = Bench(make_rig(1, make="guides"), {}, PERIOD, hand=(0.0, 0.0))
    rig, rows = Lockstep(bench, 1, lambda time: (0.0, 0.0)), Rows()
    times = np.linspace(0.0, 2.0, 201)
    servo = Servo(DRIVE, times, 0.4 * np.sin(2.0 * times))
    axis = DrivenAxis(rig, DRIVE, servo, LIMITS, Watchdog())
    loop = Loop([axis], controller("none", DRIVE), clock=rig, log=rows)
    assert loop.run(APPROACH_TIME + 2.0).code == 0
    seen = np.array(rows.rows)
    now = seen[:, 0] - seen[0, 0]
    moving = (now > APPROACH_TIME + 0.3) & (now < APPROACH_TIME + 2.0)
    wanted = [servo.course(t, 0.0)[0] for t in now[moving]]
    assert np.sqrt(np.mean((seen[moving, 1] - wanted) ** 2)) < 0.05
    # Smooth enough to be data: the torque does not jump from cycle to cycle.
    assert np.std(np.diff(seen[moving, 8])) < 0.1


def test_a_motor_goes_smoothly_to_where_its_course_begins() -> None:
    servo = Servo(DRIVE, np.array([0.0, 1.0]), np.array([0.3, 0.5]))
    path = [servo.course(t, -0.2) for t in np.arange(0.0, APPROACH_TIME + 1.0, PERIOD)]
    angle, speed = np.array(path).T
    assert angle[0] == -0.2 and angle[-1] == pytest.approx(0.5, abs=1e-3)
    assert np.gradient(angle, PERIOD)[1:-1] == pytest.approx(speed[1:-1], abs=0.11)
    assert np.abs(np.diff(angle)).max() < 1e-3  # nowhere a jump


def test_a_servo_needs_the_inertia_that_it_moves() -> None:
    with pytest.raises(CableError, match="inertia must be known"):
        Stiffness.of(dataclasses.replace(DRIVE, inertia=0.0))


def test_a_trial_leaves_a_log_that_is_data_with_what_is_known_of_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written(tmp_path / "plan")
    with Peer() as peer:
        assert cli.main(words(tmp_path, peer.end.rig, "--trial", "2")) == 0
        # A motor that stays where it is gets all the torque there is, and no more.
        assert 0.0 < max(np.abs(peer.torques)) <= 1.0
        assert peer.stopped()
    assert "trial_02: n2" in capsys.readouterr().out
    out = tmp_path / "out"
    about = json.loads((out / "trial_02.json").read_text())
    assert about["exit_code"] == 0 and about["plan"] == str(tmp_path / "plan")
    assert recorded(out) == {"trial_02": 80.0}
    with Peer() as peer:
        assert cli.main(words(tmp_path, peer.end.rig, "--trial", "2")) == 2
        assert not peer.commands
    assert "measured data are never replaced" in capsys.readouterr().err
    with Peer() as peer:
        assert cli.main(words(tmp_path, peer.end.rig, "--trial", "1")) == 0
    assert recorded(out) == {"trial_01": 40.0, "trial_02": 80.0}


def test_a_trial_that_was_cut_short_is_reported(tmp_path: Path) -> None:
    log = RunLog(tmp_path, {}, 1, "trial_01")
    add_row(log, Readings(0.0, *[0.1] * 5, Status.ENABLED))
    log.close({"outcome": "stopped by SIGTERM.", "exit_code": 143})
    first, second, none = (tmp_path / f"trial_0{k}.csv" for k in (1, 2, 3))
    assert truncation_reason(first) == "stopped by SIGTERM."
    whole = RunLog(tmp_path, {}, 1, "trial_02")
    assert truncation_reason(second) == "running, or killed"
    whole.close({"outcome": "the 3 s are over.", "exit_code": 0})
    assert truncation_reason(second) == truncation_reason(none) == ""
    none.with_suffix(".json").write_text('{"outcome": "of somebody else"}')
    assert truncation_reason(none) == ""


def test_a_log_without_rows_is_replaced_and_one_with_rows_is_not(
    tmp_path: Path,
) -> None:
    for rows in (0, 0, 1):
        log = RunLog(tmp_path, {}, 1)
        for _ in range(rows):
            add_row(log, Readings(0.0, *[0.1] * 5, Status.ENABLED))
        log.close({"outcome": "the rig gave no reading in 3 s.", "exit_code": 3})
    before = (tmp_path / "log.csv").read_bytes()
    with pytest.raises(CableError, match="measured data are never replaced"):
        RunLog(tmp_path, {}, 1)
    assert (tmp_path / "log.csv").read_bytes() == before


def test_the_trials_of_a_real_plan_are_read(tmp_path: Path) -> None:
    folder = written(tmp_path / "plan")
    first, second = read_plan(folder)
    assert (first.name, second.notes) == ("trial_01", "n2")
    assert first.duration == pytest.approx(APPROACH_TIME + 0.2)
    assert np.interp(0.1, first.times, first.joint) == pytest.approx(0.025)
    shutil.rmtree(folder)
    with pytest.raises(CableError, match="holds no plan"):
        read_plan(folder)


@pytest.mark.parametrize(
    ("more", "reach", "said"),
    [
        (("--trial", "3"), 0.05, "--trial must be 1 to 2, not 3"),
        (("--trial", "1"), 3.0, "takes the joint to 1.5 rad, outside its range"),
        (("--trial", "1"), 1.99, "turns the motor at 30.7 rad/s, beyond"),
        (("--controller", "pi", "--trial", "1"), 0.05, "--controller does not go"),
        ((), 0.05, "somebody has to make the rig ready"),
    ],
)
def test_what_cannot_be_played_is_said_before_the_rig_is_touched(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    more: tuple[str, ...],
    reach: float,
    said: str,
) -> None:
    plan = written(tmp_path / "plan", reach)
    with Peer() as peer:
        arguments = words(tmp_path, peer.end.rig, *more, trials=plan)
        assert cli.main(arguments) == 2
        assert not peer.commands
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
