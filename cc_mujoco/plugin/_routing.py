"""Compiled guidance of a cable along its path, for callbacks of the engine plugin.

Functions that other callbacks call by name, so that they are compiled once each.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable import _pack as prepare
from cc_mujoco.cable._cable import MAX_SECTIONS
from cc_mujoco.plugin import _attachments as attachments
from cc_mujoco.plugin import _config as config
from cc_mujoco.plugin import _instance_data as blocks
from cc_mujoco.plugin import _mj_struct as mj_struct
from cc_mujoco.plugin import _open_path as open_path
from cc_mujoco.plugin import _path as path
from cc_mujoco.plugin._ffi import (
    FloatMatrix,
    Floats,
    add,
    assign,
    borrow_floats,
    borrow_rows,
    callback,
    evaluate_bodies,
    evaluate_tendons,
    fill,
    floats,
    free_stack,
    internal,
    load_real,
    load_word,
    mark_stack,
    store_real,
    store_word,
)


@internal
def _rest_mocap(model: int, held: FloatMatrix) -> None:
    """Write the initial position and orientation of mocap bodies (bodies, 7)."""
    for body in range(mj_struct.bodies(model)):
        for i in range(7):
            field = mj_struct.BODY_POS if i < 3 else mj_struct.BODY_QUAT
            at = 3 * body + i if i < 3 else 4 * body + i - 3
            held[body, i] = mj_struct.real(model, field, at)


@internal
def _exchange_mocap(model: int, data: int, held: FloatMatrix) -> None:
    """Exchange the poses of the mocap bodies with those in `held` (bodies, 7)."""
    for body in range(mj_struct.bodies(model)):
        place = mj_struct.integer(model, mj_struct.BODY_MOCAP, body)
        for i in range(7 if place >= 0 else 0):
            at = load_word(data + mj_struct.MOCAP_POS) + 24 * place + 8 * i
            if i >= 3:
                at = load_word(data + mj_struct.MOCAP_QUAT) + 32 * place + 8 * (i - 3)
            before = load_real(at)
            store_real(at, held[body, i])
            held[body, i] = before


@callback
def _survey(block: int, model: int, data: int, state: int, shape: int) -> None:
    """Measure the open path at the last position, as seen from a state.

    `state` is 0 where the path is that of `qpos0` itself, which is not known yet.
    """
    n, guided = load_word(block + blocks.SEGMENTS), load_word(block + blocks.GUIDED)
    tendon, size = load_word(block + blocks.ROUTE), open_path.shape_size(n)
    seen = floats(shape, size)
    mouth = load_word(block + blocks.MOUTH)
    reach = open_path.measure_path(
        model,
        data,
        tendon,
        mouth,
        guided,
        n,
        floats(blocks.guides_at(block, n), n),
        seen,
    )
    if state == 0:
        return
    reference = floats(blocks.shape_at(block, n, blocks.REFERENCE_STAGE), size)
    open_path.keep_conduit(seen, reference, n, guided)
    if load_word(block + blocks.BENDS_WITH_ROUTE) == 1:
        length = mj_struct.real(data, mj_struct.TEN_LENGTH, tendon) - reach
        contact = open_path.contacts(reference, n)[:guided]
        path.bend(model, data, tendon, mouth + 1, length, contact, seen[:guided])


@internal
def seats_with_route(block: int) -> bool:
    """Return whether a cable has clearance in bends that its route changes."""
    n = load_word(block + blocks.SEGMENTS)
    prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
    is_bent = load_word(block + blocks.BENDS_WITH_ROUTE) == 1
    return is_bent and float(prm[config.CLEARANCE]) > 0.0


@internal
def _bend(block: int, model: int, data: int, angles: Floats) -> None:
    """Measure the wrap angles of a conduit that follows its route (n,) [rad]."""
    n, tendon = load_word(block + blocks.SEGMENTS), load_word(block + blocks.ROUTE)
    length = mj_struct.real(data, mj_struct.TEN_LENGTH, tendon)
    prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
    path.bend(model, data, tendon, 0, length, layout.contact_length(prm, n), angles)


@callback
def set_reference(block: int, model: int, data: int) -> None:
    """Measure the path in the pose `qpos0`; of an open one make the mesh."""
    n, nq = load_word(block + blocks.SEGMENTS), mj_struct.positions(model)
    present, rest = (
        load_word(data + mj_struct.QPOS),
        load_word(model + mj_struct.QPOS0),
    )
    mark_stack(data)
    kept = borrow_floats(data, nq)
    assign(kept, floats(present, nq))
    assign(floats(present, nq), floats(rest, nq))
    held = borrow_rows(data, mj_struct.bodies(model), 7)
    _rest_mocap(model, held)
    _exchange_mocap(model, data, held)
    evaluate_bodies(model, data)
    evaluate_tendons(model, data)
    free = blocks.is_open(block)
    size = open_path.shape_size(n) if free else n
    first = blocks.shape_at(block, n, blocks.REFERENCE_STAGE)
    reference = floats(first, size)
    fill(reference, 0.0)
    if free:
        _survey(block, model, data, 0, first)
    else:
        _bend(block, model, data, reference)
    assign(floats(present, nq), kept)
    _exchange_mocap(model, data, held)
    evaluate_bodies(model, data)
    evaluate_tendons(model, data)
    if free:
        _make_mesh(block, model, data, reference)
    free_stack(data)
    blocks.invalidate(block)
    store_word(block + blocks.REFERENCE_KNOWN, 1)


@internal
def _make_mesh(block: int, model: int, data: int, reference: Floats) -> None:
    n, guided = load_word(block + blocks.SEGMENTS), load_word(block + blocks.GUIDED)
    values = np.empty(config.SCALARS)
    sections = np.empty((MAX_SECTIONS, 2))
    attributes = mj_struct.attributes(model, load_word(block + blocks.INSTANCE))
    _, count = config.read(attributes, values, sections)
    prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
    if guided > 0:
        inside = borrow_floats(data, kernel.parameter_size(guided))
        kernel.pack(values, sections[:count], guided, inside)
        open_path.store_conduit(inside, reference, n, guided)
    open_path.pack_reference(values, n, guided, reference, prm)


@callback
def lay(block: int, shape: int, state: int) -> None:
    """Give the packed segments the path at an address, as seen from a state."""
    n = load_word(block + blocks.SEGMENTS)
    prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
    if blocks.is_open(block):
        size = open_path.shape_size(n)
        path_now = floats(shape, size)
        reference = floats(blocks.shape_at(block, n, blocks.REFERENCE_STAGE), size)
        gained = floats(blocks.scratch_at(block, n), n + 1)
        tension = layout.tensions(floats(state, kernel.state_size(n)), n)
        memory = blocks.path_memory(state, n)
        changed = open_path.lay(prm, n, tension, path_now, reference, memory, gained)
    else:
        contacts = layout.contact_length(prm, n)
        changed = prepare.set_path(prm, n, floats(shape, n), contacts)
    if changed:
        blocks.invalidate(block)


@callback
def follow(block: int, model: int, data: int, state: int) -> None:
    """Lead the cable along its path at the last position, from a state."""
    tendon = load_word(block + blocks.ROUTE)
    if tendon < 0:
        return
    n = load_word(block + blocks.SEGMENTS)
    now = blocks.shape_at(block, n, 0)
    if blocks.is_open(block):
        if load_word(block + blocks.REFERENCE_KNOWN) == 0:
            set_reference(block, model, data)
        _survey(block, model, data, state, now)
    else:
        _bend(block, model, data, floats(now, n))
    lay(block, now, state)
    if seats_with_route(block) and load_real(state + 8 * layout.rest_wrap(n)) < 0.0:
        if load_word(block + blocks.REFERENCE_KNOWN) == 0:
            set_reference(block, model, data)
        first = floats(blocks.shape_at(block, n, blocks.REFERENCE_STAGE), n)
        prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
        prepare.rest_in(prm, n, first, floats(state, kernel.state_size(n)))


@callback
def pull(block: int, model: int, data: int) -> None:
    """Pull with the pieces of an open cable, as last evaluated."""
    n, nv = load_word(block + blocks.SEGMENTS), mj_struct.dofs(model)
    target = load_word(data + mj_struct.QFRC_PASSIVE)
    last = floats(blocks.pulls_at(block, n), nv)
    forces = floats(blocks.scratch_at(block, n), nv)
    fill(forces, 0.0)
    tied = 0.0
    node = blocks.new_at(block, n) + 8 * kernel.STATE_HEADER
    for end in (blocks.PROXIMAL, blocks.DISTAL):
        if load_word(block + blocks.TIED_ENDS + end - blocks.PROXIMAL) != 0:
            gear = attachments.pulley_radius(model, load_word(block + end))
            sense = gear if end == blocks.PROXIMAL else -gear
            at = node if end == blocks.PROXIMAL else node + 8 * n
            tied += max(load_real(at), 0.0) * sense
    open_path.apply_pulls(
        model, data, load_word(block + blocks.ROUTE), load_word(block + blocks.MOUTH),
        floats(blocks.shape_at(block, n, 0), open_path.shape_size(n)), n,
        load_word(block + blocks.GUIDED), floats(node, n + 1), tied, -1,
        block + blocks.SCRATCH, forces.ctypes.data,
    )  # fmt: skip
    passive = floats(target, nv)
    assign(floats(blocks.before_at(block, n), nv), passive)
    if load_word(block + blocks.PASSIVE_FRESH) == 0:
        # MuJoCo evaluates the actuators again, alone.
        add(passive, last, -1.0)
    add(passive, forces, 1.0)
    assign(last, forces)
    store_word(block + blocks.PASSIVE_FRESH, 0)
