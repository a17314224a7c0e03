"""Fits, covariances and intervals, against linear problems with known answers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from cc_mujoco.cable import Parameter
from cc_mujoco.estimation._least_squares import (
    Tuned,
    bounded_step,
    covariance,
    differences,
    estimate,
    fit,
    undetermined_directions,
)

RANDOM = np.random.default_rng(0)
DESIGN = RANDOM.standard_normal((400, 3)) * [1.0, 50.0, 0.2]
TRUTH = np.array([0.5, -0.02, 1.5])
MEASURED = DESIGN @ TRUTH + RANDOM.standard_normal(400)
FREE = tuple(Tuned(Parameter(name), 0.0, 1.0, -9.0, 9.0) for name in "abc")


def residual(x: np.ndarray) -> np.ndarray:
    return MEASURED - DESIGN @ x


def test_a_linear_problem_is_solved_as_by_linear_algebra() -> None:
    found = fit(residual, lambda x: -DESIGN, FREE, np.zeros(3))
    exact, squares, *_ = np.linalg.lstsq(DESIGN, MEASURED)
    np.testing.assert_allclose(found.x, exact, rtol=1e-6)
    assert found.cost == pytest.approx(squares[0] / 2.0)


def test_a_fit_ends_where_no_shorter_step_helps() -> None:
    tried: list[float] = []

    def jagged(x: np.ndarray) -> np.ndarray:
        tried.append(float(x[0]))
        return np.array([1.0 if x[0] == 0.0 else 2.0])

    found = fit(jagged, lambda x: np.array([[-1.0]]), FREE[:1], [0.0])
    assert found.x == [0.0] and found.cost == 0.5
    # The start, and steps of which each is clearly shorter.
    assert len(tried) == 5
    assert tried[1] > tried[2] > 1.2 * tried[3] > 5.0 * tried[4] > 0.0


def test_a_start_and_an_end_lie_within_the_bounds() -> None:
    tight = (FREE[0]._replace(high=0.3), *FREE[1:])
    found = fit(residual, lambda x: -DESIGN, tight, [2.0, 0.0, 0.0])
    assert found.x[0] == pytest.approx(0.3, abs=1e-6)


@pytest.mark.parametrize("central", [True, False])
def test_differences_are_derivatives(central: bool) -> None:
    def arrays(x: np.ndarray) -> list[np.ndarray]:
        return [np.sin(x[0]) * np.arange(3.0), x[:1] * x[1:]]

    x = np.array([0.4, 2.0])
    here = () if central else arrays(x)
    found = differences(arrays, x, {0: 1e-6, 1: -1e-6}, here)
    np.testing.assert_allclose(found[0][0], np.cos(0.4) * np.arange(3.0), rtol=1e-5)
    assert found[0][1] == pytest.approx(2.0)
    assert np.all(found[1][0] == 0.0)
    assert found[1][1] == pytest.approx(0.4)


def test_covariance_of_white_residuals_is_the_textbook_s() -> None:
    textbook = np.linalg.inv(DESIGN.T @ DESIGN)
    np.testing.assert_allclose(covariance(DESIGN), textbook, rtol=1e-9)
    found = covariance(DESIGN, [residual(TRUTH)])
    ratio = np.sqrt(np.diag(found) / np.diag(textbook))
    assert np.all((ratio > 0.999) & (ratio < 1.2))


def test_covariance_counts_residuals_that_last_once() -> None:
    held = 20
    design, told = (np.repeat(a, held, axis=0) for a in (DESIGN, residual(TRUTH)))
    few = np.sqrt(np.diag(covariance(DESIGN)))
    many = np.sqrt(np.diag(covariance(design, [told])))
    assert np.all(np.abs(many / few - 1.0) < 0.35)


@pytest.mark.parametrize("sequences", [0, 1, 2])
def test_two_that_act_alike_are_told_apart_from_the_rest(sequences: int) -> None:
    twins = 1e3 * DESIGN[:, [0, 0, 1]]
    parts = np.split(residual(TRUTH), 2)
    residuals = [[], [np.concatenate(parts)], parts][sequences]
    found = covariance(twins, residuals)
    (shares,) = undetermined_directions(found, 0.5)
    np.testing.assert_allclose(np.abs(shares), [0.5**0.5, 0.5**0.5, 0.0], atol=1e-6)
    assert shares[0] == pytest.approx(-shares[1])
    alone = covariance(1e3 * DESIGN[:, :2], residuals)
    total = np.array([1.0, 1.0, 0.0])
    assert total @ found @ total == pytest.approx(alone[0, 0], rel=0.05)


def test_combinations_are_told_from_the_least_certain_on() -> None:
    found = undetermined_directions(np.diag([1.0, 9.0, 0.01, 4.0]), 1.0)
    np.testing.assert_allclose(np.abs(found), np.eye(4)[[1, 3, 0]])


def test_intervals_are_those_of_the_place() -> None:
    plain = Tuned(Parameter("x", "m"), 5.0, 0.1, -9.0, 9.0)
    found = estimate(plain, 3.0, 2.0)
    assert (found.value, found.unit) == (pytest.approx(5.3), "m")
    assert found.ci95 == pytest.approx((5.3 - 0.392, 5.3 + 0.392), abs=1e-5)
    factor = Tuned(Parameter("x", "m", scale="log"), 5.0, 0.1, -9.0, 9.0)
    low, high = estimate(factor, 3.0, 2.0).ci95
    assert low * high == pytest.approx((5.0 * math.exp(0.3)) ** 2)
    assert high / low == pytest.approx(math.exp(2.0 * 0.392), abs=1e-4)
    assert all(map(math.isfinite, estimate(factor, 0.0, 1e9).ci95))
    assert found.holds(5.0) and not found.holds(5.7)
    # Of a deviation that six degrees of freedom tell, by the tables of Student's t.
    wider = estimate(plain, 3.0, 2.0, 6.0).ci95
    assert wider == pytest.approx((5.3 - 0.4894, 5.3 + 0.4894), abs=1e-4)


def test_a_step_within_bounds_is_that_of_bounded_least_squares() -> None:
    random = np.random.default_rng(0)
    for _ in range(20):
        table, error = random.normal(size=(30, 5)), random.normal(size=30)
        high = random.uniform(0.0, 0.3, 5)
        found = bounded_step(table.T @ table, table.T @ error, 0.0, -high, high)
        wanted = lsq_linear(table, -error, (-high, high + 1e-12)).x
        costs = [np.sum((error + table @ step) ** 2) for step in (found, wanted)]
        assert np.all(np.abs(found) <= high)
        assert costs[0] <= 1.01 * costs[1]
