"""Slipping segments and slack nodes, found by policy iteration.

Same chain as in `_fronts.py`. Mostly what slips is what slipped in the step before, or
nearly, and what is slack was slack. Each round solves the step for one guess and
corrects it where a law does not hold (policy iteration, Howard 1960). The tensions of a
step are unique, so a guess that needs no correction is right, however it was found.
Not unique is where a piece slips whose every node is slack or at its limit: it may
move as a whole, and takes the same energy wherever it stays.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.cable._chain_solve import lay_slack, slipping, solve
from cc_mujoco.cable._fronts import LIMIT_TOLERANCE, overcome_direction
from cc_mujoco.native import FloatArray, internal

_QUICK_ROUNDS = 6
"""Rounds after which nodes change only where all segments are right."""
_MAX_ROUNDS = 12
"""Rounds after which `solve_with_slack` leaves a step to `_graph.py`: 3 % of random
steps that follow each other (`tests/cable/test_solvers.py`)."""


@internal
def solve_marked(
    n: int,
    tension: FloatArray,
    stiffness: FloatArray,
    hold_distal: FloatArray,
    hold_proximal: FloatArray,
    drag: FloatArray,
    viscosity: FloatArray,
    slip_direction: FloatArray,
    slack: FloatArray,
    proximal_p: float,
    proximal_q: float,
    distal_p: float,
    distal_q: float,
    shift: FloatArray,
    node: FloatArray,
    lines: FloatArray,
    work: FloatArray,
) -> None:
    """Solve a step whose slip and slack nodes are known, and lay what is slack."""
    lies = False
    for s in range(n - 1, -1, -1):
        if slack[s + 1] != 0.0 and drag[s] == 0.0 and viscosity[s] == 0.0:
            slack[s] = 1.0
        if slack[s] != 0.0 and slack[s + 1] != 0.0:
            slip_direction[s] = 0.0
            lies = True
    gain, offset, own = lines[:n], lines[n : 2 * n], lines[2 * n :]
    for s in range(n):
        if slip_direction[s] == 0.0:
            own[s] = np.inf
            continue
        gain[s], offset[s], own[s] = slipping(
            slip_direction[s], hold_distal[s], hold_proximal[s], drag[s], viscosity[s]
        )
    solve(
        n, tension, stiffness, gain, offset, own, slack,
        proximal_p, proximal_q, distal_p, distal_q, shift, node, work,
    )  # fmt: skip
    for i in range(n + 1):
        node[i] = max(node[i], 0.0)
    if not lies:
        return
    free = gain
    for s in range(n):
        free[s] = 1.0 if drag[s] == 0.0 and viscosity[s] == 0.0 else 0.0
    lay_slack(
        n, free, tension, stiffness, slack,
        proximal_p, proximal_q, distal_p, distal_q, shift,
    )  # fmt: skip


@internal
def solve_with_slack(
    n: int,
    tension: FloatArray,
    stiffness: FloatArray,
    hold_distal: FloatArray,
    hold_proximal: FloatArray,
    drag: FloatArray,
    viscosity: FloatArray,
    slip_direction: FloatArray,
    slack: FloatArray,
    proximal_p: float,
    proximal_q: float,
    distal_p: float,
    distal_q: float,
    shift: FloatArray,
    node: FloatArray,
    lines: FloatArray,
    work: FloatArray,
) -> bool:
    """Solve one step in which any node may be or become slack; return if found.

    `slip_direction` (n,) and `slack` (n + 1,) are the guess on input. Where correcting
    all at once turns in a circle, nodes wait for the segments.
    """
    for rounds in range(_MAX_ROUNDS):
        for s in range(n):
            if slack[s] != 0.0 and drag[s] == 0.0 and viscosity[s] == 0.0:
                slack[s + 1] = 1.0
        solve_marked(
            n, tension, stiffness, hold_distal, hold_proximal, drag, viscosity,
            slip_direction, slack, proximal_p, proximal_q, distal_p, distal_q,
            shift, node, lines, work,
        )  # fmt: skip
        right = True
        for s in range(n):
            way = slip_direction[s]
            if way == 0.0 or shift[s] == 0.0:
                now = overcome_direction(
                    node[s], node[s + 1], hold_distal[s], hold_proximal[s], drag[s]
                )
                if now != 0 and float(now) == way:
                    # Slack at both ends of a chain that slips: one of them is taut.
                    slack[s], slack[s + 1] = 0.0, 0.0
                    right = False
                elif float(now) != way:
                    slip_direction[s] = float(now)
                    right = False
            elif shift[s] * way < 0.0:
                slip_direction[s] = 0.0
                right = False
        may_change = right or rounds < _QUICK_ROUNDS
        for i in range(n + 1):
            if not np.isfinite(node[i]):
                return False
            if i == 0:
                strained, strain = proximal_p, proximal_q * shift[0]
            elif i == n:
                strained, strain = distal_p, -distal_q * shift[n - 1]
            else:
                strained = tension[i]
                strain = stiffness[i] * (shift[i] - shift[i - 1])
            now_slack = 1.0 if strained + strain < 0.0 else 0.0
            if now_slack == slack[i] or not may_change:
                continue
            size = abs(strain)
            if 0 < i < n:
                size = stiffness[i] * (abs(shift[i]) + abs(shift[i - 1]))
            if abs(strained + strain) > LIMIT_TOLERANCE * (abs(strained) + size):
                slack[i], right = now_slack, False
        if right:
            return True
    return False
