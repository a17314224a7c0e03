"""Torque of the motor now from delayed measurements: observer, plan, torque.

A row of `memory` is what a controller knows of one device in addition to the state of
its cables: the rotor as estimated by an observer, with the torque that the model does
not explain; motion of the joint and of the desired torque, per control step, by filters
of third order; the direction in which the motor turns; the low-passed torque; the delay
of the measurements in control steps; the energy of the joint beyond the desired one;
bias of the torque sensor; torque of the motor and its last command; whether the guard
makes the motor follow the joint; by how much the torque sensor has shifted the joint of
a single cable's model so that it pulls, now and when it last pulled no more than
desired; logarithms of the factors of friction.

A motor whose torque lags follows its command by lag dtau/dt + tau = command. Observers
and prediction work on the mean torque of every step; the plan is that of a motor
without lag, and its torque is led by the command, see `_command_for_torque`. Where the
rate of the command is too limited for that, the plan minimises a cost of commands over
increments within the limit: D. Bertsekas, "Projected Newton methods for optimization
problems with simple constraints", SIAM J. Control and Optimization 20, 1982.

Which torque made the rotor move as it was seen to tells how late that was: there is an
observer of the rotor for every delay that may be, and the one that errs least is
believed. D. Magill, "Optimal adaptive estimation of sampled stochastic processes", IEEE
Trans. Automatic Control 10, 1965.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cc_mujoco._utils.compilation import FloatArray, compiled, internal
from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._layout import segment_angles, slips, tensions
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _rollout as rollout
from cc_mujoco.control._planner_parameters import (
    BELIEF,
    DAMPER,
    DAMPING,
    FORGETTING,
    HIGH,
    INERTIA,
    LAG,
    LATE_FIRST,
    LEAK,
    LEARNING,
    LOW,
    MIN_FRICTION_TORQUE,
    MOTION_0,
    MOTION_1,
    MOTION_2,
    NOISE,
    PERIOD,
    RATE,
    RATIO,
    ROTOR_0,
    ROTOR_1,
    SAFE,
    SLOW,
    SPAN,
    SPEND,
    STIFFNESS,
    TOLERANCE,
    TURNING,
    YIELDING,
    ZEROING,
)

ANGLE, VELOCITY, DISTURBANCE, LOAD = 0, 1, 2, 3
JOINT, DESIRED_TORQUE, DIRECTION, STARTED, FILTERED_TORQUE = 4, 7, 10, 11, 12
BELIEVED_DELAY, ENERGY, BIAS, MOTOR_TORQUE, COMMAND = 13, 14, 15, 16, 17
RELEASED, JOINT_SHIFT, TAUT_SHIFT, FRICTION = 18, 19, 20, 21
"""Places in the memory; behind the last there is a number for every cable."""

OBSERVER_ERROR, OBSERVER_SIZE = 3, 4
"""Place of the mean squared error of an observer of the rotor, behind angle, velocity
and unexplained torque; how many numbers it has."""


_RATE_TERMS = law.INDEX["viscous_friction"], law.INDEX["grease_drag"]
_MAX_KNOT_STEP = 2.0
"""Largest turn of the motor between two knots of a plan [rad]."""
_TORQUE_SMOOTHING = 0.25
"""Share of a low-pass that tells taut from slack, per step."""
_FRICTION_FACTOR_BOUNDS = 0.2, 3.0
"""Bounds of the factor of friction."""
_OBSERVER_SWITCH_RATIO = 0.7
"""Mean squared error of an observer, over that of the one that is believed, below which
it is believed instead."""
_ROUNDING_ERROR = (2e-4) ** 2
"""Mean squared error of an angle from which nothing is concluded [rad^2]: an encoder of
14 bits rounds by half of that."""
_MAX_FRICTION_ERROR = 0.3
"""Relative error of friction for which a bias may be taken."""
_MAX_BIAS_RATIO = 2.0
"""Greatest bias of the torque sensor, over the torque that is one for sure."""
_COULOMB = law.INDEX["friction"]
_NEWTON_STEPS, _HALVINGS, _LINEARIZATIONS = 12, 6, 2
"""At most, of a plan of commands, within one of its steps, and around which paths the
load is linear."""
_COST_TOLERANCE = 1e-6
"""Relative change of the cost at which a plan of commands is found."""
WORK_ROWS = 9
"""Rows of numbers for each knot, that a plan of commands needs."""


class PlannerMemory(NamedTuple):
    """Memory of a controller for one device beside its cables; see this module.

    Attributes:
        memory: (`FRICTION` + cables,).
        rotors: observers of the rotor (delays, `OBSERVER_SIZE`).
        applied: mean torques of the motor in past steps, the oldest first; the last is
            the command of the step that has just passed (delays,) [N m].
    """

    memory: FloatArray
    rotors: FloatArray
    applied: FloatArray


class Tables(NamedTuple):
    """Tables that a controller is given.

    Attributes:
        gains: accelerations of a plan per angle, velocity and wanted angles of the
            motor, for every delay (delays, knots, 2 + knots).
        unexplained: gain of the unexplained torque, for every delay (delays,).
        weight: of a squared acceleration to a squared angle in the cost of a plan, for
            every delay (delays,) [s^4].
        tune: see `Tuning.packed`.
    """

    gains: FloatArray
    unexplained: FloatArray
    weight: FloatArray
    tune: FloatArray


class PlannerWorkspace(NamedTuple):
    """Room to compute in; nothing is kept in it.

    Attributes:
        new: states of the cables (cables, numbers).
        state: states of the cables (cables, numbers).
        rolled: states of the cables (cables, numbers).
        leapt: states of the cables (cables, numbers).
        push: accelerations of a plan, then its first command (knots + 1,).
        best: accelerations of the best plan, then its first command (knots + 1,).
        memory: (`FRICTION` + cables,).
        wanted: angles of the motor at the knots of a plan (knots,).
        path: angles of the motor at the knots to which a plan leads (knots,).
        load: torques of the cables at the motor there (knots,).
        holding: torques of the cables at the motor on the wanted path (knots,).
        matrix: of a plan of commands (knots, knots).
        vectors: of a plan of commands (`WORK_ROWS`, knots).
        work: `cable._layout.work_size`.
    """

    new: FloatArray
    state: FloatArray
    rolled: FloatArray
    leapt: FloatArray
    push: FloatArray
    best: FloatArray
    memory: FloatArray
    wanted: FloatArray
    path: FloatArray
    load: FloatArray
    holding: FloatArray
    matrix: FloatArray
    vectors: FloatArray
    work: FloatArray


@internal
def _replace_by_mean_torque(
    memory: FloatArray, applied: FloatArray, tune: FloatArray
) -> None:
    """Replace the newest command in `applied` by the mean torque that it led to."""
    command, lag, dt = applied[applied.size - 1], tune[LAG], tune[PERIOD]
    behind = memory[MOTOR_TORQUE] - command
    memory[COMMAND] = memory[MOTOR_TORQUE] = command
    if lag > 0.0:
        passed = -np.expm1(-dt / lag)
        applied[applied.size - 1] += behind * (passed * lag / dt)
        memory[MOTOR_TORQUE] += behind * (1.0 - passed)


@compiled
def smooth(
    memory: FloatArray, first: int, seen: float, a: float, b: float, c: float
) -> None:
    """Correct value, rate and acceleration (per step) by the reading one step later."""
    memory[first] += memory[first + 1] + 0.5 * memory[first + 2]
    memory[first + 1] += memory[first + 2]
    off = seen - memory[first]
    memory[first] += a * off
    memory[first + 1] += b * off
    memory[first + 2] += 2.0 * c * off


@internal
def _copy_states(source: FloatArray, target: FloatArray) -> None:
    """Copy states of cables (cables, numbers) into others."""
    for k in range(source.shape[0]):
        for i in range(source.shape[1]):
            target[k, i] = source[k, i]


@internal
def _reset(
    cables: stepper.Cables,
    state: FloatArray,
    device: PlannerMemory,
    seen: FloatArray,
    late: float,
) -> None:
    """Reset the memory, with motor and joint at rest at their measured angles."""
    memory, rotors = device.memory, device.rotors
    memory[:] = 0.0
    memory[JOINT], memory[DESIRED_TORQUE], memory[BELIEVED_DELAY] = (
        seen[1],
        seen[3],
        late,
    )
    rotors[:] = 0.0
    rotors[:, ANGLE] = seen[0]
    memory[LOAD] = stepper.torque(cables, state, False, seen[0])[0]
    memory[STARTED] = 1.0


@compiled
def _observe(
    cables: stepper.Cables,
    state: FloatArray,
    joint: float,
    device: PlannerMemory,
    seen: FloatArray,
    tables: Tables,
    scratch: PlannerWorkspace,
) -> float:
    """Bring cables, rotor and motion to when `seen` was measured; the model's joint."""
    memory, rotors, applied = device.memory, device.rotors, device.applied
    tune, new = tables.tune, scratch.new
    motor, angle, aim = seen[0], seen[1], seen[3]
    torque = seen[2] - memory[BIAS]
    if memory[STARTED] == 0.0:
        _reset(cables, state, device, seen, tune[LATE_FIRST])
    before = memory[JOINT]
    smooth(memory, JOINT, angle, tune[MOTION_0], tune[MOTION_1], tune[MOTION_2])
    smooth(memory, DESIRED_TORQUE, aim, tune[MOTION_0], tune[MOTION_1], tune[MOTION_2])
    joint += memory[JOINT] - before
    memory[ENERGY] += (torque - memory[DESIRED_TORQUE]) * memory[JOINT + 1]
    memory[ENERGY] -= tune[LEAK] * memory[ENERGY]
    stepper.move(cables, state, motor, joint, tune[PERIOD], new, scratch.work)
    made, size = stepper.torque(cables, new, True, motor)
    memory[FILTERED_TORQUE] += _TORQUE_SMOOTHING * (torque - memory[FILTERED_TORQUE])
    taut = size > 0.0
    if cables.n.size == 1:
        # By the bias of its sensor a cable would be paid out without an end.
        taut = abs(made) > tune[NOISE]
    if taut or abs(memory[FILTERED_TORQUE]) > tune[NOISE]:
        # What the cables did is known better than the last bit of a sensor.
        made += tune[BELIEF] * (torque - made)
        if cables.n.size == 1 and made * cables.distal[0] > 0.0:
            made = 0.0  # noise may push, a cable cannot
        to = rollout.find_joint_angle(
            cables, state, motor, joint, made, tune[STIFFNESS], 0.02 * tune[NOISE],
            tune[PERIOD], new, scratch.work,
        )  # fmt: skip
        if cables.n.size == 1:
            side = np.sign(cables.distal[0])
            shift = _shift(
                memory, side * (to - joint), -side * torque, -side, scratch, tune
            )
            if shift < side * (to - joint):
                to = joint + side * shift
                stepper.move(cables, state, motor, to, tune[PERIOD], new, scratch.work)
        joint = to
    _copy_states(new, state)
    load = stepper.torque(cables, state, False, motor)[0]
    mean_load = 0.5 * (load + memory[LOAD])
    memory[LOAD] = load
    believed = int(memory[BELIEVED_DELAY])
    gain = tables.unexplained[believed]  # the same for all, or the quickest would win
    best = 0
    for d in range(rotors.shape[0]):
        _update_observer(
            rotors[d], motor, applied[applied.size - 1 - d] - mean_load, gain, tune
        )
        if rotors[d, OBSERVER_ERROR] < rotors[best, OBSERVER_ERROR]:
            best = d
    if (
        rotors[best, OBSERVER_ERROR] + _ROUNDING_ERROR
        < _OBSERVER_SWITCH_RATIO * rotors[believed, OBSERVER_ERROR]
    ):
        believed = best
    memory[BELIEVED_DELAY] = believed
    memory[ANGLE], memory[VELOCITY] = (
        rotors[believed, ANGLE],
        rotors[believed, VELOCITY],
    )
    memory[DISTURBANCE] = rotors[believed, DISTURBANCE]
    return joint


