"""Kaneko's lumped masses, springs and dampers in series (thesis 1.5, Fig. 1.5).

Friction is not a force here but a change of stiffness: k = k_cable l/(e^l - 1) with
l = mu theta, of the sign of the motion, gives the stretch that friction causes for a
tension at the output, which at the input is e^l times larger (Kaneko, Yamashita and
Tanie 1991; Kaneko, Wada, Maekawa and Tanie 1991; as in the thesis's account). The
system is linear between reversals: no part of the cable can stand still, tension may be
negative, and where the direction changes the stiffness jumps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from cc_mujoco.cable import Cable
from cc_mujoco.native import FloatArray
from thesis.predecessors._model import Answer, Asked, PublishedModel, ReplayedMotion


class LumpedMasses(PublishedModel):
    """Mass-spring-damper chain with direction-dependent apparent stiffness."""

    name: ClassVar[str] = "Kaneko, lumped masses"
    refuses: ClassVar[Mapping[Asked, str]] = {
        "a moved output": "its environment must be a spring",
        "a tension profile": "pretension is one number",
        "bends that change": "its stiffness is set once",
    }

    def __init__(
        self, cable: Cable, masses: int = 10, line_density: float = 2.5e-3
    ) -> None:
        """Choose the number of masses.

        Args:
            line_density: mass per length [kg/m]; a steel rope of 0.75 mm has 2.5e-3.
        """
        super().__init__(cable)
        self.masses, self.line_density = masses, line_density

    def answer(self, motion: ReplayedMotion) -> Answer:
        """See `PublishedModel.answer`; a chain for either way of moving."""
        proximal, stiffness = motion.proximal, motion.stiffness
        steps, gains = zip(
            *(self._system(motion.dt, sign, stiffness) for sign in (-1.0, 1.0)),
            strict=True,
        )
        stretch = np.empty((proximal.size, 2))
        _step_through(proximal, np.array(steps), np.array(gains), stretch)
        angle = self.cable.friction * self.cable.wrap
        direction = np.sign(np.diff(proximal, prepend=0.0))
        last = np.maximum.accumulate(
            np.where(direction != 0, np.arange(proximal.size), 0)
        )
        ratio = np.exp(-angle * direction[last])
        spring = np.array([self._spring(sign) for sign in (-1.0, 1.0)])
        now = np.where(direction[last] > 0, spring[1], spring[0])
        distal = stretch[:, 1] if np.isfinite(stiffness) else np.zeros(proximal.size)
        tension = self.cable.pretension + now * stretch[:, 0]
        return Answer(tension * ratio, tension, distal)

    def _spring(self, sign: float) -> float:
        """Return an element's stiffness for motion of this sign, positive to distal."""
        angle = -sign * self.cable.friction * self.cable.wrap
        own = self.cable.axial_stiffness / self.cable.length * self.masses
        return own * angle / math.expm1(angle) if angle else own

    def _system(
        self, dt: float, sign: float, stiffness: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return A and b of implicit Euler: new state = A old state + b u_proximal.

        Masses 1 ... n at the nodes beyond the motor's; where the output is locked the
        last one is held. State: displacements, then velocities.
        """
        n = self.masses
        k = self._spring(sign)
        mass = self.line_density * self.cable.length / n
        damping = 2.0 * math.sqrt(k * mass)  # critical for one element
        chain = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
        chain[-1, -1] = 1.0
        pull = np.zeros(n)
        pull[0] = k
        load = np.zeros((n, n))
        load[-1, -1] = 1e9 * k if math.isinf(stiffness) else stiffness
        whole = k * chain + load
        matrix = mass * np.eye(n) + dt * damping * chain + dt**2 * whole
        inverse = np.linalg.inv(matrix)
        by_velocity = inverse * mass
        by_place = -dt * inverse @ whole
        by_input = dt * inverse @ pull
        step = np.block(
            [[np.eye(n) + dt * by_place, dt * by_velocity], [by_place, by_velocity]]
        )
        return step, np.concatenate([dt * by_input, by_input])


def _step_through(
    proximal: FloatArray, steps: FloatArray, gains: FloatArray, out: FloatArray
) -> None:
    """Compute stretch of the last element and place of the last mass (samples, 2)."""
    n = steps.shape[1] // 2
    state = np.zeros(2 * n)
    which = 0
    for row in range(proximal.size):
        if row > 0 and proximal[row] != proximal[row - 1]:
            which = 1 if proximal[row] > proximal[row - 1] else 0
        state = gains[which] * proximal[row] + steps[which] @ state
        before = state[n - 2] if n > 1 else proximal[row]
        out[row, 0] = state[n - 1] - before
        out[row, 1] = state[n - 1]
