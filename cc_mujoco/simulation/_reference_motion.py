"""Motion of the wearer in an episode, worked out before it begins."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.device._model import DeviceModel
from cc_mujoco.device._mover import Mover
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.human import (
    Motion,
    Perturbed,
    Recorded,
    Task,
    TimeTorque,
    Trajectory,
    Walk,
)

Array = NDArray[np.float64]


MARKS = 4
"""Marks of an axis: reference angle [rad], phase of the cycle or time [s] for a task of
time, sine and cosine of the phase."""


@dataclass(frozen=True, eq=False)
class Script:
    """The wearer's part in an episode of n control steps and m physics steps."""

    angles: Mapping[str, float]
    """First angle of each joint that the wearer moves [rad]."""
    commands: Array
    """Controls of the wearer before every physics step, (m + 1, k).

    One per physics step: a command that is held over a control period would be a
    staircase, which a stiff wearer follows as one.
    """
    marks: Array
    """`MARKS` of every axis in turn at every control step, (n + 1, 4 axes)."""


class Author:
    """Author of a script for every episode.

    A trajectory that draws no random numbers is the same in every episode, and so is
    its script.
    """

    def __init__(
        self,
        device: DeviceModel,
        sources: Sequence[Trajectory],
        tasks: Sequence[Task],
        steps: int,
        frame_skip: int,
    ) -> None:
        """Prepare; warn of a recorded motion or torque that ends before the episode.

        Args:
            device: Whose joints are moved.
            sources: How the joint of each axis is moved; what is the same trajectory
                is one motion.
            tasks: What the wearer should feel at each axis.
            steps: Control steps in an episode.
            frame_skip: Physics steps in a control step.
        """
        duration = steps * frame_skip * float(device.model.opt.timestep)
        for recorded in dict.fromkeys((*map(unperturbed, sources), *tasks)):
            _warn_of_end(recorded, duration)
        walks = dict.fromkeys(
            source.describe()
            for source in map(unperturbed, sources)
            if isinstance(source, Walk) and source.joints
        )
        self.note = "; ".join(walks) + "." if walks else ""
        """Sentence that says which joints of the device walk; empty by default."""
        self._of_time = tuple(task.of_time for task in tasks)
        self._device = device
        self._sources = tuple(sources)
        self._steps = steps
        self.frame_skip = frame_skip
        self._single_script: Script | None = None
        self._wearers = device.wearers
        """Wearers whose script that is."""

    def write(self, rng: np.random.Generator) -> Script:
        """Write the script of an episode.

        Args:
            rng: Source of all that is random about it.

        Raises:
            CableError: If a joint would have to leave its range.
        """
        wearers = self._device.wearers
        if self._single_script is not None and wearers == self._wearers:
            return self._single_script
        before = repr(rng.bit_generator.state)
        script = self._write(rng)
        if repr(rng.bit_generator.state) == before:
            self._single_script, self._wearers = script, wearers
        return script

    def _write(self, rng: np.random.Generator) -> Script:
        device = self._device
        dt = float(device.model.opt.timestep)
        substeps = self._steps * self.frame_skip
        sampled: dict[int, Motion] = {}
        for source in self._sources:
            if id(source) not in sampled:
                sampled[id(source)] = source.sample(substeps * dt, dt, rng)
        moved: dict[str, Motion] = {}
        motions: list[Motion] = []
        for axis, source in zip(device.axes, self._sources, strict=True):
            motion = sampled[id(source)]
            moved.update(motion.companions)
            joint = axis.axis.limb
            if joint not in device.movers:  # the body moves by itself
                motion = resting(motion, device.neutral(joint))
            own = motion.companions.get(joint, motion)
            recorded = isinstance(unperturbed(source), Recorded)
            if own is motion and motions and (recorded or motion.companions):
                own = resting(motion, device.neutral(joint))
            moved[joint] = own
            motions.append(own)
        for joint, part in moved.items():
            if joint in device.movers:
                _require_range(device.model, joint, part)
        angles: dict[str, float] = {}
        commands = np.zeros((substeps + 1, len(device.movers)))
        for axis in device.axes:  # a frame starts where its limb does
            angles[axis.axis.joint] = float(moved[axis.axis.limb].angle[0])
        for place, (joint, mover) in enumerate(device.movers.items()):
            if joint not in moved:
                angles[joint] = device.neutral(joint)
                commands[:, place] = mover.command(angles[joint], 0.0)
                continue
            part = moved[joint]
            _warn_of_limit(joint, mover, part)
            angles[joint] = float(part.angle[0])
            commands[:, place] = mover.command(part.angle, part.velocity)
        marks = []
        for motion, of_time in zip(motions, self._of_time, strict=True):
            phase = motion.phase[:: self.frame_skip]
            turn = 2 * np.pi * phase
            angle = motion.angle[:: self.frame_skip]
            clock = motion.time[:: self.frame_skip] if of_time else phase
            marks += [angle, clock, np.sin(turn), np.cos(turn)]
        return Script(angles, commands, np.stack(marks, axis=-1))


