"""The engine plugin's callbacks, compiled.

An instance is one cable, shared by two plugin actuators. `compute` evaluates the cable
from its last committed state and applies the end tensions; it never writes
`plugin_state`. `advance` commits, once a time step, the configuration at which the step
began. All state that matters to the simulation is in `plugin_state`: that of the kernel
and, under RK4, the time of the committed configuration. `plugin_data` holds what
follows from the configuration, scratch memory, and the result of the last evaluation
with its inputs, which is used again only for bitwise equal inputs.

The block of memory is made by `init`. MuJoCo also steps data on which it has called no
`init`, when it searches for the length range of a muscle: there a cable has neither
state nor force.

A conduit that follows its route takes its bends, at every evaluation, from the path of
the tendon at that position; like the displacements of the ends they are an input of the
evaluation and no state.

Under RK4 the four stages are evaluated from the committed state too. The first stage is
at the configuration where the step begins, one time step after the committed one; the
later ones are half, half and one step further on, so that much time has passed for the
rate-dependent friction terms. The first stage is what `advance` commits.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numba import cfunc

from cc_mujoco.engine import config, ends, fields, path, steps
from cc_mujoco.engine.block import (
    CHECKED,
    DISTAL,
    INPUTS,
    KNOWN,
    PROXIMAL,
    ROUTE,
    SEGMENTS,
    STAGE,
    STAGES,
    TEXT_CAPACITY,
    TEXT_SIZE,
    bends_at,
    committed_time,
    displacement,
    new_at,
    old_at,
    parameters_at,
    text_at,
    work_at,
    wound,
)
from cc_mujoco.engine.config import PLUGIN, constant
from cc_mujoco.engine.memory import (
    CAPACITY,
    allocate,
    append,
    clear,
    copy,
    export,
    floats,
    internal,
    load_byte,
    load_real,
    load_word,
    quote,
    release,
    said_before,
    store_real,
    store_word,
    types,
    warn,
)
from cc_mujoco.transmission import kernel
from cc_mujoco.transmission.parameters import MAX_SECTIONS

_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
_NO_ACTUATION = int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)

_START = constant(f"plugin `{PLUGIN}`, instance ")
_START_END = constant(": ")


# The large functions are compiled once each and called by name; as Numba functions they
# would be compiled again inside every callback that calls them.
_REFUSED = types.int32(types.intp, types.int32)
_PACK = types.int32(types.intp, types.intp, types.int32)
_ADVANCE = types.int32(types.intp, types.float64, types.float64, types.float64)
_BEND = types.void(types.intp, types.intp, types.int32, types.int32, types.intp)
_LAY = types.void(types.intp, types.intp)
_refused = types.ExternalFunction("cc_mujoco_refused", _REFUSED)
_pack = types.ExternalFunction("cc_mujoco_pack", _PACK)
_advance = types.ExternalFunction("cc_mujoco_advance", _ADVANCE)
_bend = types.ExternalFunction("cc_mujoco_bend", _BEND)
_lay = types.ExternalFunction("cc_mujoco_lay", _LAY)
_CHECK = types.void(types.intp, types.intp, types.int32)
_check = types.ExternalFunction("cc_mujoco_check", _CHECK)


@internal
def _up_to_date(block: int, model: int, instance: int) -> bool:
    """Bring the packed parameters up to date with the configuration of the model.

    They are unless a batch gives its simulations different models; then the text of the
    configuration differs from the copy that was packed last.
    """
    attributes = fields.attributes(model, instance)
    seen = text_at(block, load_word(block + SEGMENTS))
    size = load_word(block + TEXT_SIZE)
    i = 0
    while i + 8 <= size and load_word(seen + i) == load_word(attributes + i):
        i += 8
    while i < size and load_byte(seen + i) == load_byte(attributes + i):
        i += 1
    if size > 0 and i == size:
        return True
    packed: bool = _pack(block, model, instance) == 1
    return packed


@internal
def _follow(block: int, model: int, data: int) -> None:
    """Bend a conduit that follows its route as that is at the last position."""
    tendon = load_word(block + ROUTE)
    if tendon >= 0:
        n = load_word(block + SEGMENTS)
        now = bends_at(block, n, 0)
        _bend(model, data, tendon, n, now)
        _lay(block, now)


@internal
def _bent_as_last(block: int) -> bool:
    """Whether the route bends now as it did at the last stage of RK4."""
    n = load_word(block + SEGMENTS)
    now, last = bends_at(block, n, 0), bends_at(block, n, 4)
    for i in range(0, 8 * n if load_word(block + ROUTE) >= 0 else 0, 8):
        if load_word(now + i) != load_word(last + i):
            return False
    return True


@internal
def _elapsed(model: int, data: int, committed: float) -> float:
    """Time between the committed configuration and the present one [s].

    One time step; under RK4, at the later stages, up to two.
    """
    step = fields.timestep(model)
    if fields.integrator(model) != _RK4:
        return step
    halves = np.rint(2.0 * (fields.time(data) - committed) / step)
    return 0.5 * halves * step if 2.0 <= halves <= 4.0 else step


@internal
def _evaluate(
    block: int, state: int, u_proximal: float, u_distal: float, dt: float
) -> bool:
    """Evaluate from the committed state at address `state`, unless that is known.

    The parameters must be up to date.

    Returns:
        Whether the new state, in the block, is finite.
    """
    n = load_word(block + SEGMENTS)
    old = old_at(block, n)
    size = 8 * kernel.state_size(n)
    known = load_word(block + KNOWN) == 1
    previous = load_word(block + INPUTS), load_word(block + INPUTS + 8)
    step = load_word(block + INPUTS + 16)
    store_real(block + INPUTS, u_proximal)
    store_real(block + INPUTS + 8, u_distal)
    store_real(block + INPUTS + 16, dt)
    known = known and previous[0] == load_word(block + INPUTS)
    known = known and previous[1] == load_word(block + INPUTS + 8)
    known = known and step == load_word(block + INPUTS + 16)
    i = 0
    while known and i < size:
        known = load_word(old + i) == load_word(state + i)
        i += 8
    if known:
        return True
    for i in range(0, size, 8):
        store_word(old + i, load_word(state + i))
    finite: bool = _advance(block, u_proximal, u_distal, dt) == kernel.OK
    store_word(block + KNOWN, 1 if finite else 0)
    return finite


@internal
def _begin(
    block: int,
    model: int,
    state: int,
    proximal_length: float,
    distal_length: float,
    time: float,
) -> None:
    """Set the state at address `state` to rest with the lengths of both actuators [m].

    The parameters must be up to date.
    """
    n = load_word(block + SEGMENTS)
    kernel.initialize(
        floats(parameters_at(block), kernel.parameter_size(n)),
        n,
        wound(model, block, proximal_length)[0],
        distal_length,
        floats(state, kernel.state_size(n)),
    )
    before = time - fields.timestep(model)
    store_real(
        committed_time(state, n), before if fields.integrator(model) == _RK4 else 0.0
    )


def compile_callbacks(stamp: str, cache: bool) -> dict[str, Any]:
    """Compile the callbacks.

    Args:
        stamp: what their code depends on besides this file; part of their cache key.
        cache: whether to keep the compiled code on disk.
    """
    options: Any = {"cache": cache, "error_model": "numpy"}

    @cfunc(_REFUSED, **options)
    def refused(model: int, instance: int) -> int:
        """Whether the instance cannot be used; if so, MuJoCo has been told why."""
        _ = stamp
        message = np.zeros(CAPACITY, np.uint8)
        used = append(message, 0, _START)
        used = quote(message, used, fields.plugin_name(model, instance))
        start = append(message, used, _START_END)
        used = ends.explain(message, start, model, instance)
        attributes = fields.attributes(model, instance)
        if used == start:
            values = np.empty(config.SCALARS)
            sections = np.empty((MAX_SECTIONS, 2))
            key, _ = config.read(attributes, values, sections)
            _, first, _ = ends.find(model, instance)
            radius = abs(ends.gear(model, ends.output(model, first)))
            swing = values[config.ECCENTRICITY] + values[config.OVALITY]
            if key == config.VALID and swing >= radius:
                alone = values[config.ECCENTRICITY] >= radius
                key = config.ECCENTRICITY if alone else config.OVALITY
            route = config.value(attributes, config.ROUTE)
            if key == config.VALID and route.size > 0:
                tendon = ends.find_route(model, instance, route)
                if tendon < 0:
                    key = config.ROUTE
                elif config.moves(attributes) and path.branches(model, tendon):
                    key = config.BEND
            if key != config.VALID:
                used = config.explain(message, start, attributes, key)
        if used > start:
            warn(message, used)
        return used > start

    @cfunc(_PACK, **options)
    def pack(block: int, model: int, instance: int) -> int:
        """Pack the parameters from the attribute block of the instance.

        Returns:
            Whether they can be used.
        """
        _ = stamp
        attributes = fields.attributes(model, instance)
        n = load_word(block + SEGMENTS)
        values = np.empty(config.SCALARS)
        sections = np.empty((MAX_SECTIONS, 2))
        key, count = config.read(attributes, values, sections)
        store_word(block + KNOWN, 0)
        store_word(block + TEXT_SIZE, 0)
        if key != config.VALID or config.segments(attributes) != n:
            return 0
        prm = floats(parameters_at(block), kernel.parameter_size(n))
        kernel.pack(values, sections[:count], n, prm)
        tendon = -1
        if config.moves(attributes):
            route = config.value(attributes, config.ROUTE)
            tendon = ends.find_route(model, instance, route)
            if tendon < 0 or path.branches(model, tendon):
                return 0
            kernel.expect_change(prm)
        store_word(block + ROUTE, tendon)
        size = config.block_size(attributes)
        if size <= TEXT_CAPACITY:
            copy(attributes, text_at(block, n), size)
            store_word(block + TEXT_SIZE, size)
        return 1

    @cfunc(_ADVANCE, **options)
    def step(block: int, u_proximal: float, u_distal: float, dt: float) -> int:
        """Step the kernel from the old to the new state in the block."""
        _ = stamp
        n = load_word(block + SEGMENTS)
        size = kernel.state_size(n)
        return kernel.advance(
            floats(parameters_at(block), kernel.parameter_size(n)),
            n,
            floats(old_at(block, n), size),
            u_proximal,
            u_distal,
            dt,
            floats(new_at(block, n), size),
            floats(work_at(block, n), kernel.work_size(n)),
        )

    @cfunc(_BEND, **options)
    def bend(model: int, data: int, tendon: int, n: int, angles: int) -> None:
        """Wrap angles of n segments along a tendon, to an address."""
        _ = stamp
        path.bend(model, data, tendon, floats(angles, n))

    @cfunc(_LAY, **options)
    def lay(block: int, angles: int) -> None:
        """Give the packed segments the wrap angles at an address."""
        _ = stamp
        n = load_word(block + SEGMENTS)
        prm = floats(parameters_at(block), kernel.parameter_size(n))
        wanted, present = floats(angles, n), kernel.segment_angles(prm, n)
        for j in range(n):
            if wanted[j] != present[j]:
                kernel.rebend(prm, n, wanted)
                store_word(block + KNOWN, 0)
                break

    @cfunc(types.void(types.intp, types.intp, types.int32, types.intp), **options)
    def limits(model: int, data: int, instance: int, out: int) -> None:
        """Longest stable time steps of both ends of an instance [s], to an address."""
        _ = stamp
        steps.limits(model, data, instance, floats(out, 2))

    @cfunc(_CHECK, **options)
    def check(model: int, data: int, instance: int) -> None:
        """Warn if the time step is too long for an end of the instance."""
        _ = stamp
        longest = np.empty(2)
        steps.limits(model, data, instance, longest)
        step = fields.timestep(model)
        distal = longest[1] < longest[0]
        limit = longest[1 if distal else 0]
        if step <= limit:
            return
        message = np.zeros(CAPACITY, np.uint8)
        used = append(message, 0, _START)
        used = quote(message, used, fields.plugin_name(model, instance))
        used = append(message, used, _START_END)
        used = steps.explain(message, used, distal, limit, step)
        if not said_before(message, used, fields.signature(model)):
            warn(message, used)

    export("cc_mujoco_limits", limits.address)
    export("cc_mujoco_check", check.address)
    export("cc_mujoco_refused", refused.address)
    export("cc_mujoco_pack", pack.address)
    export("cc_mujoco_advance", step.address)
    export("cc_mujoco_bend", bend.address)
    export("cc_mujoco_lay", lay.address)

    @cfunc(types.void(types.intp, types.intp, types.int32), **options)
    def settle(model: int, data: int, instance: int) -> None:
        """Lay the cable at rest, with its ends where they are at the last position."""
        _ = stamp
        block = fields.block(data, instance)
        if block == 0 or not _up_to_date(block, model, instance):
            return
        proximal_length = displacement(data, block, PROXIMAL)
        distal_length = displacement(data, block, DISTAL)
        state = fields.state(model, data, instance)
        _begin(block, model, state, proximal_length, distal_length, fields.time(data))

    export("cc_mujoco_settle", settle.address)
    address = types.intp
    integer = types.int32

    @cfunc(integer(address, integer), **options)
    def nstate(model: int, instance: int) -> int:
        _ = stamp
        n = max(config.segments(fields.attributes(model, instance)), 1)
        return kernel.state_size(n) + 1

    @cfunc(integer(address, address, integer), **options)
    def init(model: int, data: int, instance: int) -> int:
        _ = stamp
        fields.set_block(data, instance, 0)
        if _refused(model, instance) != 0:
            return -1
        attributes = fields.attributes(model, instance)
        n = config.segments(attributes)
        size = bends_at(0, n, 5)
        block = allocate(size)
        clear(block, size)
        _, first, second = ends.find(model, instance)
        store_word(block + SEGMENTS, n)
        store_word(block + PROXIMAL, ends.output(model, first))
        store_word(block + DISTAL, ends.output(model, second))
        _pack(block, model, instance)
        fields.set_block(data, instance, block)
        return 0

    @cfunc(types.void(address, integer), **options)
    def destroy(data: int, instance: int) -> None:
        _ = stamp
        block = fields.block(data, instance)
        if block != 0:
            release(block)
        fields.set_block(data, instance, 0)

    @cfunc(types.void(address, address, address, integer), **options)
    def reset(model: int, state: int, block: int, instance: int) -> None:
        _ = stamp
        if block == 0 or not _up_to_date(block, model, instance):
            return
        proximal_length = fields.real(
            model, fields.LENGTH0, load_word(block + PROXIMAL)
        )
        distal_length = fields.real(model, fields.LENGTH0, load_word(block + DISTAL))
        _begin(block, model, state, proximal_length, distal_length, 0.0)

    @cfunc(types.void(address, address, integer, integer), **options)
    def compute(model: int, data: int, instance: int, capability: int) -> None:
        _ = stamp
        block = fields.block(data, instance)
        if block == 0:
            return
        state = fields.state(model, data, instance)
        n = load_word(block + SEGMENTS)
        fits = _up_to_date(block, model, instance)
        u_proximal, lever = wound(model, block, displacement(data, block, PROXIMAL))
        u_distal = displacement(data, block, DISTAL)
        dt = 0.0
        if fits:
            dt = _elapsed(model, data, load_real(committed_time(state, n)))
            _follow(block, model, data)
            if load_real(block + CHECKED) != fields.timestep(model):
                store_real(block + CHECKED, fields.timestep(model))
                _check(model, data, instance)
        if fits and _evaluate(block, state, u_proximal, u_distal, dt):
            tension = new_at(block, n) + 8 * kernel.STATE_HEADER
            proximal = max(load_real(tension), 0.0) * lever
            distal = max(load_real(tension + 8 * n), 0.0)
        else:
            # MuJoCo sees the bad acceleration, warns and resets, as for any other.
            proximal, distal = np.nan, np.nan
        fields.set_force(data, load_word(block + PROXIMAL), proximal)
        fields.set_force(data, load_word(block + DISTAL), -distal)
        if fields.integrator(model) == _RK4:
            stages = block + STAGES
            copy(stages + STAGE, stages, 3 * STAGE)
            store_real(stages + 3 * STAGE, u_proximal)
            store_real(stages + 3 * STAGE + 8, u_distal)
            store_real(stages + 3 * STAGE + 16, dt)
            store_real(stages + 3 * STAGE + 24, fields.time(data))
            if load_word(block + ROUTE) >= 0:
                size = 8 * n
                copy(bends_at(block, n, 2), bends_at(block, n, 1), 3 * size)
                copy(bends_at(block, n, 0), bends_at(block, n, 4), size)

    @cfunc(types.void(address, address, integer), **options)
    def advance(model: int, data: int, instance: int) -> None:
        _ = stamp
        block = fields.block(data, instance)
        if block == 0 or not _up_to_date(block, model, instance):
            return
        state = fields.state(model, data, instance)
        n = load_word(block + SEGMENTS)
        u_proximal, _ = wound(model, block, displacement(data, block, PROXIMAL))
        u_distal = displacement(data, block, DISTAL)
        dt = fields.timestep(model)
        time = 0.0
        if fields.disabled(model, _NO_ACTUATION):
            # Nothing has evaluated the last position.
            _follow(block, model, data)
        if fields.integrator(model) == _RK4:
            # A step makes four evaluations; the first of them is committed. With
            # actuation disabled there are none, and the last position counts.
            time = fields.time(data) - dt
            stages = block + STAGES
            if (
                load_real(stages + 3 * STAGE) == u_proximal
                and load_real(stages + 3 * STAGE + 8) == u_distal
                and _bent_as_last(block)
            ):
                u_proximal = load_real(stages)
                u_distal = load_real(stages + 8)
                dt = load_real(stages + 16)
                time = load_real(stages + 24)
                if load_word(block + ROUTE) >= 0:
                    _lay(block, bends_at(block, n, 1))
        if _evaluate(block, state, u_proximal, u_distal, dt):
            new = new_at(block, n)
            for i in range(0, 8 * kernel.state_size(n), 8):
                store_word(state + i, load_word(new + i))
            store_real(committed_time(state, n), time)

    return {
        "nstate": nstate,
        "init": init,
        "destroy": destroy,
        "reset": reset,
        "compute": compute,
        "advance": advance,
    }