@internal
def _shift(
    memory: FloatArray,
    wanted: float,
    pull: float,
    way: float,
    scratch: PlannerWorkspace,
    tune: FloatArray,
) -> float:
    """Return by how much the joint of a single cable's model is shifted [rad].

    Drag keeps up a pull that no paying out ends. A model without that drag would be
    shifted for as long, and its motor would pay out cable without an end. So while the
    cable pulls more than desired, the shift is no more than what that pull stretches
    it by, and what the motor takes up in half of the horizon.

    Args:
        memory: of the device.
        wanted: by the torque sensor, above 0 where the cable is to pull more [rad].
        pull: measured torque in the direction in which the cable pulls [N m].
        way: sign of such a torque.
        scratch: of the plan.
        tune: see `Tuning.packed`.
    """
    shift = memory[JOINT_SHIFT] + wanted
    if pull > max(way * memory[DESIRED_TORQUE], 0.0) + tune[NOISE]:
        half = 0.5 * tune[SPAN] * scratch.path.size
        quick = max(abs(tune[LOW]), abs(tune[HIGH])) / tune[INERTIA]
        reach = 0.25 * quick * half * half / abs(tune[RATIO])
        most = memory[TAUT_SHIFT] + pull / tune[STIFFNESS] + reach
        shift = min(shift, max(most, memory[JOINT_SHIFT]))
    elif pull > tune[NOISE]:
        memory[TAUT_SHIFT] = shift
    wanted = shift - memory[JOINT_SHIFT]
    memory[JOINT_SHIFT] = shift
    return float(wanted)


