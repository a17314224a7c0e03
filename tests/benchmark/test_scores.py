"""Scores measure what they are called, and only what is unsafe has failed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from cc_mujoco.benchmark import SCORES
from cc_mujoco.benchmark._cell import episode_scores
from cc_mujoco.metrics import ArrayLog

CABLES = ("flexor", "extensor")
ABOUT = {
    "safe_torque": 2.0,
    "strength": dict.fromkeys(CABLES, 100.0),
    "pull_pull": True,
    "spring": True,
}


def episode(samples: int = 4000) -> dict[str, np.ndarray]:
    """Return a spring rendered perfectly by a motor that turns smoothly."""
    time = np.arange(samples) / 1000.0
    angle = 0.5 * np.sin(2.0 * math.pi * time)
    return {
        "time_s": time,
        "joint_angle_rad": angle,
        "joint_torque_nm": -angle,
        "desired_torque_nm": -angle,
        "motor_torque_nm": np.full(samples, 0.3),
        **{f"tension_{c}_nodes_n": np.full((samples, 1), 10.0) for c in CABLES},
        **{f"tension_{c}_proximal_n": np.full(samples, 10.0) for c in CABLES},
        **{f"tension_{c}_distal_n": np.full(samples, 10.0) for c in CABLES},
    }


def scored(
    about: dict[str, Any] | None = None, **changes: np.ndarray
) -> dict[str, float]:
    return episode_scores(ArrayLog(episode() | changes, CABLES, ABOUT | (about or {})))


def test_scores_of_a_perfect_episode() -> None:
    found = scored()
    assert set(found) == {s.name for s in SCORES}
    motor = {"rms_motor_torque", "peak_motor_torque"}
    for name in set(found) - motor:
        assert found[name] == pytest.approx(0.0, abs=1e-9)
    for name in motor:
        assert found[name] == pytest.approx(0.3)
    assert found["chatter"] == pytest.approx(0.0, abs=1e-12)


def test_scores_measure_what_they_are_called() -> None:
    torque = episode()["joint_torque_nm"]
    for shift in (20, -20):
        late = scored(joint_torque_nm=np.roll(torque, shift))
        assert late["torque_lag"] == pytest.approx(1e-3 * shift, abs=5e-4)
    out_of_phase = scored(joint_torque_nm=np.gradient(torque))
    assert math.isnan(out_of_phase["torque_lag"])
    off = scored(joint_torque_nm=torque + 0.1)
    assert off["rms_torque_error"] == pytest.approx(0.1)
    assert off["peak_torque_error"] == pytest.approx(0.1)
    rubbed = torque + 0.1 * np.sign(np.gradient(torque))
    assert scored(joint_torque_nm=rubbed)["spring_backlash"] == pytest.approx(
        0.2, rel=0.05
    )
    rough = rubbed + 0.3 * (-1.0) ** np.arange(4000)
    assert scored(joint_torque_nm=rough)["spring_backlash"] == pytest.approx(
        0.2, rel=0.05
    )
    rough = scored(motor_torque_nm=0.3 + 0.1 * (-1.0) ** np.arange(4000))
    assert rough["chatter"] == pytest.approx(0.1, rel=0.05)
    assert math.isnan(scored({"spring": False})["spring_backlash"])


def test_slack_is_a_score_and_no_failure() -> None:
    hanging = np.where(np.arange(4000) < 1000, 0.0, 10.0)[:, None]
    one = {"tension_flexor_nodes_n": hanging}
    both = one | {"tension_extensor_nodes_n": hanging}
    assert scored(**one)["slack_under_load"] == 0.0
    assert scored(**both)["slack_under_load"] == pytest.approx(0.25)
    # Of a sine, 6.4 % of the time asks for less than a tenth of the most.
    found = scored({"pull_pull": False}, **one)
    assert found["slack_under_load"] == pytest.approx(0.25 * 0.936, abs=0.005)
    assert found["failed"] == 0.0


def test_only_what_is_unsafe_or_diverged_has_failed() -> None:
    torque = episode()["joint_torque_nm"]
    for width, failed in ((9, 0.0), (10, 1.0)):
        thrown = torque.copy()
        thrown[500 : 500 + width] = -2.1
        assert scored(joint_torque_nm=thrown)["failed"] == failed
    torn = np.full(4000, 10.0)
    torn[7] = 100.1
    assert scored(tension_extensor_proximal_n=torn)["failed"] == 1.0
    lost = torque.copy()
    lost[2000:] = math.nan
    found = scored(joint_torque_nm=lost)
    assert found["failed"] == 1.0
    assert math.isnan(found["rms_torque_error"])
