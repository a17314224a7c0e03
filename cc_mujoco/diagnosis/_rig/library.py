"""Effects that a rig can show, by its cables and its torque instruments.

A load cell on the cable does not measure effects behind it, a known load has no sensor
that could be off, and without an instrument of a torque none of its effects can be
seen. Effects that are left out are reported with the instrument that would show them.
Facts of the rig remove or bound others.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

from cc_mujoco.datasets._coupled_route import Leading
from cc_mujoco.datasets._instruments import Instrument, Instruments
from cc_mujoco.datasets._trials import Constant
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis.effects import (
    ANTAGONIST,
    EFFECTS,
    EXIT_FORMS,
    Effect,
    EffectParameter,
    form_key,
)
from cc_mujoco.report._html import list_words

_MECHANICAL_INSTRUMENTS: dict[str, tuple[Instrument, ...]] = {
    "motor": ("torque sensor", "motor current"),
    "joint": ("torque sensor", "known load"),
}
"""Instruments that show effects beyond the cable, on the torque of one side."""
_SENSOR_INSTRUMENTS: dict[str, tuple[Instrument, ...]] = {
    "motor": ("torque sensor", "load cells", "motor current"),
    "joint": ("torque sensor", "load cells"),
}
"""Instruments to which sensor errors of the torque apply, by side."""
_EXCLUDING_FACTS = {"joint_gravity": "balanced", "joint_stiffness": "joint_spring"}
"""Statements of `[rig]` by which a rig does not have an effect."""
_SEAL_PARAMETERS = ("seal_proximal", "seal_distal")
"""Parameters that only a conduit has."""
_TURNING_EFFECTS = (
    "pulley_eccentricity",
    "configuration_dependent_wrap",
    "drum_winding",
    "lever_geometry",
)
"""Effects of an angle at an end, which held ends do not have."""
_LOAD_EFFECTS = ("joint_stiffness", "joint_inertia")
"""Effects that may also be negative beside a declared load."""


class Library(NamedTuple):
    """Effects of a rig.

    Attributes:
        effects: effects by id, with the parameters that can change the residuals.
        hidden: reason why each other effect is not detectable, by id.
        declared: facts of the rig that remove an effect or bound it, by id, in words.
    """

    effects: Mapping[str, Effect]
    hidden: Mapping[str, str]
    declared: Mapping[str, str]


def available_effects(
    cables: int,
    instruments: Instruments,
    led: Leading = "",
    tied: bool = False,
    columns: Collection[str] = (),
    constants: Mapping[str, Constant] = MappingProxyType({}),
    ends_held: bool = False,
) -> Library:
    """Return the effects that a rig can show.

    `led` is the part of the cables that the joint moves besides their ends; they are
    `tied` if they end where their open path ends. `columns` are further columns of all
    trials. `ends_held` is true if drum or conduit moves and the ends do not.
    """
    sides: dict[str, Instrument | None] = dict(instruments._asdict())

    def acts(parameter: EffectParameter) -> bool:
        for side, known in sides.items():
            if parameter.name.startswith(f"{side}_torque_"):
                return known in _SENSOR_INSTRUMENTS[side]
        if led == "open" and parameter.name in _SEAL_PARAMETERS:
            return False
        return cables > 1 or ANTAGONIST not in parameter.name

    effects, hidden = {}, {}
    declared: dict[str, str] = {}
    for name, effect in EFFECTS.items():
        side = effect.where if effect.torques and not effect.sensor else ""
        shown = _MECHANICAL_INSTRUMENTS.get(side, ())
        kept = tuple(filter(acts, effect.parameters))
        if name in _LOAD_EFFECTS and sides["joint"] == "known load":
            either = (-math.inf, math.inf)
            kept = tuple(parameter._replace(plausible=either) for parameter in kept)
        if fact := _excluding_fact(name, constants):
            declared[name] = fact
            continue
        kept, fact = _bounded_parameters(name, kept, constants)
        if fact:
            declared[name] = fact
        absent = [column for column in effect.columns if column not in columns]
        if reason := _path_exclusion(effect, led, tied):
            hidden[name] = reason
        elif ends_held and name in _TURNING_EFFECTS:
            hidden[name] = "both ends are held, so no pulley turns"
        elif absent:
            hidden[name] = f"it takes the column {absent[0]}, which not all trials have"
        elif shown and sides[side] not in shown:
            hidden[name] = _instrument_exclusion(side, sides[side], shown)
        elif not kept:
            hidden[name] = "no sensor of a torque is there that could be off"
        else:
            effects[name] = _with_parameters(effect, kept, cables, constants)
    return Library(effects, hidden, declared)


def _with_parameters(
    effect: Effect,
    kept: tuple[EffectParameter, ...],
    cables: int,
    constants: Mapping[str, Constant],
) -> Effect:
    """Return an effect with these parameters, in the forms that the rig may have."""
    key = form_key(effect.id)
    forms, starts = effect.forms, effect.starts
    if forms == EXIT_FORMS and (cables == 1 or "exit_angle" in constants):
        forms, starts = (), tuple(s for s in starts if s[key] == 0.0)
    names = {parameter.name for parameter in kept}
    if forms:
        names.add(key)
    starts = tuple(
        {name: value for name, value in start.items() if name in names}
        for start in starts
    )
    return replace(effect, parameters=kept, starts=starts, forms=forms)


def _excluding_fact(name: str, constants: Mapping[str, Constant]) -> str:
    """Return the fact by which a rig does not have an effect; "" if it may."""
    fact = _EXCLUDING_FACTS.get(name, "")
    if fact not in constants:
        return ""
    return f"{fact} = {str(bool(constants[fact].value)).lower()}"


def _bounded_parameters(
    name: str,
    parameters: tuple[EffectParameter, ...],
    constants: Mapping[str, Constant],
) -> tuple[tuple[EffectParameter, ...], str]:
    """Return the parameters that the facts leave, and the fact."""
    if name == "torque_sensor_offset" and "zeroed" in constants:
        drifts = tuple(each for each in parameters if not each.name.endswith("_bias"))
        return drifts, "zeroed = true leaves drifts"
    if name == "torque_sensor_gain" and "gain_uncertainty" in constants:
        known = constants["gain_uncertainty"].value
        most = Limit.gain_sigmas * known
        bounded = tuple(each._replace(plausible=(-most, most)) for each in parameters)
        return bounded, f"gain_uncertainty = {known:g} leaves at most {most:.2g}"
    return parameters, ""


def _path_exclusion(effect: Effect, led: Leading, tied: bool) -> str:
    """Return why a cable that the joint moves cannot have an effect; "" if it can."""
    if led and (effect.joint_arm is not None or effect.motor_arm is not None):
        return "a path that the joint moves is played with the arms of the scene"
    if led == "open" and effect.id == "clamp_creep":
        return "an open cable has no conduit that a clamp could hold"
    if led and effect.id == "backlash":
        if tied:
            return "the cable ends on the body that it turns, where nothing has play"
        return "play is looked for where the joint moves the end of the cable alone"
    if tied and effect.id == "configuration_dependent_wrap":
        return "the path in the scene says how much the cable bends at every angle"
    return ""


def _instrument_exclusion(
    side: str, known: Instrument | None, shown: tuple[Instrument, ...]
) -> str:
    reason = f"the {side}'s torque is not measured"
    if known is not None:
        reason = f"load cells on the cable do not see what happens at the {side}"
    return f"{reason}; it takes a {list_words(shown, 'or')} there"
