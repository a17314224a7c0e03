"""Physics behind experiments 1 and 3: what pretension, bends and followers do."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cc_mujoco.cable import Section
from thesis import _rig as rig
from thesis._experiments import blocked, follower


def test_torque_is_the_chopped_triangle() -> None:
    time, torque = rig.chopped_triangle()
    assert time[-1] == pytest.approx(rig.DURATION, abs=2 * rig.DT)
    assert np.max(torque) == -np.min(torque) == rig.PEAK_TORQUE
    rate = np.abs(np.diff(torque)) / rig.DT
    assert np.max(rate) == pytest.approx(rig.TORQUE_RATE)
    held = np.diff(np.flatnonzero(np.diff(torque == rig.PEAK_TORQUE)))[0] * rig.DT
    assert held == pytest.approx(rig.DWELL_TIME, abs=2 * rig.DT)


@pytest.mark.parametrize("friction", [0.02, 0.21])
def test_output_feels_the_motor_when_the_first_front_arrives(friction: float) -> None:
    cable = blocked.COULOMB.replace(friction=friction, segments=150)
    torque = np.linspace(0.0, 3.0, 12_000)
    found = rig.drive(cable).replay(
        rig.DT, motor_torque=torque, joint_angle=np.zeros_like(torque)
    )
    onset = torque[np.argmax(np.abs(found.joint_torque) > 1e-3)]
    assert onset == pytest.approx(rig.onset_torque(cable), rel=0.02)


def test_table_2_2_does_not_move_the_output_of_experiment_1() -> None:
    assert rig.onset_torque(blocked.COULOMB) > 3.0 * rig.PEAK_TORQUE
    assert np.ptp(rig.blocked_output_test(rig.PRINTED_CABLE).joint_torque) < 1e-9


def test_less_pretension_alone_stays_below_the_capstan_ratio() -> None:
    low = rig.blocked_output_test(blocked.COULOMB.replace(pretension=0.2))
    bound = math.exp(-blocked.COULOMB.friction * blocked.COULOMB.wrap)
    assert low.efficiency == pytest.approx(bound, rel=1e-3)


def test_reconciled_differs_from_table_2_2_in_friction_alone() -> None:
    back = rig.RECONCILED_CABLE.replace(
        friction=rig.PRINTED_CABLE.friction,
        static_friction=rig.PRINTED_CABLE.static_friction,
    )
    assert back == rig.PRINTED_CABLE
    three = rig.RECONCILED_CABLE.replace(conduit=rig.conduit_in_loops(3))
    assert rig.onset_torque(three) < rig.PEAK_TORQUE
    assert rig.onset_torque(three.replace(friction=0.02)) > rig.PEAK_TORQUE


def test_pretension_and_loops_widen_the_loop_and_take_efficiency() -> None:
    cables = [rig.RECONCILED_CABLE.replace(pretension=value) for value in (5.0, 20.0)]
    cables += [
        rig.RECONCILED_CABLE.replace(conduit=rig.conduit_in_loops(n)) for n in (1, 3)
    ]
    found = [rig.blocked_output_test(cable) for cable in cables]
    for rows in (found[:2], found[2:]):
        assert np.all(np.diff([row.efficiency for row in rows]) < 0.0)
        assert np.all(np.diff([row.backlash for row in rows]) > 0.0)


def test_work_of_a_cycle_is_what_friction_takes() -> None:
    time, torque = rig.chopped_triangle()
    found = rig.drive(rig.RECONCILED_CABLE).replay(
        rig.DT, motor_torque=torque, joint_angle=np.zeros_like(torque)
    )
    late = np.flatnonzero(time >= 12.0)[:6001]  # one period
    work = np.trapezoid(found.motor_torque[late], found.motor_angle[late])
    lost = np.sum(found.dissipated[:, late[-1]] - found.dissipated[:, late[0]])
    assert lost == pytest.approx(work, rel=0.01)


@pytest.mark.parametrize("friction", [0.015, 0.2])
def test_ideal_follower_shares_evenly_in_a_uniform_bend(friction: float) -> None:
    cable = follower.CABLE.replace(friction=friction)
    angle = follower.handle_angle(3.0)
    shared = follower.share_efforts(cable, rig.drive(cable).ratio * angle, angle)
    assert shared.motor == pytest.approx(shared.handle, abs=1e-9)
    radius = rig.HANDLE_RADIUS
    peak = radius * cable.pretension * friction * cable.wrap
    assert np.max(np.abs(shared.motor)) == pytest.approx(peak, rel=0.01)


def test_ideal_follower_shares_unevenly_when_the_bend_is_at_one_end() -> None:
    bent = follower.CABLE.replace(conduit=(Section(0.3, 0.05), Section(1.7, np.inf)))
    angle = follower.handle_angle(3.0)
    shared = follower.share_efforts(bent, rig.drive(bent).ratio * angle, angle)
    assert shared.share > 0.6
