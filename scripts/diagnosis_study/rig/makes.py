"""The makes of rigs: other equations, and other sensors, for the same bench."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any, NamedTuple

from rig import bristles, elements, guides, instruments, sensors
from rig.effects import Effect
from rig.engine import Law
from rig.nominal import Rig


class Make(NamedTuple):
    """One of them."""

    plant_of: Callable[[Rig], Any]  # the plant of a rig in which nothing is hidden
    law: Law  # motion of its cables
    effects: Mapping[str, Effect]  # what can be hidden, by id
    named: tuple[str, ...]  # ids that a library can be expected to know
    unknown: tuple[str, ...]  # those that it cannot
    chain_of: Callable[[Rig], Any]  # its sensors when nothing is hidden
    trials: Callable[[Rig], str]  # the set of trials that a study of this rig records


def _usual(_rig: Rig) -> sensors.Chain:
    return sensors.Chain()


def _rich(_rig: Rig) -> str:
    return "rich"


def _slow_where_coarse(rig: Rig) -> str:
    """Return, where encoders are coarse, trials with what is hard for them."""
    return "restful" if instruments.chain_of(rig).coarse else "rich"


def _make(
    of: ModuleType,
    chain_of: Callable[[Rig], Any] = _usual,
    trials: Callable[[Rig], str] = _rich,
) -> Make:
    known = tuple(of.NAMED), tuple(of.UNKNOWN)
    return Make(of.plant_of, of.LAW, of.EFFECTS, *known, chain_of, trials)


MAKES = {
    "bristles": _make(bristles),
    "guides": _make(guides),
    "elements": _make(elements, instruments.chain_of, _slow_where_coarse),
}
