"""Messages to users about a cable: refusals of open paths, and one-time warnings."""

import math

import numpy as np
import numpy.typing as npt
from mujoco import mjtDisableBit, mjtDyn, mjtJoint, mjtWrap

from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable import _moving_path as moving_path
from cc_mujoco.cable import _open_path as open_path
from cc_mujoco.cable._cable import KEYS, MAX_SECTIONS
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.cable._soft_end import CURVE_TOLERANCE
from cc_mujoco.native import FloatArray, internal
from cc_mujoco.plugin import _attachments as attachments
from cc_mujoco.plugin import _config as config
from cc_mujoco.plugin import _ffi as ffi
from cc_mujoco.plugin import _implicit_ends as implicit_ends
from cc_mujoco.plugin import _instance_data as blocks
from cc_mujoco.plugin import _path as path
from cc_mujoco.plugin._engine import PLUGIN
from cc_mujoco.plugin._evaluate import is_rk4
from cc_mujoco.plugin._ffi import MjData, MjModel
from cc_mujoco.plugin._instance_data import Block, Pair

RANDOM_POSES = 200
"""Number of random poses tried before a warning that a path never touches a geom."""
NO_PASSIVE = (
    "an open path pulls by passive forces; enable `spring` or `damper` in <flag>"
)
NO_TIMESTEP = (
    "the `timestep` must be a positive finite number; with another one the cable does "
    "not pull"
)
NO_STATE = (
    "its part of `plugin_state` is not that of a cable, as `dissipated` is below 0 J "
    "or not finite; restore one that was saved, or reset the data"
)
_IGNORED = "delay", "dyntype", "actdim", "ctrlrange"
"""Attributes that <plugin> accepts and MuJoCo does not use for a plugin's force."""
_PATH = 2
"""Index of the path among a cable's parts; 0 and 1 are the proximal and distal end."""


@internal
def content(model: MjModel, instance: int) -> int:
    """Return a digest of the model's numbers that warnings of an instance rest on."""
    attributes, found = ffi.attributes(model, instance), 1469598103934665603
    step = np.empty(1)
    step[0] = model.opt.timestep
    found = ffi.digest(found ^ model.signature, step.ctypes.data, 8)
    found = ffi.digest(found, attributes, config.block_size(attributes))
    found = ffi.digest(found, model.qpos0.ctypes.data, 8 * model.nq)
    found = ffi.digest(found, model.jnt_range.ctypes.data, 16 * model.njnt)
    found = ffi.digest(found, model.dof_invweight0.ctypes.data, 8 * model.nv)
    found = ffi.digest(found, model.actuator_gear.ctypes.data, 48 * model.nactuator)
    return ffi.digest(found, model.tendon_length0.ctypes.data, 8 * model.ntendon)


@internal
def begin_message(
    room: int, model: MjModel, instance: int, block: Block
) -> ffi.Message:
    """Begin a message on an instance in the zeroed memory at address `room`."""
    # A model whose numbers change as it runs does not repeat its warnings.
    message = ffi.message_at(room)
    message.about = content(model, instance) if block == 0 else block.content
    for part in ("plugin `", PLUGIN, "`, instance "):
        ffi.append(message, part)
    ffi.quote(message, ffi.name(model, model.name_pluginadr[instance]))
    ffi.append(message, ": ")
    return message


@internal
def issue_once(message: ffi.Message) -> None:
    if not ffi.warned_once(message):
        ffi.warn(message)


@internal
def warn_once(model: MjModel, instance: int, block: Block, sentence: ffi.Bytes) -> None:
    room = np.zeros(ffi.MESSAGE_WORDS, np.int64)
    message = begin_message(room.ctypes.data, model, instance, block)
    ffi.append(message, sentence)
    issue_once(message)


