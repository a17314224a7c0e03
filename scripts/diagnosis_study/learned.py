"""Policies that learnt on a simulated bench, on rigs that they do not know.

    python scripts/train_policy.py --scene bench --algorithm sac --out runs/bench
    python scripts/imitate.py --scene bench --hold 1 --out runs/one
    python scripts/diagnosis_study/learned.py --out runs/learned \
        --controllers pi stiction predictive runs/bench/0.safetensors runs/one/0...

Rigs by other equations (`driven.py`), each off the scene by a few percent, hide one
effect each at the amount that is typical of it in the study. A controller that knows
only the scene `bench`, or learnt on it, plays the task of `closed_loop.py` (two sines
of torque while a hand swings the joint loosely) as it does there, policies once in the
period of their training. Errors are of the torque that the joint truly got; chatter is
the RMS of the motor's torque less its mean over 50 ms. Tasks that are done are kept.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from closed_loop import FRICTION, LIMITS, PERIOD, SECONDS, SETTLED, rougher, task
from driven import Array, Bench, Commands, Lockstep, errors, play, rms
from kept_cases import complete

from cc_mujoco.control import Controller, controller, read_policy
from cc_mujoco.errors import CableError
from cc_mujoco.hardware import drive_of
from cc_mujoco.report import table
from rig.makes import MAKES
from rig.nominal import Rig, make_rig

NOISE = 0.025  # noise of the joint's torque sensor, as its data sheet has it [N m]
EFFECTS = (
    "none", FRICTION, "viscous_friction", "load_independent_friction",
    "stribeck_friction", "presliding", "asymmetric_friction", "end_compliance",
    "configuration_dependent_wrap", "friction_drift",
)  # fmt: skip
MORE = 1.4  # factor of friction where that is what is hidden


def built(effect: str, seed: int) -> tuple[Rig, dict[str, float]]:
    """Return a rig with a hidden effect, and the effect's amount by id."""
    rig = make_rig(seed, make="guides")
    if effect == FRICTION:
        return rougher(rig, MORE), {}
    if effect == "none":
        return rig, {}
    return rig, {effect: MAKES[rig.make].effects[effect].typical}


def law_of(name: str) -> Controller:
    """Return a controller by name, or a policy by its file."""
    drive = drive_of("bench", Path(), PERIOD, LIMITS.torque)
    drive = dataclasses.replace(drive, torque_noise=NOISE)
    if Path(name).suffix == ".safetensors":
        (observed,) = read_policy(name)[1]
        if observed.device != "bench":
            raise CableError(
                f"policy {name!r} learnt on the device {observed.device}, not on the "
                "bench: python scripts/train_policy.py --scene bench."
            )
        drive = dataclasses.replace(drive, observed=observed, period=observed.period)
    return controller(name, drive)


def played(name: str, effect: str, seed: int) -> dict[str, Any]:
    """Play the task; return RMS error, chatter and motor peak [N m], and outcome."""
    desired, swing = task()
    law = law_of(name)
    period = law.drive.period
    bench = Bench(*built(effect, seed), period)
    lockstep, rows = Lockstep(bench, seed, swing), Commands()
    outcome = play(lockstep, law, desired, LIMITS, SECONDS, rows)
    whole = outcome.code == 0
    off = errors(lockstep, desired, SECONDS, SETTLED)
    return {
        "controller": name,
        "effect": effect,
        "seed": seed,
        "rms": rms(off) if whole else math.nan,
        "chatter": chatter(np.array(rows.torques), period) if whole else math.nan,
        "peak": float(np.max(np.abs(rows.torques))) if whole else math.nan,
        "outcome": outcome.sentence,
    }


def chatter(torques: Array, period: float) -> float:
    """Return the RMS of torques less their mean over 50 ms, after settling [N m]."""
    width = round(0.05 / period)
    mean = np.convolve(torques, np.ones(width) / width, "same")
    begin, end = round(SETTLED / period), round(SECONDS / period) - width
    return rms((torques - mean)[begin:end])


def summary(records: list[Mapping[str, Any]], names: Sequence[str]) -> str:
    """Return means over seeds as a Markdown table [mN m], a row per hidden effect."""
    effects = list(dict.fromkeys(r["effect"] for r in records))
    rows = [
        (effect.replace("_", " "), *(cell(records, n, "rms", effect) for n in names))
        for effect in effects
    ]
    for key, what in (("rms", "mean"), ("chatter", "chatter"), ("peak", "peak")):
        rows.append((what, *(cell(records, name, key) for name in names)))
    short = [
        f"{Path(n).parent.name}/{Path(n).stem}" if "/" in n else f"`{n}`" for n in names
    ]
    return table(("hidden", *short), rows)


def cell(
    records: list[Mapping[str, Any]], name: str, key: str, effect: str | None = None
) -> str:
    """Return the mean [mN m] over finished runs, and the number of others."""
    mine = [r for r in records if r["controller"] == name]
    found = [1e3 * r[key] for r in mine if effect in (None, r["effect"])]
    there = [x for x in found if math.isfinite(x)]
    mean = f"{np.mean(there):.0f}" if there else "-"
    lost = len(found) - len(there)
    return f"{mean} ({lost} of {len(found)} stopped)" if lost else mean


def main(
    controllers: tuple[str, ...],
    effects: tuple[Literal[EFFECTS], ...] = EFFECTS,
    seeds: tuple[int, ...] = (1, 2),
    out: Path = Path("runs", "learned"),
) -> None:
    try:
        for name in controllers:
            law_of(name)
    except CableError as error:
        raise SystemExit(f"--controllers: {error}") from None
    cases = [(n, effect, s) for s in seeds for effect in effects for n in controllers]
    table = partial(summary, names=controllers)
    complete(out, ("controller", "effect", "seed"), cases, played, table)


if __name__ == "__main__":
    tyro.cli(main)
