"""Scores measure what they are called, and only what is unsafe has failed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cc_mujoco.benchmark import SCORES
from cc_mujoco.benchmark.scores import Limits, score

LIMITS = Limits(torque=2.0, strength=100.0, pull_pull=True)


def episode(samples: int = 4000) -> dict[str, np.ndarray]:
    """A spring rendered perfectly by a motor that turns smoothly."""
    time = np.arange(samples) / 1000.0
    angle = 0.5 * np.sin(2.0 * math.pi * time)
    return {
        "time_s": time,
        "joint_angle_rad": angle,
        "joint_torque_nm": -angle,
        "desired_torque_nm": -angle,
        "motor_torque_nm": np.full(samples, 0.3),
        "slack": np.zeros((samples, 2), dtype=np.bool_),
        "tension_n": np.full((samples, 4), 10.0),
    }


def scored(
    spring: bool = True, limits: Limits = LIMITS, **changes: np.ndarray
) -> dict[str, float]:
    return score(episode() | changes, spring=spring, period=0.001, limits=limits)


def test_scores_of_a_perfect_episode() -> None:
    found = scored()
    assert set(found) == {s.name for s in SCORES}
    for name in ("rms_error", "peak_error", "lag", "backlash", "slack", "failed"):
        assert found[name] == pytest.approx(0.0, abs=1e-9)
    assert found["effort"] == pytest.approx(0.3)
    assert found["chatter"] == pytest.approx(0.0, abs=1e-12)


def test_scores_measure_what_they_are_called() -> None:
    torque = episode()["joint_torque_nm"]
    for shift in (20, -20):
        late = scored(joint_torque_nm=np.roll(torque, shift))
        assert late["lag"] == pytest.approx(shift, abs=0.5)
    off = scored(joint_torque_nm=torque + 0.1)
    assert off["rms_error"] == pytest.approx(0.1)
    assert off["peak_error"] == pytest.approx(0.1)
    rubbed = torque + 0.1 * np.sign(np.gradient(torque))
    assert scored(joint_torque_nm=rubbed)["backlash"] == pytest.approx(0.2, rel=0.05)
    rough = rubbed + 0.3 * (-1.0) ** np.arange(4000)
    assert scored(joint_torque_nm=rough)["backlash"] == pytest.approx(0.2, rel=0.05)
    rough = scored(motor_torque_nm=0.3 + 0.1 * (-1.0) ** np.arange(4000))
    assert rough["chatter"] == pytest.approx(0.1, rel=0.05)
    assert math.isnan(scored(False)["backlash"])


def test_slack_is_a_score_and_no_failure() -> None:
    one = np.zeros((4000, 2), dtype=np.bool_)
    one[:1000, 0] = True
    assert scored(slack=one)["slack"] == 0.0
    both = np.repeat(one[:, :1], 2, axis=1)
    assert scored(slack=both)["slack"] == pytest.approx(0.25)
    alone = Limits(2.0, 100.0, pull_pull=False)
    # Of a sine, 6.4 % of the time asks for less than a tenth of the most.
    found = scored(limits=alone, slack=one)
    assert found["slack"] == pytest.approx(0.25 * 0.936, abs=0.005)
    assert found["failed"] == 0.0


def test_only_what_is_unsafe_or_diverged_has_failed() -> None:
    torque = episode()["joint_torque_nm"]
    for width, failed in ((9, 0.0), (10, 1.0)):
        thrown = torque.copy()
        thrown[500 : 500 + width] = -2.1
        assert scored(joint_torque_nm=thrown)["failed"] == failed
    torn = np.full((4000, 4), 10.0)
    torn[7, 2] = 100.1
    assert scored(tension_n=torn)["failed"] == 1.0
    lost = torque.copy()
    lost[2000:] = math.nan
    found = scored(joint_torque_nm=lost)
    assert found["failed"] == 1.0
    assert math.isnan(found["rms_error"])
