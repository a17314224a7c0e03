"""Motor torque of a planning controller: observer, prediction over the delay, plan.

Observers and prediction work on the mean torque of every step. A motor whose torque
lags follows its command by lag dtau/dt + tau = command. The plan is that of a motor
without lag, and the command leads its torque. If the rate of the command is too limited
for that, the plan minimises a cost of commands over increments within the limit: D.
Bertsekas, "Projected Newton methods for optimization problems with simple constraints",
SIAM J. Control and Optimization 20, 1982.
"""

from typing import NamedTuple

import numpy as np

from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _planner_memory as at
from cc_mujoco.control import _planner_observer as observer
from cc_mujoco.control import _rollout as rollout
from cc_mujoco.control._cholesky import solve_active
from cc_mujoco.control._compensation import has_drag
from cc_mujoco.control._planner_memory import Planner
from cc_mujoco.native import FloatArray, FloatMatrix, internal

_RATE_TERMS = tuple(
    place for place, term, _ in law.DRAG_TERMS if "rate" in term.depends_on
)
"""Indices of the parameters of friction that depends on speed."""


class _Motor(NamedTuple):
    """Angle [rad], velocity [rad/s] and torque [N m] of a motor."""

    angle: float
    velocity: float
    torque: float


class _Deviations(NamedTuple):
    """Terms of the quadratic cost of command increments in `optimise_commands`."""

    angle: FloatArray  # error of the angle without increments (knots,) [rad]
    command: FloatArray  # command less holding torque without them (knots,) [N m]
    step: FloatArray  # angle per increment, by knots since it (knots,) [rad/(N m)]
    weight: float  # of a squared torque [rad^2/(N m)^2]


@internal
def command_for_torque(before: float, wanted: float, tune: FloatArray) -> float:
    """Return the command that gives a motor with lag a mean torque `wanted` [N m].

    The mean is over the time between two knots of the plan, although the next step
    gives another command: full compensation of the lag within a step would oscillate
    from step to step and amplify noise. `before` is the present torque of the motor [N
    m].
    """
    lag, span = tune[at.LAG], tune[at.SPAN]
    if lag == 0.0:
        return wanted
    kept = -np.expm1(-span / lag) * lag / span
    return float(before + (wanted - before) / (1.0 - kept))


@internal
def is_within(planner: Planner, push: FloatArray, load: float) -> bool:
    """Return whether the command's rate limit lets the motor follow a plan `push`."""
    tune, ahead, path = planner.tune, planner.ahead, planner.path
    last, lasting, before = ahead[at.ANGLE], load, ahead[at.COMMAND]
    torque = ahead[at.MOTOR_TORQUE]
    for i in range(path.size):
        most = tune[at.RATE] * (tune[at.SPAN] if i > 0 else tune[at.PERIOD])
        need = 0.5 * (lasting + planner.load[i]) + tune[at.INERTIA] * push[i]
        need += tune[at.DAMPING] * (path[i] - last) / tune[at.SPAN]
        need -= ahead[at.DISTURBANCE]
        command = command_for_torque(torque, need, tune)
        if abs(command - before) > most:
            return False
        last, lasting, before, torque = path[i], planner.load[i], command, need
    return True


@internal
def _motor_response(
    motor: _Motor, command: float, load: float, tune: FloatArray
) -> _Motor:
    """Return the motor one knot later, for a constant command [N m].

    The torques against it are `load` [N m] and, by its mean angle, that of all cables
    as a spring.
    """
    span, lag = tune[at.SPAN], tune[at.LAG]
    spring = tune[at.STIFFNESS] / tune[at.RATIO] ** 2
    mean, velocity = command, motor.velocity
    if lag > 0.0:
        passed = -np.expm1(-span / lag)
        behind = motor.torque - command
        mean += behind * (passed * lag / span)
        command += behind * (1.0 - passed)
    load += spring * (motor.angle + 0.5 * span * velocity) + tune[at.DAMPING] * velocity
    gained = (mean - load) / (tune[at.INERTIA] + 0.25 * spring * span * span)
    angle = motor.angle + span * (velocity + 0.5 * span * gained)
    return _Motor(angle, velocity + span * gained, command)


