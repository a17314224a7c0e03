"""This package's model behind the interface of the others (chapter 2 of the thesis)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.compiled import FloatArray, compiled
from cc_mujoco.predecessors.model import Answer, Environment, Model, scales, springs
from cc_mujoco.transmission import kernel, rest_state, stepper
from cc_mujoco.transmission.packing import tensions


class Distributed(Model):
    """Distributed Coulomb friction, motion entering from both ends."""

    name: ClassVar[str] = "this package"

    def replay(
        self,
        dt: float,
        u_proximal: ArrayLike,
        environment: Environment,
        *,
        initial_tension: ArrayLike | None = None,
        wrap_scale: ArrayLike | None = None,
    ) -> Answer:
        """See `Model.replay`; takes everything."""
        near = np.ascontiguousarray(u_proximal, dtype=np.float64)
        stiffness, moved = springs(environment, near.size)
        cable = self.cable
        # Arms of one, so that an angle is a displacement and a torque a tension.
        cables = stepper.between((cable,), (1.0,), (-1.0,))
        state = rest_state(cable, initial_tension)[None]
        values = np.array(cable.scalars)
        sections = np.array(cable.conduit, dtype=np.float64)
        factor = scales(wrap_scale, near.size)
        return Answer(
            *_play(cables, values, sections, state, near, moved, stiffness, factor, dt)
        )


@compiled
def _play(
    cables: stepper.Cables,
    values: FloatArray,
    sections: FloatArray,
    state: FloatArray,
    near: FloatArray,
    moved: FloatArray,
    stiffness: float,
    factor: FloatArray,
    dt: float,
) -> FloatArray:
    """Tension of both ends and place of the distal one, (3, samples)."""
    n, prm = cables.n[0], cables.prm[0]
    new, work = state.copy(), np.empty(kernel.work_size(n))
    changing = factor.max() != factor.min() or factor[0] != 1.0
    bent = sections.copy()
    tension = tensions(state[0], n)
    rest = max(tension[n], 0.0)
    out = np.empty((3, near.size))
    far = 0.0
    for row in range(near.size):
        if changing:
            bent[:, 1] = sections[:, 1] / factor[row]
            kernel.pack(values, bent, n, prm)
            kernel.expect_change(prm)
        if np.isinf(stiffness):
            far = moved[row]
            stepper.move(cables, state, near[row], -far, dt, new, work)
        else:
            load = stepper.Load(rest, stiffness, -np.inf, np.inf)
            far = -stepper.balance(
                cables, state, True, near[row], -far, load, dt, new, work
            )
        state[:] = new
        out[0, row] = max(tension[0], 0.0)
        out[1, row] = max(tension[n], 0.0)
        out[2, row] = far
    return out
