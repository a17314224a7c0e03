"""Which designs are best: objectives, the Pareto set, an order of all."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cc_mujoco.errors import CableError, look_up
from cc_mujoco.whatif.metrics import METRICS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Objective:
    """A metric that should be high, or low."""

    name: str
    high: bool

    @property
    def text(self) -> str:
        """For a reader."""
        return f"{self.name} ({'high' if self.high else 'low'})"


def read_objectives(
    texts: Iterable[str], measured: Sequence[str]
) -> tuple[Objective, ...]:
    """Understand `METRIC`, `min:METRIC` and `max:METRIC`.

    Args:
        texts: the objectives.
        measured: metrics that the study measures.

    Raises:
        CableError: no such metric, not measured, or given twice.
    """
    found: list[Objective] = []
    for text in texts:
        way, colon, name = text.rpartition(":")
        metric = look_up("metric", name, METRICS)
        if colon and way not in ("min", "max"):
            raise CableError(f"objective {text!r} must be NAME, min:NAME or max:NAME.")
        if name not in measured:
            raise CableError(
                f"objective {name!r} is not among the metrics that are measured."
            )
        if any(other.name == name for other in found):
            raise CableError(f"objective {name!r} is given twice.")
        found.append(Objective(name, way == "max" if colon else metric.high))
    return tuple(found)


def costs(table: pa.Table, objectives: Sequence[Objective]) -> Array:
    """What to make small, (designs, objectives); NaN where there is no number."""
    columns = [
        np.asarray(table[o.name].to_numpy(zero_copy_only=False), dtype=np.float64)
        * (-1.0 if o.high else 1.0)
        for o in objectives
    ]
    return np.stack(columns, axis=-1)


def pareto(cost: Array) -> NDArray[np.bool_]:
    """Rows that no other row beats: as good in all columns, better in one.

    Args:
        cost: to be made small, (designs, objectives); rows with NaN are never in.
    """
    from scipy.stats import rankdata

    best = np.zeros(len(cost), dtype=np.bool_)
    left = np.flatnonzero(~np.isnan(cost).any(axis=1))
    # Whatever beats a row has a smaller sum of ranks, so the first of the rest is in.
    ranks = np.sum(
        [rankdata(column, method="dense") for column in cost[left].T], axis=0
    )
    left = left[np.argsort(ranks, kind="stable")]
    while left.size:
        first, left = left[0], left[1:]
        best[first] = True
        worse = (cost[left] >= cost[first]).all(axis=1)
        worse &= (cost[left] > cost[first]).any(axis=1)
        left = left[~worse]
    return best


def order(cost: Array) -> NDArray[np.intp]:
    """Rows from best to worst: the Pareto set first, each part by mean rank.

    The rank of a design in an objective is its place among all; no number is last.
    """
    from scipy.stats import rankdata

    ranks = np.mean([rankdata(column) for column in np.nan_to_num(cost, nan=np.inf).T],
                    axis=0)  # fmt: skip
    return np.lexsort((ranks, ~pareto(cost)))
