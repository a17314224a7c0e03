"""Errors of a rig by trial are those of its samples, over the floor."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from diagnose_benchmark import off
from floors import noise_alone, summed, told

DT = 0.01


def crossed(inflation: float) -> Any:
    """Two trials of 3 s: errors of 1 and 2 floors; one second is not held out."""
    errors = [np.full((2, 300), 1.0), np.full((2, 300), 2.0)]
    errors[1][:, :100] = np.nan
    noise = [np.full((2, 300), 0.5), np.full((2, 300), 0.5)]
    floor = [np.full((2, 300), 1.0), np.full((2, 300), 2.0)]
    records = tuple(SimpleNamespace(trial=name, dt=DT) for name in ("one", "two"))
    problem = SimpleNamespace(
        inflation=inflation,
        plant=SimpleNamespace(records=records),
        noise=noise,
        floor=floor,
    )
    return SimpleNamespace(problem=problem, errors=errors)


@pytest.mark.parametrize("inflation", [1.0, 3.0])
def test_squares_are_by_trial_and_second_of_what_was_held_out(inflation: float) -> None:
    model = crossed(inflation)
    result = cast(Any, SimpleNamespace(baseline_fit=SimpleNamespace(crossed=model)))
    found = off(result)
    assert found == {
        "one": [[inflation**2] * 2] * 3,
        "two": [[4.0 * inflation**2] * 2] * 2,
    }
    np.testing.assert_allclose(summed(found)[:, 0], np.array([1.0, 4.0]) * inflation**2)
    # 300 samples of (1/2)^2 and 200 of (1/4)^2.
    expected = inflation**2 * (300 * 0.25 + 200 * 0.0625) / 500
    assert noise_alone(model) == pytest.approx([expected] * 2, abs=1e-3)


def test_a_rig_that_was_not_fitted_has_none() -> None:
    assert off(cast(Any, SimpleNamespace(baseline_fit=None))) == {}


def test_a_line_says_how_far_trials_disagree() -> None:
    line = told(
        {
            "make": "guides", "seed": 7, "trials": "rich", "effect": "", "misfit": 1.1,
            "noise": [0.6, 0.5],
            "off": {"a": [[1.0, 1.0]], "b": [[2.0, 2.0]]},
        }
    )  # fmt: skip
    assert "mean 1.50 +- 0.50 (+1.0)" in line
    assert "trials 1.00 2.00" in line
    assert "none" in line
