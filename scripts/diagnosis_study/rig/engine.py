"""The bench of every make: motor, pulleys and joint, and one trial of it.

    records = integrate(LAW, plant, pretension, asked, 1)

A make adds the law by which its cables move (`Law`), and the forms of what may be
hidden at both shafts. Shafts are advanced by symplectic Euler. Their state is one
array, indexed by the names below. Every hidden effect is off at its default.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.native import FloatArray, FloatMatrix, internal
from rig.nominal import Rig

MOTOR, MOTOR_SPEED, HUB, HUB_SPEED, JOINT, JOINT_SPEED = range(6)
"""Angles [rad] and speeds [rad/s]: motor, joint pulley (hub), handle (joint)."""
SLIP, PULLEY, TWIST, FOLLOWER, LAGGING, MOVED, TURNED, WORK_IN, WORK_OUT = range(6, 15)
ARC_A, ARC_B, SLOPE_A, SLOPE_B, STATES = range(15, 20)
"""Slip of the cables on the motor's pulley, its angle, twist of its shaft; followers of
the joint; what motor's and joint's pulley turned in the last step; their works; arc
wound onto the motor's pulley from angle 0, and its slope [m/rad], of cable a and of b,
opposite to it."""
RECORD_TIME = 2e-4  # time between two records [s]; a record is the mean over it
COMMAND_TIME = 1e-3  # time between two rows of a motion that is asked for [s]
ROWS = 5  # records per row
COLUMNS = (
    "motor_angle", "motor_torque", "joint_angle", "joint_torque", "joint_speed",
    "tension_a_proximal", "tension_b_proximal", "tension_a_distal", "tension_b_distal",
    "work_in", "work_out", "work_friction", "work_damping", "energy_stored",
)  # fmt: skip
"""Columns of the records. The works are integrals from the start [J]: of the cables on
the motor's pulley, of the cables on the joint's pulley, of all friction, of strand
damping; the energy is that of strain and motion of both cables."""
MEANS = 9  # so many columns are means; the others hold at the end of the record
NEAR_A, NEAR_B, FAR_A, FAR_B = range(5, MEANS)  # columns of the tensions at the ends


SHAFT_TIME = 1e-3  # damping of the motor's shaft over its stiffness [s]
GRIP = 4.0  # torque at which the cables begin to slip on the pulley [N m]
HUB_INERTIA = 2.5e-4  # of the joint pulley, where it is a body of its own [kg m^2]


class Bench(NamedTuple):
    """Constants of motor, pulleys and joint; SI and radians."""

    motor_radius: float
    joint_radius: float
    joint_inertia: float
    joint_damping: float
    rotor_inertia: float

    # --- what no builder gets rid of ----------------------------------------------
    shaft: float = 0.0  # compliance between motor and its pulley [rad/(N m)]
    teeth: float = 0.0  # amplitude of the transmission error of the gear [rad]
    teeth_order: float = 40.0
    teeth_phase: float = 0.0
    amplifier: float = 1e6  # torque limit of the motor [N m]

    # --- motor and its pulley -----------------------------------------------------
    cogging: float = 0.0  # amplitude of the torque of the motor's poles [N m]
    cogging_order: float = 14.0
    cogging_phase: float = 0.0
    overtone: float = 0.0  # order of its overtone; 0: a wave of parabolas
    overtone_share: float = 0.0
    motor_inertia: float = 0.0  # between torque sensor and pulley [kg m^2]
    eccentricity: float = 0.0  # first harmonic of the pulley's radius, relative
    offcentre: float = 0.0  # the same [m]
    oval: float = 0.0  # second harmonic over the first
    eccentric_phase: float = 0.0
    oval_phase: float = 0.0
    drum_growth: float = 0.0
    """Growth of the pulley's radius per angle that a cable is wound on, relative
    [1/rad]."""
    grip_slip: float = 0.0
    """Slip of the cables on the pulley, speed per excess torque [rad/(N m s)]."""

    # --- joint --------------------------------------------------------------------
    backlash: float = 0.0  # full gap between joint pulley and handle [rad]
    contact_stiffness: float = 2e4  # of the flanks [N m/rad]
    contact_damping: float = 1.5  # [N m s/rad]
    rounded: bool = False
    """Flanks that dent: torque by depth to the power 3/2, damping over the torque."""
    unbalance: float = 0.0  # unbalance of the joint pulley, m g l [N m]
    unbalance_phase: float = 0.0
    joint_stiffness: float = 0.0
    joint_stiffness_rest: float = 0.0
    hardening: float = 0.0  # growth of the stiffness by the square of the angle
    softening: float = 0.0  # angle beyond which the spring gives way, 0 for none [rad]
    extra_joint_inertia: float = 0.0
    bearing: float = 0.0  # friction of the joint pulley's bearing [N m]

    # --- what no library should know ----------------------------------------------
    mesh: float = 0.0  # ripple torque of a gear mesh at the joint [N m]
    mesh_order: float = 23.0
    mesh_phase: float = 0.0
    stop_stiffness: float = 0.0
    """Bumper that the joint pulley meets beyond `stop_angle` [N m/rad]."""
    stop_angle: float = 0.6
    catch: float = 0.0
    """Largest torque of a ball that the joint pulley catches at one angle [N m]."""
    catch_angle: float = 0.0
    felt: float = 0.0  # stiffness of a band with play of its own [N m/rad]
    felt_play: float = 0.15
    putty: float = 0.0  # stiffness of a band that relaxes [N m/rad]
    putty_time: float = 0.5

    # --- pretension ---------------------------------------------------------------
    pretension_loss: float = 0.0  # part that is lost in the end, or in 8 s
    loss_time: float = 3.0
    fast_loss: float = 0.0  # share of it that is lost with a time of 0.8 s
    creeping: bool = False  # lost with the logarithm of time


def bench_of(rig: Rig, **forms: float) -> Bench:
    """Return the bench of a rig in which nothing is hidden."""
    names = Bench._fields[: len(Bench._fields) - len(Bench._field_defaults)]
    return Bench(*(getattr(rig, name) for name in names))._replace(**forms)


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
    now: FloatArray  # what a step shows (`MEANS`,), the tensions of the ends with it
    pretension: float  # tension of both cables at rest [N]
    ties: FloatArray  # stiffness and damping, of servo and of environment (4,)
    path: FloatMatrix  # angle and speed asked for, of motor and of handle (m + 1, 4)
    steps: int  # per record
    dt: float  # duration of a step [s]
    records: FloatMatrix  # out, see `COLUMNS`


class Law(NamedTuple):
    """Law by which the cables of a make move."""

    # (plant, pretension, arcs) -> cables at rest
    start: Callable[[Any, float, tuple[float, float]], Any]
    # (plant, cables, run) -> whether the cables were found at every step
    run: Callable[[Any, Any, Run], bool]
    steps: Callable[[Any], int]  # plant -> steps per record that it needs


def at_rest(b: Bench, pretension: float, asked: Asked, steps: int) -> Run:
    """Return a trial that has not begun; `steps` are those per record."""
    count = (asked.command.shape[0] - 1) * ROWS
    dt = RECORD_TIME / steps
    run = Run(
        np.zeros(STATES), np.full(MEANS, pretension),
        pretension, np.concatenate([asked.servo, asked.environment]),
        np.concatenate([asked.command, asked.target], axis=1), steps, dt,
        np.zeros((count, len(COLUMNS))),
    )  # fmt: skip
    angle = float(asked.command[0, 0])
    run.shafts[[MOTOR, HUB, JOINT, PULLEY, LAGGING]] = angle
    run.shafts[SLIP] = b.teeth * math.sin(b.teeth_order * angle - b.teeth_phase)
    wind(b, run)
    return run


def integrate(
    law: Law, p: Any, pretension: float, asked: Asked, refine: int
) -> NDArray[np.float64]:
    """Run one trial; return (5 m, 14) records, see `COLUMNS`.

    Both cables have the pretension [N] at rest; every step is shortened by `refine`, a
    whole number.
    """
    steps = law.steps(p) * refine
    for _ in range(4):  # halved where the cables are not found
        trial = at_rest(p.bench, pretension, asked, steps)
        arcs = float(trial.shafts[ARC_A]), float(-trial.shafts[ARC_B])
        if law.run(p, law.start(p, pretension, arcs), trial):
            return trial.records
        steps *= 2
    raise ValueError("the nodes of a cable are not found; shorten the step")


@internal
def arc(b: Bench, angle: float, side: float) -> tuple[float, float]:
    """Return the arc wound onto the motor's pulley from angle 0, and its slope [m/rad].

    `side` is 1 for cable a and -1 for cable b, which leaves the pulley opposite: half a
    turn on, so that odd harmonics change their sign.
    """
    radius = b.motor_radius
    slope = radius * (1.0 + side * b.drum_growth * angle)
    length = 0.5 * (radius + slope) * angle
    if b.eccentricity != 0.0 or b.offcentre != 0.0:
        e = b.offcentre + radius * b.eccentricity
        one, two = angle - b.eccentric_phase, 2.0 * (angle - b.oval_phase)
        length += side * e * (math.sin(one) + math.sin(b.eccentric_phase))
        length += 0.5 * b.oval * e * (math.sin(two) + math.sin(2.0 * b.oval_phase))
        slope += side * e * math.cos(one) + b.oval * e * math.cos(two)
    return length, slope


@internal
def wind(b: Bench, run: Run) -> None:
    """Bring up to date what the motor's pulley has wound."""
    shafts = run.shafts
    shafts[ARC_A], shafts[SLOPE_A] = arc(b, shafts[PULLEY], 1.0)
    shafts[ARC_B], shafts[SLOPE_B] = arc(b, shafts[PULLEY], -1.0)


