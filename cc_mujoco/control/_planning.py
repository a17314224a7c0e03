"""Present torque of the motor from delayed measurements: observer, plan, torque.

Observers and prediction work on the mean torque of every step; see `_motor_commands`
for motors that lag.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _rollout as rollout
from cc_mujoco.control._compensation import has_drag
from cc_mujoco.control._motor_commands import (
    command_for_torque,
    is_within,
    optimise_commands,
)
from cc_mujoco.control._planner_memory import (
    ANGLE,
    BELIEVED_DELAY,
    BRISTLED,
    CAUTION,
    COMMAND,
    DESIRED_TORQUE,
    DIRECTION,
    DISTURBANCE,
    ENERGY,
    FILTERED_TORQUE,
    FRICTION,
    GUARD,
    JOINT,
    MOTOR_TORQUE,
    STARTED,
    VELOCITY,
    PlannerMemory,
    PlannerWorkspace,
    Tables,
    copy_states,
)
from cc_mujoco.control._planner_observer import (
    learn,
    observe,
    replace_by_mean_torque,
    set_bristles,
)
from cc_mujoco.control._planner_parameters import (
    ANSWER_TIME,
    CAUTION_SHARE,
    CREEP,
    DAMPER,
    DAMPING,
    HIGH,
    INERTIA,
    ITERATIONS,
    LAG,
    LOW,
    NOISE,
    ONE_WAY,
    PERIOD,
    RATE,
    RATIO,
    SAFE,
    SAFE_POWER,
    SAFE_SPEED,
    SHARED,
    SLACK,
    SLOW,
    SPAN,
    SPEND,
    STIFFNESS,
    TOLERANCE,
    TURNING,
    YIELDING,
)
from cc_mujoco.native import (
    FloatArray,
    FloatMatrix,
    compiled,
    internal,
)

_RATE_TERMS = tuple(
    place for place, term, _ in law.DRAG_TERMS if "rate" in term.depends_on
)
_MAX_KNOT_STEP = 2.0
"""Largest turn of the motor between two knots of a plan [rad]."""
_NEWTON_STEPS, _HALVINGS, _LINEARIZATIONS = 12, 6, 2
"""Most Newton steps of a plan of commands, halvings of a step, and linearisations of
the load."""


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
    for k in range(applied.size):
        load = stepper.torque(cables, state, False, memory[ANGLE])[0]
        force = (
            applied[k] - load - tune[DAMPING] * memory[VELOCITY] + memory[DISTURBANCE]
        )
        memory[VELOCITY] += dt * force / tune[INERTIA]
        memory[ANGLE] += dt * memory[VELOCITY]
        joint += memory[JOINT + 1] + 0.5 * memory[JOINT + 2]
        memory[JOINT + 1] += memory[JOINT + 2]
        memory[DESIRED_TORQUE] += memory[DESIRED_TORQUE + 1]
        stepper.move(cables, state, memory[ANGLE], joint, dt, scratch.new, scratch.work)
        copy_states(scratch.new, state)
    return joint


@compiled
def _anticipate_joint(memory: FloatArray, tune: FloatArray) -> None:
    """Predict the motion of the joint under the torque that it lacks.

    Otherwise a joint that a lack of torque slows down would seem to reverse.
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
    caution: float,
    gains: FloatMatrix,
    weight: float,
    tune: FloatArray,
    push: FloatArray,
    scratch: PlannerWorkspace,
) -> float:
    """Plan accelerations `push` of a motor that turns one way only [rad/s^2].

    Behind them is the first command, where the rate of the command is limited too much.
    `caution` is the initial deficit of the torque [N m]. Return the mean squared error
    of the torque over the horizon, half of it on the planned path and half on the
    wanted one, which a long way does not delay [N m^2]; infinite where it might exceed
    the allowed iterations.
    """
    memory, rolled, new = scratch.memory, scratch.rolled, scratch.new
    count, span = scratch.path.size, tune[SPAN]
    steps = span / tune[PERIOD]
    cautious, kept = caution, (1.0 - tune[CREEP]) ** steps
    rise = tune[STIFFNESS] / tune[RATIO]
    cost = 0.0
    copy_states(scratch.state, rolled)
    angle, velocity = memory[ANGLE], memory[VELOCITY]
    at = angle
    for i in range(count):
        push[i] = gains[i, 0] * angle + gains[i, 1] * velocity
    drags = _has_rate_friction(cables)
    slack = tune[SLACK] if has_drag(cables.prm[0]) else 0.0
    last = joint
    simulated = 1 + _LINEARIZATIONS if tune[RATE] < np.inf else 1
    most = rollout.most_steps(drags) + simulated * count
    for i in range(count):
        if scratch.spent[0] + most > tune[ITERATIONS]:
            return np.inf
        t = (i + 1) * steps
        where = joint + memory[JOINT + 1] * t + 0.5 * memory[JOINT + 2] * t * t
        cautious *= kept
        desired = memory[DESIRED_TORQUE] + memory[DESIRED_TORQUE + 1] * t - cautious
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
            slack,
            span,
            drags,
            scratch.leapt,
            new,
            scratch.work,
            scratch.spent,
        )
        copy_states(new, rolled)
        last = where
        cost += (rollout.joint_torque(cables, new, at) - desired) ** 2
        for j in range(count):
            push[j] += gains[j, 2 + i] * at
        scratch.wanted[i] = at
        scratch.holding[i] = stepper.torque(cables, new, False, at)[0]
    found = _simulate_plan(cables, joint, caution, cost, tune, push, scratch)
    push[count] = np.nan
    if tune[RATE] < np.inf:
        load = stepper.torque(cables, scratch.state, False, angle)[0]
        if not is_within(push, load, tune, scratch):
            for _ in range(_LINEARIZATIONS):
                optimise_commands(push, load, weight, tune, scratch)
                found = _simulate_plan(
                    cables, joint, caution, cost, tune, push, scratch
                )
    return 0.5 * found / count


