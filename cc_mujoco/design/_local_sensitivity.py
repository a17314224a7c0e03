"""Worth of each variable and each limit at the best design.

    found = around(plan, table, objectives, limits, carry_out)

Designs a step to either side of the best in one variable at a time are simulated, all
together; their differences are slopes. Between them and the limits a linear program
predicts the best objective within `TRUST_REGION` of the ranges, with the limits as they
are and with each limit relaxed by `LIMIT_RELAXATION`; the multipliers of its limits are
their shadow prices. Its proposals are simulated as well, so that each prediction can be
compared with the result.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cc_mujoco.design._designs import Range
from cc_mujoco.design._evaluation import Design
from cc_mujoco.design._pareto import (
    MetricLimit,
    Objective,
    objective_costs,
    rank_designs,
)
from cc_mujoco.design._plan import Plan, with_few_designs
from cc_mujoco.design._scenarios import Across
from cc_mujoco.device import Device
from cc_mujoco.device._variables import Value
from cc_mujoco.errors import CableError

Array = NDArray[np.float64]

SLOPE_STEP = 0.02
"""To either side, of a variable's range."""
TRUST_REGION = 0.1
"""Share of a variable's range, to either side, over which slopes are trusted."""
LIMIT_RELAXATION = 0.1
"""Relaxation of a limit, as a share of its size; 1 of its unit where that is 0."""
OBJECTIVE_TOLERANCE = 0.01
"""Share of an objective that counts as no worse where another is improved."""


@dataclass(frozen=True)
class Slope:
    """Change of a metric with a variable.

    Attributes:
        metric: its name.
        variable: its name.
        low: value of the variable to one side; that of the best where there is none.
        high: the same to the other side.
        change: of the metric for `TRUST_REGION` of the range more, or from `low` to
            `high` where only some values are allowed; NaN where it cannot be had.
        error: half the difference between the slopes to either side, in the same
            measure; NaN where there is one side.
    """

    metric: str
    variable: str
    low: Value
    high: Value
    change: float
    error: float


@dataclass(frozen=True)
class Price:
    """Possible gain near the best design.

    Attributes:
        objective: name of the metric.
        limit: as it would be; None where all are as they are.
        price: shadow price, objective per unit of the limit, NaN without a limit.
        now: the objective at the best design.
        promised: the same by the linear program.
        found: the same simulated at the design that it proposes; NaN where it failed.
        kept: whether that design keeps the limits, the relaxed one among them, and is
            no worse in the other objectives.
        design: that design.
    """

    objective: str
    limit: MetricLimit | None
    price: float
    now: float
    promised: float
    found: float
    kept: bool
    design: Mapping[str, Value]


@dataclass(frozen=True)
class Around:
    """The best design: its number, its slopes, and the prices of limits."""

    design: int
    slopes: tuple[Slope, ...]
    prices: tuple[Price, ...]