@internal
def tension_at_rest(b: Bench, pretension: float, time: float) -> float:
    """Return the tension of a cable that is not stretched, after `time` [s] [N]."""
    if b.pretension_loss == 0.0:
        return pretension
    if b.creeping:
        late = math.log1p(time / b.loss_time) / math.log1p(8.0 / b.loss_time)
        return pretension * (1.0 - b.pretension_loss * late)
    fast, slow = math.exp(-time / 0.8), math.exp(-time / b.loss_time)
    left = b.fast_loss * fast + (1.0 - b.fast_loss) * slow
    return pretension * (1.0 - b.pretension_loss * (1.0 - left))


@internal
def torques(run: Run, step: int) -> tuple[float, float]:
    """Return the torques of servo and environment at the beginning of a step [N m]."""
    per_row = ROWS * run.steps
    at = step // per_row
    part = (step - at * per_row) / per_row
    return _tied(run, 0, MOTOR, at, part), _tied(run, 2, JOINT, at, part)


@internal
def _tied(run: Run, of: int, shaft: int, at: int, part: float) -> float:
    """Return the torque of a spring and damper that tie a shaft to a motion."""
    path, shafts = run.path, run.shafts
    angle = path[at, of] + part * (path[at + 1, of] - path[at, of])
    speed = path[at, of + 1] + part * (path[at + 1, of + 1] - path[at, of + 1])
    push = run.ties[of] * (angle - shafts[shaft])
    return push + run.ties[of + 1] * (speed - shafts[shaft + 1])


