"""The engine plugin: MuJoCo's callbacks, compiled, and their registration.

An instance is one cable, shared by two plugin actuators. `compute` evaluates the cable
from its last committed state and applies the end tensions; it never writes
`plugin_state`. `advance` commits, once a time step, the configuration at which the step
began. All state that matters to the simulation is in `plugin_state`; `plugin_data` holds
what follows from the configuration, scratch memory, and the result of the last
evaluation with its inputs, which is used again only for bitwise equal inputs.

Under RK4 the four stages are evaluated from the committed state too. The first stage is
at the configuration where the step begins, one time step after the committed one; the
later ones are half, half and one step further on, so that much time has passed for the
rate-dependent friction terms. The first stage is what `advance` commits.
"""

from __future__ import annotations

import ctypes
import hashlib
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numba import cfunc, njit, types

from cc_mujoco.engine import config, ends, fields, layout
from cc_mujoco.engine.config import PLUGIN, constant
from cc_mujoco.engine.memory import (
    CAPACITY,
    LIBRARY,
    allocate,
    append,
    characters,
    floats,
    release,
    warn,
    words,
)
from cc_mujoco.transmission import kernel
from cc_mujoco.transmission.parameters import KEYS, MAX_SECTIONS

_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)

# Header of the memory block of an instance, in 8-byte numbers; then follow the packed
# parameters, scratch, the state before and after the last evaluation, and a copy of the
# configuration text.
_SEGMENTS = 0
_PROXIMAL = 1
_DISTAL = 2
_TEXT_SIZE = 3
_KNOWN = 4
_INPUTS = 5  # u_proximal, u_distal, dt
_STAGES = 8  # u_proximal, u_distal, dt, time of the last four evaluations under RK4
_HEADER = 24
_TEXT_CAPACITY = 4096
_TIME = 3  # position in the state of the time of the committed configuration, under RK4

_START = constant(f"plugin `{PLUGIN}`, instance '")
_START_END = constant("': ")


@njit(nogil=True)
def _block_size(n: int) -> int:
    """Bytes of the memory block of a cable of n segments."""
    numbers = kernel.parameter_size(n) + kernel.work_size(n) + 2 * kernel.state_size(n)
    return 8 * (_HEADER + numbers) + _TEXT_CAPACITY


@njit(nogil=True)
def _parts(block: int, n: int) -> tuple[int, int, int, int, int]:
    """Addresses of parameters, scratch, old state, new state and text in a block."""
    parameters = block + 8 * _HEADER
    work = parameters + 8 * kernel.parameter_size(n)
    old = work + 8 * kernel.work_size(n)
    new = old + 8 * kernel.state_size(n)
    return parameters, work, old, new, new + 8 * kernel.state_size(n)


@njit(nogil=True)
def _refused(model: int, instance: int) -> bool:
    """Whether the instance cannot be used; if so, MuJoCo has been told why."""
    message = np.zeros(CAPACITY, np.uint8)
    used = append(message, 0, _START)
    used = append(message, used, fields.plugin_name(model, instance))
    start = append(message, used, _START_END)
    used = ends.explain(message, start, model, instance)
    attributes = fields.attributes(model, instance)
    if used == start:
        values = np.empty(config.SCALARS)
        sections = np.empty((MAX_SECTIONS, 2))
        key, _ = config.read(attributes, values, sections)
        route = config.value(attributes, config.ROUTE)
        if (
            key == config.VALID
            and route.size > 0
            and not ends.has_route(model, instance, route)
        ):
            key = config.ROUTE
        if key != config.VALID:
            used = config.explain(message, start, attributes, key)
    if used > start:
        warn(message, used)
    return used > start


@njit(nogil=True)
def _pack(block: int, model: int, instance: int) -> bool:
    """Bring the packed parameters up to date with the configuration of the model.

    They are unless a batch gives its simulations different models; then the text of the
    configuration differs from the copy that was packed last.
    """
    n = words(block, _HEADER)[_SEGMENTS]
    parameters, _, _, _, copy = _parts(block, n)
    attributes = fields.attributes(model, instance)
    size = words(block, _HEADER)[_TEXT_SIZE]
    seen = characters(copy, size)
    now = characters(attributes, size)
    i = 0
    while i < size and seen[i] == now[i]:
        i += 1
    if size > 0 and i == size:
        return True
    values = np.empty(config.SCALARS)
    sections = np.empty((MAX_SECTIONS, 2))
    key, count = config.read(attributes, values, sections)
    words(block, _HEADER)[_KNOWN] = 0
    words(block, _HEADER)[_TEXT_SIZE] = 0
    if key != config.VALID or config.segments(attributes) != n:
        return False
    kernel.pack(
        values, sections[:count], n, floats(parameters, kernel.parameter_size(n))
    )
    size = config.block_size(attributes)
    if size <= _TEXT_CAPACITY:
        characters(copy, size)[:] = characters(attributes, size)
        words(block, _HEADER)[_TEXT_SIZE] = size
    return True


