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
    plant_of: Callable[[Rig], Any]  # the plant of a rig in which nothing is hidden
    law: Law  # motion of its cables
    effects: Mapping[str, Effect]  # what can be hidden, by id
    named: tuple[str, ...]  # ids that a library can be expected to know
    unknown: tuple[str, ...]  # those that it cannot
    chain_of: Callable[[Rig], Any]  # its sensors when nothing is hidden
    trials: Callable[[Rig], str]  # the set of trials that a study of this rig records


def _make(of: ModuleType, chain_of: Callable[[Rig], Any]) -> Make:
    # Rests and creep are what is hard for coarse encoders.
    return Make(
        of.plant_of, of.LAW, of.NAMED | of.UNKNOWN, tuple(of.NAMED), tuple(of.UNKNOWN),
        chain_of, lambda rig: "restful" if chain_of(rig).coarse else "rich",
    )  # fmt: skip


MAKES = {
    "bristles": _make(bristles, lambda _rig: sensors.Chain()),
    "guides": _make(guides, lambda _rig: sensors.Chain()),
    "elements": _make(elements, instruments.chain_of),
}
