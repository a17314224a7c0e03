"""An episode inside MuJoCo's own steps: task, controller and record, compiled.

A batch that comes back to Python at every control step spends more time there, and on
fetching every simulation into the cache anew, than on physics. Where task and
controller are known as compiled code, a plugin of the models calls them when a step
ends, and a simulation goes through its episode in one go.

`advance` is called when a step has new positions and velocities and still the forces
that acted in it, which is what a control step of an environment reads. The formulas are
those of `human._tasks` and `control._compiled_laws`; here is only where their arguments
lie.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Annotated, Any

import mujoco
import numpy as np

from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.control import _compiled_laws as compiled_laws
from cc_mujoco.control._cable_model import follow
from cc_mujoco.control._compensation import SCRATCH_ROWS
from cc_mujoco.control._guard import SPRING_SIZE
from cc_mujoco.human._tasks import clamp, spring_torque, tunnel_torque
from cc_mujoco.native import FloatArray, internal
from cc_mujoco.native import _library as native_library
from cc_mujoco.plugin import _mj_struct as mj_struct
from cc_mujoco.plugin._engine import LIBRARY
from cc_mujoco.plugin._ffi import (
    CInt,
    callback,
    float_rows,
    floats,
    load_real,
    load_word,
    reinterpret,
    store_real,
    words,
)
from cc_mujoco.plugin._registration import add_plugin

PLUGIN = "cc_mujoco.episode"

UNPOWERED, FEED_FORWARD, FEEDBACK, TUNED, MODEL, STICTION = range(6)
"""Laws that drive the motor."""

OF_PHASE, TUNNEL, SPRING = range(3)
"""Tasks: of the phase alone, whose torques are known in advance; `Tunnel`; `Spring`."""

KEPT = (
    "motor_angle_rad",
    "motor_velocity_rad_s",
    "motor_torque_nm",
    "joint_angle_rad",
    "joint_velocity_rad_s",
    "joint_torque_nm",
    "wearer_torque_nm",
    "desired_torque_nm",
)
"""Columns that are kept of every control step, before those of each cable."""
PER_CABLE = 4
"""Columns of each cable: tension at both ends, energy that friction took, least
tension."""

RECORD = np.dtype(
    [
        (name, np.int64)
        for name in (
            "law",
            "task",
            "skip",  # physics steps in a control step
            "steps",  # control steps in the episode
            "count",  # physics steps that have been done
            "refused",  # 1 where the controller gave no finite torque at this step
            "motor_control",
            "scripted",  # number of controls that follow the script
            "script_controls",  # address of their places
            "commands",  # address of (physics steps + 1, scripted)
            "desired",  # address of the torques of a task of the phase (steps + 1,)
            "task_parameters",  # address of those of `Tunnel` or `Spring`
            "motor_q",
            "motor_v",
            "joint_q",
            "joint_v",
            "motor_out",
            "wearer_out",
            "cables",  # number
            "readings",  # address of (cables, 5): first node in `plugin_state`, number
            # of nodes, energy, and both ends in `actuator_force`
            "wound",  # number of arms of the winding; 0 for a round pulley
            "arms",  # address of the places of the arms, then of their velocities
            "own_arm",  # place of the joint's among them
            "wound_end",  # place of the distal end in `actuator_length`
            "columns",  # address of what is kept (columns, steps + 1)
            "gains",  # address of `_compiled_laws.GAINS`; likewise those that follow
            "memory",
            "spring",  # of all cables at the joint, see `guard.STIFFNESS`
            "seen",
            "model_cables",  # number; then addresses of arrays of `CableModel`
            "segments",
            "proximal",
            "distal",
            "packed",
            "packed_size",
            "state",
            "state_size",
            "joint",
            "slip_direction",
            "gain",
            "arm",
            "new",
            "work",
            "work_size",
            "scratch",
        )
    ]
    + [
        (name, np.float64)
        for name in (
            "motor_gear",
            "motor_scale",  # control of the motor at its largest torque
            "torque_limit",  # largest torque of the motor [N m]
            "winding_arm",  # arm of the winding in the neutral pose [m/rad]
            "wound_length",  # length of the distal end there [m]
            "timestep",  # of the physics [s]
            "least_leverage",
        )
    ]
)
"""Record of a simulation. `userdata[0]` of the simulation holds its address; 0 is none,
which is also what MuJoCo makes of it when a simulation diverges."""

_FIXED, _PER_CABLE = len(KEPT), PER_CABLE
_GAINS, _SEEN, _MEMORY = (
    len(compiled_laws.GAINS),
    len(compiled_laws.LAW_INPUTS),
    compiled_laws.MEMORY_SIZE,
)
_PERIOD = compiled_laws.PERIOD
_tunnel, _spring = internal(tunnel_torque), internal(spring_torque)


EpisodeRecord = Annotated[Any, ("EpisodeRecord", RECORD)]
"""A simulation's `RECORD`."""


