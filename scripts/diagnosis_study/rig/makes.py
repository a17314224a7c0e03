"""The makes of rigs: other equations for the same bench, motions and sensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from rig import effects, kernel, plant
from rig.guides import effects as guided
from rig.guides import kernel as guides
from rig.guides import plant as through_guides
from rig.nominal import Rig


class Make(NamedTuple):
    """One of them.

    Attributes:
        plant_of: the plant of a rig in which nothing is hidden.
        integrate: one trial of a plant, see `kernel.integrate`.
        effects: what can be hidden, by id.
        named: ids that a library can be expected to know.
        unknown: those that it cannot.
    """

    plant_of: Callable[[Rig], Any]
    integrate: Callable[..., Any]
    effects: Mapping[str, effects.Effect]
    named: tuple[str, ...]
    unknown: tuple[str, ...]


def _with_bristles(p: plant.Plant, *given: Any) -> Any:
    """Shorter steps where impacts or falling friction make motion touchy."""
    *motion, refine = given
    return kernel.integrate(p, *motion, refine * (2 if p.backlash or p.stribeck else 1))


MAKES = {
    "bristles": Make(
        plant.plant_of,
        _with_bristles,
        effects.EFFECTS,
        tuple(effects.NAMED),
        tuple(effects.UNKNOWN),
    ),
    "guides": Make(
        through_guides.plant_of,
        guides.integrate,
        guided.EFFECTS,
        tuple(guided.NAMED),
        tuple(guided.UNKNOWN),
    ),
}
