"""Present torque of the motor from delayed measurements: observer, plan, torque.

Observers and prediction work on the mean torque of every step. A motor whose torque
lags follows its command by lag dtau/dt + tau = command. The plan is that of a motor
without lag, and the command leads its torque. Where the rate of the command is too
limited for that, the plan minimises a cost of commands over increments within the
limit: D. Bertsekas, "Projected Newton methods for optimization problems with simple
constraints", SIAM J. Control and Optimization 20, 1982.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _planner_memory as at
from cc_mujoco.control import _rollout as rollout
from cc_mujoco.control._compensation import has_drag
from cc_mujoco.control._planner_memory import (
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
from cc_mujoco.native import (
    FloatArray,
    FloatMatrix,
    compiled,
    internal,
)

_RATE_TERMS = tuple(
    place for place, term, _ in law.DRAG_TERMS if "rate" in term.depends_on
)
_NEWTON_STEPS, _HALVINGS, _LINEARIZATIONS = 12, 6, 2
"""Most Newton steps of a plan of commands, halvings of a step, and linearisations of
the load."""


@internal
def command_for_torque(before: float, wanted: float, tune: FloatArray) -> float:
    """Return the command for which a motor that lags has a mean torque [N m].

    The mean is over the time between two knots, although the next step gives another
    command: to compensate the lag within a step would swing from step to step, and
    multiply the noise. `before` is the present torque of the motor, `wanted` the mean
    torque [N m].
    """
    lag, span = tune[at.LAG], tune[at.SPAN]
    if lag == 0.0:
        return wanted
    kept = -np.expm1(-span / lag) * lag / span
    return float(before + (wanted - before) / (1.0 - kept))


@internal
def is_within(
    push: FloatArray, load: float, tune: FloatArray, scratch: PlannerWorkspace
) -> bool:
    """Return whether the rate of the command lets the motor follow a plan."""
    last, lasting, before = scratch.memory[at.ANGLE], load, scratch.memory[at.COMMAND]
    torque = scratch.memory[at.MOTOR_TORQUE]
    for i in range(scratch.path.size):
        most = tune[at.RATE] * (tune[at.SPAN] if i > 0 else tune[at.PERIOD])
        need = 0.5 * (lasting + scratch.load[i]) + tune[at.INERTIA] * push[i]
        need += tune[at.DAMPING] * (scratch.path[i] - last) / tune[at.SPAN]
        need -= scratch.memory[at.DISTURBANCE]
        command = command_for_torque(torque, need, tune)
        if abs(command - before) > most:
            return False
        last, lasting, before, torque = scratch.path[i], scratch.load[i], command, need
    return True


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
    span, lag = tune[at.SPAN], tune[at.LAG]
    spring = tune[at.STIFFNESS] / tune[at.RATIO] ** 2
    mean = command
    if lag > 0.0:
        passed = -np.expm1(-span / lag)
        behind = torque - command
        mean += behind * (passed * lag / span)
        command += behind * (1.0 - passed)
    load += spring * (angle + 0.5 * span * velocity) + tune[at.DAMPING] * velocity
    gained = (mean - load) / (tune[at.INERTIA] + 0.25 * spring * span * span)
    angle += span * (velocity + 0.5 * span * gained)
    return angle, velocity + span * gained, command


@compiled
def optimise_commands(
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
    load is linear around that on the path of `push`: its slope is that of cables that
    stretch as a whole, since the steep slope of their ends does not last.

    `push` has accelerations (knots,) [rad/s^2], then the first command [N m], in and
    out; `load` is the torque of the cables at the motor at the start [N m]. Of the
    scratch, `wanted` and `holding`, and `path` and `load` of `push`, are read. For the
    others see `Tables`.
    """
    n, memory, path, loads = (
        scratch.path.size,
        scratch.memory,
        scratch.path,
        scratch.load,
    )
    span, inertia = tune[at.SPAN], tune[at.INERTIA]
    spring = tune[at.STIFFNESS] / tune[at.RATIO] ** 2
    vectors = scratch.vectors
    x, trial, slope, move = vectors[0], vectors[1], vectors[2], vectors[3]
    most, base = vectors[4], vectors[5]
    off, free, step = vectors[6], vectors[7], vectors[8]
    angle, velocity, torque = (
        memory[at.ANGLE],
        memory[at.VELOCITY],
        memory[at.MOTOR_TORQUE],
    )
    turned, speed, made = 0.0, 0.0, 0.0
    last, lasting, before = angle, load, memory[at.COMMAND]
    for i in range(n):
        most[i] = tune[at.RATE] * (span if i > 0 else 0.5 * (span + tune[at.PERIOD]))
        mean = 0.5 * (lasting + loads[i])
        own = tune[at.DAMPING] * (path[i] - last) / span - memory[at.DISTURBANCE]
        need = mean + own + inertia * push[i]
        x[i] = min(max(need - before, -most[i]), most[i])
        free[i] = memory[at.COMMAND] - scratch.holding[i] - own
        base[i] = mean - spring * 0.5 * (last + path[i]) - memory[at.DISTURBANCE]
        angle, velocity, torque = _motor_response(
            angle, velocity, torque, memory[at.COMMAND], base[i], tune
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
        is_settled = cost - found < 1e-6 * cost
        cost = found
        for k in range(n):
            x[k] = trial[k]
        if is_settled:
            break
    command = memory[at.COMMAND]
    angle, velocity, torque = (
        memory[at.ANGLE],
        memory[at.VELOCITY],
        memory[at.MOTOR_TORQUE],
    )
    for i in range(n):
        command += x[i]
        before = velocity
        angle, velocity, torque = _motor_response(
            angle, velocity, torque, command, base[i], tune
        )
        push[i] = (velocity - before) / span
    push[n] = memory[at.COMMAND] + x[0]


@internal
def _cost(
    x: FloatArray, off: FloatArray, free: FloatArray, step: FloatArray, weight: float
) -> float:
    """Return half of the cost of increments `x` [rad^2]; see `optimise_commands`.

    Without the increments (knots,) [N m], `off` is the error of the angle [rad] and
    `free` the command less the holding torque [N m]. `step` is the change of the angle
    so many knots after an increment [rad/N m], `weight` that of a squared torque
    [rad^2/(N m)^2].
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
    matrix: FloatMatrix,
    move: FloatArray,
) -> None:
    """Solve for the Newton step of the free increments, by Cholesky."""
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


@compiled
def _predict(
    cables: stepper.Cables,
    joint: float,
    applied: FloatArray,
    tune: FloatArray,
    scratch: PlannerWorkspace,
) -> float:
    """Advance `room` over the applied torques; return the model's joint angle."""
    dt, memory, state = tune[at.PERIOD], scratch.memory, scratch.state
    for k in range(applied.size):
        load = stepper.torque(cables, state, False, memory[at.ANGLE])[0]
        force = (
            applied[k]
            - load
            - tune[at.DAMPING] * memory[at.VELOCITY]
            + memory[at.DISTURBANCE]
        )
        memory[at.VELOCITY] += dt * force / tune[at.INERTIA]
        memory[at.ANGLE] += dt * memory[at.VELOCITY]
        joint += memory[at.JOINT + 1] + 0.5 * memory[at.JOINT + 2]
        memory[at.JOINT + 1] += memory[at.JOINT + 2]
        memory[at.DESIRED_TORQUE] += memory[at.DESIRED_TORQUE + 1]
        stepper.move(
            cables, state, memory[at.ANGLE], joint, dt, scratch.new, scratch.work
        )
        copy_states(scratch.new, state)
    return joint


@compiled
def _anticipate_joint(memory: FloatArray, tune: FloatArray) -> None:
    """Predict the motion of the joint under the torque that it lacks.

    Otherwise a joint that a lack of torque slows down would seem to reverse.
    """
    lacking = memory[at.DESIRED_TORQUE] - memory[at.FILTERED_TORQUE]
    sure = max(abs(lacking) - tune[at.NOISE], 0.0) * np.sign(lacking)
    memory[at.JOINT + 1] += tune[at.YIELDING] * sure * tune[at.PERIOD]


@compiled
def _damp_desired(memory: FloatArray, tune: FloatArray) -> None:
    """Subtract a damping torque that dissipates the surplus energy of the joint."""
    rate = memory[at.JOINT + 1] / tune[at.PERIOD]
    damper = memory[at.ENERGY] / (tune[at.SPEND] * (rate * rate + tune[at.SLOW] ** 2))
    damper = min(max(damper, 0.0), tune[at.DAMPER])
    damper /= tune[at.PERIOD]
    memory[at.DESIRED_TORQUE] -= damper * memory[at.JOINT + 1]
    memory[at.DESIRED_TORQUE + 1] -= damper * memory[at.JOINT + 2]


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
    count, span = scratch.path.size, tune[at.SPAN]
    steps = span / tune[at.PERIOD]
    cautious, kept = caution, (1.0 - tune[at.CREEP]) ** steps
    rise = tune[at.STIFFNESS] / tune[at.RATIO]
    cost = 0.0
    copy_states(scratch.state, rolled)
    angle, velocity = memory[at.ANGLE], memory[at.VELOCITY]
    motor = angle
    for i in range(count):
        push[i] = gains[i, 0] * angle + gains[i, 1] * velocity
    drags = _has_rate_friction(cables)
    slack = tune[at.SLACK] if has_drag(cables.prm[0]) else 0.0
    last = joint
    simulated = 1 + _LINEARIZATIONS if tune[at.RATE] < np.inf else 1
    most = rollout.most_steps(drags) + simulated * count
    for i in range(count):
        if scratch.spent[0] + most > tune[at.ITERATIONS]:
            return np.inf
        t = (i + 1) * steps
        where = joint + memory[at.JOINT + 1] * t + 0.5 * memory[at.JOINT + 2] * t * t
        cautious *= kept
        desired = (
            memory[at.DESIRED_TORQUE] + memory[at.DESIRED_TORQUE + 1] * t - cautious
        )
        motor = rollout.find_motor_angle(
            cables,
            rolled,
            motor,
            sense,
            where,
            where - last,
            desired,
            rise,
            2.0,  # largest turn of the motor between two knots of a plan [rad]
            tune[at.TOLERANCE],
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
        cost += (rollout.joint_torque(cables, new, motor) - desired) ** 2
        for j in range(count):
            push[j] += gains[j, 2 + i] * motor
        scratch.wanted[i] = motor
        scratch.holding[i] = stepper.torque(cables, new, False, motor)[0]
    found = _simulate_plan(cables, joint, caution, cost, tune, push, scratch)
    push[count] = np.nan
    if tune[at.RATE] < np.inf:
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
    count, span = scratch.path.size, tune[at.SPAN]
    steps = span / tune[at.PERIOD]
    angle, velocity = memory[at.ANGLE], memory[at.VELOCITY]
    copy_states(scratch.state, rolled)
    kept = (1.0 - tune[at.CREEP]) ** steps
    limit = max(abs(tune[at.LOW]), abs(tune[at.HIGH])) / tune[at.INERTIA]
    scratch.spent[0] += count
    for i in range(count):
        push[i] = min(max(push[i], -limit), limit)
        angle += span * (velocity + 0.5 * span * push[i])
        velocity += span * push[i]
        t = (i + 1) * steps
        where = joint + memory[at.JOINT + 1] * t + 0.5 * memory[at.JOINT + 2] * t * t
        caution *= kept
        desired = (
            memory[at.DESIRED_TORQUE] + memory[at.DESIRED_TORQUE + 1] * t - caution
        )
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
    knot = int(plan[count] * tune[at.PERIOD] / tune[at.SPAN])
    push[0] = plan[knot] if knot < count else 0.0
    push[count] = np.nan


@internal
def _damping(tune: FloatArray, delay: int) -> float:
    """Return the damping of a motor that follows the joint [N m s/rad]."""
    late = tune[at.PERIOD] * (1 + delay) + tune[at.LAG]
    steady = guard.MAX_DAMPING_SHARE * tune[at.INERTIA] / late
    return float(
        min(guard.RELEASE_TIME * tune[at.STIFFNESS] / tune[at.RATIO] ** 2, steady)
    )


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
    dt, own = tune[at.PERIOD], device.memory
    limits, spring = guard.limits_of(tune), tune[at.STIFFNESS :]
    watched = own[at.GUARD : at.FRICTION]
    read = watched[guard.SEEN :]
    read[guard.MOTOR], read[guard.MOTOR_SPEED] = seen[0], own[at.VELOCITY]
    read[guard.JOINT], read[guard.JOINT_SPEED] = seen[1], own[at.JOINT + 1] / dt
    read[guard.TORQUE], read[guard.DESIRED] = seen[2], seen[3]
    watched[guard.COMMAND] = applied[applied.size - 1]
    guard.admit(limits, spring, watched, read)
    replace_by_mean_torque(device.memory, applied, tune)
    if own[at.STARTED] == 0.0:
        device.plan[:] = 0.0
    where = observe(cables, state, joint, device, read, tables, room)
    if device.memory[at.BRISTLED] != 0.0:
        state = device.other
    learn(cables, state, device.memory, tune)
    for i in range(memory.size):
        memory[i] = device.memory[i]
    delay = int(memory[at.BELIEVED_DELAY])
    copy_states(state, room.state)
    turned = _predict(cables, where, applied[applied.size - delay :], tune, room)
    _anticipate_joint(memory, tune)
    _damp_desired(memory, tune)
    before = memory[at.DIRECTION]
    sense = 1.0 if before == 0.0 else before
    gains, weight, best = tables.gains[delay], tables.weight[delay], room.best
    own[at.CAUTION] *= 1.0 - tune[at.CREEP]
    room.spent[0] = 0.0
    cost = _plan(
        cables, turned, sense, own[at.CAUTION], gains, weight, tune, best, room
    )
    rise = tune[at.STIFFNESS] / tune[at.RATIO]
    turning = 0.0 if before == 0.0 else tune[at.TURNING]
    if np.isinf(cost):
        _go_on(device.plan, tune, best)
    elif cost > turning:
        other = _plan(cables, turned, -sense, 0.0, gains, weight, tune, room.push, room)
        width = (room.wanted[room.wanted.size - 1] - memory[at.ANGLE]) * rise
        if other + turning < cost:
            sense, best = -sense, room.push
            own[at.CAUTION] = tune[at.CAUTION_SHARE] * width
    device.memory[at.DIRECTION] = sense
    if not np.isinf(cost):
        for i in range(best.size - 1):
            device.plan[i] = best[i]
        device.plan[best.size - 1] = 0.0
    device.plan[best.size - 1] += 1.0
    angle, velocity = memory[at.ANGLE], memory[at.VELOCITY]
    load = stepper.torque(cables, room.state, False, angle)[0]
    angle += dt * (velocity + 0.5 * dt * best[0])
    turned += memory[at.JOINT + 1] + 0.5 * memory[at.JOINT + 2]
    stepper.move(cables, room.state, angle, turned, dt, room.new, room.work)
    load = 0.5 * (load + stepper.torque(cables, room.new, False, angle)[0])
    torque = load + tune[at.INERTIA] * best[0] + tune[at.DAMPING] * velocity
    torque -= memory[at.DISTURBANCE]
    torque = command_for_torque(own[at.MOTOR_TORQUE], torque, tune)
    if not np.isnan(best[best.size - 1]):
        torque = best[best.size - 1]
    ahead = velocity - tune[at.RATIO] * memory[at.JOINT + 1] / dt
    planned = read[guard.DESIRED]
    if guard.state(limits, spring, watched, ahead, planned) != guard.FREE:
        # Predictions from a failed sensor would drive the motor.
        ahead = read[guard.MOTOR_SPEED] - tune[at.RATIO] * read[guard.JOINT_SPEED]
        damping = _damping(tune, delay)
        torque = guard.let_go_torque(limits, spring, watched, damping, ahead)
    if not abs(torque) < np.inf:
        # Readings that contradict each other by far made the models diverge.
        guard.stop(watched, guard.LIMP)
        torque = 0.0
    torque = guard.bounded(limits, spring, watched, torque)
    most = tune[at.RATE] * dt
    torque = min(max(torque, own[at.COMMAND] - most), own[at.COMMAND] + most)
    torque = min(max(torque, tune[at.LOW]), tune[at.HIGH])
    for i in range(applied.size - 1):
        applied[i] = applied[i + 1]
    applied[applied.size - 1] = torque
    if own[at.BRISTLED] != 0.0:
        set_bristles(cables, 0.0)
    return float(torque)
