"""Properties of every cable: tests with random parameters, term by term."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cable.random_cables import CABLES, cable_of, motion_of, turned_around
from cc_mujoco.cable import (
    PARAMETERS,
    TERMS,
    Cable,
    Section,
    Transmission,
    packed_parameters,
    replay,
)
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable._conduit import segment_lengths
from cc_mujoco.cable._friction import drag, ratio

SEEDS = st.integers(0, 2**31)
WITH_CONSTANT_COEFFICIENTS = [
    name
    for name in CABLES
    if not any(
        term.depends_on or term.acts_on == "elasticity"
        for term in cable_of(np.random.default_rng(0), name).terms.values()
    )
]
VANISHING = [
    pytest.param(name, 1e-7 if term.acts_on == "drag" else 1e-9, id=name)
    for name, term in TERMS.items()
    if term.acts_on != "pulley" and name not in ("friction", "static_friction")
]
END_BY_END = ("configuration_dependent",)  # belongs to the distal end


def test_there_are_random_cables_with_every_term():
    drawn = set()
    for name in CABLES:
        for seed in range(5):
            drawn |= set(cable_of(np.random.default_rng(seed), name).terms)
    assert drawn == {name for name, term in TERMS.items() if term.acts_on != "pulley"}


def difference(one, other):
    """Return the RMS difference over the largest magnitude."""
    largest = max(np.abs(one).max(), np.abs(other).max(), 1e-9)
    return math.sqrt(np.mean((one - other) ** 2)) / largest


def beyond_friction(cable, tension):
    """Return the largest tension step beyond friction, over the largest tension."""
    prm, n = packed_parameters(cable), cable.segments
    values = prm[: len(PARAMETERS)]
    coefficient = max(cable.friction, cable.static_friction)
    left, right = tension[:, :-1], tension[:, 1:]
    hold, free, length = np.empty(n), np.empty(n), segment_lengths(cable)
    for j, angle in enumerate(kernel.segment_angles(prm, n)):
        hold[j] = ratio(coefficient, angle)
        free[j] = drag(values, length[j], ratio(cable.friction, angle), j, n)
    excess = max((right - hold * left - free).max(), (left - hold * right - free).max())
    return excess / (tension.max() + 1.0)


@pytest.mark.parametrize("term", WITH_CONSTANT_COEFFICIENTS)
@given(seed=SEEDS)
@settings(max_examples=40)
def test_no_segment_carries_more_than_friction_holds(term, seed):
    rng = np.random.default_rng(seed)
    cable = cable_of(rng, term)
    proximal, distal = motion_of(rng, cable)
    motion = replay(cable, 1e-3, u_proximal=proximal, u_distal=distal, profile=True)
    assert beyond_friction(cable, motion.tension) < 1e-9


@pytest.mark.parametrize("term", ["coulomb", "seals", "static", "static_memory"])
@given(seed=SEEDS)
@settings(max_examples=40)
def test_friction_never_acts_with_the_slip(term, seed):
    rng = np.random.default_rng(seed)
    cable = cable_of(rng, term)
    proximal, distal = motion_of(rng, cable)
    motion = replay(cable, 1e-3, u_proximal=proximal, u_distal=distal, profile=True)
    friction = np.diff(motion.tension, axis=1)
    rounding = 1e-9 * (motion.tension.max() + 1.0)
    assert np.all(friction * motion.direction >= -rounding)


@pytest.mark.parametrize("drag", ["coulomb", "load_independent", "seals"])
@given(seed=SEEDS)
@settings(max_examples=4)
def test_energy_of_bristles_adds_up_where_the_cable_goes_slack(drag, seed):
    rng = np.random.default_rng(seed)
    cable = cable_of(rng, drag).replace(
        pretension=rng.choice([0.5, 2.0, 10.0]),
        bristle_length=10 ** rng.uniform(-5, -3),
    )
    proximal, distal = motion_of(rng, cable)
    fine = np.arange(0.0, proximal.size - 1, 1.0 / 16.0)
    proximal, distal = (
        np.interp(fine, np.arange(proximal.size), end) for end in (proximal, distal)
    )
    motion = replay(cable, 1e-3 / 16.0, u_proximal=proximal, u_distal=distal)
    pull, give = motion.tension_distal, motion.tension_proximal
    work = 0.5 * (pull[1:] + pull[:-1]) @ np.diff(distal)
    work -= 0.5 * (give[1:] + give[:-1]) @ np.diff(proximal)
    stored = motion.stored[-1] - motion.stored[0]
    scale = motion.stored.max() + motion.dissipated[-1] + 1e-6
    assert abs(work - stored - motion.dissipated[-1]) < 0.02 * scale


@pytest.mark.parametrize("term", [term for term in CABLES if term not in END_BY_END])
@given(seed=SEEDS)
@settings(max_examples=5)
def test_a_cable_turned_around_pulls_alike(term, seed):
    rng = np.random.default_rng(seed)
    cable = cable_of(rng, term)
    proximal, distal = motion_of(rng, cable)
    one = replay(cable, 1e-3, u_proximal=proximal, u_distal=distal)
    other = replay(turned_around(cable), 1e-3, u_proximal=-distal, u_distal=-proximal)
    assert difference(one.tension_proximal, other.tension_distal) < 5e-3
    assert difference(one.tension_distal, other.tension_proximal) < 5e-3


@given(seed=SEEDS)
@settings(max_examples=60)
def test_static_friction_barely_above_kinetic_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    cable = cable_of(rng)
    proximal, distal = motion_of(rng, cable)
    kinetic = replay(cable, 1e-3, u_proximal=proximal, u_distal=distal)
    static = cable.replace(static_friction=cable.friction * (1.0 + 1e-6))
    held = replay(static, 1e-3, u_proximal=proximal, u_distal=distal)
    assert difference(held.tension_proximal, kinetic.tension_proximal) < 1e-3
    assert difference(held.tension_distal, kinetic.tension_distal) < 1e-3


@pytest.mark.parametrize(("term", "small"), VANISHING)
@given(seed=SEEDS)
@settings(max_examples=4)
def test_a_vanishing_term_changes_nothing(term, small, seed):
    rng = np.random.default_rng(seed)
    spring = term.replace("hardening", "compliance").replace("loss", "compliance")
    soft = {} if spring == term else {spring: 1e-5}
    cable = cable_of(rng).replace(pretension=20.0, segments=50, **soft)
    proximal, distal = motion_of(rng, cable)
    without = replay(cable, 1e-3, u_proximal=proximal, u_distal=distal)
    there = replay(
        cable.replace(**{term: small}), 1e-3, u_proximal=proximal, u_distal=distal
    )
    # Not smaller: these terms resolve the point where motion turns to a segment only.
    assert difference(there.tension_proximal, without.tension_proximal) < 0.1
    assert difference(there.tension_distal, without.tension_distal) < 0.1


@given(seed=SEEDS)
@settings(max_examples=60)
def test_a_prescribed_tension_pulls_the_other_end_as_far_as_friction_lets_it(seed):
    rng = np.random.default_rng(seed)
    cable = cable_of(rng)
    proximal, distal = motion_of(rng, cable)
    pull = 50.0 + 40.0 * proximal / max(np.abs(proximal).max(), 1e-12)
    motion = replay(cable, 1e-3, tension_proximal=pull, u_distal=distal)
    ratio = math.exp(cable.friction * cable.wrap) * (1.0 + 1e-9)
    assert np.all(motion.tension_distal <= pull * ratio)
    assert np.all(motion.tension_distal * ratio >= pull)
    mirrored = replay(
        turned_around(cable), 1e-3, u_proximal=-distal, tension_distal=pull
    )
    assert difference(mirrored.tension_proximal, motion.tension_distal) < 1e-3
    assert difference(-mirrored.u_distal, motion.u_proximal) < 1e-3


@pytest.mark.parametrize("pulled", [0.006, 0.008, 0.01])
def test_a_cable_that_beds_in_is_pulled_far_in_one_step(pulled):
    cable = Cable(
        friction=0.2,
        pretension=10.0,
        axial_stiffness=4000.0,
        conduit=(Section(1.0, 0.3),),
        segments=10,
        bedding_strain=5e-3,
    )
    proximal = np.array([0.0, -pulled, -pulled, -pulled])
    motion = replay(
        cable, 1e-3, u_proximal=proximal, u_distal=0.0 * proximal, profile=True
    )
    assert np.all(np.diff(motion.tension[1]) < 0.0)
    assert beyond_friction(cable, motion.tension[1:]) < 1e-4
    assert motion.tension[3] == pytest.approx(motion.tension[1], rel=1e-4)


def test_slack_cable_with_drag_carries_no_more_than_its_drag():
    cable = Cable(
        axial_stiffness=2e4,
        pretension=10.0,
        friction=0.1,
        load_independent_friction=0.2,
        segments=20,
        conduit=(Section(0.09, math.inf), Section(0.12, 0.1), Section(0.09, math.inf)),
    )
    time = np.arange(0.0, 2.0, 1e-3)
    proximal = 0.01 * np.sin(2 * np.pi * 1.3 * time)
    distal = 0.01 * np.sin(2 * np.pi * 2.9 * time)
    dragged = replay(cable, 1e-3, u_proximal=proximal, u_distal=distal)
    free = replay(
        cable.replace(load_independent_friction=0.0),
        1e-3,
        u_proximal=proximal,
        u_distal=distal,
    )
    slack = (free.tension_distal == 0.0) & (free.tension_proximal == 0.0)
    assert np.sum(slack) > 500
    limit = 0.2 * cable.length * math.exp(cable.friction * cable.wrap)
    assert dragged.tension_distal[slack].max() < 2.0 * limit
    assert dragged.tension_proximal[slack].max() < 2.0 * limit
    assert dragged.dissipated[-1] == pytest.approx(free.dissipated[-1], rel=0.01)


@pytest.mark.parametrize("at_distal", [False, True])
def test_a_constant_tension_at_one_end_reaches_the_other(at_distal):
    cable = Cable(friction=0.1, conduit=(Section(0.6, 0.3), Section(0.4, math.inf)))
    swing = 0.01 * np.sin(2 * np.pi * 1.5 * np.arange(998) * 1e-3)
    pull = np.full(998, 60.0)
    if at_distal:
        cable = turned_around(cable)
        motion = replay(cable, 1e-3, u_proximal=-swing, tension_distal=pull)
        other = motion.tension_proximal
    else:
        motion = replay(cable, 1e-3, tension_proximal=pull, u_distal=swing)
        other = motion.tension_distal
    ratio = math.exp(cable.friction * cable.wrap)
    assert other[1:].min() == pytest.approx(60.0 / ratio, rel=1e-9)
    assert other[1:].max() == pytest.approx(60.0 * ratio, rel=1e-9)


def test_a_motor_torque_on_two_cables_reaches_the_joint():
    cable = Cable(
        friction=0.1,
        pretension=60.0,
        conduit=(Section(0.6, 0.3), Section(0.4, math.inf)),
    )
    drive = Transmission.pull_pull(cable, motor_radius=0.02, joint_radius=0.03)
    time = np.arange(2001) * 1e-3
    swing = 0.3 * np.sin(2 * np.pi * 1.5 * time)
    torque = 0.3 * np.sin(2 * np.pi * 0.4 * time)
    motion = drive.replay(1e-3, motor_torque=torque, joint_angle=swing)
    proximal, distal = motion.tension_proximal, motion.tension_distal
    ratio = math.exp(cable.friction * cable.wrap)
    # But in single steps, where fronts meet.
    assert np.mean(np.abs(motion.motor_torque - torque) < 1e-6) > 0.99
    taut = proximal > 1.0
    assert taut.mean() > 0.9
    assert np.all(distal[taut] * ratio * (1 + 1e-9) >= proximal[taut])
    assert np.all(proximal[taut] * ratio * (1 + 1e-9) >= distal[taut])


def test_drag_far_stiffer_than_the_cable_keeps_its_accuracy():
    cable = Cable(
        axial_stiffness=4e3,
        friction=0.1,
        viscous_friction=1e3,
        segments=100,
        conduit=(Section(2.0, 0.5),),
    )
    time = np.arange(0.0, 0.2, 1e-4)
    pulled = -0.02 * np.sin(2 * np.pi * 5.0 * time)
    still = np.zeros(time.size)
    one = replay(cable, 1e-4, u_proximal=pulled, u_distal=still)
    other = replay(cable, 1e-4, u_proximal=still, u_distal=-pulled)
    assert one.tension_proximal == pytest.approx(other.tension_distal, rel=1e-9)
    work = -np.sum(
        0.5
        * (one.tension_proximal[1:] + one.tension_proximal[:-1])
        * np.diff(one.u_proximal)
    )
    stored = one.stored[-1] - one.stored[0]
    assert one.dissipated[-1] + stored == pytest.approx(work, rel=0.05)
