"""Errors of a rig by trial are those of its samples, over those of noise."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from floors import by_trial, told

from cc_mujoco.diagnosis import CrossValidation

DT = 0.01


def crossed() -> CrossValidation:
    """Two trials of 3 s: errors of 1 and 2, noise of 0.5, over what divides them.

    One second is not held out.
    """
    errors = (np.full((2, 300), 1.0), np.full((2, 300), 2.0))
    errors[1][:, :100] = np.nan
    records = tuple(SimpleNamespace(trial=name, dt=DT) for name in ("one", "two"))
    problem: Any = SimpleNamespace(
        plant=SimpleNamespace(records=records),
        sensed=[np.full((2, 300), 0.5), np.full((2, 300), 1.0)],
        floor=[np.full((2, 300), 1.0), np.full((2, 300), 2.0)],
        inflation=2.0,
    )
    return CrossValidation(problem, (), errors)


def test_squares_are_by_trial_of_what_was_held_out() -> None:
    model = crossed()
    assert by_trial(model) == {
        "one": [[300.0] * 2, [75.0] * 2],
        "two": [[800.0] * 2, [50.0] * 2],
    }
    assert model.misfit**2 == pytest.approx(1100.0 / 125.0)


def test_a_line_says_how_far_trials_disagree() -> None:
    line = told(
        {
            "make": "guides", "seed": 7, "trials": "rich", "effect": "",
            "misfit": 1.22,
            "squares": {
                "a": [[100.0, 100.0], [100.0, 100.0]],
                "b": [[200.0, 200.0], [100.0, 100.0]],
            },
        }
    )  # fmt: skip
    assert "squares: 1.50 +- 0.50 (+1.0)" in line
    assert "channels 1.50 1.50; trials 1.00 2.00" in line
    assert "none" in line
