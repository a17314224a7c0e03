"""Effects that a diagnosis can name: one entry each.

An entry of `effects.toml` says what the effect is, where it acts and what its
parameters are; `ACTIONS` how it changes a simulation: through cables, moment arms or
the readings of motor and joint (`torques`). `backlash` and `JOINT_DELAY` change the
played motion, too. Sizes at 0 are off, bit for bit. To add an effect, write its entry,
and its form in MuJoCo in `_scene/realisation.py` where it is not in the cable.
"""

import inspect
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from cc_mujoco._utils.user_code import named_object
from cc_mujoco.diagnosis.effects import _cable_effects, _drive_effects
from cc_mujoco.diagnosis.effects._effect import Effect, effect_of_class, read_effects
from cc_mujoco.errors import CableError

EFFECTS: dict[str, Effect] = {
    effect.id: effect
    for effect in (
        *read_effects(_cable_effects.ACTIONS | _drive_effects.ACTIONS),
        # Rare ones: searched on request, and where these leave the error unexplained
        *(
            effect_of_class(kind, rare=True)
            for kind in (
                _cable_effects.ClampCreep,
                _cable_effects.SoftAnchor,
                _drive_effects.DrumWinding,
                _drive_effects.UpperJointStop,
                _drive_effects.LowerJointStop,
                _drive_effects.CurrentRipple,
                _cable_effects.FrictionByOrder,
                _cable_effects.FrictionByTemperature,
                _drive_effects.SensorCrossTalk,
                _drive_effects.JointFriction,
                _drive_effects.CoupledNeighbour,
                _drive_effects.LeverGeometry,
            )
        ),
    )
}
"""Every effect of the library by its id."""


def usual_effects() -> tuple[str, ...]:
    """Return the ids of the effects that every search considers."""
    return tuple(name for name, effect in EFFECTS.items() if not effect.rare)


@contextmanager
def effects_in_use(given: Iterable[Any]) -> Iterator[tuple[str, ...]]:
    """Put effects in `EFFECTS` while the block runs; yield their ids.

    `given` are ids of the library, `FILE.py:CLASS` or `MODULE:CLASS`, classes as in
    `_effect`, or effects. One with the id or a parameter name of another is refused.
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
            if isinstance(each, str):
                each = named_object("effect", each, "class")
            effect = each if isinstance(each, Effect) else effect_of_class(each)
            _require_new(effect)
            EFFECTS[effect.id] = effect
            added.append(effect.id)
            requested.append(effect.id)
        yield tuple(dict.fromkeys(requested))
    finally:
        for name in added:
            del EFFECTS[name]


def _require_new(effect: Effect) -> None:
    if effect.id in EFFECTS:
        raise CableError(
            f"effect {effect.id!r} is in the library already; give the class another "
            "name, or an attribute `id`"
        )
    others = ((each, p.name) for each in EFFECTS.values() for p in each.parameters)
    owners = {name: each.id for each, name in others}
    for parameter in effect.parameters:
        if parameter.name in owners:
            raise CableError(
                f"effect {effect.id!r}: parameter {parameter.name!r} is one of effect "
                f"{owners[parameter.name]!r}; call it otherwise"
            )
    for other in (*effect.confounded_with, *effect.generalises, *effect.resembles):
        if other not in EFFECTS:
            raise CableError.unknown(
                f"effect {effect.id!r} in `confused_with`: effect", other, EFFECTS
            )
