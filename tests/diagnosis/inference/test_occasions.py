"""Several occasions of one rig: shared effects, and what changed between them."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cc_mujoco.cable import Parameter
from cc_mujoco.datasets import Dataset
from cc_mujoco.diagnosis import Options, run_inference
from cc_mujoco.diagnosis._fit.fit import fit_baseline, plant_of, prepare_start
from cc_mujoco.diagnosis._fit.problem import fit
from cc_mujoco.diagnosis._fit.trials import (
    TrialConstants,
    compare_size,
    constants_by_occasion,
    describe_change,
)
from cc_mujoco.diagnosis._phrases import MINUS, plain_name
from cc_mujoco.diagnosis._propose.experiment import (
    as_record,
    motions,
    next_trial_names,
    trial_table,
)
from cc_mujoco.diagnosis._rig.records import prepare
from cc_mujoco.diagnosis._rig.simulation import (
    SimulatedRig,
    baseline_parameters,
    values_on,
)
from cc_mujoco.estimation._least_squares import Estimate, Tuned
from diagnosis.recorded import BENCH, dataset

DRAG = {"viscous_friction": {"viscous_friction": 10.0}}
FRICTION, PRETENSION = 1.18, 0.7
"""Ratios of June to March."""


def on(occasion: str, recorded: Dataset) -> Dataset:
    """Return the trials as those of an occasion."""
    trials = [
        replace(
            trial,
            name=f"{occasion}/{trial.name}",
            facts=replace(trial.facts, occasion=occasion),
        )
        for trial in recorded.trials
    ]
    return replace(recorded, trials=tuple(trials))


def two_occasions(duration: float, june: dict[str, dict[str, float]]) -> Dataset:
    """Return trials of March with `DRAG`, and of June with changed cables."""
    cable = BENCH.cables[0]
    changed = {
        "friction": FRICTION * cable.friction,
        "pretension": PRETENSION * cable.pretension,
    }
    first = on("March", dataset(DRAG, duration))
    last = on("June", dataset(june, duration, seed=3, changes=changed))
    return replace(first, trials=first.trials + last.trials)


def test_an_occasion_has_its_ratios_and_differences_and_the_last_one_none() -> None:
    values = {
        "friction": 0.2,
        "friction@March": 0.5,
        "joint_angle_offset": 0.01,
        "joint_angle_offset@March": 0.02,
    }
    march = values_on(values, "March")
    assert march["friction"] == pytest.approx(0.1)
    assert march["joint_angle_offset"] == pytest.approx(0.03)
    assert values_on(values, "June") is values


def test_a_proposed_trial_is_of_the_last_occasion_and_has_a_free_name() -> None:
    march, june = (on(name, dataset(duration=1.0)) for name in ("March", "June"))
    records, _ = prepare(replace(march, trials=march.trials + june.trials), BENCH)
    named = (*records[:-1], replace(records[-1], trial="June/trial_01"))
    assert next_trial_names(named, 2) == ("trial_02", "trial_03")
    plant: Any = SimpleNamespace(plant=SimulatedRig(BENCH, named, 4))
    motion = motions(BENCH, 0.8, 3.0)[0]
    proposed = as_record(plant, motion)
    assert proposed.occasion == "June"
    lines = trial_table("trial_02", motion, 80.0, proposed.occasion)
    facts = tomllib.loads("\n".join(lines))["trials"]["trial_02"]
    assert facts["occasion"] == "June" and facts["pretension"] == 80.0


def test_a_change_moves_the_torques_of_its_occasion_only() -> None:
    recorded = two_occasions(1.0, DRAG)
    records, _ = prepare(recorded, BENCH)
    assert SimulatedRig(BENCH, records, 4).occasions == ("March", "June")
    free = {p.name: p for p in baseline_parameters(BENCH, records, {})}
    assert free["friction@March"].start == 1.0
    assert not any(name.endswith("@June") for name in free)
    plant = SimulatedRig(BENCH, records, 4)
    usual = {name: parameter.start for name, parameter in free.items()}
    before = plant.simulate(usual)
    after = plant.simulate({**usual, "friction@March": 1.2})
    for record, one, other in zip(records, before, after, strict=True):
        assert np.array_equal(one, other) is (record.occasion == "June")


def test_changes_are_told_from_the_earlier_to_the_later_occasion() -> None:
    ratio = Tuned(Parameter("pretension@March", "1", scale="log"), 1.0, 1.0, -3.0, 3.0)
    _, found = describe_change(ratio, Estimate(1.25, "1", (1.20, 1.30)))
    assert found.replace(MINUS, "-") == "pretension -20.0 % (95 %: -23.1 to -16.7)"
    offset = Tuned(Parameter("joint_torque_offset@March", "N m"), 0.0, 1.0, -3.0, 3.0)
    _, found = describe_change(offset, Estimate(0.01, "N m", (-0.01, 0.03)))
    assert found == "joint torque offset unchanged within 0.030 N m"
    assert (
        plain_name(ratio.name) == "pretension on March, relative to the last occasion"
    )


def test_an_occasion_that_could_show_an_effect_and_does_not_disputes_it() -> None:
    drag = Tuned(Parameter("viscous_friction", "N s/m^2"), 0.0, 1.0, 0.0, 100.0)

    def constants(
        value: tuple[float, float], error: tuple[float, float]
    ) -> TrialConstants:
        both = np.array(value), np.array(error)
        return TrialConstants(drag, ("March", "June"), *both, 0.5, *both)

    same = compare_size("viscous_friction", constants((9.0, 11.0), (1.0, 1.0)), 10.0)
    assert same.agree
    gone = compare_size("viscous_friction", constants((20.0, 0.1), (1.0, 1.0)), 10.0)
    assert not gone.agree
    assert "June could show it and does not" in gone.statement
    lost = compare_size(
        "viscous_friction", constants((np.nan, np.nan), (1.0, 1.0)), 10.0
    )
    assert lost.sizes == {} and "agreement is not known" in lost.statement
    blind = compare_size("viscous_friction", constants((10.0, 0.1), (1.0, 8.0)), 10.0)
    assert blind.agree
    assert "June cannot show a size of 10.0" in blind.statement


@pytest.mark.parametrize(("friction", "taken"), [(6.0, 5.0), (-1.0, 0.0)])
def test_friction_that_a_change_takes_beyond_its_range_is_at_its_end(
    friction: float, taken: float
) -> None:
    (record, *_), _ = prepare(dataset(duration=1.0), BENCH)
    made = SimulatedRig(BENCH, (record,), 4).cables({"friction": friction}, ())
    assert [cable.friction for cable in made] == [taken, taken]


@pytest.mark.study
def test_hidden_changes_are_found_beside_a_shared_effect() -> None:
    suspects = Options(("viscous_friction", "load_independent_friction"))
    found = run_inference(two_occasions(6.0, DRAG), BENCH, suspects).diagnosis
    assert [effect.id for effect in found.missing] == ["viscous_friction"]
    assert found.occasions is not None
    change = {each.parameter: each.change for each in found.occasions.changes}
    assert change["friction"].value == pytest.approx(FRICTION - 1.0, abs=0.01)
    assert change["pretension"].value == pytest.approx(PRETENSION - 1.0, abs=0.01)
    assert change["axial_stiffness"].holds(0.0)
    assert all(each.agree for each in found.occasions.sizes)


@pytest.mark.study
def test_each_occasion_has_its_own_size_of_an_effect() -> None:
    drags = (5.0, 15.0)
    parts = [
        on(day, dataset({"viscous_friction": {"viscous_friction": drag}}, 6.0, seed))
        for day, drag, seed in zip(("March", "June"), drags, (0, 3), strict=True)
    ]
    both = replace(parts[0], trials=parts[0].trials + parts[1].trials)
    _, records, filtering = prepare_start(both, BENCH)
    plant = plant_of(both, BENCH, records)
    tuned = fit_baseline(both, plant, filtering, 0)
    problem = tuned.problem.with_effect("viscous_friction", {})
    start = np.append(tuned.whole.x, 0.5)
    x = fit(problem, start, [record.counts for record in records]).x
    (found,) = constants_by_occasion(problem, x, [x.size - 1])
    assert found.trials == ("March", "June")
    assert found.value == pytest.approx(drags, rel=0.05)


@pytest.mark.study
def test_an_effect_of_one_occasion_is_not_called_missing() -> None:
    found = run_inference(
        two_occasions(6.0, {}), BENCH, Options(("viscous_friction",))
    ).diagnosis
    assert found.verdict == "unknown"
    assert not found.missing
