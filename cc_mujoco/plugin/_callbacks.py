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
that before the actuators, so `compute` adds to it when it is called for the actuator,
once for each time that it was evaluated.

Under RK4 the first stage is evaluated from the committed state, one time step before,
and is what `advance` commits. The later ones are half, half and one step further on;
they are evaluated from the state after the first stage, which the block keeps.
"""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco.introspect.enums import ENUMS

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable import _moving_path as moving_path
from cc_mujoco.cable import _pack as prepare
from cc_mujoco.cable._cable import MAX_SECTIONS
from cc_mujoco.plugin import _attachments as attachments
from cc_mujoco.plugin import _config as config
from cc_mujoco.plugin import _evaluate as evaluating
from cc_mujoco.plugin import _guides as guides
from cc_mujoco.plugin import _implicit_ends as implicit_ends
from cc_mujoco.plugin import _instance_data as blocks
from cc_mujoco.plugin import _jump_warnings as jump_warnings
from cc_mujoco.plugin import _mj_struct as mj_struct
from cc_mujoco.plugin import _open_path as open_path
from cc_mujoco.plugin import _path as path
from cc_mujoco.plugin import _stability_limits as stability_limits
from cc_mujoco.plugin import _warnings as messages
from cc_mujoco.plugin._ffi import (
    MESSAGE_CAPACITY,
    CInt,
    allocate,
    append,
    assign,
    borrow,
    borrow_floats,
    callback,
    clear,
    copy,
    fill,
    floats,
    free_stack,
    load_real,
    load_word,
    mark_stack,
    octets,
    release,
    store_real,
    store_word,
    warn,
    warned_once,
)
from cc_mujoco.plugin._routing import follow, lay, pull, seats_with_route, set_reference
from cc_mujoco.plugin._slack_passage import evaluate_prediction

_NO_ACTUATION = int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
_SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
_PASSIVE = int(ENUMS["mjtPluginCapabilityBit"].values["mjPLUGIN_PASSIVE"])


@callback
def refused(model: int, instance: CInt) -> CInt:
    """Return whether the instance cannot be used; if so, report why to MuJoCo."""
    message = np.zeros(MESSAGE_CAPACITY, np.uint8)
    start = messages.begin_message(message, model, instance)
    used = attachments.explain(message, start, model, instance)
    attributes = mj_struct.attributes(model, instance)
    if not mj_struct.has_timestep(model):
        used = append(message, start, messages.NO_TIMESTEP)
    if used == start:
        values = np.empty(config.SCALARS)
        sections = np.empty((MAX_SECTIONS, 2))
        key, _ = config.read(attributes, values, sections)
        _, first, _ = attachments.find_actuators(model, instance)
        radius = abs(
            attachments.pulley_radius(model, attachments.output_index(model, first))
        )
        swing = values[config.ECCENTRICITY] + values[config.OVALITY]
        if key == config.VALID_CONFIGURATION and swing >= radius:
            alone = values[config.ECCENTRICITY] >= radius
            key = config.ECCENTRICITY if alone else config.OVALITY
        route = config.key_text(attributes, config.ROUTE)
        tendon, mouth = -1, 0
        if key == config.VALID_CONFIGURATION and route.size > 0:
            tendon = attachments.find_route(model, instance, route)
            if tendon < 0:
                key = config.ROUTE
            elif config.bends_with_route(attributes) and path.has_branches(
                model, tendon
            ):
                key = config.BEND
            elif not attachments.is_length(
                mj_struct.real(model, mj_struct.TENDON_LENGTH0, tendon)
            ):
                used = append(message, start, messages.ITS_ROUTE)
                used = append(message, used, attachments.NO_LENGTH)
            elif config.is_open(attributes):
                key, used = messages.refuse_open_path(
                    message, start, model, instance, tendon
                )
        if key != config.VALID_CONFIGURATION:
            used = config.explain(message, start, attributes, key)
        if used == start:
            if config.is_mixed(attributes):
                name = config.key_text(attributes, config.MOUTH)
                mouth = attachments.find_mouth(model, instance, tendon, route, name)
            path_open = tendon if config.is_open(attributes) else -1
            body = attachments.keep_awake(model, instance, path_open, mouth)
            used = attachments.explain_sleep(message, start, model, body)
    if used > start:
        warn(message, used)
    return used > start


@callback
def cannot_act(model: int, data: int, instance: CInt) -> None:
    """Warn, once, why a cable does not pull, or with no finite tension."""
    messages.warn_cannot_act(model, data, instance)


@callback
def route(model: int, instance: CInt) -> CInt:
    """Return the spatial tendon that is the route of the instance, or -1."""
    attributes = mj_struct.attributes(model, instance)
    written = config.key_text(attributes, config.ROUTE)
    return attachments.find_route(model, instance, written)


@callback
def turn(model: int, data: int, tendon: CInt) -> float:
    """Return the total turning angle of a tendon at the last position [rad]."""
    whole, total = np.empty(1), np.empty(1)
    whole[0] = 1.0
    length = mj_struct.real(data, mj_struct.TEN_LENGTH, tendon)
    path.bend(model, data, tendon, 0, length, whole, total)
    return float(total[0])


@callback
def holds(model: int, data: int, instance: CInt) -> CInt:
    return 1 if evaluating.packed_block(model, data, instance) != 0 else 0


@callback
def wrap(model: int, data: int, instance: CInt, out: int) -> None:
    block = blocks.acting_block(model, data, instance)
    if block == 0 or not evaluating.update_parameters(block, model, instance):
        return
    follow(block, model, data, mj_struct.state(model, data, instance))
    n = load_word(block + blocks.SEGMENTS)
    prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
    assign(floats(out, n), kernel.segment_angles(prm, n))


@callback
def compliance(model: int, data: int, instance: CInt, out: int) -> None:
    """Write an instance's node compliances [m/N], then its elastic energy [J]."""
    block = blocks.acting_block(model, data, instance)
    if block == 0 or not evaluating.update_parameters(block, model, instance):
        return
    if blocks.is_open(block) and load_word(block + blocks.REFERENCE_KNOWN) == 0:
        set_reference(block, model, data)
    n = load_word(block + blocks.SEGMENTS)
    prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
    at_state = mj_struct.state(model, data, instance)
    state = floats(at_state, kernel.state_size(n))
    mark_stack(data)
    if blocks.is_open(block):
        # The packed nodes are those of the next step.
        packed, prm = prm, borrow_floats(data, prm.size)
        assign(prm, packed)
        reference = floats(
            blocks.shape_at(block, n, blocks.REFERENCE_STAGE), open_path.shape_size(n)
        )
        before = open_path.previous_lengths(
            reference, blocks.path_memory(at_state, n), n
        )
        moving_path.set_unstretched_lengths(prm, n, layout.tensions(state, n), before)
    found = floats(out, n + 2)
    assign(found[: n + 1], layout.node_compliance(prm, n))
    found[n + 1] = kernel.stored_energy(prm, n, state)
    free_stack(data)


