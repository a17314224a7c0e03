"""Answers on an effect that has no name."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from cc_mujoco.datasets._dataset_file import read_dataset_file
from cc_mujoco.diagnosis._report.sections import (
    CABLE_ALONE,
    JOINT_ONLY,
    MOTOR_ONLY,
    four_answers,
    isolating_trial,
)
from cc_mujoco.diagnosis._verdict import Diagnosis, Gap, TrialError, Where


def gap(size: float) -> Gap:
    """Return the gap of a channel whose error is this many floors."""
    return Gap(size, size, 1.0, 0.0, (math.nan, math.nan))


def diagnosis(motor: float, joint: float, axis: str = "") -> Diagnosis:
    """Return an unknown verdict with these errors over the floor."""
    gaps = {"motor_torque_nm": gap(motor), "joint_torque_nm": gap(joint)}
    trials = tuple(
        TrialError(name, {}, {}, {}, size, size)
        for name, size in (("slow", 1.0), ("fast", 7.0), ("chirp", 2.0))
    )
    places = (Where("motor_torque_nm", axis, 0.4, "There."),) if axis else ()
    return Diagnosis("unknown", "Something.", gap=gaps, trials=trials, where=places)


def test_every_question_has_an_answer_that_names_end_trials_and_quantity() -> None:
    answers = dict(four_answers(diagnosis(8.0, 1.2, "motor angle")))
    assert "mostly at the motor's end" in answers["Which channel and end?"]
    assert answers["Which trials?"].startswith("Mostly in fast (94 %)")
    assert answers["Growing with what?"].startswith("Motor angle (40 %")
    assert "two different angles" in answers["What shows it alone?"]


@pytest.mark.parametrize(
    ("motor", "joint", "trial"),
    [(8.0, 1.2, MOTOR_ONLY), (1.2, 8.0, JOINT_ONLY), (5.0, 4.0, CABLE_ALONE)],
)
def test_without_a_quantity_the_trial_parts_the_ends(
    motor: float, joint: float, trial: str
) -> None:
    assert isolating_trial(diagnosis(motor, joint)) == trial


def test_where_nothing_was_compared_the_questions_are_answered_too() -> None:
    answers = four_answers(Diagnosis("unknown", "Nothing."))
    assert all(answer for _, answer in answers)


@pytest.mark.parametrize("advice", [MOTOR_ONLY, JOINT_ONLY, CABLE_ALONE])
def test_facts_of_an_advised_trial_can_be_declared(advice: str, tmp_path: Path) -> None:
    facts = re.findall(r"`(\w+ = [^`]+)`", advice)
    assert facts
    toml = tmp_path / "dataset.toml"
    toml.write_text("\n".join(["[trials.next]", *facts]), encoding="utf-8")
    assert read_dataset_file(toml).facts["next"]
