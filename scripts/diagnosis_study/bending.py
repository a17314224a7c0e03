"""A bench whose conduits bend while it runs, and sensors of bend and strain along them.

    bench = BendingBench(make_rig(1, make="guides"), {}, 0.001, Elbow.drawn(1))
    bench.advance(0.0, 0.0, 0.0)
    bends, tensions = Taps(1, 0.001).read(bench)

The equations are those of the rig with guides: what changes is the bend of every guide.
Both conduits pass an elbow beside each other; it adds bend to the guides around it. The
length of the conduits stays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from driven import HAND, Array, Bench

from rig.guides import GUIDES
from rig.nominal import Rig

ZONES = 6  # lengths of conduit whose angle a sensor of bend measures, each a sixth
PLACES = (0.0, 0.5, 1.0)  # places of the sensors of tension, over the length of a cable


@dataclass(frozen=True)
class Elbow:
    """Bend that changes the path while the bench runs."""

    begin: float  # begin of the part that bends, over the length
    end: float
    most: float  # bend that it adds at most [rad]
    paces: tuple[float, float]  # two periods in which it goes to and fro [s]
    shares: tuple[float, float]  # shares of both conduits: the inner one bends more

    @classmethod
    def drawn(cls, seed: int, most: float = 2.2) -> Elbow:
        """Return an elbow somewhere in the middle, slow beside the joint's motion."""
        random = np.random.default_rng([seed, 0xE1B])
        middle, width = random.uniform(0.35, 0.65), random.uniform(0.2, 0.4)
        inner = 1.0 + random.uniform(-0.03, 0.03)
        return cls(
            middle - 0.5 * width, middle + 0.5 * width,
            most * random.uniform(0.8, 1.0),
            (random.uniform(6.0, 9.0), random.uniform(3.5, 5.0)),
            (inner, 2.0 - inner),
        )  # fmt: skip

    def bend(self, time: float) -> float:
        """Return what it adds to the bend of a conduit [rad], 0 at first."""
        long, short = (
            0.5 - 0.5 * math.cos(2.0 * math.pi * time / t) for t in self.paces
        )
        return self.most * (0.7 * long + 0.3 * short)


class BendingBench(Bench):
    def __init__(
        self,
        rig: Rig,
        effects: Mapping[str, float],
        period: float,
        elbow: Elbow,
        *,
        hand: tuple[float, float] = HAND,
    ) -> None:
        super().__init__(rig, effects, period, hand=hand)
        self._straight = self.plant.bend.copy()
        self._elbow, self._time = elbow, 0.0
        place = (np.arange(GUIDES) + 0.5) / GUIDES
        inside = (place > elbow.begin) & (place < elbow.end)
        self._where = np.array(elbow.shares)[:, None] * inside / inside.sum()

    def advance(self, torque: float, swing: float, rate: float) -> None:
        self._time += self.period
        added = self._elbow.bend(self._time) * self._where
        self.plant.bend[:] = self._straight + added
        super().advance(torque, swing, rate)

    @property
    def bends(self) -> Array:
        """Bend of every zone of both conduits (2, `ZONES`) [rad]."""
        return self.plant.bend.reshape(2, ZONES, -1).sum(axis=2)

    @property
    def tensions(self) -> Array:
        """Tensions of both cables where the sensors are (2, `PLACES`) [N]."""
        pieces = np.round(np.array(PLACES) * GUIDES).astype(int)
        return self.cables.tension[:, pieces].copy()


class Quality(NamedTuple):
    """Errors of a kind of sensor; each sensor of a bench has its own."""

    noise: float  # standard deviation of every reading
    gain: float  # standard deviation of the error of its gain, relative
    drift: float  # standard deviation of its drift after 10 s, as a random walk


BEND = Quality(0.02, 0.03, 0.03)  # errors of the bend of a zone [rad]
STRAIN = Quality(1.0, 0.02, 1.0)  # errors of a tension [N]


class _Kind:
    def __init__(
        self, random: np.random.Generator, quality: Quality, shape: tuple[int, int],
        period: float,
    ) -> None:  # fmt: skip
        self._random, self._quality, self._shape = random, quality, shape
        self._gain = 1.0 + quality.gain * random.normal(size=shape)
        self._walk = np.zeros(shape)
        self._step = quality.drift * math.sqrt(period / 10.0)

    def read(self, true: Array) -> Array:
        self._walk += self._step * self._random.normal(size=self._shape)
        noise = self._quality.noise * self._random.normal(size=self._shape)
        return np.maximum(self._gain * true + self._walk + noise, 0.0)


class Taps:
    def __init__(
        self, seed: int, period: float, bend: Quality = BEND, strain: Quality = STRAIN
    ) -> None:
        """Draw what is wrong with each; `period` is between two readings [s]."""
        kinds = np.random.default_rng([seed, 0x7A9]).spawn(2)
        self._bend = _Kind(kinds[0], bend, (2, ZONES), period)
        self._strain = _Kind(kinds[1], strain, (2, len(PLACES)), period)

    def read(self, bench: BendingBench) -> tuple[Array, Array]:
        """Return the bends (2, `ZONES`) [rad] and tensions (2, `PLACES`) [N]."""
        return self._bend.read(bench.bends), self._strain.read(bench.tensions)
