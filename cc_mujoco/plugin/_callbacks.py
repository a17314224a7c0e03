"""The engine plugin's callbacks, compiled.

An instance is one cable, shared by two plugin actuators. `compute` evaluates the cable
from its last committed state and applies the end tensions; it never writes
`plugin_state`. `advance` commits, once a time step, the configuration at which the step
began. All state that matters to the simulation is in `plugin_state`: that of the kernel
and, under RK4, the time of the committed configuration. `plugin_data` holds packed
parameters, scratch, and the result of the last evaluation with its inputs, which is
used again only for bitwise equal inputs.

The block of memory is made by `init`. MuJoCo also steps data on which it has called no
`init`, when it searches for the length range of a muscle: there a cable has neither
state nor force.

A conduit that follows its route takes its bends, at every evaluation, from the path of
the tendon at that position; like the displacements of the ends they are an input of the
evaluation and no state. The open part of a cable takes the lengths of its pieces from
there, too. Friction depends on their growth from step to step, so the committed lengths
are in `plugin_state`. The pieces pull by `qfrc_passive`. MuJoCo evaluates that before
the actuators, so `compute` adds to it when called for the actuators, once for each
evaluation of `qfrc_passive`.

Under RK4 the first stage is evaluated from the committed state, one time step before,
and is what `advance` commits. The later ones are half, half and one step further on;
they are evaluated from the state after the first stage, which the block keeps.
"""

import numpy as np
from mujoco import mjtDisableBit, mjtEnableBit
from mujoco.introspect.enums import ENUMS

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable import _moving_path as moving_path
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable import _open_path as open_path
from cc_mujoco.cable import _pack as prepare
from cc_mujoco.cable._cable import MAX_SECTIONS
from cc_mujoco.native import internal
from cc_mujoco.plugin import _attachments as attachments
from cc_mujoco.plugin import _config as config
from cc_mujoco.plugin import _evaluate as evaluating
from cc_mujoco.plugin import _ffi as ffi
from cc_mujoco.plugin import _implicit_ends as implicit_ends
from cc_mujoco.plugin import _instance_data as blocks
from cc_mujoco.plugin import _path as path
from cc_mujoco.plugin import _stability_limits as stability_limits
from cc_mujoco.plugin import _warnings as messages
from cc_mujoco.plugin._ffi import MjData, MjModel
from cc_mujoco.plugin._instance_data import Block, Pair
from cc_mujoco.plugin._routing import follow, lay, pull, seats_with_route, set_reference

_PASSIVE = int(ENUMS["mjtPluginCapabilityBit"].values["mjPLUGIN_PASSIVE"])


@internal
def _refuse_values(message: ffi.Message, model: MjModel, instance: int) -> int:
    """Check the configuration of an instance.

    Return the key that cannot be used, or `VALID_CONFIGURATION`; then it is still
    refused if a reason has been appended to `message`.
    """
    attributes = ffi.attributes(model, instance)
    values = np.empty(config.SCALARS)
    sections = np.empty((MAX_SECTIONS, config.SECTION_SIZE))
    key, _ = config.read(attributes, values, sections)
    if key != config.VALID_CONFIGURATION:
        return key
    _, first, _ = attachments.find_actuators(model, instance)
    radius = abs(attachments.end_radius(model, first))
    if values[config.KEY.eccentricity] + values[config.KEY.ovality] >= radius:
        alone = values[config.KEY.eccentricity] >= radius
        return int(config.KEY.eccentricity if alone else config.KEY.ovality)
    route = config.key_text(attributes, config.KEY.route)
    if route.size == 0:
        return key
    tendon = attachments.find_route(model, instance, route)
    if tendon < 0:
        return int(config.KEY.route)
    if config.bends_with_route(attributes) and path.has_branches(model, tendon):
        return int(config.KEY.bend)
    if not attachments.is_length(model.tendon_length0[tendon]):
        ffi.append(message, "its route")
        ffi.append(message, attachments.NO_LENGTH)
    elif config.is_open(attributes):
        return messages.refuse_open_path(message, model, instance, tendon)
    return key


