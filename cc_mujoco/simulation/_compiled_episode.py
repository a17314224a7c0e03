"""An episode inside MuJoCo's own steps: task, controller and recording, compiled.

A batch that returns to Python at every control step spends more time there, and on
reloading every simulation into the cache, than on physics. If task and controller are
compiled, a plugin of the model calls them at the end of physics steps, and each
simulation runs through its episode in one call.

MuJoCo calls `advance` when a step has new positions and velocities but still the forces
that acted in it, as an environment reads them at a control step. The formulas are those
of `human._tasks` and `control._law_steps`; this module only passes their arguments.
"""

import ctypes
from functools import cache
from typing import Annotated, Any

import mujoco
import numpy as np

from cc_mujoco.control import _controller as controller
from cc_mujoco.control._law_steps import LawData
from cc_mujoco.device import _axis_record as axis_record
from cc_mujoco.human._tasks import clamp
from cc_mujoco.native import _library as native_library
from cc_mujoco.native import internal
from cc_mujoco.plugin._engine import LIBRARY
from cc_mujoco.plugin._ffi import CInt, callback, floats, reinterpret, words
from cc_mujoco.plugin._mj_offsets import MjData, MjModel
from cc_mujoco.plugin._registration import add_plugin
from cc_mujoco.simulation._wiring import OF_PHASE, desired_torque

PLUGIN = "cc_mujoco.episode"

UNPOWERED = -1
"""Law of a motor that gives no torque; others are places in `_controller.STEPS`."""

KEPT = (*axis_record.READING_COLUMNS[: axis_record.WINDING_ANGLE], "desired_torque_nm")
"""Columns that are kept of every control step. Those of each cable follow: tension at
both ends, energy that friction took, least tension."""
READ_COLUMNS = (*axis_record.READING_COLUMNS, "desired_torque_nm")
"""Columns that a law may read."""

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
            "axis",  # address of its record, see `device._axis_record`
            "scripted",  # number of controls that follow the script
            "script_controls",  # address of their places
            "commands",  # address of (physics steps + 1, scripted)
            "desired",  # address of the torques of a task of the phase (steps + 1,)
            "task_parameters",  # address of those of `Tunnel` or `Spring`
            "cables",  # number of cables
            "readings",  # address of (cables, 5): first node in `plugin_state`, number
            # of nodes, energy, and both ends in `actuator_force`
            "columns",  # address of the kept columns (columns, steps + 1)
            # Addresses of the arrays of `LawData`, and their sizes
            "memory", "memory_size", "shape", "shape_size", "tables", "tables_size",
            "sources",  # address of the indices in `READ_COLUMNS` of the law's readings
            "source_count",
            "taps",  # address of the indices of its tension sensors in `plugin_state`
            "tap_count",
            "is_round",  # 1 where it reads torques as of a round pulley
            "seen",  # address of the readings
        )
    ]
)  # fmt: skip
"""Record of a simulation. `userdata[0]` of the simulation holds its address, or 0 for
none, to which MuJoCo also resets it when a simulation diverges."""

_FIELD_COUNT = len(axis_record.Physics._fields)
EpisodeRecord = Annotated[Any, ("EpisodeRecord", RECORD)]  # a simulation's `RECORD`


@reinterpret
def _record(address: int) -> EpisodeRecord:
    memory = (ctypes.c_byte * RECORD.itemsize).from_address(address)
    return np.frombuffer(memoryview(memory), RECORD).view(np.recarray)[0]


@internal
def _desired_torque(record: EpisodeRecord, step: int, angle: float) -> float:
    if record.task == OF_PHASE:
        return axis_record.real(record.desired, step)
    given = floats(record.task_parameters, 3)
    return float(desired_torque(record.task, given, angle, 0.0))


@internal
def _torque(record: EpisodeRecord) -> float:
    if record.law == UNPOWERED:
        return 0.0
    memory = floats(record.memory, record.memory_size)
    shape = words(record.shape, record.shape_size)
    tables = floats(record.tables, record.tables_size)
    seen = floats(record.seen, record.source_count + record.tap_count)
    data = LawData(memory, shape, tables, seen)
    return controller.step(record.law, data)