@internal
def optimise_commands(planner: Planner, push: FloatArray, load: float) -> None:
    """Replace a plan by the best for a motor with lag or a limited rate of command.

    Commands are constant between two knots. They minimise sum (angle - wanted)^2 +
    weight ((command - holding) / inertia)^2, where `holding` is the torque that holds
    the motor on the wanted path; their increments are within the rate limit. The load
    is linearised about the path of `push`: its slope is that of cables that stretch as
    a whole, since the steep slope of their ends does not last.

    `push` has accelerations (knots,) [rad/s^2], then the first command [N m], and is
    replaced; `load` is the torque of the cables at the motor at the start [N m].
    """
    tune, ahead, path = planner.tune, planner.ahead, planner.path
    n, span, inertia = path.size, tune[at.SPAN], tune[at.INERTIA]
    spring = tune[at.STIFFNESS] / tune[at.RATIO] ** 2
    vectors = planner.vectors
    x, trial, slope, move = vectors[0], vectors[1], vectors[2], vectors[3]
    most, base = vectors[4], vectors[5]
    weight = planner.tables.weight[int(ahead[at.BELIEVED_DELAY])]
    off = _Deviations(vectors[6], vectors[7], vectors[8], weight / inertia**2)
    start = _Motor(ahead[at.ANGLE], ahead[at.VELOCITY], ahead[at.MOTOR_TORQUE])
    motor, unit = start, _Motor(0.0, 0.0, 0.0)
    last, lasting, before = start.angle, load, ahead[at.COMMAND]
    for i in range(n):
        most[i] = tune[at.RATE] * (span if i > 0 else 0.5 * (span + tune[at.PERIOD]))
        mean = 0.5 * (lasting + planner.load[i])
        own = tune[at.DAMPING] * (path[i] - last) / span - ahead[at.DISTURBANCE]
        need = mean + own + inertia * push[i]
        x[i] = min(max(need - before, -most[i]), most[i])
        off.command[i] = ahead[at.COMMAND] - planner.holding[i] - own
        base[i] = mean - spring * 0.5 * (last + path[i]) - ahead[at.DISTURBANCE]
        motor = _motor_response(motor, ahead[at.COMMAND], base[i], tune)
        off.angle[i] = motor.angle - planner.wanted[i]
        unit = _motor_response(unit, 1.0, 0.0, tune)
        off.step[i] = unit.angle
        last, lasting, before = path[i], planner.load[i], need
    cost = _cost(off, x, slope)
    for _ in range(12):  # Newton steps
        for k in range(n):
            is_bound = (x[k] >= most[k] and slope[k] < 0.0) or (
                x[k] <= -most[k] and slope[k] > 0.0
            )
            move[k] = 0.0 if is_bound else slope[k]
            trial[k] = 0.0 if is_bound else 1.0
        _newton_step(off, trial, planner.matrix, move)
        share, found = 1.0, cost
        for _ in range(6):  # halvings of a step
            for k in range(n):
                trial[k] = min(max(x[k] - share * move[k], -most[k]), most[k])
            found = _cost(off, trial, slope)
            if found < cost:
                break
            share *= 0.5
        if not found < cost:
            break
        is_settled = cost - found < 1e-6 * cost
        cost = found
        x[:] = trial
        if is_settled:
            break
    command, motor = ahead[at.COMMAND], start
    for i in range(n):
        command += x[i]
        velocity = motor.velocity
        motor = _motor_response(motor, command, base[i], tune)
        push[i] = (motor.velocity - velocity) / span
    push[n] = ahead[at.COMMAND] + x[0]


@internal
def _cost(off: _Deviations, x: FloatArray, slope: FloatArray) -> float:
    """Return half of the cost of increments `x` [rad^2]; see `optimise_commands`.

    Its derivative by every increment is written to `slope`.
    """
    slope[:] = 0.0
    cost, above = 0.0, 0.0
    for i in range(x.size):
        error = off.angle[i]
        for k in range(i + 1):
            error += off.step[i - k] * x[k]
        above += x[i]
        cost += error * error + off.weight * (off.command[i] + above) ** 2
        for k in range(i + 1):
            slope[k] += error * off.step[i - k] + off.weight * (off.command[i] + above)
    return 0.5 * cost


