"""Compiled update of a cable's segments by the path of its tendon, for callbacks."""

import numpy as np

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable import _open_path as open_path
from cc_mujoco.cable import _pack as prepare
from cc_mujoco.cable._cable import MAX_SECTIONS
from cc_mujoco.native import FloatArray, internal
from cc_mujoco.plugin import _attachments as attachments
from cc_mujoco.plugin import _config as config
from cc_mujoco.plugin import _ffi as ffi
from cc_mujoco.plugin import _instance_data as blocks
from cc_mujoco.plugin import _path as path
from cc_mujoco.plugin._ffi import MjData, MjModel
from cc_mujoco.plugin._instance_data import Block


@internal
def _exchange_mocap(model: MjModel, data: MjData, held: ffi.FloatMatrix) -> None:
    """Exchange the poses of the mocap bodies with those in `held` (bodies, 7)."""
    before = np.empty(7)
    for body in range(model.nbody):
        place = model.body_mocapid[body]
        if place >= 0:
            before[:3] = data.mocap_pos[place]
            before[3:] = data.mocap_quat[place]
            data.mocap_pos[place, :] = held[body, :3]
            data.mocap_quat[place, :] = held[body, 3:]
            held[body, :] = before


@internal
def _survey(
    block: Block, model: MjModel, data: MjData, stage: int, known: bool
) -> float:
    """Measure an open path at the last evaluated position and store it as a stage.

    Return its length from the mouth on [m]. If the path in `qpos0` is `known`, the part
    inside the conduit is copied from it.
    """
    led = blocks.path_of(block, stage)
    reach = path.measure_path(model, data, led)
    if not known:
        return float(reach)
    reference = blocks.shape(block, blocks.REFERENCE_STAGE)
    open_path.keep_conduit(led.measured, reference, led.n, led.guided)
    if block.bends_with_route == 1:
        _bend_inside(block, model, data, reach, led.measured[: led.guided])
        open_path.remember_bends(led.measured, led.n, led.guided)
    return float(reach)


@internal
def _bend_inside(
    block: Block, model: MjModel, data: MjData, reach: float, angles: FloatArray
) -> None:
    """Store the wrap angles [rad] of the conduit up to the mouth of a mixed path."""
    reference = blocks.shape(block, blocks.REFERENCE_STAGE)
    contact = open_path.contacts(reference, block.segments)[: block.guided]
    length = data.ten_length[block.route] - reach
    path.bend(model, data, block.route, block.mouth + 1, length, contact, angles)


@internal
def seats_with_route(block: Block) -> bool:
    """Return whether a guided cable has clearance in bends that its route moves."""
    guided = block.bends_with_route == 1 and not blocks.is_open(block)
    return guided and bool(blocks.parameters(block)[config.KEY.clearance] > 0.0)


@internal
def _bend(block: Block, model: MjModel, data: MjData, stage: int) -> None:
    """Write to `stage` of the block the wrap angles (n,) [rad] that its route gives."""
    contact = layout.contact_length(blocks.parameters(block), block.segments)
    length, angles = data.ten_length[block.route], blocks.shape(block, stage)
    path.bend(model, data, block.route, 0, length, contact, angles)


@internal
def set_reference(block: Block, model: MjModel, data: MjData) -> None:
    ffi.mark_stack(data)
    kept = ffi.borrow_floats(data, model.nq)
    kept[:] = data.qpos[: model.nq]
    data.qpos[: model.nq] = model.qpos0[: model.nq]
    held = ffi.borrow_rows(data, model.nbody, 7)
    for body in range(model.nbody):
        held[body, :3] = model.body_pos[body]
        held[body, 3:] = model.body_quat[body]
    _exchange_mocap(model, data, held)
    ffi.evaluate_bodies(model, data)
    ffi.evaluate_tendons(model, data)
    blocks.shape(block, blocks.REFERENCE_STAGE)[:] = 0.0
    if blocks.is_open(block):
        reach = _survey(block, model, data, blocks.REFERENCE_STAGE, False)
        _make_mesh(block, model, data)
        if block.bends_with_route == 1:
            reference = blocks.shape(block, blocks.REFERENCE_STAGE)
            bends = open_path.bends_of(reference, block.segments)
            _bend_inside(block, model, data, reach, bends[: block.guided])
    else:
        _bend(block, model, data, blocks.REFERENCE_STAGE)
    data.qpos[: model.nq] = kept
    _exchange_mocap(model, data, held)
    ffi.evaluate_bodies(model, data)
    ffi.evaluate_tendons(model, data)
    ffi.free_stack(data)
    blocks.invalidate(block)
    block.reference_known = 1


