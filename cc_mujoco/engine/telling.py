"""What a user is told of a cable: why it cannot lie open, and, once, what is amiss."""

from __future__ import annotations

import mujoco
import numpy as np

from cc_mujoco.engine import config, ends, fields, jumps, path, pieces
from cc_mujoco.engine.block import (
    DISTAL,
    EXPLICIT,
    MOUTH,
    PROXIMAL,
    REFERENCE,
    ROUTE,
    SEGMENTS,
    TIED,
    memory,
    opens,
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

_NO_SPRING = int(mujoco.mjtDisableBit.mjDSBL_SPRING)
_NO_DAMPER = int(mujoco.mjtDisableBit.mjDSBL_DAMPER)

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
    n, tendon = load_word(block + SEGMENTS), load_word(block + ROUTE)
    for what in range(3):
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
        if not jumps.jumped(model, speed, moved):
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
    """Whether MuJoCo evaluates no passive forces."""
    no_spring = fields.disabled(model, _NO_SPRING)
    return no_spring and fields.disabled(model, _NO_DAMPER)
