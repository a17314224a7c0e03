"""Ranges from which the plants of episodes are drawn.

    ranges = Ranges({"friction": (0.05, 0.2), "delay": (0, 3)}, device)
    ranges.draw(rng, {"delay": 2})
    Ranges({"bristle_length": (1e-3, 1e-2, 0.3)}, device)   # in 30 % of the episodes

Controllers are not informed: `drive` stays that of the scene.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cc_mujoco._validation import require_dictionary, require_number
from cc_mujoco.device import IN_EPISODES, Nominal, Plant
from cc_mujoco.device._variables import DELAY, OF_CABLES, find
from cc_mujoco.errors import CableError

Range = tuple[float, float]


class Ranges:
    """Ranges from which plants are drawn.

    Every cable has draws of its own. What is above 0 is drawn with a uniform logarithm,
    whole numbers and what may be 0 uniformly. What has a probability is drawn with it
    for all cables, or is the scene's in all.
    """

    def __init__(self, given: Mapping[str, Any] | None, device: Nominal) -> None:
        """Check the ranges.

        `given` are (least, most), or (least, most, probability) of being drawn at all,
        by name of `device.IN_EPISODES`: of all cables (`friction`) or of one
        (`flexor.friction`).
        """
        self.nominal = Plant(device)
        """The scene as it is."""
        self._ranges: dict[str, Range] = {}
        self._probabilities: dict[str, float] = {}
        for name, ends in require_dictionary("randomise", given).items():
            try:
                if isinstance(ends, str):
                    raise TypeError
                low, high, *rest = ends
                (probability,) = rest or (1.0,)
            except (TypeError, ValueError):
                raise CableError(
                    f"randomise[{name!r}] must be (least, most), or (least, most, "
                    f"probability), not {ends!r}."
                ) from None
            require_number(f"randomise[{name!r}][2]", probability, 0.0, 1.0, "")
            for end in (low, high):
                self._check("randomise", name, end)
            if low > high:
                raise CableError(
                    f"randomise[{name!r}] must be (least, most), the lower number "
                    f"first, not {ends!r}."
                )
            for own in self._each(name):
                self._ranges[own] = low, high
                self._probabilities[own] = probability
        # Parameters may exclude each other: all corners of each cable must be possible.
        for cable in device.cables:
            mine = [n for n in self._ranges if n.startswith(f"{cable}.")]
            for corner in itertools.product((0, 1), repeat=min(len(mine), 8)):
                ends = zip(mine, corner, strict=False)
                Plant(device, {name: self._ranges[name][end] for name, end in ends})

    @property
    def any(self) -> bool:
        return bool(self._ranges)

    @property
    def varied(self) -> tuple[str, ...]:
        """Names of the drawn variables, `CABLE.NAME` for one of a cable."""
        return tuple(self._ranges)

    def draw(self, rng: np.random.Generator, given: Mapping[str, Any] | None) -> Plant:
        values: dict[str, float] = {}
        tosses: dict[str, float] = {}
        for name, (low, high) in self._ranges.items():
            if (probability := self._probabilities[name]) < 1.0:
                of_all = name.rpartition(".")[2]
                if of_all not in tosses:
                    tosses[of_all] = rng.uniform()
                if tosses[of_all] >= probability:
                    continue
            if name == DELAY.name:
                values[name] = int(rng.integers(int(low), int(high), endpoint=True))
            elif low > 0.0:
                values[name] = float(np.exp(rng.uniform(math.log(low), math.log(high))))
                values[name] = min(max(values[name], low), high)
            else:
                values[name] = float(rng.uniform(low, high))
        # A value for one cable takes precedence over one for all.
        said = require_dictionary("options", given)
        for name in sorted(said, key=lambda name: "." in name):
            value = said[name]
            self._check("options", name, value)
            values |= dict.fromkeys(self._each(name), value)
        return Plant(self.nominal.device, values) if values else self.nominal

    def _each(self, name: str) -> tuple[str, ...]:
        """Return the names of a variation; one of all cables gives a name per cable."""
        if "." in name or name not in OF_CABLES:
            return (name,)
        return tuple(f"{cable}.{name}" for cable in self.nominal.cables)

    def _check(self, where: str, name: str, value: Any) -> None:
        variable = find(name, self.nominal.cables, among=IN_EPISODES, kind="variation")
        variable.check(value, f"{where}[{name!r}]")