@compiled
def _update_observer(
    rotor: FloatArray, seen: float, force: float, unexplained: float, tune: FloatArray
) -> None:
    """Advance an observer of the rotor by one step, with the measured angle."""
    dt, inertia = tune[PERIOD], tune[INERTIA]
    force += rotor[DISTURBANCE] - tune[DAMPING] * rotor[VELOCITY]
    gained = dt * force / inertia
    rotor[ANGLE] += dt * (rotor[VELOCITY] + 0.5 * gained)
    rotor[VELOCITY] += gained
    off = seen - rotor[ANGLE]
    rotor[ANGLE] += tune[ROTOR_0] * off
    rotor[VELOCITY] += tune[ROTOR_1] / dt * off
    rotor[DISTURBANCE] += 2.0 * unexplained / dt**2 * inertia * off
    rotor[OBSERVER_ERROR] += tune[FORGETTING] * (off * off - rotor[OBSERVER_ERROR])


@compiled
def _learn(
    cables: stepper.Cables, state: FloatArray, memory: FloatArray, tune: FloatArray
) -> None:
    """Adapt friction and bias to the torque on the rotor that the model lacks.

    While all slips, the load grows with the logarithm of friction by r T mu phi of
    every cable, with the tension T at the motor, whose sign is that of the slip; and by
    what the torque sensor has too much, over the ratio, whatever the slip. Friction
    takes the step of a normalised gradient, the bias its share by the two variances.
    """
    sensitivity = 0.0
    for k in range(cables.n.size):
        n = cables.n[k]
        slip = slips(state[k], n)
        sign = np.sign(slip[0])
        for j in range(n):
            if slip[j] * sign <= 0.0:
                return
        sensitivity += _load_slope(cables, k, state[k], sign) ** 2
    unexplained = min(
        max(memory[DISTURBANCE], -tune[MIN_FRICTION_TORQUE]), tune[MIN_FRICTION_TORQUE]
    )
    biased = (tune[NOISE] / tune[RATIO]) ** 2
    share = biased / (
        biased + (_MAX_FRICTION_ERROR * _MAX_FRICTION_ERROR) * sensitivity
    )
    step = tune[ZEROING] * tune[PERIOD] * share * unexplained * tune[RATIO]
    most = _MAX_BIAS_RATIO * tune[NOISE]
    memory[BIAS] = min(max(memory[BIAS] + step, -most), most)
    rate = (
        tune[LEARNING]
        * tune[PERIOD]
        * unexplained
        / (tune[MIN_FRICTION_TORQUE] ** 2 + sensitivity)
    )
    low, high = np.log(_FRICTION_FACTOR_BOUNDS[0]), np.log(_FRICTION_FACTOR_BOUNDS[1])
    for k in range(cables.n.size):
        sign = np.sign(slips(state[k], cables.n[k])[0])
        factor = memory[FRICTION + k] - rate * _load_slope(cables, k, state[k], sign)
        memory[FRICTION + k] = min(max(factor, low), high)


