"""Proposed experiments separate rivals by differences that tuning cannot absorb."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cc_mujoco.diagnosis import (
    MOTION_STEP,
    BaselineFit,
    CrossValidation,
    Problem,
    fit,
    fit_baseline,
    plant_of,
    prepare,
)
from cc_mujoco.diagnosis._propose.experiment import (
    LEAST,
    MOST,
    CataloguedTrial,
    Comparison,
    Expected,
    Rivals,
    TrialSettings,
    as_record,
    designed,
    kind_of,
    refit_difference,
)
from cc_mujoco.diagnosis._report.output import write_proposed
from cc_mujoco.diagnosis._verdict import NextExperiment
from cc_mujoco.estimation._least_squares import Fit
from cc_mujoco.hardware._limits import Limits
from cc_mujoco.hardware._references import read_plan
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
    comparison = Comparison(sprung[1])
    found = designed(comparison)
    assert found is not None
    planned, (motion,) = comparison.next(found), found.motions
    assert "the rig turned by" in planned.description
    assert motion.tilt > 1.0 and motion.description == planned.description
    assert planned.separates == ("joint_stiffness", "joint_gravity")
    (name,) = planned.trials
    assert name not in {r.trial for r in sprung[0].problem.plant.records}
    table = tomllib.loads("\n".join(planned.facts))["trials"][name]
    assert table["tilt"] == pytest.approx(motion.tilt, abs=1e-3)


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


def weights_and_springs(baseline_fit: BaselineFit, size: float) -> Rivals:
    """Return a spring of `size` [N m/rad] and a weight that pulls as much."""
    spring = {"joint_stiffness": size, "joint_stiffness_moment": 0.0}
    weight = {"gravity_sine": 1.1 * size, "gravity_cosine": 0.0}
    one = rival(baseline_fit, "joint_stiffness", spring)
    return tie(baseline_fit, one, rival(baseline_fit, "joint_gravity", weight))


def test_a_kind_that_the_data_have_is_not_proposed_again(
    sprung: tuple[BaselineFit, Rivals], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Trials of a kind have the same words but for numbers; kinds differ."""
    comparison = Comparison(sprung[1])
    kinds = [kind_of(motion.description) for motion in comparison.trials()]
    assert len({*kinds}) == len(kinds)
    for settings in (LEAST, MOST):
        other = comparison.trials(settings)
        assert [kind_of(motion.description) for motion in other] == kinds
    plant = comparison.problem.plant
    turned = [motion for motion in comparison.trials() if motion.tilt]
    monkeypatch.setattr(Comparison, "trials", lambda *_: turned)
    assert designed(comparison) is not None
    noted = [
        replace(record, notes=motion.description)
        for record, motion in zip(plant.records, turned, strict=False)
    ]
    known = replace(plant, records=(*noted, *plant.records[len(noted) :]))
    comparison.problem = replace(comparison.problem, plant=known)
    assert designed(comparison) is None


