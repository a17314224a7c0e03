"""Occasions: folders that were given together, and `occasion` of `[trials]`."""

from __future__ import annotations

from pathlib import Path

import pytest

from cc_mujoco.datasets._data_findings import errors
from cc_mujoco.diagnosis import load
from cc_mujoco.errors import CableError
from diagnosis.recorded import DT, motions


def folder_of(place: Path, toml: str = "", seed: int = 0) -> Path:
    """Write one trial of a second to a folder."""
    place.mkdir()
    motor, joint = motions(2.0, seed)[0]
    rows = [
        f"{DT * k:.3f},{m:.6f},{j:.6f},{0.1 + m:.6f},{j:.6f}"
        for k, (m, j) in enumerate(zip(motor, joint, strict=True))
    ]
    head = "time_s,motor_angle_rad,joint_angle_rad,motor_torque_nm,joint_torque_nm"
    (place / "run.csv").write_text("\n".join([head, *rows]) + "\n")
    if toml:
        (place / "dataset.toml").write_text(toml)
    return place


def test_two_folders_are_two_occasions_and_one_folder_is_none(tmp_path: Path) -> None:
    march, june = folder_of(tmp_path / "march"), folder_of(tmp_path / "june", seed=1)
    both, _ = load([march, june])
    assert [trial.facts.occasion for trial in both.trials] == ["march", "june"]
    alone, _ = load([march])
    pooled, _ = load([march, june / "run.csv"])
    assert {trial.facts.occasion for trial in alone.trials + pooled.trials} == {""}


def test_each_occasion_is_read_by_its_own_dataset_file(tmp_path: Path) -> None:
    march = folder_of(tmp_path / "march", "[trials.run]\npretension = 80\n")
    june = folder_of(tmp_path / "june", "[trials.run]\npretension = 60\n", seed=1)
    both, _ = load([march, june])
    assert [trial.name for trial in both.trials] == ["march/run", "june/run"]
    assert [trial.facts.pretension for trial in both.trials] == [80.0, 60.0]


def test_constants_that_differ_between_occasions_are_refused(tmp_path: Path) -> None:
    march = folder_of(tmp_path / "march", "[rig]\nmotor_radius = 0.05\n")
    june = folder_of(tmp_path / "june", "[rig]\nmotor_radius = 0.06\n", seed=1)
    with pytest.raises(CableError, match="motor_radius of occasion 'march'"):
        load([march, june])


def test_an_occasion_of_some_trials_only_is_an_error(tmp_path: Path) -> None:
    place = folder_of(tmp_path / "all", '[trials.run]\noccasion = "March"\n')
    other = folder_of(tmp_path / "other", seed=1) / "run.csv"
    other.rename(place / "other.csv")
    _, findings = load([place])
    assert "has no occasion" in errors(findings)[0].statement
