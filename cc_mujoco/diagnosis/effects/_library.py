"""Table of the effects that a diagnosis can name, and effects of the user in it.

with effects_in_use(["my.py:JointDrag", "joint_stops"]) as requested:
...                     # EFFECTS has `joint_drag`; both are searched
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from cc_mujoco._utils.user_code import named_object
from cc_mujoco.diagnosis.effects._conduit_effects import CABLE_EFFECTS, FRICTION_EFFECTS
from cc_mujoco.diagnosis.effects._drive_effects import DRIVE_EFFECTS, SENSOR_EFFECTS
from cc_mujoco.diagnosis.effects._effect import Effect
from cc_mujoco.diagnosis.effects._effect_class import effect_of_class
from cc_mujoco.diagnosis.effects._rare_effects import RARE_EFFECTS
from cc_mujoco.errors import CableError

EFFECTS: dict[str, Effect] = {
    effect.id: effect
    for effect in (
        *FRICTION_EFFECTS,
        *CABLE_EFFECTS,
        *DRIVE_EFFECTS,
        *SENSOR_EFFECTS,
        *RARE_EFFECTS,
    )
}
"""Every effect of the library by its id."""


def table_rows(effects: Iterable[Effect]) -> list[list[str]]:
    """Return effects as rows of text below their heads; rare ones have a star."""
    rows = [
        [each.id + ("*" if each.rare else ""), each.equation, each.required_excitation]
        for each in effects
    ]
    return [["effect", "term", "required excitation"], *rows]


def usual_effects() -> tuple[str, ...]:
    """Return the ids of the effects that every search considers."""
    return tuple(name for name, effect in EFFECTS.items() if not effect.rare)


@contextmanager
def effects_in_use(given: Iterable[Any]) -> Iterator[tuple[str, ...]]:
    """Have effects in `EFFECTS` while the block runs; yield their ids.

    Args:
        given: ids of the library, `FILE.py:CLASS` or `MODULE:CLASS`, classes as
            described in `_effect_class`, or effects.

    Raises:
        CableError: an effect cannot be used, or its id or a parameter has the name of
            another one's.
    """
    if isinstance(given, str) or inspect.isclass(given):
        given = [given]
    requested: list[str] = []
    added: list[str] = []
    try:
        for each in given:
            if isinstance(each, str) and ":" not in each:
                if each.endswith(".py"):
                    raise CableError(
                        f"effect {each!r} names a file; write {each}:CLASS, with the "
                        "class of the effect in it."
                    )
                if each not in EFFECTS:
                    raise CableError.unknown("effect", each, EFFECTS)
                requested.append(each)
                continue
            effect = _loaded(each)
            _require_new(effect)
            EFFECTS[effect.id] = effect
            added.append(effect.id)
            requested.append(effect.id)
        yield tuple(dict.fromkeys(requested))
    finally:
        for name in added:
            del EFFECTS[name]


def _loaded(given: Any) -> Effect:
    """Return the effect that a class, an object or its name stands for."""
    if isinstance(given, str):
        given = named_object("effect", given, "class")
    return given if isinstance(given, Effect) else effect_of_class(given)


def _require_new(effect: Effect) -> None:
    if effect.id in EFFECTS:
        raise CableError(
            f"effect {effect.id!r} is in the library already; give the class another "
            "name, or an attribute `id`"
        )
    owners = {
        parameter.name: other.id
        for other in EFFECTS.values()
        for parameter in other.parameters
    }
    for parameter in effect.parameters:
        if parameter.name in owners:
            raise CableError(
                f"effect {effect.id!r}: parameter {parameter.name!r} is one of effect "
                f"{owners[parameter.name]!r}; call it otherwise"
            )
    for other in (*effect.confounded_with, *effect.generalises):
        if other not in EFFECTS:
            raise CableError.unknown(
                f"effect {effect.id!r} in `confused_with`: effect", other, EFFECTS
            )