@njit(nogil=True)
def _elapsed(model: int, data: int, committed: float) -> float:
    """Time between the committed configuration and the present one [s].

    One time step; under RK4, at the later stages, up to two.
    """
    step = fields.timestep(model)
    if fields.integrator(model) != _RK4:
        return step
    halves = np.rint(2.0 * (fields.time(data) - committed) / step)
    return 0.5 * halves * step if 2.0 <= halves <= 4.0 else step


@njit(nogil=True)
def _evaluate(block: int, start: int, u_proximal: float, u_distal: float, dt: float):  # type: ignore[no-untyped-def]
    """New state from the committed one at address `start`.

    Returns:
        View on the new state, in the block; whether it is finite.
    """
    header = words(block, _HEADER)
    inputs = floats(block + 8 * _INPUTS, 3)
    n = header[_SEGMENTS]
    size = kernel.state_size(n)
    parameters, work, old, new, _ = _parts(block, n)
    given = np.array([u_proximal, u_distal, dt])
    known = header[_KNOWN] == 1
    for i in range(3):
        known = known and inputs.view(np.int64)[i] == given.view(np.int64)[i]
    i = 0
    while known and i < size:
        known = words(old, size)[i] == words(start, size)[i]
        i += 1
    result = floats(new, size)
    if known:
        return result, True
    floats(old, size)[:] = floats(start, size)
    inputs[:] = given
    status = kernel.advance(
        floats(parameters, kernel.parameter_size(n)),
        n,
        floats(old, size),
        u_proximal,
        u_distal,
        dt,
        result,
        floats(work, kernel.work_size(n)),
    )
    header[_KNOWN] = 1 if status == kernel.OK else 0
    return result, status == kernel.OK


@njit(nogil=True)
def _lengths(model: int, data: int, block: int) -> tuple[float, float]:
    """Displacement of the two ends at the last evaluated position [m]."""
    header = words(block, _HEADER)
    u_proximal = fields.real(data, fields.LENGTH, header[_PROXIMAL])
    return u_proximal, fields.real(data, fields.LENGTH, header[_DISTAL])


