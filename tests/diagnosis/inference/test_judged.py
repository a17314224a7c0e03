"""The word for what a search found."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from cc_mujoco.diagnosis.inference.reason import judged
from cc_mujoco.diagnosis.inference.search import Thresholds
from cc_mujoco.diagnosis.verdict import Gap

GAP = {"motor_torque_nm": Gap(0.05, 0.04, 0.02, 0.43, (0.3, 0.5))}
CLOSED = {"motor_torque_nm": Gap(0.05, 0.025, 0.02, 0.89, (0.8, 0.95))}
ALIKE = ("stribeck_friction", "dwell_dependent_stiction")


def search(misfit: float, left: float, rivals: tuple[str, ...]) -> Any:
    """A search that went from one error over the floor to another."""
    return SimpleNamespace(
        before=SimpleNamespace(misfit=misfit),
        after=SimpleNamespace(misfit=left),
        rounds=(SimpleNamespace(rivals=rivals),),
    )


@pytest.mark.parametrize(
    ("left", "rivals", "verdict"),
    [
        (1.0, ALIKE[:1], "named"),
        (1.0, ALIKE, "tie"),
        (1.6, ALIKE[:1], "named"),
        (2.6, ALIKE[:1], "unknown"),
        (2.6, ALIKE, "unknown"),
        (1.2, ALIKE, "tie"),
    ],
)
def test_effects_that_leave_most_of_the_error_are_not_the_answer(
    left: float, rivals: tuple[str, ...], verdict: str
) -> None:
    problem: Any = SimpleNamespace(effects=rivals[:1])
    said, statement = judged(search(3.0, left, rivals), problem, GAP, Thresholds())
    assert said == verdict
    if verdict == "unknown":
        assert "28% of it" in statement


def test_an_effect_of_few_moments_closes_the_gap() -> None:
    problem: Any = SimpleNamespace(effects=ALIKE[:1])
    said, _ = judged(search(3.0, 2.6, ALIKE[:1]), problem, CLOSED, Thresholds())
    assert said == "named"


def test_little_error_is_within_what_effect_free_rigs_reach() -> None:
    problem: Any = SimpleNamespace(effects=ALIKE[:1])
    said, _ = judged(search(1.3, 1.24, ALIKE[:1]), problem, GAP, Thresholds())
    assert said == "named"
