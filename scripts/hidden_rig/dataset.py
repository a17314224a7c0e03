"""Data sets with something hidden in them.

    rig = make_rig(seed=3)
    amount = calibrate(rig, "viscous_friction", strength=2.0, trials="rich", seed=3)
    data = make_dataset(rig, {"viscous_friction": amount}, trials="rich", seed=3)

The strength R of what is hidden is the root mean square, over the torques and the
joint's angle, of the change it makes in each over that channel's noise floor.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hidden_rig.effects import EFFECTS, Truth
from hidden_rig.kernel import integrate
from hidden_rig.nominal import Rig
from hidden_rig.plant import plant_of
from hidden_rig.sensors import BASIC, CHANNELS, Chain, logged, sampled
from hidden_rig.trials import SETS, Trial

Array = NDArray[np.float64]

RESPONSES = ("motor_torque", "joint_angle", "joint_torque")
"""Channels whose change counts for the strength."""
_TOLERANCE = 0.05
_ATTEMPTS = 6


def make_trials(trials: str, seed: int) -> list[Trial]:
    """The trials of a set, with the motions that `seed` draws."""
    return SETS[trials](np.random.default_rng([seed, 0x3A1]))


def truth_of(
    rig: Rig, effects: Mapping[str, float], seed: int, nodes: int = 12
) -> Truth:
    """The rig with effects hidden in it; an amount of 0 hides nothing.

    Args:
        rig: the rig.
        effects: amount by id, see `EFFECTS`.
        seed: of what else an effect draws.
        nodes: massive nodes per cable.
    """
    truth = Truth(plant_of(rig, nodes), Chain())
    for name, amount in effects.items():
        if amount != 0.0:
            rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
            truth = EFFECTS[name].hide(truth, amount, rng)
    return truth


def run(truth: Truth, rig: Rig, trial: Trial, refine: int = 1) -> Array:
    """Records of one trial, see `kernel.integrate`."""
    out: Array = integrate(
        truth.plant,
        rig.pretension * trial.tightness,
        np.array(trial.servo),
        np.array(trial.environment),
        trial.command,
        trial.target,
        refine,
    )
    return out


def clean_dataset(
    rig: Rig,
    effects: Mapping[str, float],
    trials: str,
    seed: int,
    *,
    names: tuple[str, ...] = BASIC,
    every: int = 1,
) -> list[Array]:
    """What a logger without noise would store: (samples, names) per trial."""
    truth = truth_of(rig, effects, seed)
    return [
        sampled(run(truth, rig, trial), rig, truth.chain, names)
        for trial in make_trials(trials, seed)[::every]
    ]


def make_dataset(
    rig: Rig,
    effects: Mapping[str, float],
    trials: str = "rich",
    seed: int = 0,
    *,
    tensions: bool = False,
) -> list[dict[str, Array]]:
    """The recorded trials of one session.

    Args:
        rig: the rig, see `make_rig`.
        effects: amount by id, see `EFFECTS`; empty hides nothing.
        trials: `rich`, `ramps` or `human`.
        seed: of motions, noise and what effects draw; not of the rig.
        tensions: whether the four end tensions are recorded too.

    Returns:
        One dict of columns per trial, 500 Hz, see `sensors.CHANNELS`.
    """
    names = tuple(CHANNELS) if tensions else BASIC
    clean = clean_dataset(rig, effects, trials, seed, names=names)
    return [
        logged(signals, names, [seed, rig.seed, k]) for k, signals in enumerate(clean)
    ]


def change(changed: list[Array], plain: list[Array]) -> dict[str, float]:
    """RMS change of each response over its noise floor, clean data of `BASIC`."""
    moved = np.concatenate(changed) - np.concatenate(plain)
    rms = np.sqrt(np.mean(moved**2, axis=0))
    return {
        name: float(rms[BASIC.index(name)] / CHANNELS[name].floor) for name in RESPONSES
    }


def strength_of(by_channel: Mapping[str, float]) -> float:
    """R: root mean square over the responses."""
    return math.sqrt(np.mean([value**2 for value in by_channel.values()]))


@lru_cache(maxsize=4)
def _plain(rig: Rig, trials: str, seed: int, every: int) -> list[Array]:
    return clean_dataset(rig, {}, trials, seed, every=every)


def measure(
    rig: Rig, effects: Mapping[str, float], trials: str, seed: int, every: int = 1
) -> dict[str, float]:
    """Change of each response that the effects cause at the same commands."""
    changed = clean_dataset(rig, effects, trials, seed, every=every)
    return change(changed, _plain(rig, trials, seed, every))


def calibrate(
    rig: Rig, effect: str, strength: float, trials: str = "rich", seed: int = 0
) -> float:
    """The amount of an effect that gives it a strength.

    Secants in the logarithms, over every second trial. Stops at the effect's limit, so
    the strength reached may be less than asked.
    """
    if strength == 0.0:
        return 0.0
    entry = EFFECTS[effect]
    seen: list[tuple[float, float]] = []
    amount = entry.typical
    for _ in range(_ATTEMPTS):
        reached = strength_of(measure(rig, {effect: amount}, trials, seed, every=2))
        seen.append((math.log(amount), math.log(max(reached, 1e-9))))
        missing = math.log(strength) - seen[-1][1]
        if abs(missing) < _TOLERANCE or (amount == entry.limit and missing > 0):
            break
        slope = 1.0
        if len(seen) > 1:
            (x0, y0), (x1, y1) = seen[-2:]
            slope = (y1 - y0) / (x1 - x0) if x1 != x0 else 1.0
        slope = min(max(slope, 0.3), 3.0)
        amount = min(math.exp(seen[-1][0] + missing / slope), entry.limit)
    return amount
