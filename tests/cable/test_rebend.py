"""Bends that change under a loaded cable."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco.cable import Cable, Conduit, Section, packed_parameters, rest_state
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.errors import CableError

LENGTH = 2.0
CABLE = Cable(
    axial_stiffness=4000.0,
    pretension=10.0,
    friction=0.2,
    static_friction=0.0,
    conduit=(Section(LENGTH, 0.4),),
    segments=40,
)


def bends(*curvatures):
    """Equal sections of these curvatures [1/m]."""
    length = LENGTH / len(curvatures)
    return [Section(length, 1.0 / c if c > 0.0 else math.inf) for c in curvatures]


def loaded(cable=CABLE, pull=0.012, steps=60):
    conduit = Conduit(cable)
    for part in np.linspace(0.0, pull, steps):
        conduit.step(1e-3, u_proximal=-part, u_distal=0.0)
    return conduit


def hold(conduit):
    conduit.step(1e-3, u_proximal=conduit.u_proximal, u_distal=conduit.u_distal)


def test_straightened_conduit_evens_out_the_tension():
    conduit = loaded()
    before = conduit.tension
    assert before[0] > 1.3 * before[-1]
    conduit.rebend(bends(0.0))
    hold(conduit)
    stretch = 10.0 * LENGTH / 4000.0 + 0.012
    assert conduit.tension == pytest.approx(stretch * 4000.0 / LENGTH, rel=1e-9)


def test_cable_held_by_tighter_bends_does_not_move():
    conduit = loaded()
    before = conduit.tension
    conduit.rebend(bends(4.0))
    hold(conduit)
    assert np.array_equal(conduit.tension, before)
    assert conduit.moving_fraction == 0.0


def test_the_path_it_already_has_changes_nothing_in_motion():
    plain, bent = loaded(), loaded()
    bent.rebend(CABLE.conduit)
    for part in np.linspace(0.0, 0.01, 50):
        for conduit in (plain, bent):
            conduit.step(1e-3, u_proximal=-0.012 - part, u_distal=-part)
    assert bent.tension == pytest.approx(plain.tension, rel=1e-9)
    assert bent.dissipated == pytest.approx(plain.dissipated, rel=1e-9)


@given(
    path=st.lists(st.floats(0.0, 6.0), min_size=1, max_size=5),
    pull=st.floats(0.0, 0.03),
)
@settings(max_examples=40)
def test_friction_limits_every_segment_and_creates_no_energy(path, pull):
    conduit = loaded(pull=pull)
    before = conduit.stored
    lost = conduit.dissipated
    conduit.rebend(bends(*path))
    hold(conduit)
    tension = conduit.tension
    low, high = np.sort([tension[1:], tension[:-1]], axis=0)
    wrap = np.concatenate([[0.0], np.cumsum(path)]) * LENGTH / len(path)
    at = np.interp(np.linspace(0.0, 1.0, 41), np.linspace(0.0, 1.0, wrap.size), wrap)
    assert np.all(high <= low * np.exp(0.2 * np.diff(at)) * (1.0 + 1e-9) + 1e-9)
    assert np.all(tension >= 0.0)
    assert conduit.stored <= before + 1e-12
    assert conduit.dissipated >= lost


def wide_stretch(tension, wrap):
    """Stretch of a cable without friction and with 1 mm of clearance [m]."""
    return tension * LENGTH / 4000.0 + 1e-3 * wrap * tension / (tension + 5.0)


def test_clearance_of_tighter_bends_takes_the_cable_that_it_gives():
    """Without friction the stretch stays the same, and a way back undoes all."""
    conduit = loaded(CABLE.replace(friction=0.0, clearance=1e-3, seating_tension=5.0))
    start = conduit.tension
    stretch = wide_stretch(10.0, CABLE.wrap) + 0.012
    assert wide_stretch(start, CABLE.wrap) == pytest.approx(stretch, rel=1e-6)
    seen = []
    for path in (bends(4.0), bends(0.0, 3.0), bends(0.0)):
        conduit.rebend(path)
        hold(conduit)
        wrap = sum(s.length / s.radius for s in path)
        assert wide_stretch(conduit.tension, wrap) == pytest.approx(stretch, rel=1e-6)
        seen.append(conduit.tension[0])
    assert seen[0] < start[0] < seen[-1]
    conduit.rebend(CABLE.conduit)
    hold(conduit)
    assert conduit.tension == pytest.approx(start, rel=1e-6)


@given(
    path=st.lists(st.floats(0.0, 6.0), min_size=1, max_size=5),
    pull=st.floats(-0.02, 0.03),
)
@settings(max_examples=40)
def test_a_cable_with_clearance_keeps_its_length_in_other_bends(path, pull):
    cable = CABLE.replace(clearance=1e-3)
    conduit = loaded(cable, pull=pull)
    conduit.rebend(bends(*path))
    hold(conduit)
    rest = kernel.total_stretch(packed_parameters(cable), 40, rest_state(cable))
    found = kernel.total_stretch(conduit._prm, 40, conduit._state)
    assert found == pytest.approx(rest + pull, abs=2e-6)


def test_reset_returns_to_the_first_path():
    conduit = loaded()
    conduit.rebend(bends(0.0))
    hold(conduit)
    conduit.reset()
    for part in np.linspace(0.0, 0.012, 60):
        conduit.step(1e-3, u_proximal=-part, u_distal=0.0)
    assert np.array_equal(conduit.tension, loaded().tension)


def test_another_length_is_refused():
    with pytest.raises(CableError, match=r"1 m long; it must be 2 m"):
        Conduit(CABLE).rebend([Section(1.0, 0.4)])


def travelling(segments):
    """End tensions while a tighter bend travels to and fro and both ends move."""
    conduit = Conduit(CABLE.replace(segments=segments))
    tensions = []
    for at in np.linspace(0.0, 6.0, 300):
        middle = 1.0 + 0.6 * math.sin(1.3 * at)
        conduit.rebend(
            [
                Section(middle - 0.3, 1.0),
                Section(0.6, 0.25),
                Section(LENGTH - middle - 0.3, 1.0),
            ]
        )
        distal = 0.01 * math.sin(2.1 * at)
        conduit.step(1e-3, u_proximal=-0.015 * math.sin(at), u_distal=distal)
        tensions.append((conduit.tension_proximal, conduit.tension_distal))
    return np.array(tensions)


def test_moving_bends_converge_with_the_number_of_segments():
    exact = travelling(800)
    errors = [
        float(np.sqrt(np.mean((travelling(n) - exact) ** 2))) / exact.max()
        for n in (25, 50, 100)
    ]
    assert errors[0] > 1.5 * errors[1] > 2.0 * errors[2]
    assert errors[1] < 0.002
