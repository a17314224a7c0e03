"""Further runs of a finished study: sensitivity at the best design, time step.

    found = analyse_best_design(plan, table, carry_out)
    check_timestep(plan, table, goals, carry_out)

Designs one step from the best, in one variable each, are simulated; the differences
give slopes. With them a linear program predicts the best objective within
`TRUST_REGION` of the ranges, under the limits and with each limit relaxed by
`relax_limit`. The multipliers of the limits are their shadow prices. The designs that
it proposes are simulated as well, to compare each prediction with the result.

Some designs are simulated again at half the time step. Even if the step resolves a
cable, a controller made for a softer one can drive it into a limit cycle, so that a
metric depends on the step more than on the design. No single step of a simulation shows
that.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from cc_mujoco.design import _pareto as pareto
from cc_mujoco.design._designs import Range
from cc_mujoco.design._evaluation import Design
from cc_mujoco.design._plan import Plan
from cc_mujoco.design._protocol import CONTROLLER_METRIC
from cc_mujoco.device._variables import Value
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray as Array

TRUST_REGION = 0.1
"""Share of a variable's range, to either side, over which slopes are trusted."""
OBJECTIVE_TOLERANCE = 0.01
"""Share of an objective by which it may worsen while another is improved."""


@dataclass(frozen=True)
class Slope:
    metric: str
    variable: str
    low: Value  # value of the variable below the best one; the best where there is none
    high: Value  # value above the best one, likewise
    # For `TRUST_REGION` of the range more, or from `low` to `high` where only some
    # values are allowed; NaN where it cannot be had.
    change: float
    error: float  # half the difference between the two sides; NaN where there is one


@dataclass(frozen=True)
class Price:
    objective: str  # name of the metric
    limit: pareto.MetricLimit | None  # the relaxed one; None if all stay as they are
    price: float  # shadow price, objective per unit of the limit; NaN without a limit
    now: float  # objective at the best design
    promised: float  # objective by the linear program
    found: float  # objective simulated at the proposed design; NaN where it failed
    kept: bool  # keeps the limits, the relaxed one too; other objectives are no worse
    design: Mapping[str, Value]  # the proposed one


@dataclass(frozen=True)
class Around:
    """Neighbourhood of the best design: its number, slopes, and prices of limits."""

    design: int
    slopes: tuple[Slope, ...]
    prices: tuple[Price, ...]


def analyse_best_design(
    plan: Plan, table: pa.Table, run: Callable[[Plan], pa.Table]
) -> Around | None:
    """Return slopes and prices at the best design; None if there are none."""
    if not plan.objectives:
        raise CableError("what is around the best design needs an objective.")
    cost = pareto.objective_costs(table, plan.objectives, plan.limits)
    best = int(pareto.rank_designs(cost)[0])
    if np.isnan(cost[best]).any():
        return None
    base, device = plan.designs[best], plan.protocol.device

    def possible(design: Mapping[str, Value]) -> Design | None:
        try:
            return plan.protocol.across.check(device, design)
        except CableError:  # promised by a range or by slopes alone
            return None

    sides: dict[str, list[Design | None]] = {}
    for name in plan.varied:
        near = _neighbours(plan.ranges[name], base[name])
        sides[name] = [None if v is None else possible({**base, name: v}) for v in near]
    tried = [base, *(d for pair in sides.values() for d in pair if d is not None)]
    if len(tried) == 1:
        return None
    rows = iter(run(plan.with_few_designs(tried)).to_pylist())
    centre = next(rows)
    slopes: list[Slope] = []
    for name, pair in sides.items():
        found = [None if design is None else next(rows) for design in pair]
        slopes += [
            _metric_slope(metric, name, plan.ranges[name], centre, found)
            for metric in pareto.decisive_columns(plan.objectives, plan.limits)
        ]
    prices = _prices(plan, base, centre, slopes)
    checked = {place: possible(price.design) for place, price in enumerate(prices)}
    if proposed := {n: design for n, design in checked.items() if design is not None}:
        there = run(plan.with_few_designs([*proposed.values()])).to_pylist()
        for place, row in zip(proposed, there, strict=True):
            prices[place] = _checked(plan, prices[place], row, centre)
    return Around(best, tuple(slopes), tuple(prices))


