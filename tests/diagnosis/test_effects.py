"""The library of effects: off is off, on is on, and every entry is complete."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco.cable import TERMS, Cable, Parameter
from cc_mujoco.diagnosis import (
    EFFECTS,
    EffectParameter,
    Options,
    prepare,
    run_inference,
)
from cc_mujoco.diagnosis._fit.problem import tuned_effect_parameter
from cc_mujoco.diagnosis._rig.simulation import SimulatedRig, baseline_parameters
from cc_mujoco.diagnosis._scene.realisation import REALISATIONS
from cc_mujoco.diagnosis.effects import _cable_effects, _drive_effects
from cc_mujoco.diagnosis.effects._effect import RigGeometry, TrialConditions, form_key
from diagnosis.recorded import BENCH, dataset

IDS = """viscous_friction grease_drag stribeck_friction presliding
load_independent_friction asymmetric_friction tension_dependent_friction
dwell_dependent_stiction configuration_dependent_wrap pretension_loss friction_drift
backlash pulley_eccentricity motor_cogging cable_stiffening end_compliance
joint_gravity joint_stiffness joint_inertia motor_inertia torque_sensor_gain
torque_sensor_offset sensor_delay""".split()
DRAG = ("joint_drag", "joint_inertia")


@pytest.fixture(scope="module")
def plant() -> SimulatedRig:
    """Return a rig of which effects know all that they may take."""
    records, _ = prepare(dataset(duration=2.0), BENCH)
    conditions = TrialConditions(1.0, 2.0, 0.5)
    known = {
        name: np.sin(records[0].time) for e in EFFECTS.values() for name in e.columns
    }
    return SimulatedRig(
        BENCH,
        tuple(replace(r, conditions=conditions, columns=known) for r in records),
        8,
    )


def test_the_library_has_the_ids_that_verdicts_promise() -> None:
    assert set(IDS) <= set(EFFECTS)


def test_every_function_is_of_an_effect_that_has_it() -> None:
    for name, fields in (_cable_effects.ACTIONS | _drive_effects.ACTIONS).items():
        for field, function in fields.items():
            assert getattr(EFFECTS[name], field) is function


def test_every_term_of_a_cable_can_be_named() -> None:
    given, rig = (Cable(), Cable()), RigGeometry(0.02, 0.05, math.pi)
    named = {"friction", "static_friction"}  # of the baseline
    named.add("clearance")  # its torques are those of a cable that stiffens
    # Of the motor's fastener, which is of metal.
    named |= {"proximal_hardening", "proximal_loss"}
    for effect in EFFECTS.values():
        for cable in (
            effect.cables(given, effect.starts[-1], rig) if effect.cables else ()
        ):
            named |= cable.terms.keys()
    assert named == set(TERMS)


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_at_0_leaves_cables_with_soft_ends_as_they_are(name: str) -> None:
    soft = {"compliance": 1e-4, "hardening": 0.02, "loss": 0.2}
    ends = [
        (f"{end}_{key}", v) for end in ("end", "proximal") for key, v in soft.items()
    ]
    given = (Cable(pretension=10.0).replace(**dict(ends)),) * 2
    effect, rig = EFFECTS[name], RigGeometry(0.02, 0.05, math.pi)
    if effect.cables:
        off = {
            parameter.name: 0.0
            if parameter.linear
            else effect.starts[0][parameter.name]
            for parameter in effect.parameters
        }
        for cable in effect.cables(given, off, rig):
            for key, value in ends:
                assert getattr(cable, key) == value


@pytest.mark.parametrize("name", EFFECTS)
def test_off_is_the_baseline_bit_for_bit_and_on_is_not(
    name: str, plant: SimulatedRig
) -> None:
    effect = EFFECTS[name]
    values = {p.name: p.start for p in baseline_parameters(BENCH, plant.records, {})}
    plain = plant.simulate(values)
    off = {
        parameter.name: 0.0 if parameter.linear else effect.starts[0][parameter.name]
        for parameter in effect.parameters
    }
    for a, b in zip(plain, plant.simulate({**values, **off}, (name,)), strict=True):
        assert np.array_equal(a, b)
    starts = effect.starts if effect.rare else effect.starts[-1:]
    shown = [plant.simulate({**values, **start}, (name,)) for start in starts]
    assert any(
        float(np.max(np.abs(a - b))) > 1e-4
        for on in shown
        for a, b in zip(plain, on, strict=True)
    )


def test_compliance_beyond_the_softest_end_ends_at_it() -> None:
    given = (Cable(pretension=10.0, end_compliance=1.0),) * 2
    effect, rig = EFFECTS["end_compliance"], RigGeometry(0.02, 0.05, math.pi)
    assert effect.cables
    made = effect.cables(given, {p.name: 1e-5 for p in effect.parameters}, rig)
    assert [cable.end_compliance for cable in made] == [1.0, 1.0]


@pytest.mark.parametrize("name", EFFECTS)
@given(corner=st.randoms(use_true_random=False), radius=st.sampled_from((0.05, 0.004)))
@settings(max_examples=10)
def test_a_fit_that_ends_at_its_bounds_ends_at_a_cable(
    name: str, corner: random.Random, radius: float, plant: SimulatedRig
) -> None:
    """Even where rounding takes a logarithm beyond its bound, and at the other ends."""
    bench = replace(plant.bench, motor_radius=radius, joint_radius=radius)
    plant = replace(plant, bench=bench)
    values = {
        p.name: p.value(corner.choice((p.low, 0.0, p.high)))
        for p in baseline_parameters(bench, plant.records, {})
    }
    start = corner.choice(EFFECTS[name].starts)
    for parameter in EFFECTS[name].parameters:
        knob = tuned_effect_parameter(parameter, start[parameter.name], plant)
        value = knob.value(corner.choice((knob.low, 0.0, knob.high)))
        assert parameter.parameter.admits(value)
        values[parameter.name] = value
    assert len(plant.cables(values, (name,))) == 2


def test_an_effect_that_is_registered_late_is_looked_for(
    plant: SimulatedRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    drag = replace(
        EFFECTS["joint_inertia"],
        id="joint_drag",
        parameters=(
            EffectParameter(
                Parameter("joint_drag", "N m s/rad", low=0.0, high=10.0), 0.01
            ),
        ),
        starts=({"joint_drag": 0.01},),
        torques=lambda shown, values: shown.added(
            joint=-values["joint_drag"] * np.gradient(shown.joint_angle, shown.dt)
        ),
    )
    assert "joint_drag" not in plant.library.effects
    monkeypatch.setitem(EFFECTS, "joint_drag", drag)
    later = replace(plant)
    assert later.library.effects["joint_drag"] == drag
    later.simulate({}, ("joint_drag",))
    found = run_inference(
        dataset({"joint_drag": {"joint_drag": 0.3}}, 2.0),
        BENCH,
        Options(DRAG),
    )
    assert [effect.id for effect in found.diagnosis.effects] == ["joint_drag"]


@pytest.mark.parametrize("name", EFFECTS)
def test_entries_are_complete(name: str) -> None:
    effect = EFFECTS[name]
    assert effect.id == name
    for text in (
        effect.title,
        effect.equation,
        effect.required_excitation,
        effect.source,
    ):
        assert text
    assert set(effect.confounded_with) <= set(EFFECTS) - {name}
    assert set(effect.generalises) <= set(effect.confounded_with)
    known = [parameter.parameter for parameter in effect.parameters]
    assert any(parameter.admits(0.0) for parameter in known)
    assert all(parameter.unit and parameter.meaning for parameter in known)
    for start in effect.starts:
        own = {parameter.name for parameter in effect.parameters}
        assert set(start) - {form_key(effect.id)} == own
        for parameter in effect.parameters:
            assert parameter.parameter.admits(start[parameter.name])
    in_scene = effect.cables is not None or name in REALISATIONS
    assert in_scene or effect.rare


def test_an_eccentric_pulley_is_as_far_out_where_each_cable_leaves_it() -> None:
    """At the angle after which the antagonist leaves, its lever is the agonist's."""
    values = {
        "eccentricity_cosine": 3e-4,
        "eccentricity_sine": -4e-4,
        "ovality_cosine": 1e-4,
        "ovality_sine": 2e-4,
    }
    change = EFFECTS["pulley_eccentricity"].cables
    assert change is not None
    for apart in (0.0, 2.0, math.pi, 2.0 * math.pi):
        agonist, antagonist = change(
            (Cable(),) * 2, values, RigGeometry(0.02, 0.05, apart)
        )
        for q in (0.0, 0.7, -3.0):
            levers = [
                cable.eccentricity * math.cos(at - cable.eccentricity_phase)
                + cable.ovality * math.cos(2.0 * at - cable.ovality_phase)
                for cable, at in ((agonist, q), (antagonist, q + apart))
            ]
            assert levers[0] == pytest.approx(levers[1], abs=1e-12)
