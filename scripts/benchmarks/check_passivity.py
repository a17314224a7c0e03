"""Does a controlled joint stay quiet in the hands of the worst passive wearer?

    python scripts/benchmarks/check_passivity.py --jobs 2

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

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Literal

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


def row(piece: Piece, generations: int, crowd: int) -> tuple[str, ...]:
    """Return a row of the table, over all wearers that are simulated."""
    name, task, law = piece
    scene, _, own = name.partition(".")
    axis = own or None
    inertia = export.inertia_of(scene, axis)

    def played(places: Array) -> export.WearerEnergy:
        limbs = [export.limb_of(place, inertia) for place in places]
        return export.play(scene, law, task, limbs, axis=axis)

    bounds = export.wearer_bounds(scene, axis)
    tried, found = search(played, bounds, generations, crowd)
    worst = export.limb_of(tried[np.argmax(found.held)], inertia)
    wearer = ", ".join(
        f"{float(f'{value:.2g}'):g}"
        for value in (worst.stiffness, worst.damping, worst.inertia)
    )
    energies = [_figure(1e3 * float(np.max(e))) for e in (found.held, found.begun)]
    return name, task, f"`{law}`", *energies, wearer


HEAD = (
    "device", "task", "controller", "energy, held still [mJ]",
    "from the beginning [mJ]", "the first into the wearer",
)  # fmt: skip
"""Head of the table; energies are the largest of all wearers."""
LEAST = 0.01  # energy of which a table tells [mJ]


def _figure(energy: float) -> str:
    return f"{float(f'{energy:.2g}'):g}" if energy >= LEAST else f"< {LEAST:g}"


def main(
    scenes: tuple[Literal[tuple(export.LIMB_RANGES)], ...] = tuple(export.LIMB_RANGES),
    tasks: tuple[Literal[tuple(export.PASSIVITY_TASKS)], ...] = ("spring",),
    controllers: tuple[str, ...] = (*export.PASSIVITY_REFERENCES, *CONTROLLERS),
    generations: int = 5,
    crowd: int = 24,
    jobs: int = 1,
) -> None:
    """Search the worst wearers, and print the table.

    Args:
        generations: after the first.
        crowd: wearers in each.
        jobs: processes.
    """
    pieces = [(s, task, law) for s in scenes for task in tasks for law in controllers]
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        each = partial(row, generations=generations, crowd=crowd)
        print(table(HEAD, list(pool.map(each, pieces)), (3, 4)))
    print("\nWearers: stiffness [N m/rad], damping [N m s/rad], inertia added [kg m2].")


if __name__ == "__main__":
    tyro.cli(main)