@reinterpret
def _record(address: int) -> EpisodeRecord:
    """Return the record at an address."""
    memory = (ctypes.c_byte * RECORD.itemsize).from_address(address)
    return np.frombuffer(memoryview(memory), RECORD).view(np.recarray)[0]


@internal
def _desired(record: EpisodeRecord, step: int, angle: float) -> float:
    """Return the task's desired torque at a control step [N m]."""
    if record.task == OF_PHASE:
        return load_real(record.desired + 8 * step)
    given = floats(record.task_parameters, 3)
    if record.task == TUNNEL:
        return float(_tunnel(angle, given[0], given[1], given[2]))
    return float(_spring(angle, given[0]))


@internal
def _winding(
    record: EpisodeRecord, data: int, angle: float, velocity: float
) -> tuple[float, float, float]:
    """Return angle, velocity and leverage of the joint; see `Winding.read`."""
    count = record.wound
    if count == 0:
        return angle, velocity, 1.0
    arms, nominal = words(record.arms, 2 * count), record.winding_arm
    pace = 0.0
    for i in range(count):
        arm = mj_struct.real(data, mj_struct.ACTUATOR_MOMENT, arms[i])
        pace = pace + arm * mj_struct.real(data, mj_struct.QVEL, arms[count + i])
    arm = mj_struct.real(data, mj_struct.ACTUATOR_MOMENT, arms[record.own_arm])
    end = mj_struct.real(data, mj_struct.ACTUATOR_LENGTH, record.wound_end)
    wound = (end - record.wound_length + record.timestep * pace) / nominal
    return wound, pace / nominal, max(arm / nominal, record.least_leverage)


@internal
def _torque(record: EpisodeRecord, seen: FloatArray) -> float:
    """Return the torque of the motor [N m]."""
    law = record.law
    if law == UNPOWERED:
        return 0.0
    gains = floats(record.gains, _GAINS)
    if law == FEED_FORWARD:
        return float(compiled_laws.feed_forward(gains, seen[compiled_laws.DESIRED]))
    memory, spring = floats(record.memory, _MEMORY), floats(record.spring, SPRING_SIZE)
    compiled_laws.admit(gains, spring, memory, seen)
    if law == FEEDBACK:
        return float(compiled_laws.guarded_torque(gains, spring, memory, seen))
    if law == TUNED:
        ahead = compiled_laws.feed_forward(gains, seen[compiled_laws.DESIRED])
        return float(compiled_laws.damped_feedback(gains, spring, memory, seen, ahead))
    count, width, size = record.model_cables, record.packed_size, record.state_size
    prm = float_rows(record.packed, count, width)
    state = float_rows(record.state, count, size)
    new = float_rows(record.new, count, size)
    n = words(record.segments, count)
    proximal, distal = floats(record.proximal, count), floats(record.distal, count)
    slip_direction = floats(record.slip_direction, count)
    gain, arm = floats(record.gain, count), floats(record.arm, count)
    joint, work = floats(record.joint, 1), floats(record.work, record.work_size)
    scratch = float_rows(record.scratch, SCRATCH_ROWS, count)
    cables = stepper.Cables(prm, n, proximal, proximal, distal)
    joint[0] = follow(
        cables,
        state,
        seen[compiled_laws.ANGLE],
        seen[compiled_laws.TORQUE],
        joint[0],
        slip_direction,
        gain,
        arm,
        gains[_PERIOD],
        new,
        work,
    )
    if law == MODEL:
        found = compiled_laws.model_based(
            gains, spring, prm, n, distal, arm, state, slip_direction, gain, 0.0,
            memory, seen, scratch,
        )  # fmt: skip
    else:
        found = compiled_laws.stiction(
            gains, spring, prm, n, distal, arm, state, memory, seen, scratch
        )
    return float(found)