@callback
def limits(model: int, data: int, instance: CInt, out: int) -> None:
    """Write the longest stable time steps of an instance (3,) [s] to an address."""
    fill(floats(out, 3), np.inf)
    if blocks.acting_block(model, data, instance) == 0:
        return
    evaluating.follow_all_paths(model, data, instance)
    stability_limits.stable_timesteps(model, data, instance, floats(out, 3))


@callback
def aim(model: int, data: int, instance: CInt, out: int) -> None:
    """Write the prediction of an instance's ends (`predict_ends`) to an address."""
    kind = mj_struct.integer(model, mj_struct.PLUGIN, instance)
    lead = mj_struct.block(data, mj_struct.first_cable(model, instance))
    area = lead + load_word(lead + blocks.PREDICTION_AREA)
    if implicit_ends.is_unknown(area):
        evaluating.follow_other_paths(
            model, data, instance, load_word(lead + blocks.EVALUATION_COUNT)
        )
        implicit_ends.predict_acceleration(model, data, kind, area)
    block = mj_struct.block(data, instance)
    implicit_ends.predict_ends(model, data, block, kind, area, floats(out, 9))


@callback
def missed(model: int, data: int, instance: CInt) -> None:
    """Warn, once, of each geom in the path of an instance that it never touches."""
    message = np.zeros(MESSAGE_CAPACITY, np.uint8)
    start = messages.begin_message(message, model, instance)
    used = append(message, start, guides.GEOMS_SEARCHED)
    if warned_once(message, used, mj_struct.signature(model)):
        return
    tendon = load_word(mj_struct.block(data, instance) + blocks.ROUTE)
    count = mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    mark_stack(data)
    touched = octets(borrow(data, count), count)
    guides.mark_touched(model, data, tendon, touched)
    for place in range(touched.size):
        if touched[place] == 0:
            used = guides.explain(message, start, model, tendon, place)
            warn(message, used)
    free_stack(data)


