"""Which controllers can be exported, and the numbers that they are given.

plan = Plan.of("stiction", drive, ("flexor", "extensor"))
plan.fields[0].name, plan.values()[0]      # "ratio", 5.2
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.control import (
    CONTROLLERS,
    CableDrive,
    Controller,
    Drive,
    Feedback,
    ModelBased,
    PredictiveCompensation,
    ProportionalIntegral,
    StictionCompensation,
)
from cc_mujoco.control.laws import GAINS, SEEN
from cc_mujoco.control.predictive import SEEN as READ
from cc_mujoco.control.tuning import TUNING
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.export import entries, predictive
from cc_mujoco.transmission import PARAMETERS
from cc_mujoco.transmission.parameter import Parameter


@dataclass(frozen=True)
class Law:
    """The compiled functions of a controller."""

    set_parameters: Callable[..., Any]
    step: Callable[..., Any]
    has_model: bool
    unread: frozenset[str] = frozenset()
    """Gains that it does not read."""
    fixed: frozenset[str] = frozenset()
    """Gains that what it was exported with depends on."""
    gains: tuple[Parameter, ...] = GAINS
    seen: tuple[str, ...] = SEEN
    """What it reads."""


_SENSE = frozenset({"preview", "tolerance"})
_FEEDBACK = Law(
    entries.set_gains,
    entries.step_proportional_integral,
    False,
    _SENSE | {"settling"},
)
LAWS: dict[type[Controller], Law] = {
    ProportionalIntegral: _FEEDBACK,
    Feedback: _FEEDBACK,
    ModelBased: Law(
        entries.set_cables, entries.step_model_based, True, _SENSE | {"feed_forward"}
    ),
    StictionCompensation: Law(
        entries.set_cables, entries.step_stiction, True, frozenset({"feed_forward"})
    ),
    PredictiveCompensation: Law(
        predictive.set_plan,
        predictive.step_plan,
        True,
        fixed=frozenset(
            "period span rotor_0 rotor_1 motion_0 motion_1 motion_2 forgetting leak "
            "late".split()
        ),
        gains=TUNING,
        seen=READ,
    ),
}
"""Controllers whose step is a compiled function, hence can be exported."""

EXPORTED = tuple(name for name, kind in CONTROLLERS.items() if kind in LAWS)
"""Their names."""


@dataclass(frozen=True)
class Field:
    """One parameter, and where it comes from."""

    name: str
    unit: str
    low: float
    high: float
    value: float
    meaning: str


@dataclass(frozen=True)
class Plan:
    """A controller for a device, as it is exported."""

    law: Law
    fields: tuple[Field, ...]
    """Parameters in the order in which C has them."""
    cables: tuple[str, ...]
    """Names of the cables that the controller has a model of."""
    segments: tuple[int, ...]
    sections: tuple[int, ...]
    plans: tuple[FloatArray, ...] = ()
    """Of a controller that plans: gains of the plans (delays, knots, 2 + knots) and of
    the unexplained torque (delays,)."""

    @classmethod
    def of(cls, name: str, drive: Drive, cables: tuple[str, ...]) -> Plan:
        """Plan a controller with its default gains.

        Args:
            name: Of the controller.
            drive: The device.
            cables: Names of its cables.

        Raises:
            CableError: There is no such controller, it cannot be exported, or it needs
                cables and there are none.
        """
        kind = look_up("controller", name, CONTROLLERS)
        if kind not in LAWS:
            raise CableError(
                f"controller {name!r} cannot be exported, for its step is not one "
                f"compiled function; {', '.join(EXPORTED)} can be."
            )
        made: Any = kind(drive)
        law = LAWS[kind]
        known = drive.cables if law.has_model else ()
        planned = isinstance(made, PredictiveCompensation)
        given = made.tuning if planned else made.gains
        rows = tuple(zip(map(_identifier, cables), known, strict=False))
        fields = [
            _of_gain(gain, float(getattr(given, gain.name)), law) for gain in law.gains
        ]
        for cable, own in rows:
            fields += _of_cable(cable, own)
        if len({field.name.upper() for field in fields}) < len(fields):
            raise CableError(
                f"cables {', '.join(cables)} have the same name in C; rename one."
            )
        return cls(
            law,
            tuple(fields),
            tuple(cable for cable, _ in rows),
            tuple(own.cable.segments for _, own in rows),
            tuple(len(own.cable.conduit) for _, own in rows),
            (made.tables.gains, made.tables.unexplained) if planned else (),
        )

    @property
    def shape(self) -> tuple[int, ...]:
        """What the compiled functions are told: see `entries`."""
        told = (len(self.cables), *self.segments, *self.sections)
        return (*told, *self.plans[0].shape[:2]) if self.plans else told

    @property
    def tables(self) -> tuple[float, ...]:
        """Numbers that no parameter changes: see `entries`."""
        return tuple(
            float(number) for table in self.plans for number in np.ravel(table)
        )

    def values(self) -> FloatArray:
        """The parameters, in order."""
        return np.array([field.value for field in self.fields])

    @property
    def places(self) -> tuple[int, ...]:
        """Where numbers stand in the memory; the last is how many there are."""
        longest = max(self.segments, default=0)
        if self.plans:
            delays, knots = self.plans[0].shape[:2]
            return tuple(
                predictive.places(
                    len(self.cables), longest, sum(self.sections), delays, knots
                )
            )
        return tuple(entries.places(len(self.cables), longest))

    @property
    def given(self) -> int:
        """Place of the last torque in the memory, of a controller that plans."""
        return self.places[0] - 1  # before the scratch, see `predictive.places`


def _identifier(name: str) -> str:
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def _bounds(parameter: Any) -> tuple[float, float]:
    low = parameter.low
    return (
        math.nextafter(low, math.inf) if parameter.low_open else low
    ), parameter.high


def _of_gain(gain: Parameter, value: float, law: Law) -> Field:
    meaning, (low, high) = gain.meaning, _bounds(gain)
    if gain.name in law.unread:
        meaning += "; this controller does not read it"
    if gain.name in law.fixed:
        meaning, low, high = meaning + "; fixed by the export", value, value
    return Field(gain.name, gain.unit, low, high, value, meaning)


def _of_cable(name: str, own: CableDrive) -> Iterator[Field]:
    most, least = 1e6, math.nextafter(0.0, 1.0)
    for side, value in (("proximal", own.proximal), ("distal", own.distal)):
        end = "motor" if side == "proximal" else "joint"
        yield Field(
            f"{name}_{side}", "m/rad", -most, most, value,
            f"displacement of the {side} end per angle of the {end}, signed, not 0",
        )  # fmt: skip
    for parameter, value in zip(PARAMETERS, own.cable.scalars, strict=True):
        low, high = _bounds(parameter)
        if own.cable.path == "open" and parameter.name.startswith("seal_"):
            high = 0.0
        yield Field(
            f"{name}_{parameter.name}", parameter.unit, low, high, value,
            parameter.meaning,
        )  # fmt: skip
    for i, section in enumerate(own.cable.conduit):
        yield Field(
            f"{name}_length_{i}", "m", least, most, section.length,
            f"length of section {i} of the conduit, from the motor",
        )  # fmt: skip
        yield Field(
            f"{name}_radius_{i}", "m", least, math.inf, section.radius,
            "its bend radius; infinite where it is straight",
        )  # fmt: skip
