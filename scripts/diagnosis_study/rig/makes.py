"""The makes of rigs: other equations, and other sensors, for the same bench."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from rig import sensors
from rig.bristles import effects as of_bristles
from rig.bristles import kernel as bristles
from rig.bristles import plant as of_nodes
from rig.effects import Effect
from rig.elements import effects as of_elements
from rig.elements import instruments
from rig.elements import kernel as elements
from rig.elements import plant as meshed
from rig.engine import Law
from rig.guides import effects as guided
from rig.guides import kernel as guides
from rig.guides import plant as through_guides
from rig.nominal import Rig


class Make(NamedTuple):
    """One of them.

    Attributes:
        plant_of: the plant of a rig in which nothing is hidden.
        law: motion of its cables.
        effects: what can be hidden, by id.
        named: ids that a library can be expected to know.
        unknown: those that it cannot.
        chain_of: its sensors when nothing is hidden, see `sensors.Chain`.
        trials: the set of trials that a study of this rig records.
    """

    plant_of: Callable[[Rig], Any]
    law: Law
    effects: Mapping[str, Effect]
    named: tuple[str, ...]
    unknown: tuple[str, ...]
    chain_of: Callable[[Rig], Any]
    trials: Callable[[Rig], str]


def _usual(_rig: Rig) -> sensors.Chain:
    return sensors.Chain()


def _rich(_rig: Rig) -> str:
    return "rich"


def _slow_where_coarse(rig: Rig) -> str:
    """Return, where encoders are coarse, trials with what is hard for them."""
    return "restful" if instruments.chain_of(rig).coarse else "rich"


MAKES = {
    "bristles": Make(
        of_nodes.plant_of,
        bristles.LAW,
        of_bristles.EFFECTS,
        tuple(of_bristles.NAMED),
        tuple(of_bristles.UNKNOWN),
        _usual,
        _rich,
    ),
    "guides": Make(
        through_guides.plant_of,
        guides.LAW,
        guided.EFFECTS,
        tuple(guided.NAMED),
        tuple(guided.UNKNOWN),
        _usual,
        _rich,
    ),
    "elements": Make(
        meshed.plant_of,
        elements.LAW,
        of_elements.EFFECTS,
        tuple(of_elements.NAMED),
        tuple(of_elements.UNKNOWN),
        instruments.chain_of,
        _slow_where_coarse,
    ),
}