@callback
def check(model: int, data: int, instance: CInt) -> None:
    """Warn if the time step is too long for the instance, or its ends are not fit.

    What was refused at load can also be set on the compiled model.
    """
    message = np.zeros(MESSAGE_CAPACITY, np.uint8)
    start = messages.begin_message(message, model, instance)
    used = attachments.explain(message, start, model, instance)
    block = mj_struct.block(data, instance)
    if used == start and blocks.is_open(block):
        tendon = load_word(block + blocks.ROUTE)
        used = attachments.explain_bypass(message, start, model, instance, tendon)
    if used > start and not warned_once(message, used, mj_struct.signature(model)):
        warn(message, used)
    if blocks.is_open(block):
        messages.warn_no_effect(model, instance, block)
    if load_word(block + blocks.ROUTE) >= 0:
        missed(model, data, instance)
    messages.warn_cannot_pull(model, instance)
    messages.warn_short_conduit(model, data, instance, block)
    longest = np.empty(3)
    limits(model, data, instance, longest.ctypes.data)
    messages.warn_short_period(model, instance, block, longest[0], longest[1])
    if implicit_ends.is_implicit(model, block):
        longest[0] = longest[1] = np.inf
    step, worst = mj_struct.timestep(model), int(np.argmin(longest))
    limit = longest[worst]
    if step <= limit:
        return
    used = stability_limits.append_part(message, start, worst, step)
    if not warned_once(message, used, mj_struct.signature(model)):
        warn(
            message,
            stability_limits.append_limit(message, start, worst, limit, step),
        )


@callback
def pull_early(model: int, data: int, instance: CInt) -> None:
    """Pull with the pieces of an open cable before its actuators are evaluated.

    `mj_inverse` evaluates passive forces, but no actuators. Where the acceleration
    is given, an implicit end looks ahead by that.
    """
    block = mj_struct.block(data, instance)
    if mj_struct.disabled(model, _NO_ACTUATION) or messages.has_no_passive(model):
        return
    if not evaluating.update_parameters(block, model, instance):
        return
    lead = mj_struct.block(data, mj_struct.first_cable(model, instance))
    state, dt = evaluating.origin(block, model, data, instance)
    follow(block, model, data, state)
    store_word(
        block + blocks.PATH_EVALUATION, load_word(lead + blocks.EVALUATION_COUNT) + 1
    )
    u_proximal = blocks.proximal_winding(
        model, block, blocks.displacement(data, block, blocks.PROXIMAL)
    )[0]
    u_distal = blocks.displacement(data, block, blocks.DISTAL)
    known, looks = True, implicit_ends.is_implicit(model, block)
    if not looks:
        known = evaluating.evaluate(block, state, u_proximal, u_distal, 0.0, 0.0, dt)
    elif not evaluating.is_evaluated(block, data, state, u_proximal, u_distal):
        aim = np.empty(9)
        implicit_ends.predict_known_motion(model, data, block, aim)
        known = evaluate_prediction(model, block, state, aim, dt)
    if known:
        pull(block, model, data)
        store_word(
            block + blocks.EARLY_PULL,
            blocks.EARLY_REPLACED if looks else blocks.EARLY_KEPT,
        )


