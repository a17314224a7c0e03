"""Protocol of every design, and the cue cards of a run: tests and their parts.

A protocol is the episode that a study asks for and, where a metric needs them, two
tests that say more of the hardware alone:

- `backdrive`: the wearer moves along the same trajectory and the motor gives no torque;
- `backlash`: the joint is held, and the motor's torque swings slowly to and fro, as in
  Experiment 1 of the thesis;
- `bandwidth`: the joint is held, and the desired torque is a chirp.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.provenance import file_digests
from cc_mujoco.design._scenarios import Across
from cc_mujoco.device import Description, Device, load_device
from cc_mujoco.device._axis_columns import split_by_axis
from cc_mujoco.errors import CableError
from cc_mujoco.human import Task, Trajectory
from cc_mujoco.human._motion import Motion, episode_fraction
from cc_mujoco.human._parsing import user_classes
from cc_mujoco.metrics import Metric, find_metric
from cc_mujoco.metrics._clamped import CHIRP_HIGH, CHIRP_LOW, SWING_PERIODS

Array = NDArray[np.float64]
Real = TypeVar("Real", float, Array)

SWING_TIME = 2.0
"""Length of a swing of the backlash test [s]. Swings go as far as the scene's own motor
would if nothing rubbed."""

CHIRP_TIME = 6.0
CHIRP_SHARE = 0.2
"""Duration [s] and amplitude of the chirp that the bandwidth is measured
with, as a part of the largest torque of the scene's own motor at the joint."""


@dataclass(frozen=True)
class EpisodeProtocol:
    """Protocol by which each design of a study is tried."""

    scene: str
    """Name of a built-in device, or path of the file of another."""
    trajectory: str | Trajectory
    """Text, or what a table holds."""
    task: str | Task | Mapping[str, str | Task]
    """Text, or what a table holds; of several axes by their names."""
    controllers: tuple[str, ...]
    """Controllers of the motors, each in an episode of its own."""
    duration: float
    """Length of the episode [s]."""
    seed: int
    timestep: float
    """Time step of the physics [s]."""
    metrics: tuple[str, ...]
    """Names of `METRICS`, also `AXIS.NAME` where there are several axes."""
    across: Across = Across()  # noqa: RUF009
    """Cases over which a design is judged."""
    costs: tuple[tuple[str, float], ...] = ()
    """Cost of each part, where that is measured."""
    own: tuple[str | Metric, ...] = ()
    """Metrics of the user among them, as they were given."""
    sources: tuple[str, str] = ("", "")
    """Texts by which trajectory and task are known: as given, the path of a table, or
    description of an object."""
    axes: tuple[str, ...] = ()
    """Names of the axes where there are several."""
    files: tuple[tuple[str, str], ...] = ()
    """Names and digests of the user's files that define the scene."""

    @property
    def device(self) -> Device:
        """Device that designs are variants of."""
        device = load_device(self.scene, self.timestep)
        now, then = device_digests(device), dict(self.files)
        for name in {**then, **now}:
            if now.get(name) != then.get(name):
                raise CableError(
                    f"{name} of the scene {self.scene} changed while the study ran; "
                    "its designs would be of two devices: run it again with --again."
                )
        return device

    def find_metrics(self) -> None:
        """Register the metrics of the user in `METRICS` of this process."""
        for given in self.own:
            find_metric(given)

    @property
    def metric_files(self) -> tuple[str, ...]:
        """Metrics of the user that lie in a module, as `MODULE:NAME`."""
        return tuple(one for one in self.own if isinstance(one, str))

    @property
    def code_names(self) -> tuple[str, ...]:
        """Names of all that `code_provenance` must know, but for tables.

        A table goes with the protocol.
        """
        played = []
        several = self.task.values() if isinstance(self.task, Mapping) else [self.task]
        for given in (self.trajectory, *several):
            if isinstance(given, str):
                played.append(given)
            else:
                played += user_classes(given)
        laws = split_axes(self.controllers, self.axes)
        return (*laws, *self.metric_files, *played)

    @property
    def tables(self) -> tuple[str, ...]:
        """Texts by which trajectory and tasks are known, those of each axis alone."""
        return split_axes(self.sources, self.axes)

    @property
    def frame_skip(self) -> int:
        """Physics steps between two calls of the controller."""
        return self.device.frame_skip


@dataclass(frozen=True)
class NoMotion(Trajectory):
    """No motion: joints stay where they are. Phase: fraction of the episode."""

    angles: tuple[tuple[str, float], ...] = ()
    """Joints and their angles [rad]; those of others are 0."""

    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        still, phase = np.zeros_like(time), episode_fraction(time, duration)
        held = {
            joint: Motion(time, still + angle, still, still, phase)
            for joint, angle in self.angles
        }
        return Motion(time, still, still, still, phase, held)


@dataclass(frozen=True)
class _HeldTorque(Task):
    of_phase = True
    amplitude: float
    """Signed [N m]."""
    bias: float
    """Constant part [N m]; a cable that only pulls needs one."""


@dataclass(frozen=True)
class SineTorque(_HeldTorque):
    """A desired torque that swings as a sine, `SWING_PERIODS` times."""

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        wave = self.bias + self.amplitude * np.sin(
            2.0 * math.pi * SWING_PERIODS * phase
        )
        torque: Real = 0.0 * angle + wave
        return torque


@dataclass(frozen=True)
class ChirpTorque(_HeldTorque):
    """A desired torque whose frequency grows exponentially with the phase."""

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        octaves = math.log(CHIRP_HIGH / CHIRP_LOW)
        cycles = CHIRP_LOW * CHIRP_TIME * np.expm1(octaves * phase) / octaves
        wave = self.bias + self.amplitude * np.sin(2.0 * math.pi * cycles)
        torque: Real = 0.0 * angle + wave
        return torque


def device_digests(device: Device) -> dict[str, str]:
    """Return digests of the user's files that define a device, by name."""
    folder = device.files[0].parent if device.files else Path()
    return file_digests(device.files, folder)


def tasks_of_axes(
    task: str | Path | Task | None, device: Description
) -> dict[str, str | Path | Task]:
    """Return the task of every axis by its name.

    `task` is that of all axes, or of each as `hip=swing,ankle=assist`; an axis that is
    not named keeps that of the device, as all do without a task.
    """
    own: dict[str, str | Path | Task] = {axis.name: axis.task for axis in device.axes}
    if task is None:
        return own
    given = split_by_axis(task, own) if isinstance(task, str) else task
    return own | given if isinstance(given, dict) else dict.fromkeys(own, given)


def task_text(tasks: Mapping[str, str]) -> str:
    """Return the text of the tasks of all axes, which `tasks_of_axes` reads."""
    if len(tasks) == 1:
        return next(iter(tasks.values()))
    return ",".join(f"{name}={task}" for name, task in tasks.items())


def split_axes(texts: Iterable[str], axes: Iterable[str]) -> tuple[str, ...]:
    """Return texts, in place of each like `hip=pi,ankle=model` its parts."""
    names = tuple(axes)
    found: list[str] = []
    for text in texts:
        parts = split_by_axis(text, names)
        found += parts.values() if isinstance(parts, dict) else [parts]
    return tuple(found)
