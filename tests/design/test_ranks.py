"""A controller of fixed gains judges designs by its fit; one that follows them, less.

Both are compared, by the ranks of a Latin hypercube of designs, with the model.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import spearmanr

from cc_mujoco.design import study

VARY = {
    "friction": "0.03:0.2",
    "wrap": "0.8:6",
    "motor_radius": "0.01:0.05",
    "joint_radius": "0.06:0.18",
    "pretension": "5:40",
    "axial_stiffness": "30000:300000:log",
}
METRIC = "rms_torque_error"


@pytest.mark.study
def test_tuned_gains_rank_designs_as_the_model_does_and_fixed_gains_do_not() -> None:
    laws = ("pi", "pi_tuned", "model")
    table = study(
        "ankle", VARY, sampling="lhs", samples=60, controllers=laws, duration=5.0,
        metrics=[METRIC],
    )  # fmt: skip
    found = {law: np.array(table[f"{METRIC}@{law}"].to_pylist(), float) for law in laws}
    ranks = {}
    for law in laws[:2]:
        both = np.isfinite(found[law]) & np.isfinite(found["model"])
        assert both.sum() > 50
        ranks[law] = spearmanr(found[law][both], found["model"][both]).statistic
    assert ranks["pi"] < 0.65
    assert ranks["pi_tuned"] > 0.8
