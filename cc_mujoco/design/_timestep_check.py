"""Check of a study's dependence on its time step: some designs at half of it.

found = check_timestep(plan, table, goals, carry_out)

A cable that the step resolves can still be driven into a limit cycle, by a controller
that meets a stiffer cable than it is made for, and then a number says more of the step
than of the design. That is no error of any one step, so it is looked for in the end.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from cc_mujoco.design._pareto import (
    Objective,
    decisive_columns,
    objective_costs,
    rank_designs,
)
from cc_mujoco.design._plan import Plan
from cc_mujoco.design._protocol import CONTROLLER_METRIC

MAX_CHECKED_DESIGNS = 6
"""Designs that are tried at most."""
TOLERATED_CHANGE = 0.05
"""Change of a number that is not worth a word."""
MIN_RANGE_SHARE = 0.05
"""Part of the range of all designs; the change of a smaller number is over this."""


@dataclass(frozen=True)
class TimestepChange:
    """Change of a number of a design."""

    metric: str
    design: int
    value: float
    """In the study."""
    half_step_value: float
    """At half the time step; NaN where there is no such number."""
    share: float
    """Difference over the number or `MIN_RANGE_SHARE` of the range; inf without one."""


@dataclass(frozen=True)
class Halved:
    """Designs at half the time step."""

    timestep: float
    """That half [s]."""
    designs: tuple[int, ...]
    """Numbers of the designs, the best first."""
    changes: tuple[TimestepChange, ...]
    """The largest of every metric, the largest of all first."""

    @property
    def unsettled(self) -> tuple[TimestepChange, ...]:
        """Changes that are worth a word."""
        return tuple(one for one in self.changes if one.share > TOLERATED_CHANGE)


def check_timestep(
    plan: Plan,
    table: pa.Table,
    goals: Sequence[Objective],
    run: Callable[[Plan], pa.Table],
) -> Halved | None:
    """Try designs of a study again at half its time step.

    They are spread over the ranking, with the best and the worst among them. The
    numbers of `goals` and of the limits are compared. Returns None where no design
    has all of them. `run` carries a plan out; see `carry_out`.
    """
    # A number may break a limit by the step alone.
    cost = objective_costs(table, goals)
    ranked = [int(i) for i in rank_designs(cost) if not np.isnan(cost[i]).any()]
    if not ranked:
        return None
    wanted = max(3, math.ceil(len(ranked) / 4))
    count = min(MAX_CHECKED_DESIGNS, wanted, len(ranked))
    places = np.linspace(0, len(ranked) - 1, count).round().astype(int)
    best = int(rank_designs(objective_costs(table, goals, plan.limits))[0])
    tried = tuple(dict.fromkeys([best, *(ranked[place] for place in places)]))
    columns = decisive_columns(goals, plan.limits)
    measured = {name.partition("@")[0] for name in columns}
    if len(plan.protocol.controllers) > 1:
        measured.add(CONTROLLER_METRIC)
    protocol = dataclasses.replace(
        plan.protocol,
        timestep=0.5 * plan.protocol.timestep,
        metrics=tuple(name for name in plan.protocol.metrics if name in measured),
    )
    again = dataclasses.replace(plan, protocol=protocol)
    few = again.with_few_designs([plan.designs[i] for i in tried])
    rows = run(few).to_pylist()
    changes = []
    for name in columns:
        every = table[name].to_pylist()
        known = [value for value in every if value is not None]
        least = MIN_RANGE_SHARE * float(np.ptp(known)) if known else 0.0
        found = [
            _change(name, i, every[i], row[name], least)
            for i, row in zip(tried, rows, strict=True)
        ]
        changes.append(max(found, key=lambda one: one.share))
    changes.sort(key=lambda one: -one.share)
    return Halved(protocol.timestep, tried, tuple(changes))


def _change(
    name: str, design: int, value: object, again: object, least: float
) -> TimestepChange:
    if not isinstance(value, float):  # a limit that is not a goal may have no number
        return TimestepChange(name, design, math.nan, math.nan, 0.0)
    if not isinstance(again, float):
        return TimestepChange(name, design, value, math.nan, math.inf)
    size = max(abs(value), least)
    share = abs(again - value) / size if again != value else 0.0
    return TimestepChange(name, design, value, again, share)
