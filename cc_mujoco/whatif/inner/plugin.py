"""The plugin that plays an episode where MuJoCo's steps end, compiled.

`advance` is called when a step has new positions and velocities and still the forces
that acted in it, which is what a control step of an environment reads.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import mujoco
import numpy as np
from numba import cfunc

from cc_mujoco.compiled import FloatArray, internal, types
from cc_mujoco.control import laws
from cc_mujoco.control.compensation import SCRATCH
from cc_mujoco.control.model import follow
from cc_mujoco.engine import fields
from cc_mujoco.engine.memory import (
    LIBRARY,
    floats,
    load_real,
    load_word,
    store_real,
    store_word,
    words,
)
from cc_mujoco.engine.plugin import add
from cc_mujoco.transmission import stepper
from cc_mujoco.whatif.inner.record import KEPT, PER_CABLE, Asked, Law, Number, Word

PLUGIN = "cc_mujoco.episode"
LEAST = 0.1
"""Least leverage, see `envs.winding`."""

_FIXED, _PER_CABLE = len(KEPT), PER_CABLE
_UNPOWERED, _FEED_FORWARD, _FEEDBACK, _MODEL = (
    int(law) for law in (Law.UNPOWERED, Law.FEED_FORWARD, Law.FEEDBACK, Law.MODEL)
)
_TUNNEL, _SPRING = int(Asked.TUNNEL), int(Asked.SPRING)
_GAINS, _SEEN, _MEMORY = len(laws.GAINS), len(laws.SEEN), laws.MEMORY
_RATIO, _LOW, _HIGH, _PERIOD = (
    [gain.name for gain in laws.GAINS].index(name)
    for name in ("ratio", "low", "high", "period")
)

# Enumerations are resolved here, as compiled code reads plain integers only.
(
    _LAW, _ASKED, _SKIP, _STEPS, _COUNT, _REFUSED, _MOTOR_CONTROL, _SCRIPTED,
    _SCRIPT_CONTROLS, _COMMANDS, _DESIRED, _MOTOR_Q, _MOTOR_V, _JOINT_Q, _JOINT_V,
    _MOTOR_OUT, _WEARER_OUT, _CABLES, _READINGS, _WOUND, _ARMS, _WOUND_OWN, _NUMBERS,
    _COLUMNS, _GAINS_AT, _MEMORY_AT, _SEEN_AT, _MODEL_CABLES, _SEGMENTS, _PROXIMAL,
    _DISTAL, _PACKED, _PACKED_SIZE, _STATE, _STATE_SIZE, _JOINT, _SLIP_DIRECTION,
    _GAIN, _ARM, _NEW, _WORK, _WORK_SIZE, _SCRATCH,
) = (8 * int(word) for word in Word)  # fmt: skip
(
    _GEAR, _SCALE, _LIMIT, _HALF_WIDTH, _STIFFNESS, _MOST, _LEVERAGE_ARM,
    _CABLE_STIFFNESS,
) = (8 * int(number) for number in Number)  # fmt: skip


@internal
def _clamped(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


@internal
def _desired(record: int, step: int, angle: float) -> float:
    """Return the task's desired torque at a control step [Nm]; see `human.tasks`."""
    kind, numbers = load_word(record + _ASKED), load_word(record + _NUMBERS)
    stiffness = load_real(numbers + _STIFFNESS)
    if kind == _TUNNEL:
        width = load_real(numbers + _HALF_WIDTH)
        most = load_real(numbers + _MOST)
        wall = stiffness * (_clamped(angle, -width, width) - angle)
        return _clamped(wall, -most, most)
    if kind == _SPRING:
        return -stiffness * angle
    return load_real(load_word(record + _DESIRED) + 8 * step)


@internal
def _leverage(record: int, data: int, velocity: float) -> tuple[float, float]:
    """Velocity and leverage of the joint as if wound on a round pulley."""
    count = load_word(record + _WOUND)
    if count == 0:
        return velocity, 1.0
    arms, own = load_word(record + _ARMS), load_word(record + _WOUND_OWN)
    nominal = load_real(load_word(record + _NUMBERS) + _LEVERAGE_ARM)
    pace = 0.0
    for i in range(count):
        arm = fields.real(data, fields.MOMENT, load_word(arms + 8 * i))
        dof = load_word(arms + 8 * (count + i))
        pace = pace + arm * fields.real(data, fields.VELOCITIES, dof)
    arm = fields.real(data, fields.MOMENT, load_word(arms + 8 * own))
    return pace / nominal, max(arm / nominal, LEAST)


