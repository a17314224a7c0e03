"""Messages to users about a cable: refusals of open paths, and one-time warnings."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable._cable import MAX_SECTIONS
from cc_mujoco.cable._friction import INDEX
from cc_mujoco.plugin import _attachments as attachments
from cc_mujoco.plugin import _config as config
from cc_mujoco.plugin import _implicit_ends as implicit_ends
from cc_mujoco.plugin import _instance_data as blocks
from cc_mujoco.plugin import _jump_warnings as jump_warnings
from cc_mujoco.plugin import _mj_struct as mj_struct
from cc_mujoco.plugin import _open_path as open_path
from cc_mujoco.plugin import _path as path
from cc_mujoco.plugin._config import constant
from cc_mujoco.plugin._engine import PLUGIN
from cc_mujoco.plugin._evaluate import RK4
from cc_mujoco.plugin._ffi import (
    MESSAGE_CAPACITY,
    Bytes,
    Floats,
    allocate,
    append,
    append_integer,
    append_millimetres,
    append_thousandths,
    floats,
    internal,
    load_real,
    load_word,
    quote,
    release,
    store_real,
    warn,
    warned_once,
)

_NO_SPRING = int(mujoco.mjtDisableBit.mjDSBL_SPRING)
_NO_DAMPER = int(mujoco.mjtDisableBit.mjDSBL_DAMPER)

_SITE = int(mujoco.mjtWrap.mjWRAP_SITE)

_STIFFNESS, _PRETENSION = INDEX["axial_stiffness"], INDEX["pretension"]

_LENGTH_TOLERANCE = 0.02
"""Part by which the length of `conduit` may differ from that of the path it is."""

_MESSAGE_START = constant(f"plugin `{PLUGIN}`, instance ")
_MESSAGE_START_END = constant(": ")
_TOO_FEW_SEGMENTS = constant("key `segments` is too small: its path needs at least ")
_WRONG_LENGTH = constant(
    "key `conduit` has the wrong length: the path of its tendon is "
)
_WRONG_LENGTH_END = constant(" long in the pose `qpos0`")
ACTUATION_DISABLED = constant(
    "`actuation` is disabled in <flag>, so the cable does not pull; its tensions are "
    "those that it would have"
)
GROUP_DISABLED = constant(
    "an end is in a group of `actuatorgroupdisable`, which MuJoCo does not heed for "
    "plugins; the cable pulls all the same"
)
NO_PASSIVE = constant(
    "an open path pulls by passive forces; enable `spring` or `damper` in <flag>"
)

NO_TIMESTEP = constant(
    "the `timestep` must be a positive finite number; with another one the cable does "
    "not pull"
)
_OTHER_MODEL = constant(
    "its data were made by a model with other sizes or another kind of path, so the "
    "cable does not pull; make new data of this model"
)
_NOT_FINITE = constant(
    "its tension is no finite number: its part of `plugin_state`, its route or the "
    "motion of an end is none; reset the data"
)
ITS_ROUTE = constant("its route")
_SHORT_CONDUIT = constant("key `conduit` is ")
_SHORT_CONDUIT_SPAN = constant(" long, and its ends are ")
_SHORT_CONDUIT_END = constant(" apart in a straight line; lengthen it")
_MIN_SPAN_SHARE = 0.8
"""Part of the distance of its ends that a conduit must be long.

Ends are known by the joints and tendons that they act on, not by the mouths of the
conduit.
"""
_SHORT_PERIOD = constant("the period of its ends is ")
_SHORT_PERIOD_END = constant(
    " time steps, too few for the tension to be right while they vibrate; shorten the "
    "`timestep`, or give what they move more inertia (`armature`)"
)
_MIN_PERIOD, _MIN_PERIOD_RK4 = 10.0, 5.0
"""Steps in a period of the slower end, on a cable that slips as a whole.

