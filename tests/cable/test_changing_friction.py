"""Friction that depends on tension, rest, place and time, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cable.test_kernel_physics import BENT, sliding
from cc_mujoco.cable import Conduit, replay


@pytest.mark.parametrize("exponent", [-0.3, 0.25])
def test_tension_dependent_friction_in_steady_sliding(exponent):
    errors = []
    for segments in (25, 100):
        cable = BENT.replace(tension_exponent=exponent, friction=0.1, segments=segments)
        low, high = sliding(cable, 0.05)
        # dT/da = mu T (T / T0)^e along the angle a from distal to proximal.
        power = (low / 10.0) ** -exponent - exponent * 0.1 * cable.wrap
        errors.append(abs(high / (10.0 * power ** (-1.0 / exponent)) - 1.0))
    assert errors[1] < 0.3 * errors[0]
    assert errors[1] < 1e-3


def test_tension_dependence_is_cut_at_a_hundredth_of_the_pretension():
    cable = BENT.replace(tension_exponent=-1.0, friction=1e-3, segments=1)
    conduit = Conduit(cable)
    for u in np.linspace(0.0, 0.005 - 1e-6, 400):
        conduit.step(1e-3, u_proximal=u, u_distal=0.0)
    for u in np.linspace(0.0, -0.05, 400):
        conduit.step(1e-3, u_proximal=0.005 - 1e-6 + u, u_distal=u)
    ratio = conduit.tension_proximal / conduit.tension_distal
    assert conduit.tension_proximal < 0.1
    assert math.log(ratio) == pytest.approx(1e-3 * 100.0 * cable.wrap, rel=1e-9)


def broken_away(cable, rest, after=0.0):
    """Log of the tension ratio when slip begins after a rest, or some slip later."""
    conduit = Conduit(cable)
    for _ in range(10):
        conduit.step(rest / 10.0, u_proximal=0.0, u_distal=0.0)
    fine = 1e-6 * 4000.0 / cable.axial_stiffness
    ratios, u, slipped = [], 0.0, 0.0
    while slipped <= after:
        u -= 1e-6 if slipped > 0.0 else fine
        conduit.step(1e-9, u_proximal=u, u_distal=u)
        ratios.append(conduit.tension_proximal / conduit.tension_distal)
        if conduit.moving_fraction > 0.0:
            slipped += 1e-6
    return math.log(ratios[-2] if after == 0.0 else ratios[-1])


@pytest.mark.parametrize("rest", [0.1, 3.0, 100.0])
def test_friction_after_a_rest_grows_with_the_logarithm_of_time(rest):
    cable = BENT.replace(
        segments=1, friction=0.1, ageing_friction=0.02, ageing_time=0.5
    )
    coefficient = 0.1 + 0.02 * math.log(1.0 + rest / 0.5)
    assert broken_away(cable, rest) == pytest.approx(coefficient * cable.wrap, abs=2e-3)
    # Without memory the first slip takes it all back.
    assert broken_away(cable, rest, 1e-5) == pytest.approx(0.1 * cable.wrap, abs=1e-6)


def test_the_excess_of_a_rest_fades_over_the_critical_slip_distance():
    cable = BENT.replace(
        segments=1,
        axial_stiffness=4e6,
        friction=0.1,
        ageing_friction=0.05,
        critical_slip_distance=1e-3,
    )
    for after in (5e-4, 1e-3, 3e-3):
        excess = 0.05 * math.log(1.0 + 10.0 * math.exp(-after / 1e-3))
        found = broken_away(cable, 10.0, after)
        # A stiff cable, so nearly all of the motion is slip.
        assert found == pytest.approx((0.1 + excess) * cable.wrap, rel=0.02)


@pytest.mark.parametrize("speed", [0.01, 0.05])
def test_contacts_that_slide_keep_the_age_of_one_critical_slip_distance(speed):
    """Ruina's steady state: age = critical slip distance over speed."""
    ageing = {
        "ageing_friction": 0.05,
        "ageing_time": 0.01,
        "critical_slip_distance": 1e-3,
    }
    cable = BENT.replace(friction=0.1, **ageing)
    low, high = sliding(cable, speed)
    coefficient = 0.1 + 0.05 * math.log(1.0 + 1e-3 / speed / 0.01)
    assert math.log(high / low) == pytest.approx(coefficient * cable.wrap, rel=1e-3)


def test_age_is_kept_while_the_slip_has_not_taken_it():
    """A short slip does not make a long rest forgotten."""
    cable = BENT.replace(
        segments=1,
        axial_stiffness=4e6,
        friction=0.1,
        ageing_friction=0.05,
        critical_slip_distance=1e-2,
    )
    conduit = Conduit(cable)
    conduit.step(1000.0, u_proximal=0.0, u_distal=0.0)
    u = 0.0
    while conduit.moving_fraction == 0.0:
        u -= 1e-9
        conduit.step(1e-9, u_proximal=u, u_distal=u)
    first = conduit.tension_proximal / conduit.tension_distal
    for _ in range(5):
        conduit.step(1e-9, u_proximal=u, u_distal=u)
    assert conduit.moving_fraction == 0.0
    while conduit.moving_fraction == 0.0:
        u -= 1e-9
        conduit.step(1e-9, u_proximal=u, u_distal=u)
    second = conduit.tension_proximal / conduit.tension_distal
    assert second == pytest.approx(first, rel=1e-3)


