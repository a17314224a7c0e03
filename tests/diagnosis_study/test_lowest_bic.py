"""BIC on refits by simulation, and its comparison with the diagnosis."""

from __future__ import annotations

from typing import Any

import numpy as np
from diagnose_benchmark import bic, comparison

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


def case(kind: str, hidden: str, guessed: str | None) -> dict[str, Any]:
    """Return a case whose effect the diagnosis does not name."""
    return {
        "kind": kind,
        "hidden": [hidden] if hidden else [],
        "named": [],
        "verdict": "none",
        "bic": {"named": guessed},
    }


RECORDS = [
    case("named", "backlash", "backlash"),
    case("named", "backlash", None),
    case("named", "presliding", "backlash"),
    case("none", "", "backlash"),
    case("none", "", None),
    case("unknown", "unknown_reflex", "viscous_friction"),
]


def judge(record: dict[str, Any]) -> str:
    """Right, wrong or missed, by the first name."""
    if not record["named"]:
        return "missed"
    return "right" if record["named"] == record["hidden"] else "wrong"


def test_the_comparison_counts_what_both_said_of_the_same_cases() -> None:
    plain = {key: value for key, value in RECORDS[0].items() if key != "bic"}
    *_, diagnosis, guess = comparison([*RECORDS, plain], judge).splitlines()
    third = ["33% of 3"]
    assert [cell.strip() for cell in guess.strip("|").split("|")] == [
        "lowest BIC", *third, "0% of 3", *third, *third, "50% of 2", "100% of 1",
    ]  # fmt: skip
    assert "| 0% of 3 | 0% of 3 | 100% of 3 | 0% of 3 |" in diagnosis
