"""Scripts: the wearer's motion in an episode, computed before it begins."""

import itertools
import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cc_mujoco.device._model import DeviceModel
from cc_mujoco.device._mover import Mover
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.human import Motion, Recorded, Task, TimeTorque, Trajectory, Walk
from cc_mujoco.human._by_text import TableTorque
from cc_mujoco.human._motion import SampledMotion
from cc_mujoco.human._perturbed import unperturbed
from cc_mujoco.human._tasks import task_torque
from cc_mujoco.native import FloatArray as Array

MARKS = 5
"""Marks of an axis: reference angle [rad], phase of the cycle or time [s] for a task of
time, sine and cosine of the phase, and the desired torque [N m] where it is known in
advance, else 0; see `Author.tasks`."""


PART_STEPS = 16_384  # samples of a script that are computed at once


class ScriptPart(NamedTuple):
    """`PART_STEPS` consecutive samples of a script, or the rest of it."""

    commands: Array
    """Controls of the wearer before every physics step, (physics steps, k).

    One per physics step: a command that is held over a control period would be a
    staircase, which a stiff wearer follows as one.
    """
    marks: Array
    """`MARKS` of every axis in turn at every sample, (samples, MARKS * axes)."""


class Script:
    """Controls of the wearer, and reference motion, for an episode of n samples.

    It is computed in parts on demand; only the latest part stays in memory.
    """

    def __init__(
        self,
        angles: Mapping[str, float],
        count: int,
        work_out: Callable[[int], ScriptPart],
    ) -> None:
        """Prepare for `count` parts; `work_out` computes the part of a number.

        `angles` are the initial angles of the joints that the wearer moves [rad].
        """
        self.angles = angles
        self.count, self._work_out = count, work_out
        self._latest: tuple[int, ScriptPart] | None = None

    def part(self, number: int) -> ScriptPart:
        latest = self._latest
        if latest is None or latest[0] != number:
            self._latest = latest = (number, self._work_out(number))
        return latest[1]

    @cached_property
    def commands(self) -> Array:
        return np.concatenate([part.commands for part in self._parts()])

    @cached_property
    def marks(self) -> Array:
        return np.concatenate([part.marks for part in self._parts()])

    def mark(self, place: int) -> Array:
        """Return column `place` of the marks, (n + 1,), without loading the others."""
        return np.concatenate([part.marks[:, place] for part in self._parts()])

    def _parts(self) -> Iterator[ScriptPart]:
        return map(self.part, range(self.count))


