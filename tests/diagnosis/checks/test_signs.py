"""Signs, sides and units, found out by mechanics."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.datasets._data_findings import errors
from cc_mujoco.diagnosis import load
from cc_mujoco.diagnosis._checks.mechanics import measure_mechanics
from cc_mujoco.diagnosis._checks.readings import check_bench, check_ratio
from diagnosis.bench import RATIO, Columns, loaded, one, only_fix, recording, write
from diagnosis.recorded import BENCH, dataset

TORQUES = ("motor_torque_nm", "joint_torque_nm")
INVERTED = {
    "motor_angle_rad": "invert motor_angle_rad",
    "motor_torque_nm": "invert motor_torque_nm",
    "joint_angle_rad": "invert joint_angle_rad",
    "joint_torque_nm": "invert joint_torque_nm",
}


@pytest.mark.parametrize("channel", INVERTED)
@pytest.mark.parametrize("seed", range(3))
def test_an_inverted_channel_is_found(tmp_path: Path, channel: str, seed: int) -> None:
    columns = recording(seed=seed)
    columns[channel] = -columns[channel]
    told = only_fix(loaded(tmp_path, columns)[1]).statement
    assert INVERTED[channel] in told and "`sign` in the table [columns." in told
    assert one(tmp_path, columns, f"[columns.{channel}]\nsign = -1")


@pytest.mark.parametrize(
    ("channels", "sentence"),
    [
        (
            ("motor_torque_nm", "joint_torque_nm"),
            "leaves the transmission than enters, by .*; invert motor",
        ),
        (("motor_torque_nm", "joint_angle_rad"), "invert motor_torque_nm and joint_an"),
    ],
)
def test_two_inverted_channels_are_found(
    tmp_path: Path, channels: tuple[str, ...], sentence: str
) -> None:
    columns = recording()
    for channel in channels:
        columns[channel] = -columns[channel]
    found = only_fix(loaded(tmp_path, columns)[1])
    assert re.search(sentence, found.statement)


def test_several_trials_without_power_tell_an_inverted_torque(tmp_path: Path) -> None:
    """No closed cycle, so nothing is known of the work, but torques are opposed."""
    for seed in range(3):
        columns = recording(seed=seed)
        half = {name: values[: len(values) // 3] for name, values in columns.items()}
        half["joint_torque_nm"] = -half["joint_torque_nm"]
        write(tmp_path / f"trial_{seed}.csv", half)
    told = errors(load([tmp_path])[1])
    assert told
    assert "motor torque falls where joint torque rises" in told[0].statement


def test_both_sides_the_other_way_round_are_as_good(tmp_path: Path) -> None:
    columns = recording()
    for channel in INVERTED:
        columns[channel] = -columns[channel]
    one(tmp_path, columns)


def test_swapped_sides_are_found(tmp_path: Path) -> None:
    columns = recording()
    swapped = {
        name.replace("motor", "?").replace("joint", "motor").replace("?", "joint"): v
        for name, v in columns.items()
    }
    told = only_fix(loaded(tmp_path, swapped)[1]).statement
    assert "swap the motor's columns with the joint's" in told


@pytest.mark.parametrize("kind", ["torque_nm", "angle_rad"])
def test_swapped_columns_of_one_kind_are_found(tmp_path: Path, kind: str) -> None:
    columns = recording()
    motor, joint = f"motor_{kind}", f"joint_{kind}"
    columns[motor], columns[joint] = columns[joint], columns[motor]
    found = errors(loaded(tmp_path, columns)[1])
    assert found or mechanics_contradict_scene(tmp_path, columns)


def mechanics_contradict_scene(folder: Path, columns: Columns) -> bool:
    dataset, _ = loaded(folder, columns)
    return bool(check_ratio(dataset.trials[0], RATIO))


def test_swapped_torques_are_called_so(tmp_path: Path) -> None:
    columns = recording()
    columns["motor_angle_rad"] = columns["motor_angle_rad"] / RATIO
    columns["motor_torque_nm"] = columns["motor_torque_nm"] * RATIO
    motor, joint = "motor_torque_nm", "joint_torque_nm"
    columns[motor], columns[joint] = columns[joint], columns[motor]
    told = only_fix(loaded(tmp_path, columns)[1]).statement
    assert "swap motor_torque_nm and joint_torque_nm" in told


@pytest.mark.parametrize("channels", [TORQUES[:1], TORQUES[1:], TORQUES])
def test_one_trial_in_millinewtonmetres_is_found(
    tmp_path: Path, channels: tuple[str, ...]
) -> None:
    for seed in range(3):
        columns = recording(seed=seed)
        if seed == 1:
            columns |= {name: 1e3 * columns[name] for name in channels}
        write(tmp_path / f"trial_{seed}.csv", columns)
    told = [finding.statement for finding in errors(load([tmp_path])[1])]
    for name in channels:
        says = f"trial_1.csv, column {name} is"
        assert any(says in text and "_mnm there" in text for text in told)
    assert not any("trial_0.csv, column" in text for text in told)


def test_a_joint_that_hangs_free_is_no_other_unit(tmp_path: Path) -> None:
    for seed in range(3):
        columns = recording(seed=seed)
        if seed:
            columns["joint_torque_nm"] = columns["joint_torque_nm"] / 500.0
        write(tmp_path / f"trial_{seed}.csv", columns)
    told = [finding.statement for finding in load([tmp_path])[1]]
    assert not any("perhaps it is in mNm: call" in text for text in told)


@pytest.mark.parametrize("which", ["motor", "joint"])
def test_degrees_on_one_side_are_found(tmp_path: Path, which: str) -> None:
    columns = recording()
    channel = f"{which}_angle_rad"
    columns[channel] = np.degrees(columns[channel])
    found = errors(loaded(tmp_path, columns)[1])
    assert any("deg" in f.statement and channel in f.statement for f in found)
    trial = one(tmp_path, columns, f"[columns.{channel}]\nunit = 'deg'")
    assert trial.channel(channel) == pytest.approx(recording()[channel])


def test_degrees_on_both_sides_are_found(tmp_path: Path) -> None:
    columns = recording()
    for channel in ("motor_angle_rad", "joint_angle_rad"):
        columns[channel] = np.degrees(columns[channel])
    found = errors(loaded(tmp_path, columns)[1])
    assert {f.channel for f in found} == {"motor_angle_rad", "joint_angle_rad"}


def test_many_turns_are_right_if_declared(tmp_path: Path) -> None:
    columns = recording()
    columns["motor_angle_rad"] *= 20.0
    columns["motor_torque_nm"] /= 20.0
    _, findings = loaded(tmp_path, columns)
    assert "unit = 'deg'" in only_fix(findings).statement
    one(tmp_path, columns, "[columns.motor_angle_rad]\nunit = 'rad'")


def test_millinewtonmetres_are_found(tmp_path: Path) -> None:
    columns = recording()
    columns["motor_torque_nm"] *= 1e3
    told = only_fix(loaded(tmp_path, columns)[1]).statement
    assert "motor_torque_nm is in mNm" in told


def test_one_trial_in_degrees_among_others(tmp_path: Path) -> None:
    for seed in range(4):
        write(tmp_path / f"run{seed}.csv", recording(5.0, 200.0, seed))
    columns = recording(5.0, 200.0, 9)
    columns["motor_angle_rad"] *= 0.1
    columns["joint_angle_rad"] = np.degrees(columns["joint_angle_rad"]) * 0.1
    write(tmp_path / "run9.csv", columns)
    _, findings = load(tmp_path)
    assert {finding.trial for finding in errors(findings)} == {"run9"}


def test_ratio_of_a_scene(tmp_path: Path) -> None:
    trial = one(tmp_path, recording())
    assert check_ratio(trial, RATIO) == []
    assert check_ratio(trial, 1.6 * RATIO) == []
    assert "sides are swapped" in check_ratio(trial, 1.0 / RATIO)[0].statement
    assert "sign" in check_ratio(trial, -RATIO)[0].statement
    degrees = check_ratio(trial, RATIO * 57.3)[0].statement
    assert "joint_angle_rad is in degrees" in degrees


@pytest.mark.parametrize("side", ["motor", "joint"])
def test_radians_under_a_name_of_degrees_are_blamed_themselves(
    tmp_path: Path, side: str
) -> None:
    columns = recording()
    columns[f"{side}_angle_deg"] = columns.pop(f"{side}_angle_rad")
    write(tmp_path / "run.csv", columns)
    dataset, findings = load(tmp_path)
    told = [found.statement for found in errors(findings)]
    told += [f.statement for f in check_ratio(dataset.trials[0], RATIO)]
    assert len(told) == 2
    for sentence in told:
        assert f"{side}_angle_deg is in radians, whatever its name says" in sentence
        assert "is in degrees" not in sentence


def test_power_of_the_bench_is_what_its_friction_takes(tmp_path: Path) -> None:
    trial = one(tmp_path, recording(noise=0.0))
    known = measure_mechanics(trial)
    lost = (known.motor_work - known.joint_work) * np.abs(
        np.diff(trial.motor_angle)
    ).sum()
    assert lost == pytest.approx(
        0.15 * np.abs(np.diff(trial.joint_angle)).sum(), rel=0.1
    )


@pytest.mark.parametrize("several", [False, True])
def test_a_joint_ahead_of_its_pulleys_is_a_finding_and_an_error_if_always(
    tmp_path: Path, several: bool
) -> None:
    trial = one(tmp_path, recording())
    (found,) = check_ratio(trial, 1.9 / measure_mechanics(trial).ratio, several)
    assert (found.severity == "error") == several


def test_newton_metres_under_a_name_of_millinewton_metres_are_blamed_themselves(
    tmp_path: Path,
) -> None:
    columns = recording()
    columns["motor_torque_mnm"] = columns.pop("motor_torque_nm")
    write(tmp_path / "run.csv", columns)
    (told,) = [f.statement for f in errors(load(tmp_path)[1])]
    assert "motor_torque_mnm is in Nm, whatever its name says" in told


def test_an_angle_that_is_a_copy_of_the_other_is_no_reading(tmp_path: Path) -> None:
    columns = recording()
    columns["joint_angle_rad"] = 0.5 * columns["motor_angle_rad"] + 0.1
    write(tmp_path / "run.csv", columns)
    told = [f.statement for f in errors(load(tmp_path)[1])]
    assert any("times a number to the last digit" in each for each in told)


@pytest.mark.parametrize("wrong", [1.5, 0.7])
def test_pulleys_of_the_scene_are_doubted_where_angles_and_torques_agree(
    wrong: float,
) -> None:
    data = dataset(changes={"friction": 0.1}, duration=4.0)
    assert not [f for f in check_bench(data.trials, BENCH) if "pulleys" in f.statement]
    bench = replace(BENCH, joint_radius=wrong * BENCH.joint_radius)
    (found,) = check_bench(data.trials, bench)
    assert found.severity == "doubt" and "correct their radii" in found.statement
