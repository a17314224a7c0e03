"""The benchmark: what controllers see, scores, and that runs repeat and resume."""

from __future__ import annotations

import dataclasses
import math
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pyarrow.parquet as pq
import pytest

import cc_mujoco  # noqa: F401
from cc_mujoco.benchmark import (
    SCORES,
    Cell,
    CellResult,
    Plan,
    drawing,
    interval,
    markdown,
    play,
    run,
)
from cc_mujoco.benchmark.mismatch import Mismatch
from cc_mujoco.benchmark.report import over_conditions
from cc_mujoco.benchmark.runner import FIGURES, write_scores
from cc_mujoco.benchmark.scores import score
from cc_mujoco.benchmark.writing import write
from cc_mujoco.control import controller
from cc_mujoco.devices import DEVICES
from cc_mujoco.errors import CableError
from cc_mujoco.figures import figure
from cc_mujoco.recording import play as record
from cc_mujoco.sensing import MEASURED, PERFECT, TENSIONS, Measuring, Sensing
from control.policies import Linear, saved

SHORT = Cell("wrist", "stiction", "sine", "spring", seeds=(0, 1), duration=1.05)


def readings(sensing: Sensing, seeds: tuple[int, ...], steps: int = 30) -> list[Any]:
    """What is measured of a wrist that the motor turns."""
    env = gymnasium.make_vec("cc_mujoco/WristHandle-v0", len(seeds), threads=1)
    wrist = env.unwrapped
    drive = sensing.equip(wrist.drive)
    measuring = Measuring(sensing, drive, ("flexor", "extensor"), seeds, steps)
    _, info = env.reset(seed=0)
    found = []
    for _ in range(steps):
        found.append((info, measuring.measure(info)))
        *_, info = env.step(wrist.action(np.full(len(seeds), 0.5)))
    env.close()
    return found


def test_perfect_sensors_tell_the_truth() -> None:
    for info, seen in readings(PERFECT, (0, 1)):
        for name in MEASURED:
            assert np.array_equal(seen[name], info[name])
        assert seen[TENSIONS].shape == (2, 2, 3)
        assert np.array_equal(
            seen[TENSIONS][:, 1, 2], info["tension_extensor_distal_n"]
        )


