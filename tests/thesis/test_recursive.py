"""Recursive least squares that forgets only where something new is learnt."""

from __future__ import annotations

import numpy as np
import pytest

from cc_mujoco.estimation._recursive import RecursiveEstimate
from thesis._experiments.online import RecursiveLeastSquares


def test_endless_memory_is_bayesian_least_squares() -> None:
    random = np.random.default_rng(7)
    rows, right = random.normal(size=(30, 3)), random.normal(size=30)
    start, spread = np.array([1.0, -2.0, 0.5]), np.array([0.5, 1.0, 3.0])
    fit = RecursiveLeastSquares(start, spread, np.inf)
    for row, y in zip(rows, right, strict=True):
        fit.update(np.outer(row, row), row * y)
    weight = np.diag(spread**-2.0)
    precision = weight + rows.T @ rows
    assert fit.value == pytest.approx(
        np.linalg.solve(precision, weight @ start + rows.T @ right)
    )
    assert fit.covariance == pytest.approx(np.linalg.inv(precision))


def test_silent_direction_is_not_forgotten() -> None:
    fit = RecursiveLeastSquares([0.0, 0.0], [1.0, 1.0], 20.0)
    for _ in range(100):
        fit.update(np.eye(2), np.array([3.0, 4.0]))
    before = fit.value[1], fit.covariance[1, 1]
    for _ in range(1000):
        fit.update(np.diag([1.0, 0.0]), np.array([5.0, 0.0]))
    assert fit.value[0] == pytest.approx(5.0, rel=0.01)
    assert (fit.value[1], fit.covariance[1, 1]) == pytest.approx(before)


def test_one_parameter_is_followed_as_one_of_two() -> None:
    """It has a recursion of its own, without matrices, which runs in C too."""
    random = np.random.default_rng(8)
    alone = RecursiveEstimate(0.3, 0.2, 50.0, 1e-3)
    beside = RecursiveLeastSquares([0.3, 1.0], [0.2, 1.0], 50.0, [1e-3, 0.0])
    for size, told in zip(
        random.uniform(0.0, 40.0, 200), random.normal(8.0, 3.0, 200), strict=True
    ):
        alone.update(np.array([[size]]), np.array([told]))
        beside.update(np.diag([size, 0.0]), np.array([told, 0.0]))
        assert alone.value[0] == pytest.approx(beside.value[0], rel=1e-10)
        assert alone.deviation[0] == pytest.approx(
            np.sqrt(beside.covariance[0, 0]), rel=1e-8
        )
    before = alone.value[0]
    alone.update(np.zeros((1, 1)), np.zeros(1))
    assert alone.value[0] == before
