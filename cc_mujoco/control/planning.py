"""From what was measured late to the torque of the motor now: observer, plan, torque.

A row of `memory` is what a controller knows of one device beside the state of its
cables: the rotor as an observer has it, with the torque that the model does not
explain; motion of the joint and of the desired torque, per control step, by filters of
third order; the sense in which the motor turns; the torque through a low-pass; by how
many control steps measurements are late; energy that the joint was given beyond what is
desired; logarithms of the factors of friction.

Which torque made the rotor move as it was seen to tells how late that was: there is an
observer of the rotor for every delay that may be, and the one that errs least is
believed. D. Magill, "Optimal adaptive estimation of sampled stochastic processes", IEEE
Trans. Automatic Control 10, 1965.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cc_mujoco.compiled import FloatArray, compiled
from cc_mujoco.control import rollout
from cc_mujoco.transmission import friction as law
from cc_mujoco.transmission import stepper
from cc_mujoco.transmission.packing import segment_angles, slips, tensions

ANGLE, VELOCITY, UNEXPLAINED, LOAD = 0, 1, 2, 3
JOINT, AIM, SENSE, STARTED, FELT = 4, 7, 10, 11, 12
LATE, ENERGY, FRICTION = 13, 14, 15
"""Places in the memory; behind the last there is a number for every cable."""

ERROR, ROTOR = 3, 4
"""Place of the mean squared error of an observer of the rotor, behind angle, velocity
and unexplained torque; how many numbers it has."""

(
    PERIOD, INERTIA, DAMPING, STIFFNESS, RATIO, LOW, HIGH, SPAN, TOLERANCE, TURNING,
    NOISE, BELIEF, LEARNING, LEAST, ROTOR_0, ROTOR_1, MOTION_0, MOTION_1, MOTION_2,
    FORGETTING, LEAK, SPEND, SLOW, DAMPER,
) = range(24)  # fmt: skip
"""Places in the tuning, see `predictive`."""

_COULOMB = law.INDEX["friction"]
_RATED = law.INDEX["viscous_friction"], law.INDEX["grease_drag"]
_FARTHEST = 2.0
"""That a plan turns the motor between two knots [rad]."""
_FEELING = 0.25
"""Share of a low-pass that tells taut from slack, per step."""
_FACTORS = 0.2, 3.0
"""Bounds of the factor of friction."""
_BETTER = 0.7
"""Mean squared error of an observer, over that of the one that is believed, below which
it is believed instead."""
_ROUNDED = (2e-4) ** 2
"""Mean squared error of an angle from which nothing is concluded [rad^2]: an encoder of
14 bits rounds by half of that."""


@compiled
def smooth(
    memory: FloatArray, first: int, seen: float, a: float, b: float, c: float
) -> None:
    """Correct value, rate and acceleration (per step) by what is seen one step on."""
    memory[first] += memory[first + 1] + 0.5 * memory[first + 2]
    memory[first + 1] += memory[first + 2]
    off = seen - memory[first]
    memory[first] += a * off
    memory[first + 1] += b * off
    memory[first + 2] += 2.0 * c * off


@compiled
def _observe(
    advance: Any,
    cables: stepper.Cables,
    state: FloatArray,
    joint: float,
    applied: FloatArray,
    seen: FloatArray,
    late: int,
    unexplained: FloatArray,
    memory: FloatArray,
    rotors: FloatArray,
    tune: FloatArray,
    new: FloatArray,
    work: FloatArray,
) -> float:
    """Bring cables, rotor and motion to when `seen` was measured; the model's joint."""
    motor, angle, torque, aim = seen
    if memory[STARTED] == 0.0:
        memory[:] = 0.0
        memory[JOINT], memory[AIM], memory[LATE] = angle, aim, late
        rotors[:] = 0.0
        rotors[:, ANGLE] = motor
        memory[LOAD] = stepper.torque(cables, state, False, motor)[0]
        memory[STARTED] = 1.0
    before = memory[JOINT]
    smooth(memory, JOINT, angle, tune[MOTION_0], tune[MOTION_1], tune[MOTION_2])
    smooth(memory, AIM, aim, tune[MOTION_0], tune[MOTION_1], tune[MOTION_2])
    joint += memory[JOINT] - before
    memory[ENERGY] += (torque - memory[AIM]) * memory[JOINT + 1]
    memory[ENERGY] -= tune[LEAK] * memory[ENERGY]
    rollout.move(advance, cables, state, motor, joint, tune[PERIOD], new, work)
    made, size = stepper.torque(cables, new, True, motor)
    memory[FELT] += _FEELING * (torque - memory[FELT])
    taut = size > 0.0
    if cables.n.size == 1:
        # By the bias of its sensor a cable would be paid out without an end.
        taut = abs(made) > tune[NOISE]
    if taut or abs(memory[FELT]) > tune[NOISE]:
        # What the cables did is known better than the last bit of a sensor.
        made += tune[BELIEF] * (torque - made)
        if cables.n.size == 1 and made * cables.distal[0] > 0.0:
            made = 0.0  # noise may push, a cable cannot
        joint = rollout.joint_for(
            advance, cables, state, motor, joint, made, tune[STIFFNESS],
            0.02 * tune[NOISE], tune[PERIOD], new, work,
        )  # fmt: skip
    state[:] = new
    load = stepper.torque(cables, state, False, motor)[0]
    felt = 0.5 * (load + memory[LOAD])
    memory[LOAD] = load
    believed = int(memory[LATE])
    gain = unexplained[believed]  # the same for all, or the quickest would win
    for d in range(rotors.shape[0]):
        _turn(rotors[d], motor, applied[applied.size - 1 - d] - felt, gain, tune)
    best = int(np.argmin(rotors[:, ERROR]))
    if rotors[best, ERROR] + _ROUNDED < _BETTER * rotors[believed, ERROR]:
        believed = best
    memory[LATE] = believed
    memory[ANGLE], memory[VELOCITY], memory[UNEXPLAINED] = rotors[believed, :ERROR]
    return joint


