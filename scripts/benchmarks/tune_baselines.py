"""Search the free numbers of the baselines that are best over many devices.

    python scripts/benchmarks/tune_baselines.py --controllers pi_tuned lqg

Multiplies one number after another by a factor, keeps what lowers the score, and prints
the score of each, with chatter. The score is the RMS torque error, the worst of the
seeds, over that with today's numbers: the geometric mean over conditions of suite `v2`
and `noise-loud`, of all devices. One set of numbers serves them all, so that a device
of one's own gets it, too. No table uses the seeds.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib
from functools import reduce
from typing import Any

import numpy as np

from cc_mujoco.benchmark import SUITES, Cell, Condition, play
from cc_mujoco.native import FloatArray

SEEDS = 40, 41, 42, 43, 44, 45
"""Development seeds of suite `v2`."""
SCENES = "wrist", "ankle", "finger", "exosuit"
STRUCTURES = "presliding", "rotor-inertia", "late-commands", "wrap-end"
"""Conditions of suite `v2`, beside `noise-loud`."""
DURATION = 1.6
"""Length of an episode [s]."""
FACTORS = 0.5, 2.0
"""Factors of a number that are tried."""
SCORES = "rms_torque_error", "chatter"
_LOOP = "tuned_feedback._DELAY_SHARE", "tuned_feedback._INTEGRAL_SHARE"
_FORWARD = "tuned_feedback.FrictionFeedForward"
NUMBERS = {
    "pi_tuned": (*_LOOP, "tuned_feedback._DEAD_SIGMAS"),
    "pi_feed_forward": (f"{_FORWARD}.friction_share", f"{_FORWARD}.slip_speed"),
    "lqg": ("gaussian._EFFORT", "gaussian._LOAD_WALK", "gaussian._LACK_WALK"),
    "inverse": (
        "backlash_inverse._DELAY_SHARE",
        "backlash_inverse._MAX_BANDWIDTH",
        "backlash_inverse._INTEGRAL_SHARE",
        "backlash_inverse._BAND_SIGMAS",
    ),
}
"""Free numbers of each baseline, and where they are in `cc_mujoco.control`."""


def conditions(scene: str) -> list[Condition]:
    """Return the conditions of a device that count."""
    found = [
        *(one for one in SUITES["v2"].conditions(scene) if one.structure in STRUCTURES),
        *(c for c in SUITES["generic"].conditions(scene) if c.name == "noise-loud"),
    ]
    return [dataclasses.replace(one, duration=DURATION) for one in found]


def scores(law: str, wanted: list[Condition]) -> FloatArray:
    """Return `SCORES` in every condition (2, conditions); infinite if one fails."""
    found = np.empty((len(SCORES), len(wanted)))
    for n, condition in enumerate(wanted):
        played = play(Cell(condition, law, SEEDS)).scores
        lost = bool(np.any(played["failed"]))
        found[:, n] = [np.inf if lost else np.max(played[name]) for name in SCORES]
    return found


def place(number: str) -> tuple[Any, str]:
    """Return the object that has a number, and its name there."""
    module, *inner, name = number.split(".")
    owner = importlib.import_module(f"cc_mujoco.control._{module}")
    return reduce(getattr, inner, owner), name


def tune(law: str, wanted: list[Condition]) -> None:
    """Print the numbers of a baseline that are tried, and those that are best."""
    start = scores(law, wanted)

    def over(found: FloatArray) -> FloatArray:
        means: FloatArray = np.exp(np.mean(np.log(found / start), axis=1))
        return means

    best, least = {}, 1.0
    for number in NUMBERS[law]:
        owner, name = place(number)
        kept = first = getattr(owner, name)
        for factor in FACTORS:
            setattr(owner, name, factor * first)
            error, chatter = over(scores(law, wanted))
            print(
                f"{law:16} {number:48} {factor * first:8.3g} {error:.3f} {chatter:.2f}",
                flush=True,
            )
            if error < least:
                kept, least = factor * first, error
        setattr(owner, name, kept)
        best[number] = kept
    print(f"{law}: {least:.3f} with {best}", flush=True)


def main() -> None:
    """Tune every baseline that is named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--controllers", nargs="+", choices=NUMBERS, default=list(NUMBERS)
    )
    options = parser.parse_args()
    wanted = [condition for scene in SCENES for condition in conditions(scene)]
    for law in options.controllers:
        tune(law, wanted)


if __name__ == "__main__":
    main()
