"""A stand-in for Stable-Baselines3 that saves and loads linear policies."""

from __future__ import annotations

import pickle
import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium
import numpy as np
import pytest

ACTION = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)


@dataclass
class Linear:
    """A policy: the action is the observation times weights."""

    observation_space: Any
    weights: Any
    action_space: Any = field(default_factory=lambda: ACTION)

    def predict(self, observation: Any, deterministic: bool = False) -> Any:
        """The action (1,), and the state of a policy that has none."""
        assert observation.shape == self.observation_space.shape
        action = np.clip(np.sum(observation * self.weights), -1.0, 1.0)
        return np.full(1, action, np.float32), None


class PPO:
    """An algorithm that has learnt a linear policy."""

    policy_aliases = {"MlpPolicy": Linear}  # noqa: RUF012

    def __init__(self, policy: Linear) -> None:
        self.policy = policy

    @classmethod
    def load(cls, path: Any, device: str) -> PPO:
        """Read what `saved` wrote."""
        return cls(pickle.loads(Path(path).read_bytes()))


def saved(policy: Linear, path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Save a policy as a file that, for the length of a test, can be loaded."""
    names = ("stable_baselines3", "stable_baselines3.common")
    modules = {name: ModuleType(name) for name in (*names, f"{names[1]}.save_util")}
    fake, _, util = modules.values()
    vars(fake)["PPO"] = PPO
    vars(util)["load_from_zip_file"] = lambda path, device: ({"policy_class": Linear},)
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    path.write_bytes(pickle.dumps(policy))
    return str(path)
