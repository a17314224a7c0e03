"""Laws that hold for every cable: closed forms, energy, slack, friction terms."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cable.random_cables import sections
from cable.terms_on import TERMS_ON
from cc_mujoco.cable import (
    PARAMETERS,
    TERMS,
    Cable,
    Conduit,
    Section,
    packed_parameters,
    replay,
    rest_state,
)
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout

BENT = Cable(friction=0.21, pretension=10.0, conduit=(Section(2.0, 0.28),))
STRAIGHT = Cable(friction=0.3, pretension=10.0, conduit=(Section(2.0, math.inf),))
OF_CABLES = {name for name, term in TERMS.items() if term.acts_on != "pulley"}


def test_every_term_of_a_cable_is_tested_alone_and_with_all_others():
    springs = {"end_compliance", "proximal_compliance"}  # others need one
    alone = [
        set(BENT.replace(**on).terms) for name, on in TERMS_ON.items() if name != "all"
    ]
    assert OF_CABLES == {
        name for terms in alone if len(terms - springs) <= 2 for name in terms
    }
    assert set(BENT.replace(**TERMS_ON["all"]).terms) == OF_CABLES


def trapezoid(force, displacement):
    mean = 0.5 * (force[1:] + force[:-1])
    return np.concatenate([[0.0], np.cumsum(mean * np.diff(displacement))])


def work_in(motion):
    """Return the work of both ends on the cable: T du at distal, -T du at proximal."""
    return trapezoid(motion.tension_distal, motion.u_distal) - trapezoid(
        motion.tension_proximal, motion.u_proximal
    )


def wander(rng, samples, size, knots=12):
    at = np.linspace(0.0, 1.0, samples)
    values = np.concatenate([[0.0], rng.uniform(-size, size, knots)])
    return np.interp(at, np.linspace(0.0, 1.0, knots + 1), values)


@pytest.mark.parametrize("slip_direction", [-1.0, 1.0])
def test_full_slip_has_the_capstan_ratio(slip_direction):
    u = np.concatenate([np.linspace(0.0, 0.03, 50), np.linspace(0.03, 0.3, 300)])
    together = replay(
        BENT,
        1e-3,
        u_proximal=slip_direction * u,
        u_distal=slip_direction * u + np.minimum(u, 0.03),
    )
    ratio = together.tension_distal[-1] / together.tension_proximal[-1]
    assert ratio == pytest.approx(math.exp(slip_direction * 0.21 * BENT.wrap), rel=1e-9)
    assert together.moving_fraction[-1] == 1.0


def test_straight_conduit_obeys_hooke():
    rng = np.random.default_rng(0)
    proximal, distal = wander(rng, 500, 4e-3), wander(rng, 500, 4e-3) + 5e-3
    distal[0] = proximal[0] = 0.0
    motion = replay(STRAIGHT, 1e-3, u_proximal=proximal, u_distal=distal)
    stretch = 10.0 * 2.0 / 4000.0 + distal - proximal
    tension = 4000.0 * np.maximum(stretch, 0.0) / 2.0
    assert motion.tension_proximal == pytest.approx(tension, abs=1e-9)
    assert motion.tension_distal == pytest.approx(tension, abs=1e-9)


def test_tension_lost_to_slack_is_exactly_zero_and_returns_when_taut():
    pushed = np.concatenate([np.linspace(0.0, 0.02, 100), np.linspace(0.02, 0.0, 100)])
    motion = replay(BENT, 1e-3, u_proximal=pushed, u_distal=np.zeros(200))
    slack = pushed > 0.00501
    assert np.all(motion.tension_proximal[slack] == 0.0)
    assert np.all(motion.tension_distal[slack] == 0.0)
    assert motion.slack[slack] == pytest.approx(pushed[slack] - 0.005, abs=1e-12)
    assert motion.tension_proximal[-1] > 5.0
    assert motion.slack[-1] == 0.0


def test_a_cable_at_rest_stays_as_it_is():
    conduit = Conduit(BENT)
    conduit.step(1e-3, u_proximal=-0.004, u_distal=0.001)
    before = conduit.tension
    for _ in range(60_000 // 100):
        conduit.step(1e-3, u_proximal=-0.004, u_distal=0.001)
    assert np.array_equal(conduit.tension, before)
    assert conduit.moving_fraction == 0.0


def missing_heat(terms, strain, friction, size, seed, steps):
    """Return the energy that a turn of both ends leaves unexplained, by its heat.

    Args:
        terms: values of the cable.
        strain: at its pretension.
        friction: coefficient.
        size: of the motion, over half of what the pretension stretches it.
        seed: of amplitudes and phases.
        steps: of the turn, which takes 1 s.
    """
    rng = np.random.default_rng(seed)
    given = {"axial_stiffness": 100.0 / strain, "pretension": 100.0, "segments": 9}
    cable = Cable(friction=friction, conduit=(Section(0.5, 0.4),), **given, **terms)
    reach = 0.25 * size * min(strain, 0.05) * rng.uniform(0.3, 1.0, (2, 2))
    phase, turn = rng.uniform(0.0, 6.0, (2, 2)), np.linspace(0.0, 2.0 * np.pi, steps)
    ends = np.zeros((2, steps))
    for end, tone in np.ndindex(2, 2):
        swing = np.sin((tone + 1) * turn + phase[end, tone]) - np.sin(phase[end, tone])
        ends[end] += reach[end, tone] * swing
    prm, n, state = packed_parameters(cable), cable.segments, rest_state(cable)
    new, work = np.empty_like(state), np.empty(kernel.work_size(n))
    tension, start, given, gross = layout.tensions, rest_state(cable), 0.0, 0.0
    for k in range(1, steps):
        kernel.advance(prm, n, state, *ends[:, k], 1.0 / steps, new, work)
        pull = [taut_mean(tension(state, n)[i], tension(new, n)[i]) for i in (0, n)]
        moved = ends[:, k] - ends[:, k - 1]
        part = pull[1] * moved[1] - pull[0] * moved[0]
        given, gross = given + part, gross + abs(part)
        assert new[2] >= state[2]
        state, new = new, state
    stored = [kernel.stored_energy(prm, n, at) for at in (start, state)]
    return abs(given - (stored[1] - stored[0]) - state[2]) / max(state[2], 1e-3 * gross)


def taut_mean(before, after):
    """Return the mean tension of an end on a straight way, none while slack [N]."""
    low, high = sorted((before, after))
    if low >= 0.0 or high <= 0.0:
        return max(0.5 * (low + high), 0.0)
    return 0.5 * high * high / (high - low)


def largest_missing_heat(terms):
    """Return what a turn in 1000 steps may leave, as part of its heat.

    Drag that needs no tension begins at once where slack runs out, within a step;
    work on a cable that beds in or seats, or on a spring that hardens or holds, is not
    quite the mean tension times the way.
    """
    drags = (
        "load_independent_friction", "seal_proximal", "seal_distal",
        "viscous_friction", "grease_drag",
    )  # fmt: skip
    if any(term in terms for term in drags):
        return 1e-3
    smooth = (
        "bedding_strain", "clearance",
        "end_hardening", "end_loss", "proximal_hardening", "proximal_loss",
    )  # fmt: skip
    if any(term in terms for term in smooth):
        return 1e-4
    # Where rounds of bristles do not settle, they keep what adds no energy to a chain.
    return 1e-5 if "bristle_length" in terms else 1e-10


@pytest.mark.parametrize("strain", [0.005, 0.05, 0.2])
@pytest.mark.parametrize("terms", TERMS_ON.values(), ids=TERMS_ON)
def test_work_is_stored_or_heat(terms, strain):
    missing = missing_heat(terms, strain, 0.3, 2.0, 0, 1000)
    assert missing < largest_missing_heat(terms)


@pytest.mark.study
@pytest.mark.parametrize("seed", range(200))
def test_work_of_any_terms_is_stored_or_heat(seed):
    """Check all terms, and clamps, bristles and relaxation of any size."""
    rng = np.random.default_rng([seed, 8])
    own = {
        "clamp_creep_proximal": 10 ** rng.uniform(-6.0, -2.0),
        "clamp_creep_distal": 10 ** rng.uniform(-6.0, -2.0),
        "clamp_force": rng.choice([0.0, 10.0, 50.0, 95.0]),
        "stress_relaxation": rng.uniform(0.1, 1.0),
        "relaxation_time": 10 ** rng.uniform(-1.0, 1.0),
    }
    bristles = {"bristle_length": 10 ** rng.uniform(-4.0, -2.0)}
    strain, friction = 10 ** rng.uniform(-2.3, -0.7), rng.choice([0.05, 0.3])
    size = rng.choice([0.5, 1.0, 2.0])
    for terms in (*TERMS_ON.values(), own, bristles, own | bristles):
        coarse, fine = (
            missing_heat(terms, strain, friction, size, seed, n) for n in (1000, 4000)
        )
        most = largest_missing_heat(terms)
        assert coarse < 2.0 * most
        assert fine < max(0.5 * most, 1e-10)


@pytest.mark.parametrize("terms", TERMS_ON.values(), ids=TERMS_ON)
@given(seed=st.integers(0, 2**31))
@settings(max_examples=3)
def test_a_closed_cycle_returns_no_more_energy_than_it_took(terms, seed):
    rng = np.random.default_rng(seed)
    cable = BENT.replace(segments=15, **terms)
    proximal, distal = wander(rng, 800, 0.01, 6), wander(rng, 800, 0.01, 6)
    # There, and back to rest; the second lap starts and ends in the same place.
    there = np.concatenate([proximal, proximal[::-1], proximal, proximal[::-1]])
    back = np.concatenate([distal, distal[::-1], distal, distal[::-1]])
    motion = replay(cable, 1e-3, u_proximal=there, u_distal=back)
    lap = len(there) // 2 - 1
    gain = motion.stored[-1] - motion.stored[lap]
    took = work_in(motion)[-1] - work_in(motion)[lap]
    assert took - gain >= -1e-6 * (1.0 + motion.dissipated[-1])
    assert np.all(np.diff(motion.dissipated) >= 0.0)


def extremes():
    scalars = {
        p.name: st.one_of(
            st.floats(max(p.low, 1e-12) if p.low_open else p.low, p.high),
            st.floats(max(p.low, 1e-6), min(p.high, 2.0)),
        )
        for p in PARAMETERS
        if p.name not in ("static_friction", "pretension")
    }
    scalars["pretension"] = st.floats(1e-9, 1e6)
    for name in "end_compliance", "proximal_compliance":  # others need one
        scalars[name] = st.floats(1e-12, 1.0)
    conduit = st.lists(sections(1e-4), min_size=1, max_size=4)
    return st.fixed_dictionaries(
        {**scalars, "conduit": conduit, "segments": st.integers(1, 40)}
    )


@given(
    values=extremes(),
    static=st.floats(0.0, 1.0),
    seed=st.integers(0, 2**31),
    size=st.sampled_from([1e-12, 1e-4, 1e-2, 1.0, 1e4]),
    dt=st.sampled_from([1e-9, 1e-3, 10.0]),
)
@settings(max_examples=100)
def test_tension_is_finite_and_never_negative(values, static, seed, size, dt):
    extra = values["friction"] * static
    if static > 0.5:
        values["static_friction"] = min(values["friction"] + extra, 5.0)
    values["conduit"] = tuple(Section(*s) for s in values["conduit"])
    rng = np.random.default_rng(seed)
    proximal, distal = wander(rng, 60, size), wander(rng, 60, size)
    motion = replay(
        Cable(**values), dt, u_proximal=proximal, u_distal=distal, profile=True
    )
    for series in (motion.tension, motion.stored, motion.dissipated, motion.slack):
        assert np.all(np.isfinite(series))
        assert np.all(series >= 0.0)
    assert np.all(np.diff(motion.dissipated) >= 0.0)


@given(seed=st.integers(0, 2**31), segments=st.integers(1, 30))
@settings(max_examples=60)
def test_stretch_of_the_nodes_adds_up_to_that_of_the_ends(seed, segments):
    rng = np.random.default_rng(seed)
    cable = BENT.replace(segments=segments)
    proximal, distal = wander(rng, 300, 0.01), wander(rng, 300, 0.01)
    motion = replay(cable, 1e-3, u_proximal=proximal, u_distal=distal, profile=True)
    share = np.full(segments + 1, 2.0 / segments)
    share[[0, -1]] /= 2.0
    stretch = motion.tension @ share / 4000.0 - motion.slack
    assert stretch == pytest.approx(0.005 + distal - proximal, abs=1e-12)


@given(seed=st.integers(0, 2**31))
@settings(max_examples=30)
@example(seed=130)  # a null point in the last half segment of a cable let go
def test_friction_stays_within_its_cone(seed):
    rng = np.random.default_rng(seed)
    proximal, distal = wander(rng, 400, 0.02), wander(rng, 400, 0.02)
    motion = replay(BENT, 1e-3, u_proximal=proximal, u_distal=distal, profile=True)
    low = np.minimum(motion.tension[:, 1:], motion.tension[:, :-1])
    high = np.maximum(motion.tension[:, 1:], motion.tension[:, :-1])
    assert np.all(high <= low * math.exp(0.21 * BENT.wrap / 50) * (1 + 1e-9) + 1e-9)


@pytest.mark.parametrize("name", [n for n in TERMS_ON if n not in ("kinetic", "all")])
def test_a_term_that_is_off_changes_nothing(name):
    rng = np.random.default_rng(2)
    proximal, distal = wander(rng, 2000, 0.02), wander(rng, 2000, 0.02)
    plain = replay(BENT, 1e-3, u_proximal=proximal, u_distal=distal)
    shape = {
        p.name: 0.3 * p.default or 3e-3
        for p in PARAMETERS
        if p.term is None and p.name not in ("axial_stiffness", "pretension")
    }
    off = replay(BENT.replace(**shape), 1e-3, u_proximal=proximal, u_distal=distal)
    on = replay(
        BENT.replace(**TERMS_ON[name]), 1e-3, u_proximal=proximal, u_distal=distal
    )
    assert np.array_equal(plain.tension_proximal, off.tension_proximal)
    assert np.array_equal(plain.tension_distal, off.tension_distal)
    assert not np.allclose(plain.tension_proximal, on.tension_proximal, atol=0.05)


def sliding(cable, speed, dt=1e-3):
    """Return the end tensions of a cable that slides steadily towards proximal."""
    time = np.arange(0.0, 0.4 / speed, dt)
    motion = replay(cable, dt, u_proximal=-speed * time, u_distal=-speed * time)
    return motion.tension_distal[-1], motion.tension_proximal[-1]


def test_viscous_friction_in_steady_sliding():
    cable = BENT.replace(viscous_friction=40.0)
    low, high = sliding(cable, 0.1)
    # dT/dx = kappa T + c v from distal to proximal, kappa = mu / R.
    kappa = 0.21 / 0.28
    drag = 40.0 * 0.1
    expected = (low + drag / kappa) * math.exp(kappa * 2.0) - drag / kappa
    assert high == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("speed", [0.01, 0.1])
@pytest.mark.parametrize(
    ("exponent", "tail", "share"),
    [
        (1.0, 0.0, lambda x: math.exp(-x)),
        (2.0, 0.0, lambda x: math.exp(-(x**2))),
        (2.0, 1.0, lambda x: 1.0 / (1.0 + x**2)),
    ],
    ids=("exponential", "Gaussian", "Lorentzian"),
)
def test_stribeck_friction_in_steady_sliding(exponent, tail, share, speed):
    cable = BENT.replace(
        stribeck_friction=0.15,
        stribeck_speed=0.02,
        stribeck_exponent=exponent,
        stribeck_tail=tail,
        critical_slip_distance=1e-3,
    )
    low, high = sliding(cable, speed)
    coefficient = 0.21 + 0.15 * share(speed / 0.02)
    assert math.log(high / low) == pytest.approx(coefficient * BENT.wrap, rel=1e-3)


def test_load_independent_friction_in_steady_sliding():
    cable = BENT.replace(load_independent_friction=3.0)
    low, high = sliding(cable, 0.05)
    kappa = 0.21 / 0.28
    expected = (low + 3.0 / kappa) * math.exp(kappa * 2.0) - 3.0 / kappa
    assert high == pytest.approx(expected, rel=1e-6)
    straight = STRAIGHT.replace(friction=0.0, load_independent_friction=3.0)
    low, high = sliding(straight, 0.05)
    assert high - low == pytest.approx(6.0, rel=1e-6)


def test_seals_in_steady_sliding():
    """The distal seal's drag is carried through the conduit, the proximal one's not."""
    cable = BENT.replace(seal_proximal=2.0, seal_distal=1.0, segments=200)
    low, high = sliding(cable, 0.05)
    expected = (low + 1.0) * math.exp(0.21 * BENT.wrap) + 2.0
    assert high == pytest.approx(expected, rel=2e-3)
    straight = STRAIGHT.replace(friction=0.0, seal_proximal=2.0, seal_distal=1.0)
    low, high = sliding(straight, 0.05)
    assert high - low == pytest.approx(3.0, rel=1e-9)


@pytest.mark.parametrize("end", ["seal_proximal", "seal_distal"])
def test_a_seal_holds_its_end(end):
    """Without other friction the inner cable is at rest until the seal slips."""
    cable = STRAIGHT.replace(friction=0.0, segments=20, **{end: 3.0})
    conduit = Conduit(cable)
    stiffness = 20.0 * cable.axial_stiffness / cable.length
    beyond = 19.5 if end == "seal_distal" else 0.5  # segments between motor and seal
    slips = 3.0 / stiffness * beyond
    for u in np.linspace(0.0, -0.99 * slips, 50):
        conduit.step(1e-3, u_proximal=u, u_distal=0.0)
    assert conduit.tension_distal == pytest.approx(10.0, rel=1e-9)
    conduit.step(1e-3, u_proximal=-1.2 * slips, u_distal=0.0)
    assert conduit.tension_distal > 10.0


def break_away(cable):
    """Return the mean excess of proximal tension over the kinetic law at break-away."""
    pull = -np.linspace(0.0, 0.02, 4000)
    motion = replay(cable, 1e-3, u_proximal=pull, u_distal=np.zeros(4000))
    kinetic = replay(
        cable.replace(static_friction=0.0),
        1e-3,
        u_proximal=pull,
        u_distal=np.zeros(4000),
    )
    return float(np.mean(motion.tension_proximal - kinetic.tension_proximal))


def test_static_friction_across_one_segment_fades_with_the_mesh():
    cable = BENT.replace(static_friction=0.63)
    peaks = [break_away(cable.replace(segments=n)) for n in (25, 50, 100)]
    # The rise halves with the segment, and so does the slip over which it lasts.
    assert peaks[0] / peaks[1] == pytest.approx(4.0, rel=0.1)
    assert peaks[1] / peaks[2] == pytest.approx(4.0, rel=0.1)


def test_static_friction_with_a_critical_slip_distance_does_not_depend_on_the_mesh():
    cable = BENT.replace(static_friction=0.63, critical_slip_distance=5e-3)
    peaks = [break_away(cable.replace(segments=n)) for n in (50, 100, 200)]
    assert peaks[1] > 1.0
    assert peaks[0] == pytest.approx(peaks[2], rel=0.05)
    assert abs(peaks[1] - peaks[2]) < 0.7 * abs(peaks[0] - peaks[2])


def test_tension_modes_invert_the_position_mode():
    rng = np.random.default_rng(8)
    proximal, distal = wander(rng, 1500, 0.008), wander(rng, 1500, 0.008) + 0.012
    distal[0] = proximal[0]
    cable = BENT.replace(segments=30, pretension=40.0)
    by_position = replay(cable, 1e-3, u_proximal=proximal, u_distal=distal)
    assert by_position.tension_distal.min() > 0.0
    pulled = replay(
        cable, 1e-3, tension_proximal=by_position.tension_proximal, u_distal=distal
    )
    # Friction holds a range of tensions at one position, not of positions at one
    # tension: the way back is unique up to the null point's share of a segment.
    assert pulled.u_proximal == pytest.approx(proximal, abs=2e-4)
    assert pulled.tension_distal == pytest.approx(by_position.tension_distal, abs=1.0)


def test_uneven_initial_tension_is_kept_and_checked():
    nodes = 10.0 * np.exp(0.8 * 0.21 * BENT.wrap * np.linspace(0.0, 1.0, 51))
    conduit = Conduit(BENT, tension=nodes)
    assert np.array_equal(conduit.tension, nodes)
    conduit.step(1e-3, u_proximal=-1e-6, u_distal=0.0)
    assert np.array_equal(conduit.tension[5:], nodes[5:])
    with pytest.raises(
        ValueError, match="jumps from 10 N to 60 N between nodes 9 and 10"
    ):
        Conduit(BENT, tension=np.where(np.arange(51) < 10, 10.0, 60.0))


@pytest.mark.parametrize("seed", range(6))
def test_an_end_at_rest_may_tremble(seed):
    """The sign of a negligible displacement of an end has a negligible effect."""
    rng = np.random.default_rng(seed)
    cable = BENT.replace(
        friction=rng.uniform(0.02, 0.3),
        pretension=rng.uniform(20.0, 60.0),
        segments=int(rng.integers(4, 25)),
    )
    conduit = Conduit(cable)
    speeds = np.repeat(rng.normal(size=(15, 2)), 10, axis=0)
    for proximal, distal in 3e-4 * np.cumsum(speeds, axis=0):
        found = []
        for tremor in (-1e-12, 1e-12):
            other = copy.deepcopy(conduit)
            rest = conduit.u_distal + tremor
            other.step(1e-3, u_proximal=proximal, u_distal=rest)
            found.append([other.tension_proximal, other.tension_distal])
        assert np.ptp(found, axis=0).max() < 1e-6 * cable.pretension
        conduit.step(1e-3, u_proximal=proximal, u_distal=distal)