@internal
def _load_slope(
    cables: stepper.Cables, k: int, state: FloatArray, sign: float
) -> float:
    """Return the derivative of the motor's load by the logarithm of friction [N m]."""
    n, wrap = cables.n[k], 0.0
    angles = segment_angles(cables.prm[k], n)
    for j in range(n):
        wrap += angles[j]
    pull = cables.proximal[k] * sign * max(tensions(state, n)[0], 0.0)
    return float(pull * (cables.prm[k, _COULOMB] * wrap))


@compiled
def _predict(
    cables: stepper.Cables,
    joint: float,
    applied: FloatArray,
    tune: FloatArray,
    scratch: PlannerWorkspace,
) -> float:
    """Advance `room` over the applied torques; return the model's joint angle."""
    dt, memory, state = tune[PERIOD], scratch.memory, scratch.state
    for torque in applied:
        load = stepper.torque(cables, state, False, memory[ANGLE])[0]
        force = torque - load - tune[DAMPING] * memory[VELOCITY] + memory[DISTURBANCE]
        memory[VELOCITY] += dt * force / tune[INERTIA]
        memory[ANGLE] += dt * memory[VELOCITY]
        joint += memory[JOINT + 1] + 0.5 * memory[JOINT + 2]
        memory[JOINT + 1] += memory[JOINT + 2]
        memory[DESIRED_TORQUE] += memory[DESIRED_TORQUE + 1]
        stepper.move(cables, state, memory[ANGLE], joint, dt, scratch.new, scratch.work)
        _copy_states(scratch.new, state)
    return joint


@compiled
def _anticipate_joint(memory: FloatArray, tune: FloatArray) -> None:
    """Predict the motion of the joint under the torque that it lacks.

    A joint that too little torque slows down would else seem to turn.
    """
    lacking = memory[DESIRED_TORQUE] - memory[FILTERED_TORQUE]
    sure = max(abs(lacking) - tune[NOISE], 0.0) * np.sign(lacking)
    memory[JOINT + 1] += tune[YIELDING] * sure * tune[PERIOD]


