"""The static capstan ratio: what simulators that know cable friction at all use today.

A spring of the cable's stiffness gives the tension at the motor; the tension at the
joint is that times e^(mu theta s), s the direction of motion (Euler's belt equation).
Nothing inside the cable has a state, so at a reversal the output jumps.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from thesis.predecessors._model import Answer, Asked, PublishedModel, ReplayedMotion


class StaticCapstan(PublishedModel):
    """Elastic tendon with the tension ratio of Euler's belt equation."""

    name: ClassVar[str] = "static capstan ratio"
    refuses: ClassVar[Mapping[Asked, str]] = {
        "a tension profile": "it has one tension, not many"
    }

    def answer(self, motion: ReplayedMotion) -> Answer:
        """See `PublishedModel.answer`; the whole cable slips or rests."""
        proximal, moved, stiffness = motion.proximal, motion.moved, motion.stiffness
        cable = self.cable
        wrap = cable.friction * cable.wrap * motion.factor
        direction = np.sign(np.diff(proximal + moved, prepend=0.0))
        # At rest the last direction holds; before any motion there is none.
        last = np.maximum.accumulate(
            np.where(direction != 0, np.arange(proximal.size), 0)
        )
        ratio = np.exp(wrap * direction[last])
        own = cable.axial_stiffness / cable.length
        if np.isinf(stiffness):
            distal = moved
        else:  # ratio (T0 + K (far - near)) = T0 - k far
            distal = (cable.pretension * (1.0 - ratio) + ratio * own * proximal) / (
                ratio * own + stiffness
            )
        tension = np.maximum(cable.pretension + own * (distal - proximal), 0.0)
        return Answer(tension, tension * ratio, distal)