@internal
def _newton_step(
    off: _Deviations, free: FloatArray, matrix: FloatMatrix, move: FloatArray
) -> None:
    """Replace the gradient `move` by the Newton step of the `free` increments."""
    n = free.size
    for k in range(n):
        for m in range(k + 1):
            total = off.weight * (n - k)
            for i in range(k, n):
                total += off.step[i - k] * off.step[i - m]
            matrix[k, m] = total
    solve_active(matrix, free, matrix, move)


@internal
def _predict(planner: Planner, joint: float, applied: FloatArray) -> float:
    """Advance `ahead` and `present` by past torques; return the model's joint [rad]."""
    cables, state, new = planner.cables, planner.present, planner.new
    tune, ahead, dt = planner.tune, planner.ahead, planner.tune[at.PERIOD]
    for k in range(applied.size):
        load = stepper.torque(cables, state, False, ahead[at.ANGLE])[0]
        force = applied[k] - load - tune[at.DAMPING] * ahead[at.VELOCITY]
        force += ahead[at.DISTURBANCE]
        ahead[at.VELOCITY] += dt * force / tune[at.INERTIA]
        ahead[at.ANGLE] += dt * ahead[at.VELOCITY]
        joint += ahead[at.JOINT + 1] + 0.5 * ahead[at.JOINT + 2]
        ahead[at.JOINT + 1] += ahead[at.JOINT + 2]
        ahead[at.DESIRED_TORQUE] += ahead[at.DESIRED_TORQUE + 1]
        stepper.move(cables, state, ahead[at.ANGLE], joint, dt, new, planner.work)
        state[:] = new
    return joint


@internal
def _anticipate_joint(memory: FloatArray, tune: FloatArray) -> None:
    """Adjust the predicted motion of the joint and its desired torque, in `memory`.

    A joint that has less torque than desired slows down; without a prediction of its
    recovery it would seem to reverse. The torque of a damper is subtracted from the
    desired one, which dissipates the surplus energy of the joint.
    """
    lacking = memory[at.DESIRED_TORQUE] - memory[at.FILTERED_TORQUE]
    sure = max(abs(lacking) - tune[at.NOISE], 0.0) * np.sign(lacking)
    memory[at.JOINT + 1] += tune[at.YIELDING] * sure * tune[at.PERIOD]
    rate = memory[at.JOINT + 1] / tune[at.PERIOD]
    damper = memory[at.ENERGY] / (tune[at.SPEND] * (rate * rate + tune[at.SLOW] ** 2))
    damper = min(max(damper, 0.0), tune[at.DAMPER])
    damper /= tune[at.PERIOD]
    memory[at.DESIRED_TORQUE] -= damper * memory[at.JOINT + 1]
    memory[at.DESIRED_TORQUE + 1] -= damper * memory[at.JOINT + 2]


@internal
def _extrapolated(ahead: FloatArray, joint: float, t: float) -> tuple[float, float]:
    """Return joint angle [rad] and desired torque [N m] `t` steps after `ahead`."""
    where = joint + ahead[at.JOINT + 1] * t + 0.5 * ahead[at.JOINT + 2] * t * t
    return where, ahead[at.DESIRED_TORQUE] + ahead[at.DESIRED_TORQUE + 1] * t


