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

Under RK4 the first stage is evaluated from the committed state, one time step before,
and is what `advance` commits. The later ones are half, half and one step further on;
they are evaluated from the state after the first stage, which the block keeps.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from mujoco.introspect.enums import ENUMS
from numba import cfunc

from cc_mujoco.engine import (
    ahead,
    config,
    ends,
    fields,
    guides,
    jumps,
    path,
    pieces,
    steps,
)
from cc_mujoco.engine.block import (
    AREA,
    BEGUN,
    CHECKED,
    DISTAL,
    DOFS,
    EARLY,
    EVALUATION,
    EXPLICIT,
    FIRST,
    FOLLOWS,
    FOR_NOW,
    FRESH,
    GUIDED,
    HOLDERS,
    INPUTS,
    INSTANCE,
    KEPT,
    KNOWN,
    MOCAPS,
    MOUTH,
    PATH,
    PROXIMAL,
    REFERENCE,
    REFERRED,
    ROUTE,
    SEEN,
    SEGMENTS,
    SHAPE,
    STAGE,
    STAGES,
    STIFFEST,
    TEXT_CAPACITY,
    TEXT_SIZE,
    TIED,
    TOUCHED,
    WALKED,
    before_at,
    committed_time,
    displacement,
    memory,
    new_at,
    opens,
    outdate,
    parameters_at,
    pose_at,
    pulls_at,
    rest_displacement,
    shape_at,
    text_at,
    wound,
)
from cc_mujoco.engine.evaluation import (
    PACK,
    RK4,
    begin,
    bent_as_last,
    evaluate,
    evaluated,
    follow_all,
    follow_others,
    inputs,
    note_first,
    note_motion,
    origin,
    repack,
    stiffened,
    up_to_date,
)
from cc_mujoco.engine.leading import compile_leading, follow, lay, pull, refer
from cc_mujoco.engine.memory import (
    CAPACITY,
    allocate,
    append,
    assign,
    clear,
    copy,
    copy_words,
    export,
    floats,
    load_real,
    load_word,
    release,
    said_before,
    store_real,
    store_word,
    types,
    warn,
)
from cc_mujoco.engine.telling import (
    GROUP,
    IDLE,
    NO_PASSIVE,
    no_passive,
    open_refused,
    opening,
    warn_jump,
    warn_once,
    warn_order,
    warn_unfelt,
)
from cc_mujoco.transmission import kernel, material, packing
from cc_mujoco.transmission.parameters import MAX_SECTIONS

_NO_ACTUATION = int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
_SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
_PASSIVE = int(ENUMS["mjtPluginCapabilityBit"].values["mjPLUGIN_PASSIVE"])


