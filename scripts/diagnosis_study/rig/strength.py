"""Strength of a hidden effect, and the amount of it that has a given strength.

The strength R measures the change of the torques and the joint's angle by an effect at
the same commands: the root mean square over these channels of the RMS change over the
noise floor. `raw` is R without tuning. `refit` is R after a rig without the effect has
been tuned to the data (friction, stiffness, pretension, sensor offsets and the clock of
the joint's card, each within plausible bounds) by least squares in two Gauss-Newton
steps.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from cc_mujoco.native import FloatArray as Array
from rig.dataset import make_trials, run, truth_of
from rig.makes import MAKES, Truth
from rig.nominal import Rig
from rig.sensors import SAMPLE_RATE, sampled

RESPONSES = ("motor_torque", "joint_angle", "joint_torque")
"""Channels over which the strength is computed."""

LOOKED_AT = {
    "rich": (0, 2, 3, 5, 6),
    "restful": (0, 2, 3, 5, 6),
    "ramps": (0, 3, 5),
    "human": (0, 1, 3),
}
"""Indices of representative trials of each set, to save time."""


class Tuned(NamedTuple):
    """Constants of the rig that the experimenter fits as one, and its bounds."""

    names: tuple[str, ...]
    step: float  # step of the difference quotient
    bound: float  # largest plausible change
    mechanical: bool = False  # scaled, and the motion changes with it; else shifted

    def change(self, rig: Rig, x: float) -> Rig:
        now = {name: getattr(rig, name) for name in self.names}
        changed = {
            name: math.exp(x) * value if self.mechanical else value + x
            for name, value in now.items()
        }
        return dataclasses.replace(rig, **changed)


TUNED = (
    Tuned(("friction_a", "friction_b"), 0.02, 0.7, True),
    Tuned(("axial_stiffness",), 0.02, 0.7, True),
    Tuned(("pretension",), 0.01, 0.1, True),
    Tuned(("joint_clock_offset",), 2e-4, 1 / SAMPLE_RATE),
    Tuned(("motor_torque_offset",), 0.02, 0.05),
    Tuned(("joint_torque_offset",), 0.02, 0.05),
    Tuned(("joint_angle_offset",), 0.002, 0.01),
)


def _simulated(
    rig: Rig, effects: Mapping[str, float], trials: str, seed: int
) -> tuple[Truth, list[Array]]:
    """Return the truth and the records of the trials that are evaluated."""
    truth = truth_of(rig, effects, seed)
    every = make_trials(trials, seed)
    return truth, [
        run(truth, rig, every[k]) for k in LOOKED_AT[trials.removesuffix("_standard")]
    ]


def _responses(rig: Rig, truth: Truth, records: list[Array]) -> Array:
    """Return the readings of records over their noise floors, (samples, 3)."""
    channels = MAKES[rig.make].chain_of(rig).channels()
    floors = np.array([channels[name].floor for name in RESPONSES])
    seen = [sampled(record, rig, truth.chain, RESPONSES) for record in records]
    return np.asarray(np.concatenate(seen) / floors)


@lru_cache(maxsize=2)
def _plain(rig: Rig, trials: str, seed: int) -> tuple[Truth, list[Array], Array]:
    truth, records = _simulated(rig, {}, trials, seed)
    return truth, records, _responses(rig, truth, records)


@lru_cache(maxsize=2)
def _tangents(rig: Rig, trials: str, seed: int) -> Array:
    """Change of the responses per change of each tuned constant, (3 samples, 7)."""
    truth, records, plain = _plain(rig, trials, seed)
    columns = []
    for tuned in TUNED:
        nudged = tuned.change(rig, tuned.step)
        if tuned.mechanical:
            moved = _responses(nudged, *_simulated(nudged, {}, trials, seed))
        else:
            moved = _responses(nudged, truth, records)
        columns.append((moved - plain).ravel() / tuned.step)
    return np.stack(columns, axis=1)


def forget() -> None:
    """Clear cached rigs, as required after a change of `LOOKED_AT`."""
    _plain.cache_clear()
    _tangents.cache_clear()


def _left_over(rig: Rig, change: Array, trials: str, seed: int) -> Array:
    """Return the residual of a change after the plain rig has been tuned to it."""
    bounds = np.array([tuned.bound for tuned in TUNED])
    # Unit bounds, so that no constant is favoured by its unit.
    scaled = _tangents(rig, trials, seed) * bounds
    found = lsq_linear(scaled, change.ravel(), bounds=(-1, 1)).x
    refit = rig
    for tuned, x in zip(TUNED, found * bounds, strict=True):
        refit = tuned.change(refit, float(x))
    tuned_to = _responses(refit, *_simulated(refit, {}, trials, seed))
    left = change - (tuned_to - _plain(rig, trials, seed)[2])
    room = (-1.001 - found, 1.001 - found)
    more = lsq_linear(scaled, left.ravel(), bounds=room).x
    return np.asarray(left - (scaled @ more).reshape(left.shape))


class Strength(NamedTuple):
    raw: float
    refit: float


def measure(
    rig: Rig, effects: Mapping[str, float], trials: str = "rich", seed: int = 0
) -> Strength:
    """Return the strength of effects (amounts by id), in the trials of `LOOKED_AT`."""
    changed = _responses(rig, *_simulated(rig, effects, trials, seed))
    change = changed - _plain(rig, trials, seed)[2]
    left = _left_over(rig, change, trials, seed)
    return Strength(math.sqrt(np.mean(change**2)), math.sqrt(np.mean(left**2)))


def calibrate(
    rig: Rig, effect: str, strength: float, trials: str = "rich", seed: int = 0
) -> float:
    """Return the amount of an effect whose strength R after refit is `strength`.

    The secant method in logarithms finds it. It stops at the effect's limit, so the
    strength may be lower than requested.
    """
    if strength == 0.0:
        return 0.0
    hidden = MAKES[rig.make].effects[effect]
    limit, x = hidden.limit, math.log(hidden.typical)
    last: tuple[float, float] | None = None
    for _ in range(6):
        reached = measure(rig, {effect: math.exp(x)}, trials, seed).refit
        y = math.log(max(reached, 1e-6))
        missing = math.log(strength) - y
        at_limit = x >= math.log(limit) and missing > 0
        if abs(missing) < 0.05 or at_limit:
            break
        slope = 1.0 if last is None or last[0] == x else (y - last[1]) / (x - last[0])
        last = (x, y)
        x = min(x + missing / min(max(slope, 0.4), 2.5), math.log(limit))
    return math.exp(x)
