"""Everything that can be hidden in a rig, by make and id, of `effects.toml`.

An effect has one amount, off at 0, and turns the truth without it into the truth with
it. What else it needs (phases, signs, places) is drawn from the generator it is given.
The forms differ on purpose from those a model library would choose first.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from numpy.random import Generator


class Truth(NamedTuple):
    """The physics and the sensors of a rig, hidden effects included."""

    plant: Any
    chain: Any


class Effect(NamedTuple):
    """One thing that can be hidden, see `effects.toml`."""

    parameter: str  # what `amount` measures
    unit: str  # of the amount
    typical: float
    limit: float
    plant: str = ""  # field that is the amount
    chain: str = ""
    adds_to: str = ""
    uneven: str = ""
    signed: bool = False
    drawn: Mapping[str, Any] = {}

    def hide(self, truth: Truth, amount: float, random: Generator) -> Truth:
        """Return the truth with the effect."""
        size = float(random.choice([-1.0, 1.0])) * amount if self.signed else amount
        changes: dict[str, Any] = {self.plant or self.chain: size}
        if self.uneven:
            each = amount * random.uniform(0.5, 1.5, truth.plant.mass.shape)
            changes = {self.uneven: getattr(truth.plant, self.uneven) + each}
        elif self.adds_to:
            changes = {self.adds_to: getattr(truth.plant, self.adds_to) + amount}
        changes |= {key: _draw(how, random) for key, how in self.drawn.items()}
        part = "chain" if self.chain else "plant"
        return truth._replace(**{part: getattr(truth, part)._replace(**changes)})


def _draw(how: Any, random: Generator) -> Any:
    match how:
        case "turn":
            return random.uniform(-math.pi, math.pi)
        case "around":
            return random.uniform(0.0, 2.0 * math.pi)
        case {"choice": values}:
            return float(random.choice(values))
        case {"integers": ends}:
            return float(random.integers(*ends))
        case {"uniform": ends, "size": size}:
            return random.uniform(*ends, size)
    return random.uniform(*how)


EFFECTS: dict[str, dict[str, Effect]] = {
    make: {name: Effect(**fields) for name, fields in effects.items()}
    for make, effects in tomllib.loads(
        Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
    ).items()
}
