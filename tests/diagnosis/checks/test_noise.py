"""Quantisation, sensor noise and repeatability: what was put in is found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.diagnosis import load
from cc_mujoco.diagnosis._checks.content import find_period, repeat_scatter
from diagnosis.bench import RATIO, loaded, only_fix, recording, write

JOINT = ("joint_torque_nm",)


def test_noise_is_what_was_put_in(tmp_path: Path) -> None:
    dataset, _ = loaded(tmp_path, recording(60.0))
    noise = dataset.noise
    assert noise["joint_torque_nm"].deviation == pytest.approx(2e-3, rel=0.1)
    assert noise["motor_torque_nm"].deviation == pytest.approx(1e-3, rel=0.1)
    assert noise["joint_angle_rad"].resolution == pytest.approx(2e-4, rel=1e-3)


@pytest.mark.parametrize("rate", [1.0, 40.0])
def test_a_digit_is_found_however_times_jitter_and_clocks_are_late(
    tmp_path: Path, rate: float
) -> None:
    """A motion of 40 times the rate hardly reads any digit twice."""
    columns = recording(30.0)
    time = columns["time_s"]
    time += np.random.default_rng(1).uniform(-3e-4, 3e-4, len(time))
    for name, bits in (("motor_angle_rad", 15), ("joint_angle_rad", 13)):
        step = 2.0 * np.pi / 2**bits
        angle = 0.5 * np.sin(rate * time + 0.4 * bits)
        columns[name] = np.round(step * np.round(angle / step), 6)
    toml = "[columns.joint_angle_rad]\ndelay = 0.0007\n"
    (tmp_path / "dataset.toml").write_text(toml)
    noise = loaded(tmp_path, columns)[0].noise
    for name, bits in (("motor_angle_rad", 15), ("joint_angle_rad", 13)):
        assert noise[name].resolution == pytest.approx(2.0 * np.pi / 2**bits, rel=1e-2)


def test_noise_in_rests_is_not_the_torque_that_relaxes(tmp_path: Path) -> None:
    columns = recording(30.0)
    rest = columns["time_s"] % 5.0 > 3.0
    rng = np.random.default_rng(0)
    count = len(rest)
    hold = np.where(rest, 0.0, np.sin(2 * np.pi * columns["time_s"]))
    columns["motor_angle_rad"] = hold
    columns["joint_angle_rad"] = hold / RATIO
    columns["joint_torque_nm"] = (
        0.1 * hold
        + np.exp(-(columns["time_s"] % 5.0))
        + 2e-3 * rng.standard_normal(count)
    )
    dataset, _ = loaded(tmp_path, columns)
    noise = dataset.noise["joint_torque_nm"]
    assert noise.source == "holds"
    assert noise.deviation == pytest.approx(2e-3, rel=0.15)


def test_declared_noise_wins(tmp_path: Path) -> None:
    toml = "[columns.motor_torque_nm]\nunit = 'mNm'\nnoise = 7\nresolution = 0.5"
    columns = recording()
    columns["motor_torque_nm"] *= 1e3
    noise = loaded(tmp_path, columns, toml)[0].noise["motor_torque_nm"]
    assert noise.source == "declared"
    assert noise.deviation == pytest.approx(7e-3)
    assert noise.resolution == pytest.approx(5e-4)


def test_declared_noise_is_in_the_unit_of_the_columns_name(tmp_path: Path) -> None:
    toml = "[columns.motor_angle_rad]\nnoise = 0.02\nresolution = 0.01"
    columns = recording()
    columns["motor_angle_deg"] = np.degrees(columns.pop("motor_angle_rad"))
    noise = loaded(tmp_path, columns, toml)[0].noise["motor_angle_rad"]
    assert noise.deviation == pytest.approx(np.radians(0.02))
    assert noise.resolution == pytest.approx(np.radians(0.01))


def test_repeats_tell_the_scatter(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    for name in "ab":
        columns = recording(10.0, noise=0.0)
        columns["joint_torque_nm"] += 0.02 * rng.standard_normal(5000)
        write(tmp_path / f"{name}.csv", columns)
    (tmp_path / "dataset.toml").write_text("[trials.b]\nrepeat_of = 'a.csv'")
    trials = load(tmp_path)[0].trials
    assert repeat_scatter(trials, JOINT).deviation == pytest.approx(0.02, rel=0.05)
    gaps = np.where(np.arange(5000) % 3 == 0, np.nan, trials[1].joint_torque)
    with_gaps = (trials[0], replace(trials[1], joint_torque=gaps))
    assert repeat_scatter(with_gaps, JOINT).deviation == pytest.approx(0.02, rel=0.05)


def test_a_repeat_that_is_none(tmp_path: Path) -> None:
    for seed, name in enumerate("ab"):
        write(tmp_path / f"{name}.csv", recording(5.0, seed=seed))
    (tmp_path / "dataset.toml").write_text("[trials.b]\nrepeat_of = 'a'")
    assert "correct repeat_of" in only_fix(load(tmp_path)[1]).statement


def test_a_repeat_that_was_set_up_otherwise(tmp_path: Path) -> None:
    for name, seed in ("a", 0), ("b", 1):
        columns = recording(5.0, noise=0.0)
        noise = np.random.default_rng(seed).standard_normal(columns["time_s"].size)
        columns["joint_torque_nm"] += 0.02 * noise
        write(tmp_path / f"{name}.csv", columns)
    toml = "[trials.b]\nrepeat_of = 'a'\n{} = 1.0\n[trials.a]\n{} = {}"
    for what in ("pretension", "tilt"):
        (tmp_path / "dataset.toml").write_text(toml.format(what, what, 0.5))
        told = only_fix(load(tmp_path)[1]).statement
        assert f"another {what}" in told and "correct repeat_of" in told
        (tmp_path / "dataset.toml").write_text(toml.format(what, what, 1.0))
        assert not [each for each in load(tmp_path)[1] if "repeat of" in each.statement]
    for unsaid in "pretension = 80.0", "tilt = 0.0":
        same = f"[trials.b]\nrepeat_of = 'a'\n{unsaid}"
        (tmp_path / "dataset.toml").write_text(same)
        assert not [each for each in load(tmp_path)[1] if "repeat of" in each.statement]


@given(length=st.floats(60.0, 400.0))
def test_period_of_a_motion(length: float) -> None:
    angle = np.sin(2.0 * np.pi * np.arange(1500) / length)
    assert find_period(angle) == pytest.approx(length, rel=2e-3)
    assert find_period(np.random.default_rng(0).standard_normal(500).cumsum()) is None


def test_a_swing_that_grows_does_not_repeat_itself(tmp_path: Path) -> None:
    columns = recording(noise=0.0)
    now = columns["time_s"]
    for name in list(columns)[1:]:
        columns[name] = (1.0 + 0.05 * now) * np.sin(2.0 * np.pi * 0.5 * now)
    assert not repeat_scatter(loaded(tmp_path, columns)[0].trials, JOINT).deviation
    for name in list(columns)[1:]:
        columns[name] = np.sin(2.0 * np.pi * 0.5 * now)
    columns["joint_torque_nm"] += 0.02 * np.random.default_rng(3).normal(size=now.size)
    found = repeat_scatter(loaded(tmp_path, columns)[0].trials, JOINT)
    assert found.deviation == pytest.approx(0.02, rel=0.1)
