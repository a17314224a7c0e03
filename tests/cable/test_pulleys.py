"""Transmissions with pulleys: torques and tensions at both ends."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import brentq

from cc_mujoco.cable import Cable, Section, Transmission, replay
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.errors import CableError

CABLE = Cable(friction=0.05, pretension=20.0, conduit=(Section(2.0, 0.28),))
DRIVE = Transmission.pull_pull(CABLE, motor_radius=0.02, joint_radius=0.104)
TIME = np.arange(0.0, 4.0, 2e-3)


def test_pull_pull_is_two_cables_driven_opposite_ways():
    motor, joint = 2.0 * np.sin(3.0 * TIME), 0.3 * np.sin(2.0 * TIME)
    motion = DRIVE.replay(2e-3, motor_angle=motor, joint_angle=joint)
    one = replay(CABLE, 2e-3, u_proximal=-0.02 * motor, u_distal=-0.104 * joint)
    other = replay(CABLE, 2e-3, u_proximal=0.02 * motor, u_distal=0.104 * joint)
    pull = one.tension_distal - other.tension_distal
    hold = one.tension_proximal - other.tension_proximal
    assert motion.joint_torque == pytest.approx(0.104 * pull, abs=1e-12)
    assert motion.motor_torque == pytest.approx(0.02 * hold, abs=1e-12)


def test_torque_on_the_motor_side_is_met_and_gives_back_the_angle():
    torque = 0.3 * np.sin(2.0 * TIME)
    joint = 0.2 * np.sin(1.3 * TIME)
    motion = DRIVE.replay(2e-3, motor_torque=torque, joint_angle=joint)
    wrong = np.abs(motion.motor_torque - torque) > 1e-9
    # Where the two fronts meet within one step the force may jump past the torque.
    assert np.mean(wrong) < 0.005
    assert np.max(np.abs(motion.motor_torque - torque)) < 5e-3
    again = DRIVE.replay(2e-3, motor_angle=motion.motor_angle, joint_angle=joint)
    assert again.joint_torque == pytest.approx(motion.joint_torque, abs=1e-9)


def test_torque_on_the_joint_side_is_met():
    torque = 1.0 * np.sin(2.0 * TIME)
    motion = DRIVE.replay(2e-3, motor_angle=np.zeros_like(TIME), joint_torque=torque)
    assert np.mean(np.abs(motion.joint_torque - torque) > 1e-8) < 0.005


def test_without_friction_the_pair_is_a_spring_and_a_ratio():
    smooth = CABLE.replace(friction=0.0, pretension=200.0)
    drive = Transmission.pull_pull(smooth, 0.02, 0.104)
    torque = 0.5 * np.sin(2.0 * TIME)
    motion = drive.replay(2e-3, motor_torque=torque, joint_angle=np.zeros_like(TIME))
    assert motion.joint_torque == pytest.approx(torque * drive.ratio, abs=1e-9)
    stiffness = 2.0 * 4000.0 / 2.0 * 0.02**2
    assert motion.motor_angle == pytest.approx(torque / stiffness, abs=1e-9)


def test_a_single_cable_pulls_and_never_pushes():
    drive = Transmission.single(CABLE, 0.02, 0.104)
    torque = 0.8 * np.sin(2.0 * TIME)
    motion = drive.replay(2e-3, motor_torque=torque, joint_angle=np.zeros_like(TIME))
    assert motion.motor_torque == pytest.approx(np.maximum(torque, 0.0), abs=1e-12)
    assert motion.joint_torque.min() >= 0.0
    assert motion.joint_torque.max() == pytest.approx(
        0.8 * drive.ratio * math.exp(-0.05 * CABLE.wrap), rel=1e-6
    )


def test_a_gear_divides_torque_and_multiplies_angle():
    geared = Transmission.pull_pull(CABLE, 0.02, 0.104, gear_ratio=10.0)
    joint = 0.3 * np.sin(2.0 * TIME)
    plain = DRIVE.replay(2e-3, motor_angle=np.sin(TIME), joint_angle=joint)
    motion = geared.replay(2e-3, motor_angle=10.0 * np.sin(TIME), joint_angle=joint)
    assert motion.joint_torque == pytest.approx(plain.joint_torque, abs=1e-9)
    assert motion.motor_torque == pytest.approx(plain.motor_torque / 10.0, abs=1e-10)
    assert geared.ratio == pytest.approx(10.0 * DRIVE.ratio)


def test_more_friction_and_pretension_widen_the_loop_of_a_locked_joint():
    """The trends of thesis Experiment 1 hold at a torque that overcomes friction."""
    torque = 0.6 * np.sin(np.linspace(0.0, 4.0 * np.pi, 3000))
    delivered = []
    for pretension, radius in ((20.0, 0.5), (40.0, 0.5), (40.0, 0.25)):
        cable = CABLE.replace(pretension=pretension, conduit=(Section(2.0, radius),))
        motion = Transmission.pull_pull(cable, 0.02, 0.104).replay(
            1e-3, motor_torque=torque, joint_angle=np.zeros(3000)
        )
        delivered.append(float(np.ptp(motion.joint_torque)))
    assert delivered[0] > delivered[1] > delivered[2]


def test_an_eccentric_pulley_winds_up_more_where_its_radius_is_larger():
    """Without friction, tension and torque match the closed form; energy is kept."""
    cable = CABLE.replace(
        friction=0.0, pretension=200.0, eccentricity=1e-3, eccentricity_phase=0.7
    )
    drive = Transmission.single(cable, 0.02, 0.104, gear_ratio=3.0)
    motor = 12.0 * np.sin(0.7 * TIME)
    motion = drive.replay(2e-3, motor_angle=motor, joint_angle=np.zeros_like(TIME))
    q = motor / 3.0
    wound = 0.02 * q + 1e-3 * (np.sin(q - 0.7) + np.sin(0.7))
    tension = 200.0 + 4000.0 / 2.0 * wound
    assert tension.min() > 0.0
    assert motion.tension_distal[0] == pytest.approx(tension, abs=1e-8)
    torque = tension * (0.02 + 1e-3 * np.cos(q - 0.7)) / 3.0
    assert motion.motor_torque == pytest.approx(torque, abs=1e-9)
    assert np.array_equal(motion.motor_angle, motor)
    work = np.cumsum(torque[1:] * np.diff(motor))
    stored = 0.5 * (tension[1:] ** 2 - 200.0**2) * 2.0 / 4000.0
    assert work == pytest.approx(stored, abs=2e-2 * np.ptp(stored))


def test_an_oval_pulley_winds_up_more_where_its_radius_is_larger():
    cable = CABLE.replace(
        friction=0.0, pretension=200.0, ovality=8e-4, ovality_phase=0.4
    )
    drive = Transmission.single(cable, 0.02, 0.104)
    q = 4.0 * np.sin(0.7 * TIME)
    motion = drive.replay(2e-3, motor_angle=q, joint_angle=np.zeros_like(TIME))
    wound = 0.02 * q + 4e-4 * (np.sin(2.0 * q - 0.4) + np.sin(0.4))
    tension = 200.0 + 4000.0 / 2.0 * wound
    assert motion.tension_distal[0] == pytest.approx(tension, abs=1e-8)
    torque = tension * (0.02 + 8e-4 * np.cos(2.0 * q - 0.4))
    assert motion.motor_torque == pytest.approx(torque, abs=1e-9)


def test_an_eccentric_pulley_is_checked():
    wide = CABLE.replace(eccentricity=0.03)
    with pytest.raises(ValueError, match="less than motor_radius"):
        Transmission.single(wide, 0.02, 0.104)
    together = CABLE.replace(eccentricity=0.015, ovality=0.005)
    with pytest.raises(ValueError, match=r"`ovality` is 0\.005; .*less than motor"):
        Transmission.single(together, 0.02, 0.104)


def test_cables_on_two_sides_of_an_eccentric_pulley_tighten_and_slacken_together():
    """The lever arms on both sides change by opposite amounts."""
    e, phase = 1e-3, 0.7
    side = CABLE.replace(
        friction=0.0, pretension=200.0, eccentricity=e, eccentricity_phase=phase
    )
    other = side.replace(eccentricity_phase=phase + np.pi)
    q = 4.0 * np.sin(0.7 * TIME)
    motion = Transmission((side, other), 0.02, 0.104).replay(
        2e-3, motor_angle=q, joint_angle=np.zeros_like(TIME)
    )
    off = e * (np.sin(q - phase) + np.sin(phase))
    agonist = 200.0 + 4000.0 / 2.0 * (0.02 * q + off)
    antagonist = 200.0 - 4000.0 / 2.0 * (0.02 * q - off)
    assert min(agonist.min(), antagonist.min()) > 0.0
    assert motion.tension_distal == pytest.approx(
        np.array([agonist, antagonist]), abs=1e-8
    )
    swing = e * np.cos(q - phase)
    torque = agonist * (0.02 + swing) - antagonist * (0.02 - swing)
    assert motion.motor_torque == pytest.approx(torque, abs=1e-9)


@pytest.mark.parametrize("cables", [1, 2])
@pytest.mark.parametrize("gear_ratio", [1.0, 3.0])
def test_the_torque_of_an_eccentric_pulley_turns_it_to_where_it_was(cables, gear_ratio):
    cable = CABLE.replace(
        friction=0.05, pretension=40.0, eccentricity=2e-3, eccentricity_phase=0.7
    )
    drive = Transmission((cable,) * cables, 0.02, 0.104, gear_ratio)
    motor = gear_ratio * 0.4 * (1.0 - np.cos(0.7 * TIME))
    still = np.zeros_like(TIME)
    turned = drive.replay(2e-3, motor_angle=motor, joint_angle=still)
    back = drive.replay(2e-3, motor_torque=turned.motor_torque, joint_angle=still)
    assert np.abs(back.motor_angle - motor).max() < 1e-8 * np.ptp(motor)
    assert np.abs(back.motor_torque - turned.motor_torque).max() < 1e-9


def test_what_is_prescribed_is_checked():
    zero = np.zeros(5)
    for given, said in (
        ({"motor_angle": zero}, "joint_angle or joint_torque"),
        ({"motor_torque": zero, "joint_torque": zero}, "driven by torque"),
        ({"motor_angle": zero, "joint_angle": np.zeros(4)}, "same number"),
        ({"motor_angle": np.full(5, np.nan), "joint_angle": zero}, "finite"),
    ):
        with pytest.raises(ValueError, match=said):
            DRIVE.replay(1e-3, **given)
    with pytest.raises(
        ValueError, match=r"time step must be a number in \(0, 1e\+06\] s, not 0"
    ):
        DRIVE.replay(0, motor_angle=zero, joint_angle=zero)
    with pytest.raises(
        ValueError, match=r"motor_radius must be a number in \[1e-06, 1000\] m, not -1"
    ):
        Transmission.pull_pull(CABLE, -1.0, 0.1)


@pytest.mark.parametrize("cables", [1, 2])
def test_backlash_is_lost_motion_without_torque(cables):
    cable = Cable(pretension=20.0, friction=0.02, conduit=(Section(1.0, 0.5),))
    drive = Transmission((cable,) * cables, 0.03, 0.05, backlash=0.04)
    ideal = Transmission((cable,) * cables, 0.03, 0.05)
    swing = 0.1 * np.sin(np.linspace(0.0, 12.0, 1500))
    still = np.zeros(1500)
    played = drive.replay(1e-3, motor_angle=swing, joint_angle=still)
    tight = ideal.replay(1e-3, motor_angle=swing, joint_angle=still)
    if cables == 2:
        # Between the stops nothing reaches the joint, beyond them the stop is felt.
        free = np.abs(played.joint_torque) < 1e-6
        assert 0.1 < np.mean(free) < 0.6
        assert np.abs(played.joint_torque).max() < np.abs(tight.joint_torque).max()
    else:
        # One cable always leans on the same stop: 0.02 rad slack in its way.
        assert np.all(played.joint_torque >= 0.0)
        leaning = still + np.where(np.arange(1500) > 0, 0.02, 0.0)
        late = ideal.replay(1e-3, motor_angle=swing, joint_angle=leaning)
        assert played.joint_torque[200:] == pytest.approx(
            late.joint_torque[200:], abs=1e-6
        )


def test_backlash_needs_both_angles():
    drive = Transmission.pull_pull(Cable(), 0.03, 0.05)
    loose = dataclasses.replace(drive, backlash=0.1)
    with pytest.raises(CableError, match="only from both angles"):
        loose.replay(1e-3, motor_torque=np.zeros(3), joint_angle=np.zeros(3))
    with pytest.raises(
        CableError, match=r"backlash must be a number in \[0, 1000\] rad, not -1"
    ):
        dataclasses.replace(drive, backlash=-1.0)


def test_a_single_stop_holds_the_side_that_one_cable_pulls():
    cables = stepper.make_cables((CABLE,), (-0.02,), (-0.1,))
    state = stepper.rest_states(cables, 0.0, 0.0)
    new, work = state.copy(), stepper.scratch(cables)
    stop = stepper.NO_LOAD._replace(high=0.01)
    found = stepper.balance(cables, state, True, 1.0, 0.0, stop, 1e-3, new, work)
    assert found == stop.high
    assert stepper.torque(cables, new, True, 1.0)[0] > 0.0


@pytest.mark.parametrize(
    ("distal", "stiffness"), [(False, 0.0), (True, 0.0), (True, 0.4), (True, 50.0)]
)
@pytest.mark.parametrize("torque", [0.0, 0.02, -0.5, 3.0])
def test_a_balance_is_where_the_torques_cross(
    distal: bool, stiffness: float, torque: float
) -> None:
    cables = stepper.make_cables((CABLE, CABLE), (-0.03, 0.03), (-0.05, 0.05))
    state = stepper.rest_states(cables, 0.0, 0.0)
    new, work = state.copy(), stepper.scratch(cables)
    stepper.move(cables, state, 0.2, 0.1, 1e-3, new, work)
    state[:] = new

    def error(angle: float) -> float:
        motor, joint = (0.3, angle) if distal else (angle, 0.1)
        stepper.move(cables, state, motor, joint, 1e-3, new, work)
        found, _ = stepper.torque(cables, new, distal, motor)
        return float(found - torque - stiffness * angle)

    load = stepper.NO_LOAD._replace(torque=torque, stiffness=stiffness)
    fixed, start = (0.3, 0.1) if distal else (0.1, 0.2)
    found = stepper.balance(cables, state, distal, fixed, start, load, 1e-3, new, work)
    crossing = brentq(error, -9.0, 9.0, xtol=1e-15, rtol=1e-14)
    assert found == pytest.approx(crossing, abs=1e-9)
