"""Messages to users about a cable: why it cannot lie open, and, once, what is amiss."""

from __future__ import annotations

import mujoco
import numpy as np

from cc_mujoco.engine import ahead, config, ends, fields, jumps, path, pieces
from cc_mujoco.engine.block import (
    DISTAL,
    EXPLICIT,
    HOLDERS,
    MOUTH,
    PROXIMAL,
    REFERENCE,
    ROUTE,
    SEGMENTS,
    TIED,
    TOUCHED,
    memory,
    opens,
    parameters_at,
    shape_at,
)
from cc_mujoco.engine.config import PLUGIN, constant
from cc_mujoco.engine.memory import (
    CAPACITY,
    Bytes,
    append,
    append_integer,
    append_millimetres,
    floats,
    internal,
    load_real,
    load_word,
    quote,
    said_before,
    warn,
)
from cc_mujoco.transmission import kernel, packing
from cc_mujoco.transmission.friction import INDEX
from cc_mujoco.transmission.parameters import MAX_SECTIONS

_NO_SPRING = int(mujoco.mjtDisableBit.mjDSBL_SPRING)
_NO_DAMPER = int(mujoco.mjtDisableBit.mjDSBL_DAMPER)

_STIFFNESS, _PRETENSION = INDEX["axial_stiffness"], INDEX["pretension"]

_NEAR = 0.02
"""Part by which the length of `conduit` may differ from that of the path it is."""

_START = constant(f"plugin `{PLUGIN}`, instance ")
_START_END = constant(": ")
_FEW = constant("key `segments` is too small: its path needs at least ")
_LENGTH = constant("key `conduit` has the wrong length: the path of its tendon is ")
_LENGTH_END = constant(" long in the pose `qpos0`")
IDLE = constant(
    "`actuation` is disabled in <flag>, so the cable does not pull; its tensions are "
    "those that it would have"
)
GROUP = constant(
    "an end is in a group of `actuatorgroupdisable`, which MuJoCo does not heed for "
    "plugins; the cable pulls all the same"
)
NO_PASSIVE = constant(
    "an open path pulls by passive forces; enable `spring` or `damper` in <flag>"
)

