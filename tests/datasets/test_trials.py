"""Trials and datasets as values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cc_mujoco.datasets import Dataset, Trial
from cc_mujoco.errors import CableError
from diagnosis.bench import recording


def trial(name: str = "one", **more: object) -> Trial:
    columns = recording(2.0)
    made = Trial(
        name=name,
        time=columns["time_s"],
        motor_angle=columns["motor_angle_rad"],
        motor_torque=columns["motor_torque_nm"],
        joint_angle=columns["joint_angle_rad"],
        joint_torque=columns["joint_torque_nm"],
        segments=(slice(0, 400), slice(500, 1000)),
        step=0.002,
        path="data/one.csv",
        labels={"motor_angle_rad": "theta"},
    )
    return replace(made, **more)  # type: ignore[arg-type]


def test_only_valid_samples_count() -> None:
    assert trial().samples == 900
    assert trial().duration == pytest.approx(1.8)
    assert trial().rate == pytest.approx(500.0)


def test_channels_are_found_by_name() -> None:
    tension = np.full(1000, 12.0)
    made = trial(tensions={"tension_flexor_proximal_n": tension})
    assert made.channel("joint_torque_nm") is made.joint_torque
    assert made.channel("tension_flexor_proximal_n") is tension
    assert made.channels[-1] == "tension_flexor_proximal_n"
    with pytest.raises(CableError, match="did you mean 'joint_torque_nm'"):
        made.channel("joint_torqe_nm")
    with pytest.raises(CableError, match="temperature_c"):
        made.channel("temperature_c")


def test_a_sentence_names_the_column_as_the_file_does() -> None:
    assert trial().column("motor_angle_rad") == "data/one.csv, column theta"
    assert trial().column("joint_angle_rad").endswith("column joint_angle_rad")


def test_a_dataset_has_the_channels_that_all_trials_have() -> None:
    tensions = {"tension_a_distal_n": np.ones(1000)}
    both = Dataset((trial(tensions=tensions), trial("two")))
    assert "tension_a_distal_n" not in both.channels
    assert both.channels == trial().channels
    assert Dataset(()).channels == ()
    assert both.trial("two").name == "two"
    with pytest.raises(CableError, match="unknown trial 'three'"):
        both.trial("three")