@internal
def _simulate_plan(
    cables: stepper.Cables,
    joint: float,
    caution: float,
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
    copy_states(scratch.state, rolled)
    kept = (1.0 - tune[CREEP]) ** steps
    limit = max(abs(tune[LOW]), abs(tune[HIGH])) / tune[INERTIA]
    scratch.spent[0] += count
    for i in range(count):
        push[i] = min(max(push[i], -limit), limit)
        angle += span * (velocity + 0.5 * span * push[i])
        velocity += span * push[i]
        t = (i + 1) * steps
        where = joint + memory[JOINT + 1] * t + 0.5 * memory[JOINT + 2] * t * t
        caution *= kept
        desired = memory[DESIRED_TORQUE] + memory[DESIRED_TORQUE + 1] * t - caution
        stepper.move(cables, rolled, angle, where, span, new, scratch.work)
        copy_states(new, rolled)
        cost += (rollout.joint_torque(cables, new, angle) - desired) ** 2
        scratch.path[i] = angle
        scratch.load[i] = stepper.torque(cables, new, False, angle)[0]
    return cost


@internal
def _go_on(plan: FloatArray, tune: FloatArray, push: FloatArray) -> None:
    """Write the acceleration of the last whole plan, 0 behind its end, to a plan."""
    count = plan.size - 1
    knot = int(plan[count] * tune[PERIOD] / tune[SPAN])
    push[0] = plan[knot] if knot < count else 0.0
    push[count] = np.nan


@internal
def _damping(tune: FloatArray, delay: int) -> float:
    """Return the damping of a motor that follows the joint [N m s/rad]."""
    late = tune[PERIOD] * (1 + delay) + tune[LAG]
    steady = guard.MAX_DAMPING_SHARE * tune[INERTIA] / late
    return float(min(guard.RELEASE_TIME * tune[STIFFNESS] / tune[RATIO] ** 2, steady))


@compiled
def motor_torque(
    cables: stepper.Cables,
    state: FloatMatrix,
    joint: FloatArray,
    device: PlannerMemory,
    seen: FloatArray,
    tables: Tables,
    room: PlannerWorkspace,
) -> float:
    """Return the torque of the motor of one device [N m].

    States of the cables when they were measured (cables, numbers), the model's joint
    angle (1,) [rad] and the device are updated. `seen` has motor angle, joint angle,
    joint torque and desired torque (4,).
    """
    tune, memory, applied = tables.tune, room.memory, device.applied
    dt, own = tune[PERIOD], device.memory
    limits = guard.DriveLimits(
        tune[RATIO], tune[LOW], tune[HIGH], dt, tune[ONE_WAY], tune[INERTIA],
        tune[SAFE], tune[SAFE_SPEED], tune[SAFE_POWER], tune[ANSWER_TIME],
        tune[SHARED],
    )  # fmt: skip
    spring, watched = tune[STIFFNESS:], own[GUARD:FRICTION]
    read = watched[guard.SEEN :]
    read[guard.MOTOR], read[guard.MOTOR_SPEED] = seen[0], own[VELOCITY]
    read[guard.JOINT], read[guard.JOINT_SPEED] = seen[1], own[JOINT + 1] / dt
    read[guard.TORQUE], read[guard.DESIRED] = seen[2], seen[3]
    watched[guard.COMMAND] = applied[applied.size - 1]
    guard.admit(limits, spring, watched, read)
    replace_by_mean_torque(device.memory, applied, tune)
    if own[STARTED] == 0.0:
        device.plan[:] = 0.0
    where = observe(cables, state, joint, device, read, tables, room)
    if device.memory[BRISTLED] != 0.0:
        state = device.other
    learn(cables, state, device.memory, tune)
    for i in range(memory.size):
        memory[i] = device.memory[i]
    delay = int(memory[BELIEVED_DELAY])
    copy_states(state, room.state)
    at = _predict(cables, where, applied[applied.size - delay :], tune, room)
    _anticipate_joint(memory, tune)
    _damp_desired(memory, tune)
    before = memory[DIRECTION]
    sense = 1.0 if before == 0.0 else before
    gains, weight, best = tables.gains[delay], tables.weight[delay], room.best
    own[CAUTION] *= 1.0 - tune[CREEP]
    room.spent[0] = 0.0
    cost = _plan(cables, at, sense, own[CAUTION], gains, weight, tune, best, room)
    rise = tune[STIFFNESS] / tune[RATIO]
    turning = 0.0 if before == 0.0 else tune[TURNING]
    if np.isinf(cost):
        _go_on(device.plan, tune, best)
    elif cost > turning:
        other = _plan(cables, at, -sense, 0.0, gains, weight, tune, room.push, room)
        width = (room.wanted[room.wanted.size - 1] - memory[ANGLE]) * rise
        if other + turning < cost:
            sense, best = -sense, room.push
            own[CAUTION] = tune[CAUTION_SHARE] * width
    device.memory[DIRECTION] = sense
    if not np.isinf(cost):
        for i in range(best.size - 1):
            device.plan[i] = best[i]
        device.plan[best.size - 1] = 0.0
    device.plan[best.size - 1] += 1.0
    angle, velocity = memory[ANGLE], memory[VELOCITY]
    load = stepper.torque(cables, room.state, False, angle)[0]
    angle += dt * (velocity + 0.5 * dt * best[0])
    at += memory[JOINT + 1] + 0.5 * memory[JOINT + 2]
    stepper.move(cables, room.state, angle, at, dt, room.new, room.work)
    load = 0.5 * (load + stepper.torque(cables, room.new, False, angle)[0])
    torque = load + tune[INERTIA] * best[0] + tune[DAMPING] * velocity
    torque -= memory[DISTURBANCE]
    torque = command_for_torque(own[MOTOR_TORQUE], torque, tune)
    if not np.isnan(best[best.size - 1]):
        torque = best[best.size - 1]
    ahead = velocity - tune[RATIO] * memory[JOINT + 1] / dt
    planned = read[guard.DESIRED]
    if guard.state(limits, spring, watched, ahead, planned) != guard.FREE:
        # Predictions from a failed sensor would drive the motor.
        ahead = read[guard.MOTOR_SPEED] - tune[RATIO] * read[guard.JOINT_SPEED]
        damping = _damping(tune, delay)
        torque = guard.let_go_torque(limits, spring, watched, damping, ahead)
    if not abs(torque) < np.inf:
        # Readings that contradict each other by far made the models diverge.
        guard.stop(watched, guard.LIMP)
        torque = 0.0
    torque = guard.bounded(limits, spring, watched, torque)
    most = tune[RATE] * dt
    torque = min(max(torque, own[COMMAND] - most), own[COMMAND] + most)
    torque = min(max(torque, tune[LOW]), tune[HIGH])
    for i in range(applied.size - 1):
        applied[i] = applied[i + 1]
    applied[applied.size - 1] = torque
    if own[BRISTLED] != 0.0:
        set_bristles(cables, 0.0)
    return float(torque)
