"""The cables of a device stepped together, compiled: motor and joint move them all.

Arrays of one device have a row per cable; `n` are the segments of each, `near` and
`far` the arms of its ends [m/rad]. Torques are those that the motor puts into the
cables, and that the cables put into the joint.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.compiled import FloatArray, compiled
from cc_mujoco.transmission import kernel

Counts = NDArray[np.int64]

STEPS = 100
"""Most evaluations of a balance; some ten are usual."""

TOLERANCE = 1e-9
"""Of a balance of torques, relative to what the tensions make."""


@compiled
def side_torque(
    n: Counts, arm: FloatArray, state: FloatArray, at_far: bool
) -> tuple[float, float]:
    """Torque of one side, and the sum of the sizes of its parts [Nm]."""
    total, size = 0.0, 0.0
    for k in range(n.size):
        node = kernel.STATE_HEADER + (n[k] if at_far else 0)
        part = arm[k] * max(state[k, node], 0.0)
        total -= part
        size += abs(part)
    return total, size


@compiled
def move(
    prm: FloatArray,
    n: Counts,
    near: FloatArray,
    far: FloatArray,
    state: FloatArray,
    motor: float,
    joint: float,
    dt: float,
    new: FloatArray,
    work: FloatArray,
) -> None:
    """Step all cables with both angles given [rad]."""
    for k in range(n.size):
        kernel.advance(
            prm[k], n[k], state[k], near[k] * motor, far[k] * joint, dt, new[k], work
        )


@compiled
def balance(
    prm: FloatArray,
    n: Counts,
    near: FloatArray,
    far: FloatArray,
    state: FloatArray,
    at_far: bool,
    fixed: float,
    start: float,
    wanted: float,
    dt: float,
    new: FloatArray,
    work: FloatArray,
) -> float:
    """Step all cables with the angle of one side given and the torque of the other.

    One cable takes a tension directly. Of several, the torque at the motor grows with
    its angle and that at the joint falls with it, piecewise linearly: bracket from
    where the side was, then regula falsi with the Illinois rule.

    Args:
        prm: packed parameters.
        n: segments.
        near: arms of the proximal ends.
        far: arms of the distal ends.
        state: before the step.
        at_far: whether the joint is the side driven by torque.
        fixed: angle of the other side [rad].
        start: angle of this side before [rad].
        wanted: torque of this side [Nm].
        dt: time step [s].
        new: out, after the step.
        work: scratch.

    Returns:
        Angle of this side [rad].
    """
    arm = far if at_far else near
    if n.size == 1:
        pull = max(-wanted / arm[0], 0.0)
        if at_far:
            kernel.step(
                prm[0], n[0], state[0], kernel.POSITION, near[0] * fixed,
                kernel.TENSION, pull, dt, new[0], work,
            )  # fmt: skip
            return float(new[0, 1] / arm[0])
        kernel.step(
            prm[0], n[0], state[0], kernel.TENSION, pull,
            kernel.POSITION, far[0] * fixed, dt, new[0], work,
        )  # fmt: skip
        return float(new[0, 0] / arm[0])
    sign = -1.0 if at_far else 1.0
    stiffest = 0.0
    for k in range(n.size):
        ends = kernel.node_stiffness(prm[k], n[k])
        stiffest += arm[k] ** 2 * ends[0]
    at, low, high, reach = start, start, start, 0.0
    f_low, f_high = 0.0, 0.0
    has_low, has_high = False, False
    side = 0
    for _ in range(STEPS):
        if at_far:
            move(prm, n, near, far, state, fixed, at, dt, new, work)
        else:
            move(prm, n, near, far, state, at, fixed, dt, new, work)
        torque, size = side_torque(n, arm, new, at_far)
        error = sign * (torque - wanted)
        if abs(error) <= TOLERANCE * (size + abs(wanted)):
            break
        if error > 0.0:
            high, f_high, has_high = at, error, True
            if side > 0:
                f_low *= 0.5
            side = 1
        else:
            low, f_low, has_low = at, error, True
            if side < 0:
                f_high *= 0.5
            side = -1
        if has_low and has_high:
            if high - low <= 4e-16 * (abs(high) + abs(low)):
                break
            at = low - f_low * (high - low) / (f_high - f_low)
            if at <= low or at >= high:
                at = 0.5 * (low + high)
        else:
            # No cable is stiffer than at its end, so the first step falls short.
            reach = max(3.0 * reach, abs(error) / stiffest)
            at = at - reach if error > 0.0 else at + reach
            side = 0
    return at
