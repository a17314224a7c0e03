"""The two ways of finding which segments slip give one answer."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco.cable._chain_solve import Chain, ChainMotion
from cc_mujoco.cable._fronts import CoulombChain, march, repeat_slip
from cc_mujoco.cable._graph import solve_by_graph, solve_with_slack, sweep
from cc_mujoco.native import FloatArray


def chain(rng, n, drag):
    """Return a random state of a cable inside its friction cone, and end motions."""
    growth = np.exp(rng.uniform(0.0, 0.1, n))
    tension = np.empty(n + 1)
    tension[0] = rng.uniform(1.0, 50.0)
    for j in range(n):
        tension[j + 1] = tension[j] * growth[j] ** rng.uniform(-0.99, 0.99)
    stiffness = rng.uniform(0.5, 2.0, n + 1) * 1e5
    ends = rng.uniform(-1e-3, 1e-3, 2) * rng.choice([1.0, 1e-2], 2)
    return tension, stiffness, growth, np.full(n, drag), ends


def by_march(n, tension, stiffness, growth, drag, proximal, distal):
    shift, node, work = np.empty(n), np.empty(n + 1), np.zeros(10 * (n + 1))
    half = np.full(n, 1.0 / stiffness[0])
    still = np.zeros(n)
    given = CoulombChain(tension, 1.0 / stiffness, half, growth, growth, still, drag)
    ok = march(n, given, proximal, distal, shift, node, work)
    return ok, shift, node


def by_sweep(n, tension, stiffness, growth, drag, proximal, distal, last=None):
    shift, node, work = np.empty(n), np.empty(n + 1), np.zeros(11 * (n + 1))
    last = np.zeros(n) if last is None else last
    given = Chain(
        tension, stiffness, growth.copy(), growth.copy(), drag, np.zeros(n),
        tension[0] - stiffness[0] * proximal, stiffness[0],
        tension[n] + stiffness[n] * distal, stiffness[n],
    )  # fmt: skip
    sweep(n, last, given, growth, growth, shift, node, work)
    return shift, node


@given(
    seed=st.integers(0, 2**31), n=st.integers(1, 40), drag=st.sampled_from([0.0, 0.3])
)
@settings(max_examples=100)
def test_marching_and_sweeping_agree(seed, n, drag):
    rng = np.random.default_rng(seed)
    tension, stiffness, growth, drags, (du, dv) = chain(rng, n, drag)
    ok, shift, node = by_march(n, tension, stiffness, growth, drags, du, dv)
    shift_2, node_2 = by_sweep(n, tension, stiffness, growth, drags, du, dv)
    # The march refines the null point of opposed motion; a cable about to go slack is
    # left to the sweep.
    if not ok or du * dv < 0.0 or np.any(node <= 0.0):
        return
    assert np.allclose(node, node_2, rtol=1e-8, atol=1e-8)
    assert np.allclose(shift, shift_2, atol=1e-12)


@given(seed=st.integers(0, 2**31), n=st.integers(1, 40))
@settings(max_examples=200)
def test_what_slipped_last_changes_no_solution(seed, n):
    """Neither a wrong guess nor a right one, from inside the friction cone or not."""
    rng = np.random.default_rng(seed)
    tension, stiffness, growth, drag, (du, dv) = chain(rng, n, rng.choice([0.0, 0.3]))
    if rng.random() < 0.5:
        tension = rng.uniform(1.0, 60.0, n + 1)
    shift, node = by_sweep(n, tension, stiffness, growth, drag, du, dv)
    for last in (shift, -shift, rng.normal(size=n), np.full(n, rng.normal())):
        again = by_sweep(n, tension, stiffness, growth, drag, du, dv, last)
        assert np.allclose(again[0], shift, rtol=1e-9, atol=1e-12)
        assert np.allclose(again[1], node, rtol=1e-9, atol=1e-9)


def require_laws(tension, stiffness, growth, drag, ends, shift, node):
    """Check the equations of the springs and the friction limits."""
    moved = np.concatenate([[ends[0]], shift, [ends[1]]])
    strained = tension + stiffness * np.diff(moved)
    assert np.all(node >= 0.0)
    assert np.allclose(node, np.maximum(strained, 0.0), atol=1e-7)
    low, high = node[:-1], node[1:]
    limit = 1e-7
    loaded = np.maximum(low, high) + drag > limit
    right, left = (shift > 1e-13) & loaded, (shift < -1e-13) & loaded
    assert np.allclose(high[right], (growth * low + drag)[right], atol=limit)
    assert np.allclose(low[left], (growth * high + drag)[left], atol=limit)
    assert np.all(high <= growth * low + drag + limit)
    assert np.all(low <= growth * high + drag + limit)


@given(seed=st.integers(0, 2**31), n=st.integers(1, 30))
@settings(max_examples=100)
def test_the_sweep_solves_any_state(seed, n):
    """Equations and friction limits hold, also from far outside the friction cone."""
    rng = np.random.default_rng(seed)
    _, stiffness, growth, drag, ends = chain(rng, n, rng.choice([0.0, 0.5]))
    tension = rng.uniform(0.0, 60.0, n + 1)
    shift, node = by_sweep(n, tension, stiffness, growth, drag, *ends)
    require_laws(tension, stiffness, growth, drag, ends, shift, node)


def test_slip_that_goes_on_is_that_of_the_sweep():
    """Steps that follow each other while the bends change, with drag and slack too.

    A guess is refused or right; most are right once the ends go on the same way.
    """
    rng, taken = np.random.default_rng(5), [0, 0]
    for _ in range(300):
        n = int(rng.integers(1, 41))
        tension, stiffness, growth, drag, ends = chain(rng, n, rng.choice([0.0, 0.3]))
        slips, soft = np.zeros(n), 1.0 / stiffness
        for k in range(4):
            args = tension, stiffness, growth, drag, *ends
            right, nodes = by_sweep(n, *args, slips)
            found, node, work = np.empty(n), np.empty(n + 1), np.zeros(8 * (n + 1))
            given = CoulombChain(tension, soft, soft[:n], growth, growth, slips, drag)
            if repeat_slip(n, given, *ends, found, node, work):
                taken[k > 0] += 1
                require_laws(tension, stiffness, growth, drag, ends, found, node)
                assert np.allclose(node, nodes, rtol=1e-8, atol=1e-8)
                assert np.allclose(found, right, rtol=1e-8, atol=1e-13)
            moved = np.diff(np.concatenate([[ends[0]], right, [ends[1]]]))
            tension = np.where(nodes > 0.0, nodes, tension + stiffness * moved)
            slips, ends = right, ends * rng.uniform(0.5, 1.0)
            growth = 1.0 + (growth - 1.0) * rng.uniform(0.999, 1.001, n)
    assert taken[0] < 60 and taken[1] > 350


def solve_both(
    n: int,
    tension: FloatArray,
    stiffness: FloatArray,
    growth: FloatArray,
    drag: FloatArray,
    proximal: float,
    distal: float,
    guess: FloatArray,
    found: FloatArray,
    right: FloatArray,
) -> bool:
    """Solve a step by policy iteration and by the graph; return whether both could."""
    work, none = np.zeros(11 * (n + 1)), np.zeros(n)
    proximal_p = tension[0] - stiffness[0] * proximal
    distal_p = tension[n] + stiffness[n] * distal
    given = Chain(
        tension, stiffness, growth, growth, drag, none, proximal_p, stiffness[0],
        distal_p, stiffness[n],
    )  # fmt: skip
    first = ChainMotion(np.zeros(n), np.zeros(n + 1), right[:n], right[n:])
    solve_by_graph(n, given, first, work)
    second = ChainMotion(guess[:n], guess[n:], found[:n], found[n:])
    return solve_with_slack(n, given, second, work[: 3 * n], work[3 * n :])


def solved_alike(tension, stiffness, growth, drag, ends, guess):
    """Return slips and tensions of a step, and whether it needed no graph."""
    n = growth.size
    found, right = np.empty(2 * n + 1), np.empty(2 * n + 1)
    own = solve_both(n, tension, stiffness, growth, drag, *ends, guess, found, right)
    for answer in (found, right) if own else (right,):
        require_laws(tension, stiffness, growth, drag, ends, answer[:n], answer[n:])
    if own:
        assert np.allclose(found[n:], right[n:], rtol=1e-8, atol=1e-8)
        # Where a piece floats, it is not determined which of two segments slips.
        lost, by_graph = (
            np.abs(np.diff(answer[n:]) * answer[:n]).sum() for answer in (found, right)
        )
        assert np.isclose(lost, by_graph, rtol=1e-8, atol=1e-9)
    return right[:n], right[n:], own


def test_slack_is_found_without_the_graph_and_as_by_it():
    """Steps from states and guesses that no cable has, then steps that follow them."""
    rng, needed = np.random.default_rng(3), [0, 0]
    for _ in range(200):
        n = int(rng.integers(1, 41))
        _, stiffness, growth, drag, ends = chain(rng, n, 0.3)
        drag *= rng.choice([0.0, 1.0]) * (rng.random(n) < rng.choice([0.5, 1.0]))
        tension = rng.uniform(-30.0, 30.0) + rng.uniform(-30.0, 30.0, n + 1)
        slips = rng.integers(-1, 2, n)
        for wild in (True, False, False):
            guess = np.concatenate([np.sign(slips), tension <= 0.0]).astype(float)
            slips, nodes, own = solved_alike(
                tension, stiffness, growth, drag, ends, guess
            )
            needed[wild] += not own
            moved = np.diff(np.concatenate([[ends[0]], slips, [ends[1]]]))
            tension = np.where(nodes > 0.0, nodes, tension + stiffness * moved)
            ends = tuple(0.3 * np.array(ends) + rng.uniform(-1e-4, 1e-4, 2))
    assert needed[True] < 100 and needed[False] < 20