@internal
def warn_cannot_act(model: MjModel, data: MjData, instance: int) -> None:
    """Warn, once, why a cable does not pull, or has no finite tension.

    Data on which MuJoCo has never called `init` have no cables, and cause no warning.
    """
    if (
        instance < data.nplugin
        and data.plugin[instance] == model.plugin[instance]
        and data.plugin_data[instance] == 0
    ):
        return
    block = blocks.acting_block(model, data, instance)
    own = blocks.own_block(model, data, instance)
    why: ffi.Bytes = (
        "its tension is no finite number: its part of `plugin_state`, its route or "
        "the motion of an end is none; reset the data"
    )
    if not ffi.has_timestep(model):
        why = NO_TIMESTEP
    elif block == 0 or block.other_kind != 0:
        why = (
            "its data were made by a model with other sizes or another kind of path, "
            "so the cable does not pull; make new data of this model"
        )
    warn_once(model, instance, own, why)


@internal
def refuse_open_path(
    message: ffi.Message, model: MjModel, instance: int, tendon: int
) -> int:
    """Check that a cable can run openly along a tendon.

    Return the key that cannot be used or `VALID_CONFIGURATION`. Reasons for refusal
    that `_config.explain` cannot report are appended to `message`.
    """
    if path.has_branches(model, tendon):
        return int(config.KEY.path)
    attributes, start = ffi.attributes(model, instance), message.used
    mouth = 0
    if config.is_mixed(attributes):
        mouth = attachments.find_mouth(model, instance, tendon)
        if mouth < 0:
            return int(config.KEY.mouth)
    least = path.min_segments(model, tendon, mouth) + (1 if mouth > 0 else 0)
    least = max(least, 1)
    if config.segment_count(attributes) < least:
        ffi.append(message, "key `segments` is too small: its path needs at least ")
        ffi.append_integer(message, least)
        return config.VALID_CONFIGURATION
    at_guides = ffi.allocate(8 * least)
    guides = ffi.floats(at_guides, least)
    known = attachments.read_guides(model, instance, tendon, mouth, guides)
    ffi.release(at_guides)
    if not known:
        return int(config.KEY.guides)
    true = model.tendon_length0[tendon]
    off = abs(config.length(attributes) - true)
    if mouth == 0 and not off <= 0.02 * true:  # its tolerance
        ffi.append(
            message, "key `conduit` has the wrong length: the path of its tendon is "
        )
        ffi.append_thousandths(message, true, " mm long in the pose `qpos0`")
    elif has_no_passive(model):
        ffi.append(message, NO_PASSIVE)
    else:
        attachments.explain_bypass(message, model, instance, tendon)
        if message.used == start:
            attachments.explain_tied(message, model, instance, tendon)
    return config.VALID_CONFIGURATION


@internal
def has_no_passive(model: MjModel) -> bool:
    no_spring = ffi.disabled(model, mjtDisableBit.mjDSBL_SPRING)
    return no_spring and ffi.disabled(model, mjtDisableBit.mjDSBL_DAMPER)


@internal
def _no_effect_reason(
    arcs: int, places: int, mouth: int, tied: tuple[int, int], key: int
) -> ffi.Bytes:
    """Return the reason why a key of an open cable has no effect, or an empty text.

    `places` is the number of sites and geoms with friction in its path, `arcs` that of
    geoms and sites with a radius among them, `mouth` the index of the conduit's mouth,
    0: none. `tied` is not 0 for an end that is tied to the tendon.
    """
    if mouth == 0 and places == 0 and key == config.KEY.friction:
        return "the path rubs at no site and on no geom"
    if mouth == 0 and arcs == 0:
        for drag in config.DRAGS_PER_LENGTH:
            if key == drag:
                return (
                    "it is drag per length of contact, and the path goes around no "
                    "geom and no guide with a radius"
                )
    if key == config.KEY.wrap_growth:
        if tied[1] != 0:
            return "the distal end is tied to its tendon and does not move"
        if mouth == 0 and arcs == 0:
            return "the path has no conduit and goes around no geom"
    if (key == config.KEY.eccentricity or key == config.KEY.ovality) and tied[0] != 0:
        return "the proximal end is tied to its tendon, on no pulley"
    return ""


