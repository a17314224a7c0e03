"""What is proposed to separate rivals is what no tuning makes up for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cc_mujoco.diagnosis.inference.baseline import Tuning, tune
from cc_mujoco.diagnosis.inference.experiment import left_after_fit, propose
from cc_mujoco.diagnosis.inference.fitting import Problem
from cc_mujoco.diagnosis.inference.records import prepare
from diagnosis.recorded import BENCH, dataset


@pytest.fixture(scope="module")
def tuning() -> Tuning:
    data = dataset(duration=3.0)
    records, filtering = prepare(data, BENCH)
    return tune(data, BENCH, records, filtering, seed=0)


def rival(
    tuning: Tuning, name: str, values: dict[str, float]
) -> tuple[Problem, np.ndarray]:
    wider = tuning.problem.with_effect(name, values)
    return wider, wider.placed(tuning.whole.at, values)


def test_gravity_and_a_spring_part_where_the_joint_goes_further(tuning: Tuning) -> None:
    spring = rival(tuning, "joint_stiffness", {"joint_stiffness": 0.4})
    weight = rival(
        tuning, "joint_gravity", {"gravity_sine": 0.44, "gravity_cosine": 0.0}
    )
    found = propose([spring, weight], ["joint_stiffness", "joint_gravity"])
    assert found is not None
    assert "twice the range" in found.description
    assert "may not be enough" not in found.description
    assert found.separates == ("joint_stiffness", "joint_gravity")


def test_what_tuning_makes_up_for_separates_nothing(tuning: Tuning) -> None:
    """Two models that differ in a little friction are one model."""
    problem, at = rival(tuning, "joint_stiffness", {"joint_stiffness": 0.4})
    other = at.copy()
    other[problem.names.index("friction")] += 0.01
    plant = problem.plant
    (record, *_) = plant.records
    shown = [
        plant.limited([record]).simulate(problem.values(place), problem.effects)[0]
        for place in (at, other)
    ]
    noise = np.array([[0.02], [0.02]])
    apart = (shown[1] - shown[0]) / noise
    nothing = np.zeros((0, at.size))
    new = replace(record, measured=shown[0])
    left = left_after_fit(problem, at, new, noise, nothing, apart)
    assert np.linalg.norm(left) < 0.1 * np.linalg.norm(apart)
