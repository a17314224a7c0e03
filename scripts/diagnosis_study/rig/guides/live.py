"""A rig with guides that is driven by a torque from outside, step by step; compiled."""

from __future__ import annotations

from cc_mujoco.native import FloatArray, compiled
from rig.guides.cables import Cables, settle
from rig.guides.plant import Plant


@compiled
def advance(
    p: Plant,
    cables: Cables,
    pretension: float,
    state: FloatArray,
    ends: FloatArray,
    torque: float,
    hand: FloatArray,
    steps: int,
    dt: float,
) -> None:
    """Advance by some steps, symplectic as in `rig.guides.kernel`.

    Args:
        p: The plant; loads on the shafts, play, an axis off the middle and a
            pretension that settles are left out.
        cables: Their state, which moves on.
        pretension: Tension at rest [N].
        state: Angle and speed of the motor, of the joint; which move on.
        ends: Tensions at the motor and at the joint, of both cables [N].
        torque: Of the motor [N m].
        hand: Stiffness, damping, angle and speed that it asks for.
        steps: How many.
        dt: Of each [s].
    """
    for _ in range(steps):
        load = p.motor_radius * (ends[0] - ends[1])
        state[1] += (torque - load) / (p.rotor_inertia + p.gear_inertia) * dt
        state[0] += state[1] * dt
        given = p.joint_radius * (ends[2] - ends[3])
        hold = hand[0] * (hand[2] - state[2]) + hand[1] * (hand[3] - state[3])
        hold -= p.joint_damping * state[3]
        state[3] += (given + hold) / (p.joint_inertia + p.flywheel) * dt
        state[2] += state[3] * dt
        near, far = p.motor_radius * state[0], p.joint_radius * state[2]
        ends[0], ends[2] = settle(p, cables, 0, pretension, near, far, state[2], dt)
        ends[1], ends[3] = settle(p, cables, 1, pretension, -near, -far, state[2], dt)
