"""One step of a cable whose friction builds up elastically, on bristles.

The chain is that of `_fronts.py`. Before it slips, a segment is held by a spring to its
conduit (bristles). Its friction is the smaller of the spring's force and Coulomb's
limit,

    T_distal = min(max(T_proximal + f + s w, lower), upper),

with the spring's force f before the step, its stiffness s and the displacement w, upper
= H T_proximal + B and lower its mirror image. Each of the three is one line in the
displacements of neighbours, increasing in the segment's own and decreasing in the
others, so that the step is a sequence of tridiagonal systems: guess which segments slip
and which nodes are slack, solve, correct the guess (policy iteration). It takes two to
four rounds.

With a minimum and a maximum this may cycle: in one step of some 3,000 it did, with
random cables. Correcting the choices of the maximum until they settle before each
correction of those of the minimum cannot (Hoffman and Karp 1966).
"""

import numpy as np

from cc_mujoco.cable import _chain_solve as chains
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable._chain_solve import Chain, ChainMotion
from cc_mujoco.cable._layout import Step
from cc_mujoco.native import FloatArray, internal

_ROUNDING = 1e-12


@internal
def _limits(chain: Chain, s: int, proximal: float, w: float) -> tuple[float, float]:
    """Return the least and largest distal tension [N] that Coulomb friction allows."""
    drag, viscous = chain.drag[s], chain.viscosity[s] * w
    least = (proximal - drag + viscous) / chain.hold_proximal[s]
    return least, chain.hold_distal[s] * proximal + drag + viscous


@internal
def _segment_line(
    chain: Chain, s: int, direction: float, held: FloatArray, spring: FloatArray
) -> tuple[float, float, float]:
    """Return `gain`, `offset` [N] and `own` [N/m] of segment s, see `_chain_solve.py`.

    If `direction` is 0 its bristles hold it, with stiffness `spring` [N/m] and force
    `held` [N]; else it slips that way.
    """
    if direction == 0.0:
        return 1.0, held[s], spring[s] + chain.viscosity[s]
    return chains.slipping(chain, s, direction)


@internal
def _node_tension(i: int, n: int, chain: Chain, shift: FloatArray) -> float:
    """Return the tension of node i after `shift` (n,) [m], negative where slack [N]."""
    if i == 0:
        return float(chain.proximal_p + chain.proximal_q * shift[0])
    if i == n:
        return float(chain.distal_p - chain.distal_q * shift[n - 1])
    return float(chain.tension[i] + chain.stiffness[i] * (shift[i] - shift[i - 1]))


@internal
def _solve_choices(
    n: int, chain: Chain, held: FloatArray, spring: FloatArray, motion: ChainMotion,
    work: FloatArray,
) -> None:  # fmt: skip
    """Solve for `shift` of `motion`, given its `direction` and slack nodes.

    `work` (4 n,) begins with slack of the nodes before and behind every segment.
    """
    tension, stiffness, shift = chain.tension, chain.stiffness, motion.shift
    slack_before, slack_behind = work[:n], work[n : 2 * n]
    ratio, right = work[2 * n : 3 * n], work[3 * n : 4 * n]
    for s in range(n):
        gain, offset, own = _segment_line(chain, s, motion.direction[s], held, spring)
        # A segment that nothing else would determine has some stiffness.
        low, diagonal, high = 0.0, max(own, 1e-9 * stiffness[s]), 0.0
        constant = -offset
        if slack_before[s] == 0.0:
            p, q = chain.proximal_p, chain.proximal_q
            if s > 0:
                p, q = tension[s], stiffness[s]
                low = -gain * q
            diagonal += gain * q
            constant -= gain * p
        if slack_behind[s] == 0.0:
            p, q = chain.distal_p, chain.distal_q
            if s < n - 1:
                p, q = tension[s + 1], stiffness[s + 1]
                high = -q
            diagonal += q
            constant += p
        if s > 0:
            diagonal -= low * ratio[s - 1]
            constant -= low * right[s - 1]
        ratio[s], right[s] = high / diagonal, constant / diagonal
    shift[n - 1] = right[n - 1]
    for s in range(n - 2, -1, -1):
        shift[s] = right[s] - ratio[s] * shift[s + 1]


@internal
def _find_choices(
    n: int, chain: Chain, held: FloatArray, spring: FloatArray, motion: ChainMotion,
    work: FloatArray,
) -> None:  # fmt: skip
    """Find the slip direction of each segment, and the slack nodes.

    With tensions cut off at zero, the law of a segment reads

        min(max(elastic, lower), upper)(max(T_proximal, 0)) + min(-T_distal, 0) = 0.

    The maximum chooses between `elastic` and `lower`, and whether the node before the
    segment is slack; the minimum whether the segment slips towards distal, and whether
    the node behind it is slack. The minimum chooses again only when the choices of the
    maximum have settled; the displacements then move one way only, so no choice
    returns. `work` holds (4 n,); other arguments are those of `preslide`.
    """
    shift, direction, slack = motion.shift, motion.direction, motion.slack
    slack_before, slack_behind = work[:n], work[n : 2 * n]
    for s in range(n):
        slack_before[s], slack_behind[s] = slack[s], slack[s + 1]
    for _ in range(400):
        _solve_choices(n, chain, held, spring, motion, work)
        settled = True
        for minimum in range(2):
            if minimum == 1 and not settled:
                break
            for s in range(n):
                w = shift[s]
                before = _node_tension(s, n, chain, shift)
                behind = _node_tension(s + 1, n, chain, shift)
                proximal = max(before, 0.0)
                viscosity = chain.viscosity[s]
                scale = abs(before) + abs(behind) + chain.drag[s] + abs(held[s])
                scale += (chain.stiffness[s] + spring[s] + viscosity) * abs(w)
                least, most = _limits(chain, s, proximal, w)
                elastic = proximal + held[s] + (spring[s] + viscosity) * w
                largest = max(least, elastic)
                value, best = largest, min(largest, most)
                node, chosen = behind, slack_behind
                if direction[s] > 0.0:
                    value = most
                if minimum == 0:
                    node, chosen = before, slack_before
                    if direction[s] == 0.0:
                        value = elastic
                    elif direction[s] < 0.0:
                        value = least
                    best = most if direction[s] > 0.0 else largest
                if abs(value - best) > _ROUNDING * scale:
                    settled = False
                    direction[s] = 1.0
                    if best == largest:
                        direction[s] = -1.0 if least > elastic else 0.0
                now = 1.0 if node < 0.0 else 0.0
                if now != chosen[s] and abs(node) > _ROUNDING * scale:
                    chosen[s], settled = now, False
        if settled:
            break
    for s in range(n):
        slack[s], slack[s + 1] = slack_before[s], slack_behind[s]


