"""This package's model behind the interface of the others (chapter 2 of the thesis)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable import rest_state
from cc_mujoco.cable._layout import tensions
from cc_mujoco.native import FloatArray
from thesis.predecessors._model import Answer, PublishedModel, ReplayedMotion


class Distributed(PublishedModel):
    """Distributed Coulomb friction, motion entering from both ends."""

    name: ClassVar[str] = "this package"

    def answer(self, motion: ReplayedMotion) -> Answer:
        cable = self.cable
        out = np.empty((3, motion.proximal.size))
        _play(
            # Arms of one, so that an angle is a displacement, a torque a tension.
            stepper.make_cables((cable,), (1.0,), (-1.0,)),
            np.array(cable.scalars),
            np.array(cable.conduit, dtype=np.float64),
            rest_state(cable, motion.start)[None],
            motion.proximal,
            motion.moved,
            motion.stiffness,
            motion.factor,
            motion.dt,
            out,
        )
        return Answer(*out)


def _play(
    cables: stepper.Cables,
    values: FloatArray,
    sections: FloatArray,
    state: FloatArray,
    proximal: FloatArray,
    moved: FloatArray,
    stiffness: float,
    factor: FloatArray,
    dt: float,
    out: FloatArray,
) -> None:
    """Compute the tension of both ends and place of the distal one, (3, samples)."""
    n, prm = cables.n[0], cables.prm[0]
    new, work = state.copy(), np.empty(kernel.work_size(n))
    changing = bool(np.any(factor != 1.0))
    bent = sections.copy()
    tension = tensions(state[0], n)
    rest = max(tension[n], 0.0)
    distal = 0.0
    for row in range(proximal.size):
        if changing:
            bent[:, 1] = sections[:, 1] / factor[row]
            kernel.pack(values, bent, n, prm)
            kernel.expect_change(prm)
        if np.isinf(stiffness):
            distal = moved[row]
            stepper.move(cables, state, proximal[row], -distal, dt, new, work)
        else:
            load = stepper.Load(rest, stiffness, -np.inf, np.inf)
            distal = -stepper.balance(
                cables, state, True, proximal[row], -distal, load, dt, new, work
            )
        state, new = new, state
        tension = tensions(state[0], n)
        out[0, row] = max(tension[0], 0.0)
        out[1, row] = max(tension[n], 0.0)
        out[2, row] = distal