@pytest.mark.parametrize("slip_direction", [-1.0, 1.0])
def test_wrap_that_grows_with_the_distal_end(slip_direction):
    cable = BENT.replace(wrap_growth=2.0, segments=20)
    u = slip_direction * np.linspace(0.0, 0.2, 4000)
    motion = replay(cable, 1e-3, u_proximal=0.7 + u, u_distal=0.3 + u)
    ratio = np.log(motion.tension_distal[-1] / motion.tension_proximal[-1])
    wrap = BENT.wrap * (1.0 + 2.0 * u[-2])
    assert slip_direction * ratio == pytest.approx(0.21 * wrap, rel=1e-9)


@pytest.mark.parametrize("segments", [1, 7, 20])
def test_wrap_that_grows_in_the_last_part_of_the_conduit_only(segments):
    cable = BENT.replace(wrap_growth=2.0, wrap_reach=0.3, segments=segments)
    u = np.linspace(0.0, 0.2, 4000)
    motion = replay(cable, 1e-3, u_proximal=u, u_distal=u)
    ratio = np.log(motion.tension_distal[-1] / motion.tension_proximal[-1])
    wrap = BENT.wrap * (1.0 + 0.3 * 2.0 * u[-2])
    assert ratio == pytest.approx(0.21 * wrap, rel=1e-9)


def test_the_part_that_bends_is_at_the_distal_end():
    cable = BENT.replace(wrap_growth=5.0, wrap_reach=0.5, segments=20)
    u = np.linspace(0.0, 0.2, 4000)
    motion = replay(cable, 1e-3, u_proximal=u, u_distal=u, profile=True)
    steps = np.diff(np.log(motion.tension[-1]))
    assert steps[:10] == pytest.approx(0.21 * BENT.wrap / 20, rel=1e-9)
    assert steps[10:] == pytest.approx(
        0.21 * BENT.wrap / 20 * (1 + 5 * u[-2]), rel=1e-9
    )


def test_wrap_that_shrinks_ends_at_a_straight_cable():
    cable = BENT.replace(wrap_growth=-20.0, segments=20)
    u = np.linspace(0.0, 0.1, 2000)
    motion = replay(cable, 1e-3, u_proximal=u, u_distal=u)
    assert motion.tension_distal[-1] == pytest.approx(10.0, rel=1e-9)
    assert motion.tension_proximal[-1] == pytest.approx(10.0, rel=1e-9)


@pytest.mark.parametrize("drift", [-0.1, 0.2])
def test_friction_drifts_with_time(drift):
    cable = BENT.replace(friction_drift=drift, segments=20)
    time = np.arange(1, 4001) * 1e-3
    motion = replay(cable, 1e-3, u_proximal=-time / 20, u_distal=-time / 20)
    ratio = np.log(motion.tension_proximal / motion.tension_distal)
    wanted = 0.21 * BENT.wrap * (1.0 + drift * time)
    assert ratio[2000:] == pytest.approx(wanted[2000:], rel=1e-9)


@pytest.mark.parametrize("heating", [0.5, -0.05])
def test_friction_changes_with_the_heat_that_it_leaves(heating):
    cable = BENT.replace(friction_heating=heating, cooling_time=3.0, segments=20)
    time = np.arange(1, 4001) * 1e-3
    motion = replay(cable, 1e-3, u_proximal=-time / 20, u_distal=-time / 20)
    power = np.diff(motion.dissipated, prepend=0.0)
    heat = 0.0
    ratio = np.log(motion.tension_proximal / motion.tension_distal)
    for k in range(4000):
        if k > 2000:
            wanted = 0.21 * BENT.wrap * (1.0 + heating * heat)
            assert ratio[k] == pytest.approx(wanted, rel=1e-9)
        heat = (heat + power[k]) * math.exp(-1e-3 / 3.0)
    assert heat > 0.1


def test_friction_that_has_drifted_away_is_zero():
    cable = BENT.replace(friction_drift=-1.0, segments=10)
    conduit = Conduit(cable)
    for _ in range(5):
        conduit.step(0.25, u_proximal=-0.02, u_distal=0.0)
    assert conduit.tension == pytest.approx(conduit.tension.mean(), rel=1e-9)
    conduit.reset()
    conduit.step(1e-3, u_proximal=-0.02, u_distal=0.0)
    assert conduit.tension_proximal > 1.5 * conduit.tension_distal