@internal
def preslide(n: int, chain: Chain, step: Step) -> bool:
    """Solve one step with bristles; return whether a solution was found.

    Rows of scratch: `SPRING` is the stiffness of each segment's bristles [N/m], `HELD`
    their force [N] before and after the step. `SLIPPED` is the expected slip direction
    on input, and on output the slip [m]: displacement less added bristle stretch.
    """
    work, node = step.work, at.tensions(step.new_state, n)
    held, spring = at.row(work, n, at.HELD), at.row(work, n, at.SPRING)
    shift, slipped = at.row(work, n, at.SHIFT), at.row(work, n, at.SLIPPED)
    growth_distal = at.row(work, n, at.GROWTH)
    growth_proximal = at.row(work, n, at.GROWTH_PROXIMAL)
    slip_direction, slack = work[:n], work[n : 2 * n + 1]
    motion = ChainMotion(slip_direction, slack, shift, node)
    lines, rest = work[2 * n + 1 : 5 * n + 1], work[5 * n + 1 :]
    gain, offset, own = lines[:n], lines[n : 2 * n], lines[2 * n :]
    free = rest[2 * n :]
    for i in range(n + 1):
        slack[i] = 1.0 if chain.tension[i] < 0.0 else 0.0
    for s in range(n):
        slip_direction[s] = 0.0
        if slipped[s] != 0.0:
            slip_direction[s] = 1.0 if slipped[s] > 0.0 else -1.0
    settled = False
    # No step of 160 random motions settles later; one that never does costs a
    # controller's period.
    for rounds in range(20):
        if rounds >= 12:
            _find_choices(n, chain, held, spring, motion, work[2 * n + 1 :])
        for s in range(n):
            way = slip_direction[s]
            gain[s], offset[s], own[s] = _segment_line(chain, s, way, held, spring)
        chains.solve(n, chain, lines, motion, rest)
        for s in range(n):
            free[s] = 1.0 if own[s] == 0.0 and offset[s] == 0.0 else 0.0
        chains.lay_slack(n, chain, free, motion)
        largest = 0.0
        for i in range(n + 1):
            largest = max(largest, abs(node[i]))
        settled = True
        for i in range(n + 1):
            behind = shift[i - 1] if i > 0 else 0.0
            ahead = shift[i] if i < n else 0.0
            strained = _node_tension(i, n, chain, shift)
            now = 1.0 if strained < 0.0 else 0.0
            if now != slack[i]:
                slack[i] = now
                scale = largest + chain.stiffness[i] * (abs(ahead) + abs(behind))
                if abs(strained) > _ROUNDING * scale:
                    settled = False
        for s in range(n):
            proximal, w = node[s], shift[s]
            least, most = _limits(chain, s, proximal, w)
            elastic = proximal + held[s] + (spring[s] + chain.viscosity[s]) * w
            now, wanted = 0.0, elastic
            if elastic > most:
                now, wanted = 1.0, most
            elif elastic < least:
                now, wanted = -1.0, least
            both = slack[s] != 0.0 and slack[s + 1] != 0.0
            if both and slip_direction[s] != 0.0 and own[s] == 0.0 != offset[s]:
                # No displacement balances drag without tension: its bristles give way.
                now, settled = 0.0, False
            if now != slip_direction[s]:
                scale = abs(proximal) + abs(node[s + 1]) + chain.drag[s]
                if abs(node[s + 1] - wanted) > _ROUNDING * scale:
                    settled = False
                slip_direction[s] = now
        if not settled:
            continue
        # A segment that slips follows the kinetic law: solve again with it.
        for s in range(n):
            way = slip_direction[s]
            if chains.break_away(chain, s, way, growth_distal, growth_proximal):
                settled = False
        if settled:
            break
    if not settled:
        return False
    for i in range(n + 1):
        if not np.isfinite(node[i]):
            return False
        node[i] = max(node[i], 0.0)
    for s in range(n):
        proximal, w = node[s], shift[s]
        stretched = held[s] + spring[s] * w
        slipped[s] = 0.0
        if slip_direction[s] != 0.0:
            # What Coulomb friction takes, without the share of viscosity.
            force = (chain.hold_distal[s] - 1.0) * proximal + chain.drag[s]
            if slip_direction[s] < 0.0:
                force = -(chain.hold_proximal[s] - 1.0) * node[s + 1] - chain.drag[s]
            if spring[s] > 0.0:
                slipped[s] = (stretched - force) / spring[s]
            else:
                slipped[s] = w
            stretched = force
        held[s] = stretched
    return True
