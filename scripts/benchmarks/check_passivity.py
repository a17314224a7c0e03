"""Does a controlled joint stay quiet in the hands of the worst passive wearer?

    python scripts/benchmarks/check_passivity.py --jobs 2 --out runs/passivity.csv

The wearer is a spring and a damper to a reference, with inertia added at the joint; he
moves to one side and then holds still. From then on nobody does work but the device.
What it puts into the joint, less what the virtual spring gives back, is energy that a
passive device does not have; a loop that is unstable with this wearer, or has a limit
cycle, moves the joint on and on. The sensors are those of the benchmark, noise and
delay included; the controller knows the cables.

The worst wearer is searched by differential evolution (R. Storn, K. Price,
"Differential evolution", J. Global Optimization 11, 1997) that begins with the corners
of a box and a Latin hypercube in it: 144 wearers a row by default, all rows in 11
minutes of one core. For the source of the box see `export.LIMB_RANGES`. Two
rows are no controllers: `ideal` is the unplugged device with a real spring at its
joint, with which a wearer of little damping swings on by himself; with `motor-off`,
cables and motor are there and nothing is desired.
"""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from scipy.optimize import differential_evolution

from cc_mujoco import export
from cc_mujoco.control import CONTROLLERS
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.report import table

Piece = tuple[str, str, str]
"""Device or `DEVICE.AXIS`, task, controller."""


def search(
    evaluate: Callable[[Array], export.WearerEnergy],
    bounds: Array,
    generations: int = 5,
    crowd: int = 24,
    seed: int = 0,
) -> tuple[Array, export.WearerEnergy]:
    """Search the wearer who receives the most energy while holding still.

    `evaluate` simulates `crowd` wearers at once, at places (wearers, k) within `bounds`
    (k, 2); the first crowd has the corners. Returns all places tried (tried, k), and
    the energies of the wearers there.
    """
    low, high = bounds.T
    first = low + export.first_places(len(bounds), crowd, seed) * (high - low)
    tried: list[Array] = []
    results: list[export.WearerEnergy] = []

    def loss(places: Array) -> Array:
        tried.append(places.T.copy())
        results.append(evaluate(tried[-1]))
        return -results[-1].held

    differential_evolution(
        loss,
        list(zip(low, high, strict=True)),
        init=first,
        maxiter=generations,
        tol=0.0,
        polish=False,
        updating="deferred",
        vectorized=True,
        rng=seed,
    )
    return np.vstack(tried), export.WearerEnergy(
        *(np.concatenate(parts) for parts in zip(*results, strict=True))
    )


def searched(piece: Piece, generations: int, crowd: int) -> list[dict[str, Any]]:
    name, task, law = piece
    scene, _, own = name.partition(".")
    axis = own or None
    inertia = export.inertia_of(scene, axis)

    def played(places: Array) -> export.WearerEnergy:
        limbs = [export.limb_of(place, inertia) for place in places]
        return export.play(scene, law, task, limbs, axis=axis)

    bounds = export.wearer_bounds(scene, axis)
    tried, found = search(played, bounds, generations, crowd)
    limbs = [export.limb_of(place, inertia) for place in tried]
    # A wearer of little damping swings on by himself.
    swings = export.play(scene, "ideal", task, limbs, axis=axis).velocity
    return [
        {
            "scene": name,
            "task": task,
            "controller": law,
            **dataclasses.asdict(limb),
            **{key: float(values[k]) for key, values in found._asdict().items()},
            "velocity_ideal": float(swings[k]),
        }
        for k, limb in enumerate(limbs)
    ]


HEAD = (
    "device", "task", "controller", "energy, held still [mJ]", "into the wearer",
    "from the beginning [mJ]", "velocity left (by himself) [rad/s]", "of the wearer",
)  # fmt: skip
"""Head of the table; energies are the largest of all wearers, the velocity is that
which exceeds most the one that the same wearer has with a real spring."""


LEAST = 0.01  # energy of which a table tells [mJ]


def row(tried: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    """Return a row of the table, over all wearers that were simulated."""
    worst = max(tried, key=lambda one: one["held"])
    fastest = max(tried, key=lambda one: one["velocity"] - one["velocity_ideal"])
    begun = max(one["begun"] for one in tried)
    return (
        worst["scene"], worst["task"], f"`{worst['controller']}`",
        _figure(1e3 * worst["held"]),
        _limb(worst) if 1e3 * worst["held"] >= LEAST else "",
        _figure(1e3 * begun),
        f"{fastest['velocity']:.2f} ({fastest['velocity_ideal']:.2f})",
        _limb(fastest) if fastest["velocity"] >= 0.005 else "",
    )  # fmt: skip


def _figure(energy: float) -> str:
    return f"{float(f'{energy:.2g}'):g}" if energy >= LEAST else f"< {LEAST:g}"


def _limb(one: dict[str, Any]) -> str:
    names = "stiffness", "damping", "inertia"
    return ", ".join(f"{float(f'{one[name]:.2g}'):g}" for name in names)


def main(
    scenes: tuple[Literal[tuple(export.LIMB_RANGES)], ...] = tuple(export.LIMB_RANGES),
    tasks: tuple[Literal[tuple(export.PASSIVITY_TASKS)], ...] = ("spring",),
    controllers: tuple[str, ...] = (*export.PASSIVITY_REFERENCES, *CONTROLLERS),
    generations: int = 5,
    crowd: int = 24,
    jobs: int = 1,
    out: Path | None = None,
) -> None:
    """Search the worst wearers, and print the table.

    Args:
        generations: after the first.
        crowd: wearers in each.
        jobs: processes.
        out: CSV file of all wearers that were tried.
    """
    pieces = [(s, task, law) for s in scenes for task in tasks for law in controllers]
    done = []
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        each = partial(searched, generations=generations, crowd=crowd)
        for tried in pool.map(each, pieces):
            done.append(tried)
            print(*row(tried), sep=" | ", flush=True)
    print()
    print(table(HEAD, [row(tried) for tried in done], (3, 5, 6)))
    print("\nWearers: stiffness [N m/rad], damping [N m s/rad], inertia added [kg m2].")
    if out:
        out.parent.mkdir(parents=True, exist_ok=True)
        tried = [one for each in done for one in each]
        with out.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(tried[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(tried)


if __name__ == "__main__":
    tyro.cli(main)