@internal
def _observe(record: EpisodeRecord, data: int, step: int, seen: FloatArray) -> None:
    """Read and keep what is measured at a control step; see `AxisModel.read_motion`."""
    cables, rows = record.cables, record.steps + 1
    columns = floats(record.columns, (_FIXED + _PER_CABLE * cables) * rows)
    joint = record.joint_v
    wearer = mj_struct.force(data, record.wearer_out)
    springs = mj_struct.real(data, mj_struct.QFRC_SPRING, joint)
    springs = springs + mj_struct.real(data, mj_struct.QFRC_DAMPER, joint)
    pieces = mj_struct.real(data, mj_struct.QFRC_PASSIVE, joint) - springs
    angle = mj_struct.real(data, mj_struct.QPOS, record.joint_q)
    velocity = mj_struct.real(data, mj_struct.QVEL, joint)
    turned = mj_struct.real(data, mj_struct.QPOS, record.motor_q)
    speed = mj_struct.real(data, mj_struct.QVEL, record.motor_v)
    given = mj_struct.force(data, record.motor_out)
    torque = mj_struct.real(data, mj_struct.QFRC_ACTUATOR, joint) - wearer + pieces
    desired = _desired(record, step, angle)
    kept = (
        turned, speed, given * record.motor_gear, angle, velocity, torque, wearer,
        desired,
    )  # fmt: skip
    for i in range(_FIXED):
        columns[i * rows + step] = kept[i]
    readings = words(record.readings, 5 * cables)
    state = load_word(data + mj_struct.PLUGIN_STATE)
    for k in range(cables):
        own = 5 * k
        nodes = floats(state + 8 * readings[own], readings[own + 1])
        least = nodes[0]
        for i in range(1, nodes.size):
            least = min(least, nodes[i])
        energy = load_real(state + 8 * readings[own + 2])
        proximal, distal = readings[own + 3], readings[own + 4]
        at = _FIXED + 2 * k
        columns[at * rows + step] = abs(mj_struct.force(data, proximal))
        columns[(at + 1) * rows + step] = abs(mj_struct.force(data, distal))
        columns[(_FIXED + 2 * cables + k) * rows + step] = energy
        columns[(_FIXED + 3 * cables + k) * rows + step] = least
    seen[compiled_laws.ANGLE], seen[compiled_laws.VELOCITY] = turned, speed
    leverage = 1.0
    if record.law >= FEEDBACK:
        angle, velocity, leverage = _winding(record, data, angle, velocity)
    seen[compiled_laws.JOINT_ANGLE] = angle
    seen[compiled_laws.JOINT_VELOCITY] = velocity
    if record.law < TUNED:
        leverage = 1.0
    seen[compiled_laws.TORQUE], seen[compiled_laws.DESIRED] = (
        torque / leverage,
        desired / leverage,
    )


@internal
def _play(data: int, record: EpisodeRecord) -> None:
    """Do what is due after `count` physics steps."""
    count, skip = record.count, record.skip
    control = load_word(data + mj_struct.CTRL)
    if count % skip == 0:
        step = count // skip
        seen = floats(record.seen, _SEEN)
        _observe(record, data, step, seen)
        if step == record.steps:
            store_real(load_word(data + mj_struct.USERDATA), 0.0)
            return
        torque = _torque(record, seen)
        if not np.isfinite(torque):
            record.refused = 1
            store_real(load_word(data + mj_struct.USERDATA), 0.0)
            return
        share = clamp(torque / record.torque_limit, -1.0, 1.0)
        # The actions of the environments are of single precision.
        single = float(np.float32(share))
        store_real(control + 8 * record.motor_control, single * record.motor_scale)
    scripted = record.scripted
    places = words(record.script_controls, scripted)
    commands = floats(record.commands + 8 * scripted * count, scripted)
    for i in range(scripted):
        store_real(control + 8 * places[i], commands[i])


@cache
def begin_episode() -> Any:
    """Return what begins an episode from addresses of a simulation and its record."""
    kind = ctypes.CFUNCTYPE(None, *(2 * (ctypes.c_ssize_t,)))
    return kind(("cc_mujoco_episode_begin", native_library.library()))


def attend(spec: mujoco.MjSpec) -> None:
    """Have a scene's simulations attended by the plugin, which knows none of them yet.

    Its instance has neither state nor force, so that nothing else becomes of them.
    """
    if not LIBRARY.mjp_getPlugin(PLUGIN.encode(), None):
        add_plugin(
            PLUGIN,
            {
                "nstate": "cc_mujoco_episode_nstate",
                "advance": "cc_mujoco_episode_advance",
            },
        )
    spec.nuserdata = 1
    spec.activate_plugin(PLUGIN)
    spec.add_plugin(name="episode", plugin_name=PLUGIN)


@callback
def episode_begin(data: int, record: int) -> None:
    """Begin an episode of a simulation with a record."""
    store_real(load_word(data + mj_struct.USERDATA), float(record))
    _play(data, _record(record))


@callback
def episode_nstate(model: int, instance: CInt) -> CInt:
    """Return the numbers in the plugin's state."""
    return 0


@callback
def episode_advance(model: int, data: int, instance: CInt) -> None:
    """Go on with an episode when a step ends."""
    if not mj_struct.has_userdata(model):
        return
    # An address is below 2^53, so a number holds it.
    address = int(load_real(load_word(data + mj_struct.USERDATA)))
    if address != 0:
        record = _record(address)
        record.count = record.count + 1
        _play(data, record)
