"""One evaluation of a cable from its committed state, compiled."""

from __future__ import annotations

import mujoco
import numpy as np

from cc_mujoco.cable import _drum as drum
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable import _moving_path as moving_path
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable._cable import MAX_SECTIONS
from cc_mujoco.cable._friction import INDEX
from cc_mujoco.plugin import _attachments as attachments
from cc_mujoco.plugin import _config as config
from cc_mujoco.plugin import _instance_data as blocks
from cc_mujoco.plugin import _mj_struct as mj_struct
from cc_mujoco.plugin import _open_path as open_path
from cc_mujoco.plugin import _path as path
from cc_mujoco.plugin._ffi import (
    Floats,
    callback,
    copy,
    fill,
    floats,
    internal,
    load_real,
    load_word,
    same,
    store_real,
    store_word,
)
from cc_mujoco.plugin._routing import follow, seats_with_route

_PRETENSION = INDEX["pretension"]
_SPRINGS = INDEX["proximal_compliance"], INDEX["end_compliance"]
_MIN_ROPE_SHARE = 1e-3
"""Least part of its path that a rope is long which drums have wound up entirely."""
_BISECTIONS = 100
RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)


@callback
def pack(block: int, model: int, instance: int) -> int:
    """Pack the parameters of the instance; return whether they are valid."""
    attributes = mj_struct.attributes(model, instance)
    n = load_word(block + blocks.SEGMENTS)
    values = np.empty(config.SCALARS)
    sections = np.empty((MAX_SECTIONS, 2))
    key, count = config.read(attributes, values, sections)
    blocks.invalidate(block)
    store_word(block + blocks.PATH_EVALUATION, 0)
    store_word(block + blocks.TEXT_SIZE, 0)
    store_word(block + blocks.OTHER_KIND, 0)
    if key != config.VALID_CONFIGURATION:
        return 0
    kind, free = config.path_kind(attributes), config.is_open(attributes)
    if config.segment_count(attributes) != n or kind != load_word(
        block + blocks.PATH_KIND
    ):
        store_word(block + blocks.OTHER_KIND, 1)
        return 0
    prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
    kernel.pack(values, sections[:count], n, prm)
    tendon, mouth, guided = -1, 0, n
    follows = config.bends_with_route(attributes)
    if follows or free:
        route = config.key_text(attributes, config.ROUTE)
        tendon = attachments.find_route(model, instance, route)
        if tendon < 0 or path.has_branches(model, tendon):
            return 0
        kernel.expect_change(prm)
    if free:
        kernel.expect_lengthening(prm)
        guided = 0
        if config.is_mixed(attributes):
            name = config.key_text(attributes, config.MOUTH)
            mouth = attachments.find_mouth(model, instance, tendon, route, name)
            if mouth < 0:
                return 0
            guided = n - open_path.wanted_segments(
                model, tendon, mouth, open_path.ARC_SEGMENTS
            )
            guided = max(guided, 1)
        if n - guided < open_path.min_segments(model, tendon, mouth):
            return 0
        at_guides = floats(blocks.guides_at(block, n), n)
        if not attachments.read_guides(model, instance, tendon, mouth, at_guides):
            return 0
    for end in range(2):
        actuator = load_word(block + blocks.END_ACTUATORS + 8 * end)
        tied = free and attachments.is_tied(model, actuator, tendon)
        store_word(block + blocks.TIED_ENDS + 8 * end, 1 if tied else 0)
    store_word(block + blocks.ROUTE, tendon)
    store_word(block + blocks.ROUTE_DIGEST, path.digest(model, tendon))
    store_word(block + blocks.BENDS_WITH_ROUTE, 1 if follows and guided > 0 else 0)
    store_word(block + blocks.MOUTH, mouth)
    store_word(block + blocks.GUIDED, guided)
    store_word(block + blocks.REFERENCE_KNOWN, 0)
    store_word(block + blocks.EXPLICIT_ENDS, 1 if config.is_explicit(attributes) else 0)
    size = config.block_size(attributes)
    if size <= blocks.TEXT_CAPACITY:
        copy(attributes, blocks.text_at(block, n), size)
        store_word(block + blocks.TEXT_SIZE, size)
    return 1


