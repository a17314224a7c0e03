"""Commands of a motor that lags, or whose command may not change fast enough.

A motor whose torque lags follows its command by lag dtau/dt + tau = command. The plan
is that of a motor without lag, and the command leads its torque. Where the rate of the
command is too limited for that, the plan minimises a cost of commands over increments
within the limit: D. Bertsekas, "Projected Newton methods for optimization problems with
simple constraints", SIAM J. Control and Optimization 20, 1982.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.control._planner_memory import (
    ANGLE,
    COMMAND,
    DISTURBANCE,
    MOTOR_TORQUE,
    VELOCITY,
    PlannerWorkspace,
)
from cc_mujoco.control._planner_parameters import (
    DAMPING,
    INERTIA,
    LAG,
    PERIOD,
    RATE,
    RATIO,
    SPAN,
    STIFFNESS,
)
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal

_NEWTON_STEPS, _HALVINGS, _LINEARIZATIONS = 12, 6, 2
"""Most Newton steps of a plan of commands, halvings of a step, and linearisations of
the load."""
_COST_TOLERANCE = 1e-6
"""Relative change of the cost at which a plan of commands has converged."""


@internal
def command_for_torque(before: float, wanted: float, tune: FloatArray) -> float:
    """Return the command for which a motor that lags has a mean torque [N m].

    The mean is over the time between two knots, although the next step gives another
    command: to compensate the lag within a step would swing from step to step, and
    multiply the noise. `before` is the present torque of the motor, `wanted` the mean
    torque [N m].
    """
    lag, span = tune[LAG], tune[SPAN]
    if lag == 0.0:
        return wanted
    kept = -np.expm1(-span / lag) * lag / span
    return float(before + (wanted - before) / (1.0 - kept))


@internal
def is_within(
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