@internal
def warn_no_effect(model: MjModel, instance: int, block: Block) -> None:
    """Warn, once, of each key of an open cable that changes nothing on its path."""
    values = np.empty(config.SCALARS)
    sections = np.empty((MAX_SECTIONS, config.SECTION_SIZE))
    config.read(ffi.attributes(model, instance), values, sections)
    guides, mouth = blocks.path_of(block, 0).guides, block.mouth
    start, arcs, places = model.tendon_adr[block.route] + max(mouth, 1), 0, 0
    for i in range(path.min_segments(model, block.route, mouth)):
        if guides[i] != config.ROLLING:
            places += 1
            is_geom = model.wrap_type[start + i] != mjtWrap.mjWRAP_SITE
            arcs += guides[i] > 0.0 or is_geom
    for key in range(config.SCALARS):
        if values[key] == 0.0:
            continue
        tied = block.tied[0], block.tied[1]
        why = _no_effect_reason(arcs, places, mouth, tied, key)
        if why.size > 0:
            _warn_idle(model, instance, block, key, why, "")


@internal
def _warn_idle(
    model: MjModel, instance: int, block: Block, key: int, why: ffi.Bytes,
    rest: ffi.Bytes,
) -> None:  # fmt: skip
    room = np.zeros(ffi.MESSAGE_WORDS, np.int64)
    message = begin_message(room.ctypes.data, model, instance, block)
    for part in ("key `", KEYS[key], "` has no effect: ", why, rest):
        ffi.append(message, part)
    issue_once(message)


@internal
def warn_idle_keys(model: MjModel, instance: int) -> None:
    """Warn, once, of each key that changes nothing, as another one is off."""
    values = np.empty(config.SCALARS)
    sections = np.empty((MAX_SECTIONS, config.SECTION_SIZE))
    attributes = ffi.attributes(model, instance)
    wrong, count = config.read(attributes, values, sections)
    if wrong != config.VALID_CONFIGURATION:
        return
    for key, needed in config.SCALES:
        if values[needed] == 0.0 and values[key] != config.DEFAULTS[key]:
            _warn_idle(model, instance, 0, key, KEYS[needed], " is 0")
    straight, has_factors = not config.bends_with_route(attributes), False
    for s in range(count):
        straight = straight and math.isinf(sections[s, 1])
        has_factors = has_factors or sections[s, 2] != 1.0 or sections[s, 3] != 1.0
    play = values[config.KEY.clearance]
    if play != 0.0 and straight:
        _warn_idle(model, instance, 0, config.KEY.clearance, "no section bends", "")
    elif play == 0.0 and has_factors:
        warn_once(
            model, instance, 0, "factors in `conduit` have no effect: clearance is 0"
        )


@internal
def warn_short_conduit(
    model: MjModel, data: MjData, instance: int, block: Block
) -> None:
    if blocks.is_open(block) and block.mouth == 0:
        return
    length = config.length(ffi.attributes(model, instance))
    span = _conduit_span(model, data, block)
    # Ends are known by the joints and tendons that they act on, not by its mouths.
    if length >= 0.8 * span:
        return
    room = np.zeros(ffi.MESSAGE_WORDS, np.int64)
    message = begin_message(room.ctypes.data, model, instance, block)
    ffi.append(message, "key `conduit` is ")
    if not ffi.warned_once(message):
        ffi.append_thousandths(message, length, " mm long, and its ends are ")
        rest: ffi.Bytes = " mm apart in a straight line; lengthen it"
        ffi.append_thousandths(message, span, rest)
        ffi.warn(message)


@internal
def _conduit_span(model: MjModel, data: MjData, block: Block) -> float:
    """Return a lower bound of the distance between the ends of a conduit [m].

    A conduit with a route runs between the ends of that route, or from its start to
    the mouth. Without a route each end is taken to be within the pulley's radius of its
    joint, or at a site of its tendon.
    """
    attributes = ffi.attributes(model, block.instance)
    written, leeway = config.key_text(attributes, config.KEY.route), 0.0
    first, count = np.zeros(2, np.int64), np.zeros(2, np.int64)
    of = np.zeros(2, np.int64)
    count[:] = 1
    if written.size > 0:
        of[:] = attachments.find_route(model, block.instance, written)
        first[1] = block.mouth if block.mouth > 0 else model.tendon_num[of[0]] - 1
    else:
        for end in range(2):
            of[end] = attachments.holding_tendon(model, block.actuators[end])
            if of[end] >= 0:
                count[end] = model.tendon_num[of[end]]
            else:
                leeway += abs(attachments.pulley_radius(model, block.outputs[end]))
    least = np.inf
    for i in range(count[0]):
        for j in range(count[1]):
            one = _end_point(model, data, block.actuators[0], of[0], first[0] + i)
            other = _end_point(model, data, block.actuators[1], of[1], first[1] + j)
            if one != 0 and other != 0:
                a, b, square = ffi.floats(one, 3), ffi.floats(other, 3), 0.0
                for k in range(3):
                    square += (a[k] - b[k]) ** 2
                least = min(least, math.sqrt(square))
    return max(least - leeway, 0.0) if least < np.inf else 0.0


