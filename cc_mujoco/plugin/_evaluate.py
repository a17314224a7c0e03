"""One evaluation of a cable from its committed state, compiled."""

import numpy as np
from mujoco import mjtIntegrator

from cc_mujoco.cable import _drum as drum
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable import _moving_path as moving_path
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable import _open_path as open_path
from cc_mujoco.cable._cable import MAX_SECTIONS
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.native import FloatArray
from cc_mujoco.plugin import _attachments as attachments
from cc_mujoco.plugin import _config as config
from cc_mujoco.plugin import _ffi as ffi
from cc_mujoco.plugin import _instance_data as blocks
from cc_mujoco.plugin import _path as path
from cc_mujoco.plugin._ffi import MjData, MjModel, copy, floats, internal, same
from cc_mujoco.plugin._instance_data import Block, Pair
from cc_mujoco.plugin._routing import follow, seats_with_route


@internal
def is_rk4(model: MjModel) -> bool:
    return bool(model.opt.integrator == mjtIntegrator.mjINT_RK4)


@internal
def pack(block: Block, model: MjModel, instance: int) -> bool:
    attributes = ffi.attributes(model, instance)
    n = block.segments
    values = np.empty(config.SCALARS)
    sections = np.empty((MAX_SECTIONS, config.SECTION_SIZE))
    key, count = config.read(attributes, values, sections)
    blocks.invalidate(block)
    block.path_evaluation = block.text_size = block.other_kind = 0
    if key != config.VALID_CONFIGURATION:
        return False
    kind, free = config.path_kind(attributes), config.is_open(attributes)
    if config.segment_count(attributes) != n or kind != block.path_kind:
        block.other_kind = 1
        return False
    prm = blocks.parameters(block)
    kernel.pack(values, sections[:count], n, prm)
    tendon, mouth, guided = -1, 0, n
    follows = config.bends_with_route(attributes)
    if follows or free:
        route = config.key_text(attributes, config.KEY.route)
        tendon = attachments.find_route(model, instance, route)
        if tendon < 0 or path.has_branches(model, tendon):
            return False
        kernel.expect_change(prm)
    if free:
        kernel.expect_lengthening(prm)
        guided = 0
        if config.is_mixed(attributes):
            mouth = attachments.find_mouth(model, instance, tendon)
            if mouth < 0:
                return False
            guided = max(n - path.default_segments(model, tendon, mouth), 1)
        if n - guided < path.min_segments(model, tendon, mouth):
            return False
        guides = floats(block + block.guides, n)
        if not attachments.read_guides(model, instance, tendon, mouth, guides):
            return False
    for end in range(2):
        held = attachments.holding_tendon(model, block.actuators[end])
        block.tied[end] = int(free and held == tendon)
    block.route, block.mouth, block.guided = tendon, mouth, guided
    block.route_digest = path.digest(model, tendon)
    block.bends_with_route = int(follows and guided > 0)
    block.reference_known = 0
    block.explicit_ends = int(config.is_explicit(attributes))
    size = config.block_size(attributes)
    if size <= blocks.TEXT_CAPACITY:
        copy(attributes, block + block.text, size)
        block.text_size = size
    return True


@internal
def update_parameters(block: Block, model: MjModel, instance: int) -> bool:
    """Pack the parameters anew if the configuration has changed; return if it is valid.

    A batch may give its simulations different models. Then the configuration's text or
    the digest of its route differs from the one packed last.
    """
    attributes = ffi.attributes(model, instance)
    seen, size, i = block + block.text, block.text_size, 0
    # In pieces: behind the first difference the memory need not be the model's.
    while i + 128 <= size and same(seen + i, attributes + i, 128):
        i += 128
    if i + 128 > size and same(seen + i, attributes + i, size - i):
        i = size
    route = path.digest(model, block.route)
    if size > 0 and i == size and route == block.route_digest:
        return True
    return pack(block, model, instance)


@internal
def packed_block(model: MjModel, data: MjData, instance: int) -> Block:
    """Return an instance's block with its parameters updated, or 0 if unusable."""
    block = blocks.block_of(model, data, instance)
    if block != 0 and not update_parameters(block, model, instance):
        block = 0
    return block


@internal
def packed_block_of(model: MjModel, data: MjData, other: int, kind: int) -> Block:
    """Return `packed_block` of instance `other`, or 0 if its plugin is not `kind`."""
    return packed_block(model, data, other) if model.plugin[other] == kind else 0