@internal
def _observe(record: EpisodeRecord, data: MjData, step: int) -> None:
    cables, rows, fixed = record.cables, record.steps + 1, len(KEPT)
    columns = floats(record.columns, (fixed + 4 * cables) * rows)
    desired = axis_record.READINGS
    at, found = np.empty(_FIELD_COUNT, np.int64), np.empty(desired + 1)
    axis_record.fields_of(data, at)
    axis_record.read_axis(axis_record.axis_at(record.axis), at, found)
    found[desired] = _desired_torque(record, step, found[axis_record.JOINT_ANGLE])
    for i in range(fixed - 1):
        columns[i * rows + step] = found[i]
    columns[(fixed - 1) * rows + step] = found[desired]
    readings = words(record.readings, 5 * cables)
    state = data.plugin_state.ctypes.data
    for k in range(cables):
        own = 5 * k
        nodes = floats(state + 8 * readings[own], readings[own + 1])
        least = nodes[0]
        for i in range(1, nodes.size):
            least = min(least, nodes[i])
        energy = axis_record.real(state, readings[own + 2])
        proximal, distal = readings[own + 3], readings[own + 4]
        place = fixed + 2 * k
        columns[place * rows + step] = abs(data.actuator_force[proximal])
        columns[(place + 1) * rows + step] = abs(data.actuator_force[distal])
        columns[(fixed + 2 * cables + k) * rows + step] = energy
        columns[(fixed + 3 * cables + k) * rows + step] = least
    count, taps = record.source_count, words(record.taps, record.tap_count)
    sources, seen = words(record.sources, count), floats(record.seen, count + taps.size)
    leverage = found[axis_record.LEVERAGE] if record.is_round != 0 else 1.0
    for i in range(count):
        source = sources[i]
        seen[i] = found[source]
        if source == axis_record.JOINT_TORQUE or source == desired:
            seen[i] = found[source] / leverage
    for i in range(taps.size):
        seen[count + i] = max(axis_record.real(state, taps[i]), 0.0)


@internal
def _play(data: MjData, record: EpisodeRecord) -> None:
    """Record and control if a control step is due; set the script's next controls."""
    count, skip = record.count, record.skip
    if count % skip == 0:
        step = count // skip
        _observe(record, data, step)
        if step == record.steps:
            data.userdata[0] = 0.0
            return
        torque = _torque(record)
        if not np.isfinite(torque):
            record.refused = 1
            data.userdata[0] = 0.0
            return
        axis = axis_record.axis_at(record.axis)
        share = clamp(torque / axis.torque_limit, -1.0, 1.0)
        # The actions of the environments are of single precision.
        single = float(np.float32(share))
        data.ctrl[axis.motor_control] = single * axis.motor_scale
    scripted = record.scripted
    places = words(record.script_controls, scripted)
    commands = floats(record.commands + 8 * scripted * count, scripted)
    for i in range(scripted):
        data.ctrl[places[i]] = commands[i]


@cache
def begin_episode() -> Any:
    """Return the C function that starts an episode, given `MjData` and a record."""
    kind = ctypes.CFUNCTYPE(None, *(2 * (ctypes.c_ssize_t,)))
    return kind(("cc_mujoco_episode_begin", native_library.library()))


def attend(spec: mujoco.MjSpec) -> None:
    """Add to a scene the plugin instance that runs compiled episodes.

    The instance has no state and no force, so it does not change the physics.
    """
    if not LIBRARY.mjp_getPlugin(PLUGIN.encode(), None):
        names = "nstate", "advance"
        add_plugin(PLUGIN, {name: f"cc_mujoco_episode_{name}" for name in names})
    spec.nuserdata = 1
    spec.activate_plugin(PLUGIN)
    spec.add_plugin(name="episode", plugin_name=PLUGIN)


@callback
def episode_begin(data: MjData, record: int) -> None:
    data.userdata[0] = float(record)
    _play(data, _record(record))


@callback
def episode_nstate(model: MjModel, instance: CInt) -> CInt:
    return 0


@callback
def episode_advance(model: MjModel, data: MjData, instance: CInt) -> None:
    if model.nuserdata == 0:
        return
    # An address is below 2^53, so a number holds it.
    address = int(data.userdata[0])
    if address != 0:
        record = _record(address)
        record.count = record.count + 1
        _play(data, record)