@internal
def turn_shafts(b: Bench, run: Run, drive: float, hold: float, back: float) -> None:
    """Turn both shafts by a step, under the tensions that the cables have.

    `drive` is the torque of the motor and `hold` that of the environment [N m]. What is
    seen of the angles are those `back` steps before the end of the step.
    """
    shafts, now, dt = run.shafts, run.now, run.dt
    pull = _pulled(run)
    given = b.joint_radius * (run.now[FAR_A] - run.now[FAR_B])
    if b.grip_slip != 0.0 and abs(pull) > GRIP:
        excess = pull - math.copysign(GRIP, pull)
        shafts[SLIP] += b.grip_slip * excess * dt
    load = pull
    if b.cogging != 0.0:
        load += b.cogging * _cogs(b, b.cogging_order * shafts[MOTOR] - b.cogging_phase)
    drive = min(max(drive, -b.amplifier), b.amplifier)
    rate = _turn(shafts, MOTOR, drive - load, b.rotor_inertia + b.motor_inertia, dt)
    before, hub = shafts[PULLEY], shafts[HUB]
    shafts[TWIST] += dt / SHAFT_TIME * (pull * b.shaft - shafts[TWIST])
    shafts[PULLEY] = shafts[MOTOR] - shafts[SLIP] - shafts[TWIST]
    if b.teeth != 0.0:
        turn = b.teeth_order * shafts[MOTOR] - b.teeth_phase
        shafts[PULLEY] += b.teeth * math.sin(turn)
    wind(b, run)
    now[1] = load + b.motor_inertia * rate
    net = given - _taken(b, shafts)
    now[3] = _turn_joint(
        b, shafts, net, hold - b.joint_damping * shafts[JOINT_SPEED], dt
    )
    now[0] = shafts[MOTOR] - back * dt * shafts[MOTOR_SPEED]
    now[2] = shafts[JOINT] - back * dt * shafts[JOINT_SPEED]
    now[4] = shafts[JOINT_SPEED]
    angle = shafts[HUB]
    # Follows behind a play, which is what a hysteresis of form is.
    shafts[FOLLOWER] += angle - hub
    shafts[FOLLOWER] = min(max(shafts[FOLLOWER], -b.felt_play), b.felt_play)
    shafts[LAGGING] += dt / b.putty_time * (angle - shafts[LAGGING])
    shafts[MOVED], shafts[TURNED] = shafts[PULLEY] - before, angle - hub
    shafts[WORK_IN] += 0.5 * pull * shafts[MOVED]
    shafts[WORK_OUT] += 0.5 * given * shafts[TURNED]