@internal
def origin(
    block: Block, model: MjModel, data: MjData, instance: int
) -> tuple[int, float]:
    """Return the address of the state that an evaluation starts from, and its age [s].

    That is the committed state, one time step old. At the later stages of RK4 it is the
    state after the first stage, half a step or one step old, so that a motion that
    reverses at the start of the step is followed there and back. If there was no first
    stage, the committed state is up to two steps old.
    """
    state, step = ffi.state(model, data, instance), model.opt.timestep
    if not is_rk4(model):
        return state, step
    n, first = block.segments, block + block.first_stage
    one, other = blocks.committed(state, n), blocks.committed(first, n)
    halves = np.rint(2.0 * (data.time - one.time) / step)
    if not 3.0 <= halves <= 4.0:
        return state, step
    between = np.rint(2.0 * (other.time - one.time) / step)
    if block.first_stage_valid != 0 and between == 2.0 and other.pose == one.pose:
        return first, 0.5 * (halves - 2.0) * step
    return state, 0.5 * halves * step


@internal
def save_first_stage(block: Block, data: MjData, state: int) -> None:
    """Store the state after RK4's first stage, which began from address `state`."""
    n, first = block.segments, block + block.first_stage
    copy(block + block.new_state, first, 8 * kernel.state_size(n))
    kept = blocks.committed(first, n)
    kept.time, kept.pose = data.time, blocks.committed(state, n).pose
    if blocks.is_open(block):
        open_path.save_path(blocks.shape(block, 0), n, blocks.path_memory(first, n))


@internal
def is_evaluated(block: Block, data: MjData, state: int, ends: Pair) -> bool:
    """Return whether the last evaluation had this state, `ends` [m], and velocities."""
    known = block.result_valid == 1
    for end in range(2):
        speed = data.actuator_velocity[block.outputs[end]]
        known = known and block.input_positions[end] == ends[end]
        known = known and block.input_velocities[end] == speed
    return bool(known and same(block + block.old_state, state, written_bytes(block)))


@internal
def written_bytes(block: Block) -> int:
    return 8 * kernel.written_size(blocks.parameters(block), block.segments)


@internal
def evaluate(block: Block, state: int, ends: Pair, yields: Pair, dt: float) -> bool:
    """Evaluate a cable from the state at address `state`; return whether all is finite.

    Equal inputs are not evaluated twice. The parameters must be up to date. Arguments
    are those of `cable._kernel.step` and `cable._pack.expect_yielding`.
    """
    n, given = block.segments, np.empty(5)
    given[0], given[1], given[2], given[3], given[4] = (
        ends[0], ends[1], yields[0], yields[1], dt
    )  # fmt: skip
    known = same(block.inputs.ctypes.data, given.ctypes.data, 40)
    block.inputs[:] = given
    old, new = block + block.old_state, block + block.new_state
    written = written_bytes(block)
    if known and block.result_valid == 1 and same(old, state, written):
        return True
    block.early_pull = 0
    copy(state, old, written)
    prm = blocks.parameters(block)
    kernel.expect_yielding(prm, yields[0], yields[1])
    status = kernel.step(
        prm, n, blocks.kernel_state(old, n), kernel.POSITION, ends[0], kernel.POSITION,
        ends[1], dt, blocks.kernel_state(new, n),
        floats(block + block.work, kernel.work_size(n)),
    )  # fmt: skip
    block.result_valid = int(status == kernel.OK)
    return status == kernel.OK


@internal
def set_rest_state(
    block: Block, model: MjModel, state: int, ends: Pair, time: float
) -> None:
    """Set the state at address `state` to rest, for actuator lengths `ends` [m]."""
    n, kept = block.segments, blocks.committed(state, block.segments)
    wound = blocks.proximal_winding(model, block, ends[0])[0]
    whole = blocks.kernel_state(state, n)
    kernel.initialize(blocks.parameters(block), n, wound, ends[1], whole)
    kept.time = time - model.opt.timestep if is_rk4(model) else 0.0
    kept.ends[0], kept.ends[1] = wound, ends[1]
    kept.velocities[:] = 0.0
    if blocks.is_open(block):
        blocks.path_memory(state, n)[:] = 0.0
    if seats_with_route(block):
        whole[layout.rest_wrap(n)] = -1.0