@compiled
def _damp_desired(memory: FloatArray, tune: FloatArray) -> None:
    """Subtract a damping torque that dissipates the surplus energy of the joint."""
    rate = memory[JOINT + 1] / tune[PERIOD]
    damper = memory[ENERGY] / (tune[SPEND] * (rate * rate + tune[SLOW] ** 2))
    damper = min(max(damper, 0.0), tune[DAMPER])
    damper /= tune[PERIOD]
    memory[DESIRED_TORQUE] -= damper * memory[JOINT + 1]
    memory[DESIRED_TORQUE + 1] -= damper * memory[JOINT + 2]


@compiled
def _has_rate_friction(cables: stepper.Cables) -> bool:
    """Return whether the friction of a cable depends on its speed."""
    for k in range(cables.n.size):
        for place in _RATE_TERMS:
            if cables.prm[k, place] != 0.0:
                return True
    return False


@compiled
def _plan(
    cables: stepper.Cables,
    joint: float,
    sense: float,
    gains: FloatArray,
    weight: float,
    tune: FloatArray,
    push: FloatArray,
    scratch: PlannerWorkspace,
) -> float:
    """Plan for a motor that turns one way only: `push`, its accelerations [rad/s^2].

    Behind them is the first command, where the rate of the command is limited too much.

    Returns:
        Mean squared error of the torque over the horizon, half of it on the planned
        path and half on the wanted one, which a long way does not put off [N m^2].
    """
    memory, rolled, new = scratch.memory, scratch.rolled, scratch.new
    count, span = scratch.path.size, tune[SPAN]
    steps = span / tune[PERIOD]
    rise = tune[STIFFNESS] / tune[RATIO]
    cost = 0.0
    _copy_states(scratch.state, rolled)
    angle, velocity = memory[ANGLE], memory[VELOCITY]
    at = angle
    for i in range(count):
        push[i] = gains[i, 0] * angle + gains[i, 1] * velocity
    drags = _has_rate_friction(cables)
    last = joint
    for i in range(count):
        t = (i + 1) * steps
        where = joint + memory[JOINT + 1] * t + 0.5 * memory[JOINT + 2] * t * t
        desired = memory[DESIRED_TORQUE] + memory[DESIRED_TORQUE + 1] * t
        at = rollout.find_motor_angle(
            cables,
            rolled,
            at,
            sense,
            where,
            where - last,
            desired,
            rise,
            _MAX_KNOT_STEP,
            tune[TOLERANCE],
            span,
            drags,
            scratch.leapt,
            new,
            scratch.work,
        )
        _copy_states(new, rolled)
        last = where
        cost += (rollout.joint_torque(cables, new, at) - desired) ** 2
        for j in range(count):
            push[j] += gains[j, 2 + i] * at
        scratch.wanted[i] = at
        scratch.holding[i] = stepper.torque(cables, new, False, at)[0]
    found = _simulate_plan(cables, joint, cost, tune, push, scratch)
    push[count] = np.nan
    if tune[RATE] < np.inf:
        load = stepper.torque(cables, scratch.state, False, angle)[0]
        if not _is_within(push, load, tune, scratch):
            for _ in range(_LINEARIZATIONS):
                _optimise_commands(push, load, weight, tune, scratch)
                found = _simulate_plan(cables, joint, cost, tune, push, scratch)
    return 0.5 * found / count


@internal
def _simulate_plan(
    cables: stepper.Cables,
    joint: float,
    cost: float,
    tune: FloatArray,
    push: FloatArray,
    scratch: PlannerWorkspace,
) -> float:
    """Return a cost and the squared errors of the torque of a plan [N m^2].

    `room` gets the path of the motor and the load on it.
    """
    memory, rolled, new = scratch.memory, scratch.rolled, scratch.new
    count, span = scratch.path.size, tune[SPAN]
    steps = span / tune[PERIOD]
    angle, velocity = memory[ANGLE], memory[VELOCITY]
    _copy_states(scratch.state, rolled)
    limit = max(abs(tune[LOW]), abs(tune[HIGH])) / tune[INERTIA]
    for i in range(count):
        push[i] = min(max(push[i], -limit), limit)
        angle += span * (velocity + 0.5 * span * push[i])
        velocity += span * push[i]
        t = (i + 1) * steps
        where = joint + memory[JOINT + 1] * t + 0.5 * memory[JOINT + 2] * t * t
        desired = memory[DESIRED_TORQUE] + memory[DESIRED_TORQUE + 1] * t
        stepper.move(cables, rolled, angle, where, span, new, scratch.work)
        _copy_states(new, rolled)
        cost += (rollout.joint_torque(cables, new, angle) - desired) ** 2
        scratch.path[i] = angle
        scratch.load[i] = stepper.torque(cables, new, False, angle)[0]
    return cost