@internal
def _is_refused(model: MjModel, instance: int) -> bool:
    """Return whether the instance cannot be used; if so, report why to MuJoCo."""
    room = np.zeros(ffi.MESSAGE_WORDS, np.int64)
    message = messages.begin_message(room.ctypes.data, model, instance, 0)
    start = message.used
    attachments.explain(message, model, instance)
    attributes = ffi.attributes(model, instance)
    if not ffi.has_timestep(model):
        message.used = start
        ffi.append(message, messages.NO_TIMESTEP)
    if message.used == start:
        key = _refuse_values(message, model, instance)
        if key != config.VALID_CONFIGURATION:
            config.explain(message, attributes, key)
    if message.used == start:
        route, tendon, mouth = config.key_text(attributes, config.KEY.route), -1, 0
        if config.is_open(attributes):
            tendon = attachments.find_route(model, instance, route)
        if config.is_mixed(attributes):
            mouth = attachments.find_mouth(model, instance, tendon)
        body = attachments.keep_awake(model, instance, tendon, mouth)
        attachments.explain_sleep(message, model, body)
    if message.used > start:
        ffi.warn(message)
    return bool(message.used > start)


@ffi.callback
def route(model: MjModel, instance: ffi.CInt) -> ffi.CInt:
    """Return the index of the spatial tendon that is an instance's route, or -1."""
    attributes = ffi.attributes(model, instance)
    written = config.key_text(attributes, config.KEY.route)
    return attachments.find_route(model, instance, written)


@ffi.callback
def turn(model: MjModel, data: MjData, tendon: ffi.CInt) -> float:
    whole, total = np.empty(1), np.empty(1)
    whole[0] = 1.0
    path.bend(model, data, tendon, 0, data.ten_length[tendon], whole, total)
    return float(total[0])


@ffi.callback
def holds(model: MjModel, data: MjData, instance: ffi.CInt) -> ffi.CInt:
    return int(evaluating.packed_block(model, data, instance) != 0)


@internal
def _usable_block(model: MjModel, data: MjData, instance: int) -> Block:
    block = blocks.acting_block(model, data, instance)
    if block != 0 and not evaluating.update_parameters(block, model, instance):
        block = 0
    return block


@ffi.callback
def wrap(model: MjModel, data: MjData, instance: ffi.CInt, out: int) -> None:
    block = _usable_block(model, data, instance)
    if block != 0:
        follow(block, model, data, ffi.state(model, data, instance))
        n = block.segments
        prm = blocks.parameters(block)
        ffi.floats(out, n)[:] = kernel.segment_angles(prm, n)


@ffi.callback
def compliance(model: MjModel, data: MjData, instance: ffi.CInt, out: int) -> None:
    """Write node compliances (n + 1,) [m/N], then the elastic energy [J], to `out`."""
    block = _usable_block(model, data, instance)
    if block == 0:
        return
    if blocks.is_open(block) and block.reference_known == 0:
        set_reference(block, model, data)
    n, prm = block.segments, blocks.parameters(block)
    at_state = ffi.state(model, data, instance)
    state = blocks.kernel_state(at_state, n)
    ffi.mark_stack(data)
    if blocks.is_open(block):
        # The packed nodes are those of the next step.
        packed, prm = prm, ffi.borrow_floats(data, prm.size)
        prm[:] = packed
        reference = blocks.shape(block, blocks.REFERENCE_STAGE)
        memory = blocks.path_memory(at_state, n)
        before = open_path.previous_lengths(reference, memory, n)
        nodes.recall_springs(prm, state)
        moving_path.set_unstretched_lengths(prm, n, layout.tensions(state, n), before)
    found = ffi.floats(out, n + 2)
    found[: n + 1] = layout.node_compliance(prm, n)
    found[n + 1] = kernel.stored_energy(prm, n, state)
    ffi.free_stack(data)