_KEY = constant("key `")
_ORDER = (
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
_UNFELT = (
    constant(
        "` has no effect: it is drag per length of contact, and the path goes around "
        "no geom"
    ),
    constant("` has no effect: the path bends at no site and goes around no geom"),
    constant("` has no effect: the distal end is tied to its tendon and does not move"),
    constant("` has no effect: the proximal end is tied to its tendon, on no pulley"),
    constant("` has no effect: the path has no conduit and goes around no geom"),
)
_PER_LENGTH, _NO_BEND, _NO_TRAVEL, _NO_PULLEY, _NO_WRAP = 0, 1, 2, 3, 4


@internal
def opening(message: Bytes, model: int, instance: int) -> int:
    """Begin a message with the instance that it is about.

    Returns:
        The length of the message.
    """
    used = append(message, 0, _START)
    used = quote(message, used, fields.plugin_name(model, instance))
    return append(message, used, _START_END)


@internal
def warn_once(model: int, instance: int, told: Bytes) -> None:
    """Warn, once, of something about an instance."""
    message = np.zeros(CAPACITY, np.uint8)
    used = opening(message, model, instance)
    used = append(message, used, told)
    if not said_before(message, used, fields.signature(model)):
        warn(message, used)


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
    block = fields.block(data, instance)
    if load_word(block + EXPLICIT) != 0:  # which joints that are led by hand need
        return
    n, route = load_word(block + SEGMENTS), load_word(block + ROUTE)
    lead = fields.block(data, ahead.first(model, instance))
    by_hand = load_word(block + TOUCHED) != 0
    prm = floats(parameters_at(block), kernel.parameter_size(n))
    node = packing.tensions(floats(state, kernel.state_size(n)), n)
    most = prm[_PRETENSION]
    for tension in node:
        most = max(most, tension)
    soft = most * prm[packing.LENGTH] / prm[_STIFFNESS]
    for what in range(3):
        tendon, share = route, 1.0
        if what == jumps.PATH:
            if not opens(block) or load_word(block + MOUTH) != 0:
                continue
            size = pieces.shape_size(n)
            reference = floats(shape_at(block, n, REFERENCE), size)
            moved = pieces.growth(floats(shape, size), reference, memory(state, n), n)
            speed = fields.real(data, fields.TEN_VELOCITY, tendon)
        else:
            if load_word(block + TIED + 8 * what) != 0:
                continue
            moved = (distal if what else proximal) - load_real(state + 8 * what)
            out = load_word(block + (DISTAL if what else PROXIMAL))
            speed = fields.real(data, fields.VELOCITY, out)
            tendon = ends.holder(model, load_word(block + HOLDERS + 8 * what))
            if tendon < 0 and not by_hand:
                continue  # a joint moves by its velocity
            share = abs(ends.gear(model, out))
        carried = 0.0
        if tendon >= 0:
            carried = share * jumps.carried(model, data, lead, tendon)
        if not jumps.jumped(model, speed, moved, by_hand, carried, soft):
            continue
        message = np.zeros(CAPACITY, np.uint8)
        used = opening(message, model, instance)
        used = jumps.explain(message, used, what)
        if not said_before(message, used, fields.signature(model)):
            warn(message, jumps.add_size(message, used, moved))


@internal
def open_refused(
    message: Bytes, start: int, model: int, instance: int, tendon: int
) -> tuple[int, int]:
    """Why a cable cannot lie open along a tendon.

    Returns:
        The key that cannot be used or `VALID`, and the length of the message, in which
        is what `config.explain` cannot tell.
    """
    if path.branches(model, tendon):
        return config.PATH, start
    attributes = fields.attributes(model, instance)
    mouth = 0
    if config.mixed(attributes):
        route = config.value(attributes, config.ROUTE)
        name = config.value(attributes, config.MOUTH)
        mouth = ends.find_mouth(model, instance, tendon, route, name)
        if mouth < 0:
            return config.MOUTH, start
    least = pieces.needed(model, tendon, mouth) + (1 if mouth > 0 else 0)
    if config.segments(attributes) < max(least, 1):
        used = append(message, start, _FEW)
        return config.VALID, append_integer(message, used, max(least, 1))
    if mouth == 0:
        length = config.length(attributes)
        true = fields.real(model, fields.TENDON_LENGTH0, tendon)
        if abs(length - true) > _NEAR * true:
            used = append(message, start, _LENGTH)
            used = append_millimetres(message, used, true)
            return config.VALID, append(message, used, _LENGTH_END)
    if no_passive(model):
        return config.VALID, append(message, start, NO_PASSIVE)
    used = ends.explain_bypass(message, start, model, instance, tendon)
    if used > start:
        return config.VALID, used
    return config.VALID, ends.explain_tied(message, start, model, instance, tendon)


@internal
def no_passive(model: int) -> bool:
    """Return whether MuJoCo evaluates no passive forces."""
    no_spring = fields.disabled(model, _NO_SPRING)
    return no_spring and fields.disabled(model, _NO_DAMPER)


@internal
def _unfelt(geoms: int, places: int, mouth: int, tied: int, key: int) -> int:
    """Return why a key of an open cable is without effect, or -1.

    Args:
        geoms: number of geoms in its open path.
        places: number of sites and geoms between the ends.
        mouth: place of the conduit's mouth in it, 0: none.
        tied: 1 where the proximal end is tied to the tendon, plus 2 for the distal end.
        key: index of a key that is not 0.
    """
    if mouth == 0 and places == 0 and key == config.FRICTION:
        return _NO_BEND
    drag = (
        key == config.VISCOUS
        or key == config.LOAD_INDEPENDENT
        or key == config.GREASE_DRAG
    )
    if mouth == 0 and geoms == 0 and drag:
        return _PER_LENGTH
    if key == config.WRAP_GROWTH:
        if tied >= 2:
            return _NO_TRAVEL
        if mouth == 0 and geoms == 0:
            return _NO_WRAP
    pulley = key == config.ECCENTRICITY or key == config.OVALITY
    return _NO_PULLEY if pulley and tied % 2 == 1 else -1


@internal
def warn_unfelt(model: int, instance: int, block: int) -> None:
    """Warn, once, of each key of an open cable that changes nothing on its path."""
    values = np.empty(config.SCALARS)
    sections = np.empty((MAX_SECTIONS, 2))
    config.read(fields.attributes(model, instance), values, sections)
    tendon, mouth = load_word(block + ROUTE), load_word(block + MOUTH)
    geoms = pieces.geoms(model, tendon, mouth)
    places = pieces.needed(model, tendon, mouth)
    tied = load_word(block + TIED) + 2 * load_word(block + TIED + 8)
    for key in range(config.SCALARS):
        if values[key] == 0.0:
            continue
        why = _unfelt(geoms, places, mouth, tied, key)
        if why < 0:
            continue
        message = np.zeros(CAPACITY, np.uint8)
        used = opening(message, model, instance)
        used = append(message, used, _KEY)
        used = config.append_key(message, used, key)
        used = append(message, used, _UNFELT[why])
        if not said_before(message, used, fields.signature(model)):
            warn(message, used)


@internal
def warn_order(model: int, instance: int) -> None:
    """Warn, once, of an end that can never pull: of the wrong sign, or swapped."""
    _, first, second = ends.find(model, instance)
    written = config.value(fields.attributes(model, instance), config.ROUTE)
    route = ends.find_route(model, instance, written) if written.size > 0 else -1
    for end in range(2):
        actuator, why = (second if end else first), -1
        if ends.pushes(model, actuator, end == 1):
            why = 0
        elif end == 0 and ends.pays_out(model, instance, actuator):
            why = 1
        elif end == 0 and route >= 0 and ends.swapped(model, first, second, route):
            why = 2
        if why >= 0:
            message = np.zeros(CAPACITY, np.uint8)
            used = opening(message, model, instance)
            used = ends.name_actuator(message, used, model, actuator)
            used = append(message, used, _ORDER[why])
            if not said_before(message, used, fields.signature(model)):
                warn(message, used)