@internal
def _motor_response(
    angle: float,
    velocity: float,
    torque: float,
    command: float,
    load: float,
    tune: FloatArray,
) -> tuple[float, float, float]:
    """Return angle, velocity and torque of the motor a knot on.

    Against it act `load` and the stretch of all of the cables by its mean angle.
    """
    span, lag = tune[SPAN], tune[LAG]
    spring = tune[STIFFNESS] / tune[RATIO] ** 2
    mean = command
    if lag > 0.0:
        passed = -np.expm1(-span / lag)
        behind = torque - command
        mean += behind * (passed * lag / span)
        command += behind * (1.0 - passed)
    load += spring * (angle + 0.5 * span * velocity) + tune[DAMPING] * velocity
    gained = (mean - load) / (tune[INERTIA] + 0.25 * spring * span * span)
    angle += span * (velocity + 0.5 * span * gained)
    return angle, velocity + span * gained, command


@compiled
def _optimise_commands(
    push: FloatArray,
    load: float,
    weight: float,
    tune: FloatArray,
    scratch: PlannerWorkspace,
) -> None:
    """Replace a plan by the best of a motor that lags, or whose command is limited.

    Commands are constant between two knots. They minimise sum (angle - wanted)^2 +
    weight ((command - holding) / inertia)^2, where `holding` is the torque that holds
    the motor on the wanted path; their increments are within the limit of the rate. The
    load is linear around that on the path of `push`: its slope is that of cables of
    which all stretches, since the steep slope of their ends does not last.

    Args:
        push: accelerations (knots,) [rad/s^2], then the first command [N m]; in and
            out.
        load: torque of the cables at the motor at the start [N m].
        weight: see `Tables`.
        tune: see `Tables`.
        scratch: scratch; `wanted` and `holding`, and `path` and `load` of `push`, are
            read.
    """
    n, memory, path, loads = (
        scratch.path.size,
        scratch.memory,
        scratch.path,
        scratch.load,
    )
    span, inertia = tune[SPAN], tune[INERTIA]
    spring = tune[STIFFNESS] / tune[RATIO] ** 2
    vectors = scratch.vectors
    x, trial, slope, move = vectors[0], vectors[1], vectors[2], vectors[3]
    most, base = vectors[4], vectors[5]
    off, free, step = vectors[6], vectors[7], vectors[8]
    angle, velocity, torque = memory[ANGLE], memory[VELOCITY], memory[MOTOR_TORQUE]
    turned, speed, made = 0.0, 0.0, 0.0
    last, lasting, before = angle, load, memory[COMMAND]
    for i in range(n):
        most[i] = tune[RATE] * (span if i > 0 else 0.5 * (span + tune[PERIOD]))
        mean = 0.5 * (lasting + loads[i])
        own = tune[DAMPING] * (path[i] - last) / span - memory[DISTURBANCE]
        need = mean + own + inertia * push[i]
        x[i] = min(max(need - before, -most[i]), most[i])
        free[i] = memory[COMMAND] - scratch.holding[i] - own
        base[i] = mean - spring * 0.5 * (last + path[i]) - memory[DISTURBANCE]
        angle, velocity, torque = _motor_response(
            angle, velocity, torque, memory[COMMAND], base[i], tune
        )
        off[i] = angle - scratch.wanted[i]
        turned, speed, made = _motor_response(turned, speed, made, 1.0, 0.0, tune)
        step[i] = turned
        last, lasting, before = path[i], loads[i], need
    weight /= inertia**2
    cost = _cost(x, off, free, step, weight)
    for _ in range(_NEWTON_STEPS):
        _slope(x, off, free, step, weight, slope)
        for k in range(n):
            is_bound = (x[k] >= most[k] and slope[k] < 0.0) or (
                x[k] <= -most[k] and slope[k] > 0.0
            )
            move[k] = 0.0 if is_bound else slope[k]
            trial[k] = 0.0 if is_bound else 1.0
        _newton_step(trial, step, weight, scratch.matrix, move)
        share, found = 1.0, cost
        for _ in range(_HALVINGS):
            for k in range(n):
                trial[k] = min(max(x[k] - share * move[k], -most[k]), most[k])
            found = _cost(trial, off, free, step, weight)
            if found < cost:
                break
            share *= 0.5
        if not found < cost:
            break
        is_settled = cost - found < _COST_TOLERANCE * cost
        cost = found
        for k in range(n):
            x[k] = trial[k]
        if is_settled:
            break
    command = memory[COMMAND]
    angle, velocity, torque = memory[ANGLE], memory[VELOCITY], memory[MOTOR_TORQUE]
    for i in range(n):
        command += x[i]
        before = velocity
        angle, velocity, torque = _motor_response(
            angle, velocity, torque, command, base[i], tune
        )
        push[i] = (velocity - before) / span
    push[n] = memory[COMMAND] + x[0]