@ffi.callback
def limits(model: MjModel, data: MjData, instance: ffi.CInt, out: int) -> None:
    """Write the longest stable time steps (3,) [s] of an instance to address `out`."""
    ffi.floats(out, 3)[:] = np.inf
    if blocks.acting_block(model, data, instance) == 0:
        return
    evaluating.follow_paths(model, data, instance, -1)
    stability_limits.stable_timesteps(model, data, instance, ffi.floats(out, 3))


@internal
def _check(model: MjModel, data: MjData, block: Block) -> None:
    """Warn if the time step is too long for an instance, or if its ends cannot be used.

    Values that are refused at load can still be set on the compiled model.
    """
    instance = block.instance
    room = np.zeros(ffi.MESSAGE_WORDS, np.int64)
    message = messages.begin_message(room.ctypes.data, model, instance, block)
    start = message.used
    attachments.explain(message, model, instance)
    if message.used == start and blocks.is_open(block):
        attachments.explain_bypass(message, model, instance, block.route)
    if message.used > start:
        messages.issue_once(message)
    if blocks.is_open(block):
        messages.warn_no_effect(model, instance, block)
        messages.warn_soft_on_drum(model, block)
    else:
        messages.warn_stretched(model, block)
    if block.route >= 0:
        messages.warn_missed(model, data, block)
    messages.warn_ends(model, block)
    messages.warn_short_conduit(model, data, instance, block)
    longest = np.empty(3)
    limits(model, data, instance, longest.ctypes.data)
    messages.warn_short_period(model, block, longest)
    if implicit_ends.is_implicit(model, block):
        longest[0] = longest[1] = np.inf
    step, worst = model.opt.timestep, int(np.argmin(longest))
    if step > longest[worst]:
        message.used = start
        stability_limits.warn_long_step(message, model, worst, longest[worst])


@internal
def _ends(model: MjModel, data: MjData, block: Block) -> tuple[Pair, float]:
    """Return both ends' displacements [m] and the proximal `eccentric.lever_ratio`."""
    proximal, lever = blocks.winding(model, data, block)
    return (proximal, blocks.displacement(data, block, 1)), lever


@internal
def _pull_early(model: MjModel, data: MjData, instance: int, block: Block) -> None:
    """Apply the forces of an open path before its actuators, for `mj_inverse`."""
    idle = ffi.disabled(model, mjtDisableBit.mjDSBL_ACTUATION)
    if idle or messages.has_no_passive(model):
        return
    if not evaluating.update_parameters(block, model, instance):
        return
    lead = blocks.block_at(data, ffi.first_cable(model, instance))
    state, dt = evaluating.origin(block, model, data, instance)
    follow(block, model, data, state)
    block.path_evaluation = lead.evaluation_count + 1
    ends, _ = _ends(model, data, block)
    known, implicit = True, implicit_ends.is_implicit(model, block)
    if not implicit:
        known = evaluating.evaluate(block, state, ends, (0.0, 0.0), dt)
    elif not evaluating.is_evaluated(block, data, state, ends):
        aim = np.empty(9)
        implicit_ends.predict_known_motion(model, data, block, aim)
        known = implicit_ends.evaluate_prediction(model, block, state, aim, dt)
    if known:
        pull(block, model, data)
        block.early_pull = blocks.EARLY_REPLACED if implicit else blocks.EARLY_KEPT


@internal
def _undo_early(model: MjModel, data: MjData, instance: int) -> None:
    """Remove the forces that `_pull_early` applied for implicit ends, to the last bit.

    They depend on the acceleration in `data`, which is no part of the state.
    """
    passive = data.qfrc_passive[: model.nv]
    for other in range(model.nplugin - 1, -1, -1):
        if model.plugin[other] != model.plugin[instance]:
            continue
        block = blocks.own_block(model, data, other)
        if block == 0 or block.early_pull != blocks.EARLY_REPLACED:
            continue
        if not blocks.fits(block, model, other):
            continue
        pulls = ffi.floats(block + block.pulls, passive.size)
        before = ffi.floats(block + block.passive_before, passive.size)
        for i in range(passive.size):
            # Unless another plugin has added to it since.
            if passive[i] == before[i] + pulls[i]:
                passive[i] = before[i]
            else:
                passive[i] -= pulls[i]
        block.passive_fresh = 1
        block.early_pull = 0


