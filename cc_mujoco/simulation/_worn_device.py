"""Common part of a device's single environment and its vector form.

Both are thin: they advance MuJoCo, one simulation or a batch of them, and leave all
else to a `WornDevice`, whose arithmetic is the same for numbers and arrays. So they
agree bit for bit.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco._validation import MAX_DURATION, require_number
from cc_mujoco.device import Nominal, Plant
from cc_mujoco.device._device import Array, Device, Physics
from cc_mujoco.device._observation import ACTION_SPACE
from cc_mujoco.device._ranges import Ranges
from cc_mujoco.device._registry import Setup
from cc_mujoco.device._sensors import BIAS, PERFECT_SENSING, Measuring
from cc_mujoco.device._variables import DELAY, NOISE
from cc_mujoco.errors import CableError
from cc_mujoco.human import Task, Trajectory, Walk, Wearer, scale_task
from cc_mujoco.human import task as find_task

from ._reference_motion import Author, find_trajectory, joint_range, unperturbed

EFFORT_COST = 0.05
"""Reward lost by full motor torque [1/s]."""

MAX_ERROR_COST = 10.0
"""Most that an error of torque costs [1/s]."""

REWARD_TERMS = ("reward_tracking", "reward_effort", "reward_smoothness")
"""Keys of the terms of the reward in `info`; the reward is their sum."""


def refuse_unknown(unknown: Mapping[str, Any], env: type) -> None:
    """Refuse arguments that an environment does not have, and list those it has.

    Args:
        unknown: What was given in addition to its arguments, by name.
        env: Its class.

    Raises:
        CableError: If anything was.
    """
    for name in unknown:
        parameters = inspect.signature(env).parameters.values()
        there = [p.name for p in parameters if p.kind is not p.VAR_KEYWORD]
        raise CableError.unknown("argument", name, there)


class WornDevice:
    """A device with a wearer, a trajectory and a task."""

    def __init__(
        self,
        setup: Setup,
        trajectory: str | Path | Trajectory | None,
        task: str | Path | Task | None,
        duration: float,
        frame_skip: int,
        wearer: Wearer | None,
        model: mujoco.MjModel | None,
        hold: int = 1,
        history: int = 0,
        memory: bool = False,
        randomise: Mapping[str, Any] | None = None,
        smoothness: float = 0.0,
    ) -> None:
        """Load the scene and work out the spaces.

        Args:
            setup: The device.
            trajectory: Trajectory that the wearer follows, see `human.trajectory`; that
                of the device by default.
            task: Virtual environment, see `human.task`; that of the device by default.
                By name, help that follows the gait has the pace
                of a `Walk`, not the size of who walks, which a walk does not know; see
                `human._scaled_assistance`. An environment itself stays what it is.
            duration: Length of an episode [s], rounded to whole control steps.
            frame_skip: Physics steps from one sample of the sensors to the next.
            wearer: Impedance of the wearer; that of the scene by default.
            model: A variant of the scene; the scene by default.
            hold: Samples in a control step.
            history: Earlier frames in an observation; see `Observed`.
            memory: Whether plays are observed; see `Observed`.
            randomise: From what plants are drawn; see `Ranges`.
            smoothness: Reward lost by a change of the action by 1.

        Raises:
            CableError: If an argument cannot be used.
        """
        trajectory = setup.trajectory if trajectory is None else trajectory
        task = setup.task if task is None else task
        if not (wearer is None or isinstance(wearer, Wearer)):
            raise CableError(f"wearer must be a Wearer or None, not {wearer!r}.")
        whole = isinstance(frame_skip, (int, np.integer)) and frame_skip is not True
        if not (whole and frame_skip >= 1):
            raise CableError(f"frame_skip must be an integer >= 1, not {frame_skip!r}.")
        frame_skip = int(frame_skip)
        require_number("smoothness", smoothness, 0.0, 1e3, "")
        self.smoothness = float(smoothness)
        self.setup = setup
        self.device = Device(setup, wearer, model)
        self.frame_skip = frame_skip
        self.sampling = frame_skip * float(self.device.model.opt.timestep)
        """Time between samples of the sensors [s]."""
        frame = self.device.observed(self.sampling)
        self.observed = dataclasses.replace(
            frame, hold=hold, history=history, memory=memory
        )
        self.hold = hold
        self.period = hold * self.sampling
        """Time between control steps [s]."""
        require_number("duration", duration, self.period, MAX_DURATION, "s")
        self.steps = round(duration / self.period)
        """Control steps in an episode."""
        self.samples = hold * self.steps
        joints = {
            name: joint_range(self.device.model, name)
            for name in (setup.joint, *setup.companions)
        }
        source = find_trajectory(trajectory, setup.reach, joints=joints)
        self.task = _task_of(task, source, setup.joint)
        self.author = Author(self.device, source, self.samples, frame_skip, self.task)
        self.drive = self.device.drive(self.period)
        """Knowledge that a controller may have of the device as its scene has it."""
        nominal = Nominal(setup, self.device.cables, self.device.wearers[0])
        self.plants = Ranges(randomise, nominal)
        self.observation_space = self.observed.space
        self.action_space = ACTION_SPACE

    def require_timestep(self) -> None:
        """Refuse a time step that was changed after `sampling` followed from it.

        Raises:
            CableError: If it was.
        """
        step = float(self.device.model.opt.timestep)
        if self.frame_skip * step != self.sampling:
            raise CableError(
                f"the time step of the model is {step:g} s now, but the period of "
                f"{self.period:g} s follows from the one it was made with; give the "
                "changed model as the argument `model`, and a `frame_skip` that fits."
            )

    def normalised(self, action: Any, going: Any = True) -> Any:
        """Return the actions (..., 1) as numbers in [-1, 1].

        Args:
            action: Of one environment (1,), or of several (n, 1).
            going: Of several, the mask (n,) of those whose action counts; that of the
                others is 0.

        Raises:
            CableError: If actions are of another shape, or one is no finite number.
        """
        shape = (*np.shape(going), 1)
        try:
            given = np.asarray(action)
        except ValueError:  # rows of unequal lengths
            raise CableError(f"an action must be an array of shape {shape}.") from None
        if given.shape != shape:
            raise CableError(
                f"an action must be of shape {shape}, a share of the motor's torque "
                f"for each environment, not of shape {given.shape}."
            )
        if given.dtype.kind not in "fiu":
            raise CableError(f"an action must be of numbers, not of {given.dtype}.")
        numbers = np.where(going, given.T[0].astype(np.float64), 0.0)
        wrong = numbers[~np.isfinite(numbers)]
        if wrong.size:
            raise CableError(f"an action must be a finite number, not {wrong[0]}.")
        return np.minimum(np.maximum(numbers, -1.0), 1.0)

    def action(self, torque: Any) -> NDArray[np.float32]:
        """Return the action, (..., 1), that makes the motor give a torque [N m]."""
        scaled = np.asarray(torque)[..., None] / self.device.torque_limit
        return np.clip(scaled, -1.0, 1.0).astype(np.float32)

    def sensors(self, seeds: int | Sequence[int]) -> Measuring:
        """Return the sensors of one environment or of several.

        Encoders are exact, and the error of torque is that of the plant.

        Args:
            seeds: Any number, or one for each of several environments.
        """
        names = self.observed.columns
        return Measuring(
            PERFECT_SENSING, self.drive, (), seeds, self.samples, names=names
        )

    def begin(
        self,
        sensors: Measuring,
        plant: Plant,
        rng: np.random.Generator,
        row: Any = ...,
    ) -> None:
        """Begin an episode of the sensors; draws the errors of torque if there are any.

        Args:
            sensors: Of one environment or of several.
            plant: Of the episode; without noise and delay its sensors are exact.
            rng: Source of what is drawn.
            row: Of several environments the one that begins.
        """
        errors = None
        if noise := float(plant.values.get(NOISE.name, 0.0)):
            scale = noise * self.setup.sensing.torque_noise
            bias = BIAS * rng.normal()
            errors = scale * (bias + rng.normal(size=(self.samples + 1, 1)))
        sensors.begin(int(plant.values.get(DELAY.name, 0)), errors, row)

    def feel(
        self, physics: Physics, marks: Array, asked: Array | None = None
    ) -> tuple[dict[str, Any], Any]:
        """Return the true columns that the device can measure, and the reward.

        Args:
            physics: The simulation, or several.
            marks: Row of `Script.marks` at that sample.
            asked: Torque that the task demands there, if it is known already [N m].

        Returns:
            Columns of an episode log; their reward per second for tracking the desired
            torque.
        """
        _, phase, sine, cosine = marks.T
        columns = self.device.read_motion(physics)
        if asked is None:
            angle, velocity = (
                columns["joint_angle_rad"],
                columns["joint_velocity_rad_s"],
            )
            asked = self.task.torque(angle, velocity, phase)
        columns["desired_torque_nm"] = asked
        columns["phase_sine"], columns["phase_cosine"] = sine, cosine
        error = columns["joint_torque_nm"] - columns["desired_torque_nm"]
        cost = np.minimum(np.abs(error) / self.setup.torque_scale, MAX_ERROR_COST)
        return columns, -cost

    def told(
        self, physics: Physics, columns: dict[str, Any], step: Any, marks: Array
    ) -> dict[str, Any]:
        """Return all values of a simulation, the columns of an episode log.

        Args:
            physics: The simulation, or several.
            columns: Of `feel`.
            step: Number of samples since the reset.
            marks: Row of `Script.marks` at that sample.
        """
        columns = columns | self.device.read_cables(physics)
        columns["time_s"] = step * self.sampling
        columns["reference_angle_rad"] = marks.T[0]
        return columns

    def costs(self, action: Any, before: Any) -> tuple[Any, Any]:
        """Return the rewards of a step for the effort of an action and its change.

        Args:
            action: Of one environment or of several, (n,).
            before: That of the control step before; 0 at the start of an episode.
        """
        return (
            -EFFORT_COST * self.period * action * action,
            -self.smoothness * np.abs(action - before),
        )

    def beyond(self, marks: Array) -> str:
        """Return a sentence if the task exceeds the motor, else "".

        Args:
            marks: `Script.marks`; the demand is that along the reference.
        """
        reference, phase = marks[:, 0], marks[:, 1]
        velocity = np.gradient(reference, self.sampling)
        asked = self.task.torque(reference, velocity, phase)
        least, most = self.drive.reach
        if least <= asked.min() and asked.max() <= most:
            return ""
        ends = (asked.min(), asked.max(), least, most)
        low, high, weakest, strongest = (f"{round(end, 3) + 0.0:.4g}" for end in ends)
        return (
            f"the task asks for {low} to {high} N m at joint {self.setup.joint!r}, "
            f"where the motor gives {weakest} to {strongest} N m even without friction."
        )


def _task_of(task: str | Path | Task, source: Trajectory, joint: str) -> Task:
    """Return a task itself, or one by name at the pace of the walk that is played."""
    found = find_task(task, (joint,))
    source = unperturbed(source)
    if isinstance(task, str) and isinstance(source, Walk):
        return scale_task(found, source.pace)
    return found
