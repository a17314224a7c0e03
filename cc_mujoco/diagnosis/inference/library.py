"""Effects that a rig can show: by its cables, and by what its torques are known from.

A load cell on the cable does not see what happens behind it, a known load has no
sensor that could be off, and of a torque that nothing tells no effect can be seen. What
is left out is told with what would show it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from cc_mujoco.diagnosis.data.instruments import Instrument, Instruments
from cc_mujoco.diagnosis.data.led import Leading
from cc_mujoco.diagnosis.effects import (
    ANTAGONIST,
    EFFECTS,
    Effect,
    EffectParameter,
)
from cc_mujoco.page import listed

_BEHIND: dict[str, tuple[str, tuple[Instrument, ...]]] = {
    "motor_inertia": ("motor", ("torque sensor", "motor current")),
    "motor_cogging": ("motor", ("torque sensor", "motor current")),
    "joint_gravity": ("joint", ("torque sensor", "known load")),
    "joint_stiffness": ("joint", ("torque sensor", "known load")),
    "joint_inertia": ("joint", ("torque sensor", "known load")),
}
"""Effects that change one torque only, and not the cable: side, and what shows them."""
_SENSORS: dict[str, tuple[Instrument, ...]] = {
    "motor": ("torque sensor", "load cells", "motor current"),
    "joint": ("torque sensor", "load cells"),
}
"""What may be off or late, by the beginning of an effect's parameter."""
_SEALS = ("seal_proximal", "seal_distal")
"""Parameters that only a conduit has."""
_OF_LOADS = ("joint_stiffness", "joint_inertia")
"""Effects that a declared load may have less of, as well as more."""


class Library(NamedTuple):
    """Effects of a rig.

    Attributes:
        effects: by id, with the parameters that can change what is compared.
        hidden: why the others cannot be seen, by id.
    """

    effects: Mapping[str, Effect]
    hidden: Mapping[str, str]


def library(
    cables: int, instruments: Instruments, led: Leading = "", tied: bool = False
) -> Library:
    """The effects that a rig can show.

    Args:
        cables: their number.
        instruments: what its torques are known from.
        led: what the joint moves of the cables, besides their ends.
        tied: whether they end where their path in the open does.
    """
    sides: dict[str, Instrument | None] = dict(instruments._asdict())

    def acts(parameter: EffectParameter) -> bool:
        for side, known in sides.items():
            if parameter.name.startswith(f"{side}_torque_"):
                return known in _SENSORS[side]
        if led == "open" and parameter.name in _SEALS:
            return False
        return cables > 1 or ANTAGONIST not in parameter.name

    effects, hidden = {}, {}
    for name, effect in EFFECTS.items():
        side, shown = _BEHIND.get(name, ("", ()))
        kept = tuple(filter(acts, effect.parameters))
        if name in _OF_LOADS and sides["joint"] == "known load":
            either = (-math.inf, math.inf)
            kept = tuple(parameter._replace(plausible=either) for parameter in kept)
        if told := _led(name, led, tied):
            hidden[name] = told
        elif side and sides[side] not in shown:
            hidden[name] = _behind(side, sides[side], shown)
        elif not kept:
            hidden[name] = "no sensor of a torque is there that could be off"
        else:
            names = {parameter.name for parameter in kept}
            starts = tuple(
                {key: value for key, value in start.items() if key in names}
                for start in effect.starts
            )
            effects[name] = replace(effect, parameters=kept, starts=starts)
    return Library(effects, hidden)


def _led(name: str, led: Leading, tied: bool) -> str:
    """Why a cable that the joint leads cannot have an effect; "" where it can."""
    if led and name == "backlash":
        if tied:
            return "the cable ends on the body that it turns, where nothing has play"
        return "play is looked for where the joint moves the end of the cable alone"
    if tied and name == "configuration_dependent_wrap":
        return "the path in the scene says how much the cable bends at every angle"
    return ""


def _behind(side: str, known: Instrument | None, shown: tuple[Instrument, ...]) -> str:
    told = f"the {side}'s torque is not measured"
    if known is not None:
        told = f"load cells on the cable do not see what happens at the {side}"
    return f"{told}; it takes a {listed(shown, 'or')} there"
