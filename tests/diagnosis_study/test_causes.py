"""Causes with equal torques, each hidden in a rig of other equations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis import Diagnosis, infer
from rig.dataset import make_dataset, make_trials, run, truth_of
from rig.generate import facts_of, write_data
from rig.nominal import make_rig
from rig.sensors import BASIC, logged, sampled

pytestmark = pytest.mark.study
SETS = "rich_standard"
Array = np.ndarray


def hidden(folder: Path, seed: int, sticks: float = 0.0, **values: float) -> Diagnosis:
    """Return the diagnosis of a rig with guides that has these constants.

    Its joint's torque sensor moves in steps of more than `sticks` [N m].
    """
    rig = make_rig(seed, make="guides")
    truth = truth_of(rig, {}, seed).changed(**values)
    data = []
    for k, trial in enumerate(make_trials(SETS, seed)):
        signals = sampled(run(truth, rig, trial), rig, truth.chain, BASIC)
        shown = signals[:, BASIC.index("joint_torque")]
        for i in range(1, shown.size):
            if abs(shown[i] - shown[i - 1]) <= sticks:
                shown[i] = shown[i - 1]
        data.append(logged(signals, truth.chain, BASIC, [seed, seed, k]))
    return diagnosed(folder, data, seed)


def diagnosed(folder: Path, data: list[dict[str, Array]], seed: int) -> Diagnosis:
    write_data(folder / "data", data, facts_of(SETS, seed))
    return infer(Bench.of(scene_path("bench")), [folder / "data"])[0].diagnosis


@pytest.mark.parametrize(
    ("seed", "values", "name", "cause"),
    [
        (5014, {"adhesion": 0.6}, "tension_dependent_friction", "pressure"),
        (5015, {"opening": 0.35}, "tension_dependent_friction", "bends that open"),
        (5013, {"sag": 2e-3}, "cable_stiffening", "strands"),
        (5012, {"gap": 3e-4}, "cable_stiffening", "clearance"),
        (
            5022,
            {"joint_offcentre": 4e-3, "joint_phase": 0.7},
            "lever_geometry",
            "eccentric encoder of the joint",
        ),
        (
            5023,
            {"motor_offcentre": 4e-3, "motor_phase": 0.7},
            "pulley_eccentricity",
            "eccentric encoder of the motor",
        ),
    ],
)
def test_a_cause_is_among_those_of_the_class_that_is_named(
    tmp_path: Path, seed: int, values: dict[str, float], name: str, cause: str
) -> None:
    found = hidden(tmp_path, seed, **values)
    assert found.verdict in ("named", "tie"), found.statement
    assert found.missing[0].id == name, found.statement
    (own,) = [each for each in found.classes if each.name == name]
    assert any(cause in each for each in own.causes)
    assert cause in found.statement and own.separated_by in found.statement


def test_another_cable_on_the_joint_is_a_spring_and_friction_there(
    tmp_path: Path,
) -> None:
    seed, radius, pull, stiff, hold, grip = 5024, 0.04, 15.0, 8e3, 150.0, np.exp(0.5)
    data = make_dataset(make_rig(seed, make="guides"), {}, SETS, seed)
    for columns in data:
        wound = radius * columns["joint_angle_rad"]
        slip, torque = 0.0, np.empty(wound.size)
        for i, stretch in enumerate(wound - wound[0]):
            tension = pull + stiff * (stretch - slip)
            for factor in (grip, 1.0 / grip):  # slides where a limit is passed
                beyond = tension - factor * (pull + hold * slip)
                if beyond * (factor - 1.0) > 0.0:
                    slip += beyond / (stiff + factor * hold)
                    tension = pull + stiff * (stretch - slip)
            torque[i] = radius * max(tension, 0.0)
        columns["joint_torque_nm"] -= torque
    found = diagnosed(tmp_path, data, seed)
    assert found.verdict == "named", found.statement
    names = {each.id for each in found.missing}
    assert names == {"joint_stiffness", "joint_friction"}
    assert found.statement.count("another cable on the joint") == 2


def test_a_load_cell_that_sticks_is_unknown_at_the_joint(tmp_path: Path) -> None:
    found = hidden(tmp_path, 5020, sticks=0.25)
    assert found.verdict == "unknown", found.statement
    assert "in the joint torque only" in found.where[0].statement