@ffi.callback
def settle(
    model: MjModel, data: MjData, instance: ffi.CInt, keeps_rope: ffi.CInt
) -> None:
    """Set the state of a cable to rest at the last evaluated position.

    Its tension is the pretension or, if `keeps_rope`, that of the rope mounted in
    `qpos0`.
    """
    if blocks.acting_block(model, data, instance) == 0:
        messages.warn_cannot_act(model, data, instance)
    block = _usable_block(model, data, instance)
    if block == 0:
        return
    lengths = blocks.displacement(data, block, 0), blocks.displacement(data, block, 1)
    state, n = ffi.state(model, data, instance), block.segments
    evaluating.set_rest_state(block, model, state, lengths, data.time)
    kept = blocks.committed(state, n)
    kept.pose = messages.checksum(data.qpos[: model.nq])
    seats = seats_with_route(block)
    if seats or blocks.is_open(block):
        follow(block, model, data, state)
    if keeps_rope != 0:
        evaluating.keep_mounted_rope(block, model, state)
    elif seats:
        prm = blocks.parameters(block)
        whole = blocks.kernel_state(state, n)
        prepare.rest_in(prm, n, layout.segment_angles(prm, n), whole)
    if blocks.is_open(block):
        open_path.save_path(blocks.shape(block, 0), n, blocks.path_memory(state, n))


@ffi.callback
def nstate(model: MjModel, instance: ffi.CInt) -> ffi.CInt:
    attributes = ffi.attributes(model, instance)
    n = max(config.segment_count(attributes), 1)
    messages.warn_poor_spring(model, instance)  # only compilers ask for this number
    messages.warn_idle_keys(model, instance)
    more = open_path.memory_size(n) if config.is_open(attributes) else 0
    return kernel.state_size(n) + blocks.COMMITMENT_SIZE // 8 + more


@ffi.callback
def init(model: MjModel, data: MjData, instance: ffi.CInt) -> ffi.CInt:
    data.plugin_data[instance] = 0
    if _is_refused(model, instance):
        return -1
    attributes = ffi.attributes(model, instance)
    room = np.zeros(blocks.BLOCK_WORDS, np.int64)
    head = blocks.block_of_memory(room.ctypes.data)
    head.content = messages.content(model, instance)
    head.segments = config.segment_count(attributes)
    head.path_kind = config.path_kind(attributes)
    is_first = ffi.first_cable(model, instance) == instance
    size = blocks.lay_out(head, model, is_first)
    block = blocks.block_of_memory(ffi.allocate(size))
    ffi.clear(block, size)
    ffi.copy(head, block, 8 * blocks.BLOCK_WORDS)
    blocks.save_sizes(block, model, instance)
    evaluating.pack(block, model, instance)
    data.plugin_data[instance] = block
    return 0


@ffi.callback
def destroy(data: MjData, instance: ffi.CInt) -> None:
    if data.plugin_data[instance] != 0:
        ffi.release(data.plugin_data[instance])
    data.plugin_data[instance] = 0


@ffi.callback
def reset(model: MjModel, state: int, block: Block, instance: ffi.CInt) -> None:
    fit = block != 0 and ffi.has_timestep(model) and blocks.fits(block, model, instance)
    if not (fit and evaluating.update_parameters(block, model, instance)):
        return
    block.checked_timestep = block.checked_stiffness = 0.0
    if block.mocap_poses != 0:  # which are unknown
        size = 2 * 7 * model.nmocap
        ffi.floats(block + block.mocap_poses, size)[:] = 0.0
    # The pose `qpos0` may be another since.
    block.reference_known = 0
    first = blocks.rest_displacement(model, block, 0)
    lengths = first, blocks.rest_displacement(model, block, 1)
    evaluating.set_rest_state(block, model, state, lengths, 0.0)
    kept = blocks.committed(state, block.segments)
    kept.pose = messages.checksum(model.qpos0[: model.nq])