@internal
def _told(record: int, row: int, size: int) -> FloatArray:
    """A field of the model that a law has, from its address."""
    return floats(load_word(record + row), size)


@internal
def _torque(record: int, seen: FloatArray) -> float:
    """Torque of the motor [Nm]."""
    law = load_word(record + _LAW)
    gains = _told(record, _GAINS_AT, _GAINS)
    desired, torque = seen[laws.DESIRED], seen[laws.TORQUE]
    if law == _UNPOWERED:
        return 0.0
    if law == _FEED_FORWARD:
        return _clamped(desired / gains[_RATIO], gains[_LOW], gains[_HIGH])
    memory = _told(record, _MEMORY_AT, _MEMORY)
    if law == _FEEDBACK:
        stiffness = load_real(load_word(record + _NUMBERS) + _CABLE_STIFFNESS)
        return float(laws.guarded(gains, stiffness, memory, seen))
    count = load_word(record + _MODEL_CABLES)
    width, long = load_word(record + _PACKED_SIZE), load_word(record + _STATE_SIZE)
    prm = _told(record, _PACKED, count * width).reshape(count, width)
    state = _told(record, _STATE, count * long).reshape(count, long)
    new = _told(record, _NEW, count * long).reshape(count, long)
    n = words(load_word(record + _SEGMENTS), count)
    proximal, distal = (
        _told(record, _PROXIMAL, count),
        _told(record, _DISTAL, count),
    )
    slip_direction = _told(record, _SLIP_DIRECTION, count)
    gain, arm = _told(record, _GAIN, count), _told(record, _ARM, count)
    joint, work = (
        _told(record, _JOINT, 1),
        _told(record, _WORK, load_word(record + _WORK_SIZE)),
    )
    scratch = _told(record, _SCRATCH, SCRATCH * count).reshape(SCRATCH, count)
    stiffness = load_real(load_word(record + _NUMBERS) + _CABLE_STIFFNESS)
    cables = stepper.Cables(prm, n, proximal, proximal, distal)
    joint[0] = follow(
        cables, state, seen[laws.ANGLE], torque, joint[0], slip_direction, gain, arm,
        gains[_PERIOD], new, work,
    )  # fmt: skip
    if law == _MODEL:
        found = laws.model_based(
            gains, stiffness, prm, n, distal, arm, state, slip_direction, gain, 0.0,
            memory, seen, scratch,
        )  # fmt: skip
    else:
        found = laws.stiction(
            gains, stiffness, prm, n, distal, arm, state, memory, seen, scratch
        )
    return float(found)


@internal
def _observe(record: int, data: int, step: int, seen: FloatArray) -> None:
    """Read and keep what is measured at a control step."""
    numbers, out = load_word(record + _NUMBERS), load_word(record + _COLUMNS)
    row = 8 * (load_word(record + _STEPS) + 1)
    joint = load_word(record + _JOINT_V)
    wearer = fields.force(data, load_word(record + _WEARER_OUT))
    own = fields.real(data, fields.SPRING, joint) + fields.real(
        data, fields.DAMPER, joint
    )
    pieces = fields.real(data, fields.PASSIVE, joint) - own
    angle = fields.real(data, fields.POSITION, load_word(record + _JOINT_Q))
    velocity = fields.real(data, fields.VELOCITIES, joint)
    turned = fields.real(data, fields.POSITION, load_word(record + _MOTOR_Q))
    speed = fields.real(data, fields.VELOCITIES, load_word(record + _MOTOR_V))
    given = fields.force(data, load_word(record + _MOTOR_OUT))
    torque = fields.real(data, fields.ACTUATION, joint) - wearer + pieces
    desired = _desired(record, step, angle)
    kept = (
        turned, speed, given * load_real(numbers + _GEAR), angle, velocity, torque,
        wearer, desired,
    )  # fmt: skip
    at = out + 8 * step
    for i in range(_FIXED):
        store_real(at + i * row, kept[i])
    at += _FIXED * row
    cables, readings = load_word(record + _CABLES), load_word(record + _READINGS)
    state = load_word(data + fields.PLUGIN_STATE)
    for k in range(cables):
        reading = readings + 40 * k
        nodes = floats(state + 8 * load_word(reading), load_word(reading + 8))
        least = nodes[0]
        for i in range(1, nodes.size):
            least = min(least, nodes[i])
        proximal = fields.force(data, load_word(reading + 24))
        distal = fields.force(data, load_word(reading + 32))
        store_real(at + 2 * k * row, abs(proximal))
        store_real(at + (2 * k + 1) * row, abs(distal))
        energy = load_real(state + 8 * load_word(reading + 16))
        store_real(at + (2 * cables + k) * row, energy)
        store_real(at + (3 * cables + k) * row, least)
    seen[laws.ANGLE], seen[laws.VELOCITY] = turned, speed
    seen[laws.JOINT_VELOCITY], leverage = velocity, 1.0
    law = load_word(record + _LAW)
    if law >= _FEEDBACK:
        seen[laws.JOINT_VELOCITY], leverage = _leverage(record, data, velocity)
    if law < _MODEL:
        leverage = 1.0
    seen[laws.TORQUE], seen[laws.DESIRED] = torque / leverage, desired / leverage