@internal
def _make_mesh(block: Block, model: MjModel, data: MjData) -> None:
    n, guided = block.segments, block.guided
    values = np.empty(config.SCALARS)
    sections = np.empty((MAX_SECTIONS, config.SECTION_SIZE))
    attributes = ffi.attributes(model, block.instance)
    _, count = config.read(attributes, values, sections)
    reference = blocks.shape(block, blocks.REFERENCE_STAGE)
    if guided > 0:
        inside = ffi.borrow_floats(data, kernel.parameter_size(guided))
        kernel.pack(values, sections[:count], guided, inside)
        open_path.store_conduit(inside, reference, n, guided)
    open_path.pack_reference(values, n, guided, reference, blocks.parameters(block))


@internal
def lay(block: Block, stage: int, state: int) -> None:
    """Set the packed segments to the path of a stage, for the state at this address."""
    n, prm, shape = block.segments, blocks.parameters(block), blocks.shape(block, stage)
    if blocks.is_open(block):
        reference = blocks.shape(block, blocks.REFERENCE_STAGE)
        whole = blocks.kernel_state(state, n)
        memory, gained = blocks.path_memory(state, n), blocks.node_scratch(block)
        changed = open_path.lay(prm, n, whole, shape, reference, memory, gained)
    else:
        changed = prepare.set_path(prm, n, shape, layout.contact_length(prm, n))
    if changed:
        blocks.invalidate(block)


@internal
def follow(block: Block, model: MjModel, data: MjData, state: int) -> None:
    if block.route < 0:
        return
    n = block.segments
    if blocks.is_open(block):
        if block.reference_known == 0:
            set_reference(block, model, data)
        _survey(block, model, data, 0, True)
    else:
        _bend(block, model, data, 0)
    lay(block, 0, state)
    whole = blocks.kernel_state(state, n)
    if seats_with_route(block) and whole[layout.rest_wrap(n)] < 0.0:
        if block.reference_known == 0:
            set_reference(block, model, data)
        reference = blocks.shape(block, blocks.REFERENCE_STAGE)[:n]
        prepare.rest_in(blocks.parameters(block), n, reference, whole)


@internal
def pull(block: Block, model: MjModel, data: MjData) -> None:
    n, nv = block.segments, model.nv
    last = ffi.floats(block + block.pulls, nv)
    forces = ffi.floats(block + block.forces, nv)
    forces[:] = 0.0
    tied = 0.0
    node = layout.tensions(blocks.kernel_state(block + block.new_state, n), n)
    for end in range(2):
        if block.tied[end] != 0:
            gear = attachments.pulley_radius(model, block.outputs[end])
            tied += max(node[n * end], 0.0) * (gear if end == 0 else -gear)
    led = blocks.path_of(block, 0)
    path.apply_pulls(model, data, led, node, tied, -1, forces.ctypes.data)
    passive = data.qfrc_passive[:nv]
    before = ffi.floats(block + block.passive_before, nv)
    before[:] = passive
    if block.passive_fresh == 0:
        # MuJoCo evaluates the actuators again, alone.
        ffi.add(passive, last, -1.0)
    ffi.add(passive, forces, 1.0)
    last[:] = forces
    block.passive_fresh = 0
