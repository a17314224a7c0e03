"""The scenes whose transmissions can be redesigned, and what their files do not say."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import cc_mujoco.envs
from cc_mujoco.errors import look_up

if TYPE_CHECKING:
    from cc_mujoco.envs.scalar import ExoEnv


@dataclass(frozen=True)
class Scene:
    """A scene, and the cable that is in it as it stands."""

    environment: str
    """Name of its class in `cc_mujoco.envs`."""
    strength: float
    """Breaking load of the cable [N]."""
    diameter: float
    """Diameter of the cable [m]."""
    motor_pulley: float
    """Inertia of the motor's pulley about its axis [kg m^2]; grows as radius^4."""
    joint_pulley: float = 0.0
    """The same at the joint; 0 where a lever is in its place, which keeps its own."""
    lever: tuple[str, ...] = ()
    """Sites that move with the lever: the two ends of the free rope at the joint."""

    @property
    def cls(self) -> type[ExoEnv]:
        """The environment's class."""
        return cast("type[ExoEnv]", getattr(cc_mujoco.envs, self.environment))

    def default(self, argument: str) -> Any:
        """Default of an argument of the environment: `trajectory`, `task`."""
        return inspect.signature(self.cls).parameters[argument].default


SCENES: dict[str, Scene] = {
    # The wire rope of the scene's comment: 0.15 mm^2 of metal at 1770 N/mm^2, the
    # common grade of rope wire (EN 10264-2). Its pulleys are there too.
    "wrist": Scene(
        "WristHandle",
        strength=265.0,
        diameter=0.6e-3,
        motor_pulley=1.6e-5,
        joint_pulley=1.1e-3,
    ),
    # The synthetic rope and the drum of the scene's comments.
    "ankle": Scene(
        "AnkleExo",
        strength=8000.0,
        diameter=3e-3,
        motor_pulley=1.5e-4,
        lever=("conduit_shank", "heel_lever"),
    ),
}
"""Every scene by name."""


def scene(name: str) -> Scene:
    """Look a scene up.

    Raises:
        CableError: there is none of that name; names the nearest and all others.
    """
    return look_up("scene", name, SCENES)