@pytest.mark.parametrize(
    ("scene", "trajectory", "task"),
    [("wrist", "multisine", "spring"), ("ankle", "walk", "assist")],
)
def test_a_policy_scores_as_in_its_environment_where_sensors_are_perfect(
    scene: str,
    trajectory: str,
    task: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    name = DEVICES[scene].environment
    env = gymnasium.make(name, trajectory=trajectory, task=task, duration=1.05)
    most = env.observation_space.high
    weights = np.array([0.3, -0.5, 0.2, -0.1, -4.0, 4.0, 0.1, -0.1])[: most.size]
    policy = Linear(env.observation_space, weights / most)
    errors = []
    for seed in (2, 5):
        observation, info = env.reset(seed=seed)
        rows, truncated = [info], False
        while not truncated:
            action, _ = policy.predict(observation)
            observation, _, _, truncated, info = env.step(action)
            rows.append(info)
        error = [row["joint_torque_nm"] - row["desired_torque_nm"] for row in rows]
        errors.append(np.sqrt(np.mean(np.square(error[500:]))))
    env.close()
    path = saved(policy, tmp_path / "policy.zip", monkeypatch)
    cell = Cell(scene, path, trajectory, task, (2, 5), 1.05, sensing=PERFECT)
    assert play(cell).scores["rms_error"] == pytest.approx(errors, rel=1e-9)


def test_encoders_step_and_measurements_are_late() -> None:
    coarse = Sensing(0.0, 0.0, motor_steps=100.0, joint_steps=0.0, delay=3)
    rows = readings(coarse, (0,))
    for _, seen in rows:
        count = seen["motor_angle_rad"] * 100.0 / (2.0 * math.pi)
        assert count == pytest.approx(np.round(count), abs=1e-9)
    for late, early in zip(rows[3:], rows, strict=False):
        assert late[1]["joint_angle_rad"] == early[0]["joint_angle_rad"]


def test_a_seed_is_the_same_noise_in_any_company() -> None:
    sensing = Sensing(0.1, 1.0)
    together, alone = readings(sensing, (4, 7)), readings(sensing, (7,))
    for (_, many), (_, one) in zip(together, alone, strict=True):
        assert many["joint_torque_nm"][1] == one["joint_torque_nm"][0]
        assert np.array_equal(many[TENSIONS][1], one[TENSIONS][0])
    noise = [
        seen["joint_torque_nm"] - info["joint_torque_nm"] for info, seen in together
    ]
    assert np.std(noise[5:]) > 0.03


def test_models_are_wrong_by_seed_and_without_error_right() -> None:
    env = gymnasium.make("cc_mujoco/WristHandle-v0", disable_env_checker=True)
    drive = env.unwrapped.drive
    right = Mismatch(0.0, 0.0, 0.0).believed(drive, (3,))
    assert right.cable_drives == drive.cable_drives
    wrong = Mismatch().believed(drive, (3, 5))
    assert wrong.cable_drives[1] == Mismatch().believed(drive, (5,)).cable_drives[0]
    assert wrong.cable_drives[0] != wrong.cable_drives[1]
    biased = Mismatch(0.0, 0.0, 0.0, bias=0.5).believed(drive, (0,))
    assert biased.cables[0].cable.friction == pytest.approx(0.315)
    assert biased.cables[0].cable.static_friction == pytest.approx(0.945)


def episode(samples: int = 4000) -> dict[str, np.ndarray]:
    """A spring rendered perfectly by a motor that turns smoothly."""
    time = np.arange(samples) / 1000.0
    angle = 0.5 * np.sin(2.0 * math.pi * time)
    return {
        "time_s": time,
        "joint_angle_rad": angle,
        "joint_torque_nm": -angle,
        "desired_torque_nm": -angle,
        "motor_torque_nm": np.full(samples, 0.3),
        "slack_m": np.zeros((samples, 2)),
    }


def scored(task: str = "spring", pull_pull: bool = True, **changes: np.ndarray) -> dict:
    return score(episode() | changes, task=task, period=0.001, pull_pull=pull_pull)


def test_scores_of_a_perfect_episode() -> None:
    found = scored()
    assert set(found) == {s.name for s in SCORES}
    for name in ("rms_error", "peak_error", "lag", "backlash", "failed"):
        assert found[name] == pytest.approx(0.0, abs=1e-9)
    assert found["effort"] == pytest.approx(0.3)
    assert found["chatter"] == pytest.approx(0.0, abs=1e-12)


def test_scores_measure_what_they_are_called() -> None:
    torque = episode()["joint_torque_nm"]
    for shift in (20, -20):
        late = scored(joint_torque_nm=np.roll(torque, shift))
        assert late["lag"] == pytest.approx(shift, abs=0.5)
    off = scored(joint_torque_nm=torque + 0.1)
    assert off["rms_error"] == pytest.approx(0.1)
    assert off["peak_error"] == pytest.approx(0.1)
    rubbed = torque + 0.1 * np.sign(np.gradient(torque))
    assert scored(joint_torque_nm=rubbed)["backlash"] == pytest.approx(0.2, rel=0.05)
    rough = rubbed + 0.3 * (-1.0) ** np.arange(4000)
    assert scored(joint_torque_nm=rough)["backlash"] == pytest.approx(0.2, rel=0.05)
    rough = scored(motor_torque_nm=0.3 + 0.1 * (-1.0) ** np.arange(4000))
    assert rough["chatter"] == pytest.approx(0.1, rel=0.05)
    free = scored("transparent", desired_torque_nm=np.zeros(4000))
    assert free["transparency"] == pytest.approx(0.5 / math.sqrt(2.0), rel=1e-3)
    assert math.isnan(free["backlash"])


def test_failures_are_slack_at_the_wrong_time_and_divergence() -> None:
    one, both = np.zeros((4000, 2)), np.full((4000, 2), 0.01)
    one[:, 0] = 0.01
    assert scored(slack_m=one)["failed"] == 0.0
    assert scored(slack_m=both)["failed"] == 1.0
    assert scored(slack_m=one, pull_pull=False)["failed"] == 1.0
    lost = episode()["joint_torque_nm"].copy()
    lost[2000:] = math.nan
    found = scored(joint_torque_nm=lost)
    assert found["failed"] == 1.0
    assert math.isnan(found["rms_error"])


def test_interval_is_that_of_student() -> None:
    found = interval(np.array([1.0, 2.0, 3.0, math.nan]))
    assert found.mean == 2.0
    assert found.half == pytest.approx(4.302652729911275 / math.sqrt(3.0))
    assert str(found) == "2.0 ± 2.5 (3 of 4)"
    assert str(interval(np.array([1.0, 2.0, 3.0]))) == "2.0 ± 2.5"
    assert str(interval(np.array([math.nan]))) == "-"


def test_a_seed_scores_the_same_alone_and_among_others() -> None:
    together = play(SHORT)
    alone = play(dataclasses.replace(SHORT, seeds=(1,)))
    for name, values in together.scores.items():
        assert np.array_equal(values[1:], alone.scores[name], equal_nan=True)


def test_recording_changes_nothing_and_is_whole() -> None:
    seen = play(dataclasses.replace(SHORT, seeds=(0,)), record=True)
    assert seen.log is not None
    assert len(seen.log) == 1051
    assert np.array_equal(
        seen.log["joint_torque_nm"][::10], seen.trace["joint_torque_nm"]
    )


@pytest.mark.parametrize("law", ["stiction", "fused"])
def test_a_cell_whose_model_is_right_is_the_episode_that_is_recorded(law: str) -> None:
    right = Mismatch(0.0, 0.0, 0.0)
    cell = dataclasses.replace(SHORT, controller=law, seeds=(3,), mismatch=right)
    found = play(cell, record=True).log
    assert found is not None
    device = DEVICES[cell.scene]
    about = {"trajectory": cell.trajectory, "task": cell.task}
    env = gymnasium.make(device.environment, duration=cell.duration, **about)
    drive = env.unwrapped.drive
    known = record(env, controller(law, drive), seed=3)
    assert found.columns.keys() == known.columns.keys()
    for name, column in known.columns.items():
        assert np.array_equal(found[name], column), name
    extra = {*about, "controller", "mismatch"}
    assert {**known.metadata, **{n: found.metadata[n] for n in extra}} == found.metadata


@pytest.mark.slow
def test_run_resumes_and_repeats_byte_for_byte_in_any_number_of_processes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = Plan(("wrist",), ("none", "stiction"), ("sine",), ("spring",), 2, 1.05)
    fresh: list[bool] = []
    first = run(plan, tmp_path / "a", finished=lambda _, now: fresh.append(now))
    again = run(plan, tmp_path / "a", finished=lambda _, now: fresh.append(now))
    assert fresh == [True, True, False, False]
    other = run(plan, tmp_path / "b", workers=2)
    tables = {markdown(results) for results in (first, again, other)}
    assert len(tables) == 1
    write(tmp_path / "a", first)
    for stem in FIGURES:  # drawn once is enough
        monkeypatch.setattr(drawing, stem, lambda *_: figure(1.0, 1.0))
    write(tmp_path / "b", other)
    for file in ("scores.parquet", "table.md"):
        one, two = ((tmp_path / name / file).read_bytes() for name in ("a", "b"))
        assert one == two
    assert (tmp_path / "a" / "wrist-pareto.png").stat().st_size > 10_000
    longer = dataclasses.replace(plan, controllers=("none",), duration=1.1)
    run(longer, tmp_path / "a", finished=lambda _, now: fresh.append(now))
    assert fresh[4:] == [True]


def test_a_cell_of_other_code_is_played_again_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("mine", "helper"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    Path("helper.py").write_text(
        "from pathlib import Path\n"
        "def gain():\n    return float(Path('gain.toml').read_text())\n"
    )
    Path("mine.py").write_text(
        "import helper\n"
        "def make(drive):\n"
        "    gain = helper.gain()\n"
        "    return lambda seen: gain * seen['desired_torque_nm']\n"
    )
    plan = Plan(("wrist",), ("none", "mine:make"), ("sine",), ("spring",), 1, 1.05)
    said: list[str] = []
    errors = []
    for gain in ("0.0", "0.0", "0.2"):
        Path("gain.toml").write_text(gain)
        results = run(plan, "out", say=said.append)
        errors.append(float(results[1][1].scores["rms_error"][0]))
    assert errors[0] == errors[1] != errors[2]
    kept = "cells kept; --again runs them anew."
    assert said == [
        f"2 of 2 {kept}",
        f"1 of 2 {kept} Earlier cells are replaced: they differ in gain.toml.",
    ]


def test_table_pairs_seeds_with_the_baseline(tmp_path: Path) -> None:
    def fake(law: str, errors: list[float]) -> tuple[Cell, CellResult]:
        cell = dataclasses.replace(SHORT, controller=law)
        scores = {s.name: np.full(2, math.nan) for s in SCORES}
        scores |= {"rms_error": np.array(errors), "failed": np.zeros(2)}
        return cell, CellResult(scores, {}, None)

    results = [fake("pi", [1.0, 2.0]), fake("model", [0.5, 1.5])]
    text = markdown(results)
    assert "| `model` | -0.5 |" in text
    assert over_conditions(results, "wrist", "model", "rms_error").tolist() == [
        0.5,
        1.5,
    ]
    write_scores(tmp_path / "scores.parquet", results)
    table = pq.read_table(tmp_path / "scores.parquet")
    assert table["rms_error"].to_pylist() == [1.0, 2.0, 0.5, 1.5]
    assert table["seed"].to_pylist() == [0, 1, 0, 1]


def test_diverging_where_it_is_hard_makes_no_mean_better() -> None:
    def fake(law: str, trajectory: str, errors: list[float]) -> tuple[Cell, CellResult]:
        cell = dataclasses.replace(SHORT, controller=law, trajectory=trajectory)
        scores = {s.name: np.full(2, math.nan) for s in SCORES}
        scores |= {"rms_error": np.array(errors), "failed": np.isnan(errors) + 0.0}
        return cell, CellResult(scores, {}, None)

    results = [
        fake("pi", "sine", [1.0, 1.0]),
        fake("pi", "sweep", [3.0, 3.0]),
        fake("mine", "sine", [0.1, 0.1]),
        fake("mine", "sweep", [0.3, math.nan]),
    ]
    found = over_conditions(results, "wrist", "mine", "rms_error")
    assert np.array_equal(found, [0.2, math.nan], equal_nan=True)
    assert "| `mine` | 0.2 (1 of 2) | -1.8 (1 of 2) | 25% |" in markdown(results)
    nowhere = over_conditions(results, "wrist", "mine", "lag")
    assert np.isnan(nowhere).all()


def test_a_name_given_twice_is_played_once_and_files_are_never_shared() -> None:
    twice = Plan(("wrist",), ("pi", "pi"), ("sine", "sine"), ("spring",))
    assert len(twice.cells()) == 1
    with pytest.raises(CableError, match="same files"):
        Plan(("wrist",), ("runs/p.zip", "runs_p.zip")).cells()


def test_a_controller_that_gives_no_number_fails_and_a_wrong_shape_is_refused() -> None:
    short = dataclasses.replace(SHORT, controller=f"{__name__}:infinite")
    assert play(short).scores["failed"].tolist() == [1.0, 1.0]
    for law in ("too_many", "raising"):
        with pytest.raises(CableError, match=law):
            play(dataclasses.replace(SHORT, controller=f"{__name__}:{law}"))


def infinite(drive: Any) -> Any:
    return lambda seen: np.full_like(seen["joint_torque_nm"], math.inf)


def too_many(drive: Any) -> Any:
    return lambda seen: np.zeros(17)


def raising(drive: Any) -> Any:
    return lambda seen: seen["tension_flexor_distal_n"]


def test_what_cannot_be_played_is_refused() -> None:
    with pytest.raises(CableError, match="unknown scene"):
        Cell("elbow", "pi", "sine", "spring")
    with pytest.raises(CableError, match="seed"):
        dataclasses.replace(SHORT, seeds=())
    with pytest.raises(CableError, match="duration"):
        dataclasses.replace(SHORT, duration=0.5)
    with pytest.raises(CableError, match="unknown controller"):
        Plan(("wrist",), ("pid",)).check()
    with pytest.raises(CableError, match="at least one scene"):
        Plan((), ("pi",)).cells()
    assert Plan(("wrist", "ankle"), ("pi",)).check() == ()
    (warning,) = Plan(("wrist",), ("pi",), tasks=("assist", "spring")).check()
    assert warning.startswith("wrist, assist: the task asks for -30 to ")
    with pytest.raises(CableError, match="delay"):
        Sensing(0.0, 0.0, delay=-1)
