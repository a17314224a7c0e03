"""Time of a controller for a step of one device, on this machine."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.benchmark import _user_entry as user_entry
from cc_mujoco.benchmark._cell import Cell, prepare_episodes
from cc_mujoco.simulation._loop import run

TIMED_DURATION = 1.1
"""Length of the episode that is timed [s]; what is compiled has been before."""


class StepTimes(NamedTuple):
    """Times of a call of `Controller.torque` with the numbers of one device.

    It is time of the processor, so that other work on the machine does not count.
    """

    median: float
    """[s]."""
    worst: float
    """[s]."""


def time_steps(cell: Cell) -> StepTimes:
    """Time the steps of a cell's controller, for the first seed of its condition."""
    short = dataclasses.replace(cell.condition, duration=TIMED_DURATION)
    made = prepare_episodes(
        [dataclasses.replace(cell, condition=short, seeds=cell.seeds[:1])]
    )
    law = user_entry.make_controller(cell.controller, made.drives, made.batch.prefixes)
    law.reset()
    taken: list[float] = []

    def timed(seen: Mapping[str, Any]) -> Mapping[str, Any]:
        one = {n: v[0] if v.ndim > 1 else float(v[0]) for n, v in seen.items()}
        begun = time.thread_time()
        law.torque(one)
        spent = time.thread_time() - begun
        # Not the time that it takes to ask the process of an entry.
        taken.append(law.spent if isinstance(law, user_entry.Entry) else spent)
        return seen

    with np.errstate(all="ignore"):
        run(
            made.batch,
            made.law,
            _ignore_step,
            measure=lambda columns: timed(made.sensors.measure(columns)),
            name=cell.controller,
        )
    # The first calls fill caches.
    counted = np.array(taken[round(len(taken) / 3) :])
    return StepTimes(float(np.median(counted)), float(np.max(counted)))


def _ignore_step(step: int, columns: Mapping[str, Any], _: NDArray[np.float64]) -> None:
    """Observe nothing."""
