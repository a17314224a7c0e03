"""What the tests of the rig share."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.dataset import make_trials
from rig.nominal import Rig, make_rig
from rig.trials import Trial

SCRIPTS = Path(__file__).parents[3] / "scripts" / "diagnosis_study"


@pytest.fixture
def scripts() -> Path:
    return SCRIPTS


@pytest.fixture
def rig() -> Rig:
    return make_rig(seed=3)


def cut(trial: Trial, seconds: float) -> Trial:
    """The first seconds of a trial, after its lead-in."""
    rows = round(1000 * (seconds + 0.6)) + 1
    return dataclasses.replace(
        trial, command=trial.command[:rows], target=trial.target[:rows]
    )


@pytest.fixture(scope="session")
def shortened() -> Callable[[Trial, float], Trial]:
    return cut


@pytest.fixture
def dwelling() -> Trial:
    """Moves with rests between them, of motor and hand."""
    return cut(make_trials("rich", seed=3)[2], 3.0)


@pytest.fixture
def ladder() -> Trial:
    """Slow to fast against a spring."""
    return make_trials("rich", seed=3)[0]


@pytest.fixture(scope="session")
def lively() -> Trial:
    """Motor and hand on multisines."""
    return cut(make_trials("rich", seed=3)[1], 1.5)


@pytest.fixture(scope="session")
def reversing() -> Trial:
    """Up to high torque with many reversals on the way."""
    return cut(make_trials("rich", seed=3)[4], 2.5)
