"""Trajectories and tasks by text: names, numbers, tables and objects of the user.

    >>> from cc_mujoco.human import task, trajectory
    >>> trajectory("sweep")
    Sweep(amplitude=0.4, move=1.0, hold=0.5)
    >>> trajectory("sweep", limit=0.3).amplitude       # made to fit an ankle
    0.3
    >>> trajectory("sine:0.2,frequency=2").frequency
    2.0
    >>> task("hold:-12")
    Hold(pull=-12.0)
    >>> task("tunnel:half_width=0.1,limit=0.5").limit
    0.5

A first number without a name is the first parameter of the trajectory or task. Defaults
suit a wrist, except those of `walk`, which suit an ankle. Parameters are changed with
`dataclasses.replace`; `Trajectory` has what all have in common. A table of torques is
over the phase of the gait, or over time:

read_torque("torque.csv")               # phase or time_s, torque_nm
read_torque("torque.csv", ("knee",))    # or knee_torque_nm, knee_angle_moment_nm
read_torque("id.sto", ("knee_r",))      # knee_angle_r_moment
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cc_mujoco._utils import opensim_files, tables
from cc_mujoco._utils.tables import is_table
from cc_mujoco._utils.units import ANGLE, CLOCK, PHASE, TORQUE, quantity_words
from cc_mujoco._utils.user_code import named_object, user_errors, without_mark
from cc_mujoco._validation import require_number
from cc_mujoco.errors import CableError, look_up, naming
from cc_mujoco.human import _recorded as recorded
from cc_mujoco.human._motion import Motion, Trajectory
from cc_mujoco.human._pace import Real
from cc_mujoco.human._perturbed import Disturbed
from cc_mujoco.human._recorded import Recorded, no_column, read_trajectory
from cc_mujoco.human._scripted import TRAJECTORIES, Walk
from cc_mujoco.human._tasks import TASKS, Task
from cc_mujoco.native import FloatArray as Array

Entry = TypeVar("Entry")


@dataclass(frozen=True)
class Centred(Trajectory):
    """Scripted trajectory about an angle other than 0, at which it starts at rest."""

    base: Trajectory  # trajectory about 0
    centre: float  # angle that is added [rad]

    @property
    def is_pointwise(self) -> bool:
        return self.base.is_pointwise

    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        motion = self.base._motion(time, duration, rng)
        return replace(motion, angle=motion.angle + self.centre)


@dataclass(frozen=True)
class UserTrajectory(Trajectory):
    """Trajectory of a user's class; its errors become a `CableError` of a sentence."""

    name: str  # `MODULE:NAME`
    own: Trajectory

    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        with user_errors(f"trajectory {self.name!r}"):
            motion = self.own._motion(time, duration, rng)
        if not isinstance(motion, Motion):
            raise CableError(
                f"trajectory {self.name!r} gave {motion!r}; it must be a Motion."
            )
        for each in ("angle", "velocity", "acceleration", "phase"):
            values = np.asarray(getattr(motion, each))
            if values.shape != time.shape or not np.isfinite(values).all():
                raise CableError(
                    f"trajectory {self.name!r}: `{each}` must be {time.size} finite "
                    f"numbers, one for each time, not an array {values.shape}."
                )
        return motion


def trajectory(
    given: str | Path | Trajectory,
    limit: float | None = None,
    centre: float = 0.0,
    joints: Mapping[str, tuple[float, float]] | None = None,
    driven: Sequence[str] = (),
) -> Trajectory:
    """Return the trajectory that `given` names, adapted to a device.

    A built-in trajectory moves about `centre`, where it starts at rest. Its default
    amplitude is reduced to `limit`; one in the text is kept. At `centre` 0 and without
    `limit` it is the entry of `TRAJECTORIES`, bit for bit. `walk` has the angles of the
    gait, on the joints that take part (`Walk.on_joints`), and ignores `centre`.
    Recorded motions and those of a user are not changed.

    Args:
        given: A key of `TRAJECTORIES`, also with numbers (`sine:0.3`,
            `chirp:0.2,high=5`); a table (a `Path`, or a text with the ending of one,
            see `read_trajectory`); `MODULE:NAME` of a `Trajectory` or of a function
            that returns one; or a trajectory.
        limit: Largest excursion of built-in trajectories from `centre` [rad]; none by
            default.
        centre: Angle about which built-in trajectories move [rad].
        joints: Range [rad] by name of the joints that the wearer moves, the driven one
            first; by default joints are not checked.
        driven: Joints that the device drives, of which a table must move one; the first
            of `joints` by default.
    """
    require_number("centre", centre, -1e3, 1e3, "rad")
    if isinstance(given, Path) or (isinstance(given, str) and is_table(given)):
        read = read_trajectory(given, tuple(joints or ()), driven)
        return _on_joints(read, joints, driven)
    kind = "trajectory"
    made = _object(kind, given, TRAJECTORIES, Trajectory, UserTrajectory)
    if made is not None:
        return _on_joints(made, joints, driven)
    found = with_numbers(kind, str(given), TRAJECTORIES)
    # Names of the parameters in the text; the first may be without.
    pieces = [piece for piece in str(given).partition(":")[2].split(",") if piece]
    named = [p.partition("=")[0].strip() if "=" in p else "" for p in pieces]
    chosen = "" in named or "amplitude" in named
    if not chosen and limit is not None and found.amplitude > limit:
        found = replace(found, amplitude=limit)
    if centre and not isinstance(found, Walk):
        return Centred(found, float(centre))
    return _on_joints(found, joints, driven)