@internal
def _play(data: int, record: int) -> None:
    """Do what is due after `COUNT` physics steps."""
    count, skip = load_word(record + _COUNT), load_word(record + _SKIP)
    control = load_word(data + fields.CTRL)
    if count % skip == 0:
        step = count // skip
        seen = _told(record, _SEEN_AT, _SEEN)
        _observe(record, data, step, seen)
        if step == load_word(record + _STEPS):
            store_real(load_word(data + fields.USERDATA), 0.0)
            return
        torque = _torque(record, seen)
        if not np.isfinite(torque):
            store_word(record + _REFUSED, 1)
            store_real(load_word(data + fields.USERDATA), 0.0)
            return
        numbers = load_word(record + _NUMBERS)
        share = _clamped(torque / load_real(numbers + _LIMIT), -1.0, 1.0)
        # The actions of the environments are of single precision.
        single = float(np.float32(share))
        at = control + 8 * load_word(record + _MOTOR_CONTROL)
        store_real(at, single * load_real(numbers + _SCALE))
    scripted = load_word(record + _SCRIPTED)
    places = load_word(record + _SCRIPT_CONTROLS)
    commands = load_word(record + _COMMANDS) + 8 * scripted * count
    for i in range(scripted):
        command = load_real(commands + 8 * i)
        store_real(control + 8 * load_word(places + 8 * i), command)


@cache
def instant() -> Any:
    """Return what begins an episode from addresses of a simulation and its record."""
    return ctypes.CFUNCTYPE(None, *(2 * (ctypes.c_ssize_t,)))(_compiled()[1].address)


def attend(spec: mujoco.MjSpec) -> None:
    """Have a scene's simulations attended by the plugin, which knows none of them yet.

    Its instance has neither state nor force, so that nothing else becomes of them.
    """
    if not LIBRARY.mjp_getPlugin(PLUGIN.encode(), None):
        add(PLUGIN, _compiled()[0])
    spec.nuserdata = 1
    spec.activate_plugin(PLUGIN)
    spec.add_plugin(name="episode", plugin_name=PLUGIN)


@cache
def _compiled() -> tuple[dict[str, Any], Any]:
    try:
        return _compile({"cache": True, "error_model": "numpy"})
    except RuntimeError:  # Numba finds no folder for its cache
        return _compile({"error_model": "numpy"})


def _compile(options: Any) -> tuple[dict[str, Any], Any]:
    address, integer = types.intp, types.int32

    @cfunc(types.void(address, address), **options)
    def begin(data: int, record: int) -> None:
        store_real(load_word(data + fields.USERDATA), float(record))
        _play(data, record)

    @cfunc(integer(address, integer), **options)
    def nstate(model: int, instance: int) -> int:
        return 0

    @cfunc(types.void(address, address, integer), **options)
    def advance(model: int, data: int, instance: int) -> None:
        if not fields.has_userdata(model):
            return
        # An address is below 2^53, so a number holds it.
        record = int(load_real(load_word(data + fields.USERDATA)))
        if record != 0:
            store_word(record + _COUNT, load_word(record + _COUNT) + 1)
            _play(data, record)

    return {"nstate": nstate, "advance": advance}, begin
