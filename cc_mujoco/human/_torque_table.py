"""Tasks by text: names, numbers, tasks of the user, and torque profiles from a table.

>>> from cc_mujoco.human import task
>>> task("hold:-12")
Hold(pull=-12.0)
>>> task("tunnel:half_width=0.1,limit=0.5").limit
0.5

Torques are against the phase of the gait, or against time:

read_torque("torque.csv")               # phase or time_s, torque_nm
read_torque("torque.csv", ("knee",))    # or knee_torque_nm, knee_angle_moment_nm
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cc_mujoco._utils import tables
from cc_mujoco._utils.tables import is_table
from cc_mujoco._utils.units import CLOCK, PHASE, TORQUE, quantity_words
from cc_mujoco._utils.user_code import user_errors
from cc_mujoco.errors import CableError
from cc_mujoco.human._pace import Real
from cc_mujoco.human._parsing import user_object, with_numbers
from cc_mujoco.human._recorded import match_joints
from cc_mujoco.human._tasks import TASKS, Task

MIN_SAMPLES = 2
_MAX_TORQUE, _MAX_TIME = 1e6, 1e6
_MAX_GAP = 0.5
"""Largest part of the cycle without a sample [-]."""


@dataclass(frozen=True)
class PhaseTorque(Task):
    """A torque over the phase, linear between its samples and periodic."""

    of_phase = True
    phases: tuple[float, ...]
    """Phases of the samples [-], increasing within [0, 1]."""
    torques: tuple[float, ...]
    """Torques [N m]."""
    source: str = field(default="", compare=False, repr=False)
    """Path of the file, for messages."""

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        found: Real = _interpolated(phase, self.phases, self.torques, 1.0)
        return found


@dataclass(frozen=True)
class TimeTorque(Task):
    """A torque over the time of the episode, linear between its samples.

    Before the first sample and after the last it keeps their torques.
    """

    of_phase = True
    of_time = True
    times: tuple[float, ...]
    """Times of the samples from the start of the episode [s], increasing."""
    torques: tuple[float, ...]
    """Torques [N m]."""
    source: str = field(default="", compare=False, repr=False)
    """Path of the file, for messages."""

    @property
    def end(self) -> float:
        """Time of the last sample [s]."""
        return self.times[-1]

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        found: Real = _interpolated(phase, self.times, self.torques, None)
        return found


def _interpolated(
    at: Any, over: Sequence[float], torques: Sequence[float], period: float | None
) -> Any:
    found = np.interp(at, over, torques, period=period)
    return found if isinstance(found, np.ndarray) else float(found)


def read_torque(
    path: str | Path, joints: Sequence[str] = ()
) -> PhaseTorque | TimeTorque:
    """Read a profile from a table with a column of torque over phase or time.

    `phase` holds fractions of the cycle up to 1; `phase_percent` (or `phase [%]`) per
    cent. Without either, `time_s`, `time_ms`, `time_us` or `time_ns` is the time since
    the start of the episode. Torque is `torque_nm`, or in another unit of torque, with
    the name of a joint before it, if any.

    Args:
        path: The file.
        joints: Name of the joint that the torque acts on, first of several; by default
            the file must have one column of torque.

    Raises:
        CableError: If the file cannot be read or used; names file, column and row.
    """
    path = Path(path)
    names = tables.column_names(path)
    torque = _torque_column(path, names, joints)
    phases = [name for name in names if quantity_words(name, PHASE)[0] == ()]
    phases = [name for name in phases if PHASE.name in name.lower()]
    if len(phases) > 1:
        raise CableError(f"{path}: {' and '.join(phases)} are both phase; keep one.")
    if not phases:
        over = tables.quantity_column(path, names, "time_s", CLOCK)
        times, torques = tables.read_course(
            path, [over._replace(limit=_MAX_TIME), torque]
        )
        _require_samples(path, times)
        return TimeTorque(tuple(times.tolist()), tuple(torques.tolist()), str(path))
    unit = quantity_words(phases[0], PHASE)[1]
    factor = PHASE.factors[unit] if unit else 1.0
    over = tables.Column(phases[0], factor)
    phase, torques = tables.read_course(path, [over, torque])
    _require_samples(path, phase)
    if phase[0] < 0.0 or phase[-1] > 1.0:
        ends = f"{phase[0] / factor:g} to {phase[-1] / factor:g}"
        advice = "" if unit else "; name it phase_percent if it is in per cent"
        raise CableError(
            f"{path}, column {phases[0]} goes from {ends}; it must be in "
            f"[0, {1.0 / factor:g}]{advice}."
        )
    gap = float(max(np.diff(phase).max(), 1.0 + phase[0] - phase[-1]))
    if gap > _MAX_GAP:
        raise CableError(
            f"{path}, column {phases[0]} leaves {gap:.0%} of the cycle without a "
            f"sample; it must leave at most {_MAX_GAP:.0%}."
        )
    return PhaseTorque(tuple(phase.tolist()), tuple(torques.tolist()), str(path))


def _torque_column(
    path: Path, names: Sequence[str], joints: Sequence[str]
) -> tables.Column:
    found: dict[tuple[str, ...], list[str]] = {}
    for name in names:
        key, unit = quantity_words(name, TORQUE)
        if unit is not None:
            own = tuple(word for word in key if word not in ("moment", "angle"))
            found.setdefault(own, []).append(name)
    matched = match_joints(found, joints)
    every = [name for columns in found.values() for name in columns]
    columns = matched.get(joints[0], []) if joints else every
    if not columns:
        name = f"{joints[0]}_torque_nm or torque_nm" if joints else "torque_nm"
        raise CableError(
            f"{path} has no column of the torque"
            + f" on joint {joints[0]!r}" * bool(joints)
            + f", only {', '.join(names[:12])}{', ...' if len(names) > 12 else ''}; "
            f"name it {name}."
        )
    if len(columns) > 1:
        raise CableError(
            f"{path} has several columns of torque, {' and '.join(columns)}; keep one "
            "of them."
        )
    unit = quantity_words(columns[0], TORQUE)[1]
    assert unit is not None
    return tables.Column(columns[0], TORQUE.factors[unit], _MAX_TORQUE)


def _require_samples(path: Path, over: np.ndarray[Any, Any]) -> None:
    if over.size < MIN_SAMPLES:
        raise CableError(
            f"{path} has {over.size} rows of data; a torque profile needs at least "
            f"{MIN_SAMPLES}."
        )


@dataclass(frozen=True)
class UserTask(Task):
    """A task of the user's own class, whose errors are reported in one sentence."""

    name: str
    """`MODULE:NAME`."""
    own: Task

    def __post_init__(self) -> None:
        super().__post_init__()
        for trait in ("of_phase", "of_time", "about_reference", "commands_angle"):
            object.__setattr__(self, trait, getattr(self.own, trait))

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        with user_errors(f"task {self.name!r}"):
            return self.own.torque(angle, velocity, phase)


def task(given: str | Path | Task, joints: Sequence[str] = ()) -> Task:
    """Return the task that is meant.

    Args:
        given: A key of `TASKS`, also with numbers (`hold:-12`, `spring:2.5`,
            `tunnel:half_width=0.1,limit=0.5`); a torque profile over phase or time in a
            table (a `Path`, or a text that ends as one, see `read_torque`);
            `MODULE:NAME` of a `Task` or a function that returns one; or a task.
        joints: Name of the joint that the torque acts on, for a table.

    Raises:
        CableError: If there is no such task, or it cannot be read or made.
    """
    if isinstance(given, Task):
        return given
    if isinstance(given, Path) or (isinstance(given, str) and is_table(given)):
        return read_torque(given, joints)
    if not isinstance(given, str):
        raise CableError(
            f"task must be a name, the path of a table or a Task, not {given!r}."
        )
    name, colon, _ = given.partition(":")
    if colon and name not in TASKS:
        made: Task = user_object("task", given, TASKS, Task, UserTask)
        return made
    return with_numbers("task", given, TASKS)