@callback
def undo_early(model: int, data: int, instance: CInt) -> None:
    """Take back the early pulls of implicit cables, to the last bit.

    They depend on an acceleration that is no part of the state; what is left of
    them by rounding must not reach the simulation.
    """
    kind, nv = (
        mj_struct.integer(model, mj_struct.PLUGIN, instance),
        mj_struct.dofs(model),
    )
    passive = floats(load_word(data + mj_struct.QFRC_PASSIVE), nv)
    for other in range(mj_struct.plugins(model) - 1, -1, -1):
        block = 0
        if mj_struct.integer(model, mj_struct.PLUGIN, other) == kind:
            block = blocks.own_block(model, data, other)
        if block == 0 or load_word(block + blocks.EARLY_PULL) != blocks.EARLY_REPLACED:
            continue
        if not blocks.fits(block, model, other):
            continue
        n = load_word(block + blocks.SEGMENTS)
        pulls = floats(blocks.pulls_at(block, n), nv)
        before = floats(blocks.before_at(block, n), nv)
        for i in range(nv):
            # Unless another plugin has added to it since.
            if passive[i] == before[i] + pulls[i]:
                passive[i] = before[i]
            else:
                passive[i] -= pulls[i]
        store_word(block + blocks.PASSIVE_FRESH, 1)
        store_word(block + blocks.EARLY_PULL, 0)


@callback
def settle(model: int, data: int, instance: CInt, keeps_rope: CInt) -> None:
    """Lay the cable at rest, with its ends where they are at the last position.

    Its tension is the pretension or, where it keeps its rope, that of the rope
    which was mounted in the pose `qpos0`.
    """
    block = blocks.acting_block(model, data, instance)
    if block == 0:
        cannot_act(model, data, instance)
    if block == 0 or not evaluating.update_parameters(block, model, instance):
        return
    proximal_length = blocks.displacement(data, block, blocks.PROXIMAL)
    distal_length = blocks.displacement(data, block, blocks.DISTAL)
    state = mj_struct.state(model, data, instance)
    evaluating.set_rest_state(
        block, model, state, proximal_length, distal_length, mj_struct.time(data)
    )
    n = load_word(block + blocks.SEGMENTS)
    store_real(blocks.pose_at(state, n), jump_warnings.pose_checksum(model, data))
    seats = seats_with_route(block)
    if seats or blocks.is_open(block):
        follow(block, model, data, state)
    if keeps_rope != 0:
        evaluating.keep_mounted_rope(block, model, state)
    elif seats:
        prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
        whole = floats(state, kernel.state_size(n))
        prepare.rest_in(prm, n, layout.segment_angles(prm, n), whole)
    if blocks.is_open(block):
        shape = floats(blocks.shape_at(block, n, 0), open_path.shape_size(n))
        open_path.save_path(shape, n, blocks.path_memory(state, n))


@callback
def nstate(model: int, instance: CInt) -> CInt:
    attributes = mj_struct.attributes(model, instance)
    n = max(config.segment_count(attributes), 1)
    more = open_path.memory_size(n) if config.is_open(attributes) else 0
    return kernel.state_size(n) + blocks.STATE_PATH + more


