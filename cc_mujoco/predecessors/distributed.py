"""This package's model behind the interface of the others (chapter 2 of the thesis)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.compiled import FloatArray, compiled
from cc_mujoco.predecessors.model import Answer, Environment, Model, scales, springs
from cc_mujoco.transmission import kernel, rest_state

_ROUNDS = 60
"""Most evaluations per step for the balance of cable and spring."""


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
        state = rest_state(cable, initial_tension)
        values = np.array(cable.scalars)
        sections = np.array(cable.conduit, dtype=np.float64)
        factor = scales(wrap_scale, near.size)
        return Answer(
            *_play(
                values,
                sections,
                cable.segments,
                state,
                near,
                moved,
                stiffness,
                factor,
                dt,
            )
        )


@compiled
def _play(
    values: FloatArray,
    sections: FloatArray,
    n: int,
    state: FloatArray,
    near: FloatArray,
    moved: FloatArray,
    stiffness: float,
    factor: FloatArray,
    dt: float,
) -> FloatArray:
    """Tension of both ends and place of the distal one, (3, samples)."""
    prm = np.empty(kernel.parameter_size(n))
    kernel.pack(values, sections, n, prm)
    new, work = state.copy(), np.empty(kernel.work_size(n))
    changing = factor.max() != factor.min() or factor[0] != 1.0
    bent = sections.copy()
    first, last = kernel.STATE_HEADER, kernel.STATE_HEADER + n
    rest = max(state[last], 0.0)
    out = np.empty((3, near.size))
    far = 0.0
    for row in range(near.size):
        if changing:
            bent[:, 1] = sections[:, 1] / factor[row]
            kernel.pack(values, bent, n, prm)
            kernel.expect_change(prm)
        if np.isinf(stiffness):
            far = moved[row]
            kernel.advance(prm, n, state, near[row], far, dt, new, work)
        else:
            far = _balance(
                prm, n, state, near[row], far, rest, stiffness, dt, new, work
            )
        state, new = new, state
        out[0, row] = max(state[first], 0.0)
        out[1, row] = max(state[last], 0.0)
        out[2, row] = far
    return out


@compiled
def _balance(
    prm: FloatArray,
    n: int,
    state: FloatArray,
    near: float,
    start: float,
    rest: float,
    stiffness: float,
    dt: float,
    new: FloatArray,
    work: FloatArray,
) -> float:
    """Place of the distal end where the cable's tension is the spring's.

    Excess of the cable's tension rises with the place at least as the spring's falls,
    so the excess at the start brackets the balance (regula falsi, Illinois).
    """
    last = kernel.STATE_HEADER + n
    a = start
    kernel.advance(prm, n, state, near, a, dt, new, work)
    excess_a = max(new[last], 0.0) - rest + stiffness * a
    if excess_a == 0.0:
        return a
    b = a - excess_a / stiffness
    kernel.advance(prm, n, state, near, b, dt, new, work)
    excess_b = max(new[last], 0.0) - rest + stiffness * b
    at = b
    for _ in range(_ROUNDS):
        if excess_b == 0.0 or abs(b - a) < 1e-15 + 1e-13 * abs(b):
            break
        at = b - excess_b * (b - a) / (excess_b - excess_a)
        kernel.advance(prm, n, state, near, at, dt, new, work)
        excess = max(new[last], 0.0) - rest + stiffness * at
        if excess * excess_b < 0.0:
            a, excess_a = b, excess_b
        else:
            excess_a *= 0.5
        b, excess_b = at, excess
    return float(at)
