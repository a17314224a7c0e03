"""Long trials: averaged, then sampled all over."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from diagnosis.bench import RATIO, loaded, recording


def test_long_trials_are_averaged_quickly(tmp_path: Path) -> None:
    count = 500_000
    now = np.arange(count) / 5000.0
    angle = np.sin(now)
    columns = {
        "time_s": now,
        "motor_angle_rad": RATIO * angle,
        "motor_torque_nm": angle / RATIO + 0.02 * np.sign(np.cos(now)),
        "joint_angle_rad": angle,
        "joint_torque_nm": angle,
    }
    start = time.monotonic()
    dataset, findings = loaded(tmp_path, columns)
    assert time.monotonic() - start < 20.0
    (trial,) = dataset.trials
    assert trial.samples <= 120_000
    assert trial.joint_angle == pytest.approx(np.sin(trial.time), abs=1e-5)
    assert any("samples were averaged" in f.statement for f in findings)


def test_hours_at_a_low_rate_are_sampled_all_over(tmp_path: Path) -> None:
    columns = recording(600.0, 250.0)
    columns["joint_angle_rad"][70_000:70_100] = np.nan
    dataset, findings = loaded(tmp_path, columns)
    (trial,) = dataset.trials
    assert trial.samples > 50_000 and trial.rate == pytest.approx(250.0)
    for part in trial.segments:
        assert np.diff(trial.time[part]) == pytest.approx(0.004, abs=1e-9)
        assert np.isfinite(trial.joint_angle[part]).all()
    assert trial.time[-1] > 0.9 * 600.0 and trial.time[0] == 0.0
    assert any("evenly spread stretches" in f.statement for f in findings)
