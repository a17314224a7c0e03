"""Recursive least squares that forgets only where something new is learnt."""

from __future__ import annotations

import numpy as np
import pytest

from thesis._estimators import RecursiveLeastSquares


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
