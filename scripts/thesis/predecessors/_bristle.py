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

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cc_mujoco.cable import Cable
from cc_mujoco.cable._conduit import node_lengths, packed_parameters
from cc_mujoco.cable._kernel import segment_angles
from cc_mujoco.native import FloatArray, FloatMatrix, compiled
from thesis.predecessors._model import Answer, PublishedModel, ReplayedMotion

_MAX_ITERATIONS = 200  # most steps of Newton's method
_FORCE_TOLERANCE = 1e-9  # force out of balance that ends them [N]


@dataclass(frozen=True)
class Bristle:
    """Shape of the friction."""

    # displacement over which friction builds up, F_c / sigma_0 [m]
    length: float = 2e-5
    exponent: float = 1.0  # delta_D of Dahl's law
    excess: float = 0.0  # of static over kinetic friction, relative (LuGre)
    stribeck_speed: float = 1e-3  # over which the excess fades [m/s] (LuGre)
    damping: float = 0.0  # of the bristles, sigma_1 over sigma_0 [s] (LuGre)


DAHL = Bristle()
LUGRE = Bristle(excess=0.2, damping=1e-3)


class BristleChain(PublishedModel):
    """Chain of springs with Dahl or LuGre friction at its nodes."""

    name: ClassVar[str] = "Palli and Melchiorri, Dahl"

    def __init__(self, cable: Cable, bristle: Bristle = DAHL) -> None:
        """Take a cable and the shape of the friction."""
        super().__init__(cable)
        self.bristle = bristle

    def answer(self, motion: ReplayedMotion) -> Answer:
        """See `PublishedModel.answer`; does not know slack."""
        cable = self.cable
        n = cable.segments
        segment = segment_angles(packed_parameters(cable), n)
        shape = self.bristle
        out = np.empty((3, motion.proximal.size))
        _play(
            motion.proximal,
            motion.moved,
            motion.stiffness,
            cable.friction * segment,
            cable.axial_stiffness / node_lengths(cable),
            motion.start,
            np.array(
                [
                    shape.length,
                    shape.exponent,
                    shape.excess,
                    shape.stribeck_speed,
                    shape.damping,
                ]
            ),
            motion.factor,
            motion.dt,
            np.zeros((8, n + 1)),
            np.zeros((2, n + 1)),
            out,
        )
        return Answer(*out)


class LuGreChain(BristleChain):
    """The chain with LuGre friction."""

    name: ClassVar[str] = "Palli and Melchiorri, LuGre"

    def __init__(self, cable: Cable) -> None:
        """Take a cable."""
        super().__init__(cable, LUGRE)


@compiled
def _play(
    proximal: FloatArray,
    moved: FloatArray,
    load: float,
    grip: FloatArray,
    stiffness: FloatArray,
    tension: FloatArray,
    shape: FloatArray,
    factor: FloatArray,
    dt: float,
    room: FloatMatrix,
    ends: FloatMatrix,
    out: FloatMatrix,
) -> None:
    """Compute the tension of both ends and place of the distal one, (3, samples).

    Friction acts at the middle of every segment (displacement x_j); springs of the
    cable lie between, of `stiffness` (n + 1,). `load` is infinite where the distal
    end is held or moved. `room` (8, n + 1) and `ends` (2, n + 1) are zero.
    """
    n = grip.size
    held = np.isinf(load)
    rest = tension[n]
    spring, start = ends[0], ends[1]
    for i in range(n + 1):
        spring[i], start[i] = stiffness[i], tension[i]
    if not held:
        spring[n] = spring[n] * load / (spring[n] + load)
    x, slip, limit = room[0, :n], room[1, :n], room[2, :n]
    friction, speed = room[3, :n], room[4, :n]
    for j in range(n):
        friction[j] = tension[j + 1] - tension[j]
    for row in range(proximal.size):
        distal = moved[row] if held else 0.0
        for j in range(n):
            mean = 0.5 * (max(tension[j], 0.0) + max(tension[j + 1], 0.0))
            more = shape[2] * np.exp(-((speed[j] / shape[3]) ** 2))
            limit[j] = mean * grip[j] * factor[row] * (1.0 + more)
            slip[j] = 0.0
        _settle(
            start, spring, proximal[row], distal, friction, limit, shape, dt, x, slip,
            room[5], room[6, :n], room[7, :n],
        )  # fmt: skip
        _tensions(start, spring, proximal[row], distal, x, tension)
        for j in range(n):
            friction[j] = _bristle(friction[j], slip[j], limit[j], shape, dt)[2]
            speed[j] = slip[j] / dt
        out[0, row], out[1, row] = tension[0], tension[n]
        out[2, row] = distal if held else (rest - tension[n]) / load


@compiled
def _tensions(
    start: FloatArray,
    spring: FloatArray,
    proximal: float,
    distal: float,
    x: FloatArray,
    tension: FloatArray,
) -> None:
    """Compute the tension of every spring (n + 1,)."""
    n = x.size
    before = proximal
    for i in range(n + 1):
        after = x[i] if i < n else distal
        tension[i] = start[i] + spring[i] * (after - before)
        before = after


@compiled
def _settle(
    start: FloatArray,
    spring: FloatArray,
    proximal: float,
    distal: float,
    friction: FloatArray,
    limit: FloatArray,
    shape: FloatArray,
    dt: float,
    x: FloatArray,
    slip: FloatArray,
    tension: FloatArray,
    rest: FloatArray,
    diagonal: FloatArray,
) -> None:
    """Move x until every segment is in balance, T_{j+1} - T_j = F_j.

    Newton's method; steps are shortened where the kink of friction at rest makes them
    overshoot.
    """
    n = x.size
    last, pace = np.inf, 1.0
    for _ in range(_MAX_ITERATIONS):
        _tensions(start, spring, proximal, distal, x, tension)
        size = 0.0
        for j in range(n):
            force, slope, _ = _bristle(friction[j], slip[j], limit[j], shape, dt)
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
            x[j] += pace * ahead
            slip[j] += pace * ahead


@compiled
def _bristle(
    friction: float, slip: float, limit: float, shape: FloatArray, dt: float
) -> tuple[float, float, float]:
    """Return friction after a slip, its slope, and the part stored in bristles."""
    if limit <= 0.0:
        return 0.0, 0.0, 0.0
    slip_direction = 1.0 if slip >= 0.0 else -1.0
    short = 1.0 - slip_direction * friction / limit
    side = 1.0 if short >= 0.0 else -1.0
    size, travel, exponent = abs(short), abs(slip) / shape[0], shape[1]
    if exponent == 1.0:
        size *= np.exp(-travel)
    elif size > 0.0:
        power = 1.0 - exponent
        size = max(size**power - power * travel, 0.0) ** (1.0 / power)
    stored = slip_direction * limit * (1.0 - side * size)
    slope = limit / shape[0] * side * size**exponent
    damping = shape[4] / dt
    force = stored + damping * (stored - friction)
    return force, max(slope, 0.0) * (1.0 + damping), stored