@callback
def init(model: int, data: int, instance: CInt) -> CInt:
    mj_struct.set_block(data, instance, 0)
    if refused(model, instance) != 0:
        return -1
    attributes = mj_struct.attributes(model, instance)
    n = config.segment_count(attributes)
    free = config.is_open(attributes)
    shape = 8 * (open_path.shape_size(n) if free else n)
    pulls = 8 * (3 * mj_struct.dofs(model) + n + 1) if free else 0
    # Its parts follow each other from the header on, whatever is in it.
    own = blocks.guides_at(0, n) + 8 * n + (blocks.REFERENCE_STAGE + 1) * shape + pulls
    kept, area, poses = own, 0, 0
    own += 8 * (kernel.state_size(n) + blocks.STATE_PATH)
    own += 8 * open_path.memory_size(n) if free else 0
    if mj_struct.first_cable(model, instance) == instance:
        area, poses = (
            implicit_ends.area_size(model),
            jump_warnings.poses_size(model),
        )
    block = allocate(own + area + poses)
    clear(block, own + area + poses)
    store_word(block + blocks.FIRST_STAGE_STATE, kept)
    store_word(block + blocks.PREDICTION_AREA, own if area > 0 else 0)
    store_word(block + blocks.MOCAP_POSES, own + area if poses > 0 else 0)
    store_word(block + blocks.SEGMENTS, n)
    store_word(block + blocks.SHAPE_BYTES, shape)
    store_word(block + blocks.PATH_KIND, config.path_kind(attributes))
    blocks.save_sizes(block, model, instance)
    evaluating.pack(block, model, instance)
    mj_struct.set_block(data, instance, block)
    return 0


@callback
def destroy(data: int, instance: CInt) -> None:
    block = mj_struct.block(data, instance)
    if block != 0:
        release(block)
    mj_struct.set_block(data, instance, 0)


@callback
def reset(model: int, state: int, block: int, instance: CInt) -> None:
    if block == 0 or not (
        mj_struct.has_timestep(model) and blocks.fits(block, model, instance)
    ):
        return
    if not evaluating.update_parameters(block, model, instance):
        return
    store_real(block + blocks.CHECKED_TIMESTEP, 0.0)
    store_real(block + blocks.CHECKED_STIFFNESS, 0.0)
    jump_warnings.forget_poses(model, block)
    # The pose `qpos0` may be another since.
    store_word(block + blocks.REFERENCE_KNOWN, 0)
    proximal_length = blocks.rest_displacement(model, block, blocks.PROXIMAL)
    distal_length = blocks.rest_displacement(model, block, blocks.DISTAL)
    evaluating.set_rest_state(block, model, state, proximal_length, distal_length, 0.0)
    rest = load_word(model + mj_struct.QPOS0)
    n = load_word(block + blocks.SEGMENTS)
    store_real(blocks.pose_at(state, n), jump_warnings.checksum(model, rest))


