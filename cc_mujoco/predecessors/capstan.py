"""The static capstan ratio: what simulators that know cable friction at all use today.

A spring of the cable's stiffness gives the tension at the motor; the tension at the
joint is that times e^(mu theta s), s the direction of motion (Euler's belt equation).
Nothing inside the cable has a state, so at a reversal the output jumps.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.predecessors.model import Answer, Environment, Model, scales, springs


class StaticCapstan(Model):
    """Elastic tendon with the tension ratio of Euler's belt equation."""

    name: ClassVar[str] = "static capstan ratio"

    def replay(
        self,
        dt: float,
        u_proximal: ArrayLike,
        environment: Environment,
        *,
        initial_tension: ArrayLike | None = None,
        wrap_scale: ArrayLike | None = None,
    ) -> Answer:
        """See `Model.replay`; has no initial profile, since it has no inside."""
        if initial_tension is not None:
            raise self.refuse("a tension profile", "it has one tension, not many")
        near = np.asarray(u_proximal, dtype=np.float64)
        stiffness, moved = springs(environment, near.size)
        cable = self.cable
        wrap = cable.friction * cable.wrap * scales(wrap_scale, near.size)
        direction = np.sign(np.diff(near + moved, prepend=0.0))
        # At rest the last direction holds; before any motion there is none.
        last = np.maximum.accumulate(np.where(direction != 0, np.arange(near.size), 0))
        ratio = np.exp(wrap * direction[last])
        own = cable.axial_stiffness / cable.length
        if np.isinf(stiffness):
            far = moved
        else:  # ratio (T0 + K (far - near)) = T0 - k far
            far = (cable.pretension * (1.0 - ratio) + ratio * own * near) / (
                ratio * own + stiffness
            )
        tension = np.maximum(cable.pretension + own * (far - near), 0.0)
        return Answer(tension, tension * ratio, far)
