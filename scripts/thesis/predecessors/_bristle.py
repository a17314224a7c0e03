"""Palli and Melchiorri's chain with dynamic friction (thesis 1.5, eq. 1.2).

Kaneko's chain of springs, with the friction of bristles at every node in place of a
stiffness that depends on direction. Dahl's law bends friction F from sticking to
sliding as the cable moves,

    dF/dx = sigma_0 sgn(1 - sgn(v) F/F_c) |1 - sgn(v) F/F_c|^delta,

with F_c = mu T theta of the node, from the tension before the step. It is solved in
closed form over the motion of a step, so friction never passes F_c by integration. The
LuGre law (Canudas de Wit et al. 1995) adds a friction that falls with speed and the
damping of the bristles. Inertia of the cable is left out: at 2.5 g/m its waves pass in
a few milliseconds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cc_mujoco.cable import Cable
from cc_mujoco.cable._conduit import node_lengths, packed_parameters
from cc_mujoco.cable._kernel import segment_angles
from cc_mujoco.native import FloatArray, FloatMatrix, compiled
from thesis.predecessors._model import Answer, PublishedModel, ReplayedMotion

_MAX_ITERATIONS = 200  # most steps of Newton's method
_FORCE_TOLERANCE = 1e-9  # force out of balance that ends them [N]


class Bristle(NamedTuple):
    """Shape of the friction."""

    # displacement over which friction builds up, F_c / sigma_0 [m]
    length: float = 2e-5
    exponent: float = 1.0  # delta_D of Dahl's law
    excess: float = 0.0  # of static over kinetic friction, relative (LuGre)
    stribeck_speed: float = 1e-3  # over which the excess fades [m/s] (LuGre)
    damping: float = 0.0  # of the bristles, sigma_1 over sigma_0 [s] (LuGre)


class _Chain(NamedTuple):
    """Friction at the middle of every segment (n,), and springs between (n + 1,)."""

    spring: FloatArray  # stiffness [N/m]
    start: FloatArray  # tension at first [N]
    tension: FloatArray  # of the springs [N]
    friction: FloatArray  # [N]
    limit: FloatArray  # friction that slides [N]
    x: FloatArray  # displacement [m]
    slip: FloatArray  # of a step [m]
    speed: FloatArray  # [m/s]
    rest: FloatArray  # force out of balance [N]
    diagonal: FloatArray  # of the matrix [N/m]


class BristleChain(PublishedModel):
    """Chain of springs with Dahl or LuGre friction at its nodes; knows no slack."""

    name = "Palli and Melchiorri, Dahl"

    def __init__(self, cable: Cable, bristle: Bristle | None = None) -> None:
        super().__init__(cable)
        self.bristle = bristle or Bristle()

    def answer(self, motion: ReplayedMotion) -> Answer:
        cable, load, start = self.cable, motion.stiffness, motion.start
        n = cable.segments
        spring = cable.axial_stiffness / node_lengths(cable)
        if np.isfinite(load):
            spring[n] = spring[n] * load / (spring[n] + load)
        chain = _Chain(spring, start, start.copy(), np.diff(start), *np.zeros((6, n)))
        grip = cable.friction * segment_angles(packed_parameters(cable), n)
        out = np.empty((3, motion.proximal.size))
        _play(
            chain, self.bristle, motion.proximal, motion.moved, load, grip,
            motion.factor, motion.dt, out,
        )  # fmt: skip
        return Answer(*out)


class LuGreChain(BristleChain):
    """The chain with LuGre friction."""

    name = "Palli and Melchiorri, LuGre"

    def __init__(self, cable: Cable) -> None:
        super().__init__(cable, Bristle(excess=0.2, damping=1e-3))


@compiled
def _play(
    chain: _Chain,
    shape: Bristle,
    proximal: FloatArray,
    moved: FloatArray,
    load: float,
    grip: FloatArray,
    factor: FloatArray,
    dt: float,
    out: FloatMatrix,
) -> None:
    """Compute the tension of both ends and place of the distal one, (3, samples).

    `load` is the stiffness at the distal end, infinite where it is held or moved.
    """
    n, held, tension = grip.size, np.isinf(load), chain.tension
    for row in range(proximal.size):
        distal = moved[row] if held else 0.0
        for j in range(n):
            mean = 0.5 * (max(tension[j], 0.0) + max(tension[j + 1], 0.0))
            slow = chain.speed[j] / shape.stribeck_speed
            more = shape.excess * np.exp(-(slow**2))
            chain.limit[j] = mean * grip[j] * factor[row] * (1.0 + more)
            chain.slip[j] = 0.0
        _settle(chain, shape, proximal[row], distal, dt)
        _pull(chain, proximal[row], distal)
        for j in range(n):
            chain.friction[j] = _bristle(chain, shape, j, dt)[2]
            chain.speed[j] = chain.slip[j] / dt
        out[0, row], out[1, row] = tension[0], tension[n]
        out[2, row] = distal if held else (chain.start[n] - tension[n]) / load


@compiled
def _pull(chain: _Chain, proximal: float, distal: float) -> None:
    """Compute the tension of every spring."""
    n, before = chain.x.size, proximal
    for i in range(n + 1):
        after = chain.x[i] if i < n else distal
        chain.tension[i] = chain.start[i] + chain.spring[i] * (after - before)
        before = after


@compiled
def _settle(
    chain: _Chain, shape: Bristle, proximal: float, distal: float, dt: float
) -> None:
    """Move x until every segment is in balance, T_{j+1} - T_j = F_j.

    Newton's method; steps are shortened where the kink of friction at rest makes them
    overshoot.
    """
    n, last, pace = chain.x.size, np.inf, 1.0
    spring, tension = chain.spring, chain.tension
    rest, diagonal = chain.rest, chain.diagonal
    for _ in range(_MAX_ITERATIONS):
        _pull(chain, proximal, distal)
        size = 0.0
        for j in range(n):
            force, slope, _ = _bristle(chain, shape, j, dt)
            rest[j] = tension[j + 1] - tension[j] - force
            diagonal[j] = spring[j] + spring[j + 1] + slope
            size = max(size, abs(rest[j]))
        if size < _FORCE_TOLERANCE:
            return
        pace = min(1.0, 2.0 * pace) if size < last else max(0.5 * pace, 0.05)
        last = size
        for j in range(1, n):
            share = spring[j] / diagonal[j - 1]
            diagonal[j] -= share * spring[j]
            rest[j] += share * rest[j - 1]
        ahead = 0.0
        for j in range(n - 1, -1, -1):
            ahead = (rest[j] + spring[j + 1] * ahead) / diagonal[j]
            chain.x[j] += pace * ahead
            chain.slip[j] += pace * ahead


@compiled
def _bristle(
    chain: _Chain, shape: Bristle, j: int, dt: float
) -> tuple[float, float, float]:
    """Return friction after a slip, its slope, and the part stored in bristles."""
    friction, slip, limit = chain.friction[j], chain.slip[j], chain.limit[j]
    if limit <= 0.0:
        return 0.0, 0.0, 0.0
    slip_direction = 1.0 if slip >= 0.0 else -1.0
    short = 1.0 - slip_direction * friction / limit
    side = 1.0 if short >= 0.0 else -1.0
    size, travel, exponent = abs(short), abs(slip) / shape.length, shape.exponent
    if exponent == 1.0:
        size *= np.exp(-travel)
    elif size > 0.0:
        power = 1.0 - exponent
        size = max(size**power - power * travel, 0.0) ** (1.0 / power)
    stored = slip_direction * limit * (1.0 - side * size)
    slope = limit / shape.length * side * size**exponent
    damping = shape.damping / dt
    force = stored + damping * (stored - friction)
    return force, max(slope, 0.0) * (1.0 + damping), stored
