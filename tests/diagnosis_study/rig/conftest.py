"""Fixtures of the tests of the rig."""

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
    """Return the first seconds of a trial, after its lead-in."""
    rows = round(1000 * (seconds + 0.6)) + 1
    return dataclasses.replace(
        trial, command=trial.command[:rows], target=trial.target[:rows]
    )


@pytest.fixture(scope="session")
def shortened() -> Callable[[Trial, float], Trial]:
    return cut


@pytest.fixture
def dwelling() -> Trial:
    """Return motions of motor and hand with rests between the moves."""
    return cut(make_trials("rich", seed=3)[2], 3.0)


@pytest.fixture
def ladder() -> Trial:
    """Return a trial of rising speed against a spring."""
    return make_trials("rich", seed=3)[0]


@pytest.fixture(scope="session")
def lively() -> Trial:
    """Return a trial of multisines at motor and hand."""
    return cut(make_trials("rich", seed=3)[1], 1.5)


@pytest.fixture(scope="session")
def reversing() -> Trial:
    """Return a trial with many reversals on the way to high torque."""
    return cut(make_trials("rich", seed=3)[4], 2.5)