@internal
def _end_point(
    model: MjModel, data: MjData, actuator: int, tendon: int, place: int
) -> int:
    """Return the address of a point where an end may be.

    That is the site at `place` of its tendon, or the anchor of its joint if `tendon` is
    below 0. It is 0 if that place is no site.
    """
    if tendon < 0:
        return int(data.xanchor.ctypes.data + 24 * model.actuator_trnid[actuator, 0])
    wrap = model.tendon_adr[tendon] + place
    if model.wrap_type[wrap] != mjtWrap.mjWRAP_SITE:
        return 0
    return int(data.site_xpos.ctypes.data + 24 * model.wrap_objid[wrap])


@internal
def warn_short_period(model: MjModel, block: Block, limits: FloatArray) -> None:
    """Warn, once, if the time step does not resolve the vibration of the ends.

    Counted are steps in a period of the slower end on a cable that slips as a whole;
    `limits` are the longest stable steps of both ends [s]. Of 300 random rigs (EA 10 kN
    to 100 MN, motors of 1e-5 to 1e-2 kg m^2, steps of 0.5 to 10 ms) a tension errs by
    more than 10 % RMS in 53 % of those with less than 1 step, 36 % with 1 to 3, 17 %
    with 3 to 8 and 7 % with 8 to 10. With more, and under RK4 with more than 5, only
    those do whose friction of 0.05 or less does not damp the vibration.
    """
    slower = 0.0
    for end in range(2):
        if limits[end] < np.inf:
            ratio = implicit_ends.held_stiffness(block, end)
            ratio /= implicit_ends.slipping_stiffness(block)
            slower = max(slower, math.pi * limits[end] * math.sqrt(ratio))
    steps = slower / model.opt.timestep
    if slower == 0.0 or steps >= (5.0 if is_rk4(model) else 10.0):
        return
    room = np.zeros(ffi.MESSAGE_WORDS, np.int64)
    message = begin_message(room.ctypes.data, model, block.instance, block)
    ffi.append(message, "the period of its ends is ")
    if not ffi.warned_once(message):
        ffi.append_thousandths(
            message,
            1e-3 * steps,
            " time steps, too few for the tension to be right while they vibrate; "
            "shorten the `timestep`, or give what they move more inertia (`armature`)",
        )
        ffi.warn(message)


@internal
def warn_soft_on_drum(model: MjModel, block: Block) -> None:
    """Warn, once, of a rope so soft that its slip on a drum takes much work."""
    prm, winds = blocks.parameters(block), False
    for end in range(2):
        joint = attachments.holding_joint(model, block.actuators[end])
        if block.tied[end] == 0 and joint >= 0:
            winds = winds or model.jnt_type[joint] == mjtJoint.mjJNT_HINGE
    strain = moving_path.stretch_ratio(prm, prm[PLACE.pretension]) - 1.0
    # A drum and a load that are led round a closed path lose 0.12 % of the work that
    # passes at a strain of 0.005, 0.5 % at 0.02, 3.8 % at 0.2, without any friction.
    if not winds or not strain > 0.02:
        return
    room = np.zeros(ffi.MESSAGE_WORDS, np.int64)
    message = begin_message(room.ctypes.data, model, block.instance, block)
    ffi.append(message, "its pretension stretches it by ")
    if not ffi.warned_once(message):
        why: ffi.Bytes = (
            " %, and rope that leaves its drum at another tension than it was wound at "
            "slips there, which takes work without any friction, the more the softer "
            "it is; `dissipated` counts it"
        )
        ffi.append_thousandths(message, 0.1 * strain, why)
        ffi.warn(message)


