"""What an effect takes of the gap is that of the model it is in at last."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cc_mujoco.diagnosis.inference.baseline import fit_baseline, plant_of
from cc_mujoco.diagnosis.inference.fitting import fit
from cc_mujoco.diagnosis.inference.reason import shares_in
from cc_mujoco.diagnosis.inference.records import prepare
from diagnosis.recorded import BENCH, dataset

PULL = {"gravity_sine": 1.2, "gravity_cosine": 0.0}


def test_an_effect_that_was_idle_beside_others_counts_anew_without_them() -> None:
    data = dataset({"joint_gravity": PULL}, 2.0, seed=3, chosen=(0, 2))
    records, filtering = prepare(data, BENCH)
    base = fit_baseline(data, plant_of(data, BENCH, records), filtering, 0)
    problem = base.problem.with_effect("joint_gravity", PULL)
    x = fit(problem, problem.placed(base.whole.x, PULL), [r.counts for r in records]).x
    idle = {"joint_gravity": 0.01, "joint_stiffness": 0.01}
    with_others = SimpleNamespace(effects=tuple(idle))
    found: Any = SimpleNamespace(
        after=SimpleNamespace(problem=with_others), shares=idle
    )
    model: Any = SimpleNamespace(problem=problem, x=np.asarray(x))
    shares = shares_in(base, found, model)
    assert shares == {"joint_gravity": pytest.approx(1.0, abs=0.1)}
    with_others.effects = problem.effects
    assert shares_in(base, found, model) is idle
