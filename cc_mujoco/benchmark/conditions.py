"""What the benchmark does with each scene unless told otherwise."""

from __future__ import annotations

from dataclasses import dataclass

from cc_mujoco.sensing import Sensing


@dataclass(frozen=True)
class Condition:
    """A scene with its sensors, and what is played on it."""

    environment: str
    """Gymnasium id."""
    trajectories: tuple[str, ...]
    tasks: tuple[str, ...]
    sensing: Sensing
    pull_pull: bool
    """Whether two cables hold each other taut, so that both slack is a failure."""


CONDITIONS = {
    "wrist": Condition(
        "cc_mujoco/WristHandle-v0",
        ("sine", "sweep", "multisine"),
        ("spring", "transparent"),
        Sensing(torque_noise=0.01, tension_noise=0.3),
        pull_pull=True,
    ),
    "ankle": Condition(
        "cc_mujoco/AnkleExo-v0",
        ("walk",),
        ("assist", "transparent"),
        Sensing(torque_noise=0.3, tension_noise=3.0),
        pull_pull=False,
    ),
}
"""Scenes by their names on the command line."""

WARM_UP = 0.5
"""Beginning of an episode that no score counts [s]."""
