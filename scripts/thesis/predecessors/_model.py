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
        stiffness, moved = environment_stiffness(environment, proximal.size)
        start = initial_profile(self.cable, initial_tension)
        factor = wrap_scales(wrap_scale, proximal.size)
        return self.answer(
            ReplayedMotion(dt, proximal, moved, stiffness, start, factor)
        )

    @abstractmethod
    def answer(self, motion: ReplayedMotion) -> Answer:
        """Return the answer a motion with nothing in it that the model refuses."""


def environment_stiffness(
    environment: Environment, samples: int
) -> tuple[float, FloatArray]:
    """Return stiffness (infinite without a spring) and motion of the environment."""
    if isinstance(environment, EndSpring):
        if not environment.stiffness > 0.0:
            raise CableError(
                f"spring stiffness is {environment.stiffness!r} N/m; "
                "it must be greater than 0"
            )
        return environment.stiffness, np.zeros(samples)
    if isinstance(environment, Moved):
        moved = np.asarray(environment.displacement, dtype=np.float64)
        if moved.shape != (samples,):
            raise CableError(
                f"the distal motion has shape {moved.shape}; the proximal one has "
                f"{samples} samples"
            )
        return np.inf, moved
    return np.inf, np.zeros(samples)


def initial_profile(cable: Cable, initial_tension: ArrayLike | None) -> FloatArray:
    """Return the node tensions at the start (segments + 1,) [N]."""
    if initial_tension is None:
        return np.full(cable.segments + 1, cable.pretension)
    given = np.asarray(initial_tension, dtype=np.float64)
    if given.shape != (cable.segments + 1,):
        raise CableError(
            f"initial tension has shape {given.shape}; a cable of {cable.segments} "
            f"segments takes ({cable.segments + 1},)"
        )
    return given.copy()


def wrap_scales(wrap_scale: ArrayLike | None, samples: int) -> FloatArray:
    """Return the factor of the wrap angles over time (samples,)."""
    if wrap_scale is None:
        return np.ones(samples)
    given = np.ascontiguousarray(wrap_scale, dtype=np.float64)
    if given.shape != (samples,) or not np.all(given >= 0.0):
        raise CableError(
            f"the factor of the wrap angles has shape {given.shape}; it must be "
            f"({samples},), 0 or more"
        )
    return given
