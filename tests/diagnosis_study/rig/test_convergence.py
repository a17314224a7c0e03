"""Shorter steps and more nodes change less than the sensors can show."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.dataset import run, truth_of
from rig.nominal import Rig
from rig.sensors import BASIC, CHANNELS, sampled
from rig.trials import Trial

FLOORS = np.array([CHANNELS[name].floor for name in BASIC])


def seen(
    rig: Rig, trial: Trial, effects: dict[str, float], nodes: int = 12, refine: int = 1
) -> NDArray[np.float64]:
    """Noise-free samples over the noise floors."""
    truth = truth_of(rig, effects, seed=3, nodes=nodes)
    records = run(truth, rig, trial, refine)
    return sampled(records, rig, truth.chain, BASIC) / FLOORS


def rms(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


@pytest.mark.parametrize(
    "effects",
    [
        {},
        pytest.param({"stribeck_friction": 0.15}, marks=pytest.mark.study),
        pytest.param({"dwell_dependent_stiction": 0.2}, marks=pytest.mark.study),
        pytest.param({"asymmetric_friction": 0.15}, marks=pytest.mark.study),
        {"backlash": 0.004},
    ],
)
def test_half_the_step_changes_a_tenth_of_the_noise_at_most(
    rig: Rig, dwelling: Trial, effects: dict[str, float]
) -> None:
    change = seen(rig, dwelling, effects) - seen(rig, dwelling, effects, refine=2)
    assert rms(change).max() < 0.1
    # Across the rests too, where chatter would release friction bit by bit.
    ends = np.abs(change[-100:]).max(axis=0)
    assert ends.max() < 0.1


def test_half_the_step_at_the_fastest_rung(rig: Rig, ladder: Trial) -> None:
    change = seen(rig, ladder, {}) - seen(rig, ladder, {}, refine=2)
    assert rms(change).max() < 0.1


def test_more_nodes_change_less_and_less(rig: Rig, dwelling: Trial) -> None:
    finest = seen(rig, dwelling, {}, nodes=32, refine=2)
    errors = [
        rms(seen(rig, dwelling, {}, nodes=nodes) - finest).max()
        for nodes in (6, 12, 20)
    ]
    assert errors[2] < 0.6 * errors[1] < 0.4 * errors[0]
    assert errors[1] < 0.3
