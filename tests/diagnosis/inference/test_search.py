"""Screening of candidates, and ties between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from cc_mujoco.diagnosis import BaselineFit, Options, run_inference
from cc_mujoco.diagnosis._fit.fit import fit_scene
from cc_mujoco.diagnosis._phrases import no_progress
from cc_mujoco.diagnosis._search import candidates as acceptance
from cc_mujoco.diagnosis._search import search as rounds
from cc_mujoco.diagnosis._search.candidates import (
    Changes,
    bounded_least_squares,
    parted_by_form,
    tie_reason,
)
from cc_mujoco.diagnosis._search.search import search
from cc_mujoco.diagnosis._thresholds import Limit
from diagnosis import recorded
from diagnosis.recorded import BENCH, DT, dataset
from study_marks import study_but

SPRINGY = ("joint_stiffness", "joint_gravity", "viscous_friction")
SOFT = ("end_compliance", "presliding", "load_independent_friction", "cable_stiffening")


@pytest.mark.parametrize("seed", range(5))
def test_sizes_that_run_beyond_a_bound_leave_the_others_at_their_best(
    seed: int,
) -> None:
    random = np.random.default_rng(seed)
    common = random.normal(size=(60, 1))
    columns = common + 0.1 * random.normal(size=(60, 4))
    low, high = np.zeros(4), np.full(4, 20.0)
    wanted = columns @ np.array([0.0, 0.0, 0.7, 0.0]) + 0.1 * random.normal(size=60)
    found = bounded_least_squares(columns, wanted, low, high)
    assert np.all((low <= found) & (found <= high))
    best = lsq_linear(columns, wanted, (low, high)).x
    cost, least = (float(np.sum((wanted - columns @ x) ** 2)) for x in (found, best))
    assert cost < 1.1 * least
    clipped = np.clip(np.linalg.lstsq(columns, wanted)[0], low, high)
    assert cost <= float(np.sum((wanted - columns @ clipped) ** 2))


@pytest.mark.parametrize(
    "spring",
    [pytest.param("proximal_compliance", marks=pytest.mark.study), "end_compliance"],
)
def test_a_soft_fastening_of_one_cable_is_found_at_the_end_where_it_is(
    spring: str,
) -> None:
    data = dataset({"end_compliance": {spring: 3e-5}}, 3.0, seed=1)
    found = run_inference(data, BENCH, Options(SOFT)).diagnosis
    assert found.verdict == "named", found.statement
    assert [effect.id for effect in found.missing] == ["end_compliance"]
    parameters = found.missing[0].parameters
    assert parameters.pop(spring).value == pytest.approx(3e-5, rel=0.15)
    assert max(value.value for value in parameters.values()) < 6e-6


@pytest.mark.study
def test_a_spring_that_softens_is_in_a_tie_with_gravity() -> None:
    data = dataset(duration=3.0, seed=2)
    soft = tuple(
        replace(t, joint_torque=t.joint_torque - 2.0 * np.sin(t.joint_angle))
        for t in data.trials
    )
    found = run_inference(replace(data, trials=soft), BENCH, Options(SPRINGY)).diagnosis
    assert found.verdict == "tie", found.statement
    assert found.ties == (("joint_gravity", "joint_stiffness"),)
    assert not {"joint_gravity", "joint_stiffness"} & {n.id for n in found.not_testable}


@pytest.mark.parametrize(
    ("weight", "name"),
    [
        (1.0, "joint_gravity"),
        pytest.param(0.0, "joint_stiffness", marks=pytest.mark.study),
    ],
)
def test_a_trial_with_the_rig_turned_tells_a_weight_from_a_spring_that_softens(
    weight: float, name: str
) -> None:
    data = dataset(duration=3.0, seed=2)
    tilts = (0.0, 0.0, 0.5 * np.pi)
    pulled = tuple(
        replace(
            t,
            joint_torque=t.joint_torque - 2.0 * np.sin(t.joint_angle + weight * tilt),
            facts=replace(t.facts, tilt=tilt),
        )
        for t, tilt in zip(data.trials, tilts, strict=True)
    )
    found = run_inference(
        replace(data, trials=pulled), BENCH, Options(SPRINGY)
    ).diagnosis
    assert found.verdict == "named", found.statement
    assert [effect.id for effect in found.missing] == [name]


def test_effects_that_hide_each_other_are_found_together() -> None:
    """Friction that falls with speed cancels most of one that rises with it."""
    rising, falling = {"viscous_friction": 20.0}, {
        "stribeck_friction": 0.016, "stribeck_speed": 0.03, "stribeck_slip": 1e-5,
    }  # fmt: skip
    hidden = {"viscous_friction": rising, "stribeck_friction": falling}
    data = dataset(hidden, 3.0, seed=2)
    ids = ("viscous_friction", "stribeck_friction")
    result = run_inference(data, BENCH, Options(ids))
    found = result.diagnosis
    assert {effect.id for effect in found.missing} == {*hidden}, found.statement
    assert result.found is not None
    first, *pair = result.found.search.rounds
    assert first.added is None and all(each.reason for each in first.candidates)
    assert {step.added for step in pair if step.added} == {*hidden}


@pytest.mark.parametrize(
    "rest", [pytest.param(r, marks=pytest.mark.study) for r in (0.8, 0.0, -0.35)]
)
def test_a_spring_is_named_wherever_it_rests(rest: float) -> None:
    data = dataset(duration=3.0, seed=2)
    pulled = tuple(
        replace(t, joint_torque=t.joint_torque - 0.9 * (t.joint_angle - rest))
        for t in data.trials
    )
    ids = (*SPRINGY, "torque_sensor_offset")
    found = run_inference(replace(data, trials=pulled), BENCH, Options(ids)).diagnosis
    assert found.verdict in ("named", "tie"), found.statement
    (spring,) = found.missing
    assert spring.id == "joint_stiffness"
    sizes = spring.parameters
    assert sizes["joint_stiffness"].value == pytest.approx(0.9, rel=0.02)
    moment = sizes["joint_stiffness_moment"].value
    assert moment == pytest.approx(-0.9 * rest, abs=0.02)


@pytest.mark.parametrize("play", study_but(2, [0.07, 0.02]))
def test_play_is_found_whatever_its_size(
    play: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither what the scene without it fits nor a size by first order leads astray."""

    def hanging(duration: float, seed: int) -> list[tuple[np.ndarray, np.ndarray]]:
        time = np.arange(0.0, duration, DT)
        mixed = 0.5 * np.sin(1.7 * time) + 0.3 * np.sin(5.1 * time)
        motors = 0.8 * np.sin(2.0 * time), 0.6 * np.sin(4.0 * time), mixed
        return [(m, m - 0.5 * play * np.tanh(m / 0.05)) for m in motors]

    monkeypatch.setattr(recorded, "motions", hanging)
    data = dataset({"backlash": {"backlash": play}}, 3.2, 1)
    start = fit_scene(data, BENCH, Options(), no_progress)
    assert isinstance(start, BaselineFit)
    found = search(start.crossed, ("backlash",))
    assert found.after.misfit < 1.5 < 10.0 < start.crossed.misfit
    values = found.after.problem.values(found.after.fits[0].x)
    assert values["backlash"] == pytest.approx(play, rel=0.01)


