"""Rollout of cables moved at both ends, to test candidate commands."""

from typing import NamedTuple

import numpy as np

from cc_mujoco.cable import _root as root
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._layout import node_stiffness, tensions
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal

MAX_EVALUATIONS = 12  # of a torque in a search for an angle of the motor


class MotorSearch(NamedTuple):
    """Inputs, output and scratch of `find_motor_angle`, in one plan."""

    cables: stepper.Cables
    state: FloatMatrix  # before the step (cables, numbers)
    new: FloatMatrix  # out, after the step
    leapt: FloatMatrix  # scratch, as `state`
    work: FloatArray  # scratch
    spent: FloatArray  # steps of the model (1,); counted, two where friction drags
    dt: float  # [s]
    rise: float  # torque per angle of the motor while all stretches [N m/rad]
    tolerance: float  # of the torque [N m]
    slack: float  # see `_torque_deficit` [N m]
    drags: bool  # whether friction depends on speed


@internal
def _end_tension(cables: stepper.Cables, state: FloatMatrix, distal: bool) -> float:
    """Return the tension at one end of the first cable [N].

    If that end is slack, it is negative: the tension that would draw the slack cable
    taut as a whole. Slack beyond the first taut node, which drag keeps there, does not
    count.
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

    A single slack cable counts as pushing in proportion to its slack. So a plan neither
    pays it out nor leaves it slack more than needed.
    """
    if cables.n.size == 1:
        return float(-cables.distal[0] * _end_tension(cables, state, True))
    return stepper.torque(cables, state, True, motor)[0]


@internal
def _torque_deficit(search: MotorSearch, motor: float, torque: float) -> float:
    """Return the missing torque of the cables, as far as the motor can change it [N m].

    A single cable that is slack at the motor cannot be made to pull less. So if it
    pulls too much, the aim is a slack of `slack` [N m] at that end, and no more.
    """
    cables, state = search.cables, search.new
    lack = torque - joint_torque(cables, state, motor)
    if cables.n.size > 1 or lack * cables.distal[0] <= 0.0:
        return lack
    held = cables.distal[0] * _end_tension(cables, state, False)
    if cables.distal[0] > 0.0:
        return float(min(lack, held + search.slack))
    return float(max(lack, held - search.slack))


@compiled
def find_motor_angle(
    search: MotorSearch,
    start: float,
    way: float,
    joint: float,
    turned: float,
    torque: float,
) -> float:
    """Find the nearest motor angle [rad] in direction `way` that makes a torque [N m].

    If that direction leads away from the torque, the motor stays. Drag that needs no
    tension can keep a pull however much is paid out; then the motor goes to the nearest
    torque that it can reach, see `_torque_deficit`. If friction depends on speed, the
    motor first moves slowly and then with the joint, so the torque is that of cables
    drawn at that speed, not that of a jump.

    `start` is the motor angle before [rad], `way` 1 or -1, `joint` the joint angle
    after the step [rad], and `turned` the joint's motion in it [rad].
    """
    cables, drags, work = search.cables, search.drags, search.work
    before = search.leapt if drags else search.state
    along = turned * cables.distal[0] / cables.proximal[0] if drags else 0.0
    toward, most = way * np.sign(search.rise), 2.0  # rad, farthest
    bracket, known, at, step, tried = root.UNKNOWN, False, 0.0, 0.0, 0.0
    for turn in range(MAX_EVALUATIONS):
        tried = at
        search.spent[0] += 2.0 if drags else 1.0
        if drags:
            # 0.5 s: time of a motor to the point where friction at speed is evaluated.
            angle, slow = start + way * at - along, 0.5
            stepper.move(
                cables, search.state, angle, joint - turned, slow, search.leapt, work
            )
        stepper.move(
            cables, before, start + way * at, joint, search.dt, search.new, work
        )
        lack = toward * _torque_deficit(search, start, torque)
        if abs(lack) <= search.tolerance:
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
                step = max(lack / abs(search.rise), 2.0 * step)
        bracket = root.narrowed(bracket, at, -lack)
        known = bracket.high < np.inf
        at = root.between(bracket) if known else min(bracket.low + step, most)
    # `new` is the state at the last angle that was tried.
    return start + way * (at if known else tried)
