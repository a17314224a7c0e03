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
evaluation and no state. So does the open part of a cable, with the lengths of its
pieces; as friction depends on what these gain from step to step, those of the committed
configuration are in `plugin_state`. Its pieces pull by `qfrc_passive`: MuJoCo evaluates
that before the actuators, so `compute` adds to it when it is asked for the actuator,
once for each time that it was evaluated.

Under RK4 the four stages are evaluated from the committed state too. The first stage is
at the configuration where the step begins, one time step after the committed one; the
later ones are half, half and one step further on, so that much time has passed for the
rate-dependent friction terms. The first stage is what `advance` commits.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from mujoco.introspect.enums import ENUMS
from numba import cfunc

from cc_mujoco.engine import ahead, config, ends, fields, jumps, path, pieces, steps
from cc_mujoco.engine.block import (
    AREA,
    CHECKED,
    DISTAL,
    DOFS,
    EVALUATION,
    EXPLICIT,
    FOLLOWS,
    FRESH,
    GUIDED,
    HOLDERS,
    INPUTS,
    INSTANCE,
    KNOWN,
    LOOKS,
    MOUTH,
    PROXIMAL,
    REFERENCE,
    REFERRED,
    ROUTE,
    SEEN,
    SEGMENTS,
    SHAPE,
    STAGE,
    STAGES,
    TEXT_CAPACITY,
    TEXT_SIZE,
    TIED,
    WALKED,
    committed_time,
    displacement,
    memory,
    new_at,
    old_at,
    opens,
    outdate,
    parameters_at,
    rest_displacement,
    shape_at,
    text_at,
    work_at,
    wound,
)
from cc_mujoco.engine.config import PLUGIN, constant
from cc_mujoco.engine.leading import compile_leading, follow, lay, pull, refer
from cc_mujoco.engine.memory import (
    CAPACITY,
    Bytes,
    allocate,
    append,
    append_integer,
    append_millimetres,
    assign,
    clear,
    copy,
    copy_words,
    export,
    fill,
    floats,
    internal,
    load_byte,
    load_real,
    load_word,
    quote,
    release,
    said_before,
    same_words,
    store_real,
    store_word,
    types,
    warn,
)
from cc_mujoco.transmission import kernel, packing
from cc_mujoco.transmission.parameters import MAX_SECTIONS

_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
_NO_ACTUATION = int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
_NO_SPRING = int(mujoco.mjtDisableBit.mjDSBL_SPRING)
_NO_DAMPER = int(mujoco.mjtDisableBit.mjDSBL_DAMPER)
_PASSIVE = int(ENUMS["mjtPluginCapabilityBit"].values["mjPLUGIN_PASSIVE"])

_NEAR = 0.02
"""Part by which the length of `conduit` may differ from that of the path it is."""

_START = constant(f"plugin `{PLUGIN}`, instance ")
_START_END = constant(": ")
_FEW = constant("key `segments` is too small: its path needs at least ")
_LENGTH = constant("key `conduit` has the wrong length: the path of its tendon is ")
_LENGTH_END = constant(" long in the pose `qpos0`")
_IDLE = constant(
    "`actuation` is disabled in <flag>, so the cable does not pull; its tensions are "
    "those that it would have"
)
_GROUP = constant(
    "an end is in a group of `actuatorgroupdisable`, which MuJoCo does not heed for "
    "plugins; the cable pulls all the same"
)
_NO_PASSIVE = constant(
    "an open path pulls by passive forces; enable `spring` or `damper` in <flag>"
)


