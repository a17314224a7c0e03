"""The makes of rigs, and the effects of `effects.toml` that can be hidden in them.

A make simulates the same bench by other equations, with other sensors.

An effect has one amount, off at 0, and turns a rig without it into one with it. Its
other properties (phases, signs, places) are drawn from a random generator. Its formulas
differ on purpose from those a model library would choose first.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from numpy.random import Generator

from rig import bristles, elements, guides, sensors
from rig.engine import Law
from rig.nominal import Rig

EFFECTS = Path(__file__).with_name("effects.toml")


class Truth(NamedTuple):
    """Physics and sensors of a rig, hidden effects included."""

    plant: Any
    chain: Any

    def values(self) -> dict[str, Any]:
        """Return all constants of bench, plant and sensors, by name."""
        plant, chain = self.plant, self.chain
        return plant.bench._asdict() | plant._asdict() | chain._asdict()

    def changed(self, **values: Any) -> Truth:
        """Return the rig with other values of constants, wherever these belong."""

        def of(part: Any) -> Any:
            return part._replace(
                **{name: values[name] for name in part._fields if name in values}
            )

        plant = of(self.plant._replace(bench=of(self.plant.bench)))
        return Truth(plant, of(self.chain))


class Effect(NamedTuple):
    """An effect that can be hidden in a rig, see `effects.toml`."""

    parameter: str  # what `amount` measures
    unit: str  # of the amount
    typical: float
    limit: float
    field: str = ""  # constant that is the amount
    adds_to: str = ""
    uneven: str = ""
    signed: bool = False
    drawn: Mapping[str, Any] = {}

    def hide(self, truth: Truth, amount: float, random: Generator) -> Truth:
        """Return the rig with `amount` of the effect; `random` draws its details."""
        size = float(random.choice([-1.0, 1.0])) * amount if self.signed else amount
        changes: dict[str, Any] = {self.field: size}
        if self.uneven:
            each = amount * random.uniform(0.5, 1.5, truth.plant.mass.shape)
            changes = {self.uneven: getattr(truth.plant, self.uneven) + each}
        elif self.adds_to:
            changes = {self.adds_to: getattr(truth.plant, self.adds_to) + amount}
        changes |= {key: _draw(how, random) for key, how in self.drawn.items()}
        return truth.changed(**changes)


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


class Make(NamedTuple):
    plant_of: Callable[..., Any]  # the plant of a rig in which nothing is hidden
    law: Law  # motion of its cables
    effects: Mapping[str, Effect]  # what can be hidden, by id
    named: tuple[str, ...]  # ids that a library can be expected to know
    unknown: tuple[str, ...]  # those that it cannot
    chain_of: Callable[[Rig], sensors.Chain]  # its sensors when nothing is hidden

    def trials(self, rig: Rig) -> str:
        """Return the set of trials that a study of this rig records."""
        # Rests and creep are what is hard for coarse encoders.
        return "restful" if self.chain_of(rig).coarse else "rich"


def _make(of: ModuleType, chain_of: Callable[[Rig], sensors.Chain]) -> Make:
    hidden = tomllib.loads(EFFECTS.read_text(encoding="utf-8"))
    effects = {k: Effect(**v) for k, v in hidden[of.__name__.split(".")[-1]].items()}
    unknown = tuple(name for name in effects if name.startswith("unknown_"))
    named = tuple(name for name in effects if name not in unknown)
    return Make(of.plant_of, of.LAW, effects, named, unknown, chain_of)


MAKES = {
    "bristles": _make(bristles, lambda _rig: sensors.Chain()),
    "guides": _make(guides, lambda _rig: sensors.Chain()),
    "elements": _make(elements, sensors.imperfect),
}