@ffi.callback
def compute(
    model: MjModel, data: MjData, instance: ffi.CInt, capability: ffi.CInt
) -> None:
    own = blocks.own_block(model, data, instance)
    if own != 0:
        own.evaluated_model = 0
        if capability == _PASSIVE and not blocks.is_open(own):
            return  # all that it does are the forces of its actuators
    block = blocks.acting_block(model, data, instance)
    if block == 0:
        messages.warn_cannot_act(model, data, instance)
        return
    if capability == _PASSIVE:
        block.passive_fresh = 1
        block.early_pull = 0
        _pull_early(model, data, instance, block)
        return
    lead = blocks.block_at(data, ffi.first_cable(model, instance))
    if lead == block:
        lead.evaluation_count += 1
        lead.known_step = 0
        messages.note_position(model, data, lead)
        _undo_early(model, data, instance)
    usable = evaluating.update_parameters(block, model, instance)
    block.evaluated_model = model if usable else 0
    if block.other_kind != 0:
        messages.warn_cannot_act(model, data, instance)
        return
    cut = blocks.is_open(block) and messages.has_no_passive(model)
    if block.route >= 0 and not np.isfinite(data.ten_length[block.route]):
        # MuJoCo sees the bad acceleration, warns and resets, as for any other.
        messages.warn_cannot_act(model, data, instance)
        blocks.invalidate(block)
        for end in range(2):
            data.actuator_force[block.outputs[end]] = np.nan
        return
    if usable and model.opt.enableflags & mjtEnableBit.mjENBL_SLEEP != 0:
        tendon = block.route if blocks.is_open(block) else -1
        attachments.keep_awake(model, instance, tendon, block.mouth)
    n = block.segments
    state, dt = evaluating.origin(block, model, data, instance)
    begins = state == ffi.state(model, data, instance)
    ends, lever = _ends(model, data, block)
    implicit = False
    if usable:
        if block.path_evaluation != lead.evaluation_count:
            follow(block, model, data, state)
            block.path_evaluation = lead.evaluation_count
        # A piece that has become short needs a shorter step.
        shorter = blocks.is_open(block) and evaluating.has_stiffened(block)
        if shorter or block.checked_timestep != model.opt.timestep:
            block.checked_timestep = model.opt.timestep
            _check(model, data, block)
        if begins:
            # Work of friction, with room for the tolerance of the solvers [J].
            if not blocks.kernel_state(state, n)[2] > -0.1:
                messages.warn_once(model, instance, block, messages.NO_STATE)
            pose = blocks.committed(state, n).pose
            touched = messages.position_changed(lead, pose)
            block.position_changed = int(touched)
        implicit = implicit_ends.is_implicit(model, block)
    block.path_evaluation = 0
    if cut:
        messages.warn_once(model, instance, block, messages.NO_PASSIVE)
    for end in range(2):
        block.input_positions[end] = ends[end]
        block.input_velocities[end] = data.actuator_velocity[block.outputs[end]]
    known = False
    if usable and not cut and implicit:
        aim = np.empty(9)
        implicit_ends.predict_ends(model, data, block, lead, aim)
        known = implicit_ends.evaluate_prediction(model, block, state, aim, dt)
    elif usable and not cut:
        known = evaluating.evaluate(block, state, ends, (0.0, 0.0), dt)
    # MuJoCo sees a bad acceleration, warns and resets, as for any other.
    proximal = distal = np.nan
    if known:
        node = layout.tensions(blocks.kernel_state(block + block.new_state, n), n)
        proximal, distal = max(node[0], 0.0) * lever, max(node[n], 0.0)
    if usable and not cut and not np.isfinite(proximal + distal):
        messages.warn_cannot_act(model, data, instance)
    data.actuator_force[block.outputs[0]] = proximal
    data.actuator_force[block.outputs[1]] = -distal
    if usable and blocks.is_open(block) and block.early_pull == 0:
        pull(block, model, data)
    block.early_pull = 0
    if evaluating.is_rk4(model):
        if begins:
            block.first_stage_valid = block.result_valid
            evaluating.save_first_stage(block, data, state)
        for k in range(3):
            block.stages[k, :] = block.stages[k + 1]
        block.stages[3, 0], block.stages[3, 1] = ends
        block.stages[3, 2] = data.time
        block.stages[3, 3:] = block.inputs
        if block.route >= 0:
            size = block.shape_bytes
            ffi.copy(blocks.shape_at(block, 2), blocks.shape_at(block, 1), 3 * size)
            ffi.copy(blocks.shape_at(block, 0), blocks.shape_at(block, 4), size)