@callback
def compute(model: int, data: int, instance: CInt, capability: CInt) -> None:
    own = blocks.own_block(model, data, instance)
    if own != 0:
        store_word(own + blocks.EVALUATED_MODEL, 0)
        if capability == _PASSIVE and not blocks.is_open(own):
            return  # all that it does are the forces of its actuators
    block = blocks.acting_block(model, data, instance)
    if block == 0:
        cannot_act(model, data, instance)
        return
    if capability == _PASSIVE:
        store_word(block + blocks.PASSIVE_FRESH, 1)
        store_word(block + blocks.EARLY_PULL, 0)
        pull_early(model, data, instance)
        return
    lead = mj_struct.block(data, mj_struct.first_cable(model, instance))
    if lead == block:
        implicit_ends.begin_evaluation(lead)
        undo_early(model, data, instance)
    usable = evaluating.update_parameters(block, model, instance)
    store_word(block + blocks.EVALUATED_MODEL, model if usable else 0)
    if load_word(block + blocks.OTHER_KIND) != 0:
        cannot_act(model, data, instance)
        return
    cut = blocks.is_open(block) and messages.has_no_passive(model)
    tendon = load_word(block + blocks.ROUTE)
    if tendon >= 0 and not np.isfinite(
        mj_struct.real(data, mj_struct.TEN_LENGTH, tendon)
    ):
        # MuJoCo sees the bad acceleration, warns and resets, as for any other.
        cannot_act(model, data, instance)
        blocks.invalidate(block)
        mj_struct.set_force(data, load_word(block + blocks.PROXIMAL), np.nan)
        mj_struct.set_force(data, load_word(block + blocks.DISTAL), np.nan)
        return
    if usable and mj_struct.enabled(model, _SLEEP):
        route = load_word(block + blocks.ROUTE) if blocks.is_open(block) else -1
        attachments.keep_awake(model, instance, route, load_word(block + blocks.MOUTH))
    n = load_word(block + blocks.SEGMENTS)
    state, dt = evaluating.origin(block, model, data, instance)
    begins = state == mj_struct.state(model, data, instance)
    u_proximal, lever = blocks.proximal_winding(
        model, block, blocks.displacement(data, block, blocks.PROXIMAL)
    )
    u_distal = blocks.displacement(data, block, blocks.DISTAL)
    looks = False
    if usable:
        evaluation = load_word(lead + blocks.EVALUATION_COUNT)
        if load_word(block + blocks.PATH_EVALUATION) != evaluation:
            follow(block, model, data, state)
            store_word(block + blocks.PATH_EVALUATION, evaluation)
        # A piece that has become short needs a shorter step.
        shorter = blocks.is_open(block) and evaluating.has_stiffened(block)
        if shorter or load_real(block + blocks.CHECKED_TIMESTEP) != mj_struct.timestep(
            model
        ):
            store_real(block + blocks.CHECKED_TIMESTEP, mj_struct.timestep(model))
            check(model, data, instance)
        if begins:
            touched = jump_warnings.position_changed(
                model, data, load_real(blocks.pose_at(state, n))
            )
            store_word(block + blocks.POSITION_CHANGED, 1 if touched else 0)
        looks = implicit_ends.is_implicit(model, block)
    store_word(block + blocks.PATH_EVALUATION, 0)
    if cut:
        messages.warn_once(model, instance, messages.NO_PASSIVE)
    evaluating.save_motion(block, data, u_proximal, u_distal)
    known = False
    if usable and not cut and looks:
        found = np.empty(9)
        aim(model, data, instance, found.ctypes.data)
        known = evaluate_prediction(model, block, state, found, dt)
    elif usable and not cut:
        known = evaluating.evaluate(block, state, u_proximal, u_distal, 0.0, 0.0, dt)
    if known:
        tension = blocks.new_at(block, n) + 8 * kernel.STATE_HEADER
        proximal = max(load_real(tension), 0.0) * lever
        distal = max(load_real(tension + 8 * n), 0.0)
    else:
        # MuJoCo sees the bad acceleration, warns and resets, as for any other.
        proximal, distal = np.nan, np.nan
    if usable and not cut and not np.isfinite(proximal + distal):
        cannot_act(model, data, instance)
    mj_struct.set_force(data, load_word(block + blocks.PROXIMAL), proximal)
    mj_struct.set_force(data, load_word(block + blocks.DISTAL), -distal)
    if usable and blocks.is_open(block) and load_word(block + blocks.EARLY_PULL) == 0:
        pull(block, model, data)
    store_word(block + blocks.EARLY_PULL, 0)
    if mj_struct.integrator(model) == evaluating.RK4:
        if begins:
            store_word(
                block + blocks.FIRST_STAGE_VALID, load_word(block + blocks.RESULT_VALID)
            )
            evaluating.save_first_stage(block, data, state)
        stages = block + blocks.STAGES
        copy(stages + blocks.STAGE_SIZE, stages, 3 * blocks.STAGE_SIZE)
        store_real(stages + 3 * blocks.STAGE_SIZE, u_proximal)
        store_real(stages + 3 * blocks.STAGE_SIZE + 8, u_distal)
        store_real(stages + 3 * blocks.STAGE_SIZE + 16, mj_struct.time(data))
        copy(block + blocks.INPUTS, stages + 3 * blocks.STAGE_SIZE + 24, 40)
        if load_word(block + blocks.ROUTE) >= 0:
            size = load_word(block + blocks.SHAPE_BYTES)
            copy(blocks.shape_at(block, n, 2), blocks.shape_at(block, n, 1), 3 * size)
            copy(blocks.shape_at(block, n, 0), blocks.shape_at(block, n, 4), size)