def analyse_best_design(
    plan: Plan,
    table: pa.Table,
    objectives: Sequence[Objective],
    limits: Sequence[MetricLimit],
    run: Callable[[Plan], pa.Table],
) -> Around | None:
    """Look around the best design of a study that keeps the limits.

    Returns None where no design is good, or none could move. `run` carries a plan out;
    see `carry_out`.
    """
    if not objectives:
        raise CableError("what is around the best design needs an objective.")
    cost = objective_costs(table, objectives, limits)
    best = int(rank_designs(cost)[0])
    if np.isnan(cost[best]).any():
        return None
    base = plan.designs[best]
    device = plan.protocol.device
    check = plan.protocol.across.check
    sides = {
        name: _neighbour_designs(
            plan.protocol.across, device, plan.ranges[name], base, name
        )
        for name in plan.varied
    }
    tried = [base, *(d for pair in sides.values() for d in pair if d is not None)]
    if len(tried) == 1:
        return None
    rows = iter(run(with_few_designs(plan, device, tried)).to_pylist())
    centre = next(rows)
    names = _objective_columns(objectives, limits)
    slopes: list[Slope] = []
    for name, pair in sides.items():
        found = [None if design is None else next(rows) for design in pair]
        slopes += [
            _metric_slope(m, name, plan.ranges[name], centre, found) for m in names
        ]
    program = _Program(plan, base, centre, slopes, objectives, limits)
    prices = program.prices()
    proposed: list[tuple[Price, Design]] = []
    for price in prices:
        try:
            proposed.append((price, check(device, price.design)))
        except CableError:  # promised by slopes alone, and impossible
            continue
    there: list[Mapping[str, object]] = []
    if proposed:
        designs = [design for _, design in proposed]
        there = run(with_few_designs(plan, device, designs)).to_pylist()
    checked = {id(price): row for (price, _), row in zip(proposed, there, strict=True)}
    return Around(
        best,
        tuple(slopes),
        tuple(
            _check_price(price, checked.get(id(price)), centre, objectives, limits)
            for price in prices
        ),
    )


def _range_position(values: Range, value: Value) -> float:
    """Return the position of a value in its range, 0 to 1."""
    assert values.ends is not None
    low, high = values.ends
    number = float(value)
    if values.log:
        return math.log(number / low) / math.log(high / low)
    return (number - low) / (high - low)


def _shift_value(values: Range, value: Value, by: float) -> Value:
    share = np.clip(_range_position(values, value) + by, 0.0, 1.0)
    return values.at(np.array([share]))[0]


def _neighbour_designs(
    across: Across, device: Device, values: Range, base: Design, name: str
) -> tuple[Design | None, Design | None]:
    """Return the best design with a variable lower and higher, None if impossible."""
    here = base[name]
    if values.ends is not None:
        less, more = (
            _shift_value(values, here, by) for by in (-SLOPE_STEP, SLOPE_STEP)
        )
    elif isinstance(here, str):
        return None, None
    else:
        levels = sorted(values.levels, key=float)
        place = levels.index(here)
        less = levels[max(place - 1, 0)]
        more = levels[min(place + 1, len(levels) - 1)]
    found: list[Design | None] = []
    for value in (less, more):
        try:
            same = math.isclose(float(value), float(here), rel_tol=1e-9)
            found.append(None if same else across.check(device, {**base, name: value}))
        except CableError:
            found.append(None)
    return found[0], found[1]


def _metric_slope(
    metric: str,
    name: str,
    values: Range,
    centre: Mapping[str, object],
    sides: Sequence[Mapping[str, object] | None],
) -> Slope:
    here, value = centre[name], _number(centre[metric])
    less, more = ((row or centre)[name] for row in sides)
    changes = []
    for row in sides:
        if row is None:
            continue
        change = _number(row[metric]) - value
        if values.ends is not None:
            run = _range_position(values, _value(row[name])) - _range_position(
                values, _value(here)
            )
            changes.append(TRUST_REGION * change / run)
        else:
            changes.append(-change if row is sides[0] else change)
    total = math.nan
    if changes:
        total = float(np.mean(changes) if values.ends is not None else np.sum(changes))
    error = 0.5 * abs(changes[1] - changes[0]) if len(changes) == 2 else math.nan
    return Slope(metric, name, _value(less), _value(more), total, error)


