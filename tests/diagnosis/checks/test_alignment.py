"""One clock or two: drift and delay between the sides."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.datasets._data_findings import errors
from cc_mujoco.diagnosis._checks.mechanics import check_alignment
from diagnosis.bench import RATIO, loaded, one, recording


@pytest.mark.parametrize(("rate", "seconds"), [(1.01, 20.0), (0.99, 40.0)])
def test_clocks_that_drift_apart(tmp_path: Path, rate: float, seconds: float) -> None:
    told = 0
    for seed in range(5):
        columns = recording(seconds, seed=seed)
        now = columns["time_s"]
        for name in ("joint_angle_rad", "joint_torque_nm"):
            columns[name] = np.interp(now * rate, now, columns[name])
        found = errors(loaded(tmp_path, columns)[1])
        told += any("two clocks" in finding.statement for finding in found)
    # A motion that is nearly periodic can hide a drift of a period.
    assert told >= 4


def test_a_sweep_is_not_a_drifting_clock(tmp_path: Path) -> None:
    columns = recording(40.0)
    now = columns["time_s"]
    phase = 2.0 * np.pi * (0.2 * now + 0.03 * now**2)
    columns["motor_angle_rad"] = RATIO * np.sin(phase)
    reach = 0.05
    here, joint = 0.0, np.empty_like(now)
    for k, wanted in enumerate(np.sin(phase)):
        here = min(max(here, wanted - reach), wanted + reach)
        joint[k] = here
    columns["joint_angle_rad"] = joint
    columns["joint_torque_nm"] = 2.0 * joint
    columns["motor_torque_nm"] = (5.0 * (np.sin(phase) - joint) + 2 * joint) / RATIO
    one(tmp_path, columns)


def test_a_delay_that_no_rig_has(tmp_path: Path) -> None:
    columns = recording()
    columns["joint_angle_rad"] = np.roll(columns["joint_angle_rad"], 200)
    found = errors(loaded(tmp_path, columns)[1])
    assert any("declare its delay" in finding.statement for finding in found)


def test_a_motor_on_a_lone_cable_may_move_on_its_own(tmp_path: Path) -> None:
    columns = recording()
    columns["joint_angle_rad"] = np.roll(columns["joint_angle_rad"], 200)
    (trial,) = loaded(tmp_path, columns)[0].trials
    (found,) = check_alignment(trial, alone=True)
    assert found.severity == "warning" and "slack" in found.statement
    assert "declare its delay" in check_alignment(trial)[0].statement
