"""A controller on the rig with guides, in a hand that holds its joint loosely."""

from __future__ import annotations

from pathlib import Path

import closed_loop
import numpy as np
import pytest

SECONDS = 5.0


def test_predictive_does_not_turn_at_each_step_of_a_joint_that_follows_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(closed_loop, "SECONDS", SECONDS)
    case = closed_loop.Case("none", 2, 4.0, tmp_path)
    found = case.error("predictive", "bench", "run")
    # 0.26 and 0.17 Nm while the joint was taken for led, whatever it felt.
    assert found["rms"] < 0.15
    assert found["between"] < 0.08
    log = np.genfromtxt(tmp_path / "run" / "log.csv", delimiter=",", names=True)
    assert np.ptp(log["joint_angle_rad"]) > 0.3