@internal
def warn_stretched(model: MjModel, block: Block) -> None:
    """Warn, once, of a cable in a conduit that strains more than the model allows.

    Bends and friction are those of the unstretched cable. Ropes break before 0.1.
    """
    prm = blocks.parameters(block)
    strain = prm[PLACE.pretension] / prm[PLACE.axial_stiffness]
    if not strain > 0.1:
        return
    room = np.zeros(ffi.MESSAGE_WORDS, np.int64)
    message = begin_message(room.ctypes.data, model, block.instance, block)
    ffi.append(message, "its pretension stretches it by ")
    ffi.append_thousandths(message, 0.1 * strain, " %")
    why: ffi.Bytes = (
        ", more than 10 %, where cables break and this model, of small strains, is "
        "wrong; `axial_stiffness` is that of a metre of cable, E A in N"
    )
    ffi.append(message, why)
    issue_once(message)


@internal
def warn_poor_spring(model: MjModel, instance: int) -> None:
    """Warn of loading curves that the springs at the ends do not follow."""
    for end in range(2):
        soft = config.spring(ffi.attributes(model, instance), end)
        if soft.residual > CURVE_TOLERANCE:
            room = np.zeros(ffi.MESSAGE_WORDS, np.int64)
            message = begin_message(room.ctypes.data, model, instance, 0)
            ffi.append(message, "the spring C ln(1 + h T) / h of an end is ")
            ffi.append_thousandths(message, 0.1 * soft.residual, " %")
            ffi.append(
                message,
                " of the extension off its curve; leave out forces that do not occur",
            )
            ffi.warn(message)


@internal
def _cannot_pull_reason(
    model: MjModel, instance: int, actuator: int, end: int
) -> ffi.Bytes:
    """Return the reason why an end can never pull, or an empty text."""
    if attachments.pushes(model, actuator, end == 1):
        return (
            " pushes its tendon apart, so the cable stays slack: the `gear` of a "
            "tendon must be negative at the proximal end and positive at the distal end"
        )
    if end == 0 and attachments.only_pays_out(model, instance, actuator):
        return (
            " can only pay the cable out from its pose in `qpos0`, so the cable stays "
            "slack: change the sign of its `gear`, or the order of the two actuators"
        )
    if end == 0 and attachments.ends_swapped(model, instance):
        return (
            " is at the last site of the route, and the other end at the first one: "
            "the actuators must come in the order of the route, that of the motor first"
        )
    return ""


@internal
def warn_ends(model: MjModel, block: Block) -> None:
    """Warn, once, of ends that never pull, and of attributes that do nothing there."""
    room = np.zeros(ffi.MESSAGE_WORDS, np.int64)
    message = begin_message(room.ctypes.data, model, block.instance, block)
    start = message.used
    for end in range(2):
        actuator = block.actuators[end]
        why = _cannot_pull_reason(model, block.instance, actuator, end)
        if why.size > 0:
            message.used = start
            attachments.blame(message, model, actuator, why)
            issue_once(message)
        is_plain = model.actuator_dyntype[actuator] == mjtDyn.mjDYN_NONE
        found = np.zeros(4)
        found[0] = model.actuator_delay[actuator]
        found[1] = not is_plain
        found[2] = model.actuator_actnum[actuator] if is_plain else 0
        found[3] = model.actuator_ctrllimited[model.actuator_ctrladr[actuator]]
        for which in range(found.size):
            if found[which] != 0.0:
                message.used = start
                attachments.blame(message, model, actuator, " has `")
                ffi.append(message, _IGNORED[which])
                ffi.append(
                    message,
                    "`, its own or that of a default, which has no effect, as the "
                    "cable alone sets the force of its ends; take it away there, and "
                    "give it to the actuator of the motor",
                )
                issue_once(message)
    for body in range(model.nbody):
        if model.body_plugin[body] == block.instance:
            message.used = start
            ffi.append(message, "its <plugin> in body ")
            name = ffi.name(model, model.name_bodyadr[body])
            ffi.append_label(message, name, body)
            ffi.append(message, " has no effect; take it away there")
            issue_once(message)