@internal
def keep_mounted_rope(block: Block, model: MjModel, state: int) -> None:
    """Give a cable at rest the uniform tension of the rope that was mounted in `qpos0`.

    Motion of its ends since then has stretched the rope or made it slack. On an open
    path, measured at the present position, drums change the unstretched length of the
    rope: they pay it out at the strain of the pretension, and wind it up at the mean of
    that strain and the present one. `state` is the address of a `set_rest_state`.
    """
    n, prm = block.segments, blocks.parameters(block)
    whole = blocks.kernel_state(state, n)
    rest = blocks.rest_displacement(model, block, 0)
    begin = blocks.proximal_winding(model, block, rest)[0]
    travel = whole[1] - blocks.rest_displacement(model, block, 1)
    if prm[layout.STATE_DEPENDENT] != 0.0:
        whole[layout.TRAVEL] = travel
    paid = np.empty(2)
    paid[0], paid[1] = whole[0] - begin, -travel
    length, wound, rope = 0.0, 0.0, whole[3] - (paid[0] + paid[1])
    mounted = moving_path.stretch_ratio(prm, prm[PLACE.pretension])
    if blocks.is_open(block):
        first = blocks.shape(block, blocks.REFERENCE_STAGE)
        length = layout.total(open_path.lengths(blocks.shape(block, 0), n))
        out = max(paid[0], 0.0) + max(paid[1], 0.0)
        rope = layout.total(open_path.lengths(first, n)) + out
        rope -= nodes.rest_spring_stretch(prm, prm[PLACE.pretension])
        bends = open_path.angles(first, n)
        if block.bends_with_route == 1:
            bends = open_path.bends_of(first, n)
        rope -= nodes.seated_stretch(prm, n, bends, prm[PLACE.pretension])
        rope /= mounted
        wound = max(-paid[0], 0.0) + max(-paid[1], 0.0)
    else:
        whole[3] = rope
    tension = _even_tension(prm, n, length, rope, wound)
    layout.tensions(whole, n)[:] = tension
    nodes.rest_springs(prm, n, whole)
    if blocks.is_open(block):
        for end in range(2):
            ratio = mounted if paid[end] > 0.0 else _wound_ratio(prm, tension)
            drum.turn(prm, n, whole, whole, end, paid[end], ratio)


@internal
def _wound_ratio(prm: FloatArray, tension: float) -> float:
    """Return the mean of the stretch ratios at the pretension and at `tension` [N]."""
    now = moving_path.stretch_ratio(prm, max(tension, 0.0))
    return 0.5 * (moving_path.stretch_ratio(prm, prm[PLACE.pretension]) + now)


@internal
def _even_tension(
    prm: FloatArray, n: int, path: float, rope: float, wound: float
) -> float:
    """Return the uniform tension of a cable at rest [N], negative if it is slack.

    `path` is the length of an open path [m], `rope` the unstretched length of the cable
    and of rope wound up, `wound` the stretched length of the latter [m]. In a conduit
    `path` is 0 and `rope` the stretch of cable and springs [m].
    """
    if not np.isfinite(path + rope + wound):
        return np.nan
    low, high = -1.0, 1.0
    while _is_longer(prm, n, path, rope, wound, low):
        low *= 2.0
    while not _is_longer(prm, n, path, rope, wound, high):
        high *= 2.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        if _is_longer(prm, n, path, rope, wound, middle):
            high = middle
        else:
            low = middle
    return high


@internal
def _is_longer(
    prm: FloatArray, n: int, path: float, rope: float, wound: float, tension: float
) -> bool:
    seated = nodes.seated_stretch(prm, n, layout.segment_angles(prm, n), tension)
    if path == 0.0:
        return nodes.rest_stretch(prm, n, 0.0, tension) + seated >= rope
    ratio = moving_path.stretch_ratio(prm, tension)
    springs = nodes.rest_spring_stretch(prm, tension)
    # Of a rope that drums have wound up entirely this part of its path is left.
    left = max(rope - wound / _wound_ratio(prm, tension), 1e-3 * path)
    return ratio > 0.0 and ratio * left + springs + seated >= path


@internal
def has_stiffened(block: Block) -> bool:
    """Return whether the stiffest piece is twice as stiff as at the last True."""
    n, prm = block.segments, blocks.parameters(block)
    stiffness = kernel.node_stiffness(prm, n)
    now = open_path.max_piece_stiffness(blocks.shape(block, 0), stiffness, n)
    if now <= 2.0 * block.checked_stiffness:
        return False
    block.checked_stiffness = now
    return True


@internal
def follow_paths(model: MjModel, data: MjData, instance: int, evaluation: int) -> None:
    """Measure the paths of all open cables and update their segments.

    Paths already measured in evaluation number `evaluation` are left out; -1: none.
    """
    kind = model.plugin[instance]
    for other in range(model.nplugin):
        block = packed_block_of(model, data, other, kind)
        if block == 0 or block.path_evaluation == evaluation:
            continue
        if blocks.is_open(block):
            follow(block, model, data, origin(block, model, data, other)[0])
            if evaluation >= 0:
                block.path_evaluation = evaluation