@compiled
def _turn(
    rotor: FloatArray, seen: float, force: float, unexplained: float, tune: FloatArray
) -> None:
    """Bring an observer of the rotor one step on, to the angle seen then."""
    dt, inertia = tune[PERIOD], tune[INERTIA]
    force += rotor[UNEXPLAINED] - tune[DAMPING] * rotor[VELOCITY]
    gained = dt * force / inertia
    rotor[ANGLE] += dt * (rotor[VELOCITY] + 0.5 * gained)
    rotor[VELOCITY] += gained
    off = seen - rotor[ANGLE]
    rotor[ANGLE] += tune[ROTOR_0] * off
    rotor[VELOCITY] += tune[ROTOR_1] / dt * off
    rotor[UNEXPLAINED] += 2.0 * unexplained / dt**2 * inertia * off
    rotor[ERROR] += tune[FORGETTING] * (off * off - rotor[ERROR])


@compiled
def _learn(
    cables: stepper.Cables, state: FloatArray, memory: FloatArray, tune: FloatArray
) -> None:
    """Have friction explain what the rotor feels beyond the model, while all slips.

    The load grows with the logarithm of friction by r T mu phi of every cable, with the
    tension T at the motor; the step is that of a normalised gradient.
    """
    share = np.zeros(cables.n.size)
    size = tune[LEAST] ** 2
    for k in range(cables.n.size):
        n = cables.n[k]
        slip, tension = slips(state[k], n), tensions(state[k], n)
        sign = np.sign(slip[0])
        for j in range(n):
            if slip[j] * sign <= 0.0:
                return
        wrap = cables.prm[k, _COULOMB] * np.sum(segment_angles(cables.prm[k], n))
        share[k] = cables.proximal[k] * sign * max(tension[0], 0.0) * wrap
        size += share[k] ** 2
    unexplained = min(max(memory[UNEXPLAINED], -tune[LEAST]), tune[LEAST])
    rate = tune[LEARNING] * tune[PERIOD] * unexplained / size
    low, high = np.log(_FACTORS[0]), np.log(_FACTORS[1])
    for k in range(cables.n.size):
        factor = memory[FRICTION + k] - rate * share[k]
        memory[FRICTION + k] = min(max(factor, low), high)


