"""Location of an error: the first sentence names the torque and the structure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cc_mujoco.diagnosis import Diagnosis, Options, run_inference
from cc_mujoco.diagnosis._phrases import VERDICT_MEANINGS, tried_sentence
from cc_mujoco.diagnosis._report.sections import next_steps
from diagnosis.inference.test_trial_trends import day
from diagnosis.recorded import BENCH, dataset
from study_marks import study_but

IDS = ("motor_inertia",)


def rippled(side: str, by_torque: bool) -> Diagnosis:
    """Return a diagnosis of trials in which one torque has a ripple, 16 per turn."""
    data = dataset(duration=3.0, seed=3, chosen=(0, 2))
    trials = []
    for trial in data.trials:
        torque = np.asarray(getattr(trial, f"{side}_torque"))
        phase = 16.0 * getattr(trial, f"{side}_angle") + 0.4
        more = 0.2 * (torque if by_torque else 1.0) * np.cos(phase)
        trials.append(replace(trial, **{f"{side}_torque": torque + more}))
    return run_inference(
        replace(data, trials=tuple(trials)), BENCH, Options(IDS)
    ).diagnosis


@pytest.mark.parametrize(
    ("side", "by_torque"), study_but(2, [("motor", True), ("joint", False)])
)
def test_the_first_sentence_names_torque_period_and_amplitude(
    side: str, by_torque: bool
) -> None:
    found = rippled(side, by_torque)
    assert found.verdict == "unknown", found.statement
    first, second = found.where[:2]
    assert first.channel == second.channel == f"{side}_torque_nm"
    assert f"The error is in the {side} torque only" in first.statement
    assert f"periodic in the {side} angle, 16 per turn" in first.statement
    amplitude = "proportional to the torque" if by_torque else "the same at every"
    assert amplitude in first.statement
    assert second.axis == f"{side} angle" and second.share_of_error > 0.5
    assert first.statement in str(next_steps(found))


def test_friction_that_falls_from_trial_to_trial_is_the_first_sentence() -> None:
    data = day([1.3, 1.15, 1.0, 0.85, 0.7])
    found = run_inference(data, BENCH, Options(IDS)).diagnosis
    assert found.verdict == "unknown", found.statement
    first, second = found.where[:2]
    assert "The error is in both torques" in first.statement
    assert "falls steadily from trial to trial" in first.statement
    assert "degrees of freedom, p =" in second.statement


def test_an_offset_beyond_what_is_tuned_is_told_as_a_constant() -> None:
    data = dataset(duration=2.0, seed=3, chosen=(0, 2))
    trials = tuple(
        replace(trial, joint_torque=np.asarray(trial.joint_torque) + 2.0)
        for trial in data.trials
    )
    found = run_inference(replace(data, trials=trials), BENCH, Options(IDS)).diagnosis
    first, second = found.where[:2]
    assert "it is nearly constant, measured minus simulated motor" in first.statement
    assert "and joint torque +" in first.statement
    assert second.axis == "all data" and second.share_of_error > 0.5


def test_nothing_is_claimed_of_a_rig_that_is_as_its_scene() -> None:
    found = run_inference(
        dataset(duration=1.0, seed=3, chosen=(0, 2)), BENCH, Options(IDS)
    ).diagnosis
    assert found.verdict == "none"
    assert "No torque is far off" in found.where[0].statement
    for word in ("periodic", "constant"):
        assert all(word not in each.statement for each in found.where)
    assert all("trial to trial" not in each.statement for each in found.where)


def test_no_step_is_empty_and_no_effect_tried_that_was_not() -> None:
    nothing = Diagnosis("unknown", "Something is missing.", runner_ups=((),))
    assert "Where to look: </strong>No quantity" in str(next_steps(nothing))
    assert "none was refitted" in tried_sentence(nothing)
    assert tried_sentence(Diagnosis("fix-data", "A fault.")) == ""
    assert "tried" not in VERDICT_MEANINGS["unknown"]