@internal
def _cost(
    x: FloatArray, off: FloatArray, free: FloatArray, step: FloatArray, weight: float
) -> float:
    """Return half of the cost of increments `x` [rad^2]; see `_optimise_commands`.

    Args:
        x: increments of the command (knots,) [N m].
        off: error of the angle without them (knots,) [rad].
        free: command less the holding torque without them (knots,) [N m].
        step: change of the angle so many knots after an increment [rad/N m].
        weight: of a squared torque [rad^2/(N m)^2].
    """
    cost, above = 0.0, 0.0
    for i in range(x.size):
        error = off[i]
        for k in range(i + 1):
            error += step[i - k] * x[k]
        above += x[i]
        cost += error * error + weight * (free[i] + above) ** 2
    return 0.5 * cost


@internal
def _slope(
    x: FloatArray,
    off: FloatArray,
    free: FloatArray,
    step: FloatArray,
    weight: float,
    slope: FloatArray,
) -> None:
    """Write the derivative of `_cost` by every increment to `slope`."""
    slope[:] = 0.0
    above = 0.0
    for i in range(x.size):
        error = off[i]
        for k in range(i + 1):
            error += step[i - k] * x[k]
        above += x[i]
        for k in range(i + 1):
            slope[k] += error * step[i - k] + weight * (free[i] + above)


@internal
def _newton_step(
    free: FloatArray,
    step: FloatArray,
    weight: float,
    matrix: FloatArray,
    move: FloatArray,
) -> None:
    """Solve for the Newton step of the increments that are free, by Cholesky."""
    n = free.size
    for k in range(n):
        for m in range(k + 1):
            total = weight * (n - k)
            for i in range(k, n):
                total += step[i - k] * step[i - m]
            both = free[k] != 0.0 and free[m] != 0.0
            matrix[k, m] = total if both else (1.0 if k == m else 0.0)
    for k in range(n):
        for m in range(k + 1):
            total = matrix[k, m]
            for i in range(m):
                total -= matrix[k, i] * matrix[m, i]
            if k == m:
                matrix[k, k] = np.sqrt(total)
            else:
                matrix[k, m] = total / matrix[m, m]
    for k in range(n):
        for i in range(k):
            move[k] -= matrix[k, i] * move[i]
        move[k] /= matrix[k, k]
    for k in range(n - 1, -1, -1):
        for i in range(k + 1, n):
            move[k] -= matrix[i, k] * move[i]
        move[k] /= matrix[k, k]


@internal
def _command_for_torque(before: float, wanted: float, tune: FloatArray) -> float:
    """Return the command for which a motor that lags has a mean torque [N m].

    The mean is that over the time between two knots, although the next step gives
    another command: to make up for the lag within a step would swing from step to step,
    and multiply the noise.

    Args:
        before: torque of the motor now [N m].
        wanted: mean torque [N m].
        tune: see `Tables`.
    """
    lag, span = tune[LAG], tune[SPAN]
    if lag == 0.0:
        return wanted
    kept = -np.expm1(-span / lag) * lag / span
    return float(before + (wanted - before) / (1.0 - kept))


@internal
def _is_within(
    push: FloatArray, load: float, tune: FloatArray, scratch: PlannerWorkspace
) -> bool:
    """Return whether the rate of the command lets the motor follow a plan."""
    last, lasting, before = scratch.memory[ANGLE], load, scratch.memory[COMMAND]
    torque = scratch.memory[MOTOR_TORQUE]
    for i in range(scratch.path.size):
        most = tune[RATE] * (tune[SPAN] if i > 0 else tune[PERIOD])
        need = 0.5 * (lasting + scratch.load[i]) + tune[INERTIA] * push[i]
        need += tune[DAMPING] * (scratch.path[i] - last) / tune[SPAN]
        need -= scratch.memory[DISTURBANCE]
        command = _command_for_torque(torque, need, tune)
        if abs(command - before) > most:
            return False
        last, lasting, before, torque = scratch.path[i], scratch.load[i], command, need
    return True


@internal
def _damping(tune: FloatArray, delay: int) -> float:
    """Return the damping of a motor that follows the joint [N m s/rad]."""
    late = tune[PERIOD] * (1 + delay) + tune[LAG]
    steady = guard.MAX_DAMPING_SHARE * tune[INERTIA] / late
    return float(min(guard.RELEASE_TIME * tune[STIFFNESS] / tune[RATIO] ** 2, steady))


