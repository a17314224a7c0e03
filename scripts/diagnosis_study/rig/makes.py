"""The makes of rigs: other equations, and other sensors, for the same bench."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from rig import effects, kernel, plant, sensors
from rig.elements import effects as of_elements
from rig.elements import instruments
from rig.elements import kernel as elements
from rig.elements import plant as meshed
from rig.guides import effects as guided
from rig.guides import kernel as guides
from rig.guides import plant as through_guides
from rig.nominal import Rig


class Logger(NamedTuple):
    """Conversion of what happens in a rig into what is stored.

    Attributes:
        chain_of: what the sensors of a rig are like when nothing is hidden.
        channels: of the logger of a rig.
        sampled: see `sensors.sampled`.
        logged: (clean, rig, names, key) -> columns, see `sensors.logged`.
    """

    chain_of: Callable[[Rig], Any]
    channels: Callable[[Rig], Mapping[str, sensors.Channel]]
    sampled: Callable[..., Any]
    logged: Callable[..., dict[str, Any]]


class Make(NamedTuple):
    """One of them.

    Attributes:
        plant_of: the plant of a rig in which nothing is hidden.
        integrate: one trial of a plant, see `kernel.integrate`.
        effects: what can be hidden, by id.
        named: ids that a library can be expected to know.
        unknown: those that it cannot.
        logger: its sensors.
        trials: the set of trials that a study of this rig records.
        hanging: field of the plant that says where the joint's weight hangs [rad].
    """

    plant_of: Callable[[Rig], Any]
    integrate: Callable[..., Any]
    effects: Mapping[str, effects.Effect]
    named: tuple[str, ...]
    unknown: tuple[str, ...]
    logger: Logger
    trials: Callable[[Rig], str]
    hanging: str


def _with_bristles(p: plant.Plant, *given: Any) -> Any:
    """Shorten the steps for impacts or falling friction."""
    *motion, refine = given
    return kernel.integrate(p, *motion, refine * (2 if p.backlash or p.stribeck else 1))


_USUAL = Logger(
    lambda _rig: sensors.Chain(),
    lambda _rig: sensors.CHANNELS,
    sensors.sampled,
    lambda clean, _rig, names, key: sensors.logged(clean, names, key),
)


def _rich(_rig: Rig) -> str:
    return "rich"


def _slow_where_coarse(rig: Rig) -> str:
    """Return, where encoders are coarse, trials with what is hard for them."""
    return "restful" if instruments.chain_of(rig).coarse else "rich"


MAKES = {
    "bristles": Make(
        plant.plant_of,
        _with_bristles,
        effects.EFFECTS,
        tuple(effects.NAMED),
        tuple(effects.UNKNOWN),
        _USUAL,
        _rich,
        "gravity_phase",
    ),
    "guides": Make(
        through_guides.plant_of,
        guides.integrate,
        guided.EFFECTS,
        tuple(guided.NAMED),
        tuple(guided.UNKNOWN),
        _USUAL,
        _rich,
        "unbalance_phase",
    ),
    "elements": Make(
        meshed.plant_of,
        elements.integrate,
        of_elements.EFFECTS,
        tuple(of_elements.NAMED),
        tuple(of_elements.UNKNOWN),
        Logger(
            instruments.chain_of,
            instruments.channels,
            instruments.sampled,
            instruments.logged,
        ),
        _slow_where_coarse,
        "weight_phase",
    ),
}