@compiled
def _predict(
    advance: Any,
    cables: stepper.Cables,
    state: FloatArray,
    joint: float,
    applied: FloatArray,
    memory: FloatArray,
    tune: FloatArray,
    new: FloatArray,
    work: FloatArray,
) -> float:
    """Roll on over torques that are applied already; the model's joint then."""
    dt = tune[PERIOD]
    for torque in applied:
        load = stepper.torque(cables, state, False, memory[ANGLE])[0]
        force = torque - load - tune[DAMPING] * memory[VELOCITY] + memory[UNEXPLAINED]
        memory[VELOCITY] += dt * force / tune[INERTIA]
        memory[ANGLE] += dt * memory[VELOCITY]
        joint += memory[JOINT + 1] + 0.5 * memory[JOINT + 2]
        memory[JOINT + 1] += memory[JOINT + 2]
        memory[AIM] += memory[AIM + 1]
        rollout.move(advance, cables, state, memory[ANGLE], joint, dt, new, work)
        state[:] = new
    return joint


@compiled
def _damp(memory: FloatArray, tune: FloatArray) -> None:
    """Take from what is desired a damper that spends what the joint was given."""
    rate = memory[JOINT + 1] / tune[PERIOD]
    damper = memory[ENERGY] / (tune[SPEND] * (rate * rate + tune[SLOW] ** 2))
    damper = min(max(damper, 0.0), tune[DAMPER])
    damper /= tune[PERIOD]
    memory[AIM] -= damper * memory[JOINT + 1]
    memory[AIM + 1] -= damper * memory[JOINT + 2]


@compiled
def _drags(cables: stepper.Cables) -> bool:
    """Whether the friction of a cable depends on its speed."""
    for k in range(cables.n.size):
        for place in _RATED:
            if cables.prm[k, place] != 0.0:
                return True
    return False


@compiled
def _plan(
    advance: Any,
    cables: stepper.Cables,
    state: FloatArray,
    joint: float,
    sense: float,
    gains: FloatArray,
    memory: FloatArray,
    tune: FloatArray,
    push: FloatArray,
    rolled: FloatArray,
    new: FloatArray,
    work: FloatArray,
) -> float:
    """Plan for a motor that turns one way only: `push`, its accelerations [rad/s^2].

    Returns:
        Mean squared error of the torque over the horizon, half of it on the planned
        path and half on the wanted one, which a long way does not put off [Nm^2].
    """
    count, span = push.size, tune[SPAN]
    steps = span / tune[PERIOD]
    rise = tune[STIFFNESS] / tune[RATIO]
    cost = 0.0
    rolled[:] = state
    angle, velocity = memory[ANGLE], memory[VELOCITY]
    at = angle
    push[:] = gains[:, 0] * angle + gains[:, 1] * velocity
    drags = _drags(cables)
    last = joint
    for i in range(count):
        t = (i + 1) * steps
        where = joint + memory[JOINT + 1] * t + 0.5 * memory[JOINT + 2] * t * t
        desired = memory[AIM] + memory[AIM + 1] * t
        at = rollout.motor_for(
            advance, cables, rolled, at, sense, where, where - last, desired, rise,
            _FARTHEST, tune[TOLERANCE], span, drags, new, work,
        )  # fmt: skip
        rolled[:], last = new, where
        cost += (rollout.made(cables, new, at) - desired) ** 2
        push += gains[:, 2 + i] * at
    rolled[:] = state
    limit = max(abs(tune[LOW]), abs(tune[HIGH])) / tune[INERTIA]
    for i in range(count):
        push[i] = min(max(push[i], -limit), limit)
        angle += span * (velocity + 0.5 * span * push[i])
        velocity += span * push[i]
        t = (i + 1) * steps
        where = joint + memory[JOINT + 1] * t + 0.5 * memory[JOINT + 2] * t * t
        desired = memory[AIM] + memory[AIM + 1] * t
        rollout.move(advance, cables, rolled, angle, where, span, new, work)
        rolled[:] = new
        cost += (rollout.made(cables, new, angle) - desired) ** 2
    return 0.5 * cost / count