def test_no_trial_that_settles_nothing_is_proposed(
    baseline_fit: BaselineFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    comparison = Comparison(weights_and_springs(baseline_fit, 4e-3))
    turned = [motion for motion in comparison.trials() if motion.tilt]
    monkeypatch.setattr(Comparison, "trials", lambda *_: turned)
    assert designed(comparison) is None


def test_a_designed_trial_separates_more_a_second_than_the_usual_one(
    sprung: tuple[BaselineFit, Rivals],
) -> None:
    comparison = Comparison(sprung[1])
    usual = filter(None, map(comparison.expected, comparison.trials()))
    best = max(usual, key=lambda expected: expected.rank)
    found = designed(comparison)
    assert found is not None and all(found.settles)
    assert found.rank[-1] > 1.5 * best.rank[-1]
    assert found.motions[0].motor.size < best.motions[0].motor.size


def test_a_run_in_does_not_count(sprung: tuple[BaselineFit, Rivals]) -> None:
    """A locked motor never winds the cable up, so that nothing counts."""
    comparison = Comparison(sprung[1])
    locked, turned = (
        next(m for m in comparison.trials() if words in m.description)
        for words in ("motor locked", "the rig turned")
    )
    assert not as_record(comparison.problem, locked).counts.any()
    assert comparison.expected(locked) is None
    record = as_record(comparison.problem, turned)
    found = comparison.expected(turned)
    assert found is not None and not record.counts.all()
    assert np.all(found.left[:, ~record.counts] == 0.0)
    assert np.all(found.left[:, record.counts] != 0.0)


def test_where_no_trial_settles_a_tie_the_standard_ones_are_proposed_together(
    sprung: tuple[BaselineFit, Rivals], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    comparison = Comparison(sprung[1])
    whole = Comparison.expected

    def lone_ones_settle_nothing(
        self: Comparison, *trials: CataloguedTrial, least: float = 0.0
    ) -> Expected | None:
        return whole(self, *trials, least=least) if len(trials) > 1 else None

    monkeypatch.setattr(Comparison, "expected", lone_ones_settle_nothing)
    found = designed(comparison)
    assert found is not None
    planned = comparison.next(found)
    assert len(found.motions) == len(planned.trials) == 3
    assert all(motion.standard for motion in found.motions)
    assert "no single trial separates them, these 3 do" in planned.description
    tables = tomllib.loads("\n".join(planned.facts))["trials"]
    assert tuple(tables) == planned.trials
    assert sum(table.get("unhooked", False) for table in tables.values()) == 2
    write_proposed(tmp_path, planned, found.motions, "")
    assert tuple(trial.name for trial in read_plan(tmp_path)) == planned.trials


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_every_setting_stays_within_the_limits_of_a_rig_that_made_the_data(
    baseline_fit: BaselineFit, tmp_path: Path, share: float
) -> None:
    """Those beyond the range of the data stay within the stops."""
    comparison = Comparison(weights_and_springs(baseline_fit, 0.4))
    records = comparison.problem.plant.records
    motor = np.array([[np.ptp(r.motor_angle), r.motor_angle.mean()] for r in records])
    speed = max(np.max(np.abs(np.gradient(r.motor_angle, r.dt))) for r in records)
    swing = 0.5 * motor[:, 0].max()
    # The joint follows by half the wind-up that the pretension allows.
    reach = swing * BENCH.motor_radius / BENCH.joint_radius + 0.1
    limits = Limits(4.0, 40.0, speed, (-reach, reach))
    drive: Any = SimpleNamespace(ratio=1.0)
    pairs = zip(LEAST, MOST, strict=True)
    settings = TrialSettings(*(low + share * (high - low) for low, high in pairs))
    for motion in comparison.trials(settings):
        planned = NextExperiment(motion.description, (), "", ("trial_09",))
        write_proposed(tmp_path, planned, [motion], "")
        (trial,) = read_plan(tmp_path)
        if motion.hard and not motion.load_cell:
            assert np.max(np.abs(trial.joint)) <= BENCH.span[1]
            continue
        trial.require_within(limits, drive)
        if motion.pretension == 0.0:
            continue
        assert 0.0 < motion.pretension <= 1.0
        cables = tuple(
            cable.replace(pretension=motion.pretension * cable.pretension)
            for cable in BENCH.cables
        )
        played = replace(BENCH, cables=cables).transmission.replay(
            MOTION_STEP, motor_angle=trial.motor, joint_angle=trial.joint
        )
        most = max(played.tension_proximal.max(), played.tension_distal.max())
        assert most < 4.0 * BENCH.cables[0].pretension, motion.description


def test_old_and_new_trials_count_by_what_is_left_with_the_effect(
    sprung: tuple[BaselineFit, Rivals],
) -> None:
    """Without the effect, the model error would inflate the noise floor."""
    found, rivals = sprung
    assert found.crossed.misfit > 3.0
    for problem, _ in Comparison(rivals).fitted:
        assert problem.weight > 2.0 * found.problem.weight
        assert problem.inflation < found.problem.inflation


def test_a_fit_to_old_and_new_trials_keeps_its_bounds(
    baseline_fit: BaselineFit,
) -> None:
    """An offset beyond either bound of the baseline remains as a residual."""
    problem, x = baseline_fit.problem, baseline_fit.whole.x.copy()
    record = replace(problem.plant.records[0], counts=np.ones(750, dtype=bool))
    index = problem.names.index("joint_torque_offset")
    most = problem.tuned[index].value(problem.tuned[index].high)
    noise = np.array([[0.02], [0.02]])
    others = 1e9 * np.delete(np.eye(x.size), index, axis=0)  # which have to stay
    x[index] = 0.9 * problem.tuned[index].high
    (shown,) = problem.plant.limited([record]).simulate(problem.values(x))
    for size, beyond in ((0.05, 0.0), (0.5, 0.4), (-0.5, 0.0), (-20.0, 18.1)):
        apart = np.zeros(shown.shape)
        apart[1] = size * most / noise[1]
        given = [record], [shown], noise, others, apart
        left = refit_difference(problem, x, *given)
        part = np.linalg.norm(left) / np.linalg.norm(apart)
        assert part == pytest.approx(abs(beyond / size), abs=0.01)


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
    record = replace(plant.records[0], counts=np.ones(750, dtype=bool))
    shown = [
        plant.limited([record]).simulate(problem.values(place), problem.effects)[0]
        for place in (x, other)
    ]
    noise = np.array([[0.02], [0.02]])
    apart = (shown[1] - shown[0]) / noise
    nothing = np.zeros((0, x.size))
    given = [record], shown[:1], noise, nothing, apart
    left = refit_difference(problem, x, *given)
    assert np.linalg.norm(left) < 0.1 * np.linalg.norm(apart)