# The large functions are compiled once each and called by name; as Numba functions they
# would be compiled again inside every callback that calls them.
_REFUSED = types.int32(types.intp, types.int32)
_PACK = types.int32(types.intp, types.intp, types.int32)
_refused = types.ExternalFunction("cc_mujoco_refused", _REFUSED)
_pack = types.ExternalFunction("cc_mujoco_pack", _PACK)
_TURN = types.float64(types.intp, types.intp, types.int32)
_WRAP = types.void(types.intp, types.intp, types.int32, types.intp)
_limits = types.ExternalFunction("cc_mujoco_limits", _WRAP)
_aim = types.ExternalFunction("cc_mujoco_aim", _WRAP)
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
def _bent_as_last(block: int) -> bool:
    """Whether the path is now what it was at the last stage of RK4."""
    n = load_word(block + SEGMENTS)
    now, last = shape_at(block, n, 0), shape_at(block, n, 4)
    return same_words(now, last, load_word(block + SHAPE) // 8)


@internal
def _no_passive(model: int) -> bool:
    """Whether MuJoCo evaluates no passive forces."""
    no_spring = fields.disabled(model, _NO_SPRING)
    return no_spring and fields.disabled(model, _NO_DAMPER)


@internal
def _warn_once(model: int, instance: int, told: Bytes) -> None:
    """Warn, once, of something about an instance."""
    message = np.zeros(CAPACITY, np.uint8)
    used = append(message, 0, _START)
    used = quote(message, used, fields.plugin_name(model, instance))
    used = append(message, used, _START_END)
    used = append(message, used, told)
    if not said_before(message, used, fields.signature(model)):
        warn(message, used)


@internal
def _warn_jump(
    model: int,
    data: int,
    instance: int,
    state: int,
    proximal: float,
    distal: float,
    shape: int,
) -> None:
    """Warn, once, if an end or the path has jumped from where it is in the state.

    `shape` is the address of the path where it is now.
    """
    block = fields.block(data, instance)
    if load_word(block + EXPLICIT) != 0:  # which joints that are led by hand need
        return
    n, tendon = load_word(block + SEGMENTS), load_word(block + ROUTE)
    for what in range(3):
        if what == jumps.PATH:
            if not opens(block) or load_word(block + MOUTH) != 0:
                continue
            size = pieces.shape_size(n)
            reference = floats(shape_at(block, n, REFERENCE), size)
            moved = pieces.growth(floats(shape, size), reference, memory(state, n), n)
            speed = fields.real(data, fields.TEN_VELOCITY, tendon)
        else:
            if load_word(block + TIED + 8 * what) != 0:
                continue
            moved = (distal if what else proximal) - load_real(state + 8 * what)
            out = load_word(block + (DISTAL if what else PROXIMAL))
            speed = fields.real(data, fields.VELOCITY, out)
        if not jumps.jumped(model, speed, moved):
            continue
        message = np.zeros(CAPACITY, np.uint8)
        used = append(message, 0, _START)
        used = quote(message, used, fields.plugin_name(model, instance))
        used = append(message, used, _START_END)
        used = jumps.explain(message, used, what)
        if not said_before(message, used, fields.signature(model)):
            warn(message, jumps.add_size(message, used, moved))


@internal
def _open_refused(
    message: Bytes, start: int, model: int, instance: int, tendon: int
) -> tuple[int, int]:
    """Why a cable cannot lie open along a tendon.

    Returns:
        The key that cannot be used or `VALID`, and the length of the message, in which
        is what `config.explain` cannot tell.
    """
    if path.branches(model, tendon):
        return config.PATH, start
    attributes = fields.attributes(model, instance)
    mouth = 0
    if config.mixed(attributes):
        route = config.value(attributes, config.ROUTE)
        name = config.value(attributes, config.MOUTH)
        mouth = ends.find_mouth(model, instance, tendon, route, name)
        if mouth < 0:
            return config.MOUTH, start
    least = pieces.needed(model, tendon, mouth) + (1 if mouth > 0 else 0)
    if config.segments(attributes) < max(least, 1):
        used = append(message, start, _FEW)
        return config.VALID, append_integer(message, used, max(least, 1))
    if mouth == 0:
        length = config.length(attributes)
        true = fields.real(model, fields.TENDON_LENGTH0, tendon)
        if abs(length - true) > _NEAR * true:
            used = append(message, start, _LENGTH)
            used = append_millimetres(message, used, true)
            return config.VALID, append(message, used, _LENGTH_END)
    if _no_passive(model):
        return config.VALID, append(message, start, _NO_PASSIVE)
    used = ends.explain_bypass(message, start, model, instance, tendon)
    if used > start:
        return config.VALID, used
    return config.VALID, ends.explain_tied(message, start, model, instance, tendon)


@internal
def _follow_all(model: int, data: int, instance: int) -> None:
    """Lead all open cables along their paths, so that their meshes are known."""
    for other in range(fields.plugins(model)):
        kind = fields.integer(model, fields.PLUGIN, other)
        if kind == fields.integer(model, fields.PLUGIN, instance):
            block = fields.block(data, other)
            if block != 0 and opens(block):
                follow(block, model, data, fields.state(model, data, other))


@internal
def _follow_others(model: int, data: int, instance: int, evaluation: int) -> None:
    """Lead all open cables along their paths that were not in this evaluation."""
    for other in range(fields.plugins(model)):
        kind = fields.integer(model, fields.PLUGIN, other)
        if kind == fields.integer(model, fields.PLUGIN, instance):
            block = fields.block(data, other)
            walked = block == 0 or load_word(block + WALKED) == evaluation
            if not walked and opens(block):
                follow(block, model, data, fields.state(model, data, other))
                store_word(block + WALKED, evaluation)


@internal
def _inputs(block: int) -> tuple[float, float, tuple[float, float], float]:
    """What the last evaluation was of: displacements, how far ends yield, and dt."""
    at = block + INPUTS
    yields = load_real(at + 16), load_real(at + 24)
    return load_real(at), load_real(at + 8), yields, load_real(at + 32)


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
    block: int,
    state: int,
    u_proximal: float,
    u_distal: float,
    yield_proximal: float,
    yield_distal: float,
    dt: float,
) -> bool:
    """Evaluate from the committed state at address `state`, unless that is known.

    The parameters must be up to date. Arguments as in `kernel.step` and
    `kernel.expect_yielding`.

    Returns:
        Whether the new state, in the block, is finite.
    """
    n = load_word(block + SEGMENTS)
    old = old_at(block, n)
    size = kernel.state_size(n)
    known = load_word(block + KNOWN) == 1
    given = (u_proximal, u_distal, yield_proximal, yield_distal, dt)
    for i in range(5):
        before = load_word(block + INPUTS + 8 * i)
        store_real(block + INPUTS + 8 * i, given[i])
        known = known and before == load_word(block + INPUTS + 8 * i)
    if known and same_words(old, state, size):
        return True
    copy_words(state, old, size)
    prm = floats(parameters_at(block), kernel.parameter_size(n))
    kernel.expect_yielding(prm, yield_proximal, yield_distal)
    status = kernel.step(
        prm, n, floats(old, size), kernel.POSITION, u_proximal, kernel.POSITION,
        u_distal, dt, floats(new_at(block, n), size),
        floats(work_at(block, n), kernel.work_size(n)),
    )  # fmt: skip
    store_word(block + KNOWN, 1 if status == kernel.OK else 0)
    return status == kernel.OK


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
    if opens(block):
        fill(memory(state, n), 0.0)


