"""Timing of contestants by turns in one process, so that other load affects all alike.

from turns import by_turns, spread
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cc_mujoco.native import FloatArray as Array


def by_turns(
    contestants: Mapping[Any, Callable[[], float]], rounds: int, first: int = 0
) -> dict[Any, Array]:
    """Return the costs (rounds,) of each contestant, after `first` uncounted rounds."""
    found: dict[Any, list[float]] = {name: [] for name in contestants}
    for _ in range(first + rounds):
        for name, turn in contestants.items():
            found[name].append(turn())
    return {name: np.array(costs[first:]) for name, costs in found.items()}


def spread(ratios: Array) -> str:
    low, middle, high = np.quantile(ratios, (0.25, 0.5, 0.75))
    return f"{middle:.2f} ({low:.2f} to {high:.2f})"
