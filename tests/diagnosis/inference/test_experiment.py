"""Proposed experiments separate rivals by differences that tuning cannot absorb."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from cc_mujoco.diagnosis import (
    MOTION_STEP,
    BaselineFit,
    CrossValidation,
    Problem,
    Record,
    catalogue,
    fit,
    fit_baseline,
    plant_of,
    prepare,
)
from cc_mujoco.diagnosis._propose import experiment
from cc_mujoco.diagnosis._propose.experiment import (
    CataloguedTrial,
    Rivals,
    best_trial,
    recorded,
    refit_difference,
)
from cc_mujoco.estimation._least_squares import Fit
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


@pytest.fixture(scope="module")
def sprung() -> tuple[BaselineFit, Rivals]:
    """Return the data of a joint with a spring, and two models that explain them."""
    stiffness = {"joint_stiffness": 0.4, "joint_stiffness_moment": 0.0}
    data = dataset({"joint_stiffness": stiffness}, duration=2.5, chosen=(0, 2))
    records, filtering = prepare(data, BENCH)
    found = fit_baseline(data, plant_of(data, BENCH, records), filtering, seed=0)
    masks = [record.free for record in records]

    def fitted(name: str, values: dict[str, float]) -> tuple[Problem, np.ndarray]:
        wider, x = rival(found, name, values)
        return wider, fit(wider, x, masks).x

    spring = fitted("joint_stiffness", stiffness)
    weight = fitted("joint_gravity", {"gravity_sine": 0.44, "gravity_cosine": 0.0})
    return found, tie(found, spring, weight)


@pytest.mark.study
def test_gravity_and_a_spring_part_where_the_rig_is_turned(
    sprung: tuple[BaselineFit, Rivals],
) -> None:
    found = best_trial(sprung[1])
    assert found is not None
    planned = found.experiment
    assert "turned by 90 degrees" in planned.description
    assert found.motion.tilt > 0.0 and found.motion.description == planned.description
    assert planned.separates == ("joint_stiffness", "joint_gravity")
    assert planned.trial not in {r.trial for r in sprung[0].problem.plant.records}
    (table,) = tomllib.loads("\n".join(planned.facts))["trials"].values()
    assert table["tilt"] == pytest.approx(1.571)


def tie(
    baseline_fit: BaselineFit,
    one: tuple[Problem, np.ndarray],
    other: tuple[Problem, np.ndarray],
) -> Rivals:
    """Return two models in a tie, as fitted by the search."""

    def crossed(problem: Problem, x: np.ndarray) -> CrossValidation:
        return CrossValidation(problem, (Fit(x, 0.0),), tuple(problem.errors(x)))

    before = crossed(baseline_fit.problem, baseline_fit.whole.x)
    ids = one[0].effects[0], other[0].effects[0]
    return Rivals(ids, before, (crossed(*one), crossed(*other)), True)


def as_recorded(motion: CataloguedTrial, like: Record) -> Record:
    """Return a motion as a trial of the data, at their rate and with small errors."""
    size = int(motion.motor.size * MOTION_STEP / like.dt)
    time = like.dt * np.arange(size)
    known = MOTION_STEP * np.arange(motion.motor.size)
    motor, joint = (
        1.02 * np.interp(time, known, angle) + 0.03
        for angle in (motion.motor, motion.joint[: motion.motor.size])
    )
    return replace(
        like,
        time=time,
        motor_angle=motor,
        joint_angle=joint,
        pretension=80.0 * motion.pretension,
        tilt=motion.tilt,
        known_torques=motion.known_torques,
        swapped=motion.swapped,
        load_cell=motion.cell_on(BENCH, 80.0 * motion.pretension),
    )


def test_a_motion_is_found_again_among_trials_and_no_other_is(
    baseline_fit: BaselineFit,
) -> None:
    problem = baseline_fit.problem
    (like, *_) = problem.plant.records
    others = [replace(r, pretension=80.0) for r in problem.plant.records]
    every = catalogue(problem)
    for motion in every:
        trial = as_recorded(motion, like)
        found = recorded(every, problem.plant.bench, [*others, trial])
        assert found == {motion.description}
    assert not recorded(every, problem.plant.bench, others)
    noted = replace(others[0], notes=every[0].description)
    assert recorded(every, problem.plant.bench, [noted]) == {every[0].description}


def test_no_trial_that_the_data_have_and_none_that_settles_nothing_is_proposed(
    baseline_fit: BaselineFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    spring = rival(
        baseline_fit,
        "joint_stiffness",
        {"joint_stiffness": 0.4, "joint_stiffness_moment": 0.0},
    )
    weight = rival(
        baseline_fit, "joint_gravity", {"gravity_sine": 0.44, "gravity_cosine": 0.0}
    )
    turned = [m for m in catalogue(baseline_fit.problem) if m.tilt]
    monkeypatch.setattr(experiment, "catalogue", lambda _: turned)
    done = {motion.description for motion in turned}
    monkeypatch.setattr(experiment, "recorded", lambda *_: done)
    assert best_trial(tie(baseline_fit, spring, weight)) is None
    monkeypatch.setattr(experiment, "recorded", lambda *_: set())
    small = {"joint_stiffness": 4e-3, "joint_stiffness_moment": 0.0}
    faint = rival(baseline_fit, "joint_stiffness", small)
    weak = rival(
        baseline_fit, "joint_gravity", {"gravity_sine": 4.4e-3, "gravity_cosine": 0.0}
    )
    assert best_trial(tie(baseline_fit, faint, weak)) is None


def test_old_and_new_trials_count_by_what_is_left_with_the_effect(
    sprung: tuple[BaselineFit, Rivals],
) -> None:
    """Without the effect, the model error would inflate the noise floor."""
    found, rivals = sprung
    assert found.crossed.misfit > 3.0
    for problem, _ in rivals.fitted:
        assert problem.weight > 2.0 * found.problem.weight
        assert problem.inflation < found.problem.inflation


def test_a_fit_to_old_and_new_trials_keeps_its_bounds(
    baseline_fit: BaselineFit,
) -> None:
    """An offset beyond the bound of the baseline remains as a residual."""
    problem, x = baseline_fit.problem, baseline_fit.whole.x
    (record, *_) = problem.plant.records
    (shown,) = problem.plant.limited([record]).simulate(problem.values(x))
    index = problem.names.index("joint_torque_offset")
    most = problem.tuned[index].value(problem.tuned[index].high)
    noise = np.array([[0.02], [0.02]])
    nothing = np.zeros((0, x.size))
    new = replace(record, measured=shown)
    for size, least in ((0.5, 0.0), (20.0, 0.5)):
        apart = np.zeros(shown.shape)
        apart[1] = size * most / noise[1]
        left = refit_difference(problem, x, new, noise, nothing, apart)
        part = np.linalg.norm(left) / np.linalg.norm(apart)
        assert part < 0.05 if least == 0.0 else part > least


def test_what_tuning_makes_up_for_separates_nothing(baseline_fit: BaselineFit) -> None:
    """Two models that differ by a small change of friction are not separable."""
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
    left = refit_difference(problem, x, new, noise, nothing, apart)
    assert np.linalg.norm(left) < 0.1 * np.linalg.norm(apart)