@internal
def update_parameters(block: int, model: int, instance: int) -> bool:
    """Update the packed parameters by the configuration of the model.

    They are unless a batch gives its simulations different models; then the text of the
    configuration differs from the copy that was packed last, or its route does.
    """
    attributes = mj_struct.attributes(model, instance)
    seen = blocks.text_at(block, load_word(block + blocks.SEGMENTS))
    size = load_word(block + blocks.TEXT_SIZE)
    i = 0
    # In pieces: what follows the first difference need not be memory of the model.
    while i + 128 <= size and same(seen + i, attributes + i, 128):
        i += 128
    if i + 128 > size and same(seen + i, attributes + i, size - i):
        i = size
    route = path.digest(model, load_word(block + blocks.ROUTE))
    if size > 0 and i == size and route == load_word(block + blocks.ROUTE_DIGEST):
        return True
    packed: bool = pack(block, model, instance) == 1
    return packed


@internal
def packed_block(model: int, data: int, instance: int) -> int:
    """Return the block of an instance, its parameters up to date; 0 if there is none.

    There is none either where the model or its configuration does not fit the block.
    """
    block = blocks.block_of(model, data, instance)
    if block != 0 and not update_parameters(block, model, instance):
        block = 0
    return block


@internal
def path_unchanged(block: int) -> bool:
    """Return whether the path is the same as at the last stage of RK4."""
    n = load_word(block + blocks.SEGMENTS)
    now, last = blocks.shape_at(block, n, 0), blocks.shape_at(block, n, 4)
    return same(now, last, load_word(block + blocks.SHAPE_BYTES))


@internal
def origin(block: int, model: int, data: int, instance: int) -> tuple[int, float]:
    """Return the state that an evaluation begins from, and the time since then [s].

    The committed state, a time step ago; at the later stages of RK4 that of the first
    one. So a motion that turns at the start of the step is followed to there and back.
    The time is half a step, a step or, where there was no first stage, up to two.
    """
    state, step = mj_struct.state(model, data, instance), mj_struct.timestep(model)
    if mj_struct.integrator(model) != RK4:
        return state, step
    n = load_word(block + blocks.SEGMENTS)
    committed, first = blocks.committed_time_at(state, n), blocks.first_stage_at(block)
    halves = np.rint(2.0 * (mj_struct.time(data) - load_real(committed)) / step)
    if not 3.0 <= halves <= 4.0:
        return state, step
    between = load_real(blocks.committed_time_at(first, n)) - load_real(committed)
    if (
        load_word(block + blocks.FIRST_STAGE_VALID) != 0
        and np.rint(2.0 * between / step) == 2.0
        and load_word(blocks.pose_at(first, n)) == load_word(blocks.pose_at(state, n))
    ):
        return first, 0.5 * (halves - 2.0) * step
    return state, 0.5 * halves * step


@internal
def save_first_stage(block: int, data: int, state: int) -> None:
    """Keep the state that was found last as that of the first stage of RK4.

    It began from the state at address `state`.
    """
    n, first = load_word(block + blocks.SEGMENTS), blocks.first_stage_at(block)
    copy(blocks.new_at(block, n), first, 8 * kernel.state_size(n))
    store_real(blocks.committed_time_at(first, n), mj_struct.time(data))
    store_word(blocks.pose_at(first, n), load_word(blocks.pose_at(state, n)))
    if blocks.is_open(block):
        shape = floats(blocks.shape_at(block, n, 0), open_path.shape_size(n))
        open_path.save_path(shape, n, blocks.path_memory(first, n))


@internal
def evaluation_inputs(at: int) -> tuple[float, float, tuple[float, float], float]:
    """Return the inputs of an evaluation: displacements, compliances, and dt."""
    yields = load_real(at + 16), load_real(at + 24)
    return load_real(at), load_real(at + 8), yields, load_real(at + 32)


@internal
def save_motion(block: int, data: int, u_proximal: float, u_distal: float) -> None:
    """Save positions and speeds of the ends at the evaluation of the cable."""
    store_real(block + blocks.INPUT_POSITIONS, u_proximal)
    store_real(block + blocks.INPUT_POSITIONS + 8, u_distal)
    for end in range(2):
        output = load_word(block + (blocks.DISTAL if end else blocks.PROXIMAL))
        speed = mj_struct.real(data, mj_struct.ACTUATOR_VELOCITY, output)
        store_real(block + blocks.INPUT_VELOCITIES + 8 * end, speed)