@compiled
def act(
    advance: Any,
    prm: FloatArray,
    n: stepper.Counts,
    proximal: FloatArray,
    distal: FloatArray,
    states: FloatArray,
    joints: FloatArray,
    memories: FloatArray,
    rotors: FloatArray,
    applied: FloatArray,
    seen: FloatArray,
    late: int,
    gains: FloatArray,
    unexplained: FloatArray,
    tune: FloatArray,
    found: FloatArray,
    work: FloatArray,
) -> None:
    """Torque of the motor of every device.

    Args:
        advance: see `rollout.pointer`.
        prm: packed parameters (rows, cables, numbers).
        n: segments of every cable.
        proximal: arms at the motor [m/rad].
        distal: arms at the joint [m/rad].
        states: of the cables when they were measured (rows, cables, numbers).
        joints: angles of the joints in the model (rows,) [rad].
        memories: (rows, `FRICTION` + cables).
        rotors: observers of the rotor (rows, delays, `ROTOR`).
        applied: torques, the oldest first (rows, delays) [Nm].
        seen: motor angle, joint angle, joint torque, desired torque (rows, 4).
        late: control steps by which that is thought to be late at first.
        gains: accelerations of a plan per angle, velocity and wanted angles of the
            motor, for every delay (delays, knots, 2 + knots).
        unexplained: gain of the unexplained torque, for every delay (delays,).
        tune: numbers of this module's places.
        found: out (rows,) [Nm].
        work: scratch.
    """
    shape = states.shape[1:]
    new, state, rolled = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    push, best = np.zeros(gains.shape[1]), np.zeros(gains.shape[1])
    dt = tune[PERIOD]
    for row in range(found.size):
        cables = stepper.Cables(prm[row], n, proximal, proximal, distal)
        joints[row] = _observe(
            advance, cables, states[row], joints[row], applied[row], seen[row], late,
            unexplained, memories[row], rotors[row], tune, new, work,
        )  # fmt: skip
        _learn(cables, states[row], memories[row], tune)
        memory = memories[row].copy()
        delay = int(memory[LATE])
        state[:] = states[row]
        joint = _predict(
            advance, cables, state, joints[row], applied[row, gains.shape[0] - delay :],
            memory, tune, new, work,
        )  # fmt: skip
        _damp(memory, tune)
        before = memory[SENSE]
        sense = 1.0 if before == 0.0 else before
        cost = _plan(
            advance, cables, state, joint, sense, gains[delay], memory, tune, best,
            rolled, new, work,
        )  # fmt: skip
        turning = 0.0 if before == 0.0 else tune[TURNING]
        if cost > turning:
            other = _plan(
                advance, cables, state, joint, -sense, gains[delay], memory, tune,
                push, rolled, new, work,
            )  # fmt: skip
            if other + turning < cost:
                sense = -sense
                best[:] = push
        memories[row, SENSE] = sense
        angle, velocity = memory[ANGLE], memory[VELOCITY]
        load = stepper.torque(cables, state, False, angle)[0]
        angle += dt * (velocity + 0.5 * dt * best[0])
        joint += memory[JOINT + 1] + 0.5 * memory[JOINT + 2]
        rollout.move(advance, cables, state, angle, joint, dt, new, work)
        load = 0.5 * (load + stepper.torque(cables, new, False, angle)[0])
        torque = load + tune[INERTIA] * best[0] + tune[DAMPING] * velocity
        torque -= memory[UNEXPLAINED]
        found[row] = min(max(torque, tune[LOW]), tune[HIGH])
