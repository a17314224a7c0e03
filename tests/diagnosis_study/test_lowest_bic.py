"""BIC on refits by simulation, and its comparison with the diagnosis."""

from __future__ import annotations

from typing import Any

import numpy as np
from diagnose_benchmark import bic, summary

from cc_mujoco.diagnosis import BaselineFit, CrossValidation, Problem, Record, fit
from cc_mujoco.diagnosis._rig.simulation import SimulatedRig, baseline_parameters
from diagnosis.recorded import BENCH, motions

DT = 0.004
NOISE = 0.02
IDS = ("viscous_friction", "joint_gravity", "motor_inertia")

Array = np.ndarray


def record(motor: Array, joint: Array, measured: Array) -> Record:
    """Return a record of these signals; its first samples do not count."""
    return Record(
        trial="one",
        dt=DT,
        step=DT,
        time=DT * np.arange(motor.size),
        motor_angle=motor,
        joint_angle=joint,
        read=np.array([motor, joint]),
        measured=measured,
        band=25.0,
        counts=np.arange(motor.size) >= 100,
        pretension=None,
        start=0.0,
        split=None,
        group="one",
    )


def tuned(**hidden: float) -> BaselineFit:
    """Return the baseline tuned to a trial with hidden effects of one parameter."""
    motor, joint = (angle - angle[0] for angle in motions(4.0, 0)[2])
    plant = SimulatedRig(BENCH, (record(motor, joint, np.zeros((2, motor.size))),), 4)
    measured = plant.simulate(hidden, tuple(hidden))[0]
    measured += NOISE * np.random.default_rng(1).standard_normal(measured.shape)
    seen = record(motor, joint, measured)
    floor = (np.full(measured.shape, NOISE),)
    free = baseline_parameters(BENCH, (seen,), {})
    problem = Problem(plant.limited([seen]), free, (), floor, floor)
    found = fit(problem, np.zeros(len(free)), [seen.counts])
    return BaselineFit(problem, found, CrossValidation(problem, (found,), ()), 0.0)


def test_the_hidden_effect_has_the_lowest_bic() -> None:
    guess = bic(tuned(viscous_friction=60.0), ids=IDS)
    assert guess.named == "viscous_friction"
    assert set(guess.ranking) == set(IDS)
    assert guess.share > 0.5


def test_parameters_have_their_price() -> None:
    guess = bic(tuned(), ids=IDS)
    assert guess.named is None
    assert abs(guess.share) < 0.02


def case(
    seed: int, kind: str, hidden: str, guessed: str | None, misfit: float = 3.0
) -> dict[str, Any]:
    """Return a case whose effect the diagnosis does not name."""
    return {
        "make": "guides", "protocol": "bare", "strength": 4.0, "seed": seed,
        "kind": kind, "hidden": hidden or "none", "trials": "rich", "misfit": misfit,
        "effects": [hidden] if hidden else [], "closed": 0.5,
        "steps": [{"named": [], "verdict": "none", "ties": []}], "proposed": [""],
        "odds": [0.9], "intervals": {}, "bic": {"named": guessed},
        "event": {"found": True, "kinds": [], "late": 0.0},
        "learned": {"before": 5.0, "after": 2.0, "closed": 0.0, "curves": "",
                    "formulas": ""},
    }  # fmt: skip


def test_the_table_counts_what_both_said_of_the_same_cases() -> None:
    guesses = [
        ("named", "backlash", "backlash"),
        ("named", "backlash", None),
        ("named", "presliding", "backlash"),
        ("none", "", "backlash"),
        ("none", "", None),
        ("unknown", "unknown_reflex", "viscous_friction"),
    ]
    text = summary([case(seed, *guess) for seed, guess in enumerate(guesses)])
    row = "| named, motions alone | 4 | 3 | 0 | 0 (0 to 71 %) | 0 | 0 | 3 | 0 | 1 | 1 |"
    assert row in text
    assert "| none, motions alone | 4 | 2 | 2 | 2 (16 to 100 %) |" in text
    found = {row.split(" | ")[0]: row.split(" | ")[-2:] for row in text.splitlines()}
    assert found["| none, motions alone"] == ["1", "1 |"]
    assert found["| unknown, motions alone"] == ["0", "1 |"]


def test_the_lowest_bic_names_nothing_near_the_floor() -> None:
    text = summary([case(1, "none", "", "backlash", 1.2)])
    row = "| none, motions alone | 4 | 1 | 1 | 1 (3 to 100 %) | 0 | 0 | 0 | 0 | 1 | 0 |"
    assert row in text
