"""What is proposed to separate rivals is what no tuning makes up for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cc_mujoco.diagnosis.inference.baseline import BaselineFit, fit_baseline, plant_of
from cc_mujoco.diagnosis.inference.experiment import left_after_fit, propose
from cc_mujoco.diagnosis.inference.fitting import Problem
from cc_mujoco.diagnosis.inference.records import prepare
from diagnosis.recorded import BENCH, dataset


@pytest.fixture(scope="module")
def baseline_fit() -> BaselineFit:
    data = dataset(duration=3.0)
    records, filtering = prepare(data, BENCH)
    return fit_baseline(data, plant_of(data, BENCH, records), filtering, seed=0)


def rival(
    baseline_fit: BaselineFit, name: str, values: dict[str, float]
) -> tuple[Problem, np.ndarray]:
    wider = baseline_fit.problem.with_effect(name, values)
    return wider, wider.placed(baseline_fit.whole.x, values)


def test_gravity_and_a_spring_part_where_the_rig_is_turned(
    baseline_fit: BaselineFit,
) -> None:
    spring = rival(
        baseline_fit,
        "joint_stiffness",
        {"joint_stiffness": 0.4, "joint_stiffness_moment": 0.0},
    )
    weight = rival(
        baseline_fit, "joint_gravity", {"gravity_sine": 0.44, "gravity_cosine": 0.0}
    )
    found = propose([spring, weight], ["joint_stiffness", "joint_gravity"])
    assert found is not None
    assert "turned by 90 degrees" in found.description
    assert "tilt = 1.571" in found.description
    assert "may not be enough" not in found.description
    assert found.separates == ("joint_stiffness", "joint_gravity")


def test_what_tuning_makes_up_for_separates_nothing(baseline_fit: BaselineFit) -> None:
    """Two models that differ in a little friction are one model."""
    problem, x = rival(
        baseline_fit,
        "joint_stiffness",
        {"joint_stiffness": 0.4, "joint_stiffness_moment": 0.0},
    )
    other = x.copy()
    other[problem.names.index("friction")] += 0.01
    plant = problem.plant
    (record, *_) = plant.records
    shown = [
        plant.limited([record]).simulate(problem.values(place), problem.effects)[0]
        for place in (x, other)
    ]
    noise = np.array([[0.02], [0.02]])
    apart = (shown[1] - shown[0]) / noise
    nothing = np.zeros((0, x.size))
    new = replace(record, measured=shown[0])
    left = left_after_fit(problem, x, new, noise, nothing, apart)
    assert np.linalg.norm(left) < 0.1 * np.linalg.norm(apart)
