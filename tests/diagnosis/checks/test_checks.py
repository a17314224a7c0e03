"""Good data need no repair; readings that cannot be are reported in a sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco.datasets import Bench
from cc_mujoco.datasets._channels import MAIN_CHANNELS
from cc_mujoco.datasets._data_findings import errors
from cc_mujoco.datasets._reading import Recording
from cc_mujoco.diagnosis import load
from cc_mujoco.diagnosis._checks import readings
from diagnosis.bench import loaded, one, only_fix, recording, write
from diagnosis.rigs import BENCH, alone


@pytest.mark.parametrize("seed", range(5))
def test_good_data_need_no_repair(tmp_path: Path, seed: int) -> None:
    columns = recording(seed=seed)
    trial = one(tmp_path, columns)
    assert trial.segments == (slice(0, 10_000),)
    assert np.array_equal(trial.joint_torque, columns["joint_torque_nm"])


@settings(max_examples=25)
@given(
    seed=st.integers(0, 1000),
    rate=st.sampled_from((100.0, 200.0, 1000.0)),
    noise=st.sampled_from((0.0, 1.0, 3.0)),
    seconds=st.floats(3.0, 12.0),
)
def test_no_kind_of_good_data_needs_repair(
    tmp_path_factory: pytest.TempPathFactory,
    seed: int,
    rate: float,
    noise: float,
    seconds: float,
) -> None:
    folder = tmp_path_factory.mktemp("data")
    one(folder, recording(seconds, rate, seed, noise))


@pytest.mark.parametrize("channel", MAIN_CHANNELS)
def test_constant_channels(tmp_path: Path, channel: str) -> None:
    columns = recording()
    columns[channel][:] = 0.3
    found = [f for f in errors(loaded(tmp_path, columns)[1]) if f.channel == channel]
    assert "is 0.3 in every row; check the sensor" in found[0].statement


def test_a_locked_joint_is_right_if_declared(tmp_path: Path) -> None:
    columns = recording()
    columns["joint_angle_rad"][:] = 0.3
    one(tmp_path, columns, "[trials.run]\nlocked = 'joint'")


def test_a_joint_that_moves_was_not_held_fast(tmp_path: Path) -> None:
    toml = "[trials.run]\nlocked = 'joint'"
    shown = only_fix(loaded(tmp_path, recording(), toml)[1]).statement
    assert "held fast" in shown


def test_an_angle_in_degrees_by_its_name_may_turn_often(tmp_path: Path) -> None:
    columns = recording()
    columns["motor_angle_deg"] = 9.0 * np.degrees(columns.pop("motor_angle_rad"))
    columns["motor_torque_nm"] = columns["motor_torque_nm"] / 9.0
    one(tmp_path, columns)


def test_clipped_torque(tmp_path: Path) -> None:
    columns = recording()
    columns["motor_torque_nm"] = np.clip(columns["motor_torque_nm"], -9.0, 0.2)
    dataset, findings = loaded(tmp_path, columns)
    (found,) = [f for f in findings if f.severity == "doubt"]
    assert "repeats 0.2 " in found.statement and "cut off above" in found.statement
    assert "ask less of the motor if this is its limit" in found.statement
    torque = dataset.trials[0].motor_torque
    used = np.concatenate([torque[rows] for rows in dataset.trials[0].segments])
    assert np.mean(used == 0.2) < 1e-3


def test_a_torque_that_is_cut_off_on_both_sides(tmp_path: Path) -> None:
    columns = recording()
    least, most = np.quantile(columns["joint_torque_nm"], (0.3, 0.7))
    columns["joint_torque_nm"] = np.clip(columns["joint_torque_nm"], least, most)
    findings = loaded(tmp_path, columns)[1]
    shown = [f.statement for f in findings]
    assert "repair the sensor or leave the trial out" in only_fix(findings).statement
    assert any("cut off above" in each for each in shown)
    assert any("cut off below" in each for each in shown)


@pytest.mark.parametrize("least", [0.0, 0.05])
def test_a_slack_cable_is_no_sensor_that_is_cut_off(
    tmp_path: Path, least: float
) -> None:
    """It pulls with nothing; a tension that stays elsewhere is cut off."""
    columns = recording()
    columns["tension_distal_n"] = np.maximum(20.0 * columns["joint_torque_nm"], least)
    _, findings = load(write(tmp_path / "run.csv", columns))
    shown = [f for f in findings if "cut off below" in f.statement]
    assert [f.channel for f in shown] == (["tension_distal_n"] if least else [])


def test_a_torque_is_nothing_while_the_only_cable_is_slack(tmp_path: Path) -> None:
    """A second cable would pull the other way."""
    columns = recording()
    columns["joint_torque_nm"] = np.maximum(columns["joint_torque_nm"], 0.0)
    path = write(tmp_path / "run.csv", columns)
    for bench, times in ((BENCH, 1), (Bench.of(alone(tmp_path)), 0)):
        shown = [f.statement for f in load(path, None, bench)[1]]
        assert sum("cut off below" in each for each in shown) == times


@pytest.mark.parametrize("side", ["motor", "joint"])
def test_an_encoder_that_begins_anew_after_a_turn(tmp_path: Path, side: str) -> None:
    columns = recording()
    angle = np.degrees(columns.pop(f"{side}_angle_rad"))
    columns[f"{side}_angle_deg"] = angle % 360.0
    first = errors(loaded(tmp_path, columns)[1])[0]
    times = np.count_nonzero(np.abs(np.diff(angle % 360.0)) > 180.0)
    assert f"jumps by a full turn {times} times" in first.statement
    assert f"{side}_angle_deg" in first.statement


def test_an_encoder_that_slips_puts_the_conclusions_in_doubt(tmp_path: Path) -> None:
    columns = recording()
    columns["joint_angle_rad"][5000:] += 0.4
    found = [f for f in loaded(tmp_path, columns)[1] if f.severity == "doubt"]
    assert [f.channel for f in found] == ["joint_angle_rad"]
    assert "(row 5001), as an encoder does that slips" in found[0].statement


def test_a_glitch_and_a_frozen_torque_split_the_trial(tmp_path: Path) -> None:
    columns = recording()
    columns["joint_torque_nm"][3000] = 1e3
    columns["motor_torque_nm"] += 1e-3 * np.random.default_rng(0).normal(size=10_000)
    columns["motor_torque_nm"][6000:6100] = columns["motor_torque_nm"][6000]
    dataset, findings = loaded(tmp_path, columns)
    (trial,) = dataset.trials
    ends = slice(0, 3000), slice(3001, 6001), slice(6100, 10_000)
    assert trial.segments == ends
    text = " ".join(f.statement for f in findings)
    assert "reads 1000 at 6 s (row 3001)" in text
    assert "in 99 rows from 12.002 s (row 6002) on" in text


@pytest.mark.parametrize("later", [0.0, 7.0])
def test_a_copy_is_no_repeat(tmp_path: Path, later: float) -> None:
    columns = recording(3.0)
    write(tmp_path / "a.csv", columns)
    write(tmp_path / "b.csv", {**columns, "time_s": columns["time_s"] + later})
    dataset, findings = load(tmp_path)
    assert len(dataset.trials) == 1
    assert any("has the readings of" in finding.statement for finding in findings)


@pytest.mark.parametrize("first", [0, 300])
@pytest.mark.parametrize("rows", [200, 1000])
def test_rows_that_stand_twice_put_the_conclusions_in_doubt(
    tmp_path: Path, first: int, rows: int
) -> None:
    columns = recording(3.0)
    for name, values in columns.items():
        if name != "time_s":
            columns[name] = np.append(values, values[first : first + rows])
    columns["time_s"] = np.arange(1500 + rows) / 500.0
    found = [f for f in loaded(tmp_path, columns)[1] if "a copy is no" in f.statement]
    assert [f.severity for f in found] == ["doubt"]
    copied = f"has the rows {first + 1} to {first + rows} again as rows 1501 to"
    assert f"{copied} {1500 + rows}, from 3 s on" in found[0].statement


def test_rows_whose_sums_are_equal_are_no_copies() -> None:
    """Their bits differ by 2 in one column and by -1 in that of twice the weight."""
    first, other = np.random.default_rng(0).uniform(1.0, 2.0, (2, 200))
    late = (
        (first.view(np.int64) + 2).view(float),
        (other.view(np.int64) - 1).view(float),
    )
    values = {
        "time_s": np.arange(400.0),
        "motor_angle_rad": np.append(first, late[0]),
        "joint_angle_rad": np.append(other, late[1]),
    }
    made = Recording("a", Path("a"), "", values, {}, {}, [])
    readings._check_copied_rows(made)
    assert made.findings == []
    values["motor_angle_rad"][200:], values["joint_angle_rad"][200:] = first, other
    readings._check_copied_rows(made)
    assert len(made.findings) == 1


def test_a_load_that_is_another_one_is_refused(tmp_path: Path) -> None:
    columns = recording(3.0)
    columns["joint_torque_nm"] = columns["motor_torque_nm"]
    wrong = errors(loaded(tmp_path, columns)[1])
    assert [f.channel for f in wrong if "holds the readings" in f.statement] == [
        "joint_torque_nm"
    ]


def test_a_second_line_of_names_ends_a_recording(tmp_path: Path) -> None:
    write(tmp_path / "run.csv", recording(1.0))
    text = (tmp_path / "run.csv").read_text(encoding="utf-8")
    (tmp_path / "run.csv").write_text(text + text, encoding="utf-8")
    (wrong,) = errors(load(tmp_path)[1])
    assert "row 501 of the data is a second line of names; split" in wrong.statement


def test_like_names_in_two_folders(tmp_path: Path) -> None:
    for seed, name in enumerate("ab"):
        (tmp_path / name).mkdir()
        write(tmp_path / name / "run.csv", recording(3.0, seed=seed))
    dataset, _ = load([tmp_path / "b", tmp_path / "a"])
    assert [trial.name for trial in dataset.trials] == ["b/run", "a/run"]


def test_the_dataset_file_in_the_folder_is_used(tmp_path: Path) -> None:
    write(tmp_path / "a.csv", recording(3.0))
    (tmp_path / "dataset.toml").write_text("[rig]\njoint_radius = 0.1")
    dataset, findings = load(str(tmp_path))
    assert dataset.constants["joint_radius"].value == 0.1
    assert any("dataset.toml" in finding.statement for finding in findings)


@settings(max_examples=60)
@given(data=st.data())
def test_any_table_of_numbers_is_data_or_a_sentence(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("data")
    columns = {name: v.copy() for name, v in recording(2.0, 100.0).items()}
    names = st.sampled_from(sorted(columns))
    for _ in range(data.draw(st.integers(1, 3))):
        values = columns[data.draw(names)]
        start = data.draw(st.integers(0, 199))
        stop = data.draw(st.integers(start, 200))
        values[start:stop] = data.draw(
            st.sampled_from((0.0, np.nan, np.inf, -1e300, 1e9, 1e-300))
        )
    dataset, findings = loaded(folder, columns)
    assert dataset.trials or errors(findings)