def _on_joints(
    found: Trajectory,
    joints: Mapping[str, tuple[float, float]] | None,
    driven: Sequence[str],
) -> Trajectory:
    if not joints:
        return found
    if isinstance(found, Disturbed):
        return replace(found, base=_on_joints(found.base, joints, driven))
    if isinstance(found, Walk):
        return found.on_joints(joints)
    if isinstance(found, Recorded):
        return found.on_joints(joints, driven)
    return found


class TableTorque(Task):
    """Torque of a table, linear between its samples."""

    torques: tuple[float, ...]
    source: str
    column: str

    def describe(self) -> str:
        """Return a clause with column, range and sign of the torque."""
        ends = f"{min(self.torques):.3g} to {max(self.torques):.3g} N m"
        sign = "turned" if self.column.startswith("-") else "with the sign of the file"
        return f"the torque is {self.column!r} of {self.source}, {ends}, {sign}"


@dataclass(frozen=True)
class PhaseTorque(TableTorque):
    """Torque as a periodic function of the phase."""

    of_phase = True
    phases: tuple[float, ...]  # of the samples [-], increasing within [0, 1]
    torques: tuple[float, ...]  # [N m]
    source: str = field(default="", compare=False, repr=False)  # path, for messages
    column: str = field(default="", compare=False, repr=False)  # a minus turns it

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        found = np.interp(phase, self.phases, self.torques, period=1.0)
        return found if isinstance(phase, np.ndarray) else float(found)


@dataclass(frozen=True)
class TimeTorque(TableTorque):
    """Torque as a function of the time in the episode.

    It is constant before the first sample and after the last.
    """

    of_phase = True
    of_time = True
    times: tuple[float, ...]  # from the start of the episode [s], increasing
    torques: tuple[float, ...]  # [N m]
    source: str = field(default="", compare=False, repr=False)  # path, for messages
    column: str = field(default="", compare=False, repr=False)  # a minus turns it

    @property
    def end(self) -> float:
        """Time of the last sample [s]."""
        return self.times[-1]

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        found = np.interp(phase, self.times, self.torques)
        return found if isinstance(phase, np.ndarray) else float(found)


