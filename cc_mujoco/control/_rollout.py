"""Rollout of cables moved at both ends, to test candidate commands."""

from __future__ import annotations

import numpy as np

from cc_mujoco.cable import _root as root
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._layout import node_stiffness, tensions
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal

_MAX_EVALUATIONS = 12


@compiled
def find_joint_angle(
    cables: stepper.Cables,
    state: FloatMatrix,
    motor: float,
    start: float,
    torque: float,
    stiffness: float,
    tolerance: float,
    dt: float,
    new: FloatMatrix,
    work: FloatArray,
) -> float:
    """Find the joint angle [rad] at which the cables make a torque, and move there.

    The torque falls as the joint turns: bracket from `start`, then regula falsi
    (`root`). The motor has its angle after the step [rad]; `start` is a guess of the
    joint [rad], `stiffness` that of all cables at the joint [N m/rad], `tolerance` that
    of the torque [N m]. `new` is the state after the step, out.
    """
    bracket, at, reach = root.UNKNOWN, 0.0, 0.0
    for _ in range(2 * _MAX_EVALUATIONS):
        stepper.move(cables, state, motor, start + at, dt, new, work)
        over = stepper.torque(cables, new, True, motor)[0] - torque
        if abs(over) <= tolerance:
            break
        bracket = root.narrowed(bracket, at, -over)
        if root.encloses(bracket):
            at = root.between(bracket)
        else:
            # At least a fifth of the step of a cable that stretches as a whole: its end
            # alone is stiffer.
            reach = max(2.0 * reach, 0.2 * abs(over) / stiffness)
            at += reach if over > 0.0 else -reach
    return start + at


@internal
def _end_tension(cables: stepper.Cables, state: FloatMatrix, distal: bool) -> float:
    """Return the tension at one end of the first cable [N].

    Where that end is slack it is below 0: the tension that would draw the slack cable
    taut as a whole. Drag that needs no tension keeps slack where it is.
    """
    n = cables.n[0]
    tension = tensions(state[0], n)
    end, way = (n, -1) if distal else (0, 1)
    if tension[end] >= 0.0:
        return float(tension[end])
    stiffness = node_stiffness(cables.prm[0], n)
    slack, compliance, lies = 0.0, 0.0, True
    for i in range(n + 1):
        j = end + way * i
        lies = lies and tension[j] < 0.0
        if lies:
            slack += tension[j] / stiffness[j]
        compliance += 1.0 / stiffness[j]
    return slack / compliance


@compiled
def joint_torque(cables: stepper.Cables, state: FloatMatrix, motor: float) -> float:
    """Return the torque of the cables at the joint [N m].

    A single cable is assumed to push in proportion to its slack, so that it is neither
    paid out nor left behind further than needed.
    """
    if cables.n.size == 1:
        return float(-cables.distal[0] * _end_tension(cables, state, True))
    return stepper.torque(cables, state, True, motor)[0]


@internal
def _torque_deficit(
    cables: stepper.Cables,
    state: FloatMatrix,
    motor: float,
    torque: float,
    slack: float,
) -> float:
    """Return the torque that the cables lack and the motor can change [N m].

    A single cable whose end at the motor is slack cannot be made to pull less. So where
    it pulls too much, that end gets a slack of `slack` [N m], and no more.
    """
    lack = torque - joint_torque(cables, state, motor)
    if cables.n.size > 1 or lack * cables.distal[0] <= 0.0:
        return lack
    held = cables.distal[0] * _end_tension(cables, state, False)
    if cables.distal[0] > 0.0:
        return float(min(lack, held + slack))
    return float(max(lack, held - slack))


@internal
def most_steps(drags: bool) -> int:
    """Return the most steps of the model that `find_motor_angle` takes."""
    return 2 * _MAX_EVALUATIONS if drags else _MAX_EVALUATIONS


@compiled
def find_motor_angle(
    cables: stepper.Cables,
    state: FloatMatrix,
    start: float,
    way: float,
    joint: float,
    turned: float,
    torque: float,
    rise: float,
    most: float,
    tolerance: float,
    slack: float,
    dt: float,
    drags: bool,
    leapt: FloatMatrix,
    new: FloatMatrix,
    work: FloatArray,
    spent: FloatArray,
) -> float:
    """Find the nearest motor angle [rad] in direction `way` that makes a torque.

    Where that direction leads away from the torque, the motor stays. Drag that needs no
    tension leaves a pull that no paying out ends; then the motor goes to the nearest
    torque that it can reach, see `_torque_deficit`. Where friction depends on speed,
    the motor gets there slowly and goes on with the joint: the torque is that of cables
    drawn at that speed, not that of a jump.

    Args:
        cables: cables of the transmission.
        state: before the step (cables, numbers).
        start: angle of the motor before [rad].
        way: direction in which it may turn, 1 or -1.
        joint: angle of the joint after the step [rad].
        turned: change of that angle in the step [rad].
        torque: to be made [N m].
        rise: torque per angle of the motor while the whole cable stretches [N m/rad].
        most: farthest that the motor turns [rad].
        tolerance: tolerance of the torque [N m].
        slack: see `_torque_deficit` [N m].
        dt: time step [s].
        drags: whether friction depends on speed.
        leapt: scratch, as `state`.
        new: out, after the step.
        work: scratch.
        spent: steps of the model (1,); counted, at most `most_steps`.
    """
    before = leapt if drags else state
    along = turned * cables.distal[0] / cables.proximal[0] if drags else 0.0
    toward = way * np.sign(rise)
    bracket, known, at, step, tried = root.UNKNOWN, False, 0.0, 0.0, 0.0
    for turn in range(_MAX_EVALUATIONS):
        tried = at
        spent[0] += 2.0 if drags else 1.0
        if drags:
            stepper.move(
                cables, state, start + way * at - along, joint - turned,
                # Time of a motor to the point where friction at speed is evaluated [s].
                0.5, leapt, work,
            )  # fmt: skip
        stepper.move(cables, before, start + way * at, joint, dt, new, work)
        lack = toward * _torque_deficit(cables, new, start, torque, slack)
        if abs(lack) <= tolerance:
            known = True
            break
        if turn == 0 and lack <= 0.0:
            break
        if lack > 0.0:
            if at >= most:
                break
            before_lack, gone = -bracket.f_low, at - bracket.low
            if turn > 0 and before_lack > lack:
                # A secant, a little further, so that the root is soon enclosed.
                step = min(1.2 * lack * gone / (before_lack - lack), 4.0 * gone)
            else:
                step = max(lack / abs(rise), 2.0 * step)
        bracket = root.narrowed(bracket, at, -lack)
        known = bracket.high < np.inf
        at = root.between(bracket) if known else min(bracket.low + step, most)
    # `new` is the state at the last angle that was tried.
    return start + way * (at if known else tried)
