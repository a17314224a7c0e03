"""The Pareto set and the order, against their definitions."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from cc_mujoco.design import objective_costs, pareto_rows, read_objectives
from cc_mujoco.design._pareto import rank_designs
from cc_mujoco.errors import CableError

MEASURED = ("efficiency", "held_backlash", "rms_torque_error")


@given(
    arrays(
        np.float64,
        array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=12),
        elements=st.one_of(st.integers(0, 4).map(float), st.just(float("nan"))),
    )
)
def test_the_set_is_what_nothing_beats(cost: np.ndarray) -> None:
    whole = ~np.isnan(cost).any(axis=1)
    for i, inside in enumerate(pareto_rows(cost)):
        beaten = any(
            whole[j] and (cost[j] <= cost[i]).all() and (cost[j] < cost[i]).any()
            for j in range(len(cost))
        )
        assert inside == (whole[i] and not beaten)


@given(arrays(np.float64, (9, 2), elements=st.integers(0, 5).map(float)))
def test_the_order_is_of_all_and_begins_with_the_set(cost: np.ndarray) -> None:
    places = rank_designs(cost)
    assert sorted(places) == list(range(9))
    best = pareto_rows(cost)[places]
    assert (np.diff(best.astype(int)) <= 0).all()


def test_objectives_know_their_direction() -> None:
    table = pa.table({"efficiency": [0.2, None], "held_backlash": [1.0, 2.0]})
    goals = read_objectives(["efficiency", "max:held_backlash"], MEASURED)
    found = objective_costs(table, goals)
    assert np.array_equal(found, [[-0.2, -1.0], [np.nan, -2.0]], equal_nan=True)


@pytest.mark.parametrize(
    ("texts", "wrong"),
    [
        (["eficiency"], "did you mean 'efficiency'"),
        (["best:efficiency"], "min:NAME"),
        (["bandwidth"], "not among the metrics"),
        (["efficiency", "min:efficiency"], "given twice"),
    ],
)
def test_objectives_that_are_none(texts: list[str], wrong: str) -> None:
    with pytest.raises(CableError, match=wrong):
        read_objectives(texts, MEASURED)
