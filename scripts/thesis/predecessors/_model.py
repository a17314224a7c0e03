"""Interface of a cable model here: a recorded motion in, both end tensions out.

    model = Distributed(cable)                     # ours, or one of those before
    answer = model.replay(1e-3, u_proximal, EndSpring(stiffness=500.0, preload=10.0))
    answer.tension_proximal, answer.tension_distal

Every model is made from the same `Cable`. Displacements are positive towards distal and
count from rest in the pretension. A model that cannot do what is requested raises
`CableError` with the reason.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.cable import Cable
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray


@dataclass(frozen=True)
class Locked:
    """The distal end does not move."""


@dataclass(frozen=True)
class EndSpring:
    """A spring pulls the distal end, which rests at the preload."""

    stiffness: float  # [N/m]


@dataclass(frozen=True)
class Moved:
    """Someone moves the distal end, whatever the tension."""

    displacement: FloatArray  # recorded (samples,) [m]


Environment = Locked | EndSpring | Moved


class Answer(NamedTuple):
    """Output of a model, (samples,) each."""

    tension_proximal: FloatArray  # [N]
    tension_distal: FloatArray  # [N]
    u_distal: FloatArray  # displacement of the distal end [m]


Asked = Literal[
    "a locked output", "a moved output", "a tension profile", "bends that change"
]
"""Requests that not every model can fulfil."""


class ReplayedMotion(NamedTuple):
    """A motion that a model is to answer, checked and with its defaults."""

    dt: float  # time between samples [s]
    proximal: FloatArray  # displacement of the proximal end (samples,) [m]
    # that of the distal end where someone moves it, else 0 (samples,) [m]
    moved: FloatArray
    stiffness: float  # of the spring at the distal end, infinite without one [N/m]
    start: FloatArray  # tension at the nodes at first (segments + 1,) [N]
    factor: FloatArray  # of all wrap angles (samples,)


class PublishedModel(ABC):
    """A model of one cable; subclasses are one published model each."""

    name: ClassVar[str]  # who published it
    refuses: ClassVar[Mapping[Asked, str]] = {}  # what it cannot take, and why

    def __init__(self, cable: Cable) -> None:
        """Take length, stiffness, bends, friction and pretension from a cable."""
        self.cable = cable

    def replay(
        self,
        dt: float,
        u_proximal: ArrayLike,
        environment: Environment,
        *,
        initial_tension: ArrayLike | None = None,
        wrap_scale: ArrayLike | None = None,
    ) -> Answer:
        """Play a recorded motion of the proximal end, from rest.

        Args:
            dt: time between samples [s].
            u_proximal: displacement of the proximal end (samples,) [m]; 0 at first.
            initial_tension: tension at the nodes (segments + 1,) [N]; default the
                uniform pretension.
            wrap_scale: factor of all wrap angles over time (samples,); default 1.
        """
        asked: dict[Asked, bool] = {
            "a locked output": isinstance(environment, Locked),
            "a moved output": isinstance(environment, Moved),
            "a tension profile": initial_tension is not None,
            "bends that change": wrap_scale is not None,
        }
        for what, why in self.refuses.items():
            if asked[what]:
                raise CableError(f"{self.name} cannot take {what}: {why}")
        proximal = np.ascontiguousarray(u_proximal, dtype=np.float64)
        samples, nodes = proximal.size, self.cable.segments + 1
        stiffness, moved = np.inf, np.zeros(samples)
        if isinstance(environment, EndSpring):
            stiffness = environment.stiffness
        elif isinstance(environment, Moved):
            moved = _sized("the distal motion", environment.displacement, samples)
        start, factor = np.full(nodes, self.cable.pretension), np.ones(samples)
        if initial_tension is not None:
            start = _sized("the initial tension", initial_tension, nodes)
        if wrap_scale is not None:
            factor = _sized("the factor of the wrap angles", wrap_scale, samples)
        return self.answer(
            ReplayedMotion(dt, proximal, moved, stiffness, start, factor)
        )

    @abstractmethod
    def answer(self, motion: ReplayedMotion) -> Answer:
        """Return the answer a motion with nothing in it that the model refuses."""


def _sized(name: str, values: ArrayLike, size: int) -> FloatArray:
    """Return the values as an array of their own, if they are as many as they must."""
    given = np.array(values, dtype=np.float64)
    if given.shape != (size,):
        raise CableError(f"{name} has shape {given.shape}; it must be ({size},)")
    return given
