"""Value of a self-tuning model while the path of the cable changes.

    python scripts/diagnosis_study/self_tuning.py --out runs/self_tuning

The next step of the thesis's section 5.3. The rig with guides, in which an elbow adds
up to 2.2 rad to the bend of the guides around it while a wearer leads the joint,
follows two sines of torque, through the loop of `cc-mujoco run`, in lockstep at 1 kHz.
The controller is `predictive` with the nominal `bench` for a model; it knows no more,
or learns friction by its motor, or has sensors of bend or of tension, all of them with
noise, wrong gains and drift. In one world only the path changes, in the other friction
drifts as well. Errors are of the torque that the joint truly got. Tasks that are done
are kept.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import tyro
from controlled import NOISE, measured, summary
from driven import HAND, Array, Bench, Lockstep, Swing
from kept_cases import complete

from cc_mujoco.control import (
    AdaptiveModel,
    Controller,
    PredictiveCompensation,
    controller,
)
from cc_mujoco.device import TENSION_COLUMN, Drive, Sensors
from cc_mujoco.hardware import Limits, TorqueTable, drive_of
from cc_mujoco.report import table
from rig.guides import GUIDES
from rig.nominal import Rig, make_rig

ZONES = 6  # lengths of conduit whose angle a sensor of bend measures, each a sixth
PLACES = (0.0, 0.5, 1.0)  # places of the sensors of tension, over the length of a cable


@dataclasses.dataclass(frozen=True)
class Elbow:
    """A bend of the route that changes during a run of the bench."""

    begin: float  # begin of the part that bends, over the length
    end: float
    most: float  # bend that it adds at most [rad]
    paces: tuple[float, float]  # two periods in which it goes to and fro [s]
    shares: tuple[float, float]  # shares of both conduits: the inner one bends more

    @classmethod
    def drawn(cls, seed: int, most: float = 2.2) -> Elbow:
        """Return a random elbow near the middle, slow beside the joint's motion."""
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
        """Return the bend that the elbow adds to a conduit [rad], 0 at the start."""
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
        """Tensions of both cables at the tension sensors (2, `PLACES`) [N]."""
        pieces = np.round(np.array(PLACES) * GUIDES).astype(int)
        return self.cables.tension[:, pieces].copy()


class Quality(NamedTuple):
    """Errors of a kind of sensor; each single sensor draws its own."""

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
        """Return read bends (2, `ZONES`) [rad] and tensions (2, `PLACES`) [N]."""
        return self._bend.read(bench.bends), self._strain.read(bench.tensions)


PERIOD = 0.001
SECONDS, SETTLED = 20.0, 2.0
"""Length of a task, and time from which its error counts [s]."""
LIMITS = Limits(
    torque=10.0, torque_rate=2e4, motor_speed=60.0, joint_range=(-2.5, 2.5),
    soft_start=0.5,
)  # fmt: skip
SETTINGS = {"rotor": 1500.0, "motion": 100.0, "latest": 0.003}
"""Settings of the controller, chosen on seeds 1 to 5 against limit cycles of 40 Hz: the
rotor is light, and the joint's encoder noisy."""
EVERY, CUTOFF = 10, 3.0
"""Periods between two paths that the model takes over; low-pass before [Hz]."""
WORLDS: dict[str, dict[str, float]] = {
    "path": {},
    "path and friction": {"friction_drift": 0.5},
}
"""Changes in the rig; friction over travel, by up to half, up or down by seed."""
VARIANTS = ("pi", "fixed", "motor", "bend", "strain", "bend+motor", "bend+strain")
"""Equipment of the controller: no model; a model that stays as it is, or learns
friction by the motor, or has sensors of bend or of tension, or two of these."""
SEEDS = tuple(range(11, 21))


class Equipped(Controller):
    """A controller with sensors along the cables, which may tell its model the path."""

    def __init__(
        self, law: Controller, bench: BendingBench, taps: Taps, senses_bend: bool
    ) -> None:
        super().__init__(law.drive)
        self._law, self._bench, self._taps = law, bench, taps
        self._senses_bend = senses_bend
        self.reset()

    def reset(self, where: Any = None) -> None:
        self._law.reset(where)
        self._calls = 0
        self._bends = self._taps.read(self._bench)[0]

    def torque(self, observation: Mapping[str, Any]) -> Any:
        bends, tensions = self._taps.read(self._bench)
        share = -math.expm1(-2.0 * math.pi * CUTOFF * PERIOD)
        self._bends += share * (bends - self._bends)
        law = self._law
        due = self._senses_bend and self._calls % EVERY == 0
        if due and isinstance(law, PredictiveCompensation):
            cables = (own.cable for own in self.drive.cables)
            law.rebend(
                [
                    along(bend, cable.segments)
                    for bend, cable in zip(self._bends, cables, strict=True)
                ]
            )
        self._calls += 1
        return law.torque({**observation, TENSION_COLUMN: tensions})