def _stamp() -> str:
    """What compiled code depends on beyond its own source file.

    Numba's cache looks at the file of a function only; this also tells when the kernel,
    the parameter table or MuJoCo's layout changed.
    """
    digest = hashlib.sha256(mujoco.__version__.encode())
    for module in (layout, kernel):
        for source in sorted(Path(str(module.__file__)).parent.glob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()


def _callbacks(stamp: str, cache: bool) -> dict[str, Any]:
    """Compile the callbacks; `stamp` is part of their key in the cache."""
    pointer = types.intp
    integer = types.int32
    none = types.void

    @cfunc(integer(pointer, integer), cache=cache, error_model="numpy")
    def nstate(model: int, instance: int) -> int:
        _ = stamp
        n = config.segments(fields.attributes(model, instance))
        return kernel.state_size(max(n, 1))

    @cfunc(integer(pointer, pointer, integer), cache=cache, error_model="numpy")
    def init(model: int, data: int, instance: int) -> int:
        _ = stamp
        fields.set_block(data, instance, 0)
        if _refused(model, instance):
            return -1
        n = config.segments(fields.attributes(model, instance))
        size = _block_size(n)
        block = allocate(size)
        characters(block, size)[:] = 0
        _, first, second = ends.find(model, instance)
        header = words(block, _HEADER)
        header[_SEGMENTS] = n
        header[_PROXIMAL] = ends.output(model, first)
        header[_DISTAL] = ends.output(model, second)
        _pack(block, model, instance)
        fields.set_block(data, instance, block)
        return 0

    @cfunc(none(pointer, integer), cache=cache, error_model="numpy")
    def destroy(data: int, instance: int) -> None:
        _ = stamp
        block = fields.block(data, instance)
        if block != 0:
            release(block)
        fields.set_block(data, instance, 0)

    @cfunc(none(pointer, pointer, pointer, integer), cache=cache, error_model="numpy")
    def reset(model: int, state: int, block: int, instance: int) -> None:
        _ = stamp
        if not _pack(block, model, instance):
            return
        header = words(block, _HEADER)
        n = header[_SEGMENTS]
        parameters, _, _, _, _ = _parts(block, n)
        view = floats(state, kernel.state_size(n))
        kernel.initialize(
            floats(parameters, kernel.parameter_size(n)),
            n,
            fields.real(model, fields.ACTUATOR_LENGTH0, header[_PROXIMAL]),
            fields.real(model, fields.ACTUATOR_LENGTH0, header[_DISTAL]),
            view,
        )
        if fields.integrator(model) == _RK4:
            view[_TIME] = -fields.timestep(model)

    @cfunc(none(pointer, pointer, integer, integer), cache=cache, error_model="numpy")
    def compute(model: int, data: int, instance: int, capability: int) -> None:
        _ = stamp
        block = fields.block(data, instance)
        header = words(block, _HEADER)
        n = header[_SEGMENTS]
        start = fields.state(model, data, instance)
        u_proximal, u_distal = _lengths(model, data, block)
        dt = _elapsed(model, data, floats(start, _TIME + 1)[_TIME])
        fits = _pack(block, model, instance)
        new, finite = _evaluate(block, start, u_proximal, u_distal, dt)
        first = kernel.STATE_HEADER
        proximal = max(new[first], 0.0)
        distal = max(new[first + n], 0.0)
        if not (fits and finite):
            # MuJoCo sees the bad acceleration, warns and resets, as for any other.
            proximal, distal = np.nan, np.nan
        force = fields.pointer(data, fields.FORCE)
        floats(force + 8 * header[_PROXIMAL], 1)[0] = proximal
        floats(force + 8 * header[_DISTAL], 1)[0] = -distal
        if fields.integrator(model) == _RK4:
            stages = floats(block + 8 * _STAGES, 16)
            stages[:12] = stages[4:].copy()
            stages[12] = u_proximal
            stages[13] = u_distal
            stages[14] = dt
            stages[15] = fields.time(data)

    @cfunc(none(pointer, pointer, integer), cache=cache, error_model="numpy")
    def advance(model: int, data: int, instance: int) -> None:
        _ = stamp
        block = fields.block(data, instance)
        n = words(block, _HEADER)[_SEGMENTS]
        start = fields.state(model, data, instance)
        u_proximal, u_distal = _lengths(model, data, block)
        dt = fields.timestep(model)
        time = fields.time(data) - dt
        if fields.integrator(model) == _RK4:
            # A step makes four evaluations; the first of them is committed. With
            # actuation disabled there are none, and the last position counts.
            stages = floats(block + 8 * _STAGES, 16)
            if stages[12] == u_proximal and stages[13] == u_distal:
                u_proximal, u_distal, dt, time = (
                    stages[0], stages[1], stages[2], stages[3]
                )  # fmt: skip
        if not _pack(block, model, instance):
            return
        new, finite = _evaluate(block, start, u_proximal, u_distal, dt)
        if finite:
            state = floats(start, kernel.state_size(n))
            state[:] = new
            if fields.integrator(model) == _RK4:
                state[_TIME] = time

    return {
        "nstate": nstate,
        "init": init,
        "destroy": destroy,
        "reset": reset,
        "compute": compute,
        "advance": advance,
    }


_CALLBACKS = (
    "nstate", "nsensordata", "init", "destroy", "copy", "reset", "compute", "advance",
    "visualize", "actuator_act_dot", "sdf_distance", "sdf_gradient",
    "sdf_staticdistance", "sdf_attribute", "sdf_aabb",
)  # fmt: skip


class _Plugin(ctypes.Structure):
    """`mjpPlugin` of mjplugin.h."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("nattribute", ctypes.c_int),
        ("attributes", ctypes.POINTER(ctypes.c_char_p)),
        ("capabilityflags", ctypes.c_int),
        ("needstage", ctypes.c_int),
        *((name, ctypes.c_void_p) for name in _CALLBACKS),
    )


def register() -> None:
    """Register the plugin with MuJoCo, once per process.

    Raises:
        ImportError: this MuJoCo cannot run the plugin, or the name is taken by another.
    """
    LIBRARY.mjp_getPlugin.restype = ctypes.POINTER(_Plugin)
    LIBRARY.mjp_getPlugin.argtypes = (ctypes.c_char_p, ctypes.POINTER(ctypes.c_int))
    present = LIBRARY.mjp_getPlugin(PLUGIN.encode(), None)
    if present:
        plugin = present.contents
        keys = [plugin.attributes[i].decode() for i in range(plugin.nattribute)]
        if keys != list(KEYS):
            raise ImportError(
                f"MuJoCo already has a plugin `{PLUGIN}` with other keys "
                f"({', '.join(keys)}); only one version can be loaded in a process"
            )
        return
    layout.verify()
    stamp = _stamp()
    try:
        callbacks = _callbacks(stamp, cache=True)
    except RuntimeError:  # Numba finds no folder that it may write its cache to.
        callbacks = _callbacks(stamp, cache=False)
    plugin = _Plugin()
    LIBRARY.mjp_defaultPlugin(ctypes.byref(plugin))
    plugin.name = PLUGIN.encode()
    plugin.nattribute = len(KEYS)
    plugin.attributes = (ctypes.c_char_p * len(KEYS))(*(k.encode() for k in KEYS))
    plugin.capabilityflags = 1  # mjPLUGIN_ACTUATOR
    plugin.needstage = int(mujoco.mjtStage.mjSTAGE_ACC)
    for name, callback in callbacks.items():
        setattr(plugin, name, callback.address)
    # MuJoCo keeps the addresses for the life of the process, whatever happens to this
    # module; so must what they point to.
    ctypes.pythonapi.Py_IncRef(ctypes.py_object((plugin, callbacks)))
    LIBRARY.mjp_registerPlugin(ctypes.byref(plugin))