@internal
def is_evaluated(
    block: int, data: int, state: int, u_proximal: float, u_distal: float
) -> bool:
    """Return whether the last evaluation is that of this state and motion of the ends.

    What an implicit end looks ahead to depends on its velocity, too.
    """
    n = load_word(block + blocks.SEGMENTS)
    known = load_word(block + blocks.RESULT_VALID) == 1
    known = known and load_real(block + blocks.INPUT_POSITIONS) == u_proximal
    known = known and load_real(block + blocks.INPUT_POSITIONS + 8) == u_distal
    for end in range(2):
        output = load_word(block + (blocks.DISTAL if end else blocks.PROXIMAL))
        speed = mj_struct.real(data, mj_struct.ACTUATOR_VELOCITY, output)
        known = known and load_real(block + blocks.INPUT_VELOCITIES + 8 * end) == speed
    return known and same(blocks.old_at(block, n), state, written_bytes(block))


@internal
def written_bytes(block: int) -> int:
    """Return how many bytes of a state evaluations may change, from the first."""
    n = load_word(block + blocks.SEGMENTS)
    prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
    return 8 * kernel.written_size(prm, n)


@internal
def evaluate(
    block: int,
    state: int,
    u_proximal: float,
    u_distal: float,
    yield_proximal: float,
    yield_distal: float,
    dt: float,
) -> bool:
    """Evaluate from the committed state, unless done; return if all is finite.

    The parameters must be up to date. Arguments as in `cable._kernel.step` and
    `cable._pack.expect_yielding`.
    """
    n = load_word(block + blocks.SEGMENTS)
    old = blocks.old_at(block, n)
    size, written = kernel.state_size(n), written_bytes(block)
    known = load_word(block + blocks.RESULT_VALID) == 1
    given = (u_proximal, u_distal, yield_proximal, yield_distal, dt)
    for i in range(5):
        before = load_word(block + blocks.INPUTS + 8 * i)
        store_real(block + blocks.INPUTS + 8 * i, given[i])
        known = known and before == load_word(block + blocks.INPUTS + 8 * i)
    if known and same(old, state, written):
        return True
    store_word(block + blocks.EARLY_PULL, 0)
    copy(state, old, written)
    prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
    kernel.expect_yielding(prm, yield_proximal, yield_distal)
    status = kernel.step(
        prm, n, floats(old, size), kernel.POSITION, u_proximal, kernel.POSITION,
        u_distal, dt, floats(blocks.new_at(block, n), size),
        floats(blocks.work_at(block, n), kernel.work_size(n)),
    )  # fmt: skip
    store_word(block + blocks.RESULT_VALID, 1 if status == kernel.OK else 0)
    return status == kernel.OK