@internal
def _plan(
    planner: Planner, joint: float, sense: float, caution: float, push: FloatArray
) -> float:
    """Plan accelerations `push` [rad/s^2] of a motor that turns only in `sense`.

    They are followed by the first command [N m] if the rate of the command is too
    limited, else NaN. `caution` [N m], which decays, is taken off the desired torque.
    Return the mean squared torque error [(N m)^2], half of it on the planned path, half
    on the wanted one, to which the motor jumps. It is infinite if the plan might exceed
    the allowed iterations. `joint` is the joint's angle.
    """
    cables, tune, ahead, new = planner.cables, planner.tune, planner.ahead, planner.new
    gains = planner.tables.gains[int(ahead[at.BELIEVED_DELAY])]
    count, steps = planner.path.size, tune[at.SPAN] / tune[at.PERIOD]
    cautious, kept = caution, (1.0 - tune[at.CREEP]) ** steps
    cost = 0.0
    planner.rolled[:] = planner.present
    motor = ahead[at.ANGLE]
    for i in range(count):
        push[i] = gains[i, 0] * motor + gains[i, 1] * ahead[at.VELOCITY]
    drags = False
    for k in range(cables.n.size):
        for place in _RATE_TERMS:
            drags = drags or cables.prm[k, place] != 0.0
    search = rollout.MotorSearch(
        cables, planner.rolled, new, planner.leapt, planner.work, planner.spent,
        tune[at.SPAN], tune[at.STIFFNESS] / tune[at.RATIO], tune[at.TOLERANCE],
        tune[at.SLACK] if has_drag(cables.prm[0]) else 0.0, drags,
    )  # fmt: skip
    last = joint
    linearizations = 2 if tune[at.RATE] < np.inf else 0  # of the load
    most = rollout.MAX_EVALUATIONS * (2 if drags else 1) + (1 + linearizations) * count
    for i in range(count):
        if planner.spent[0] + most > tune[at.ITERATIONS]:
            return np.inf
        where, desired = _extrapolated(ahead, joint, (i + 1) * steps)
        cautious *= kept
        desired -= cautious
        motor = rollout.find_motor_angle(
            search, motor, sense, where, where - last, desired
        )
        planner.rolled[:] = new
        last = where
        cost += (rollout.joint_torque(cables, new, motor) - desired) ** 2
        for j in range(count):
            push[j] += gains[j, 2 + i] * motor
        planner.wanted[i] = motor
        planner.holding[i] = stepper.torque(cables, new, False, motor)[0]
    found = _simulate_plan(planner, joint, caution, cost, push)
    push[count] = np.nan
    if linearizations > 0:
        load = stepper.torque(cables, planner.present, False, ahead[at.ANGLE])[0]
        if not is_within(planner, push, load):
            for _ in range(linearizations):
                optimise_commands(planner, push, load)
                found = _simulate_plan(planner, joint, caution, cost, push)
    return 0.5 * found / count


@internal
def _simulate_plan(
    planner: Planner, joint: float, caution: float, cost: float, push: FloatArray
) -> float:
    """Return `cost` plus the squared torque errors of a plan `push` [(N m)^2].

    `path` and `load` of `planner` get the path of the motor and the load on it.
    """
    cables, tune, ahead, new = planner.cables, planner.tune, planner.ahead, planner.new
    count, span = planner.path.size, tune[at.SPAN]
    steps = span / tune[at.PERIOD]
    angle, velocity = ahead[at.ANGLE], ahead[at.VELOCITY]
    planner.rolled[:] = planner.present
    kept = (1.0 - tune[at.CREEP]) ** steps
    limit = max(abs(tune[at.LOW]), abs(tune[at.HIGH])) / tune[at.INERTIA]
    planner.spent[0] += count
    for i in range(count):
        push[i] = min(max(push[i], -limit), limit)
        angle += span * (velocity + 0.5 * span * push[i])
        velocity += span * push[i]
        where, desired = _extrapolated(ahead, joint, (i + 1) * steps)
        caution *= kept
        desired -= caution
        stepper.move(cables, planner.rolled, angle, where, span, new, planner.work)
        planner.rolled[:] = new
        cost += (rollout.joint_torque(cables, new, angle) - desired) ** 2
        planner.path[i] = angle
        planner.load[i] = stepper.torque(cables, new, False, angle)[0]
    return cost