def read_torque(
    path: str | Path, joints: Sequence[str] = ()
) -> PhaseTorque | TimeTorque:
    """Read a torque profile from a table with a column of torque over phase or time.

    `phase` is a fraction of the cycle from 0 to 1, `phase_percent` (or `phase [%]`) one
    in per cent. Without either, `time_s`, `time_ms`, `time_us` or `time_ns` is the time
    since the start of the episode; that of OpenSim's files is shifted to start at 0.
    Torque is `torque_nm` or has another unit of torque, after the name of a joint if
    there is one, or `ankle_angle_r_moment` of OpenSim. The column of the first of
    `joints` is read, or the one that stands behind the path, see `read_trajectory`;
    without `joints` the file must have a single column of torque.
    """
    path, side, chosen = recorded.split_selection(path, joints)
    names = tables.column_names(path)
    own = next((c for j, c in chosen.items() if j in joints[:1] or not joints), "")
    torque = _torque_column(path, names, joints, side, own)
    phases = [name for name in names if quantity_words(name, PHASE)[0] == ()]
    phases = [name for name in phases if PHASE.name in name.lower()]
    if len(phases) > 1:
        raise CableError(f"{path}: {' and '.join(phases)} are both phase; keep one.")
    if phases:
        unit = quantity_words(phases[0], PHASE)[1]
        factor = PHASE.factors[unit] if unit else 1.0
        over = tables.Column(phases[0], factor)
    else:
        clock = tables.quantity_column(path, names, "time_s", CLOCK)
        over = clock._replace(limit=1e6)
    phase, torques = tables.read_course(path, [over, torque])
    if phase.size < 2:
        raise CableError(
            f"{path} has {phase.size} rows of data; a torque profile needs at least 2."
        )
    if not phases and opensim_files.has_header(path):
        phase = phase - phase[0]
    text = own or torque.name
    samples = tuple(phase.tolist()), tuple(torques.tolist()), str(path), text
    if not phases:
        return TimeTorque(*samples)
    if phase[0] < 0.0 or phase[-1] > 1.0:
        ends = f"{phase[0] / factor:g} to {phase[-1] / factor:g}"
        advice = "" if unit else "; name it phase_percent if it is in per cent"
        raise CableError(
            f"{path}, column {phases[0]} goes from {ends}; it must be in "
            f"[0, {1.0 / factor:g}]{advice}."
        )
    gap = float(max(np.diff(phase).max(), 1.0 + phase[0] - phase[-1]))
    if gap > 0.5:
        raise CableError(
            f"{path}, column {phases[0]} leaves {gap:.0%} of the cycle without a "
            f"sample; it must leave at most 50%."
        )
    return PhaseTorque(*samples)


def _torque_column(
    path: Path, names: Sequence[str], joints: Sequence[str], side: str, own: str
) -> tables.Column:
    """Return the column that is named `own`, or that of the first joint."""
    if own:
        return recorded.selected_column(path, names, own, TORQUE)
    found: dict[tuple[str, ...], list[str]] = {}
    for name in names:
        key, unit = quantity_words(name, TORQUE)
        if unit is not None:
            joint = tuple(word for word in key if word not in ("moment", "angle"))
            found.setdefault(joint, []).append(name)
    matched = recorded.match_joints(found, joints, side)
    every = [name for columns in found.values() for name in columns]
    columns = matched.get(joints[0], []) if joints else every
    if not columns:
        name = f"{joints[0]}_torque_nm or torque_nm" if joints else "torque_nm"
        where = f" on joint {joints[0]!r}" if joints else ""
        raise no_column(path, names, f"the torque{where}", name)
    if len(columns) > 1:
        raise CableError(
            f"{path} has several columns of torque, {' and '.join(columns)}; keep one "
            "of them."
        )
    unit = quantity_words(columns[0], TORQUE)[1]
    assert unit is not None
    return tables.Column(columns[0], TORQUE.factors[unit], 1e6)


@dataclass(frozen=True)
class UserTask(Task):
    """Task of a user's class; its errors become a `CableError` of a sentence."""

    name: str  # `MODULE:NAME`
    own: Task

    def __post_init__(self) -> None:
        super().__post_init__()
        for trait in ("of_phase", "of_time", "about_reference", "commands_angle"):
            object.__setattr__(self, trait, getattr(self.own, trait))

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        with user_errors(f"task {self.name!r}"):
            return self.own.torque(angle, velocity, phase)


def task(given: str | Path | Task, joints: Sequence[str] = ()) -> Task:
    """Return the task that `given` names.

    Args:
        given: A key of `TASKS`, also with numbers (`hold:-12`, `spring:2.5`,
            `tunnel:half_width=0.1,limit=0.5`); a table of torque over phase or time (a
            `Path`, or a text with the ending of one, see `read_torque`); `MODULE:NAME`
            of a `Task` or of a function that returns one; or a task.
        joints: Joints of a table, that on which the torque acts first.
    """
    if isinstance(given, Path) or (isinstance(given, str) and is_table(given)):
        return read_torque(given, joints)
    made: Task | None = _object("task", given, TASKS, Task, UserTask)
    return with_numbers("task", str(given), TASKS) if made is None else made