@internal
def balance(b: Bench, run: Run) -> None:
    """Count the works of the last step with the tensions after it."""
    shafts = run.shafts
    given = b.joint_radius * (run.now[FAR_A] - run.now[FAR_B])
    shafts[WORK_IN] += 0.5 * _pulled(run) * shafts[MOVED]
    shafts[WORK_OUT] += 0.5 * given * shafts[TURNED]


@internal
def _pulled(run: Run) -> float:
    """Return the torque of the cables on the motor's pulley [N m]."""
    shafts, now = run.shafts, run.now
    return shafts[SLOPE_A] * now[NEAR_A] - shafts[SLOPE_B] * now[NEAR_B]


@internal
def _cogs(b: Bench, phase: float) -> float:
    """Return the torque of the motor's poles over its amplitude."""
    if b.overtone == 0.0:
        part = (phase / math.pi) % 2.0
        if part < 1.0:
            return 4.0 * part * (1.0 - part)
        return -4.0 * (part - 1.0) * (2.0 - part)
    return math.sin(phase) + b.overtone_share * math.sin(b.overtone * phase)


@internal
def _taken(b: Bench, shafts: FloatArray) -> float:
    """Return the torque that what sits on the joint pulley takes."""
    angle = shafts[HUB]
    load = b.unbalance * math.sin(angle - b.unbalance_phase)
    off = angle - b.joint_stiffness_rest
    if b.softening != 0.0:
        load += b.joint_stiffness * b.softening * math.tanh(off / b.softening)
    else:
        load += b.joint_stiffness * off * (1.0 + b.hardening * off * off)
    if b.bearing != 0.0:
        load += b.bearing * math.tanh(shafts[HUB_SPEED] / 0.01)
    if b.mesh != 0.0:
        load += b.mesh * math.sin(b.mesh_order * angle - b.mesh_phase)
    if b.stop_stiffness != 0.0 and angle > b.stop_angle:
        load += b.stop_stiffness * (angle - b.stop_angle)
    if b.catch != 0.0:
        near = (angle - b.catch_angle) / 0.08
        load += b.catch * near * math.exp(0.5 * (1.0 - near * near))
    load += b.felt * shafts[FOLLOWER]
    return load + b.putty * (angle - shafts[LAGGING])


@internal
def _turn(
    shafts: FloatArray, shaft: int, push: float, inertia: float, dt: float
) -> float:
    """Advance a shaft by `dt` [s] under a torque [N m]; return its acceleration."""
    rate = push / inertia
    shafts[shaft + 1] += rate * dt
    shafts[shaft] += shafts[shaft + 1] * dt
    return rate