Of 300 drawn rigs (EA 10 kN to 100 MN, motors of 1e-5 to 1e-2 kg m^2, steps of 0.5 to 10
ms) a tension errs by more than 10 % RMS in 53 % of those with less than 1 step, 36 %
with 1 to 3, 17 % with 3 to 8 and 7 % with 8 to 10. With more, and under RK4 with more
than 5, only those do whose friction of 0.05 or less does not damp the vibration.
"""

_KEY_PREFIX = constant("key `")
_CANNOT_PULL = (
    constant(
        " pushes its tendon apart, so the cable stays slack: the `gear` of a tendon "
        "must be negative at the proximal end and positive at the distal end"
    ),
    constant(
        " can only pay the cable out from its pose in `qpos0`, so the cable stays "
        "slack: change the sign of its `gear`, or the order of the two actuators"
    ),
    constant(
        " is at the last site of the route, and the other end at the first one: the "
        "actuators must come in the order of the route, that of the motor first"
    ),
)
_NO_EFFECT = (
    constant(
        "` has no effect: it is drag per length of contact, and the path goes around "
        "no geom and no guide with a radius"
    ),
    constant("` has no effect: the path rubs at no site and on no geom"),
    constant("` has no effect: the distal end is tied to its tendon and does not move"),
    constant("` has no effect: the proximal end is tied to its tendon, on no pulley"),
    constant("` has no effect: the path has no conduit and goes around no geom"),
)
_PER_LENGTH, _NO_BEND, _NO_TRAVEL, _NO_PULLEY, _NO_WRAP = 0, 1, 2, 3, 4


@internal
def begin_message(message: Bytes, model: int, instance: int) -> int:
    """Begin a message with the name of its instance; return its length."""
    used = append(message, 0, _MESSAGE_START)
    used = quote(message, used, mj_struct.plugin_name(model, instance))
    return append(message, used, _MESSAGE_START_END)


@internal
def warn_once(model: int, instance: int, sentence: Bytes) -> None:
    """Warn, once, of something about an instance."""
    message = np.zeros(MESSAGE_CAPACITY, np.uint8)
    used = begin_message(message, model, instance)
    used = append(message, used, sentence)
    if not warned_once(message, used, mj_struct.signature(model)):
        warn(message, used)


@internal
def warn_cannot_act(model: int, data: int, instance: int) -> None:
    """Warn, once, why a cable does not pull, or does so with no finite tension.

    Data on which MuJoCo has called no `init` have no cables.
    """
    kind = mj_struct.integer(model, mj_struct.PLUGIN, instance)
    if mj_struct.is_plugin(data, instance, kind) and not mj_struct.block(
        data, instance
    ):
        return
    block = blocks.acting_block(model, data, instance)
    if not mj_struct.has_timestep(model):
        warn_once(model, instance, NO_TIMESTEP)
    elif block == 0 or load_word(block + blocks.OTHER_KIND) != 0:
        warn_once(model, instance, _OTHER_MODEL)
    else:
        warn_once(model, instance, _NOT_FINITE)


@internal
def _velocity(data: int, block: int, part: int) -> float:
    """Return the velocity of an end (0, 1) or of the path (2) [m/s]."""
    if part == jump_warnings.PATH:
        route = load_word(block + blocks.ROUTE)
        return (
            mj_struct.real(data, mj_struct.TEN_VELOCITY, route) if route >= 0 else 0.0
        )
    if load_word(block + blocks.TIED_ENDS + 8 * part) != 0:
        return 0.0
    out = load_word(block + (blocks.DISTAL if part else blocks.PROXIMAL))
    return mj_struct.real(data, mj_struct.ACTUATOR_VELOCITY, out)


@internal
def save_ends(
    data: int, block: int, state: int, n: int, proximal: float, distal: float
) -> None:
    """Save where the ends are in a committed state, and the velocities of all parts."""
    store_real(blocks.end_at(state, n, 0), proximal)
    store_real(blocks.end_at(state, n, 1), distal)
    for part in range(3):
        store_real(blocks.velocity_at(state, n, part), _velocity(data, block, part))


@internal
def _is_between_joints(model: int, block: int) -> bool:
    """Return whether joints hold both ends of a cable: these move by their velocity."""
    for end in range(2):
        actuator = load_word(block + blocks.END_ACTUATORS + 8 * end)
        if attachments.holding_tendon(model, actuator) >= 0:
            return False
    return True


@internal
def warn_jump(
    model: int,
    data: int,
    instance: int,
    state: int,
    proximal: float,
    distal: float,
    shape: int,
) -> None:
    """Warn, once, if an end or the path has jumped from where it is in the state.

    `shape` is the address of the path where it is now.
    """
    block = mj_struct.block(data, instance)
    if (
        load_word(block + blocks.EXPLICIT_ENDS) != 0
    ):  # which joints that are led by hand need
        return
    n, route = load_word(block + blocks.SEGMENTS), load_word(block + blocks.ROUTE)
    by_hand = load_word(block + blocks.POSITION_CHANGED) != 0
    if route < 0 and not by_hand and _is_between_joints(model, block):
        return
    lead = mj_struct.block(data, mj_struct.first_cable(model, instance))
    prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
    node = layout.tensions(floats(state, kernel.state_size(n)), n)
    most = prm[_PRETENSION]
    for i in range(node.size if by_hand else 0):
        most = max(most, node[i])
    soft = most * prm[layout.LENGTH] / prm[_STIFFNESS]
    for what in range(3):
        tendon, share = route, 1.0
        if what == jump_warnings.PATH:
            if not blocks.is_open(block) or load_word(block + blocks.MOUTH) != 0:
                continue
            size = open_path.shape_size(n)
            reference = floats(blocks.shape_at(block, n, blocks.REFERENCE_STAGE), size)
            moved = open_path.path_growth(
                floats(shape, size), reference, blocks.path_memory(state, n), n
            )
        else:
            if load_word(block + blocks.TIED_ENDS + 8 * what) != 0:
                continue
            moved = (distal if what else proximal) - load_real(
                blocks.end_at(state, n, what)
            )
            out = load_word(block + (blocks.DISTAL if what else blocks.PROXIMAL))
            tendon = attachments.holding_tendon(
                model, load_word(block + blocks.END_ACTUATORS + 8 * what)
            )
            if tendon < 0 and not by_hand:
                continue  # a joint moves by its velocity
            share = abs(attachments.pulley_radius(model, out))
        carried = 0.0
        if tendon >= 0:
            carried = share * jump_warnings.mocap_motion(model, data, lead, tendon)
        speed = max(
            abs(_velocity(data, block, what)),
            abs(load_real(blocks.velocity_at(state, n, what))),
        )
        if not jump_warnings.has_jumped(model, speed, moved, by_hand, carried, soft):
            continue
        message = np.zeros(MESSAGE_CAPACITY, np.uint8)
        used = begin_message(message, model, instance)
        used = jump_warnings.explain(message, used, what)
        if not warned_once(message, used, mj_struct.signature(model)):
            warn(message, jump_warnings.append_distance(message, used, moved))


@internal
def refuse_open_path(
    message: Bytes, start: int, model: int, instance: int, tendon: int
) -> tuple[int, int]:
    """Find out why a cable cannot lie open along a tendon.

    Return the key that cannot be used or `VALID`, and the length of the message, which
    holds what `_config.explain` cannot report.
    """
    if path.has_branches(model, tendon):
        return config.PATH, start
    attributes = mj_struct.attributes(model, instance)
    mouth = 0
    if config.is_mixed(attributes):
        route = config.key_text(attributes, config.ROUTE)
        name = config.key_text(attributes, config.MOUTH)
        mouth = attachments.find_mouth(model, instance, tendon, route, name)
        if mouth < 0:
            return config.MOUTH, start
    least = open_path.min_segments(model, tendon, mouth) + (1 if mouth > 0 else 0)
    if config.segment_count(attributes) < max(least, 1):
        used = append(message, start, _TOO_FEW_SEGMENTS)
        return config.VALID_CONFIGURATION, append_integer(message, used, max(least, 1))
    at_guides = allocate(8 * max(least, 1))
    known = attachments.read_guides(
        model, instance, tendon, mouth, floats(at_guides, max(least, 1))
    )
    release(at_guides)
    if not known:
        return config.GUIDES, start
    if mouth == 0:
        length = config.length(attributes)
        true = mj_struct.real(model, mj_struct.TENDON_LENGTH0, tendon)
        if not abs(length - true) <= _LENGTH_TOLERANCE * true:
            used = append(message, start, _WRONG_LENGTH)
            used = append_millimetres(message, used, true)
            return config.VALID_CONFIGURATION, append(message, used, _WRONG_LENGTH_END)
    if has_no_passive(model):
        return config.VALID_CONFIGURATION, append(message, start, NO_PASSIVE)
    used = attachments.explain_bypass(message, start, model, instance, tendon)
    if used > start:
        return config.VALID_CONFIGURATION, used
    return config.VALID_CONFIGURATION, attachments.explain_tied(
        message, start, model, instance, tendon
    )


@internal
def has_no_passive(model: int) -> bool:
    """Return whether MuJoCo evaluates no passive forces."""
    no_spring = mj_struct.disabled(model, _NO_SPRING)
    return no_spring and mj_struct.disabled(model, _NO_DAMPER)


@internal
def _no_effect_reason(arcs: int, places: int, mouth: int, tied: int, key: int) -> int:
    """Return why a key of an open cable is without effect, or -1.

    `arcs` geoms and sites with a radius and `places` of all kinds rub in its path.
    `mouth` is the place of the conduit's mouth in it, 0: none. `tied` is 1 where the
    proximal end is tied to the tendon, plus 2 for the distal end.
    """
    if mouth == 0 and places == 0 and key == config.FRICTION:
        return _NO_BEND
    if mouth == 0 and arcs == 0:
        for drag in config.DRAGS_PER_LENGTH:
            if key == drag:
                return _PER_LENGTH
    if key == config.WRAP_GROWTH:
        if tied >= 2:
            return _NO_TRAVEL
        if mouth == 0 and arcs == 0:
            return _NO_WRAP
    pulley = key == config.ECCENTRICITY or key == config.OVALITY
    return _NO_PULLEY if pulley and tied % 2 == 1 else -1


@internal
def _rubbing_places(
    model: int, tendon: int, mouth: int, guides: Floats
) -> tuple[int, int]:
    """Count the places of an open path that rub: along an arc, and all of them."""
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon) + max(mouth, 1)
    arcs, places = 0, 0
    for i in range(open_path.min_segments(model, tendon, mouth)):
        if guides[i] != config.ROLLING:
            places += 1
            kind = mj_struct.integer(model, mj_struct.WRAP_TYPE, start + i)
            arcs += guides[i] > 0.0 or kind != _SITE
    return arcs, places


@internal
def warn_no_effect(model: int, instance: int, block: int) -> None:
    """Warn, once, of each key of an open cable that changes nothing on its path."""
    values = np.empty(config.SCALARS)
    sections = np.empty((MAX_SECTIONS, 2))
    config.read(mj_struct.attributes(model, instance), values, sections)
    tendon, mouth = load_word(block + blocks.ROUTE), load_word(block + blocks.MOUTH)
    n = load_word(block + blocks.SEGMENTS)
    arcs, places = _rubbing_places(
        model, tendon, mouth, floats(blocks.guides_at(block, n), n)
    )
    tied = load_word(block + blocks.TIED_ENDS) + 2 * load_word(
        block + blocks.TIED_ENDS + 8
    )
    for key in range(config.SCALARS):
        if values[key] == 0.0:
            continue
        why = _no_effect_reason(arcs, places, mouth, tied, key)
        if why < 0:
            continue
        message = np.zeros(MESSAGE_CAPACITY, np.uint8)
        used = begin_message(message, model, instance)
        used = append(message, used, _KEY_PREFIX)
        used = config.append_key(message, used, key)
        used = append(message, used, _NO_EFFECT[why])
        if not warned_once(message, used, mj_struct.signature(model)):
            warn(message, used)


@internal
def warn_short_conduit(model: int, data: int, instance: int, block: int) -> None:
    """Warn, once, of a conduit that is shorter than its ends are apart."""
    mouth = load_word(block + blocks.MOUTH)
    if blocks.is_open(block) and mouth == 0:
        return
    attributes = mj_struct.attributes(model, instance)
    length = config.length(attributes)
    span = _conduit_span(model, data, block, attributes, mouth)
    if length >= _MIN_SPAN_SHARE * span:
        return
    message = np.zeros(MESSAGE_CAPACITY, np.uint8)
    used = begin_message(message, model, instance)
    used = append(message, used, _SHORT_CONDUIT)
    if not warned_once(message, used, mj_struct.signature(model)):
        used = append_millimetres(message, used, length)
        used = append(message, used, _SHORT_CONDUIT_SPAN)
        used = append_millimetres(message, used, span)
        warn(message, append(message, used, _SHORT_CONDUIT_END))


@internal
def _conduit_span(
    model: int, data: int, block: int, attributes: int, mouth: int
) -> float:
    """Return how far apart the ends of a conduit are at least [m].

    Where it has a route they are the ends of that, or the mouth. Without one they are
    no farther than a pulley's radius from the joints of the ends, or at a site of their
    tendons.
    """
    written, first = config.key_text(attributes, config.ROUTE), np.zeros(2, np.int64)
    count, leeway = np.zeros(2, np.int64), 0.0
    of = np.zeros(2, np.int64)
    count[:] = 1
    if written.size > 0:
        instance = load_word(block + blocks.INSTANCE)
        tendon = attachments.find_route(model, instance, written)
        last = mj_struct.integer(model, mj_struct.TENDON_NUM, tendon) - 1
        of[:] = tendon
        first[1] = mouth if mouth > 0 else last
    else:
        for end in range(2):
            actuator = load_word(block + blocks.END_ACTUATORS + 8 * end)
            of[end] = attachments.holding_tendon(model, actuator)
            if of[end] >= 0:
                count[end] = mj_struct.integer(model, mj_struct.TENDON_NUM, of[end])
                continue
            output = load_word(block + (blocks.DISTAL if end else blocks.PROXIMAL))
            leeway += abs(attachments.pulley_radius(model, output))
    least = np.inf
    for i in range(count[0]):
        for j in range(count[1]):
            one = _end_point(model, data, block, 0, of[0], first[0] + i)
            other = _end_point(model, data, block, 1, of[1], first[1] + j)
            if one != 0 and other != 0:
                least = min(least, math.sqrt(_square(floats(one, 3), floats(other, 3))))
    return max(least - leeway, 0.0) if least < np.inf else 0.0


@internal
def _end_point(
    model: int, data: int, block: int, end: int, tendon: int, place: int
) -> int:
    """Return the address of a position that an end may have.

    That is the site at `place` of its tendon, 0 where that place is no site, or the
    anchor of its joint where `tendon` is below 0.
    """
    if tendon < 0:
        actuator = load_word(block + blocks.END_ACTUATORS + 8 * end)
        joint = mj_struct.integer(model, mj_struct.ACTUATOR_TRNID, 2 * actuator)
        return load_word(data + mj_struct.XANCHOR) + 24 * joint
    wrap = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon) + place
    if mj_struct.integer(model, mj_struct.WRAP_TYPE, wrap) != _SITE:
        return 0
    site = mj_struct.integer(model, mj_struct.WRAP_OBJID, wrap)
    return load_word(data + mj_struct.SITE_XPOS) + 24 * site


@internal
def _square(a: Floats, b: Floats) -> float:
    """Return the square of the distance of two points [m^2]."""
    total = 0.0
    for i in range(3):
        total += (a[i] - b[i]) ** 2
    return total


@internal
def warn_short_period(
    model: int, instance: int, block: int, proximal: float, distal: float
) -> None:
    """Warn, once, of ends that the time step does not resolve.

    `proximal` and `distal` are their limits of stability where friction holds them [s].
    """
    slower = 0.0
    for end in range(2):
        limit = distal if end else proximal
        if limit < np.inf:
            ratio = implicit_ends.held_stiffness(block, end)
            ratio /= implicit_ends.slipping_stiffness(block)
            slower = max(slower, math.pi * limit * math.sqrt(ratio))
    steps = slower / mj_struct.timestep(model)
    least = _MIN_PERIOD_RK4 if mj_struct.integrator(model) == RK4 else _MIN_PERIOD
    if slower == 0.0 or steps >= least:
        return
    message = np.zeros(MESSAGE_CAPACITY, np.uint8)
    used = begin_message(message, model, instance)
    used = append(message, used, _SHORT_PERIOD)
    if not warned_once(message, used, mj_struct.signature(model)):
        used = append_thousandths(message, used, 1e-3 * steps, _SHORT_PERIOD_END)
        warn(message, used)


@internal
def warn_cannot_pull(model: int, instance: int) -> None:
    """Warn, once, of an end that can never pull: of the wrong sign, or swapped."""
    _, first, second = attachments.find_actuators(model, instance)
    written = config.key_text(mj_struct.attributes(model, instance), config.ROUTE)
    route = attachments.find_route(model, instance, written) if written.size > 0 else -1
    for end in range(2):
        actuator, why = (second if end else first), -1
        if attachments.pushes(model, actuator, end == 1):
            why = 0
        elif end == 0 and attachments.only_pays_out(model, instance, actuator):
            why = 1
        elif (
            end == 0
            and route >= 0
            and attachments.ends_swapped(model, first, second, route)
        ):
            why = 2
        if why >= 0:
            message = np.zeros(MESSAGE_CAPACITY, np.uint8)
            used = begin_message(message, model, instance)
            used = attachments.name_actuator(
                message, used, model, actuator, attachments.ITS_ACTUATOR
            )
            used = append(message, used, _CANNOT_PULL[why])
            if not warned_once(message, used, mj_struct.signature(model)):
                warn(message, used)
