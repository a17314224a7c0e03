"""A made-up episode with the shapes and habits of a real one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cc_mujoco.simulation import EpisodeLog, columns_for

MakeLog = Callable[..., EpisodeLog]


@pytest.fixture
def make_log() -> MakeLog:
    """Return a function that makes a log; columns given by name replace its own."""

    def make(
        cables: tuple[str, ...] = ("flexor", "extensor"),
        rows: int = 300,
        nodes: int = 9,
        nq: int = 2,
        metadata: dict[str, Any] | None = None,
        **columns: Any,
    ) -> EpisodeLog:
        random = np.random.default_rng(7)
        time = np.arange(rows) * 0.01
        angle = 0.5 * np.sin(2.0 * time)
        wave = np.sin(2.0 * time[:, None] + np.linspace(0.0, 1.0, nodes))
        filled: dict[str, Any] = {}
        for column in columns_for(cables):
            filled[column.name] = random.normal(size=rows)
        filled |= {"time_s": time, "joint_angle_rad": angle}
        filled["joint_torque_nm"] = -angle
        filled["qpos"] = np.repeat(angle[:, None], nq, axis=1)
        for number, cable in enumerate(cables):
            tension = np.maximum(20.0 * (-1.0) ** number * wave, 0.0)
            filled[f"tension_{cable}_nodes_n"] = tension
            filled[f"tension_{cable}_proximal_n"] = tension[:, 0]
            filled[f"tension_{cable}_distal_n"] = tension[:, -1]
            filled[f"slack_{cable}_m"] = 0.001 * (tension[:, 0] == 0.0)
            filled[f"dissipated_{cable}_j"] = 0.1 * time
            slip = np.sign(np.diff(tension, axis=1)).astype(np.int8)
            filled[f"slip_{cable}_direction"] = slip
            filled[f"moving_{cable}_fraction"] = np.abs(slip).mean(axis=1)
        about = {"scene": "wrist", "trajectory": "sine", "task": "tunnel", "seed": 7}
        return EpisodeLog(filled | columns, about if metadata is None else metadata)

    return make
