"""Rare effects: right by mechanics, and searched where nothing else explains the error.

`scripts/diagnosis_study/rare_effects.py` hides each in a rig that shares no code.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cc_mujoco.diagnosis import (
    EFFECTS,
    Options,
    fit_baseline,
    plant_of,
    prepare,
    run_inference,
    with_proposal,
)
from cc_mujoco.diagnosis._fit.fit import check_effects
from cc_mujoco.diagnosis._fit.intervals import implausibility
from cc_mujoco.diagnosis._rig.simulation import SimulatedRig
from cc_mujoco.diagnosis._search.search import search, search_rare
from cc_mujoco.diagnosis.effects import usual_effects
from cc_mujoco.diagnosis.effects._effect import Signals, form_key
from diagnosis.instrumented import bent
from diagnosis.recorded import BENCH, dataset
from study_marks import study_but

RARE = [name for name, effect in EFFECTS.items() if effect.rare]


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("drum_winding", {"drum_growth": 0.05}),
        ("lever_geometry", {"arm_slope": 0.1, "arm_bend": -0.2}),
    ],
)
def test_arms_that_change_make_no_work(effect: str, values: dict[str, float]) -> None:
    """Over a closed path of both angles, cables without friction return all of it."""
    records, _ = prepare(dataset(duration=2.0, chosen=(0,)), BENCH)
    turns = np.linspace(0.0, 4.0 * np.pi, 2001)
    record = replace(
        records[0],
        motor_angle=0.6 * np.sin(turns),
        joint_angle=0.6 * np.sin(turns) + 0.004 * (1.0 - np.cos(turns)),
    )
    plant = SimulatedRig(BENCH, (record,), 4)
    given = {"friction": 0.0, **values}
    shown = plant.setting(given, (effect,))
    signals = plant._torques(record, shown, given)
    round_ = signals.motor[1000:], signals.joint[1000:]
    (plain,) = plant.simulate({"friction": 0.0})
    assert np.abs(signals.motor - plain[0]).max() > 0.05
    work = [
        np.trapezoid(torque, angle[1000:])
        for torque, angle in zip(
            round_, (record.motor_angle, record.joint_angle), strict=True
        )
    ]
    size = np.abs(round_[0]).max() * 2.4
    assert abs(work[0] - work[1]) < 1e-4 * size
    assert abs(work[0]) > 1e-2 * size


@pytest.mark.parametrize("wind_up", study_but(2, [1e-3, 0.02]))
def test_friction_of_a_joint_may_wind_up(wind_up: float) -> None:
    data = dataset(duration=2.0)
    trials = [
        replace(t, joint_torque=t.joint_torque - 0.3 * bent(t.joint_angle, wind_up))
        for t in data.trials
        if t.joint_torque is not None
    ]
    data = replace(data, trials=tuple(trials))
    records, filtering = prepare(data, BENCH)
    crossed = fit_baseline(data, plant_of(data, BENCH, records), filtering, 0).crossed
    found = search(crossed, ("joint_friction",)).after
    assert found.problem.effects == ("joint_friction",) and found.misfit < 1.3
    values = found.problem.values(np.mean([fit.x for fit in found.fits], axis=0))
    assert values["joint_friction"] == pytest.approx(0.3, rel=0.05)
    assert found.problem.form("joint_friction") == "wound up"
    assert values["joint_wind_up"] == pytest.approx(wind_up, rel=0.3)


def test_friction_of_the_joint_competes_with_a_seal_there() -> None:
    seal = {"load_independent_friction": 0.0, "seal_proximal": 0.0, "seal_distal": 2.0}
    data = dataset({"load_independent_friction": seal}, duration=2.0)
    records, filtering = prepare(data, BENCH)
    crossed = fit_baseline(data, plant_of(data, BENCH, records), filtering, 0).crossed
    usual, rare = ("load_independent_friction",), ("joint_friction",)
    found = search(crossed, usual, rare=rare)
    assert found.rounds[0].added == usual[0]
    assert {c.id for c in found.rounds[0].candidates} == {*usual, *rare}


ROUND = {"eccentricity_cosine": 0.0, "ovality_cosine": 0.0, "ovality_sine": 0.0}


@pytest.mark.study
@pytest.mark.parametrize(
    ("effect", "values", "other"),
    [
        (
            "pulley_eccentricity",
            {**ROUND, "eccentricity_sine": 4e-4},
            "drum_winding",
        ),
        ("lever_geometry", {"arm_slope": 6e-3, "arm_bend": 0.0}, "pulley_eccentricity"),
        ("drum_winding", {"drum_growth": 6e-3}, "pulley_eccentricity"),
        (
            "torque_sensor_gain",
            {"joint_torque_gain": 0.05, "motor_torque_gain": 0.0},
            "asymmetric_friction",
        ),
        (
            "joint_gravity",
            {"gravity_sine": 1.0, "gravity_cosine": 0.5},
            "joint_stiffness",
        ),
        # A stop that never lets go is a spring.
        (
            "upper_joint_stop",
            {"upper_stop_stiffness": 1.0, "upper_stop_angle": -0.95},
            "joint_gravity",
        ),
    ],
)
def test_what_motions_cannot_separate_is_a_tie_with_a_trial_that_does(
    effect: str, values: dict[str, float], other: str
) -> None:
    data = dataset(duration=3.0)
    records, _ = prepare(data, BENCH)
    plant = plant_of(data, BENCH, records)
    shown = zip(plant.simulate({}), plant.simulate(values, (effect,)), strict=True)
    trials = [
        replace(
            trial,
            motor_torque=trial.motor_torque + (after - before)[0],  # type: ignore[operator]
            joint_torque=trial.joint_torque + (after - before)[1],  # type: ignore[operator]
        )
        for trial, (before, after) in zip(data.trials, shown, strict=True)
    ]
    given = replace(data, trials=tuple(trials))
    found = with_proposal(run_inference(given, BENCH)).diagnosis
    assert found.verdict == "tie", found.statement
    acts = "joint_stiffness" if effect == "upper_joint_stop" else effect
    assert set(found.ties[0]) == {acts, other}
    assert found.next_experiment is not None, found.statement


def test_a_stop_that_only_a_motion_far_beyond_reaches_is_no_stop() -> None:
    data = dataset(duration=2.0)
    records, filtering = prepare(data, BENCH)
    problem = fit_baseline(data, plant_of(data, BENCH, records), filtering, 0).problem
    for angle, far in ((0.5, False), (-2.0, True)):
        start = {"lower_stop_stiffness": 0.5, "lower_stop_angle": angle}
        wider = problem.with_effect("lower_joint_stop", start)
        reason = implausibility(wider, np.zeros(len(wider.tuned)))
        assert ("fits only with lower_stop_angle" in reason) is far


def test_a_joint_that_rests_keeps_its_friction_unless_it_is_lubricated() -> None:
    time = 0.01 * np.arange(400)
    angle = 0.2 * np.minimum(time, 2.0)
    moving = Signals(0.01, time, angle, angle, np.zeros(400), np.zeros(400))
    add = EFFECTS["joint_friction"].torques
    assert add is not None
    for form, rest in enumerate((-0.3, 0.0)):
        values = {"joint_friction": 0.3, "joint_wind_up": 1e-3}
        torque = add(moving, {**values, form_key("joint_friction"): form}).joint
        assert torque[100] == pytest.approx(-0.3)
        assert torque[300] == pytest.approx(rest)


def test_a_rare_effect_is_searched_where_the_error_is_not_explained() -> None:
    """Friction falls by a fifth from trial to trial."""
    parts = [
        dataset(duration=2.5, changes={"friction": 0.12 * factor}, chosen=(place,))
        for place, factor in enumerate((1.2, 1.0, 0.8))
    ]
    data = replace(parts[0], trials=tuple(part.trials[0] for part in parts))
    records, filtering = prepare(data, BENCH)
    plant = plant_of(data, BENCH, records)
    crossed = fit_baseline(data, plant, filtering, 0).crossed
    plain = search(crossed, ("torque_sensor_offset",))
    found = search_rare(plain, ("friction_by_order",))
    assert plain.after.problem.effects == ()
    assert found.after.problem.effects == ("friction_by_order",)
    problem = found.after.problem
    values = problem.values(np.mean([fit.x for fit in found.after.fits], axis=0))
    assert values["friction_per_trial"] == pytest.approx(-0.2, abs=0.01)
    explained = search_rare(found, RARE)
    assert explained is found


def test_rare_effects_pass_the_check_of_users_effects() -> None:
    data = dataset(duration=1.5)
    warm = [
        replace(trial, temperature=np.full(trial.time.size, 20.0 + k))
        for k, trial in enumerate(data.trials)
    ]
    records, _ = prepare(replace(data, trials=tuple(warm)), BENCH)
    known = {"neighbour_torque_nm": np.sin(records[0].time)}
    records = tuple(
        replace(r, columns={**known, "temperature_c": r.time}) for r in records
    )
    assert check_effects(SimulatedRig(BENCH, records, 4), {}, RARE) == ()


def test_rare_effects_are_not_among_the_usual_ones() -> None:
    assert RARE and not set(RARE) & set(usual_effects())


@pytest.mark.parametrize(
    ("effect", "form", "values"),
    [
        *(
            pytest.param(
                "stribeck_friction",
                form,
                {
                    "stribeck_friction": 0.08,
                    "stribeck_speed": 0.02,
                    "stribeck_slip": 2e-4,
                    "stribeck_friction_form": number,
                },
                marks=pytest.mark.study,
            )
            for form, number in (("Gaussian", 1.0), ("Lorentzian", 2.0))
        ),
        pytest.param(
            "backlash",
            "soft",
            {"backlash": 0.02, "backlash_form": 1.0},
            marks=pytest.mark.study,
        ),
        pytest.param("backlash", "hard", {"backlash": 0.02}, marks=pytest.mark.study),
    ],
)
def test_an_effect_of_the_library_is_fitted_in_its_best_form(
    effect: str, form: str, values: dict[str, float]
) -> None:
    found = run_inference(dataset({effect: values}, 2.5), BENCH, Options((effect,)))
    (named,) = found.diagnosis.effects
    assert (named.id, named.form) == (effect, form)
    assert named.parameters[effect].value == pytest.approx(values[effect], rel=0.1)


def test_an_eccentric_pulley_is_named_whatever_the_exit_angle() -> None:
    sizes = {"eccentricity_cosine": 1e-3, "eccentricity_sine": 5e-4}
    sizes |= {"ovality_cosine": 0.0, "ovality_sine": 0.0}
    name = "pulley_eccentricity"
    together = replace(BENCH, exit_angle=0.0)
    data = dataset({name: sizes}, 2.5, bench=together)
    found = run_inference(data, BENCH, Options((name,))).diagnosis
    (named,) = found.missing
    assert (named.id, named.form) == (name, EFFECTS["pulley_eccentricity"].forms[1])
    wanted = pytest.approx(1e-3, rel=0.1)
    assert named.parameters["eccentricity_cosine"].value == wanted


def test_a_soft_anchor_is_told_from_a_spring() -> None:
    values = {"anchor_compliance": 1e-4, "anchor_hardening": 0.01, "anchor_loss": 0.2}
    data = dataset({"soft_anchor": values}, duration=3.0, chosen=(0, 1, 2, 3))
    records, filtering = prepare(data, BENCH)
    crossed = fit_baseline(data, plant_of(data, BENCH, records), filtering, 0).crossed
    found = search(crossed, ("soft_anchor", "end_compliance")).after
    assert found.problem.effects == ("soft_anchor",) and found.misfit < 1.1
    fitted = found.problem.values(np.mean([fit.x for fit in found.fits], axis=0))
    for name, value in values.items():
        assert fitted[name] == pytest.approx(value, rel=0.05), name
