"""Statement of what a set of instruments can show and what it cannot.

Effects that are excluded one by one are in `library`; this states the whole, for the
head of that list in the report.
"""

from __future__ import annotations

from cc_mujoco.datasets._instruments import Instruments

_ENDS_HELD = (
    "Forces at both ends, ends held while drum or conduit moves. These data can show "
    "friction by load, speed, direction and rest, its differences between the ends, "
    "and stretch and play where the motion reverses. They cannot show pulleys, their "
    "ratio and eccentricity, or anything at a motor or a joint. Pretension is known "
    "only as the mean tension."
)
_ANGLES_ONLY = (
    "Angles only, with a declared load. These data can show play, lag, the stretch as "
    "a whole, and friction as far as the joint stays behind the motor. They cannot "
    "show where it stretches: soft ends look like less pretension or a softer cable. "
    "Nor can they show the torque of a motor, or a force more exactly than the load is "
    "declared."
)
_MOTION_ONLY = (
    "Angles only, without a torque or a known load. These data can show a dead zone, a "
    "lag, and the ratio of the drive. They cannot show what makes them (play, stretch "
    "against friction, drag, a late sensor), nor any friction, stiffness or pretension."
)
_NO_MOTOR_ANGLE = (
    "Torques at both ends without the motor's angle. While the whole cable slides, "
    "these data can show its loss by direction and load, a drag, and a break-away loss "
    "after reversals. They cannot show stretch, play, slack or pretension, where the "
    "loss arises, or anything that depends on the motor's angle. The loss of motor and "
    "gear is part of it where the torque follows from a current or a command."
)
_ARM_BY_PAIRS = (
    "The moment arm at the joint follows from angle pairs. These data cannot tell an "
    "error of the pairs from an eccentric pulley or a wrap that grows with the angle."
)
_MOTOR = {
    None: "The motor's torque is not measured. The joint's torque can show friction, "
    "stretch and play. It cannot show what acts between motor and cable (cogging, "
    "inertia, seals at that end), or tell friction in the cable from a difference of "
    "pretension.",
    "motor current": "The motor's torque follows from its current. Friction and drag "
    "of motor and gear are fitted, so these data cannot show seals, or a part of the "
    "drag in the conduit of the same size.",
    "load cells": "At the motor the tension is measured. These data cannot show "
    "cogging or inertia of the motor.",
}
"""Statement by the instrument of the motor's torque."""
_JOINT = {
    None: "The joint's torque is not measured. The motor's torque can show friction, "
    "stretch and play. It cannot show what acts at the joint (gravity, springs, "
    "inertia, seals at that end), or on which side of the cable a loss occurs.",
    "known load": "The joint's torque follows from its motion and the declared load. "
    "These data cannot tell a load that differs from its declaration from a spring or "
    "an inertia that is missing.",
    "load cells": "At the joint the tension is measured. These data cannot show "
    "gravity, springs or inertia at the joint.",
}
"""Statement by the instrument of the joint's torque."""


def describe_mode(
    instruments: Instruments,
    ends_held: bool = False,
    arm_by_pairs: bool = False,
    motor_angle: bool = True,
) -> str:
    """Return what the instruments can and cannot show; "" of two torque sensors.

    Args:
        instruments: of both torques.
        ends_held: whether the ends are held, see `Trial.ends_held`.
        arm_by_pairs: whether the arm at the joint is that of `[rig] angle_pairs`.
        motor_angle: whether the motor's angle is measured.
    """
    if not motor_angle:
        return _NO_MOTOR_ANGLE
    if ends_held:
        return _ENDS_HELD
    if not instruments.rows:
        return _MOTION_ONLY
    found = [_MOTOR.get(instruments.motor, ""), _JOINT.get(instruments.joint, "")]
    if instruments == Instruments(None, "known load"):
        found = [_ANGLES_ONLY]
    if arm_by_pairs:
        found.append(_ARM_BY_PAIRS)
    return " ".join(each for each in found if each)
