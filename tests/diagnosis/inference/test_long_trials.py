"""Long trials are thinned where the model is far off, and only there."""

from __future__ import annotations

import numpy as np
import pytest

from cc_mujoco.diagnosis import Options, run_inference
from cc_mujoco.diagnosis._fit.fit import BaselineFit, fit_scene
from cc_mujoco.diagnosis._phrases import no_progress
from diagnosis.recorded import BENCH, DT, dataset

LONG = 20.0
SOFT = {"end_compliance": {"end_compliance": 2e-4, "end_compliance_antagonist": 2e-4}}


def fitted(
    effects: dict[str, dict[str, float]], duration: float, thinned: bool
) -> BaselineFit:
    trials = dataset(effects, duration=duration)
    found = fit_scene(trials, BENCH, Options(thinned=thinned), no_progress)
    assert isinstance(found, BaselineFit)
    return found


def test_a_tuned_scene_at_the_floor_keeps_all_samples() -> None:
    found, usual = (fitted({}, LONG, thinned) for thinned in (True, False))
    assert found.problem.plant.records[0].dt == DT
    np.testing.assert_array_equal(found.whole.x, usual.whole.x)


def test_a_short_trial_keeps_all_samples() -> None:
    found = fitted(SOFT, 8.0, True)
    assert found.problem.plant.records[0].dt == DT
    assert found.resolves(found.problem, found.whole.x)


def test_a_scene_that_is_far_off_is_fitted_to_fewer_samples() -> None:
    found, usual = (fitted(SOFT, LONG, thinned) for thinned in (True, False))
    assert found.problem.plant.records[0].dt == pytest.approx(0.02)
    assert found.crossed.misfit > 100.0
    assert found.crossed.misfit == pytest.approx(usual.crossed.misfit, rel=0.05)
    stiff, other = (
        each.problem.values(each.whole.x)["axial_stiffness"] for each in (found, usual)
    )
    assert stiff == pytest.approx(other, rel=0.05)


def test_a_model_that_reaches_the_floor_is_fitted_to_all_samples() -> None:
    trials = dataset(SOFT, duration=LONG)
    found = run_inference(trials, BENCH, Options(["end_compliance"])).found
    assert found is not None
    assert found.problem.effects == ("end_compliance",)
    assert found.problem.plant.records[0].dt == DT
    assert found.search.after.misfit < 1.15
