"""Cables between two pulleys stepped together, and the root that balances them.

    both = stepper.between((cable, cable), near=(-0.02, 0.02), far=(-0.1, 0.1))
    state = stepper.rest_states(both, motor=0.0, joint=0.0)
    angle = stepper.balance(both, state, False, joint, angle, load, dt, new, work)

The motor's pulley need not be round (`eccentric`). Torques are those that the motor
puts into the cables, and that the cables put into the joint. Arrays have a row per
cable. A cable's displacement is positive from the motor to the joint, so the arm at the
motor is negative for a cable that positive rotation draws in.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.cable import _eccentric as eccentric
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _root as root
from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._conduit import packed_parameters
from cc_mujoco.cable._layout import node_stiffness, tensions
from cc_mujoco.native import FloatArray, FloatMatrix, compiled

Counts = NDArray[np.int64]


class Cables(NamedTuple):
    """Cables between a motor's and a joint's pulley."""

    prm: FloatMatrix  # packed parameters (cables, numbers), see `_pack.pack`
    n: Counts  # number of segments (cables,)
    proximal: FloatArray  # proximal displacement per motor angle (cables,) [m/rad]
    gear: FloatArray  # radius of the motor's pulley, with that sign (cables,) [m]
    distal: FloatArray  # distal displacement per joint angle (cables,) [m/rad]


class Load(NamedTuple):
    """Torque, spring and stops on the side that is not driven by angle."""

    torque: float  # torque that the side needs at angle 0, see the module [N m]
    stiffness: float  # growth of that torque with the angle [N m/rad]
    low: float  # angle of the lower stop [rad]
    high: float  # angle of the upper stop [rad]


NO_LOAD = Load(0.0, 0.0, -math.inf, math.inf)
"""No torque, and no stops."""


def make_cables(
    cables: Sequence[Cable],
    proximal: Sequence[float],
    distal: Sequence[float],
    gear: Sequence[float] | None = None,
) -> Cables:
    """Pack cables and their arms [m]; `gear` are pulley radii if not `proximal`."""
    n = np.array([cable.segments for cable in cables])
    prm = np.zeros((n.size, kernel.parameter_size(int(n.max()))))
    for row, cable in zip(prm, cables, strict=True):
        own = packed_parameters(cable)
        row[: own.size] = own
    arms = [
        np.array(arm, dtype=np.float64) for arm in (proximal, gear or proximal, distal)
    ]
    return Cables(prm, n, *arms)


def rest_states(cables: Cables, motor: float, joint: float) -> FloatArray:
    """Return the states (cables, numbers) at rest at these angles [rad]."""
    state = np.zeros((cables.n.size, kernel.state_size(int(cables.n.max()))))
    set_rest(cables, motor, joint, state)
    return state


def scratch(cables: Cables) -> FloatArray:
    return np.empty(kernel.work_size(int(cables.n.max())))


@compiled
def set_rest(cables: Cables, motor: float, joint: float, state: FloatMatrix) -> None:
    """Set `state` (cables, numbers) to rest in pretension at these angles [rad]."""
    for k in range(cables.n.size):
        u_proximal, _ = proximal_displacement(cables, k, motor)
        prm, u_distal = cables.prm[k], cables.distal[k] * joint
        kernel.initialize(prm, cables.n[k], u_proximal, u_distal, state[k])


@compiled
def proximal_displacement(cables: Cables, k: int, motor: float) -> tuple[float, float]:
    """Return the displacement of a proximal end [m], and its lever over the arm."""
    prm, length, gear = cables.prm[k], cables.proximal[k] * motor, cables.gear[k]
    return (
        eccentric.wound_length(prm, length, gear),
        eccentric.lever_ratio(prm, length, gear),
    )


@compiled
def move(
    cables: Cables, state: FloatMatrix, motor: float, joint: float, dt: float,
    new: FloatMatrix, work: FloatArray,
) -> None:  # fmt: skip
    """Step all cables by `dt` [s] to these angles [rad]; the result is `new`."""
    for k in range(cables.n.size):
        u_proximal, _ = proximal_displacement(cables, k, motor)
        kernel.advance(
            cables.prm[k], cables.n[k], state[k], u_proximal, cables.distal[k] * joint,
            dt, new[k], work,
        )  # fmt: skip


@compiled
def torque(
    cables: Cables, state: FloatMatrix, distal: bool, motor: float
) -> tuple[float, float]:
    """Return the torque of one side, and the sum of its magnitudes by cable [N m]."""
    total, size = 0.0, 0.0
    for k in range(cables.n.size):
        tension = tensions(state[k], cables.n[k])
        if distal:
            part = cables.distal[k] * max(tension[cables.n[k]], 0.0)
        else:
            _, lever = proximal_displacement(cables, k, motor)
            part = cables.proximal[k] * lever * max(tension[0], 0.0)
        total -= part
        size += abs(part)
    return total, size


@compiled
def balance(
    cables: Cables, state: FloatMatrix, distal: bool, fixed: float, start: float,
    load: Load, dt: float, new: FloatMatrix, work: FloatArray,
) -> float:  # fmt: skip
    """Step all cables with a load on one side; return the angle of that side [rad].

    The load acts on the joint if `distal`, else on the motor. `fixed` is the angle of
    the other side, `start` that of this one before the step [rad]. The result is the
    state `new`. The torque at the motor grows with its angle and that at the joint
    falls with it, piecewise smoothly. Secants from the last angle bracket the root,
    then regula falsi (`root`) finds it. A single cable that had to push goes slack.
    """
    arm = cables.distal if distal else cables.proximal
    wanted, pull = load.torque, max(-load.torque / arm[0], 0.0)
    prm, n, single = cables.prm[0], cables.n[0], False
    if cables.n.size == 1 and load.stiffness == 0.0:
        wanted = -arm[0] * pull
        single = np.isinf(load.low) and np.isinf(load.high)
    # The load is the tension of one cable's end.
    if single and (distal or eccentric.is_round(prm)):
        if distal:
            u_proximal, _ = proximal_displacement(cables, 0, fixed)
            kernel.step(
                prm, n, state[0], kernel.POSITION, u_proximal, kernel.TENSION, pull, dt,
                new[0], work,
            )  # fmt: skip
            return float(new[0, 1] / arm[0])
        kernel.step(
            prm, n, state[0], kernel.TENSION, pull, kernel.POSITION,
            cables.distal[0] * fixed, dt, new[0], work,
        )  # fmt: skip
        return float(new[0, 0] / arm[0])
    sign = -1.0 if distal else 1.0
    stiffest = load.stiffness
    for k in range(cables.n.size):
        own = node_stiffness(cables.prm[k], cables.n[k])
        stiffest += arm[k] ** 2 * max(own[0], own[cables.n[k]])
    at, reach = min(max(start, load.low), load.high), 0.0
    before, f_before = at, 0.0
    bracket = root.UNKNOWN
    for _ in range(200):  # some five are usual
        motor = fixed if distal else at
        move(cables, state, motor, at if distal else fixed, dt, new, work)
        found, size = torque(cables, new, distal, motor)
        aim = wanted + load.stiffness * at
        error = sign * (found - aim)
        if abs(error) <= 1e-12 * (size + abs(aim)):
            break
        if at <= load.low if error > 0.0 else at >= load.high:
            break
        bracket = root.narrowed(bracket, at, error)
        if root.encloses(bracket):
            low, high = bracket.low, bracket.high
            if high - low <= 4e-16 * (abs(high) + abs(low)):
                break
            at = root.between(bracket)
        else:
            # No cable is stiffer than at its end, so the first step falls short. The
            # next are secant steps through the last two points, limited where one is
            # slack.
            ahead = 10.0 * reach
            if reach > 0.0 and (error - f_before) * (at - before) > 0.0:
                ahead = min(ahead, abs(error * (at - before) / (error - f_before)))
            reach = max(ahead, abs(error) / stiffest)
            before, f_before = at, error
            at = at - reach if error > 0.0 else at + reach
            at = min(max(at, load.low), load.high)
            if at == before:
                break
    return at