def test_the_prior_of_an_effect_does_not_shrink_what_the_data_show() -> None:
    sizes = {"friction_asymmetry": 0.5, "asymmetry_antagonist": 0.5}
    data = dataset({"asymmetric_friction": sizes}, 4.0, 1)
    start = fit_scene(data, BENCH, Options(), no_progress)
    assert isinstance(start, BaselineFit)
    found = search(start.crossed, ("asymmetric_friction",))
    assert found.after.misfit < 1.2 < 50.0 < start.crossed.misfit
    values = found.after.problem.values(found.after.fits[0].x)
    assert {name: values[name] for name in sizes} == pytest.approx(sizes, rel=0.03)


def crossed(*errors: float, groups: Sequence[str] = ()) -> Any:
    """Return a cross-validation with these RMS errors, by trial."""
    names = groups or [f"trial_{k}" for k in range(len(errors))]
    records = [SimpleNamespace(group=name) for name in names]
    problem = SimpleNamespace(plant=SimpleNamespace(records=records))
    return SimpleNamespace(
        problem=problem, errors=[np.full((2, 50), size) for size in errors]
    )


def test_no_tie_where_one_explains_the_data_and_the_other_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A difference in a single second decides if one model is at the noise floor."""

    def model(misfit: float, *last: float) -> Any:
        seconds = np.array([[1.0, 0.0]] * 30 + [[each, 0.0] for each in last])
        return SimpleNamespace(misfit=misfit, seconds=seconds)

    monkeypatch.setattr(acceptance.fitting, "blocks", lambda crossed: crossed.seconds)
    monkeypatch.setattr(acceptance, "parted_by_form", lambda *_: True)
    before, best, other = model(30.0, 30e3), model(1.4, 1.0), model(5.7, 900.0)
    friction = "load_independent_friction", "tension_dependent_friction"
    assert tie_reason(before, best, other, friction, True) == ""
    # Neither explains the data: that one second decides nothing.
    worse = best.__class__(misfit=3.0, seconds=best.seconds)
    assert tie_reason(before, worse, other, friction, True) == "noise"
    near = other.__class__(misfit=2.0, seconds=other.seconds)
    assert tie_reason(before, best, near, friction, True) == "noise"
    # A band that softens pulls like a weight, however well a weight fits.
    pull = "joint_gravity", "joint_stiffness"
    sure = model(5.7, *([30.0] * 30))
    longer = model(1.4, *([1.0] * 30))
    assert tie_reason(before, longer, sure, pull, True) == "form"
    assert tie_reason(before, longer, sure, pull[::-1], True) == "form"


def test_forms_part_two_effects_where_one_trial_shows_the_difference() -> None:
    before, best = crossed(4.0, 4.0, 0.5), crossed(1.0, 1.0, 0.5)
    little = np.sqrt(1.0 + 0.8 * Limit.form_error_share * 15.0)
    much = np.sqrt(1.0 + 1.2 * Limit.form_error_share * 15.0)
    assert parted_by_form(before, best, crossed(little, little, 0.5))
    assert not parted_by_form(before, best, crossed(1.0, much, 0.5))
    # Next to nothing shows in the last, so next to nothing is much of it.
    assert parted_by_form(before, best, crossed(1.0, 1.0, 0.6))


def test_an_interruption_while_effects_are_dropped_keeps_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    forgotten: list[str] = []
    slopes = SimpleNamespace(forget=lambda: forgotten.append("slopes"))
    model: Any = SimpleNamespace(problem=SimpleNamespace(slopes=slopes))
    monkeypatch.setattr(rounds, "eliminate", interrupt)
    monkeypatch.setattr(rounds, "gap_shares", lambda *_: {})
    course = rounds.Search(model, model, (), (), {}, Changes(), (model,))
    found = rounds.drop_redundant(course)
    assert found.interrupted and found.after is model
    assert forgotten == ["slopes"]