@internal
def _mark_touched(
    model: MjModel, data: MjData, tendon: int, touched: ffi.Bytes
) -> None:
    """Write 1 to `touched` for sites of a path and geoms that it touches in a pose."""
    start = model.tendon_adr[tendon]
    missing = 0
    for place in range(touched.size):
        kind = model.wrap_type[start + place]
        plain = kind == mjtWrap.mjWRAP_SITE or kind == mjtWrap.mjWRAP_PULLEY
        touched[place] = 1 if plain else 0
        missing += not plain
    missing -= _mark_touched_now(model, data, tendon, touched)
    if missing == 0:
        return
    present = data.qpos[: model.nq]
    ffi.mark_stack(data)
    kept = ffi.borrow_floats(data, present.size)
    kept[:] = present
    present[:] = model.qpos0[: model.nq]
    reach = model.tendon_length0[tendon]
    seed, tried = np.zeros(1, np.uint64), 0
    seed[0] = 1
    while missing > 0 and tried <= RANDOM_POSES:
        if tried > 0:
            _random_pose(model, present, reach, seed)
        ffi.evaluate_bodies(model, data)
        ffi.evaluate_tendons(model, data)
        missing -= _mark_touched_now(model, data, tendon, touched)
        tried += 1
    present[:] = kept
    ffi.free_stack(data)
    ffi.evaluate_bodies(model, data)
    ffi.evaluate_tendons(model, data)


