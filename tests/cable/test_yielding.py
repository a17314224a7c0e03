"""Ends that move as their tensions change, within a step."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cable.random_cables import CABLES, cable_of, motion_of
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable import packed_parameters, rest_state
from study_marks import study_but

JUMPS = ("static_friction",)  # where a tension has two values


@pytest.mark.parametrize(
    "term", study_but(2, [name for name in CABLES if name not in JUMPS])
)
@given(seed=st.integers(0, 2**31))
@settings(max_examples=6)
def test_a_step_ends_where_it_would_if_its_ends_were_driven_there(
    term: str, seed: int
) -> None:
    """And they yield by what their tensions tell; parameters stay as they were.

    A solver for any friction has one answer for both. Fronts follow the ends through
    the step: a spring at an end takes it another way to the same place, and where
    fronts meet, the tensions of one segment depend on the way (0.2 of the friction of a
    segment at most in 1,800 motions, 0.73 with static friction).
    """
    rng = np.random.default_rng(seed)
    cable = cable_of(rng, term)
    proximal, distal = motion_of(rng, cable)
    n, prm = cable.segments, packed_parameters(cable)
    before = prm.copy()
    state, work = rest_state(cable), np.empty(kernel.work_size(n))
    yielding, plain = state.copy(), state.copy()
    hold, drag = layout.constant_hold(prm, n), layout.constant_drag(prm, n)
    marched = prm[layout.CONSTANT_COULOMB] != 0.0
    springs = [layout.HELD_PROXIMAL, layout.HELD_DISTAL]  # as before each step
    share = 1.0 if term == "static" else 0.5
    apart = []
    for u in zip(proximal[:60], distal[:60], strict=True):
        yields = 10.0 ** rng.uniform(-1.0, 2.0, 2) * layout.node_compliance(prm, n)[0]
        held = np.maximum(layout.tensions(state, n)[[0, n]], 0.0)
        kernel.expect_yielding(prm, *yields)
        assert kernel.advance(prm, n, state, *u, 1e-3, yielding, work) == kernel.OK
        assert np.array_equal(np.delete(prm, springs), np.delete(before, springs))
        assert kernel.advance(prm, n, state, *yielding[:2], 1e-3, plain, work) == 0
        ours, theirs = (
            np.maximum(layout.tensions(x, n), 0.0) for x in (yielding, plain)
        )
        largest = max(theirs.max(), cable.pretension, 1.0)
        most = (1e-4 if term == "grease" else 1e-9) * largest
        if marched:
            high = np.maximum(theirs[1:], theirs[:-1])
            most += share * float(((hold - 1.0) * high + drag).max())
        assert ours == pytest.approx(theirs, abs=most)
        apart.append(np.abs(ours - theirs).mean() / largest)
        slack = (kernel.slack_length(prm, n, x) for x in (yielding, plain))
        assert next(slack) == pytest.approx(next(slack), rel=1e-3, abs=1e-7)
        assert yielding[3] == pytest.approx(plain[3], rel=1e-6, abs=1e-9)
        ends = np.maximum(layout.tensions(yielding, n)[[0, n]], 0.0)
        gone = yields * (ends - held) * (1.0, -1.0)
        assert yielding[:2] - u == pytest.approx(gone, abs=1e-12)
        state[:] = yielding
    assert np.mean(apart) < 5e-4


def test_springs_of_still_ends_are_gone_after_a_step_whose_bends_may_change() -> None:
    cable = cable_of(np.random.default_rng(0), "coulomb")
    n, prm = cable.segments, packed_parameters(cable)
    kernel.expect_change(prm)
    before, state = prm.copy(), rest_state(cable)
    new, work = state.copy(), np.empty(kernel.work_size(n))
    kernel.expect_yielding(prm, 1e-4, 1e-4)
    assert kernel.advance(prm, n, state, *state[:2], 1e-3, new, work) == kernel.OK
    assert np.array_equal(prm, before)
    assert new[:4] == pytest.approx(state[:4], abs=1e-15)
