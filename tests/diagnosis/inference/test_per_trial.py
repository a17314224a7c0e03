"""Errors per trial, and the trial that was recorded on another rig than the rest."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from cc_mujoco.datasets import Dataset, TrialFacts
from cc_mujoco.diagnosis import (
    BaselineFit,
    Options,
    fit,
    fit_baseline,
    plant_of,
    prepare,
    run_inference,
)
from cc_mujoco.diagnosis._fit.problem import TorqueDerivatives
from cc_mujoco.diagnosis._fit.trials import find_outlier_trial, misfits, trial_errors
from cc_mujoco.diagnosis._judge import worst_stretch
from diagnosis.instrumented import told_by
from diagnosis.recorded import BENCH, dataset

USUAL = {"friction": 0.13, "axial_stiffness": 47e3, "pretension": 82.0}
COUNT = 4


def recorded(odd: int = -1, changes: Mapping[str, float] | None = None) -> Dataset:
    """Return four trials, one of which may have other cables than the rest."""
    trials = []
    for seed in (0, 1):
        rigs = (USUAL, {**USUAL, **(changes or {})})
        same, other = (dataset(changes=r, seed=seed, duration=3.0) for r in rigs)
        for usual, changed in zip(same.trials, other.trials, strict=True):
            name = f"run_{len(trials)}"
            trial = changed if len(trials) == odd else usual
            trials.append(replace(trial, name=name, path=f"{name}.csv"))
    return replace(dataset(duration=0.1), trials=tuple(trials[:COUNT]))


def baseline_fit(data: Dataset) -> BaselineFit:
    records, filtering = prepare(data, BENCH)
    return fit_baseline(data, plant_of(data, BENCH, records), filtering, 0)


@pytest.mark.parametrize(
    ("odd", "changes", "told"),
    [
        (2, {"pretension": 40.0}, r"its pretension were (40|39\.\d|40\.\d) N, not 8"),
        (0, {"friction": 0.2}, r"friction times wrap were 1\.5\d times"),
    ],
)
def test_a_trial_with_other_cables_is_asked_about(
    odd: int, changes: dict[str, float], told: str
) -> None:
    found = baseline_fit(recorded(odd, changes))
    requested = find_outlier_trial(found.problem, found.whole.x)
    assert requested is not None
    assert requested.trials == (f"run_{odd}",)
    assert requested.misfit > 5.0 * requested.rest
    assert requested.rest < 2.0
    assert f"Trial run_{odd} is off by" in requested.question
    assert re.search(told, requested.question), requested.question


def test_a_trial_that_no_constant_mends_is_not_asked_about() -> None:
    """The trial with the largest motion has the largest error from a missing effect."""
    data = recorded()
    trials = [
        replace(
            trial,
            joint_torque=trial.joint_torque + size * np.sin(11.0 * trial.joint_angle),
        )
        for trial, size in zip(data.trials, (0.05, 0.05, 0.05, 0.5), strict=True)
    ]
    found = baseline_fit(replace(data, trials=tuple(trials)))
    off = misfits(found.problem, found.whole.x)
    assert max(off, key=lambda name: off[name]) == "run_3" and off["run_3"] > 3.0
    assert find_outlier_trial(found.problem, found.whole.x) is None


def test_a_turn_the_wrong_way_is_asked_about_for_all_that_are_turned() -> None:
    data = recorded()
    trials = [
        replace(
            trial,
            joint_torque=trial.joint_torque - 0.8 * np.sin(trial.joint_angle + tilt),
            facts=TrialFacts(tilt=-tilt),
        )
        for trial, tilt in zip(data.trials, (0.0, 0.0, 1.5, 1.5), strict=True)
        if trial.joint_torque is not None
    ]
    found = baseline_fit(replace(data, trials=tuple(trials)))
    size = {"gravity_sine": 0.8, "gravity_cosine": 0.0}
    wider = found.problem.with_effect("joint_gravity", size)
    every = [record.counts for record in wider.plant.records]
    x = fit(wider, wider.placed(found.whole.x, size), every).x
    requested = find_outlier_trial(wider, x, misfits(found.problem, found.whole.x))
    assert requested is not None and requested.trials == ("run_2", "run_3")
    assert "turned by \u22121.50 rad" in requested.question
    assert "Correct sign and size of `tilt`" in requested.question
    told = re.search(r"had been turned by (1\.\d+) rad", requested.question)
    assert told and float(told[1]) == pytest.approx(1.5, abs=0.1)


def test_one_of_several_turned_trials_is_asked_about_its_pretension() -> None:
    data = recorded(2, {"pretension": 40.0})
    turned = tuple(
        replace(trial, facts=TrialFacts(tilt=1.5)) if k >= 2 else trial
        for k, trial in enumerate(data.trials)
    )
    found = baseline_fit(replace(data, trials=turned))
    requested = find_outlier_trial(found.problem, found.whole.x)
    assert requested is not None and requested.trials == ("run_2",)
    assert "its pretension were" in requested.question


def test_what_a_large_effect_leaves_is_no_contradiction() -> None:
    found = baseline_fit(recorded(2, {"pretension": 40.0}))
    off = misfits(found.problem, found.whole.x)
    assert find_outlier_trial(found.problem, found.whole.x, off) is not None
    larger = {name: 10.0 * size for name, size in off.items()}
    assert find_outlier_trial(found.problem, found.whole.x, larger) is None


@pytest.mark.parametrize("wrong", ["run_0", "run_1"])
def test_exchanged_torques_are_found_before_any_search(wrong: str) -> None:
    data = recorded()
    trials = [
        replace(t, motor_torque=t.joint_torque, joint_torque=t.motor_torque)
        if t.name == wrong
        else t
        for t in data.trials
    ]
    found = run_inference(replace(data, trials=tuple(trials)), BENCH).diagnosis
    assert found.verdict == "fix-data"
    assert f"The torque columns of trial {wrong} are swapped" in found.statement
    assert not found.runner_ups


def test_a_cable_that_comes_off_is_an_event_with_its_time() -> None:
    data = recorded()
    off = data.trials[1]
    random = np.random.default_rng(2)
    gone = off.time >= 1.5
    noise = [random.normal(0.0, 0.02, off.time.size) for _ in range(2)]
    changed = replace(
        off,
        motor_torque=np.where(gone, noise[0], off.motor_torque),
        joint_torque=np.where(gone, noise[1], off.joint_torque),
    )
    trials = (data.trials[0], changed, *data.trials[2:])
    few = Options(ids=("viscous_friction",))
    found = run_inference(replace(data, trials=trials), BENCH, few).diagnosis
    assert found.verdict == "none", found.statement
    (event,) = found.events
    assert event.kind == "silent" and list(event.spans) == ["run_1"]
    assert event.time == pytest.approx(1.5, abs=0.05)
    assert "run_1" in event.statement and "] valid = [[" in event.advice


@pytest.mark.study
def test_a_torque_by_current_that_ends_is_an_event_with_its_time() -> None:
    plain = dataset({}, 4.0, 3, USUAL)
    data = told_by("current", {}, duration=4.0, changes=USUAL)
    few = Options(ids=("viscous_friction",))
    found = run_inference(data, BENCH, few).diagnosis
    assert found.verdict == "none", found.statement
    gone = np.where(plain.trials[0].time >= 2.5, plain.trials[0].motor_torque, 0.0)
    off = replace(data.trials[0], motor_torque=data.trials[0].motor_torque - gone)
    data = replace(data, trials=(off, *data.trials[1:]))
    found = run_inference(data, BENCH, few).diagnosis
    assert found.verdict == "none", found.statement
    (event,) = found.events
    assert list(event.spans) == ["trial_0"], event
    assert event.time == pytest.approx(2.5, abs=0.05)
    assert "motor" in event.statement


def test_constants_that_differ_at_random_are_found_before_any_search() -> None:
    factors = (0.8, 1.3, 0.7, 1.1)
    trials = [
        recorded(k, {"friction": USUAL["friction"] * factor}).trials[k]
        for k, factor in enumerate(factors)
    ]
    found = run_inference(replace(recorded(), trials=tuple(trials)), BENCH).diagnosis
    assert found.verdict == "unknown" and not found.runner_ups
    assert "differs from trial to trial" in found.statement
    assert "none of the effects" not in found.statement


@pytest.fixture(scope="module")
def alike() -> BaselineFit:
    """Return the baseline fit of four trials of one rig."""
    return baseline_fit(recorded())


def test_trials_of_one_rig_are_not_asked_about(alike: BaselineFit) -> None:
    assert find_outlier_trial(alike.problem, alike.whole.x) is None


def test_every_stretch_beyond_its_limit_is_found_where_it_is(
    alike: BaselineFit,
) -> None:
    problem, x = alike.problem, alike.whole.x
    played = problem.torques(x)
    assert worst_stretch(problem, x, played) is None
    random = np.random.default_rng(4)
    for _ in range(8):
        place, row = int(random.integers(len(played))), int(random.integers(2))
        record = problem.plant.records[place]
        able = record.time[record.counts]
        start = float(random.uniform(able[0], able[-1] - 1.1))
        end = start + float(random.uniform(1.0, able[-1] - start))
        within = (record.time >= start) & (record.time <= end)
        size = float(random.uniform(20.0, 300.0))
        wrong = record.measured.copy()
        wrong[row, within] += size * problem.floor[place][row, within]
        records = list(problem.plant.records)
        records[place] = replace(record, measured=wrong)
        plant = problem.plant.limited(records)
        changed = replace(problem, plant=plant, slopes=TorqueDerivatives())
        stretch = worst_stretch(changed, x, played)
        assert stretch is not None
        assert stretch.trial == record.trial and not stretch.idle
        assert stretch.channel == problem.plant.instruments.channels[row]
        assert stretch.start == pytest.approx(start, abs=0.15)
        assert stretch.end == pytest.approx(end, abs=0.15)
        assert stretch.size == pytest.approx(size, rel=0.3)
        assert stretch.rest < 1.5


@pytest.mark.parametrize("pretension", [40.0, 82.0, 120.0])
def test_a_trial_at_the_extreme_of_a_condition_is_not_to_be_left_out(
    pretension: float,
) -> None:
    data = recorded(2, {"pretension": 40.0})
    trials = [
        replace(t, facts=TrialFacts(pretension=pretension if k == 2 else 82.0))
        for k, t in enumerate(data.trials)
    ]
    found = baseline_fit(replace(data, trials=tuple(trials)))
    odd = find_outlier_trial(found.problem, found.whole.x)
    if pretension == 40.0:
        assert odd is None
        return
    assert odd is not None and odd.trials == ("run_2",)
    alone = pretension > 100.0
    assert ("keep the trial" in odd.question) is alone
    assert ("leave the trial out" in odd.question) is not alone


def test_what_all_trials_lack_is_no_trial_of_its_own() -> None:
    data = recorded()
    trials = tuple(
        replace(t, joint_torque=t.joint_torque + 0.3 * np.sin(9.0 * t.motor_angle) ** 3)
        for t in data.trials
    )
    found = baseline_fit(replace(data, trials=trials))
    assert find_outlier_trial(found.problem, found.whole.x) is None


def test_errors_per_trial_add_up_to_those_of_all(alike: BaselineFit) -> None:
    problem, x = alike.problem, alike.whole.x
    played = problem.plant.simulate(problem.values(x), ())
    errors = trial_errors(problem, played, played, (problem, x))
    assert [each.trial for each in errors] == [f"run_{k}" for k in range(COUNT)]
    noise = [
        np.sum((noise / floor)[:, record.counts] ** 2)
        for noise, floor, record in zip(
            problem.sensed, problem.floor, problem.plant.records, strict=True
        )
    ]
    squares = [
        np.sum(error[:, record.counts] ** 2)
        for error, record in zip(problem.errors(x), problem.plant.records, strict=True)
    ]
    off = [each.misfit_before**2 for each in errors]
    assert np.dot(off, noise) == pytest.approx(np.sum(squares))
    for each in errors:
        assert each.rmse_after == each.rmse_before
        for name, rmse in each.rmse_before.items():
            assert 0.5 * each.noise_floor[name] < rmse


def test_slack_of_every_trial_is_reported(alike: BaselineFit) -> None:
    problem, x = alike.problem, alike.whole.x
    played = problem.torques(x)
    taut = trial_errors(problem, played, played, (problem, x))
    loose = problem.plant.limited(
        [replace(r, pretension=0.5) for r in problem.plant.records]
    )
    slack = trial_errors(problem, played, played, (replace(problem, plant=loose), x))
    assert all(
        0.0 <= one.slack <= two.slack <= 1.0
        for one, two in zip(taut, slack, strict=True)
    )
    assert max(each.slack for each in slack) > 0.3


def test_an_undeclared_pretension_is_unknown_with_a_question() -> None:
    data = recorded(2, {"pretension": 40.0})
    found = run_inference(data, BENCH, Options(("motor_inertia",))).diagnosis
    assert found.verdict == "unknown"
    assert "Trial run_2 is off by" in found.question
    worst = max(found.trials, key=lambda each: each.misfit_after)
    assert worst.trial == "run_2"
    assert '"question": "Trial run_2' in found.to_json()


def test_a_declared_pretension_is_no_contradiction() -> None:
    data = recorded(2, {"pretension": 40.0})
    odd = data.trials[2]
    declared = replace(odd, facts=replace(odd.facts, pretension=80.0 * 40.0 / 82.0))
    trials = (*data.trials[:2], declared, *data.trials[3:])
    found = baseline_fit(replace(data, trials=trials))
    assert find_outlier_trial(found.problem, found.whole.x) is None
