"""Friction by the update law that the thesis proposes."""

from __future__ import annotations

import numpy as np
import pytest

from cc_mujoco.device import Sensors
from estimation.runs import CABLE, Run, played, strokes
from thesis._experiments.online import slope_law

EVERY = Sensors.everywhere(CABLE, 1.0)
MU = CABLE.friction


@pytest.fixture(scope="module")
def run() -> Run:
    return played(CABLE, strokes(6.0))


def steps(run: Run, slip_direction: int, gain: float, signed: bool) -> np.ndarray:
    """Return the law's correction of mu_0 in each sample of mass motion this way."""
    whole = np.all(run.direction == slip_direction, axis=1)
    rows = run.tension[whole], run.direction[whole]
    return slope_law(CABLE, EVERY, rows, gain, 2.0 * MU, signed=signed) - 2.0 * MU


def test_printed_law_corrects_one_way_and_spoils_the_other(run: Run) -> None:
    ways = [np.sign(np.mean(steps(run, way, -1e-4, False))) for way in (-1, 1)]
    assert ways[0] == -ways[1] != 0.0
    assert np.all(steps(run, -1, 1e-4, True) <= 0.0)
    assert np.all(steps(run, 1, 1e-4, True) <= 0.0)


def test_signed_and_integrated_law_ends_near_the_truth(run: Run) -> None:
    rows = run.tension, run.direction
    track = slope_law(CABLE, EVERY, rows, 3e-5, 2.0 * MU, signed=True, integrated=True)
    assert track[-1] == pytest.approx(MU, rel=0.06)
