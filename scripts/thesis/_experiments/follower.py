"""Experiment 3: a motor that follows the handle, ideally and as a PI controller does.

Ends of equal displacement keep the stretch of each cable. In a conduit of uniform bend
the tightening cable is then the mirror image of the slackening one, T_a(x) = T_b(L - x)
in every state, partial motion and reversals included. So the motor gives exactly what
the handle gives, divided by the ratio: in mass motion r T0 mu L/R each. With the bend
at one end of the conduit the images differ, and so do the efforts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cc_mujoco.cable import Cable, Conduit, Section
from cc_mujoco.native import FloatArray
from thesis._outcome import Finding
from thesis._rig import LENGTH, MOTOR_RADIUS, RECONCILED_CABLE, conduit_in_loops, drive

CABLE = RECONCILED_CABLE.replace(conduit=conduit_in_loops(1))
DT = 2e-4
DURATION = 8.0
ROTOR_INERTIA = 7e-5
"""Inertia of motor and pulley, as in this package's wrist scene [kg m^2]."""
POSITION_GAIN, INTEGRAL_GAIN, VELOCITY_GAIN = 2.0, 20.0, 0.01
"""Gains of the follower [N m/rad, N m/(rad s), N m s/rad]; not printed."""


class _Shared(NamedTuple):
    """Efforts at both sides, at the handle's scale."""

    motor: FloatArray  # motor torque times the ratio (samples,) [N m]
    handle: FloatArray  # what the wearer gives (samples,) [N m]
    share: float  # the motor's part of the summed magnitudes
    apart: float  # RMS of their difference, relative to the RMS of the handle's


def handle_angle(duration: float = DURATION) -> FloatArray:
    """Return the wearer's periodic motion, half a radian, not quite a sine [rad]."""
    time = np.arange(0.0, duration, DT)
    turn = np.pi * time
    return 0.45 * (np.sin(turn) + 0.2 * np.sin(3.0 * turn)) * np.minimum(time, 1.0)


def share_efforts(cable: Cable, motor_angle: FloatArray, angle: FloatArray) -> _Shared:
    """Play both angles (samples,) [rad] through the pull-pull transmission."""
    transmission = drive(cable)
    found = transmission.replay(DT, motor_angle=motor_angle, joint_angle=angle)
    motor, handle = transmission.ratio * found.motor_torque, -found.joint_torque
    efforts = np.sum(np.abs(motor)), np.sum(np.abs(handle))
    apart = float(np.sqrt(np.mean((motor - handle) ** 2) / np.mean(handle**2)))
    return _Shared(motor, handle, float(efforts[0] / sum(efforts)), apart)


def follow(cable: Cable, angle: FloatArray) -> FloatArray:
    """Return the angle of a motor under PI position control that tracks `angle` [rad].

    Semi-implicit Euler; the motor's own damping stands for its back-EMF.
    """
    transmission = drive(cable)
    tightening, slackening = Conduit(cable), Conduit(cable)
    theta = omega = integral = 0.0
    reached = np.empty_like(angle)
    joint_radius = transmission.joint_radius
    for row, joint in enumerate(angle.tolist()):
        pull, distal = MOTOR_RADIUS * theta, joint_radius * joint
        tightening.step(DT, u_proximal=-pull, u_distal=-distal)
        slackening.step(DT, u_proximal=pull, u_distal=distal)
        load = tightening.tension_proximal - slackening.tension_proximal
        error = transmission.ratio * joint - theta
        integral += INTEGRAL_GAIN * error * DT
        torque = POSITION_GAIN * error + integral - MOTOR_RADIUS * load
        omega = (omega + DT * torque / ROTOR_INERTIA) / (
            1.0 + DT * VELOCITY_GAIN / ROTOR_INERTIA
        )
        theta += DT * omega
        reached[row] = theta
    return reached


def run() -> tuple[Finding, ...]:
    angle = handle_angle()
    ratio = drive(CABLE).ratio
    ideal = share_efforts(CABLE, ratio * angle, angle)
    bent = CABLE.replace(conduit=(Section(0.3, 0.05), Section(LENGTH - 0.3, np.inf)))
    lopsided = share_efforts(bent, ratio * angle, angle)
    reached = follow(CABLE, angle)
    real = share_efforts(CABLE, reached, angle)
    behind = float(np.degrees(np.max(np.abs(reached - ratio * angle))))
    peak = MOTOR_RADIUS * CABLE.pretension * CABLE.friction * CABLE.wrap
    return (
        Finding(
            f"motor's share {ideal.share:.1%}, profiles {ideal.apart:.1%} RMS apart",
            "agrees" if abs(ideal.share - 0.5) < 0.005 > ideal.apart else "disagrees",
            "exact by symmetry for a uniform bend: each side gives r T0 mu L/R, "
            f"{peak * 1e3:.0f} mN m at the motor",
        ),
        Finding(
            f"with all the bend in the motor's 0.3 m: {lopsided.share:.1%}, profiles "
            f"differ by {lopsided.apart:.0%}",
            "in part" if lopsided.apart > 0.02 else "agrees",
        ),
        Finding(
            f"motor's share {real.share:.0%}, profiles differ by {real.apart:.0%}; the "
            f"motor is up to {behind:.1f} deg behind",
            "agrees" if real.apart > 0.05 else "disagrees",
        ),
    )
