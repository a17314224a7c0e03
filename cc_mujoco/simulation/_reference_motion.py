"""Motion of the wearer in an episode, worked out before it begins."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.device._device import Device
from cc_mujoco.errors import CableError
from cc_mujoco.human import Motion, Task, Trajectory, trajectory
from cc_mujoco.human import _gait as gait
from cc_mujoco.human._csv_motion import resolve_trajectory

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
    cycle, sine and cosine of that phase."""


class Author:
    """Author of a script for every episode.

    A trajectory that draws no random numbers is the same in every episode, and so is
    its script.
    """

    def __init__(
        self, device: Device, source: Trajectory, steps: int, frame_skip: int
    ) -> None:
        """Prepare.

        Args:
            device: Whose joint is moved.
            source: How it is moved.
            steps: Control steps in an episode.
            frame_skip: Physics steps in a control step.
        """
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
        self._check(motion)
        setup = device.setup
        motions = [sampled.companions.get(name) for name in setup.companions]
        played = [motion, *motions]
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
        return Script(
            np.array([0.0 if part is None else part.angle[0] for part in played]),
            np.clip(commands, *device.script_ranges.T),
            np.stack(
                [motion.angle[:: self.frame_skip], phase, np.sin(turn), np.cos(turn)],
                axis=-1,
            ),
        )

    def _check(self, motion: Motion) -> None:
        low, high = self._device.joint_range
        least, most = float(motion.angle.min()), float(motion.angle.max())
        if least < low or most > high:
            raise CableError(
                f"the trajectory moves joint {self._device.setup.joint!r} from "
                f"{least:g} to {most:g} rad, but it must stay in "
                f"[{low:g}, {high:g}] rad."
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


def find_trajectory(given: str | Path | Trajectory, reach: float) -> Trajectory:
    """Return the trajectory that is requested of an environment.

    Args:
        given: A name, a CSV file (a string ending in `.csv`, or any `Path`), or a
            trajectory.
        reach: Largest angle of named trajectories [rad].

    Raises:
        CableError: If there is no such trajectory, or the file cannot be used.
    """
    found = resolve_trajectory(given)
    return trajectory(found, reach) if isinstance(found, str) else found