@internal
def motor_torque(planner: Planner, seen: FloatArray) -> float:
    """Return the motor torque of one device, by measurements `seen` [N m].

    These are motor angle, joint angle [rad], joint torque and desired torque [N m].
    """
    cables, tune, own = planner.cables, planner.tune, planner.memory
    applied, ahead, dt = planner.applied, planner.ahead, planner.tune[at.PERIOD]
    watched = own[at.GUARD : at.FRICTION]
    guarded = guard.Guarded(tune, tune[at.STIFFNESS :], watched)
    read = watched[guard.SEEN :]
    read[guard.MOTOR], read[guard.MOTOR_SPEED] = seen[0], own[at.VELOCITY]
    read[guard.JOINT], read[guard.JOINT_SPEED] = seen[1], own[at.JOINT + 1] / dt
    read[guard.TORQUE], read[guard.DESIRED] = seen[2], seen[3]
    watched[guard.COMMAND] = applied[applied.size - 1]
    guard.admit(guarded, read)
    observer.replace_by_mean_torque(planner)
    if own[at.STARTED] == 0.0:
        planner.plan[:] = 0.0
    turned = observer.observe(planner, read)
    state = planner.other if own[at.BRISTLED] != 0.0 else planner.state
    observer.learn(planner, state)
    ahead[:] = own
    delay = int(own[at.BELIEVED_DELAY])
    planner.present[:] = state
    turned = _predict(planner, turned, applied[applied.size - delay :])
    _anticipate_joint(ahead, tune)
    before = ahead[at.DIRECTION]
    sense, best = 1.0 if before == 0.0 else before, planner.best
    last = best.size - 1
    own[at.CAUTION] *= 1.0 - tune[at.CREEP]
    planner.spent[0] = 0.0
    cost = _plan(planner, turned, sense, own[at.CAUTION], best)
    turning = 0.0 if before == 0.0 else tune[at.TURNING]
    if np.isinf(cost):
        # The last whole plan goes on, and ends at last.
        knot = int(planner.plan[last] * dt / tune[at.SPAN])
        best[0] = planner.plan[knot] if knot < last else 0.0
        best[last] = np.nan
    elif cost > turning:
        other = _plan(planner, turned, -sense, 0.0, planner.push)
        width = planner.wanted[planner.wanted.size - 1] - ahead[at.ANGLE]
        width *= tune[at.STIFFNESS] / tune[at.RATIO]
        if other + turning < cost:
            sense, best = -sense, planner.push
            own[at.CAUTION] = tune[at.CAUTION_SHARE] * width
    own[at.DIRECTION] = sense
    if not np.isinf(cost):
        planner.plan[:last] = best[:last]
        planner.plan[last] = 0.0
    planner.plan[last] += 1.0
    angle, velocity = ahead[at.ANGLE], ahead[at.VELOCITY]
    load = stepper.torque(cables, planner.present, False, angle)[0]
    angle += dt * (velocity + 0.5 * dt * best[0])
    turned += ahead[at.JOINT + 1] + 0.5 * ahead[at.JOINT + 2]
    stepper.move(cables, planner.present, angle, turned, dt, planner.new, planner.work)
    load = 0.5 * (load + stepper.torque(cables, planner.new, False, angle)[0])
    torque = load + tune[at.INERTIA] * best[0] + tune[at.DAMPING] * velocity
    torque -= ahead[at.DISTURBANCE]
    torque = command_for_torque(own[at.MOTOR_TORQUE], torque, tune)
    if not np.isnan(best[last]):
        torque = best[last]
    behind = velocity - tune[at.RATIO] * ahead[at.JOINT + 1] / dt
    if guard.state(guarded, behind, read[guard.DESIRED]) != guard.FREE:
        # Predictions from a failed sensor would drive the motor.
        behind = read[guard.MOTOR_SPEED] - tune[at.RATIO] * read[guard.JOINT_SPEED]
        late = dt * (1 + delay) + tune[at.LAG]
        damping = guard.RELEASE_TIME * tune[at.STIFFNESS] / tune[at.RATIO] ** 2
        damping = min(damping, guard.MAX_DAMPING_SHARE * tune[at.INERTIA] / late)
        torque = guard.let_go_torque(guarded, damping, behind)
    if not abs(torque) < np.inf:
        # Readings that contradict each other by far made the models diverge.
        guard.stop(watched, guard.LIMP)
        torque = 0.0
    torque = guard.bounded(guarded, torque)
    most = tune[at.RATE] * dt
    torque = min(max(torque, own[at.COMMAND] - most), own[at.COMMAND] + most)
    torque = min(max(torque, tune[at.LOW]), tune[at.HIGH])
    applied[: applied.size - 1] = applied[1:]
    applied[applied.size - 1] = torque
    if own[at.BRISTLED] != 0.0:
        observer.set_bristles(cables, 0.0)
    return float(torque)
