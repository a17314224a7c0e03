"""Motion of the wearer in an episode, worked out before it begins."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.device._device import Device
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.human import (
    Motion,
    Perturbed,
    Recorded,
    Task,
    TimeTorque,
    Trajectory,
    Walk,
    trajectory,
)
from cc_mujoco.human import _gait as gait

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Script:
    """The wearer's part in an episode of n control steps and m physics steps."""

    angles: Array
    """First angle of the joint and of its companions [rad]."""
    commands: Array
    """Controls before every physics step, (m + 1, k): of the wearer's actuators, then
    of the motors that follow the gait by themselves.

    One per physics step: a command that is held over a control period would be a
    staircase, which a stiff wearer follows as one.
    """
    marks: Array
    """Marks at every control step, (n + 1, 4): reference angle [rad], phase of the
    cycle or time [s] for a task of time, sine and cosine of the phase."""


class Author:
    """Author of a script for every episode.

    A trajectory that draws no random numbers is the same in every episode, and so is
    its script.
    """

    def __init__(
        self,
        device: Device,
        source: Trajectory,
        steps: int,
        frame_skip: int,
        task: Task,
    ) -> None:
        """Prepare; warn of a recorded motion or torque that ends before the episode.

        Args:
            device: Whose joint is moved.
            source: How it is moved.
            steps: Control steps in an episode.
            frame_skip: Physics steps in a control step.
            task: What the wearer should feel.
        """
        duration = steps * frame_skip * float(device.model.opt.timestep)
        for recorded, held in (
            (unperturbed(source), "joint is held where it is then"),
            (task, "torque keeps its last value"),
        ):
            if (
                isinstance(recorded, (Recorded, TimeTorque))
                and recorded.end < duration - 1e-9
            ):
                warnings.warn(
                    f"{recorded.source or 'the recorded motion'} ends after "
                    f"{recorded.end:g} s; the {held} for the rest of the "
                    f"{duration:g} s.",
                    CableWarning,
                    stacklevel=4,
                )
        walk = unperturbed(source)
        self.note = (
            f"{walk.describe()}." if isinstance(walk, Walk) and walk.joints else ""
        )
        """Sentence that says which joints of the device walk; empty by default."""
        self._of_time = task.of_time
        self._device = device
        self._source = source
        self._steps = steps
        self.frame_skip = frame_skip
        self._single_script: Script | None = None
        self._wearer = device.wearers[0]
        """Wearer whose script that is."""

    def write(self, rng: np.random.Generator) -> Script:
        """Write the script of an episode.

        Args:
            rng: Source of all that is random about it.

        Raises:
            CableError: If the joint would have to leave its range.
        """
        wearer = self._device.wearers[0]
        if self._single_script is not None and wearer == self._wearer:
            return self._single_script
        before = repr(rng.bit_generator.state)
        script = self._write(rng)
        if repr(rng.bit_generator.state) == before:
            self._single_script, self._wearer = script, wearer
        return script

    def _write(self, rng: np.random.Generator) -> Script:
        device = self._device
        dt = float(device.model.opt.timestep)
        substeps = self._steps * self.frame_skip
        sampled = self._source.sample(substeps * dt, dt, rng)
        motion = sampled.companions.get(device.setup.joint, sampled)
        setup = device.setup
        motions = [sampled.companions.get(name) for name in setup.companions]
        played = [motion, *motions]
        for name, part in zip((setup.joint, *setup.companions), played, strict=True):
            if part is not None:
                _require_range(device.model, name, part)
        commands = np.zeros((substeps + 1, len(device.script_controls)))
        for place, part in enumerate(played):
            if part is not None:
                wearer = device.wearers[place]
                commands[:, place] = wearer.command(part.angle, part.velocity)
        walked = motion.phase if motion.measured is None else motion.measured
        share = gait.assistance(walked)
        for place, (rest, peak) in enumerate(setup.helpers.values(), len(played)):
            commands[:, place] = rest + (peak - rest) * share
        phase = motion.phase[:: self.frame_skip]
        turn = 2 * np.pi * phase
        clock = motion.time[:: self.frame_skip] if self._of_time else phase
        return Script(
            np.array([0.0 if part is None else part.angle[0] for part in played]),
            np.clip(commands, *device.script_ranges.T),
            np.stack(
                [motion.angle[:: self.frame_skip], clock, np.sin(turn), np.cos(turn)],
                axis=-1,
            ),
        )