# The large functions are compiled once each and called by name; as Numba functions they
# would be compiled again inside every callback that calls them.
_REFUSED = types.int32(types.intp, types.int32)
_refused = types.ExternalFunction("cc_mujoco_refused", _REFUSED)
_TURN = types.float64(types.intp, types.intp, types.int32)
_WRAP = types.void(types.intp, types.intp, types.int32, types.intp)
_limits = types.ExternalFunction("cc_mujoco_limits", _WRAP)
_aim = types.ExternalFunction("cc_mujoco_aim", _WRAP)
_CHECK = types.void(types.intp, types.intp, types.int32)
_warn_missed = types.ExternalFunction("cc_mujoco_missed", _CHECK)
_undo_early = types.ExternalFunction("cc_mujoco_undo_early", _CHECK)
_pull_early = types.ExternalFunction("cc_mujoco_pull_early", _CHECK)
_check = types.ExternalFunction("cc_mujoco_check", _CHECK)


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
        """Return whether the instance cannot be used; if so, report why to MuJoCo."""
        _ = stamp
        message = np.zeros(CAPACITY, np.uint8)
        start = opening(message, model, instance)
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
            tendon, mouth = -1, 0
            if key == config.VALID and route.size > 0:
                tendon = ends.find_route(model, instance, route)
                if tendon < 0:
                    key = config.ROUTE
                elif config.moves(attributes) and path.branches(model, tendon):
                    key = config.BEND
                elif config.opens(attributes):
                    key, used = open_refused(message, start, model, instance, tendon)
            if key != config.VALID:
                used = config.explain(message, start, attributes, key)
            if used == start:
                if config.mixed(attributes):
                    name = config.value(attributes, config.MOUTH)
                    mouth = ends.find_mouth(model, instance, tendon, route, name)
                path_open = tendon if config.opens(attributes) else -1
                body = ends.keep_awake(model, instance, path_open, mouth)
                used = ends.explain_sleep(message, start, model, body)
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

    @cfunc(PACK, **options)
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
        if block == 0 or not up_to_date(block, model, instance):
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
        if block == 0 or not up_to_date(block, model, instance):
            return
        if opens(block) and load_word(block + REFERRED) == 0:
            refer(block, model, data)
        n = load_word(block + SEGMENTS)
        prm = floats(parameters_at(block), kernel.parameter_size(n))
        at_state = fields.state(model, data, instance)
        state = floats(at_state, kernel.state_size(n))
        if opens(block):
            # The packed nodes are those of the next step.
            prm = prm.copy()
            reference = floats(shape_at(block, n, REFERENCE), pieces.shape_size(n))
            before = pieces.lengths_before(reference, memory(at_state, n), n)
            material.loosen(prm, n, packing.tensions(state, n), before)
        found = floats(out, n + 2)
        assign(found[: n + 1], packing.node_compliance(prm, n))
        found[n + 1] = kernel.stored(prm, n, state)

    export("cc_mujoco_compliance", compliance.address)

    @cfunc(_WRAP, **options)
    def limits(model: int, data: int, instance: int, out: int) -> None:
        """Longest stable time steps of an instance (3,) [s], to an address."""
        _ = stamp
        follow_all(model, data, instance)
        steps.limits(model, data, instance, floats(out, 3))

    export("cc_mujoco_limits", limits.address)

    @cfunc(_WRAP, **options)
    def aim(model: int, data: int, instance: int, out: int) -> None:
        """Write where to evaluate an instance's ends to an address, see `ahead.aim`."""
        _ = stamp
        kind = fields.integer(model, fields.PLUGIN, instance)
        lead = fields.block(data, ahead.first(model, instance))
        area = lead + load_word(lead + AREA)
        if ahead.unknown(area):
            follow_others(model, data, instance, load_word(lead + EVALUATION))
            ahead.foresee(model, data, kind, area)
        block = fields.block(data, instance)
        ahead.aim(model, data, block, kind, area, floats(out, 4))

    export("cc_mujoco_aim", aim.address)

    @cfunc(_CHECK, **options)
    def missed(model: int, data: int, instance: int) -> None:
        """Warn, once, of each geom in the path of an instance that it never touches."""
        _ = stamp
        message = np.zeros(CAPACITY, np.uint8)
        start = opening(message, model, instance)
        used = append(message, start, guides.SEARCHED)
        if said_before(message, used, fields.signature(model)):
            return
        tendon = load_word(fields.block(data, instance) + ROUTE)
        touched = np.zeros(fields.integer(model, fields.TENDON_NUM, tendon), np.uint8)
        guides.search(model, data, tendon, touched)
        for place in range(touched.size):
            if touched[place] == 0:
                used = guides.explain(message, start, model, tendon, place)
                warn(message, used)

    export("cc_mujoco_missed", missed.address)

    @cfunc(_CHECK, **options)
    def check(model: int, data: int, instance: int) -> None:
        """Warn if the time step is too long for the instance, or its ends are not fit.

        What was refused at load can also be set on the compiled model.
        """
        _ = stamp
        message = np.zeros(CAPACITY, np.uint8)
        start = opening(message, model, instance)
        used = ends.explain(message, start, model, instance)
        block = fields.block(data, instance)
        if used == start and opens(block):
            tendon = load_word(block + ROUTE)
            used = ends.explain_bypass(message, start, model, instance, tendon)
        if used > start and not said_before(message, used, fields.signature(model)):
            warn(message, used)
        if opens(block):
            warn_unfelt(model, instance, block)
        if load_word(block + ROUTE) >= 0:
            _warn_missed(model, data, instance)
        warn_order(model, instance)
        longest = np.empty(3)
        _limits(model, data, instance, longest.ctypes.data)
        if ahead.implicit(model, block):
            longest[0] = longest[1] = np.inf
        step, worst = fields.timestep(model), int(np.argmin(longest))
        limit = longest[worst]
        if step <= limit:
            return
        used = steps.name(message, start, worst, step)
        if not said_before(message, used, fields.signature(model)):
            warn(message, steps.explain(message, start, worst, limit, step))

    export("cc_mujoco_check", check.address)

    @cfunc(_CHECK, **options)
    def pull_early(model: int, data: int, instance: int) -> None:
        """Pull with the pieces of an open cable before its actuators are evaluated.

        `mj_inverse` evaluates passive forces, but no actuators. Where the acceleration
        is given, an implicit end looks ahead by that.
        """
        _ = stamp
        block = fields.block(data, instance)
        if fields.disabled(model, _NO_ACTUATION) or no_passive(model):
            return
        if not up_to_date(block, model, instance):
            return
        lead = fields.block(data, ahead.first(model, instance))
        state, dt = origin(block, model, data, instance)
        follow(block, model, data, state)
        store_word(block + WALKED, load_word(lead + EVALUATION) + 1)
        u_proximal = wound(model, block, displacement(data, block, PROXIMAL))[0]
        u_distal = displacement(data, block, DISTAL)
        known, looks = True, ahead.implicit(model, block)
        if not looks:
            known = evaluate(block, state, u_proximal, u_distal, 0.0, 0.0, dt)
        elif not evaluated(block, data, state, u_proximal, u_distal):
            u_proximal = ahead.reached(model, data, block, 0)
            u_distal = ahead.reached(model, data, block, 1)
            known = evaluate(block, state, u_proximal, u_distal, 0.0, 0.0, dt)
        if known:
            pull(block, model, data)
            store_word(block + EARLY, FOR_NOW if looks else KEPT)

    export("cc_mujoco_pull_early", pull_early.address)

    @cfunc(_CHECK, **options)
    def undo_early(model: int, data: int, instance: int) -> None:
        """Take back the early pulls of implicit cables, to the last bit.

        They depend on an acceleration that is no part of the state; what is left of
        them by rounding must not reach the simulation.
        """
        _ = stamp
        kind, nv = fields.integer(model, fields.PLUGIN, instance), fields.dofs(model)
        passive = floats(load_word(data + fields.PASSIVE), nv)
        for other in range(fields.plugins(model) - 1, -1, -1):
            block = 0
            if fields.integer(model, fields.PLUGIN, other) == kind:
                block = fields.block(data, other)
            if block == 0 or load_word(block + EARLY) != FOR_NOW:
                continue
            n = load_word(block + SEGMENTS)
            pulls = floats(pulls_at(block, n), nv)
            before = floats(before_at(block, n), nv)
            for i in range(nv):
                # Unless another plugin has added to it since.
                if passive[i] == before[i] + pulls[i]:
                    passive[i] = before[i]
                else:
                    passive[i] -= pulls[i]
            store_word(block + FRESH, 1)
            store_word(block + EARLY, 0)

    export("cc_mujoco_undo_early", undo_early.address)

    @cfunc(types.void(types.intp, types.intp, types.int32), **options)
    def settle(model: int, data: int, instance: int) -> None:
        """Lay the cable at rest, with its ends where they are at the last position."""
        _ = stamp
        block = fields.block(data, instance)
        if block == 0 or not up_to_date(block, model, instance):
            return
        proximal_length = displacement(data, block, PROXIMAL)
        distal_length = displacement(data, block, DISTAL)
        state = fields.state(model, data, instance)
        begin(block, model, state, proximal_length, distal_length, fields.time(data))
        store_real(
            pose_at(state, load_word(block + SEGMENTS)),
            jumps.pose(model, data),
        )
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
        return kernel.state_size(n) + PATH + more

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
        pulls = 8 * (3 * fields.dofs(model) + n + 1) if free else 0
        # Its parts follow each other from the header on, whatever is in it.
        own = text_at(0, n) + TEXT_CAPACITY + (REFERENCE + 1) * shape + pulls
        kept, area, poses = own, 0, 0
        own += 8 * (kernel.state_size(n) + PATH)
        own += 8 * pieces.memory_size(n) if free else 0
        if ahead.first(model, instance) == instance:
            area, poses = ahead.area_size(model), jumps.poses_size(model)
        block = allocate(own + area + poses)
        clear(block, own + area + poses)
        store_word(block + FIRST, kept)
        store_word(block + AREA, own if area > 0 else 0)
        store_word(block + MOCAPS, own + area if poses > 0 else 0)
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
        repack(block, model, instance)
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
        if block == 0 or not up_to_date(block, model, instance):
            return
        store_real(block + CHECKED, 0.0)
        store_real(block + STIFFEST, 0.0)
        jumps.forget_poses(model, block)
        # The pose `qpos0` may be another since.
        store_word(block + REFERRED, 0)
        proximal_length = rest_displacement(model, block, PROXIMAL)
        distal_length = rest_displacement(model, block, DISTAL)
        begin(block, model, state, proximal_length, distal_length, 0.0)
        rest = load_word(model + fields.REST)
        n = load_word(block + SEGMENTS)
        store_real(pose_at(state, n), jumps.checksum(model, rest))

    @cfunc(types.void(address, address, integer, integer), **options)
    def compute(model: int, data: int, instance: int, capability: int) -> None:
        _ = stamp
        block = fields.block(data, instance)
        if block == 0:
            return
        if capability == _PASSIVE:
            store_word(block + FRESH, 1)
            store_word(block + EARLY, 0)
            if opens(block):
                _pull_early(model, data, instance)
            return
        lead = fields.block(data, ahead.first(model, instance))
        if lead == block:
            ahead.forget(lead)
            _undo_early(model, data, instance)
        cut = opens(block) and no_passive(model)
        if fields.enabled(model, _SLEEP):
            route = load_word(block + ROUTE) if opens(block) else -1
            ends.keep_awake(model, instance, route, load_word(block + MOUTH))
        n = load_word(block + SEGMENTS)
        fits = up_to_date(block, model, instance)
        state, dt = origin(block, model, data, instance)
        begins = state == fields.state(model, data, instance)
        u_proximal, lever = wound(model, block, displacement(data, block, PROXIMAL))
        u_distal = displacement(data, block, DISTAL)
        seen = u_proximal, u_distal
        yields = 0.0, 0.0
        if fits:
            evaluation = load_word(lead + EVALUATION)
            if load_word(block + WALKED) != evaluation:
                follow(block, model, data, state)
                store_word(block + WALKED, evaluation)
            # A piece that has become short needs a shorter step.
            shorter = opens(block) and stiffened(block)
            if shorter or load_real(block + CHECKED) != fields.timestep(model):
                store_real(block + CHECKED, fields.timestep(model))
                _check(model, data, instance)
            if begins:
                touched = jumps.touched(model, data, load_real(pose_at(state, n)))
                store_word(block + TOUCHED, 1 if touched else 0)
            if ahead.implicit(model, block):
                aim = np.empty(4)
                _aim(model, data, instance, aim.ctypes.data)
                u_proximal, u_distal, yields = aim[0], aim[1], (aim[2], aim[3])
        store_word(block + WALKED, 0)
        if cut:
            warn_once(model, instance, NO_PASSIVE)
        note_motion(block, data, seen[0], seen[1])
        if (
            fits
            and not cut
            and evaluate(block, state, u_proximal, u_distal, yields[0], yields[1], dt)
        ):
            tension = new_at(block, n) + 8 * kernel.STATE_HEADER
            proximal = max(load_real(tension), 0.0) * lever
            distal = max(load_real(tension + 8 * n), 0.0)
        else:
            # MuJoCo sees the bad acceleration, warns and resets, as for any other.
            proximal, distal = np.nan, np.nan
        fields.set_force(data, load_word(block + PROXIMAL), proximal)
        fields.set_force(data, load_word(block + DISTAL), -distal)
        if opens(block) and load_word(block + EARLY) == 0:
            pull(block, model, data)
        store_word(block + EARLY, 0)
        if fields.integrator(model) == RK4:
            if begins:
                store_word(block + BEGUN, load_word(block + KNOWN))
                note_first(block, data, state)
            stages = block + STAGES
            copy(stages + STAGE, stages, 3 * STAGE)
            store_real(stages + 3 * STAGE, seen[0])
            store_real(stages + 3 * STAGE + 8, seen[1])
            store_real(stages + 3 * STAGE + 16, fields.time(data))
            copy(block + INPUTS, stages + 3 * STAGE + 24, 40)
            if load_word(block + ROUTE) >= 0:
                size = load_word(block + SHAPE)
                copy(shape_at(block, n, 2), shape_at(block, n, 1), 3 * size)
                copy(shape_at(block, n, 0), shape_at(block, n, 4), size)

    @cfunc(types.void(address, address, integer), **options)
    def advance(model: int, data: int, instance: int) -> None:
        _ = stamp
        block = fields.block(data, instance)
        if block == 0 or not up_to_date(block, model, instance):
            return
        state = fields.state(model, data, instance)
        n = load_word(block + SEGMENTS)
        u_proximal, _ = wound(model, block, displacement(data, block, PROXIMAL))
        u_distal = displacement(data, block, DISTAL)
        jumps.note_poses(model, data, block)
        if fields.integrator(model) != RK4:  # where these are of its last stage
            now = shape_at(block, n, 0)
            warn_jump(model, data, instance, state, u_proximal, u_distal, now)
        if ends.idle(model, instance):
            warn_once(model, instance, GROUP)
        dt = fields.timestep(model)
        time = 0.0
        yields = 0.0, 0.0
        if fields.disabled(model, _NO_ACTUATION):
            # Nothing has evaluated the last position.
            warn_once(model, instance, IDLE)
            follow(block, model, data, state)
        elif (
            fields.integrator(model) != RK4
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
        if fields.integrator(model) == RK4:
            # A step makes four evaluations; the first of them is committed. With
            # actuation disabled there are none, and the last position counts.
            time = fields.time(data) - dt
            stages = block + STAGES
            if (
                load_real(stages + 3 * STAGE) == u_proximal
                and load_real(stages + 3 * STAGE + 8) == u_distal
                and bent_as_last(block)
            ):
                u_proximal = load_real(stages)
                u_distal = load_real(stages + 8)
                first = shape_at(block, n, 1)
                warn_jump(model, data, instance, state, u_proximal, u_distal, first)
                time = load_real(stages + 16)
                u_proximal, u_distal, yields, dt = inputs(stages + 24)
                if load_word(block + ROUTE) >= 0:
                    shape = first
                    lay(block, shape, state)
        if evaluate(block, state, u_proximal, u_distal, yields[0], yields[1], dt):
            copy_words(new_at(block, n), state, kernel.state_size(n))
            store_real(committed_time(state, n), time)
            store_real(pose_at(state, n), jumps.pose(model, data))
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
