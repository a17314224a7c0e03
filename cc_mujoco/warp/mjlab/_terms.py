"""Terms of mjlab's managers: observations of cables and events that vary them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import product
from typing import Any, Literal

import torch

from cc_mujoco.cable._friction import INDEX
from cc_mujoco.errors import CableError
from cc_mujoco.warp.mjlab._actuator import CableActuator


def cable_actuators(env: Any, entity: str = "robot") -> tuple[CableActuator, ...]:
    found = [a for a in env.scene[entity].actuators if isinstance(a, CableActuator)]
    if not found:
        raise CableError(f"entity {entity!r} has no CableActuatorCfg")
    return tuple(found)


def cable_tension(
    env: Any,
    entity: str = "robot",
    end: Literal["proximal", "distal"] = "distal",
    scale: float = 1.0,
) -> torch.Tensor:
    """Observe the tension at one end of all cables of an entity, (worlds, cables).

    Args:
        env: environment.
        entity: name of the entity in the scene.
        end: end of the cables with load cells.
        scale: factor; 1 gives newtons.
    """
    side = ("proximal", "distal").index(end)
    parts = [actuator.tension[..., side] for actuator in cable_actuators(env, entity)]
    return scale * torch.cat(parts, dim=-1)


def capture_cables(env: Any, env_ids: torch.Tensor | None = None) -> None:
    """Capture the graphs of a simulation again, now with its cables.

    An event of mode `"startup"`; without a GPU it does nothing.
    """
    env.sim.create_graph()


class randomize_cables:
    """Event that draws parameters of cables uniformly, for each world and cable.

    Mode `"startup"` or `"reset"`. A pretension takes effect with the next reset, which
    for mode `"reset"` is this one. Params: `ranges`, a mapping of parameters of `Cable`
    to lowest and highest value; `entity`; `cables`, a regular expression.

    Raises:
        CableError: when the environment is built, a parameter or cable that does not
            exist, or a range that the cables or their kernel do not allow.
    """

    def __init__(self, cfg: Any, env: Any) -> None:
        """Check the ranges; see the class."""
        params = cfg.params
        ranges: Mapping[str, tuple[float, float]] = params["ranges"]
        wanted = params.get("cables", ".*")
        self._chosen = [
            (actuator, i)
            for actuator in cable_actuators(env, params.get("entity", "robot"))
            for i, name in enumerate(actuator.names)
            if re.fullmatch(wanted, name)
        ]
        if not self._chosen:
            raise CableError(f"no cable is named like {wanted!r}")
        for name, (low, high) in ranges.items():
            if name not in INDEX:
                raise CableError.unknown("parameter", name, list(INDEX))
            if not low <= high:
                raise CableError(f"{name}: the range {low:g} to {high:g} is empty")
        for actuator, i in self._chosen:
            for corner in product(*ranges.values()):
                values = dict(zip(ranges, corner, strict=True))
                actuator.cables.require_allowed(actuator.names[i], values)

    def __call__(
        self,
        env: Any,
        env_ids: torch.Tensor | None,
        ranges: Mapping[str, tuple[float, float]],
        entity: str = "robot",
        cables: str = ".*",
    ) -> None:
        """Draw the values of some worlds."""
        worlds = torch.arange(env.num_envs) if env_ids is None else env_ids
        for actuator, i in self._chosen:
            for name, (low, high) in ranges.items():
                share = torch.rand(len(worlds), device=actuator.values.device)
                actuator.values[i, worlds, INDEX[name]] = low + (high - low) * share
        for actuator in dict.fromkeys(actuator for actuator, _ in self._chosen):
            actuator.cables.repack()

    def reset(self, env_ids: torch.Tensor | slice | None = None) -> None:
        """Keep the values; mjlab calls this for every term that is a class."""