@internal
def _turn_joint(
    b: Bench, shafts: FloatArray, net: float, hold: float, dt: float
) -> float:
    """Advance joint pulley and handle by `dt` [s]; return the sensor's torque [N m].

    The sensor sits between pulley and handle, so other loads of the pulley (unbalance,
    spring, extra inertia) are on the side of the transmission. `net` is the torque on
    the pulley without the handle's, `hold` that on the handle without the pulley's.
    They are one body where they have no play.
    """
    extra = b.extra_joint_inertia
    if b.backlash == 0.0:
        rate = _turn(shafts, JOINT, net + hold, b.joint_inertia + extra, dt)
        shafts[HUB] = shafts[JOINT]
        shafts[HUB_SPEED] = shafts[JOINT_SPEED]
        return net - extra * rate
    across = _through_play(b, shafts)
    _turn(shafts, HUB, net - across, HUB_INERTIA + extra, dt)
    _turn(shafts, JOINT, across + hold, b.joint_inertia - HUB_INERTIA, dt)
    return across


@internal
def _through_play(b: Bench, shafts: FloatArray) -> float:
    """Return the torque of the pulley on the handle by play with elastic flanks."""
    ahead = shafts[HUB] - shafts[JOINT]
    over = abs(ahead) - 0.5 * b.backlash
    if over <= 0.0:
        return 0.0
    side = math.copysign(1.0, ahead)
    rate = side * (shafts[HUB_SPEED] - shafts[JOINT_SPEED])
    if b.rounded:
        push = b.contact_stiffness * over**1.5
        return side * push * max(1.0 + b.contact_damping * rate, 0.0)
    return side * max(b.contact_stiffness * over + b.contact_damping * rate, 0.0)


@internal
def record(run: Run, step: int, part: float) -> None:
    """Add what a step shows to its record, and what is left of `part` to the last."""
    own = run.records[step // run.steps]
    last = run.records[max(step - 1, 0) // run.steps]
    # The first sample has no record before it, the last none behind it.
    final = step + 1 == run.records.shape[0] * run.steps
    for k in range(MEANS):
        share = run.now[k] / run.steps
        own[k] += share if final else part * share
        if step > 0:
            last[k] += (1.0 - part) * share


@internal
def close(run: Run, step: int, rubbed: float, damped: float, stored: float) -> None:
    """Write works of friction and damping and the stored energy at a record's end."""
    row = run.records[step // run.steps]
    row[9], row[10] = run.shafts[WORK_IN], run.shafts[WORK_OUT]
    row[11], row[12], row[13] = rubbed, damped, stored


class Row(NamedTuple):
    """Terms of the balance of the nodes of a cable, without mass or with it."""

    slope: FloatArray  # derivative of the tension by the stretch (nodes + 1,) [N/m]
    left: FloatArray  # residual force (nodes,) [N]
    low: FloatArray  # negative derivative of `left` by the previous node's place [N/m]
    mid: FloatArray  # negative derivative by the node's own place [N/m]
    high: FloatArray  # negative derivative by the next node's place [N/m]
    force: FloatArray  # force of friction and dampers [N]
    held: FloatArray  # friction over load
    dry: FloatArray  # load-independent friction [N]
    old: FloatArray  # place a step ago [m]
    other: FloatArray  # of the make


@internal
def row_of(room: FloatMatrix) -> Row:
    """Return the terms that a work space (10, nodes + 1) has room for."""
    # A tuple of its own would be more than functions may take from Python.
    n = room.shape[1] - 1
    return Row(
        room[0], room[1, :n], room[2, :n], room[3, :n], room[4, :n], room[5, :n],
        room[6, :n], room[7, :n], room[8, :n], room[9, :n],
    )  # fmt: skip


@internal
def solve(low: FloatArray, mid: FloatArray, high: FloatArray, left: FloatArray) -> None:
    """Solve a tridiagonal system in place of its right side (Thomas)."""
    n = mid.size
    for i in range(1, n):
        part = low[i] / mid[i - 1]
        mid[i] -= part * high[i - 1]
        left[i] -= part * left[i - 1]
    left[n - 1] /= mid[n - 1]
    for i in range(n - 2, -1, -1):
        left[i] = (left[i] - high[i] * left[i + 1]) / mid[i]


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
