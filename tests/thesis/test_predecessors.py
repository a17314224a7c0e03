"""Accuracy of the models in the comparison with predecessors."""

from __future__ import annotations

import numpy as np
import pytest

from thesis._experiments import predecessors
from thesis.predecessors import Distributed, PassiveDistributed, StaticCapstan
from thesis.predecessors._capabilities import CABLE, DT, SPRING


@pytest.mark.study
def test_distributed_models_are_right_in_motion_and_before_it() -> None:
    proximal = predecessors.motion()
    truth = Distributed(CABLE.replace(segments=100)).replay(DT, proximal, SPRING)
    unit = predecessors.cost(Distributed(CABLE), proximal)
    found = [
        predecessors.judge(kind(CABLE), proximal, truth, unit)
        for kind in (StaticCapstan, PassiveDistributed, Distributed)
    ]
    static, passive, ours = found
    assert max(passive.moving, passive.starting, ours.moving, ours.starting) < 0.01
    assert min(static.moving, static.starting) > 0.5
    assert static.cost < passive.cost
    moving = np.abs(np.gradient(truth.u_distal)) > 1e-9
    assert 0.2 < np.mean(moving) < 0.8
