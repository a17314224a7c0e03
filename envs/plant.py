"""A device as it is in an episode: its cables, wearer and sensors, given or drawn.

    ranges = Ranges({"friction": (0.05, 0.2), "delay": (0, 3)}, device)
    ranges.draw(rng, {"delay": 2})

Controllers are not informed: `drive` stays that of the scene.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cc_mujoco.checks import named, number
from cc_mujoco.errors import CableError
from cc_mujoco.human import Wearer
from cc_mujoco.transmission import PARAMETERS, Cable, Section
from cc_mujoco.transmission.parameters import PATHS

LATEST = 50
"""Longest delay of the sensors [samples]."""

OWN = {
    "wearer": (1e-3, 1e3, "times the scene's impedance"),
    "delay": (0, LATEST, "samples"),
    "noise": (0.0, 1e3, "times the device's noise"),
}
"""Quantities varied beside the cables: least, most, unit."""

OF_CABLES = (*(p.name for p in PARAMETERS), "break_away", "wrap")
"""Quantities varied of cables: parameters; break-away over kinetic friction, at least
1; the bend of the whole conduit [rad]."""

Range = tuple[float, float]


@dataclass(frozen=True)
class Plant:
    """Properties of a device that may differ from episode to episode.

    Attributes:
        values: as `reset` and `randomise` have them, by name.
        cables: all cables of the device, by name.
        wearer: of the joint.
        delay: samples by which measurements are late.
        noise: of the joint torque sensor, as a multiple of the device's; so is its
            bias, of twice that standard deviation.
    """

    values: Mapping[str, float]
    cables: Mapping[str, Cable]
    wearer: Wearer
    delay: int = 0
    noise: float = 0.0


class Ranges:
    """Ranges from which plants are drawn.

    Every cable has draws of its own. What is above 0 is drawn with a uniform logarithm,
    whole numbers and what may be 0 uniformly.
    """

    def __init__(
        self,
        given: Mapping[str, Any] | None,
        cables: Mapping[str, Cable],
        wearer: Wearer,
        strength: float,
    ) -> None:
        """Check the ranges.

        Args:
            given: (least, most) by name: `wearer`, `delay`, `noise`, or a parameter of
                all cables (`friction`) or of one (`flexor.friction`).
            cables: Those of the scene, by name.
            wearer: That of the scene.
            strength: Breaking load of a cable [N], which no pretension may reach.

        Raises:
            CableError: If a name is unknown, or a range or a plant out of it is
                impossible.
        """
        self._strength = strength
        self.nominal = Plant({}, cables, wearer)
        """The scene as it is."""
        ranges = named("randomise", given)
        self._ranges: dict[str, Range] = {}
        for name, ends in ranges.items():
            try:
                low, high = ends
            except (TypeError, ValueError):
                raise CableError(
                    f"randomise[{name!r}] must be (least, most), not {ends!r}."
                ) from None
            for end in (low, high):
                self._check(f"randomise[{name!r}]", name, end)
            if low > high:
                raise CableError(
                    f"randomise[{name!r}] must be (least, most), the lower number "
                    f"first, not {ends!r}."
                )
            for own in self._spelt(name):
                self._ranges[own] = low, high
        # Parameters may exclude each other: all corners of each cable must be possible.
        for cable in cables:
            mine = [n for n in self._ranges if n.startswith(f"{cable}.")]
            for corner in itertools.product((0, 1), repeat=min(len(mine), 8)):
                ends = zip(mine, corner, strict=False)
                self._made({name: self._ranges[name][end] for name, end in ends})

    @property
    def any(self) -> bool:
        """True if anything is drawn."""
        return bool(self._ranges)

    def draw(self, rng: np.random.Generator, given: Mapping[str, Any] | None) -> Plant:
        """Return the plant of an episode.

        Args:
            rng: Source of what is drawn; nothing is taken from it without ranges.
            given: Values that are not drawn, by name.

        Raises:
            CableError: If one of them is unknown or impossible.
        """
        values: dict[str, float] = {}
        for name, (low, high) in self._ranges.items():
            if name == "delay":
                values[name] = int(rng.integers(int(low), int(high), endpoint=True))
            elif low > 0.0:
                values[name] = float(np.exp(rng.uniform(math.log(low), math.log(high))))
                values[name] = min(max(values[name], low), high)
            else:
                values[name] = float(rng.uniform(low, high))
        # A value for one cable takes precedence over one for all.
        said = sorted(named("options", given).items(), key=lambda item: "." in item[0])
        for name, value in said:
            self._check(f"options[{name!r}]", name, value)
            values |= dict.fromkeys(self._spelt(name), value)
        return self._made(values) if values else self.nominal

    def _spelt(self, name: str) -> tuple[str, ...]:
        """Names of a variation, that of each cable where it is of all."""
        if name in OWN or "." in name:
            return (name,)
        return tuple(f"{cable}.{name}" for cable in self.nominal.cables)

    def _check(self, where: str, name: Any, value: Any) -> None:
        cable, _, key = str(name).rpartition(".")
        cables = self.nominal.cables
        known = name in OWN or (key in OF_CABLES and (not cable or cable in cables))
        if not known:
            raise CableError.unknown("variation", str(name), (*OWN, *OF_CABLES))
        low, high, unit = OWN.get(str(name), (-math.inf, math.inf, ""))
        number(where, value, low, high, unit)
        if not math.isfinite(value):
            raise CableError(f"{where} must be a finite number, not {value!r}.")
        if name == "delay" and value != int(value):
            raise CableError(f"{where} must be a whole number, not {value!r}.")

    def _made(self, values: Mapping[str, float]) -> Plant:
        nominal = self.nominal
        cables = {}
        for name, cable in nominal.cables.items():
            start = f"{name}."
            own = {
                key[len(start) :]: float(value)
                for key, value in values.items()
                if key.startswith(start)
            }
            cables[name] = _changed(name, cable, own)
            tight = cables[name].pretension
            if "pretension" in own and tight >= self._strength:
                raise CableError(
                    f"the pretension of cable {name!r} cannot be {tight:g} N; it must "
                    f"be below the breaking load of {self._strength:g} N."
                )
        factor = values.get("wearer", 1.0)
        wearer = nominal.wearer
        if factor != 1.0:
            wearer = Wearer(factor * wearer.stiffness, factor * wearer.damping)
        return Plant(
            dict(values),
            cables,
            wearer,
            int(values.get("delay", 0)),
            float(values.get("noise", 0.0)),
        )


def _changed(name: str, cable: Cable, own: dict[str, float]) -> Cable:
    """Return a cable with some parameters changed.

    Raises:
        CableError: If there is no such cable.
    """
    wrap = own.pop("wrap", None)
    if wrap is not None:
        if cable.path != PATHS[0] or not cable.wrap:
            raise CableError(
                f"`wrap` cannot be varied for cable {name!r}: its conduit has no bends "
                "of its own."
            )
        if wrap <= 0.0:
            raise CableError(f"`wrap` of cable {name!r} must be above 0, not {wrap!r}.")
        tighter = wrap / cable.wrap
        try:
            bends = tuple(Section(s.length, s.radius / tighter) for s in cable.conduit)
            cable = cable.replace(conduit=bends)
        except CableError as error:
            raise CableError(
                f"`wrap` of cable {name!r} cannot be {wrap!r} rad: {error}."
            ) from None
    try:
        if "break_away" in own:
            if "static_friction" in own:
                raise CableError("vary `break_away` or `static_friction`, not both")
            kinetic = own.get("friction", cable.friction)
            own["static_friction"] = own.pop("break_away") * kinetic
        if "friction" in own and "static_friction" not in own:
            cable = cable.with_friction(own["friction"])
        return cable.replace(**own) if own else cable
    except CableError as error:
        raise CableError(f"cable {name!r}: {error}.") from None
