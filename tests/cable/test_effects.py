"""Effects beyond the friction terms: each against a closed form or another model."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cable.test_kernel_physics import (
    BENT,
    STRAIGHT,
    sliding,
    trapezoid,
    wander,
    work_in,
)
from cc_mujoco.cable import (
    Cable,
    Conduit,
    Section,
    packed_parameters,
    replay,
    rest_state,
)
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable._reading import guided_compliance, read_states
from cc_mujoco.errors import CableError


def ends(seed, samples=2000, size=0.01):
    rng = np.random.default_rng(seed)
    return wander(rng, samples, size), wander(rng, samples, size)


def test_asymmetric_friction_in_steady_sliding():
    cable = BENT.replace(friction_asymmetry=0.4)
    low, high = sliding(cable, 0.05)
    assert math.log(high / low) == pytest.approx(0.21 * 1.4 * BENT.wrap, rel=1e-9)
    time = np.linspace(0.0, 0.3, 3000)
    away = replay(cable, 1e-3, u_proximal=time, u_distal=time)
    ratio = away.tension_distal[-1] / away.tension_proximal[-1]
    assert math.log(ratio) == pytest.approx(0.21 * 0.6 * BENT.wrap, rel=1e-9)


@pytest.mark.parametrize("static", [0.0, 0.5])
def test_asymmetry_changes_sign_with_the_ends_exchanged(static):
    cable = BENT.replace(segments=20, static_friction=static, friction_asymmetry=0.3)
    proximal, distal = ends(1, size=4e-3)
    one = replay(cable, 1e-3, u_proximal=proximal, u_distal=distal)
    other = replay(
        cable.replace(friction_asymmetry=-0.3),
        1e-3,
        u_proximal=-distal,
        u_distal=-proximal,
    )
    assert other.tension_distal == pytest.approx(one.tension_proximal, abs=1e-7)
    assert other.tension_proximal == pytest.approx(one.tension_distal, abs=1e-7)


def test_asymmetric_friction_converges_with_the_mesh():
    proximal, distal = ends(3)
    found = [
        replay(
            BENT.replace(segments=n, friction_asymmetry=0.5),
            1e-3,
            u_proximal=proximal,
            u_distal=distal,
        ).tension_proximal
        for n in (25, 50, 100, 200)
    ]
    errors = [float(np.sqrt(np.mean((f - found[-1]) ** 2))) for f in found[:-1]]
    assert errors[2] < 0.6 * errors[1] < 0.36 * errors[0]
    assert errors[2] < 0.01 * found[-1].max()


@pytest.mark.parametrize("spring", ["end_compliance", "proximal_compliance"])
def test_end_spring_in_series_with_a_smooth_cable(spring):
    cable = STRAIGHT.replace(friction=0.0, **{spring: 2e-4})
    proximal, distal = ends(0, size=4e-3)
    motion = replay(cable, 1e-3, u_proximal=proximal, u_distal=distal)
    compliance = 2.0 / 4000.0 + 2e-4
    tension = np.maximum(10.0 + (distal - proximal) / compliance, 0.0)
    assert motion.tension_proximal == pytest.approx(tension, abs=1e-9)
    assert motion.tension_distal == pytest.approx(tension, abs=1e-9)
    assert motion.stored == pytest.approx(0.5 * compliance * tension**2, abs=1e-12)
    assert motion.slack == pytest.approx(
        np.maximum(proximal - distal - 10.0 * compliance, 0.0), abs=1e-12
    )


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("terms", [{}, {"viscous_friction": 30.0}], ids=["march", "-"])
def test_end_spring_is_that_of_a_cable_whose_end_moves_less(seed, terms):
    """The cable behind the spring is one without it, driven by what the spring left."""
    proximal, distal = ends(seed)
    distal = distal + 0.02
    distal[0] = proximal[0]
    sprung = BENT.replace(end_compliance=3e-4, pretension=30.0, segments=25, **terms)
    motion = replay(sprung, 1e-3, u_proximal=proximal, u_distal=distal)
    assert motion.slack.max() == 0.0
    behind = distal - 3e-4 * (motion.tension_distal - 30.0)
    bare = sprung.replace(end_compliance=0.0)
    alone = replay(bare, 1e-3, u_proximal=proximal, u_distal=behind)
    # A null point that passes the last segment is placed in it by the motion of its
    # ends, one of which is now the spring's; it is gone after a few samples.
    for ours, wanted in (
        (alone.tension_distal, motion.tension_distal),
        (alone.tension_proximal, motion.tension_proximal),
    ):
        error = np.abs(ours - wanted) / wanted.max()
        assert error.max() < 5e-3
        assert np.mean(error) < 3e-4


@pytest.mark.parametrize("exponent", [0.3, 0.7])
@pytest.mark.parametrize("speed", [0.005, 0.5])
def test_grease_in_steady_sliding(exponent, speed):
    grease = {"grease_drag": 5.0, "grease_exponent": exponent, "segments": 20}
    drag = 5.0 * speed**exponent
    dt = 2e-4 / speed
    low, high = sliding(BENT.replace(**grease), speed, dt)
    # dT/dx = kappa T + g v^n from distal to proximal, kappa = mu / R.
    kappa = 0.21 / 0.28
    expected = (low + drag / kappa) * math.exp(kappa * 2.0) - drag / kappa
    assert high == pytest.approx(expected, rel=1e-4)
    low, high = sliding(STRAIGHT.replace(friction=0.0, **grease), speed, dt)
    assert high - low == pytest.approx(drag * 2.0, abs=1e-5 * high)


def crept(steps):
    """Tension across one segment in grease, from a jump of both ends, over 0.2 s."""
    cable = STRAIGHT.replace(
        friction=0.0, segments=1, grease_drag=10.0, grease_exponent=0.5
    )
    conduit = Conduit(cable)
    found = []
    for _ in range(steps):
        conduit.step(0.2 / steps, u_proximal=2e-3, u_distal=2e-3)
        found.append(conduit.tension_distal - conduit.tension_proximal)
    return np.array(found)


def test_a_cable_creeps_through_grease_as_its_closed_form_to_first_order():
    # Both half cables pull: 2 k x = g L sqrt(-dx/dt), so x = x_0 / (1 + a^2 x_0 t).
    stiffness = 2.0 * 4000.0 / 1.0
    a = stiffness / (10.0 * 2.0)
    errors = []
    for steps in (100, 200, 400):
        time = 0.2 * np.arange(1, steps + 1) / steps
        wanted = stiffness * 2e-3 / (1.0 + a**2 * 2e-3 * time)
        errors.append(np.max(np.abs(crept(steps) - wanted)[steps // 10 :]))
    assert errors[2] < 0.01 * stiffness * 2e-3
    assert errors[1] < 0.6 * errors[0]
    assert errors[2] < 0.6 * errors[1]


@pytest.mark.parametrize("other", [{}, {"bristle_length": 1e-4}], ids=str)
def test_grease_hardly_depends_on_the_time_step(other):
    cable = BENT.replace(segments=20, grease_drag=8.0, grease_exponent=0.3, **other)
    found = []
    for samples in (501, 8001):
        time = np.linspace(0.0, 2.0, samples)
        motion = replay(
            cable.replace(pretension=30.0),
            2.0 / (samples - 1),
            u_proximal=8e-3 * np.sin(3.0 * time),
            u_distal=1e-2 * np.sin(4.4 * time),
        )
        found.append(motion.tension_distal[:: (samples - 1) // 500])
    error = np.sqrt(np.mean((found[0] - found[1]) ** 2))
    assert error < 1e-3 * found[1].max()


def test_grease_of_exponent_one_is_viscous_bit_for_bit():
    proximal, distal = ends(7)
    found = [
        replay(BENT.replace(**on), 1e-3, u_proximal=proximal, u_distal=distal)
        for on in (
            {"viscous_friction": 30.0},
            {"grease_drag": 30.0, "grease_exponent": 1.0},
        )
    ]
    assert np.array_equal(found[0].tension_distal, found[1].tension_distal)
    assert np.array_equal(found[0].tension_proximal, found[1].tension_proximal)


def pulled_to_and_fro(travel, samples=4000):
    """Both ends move alike, so that the mean tension of one segment stays."""
    legs = wander(np.random.default_rng(6), samples, travel, knots=20)
    return legs, legs


def test_one_segment_on_bristles_is_elastic_and_perfectly_plastic():
    cable = BENT.replace(segments=1, bristle_length=2e-3, pretension=30.0)
    proximal, distal = pulled_to_and_fro(2e-2)
    motion = replay(cable, 1e-3, u_proximal=proximal, u_distal=distal)
    # Two half cables in series with the bristles, and the slider behind them all.
    exponent = 0.21 * cable.wrap
    halves = 2.0 * (2.0 * 4000.0 / 2.0)
    bristles = exponent * 30.0 / 2e-3
    stiffness = halves * bristles / (halves + bristles)
    limit = 2.0 * 30.0 * math.tanh(0.5 * exponent)
    force, forces = 0.0, []
    for moved in np.diff(proximal, prepend=0.0):
        force = min(max(force + stiffness * moved, -limit), limit)
        forces.append(force)
    forces = np.array(forces)
    assert np.mean(np.abs(forces) < 0.999 * limit) > 0.1
    assert np.mean(np.abs(forces) == limit) > 0.1
    assert motion.tension_distal == pytest.approx(30.0 + 0.5 * forces, abs=1e-8)
    assert motion.tension_proximal == pytest.approx(30.0 - 0.5 * forces, abs=1e-8)


@pytest.mark.parametrize("static", [0.0, 0.4])
def test_short_bristles_converge_to_coulomb_friction(static):
    proximal, distal = ends(5)
    distal = distal + 0.02 * np.linspace(0.0, 1.0, distal.size)
    cable = BENT.replace(segments=20, static_friction=static)
    # The same solver class without bristles: a null point is a segment's, not inside.
    rigid = replay(
        cable.replace(viscous_friction=1e-12),
        1e-3,
        u_proximal=proximal,
        u_distal=distal,
    )
    errors = []
    for length in (1e-4, 1e-6, 1e-8):
        motion = replay(
            cable.replace(bristle_length=length),
            1e-3,
            u_proximal=proximal,
            u_distal=distal,
        )
        errors.append(np.abs(motion.tension_distal - rigid.tension_distal))
    worst = [float(e.max()) / rigid.tension_distal.max() for e in errors]
    if static == 0.0:
        assert worst[1] < 0.05 * worst[0]
        assert worst[2] < 1e-3
    # Which segment breaks away first is a matter of rounding.
    assert np.median(errors[2]) < 1e-3


def test_bristles_converge_with_the_mesh():
    proximal, distal = ends(4, size=4e-3)
    found = [
        replay(
            BENT.replace(segments=n, bristle_length=5e-4),
            1e-3,
            u_proximal=proximal,
            u_distal=distal,
        ).tension_proximal
        for n in (10, 20, 40, 160)
    ]
    errors = [float(np.sqrt(np.mean((f - found[-1]) ** 2))) for f in found[:-1]]
    assert errors[2] < 0.6 * errors[1] < 0.4 * errors[0]
    assert errors[2] < 2e-3 * found[-1].max()


def test_bristles_give_no_energy_when_the_tension_changes_between_load_and_unload():
    """Loaded at high tension and unloaded at low: the trap of F = s(T) w."""
    cable = BENT.replace(segments=1, bristle_length=2e-3, pretension=30.0)
    corners = np.array([(0, 0), (0, 4), (1, 5), (1, 1), (0, 0)]) * 1e-3
    lap = np.concatenate(
        [np.linspace(a, b, 200, endpoint=False) for a, b in pairwise(corners)]
    )
    for path in (lap, lap[::-1]):
        laps = np.concatenate([path] * 6)
        # Columns: common motion of the ends, and how far they are pulled apart.
        proximal, distal = laps[:, 0] - laps[:, 1], laps[:, 0] + laps[:, 1]
        proximal, distal = proximal - proximal[0], distal - distal[0]
        motion = replay(cable, 1e-3, u_proximal=proximal, u_distal=distal)
        taken = work_in(motion) - (motion.stored - motion.stored[0])
        assert np.all(np.diff(taken[:: len(path)]) >= -1e-9)
        assert taken == pytest.approx(motion.dissipated, abs=2e-6)


@pytest.mark.parametrize(
    "terms",
    [
        {},
        {"viscous_friction": 100.0},
        {"grease_drag": 30.0},
        {"stribeck_friction": 0.2, "stribeck_speed": 0.02},
        {"stribeck_friction": 0.2, "stribeck_speed": 0.02, "stribeck_tail": 1.0},
        {"load_independent_friction": 5.0},
        {"static_friction": 0.3, "critical_slip_distance": 1e-3},
        {"ageing_friction": 0.05, "critical_slip_distance": 1e-3},
        {"tension_exponent": -0.3},
        {"friction_asymmetry": 0.3},
        {"bedding_strain": 1e-3},
    ],
    ids=lambda terms: "".join(list(terms)[::2]) or "coulomb",
)
def test_all_energy_is_accounted_for_on_bristles(terms):
    time = np.linspace(0.0, 1.0, 2001)
    turn = 2.0 * np.pi * time
    motion = replay(
        BENT.replace(segments=10, bristle_length=5e-4, pretension=30.0, **terms),
        time[1],
        u_proximal=8e-3 * (0.5 * np.sin(turn) + 0.3 * np.sin(3.0 * turn)),
        u_distal=8e-3 * (0.7 * np.sin(2.0 * turn) + 0.4 * (1.0 - np.cos(turn))),
    )
    taken = work_in(motion) - (motion.stored - motion.stored[0])
    heat = motion.dissipated[-1]
    assert heat > 0.1
    assert taken == pytest.approx(motion.dissipated, abs=2e-5 * heat)


def test_bristles_make_a_reversal_round_and_leave_the_capstan_ratio():
    cable = BENT.replace(segments=40, bristle_length=5e-4)
    low, high = sliding(cable, 0.05)
    assert math.log(high / low) == pytest.approx(0.21 * BENT.wrap, rel=1e-9)
    turn = 1e-5 * np.concatenate([np.arange(3000), np.arange(3000, 2980, -1)])
    rigid, soft = (
        replay(c, 1e-3, u_proximal=turn, u_distal=turn)
        for c in (BENT.replace(segments=40), cable)
    )
    # Right after the turn rigid friction keeps most of the cable still.
    assert rigid.moving_fraction[-15] < 0.2
    drop = rigid.tension_distal[-20] - rigid.tension_distal[-1]
    assert soft.tension_distal[-20] - soft.tension_distal[-1] < 0.9 * drop


@pytest.mark.parametrize("spring", [0.0, 2e-4])
def test_a_cable_that_beds_in_has_its_closed_form_whatever_the_path(spring):
    cable = STRAIGHT.replace(
        friction=0.0,
        bedding_strain=5e-3,
        bedding_tension=15.0,
        end_compliance=spring,
        segments=7,
    )
    proximal, distal = ends(2, size=3e-2)
    motion = replay(cable, 1e-3, u_proximal=proximal, u_distal=distal)

    def stretch(tension):
        tension = np.maximum(tension, 0.0)
        strain = tension / 4000.0 + 5e-3 * tension / (tension + 15.0)
        return 2.0 * strain + spring * tension

    stretched = stretch(motion.tension_distal) - motion.slack
    assert stretched == pytest.approx(stretch(10.0) + distal - proximal, abs=3e-7)
    assert motion.slack.max() > 0.0
    largest = motion.tension_distal.max()
    assert motion.tension_proximal == pytest.approx(
        motion.tension_distal, abs=1e-4 * largest
    )
    # Its energy is the work that stretched it.
    tension = np.linspace(0.0, motion.tension_distal.max(), 200_001)
    work = trapezoid(tension, stretch(tension))
    wanted = np.interp(motion.tension_distal, tension, work)
    assert motion.stored == pytest.approx(wanted, abs=1e-5 * wanted.max())


@pytest.mark.parametrize("viscous", [0.0, 1e-12], ids=["march", "graph"])
@pytest.mark.parametrize("bedding", [0.0, 2e-3])
def test_clearance_shortens_the_path_of_a_cable_that_slips(bedding, viscous):
    """The path gives c theta T / (T + T_c) where T grows by mu per angle on its way."""
    clearance, seating, friction, half = 1e-3, 4.0, 0.21, 15.0
    cable = BENT.replace(
        clearance=clearance, seating_tension=seating, friction=friction,
        bedding_strain=bedding, bedding_tension=half, viscous_friction=viscous,
        segments=100,
    )  # fmt: skip
    pulled = np.linspace(0.0, -0.03, 400)
    motion = replay(cable, 1e-3, u_proximal=pulled, u_distal=np.zeros(400))
    far, near = motion.tension_distal[-1], motion.tension_proximal[-1]
    assert math.log(near / far) == pytest.approx(friction * cable.wrap, rel=1e-6)

    def ending(half):
        """Integral of T / (T + half) over the friction coefficient times the angle."""
        return math.log((near + half) / (far + half))

    along = 0.28 / friction  # length per such an angle
    stretch = along * ((near - far) / cable.axial_stiffness + bedding * ending(half))
    stretch += clearance / friction * ending(seating)
    strain = 10.0 / cable.axial_stiffness + bedding * 10.0 / (10.0 + half)
    rest = 2.0 * strain + clearance * cable.wrap * 10.0 / (10.0 + seating)
    assert stretch - rest == pytest.approx(0.03, rel=2e-4)


@pytest.mark.parametrize(("pretension", "lost"), [(0.0, 6.8e-3), (2.0, 4.8e-3)])
def test_clearance_of_the_thesis_hardware_is_millimetres_of_lost_motion(
    pretension, lost
):
    """7.1 rad of conduit and 1.0 mm of play: less the tighter the cable is at rest."""
    taut = BENT.replace(
        friction=0.0, conduit=(Section(2.0, 2.0 / 7.1),), pretension=pretension
    )
    wide = taut.replace(clearance=1e-3, seating_tension=5.0)
    pulled = np.linspace(0.0, 0.1, 500)
    ways = [
        np.interp(
            100.0,
            replay(c, 1e-3, u_proximal=-pulled, u_distal=0.0 * pulled).tension_distal,
            pulled,
        )
        for c in (taut, wide)
    ]
    assert ways[1] - ways[0] == pytest.approx(lost, abs=1e-4)


OWN_PLAY = (
    Section(0.5, math.inf), Section(0.5, 0.25), Section(0.6, 0.2, 0.5, 3.0),
    Section(0.4, 0.5, 2.0, 0.5),
)  # fmt: skip
"""Sections, two of them with their own clearance and seating tension."""


def summed_stretch(cable, tension):
    """Stretch of a cable without friction, each section with its own clearance [m]."""
    stretch = tension * cable.length / cable.axial_stiffness
    for length, radius, clearance, seating in cable.conduit:
        half = seating * cable.seating_tension
        play = clearance * cable.clearance * length / radius
        stretch = stretch + play * tension / (tension + half)
    return stretch


@pytest.mark.parametrize("sections", [OWN_PLAY[2:3], OWN_PLAY], ids=["one", "all"])
def test_clearance_of_sections_adds_up(sections):
    """A segment over two sections has the sum of taut plays and slack compliances."""
    errors = []
    for segments in (10, 20, 80):
        cable = BENT.replace(
            friction=0.0, conduit=sections, segments=segments, clearance=1e-3
        )
        pulled = np.linspace(0.0, 0.05, 300)
        motion = replay(cable, 1e-3, u_proximal=-pulled, u_distal=0.0 * pulled)
        stretch = summed_stretch(cable, motion.tension_distal)
        error = stretch - summed_stretch(cable, 10.0) - pulled
        errors.append(np.abs(error).max())
    assert errors[0] < 1e-4
    assert errors[2] < (1e-7 if len(sections) == 1 else 0.2 * errors[0])


def test_sections_that_say_nothing_have_the_clearance_of_the_cable():
    ends = np.sin(np.linspace(0.0, 9.0, 400)) * [[6e-3], [4e-3]]
    given = {"conduit": OWN_PLAY, "segments": 20}
    plain = tuple(s._replace(clearance=1.0, seating=1.0) for s in OWN_PLAY)
    for one, other, same in (
        (given, given | {"conduit": plain}, True),
        (
            given | {"clearance": 1e-3},
            given | {"clearance": 1e-3, "conduit": plain},
            False,
        ),
    ):
        found, wanted = (
            replay(BENT.replace(**keys), 1e-3, u_proximal=ends[0], u_distal=ends[1])
            for keys in (one, other)
        )
        assert np.array_equal(found.tension_distal, wanted.tension_distal) == same
        assert np.array_equal(found.dissipated, wanted.dissipated) == same


@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_a_closed_motion_gives_back_what_clearance_of_sections_stores(friction):
    """Without friction all of it, else all but the heat."""
    turn = np.linspace(0.0, 2.0 * np.pi, 4001)
    cable = BENT.replace(
        friction=friction, conduit=OWN_PLAY, segments=20, clearance=1e-3
    )
    near, far = -8e-3 * (1.0 - np.cos(turn)), 5e-3 * np.sin(turn)
    motion = replay(cable, 1e-3, u_proximal=near, u_distal=far)
    work = trapezoid(motion.tension_distal, far)
    work -= trapezoid(motion.tension_proximal, near)
    heat = motion.dissipated[-1]
    stored = motion.stored[-1] - motion.stored[0]
    assert work[-1] - stored == pytest.approx(heat, abs=1e-5 * motion.stored.max())
    if friction == 0.0:
        assert heat == pytest.approx(0.0, abs=1e-6)


ANCHORS = ("end", "proximal")


@pytest.mark.parametrize("loss", [0.0, 0.3, 0.6])
@pytest.mark.parametrize("hardening", [0.0, 1e-6, 0.05])
@pytest.mark.parametrize("end", ANCHORS)
def test_a_soft_end_follows_its_loop(end, hardening, loss):
    """Loading, part of the way back and again up, back to slack, and a smaller loop.

    Left is X(T) = C ln(1 + h T)/h. Of it a third follows T, two thirds a tension that
    stays while T falls to 1 - 3/2 loss of it.
    """
    compliance = 3e-4
    soft = {
        f"{end}_compliance": compliance,
        f"{end}_hardening": hardening,
        f"{end}_loss": loss,
    }
    cable = STRAIGHT.replace(friction=0.0, pretension=0.0, segments=5, **soft)
    corners = [0.0, 80.0, 30.0, 100.0, 0.0, 40.0, 0.0]
    pull = np.concatenate([np.linspace(a, b, 400) for a, b in pairwise(corners)])
    still = np.zeros(pull.size)
    if end == "end":
        motion = replay(cable, 1e-3, u_proximal=still, tension_distal=pull)
        way = motion.u_distal
    else:
        motion = replay(cable, 1e-3, tension_proximal=pull, u_distal=still)
        way = -motion.u_proximal

    def left(tension):
        if hardening == 0.0:
            return compliance * tension
        return compliance * np.log1p(hardening * tension) / hardening

    held, kept = np.zeros(pull.size), 1.0 - 1.5 * loss
    for k in range(1, pull.size):
        held[k] = min(max(held[k - 1], pull[k]), pull[k] / kept)
    wanted = left(pull) / 3.0 + left(held) * 2.0 / 3.0
    wanted += pull * cable.length / cable.axial_stiffness
    assert way == pytest.approx(wanted, abs=1e-9)
    # The smaller loop loses the declared share of what it took.
    up, loop = slice(-800, -400), slice(-801, None)
    own = way - pull * cable.length / cable.axial_stiffness
    lost = np.trapezoid(pull[loop], own[loop])
    assert lost == pytest.approx(loss * np.trapezoid(pull[up], own[up]), abs=1e-5)
    heat = motion.dissipated[-1] - motion.dissipated[-801]
    assert heat == pytest.approx(lost, rel=1e-4, abs=1e-6)
    assert motion.stored[-1] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("end", ANCHORS)
def test_a_spring_that_neither_hardens_nor_loses_is_linear(end):
    proximal, distal = ends(5, size=8e-3)
    soft = BENT.replace(**{f"{end}_compliance": 2e-4})
    linear = replay(soft, 1e-3, u_proximal=proximal, u_distal=distal)
    for name in f"{end}_hardening", f"{end}_loss":
        hardly = replay(
            soft.replace(**{name: 1e-9}), 1e-3, u_proximal=proximal, u_distal=distal
        )
        for one, other in (
            (hardly.tension_proximal, linear.tension_proximal),
            (hardly.tension_distal, linear.tension_distal),
        ):
            assert one == pytest.approx(other, abs=1e-3 * other.max())


def test_a_spring_needs_a_compliance_to_harden():
    allowed = r"`end_hardening` is 0.1; it must be 0 .off. where `end_compliance` is 0"
    with pytest.raises(CableError, match=allowed):
        Cable(end_hardening=0.1)


@pytest.mark.parametrize("give", [{"bedding_strain": 5e-3}, {"clearance": 2e-3}])
def test_a_slack_cable_reads_as_long_as_it_is(give):
    cable = BENT.replace(friction=0.0, segments=9, **give)
    pushed = np.linspace(0.0, 0.05, 200)
    motion = replay(cable, 1e-3, u_proximal=pushed, u_distal=0.0 * pushed)
    rest = kernel.total_stretch(packed_parameters(cable), 9, rest_state(cable))
    assert motion.slack[-1] == pytest.approx(0.05 - rest, rel=1e-9)
    state = committed(cable, pushed, 0.0 * pushed, np.full(200, 1e-3))
    reading = read_states(state[None], 0, guided_compliance(cable))
    assert reading.slack == pytest.approx(motion.slack[-1], rel=1e-9)


@pytest.mark.parametrize("viscous", [0.0, 1e-12], ids=["march", "graph"])
def test_a_little_bedding_is_none_and_steps_do_not_matter(viscous):
    proximal, distal = ends(
        8, samples=2401, size=6e-3
    )  # all corners in every tenth sample
    cable = BENT.replace(segments=20, viscous_friction=viscous)
    straight = replay(cable, 1e-3, u_proximal=proximal, u_distal=distal)
    hardly = replay(
        cable.replace(bedding_strain=1e-14), 1e-3, u_proximal=proximal, u_distal=distal
    )
    assert hardly.tension_distal == pytest.approx(straight.tension_distal, abs=1e-6)
    stiff = cable.replace(bedding_strain=2e-3, bedding_tension=10.0)
    coarse = replay(stiff, 1e-3, u_proximal=proximal[::10], u_distal=distal[::10])
    fine = replay(stiff, 1e-3, u_proximal=proximal, u_distal=distal)
    largest = fine.tension_distal.max()
    error = np.abs(coarse.tension_distal - fine.tension_distal[::10])
    assert error.max() < 0.02 * largest
    assert not np.allclose(fine.tension_distal, straight.tension_distal, rtol=0.05)


@given(seed=st.integers(0, 10**6))
@settings(max_examples=15)
def test_a_cable_that_beds_in_is_the_same_to_both_solvers(seed):
    # One end rests: the graph resolves a null point to a segment only.
    proximal, distal = ends(seed, samples=401, size=6e-3)[0], np.zeros(401)
    cable = BENT.replace(segments=9, bedding_strain=5e-3, bedding_tension=8.0)
    quick, general = (
        replay(c, 1e-3, u_proximal=proximal, u_distal=distal)
        for c in (cable, cable.replace(viscous_friction=1e-12))
    )
    largest = general.tension_proximal.max()
    for end in ("tension_proximal", "tension_distal"):
        wanted = pytest.approx(getattr(general, end), abs=1e-4 * largest)
        assert getattr(quick, end) == wanted


def committed(cable, proximal, distal, steps):
    """State of the kernel after these motions of the ends."""
    prm, n, state = packed_parameters(cable), cable.segments, rest_state(cable)
    work, new = np.empty(kernel.work_size(n)), state.copy()
    for a, b, dt in zip(proximal, distal, steps, strict=True):
        kernel.advance(prm, n, state, a, b, dt, new, work)
        state, new = new, state
    return state


def test_a_cable_that_beds_in_keeps_the_stretch_of_its_ends():
    proximal, distal = ends(9)
    cable = BENT.replace(segments=12, bedding_strain=3e-3, end_compliance=1e-4)
    prm, state = (
        packed_parameters(cable),
        committed(cable, proximal, distal, np.full(proximal.size, 1e-3)),
    )
    rest = kernel.total_stretch(prm, 12, rest_state(cable))
    wanted = rest + distal[-1] - proximal[-1]
    assert kernel.total_stretch(prm, 12, state) == pytest.approx(wanted, abs=1e-12)
    assert state[3] == pytest.approx(wanted, abs=1e-12)


def resting(cable, time, steps=200):
    conduit = Conduit(cable)
    for _ in range(steps):
        conduit.step(time / steps, u_proximal=0.0, u_distal=0.0)
    return conduit


@pytest.mark.parametrize(
    "other", [{}, {"bedding_strain": 5e-3}, {"end_compliance": 3e-4}], ids=str
)
@pytest.mark.parametrize("steps", [1, 200])
def test_creep_takes_the_pretension_of_the_rest_pose(other, steps):
    cable = STRAIGHT.replace(
        friction=0.0, segments=9, stress_relaxation=0.6, relaxation_time=30.0, **other
    )
    conduit = resting(cable, 45.0, steps)
    wanted = 10.0 * (1.0 - 0.6 * (1.0 - math.exp(-1.5)))
    assert conduit.tension == pytest.approx(wanted, rel=1e-6)
    lost = Conduit(cable).stored - conduit.stored
    assert conduit.dissipated == pytest.approx(lost, rel=1e-9)


@pytest.mark.parametrize("end", ["proximal", "distal"])
@pytest.mark.parametrize("other", [{}, {"end_compliance": 3e-4}], ids=str)
def test_a_clamp_that_slides_lets_the_tension_fall_to_what_it_holds(other, end):
    """Without friction the cable is one spring: T - F decays with the rate k c."""
    creep, force = 5e-5, 4.0
    cable = STRAIGHT.replace(friction=0.0, segments=9, clamp_force=force, **other)
    slides = cable.replace(**{f"clamp_creep_{end}": creep})
    conduit = Conduit(slides)
    springs = cable.end_compliance + cable.length / cable.axial_stiffness
    decays = (conduit.tension_distal - force) * math.exp(-0.5 * creep / springs)
    off = []
    for steps in (200, 400):
        conduit = resting(slides, 0.5, steps)
        off.append(conduit.tension / (force + decays) - 1.0)
        lost = Conduit(cable).stored - conduit.stored
        assert conduit.dissipated == pytest.approx(lost, rel=1e-9)
    assert off[0] == pytest.approx(2.0 * off[1], rel=0.05)  # first order in the step
    assert np.abs(off[1]).max() < 1e-3
    assert resting(slides, 1e4, 2000).tension == pytest.approx(force, rel=1e-4)


@pytest.mark.parametrize("other", [{}, {"bedding_strain": 5e-3}], ids=str)
def test_a_soft_clamp_caps_the_tension_at_its_end_and_stays_where_it_slid(other):
    cable = BENT.replace(segments=15, clamp_creep_distal=1.0, clamp_force=30.0, **other)
    pulled = np.concatenate(
        [np.linspace(0.0, 0.02, 4000), np.linspace(0.02, 0.0, 4000)]
    )
    conduit = Conduit(cable)
    highest = 0.0
    for u in pulled:
        conduit.step(1e-3, u_proximal=0.0, u_distal=u)
        highest = max(highest, conduit.tension_distal)
    assert 30.0 < highest < 30.5
    assert np.all(conduit.tension == 0.0)  # all pretension and more is lost
    again = []
    for u in pulled:
        conduit.step(1e-3, u_proximal=0.0, u_distal=u)
        again.append(conduit.tension_distal)
    assert max(again[:2000]) < 0.5 * highest


def test_creep_under_friction_slackens_and_keeps_the_books():
    cable = BENT.replace(segments=15, stress_relaxation=1.0, relaxation_time=5.0)
    conduit = Conduit(cable)
    for u in np.linspace(0.0, 4e-3, 50):
        conduit.step(1e-3, u_proximal=u, u_distal=0.0)
    assert conduit.tension_proximal < conduit.tension_distal
    stored = conduit.stored
    for _ in range(400):
        conduit.step(0.1, u_proximal=4e-3, u_distal=0.0)
        assert conduit.stored <= stored
        stored = conduit.stored
    assert np.all(conduit.tension == 0.0)
    # All stretch of the pretension is gone, and more was let in.
    lost = 5e-3 * (1.0 - math.exp(-40.05 / 5.0))
    assert conduit.slack == pytest.approx(4e-3 + lost - 5e-3, abs=1e-9)
    let_in = np.concatenate([np.linspace(0.0, 4e-3, 50), np.full(400, 4e-3)])
    steps = np.repeat([1e-3, 0.1], [50, 400])
    state = committed(cable, let_in, np.zeros(450), steps)
    assert state[3] == pytest.approx(-conduit.slack, abs=1e-12)