@compiled
def motor_torque(
    cables: stepper.Cables,
    state: FloatArray,
    joint: FloatArray,
    device: PlannerMemory,
    seen: FloatArray,
    tables: Tables,
    room: PlannerWorkspace,
) -> float:
    """Return the torque of the motor of one device [N m].

    Args:
        cables: of the device.
        state: of the cables when they were measured (cables, numbers); moved on.
        joint: angle of the joint in the model (1,) [rad]; moved on.
        device: moved on.
        seen: motor angle, joint angle, joint torque, desired torque (4,).
        tables: see there.
        room: scratch.
    """
    tune, memory, applied = tables.tune, room.memory, device.applied
    dt = tune[PERIOD]
    _replace_by_mean_torque(device.memory, applied, tune)
    joint[0] = _observe(cables, state, joint[0], device, seen, tables, room)
    _learn(cables, state, device.memory, tune)
    for i in range(memory.size):
        memory[i] = device.memory[i]
    delay = int(memory[BELIEVED_DELAY])
    _copy_states(state, room.state)
    at = _predict(cables, joint[0], applied[applied.size - delay :], tune, room)
    _anticipate_joint(memory, tune)
    _damp_desired(memory, tune)
    before = memory[DIRECTION]
    sense = 1.0 if before == 0.0 else before
    gains, weight, best = tables.gains[delay], tables.weight[delay], room.best
    cost = _plan(cables, at, sense, gains, weight, tune, best, room)
    turning = 0.0 if before == 0.0 else tune[TURNING]
    if cost > turning:
        other = _plan(cables, at, -sense, gains, weight, tune, room.push, room)
        if other + turning < cost:
            sense, best = -sense, room.push
    device.memory[DIRECTION] = sense
    angle, velocity = memory[ANGLE], memory[VELOCITY]
    load = stepper.torque(cables, room.state, False, angle)[0]
    angle += dt * (velocity + 0.5 * dt * best[0])
    at += memory[JOINT + 1] + 0.5 * memory[JOINT + 2]
    stepper.move(cables, room.state, angle, at, dt, room.new, room.work)
    load = 0.5 * (load + stepper.torque(cables, room.new, False, angle)[0])
    torque = load + tune[INERTIA] * best[0] + tune[DAMPING] * velocity
    torque -= memory[DISTURBANCE]
    own = device.memory
    torque = _command_for_torque(own[MOTOR_TORQUE], torque, tune)
    if not np.isnan(best[best.size - 1]):
        torque = best[best.size - 1]
    ahead = velocity - tune[RATIO] * memory[JOINT + 1] / dt
    rushing = guard.impact_torque(ahead, tune[RATIO], tune[STIFFNESS], tune[INERTIA])
    own[RELEASED] = guard.release_state(
        own[RELEASED], seen[2], rushing, seen[3], tune[SAFE]
    )
    if own[RELEASED] != 0.0:
        torque = -_damping(tune, delay) * ahead
    most = tune[RATE] * dt
    torque = min(max(torque, own[COMMAND] - most), own[COMMAND] + most)
    torque = min(max(torque, tune[LOW]), tune[HIGH])
    for i in range(applied.size - 1):
        applied[i] = applied[i + 1]
    applied[applied.size - 1] = torque
    return float(torque)


@compiled
def friction_factors(memory: FloatArray, factor: FloatArray) -> None:
    """Compute the factor on the friction of every cable (cables,)."""
    for k in range(factor.size):
        factor[k] = np.exp(memory[FRICTION + k])


@compiled
def motor_torques(
    prm: FloatArray,
    n: stepper.Counts,
    proximal: FloatArray,
    distal: FloatArray,
    states: FloatArray,
    joints: FloatArray,
    devices: PlannerMemory,
    seen: FloatArray,
    tables: Tables,
    found: FloatArray,
    room: PlannerWorkspace,
) -> None:
    """Compute the torque of the motor of every device; see `motor_torque`.

    Args:
        prm: packed parameters (rows, cables, numbers).
        n: segments of every cable.
        proximal: arms at the motor [m/rad].
        distal: arms at the joint [m/rad].
        states: (rows, cables, numbers).
        joints: (rows,).
        devices: arrays with a row for each.
        seen: (rows, 4).
        tables: of all.
        found: out (rows,) [N m].
        room: scratch.
    """
    for row in range(found.size):
        cables = stepper.Cables(prm[row], n, proximal, proximal, distal)
        device = PlannerMemory(
            devices.memory[row], devices.rotors[row], devices.applied[row]
        )
        found[row] = motor_torque(
            cables, states[row], joints[row : row + 1], device, seen[row], tables, room
        )
