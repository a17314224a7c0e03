"""Accepted and rejected effects where other instruments measure the torques."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cc_mujoco.datasets import Bench
from cc_mujoco.datasets._data_findings import errors
from cc_mujoco.datasets._trials import TORQUE_SENSORS, Constant, Instruments
from cc_mujoco.diagnosis import (
    EFFECTS,
    Diagnosis,
    DiagnosisResult,
    Options,
    low_pass,
    repair_scene,
    run_inference,
    write,
)
from cc_mujoco.diagnosis._checks.readings import check_bench
from cc_mujoco.diagnosis._judge import declared_sentence
from cc_mujoco.diagnosis._report.output import (
    rollout_difference,
    write_and_compare_scene,
)
from cc_mujoco.diagnosis._rig.records import load_noise, load_torque
from cc_mujoco.diagnosis._rig.simulation import Library, SimulatedRig
from cc_mujoco.diagnosis.effects._effect import form_key
from cc_mujoco.errors import CableError
from diagnosis.instrumented import (
    ANKLE,
    FRICTION,
    SPRING,
    Hidden,
    loaded,
    played_by_mujoco,
    told_by,
    walked,
)
from diagnosis.recorded import BENCH, dataset
from diagnosis.rigs import alone
from study_marks import study_but

FEW = (
    "viscous_friction",
    "load_independent_friction",
    "joint_gravity",
    "motor_inertia",
)
TUNED = {"friction": 0.13, "axial_stiffness": 47e3, "pretension": 82.0}
BOTH = ("motor_torque_nm", "joint_torque_nm")


def named(found: Diagnosis) -> list[str]:
    return [effect.id for effect in found.effects]


def library_of(
    cables: int,
    instruments: Instruments,
    constants: Mapping[str, Constant] | None = None,
) -> Library:
    bench = replace(BENCH, cables=BENCH.cables[:cables])
    return SimulatedRig(bench, (), 4, 1, instruments, constants or {}).library


def judged(kind: str, effects: Hidden, bench: Bench = BENCH) -> DiagnosisResult:
    data = told_by(kind, effects, bench, changes=TUNED)
    return run_inference(data, bench, Options(FEW))


@pytest.mark.study
def test_a_rotor_that_is_declared_is_no_inertia_that_is_missing() -> None:
    """The commanded torque of a motor also accelerates its rotor."""
    data = dataset({"motor_inertia": {"motor_inertia": 3e-3}}, 1.6, 3)
    assert named(run_inference(data, BENCH, Options(FEW)).diagnosis) == [
        "motor_inertia"
    ]
    told = replace(data, constants={"rotor_inertia": Constant(3e-3)})
    assert run_inference(told, BENCH, Options(FEW)).diagnosis.verdict == "none"


@pytest.mark.parametrize(
    ("kind", "cables", "rows", "unseen"),
    [
        ("cells", 2, BOTH, {"joint_gravity", "motor_inertia"}),
        pytest.param(
            *("motor", 1, BOTH[:1], {"joint_gravity"}), marks=pytest.mark.study
        ),
    ],
)
def test_an_effect_in_the_conduit_is_named_and_what_cannot_be_seen_is_told(
    tmp_path: Path,
    kind: str,
    cables: int,
    rows: tuple[str, ...],
    unseen: set[str],
) -> None:
    bench = BENCH if cables == 2 else Bench.of(alone(tmp_path))
    # One torque has to be further off before anything is named.
    drag = 40.0 if cables == 2 else 60.0
    result = judged(kind, {"viscous_friction": {"viscous_friction": drag}}, bench)
    found = result.diagnosis
    assert found.verdict == "named", found.statement
    assert named(found) == ["viscous_friction"]
    fitted = found.effects[0].parameters["viscous_friction"]
    assert fitted.value == pytest.approx(drag, rel=0.1)
    assert tuple(found.gap) == rows
    assert ("friction_balance" in found.baseline.parameters) is (cables == 2)
    reasons = {each.id: each.reason for each in found.not_testable}
    assert unseen <= reasons.keys()
    for name in unseen:
        assert "it takes a torque sensor" in reasons[name]
    write_and_compare_scene(result, tmp_path / "repaired.xml")
    _, apart, size = rollout_difference(result, tmp_path / "repaired.xml")
    assert apart < 1e-3 * size


def test_nothing_is_named_where_nothing_is_missing() -> None:
    found = judged("joint", {}).diagnosis
    assert (found.verdict, named(found)) == ("none", []), found.statement
    assert "motor_inertia" in {each.id for each in found.not_testable}


@pytest.mark.study
def test_friction_of_the_motor_hides_friction_that_needs_no_tension() -> None:
    seals: Hidden = {
        "load_independent_friction": {
            "load_independent_friction": 0.0,
            "seal_proximal": 4.0,
            "seal_distal": 0.0,
        }
    }
    data = told_by("current", seals, duration=2.5, changes=TUNED)
    ids = ("viscous_friction", "load_independent_friction")
    found = run_inference(data, BENCH, Options(ids)).diagnosis
    assert (found.verdict, named(found)) == ("none", []), found.statement
    told = found.baseline.parameters["motor_friction"].value
    assert told == pytest.approx(FRICTION + 2 * 4.0 * BENCH.motor_radius, rel=0.1)
    # What is left of it lies in the few moments of reversals, which is no evidence.
    (refitted,) = found.runner_ups
    (close,) = [c for c in refitted if c.id == "load_independent_friction"]
    assert close.parameters["seal_proximal"] == pytest.approx(4.0, rel=0.1)
    assert "standard errors" in close.reason
    assert "a few moments make that error" in found.statement


def test_friction_of_the_motor_may_wind_up() -> None:
    data = told_by("current", {}, duration=2.5, changes=TUNED, wind_up=0.02)
    found = run_inference(data, BENCH, Options(FEW)).diagnosis
    assert found.verdict == "none", found.statement
    told = found.baseline.parameters
    assert told["motor_friction"].value == pytest.approx(FRICTION, rel=0.05)
    assert told["motor_wind_up"].value == pytest.approx(0.02, rel=0.1)
    assert found.remaining < 1.2 and not found.deviating


@pytest.mark.parametrize(
    ("share", "changes", "name", "value"),
    [
        pytest.param(
            *(1.0, {"end_compliance": 2e-5}, "end_compliance", 2e-5),
            marks=pytest.mark.study,
        ),
        (0.9, {}, "joint_stiffness", -0.1 * SPRING),
    ],
)
def test_a_known_load_stands_in_for_the_joint_s_sensor(
    share: float, changes: dict[str, float], name: str, value: float
) -> None:
    data = loaded({**TUNED, **changes}, share * SPRING)
    ids = ("viscous_friction", "joint_stiffness", "end_compliance")
    found = run_inference(data, BENCH, Options(ids)).diagnosis
    assert (found.verdict, named(found)) == ("named", [name]), found.statement
    assert found.effects[0].parameters[name].value == pytest.approx(value, rel=0.1)


@pytest.mark.parametrize(
    "motor", ["torque sensor", "load cells", "motor current", None]
)
@pytest.mark.parametrize("joint", ["torque sensor", "load cells", "known load", None])
@pytest.mark.parametrize("cables", [1, 2])
def test_every_effect_is_either_seen_or_told_why_not(motor, joint, cables) -> None:
    seen = library_of(cables, Instruments(motor, joint))
    assert seen.effects.keys() | seen.hidden.keys() == EFFECTS.keys()
    assert not seen.effects.keys() & seen.hidden.keys()
    for name, effect in seen.effects.items():
        kept = {parameter.name for parameter in effect.parameters}
        assert kept and kept <= {p.name for p in EFFECTS[name].parameters}
        assert all(start.keys() - {form_key(name)} == kept for start in effect.starts)
        if joint in (None, "known load"):
            assert not any(each.startswith("joint_torque_") for each in kept)


def test_a_declared_fact_removes_or_bounds_effects() -> None:
    known = {
        "balanced": Constant(1.0),
        "joint_spring": Constant(0.0),
        "zeroed": Constant(1.0),
        "gain_uncertainty": Constant(0.01),
    }
    free = library_of(2, TORQUE_SENSORS)
    bound = library_of(2, TORQUE_SENSORS, constants=known)
    assert free.effects.keys() - bound.effects.keys() == {
        "joint_gravity",
        "joint_stiffness",
    }
    offset, gain = (
        bound.effects[f"torque_sensor_{name}"].parameters for name in ("offset", "gain")
    )
    assert {each.name for each in offset} == {
        "motor_torque_drift",
        "joint_torque_drift",
    }
    assert all(each.plausible == pytest.approx((-0.03, 0.03)) for each in gain)
    assert "(balanced = true)" in declared_sentence(bound.declared)
    assert "joint_spring = false" in bound.declared["joint_stiffness"]
    assert "gain_uncertainty = 0.01" in bound.declared["torque_sensor_gain"]
    assert not declared_sentence(free.declared)


def test_a_pulley_is_eccentric_in_either_geometry_unless_one_is_declared() -> None:
    declared = {"exit_angle": Constant(np.pi)}
    free, one, known = (
        library_of(cables, TORQUE_SENSORS, constants=constants).effects[
            "pulley_eccentricity"
        ]
        for cables, constants in ((2, {}), (1, {}), (2, declared))
    )
    assert len(free.forms) == len(free.starts) == 2
    for effect in (one, known):
        assert effect.forms == () and len(effect.starts) == 1


def test_a_load_takes_the_torque_of_its_parts() -> None:
    step, rate = 0.002, 6.0
    time = step * np.arange(2000)
    angle = 0.3 * np.sin(rate * time)
    values = {
        "load_stiffness": 2.0,
        "load_rest_angle": 0.1,
        "load_inertia": 0.02,
        "load_damping": 0.3,
        "load_weight": 1.5,
        "load_hanging_angle": -0.2,
    }
    wanted = (
        2.0 * (angle - 0.1)
        - 0.02 * rate**2 * angle
        + 0.3 * 0.3 * rate * np.cos(rate * time)
        + 1.5 * np.sin(angle + 0.2)
    )
    found = load_torque(angle, step, values)
    assert found[5:-5] == pytest.approx(wanted[5:-5], abs=1e-3)
    turned = load_torque(angle, step, values, tilt=0.7)
    wanted += 1.5 * (np.sin(angle + 0.9) - np.sin(angle + 0.2))
    assert turned[5:-5] == pytest.approx(wanted[5:-5], abs=1e-3)


def test_noise_of_a_load_is_that_of_its_angle() -> None:
    inertia = {"load_inertia": Constant(0.02), "load_stiffness": Constant(3.0)}
    random = np.random.default_rng(4)
    scatter = low_pass(1e-4 * random.standard_normal(20000), 60.0, 500.0)
    values = {name: each.value for name, each in inertia.items()}
    shaken = low_pass(load_torque(scatter, 0.002, values), 25.0, 500.0)
    told = load_noise(inertia, 1e-4, 500.0, (25.0, 60.0))
    assert 0.9 * np.std(shaken) < told < 1.5 * np.std(shaken)


@pytest.mark.study
def test_a_cable_on_a_lever_is_what_mujoco_plays() -> None:
    lever = ANKLE.lever
    assert lever is not None and lever.sign == -1.0
    step = 5e-4
    time = step * np.arange(1200)
    joint = 0.35 * np.sin(8.0 * time)
    ratio = ANKLE.joint_radius / ANKLE.motor_radius
    motor = ratio * lever.turned(joint) + 0.4 * np.sin(6.0 * time) ** 2
    played = ANKLE.transmission.replay(
        step, motor_angle=motor, joint_angle=lever.turned(joint)
    )
    proximal, distal, arm = played_by_mujoco(ANKLE, step, motor, -joint)
    most = played.tension_distal.max()
    assert most > 50.0
    assert played.tension_proximal[0] == pytest.approx(proximal, abs=1e-5 * most)
    assert played.tension_distal[0] == pytest.approx(-distal, abs=1e-5 * most)
    assert ANKLE.joint_radius * lever.share(joint) == pytest.approx(arm, rel=1e-5)


@pytest.mark.parametrize(
    ("effects", "name"),
    study_but(
        2, [({"end_compliance": {"end_compliance": 1e-5}}, "end_compliance"), ({}, "")]
    ),
)
def test_a_cable_to_a_lever_is_diagnosed(effects: Hidden, name: str) -> None:
    changes = {"friction": 0.11, "axial_stiffness": 55e3}
    data = walked(effects, 2.4, changes)
    ids = ("end_compliance", "viscous_friction")
    found = run_inference(data, ANKLE, Options(ids)).diagnosis
    assert named(found) == [name] * bool(name), found.statement
    assert found.verdict == ("named" if name else "none")
    for key, value in changes.items():
        assert found.baseline.parameters[key].value == pytest.approx(value, rel=0.02)
    if name:
        fitted = found.effects[0].parameters[name]
        assert fitted.value == pytest.approx(effects[name][name], rel=0.05)


def test_a_zero_of_the_joint_by_which_a_lever_has_another_arm_is_told() -> None:
    data = walked({}, 1.5)
    turned = replace(
        data,
        trials=tuple(
            replace(trial, joint_angle=trial.joint_angle - 0.15)
            for trial in data.trials
        ),
    )
    (away,) = run_inference(
        turned, ANKLE, Options(("viscous_friction",))
    ).diagnosis.deviating
    assert away.parameter == "joint_angle_offset" and away.given == 0.0
    assert away.tuned.value == pytest.approx(0.15, abs=0.02)
    assert "the arm of the cable hangs on that angle" in away.statement
    assert (
        run_inference(data, ANKLE, Options(("viscous_friction",))).diagnosis.deviating
        == ()
    )


def test_a_weight_at_a_joint_acts_by_its_angle_not_by_its_encoder(
    tmp_path: Path,
) -> None:
    data = walked({}, 1.5)
    trials = []
    for trial in data.trials:
        assert trial.joint_torque is not None
        angle = trial.joint_angle
        taken = 15.0 * np.sin(angle)
        trials.append(
            replace(
                trial, joint_angle=angle - 0.15, joint_torque=trial.joint_torque - taken
            )
        )
    turned = replace(data, trials=tuple(trials))
    result = run_inference(turned, ANKLE, Options(("joint_gravity",)))
    (found,) = result.diagnosis.effects
    for key, size in {"gravity_sine": 15.0, "gravity_cosine": 0.0}.items():
        assert found.parameters[key].value == pytest.approx(size, abs=0.4)
    _, apart, size = _written(result, tmp_path / "scene.xml")
    assert apart < 2e-2 * size


@pytest.mark.study
@pytest.mark.parametrize("name", ["joint_gravity", "joint_stiffness"])
def test_a_scene_with_pulleys_has_weights_where_the_encoder_saw_them(
    tmp_path: Path, name: str
) -> None:
    """The angle of the scene is the measured angle plus an offset."""
    data = dataset(duration=1.5, seed=3, chosen=(0, 2))
    trials = []
    for trial in data.trials:
        assert trial.joint_torque is not None
        read = trial.joint_angle - 0.5
        taken = 2.0 * (np.sin(read) if name == "joint_gravity" else read)
        trials.append(
            replace(trial, joint_angle=read, joint_torque=trial.joint_torque - taken)
        )
    turned = replace(data, trials=tuple(trials))
    result = run_inference(turned, BENCH, Options((name,)))
    assert [found.id for found in result.diagnosis.effects] == [name]
    _, apart, size = _written(result, tmp_path / "scene.xml")
    assert apart < 2e-2 * size


def test_what_was_found_in_the_cable_of_a_lever_is_written(tmp_path: Path) -> None:
    stiffer = tuple(cable.replace(friction=0.2) for cable in ANKLE.cables)
    write(tmp_path / "scene.xml", repair_scene(ANKLE, stiffer, {}))
    again = Bench.of(tmp_path / "scene.xml")
    assert again.cables == stiffer
    assert again.joint_radius == pytest.approx(ANKLE.joint_radius, rel=1e-6)
    with pytest.raises(CableError, match="take the values from"):
        repair_scene(ANKLE, stiffer, {"backlash": {"backlash": 0.02}})


def test_what_was_found_outside_the_cable_of_a_lever_moves_its_scene() -> None:
    """Forces match the formulas of the effects, positive in the direction of pull."""
    effects = {
        "joint_stiffness": {"joint_stiffness": 3.0, "joint_stiffness_moment": 0.4},
        "joint_gravity": {"gravity_sine": 2.0, "gravity_cosine": 1.5},
        "joint_inertia": {"joint_inertia": 0.02},
        "motor_inertia": {"motor_inertia": 1e-3},
        "motor_cogging": {
            "cogging_cosine": 0.05, "cogging_sine": 0.02, "cogging_order": 6.0
        },
    }  # fmt: skip
    stiffer = tuple(cable.replace(friction=0.2) for cable in ANKLE.cables)
    plain = repair_scene(ANKLE, stiffer, {}).compile()
    model = repair_scene(ANKLE, stiffer, effects).compile()
    motor, joint, sign = 0.3, 0.2, ANKLE.lever.sign if ANKLE.lever else 1.0
    forces = []
    for each in (plain, model):
        data = mujoco.MjData(each)
        data.joint(ANKLE.motor).qpos[0] = motor
        data.joint(ANKLE.joint).qpos[0] = sign * joint
        mujoco.mj_forward(each, data)
        net = data.qfrc_passive + data.qfrc_actuator
        forces.append(
            [net[each.joint(n).dofadr[0]] for n in (ANKLE.motor, ANKLE.joint)]
        )
    changed = np.array(forces[1]) - forces[0]
    cogging = 0.05 * np.cos(6.0 * motor) + 0.02 * np.sin(6.0 * motor)
    against = 3.0 * joint + 0.4 + 2.0 * np.sin(joint) + 1.5 * np.cos(joint)
    assert changed == pytest.approx([-cogging, -sign * against], abs=1e-6)
    heavier = [
        model.dof_M0[model.joint(n).dofadr[0]] - plain.dof_M0[plain.joint(n).dofadr[0]]
        for n in (ANKLE.motor, ANKLE.joint)
    ]
    assert heavier == pytest.approx([1e-3, 0.02])
    assert not any(model.tuple(k).name for k in range(model.ntuple))


def test_angles_beyond_the_lever_are_told() -> None:
    (trial, *_) = walked({}, 1.0).trials
    assert not errors(check_bench([trial], ANKLE))
    turned = replace(trial, joint_angle=trial.joint_angle + 0.8)
    (wrong,) = errors(check_bench([turned], ANKLE))
    assert "declare offset and sign of [columns.joint_angle_rad]" in wrong.statement


def _written(result: DiagnosisResult, path: Path) -> tuple[str, float, float]:
    """Return the `rollout_difference` of the repaired scene."""
    write_and_compare_scene(result, path)
    return rollout_difference(result, path)