class Author:
    """Source of a script for every episode.

    A trajectory without randomness gives all episodes the same script.
    """

    def __init__(
        self,
        device: DeviceModel,
        sources: Sequence[Trajectory],
        tasks: Sequence[Task],
        steps: int,
        frame_skip: int,
    ) -> None:
        """Prepare; warn if a recorded motion or torque ends before the episode.

        There is a trajectory and a task per axis; equal trajectories are sampled once.
        `steps` are samples of `frame_skip` physics steps.
        """
        duration = steps * frame_skip * float(device.model.opt.timestep)
        for recorded in dict.fromkeys((*map(unperturbed, sources), *tasks)):
            _warn_of_end(recorded, duration)
        moves: dict[str, None] = dict.fromkeys(
            source.describe()
            for source in map(unperturbed, sources)
            if (isinstance(source, Walk) and source.joints)
            or (isinstance(source, Recorded) and source.columns)
        )
        for axis, source, task in zip(device.axes, sources, tasks, strict=True):
            base, limb = unperturbed(source), axis.axis.limb
            if isinstance(base, Recorded) and base.columns and base.joint:
                if limb not in (base.joint, *dict(base.others)):
                    moves[f"{limb} rests"] = None
            if isinstance(task, TableTorque) and task.column:
                moves[task.describe()] = None
                _warn_of_sign(limb, base, task)
        self.note = "; ".join(moves) + "." if moves else ""
        """Sentence on joints that walk, and on what a table gives; empty by default."""
        self.tasks = tuple((task, _is_scripted(task)) for task in tasks)
        """Task of each axis, and whether its torque depends on phase only, equally for
        all devices: then the script has it."""
        self._commanded = tuple(task.commands_angle for task in tasks)
        self._device = device
        self._sources = tuple(sources)
        self._steps = steps
        self.frame_skip = frame_skip
        self._single_script: Script | None = None
        self._wearers = device.wearers  # wearers of that script

    def write(self, rng: np.random.Generator) -> Script:
        """Return a script with random numbers of `rng`; refuse motion out of range."""
        wearers = self._device.wearers
        if self._single_script is not None and wearers == self._wearers:
            return self._single_script
        before = repr(rng.bit_generator.state)
        script = self._write(rng)
        if repr(rng.bit_generator.state) == before:
            self._single_script, self._wearers = script, wearers
        return script

    def _write(self, rng: np.random.Generator) -> Script:
        device, skip = self._device, self.frame_skip
        dt = float(device.model.opt.timestep)
        duration, rows = self._steps * skip * dt, PART_STEPS * skip
        sampled: dict[int, SampledMotion] = {}
        for source in self._sources:
            if id(source) not in sampled:
                sampled[id(source)] = SampledMotion(source, duration, dt, rng, rows)
        movers = dict(device.movers)  # of this episode; the next wearer has others
        count = self._steps // PART_STEPS + 1

        def motions(number: int) -> tuple[dict[str, Motion], list[Motion]]:
            first = number * rows
            end = min(first + rows, self._steps * skip + 1)
            parts = {key: one.part(first, end) for key, one in sampled.items()}
            return self._motions(parts)

        def work_out(number: int) -> ScriptPart:
            return self._part(movers, *motions(number))

        # What cannot be evaluated anew, and a short script, are kept instead.
        kept = count == 1 or not all(source.is_pointwise for source in self._sources)
        parts: list[ScriptPart] = []
        angles: dict[str, float] = {}
        reach: dict[str, tuple[float, float]] = {}
        for number in range(count):
            moved, own = motions(number)
            angles = angles or self._first_angles(movers, moved)
            for joint, part in moved.items():
                low, high = reach.get(joint, (math.inf, -math.inf))
                low = min(low, float(part.angle.min()))
                reach[joint] = low, max(high, float(part.angle.max()))
            if kept:
                parts.append(self._part(movers, moved, own))
        limbs = [axis.axis.limb for axis in device.axes]
        commanded = itertools.compress(limbs, self._commanded)
        followed = {*movers, *commanded}
        for joint, ends in reach.items():
            if joint in followed:
                _require_range(joint, device.ranges[joint], *ends)
        for joint, mover in movers.items():
            if joint in reach:
                _warn_of_limit(joint, mover, *reach[joint])
        return Script(angles, count, parts.__getitem__ if kept else work_out)

    def _first_angles(
        self, movers: Mapping[str, Mover], moved: Mapping[str, Motion]
    ) -> dict[str, float]:
        first = {joint: self._device.neutral(joint) for joint in movers}
        known = [joint for joint in movers if joint in moved]
        first |= {joint: float(moved[joint].angle[0]) for joint in known}
        # A frame starts where its limb does.
        limbs = {one.axis.joint: one.axis.limb for one in self._device.axes}
        rest = {joint: self._device.neutral(limb) for joint, limb in limbs.items()}
        return {j: first.get(limbs[j], angle) for j, angle in rest.items()} | first

    def _motions(
        self, sampled: Mapping[int, Motion]
    ) -> tuple[dict[str, Motion], list[Motion]]:
        """Return the motion of every moved joint by name, and that of every axis.

        `sampled` has the motion, or a part of it, of each trajectory by its `id`.
        """
        device = self._device
        moved: dict[str, Motion] = {}
        motions: list[Motion] = []
        each = zip(device.axes, self._sources, self._commanded, strict=True)
        for axis, source, commanded in each:
            motion = sampled[id(source)]
            moved.update(motion.companions)
            joint = axis.axis.limb
            if not (commanded or joint in device.movers):  # the body moves by itself
                motion = resting(motion, device.neutral(joint))
            own = motion.companions.get(joint, motion)
            base = unperturbed(source)
            is_other = bool(motions and motion.companions)
            if isinstance(base, Recorded):  # of one joint, perhaps of another axis
                is_other = base.joint != joint if base.joint else bool(motions)
            if own is motion and is_other:
                own = resting(motion, device.neutral(joint))
            moved[joint] = own
            motions.append(own)
        return moved, motions

    def _part(
        self,
        movers: Mapping[str, Mover],
        moved: Mapping[str, Motion],
        motions: Sequence[Motion],
    ) -> ScriptPart:
        device, commands = self._device, np.zeros((motions[0].time.size, len(movers)))
        for place, (joint, mover) in enumerate(movers.items()):
            part = moved.get(joint)
            aim = (part.angle, part.velocity) if part else (device.neutral(joint), 0.0)
            commands[:, place] = mover.command(*aim)
        marks = []
        for motion, (task, is_scripted) in zip(motions, self.tasks, strict=True):
            each = motion.time, motion.angle, motion.phase
            time, angle, phase = (one[:: self.frame_skip] for one in each)
            turn = 2 * np.pi * phase
            clock = time if task.of_time else phase
            demand = nothing = np.zeros_like(phase)
            if is_scripted:
                found = task_torque(task, nothing, nothing, clock)
                demand = np.array(found, np.float64)
            marks += [angle, clock, np.sin(turn), np.cos(turn), demand]
        return ScriptPart(commands, np.stack(marks, axis=-1))