@callback
def advance(model: int, data: int, instance: CInt) -> None:
    block = blocks.own_block(model, data, instance)
    if block == 0:
        return
    known = load_word(block + blocks.EVALUATED_MODEL) == model
    # Without actuation that is of an evaluation before this step.
    known = known and not mj_struct.disabled(model, _NO_ACTUATION)
    store_word(block + blocks.EVALUATED_MODEL, 0)
    if not known:
        block = blocks.acting_block(model, data, instance)
        if block == 0 or not evaluating.update_parameters(block, model, instance):
            return
    state = mj_struct.state(model, data, instance)
    n = load_word(block + blocks.SEGMENTS)
    u_proximal, _ = blocks.proximal_winding(
        model, block, blocks.displacement(data, block, blocks.PROXIMAL)
    )
    u_distal = blocks.displacement(data, block, blocks.DISTAL)
    jump_warnings.save_poses(model, data, block)
    # Under RK4 these are of its last stage.
    if mj_struct.integrator(model) != evaluating.RK4:
        now = blocks.shape_at(block, n, 0)
        messages.warn_jump(model, data, instance, state, u_proximal, u_distal, now)
    if attachments.in_disabled_group(model, instance):
        messages.warn_once(model, instance, messages.GROUP_DISABLED)
    dt = mj_struct.timestep(model)
    time = 0.0
    ends = u_proximal, u_distal
    yields = 0.0, 0.0
    if mj_struct.disabled(model, _NO_ACTUATION):
        # Nothing has evaluated the last position.
        messages.warn_once(model, instance, messages.ACTUATION_DISABLED)
        follow(block, model, data, state)
    elif (
        mj_struct.integrator(model) != evaluating.RK4
        and load_real(block + blocks.INPUT_POSITIONS) == u_proximal
        and load_real(block + blocks.INPUT_POSITIONS + 8) == u_distal
    ):
        # What was applied is what the step did, whatever it looked ahead to.
        u_proximal, u_distal = (
            load_real(block + blocks.INPUTS),
            load_real(block + blocks.INPUTS + 8),
        )
        yields = (
            load_real(block + blocks.INPUTS + 16),
            load_real(block + blocks.INPUTS + 24),
        )
    shape = blocks.shape_at(block, n, 0)
    if mj_struct.integrator(model) == evaluating.RK4:
        # A step makes four evaluations; the first of them is committed. With
        # actuation disabled there are none, and the last position counts.
        time = mj_struct.time(data) - dt
        stages = block + blocks.STAGES
        if (
            load_real(stages + 3 * blocks.STAGE_SIZE) == u_proximal
            and load_real(stages + 3 * blocks.STAGE_SIZE + 8) == u_distal
            and evaluating.path_unchanged(block)
        ):
            u_proximal = load_real(stages)
            u_distal = load_real(stages + 8)
            ends = u_proximal, u_distal
            first = blocks.shape_at(block, n, 1)
            messages.warn_jump(
                model, data, instance, state, u_proximal, u_distal, first
            )
            time = load_real(stages + 16)
            u_proximal, u_distal, yields, dt = evaluating.evaluation_inputs(stages + 24)
            if load_word(block + blocks.ROUTE) >= 0:
                shape = first
                lay(block, shape, state)
    if evaluating.evaluate(
        block, state, u_proximal, u_distal, yields[0], yields[1], dt
    ):
        copy(blocks.new_at(block, n), state, evaluating.written_bytes(block))
        store_real(blocks.committed_time_at(state, n), time)
        store_real(blocks.pose_at(state, n), jump_warnings.pose_checksum(model, data))
        messages.save_ends(data, block, state, n, ends[0], ends[1])
        if blocks.is_open(block):
            seen = floats(shape, open_path.shape_size(n))
            open_path.save_path(seen, n, blocks.path_memory(state, n))
