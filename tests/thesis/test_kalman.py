"""The statements of section 3.1, one by one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from thesis._experiments import kalman


@pytest.mark.parametrize("segments", [2, 5, 12])
def test_state_transition_matrix_is_zero(segments: int) -> None:
    matrix = kalman.transition_matrix(segments)
    assert matrix.shape == (2 * segments + 2, segments + 1)
    assert not np.any(matrix)


@pytest.mark.parametrize("mean", [True, False])
def test_jacobian_vanishes_away_from_zero_velocity(mean: bool) -> None:
    velocity = np.linspace(-0.2, 0.2, 40_001)
    for k in kalman.SHARPNESSES:
        curve = np.abs(kalman.jacobian(velocity, k, mean))
        assert np.max(curve[np.abs(velocity) > 15.0 / k]) < 1e-9
        assert np.max(curve) > 1e3 * np.max(curve[np.abs(velocity) > 10.0 / k])


@pytest.mark.parametrize("mean", [True, False])
@pytest.mark.parametrize("u_1", [0.002, 0.01, -0.004])
def test_jacobian_is_that_of_the_smoothed_equation(mean: bool, u_1: float) -> None:
    """Against differences of (3.15), solved by a root finder."""
    k, step = 100.0, 1e-6
    angle, scale = kalman.segment_constants()

    def velocity(u_2: float, u_1_before: float, u_2_before: float) -> float:
        ahead = u_1 - u_1_before
        return 0.5 * (ahead + u_2 - u_2_before) if mean else ahead

    def now(u_1_before: float, u_2_before: float) -> float:
        def lack(u_2: float) -> float:
            smooth = np.tanh(k * velocity(u_2, u_1_before, u_2_before))
            return u_2 - u_1 - scale * float(np.expm1(angle * smooth))

        return float(brentq(lack, u_1 - 1.0, u_1 + 1.0, xtol=1e-15))

    way = np.array([0.0, 1.0]) if mean else np.array([1.0, 0.0])
    difference = (now(*step * way) - now(*-step * way)) / (2.0 * step)
    at = np.array([velocity(now(0.0, 0.0), 0.0, 0.0)])
    expected = kalman.jacobian(at, k, mean)[0]
    assert difference == pytest.approx(expected, rel=1e-4)


def test_noise_multiplies_changes_of_motion() -> None:
    assert kalman.changes_of_motion(0.0) == 2.0
    assert kalman.changes_of_motion(0.02) < kalman.changes_of_motion(0.1)
    assert kalman.changes_of_motion(0.1) > 8.0


def test_printed_filter_equations_are_not_those_of_a_kalman_filter() -> None:
    error, believed = kalman.filter_error()
    assert believed == pytest.approx(error, rel=0.05)
    error, believed = kalman.filter_error("(3.4)")
    assert believed > 1.15 * error
    assert kalman.filter_error("(3.7)")[1] == float("inf")