@internal
def _mark_touched_now(
    model: MjModel, data: MjData, tendon: int, touched: ffi.Bytes
) -> int:
    """Mark geoms that a path touches at the last position; return how many are new."""
    start, begin = model.tendon_adr[tendon], data.ten_wrapadr[tendon]
    end = begin + data.ten_wrapnum[tendon]
    found = 0
    for place in range(touched.size):
        geom = model.wrap_objid[start + place]
        at = begin
        while touched[place] == 0 and at < end:
            if data.wrap_obj[at // 2, at % 2] == geom:
                touched[place] = 1
                found += 1
            at += 1
    return found


@internal
def _uniform(seed: npt.NDArray[np.uint64]) -> float:
    """Return a random number in [0, 1): a linear congruential generator (Knuth)."""
    seed[0] = seed[0] * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
    return float(seed[0] >> np.uint64(11)) / 9007199254740992.0


@internal
def _random_pose(
    model: MjModel, positions: FloatArray, reach: float, seed: npt.NDArray[np.uint64]
) -> None:
    origin = model.qpos0[: positions.size]
    for joint in range(model.njnt):
        kind = model.jnt_type[joint]
        at = model.jnt_qposadr[joint]
        if kind == mjtJoint.mjJNT_FREE:
            for i in range(3):
                positions[at + i] = origin[at + i] + reach * (2.0 * _uniform(seed) - 1)
            at += 3
        if kind == mjtJoint.mjJNT_FREE or kind == mjtJoint.mjJNT_BALL:
            size = 0.0
            while not 0.01 < size <= 1.0:
                size = 0.0
                for i in range(4):
                    positions[at + i] = 2.0 * _uniform(seed) - 1.0
                    size += positions[at + i] ** 2
            for i in range(4):
                positions[at + i] /= math.sqrt(size)
            continue
        far = reach if kind == mjtJoint.mjJNT_SLIDE else math.pi
        low, high = origin[at] - far, origin[at] + far
        if model.jnt_limited[joint] != 0:
            low, high = model.jnt_range[joint, 0], model.jnt_range[joint, 1]
        positions[at] = low + (high - low) * _uniform(seed)


@internal
def warn_missed(model: MjModel, data: MjData, block: Block) -> None:
    """Warn, once, of each geom in a path that the cable never touches.

    MuJoCo's tendon runs straight past a geom that is not in its way, or through one
    whose axis points along it, without a warning. There is no friction there. A geom
    counts as touched where the path bends around it in `qpos0`, or in one of some
    random poses of all joints within their ranges.
    """
    room = np.zeros(ffi.MESSAGE_WORDS, np.int64)
    message = begin_message(room.ctypes.data, model, block.instance, block)
    start = message.used
    ffi.append(message, "its geoms have been looked for")
    if ffi.warned_once(message):
        return
    tendon = block.route
    count = model.tendon_num[tendon]
    ffi.mark_stack(data)
    touched = ffi.octets(ffi.borrow(data, count), count)
    _mark_touched(model, data, tendon, touched)
    for place in range(touched.size):
        if touched[place] == 0:
            message.used = start
            geom = model.wrap_objid[model.tendon_adr[tendon] + place]
            name = ffi.name(model, model.name_geomadr[geom])
            ffi.append(message, "its path never touches geom ")
            ffi.append_label(message, name, geom)
            ffi.append(message, ", neither in `qpos0` nor in ")
            ffi.append_integer(message, RANDOM_POSES)
            ffi.append(
                message,
                " random poses of the joints, so nothing rubs there; turn or move the "
                "geom, or take it from the path",
            )
            ffi.warn(message)
    ffi.free_stack(data)


@internal
def checksum(positions: FloatArray) -> float:
    total, weight = 0.0, 0.0
    for i in range(positions.size):
        weight += 0.6180339887498949  # of the golden section
        weight = weight - 1.0 if weight >= 1.0 else weight
        total += (1.0 + weight) * positions[i]
    return total


@internal
def note_position(model: MjModel, data: MjData, lead: Block) -> None:
    """Store the checksum of `qpos` and its scale in the block of the first cable."""
    positions = data.qpos[: model.nq]
    lead.position_size = 1.0
    for k in range(positions.size):
        lead.position_size += abs(positions[k])
    lead.position = checksum(positions)


@internal
def position_changed(lead: Block, led: float) -> bool:
    """Return whether the checksum of `qpos` differs from `led` beyond rounding."""
    return not abs(lead.position - led) <= 1e-9 * lead.position_size


@internal
def _poses(model: MjModel, lead: Block, before: int) -> FloatArray:
    size = 7 * model.nmocap
    return ffi.floats(lead + lead.mocap_poses + 8 * size * before, size)


@internal
def save_poses(model: MjModel, data: MjData, block: Block) -> None:
    if block.mocap_poses == 0:
        return
    count, now, before = model.nmocap, _poses(model, block, 0), _poses(model, block, 1)
    before[:] = now
    now[: 3 * count] = ffi.floats(data.mocap_pos.ctypes.data, 3 * count)
    now[3 * count :] = ffi.floats(data.mocap_quat.ctypes.data, 4 * count)


@internal
def _mocap_motion(model: MjModel, data: MjData, lead: Block, tendon: int) -> float:
    """Return a bound of the growth of a tendon by mocap bodies in the last step [m]."""
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
        position = ffi.floats(at + 24 * thing, 3)
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
    model: MjModel, data: MjData, instance: int, state: int, ends: Pair, stage: int
) -> None:
    """Warn, once, if an end or the path has jumped since the committed state.

    After `qpos` is set, a keyframe is loaded or a state is restored without its
    `plugin_state`, the cable is still in its old configuration. Unless `settle` is
    called, one step pulls it to the new pose, with forces that no motion would cause. A
    checksum in the state shows that `qpos` has changed since the last step; then a
    motion without velocity counts if it changes the tension by 1 %. Allowed is the
    larger of the velocities before and after the step, as the latter is zero if a joint
    reverses. A path also jumps if MuJoCo leads its tendon the other way around a geom,
    which creates energy. The motion of a mocap body is measured by its pose. `ends` are
    displacements [m], `state` is the address of the committed state, `stage` that of
    the path.
    """
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
            if tendon >= 0 and not attachments.is_spatial(model, tendon):
                tendon = -1
            if tendon < 0 and not by_hand:
                continue  # joints move by their velocity
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
        message = begin_message(room.ctypes.data, model, instance, block)
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
        if not ffi.warned_once(message):
            ffi.append_thousandths(message, abs(moved), " mm")
            ffi.warn(message)
