"""Selection of the best designs: objectives, limits, Pareto set, ranking."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cc_mujoco._validation import require_list
from cc_mujoco.design._protocol import metric_of_designs
from cc_mujoco.design._scenarios import LEAST_SUFFIX, MOST_SUFFIX
from cc_mujoco.errors import CableError
from cc_mujoco.metrics import METRICS
from cc_mujoco.native import FloatArray as Array


@dataclass(frozen=True)
class Objective:
    name: str
    high: bool

    @property
    def text(self) -> str:
        return f"{self.name} ({'high' if self.high else 'low'})"

    def cost(self, metrics: Mapping[str, float]) -> float:
        """Return the number to minimise: the metric, negative if high is better."""
        return -metrics[self.name] if self.high else metrics[self.name]


@dataclass(frozen=True)
class MetricLimit:
    name: str
    bound: float
    least: bool  # true if the number is the least
    across: bool = False  # true if it must hold in every case of a design

    @property
    def column(self) -> str:
        if not self.across:
            return self.name
        return f"{self.name}@{LEAST_SUFFIX if self.least else MOST_SUFFIX}"

    @property
    def text(self) -> str:
        return f"{self.name}{'>=' if self.least else '<='}{self.bound:g}"

    def beyond(self, metrics: Mapping[str, Any]) -> float:
        """Return the excess over the limit, relative to it unless it is 0."""
        over: float = metrics[self.column] - self.bound
        return (-over if self.least else over) / (abs(self.bound) or 1.0)


def read_limits(
    texts: Iterable[str], measured: Sequence[str] | None = None, across: bool = False
) -> tuple[MetricLimit, ...]:
    """Parse `METRIC>=NUMBER` and `METRIC<=NUMBER`.

    `measured` are the metrics of the study, None if it measures any that is named. With
    `across`, designs have several cases, in all of which limits hold.
    """
    found = []
    for text in require_list("subject_to", texts):
        name, sign, number = re.split(r"(>=|<=|\Z)", text, maxsplit=1)
        try:
            bound = float(number)
        except ValueError:
            bound = math.nan
        if not math.isfinite(bound):
            raise CableError(
                f"limit {text!r} must be METRIC>=NUMBER or METRIC<=NUMBER."
            )
        name = metric_of_designs(name.strip()).name
        if measured is not None and name not in measured:
            raise CableError(
                f"limit {text!r} is on what is not among the metrics measured; add "
                f"--metric {name}."
            )
        found.append(MetricLimit(name, bound, sign == ">=", across))
    return tuple(found)


def read_objectives(
    texts: Iterable[str], measured: Sequence[str] | None = None
) -> tuple[Objective, ...]:
    """Parse `METRIC` (towards its better side), `min:METRIC` and `max:METRIC`."""
    found: list[Objective] = []
    for text in require_list("objectives", texts):
        way, _, given = text.partition(":")
        if way not in ("min", "max"):
            if given in METRICS:
                raise CableError(
                    f"objective {text!r} must be NAME, min:NAME or max:NAME."
                )
            way, given = "", text
        metric = metric_of_designs(given)
        name = metric.name
        if not (way or metric.better):
            raise CableError(
                f"objective {text!r} is better neither high nor low; write min:{text} "
                f"or max:{text}."
            )
        if measured is not None and name not in measured:
            raise CableError(
                f"objective {name!r} is not among the metrics that are measured; add "
                f"--metric {given}."
            )
        if any(other.name == name for other in found):
            raise CableError(f"objective {name!r} is given twice.")
        found.append(Objective(name, way == "max" if way else metric.high))
    return tuple(found)


def objective_costs(
    table: pa.Table, objectives: Sequence[Objective], limits: Sequence[MetricLimit] = ()
) -> Array:
    """Return the numbers to minimise, (designs, objectives).

    They are NaN without a number, and for designs that exceed a limit.
    """
    columns = [(-1.0 if o.high else 1.0) * column(table, o.name) for o in objectives]
    found = np.stack(columns, axis=-1)
    found[~within_limits(table, limits)] = np.nan
    return found


def decisive_columns(
    objectives: Sequence[Objective], limits: Sequence[MetricLimit]
) -> tuple[str, ...]:
    """Return the columns of objectives and limits, each once."""
    names = [*(goal.name for goal in objectives), *(limit.column for limit in limits)]
    return tuple(dict.fromkeys(names))


def within_limits(table: pa.Table, limits: Sequence[MetricLimit]) -> NDArray[np.bool_]:
    """Return the mask (designs,) of those within all limits, with numbers for them."""
    kept = np.ones(len(table), dtype=np.bool_)
    for limit in limits:
        values = column(table, limit.column)
        kept &= values >= limit.bound if limit.least else values <= limit.bound
    return kept


def column(table: pa.Table, name: str) -> Array:
    return np.asarray(table[name].to_numpy(zero_copy_only=False), dtype=np.float64)


def pareto_rows(cost: Array) -> NDArray[np.bool_]:
    """Return the mask of rows that no other dominates.

    A row dominates if it is as small in all columns and smaller in one. `cost`
    (designs, objectives) is minimised; rows with NaN are never in.
    """
    from scipy.stats import rankdata

    best = np.zeros(len(cost), dtype=np.bool_)
    left = np.flatnonzero(~np.isnan(cost).any(axis=1))
    # Whatever beats a row has a smaller sum of ranks, so the first of the rest is in.
    ranks = [rankdata(column, method="dense") for column in cost[left].T]
    left = left[np.argsort(np.sum(ranks, axis=0), kind="stable")]
    while left.size:
        first, left = left[0], left[1:]
        best[first] = True
        worse = (cost[left] >= cost[first]).all(axis=1)
        worse &= (cost[left] > cost[first]).any(axis=1)
        left = left[~worse]
    return best


def rank_designs(cost: Array) -> NDArray[np.intp]:
    """Return row indices from best to worst: the Pareto set, then the rest.

    Each part is in order of the mean rank over objectives; NaN ranks last.
    """
    from scipy.stats import rankdata

    ranks = [rankdata(column) for column in np.nan_to_num(cost, nan=np.inf).T]
    return np.lexsort((np.mean(ranks, axis=0), ~pareto_rows(cost)))
