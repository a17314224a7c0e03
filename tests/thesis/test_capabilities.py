"""Capabilities of each model: the table of section 1.5 of the thesis, recomputed."""

from __future__ import annotations

import numpy as np
import pytest

from thesis._experiments.predecessors import (
    CABLE,
    CAPABILITY_TESTS,
    DT,
    SPRING,
    end_tension,
    find_capabilities,
    front_pull,
    onset_pull,
)
from thesis._predecessors import (
    BristleChain,
    Distributed,
    LumpedMasses,
    ModifiedBoucWen,
    Motion,
    PassiveDistributed,
    StaticCapstan,
)

BRISTLES = {
    "partial motion",
    "motion from both ends",
    "non-uniform pretension",
    "non-spring environment",
    "creates no energy",
}
ABLE = {
    StaticCapstan: {"slack", "changing curvature", "creates no energy"},
    LumpedMasses: set(),
    BristleChain: BRISTLES,
    ModifiedBoucWen: set(),
    PassiveDistributed: {
        "partial motion",
        "slack",
        "non-uniform pretension",
        "creates no energy",
    },
    Distributed: set(CAPABILITY_TESTS),
}


def made(kind):
    if kind is not ModifiedBoucWen:
        return kind(CABLE)
    time = np.arange(0.0, 2.0, DT)
    proximal = -2.5 * onset_pull(CABLE) * np.sin(np.pi * time)
    motion = Motion(DT, proximal, SPRING)
    return kind.fitted(CABLE, motion, Distributed(CABLE).answer(motion))


@pytest.mark.parametrize("kind", ABLE, ids=lambda kind: kind.__name__)
def test_each_model_shows_what_its_equations_can(kind):
    found = find_capabilities(made(kind))
    assert {name for name, finding in found.items() if finding[0]} == ABLE[kind]


def test_front_formula_is_its_own_inverse_and_ends_at_the_onset():
    assert end_tension(CABLE, front_pull(CABLE, 15.0)) == pytest.approx(15.0, rel=1e-9)
    pull = 0.6 * onset_pull(CABLE)
    assert CABLE.pretension < end_tension(CABLE, pull) < CABLE.pretension * np.e
