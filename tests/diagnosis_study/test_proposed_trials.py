"""The loop of proposed trials: cases, what a proposal asks of a rig, and rates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from diagnose_benchmark import (
    CELLS,
    Case,
    cases,
    is_alone,
    planned_trials,
    run,
    summary,
    word_of,
)

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis._propose.experiment import motions, trial_table
from cc_mujoco.diagnosis._report.output import write_proposed
from cc_mujoco.diagnosis._verdict import NextExperiment
from rig.makes import MAKES


def test_cases_take_makes_in_turn_and_hide_what_the_make_has() -> None:
    every = list(cases(("grease_drag", "none"), [*MAKES], (4.0, 2.0), ("bare",), 7, 2))
    assert {case.make for case in every if case.effects} == {"elements"}
    assert [case.make for case in every if not case.effects] == 2 * [
        "guides", "elements", "bristles",
    ]  # fmt: skip
    assert {case.seed for case in every} == {7, 8, 107, 108}
    assert Case("guides", "bare", "backlash+motor_cogging", 4.0, 1).kind == "pair"


def test_a_rig_plays_every_kind_of_proposed_trial(tmp_path: Path) -> None:
    played = []
    every = motions(Bench.of(scene_path("bench")), 0.8, 2.5)
    for motion in {motion.toml: motion for motion in every}.values():
        facts = tuple(trial_table("trial_08", motion, 80.0 * motion.pretension))
        named = ("trial_08",), facts
        planned = NextExperiment(motion.description, ("a", "b"), "", *named)
        write_proposed(tmp_path / "next", planned, [motion], "")
        ((trial, cell),), text = planned_trials(tmp_path / "next")
        assert trial.tightness == (motion.pretension or 1.0)
        assert trial.unhooked == (motion.pretension == 0.0)
        assert trial.tilt == pytest.approx(motion.tilt, abs=1e-3)
        assert trial.known_torques == motion.known_torques
        assert trial.swapped == motion.swapped and cell == motion.load_cell
        assert "trial_08" in text and cell in ("", *CELLS)
        assert np.ptp(trial.command[-30000:, 0]) == pytest.approx(
            np.ptp(motion.motor[-3750:]), rel=0.05, abs=1e-3
        )
        played.append(trial.load)
    assert set(played) == {"free", "locked", "human"} and len(played) >= 8


def test_rates_are_by_strength_and_failures_are_listed() -> None:
    tied = {"verdict": "tie", "named": [], "ties": [["joint_gravity", "b"]]}
    right = {"verdict": "named", "named": ["joint_gravity"], "ties": []}
    record = {
        "make": "guides", "protocol": "bare", "hidden": "joint_gravity",
        "strength": 4.0, "seed": 1, "kind": "named", "effects": ["joint_gravity"],
        "steps": [tied, right], "proposed": ["a", ""], "odds": [0.8, 0.95],
        "closed": 0.9, "intervals": {}, "trials": "rich",
        "event": {"found": True, "kinds": [], "late": 0.0},
    }  # fmt: skip
    wrong = {**record, "seed": 2, "steps": [{**right, "named": ["b"]}]}
    wrong |= {"proposed": [""], "odds": [0.95]}
    wrong |= {"event": {"found": False, "kinds": ["gain"], "late": 0.0}}
    text = summary([record, wrong])
    assert (
        "| named, motions alone | 4 | 2 | 0 | 1 (1 to 99 %) | 0 | 0 | 0 | 1 |" in text
    )
    assert (
        "joint_gravity | 4.0 | 2 |" in text and "joint_gravity | 4.0 | 1 |" not in text
    )
    assert "Events in rigs without one: 1 of 2 " in text
    assert "| 0.70 to 0.85 | 1 | 0.800 | 1.000 (3 to 100 %) |" in text
    assert "| 0.92 to 1.00 | 2 | 0.950 | 0.500 (1 to 99 %) |" in text


@pytest.mark.study
def test_a_rare_effect_is_asked_for_and_named() -> None:
    record = run("bristles", "bare", "current_ripple", 0.0, 820)
    (found,) = record["steps"]
    assert (found["verdict"], found["named"]) == ("named", ["current_ripple"])
    assert word_of(record, -1) == "right" and is_alone(record)
    value, low, high = found["values"]["ripple_order"]
    assert low <= 9.0 <= high and value == pytest.approx(9.0, rel=0.01)
