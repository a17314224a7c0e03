"""Shares and errors are those of the model that is left at last."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from cc_mujoco.diagnosis import fit, fit_baseline, plant_of, prepare
from cc_mujoco.diagnosis._search.candidates import Changes
from cc_mujoco.diagnosis._search.search import Search, final_search
from diagnosis.recorded import BENCH, dataset

PULL = {"gravity_sine": 1.2, "gravity_cosine": 0.0}


def test_what_is_left_of_a_model_counts_anew() -> None:
    data = dataset({"joint_gravity": PULL}, 2.0, seed=3, chosen=(0, 2))
    records, filtering = prepare(data, BENCH)
    base = fit_baseline(data, plant_of(data, BENCH, records), filtering, 0)
    problem = base.problem.with_effect("joint_gravity", PULL)
    x = fit(problem, problem.placed(base.whole.x, PULL), [r.counts for r in records]).x
    idle = {"joint_gravity": 0.01, "joint_stiffness": 0.01}
    found = Search(
        base.crossed,
        SimpleNamespace(problem=problem),
        (),
        (),
        idle,  # type: ignore
        Changes(),
    )
    assert final_search(found, problem, x) is found
    both: Any = SimpleNamespace(effects=tuple(idle))
    more = found._replace(after=SimpleNamespace(problem=both))
    left = final_search(more, problem, x)
    assert left.shares == {"joint_gravity": pytest.approx(1.0, abs=0.1)}
    assert left.after.problem is problem
    assert left.after.misfit < 0.2 * left.before.misfit
    nothing = final_search(found, base.problem, base.whole.x)
    assert nothing.after is base.crossed