def along(bends: Array, segments: int) -> Array:
    """Return wrap angles of segments from those of equal lengths of conduit [rad]."""
    edges = np.linspace(0.0, 1.0, bends.size + 1)
    sums = np.concatenate([[0.0], np.cumsum(bends)])
    return np.diff(np.interp(np.linspace(0.0, 1.0, segments + 1), edges, sums))


def equipped(name: str, drive: Drive, bench: BendingBench, seed: int) -> Equipped:
    law: Controller
    if name == "pi":
        law = controller("pi", drive)
    elif "strain" in name:
        sensors = tuple(
            Sensors.at(cable, [part * cable.length for part in PLACES], STRAIN.noise)
            for cable in (own.cable for own in drive.cables)
        )
        law = AdaptiveModel(dataclasses.replace(drive, sensors=sensors), **SETTINGS)
    else:
        learning = 5.0 if "motor" in name else 0.0
        law = PredictiveCompensation(drive, learning=learning, **SETTINGS)
    return Equipped(law, bench, Taps(seed, PERIOD), "bend" in name)


def task(seed: int) -> tuple[TorqueTable, Swing]:
    """Return desired torque and wearer's motion, each two sines of random phase."""
    random = np.random.default_rng([seed, 0x7A5])
    first, second, third, fourth = random.uniform(0.0, 2.0 * math.pi, 4)
    times = np.arange(0.0, SECONDS, 0.002)
    torques = 1.5 * np.sin(2.2 * times + first) + 0.8 * np.sin(5.65 * times + second)

    def swing(now: float) -> tuple[float, float]:
        size = min(1.0, now)
        a, b = math.pi * now + third, 4.4 * now + fourth
        return (
            size * (0.3 * math.sin(a) + 0.1 * math.sin(b)),
            size * (0.3 * math.pi * math.cos(a) + 0.44 * math.cos(b)),
        )

    return TorqueTable(times, torques), swing


def played(name: str, world: str, seed: int) -> dict[str, Any]:
    """Play a task; return errors, chatter and motor peak [N m], and the outcome."""
    desired, swing = task(seed)
    bench = BendingBench(
        make_rig(seed, make="guides"), WORLDS[world], PERIOD, Elbow.drawn(seed),
        hand=(200.0, 5.0),
    )  # fmt: skip
    drive = drive_of("bench", Path(), PERIOD, LIMITS.torque)
    drive = dataclasses.replace(drive, torque_noise=NOISE)
    law = equipped(name, drive, bench, seed)
    lockstep, times = Lockstep(bench, seed, swing), (SECONDS, SETTLED)
    found = measured(law, lockstep, desired, LIMITS, times)
    return {"controller": name, "effect": world, "seed": seed, **found}


def over_fixed(records: Sequence[Mapping[str, Any]], world: str, name: str) -> str:
    """Return the geometric mean, over seeds, of the error over that of `fixed`.

    Only seeds that both finished count; "-" without one.
    """
    errors = {
        (r["controller"], r["seed"]): math.log(r["rms"])
        for r in records
        if r["effect"] == world and math.isfinite(r["rms"])
    }
    ratios = [
        error - errors["fixed", seed]
        for (variant, seed), error in errors.items()
        if variant == name and ("fixed", seed) in errors
    ]
    return f"{math.exp(np.mean(ratios)):.2f}" if ratios else "-"


def compared(records: list[Mapping[str, Any]], names: Sequence[str]) -> str:
    """Return a table of means, and one of errors over those of a fixed model."""
    rows = [
        (world, *(over_fixed(records, world, name) for name in names))
        for world in WORLDS
    ]
    over = table(("error over `fixed`", *names), rows)
    return f"{summary(records, names)}\n\n{over}"


def main(
    seeds: tuple[int, ...] = SEEDS,
    variants: tuple[Literal[VARIANTS], ...] = VARIANTS,
    out: Path = Path("runs", "self_tuning"),
) -> None:
    cases = [(n, world, seed) for seed in seeds for world in WORLDS for n in variants]
    shown = partial(compared, names=variants)
    complete(out, ("controller", "effect", "seed"), cases, played, shown)


if __name__ == "__main__":
    warnings.filterwarnings("ignore")
    tyro.cli(main)