def _range_position(values: Range, value: Value) -> float:
    assert values.ends is not None
    low, high = values.ends
    number = float(value)
    if values.log:
        return math.log(number / low) / math.log(high / low)
    return (number - low) / (high - low)


def _shift_value(values: Range, value: Value, by: float) -> Value:
    share = np.clip(_range_position(values, value) + by, 0.0, 1.0)
    return values.at(np.array([share]))[0]


def _neighbours(values: Range, here: Value) -> list[Value | None]:
    """Return the next lower and higher value of a range, each None without one."""
    if values.ends is not None:
        # By a fiftieth of the range.
        sides = [_shift_value(values, here, by) for by in (-0.02, 0.02)]
    elif isinstance(here, str):
        return [None, None]
    else:
        levels = sorted(values.levels, key=float)
        place = levels.index(here)
        sides = [levels[max(place - 1, 0)], levels[min(place + 1, len(levels) - 1)]]
    return [
        None if math.isclose(float(value), float(here), rel_tol=1e-9) else value
        for value in sides
    ]


def _metric_slope(
    metric: str,
    name: str,
    values: Range,
    centre: Mapping[str, Any],
    sides: Sequence[Mapping[str, Any] | None],
) -> Slope:
    changes = []
    for row in sides:
        if row is None:
            continue
        change = _number(row[metric]) - _number(centre[metric])
        if values.ends is not None:
            here, there = (_range_position(values, r[name]) for r in (centre, row))
            changes.append(TRUST_REGION * change / (there - here))
        else:
            changes.append(-change if row is sides[0] else change)
    total = math.nan
    if changes:
        total = float(np.mean(changes) if values.ends is not None else np.sum(changes))
    error = 0.5 * abs(changes[1] - changes[0]) if len(changes) == 2 else math.nan
    low, high = ((row or centre)[name] for row in sides)
    return Slope(metric, name, low, high, total, error)


def _prices(
    plan: Plan, base: Design, centre: Mapping[str, object], slopes: Sequence[Slope]
) -> list[Price]:
    """Return predictions of each objective: under the limits, and with each relaxed."""
    from scipy.optimize import linprog

    change = {(s.metric, s.variable): s.change for s in slopes}
    names, ranges, limits = {s.metric for s in slopes}, plan.ranges, plan.limits
    moving = [variable for variable in plan.varied if ranges[variable].ends is not None]
    free = [v for v in moving if all(math.isfinite(change[m, v]) for m in names)]
    if not free:
        return []
    shares = [_range_position(ranges[v], base[v]) / TRUST_REGION for v in free]
    room = [(max(-1.0, -s), min(1.0, 1.0 / TRUST_REGION - s)) for s in shares]

    def slope_row(metric: str, high: bool) -> Array:
        """Return the change of a metric by each free variable; less is better."""
        return (-1.0 if high else 1.0) * np.array([change[metric, v] for v in free])

    def price(goal: pareto.Objective, relaxed: pareto.MetricLimit | None) -> Price:
        rows, bounds = [], []
        for limit in limits:
            sign = -1.0 if limit.least else 1.0
            bound = relax_limit(limit).bound if limit is relaxed else limit.bound
            rows.append(slope_row(limit.column, limit.least))
            bounds.append(max(sign * (bound - _number(centre[limit.column])), 0.0))
        others = [other for other in plan.objectives if other is not goal]
        rows += [slope_row(other.name, other.high) for other in others]
        bounds += [0.0] * len(others)
        limited = (np.array(rows), np.array(bounds)) if rows else ()
        aim = slope_row(goal.name, goal.high)
        found = linprog(aim, *limited, bounds=room, method="highs")
        now, worth = _number(centre[goal.name]), math.nan
        if relaxed is not None:
            worth = abs(float(found.ineqlin.marginals[limits.index(relaxed)]))
        moved = {
            name: _shift_value(ranges[name], base[name], TRUST_REGION * float(by))
            for name, by in zip(free, found.x, strict=True)
        }
        easier = None if relaxed is None else relax_limit(relaxed)
        promised = now + (-1.0 if goal.high else 1.0) * float(found.fun)
        design = {**base, **moved}
        return Price(goal.name, easier, worth, now, promised, math.nan, False, design)

    return [price(goal, one) for goal in plan.objectives for one in (None, *limits)]