def _warn_of_end(recorded: object, duration: float) -> None:
    if isinstance(recorded, TimeTorque):
        held = "torque keeps its last value"
    elif isinstance(recorded, Recorded):
        held = "joint is held where it is then"
    else:
        return
    if recorded.end >= duration - 1e-9:
        return
    warnings.warn(
        f"{recorded.source or 'the recorded motion'} ends after {recorded.end:g} s; "
        f"the {held} for the rest of the {duration:g} s.",
        CableWarning,
        stacklevel=5,
    )


def _warn_of_sign(joint: str, motion: Trajectory, task: TableTorque) -> None:
    is_moment = task.column.endswith("_moment_nm")  # of OpenSim, no sign given
    if isinstance(motion, Recorded) and is_moment and joint in motion.turned:
        warnings.warn(
            f"the motion of joint {joint!r} is turned to fit its range, but its torque "
            f"{task.column!r} of {task.source} is not; {task.source}:{joint}=-COLUMN "
            "turns it, too, and +COLUMN keeps it.",
            CableWarning,
            stacklevel=4,
        )


def _warn_of_limit(joint: str, mover: Mover, low: float, high: float) -> None:
    aims = mover.scale * low + mover.offset, mover.scale * high + mover.offset
    if min(aims) < mover.low - 1e-6 or max(aims) > mover.high + 1e-6:
        warnings.warn(
            f"the motion of joint {joint!r} goes from {low:g} to {high:g} rad, but the "
            f"`ctrlrange` of its wearer ends at {mover.low:g} and {mover.high:g}; it "
            "is cut there.",
            CableWarning,
            stacklevel=5,
        )


def _require_range(
    name: str, allowed: tuple[float, float], least: float, most: float
) -> None:
    low, high = allowed
    if least < low or most > high:
        raise CableError(
            f"the trajectory moves joint {name!r} from {least:g} to {most:g} rad, but "
            f"it must stay in [{low:g}, {high:g}] rad."
        )


def resting(motion: Motion, angle: float) -> Motion:
    """Return a motion at a constant angle [rad], with times and phase of `motion`."""
    still = np.zeros_like(motion.time)
    return Motion(motion.time, still + angle, still, still, motion.phase)


def _is_scripted(task: Task) -> bool:
    nothing = np.zeros(1)
    return task.of_phase and np.size(task.torque(nothing, nothing, nothing)) == 1
