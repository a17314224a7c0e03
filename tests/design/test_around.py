"""Around the best design: slopes and shadow prices of functions that are known."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco.design import Plan, StudySpec, make_plan, read_limits
from cc_mujoco.design._follow_up import TRUST_REGION, analyse_best_design
from cc_mujoco.errors import CableError

Law = Callable[[Mapping[str, Any]], Mapping[str, float]]
MEASURED = ("rms_torque_error", "peak_tension")
RANGES = {"friction": "0.1:0.3:3", "pretension": "10:110:3", "loops": "1,2,4"}
WHOLE = make_plan(StudySpec("wrist", RANGES, metrics=MEASURED, objectives=MEASURED[:1]))


def plan_of(*limits: str, **base: float) -> Plan:
    """Return a study whose first design is the best."""
    first = {"friction": 0.2, "pretension": 60.0, "loops": 2, **base}
    designs = (first, *WHOLE.designs)
    return replace(WHOLE, designs=designs, limits=read_limits(limits), full=False)


def table_of(plan: Plan, tension: float = 0.0) -> pa.Table:
    errors = [0.0] + [1e9] * (len(plan.designs) - 1)
    return pa.table({MEASURED[0]: errors, MEASURED[1]: [tension] * len(errors)})


def run(law: Law, tried: list[Plan]) -> Callable[[Plan], pa.Table]:
    def carry_out(plan: Plan) -> pa.Table:
        tried.append(plan)
        rows = [{**design, **law(design)} for design in plan.designs]
        return pa.Table.from_pylist(rows)

    return carry_out


def shares(design: Mapping[str, Any]) -> tuple[float, float]:
    return (design["friction"] - 0.1) / 0.2, (design["pretension"] - 10.0) / 100.0


@settings(max_examples=10, deadline=None)
@given(
    gain=st.tuples(*[st.floats(0.5, 3.0)] * 2),
    cost=st.tuples(*[st.floats(0.5, 3.0)] * 2),
)
def test_of_linear_metrics_slopes_and_promises_are_exact(
    gain: tuple[float, float], cost: tuple[float, float]
) -> None:
    """The error falls with either variable while tension, which is limited, rises."""

    def law(design: Mapping[str, Any]) -> Mapping[str, float]:
        one, other = shares(design)
        return {
            "rms_torque_error": 10.0 - gain[0] * one - gain[1] * other,
            "peak_tension": cost[0] * (one - 0.5) + cost[1] * (other - 0.5),
        }

    plan, tried = plan_of("peak_tension<=0"), []
    found = analyse_best_design(plan, table_of(plan), run(law, tried))
    assert found is not None and found.design == 0
    slopes = {(s.metric, s.variable): s for s in found.slopes}
    for name, less, more in zip(RANGES, gain, cost, strict=False):
        one = slopes["rms_torque_error", name]
        assert one.change == pytest.approx(-TRUST_REGION * less)
        assert one.error == pytest.approx(0.0, abs=1e-9)
        assert slopes["peak_tension", name].change == pytest.approx(TRUST_REGION * more)
    loops = slopes["rms_torque_error", "loops"]
    assert (loops.low, loops.high, loops.change) == (1, 4, 0.0)
    asis, relaxed = found.prices
    # Along the limit, up with the variable that buys more per tension and down with
    # the other, until either is a tenth of its range away.
    worth = [less / more for less, more in zip(gain, cost, strict=True)]
    slid = TRUST_REGION * min(cost) * (max(worth) - min(worth))
    assert asis.promised == pytest.approx(asis.now - slid)
    # A limit of 0 is relaxed by 1, which is more than can be used.
    assert relaxed.promised == pytest.approx(relaxed.now - TRUST_REGION * sum(gain))
    for price in found.prices:
        assert price.found == pytest.approx(price.promised)
    assert [len(each.designs) for each in tried] == [7, 2]


def test_a_limit_is_worth_what_the_objective_pays_for_it() -> None:
    def law(design: Mapping[str, Any]) -> Mapping[str, float]:
        share, _ = shares(design)
        return {"rms_torque_error": 5.0 - 2.0 * share, "peak_tension": 100.0 * share}

    tight = plan_of("peak_tension<=50")
    found = analyse_best_design(tight, table_of(tight, 50.0), run(law, []))
    assert found is not None
    asis, relaxed = found.prices
    assert asis.found == pytest.approx(asis.now) == pytest.approx(4.0)
    assert relaxed.limit is not None and relaxed.limit.text == "peak_tension<=55"
    assert relaxed.price == pytest.approx(0.02)
    assert relaxed.promised == pytest.approx(3.9) == pytest.approx(relaxed.found)
    loose = plan_of("peak_tension<=90")
    idle = analyse_best_design(loose, table_of(loose, 50.0), run(law, []))
    assert idle is not None and idle.prices[1].price == 0.0
    assert idle.prices[0].promised == pytest.approx(3.8)
    assert all(price.kept for price in idle.prices)


def test_what_breaks_a_limit_in_simulation_is_said_to() -> None:
    """Tension jumps beyond the step by which its slope was found."""

    def law(design: Mapping[str, Any]) -> Mapping[str, float]:
        share, _ = shares(design)
        tension = 80.0 if share > 0.55 else 50.0
        return {"rms_torque_error": 5.0 - 2.0 * share, "peak_tension": tension}

    plan = plan_of("peak_tension<=60")
    found = analyse_best_design(plan, table_of(plan, 50.0), run(law, []))
    assert found is not None
    assert not found.prices[0].kept and found.prices[0].found < found.prices[0].now


def test_a_bend_shows_as_an_error_and_as_a_promise_that_fails() -> None:
    def law(design: Mapping[str, Any]) -> Mapping[str, float]:
        share, _ = shares(design)
        return {"rms_torque_error": 1.0 + (share - 0.499) ** 2}

    plan = plan_of()
    found = analyse_best_design(plan, table_of(plan), run(law, []))
    assert found is not None
    slope = next(s for s in found.slopes if s.variable == "friction")
    assert slope.error > abs(slope.change)
    (price,) = found.prices
    assert math.isnan(price.price) and price.found > price.now > price.promised


def test_at_the_end_of_a_range_there_is_one_side() -> None:
    def law(design: Mapping[str, Any]) -> Mapping[str, float]:
        return {"rms_torque_error": shares(design)[0]}

    plan = plan_of(friction=0.1, loops=1)
    found = analyse_best_design(plan, table_of(plan), run(law, []))
    assert found is not None
    slope = next(s for s in found.slopes if s.variable == "friction")
    assert slope.low == 0.1 and slope.change == pytest.approx(TRUST_REGION)
    assert math.isnan(slope.error)
    assert found.prices[0].design["friction"] == pytest.approx(0.1)


def test_without_a_good_design_nothing_is_simulated() -> None:
    plan, tried = plan_of(), []
    none = pa.table({"rms_torque_error": [math.nan] * len(plan.designs)})
    assert analyse_best_design(plan, none, run(lambda design: {}, tried)) is None
    assert not tried
    with pytest.raises(CableError, match="needs an objective"):
        aimless = replace(plan, objectives=())
        analyse_best_design(aimless, none, run(lambda design: {}, tried))
