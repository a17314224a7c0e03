"""Accuracy of the models in the comparison with predecessors."""

from __future__ import annotations

import numpy as np
import pytest

from thesis._experiments import predecessors
from thesis._experiments.predecessors import CABLE
from thesis._predecessors import (
    Distributed,
    PassiveDistributed,
    StaticCapstan,
)


@pytest.mark.study
def test_distributed_models_are_right_in_motion_and_before_it() -> None:
    motion = predecessors.strokes()
    truth = Distributed(CABLE.replace(segments=100)).answer(motion)
    unit = predecessors.cost(Distributed(CABLE), motion)
    found = [
        predecessors.judge(kind(CABLE), motion, truth, unit)
        for kind in (StaticCapstan, PassiveDistributed, Distributed)
    ]
    static, passive, ours = found
    assert max(passive.moving, passive.starting, ours.moving, ours.starting) < 0.01
    assert min(static.moving, static.starting) > 0.5
    assert static.cost < passive.cost
    moving = np.abs(np.gradient(truth.u_distal)) > 1e-9
    assert 0.2 < np.mean(moving) < 0.8
