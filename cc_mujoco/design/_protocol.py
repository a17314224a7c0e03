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
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.design._scenarios import Across
from cc_mujoco.human import Task, Trajectory
from cc_mujoco.human._motion import Motion, episode_fraction
from cc_mujoco.human._parsing import user_classes
from cc_mujoco.metrics import Metric, find_metric
from cc_mujoco.metrics._clamped import CHIRP_HIGH, CHIRP_LOW, SWING_PERIODS

Array = NDArray[np.float64]
Real = TypeVar("Real", float, Array)

CONTROL_PERIOD = 1e-3
"""Time between two calls of the controller [s]."""

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
    trajectory: str | Trajectory
    """Text, or what a table holds."""
    task: str | Task
    """Text, or what a table holds."""
    controllers: tuple[str, ...]
    """Controllers of the motor, each in an episode of its own."""
    duration: float
    """Length of the episode [s]."""
    seed: int
    timestep: float
    """Time step of the physics [s]."""
    metrics: tuple[str, ...]
    """Names of `METRICS`."""
    across: Across = Across()  # noqa: RUF009
    """Cases over which a design is judged."""
    costs: tuple[tuple[str, float], ...] = ()
    """Cost of each part, where that is measured."""
    own: tuple[str | Metric, ...] = ()
    """Metrics of the user among them, as they were given."""
    sources: tuple[str, str] = ("", "")
    """Texts by which trajectory and task are known: as given, the path of a table, or
    description of an object."""

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
        for given in (self.trajectory, self.task):
            if isinstance(given, str):
                played.append(given)
            else:
                played += user_classes(given)
        return (*self.controllers, *self.metric_files, *played)

    @property
    def frame_skip(self) -> int:
        """Physics steps between two calls of the controller."""
        return round(CONTROL_PERIOD / self.timestep)


@dataclass(frozen=True)
class NoMotion(Trajectory):
    """No motion: the joint stays at angle 0. Phase: fraction of the episode."""

    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        still = np.zeros_like(time)
        return Motion(time, still, still, still, episode_fraction(time, duration))


@dataclass(frozen=True)
class SineTorque(Task):
    """A desired torque that swings as a sine, `SWING_PERIODS` times."""

    of_phase = True
    amplitude: float
    """Signed [N m]."""
    bias: float
    """Constant part [N m]; a cable that only pulls needs one."""

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        """Return the desired torque [N m]; see `Task.torque`."""
        wave = self.bias + self.amplitude * np.sin(
            2.0 * math.pi * SWING_PERIODS * phase
        )
        torque: Real = 0.0 * angle + wave
        return torque


@dataclass(frozen=True)
class ChirpTorque(Task):
    """A desired torque whose frequency grows exponentially with the phase."""

    of_phase = True
    amplitude: float
    """Signed [N m]."""
    bias: float
    """Constant part [N m]; a cable that only pulls needs one."""

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        """Return the desired torque [N m]; see `Task.torque`."""
        octaves = math.log(CHIRP_HIGH / CHIRP_LOW)
        cycles = CHIRP_LOW * CHIRP_TIME * np.expm1(octaves * phase) / octaves
        wave = self.bias + self.amplitude * np.sin(2.0 * math.pi * cycles)
        torque: Real = 0.0 * angle + wave
        return torque