def with_columns(
    texts: Mapping[str, str], columns: Sequence[str], side: str | None
) -> dict[str, str]:
    """Return the texts of tables with the columns (`JOINT=COLUMN`) that each has."""
    read = {key: text for key, text in texts.items() if is_table(text)}
    if not read:
        raise CableError("columns and a side are of a table, and none is given.")
    wanted = {column: column.partition("=")[2] for column in columns}
    left, found = list(columns), {}
    for key, text in read.items():
        kind = ANGLE if key == "trajectory" else TORQUE
        names = tables.column_names(path := tables.split_selection(text)[0])
        own = [c for c in wanted if recorded.columns_like(wanted[c], names, kind)]
        left = [column for column in left if column not in own]
        pieces = ";".join([f"side={side}"] * bool(side) + own)
        found[key] = f"{text}{':' if text == str(path) else ';'}{pieces}".rstrip(":;")
    if left:
        raise CableError(
            f"--column {left[0]} must be JOINT=COLUMN with a column of "
            f"{' or '.join(dict.fromkeys(read.values()))}, such as {names[-1]}."
        )
    return found


def is_user_object(text: object, registry: Mapping[str, Any]) -> bool:
    """Return whether a text is `MODULE:NAME`, not a name of `registry` with numbers."""
    if not isinstance(text, str) or is_table(text):
        return False
    place, colon, name = text.partition(":")
    return bool(colon) and place not in registry and name.isidentifier()


def with_numbers(kind: str, text: str, registry: Mapping[str, Entry]) -> Entry:
    """Return the entry that a text names, with the parameters after its colon.

    The text is `NAME`, `NAME:NUMBER` or `NAME:FIELD=NUMBER,FIELD=NUMBER`. Entries of
    `registry` are frozen dataclasses; errors call one a `kind`.
    """
    name, colon, rest = text.partition(":")
    found: Any = look_up(kind, name, registry)
    if not colon:
        return registry[name]
    values = {own.name: getattr(found, own.name) for own in dataclasses.fields(found)}
    numeric = {key: v for key, v in values.items() if isinstance(v, (int, float))}
    kinds = {key: int if isinstance(v, int) else float for key, v in numeric.items()}
    if not kinds:
        raise CableError(f"{kind} {text!r}: {name!r} takes no numbers; write {name!r}.")
    numbers: dict[str, float] = {}
    for place, piece in enumerate(rest.split(",")):
        key, equals, number = piece.rpartition("=")
        key = key.strip() if equals or place else next(iter(kinds))
        if key not in kinds:
            raise CableError(
                f"{kind} {text!r}: {piece!r} must be FIELD=NUMBER with FIELD one of "
                f"{', '.join(kinds)}."
            )
        if key in numbers:
            raise CableError(f"{kind} {text!r} gives {key!r} twice; give it once.")
        try:
            numbers[key] = kinds[key](number)
        except ValueError:
            whole = "whole " if kinds[key] is int else ""
            raise CableError(
                f"{kind} {text!r}: {number!r} must be a {whole}number, the {key} of "
                f"{name!r}."
            ) from None
    with naming(f"{kind} {text!r}"):
        replaced: Entry = replace(found, **numbers)
        return replaced


def _object(
    kind: str,
    given: Any,
    registry: Mapping[str, Any],
    base: type[Any],
    wrap: Callable[[str, Any], Any],
) -> Any:
    """Return `given` or the object of its `MODULE:NAME`; None if it is a name."""
    if isinstance(given, base):
        return given
    if not isinstance(given, str):
        raise CableError(
            f"{kind} must be a name, the path of a table or a {base.__name__}, not "
            f"{given!r}."
        )
    place, colon, name = given.partition(":")
    if not colon or place in registry:
        return None
    if not name.isidentifier() and given == without_mark(given):
        raise CableError.unknown(kind, place, registry)
    found = named_object(kind, given, "object")
    if callable(found) and not isinstance(found, base):
        with user_errors(f"{kind} {given!r}"):
            found = found()
    if not isinstance(found, base):
        raise CableError(
            f"{kind} {given!r} must be a {base.__name__}, or a function without "
            f"arguments that returns one, not {found!r}."
        )
    return found if is_package_object(found) else wrap(given, found)


def is_package_object(given: object) -> bool:
    return type(given).__module__.partition(".")[0] == __name__.partition(".")[0]


def user_classes(given: object) -> tuple[str, ...]:
    """Return `MODULE:NAME` of each class in an object that is not of this package."""
    kind = type(given)
    found = [] if is_package_object(given) else [f"{kind.__module__}:{kind.__name__}"]
    if dataclasses.is_dataclass(given):
        for own in dataclasses.fields(given):
            value = getattr(given, own.name)
            if type(value).__module__ != "builtins":
                found += user_classes(value)
    return tuple(found)
