"""Playing an episode into a log, and writing all that is made of a log."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

import gymnasium
import mujoco

from cc_mujoco import engine
from cc_mujoco.recording.figure import write_summary
from cc_mujoco.recording.files import replacing_folder
from cc_mujoco.recording.log import EpisodeLog, Recorder
from cc_mujoco.recording.metrics import RATIO_KEY, Metric, metrics, write_metrics
from cc_mujoco.recording.rerun_file import MODEL_KEY, write_recording

FILES = ("recording.rrd", "log.parquet", "metrics.json", "summary.png")
"""What `write_episode` leaves in its folder."""

VERSIONED = ("cc_mujoco", "mujoco", "gymnasium", "numpy", "numba")
"""Packages that decide the numbers in a log, which carries their versions."""


class Controller(Protocol):
    """What drives the motor."""

    def reset(self) -> None:
        """Forget the episode before."""

    def torque(self, observation: Mapping[str, Any]) -> float:
        """Return the motor torque in N m for what was just observed."""


def play(
    env: gymnasium.Env[Any, Any],
    controller: Controller,
    *,
    seed: int = 0,
    about: Mapping[str, Any] | None = None,
    progress: Callable[[float], object] | None = None,
) -> EpisodeLog:
    """Play one episode.

    Args:
        env: One of this package's environments; its `info` fills the log.
        controller: What drives the motor.
        seed: Seed of the reset.
        about: Metadata for the log, besides what `describe` finds.
        progress: Called with the simulated time in seconds after every step.

    Returns:
        The log, from the reset to the last step.
    """
    _, info = env.reset(seed=seed)
    controller.reset()
    inner: Any = env.unwrapped
    metadata = {**describe(inner.model), "seed": seed, **(about or {})}
    recorder = Recorder(engine.cables(inner.model), metadata)
    recorder.record(info)
    over = False
    while not over:
        action = inner.action(controller.torque(info))
        _, _, terminated, truncated, info = env.step(action)
        recorder.record(info)
        if progress is not None:
            progress(info["time_s"])
        over = terminated or truncated
    return recorder.log()


def write_episode(
    folder: str | os.PathLike[str], log: EpisodeLog, model: mujoco.MjModel
) -> tuple[Metric, ...]:
    """Write recording, log, metrics and figure of an episode.

    They are made beside the folder and moved into it when all are whole; other files in
    the folder are left alone.

    Args:
        folder: Where `FILES` shall lie; made if need be.
        log: The episode.
        model: The model that the episode was played on.

    Returns:
        The metrics that were written.
    """
    found = metrics(log)
    with replacing_folder(folder) as partial:
        log.write(partial / "log.parquet")
        write_metrics(partial / "metrics.json", found)
        write_summary(partial / "summary.png", log)
        write_recording(partial / "recording.rrd", log, model, found)
    return found
