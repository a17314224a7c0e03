"""Friction by the update law that the thesis proposes."""

from __future__ import annotations

import numpy as np
import pytest

from cc_mujoco.device import Sensors
from estimation.runs import CABLE, Run, played, strokes
from thesis.estimators._parameters import SlopeLaw

EVERY = Sensors.everywhere(CABLE, 1.0)
MU = CABLE.friction


@pytest.fixture(scope="module")
def run() -> Run:
    return played(CABLE, strokes(6.0))


def steps(law: SlopeLaw, run: Run, slip_direction: int) -> np.ndarray:
    """Return the law's correction of mu_0 in each sample of mass motion this way."""
    whole = np.all(run.direction == slip_direction, axis=1)
    found = [
        law.update(*row)
        for row in zip(run.tension[whole], run.direction[whole], strict=True)
    ]
    return np.array(found) - 2.0 * MU


def test_printed_law_corrects_one_way_and_spoils_the_other(run: Run) -> None:
    printed = SlopeLaw(CABLE, EVERY, -1e-4, start=2.0 * MU)
    slip_direction = [np.sign(np.mean(steps(printed, run, w))) for w in (-1, 1)]
    assert slip_direction[0] == -slip_direction[1] != 0.0
    turned = SlopeLaw(CABLE, EVERY, 1e-4, start=2.0 * MU, signed=True)
    assert np.all(steps(turned, run, -1) <= 0.0)
    assert np.all(steps(turned, run, 1) <= 0.0)


def test_signed_and_integrated_law_ends_near_the_truth(run: Run) -> None:
    law = SlopeLaw(CABLE, EVERY, 3e-5, start=2.0 * MU, signed=True, integrated=True)
    for row in zip(run.tension, run.direction, strict=True):
        law.update(*row)
    assert law.friction == pytest.approx(MU, rel=0.06)