def compile_callbacks(stamp: str, cache: bool) -> dict[str, Any]:
    """Compile the callbacks.

    Args:
        stamp: what their code depends on besides this file; part of their cache key.
        cache: whether to keep the compiled code on disk.
    """
    options: Any = {"cache": cache, "error_model": "numpy"}
    compile_leading(stamp, options)

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
                elif config.opens(attributes):
                    key, used = _open_refused(message, start, model, instance, tendon)
            if key != config.VALID:
                used = config.explain(message, start, attributes, key)
        if used > start:
            warn(message, used)
        return used > start

    export("cc_mujoco_refused", refused.address)

    @cfunc(_REFUSED, **options)
    def route(model: int, instance: int) -> int:
        """The spatial tendon that is the route of the instance, or -1."""
        _ = stamp
        attributes = fields.attributes(model, instance)
        written = config.value(attributes, config.ROUTE)
        return ends.find_route(model, instance, written)

    export("cc_mujoco_route", route.address)

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
        outdate(block)
        store_word(block + WALKED, 0)
        store_word(block + TEXT_SIZE, 0)
        if key != config.VALID or config.segments(attributes) != n:
            return 0
        prm = floats(parameters_at(block), kernel.parameter_size(n))
        kernel.pack(values, sections[:count], n, prm)
        tendon, mouth, guided = -1, 0, n
        follows, free = config.moves(attributes), config.opens(attributes)
        if follows or free:
            route = config.value(attributes, config.ROUTE)
            tendon = ends.find_route(model, instance, route)
            if tendon < 0 or path.branches(model, tendon):
                return 0
            kernel.expect_change(prm)
        if free:
            kernel.expect_lengthening(prm)
            guided = 0
            if config.mixed(attributes):
                name = config.value(attributes, config.MOUTH)
                mouth = ends.find_mouth(model, instance, tendon, route, name)
                if mouth < 0:
                    return 0
                guided = n - pieces.wanted(model, tendon, mouth, pieces.ARC)
                guided = max(guided, 1)
            if n - guided < pieces.needed(model, tendon, mouth):
                return 0
        store_word(block + ROUTE, tendon)
        store_word(block + FOLLOWS, 1 if follows and guided > 0 else 0)
        store_word(block + MOUTH, mouth)
        store_word(block + GUIDED, guided)
        store_word(block + REFERRED, 0)
        store_word(block + EXPLICIT, 1 if config.explicit(attributes) else 0)
        size = config.block_size(attributes)
        if size <= TEXT_CAPACITY:
            copy(attributes, text_at(block, n), size)
            store_word(block + TEXT_SIZE, size)
        return 1

    export("cc_mujoco_pack", pack.address)

    @cfunc(_TURN, **options)
    def turn(model: int, data: int, tendon: int) -> float:
        """Sum of the turning angles of a tendon's path at the last position [rad]."""
        _ = stamp
        whole, total = np.ones(1), np.empty(1)
        points = fields.integer(data, fields.TEN_WRAPNUM, tendon)
        length = fields.real(data, fields.TEN_LENGTH, tendon)
        path.bend(model, data, tendon, points, length, whole, total)
        return float(total[0])

    export("cc_mujoco_turn", turn.address)

    @cfunc(_WRAP, **options)
    def wrap(model: int, data: int, instance: int, out: int) -> None:
        """Wrap angles of the segments of an instance at the last position."""
        _ = stamp
        block = fields.block(data, instance)
        if block == 0 or not _up_to_date(block, model, instance):
            return
        follow(block, model, data, fields.state(model, data, instance))
        n = load_word(block + SEGMENTS)
        prm = floats(parameters_at(block), kernel.parameter_size(n))
        assign(floats(out, n), kernel.segment_angles(prm, n))

    export("cc_mujoco_wrap", wrap.address)

    @cfunc(_WRAP, **options)
    def compliance(model: int, data: int, instance: int, out: int) -> None:
        """Compliance of the nodes of an instance [m/N], then its elastic energy [J]."""
        _ = stamp
        block = fields.block(data, instance)
        if block == 0 or not _up_to_date(block, model, instance):
            return
        if opens(block) and load_word(block + REFERRED) == 0:
            refer(block, model, data)
        n = load_word(block + SEGMENTS)
        prm = floats(parameters_at(block), kernel.parameter_size(n))
        state = fields.state(model, data, instance)
        found = floats(out, n + 2)
        assign(found[: n + 1], packing.node_compliance(prm, n))
        found[n + 1] = kernel.stored(prm, n, floats(state, kernel.state_size(n)))

    export("cc_mujoco_compliance", compliance.address)

    @cfunc(_WRAP, **options)
    def limits(model: int, data: int, instance: int, out: int) -> None:
        """Longest stable time steps of an instance (3,) [s], to an address."""
        _ = stamp
        _follow_all(model, data, instance)
        steps.limits(model, data, instance, floats(out, 3))

    export("cc_mujoco_limits", limits.address)

    @cfunc(_WRAP, **options)
    def aim(model: int, data: int, instance: int, out: int) -> None:
        """Where to evaluate the ends of an instance, see `ahead.aim`, to an address."""
        _ = stamp
        kind = fields.integer(model, fields.PLUGIN, instance)
        lead = fields.block(data, ahead.first(model, instance))
        area = lead + load_word(lead + AREA)
        if ahead.unknown(area):
            _follow_others(model, data, instance, load_word(lead + EVALUATION))
            ahead.foresee(model, data, kind, area)
        block = fields.block(data, instance)
        ahead.aim(model, data, block, kind, area, floats(out, 4))

    export("cc_mujoco_aim", aim.address)

    @cfunc(_CHECK, **options)
    def check(model: int, data: int, instance: int) -> None:
        """Warn if the time step is too long for the instance, or its ends are not fit.

        What was refused at load can also be set on the compiled model.
        """
        _ = stamp
        message = np.zeros(CAPACITY, np.uint8)
        used = append(message, 0, _START)
        used = quote(message, used, fields.plugin_name(model, instance))
        start = append(message, used, _START_END)
        used = ends.explain(message, start, model, instance)
        block = fields.block(data, instance)
        if used == start and opens(block):
            tendon = load_word(block + ROUTE)
            used = ends.explain_bypass(message, start, model, instance, tendon)
        if used > start and not said_before(message, used, fields.signature(model)):
            warn(message, used)
        longest = np.empty(3)
        _limits(model, data, instance, longest.ctypes.data)
        if ahead.implicit(model, block):
            longest[0] = longest[1] = np.inf
        step, worst = fields.timestep(model), int(np.argmin(longest))
        limit = longest[worst]
        if step <= limit:
            return
        used = steps.explain(message, start, worst, limit, step)
        if not said_before(message, used, fields.signature(model)):
            warn(message, used)

    export("cc_mujoco_check", check.address)

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
        if opens(block):
            n = load_word(block + SEGMENTS)
            follow(block, model, data, state)
            shape = floats(shape_at(block, n, 0), pieces.shape_size(n))
            pieces.remember(shape, n, memory(state, n))

    export("cc_mujoco_settle", settle.address)

    address = types.intp
    integer = types.int32

    @cfunc(integer(address, integer), **options)
    def nstate(model: int, instance: int) -> int:
        _ = stamp
        attributes = fields.attributes(model, instance)
        n = max(config.segments(attributes), 1)
        more = pieces.memory_size(n) if config.opens(attributes) else 0
        return kernel.state_size(n) + 1 + more

    @cfunc(integer(address, address, integer), **options)
    def init(model: int, data: int, instance: int) -> int:
        _ = stamp
        fields.set_block(data, instance, 0)
        if _refused(model, instance) != 0:
            return -1
        attributes = fields.attributes(model, instance)
        n = config.segments(attributes)
        free = config.opens(attributes)
        shape = 8 * (pieces.shape_size(n) if free else n)
        pulls = 8 * (2 * fields.dofs(model) + n + 1) if free else 0
        # Its parts follow each other from the header on, whatever is in it.
        own = text_at(0, n) + TEXT_CAPACITY + (REFERENCE + 1) * shape + pulls
        area = ahead.area_size(model) if ahead.first(model, instance) == instance else 0
        block = allocate(own + area)
        clear(block, own + area)
        store_word(block + AREA, own if area > 0 else 0)
        _, first, second = ends.find(model, instance)
        store_word(block + SEGMENTS, n)
        store_word(block + SHAPE, shape)
        store_word(block + INSTANCE, instance)
        store_word(block + DOFS, fields.dofs(model))
        store_word(block + PROXIMAL, ends.output(model, first))
        store_word(block + DISTAL, ends.output(model, second))
        store_word(block + HOLDERS, first)
        store_word(block + HOLDERS + 8, second)
        if free:
            route = config.value(attributes, config.ROUTE)
            tendon = ends.find_route(model, instance, route)
            store_word(block + TIED, 1 if ends.tied(model, first, tendon) else 0)
            store_word(block + TIED + 8, 1 if ends.tied(model, second, tendon) else 0)
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
        store_real(block + CHECKED, 0.0)
        # The pose `qpos0` may be another since.
        store_word(block + REFERRED, 0)
        proximal_length = rest_displacement(model, block, PROXIMAL)
        distal_length = rest_displacement(model, block, DISTAL)
        _begin(block, model, state, proximal_length, distal_length, 0.0)

    @cfunc(types.void(address, address, integer, integer), **options)
    def compute(model: int, data: int, instance: int, capability: int) -> None:
        _ = stamp
        block = fields.block(data, instance)
        if block == 0:
            return
        if capability == _PASSIVE:
            store_word(block + FRESH, 1)
            return
        lead = fields.block(data, ahead.first(model, instance))
        if lead == block:
            ahead.forget(lead)
        cut = opens(block) and _no_passive(model)
        state = fields.state(model, data, instance)
        n = load_word(block + SEGMENTS)
        fits = _up_to_date(block, model, instance)
        u_proximal, lever = wound(model, block, displacement(data, block, PROXIMAL))
        u_distal = displacement(data, block, DISTAL)
        seen = u_proximal, u_distal
        yields = 0.0, 0.0
        dt = 0.0
        if fits:
            dt = _elapsed(model, data, load_real(committed_time(state, n)))
            evaluation = load_word(lead + EVALUATION)
            if load_word(block + WALKED) != evaluation:
                follow(block, model, data, state)
                store_word(block + WALKED, evaluation)
            if load_real(block + CHECKED) != fields.timestep(model):
                store_real(block + CHECKED, fields.timestep(model))
                _check(model, data, instance)
            looks = ahead.implicit(model, block)
            store_word(block + LOOKS, 1 if looks else 0)
            if looks and dt > fields.timestep(model):
                # A later stage of RK4: as the first one.
                u_proximal, u_distal, yields, dt = _inputs(block)
            elif looks:
                aim = np.empty(4)
                _aim(model, data, instance, aim.ctypes.data)
                u_proximal, u_distal, yields = aim[0], aim[1], (aim[2], aim[3])
        store_word(block + WALKED, 0)
        if cut:
            _warn_once(model, instance, _NO_PASSIVE)
        store_real(block + SEEN, seen[0])
        store_real(block + SEEN + 8, seen[1])
        if (
            fits
            and not cut
            and _evaluate(block, state, u_proximal, u_distal, yields[0], yields[1], dt)
        ):
            tension = new_at(block, n) + 8 * kernel.STATE_HEADER
            proximal = max(load_real(tension), 0.0) * lever
            distal = max(load_real(tension + 8 * n), 0.0)
        else:
            # MuJoCo sees the bad acceleration, warns and resets, as for any other.
            proximal, distal = np.nan, np.nan
        fields.set_force(data, load_word(block + PROXIMAL), proximal)
        fields.set_force(data, load_word(block + DISTAL), -distal)
        if opens(block):
            pull(block, model, data)
        if fields.integrator(model) == _RK4:
            stages = block + STAGES
            copy(stages + STAGE, stages, 3 * STAGE)
            store_real(stages + 3 * STAGE, seen[0])
            store_real(stages + 3 * STAGE + 8, seen[1])
            store_real(stages + 3 * STAGE + 16, dt)
            store_real(stages + 3 * STAGE + 24, fields.time(data))
            if load_word(block + ROUTE) >= 0:
                size = load_word(block + SHAPE)
                copy(shape_at(block, n, 2), shape_at(block, n, 1), 3 * size)
                copy(shape_at(block, n, 0), shape_at(block, n, 4), size)

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
        if fields.integrator(model) != _RK4:  # where these are of its last stage
            now = shape_at(block, n, 0)
            _warn_jump(model, data, instance, state, u_proximal, u_distal, now)
        if ends.idle(model, instance):
            _warn_once(model, instance, _GROUP)
        dt = fields.timestep(model)
        time = 0.0
        yields = 0.0, 0.0
        if fields.disabled(model, _NO_ACTUATION):
            # Nothing has evaluated the last position.
            _warn_once(model, instance, _IDLE)
            follow(block, model, data, state)
        elif (
            fields.integrator(model) != _RK4
            and load_real(block + SEEN) == u_proximal
            and load_real(block + SEEN + 8) == u_distal
        ):
            # What was applied is what the step did, whatever it looked ahead to.
            u_proximal, u_distal = (
                load_real(block + INPUTS),
                load_real(block + INPUTS + 8),
            )
            yields = load_real(block + INPUTS + 16), load_real(block + INPUTS + 24)
        shape = shape_at(block, n, 0)
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
                first = shape_at(block, n, 1)
                _warn_jump(model, data, instance, state, u_proximal, u_distal, first)
                dt = load_real(stages + 16)
                time = load_real(stages + 24)
                if load_word(block + LOOKS) == 1:
                    u_proximal, u_distal, yields, dt = _inputs(block)
                if load_word(block + ROUTE) >= 0:
                    shape = first
                    lay(block, shape, state)
        if _evaluate(block, state, u_proximal, u_distal, yields[0], yields[1], dt):
            copy_words(new_at(block, n), state, kernel.state_size(n))
            store_real(committed_time(state, n), time)
            if opens(block):
                seen = floats(shape, pieces.shape_size(n))
                pieces.remember(seen, n, memory(state, n))

    return {
        "nstate": nstate,
        "init": init,
        "destroy": destroy,
        "reset": reset,
        "compute": compute,
        "advance": advance,
    }