def _warn_of_end(recorded: object, duration: float) -> None:
    """Warn of a recorded motion or torque that ends before the episode."""
    if not isinstance(recorded, (Recorded, TimeTorque)):
        return
    if recorded.end >= duration - 1e-9:
        return
    held = (
        "torque keeps its last value"
        if isinstance(recorded, TimeTorque)
        else "joint is held where it is then"
    )
    warnings.warn(
        f"{recorded.source or 'the recorded motion'} ends after {recorded.end:g} s; "
        f"the {held} for the rest of the {duration:g} s.",
        CableWarning,
        stacklevel=5,
    )


def _warn_of_limit(joint: str, mover: Mover, motion: Motion) -> None:
    """Warn of a motion that the control of the wearer does not reach."""
    low, high = float(motion.angle.min()), float(motion.angle.max())
    aims = mover.scale * low + mover.offset, mover.scale * high + mover.offset
    if min(aims) < mover.low - 1e-6 or max(aims) > mover.high + 1e-6:
        warnings.warn(
            f"the motion of joint {joint!r} goes from {low:g} to {high:g} rad, but the "
            f"`ctrlrange` of its wearer ends at {mover.low:g} and {mover.high:g}; it "
            "is cut there.",
            CableWarning,
            stacklevel=5,
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


def resting(motion: Motion, angle: float) -> Motion:
    """Return a motion that stays at an angle, with the phase of another."""
    still = np.zeros_like(motion.time)
    return Motion(motion.time, still + angle, still, still, motion.phase)


class Scripts:
    """The scripts of many environments, as arrays over environments."""

    def __init__(self, author: Author, count: int, tasks: Sequence[Task]) -> None:
        """Prepare.

        Args:
            author: Writes the scripts.
            count: Number of environments.
            tasks: What the wearers should feel at each axis.
        """
        self._author = author
        self._tasks = tuple(task if task.of_phase else None for task in tasks)
        self._count = count
        self._rows = np.zeros(count, dtype=np.intp)
        self._shared: Script | None = None
        """Only script so far."""
        self._commands = np.zeros((0, 0, 0))
        self._marks = np.zeros((0, 0, 0))
        self._demands = [np.zeros((0, 0)) for _ in tasks]

    def write(self, environment: int, rng: np.random.Generator) -> Script:
        """Write the script of the next episode of an environment."""
        script = self._author.write(rng)
        if script is self._shared:
            return script
        axes = range(len(self._tasks))
        demands = [self._scripted_torque(script, axis) for axis in axes]
        if not self._commands.size:
            # One row is enough for all where every episode is the same.
            self._shared = script
            self._commands, self._marks = script.commands[None], script.marks[None]
            self._demands = [demand[None] for demand in demands]
            return script
        if self._shared is not None:
            self._shared = None
            self._rows = np.arange(self._count)
            self._commands = np.repeat(self._commands, self._count, axis=0)
            self._marks = np.repeat(self._marks, self._count, axis=0)
            self._demands = [
                np.repeat(demand, self._count, axis=0) for demand in self._demands
            ]
        row = self._rows[environment]
        self._commands[row] = script.commands
        self._marks[row] = script.marks
        for kept, demand in zip(self._demands, demands, strict=True):
            kept[row] = demand
        return script

    def marks(self, steps: NDArray[np.intp]) -> Array:
        """Return every environment's marks at its control step, (environments, 4 n)."""
        return self._at(self._marks, steps)

    def demands(self, steps: NDArray[np.intp]) -> list[Array | None]:
        """Return the torque of each axis' task in every environment there [N m].

        None where it follows from more than the phase, else (environments,).
        """
        return [
            None if task is None else self._at(kept, steps)
            for task, kept in zip(self._tasks, self._demands, strict=True)
        ]

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

    def _scripted_torque(self, script: Script, axis: int) -> Array:
        """Return a task's torque along a script; (0,) if not of the phase alone."""
        task = self._tasks[axis]
        if task is None:
            return np.zeros(0)
        phase = script.marks[:, MARKS * axis + 1]
        nothing = np.zeros_like(phase)
        demanded = task.torque(nothing, nothing, phase)
        return np.array(np.broadcast_to(demanded, phase.shape), dtype=np.float64)


def unperturbed(source: Trajectory) -> Trajectory:
    """Return the trajectory inside perturbations."""
    while isinstance(source, Perturbed):
        source = source.base
    return source