@ffi.callback
def advance(model: MjModel, data: MjData, instance: ffi.CInt) -> None:
    block = blocks.own_block(model, data, instance)
    if block == 0:
        return
    if block.lead == instance:
        messages.note_position(model, data, block)
    # Without actuation `inputs` are of an evaluation before this step.
    idle = ffi.disabled(model, mjtDisableBit.mjDSBL_ACTUATION)
    rk4 = evaluating.is_rk4(model)
    known = block.evaluated_model == model and not idle
    block.evaluated_model = 0
    if not known:
        block = _usable_block(model, data, instance)
        if block == 0:
            return
    state, n = ffi.state(model, data, instance), block.segments
    ends, _ = _ends(model, data, block)
    used, last = ends, ends
    messages.save_poses(model, data, block)
    # Under RK4 these are of its last stage.
    if not rk4:
        messages.warn_jump(model, data, instance, state, ends, 0)
    if attachments.in_disabled_group(model, instance):
        messages.warn_once(
            model, instance, block,
            "an end is in a group of `actuatorgroupdisable`, which MuJoCo does not "
            "heed for plugins; the cable pulls all the same",
        )  # fmt: skip
    dt, time, yields, stage = model.opt.timestep, 0.0, (0.0, 0.0), 0
    at, given = block.input_positions, block.inputs
    if idle:
        # Nothing has evaluated the last position.
        messages.warn_once(
            model, instance, block,
            "`actuation` is disabled in <flag>, so the cable does not pull; its "
            "tensions are those that it would have",
        )  # fmt: skip
        follow(block, model, data, state)
    elif not rk4 and at[0] == last[0] and at[1] == last[1]:
        # Commit the prediction whose tensions were applied.
        used, yields = (given[0], given[1]), (given[2], given[3])
    if rk4:
        # A step makes four evaluations; the first of them is committed. With
        # actuation disabled there are none, and the last position counts.
        time, stages = data.time - dt, block.stages
        path_now, path_last = blocks.shape_at(block, 0), blocks.shape_at(block, 4)
        if (
            stages[3, 0] == last[0]
            and stages[3, 1] == last[1]
            and ffi.same(path_now, path_last, block.shape_bytes)
        ):
            ends = stages[0, 0], stages[0, 1]
            messages.warn_jump(model, data, instance, state, ends, 1)
            time = stages[0, 2]
            used, yields = (stages[0, 3], stages[0, 4]), (stages[0, 5], stages[0, 6])
            dt = stages[0, 7]
            if block.route >= 0:
                stage = 1
                lay(block, stage, state)
    if evaluating.evaluate(block, state, used, yields, dt):
        written = evaluating.written_bytes(block)
        ffi.copy(block + block.new_state, state, written)
        kept = blocks.committed(state, n)
        kept.time = time
        kept.pose = blocks.block_at(data, block.lead).position
        kept.ends[0], kept.ends[1] = ends
        for part in range(3):
            kept.velocities[part] = messages.velocity(data, block, part)
        if blocks.is_open(block):
            shape = blocks.shape(block, stage)
            open_path.save_path(shape, n, blocks.path_memory(state, n))
