"""One trial of a rig: the code that all makes share; each has its cable law.

    records = integrate(LAW, plant, pretension, asked, 1)

Shafts are advanced by symplectic Euler. Their state is one array, indexed by the names
below.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.native import FloatArray, FloatMatrix, internal

MOTOR, MOTOR_SPEED, HUB, HUB_SPEED, JOINT, JOINT_SPEED, SLIP = range(7)
"""Angles [rad] and speeds [rad/s]: motor, joint pulley (hub), handle (joint); slip of
the cables on the motor pulley [rad]."""
RECORD_TIME = 2e-4  # time between two records [s]; a record is the mean over it
COMMAND_TIME = 1e-3  # time between two rows of a motion that is asked for [s]
COLUMNS = (
    "motor_angle", "motor_torque", "joint_angle", "joint_torque", "joint_speed",
    "tension_a_proximal", "tension_b_proximal", "tension_a_distal", "tension_b_distal",
    "work_in", "work_out", "work_friction", "work_damping", "energy_stored",
)  # fmt: skip
"""Columns of the records. The works are integrals from the start [J]: of the cables on
the motor's pulley, of the cables on the joint's pulley, of all friction, of strand
damping; the energy is that of strain and motion of both cables."""
MEANS = 9  # so many columns are means; the others hold at the end of the record


class Asked(NamedTuple):
    """Commanded motions of motor and environment, and the springs that impose them."""

    servo: FloatArray  # (2,) stiffness and damping of the motor's position loop
    # (2,) stiffness and damping that tie the handle to `target`
    environment: FloatArray
    # (m + 1, 2) angle and speed asked of the motor, every `COMMAND_TIME`
    command: FloatMatrix
    target: FloatMatrix  # (m + 1, 2) the same of the environment


class Run(NamedTuple):
    """State and settings of one trial, as a cable law steps it."""

    shafts: FloatArray  # their state
    now: FloatArray  # means of a step (`MEANS`,), work space
    pretension: float  # tension of both cables at rest [N]
    asked: Asked
    steps: int  # per record
    per_command: int  # steps per row of `asked`
    dt: float  # duration of a step [s]
    records: FloatMatrix  # out, see `COLUMNS`


class Law(NamedTuple):
    """Law by which the cables of a make move."""

    # (plant, angle, side) -> arc wound onto the motor pulley from angle 0 and its slope
    # [m/rad]; `side` is 1 for cable a and -1 for b, opposite to it
    arc: Callable[[Any, float, float], tuple[float, float]]
    # (plant, pretension, arcs) -> cables at rest
    start: Callable[[Any, float, tuple[float, float]], Any]
    # (plant, cables, run) -> whether the cables were found at every step
    run: Callable[[Any, Any, Run], bool]
    steps: Callable[[Any], int]  # plant -> steps per record that it needs


def integrate(
    law: Law, p: Any, pretension: float, asked: Asked, refine: int
) -> NDArray[np.float64]:
    """Run one trial; return (5 m, 14) records, see `COLUMNS`.

    Both cables have the pretension [N] at rest; every step is shortened by `refine`, a
    whole number.
    """
    angle = float(asked.command[0, 0])
    arcs = law.arc(p, angle, 1.0)[0], -law.arc(p, angle, -1.0)[0]
    count = (asked.command.shape[0] - 1) * round(COMMAND_TIME / RECORD_TIME)
    steps = law.steps(p) * refine
    for _ in range(4):  # halved where the cables are not found
        dt = RECORD_TIME / steps
        trial = Run(
            np.zeros(7), np.zeros(MEANS), pretension, asked, steps,
            round(COMMAND_TIME / dt), dt, np.zeros((count, len(COLUMNS))),
        )  # fmt: skip
        trial.shafts[[MOTOR, HUB, JOINT]] = angle
        if law.run(p, law.start(p, pretension, arcs), trial):
            return trial.records
        steps *= 2
    raise ValueError("the nodes of a cable are not found; shorten the step")


@internal
def torques(run: Run, step: int) -> tuple[float, float]:
    """Return the torques of servo and environment at the beginning of a step [N m]."""
    asked, shafts, per_command = run.asked, run.shafts, run.per_command
    at = step // per_command
    part = (step - at * per_command) / per_command
    motor, motor_speed = shafts[MOTOR], shafts[MOTOR_SPEED]
    joint, joint_speed = shafts[JOINT], shafts[JOINT_SPEED]
    drive = _tied(asked.servo, asked.command, at, part, motor, motor_speed)
    hold = _tied(asked.environment, asked.target, at, part, joint, joint_speed)
    return drive, hold


@internal
def _tied(
    tie: FloatArray, path: FloatMatrix, at: int, part: float, x: float, v: float
) -> float:
    """Return the torque of a spring and damper that tie a shaft to a motion."""
    angle = path[at, 0] + part * (path[at + 1, 0] - path[at, 0])
    speed = path[at, 1] + part * (path[at + 1, 1] - path[at, 1])
    return tie[0] * (angle - x) + tie[1] * (speed - v)


@internal
def turn(
    shafts: FloatArray, shaft: int, push: float, inertia: float, dt: float
) -> float:
    """Advance a shaft by `dt` [s] under a torque [N m]; return its acceleration."""
    rate = push / inertia
    shafts[shaft + 1] += rate * dt
    shafts[shaft] += shafts[shaft + 1] * dt
    return rate


@internal
def turn_joint(
    shafts: FloatArray,
    net: float,
    hold: float,
    across: float,
    inertia: float,
    hub: float,
    extra: float,
    dt: float,
) -> float:
    """Advance joint pulley and handle by `dt` [s]; return the sensor's torque [N m].

    The sensor sits between pulley and handle, so other loads of the pulley (unbalance,
    spring, extra inertia) are on the side of the transmission. `net` is the torque on
    the pulley without the handle's, `hold` that on the handle without the pulley's,
    `across` that between them through play; `hub` is the inertia of the pulley alone, 0
    where they are one body.
    """
    if hub == 0.0:
        rate = turn(shafts, JOINT, net + hold, inertia + extra, dt)
        shafts[HUB] = shafts[JOINT]
        shafts[HUB_SPEED] = shafts[JOINT_SPEED]
        return net - extra * rate
    turn(shafts, HUB, net - across, hub + extra, dt)
    turn(shafts, JOINT, across + hold, inertia - hub, dt)
    return across


@internal
def through_play(
    shafts: FloatArray, play: float, stiffness: float, damping: float
) -> float:
    """Return the torque of the pulley on the handle by play with elastic flanks."""
    ahead = shafts[HUB] - shafts[JOINT]
    over = abs(ahead) - 0.5 * play
    if over <= 0.0:
        return 0.0
    side = math.copysign(1.0, ahead)
    rate = side * (shafts[HUB_SPEED] - shafts[JOINT_SPEED])
    return side * max(stiffness * over + damping * rate, 0.0)


@internal
def see(
    now: FloatArray,
    motor: tuple[float, float],
    joint: tuple[float, float, float],
    near: tuple[float, float],
    far: tuple[float, float],
) -> None:
    """Write to `now` (`MEANS`,) the quantities that records average over steps."""
    now[0], now[1] = motor
    now[2], now[3], now[4] = joint
    now[5], now[6] = near
    now[7], now[8] = far


@internal
def add(row: FloatArray, now: FloatArray, share: float) -> None:
    """Add `now`, weighted by `share`, to the sums of a record."""
    for k in range(MEANS):
        row[k] += share * now[k]


@internal
def close(
    row: FloatArray, steps: int, works: tuple[float, float, float, float]
) -> None:
    """Divide the sums of a record by `steps`, and write the four works [J]."""
    for k in range(MEANS):
        row[k] /= steps
    row[9], row[10], row[11], row[12] = works


@internal
def total(values: FloatArray) -> float:
    whole = 0.0
    for i in range(values.size):
        whole += values[i]
    return whole


@internal
def copy(source: FloatArray, target: FloatArray) -> None:
    for i in range(source.size):
        target[i] = source[i]
