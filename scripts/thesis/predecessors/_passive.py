"""Agrawal's distributed cable, moved by the motor alone (thesis 1.5, Fig. 1.6).

A massless elastic cable under Coulomb friction, as in chapter 2 of the thesis, with two
restrictions (Agrawal, Peine and Yao 2010; Agrawal et al. 2010): slip enters at the
motor's end only, and the output must be a known function of its tension, T_O = f(x_O).
Then one number decides a step, the tension at the motor: behind the front the capstan
law holds, ahead of it nothing has moved, and the front is where the two profiles meet.
A slack cable has no tension and no friction.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from cc_mujoco.cable._conduit import node_lengths
from cc_mujoco.estimation._tracks import wrap_angles
from cc_mujoco.native import FloatArray, FloatMatrix, compiled
from thesis.predecessors._model import Answer, Asked, PublishedModel, ReplayedMotion


class PassiveDistributed(PublishedModel):
    """Distributed Coulomb friction, motion entering from the motor only."""

    name: ClassVar[str] = "Agrawal, one-directional"
    refuses: ClassVar[Mapping[Asked, str]] = {
        "a moved output": "its tension must be a function of its place"
    }

    def answer(self, motion: ReplayedMotion) -> Answer:
        cable = self.cable
        n = cable.segments
        share = node_lengths(cable) / cable.axial_stiffness
        compliance = 1.0 / motion.stiffness
        share[n] += compliance  # the spring follows the last node
        out = np.empty((3, motion.proximal.size))
        _play(
            motion.proximal, cable.friction * wrap_angles(cable), share, motion.start,
            compliance, motion.factor, np.empty(n + 1), out,
        )  # fmt: skip
        return Answer(*out)


@compiled
def _play(
    proximal: FloatArray,
    angle: FloatArray,
    share: FloatArray,
    tension: FloatArray,
    compliance: float,
    factor: FloatArray,
    trial: FloatArray,
    out: FloatMatrix,
) -> None:
    """Compute the tension of both ends and place of the distal one, (3, samples).

    `trial` (n + 1,) is room for a tension that is tried.
    """
    n = angle.size - 1
    rest = tension[n]
    stretch, before = _dot(share, tension), 0.0
    for row in range(proximal.size):
        moved = proximal[row] - before
        before = proximal[row]
        stretch -= moved
        slip_direction = 1.0 if moved > 0.0 else -1.0
        if stretch <= 0.0:
            tension[:] = 0.0
        elif moved != 0.0:
            # The tension at the motor lies between what the cable has and what a front
            # of no length would give; a pull raises it, a push lowers it.
            low = high = tension[0]
            if slip_direction > 0.0:
                low = 0.0
            else:
                high -= moved / share[0]
            while True:
                middle = 0.5 * (low + high)
                _front(tension, angle, factor[row], slip_direction, middle, trial)
                if middle <= low or middle >= high:
                    break
                if _dot(share, trial) < stretch:
                    low = middle
                else:
                    high = middle
            tension, trial = trial, tension
        out[0, row] = tension[0]
        out[1, row] = tension[n]
        out[2, row] = compliance * (rest - tension[n])


@compiled
def _dot(a: FloatArray, b: FloatArray) -> float:
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@compiled
def _front(
    tension: FloatArray,
    angle: FloatArray,
    factor: float,
    slip_direction: float,
    at_motor: float,
    out: FloatArray,
) -> None:
    """Set the capstan line from the motor until it meets the earlier tension."""
    for i in range(angle.size):
        out[i] = tension[i]
    for i in range(angle.size):
        line = at_motor * np.exp(slip_direction * factor * angle[i])
        # A pull (way -1) raises tension, a push lowers it; the front is where not.
        if i > 0 and slip_direction * (tension[i] - line) <= 0.0:
            break
        out[i] = line