def joint_range(model: mujoco.MjModel, name: str) -> tuple[float, float]:
    """Return the stops of a joint [rad], infinite where it has none."""
    joint = model.joint(name)
    if not model.jnt_limited[joint.id]:
        return -math.inf, math.inf
    low, high = joint.range
    return float(low), float(high)


def _require_range(model: mujoco.MjModel, name: str, motion: Motion) -> None:
    """Refuse a motion that leaves the range of its joint."""
    low, high = joint_range(model, name)
    least, most = float(motion.angle.min()), float(motion.angle.max())
    if least < low or most > high:
        raise CableError(
            f"the trajectory moves joint {name!r} from {least:g} to {most:g} rad, but "
            f"it must stay in [{low:g}, {high:g}] rad."
        )


class Scripts:
    """The scripts of many environments, as arrays over environments."""

    def __init__(self, author: Author, count: int, task: Task) -> None:
        """Prepare.

        Args:
            author: Writes the scripts.
            count: Number of environments.
            task: What the wearers should feel.
        """
        self._author = author
        self._task = task if task.of_phase else None
        self._count = count
        self._rows = np.zeros(count, dtype=np.intp)
        self._shared: Script | None = None
        """Only script so far."""
        self._commands = np.zeros((0, 0, 0))
        self._marks = np.zeros((0, 0, 0))
        self._asked = np.zeros((0, 0))

    def write(self, environment: int, rng: np.random.Generator) -> Script:
        """Write the script of the next episode of an environment."""
        script = self._author.write(rng)
        if not self._commands.size:
            # One row is enough for all where every episode is the same.
            self._shared = script
            self._commands, self._marks = script.commands[None], script.marks[None]
            self._asked = self._scripted_torque(script)[None]
        elif self._shared is not None and script is not self._shared:
            self._shared = None
            self._rows = np.arange(self._count)
            self._commands = np.repeat(self._commands, self._count, axis=0)
            self._marks = np.repeat(self._marks, self._count, axis=0)
            self._asked = np.repeat(self._asked, self._count, axis=0)
        if self._shared is None:
            row = self._rows[environment]
            self._commands[row] = script.commands
            self._marks[row] = script.marks
            self._asked[row] = self._scripted_torque(script)
        return script

    def marks(self, steps: NDArray[np.intp]) -> Array:
        """Return every environment's marks at its control step, (environments, 4)."""
        return self._at(self._marks, steps)

    def asked(self, steps: NDArray[np.intp]) -> Array | None:
        """Return the task's torque in every environment there, (environments,) [N m].

        None where it follows from more than the phase.
        """
        return None if self._task is None else self._at(self._asked, steps)

    def commands(self, steps: NDArray[np.intp]) -> Array:
        """Return the commands of every environment during the next control step.

        Returns:
            Commands, (environments, physics steps, joints); where the episode is over,
            the last one.
        """
        skip = self._author.frame_skip
        places = steps[:, None] * skip + np.arange(skip)
        last = self._commands.shape[1] - 1
        return self._at(self._commands, np.minimum(places, last))

    def _at(self, written: Array, places: NDArray[np.intp]) -> Array:
        """Return the values at every environment's places (environments, ...)."""
        found: Array
        if self._shared is not None:
            found = written[0].take(places, axis=0)
        else:
            rows = self._rows.reshape(-1, *(places.ndim - 1) * (1,))
            found = written[rows, places]
        return found

    def _scripted_torque(self, script: Script) -> Array:
        """Return the task's torque along a script; (0,) if not of the phase alone."""
        if self._task is None:
            return np.zeros(0)
        phase = script.marks[:, 1]
        nothing = np.zeros_like(phase)
        demanded = self._task.torque(nothing, nothing, phase)
        return np.array(np.broadcast_to(demanded, phase.shape), dtype=np.float64)


def find_trajectory(
    given: str | Path | Trajectory,
    reach: float,
    centre: float = 0.0,
    joints: Mapping[str, tuple[float, float]] | None = None,
) -> Trajectory:
    """Return the trajectory that is requested of a device; see `human.trajectory`.

    Args:
        given: A text, the path of a table, or a trajectory.
        reach: Largest excursion of named trajectories from `centre` [rad].
        centre: Angle about which named trajectories move [rad].
        joints: Range [rad] by name of the joints that the wearer moves, the driven one
            first.

    Raises:
        CableError: If there is no such trajectory, the file cannot be used, or it does
            not move the driven joint.
    """
    return trajectory(given, reach, centre, joints)


def unperturbed(source: Trajectory) -> Trajectory:
    """Return the trajectory inside perturbations."""
    while isinstance(source, Perturbed):
        source = source.base
    return source
