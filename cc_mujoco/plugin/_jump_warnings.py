"""Ends and paths that jump: they move further in a step than their velocity allows.

After `qpos` is set, a keyframe is loaded or a state is restored without its
`plugin_state`, the cable still lies where it lay. It is pulled to the new pose within
one step, with forces that no motion would cause: `settle` was not called. The state of
the cable holds a checksum of the pose after the last step, which shows that `qpos` has
been changed since. Then a motion without velocity counts if it changes the tension by
1 %. A joint that is led by hand in every step moves by its velocity: allowed is the
larger of those before and after the step, as the latter is zero where it reverses.
A path also jumps where MuJoCo leads its tendon the other way around a geom; this
creates energy. A mocap body has no velocity, so its motion is measured by its pose.
"""

from __future__ import annotations

import math

import numpy as np
from mujoco import mjtWrap

from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable import _open_path as open_path
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.native import FloatArray, internal
from cc_mujoco.plugin import _attachments as attachments
from cc_mujoco.plugin import _ffi as ffi
from cc_mujoco.plugin import _instance_data as blocks
from cc_mujoco.plugin._ffi import MjData, MjModel, floats
from cc_mujoco.plugin._instance_data import Block, Pair
from cc_mujoco.plugin._warnings import begin_message

_PATH = 2
"""The path of an open cable; 0 and 1 are the proximal and the distal end."""


@internal
def checksum(positions: FloatArray) -> float:
    total, weight = 0.0, 0.0
    for i in range(positions.size):
        weight += 0.6180339887498949  # of the golden section
        weight = weight - 1.0 if weight >= 1.0 else weight
        total += (1.0 + weight) * positions[i]
    return total


@internal
def position_changed(positions: FloatArray, led: float) -> bool:
    """Return whether `qpos` is another than that of checksum `led`."""
    size = 1.0
    for k in range(positions.size):
        size += abs(positions[k])
    # Rounding makes a smaller difference.
    return not abs(checksum(positions) - led) <= 1e-9 * size


@internal
def _poses(model: MjModel, lead: Block, before: int) -> FloatArray:
    size = 7 * model.nmocap
    return floats(lead + lead.mocap_poses + 8 * size * before, size)


@internal
def save_poses(model: MjModel, data: MjData, block: Block) -> None:
    if block.mocap_poses == 0:
        return
    count, now, before = model.nmocap, _poses(model, block, 0), _poses(model, block, 1)
    before[:] = now
    now[: 3 * count] = floats(data.mocap_pos.ctypes.data, 3 * count)
    now[3 * count :] = floats(data.mocap_quat.ctypes.data, 4 * count)


@internal
def _mocap_motion(model: MjModel, data: MjData, lead: Block, tendon: int) -> float:
    """Return how far mocap bodies can have moved a tendon in the last step [m]."""
    if lead.mocap_poses == 0:
        return 0.0
    count, total = model.nmocap, 0.0
    before, now = _poses(model, lead, 1), _poses(model, lead, 0)
    for i in range(model.tendon_adr[tendon], ffi.path_end(model, tendon)):
        body = ffi.wrap_body(model, i)
        while body > 0 and model.body_mocapid[body] < 0:
            body = model.body_parentid[body]
        if body <= 0:
            continue
        place = model.body_mocapid[body]
        at, thing = data.geom_xpos.ctypes.data, model.wrap_objid[i]
        if model.wrap_type[i] == mjtWrap.mjWRAP_SITE:
            at = data.site_xpos.ctypes.data
        position = floats(at + 24 * thing, 3)
        shifted = reach = aligned = known = 0.0
        for k in range(3):
            own = now[3 * place + k]
            shifted += (own - before[3 * place + k]) ** 2
            reach += (position[k] - own) ** 2
        for k in range(4):
            own, old = now[3 * count + 4 * place + k], before[3 * count + 4 * place + k]
            aligned += own * old
            known += abs(old)
        if known == 0.0:
            return math.inf
        turned = 2.0 * math.acos(min(abs(aligned), 1.0))
        # It moves the pieces on both sides.
        total += 2.0 * (math.sqrt(shifted) + turned * math.sqrt(reach))
    return total


@internal
def velocity(data: MjData, block: Block, part: int) -> float:
    if part == _PATH:
        return data.ten_velocity[block.route] if block.route >= 0 else 0.0
    if block.tied[part] != 0:
        return 0.0
    return float(data.actuator_velocity[block.outputs[part]])


@internal
def warn_jump(
    model: MjModel,
    data: MjData,
    instance: int,
    state: int,
    ends: Pair,
    stage: int,
) -> None:
    """Warn, once, of an end, or the path at a stage, that jumped from the state's."""
    block = blocks.block_at(data, instance)
    if block.explicit_ends != 0:  # which joints that are led by hand need
        return
    n, by_hand = block.segments, block.position_changed != 0
    held = max(
        attachments.holding_tendon(model, block.actuators[0]),
        attachments.holding_tendon(model, block.actuators[1]),
    )
    if block.route < 0 and held < 0 and not by_hand:
        return  # joints move both ends by their velocity
    lead = blocks.block_at(data, ffi.first_cable(model, instance))
    prm, kept = blocks.parameters(block), blocks.committed(state, n)
    node = layout.tensions(blocks.kernel_state(state, n), n)
    most = prm[PLACE.pretension]
    for i in range(node.size if by_hand else 0):
        most = max(most, node[i])
    soft = most * prm[layout.LENGTH] / prm[PLACE.axial_stiffness]
    for part in range(3):
        tendon, share = block.route, 1.0
        if part == _PATH:
            if not blocks.is_open(block) or block.mouth != 0:
                continue
            reference = blocks.shape(block, blocks.REFERENCE_STAGE)
            now, memory = blocks.shape(block, stage), blocks.path_memory(state, n)
            moved = open_path.path_growth(now, reference, memory, n)
        else:
            if block.tied[part] != 0:
                continue
            moved = ends[part] - kept.ends[part]
            tendon = attachments.holding_tendon(model, block.actuators[part])
            if tendon < 0 and not by_hand:
                continue  # a joint moves by its velocity
            share = abs(attachments.pulley_radius(model, block.outputs[part]))
        carried = 0.0
        if tendon >= 0:
            carried = share * _mocap_motion(model, data, lead, tendon)
        speed = max(abs(velocity(data, block, part)), abs(kept.velocities[part]))
        # What a step allows whatever the velocity is [m], and by how much that may
        # change within a step, for impacts. A motion by hand counts by the tension.
        least, factor = 2e-3, 3.0
        if by_hand:
            least, factor = min(0.01 * soft, least), 1.5
        if not abs(moved) > least + factor * speed * model.opt.timestep + carried:
            continue
        room = np.zeros(ffi.MESSAGE_WORDS, np.int64)
        message = begin_message(room.ctypes.data, model, instance)
        parts = "its proximal end", "its distal end", "its path"
        ffi.append(message, parts[part])
        ffi.append(message, " jumped, without the velocity for it: ")
        if part == _PATH:
            ffi.append(
                message,
                "a side site that turns lets MuJoCo lead a tendon another way around a "
                "geom, and ",
            )
        ffi.append(
            message,
            "after `qpos` is set, or a keyframe is loaded, call `cc_mujoco.plugin."
            'settle(model, data, rope="keep")` for the same rope in another pose, or '
            'with `rope="remount"` for a rope that is mounted there with its '
            "pretension; restore a state with its `plugin_state`; without that one "
            "step pulls it by ",
        )
        if not ffi.warned_once(message, model.signature):
            ffi.append_thousandths(message, abs(moved), " mm")
            ffi.warn(message)
