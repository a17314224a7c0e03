"""Policies on rigs by other equations."""

from __future__ import annotations

import math
from pathlib import Path

import learned
import numpy as np
import pytest

from cc_mujoco.control import Network, read_policy, write_policy
from cc_mujoco.device import Observed
from cc_mujoco.device._sensors import MEASURED_COLUMNS
from cc_mujoco.errors import CableError

UNITS = (0.02, 2.0, 0.5, 2.0, 1.0, 1.0)


def policy(path: Path, device: str, gain: float) -> str:
    """Return the file of a policy: a gain on the torque error plus feedforward."""
    observed = Observed(device, MEASURED_COLUMNS[:6], UNITS, 1.0, 1e-3, 10.0, hold=5)
    weights = np.array([[0.0, 0.0, 0.0, 0.0, gain, 0.1]])
    network = Network(
        (weights,), (np.zeros(1),), "tanh", False, np.zeros(6), np.ones(6)
    )
    name = str(path / "policy.safetensors")
    write_policy(name, network, observed)
    return name


@pytest.mark.study
def test_a_policy_plays_a_rig_in_the_period_and_torque_of_its_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learned, "SECONDS", 3.0)
    found = {}
    for gain in (0.0, 0.1):
        name = policy(tmp_path, "bench", gain)
        law = learned.law_of(name)
        assert law.drive.period == read_policy(name)[1][0].period == 1e-3
        found[gain] = learned.played(name, "none", 1)
        assert found[gain]["outcome"] == "the 3 s are over."
    # What is asked, at ten newton metres for an action of 1, and no more: friction
    # takes a part of it; feedback of what is lacking gets some back.
    assert 0.3 < found[0.1]["rms"] < found[0.0]["rms"] < 2.5
    assert 0.0 < found[0.0]["chatter"] < 0.2


def test_a_policy_of_another_device_is_told_how_one_is_trained(tmp_path: Path) -> None:
    with pytest.raises(CableError, match=r"learnt on the device wrist.*--scene bench"):
        learned.law_of(policy(tmp_path, "wrist", 0.0))


def test_chatter_is_what_is_faster_than_fifty_milliseconds() -> None:
    period = 1e-3
    times = period * np.arange(round(learned.SECONDS / period))
    slow = 2.0 * np.sin(2.0 * math.pi * 0.5 * times)
    fast = 0.3 * np.sin(2.0 * math.pi * 100.0 * times)
    assert learned.chatter(slow, period) < 0.01
    wanted = 0.3 / math.sqrt(2.0)
    assert learned.chatter(slow + fast, period) == pytest.approx(wanted, rel=0.01)


def test_what_stopped_is_counted_beside_the_mean_of_what_did_not() -> None:
    rows = [
        {"controller": "pi", "effect": "none", "rms": 1.0, "chatter": 0.1, "peak": 1.0},
        {
            "controller": "pi",
            "effect": "none",
            "rms": math.nan,
            "chatter": math.nan,
            "peak": math.nan,
        },
        {
            "controller": "pi",
            "effect": "friction",
            "rms": 3.0,
            "chatter": 0.3,
            "peak": 1.0,
        },
    ]
    assert learned.cell(rows, "pi", "rms", "none") == "1000 (1 of 2 stopped)"
    assert learned.cell(rows, "pi", "rms") == "2000 (1 of 3 stopped)"
    text = learned.summary(rows, ["pi"])
    assert "| friction | 3000 |" in text
    assert "| chatter | 200 (1 of 3 stopped) |" in text
