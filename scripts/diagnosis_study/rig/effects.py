"""Everything that can be hidden in a rig, by id.

An effect has one amount, off at 0, and turns the truth without it into the truth with
it. What else it needs (phases, signs, places) is drawn from the generator it is given.
The forms differ on purpose from those a model library would choose first.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from numpy.random import Generator


class Truth(NamedTuple):
    """The physics and the sensors of a rig, hidden effects included."""

    plant: Any
    chain: Any


Hide = Callable[[Truth, float, Generator], Truth]


class Effect(NamedTuple):
    """One thing that can be hidden."""

    parameter: str  # what `amount` measures
    unit: str  # of the amount
    typical: float  # an amount that shows clearly, R about 2 in rich trials
    limit: float  # the largest amount that is still physics
    hide: Hide  # (truth, amount, generator) -> truth with the effect


Drawn = tuple[float, float] | Callable[[Generator], Any]
"""Draw of another field: evenly between two numbers, or by a function."""


def plant(name: str, signed: bool = False, **drawn: Drawn) -> Hide:
    """Return an effect that is one field of the plant, of either sign if `signed`."""
    return _field("plant", name, signed, drawn)


def chain(name: str, signed: bool = False, **drawn: Drawn) -> Hide:
    """Return an effect that is one field of the sensors, of either sign if `signed`."""
    return _field("chain", name, signed, drawn)


def _field(part: str, name: str, signed: bool, drawn: dict[str, Drawn]) -> Hide:
    def hide(truth: Truth, amount: float, random: Generator) -> Truth:
        size = float(random.choice([-1.0, 1.0])) * amount if signed else amount
        changes = {name: size}
        for key, how in drawn.items():
            changes[key] = how(random) if callable(how) else random.uniform(*how)
        return truth._replace(**{part: getattr(truth, part)._replace(**changes)})

    return hide


def softer(name: str) -> Hide:
    """Return an effect that adds to the travel up to sliding, a field of the plant."""

    def hide(truth: Truth, amount: float, _random: Generator) -> Truth:
        travel = getattr(truth.plant, name) + amount
        return truth._replace(plant=truth.plant._replace(**{name: travel}))

    return hide


TURN = (-math.pi, math.pi)  # bounds of a phase [rad]