@internal
def set_rest_state(
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
    n = load_word(block + blocks.SEGMENTS)
    wound = blocks.proximal_winding(model, block, proximal_length)[0]
    kernel.initialize(
        floats(blocks.parameters_at(block), kernel.parameter_size(n)),
        n,
        wound,
        distal_length,
        floats(state, kernel.state_size(n)),
    )
    before = time - mj_struct.timestep(model)
    store_real(
        blocks.committed_time_at(state, n),
        before if mj_struct.integrator(model) == RK4 else 0.0,
    )
    store_real(blocks.end_at(state, n, 0), wound)
    store_real(blocks.end_at(state, n, 1), distal_length)
    for part in range(3):
        store_real(blocks.velocity_at(state, n, part), 0.0)
    if blocks.is_open(block):
        fill(blocks.path_memory(state, n), 0.0)
    if seats_with_route(block):
        store_real(state + 8 * layout.rest_wrap(n), -1.0)


@internal
def keep_mounted_rope(block: int, model: int, state: int) -> None:
    """Give a cable at rest the even tension of the rope that was mounted in `qpos0`.

    What an end has moved since then stretches the rope or makes it slack. On an open
    path, measured before at the present position, the rope is as long unstretched as it
    was, but for drums: they gave out rope at the strain of the pretension, and took it
    in at the mean of that and of the present one, as in a straight motion. `state` is
    the address of the state that `set_rest_state` has set.
    """
    n = load_word(block + blocks.SEGMENTS)
    prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
    whole = floats(state, kernel.state_size(n))
    begin = blocks.proximal_winding(
        model, block, blocks.rest_displacement(model, block, blocks.PROXIMAL)
    )[0]
    travel = whole[1] - blocks.rest_displacement(model, block, blocks.DISTAL)
    if prm[layout.STATE_DEPENDENT] != 0.0:
        whole[layout.TRAVEL] = travel
    paid = np.empty(2)
    paid[0], paid[1] = whole[0] - begin, -travel
    path, wound, rope = 0.0, 0.0, whole[3] - (paid[0] + paid[1])
    mounted = moving_path.stretch_ratio(prm, prm[_PRETENSION])
    if blocks.is_open(block):
        size = open_path.shape_size(n)
        now = floats(blocks.shape_at(block, n, 0), size)
        first = floats(blocks.shape_at(block, n, blocks.REFERENCE_STAGE), size)
        path = layout.total(open_path.lengths(now, n))
        out = max(paid[0], 0.0) + max(paid[1], 0.0)
        rope = (layout.total(open_path.lengths(first, n)) + out) / mounted
        rope -= (prm[_SPRINGS[0]] + prm[_SPRINGS[1]]) * prm[_PRETENSION]
        wound = max(-paid[0], 0.0) + max(-paid[1], 0.0)
    else:
        whole[3] = rope
    tension = _even_tension(prm, n, path, rope, wound)
    fill(layout.tensions(whole, n), tension)
    if blocks.is_open(block):
        for end in range(2):
            ratio = mounted if paid[end] > 0.0 else _wound_ratio(prm, tension)
            drum.turn(prm, n, whole, whole, end, paid[end], ratio)


@internal
def _wound_ratio(prm: Floats, tension: float) -> float:
    """Return the mean stretch ratio of rope wound up from the pretension to another."""
    now = moving_path.stretch_ratio(prm, max(tension, 0.0))
    return 0.5 * (moving_path.stretch_ratio(prm, prm[_PRETENSION]) + now)


@internal
def _even_tension(prm: Floats, n: int, path: float, rope: float, wound: float) -> float:
    """Return the even tension of a cable at rest [N], negative where it is slack.

    `path` is the length of an open path, 0 in a conduit. `rope` is the unstretched
    length of the cable on an open path and of what was wound up, less the stretch of
    the springs at its ends; of another cable its stretch, with those springs. `wound`
    is the stretched length of rope that drums have wound up. All in metres.
    """
    if not np.isfinite(path + rope + wound):
        return np.nan
    low, high = -1.0, 1.0
    while _is_longer(prm, n, path, rope, wound, low):
        low *= 2.0
    while not _is_longer(prm, n, path, rope, wound, high):
        high *= 2.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if _is_longer(prm, n, path, rope, wound, middle):
            high = middle
        else:
            low = middle
    return high


@internal
def _is_longer(
    prm: Floats, n: int, path: float, rope: float, wound: float, tension: float
) -> bool:
    """Return whether a tension [N] stretches a cable beyond its path or its stretch."""
    if path == 0.0:
        wrap = layout.total(layout.segment_angles(prm, n))
        return nodes.rest_stretch(prm, wrap, tension) >= rope
    ratio = moving_path.stretch_ratio(prm, tension)
    springs = prm[_SPRINGS[0]] + prm[_SPRINGS[1]]
    left = max(rope - wound / _wound_ratio(prm, tension), _MIN_ROPE_SHARE * path)
    return ratio > 0.0 and ratio * (left + springs * tension) >= path


@internal
def has_stiffened(block: int) -> bool:
    """Return whether a piece is twice as stiff as when this was last true."""
    n = load_word(block + blocks.SEGMENTS)
    prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
    shape = floats(blocks.shape_at(block, n, 0), open_path.shape_size(n))
    now = open_path.max_piece_stiffness(shape, kernel.node_stiffness(prm, n), n)
    if now <= 2.0 * load_real(block + blocks.CHECKED_STIFFNESS):
        return False
    store_real(block + blocks.CHECKED_STIFFNESS, now)
    return True


@internal
def follow_all_paths(model: int, data: int, instance: int) -> None:
    """Lead all open cables along their paths, so that their meshes are known."""
    for other in range(mj_struct.plugins(model)):
        kind = mj_struct.integer(model, mj_struct.PLUGIN, other)
        if kind == mj_struct.integer(model, mj_struct.PLUGIN, instance):
            block = packed_block(model, data, other)
            if block != 0 and blocks.is_open(block):
                state = origin(block, model, data, other)[0]
                follow(block, model, data, state)


@internal
def follow_other_paths(model: int, data: int, instance: int, evaluation: int) -> None:
    """Lead all open cables along their paths that were not in this evaluation."""
    for other in range(mj_struct.plugins(model)):
        kind = mj_struct.integer(model, mj_struct.PLUGIN, other)
        if kind == mj_struct.integer(model, mj_struct.PLUGIN, instance):
            block = packed_block(model, data, other)
            walked = (
                block == 0 or load_word(block + blocks.PATH_EVALUATION) == evaluation
            )
            if not walked and blocks.is_open(block):
                state = origin(block, model, data, other)[0]
                follow(block, model, data, state)
                store_word(block + blocks.PATH_EVALUATION, evaluation)