def relax_limit(limit: pareto.MetricLimit) -> pareto.MetricLimit:
    """Relax a limit by a tenth of its size, or by 1 of its unit if it is 0."""
    by = 0.1 * abs(limit.bound) or 1.0
    return dataclasses.replace(limit, bound=limit.bound + (-by if limit.least else by))


def _checked(
    plan: Plan, price: Price, row: Mapping[str, object], centre: Mapping[str, object]
) -> Price:
    names = pareto.decisive_columns(plan.objectives, plan.limits)
    metrics, now = ({n: _number(one[n]) for n in names} for one in (row, centre))
    kept = True
    for limit in plan.limits:
        easier = relax_limit(limit)
        kept &= (easier if easier == price.limit else limit).beyond(metrics) <= 0.0
    for goal in plan.objectives:
        if goal.name != price.objective:
            margin = OBJECTIVE_TOLERANCE * abs(goal.cost(now))
            kept &= goal.cost(metrics) <= goal.cost(now) + margin
    return dataclasses.replace(price, found=metrics[price.objective], kept=kept)


def _number(value: object) -> float:
    return math.nan if value is None else float(str(value))


MAX_CHECKED_DESIGNS = 6  # designs that are tried at most, besides the best
TOLERATED_CHANGE = 0.05  # change of a number that is not worth a word
MIN_RANGE_SHARE = 0.05
"""Least size of a number for relative changes, as a share of all designs' range."""


@dataclass(frozen=True)
class TimestepChange:
    metric: str
    design: int
    value: float  # in the study
    half_step_value: float  # at half the time step; NaN where there is no such number
    share: float  # difference over the number or `MIN_RANGE_SHARE`; inf without one


@dataclass(frozen=True)
class Halved:
    timestep: float  # that half [s]
    designs: tuple[int, ...]  # numbers of the designs, the best first
    changes: tuple[TimestepChange, ...]  # largest of every metric, in falling order

    @property
    def unsettled(self) -> tuple[TimestepChange, ...]:
        return tuple(one for one in self.changes if one.share > TOLERATED_CHANGE)


def check_timestep(
    plan: Plan,
    table: pa.Table,
    goals: Sequence[pareto.Objective],
    run: Callable[[Plan], pa.Table],
) -> Halved | None:
    """Simulate some designs of a study again at half its time step.

    They are spread over the ranking, from the best to the worst. The metrics of `goals`
    and limits are compared. Returns None if no design has all goals. `run` executes a
    plan, as `carry_out` does.
    """
    # A number may break a limit by the step alone.
    cost = pareto.objective_costs(table, goals)
    ranked = [int(i) for i in pareto.rank_designs(cost) if not np.isnan(cost[i]).any()]
    if not ranked:
        return None
    wanted = max(3, math.ceil(len(ranked) / 4))
    count = min(MAX_CHECKED_DESIGNS, wanted, len(ranked))
    places = np.linspace(0, len(ranked) - 1, count).round().astype(int)
    within = pareto.objective_costs(table, goals, plan.limits)
    best = int(pareto.rank_designs(within)[0])
    tried = tuple(dict.fromkeys([best, *(ranked[place] for place in places)]))
    columns = pareto.decisive_columns(goals, plan.limits)
    measured = {name.partition("@")[0] for name in columns}
    if len(plan.protocol.controllers) > 1:
        measured.add(CONTROLLER_METRIC)
    step, metrics = 0.5 * plan.protocol.timestep, plan.protocol.metrics
    metrics = tuple(name for name in metrics if name in measured)
    protocol = dataclasses.replace(plan.protocol, timestep=step, metrics=metrics)
    again = dataclasses.replace(plan, protocol=protocol)
    few = again.with_few_designs([plan.designs[i] for i in tried])
    rows = run(few).to_pylist()
    changes = []
    for name in columns:
        every = table[name].to_pylist()
        known = [value for value in every if value is not None]
        least = MIN_RANGE_SHARE * float(np.ptp(known)) if known else 0.0
        pairs = zip(tried, rows, strict=True)
        found = [_change(name, i, every[i], row[name], least) for i, row in pairs]
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
