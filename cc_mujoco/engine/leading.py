"""Compiled guidance of a cable along its path, for callbacks of the engine plugin.

Functions that other callbacks call by name, so that they are compiled once each.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cfunc

from cc_mujoco.engine import config, ends, fields, path, pieces
from cc_mujoco.engine.block import (
    DISTAL,
    FOLLOWS,
    FRESH,
    GUIDED,
    INSTANCE,
    MOUTH,
    PROXIMAL,
    REFERENCE,
    REFERRED,
    ROUTE,
    SCRATCH,
    SEGMENTS,
    TIED,
    before_at,
    memory,
    new_at,
    opens,
    outdate,
    parameters_at,
    pulls_at,
    scratch_at,
    shape_at,
)
from cc_mujoco.engine.memory import (
    Floats,
    add,
    assign,
    evaluate_bodies,
    evaluate_tendons,
    export,
    fill,
    floats,
    internal,
    load_real,
    load_word,
    store_real,
    store_word,
    types,
)
from cc_mujoco.transmission import kernel, material, packing, prepare
from cc_mujoco.transmission.parameters import MAX_SECTIONS

_FOLLOW = types.void(types.intp, types.intp, types.intp, types.intp)
_LAY = types.void(types.intp, types.intp, types.intp)
_PULL = _REFER = types.void(types.intp, types.intp, types.intp)
_SURVEY = types.void(types.intp, types.intp, types.intp, types.intp, types.intp)
follow = types.ExternalFunction("cc_mujoco_follow", _FOLLOW)
lay = types.ExternalFunction("cc_mujoco_lay", _LAY)
pull = types.ExternalFunction("cc_mujoco_pull", _PULL)
refer = types.ExternalFunction("cc_mujoco_refer", _REFER)
_survey = types.ExternalFunction("cc_mujoco_survey", _SURVEY)


@internal
def _rest_mocap(model: int, held: Floats) -> None:
    """Write the initial position and orientation of mocap bodies (bodies, 7)."""
    for body in range(fields.bodies(model)):
        for i in range(7):
            field = fields.BODY_POS if i < 3 else fields.BODY_QUAT
            at = 3 * body + i if i < 3 else 4 * body + i - 3
            held[body, i] = fields.real(model, field, at)


@internal
def _exchange_mocap(model: int, data: int, held: Floats) -> None:
    """Put mocap bodies where `held` (bodies, 7) says, and into it where they were."""
    for body in range(fields.bodies(model)):
        place = fields.integer(model, fields.BODY_MOCAP, body)
        for i in range(7 if place >= 0 else 0):
            at = load_word(data + fields.MOCAP_POS) + 24 * place + 8 * i
            if i >= 3:
                at = load_word(data + fields.MOCAP_QUAT) + 32 * place + 8 * (i - 3)
            before = load_real(at)
            store_real(at, held[body, i])
            held[body, i] = before


def compile_leading(stamp: str, options: dict[str, Any]) -> None:
    """Compile these functions; arguments as `callbacks.compile_callbacks` uses them."""

    @cfunc(_SURVEY, **options)
    def survey_path(block: int, model: int, data: int, state: int, shape: int) -> None:
        """Measure the open path at the last position, as seen from a state.

        `state` is 0 where the path is that of `qpos0` itself, which is not known yet.
        """
        _ = stamp
        n, guided = load_word(block + SEGMENTS), load_word(block + GUIDED)
        tendon, size = load_word(block + ROUTE), pieces.shape_size(n)
        seen = floats(shape, size)
        points, reach = pieces.survey(
            model, data, tendon, load_word(block + MOUTH), guided, n, seen
        )
        if state == 0:
            return
        reference = floats(shape_at(block, n, REFERENCE), size)
        assign(pieces.angles(seen, n)[:guided], pieces.angles(reference, n))
        assign(pieces.contacts(seen, n)[:guided], pieces.contacts(reference, n))
        if guided > 0:
            inside = pieces.lengths(reference, n)
            assign(pieces.lengths(seen, n)[: guided + 1], inside)
        if load_word(block + FOLLOWS) == 1:
            length = fields.real(data, fields.TEN_LENGTH, tendon) - reach
            rubs = pieces.contacts(reference, n)[:guided]
            path.bend(model, data, tendon, points, length, rubs, seen[:guided])

    export("cc_mujoco_survey", survey_path.address)

    @cfunc(_REFER, **options)
    def refer_path(block: int, model: int, data: int) -> None:
        """Measure the open path in the pose `qpos0` and make its mesh."""
        _ = stamp
        n, guided = load_word(block + SEGMENTS), load_word(block + GUIDED)
        nq = fields.positions(model)
        present, rest = (
            load_word(data + fields.POSITION),
            load_word(model + fields.REST),
        )
        kept = np.empty(nq)
        assign(kept, floats(present, nq))
        assign(floats(present, nq), floats(rest, nq))
        held = np.empty((fields.bodies(model), 7))
        _rest_mocap(model, held)
        _exchange_mocap(model, data, held)
        evaluate_bodies(model, data)
        evaluate_tendons(model, data)
        size = pieces.shape_size(n)
        reference = floats(shape_at(block, n, REFERENCE), size)
        fill(reference, 0.0)
        _survey(block, model, data, 0, shape_at(block, n, REFERENCE))
        assign(floats(present, nq), kept)
        _exchange_mocap(model, data, held)
        evaluate_bodies(model, data)
        evaluate_tendons(model, data)

        values = np.empty(config.SCALARS)
        sections = np.empty((MAX_SECTIONS, 2))
        attributes = fields.attributes(model, load_word(block + INSTANCE))
        _, count = config.read(attributes, values, sections)
        prm = floats(parameters_at(block), kernel.parameter_size(n))
        angles, contacts = kernel.segment_angles(prm, n), packing.contact_length(prm, n)
        lengths = pieces.lengths(reference, n)
        if guided > 0:
            inside = np.empty(kernel.parameter_size(guided))
            kernel.pack(values, sections[:count], guided, inside)
            bent = kernel.segment_angles(inside, guided)
            assign(pieces.angles(reference, n)[:guided], bent)
            rubs = packing.contact_length(inside, guided)
            assign(pieces.contacts(reference, n)[:guided], rubs)
            assign(lengths[: guided + 1], packing.node_length(inside, guided))
        assign(packing.node_length(prm, n), lengths)
        assign(angles, pieces.angles(reference, n))
        assign(contacts, pieces.contacts(reference, n))
        prm[packing.LENGTH] = lengths.sum()
        prm[packing.GUIDED] = guided
        kernel.pack_mesh(values, n, prm)
        kernel.expect_change(prm)
        kernel.expect_lengthening(prm)
        outdate(block)
        store_word(block + REFERRED, 1)

    export("cc_mujoco_refer", refer_path.address)

    @cfunc(_LAY, **options)
    def lay_path(block: int, shape: int, state: int) -> None:
        """Give the packed segments the path at an address, as seen from a state."""
        _ = stamp
        n = load_word(block + SEGMENTS)
        prm = floats(parameters_at(block), kernel.parameter_size(n))
        contacts, changed = packing.contact_length(prm, n), False
        if opens(block):
            size = pieces.shape_size(n)
            path_now = floats(shape, size)
            reference = floats(shape_at(block, n, REFERENCE), size)
            gained = floats(scratch_at(block, n), n + 1)
            contacts = pieces.contacts(path_now, n)
            before = memory(state, n)
            pieces.lengthen(path_now, reference, before, n, gained)
            changed = material.carry(
                prm, n, packing.tensions(floats(state, kernel.state_size(n)), n),
                pieces.lengths_before(reference, before, n),
                pieces.lengths(path_now, n), gained,
            )  # fmt: skip
        if prepare.relay(prm, n, floats(shape, n), contacts) or changed:
            outdate(block)

    export("cc_mujoco_lay", lay_path.address)

    @cfunc(_FOLLOW, **options)
    def follow_path(block: int, model: int, data: int, state: int) -> None:
        """Lead the cable along its path at the last position, from a state."""
        _ = stamp
        tendon = load_word(block + ROUTE)
        if tendon < 0:
            return
        n = load_word(block + SEGMENTS)
        now = shape_at(block, n, 0)
        if opens(block):
            if load_word(block + REFERRED) == 0:
                refer(block, model, data)
            _survey(block, model, data, state, now)
        else:
            points = fields.integer(data, fields.TEN_WRAPNUM, tendon)
            length = fields.real(data, fields.TEN_LENGTH, tendon)
            prm = floats(parameters_at(block), kernel.parameter_size(n))
            inside = packing.contact_length(prm, n)
            path.bend(model, data, tendon, points, length, inside, floats(now, n))
        lay(block, now, state)

    export("cc_mujoco_follow", follow_path.address)

    @cfunc(_PULL, **options)
    def pull_path(block: int, model: int, data: int) -> None:
        """Pull with the pieces of an open cable, as last evaluated."""
        _ = stamp
        n, nv = load_word(block + SEGMENTS), fields.dofs(model)
        target = load_word(data + fields.PASSIVE)
        last = floats(pulls_at(block, n), nv)
        forces = floats(scratch_at(block, n), nv)
        fill(forces, 0.0)
        tied = 0.0
        node = new_at(block, n) + 8 * kernel.STATE_HEADER
        for end in (PROXIMAL, DISTAL):
            if load_word(block + TIED + end - PROXIMAL) != 0:
                gear = ends.gear(model, load_word(block + end))
                sense = gear if end == PROXIMAL else -gear
                at = node if end == PROXIMAL else node + 8 * n
                tied += max(load_real(at), 0.0) * sense
        pieces.pull(
            model, data, load_word(block + ROUTE), load_word(block + MOUTH),
            floats(shape_at(block, n, 0), pieces.shape_size(n)), n,
            load_word(block + GUIDED), floats(node, n + 1), tied, -1, block + SCRATCH,
            forces.ctypes.data,
        )  # fmt: skip
        passive = floats(target, nv)
        assign(floats(before_at(block, n), nv), passive)
        if load_word(block + FRESH) == 0:
            # MuJoCo evaluates the actuators again, alone.
            add(passive, last, -1.0)
        add(passive, forces, 1.0)
        assign(last, forces)
        store_word(block + FRESH, 0)

    export("cc_mujoco_pull", pull_path.address)
