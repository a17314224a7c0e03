"""A controller on the rig with guides, in a hand that holds its joint loosely."""

from __future__ import annotations

from pathlib import Path

import closed_loop
import numpy as np
import pytest

from cc_mujoco.hardware import drive_of
from rig.nominal import make_rig

SECONDS = 5.0


@pytest.mark.study
def test_predictive_does_not_turn_at_each_step_of_a_joint_that_follows_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(closed_loop, "SECONDS", SECONDS)
    case = closed_loop.Case("none", 2, 4.0, tmp_path)
    found = case.error("predictive", "bench", "run")
    # 0.26 and 0.17 N m while the joint was taken for led, whatever it felt.
    assert found["rms"] < 0.15
    assert found["between"] < 0.08
    log = np.genfromtxt(tmp_path / "run" / "log.csv", delimiter=",", names=True)
    assert np.ptp(log["joint_angle_rad"]) > 0.3


@pytest.mark.study
def test_predictive_does_not_swing_where_friction_builds_up_otherwise_than_it_believes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It did with 5.6 N m, while it kept a model with bristles that erred more."""
    monkeypatch.setattr(closed_loop, "SECONDS", SECONDS)
    case = closed_loop.Case("none", 1, 4.0, tmp_path)
    case.hidden = {"presliding": 1.2e-4}  # as `calibrate` finds it for R = 4
    found = case.error("predictive", "bench", "run")
    assert found["rms"] < 1.0
    assert found["between"] < 0.1


def test_the_true_model_of_the_nominal_rig_is_the_scene(tmp_path: Path) -> None:
    drive = drive_of("bench", tmp_path, 1e-3, 10.0)
    told = closed_loop.true_drive(make_rig(0, spread=0.0, make="guides"), drive)
    for known, own in zip(told.cables, drive.cables, strict=True):
        assert known.cable.scalars == own.cable.scalars
        assert known.cable.wrap == pytest.approx(own.cable.wrap, rel=1e-12)
        assert (known.proximal, known.distal) == (own.proximal, own.distal)
    assert told.ratio == drive.ratio
    assert told.inertia == pytest.approx(drive.inertia, rel=0.02)
    assert told.joint_inertia == pytest.approx(drive.joint_inertia, rel=0.02)
    other = closed_loop.true_drive(make_rig(1, make="guides"), drive)
    assert other.cables[0].cable.friction != drive.cables[0].cable.friction


def test_what_is_beyond_a_floor_is_told_beside_the_error() -> None:
    errors = {"rms": 0.5, "between": 0.2}, {"rms": 0.4, "between": 0.1}
    record = {
        "effect": "presliding", "seed": 1, "strength": 4.0, "verdict": "named",
        "named": ["presliding"], "ties": [], "before": {"pi": errors[0]},
        "after": {"pi": errors[1]},
    }  # fmt: skip
    floors = {"pi-1": {"rms": 0.4, "between": 0.1}}
    row = closed_loop.told([record], floors).splitlines()[-1]
    assert "| 500 to 400 (1.2) | 400 | 300 to 0 | 200 to 100 (2.0) |" in row
    said = closed_loop.counted([record], floors)
    assert "beyond the floor falls to a third or less in 1 of 1" in said
