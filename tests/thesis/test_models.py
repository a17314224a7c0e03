"""Each model against its own printed equations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from cc_mujoco.cable import Cable, Section, replay
from thesis._predecessors import (
    BristleChain,
    Distributed,
    Hysteresis,
    LumpedMasses,
    ModifiedBoucWen,
    Motion,
    PassiveDistributed,
    StaticCapstan,
)

CABLE = Cable(
    axial_stiffness=4000.0,
    pretension=10.0,
    friction=0.2,
    static_friction=0.0,
    conduit=(Section(2.0, 0.4),),
    segments=20,
)
DT = 1e-3
TIME = np.arange(0.0, 2.0, DT)
STROKE = -0.009 * np.sin(np.pi * TIME)
RATIO = math.exp(CABLE.friction * CABLE.wrap)


def test_ours_is_the_kernel_with_a_locked_or_moved_output():
    distal = 0.004 * np.sin(3.0 * TIME)
    for moved in (None, distal):
        answer = Distributed(CABLE).answer(Motion(DT, STROKE, moved=moved))
        distal = np.zeros_like(STROKE) if moved is None else moved
        motion = replay(CABLE, DT, u_proximal=STROKE, u_distal=distal)
        assert np.array_equal(answer.tension_proximal, motion.tension_proximal)
        assert np.array_equal(answer.tension_distal, motion.tension_distal)


@pytest.mark.parametrize("stiffness", [20.0, 500.0, 20000.0])
def test_our_cable_and_its_spring_are_in_balance(stiffness):
    answer = Distributed(CABLE).answer(Motion(DT, STROKE, stiffness))
    spring = CABLE.pretension - stiffness * answer.u_distal
    assert answer.tension_distal == pytest.approx(spring, abs=1e-8)


@given(
    seed=st.integers(0, 1000),
    stiffness=st.sampled_from([math.inf, 100.0, 2000.0]),
    curvature=st.floats(0.1, 4.0),
)
@settings(max_examples=20)
def test_one_direction_is_enough_where_only_the_motor_moves(seed, stiffness, curvature):
    proximal = np.random.default_rng(seed).normal(0.0, 3e-4, 400).cumsum()
    proximal -= proximal[0]
    motion = Motion(DT, proximal, stiffness)
    cable = CABLE.replace(conduit=(Section(2.0, 1.0 / curvature),), segments=60)
    before = PassiveDistributed(cable).answer(motion)
    ours = Distributed(cable).answer(motion)
    scale = max(float(ours.tension_proximal.max()), 10.0)
    assert before.tension_proximal == pytest.approx(
        ours.tension_proximal, abs=0.01 * scale
    )
    assert before.tension_distal == pytest.approx(ours.tension_distal, abs=0.01 * scale)


@pytest.mark.study
def test_bristles_follow_the_dahl_equation():
    cable = CABLE.replace(segments=1, friction=0.02)
    length = 4e-4
    proximal = -0.002 * np.sin(np.pi * TIME[:1500])
    chain = BristleChain(cable, length)
    answer = chain.answer(Motion(DT, proximal))
    tension = np.array([answer.tension_proximal, answer.tension_distal])
    # One segment: its displacement from the distal spring, friction from both.
    x = -(tension[1] - 10.0) / (2.0 * 4000.0 / 2.0)
    friction, limit = tension[1] - tension[0], 0.1 * tension.mean(axis=0)

    def slope(at, force):
        speed = np.interp(at, TIME[:1500], np.gradient(x, DT))
        held = np.interp(at, TIME[:1500], limit)
        return held / length * (1.0 - np.sign(speed) * force / held) * speed

    found = solve_ivp(
        slope, (0.0, TIME[1499]), [0.0], t_eval=TIME[:1500], max_step=DT, rtol=1e-6
    )
    assert np.max(np.abs(friction)) > 0.5
    assert friction == pytest.approx(found.y[0], abs=0.02)


def test_shorter_bristles_come_closer_to_coulomb_friction():
    ours = Distributed(CABLE).answer(Motion(DT, STROKE, 500.0))
    errors = []
    for length in (4e-4, 1e-4, 2.5e-5):
        chain = BristleChain(CABLE, length)
        answer = chain.answer(Motion(DT, STROKE, 500.0))
        errors.append(np.max(np.abs(answer.tension_distal - ours.tension_distal)))
    assert errors[0] > 2.0 * errors[1] > 4.0 * errors[2]


def test_lumped_masses_have_the_apparent_stiffness_of_kaneko():
    pull = -np.minimum(0.01 * TIME, 0.008)
    answer = LumpedMasses(CABLE).answer(Motion(DT, pull))
    angle = CABLE.friction * CABLE.wrap
    stretch = angle / math.expm1(angle) * 4000.0 / 2.0 * 0.008
    assert answer.tension_distal[-1] == pytest.approx(10.0 + stretch, rel=1e-3)
    ratio = answer.tension_proximal[-1] / answer.tension_distal[-1]
    assert ratio == pytest.approx(RATIO, rel=1e-9)


def test_lumped_masses_carry_waves_at_the_speed_of_sound():
    speed_of_sound = math.sqrt(4000.0 / 2.5e-3)
    step = 2e-5
    chain = LumpedMasses(CABLE.replace(friction=0.0), masses=100)
    answer = chain.answer(Motion(step, -np.arange(0.0, 3e-3, step)))
    # Pulled at 1 m/s: the wave is EA v/c high, twice that at the end that holds it.
    felt = np.flatnonzero(answer.tension_distal > 10.0 + 4000.0 / speed_of_sound)[0]
    assert felt * step == pytest.approx(2.0 / speed_of_sound, rel=0.1)


def test_static_capstan_has_the_belt_ratio_in_both_directions():
    answer = StaticCapstan(CABLE).answer(Motion(DT, STROKE, 500.0))
    ratio = answer.tension_proximal / answer.tension_distal
    moving = np.abs(np.gradient(STROKE)) > 1e-7
    assert np.abs(np.log(ratio[moving][1:])) == pytest.approx(1.0, rel=1e-9)
    spring = CABLE.pretension - 500.0 * answer.u_distal
    assert answer.tension_distal == pytest.approx(spring, abs=1e-9)


def test_hysteresis_is_that_of_equation_1_4():
    shape = Hysteresis(0.0, 1.0, 0.0, 0.0, rho=300.0, sigma=1.7, lead=1e-3)
    model = ModifiedBoucWen(CABLE, shape)
    answer = model.answer(Motion(DT, STROKE, 500.0))
    zeta = answer.tension_proximal - answer.tension_distal
    x = -STROKE

    def rate(at, state):
        speed = np.pi * 0.009 * np.cos(np.pi * at)
        w = speed - 1e-3 * np.sign(np.sin(np.pi * at))  # acceleration is -sin
        size = abs(state[0])
        return [
            shape.rho
            * (w - shape.sigma * abs(w) * state[0] + (shape.sigma - 1.0) * w * size)
        ]

    found = solve_ivp(rate, (0.0, TIME[-1]), [0.0], t_eval=TIME, max_step=1e-3)
    assert np.ptp(zeta) > 1.5
    assert x.size == zeta.size
    assert zeta == pytest.approx(found.y[0], abs=0.03)


def test_a_fit_finds_the_hysteresis_that_made_a_recording():
    truth = ModifiedBoucWen(
        CABLE, Hysteresis(800.0, 4.0, 30.0, 0.5, rho=600.0, sigma=1.3, lead=1e-3)
    )
    motion = Motion(DT, STROKE, 500.0)
    seen = truth.answer(motion)
    again = ModifiedBoucWen.fitted(CABLE, motion, seen).answer(motion)
    error = again.tension_proximal - seen.tension_proximal
    assert np.sqrt(np.mean(error**2)) < 0.05