class _Program:
    """Linear program around a design, with steps in units of `TRUST_REGION` x range."""

    def __init__(
        self,
        plan: Plan,
        base: Design,
        centre: Mapping[str, object],
        slopes: Sequence[Slope],
        objectives: Sequence[Objective],
        limits: Sequence[MetricLimit],
    ) -> None:
        self._base, self._centre, self._ranges = base, centre, plan.ranges
        self._objectives, self._limits = objectives, limits
        self._change = {(s.metric, s.variable): s.change for s in slopes}
        names = {s.metric for s in slopes}
        self.free = tuple(
            variable
            for variable in plan.varied
            if plan.ranges[variable].ends is not None
            and all(math.isfinite(self._change[m, variable]) for m in names)
        )
        shares = [
            _range_position(plan.ranges[v], base[v]) / TRUST_REGION for v in self.free
        ]
        self._bounds = [
            (max(-1.0, -s), min(1.0, 1.0 / TRUST_REGION - s)) for s in shares
        ]

    def prices(self) -> list[Price]:
        """Price each objective, as things are and with each limit relaxed."""
        if not self.free:
            return []
        return [
            self._price(goal, limit)
            for goal in self._objectives
            for limit in (None, *self._limits)
        ]

    def _price(self, goal: Objective, relaxed: MetricLimit | None) -> Price:
        from scipy.optimize import linprog

        rows, bounds = [], []
        for limit in self._limits:
            sign = -1.0 if limit.least else 1.0
            bound = relax_limit(limit).bound if limit is relaxed else limit.bound
            rows.append(sign * self._row(limit.column))
            left = sign * (bound - _number(self._centre[limit.column]))
            bounds.append(max(left, 0.0))
        for other in self._objectives:
            if other is not goal:
                rows.append((-1.0 if other.high else 1.0) * self._row(other.name))
                bounds.append(0.0)
        sign = -1.0 if goal.high else 1.0
        found = linprog(
            sign * self._row(goal.name),
            np.array(rows) if rows else None,
            np.array(bounds) if rows else None,
            bounds=self._bounds,
            method="highs",
        )
        now = _number(self._centre[goal.name])
        price = math.nan
        if relaxed is not None:
            price = abs(float(found.ineqlin.marginals[self._limits.index(relaxed)]))
        moved = {
            name: _shift_value(
                self._ranges[name], self._base[name], TRUST_REGION * float(by)
            )
            for name, by in zip(self.free, found.x, strict=True)
        }
        promised = now + sign * float(found.fun)
        return Price(
            goal.name,
            None if relaxed is None else relax_limit(relaxed),
            price,
            now,
            promised,
            math.nan,
            False,
            {**self._base, **moved},
        )

    def _row(self, metric: str) -> Array:
        return np.array([self._change[metric, name] for name in self.free])


def relax_limit(limit: MetricLimit) -> MetricLimit:
    by = LIMIT_RELAXATION * abs(limit.bound) or 1.0
    return dataclasses.replace(
        limit, bound=limit.bound - by if limit.least else limit.bound + by
    )


def _check_price(
    price: Price,
    row: Mapping[str, object] | None,
    centre: Mapping[str, object],
    objectives: Sequence[Objective],
    limits: Sequence[MetricLimit],
) -> Price:
    """Return a price with the simulated result of its design."""
    if row is None:
        return price
    metrics = {n: _number(row[n]) for n in _objective_columns(objectives, limits)}
    eased = [relax_limit(limit) == price.limit for limit in limits]
    kept = all(
        (relax_limit(limit) if easier else limit).beyond(metrics) <= 0.0
        for limit, easier in zip(limits, eased, strict=True)
    )
    now = {goal.name: _number(centre[goal.name]) for goal in objectives}
    kept &= all(
        goal.cost(metrics) <= goal.cost(now) + OBJECTIVE_TOLERANCE * abs(goal.cost(now))
        for goal in objectives
        if goal.name != price.objective
    )
    return dataclasses.replace(price, found=metrics[price.objective], kept=kept)


def _objective_columns(
    objectives: Sequence[Objective], limits: Sequence[MetricLimit]
) -> tuple[str, ...]:
    names = [*(goal.name for goal in objectives), *(limit.column for limit in limits)]
    return tuple(dict.fromkeys(names))


def _number(value: object) -> float:
    return math.nan if value is None else float(str(value))


def _value(value: object) -> Value:
    assert isinstance(value, (str, int, float))
    return value
