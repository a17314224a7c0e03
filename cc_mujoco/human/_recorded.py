"""Trajectories of one or several joints, read from a table.

    read_trajectory("motion.csv")                      # time_s, angle_rad
    read_trajectory("walk.mot", ("knee_r", "hip_r"))   # knee_angle_r, hip_r, in degrees
    read_trajectory("walk.mot:knee=-knee_angle_l", ("knee",))     # that column, turned

A column of angles is named by its joint and its unit, `knee_deg` or `knee_angle_rad`;
`angle_deg` or `joint_angle_deg` is that of the joint that the device drives.
`_utils.tables` reads CSV, TSV, Parquet, OpenSim, MATLAB and HDF5 files. Behind a path
may stand `JOINT=COLUMN`, with a sign and with the unit that the column's name lacks,
and `side=left` for joints that name no side, separated by semicolons.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from cc_mujoco._utils import opensim_files, tables
from cc_mujoco._utils.units import ANGLE, CLOCK, Kind, quantity_words, unit_of
from cc_mujoco.errors import CableError, CableWarning, look_up
from cc_mujoco.human._gait import SIDES
from cc_mujoco.human._motion import Motion, Trajectory, episode_fraction, pointwise
from cc_mujoco.native import FloatArray as Array

Words = tuple[str, ...]
Entry = TypeVar("Entry")

# Names of the joint that the device drives, in words without `angle`
_DRIVEN_NAMES: tuple[Words, ...] = ((), ("joint",))


@dataclass(frozen=True)
class Recorded(Trajectory):
    """Recorded motion: a cubic spline through its samples, then its last angle.

    The spline starts and ends at rest, so that an episode begins without a jerk and the
    motion is smooth when it stops at the end. Phase: fraction of the episode.
    """

    times: tuple[float, ...]
    """Times of the samples from the first [s], increasing from 0."""
    angles: tuple[float, ...]  # of the joint that the device drives [rad]
    joint: str = ""  # name of that joint; empty where the file names none
    others: tuple[tuple[str, tuple[float, ...]], ...] = ()
    """Names and angles [rad] of other joints."""
    source: str = field(default="", compare=False, repr=False)
    """Path of the file, for messages."""
    columns: tuple[str, ...] = field(default=(), compare=False, repr=False)
    """Columns of the joints, that of the driven one first; turned ones with a minus."""
    signed: tuple[bool, ...] = field(default=(), compare=False, repr=False)
    """True for the columns whose signs are those of OpenSim's coordinates."""

    @property
    def end(self) -> float:
        """Time of the last sample [s]."""
        return self.times[-1]

    @property
    def turned(self) -> list[str]:
        """Joints whose columns are turned to fit the ranges of a device."""
        joints = self.joint, *dict(self.others)
        each = zip(joints, self.columns, self.signed, strict=False)
        return [joint for joint, column, own in each if own and column.startswith("-")]

    def describe(self) -> str:
        """Return a sentence with column, range and sign of each joint's angle."""
        every = [(self.joint, self.angles), *self.others]
        each, signs = [], "with the signs of the file"
        for k, column in enumerate(self.columns):
            (joint, angles), is_other = every[k], column.startswith("-")
            least, most = min(angles), max(angles)
            text = f"{joint or 'the driven joint'} by {column!r}, {least:.3g} to "
            each.append(f"{text}{most:.3g} rad")
            signs = "a minus turns a column" if is_other else signs
            limb = _side_and_limb(quantity_words(column, ANGLE)[0])[1]
            if any(self.signed[k : k + 1]) and limb in _COORDINATES:
                known = _COORDINATES[limb]
                if known.joint == "knee":  # models differ; it flexes the further way
                    is_other = most > -least
                each[-1] += f", {(known.positive, known.negative)[is_other]} positive"
        return f"{self.source} moves {', '.join(each)}, {signs}"

    def on_joints(
        self,
        joints: Sequence[str] | Mapping[str, tuple[float, float]],
        driven: Sequence[str] = (),
    ) -> Recorded:
        """Return the motion with the joints of a device, a driven one first.

        The `driven` joints are the first by default; one of them must move. With ranges
        [rad] a coordinate of OpenSim is turned if more of its motion then lies in the
        range of its joint.
        """
        ranges, joints = joints if isinstance(joints, Mapping) else {}, tuple(joints)
        every = [(self.joint, self.angles), *self.others]
        keys = {}
        for k, (name, angles) in enumerate(every):
            words = quantity_words(name, ANGLE)[0]
            keys[words] = angles, self.columns[k : k + 1], self.signed[k : k + 1]
        found = match_joints(keys, joints)
        if not (first := [j for j in driven or joints[:1] if j in found]):
            names = " and ".join(repr(name) for name, _ in every)
            raise CableError(
                f"{self.source or 'the recorded motion'} moves {names}, but the device "
                f"drives the joint {joints[0]!r}; name its column "
                f"{tables.unit_names(joints[0] + '_angle', ANGLE)}."
            )
        moved = {name: found[name] for name in (*first, *joints) if name in found}
        for name, (angles, column, by_model) in moved.items():
            low, high = ranges.get(name, (0.0, 0.0))
            least, most = min(angles), max(angles)
            inside = min(most, high) - max(least, low)
            if any(by_model) and min(-least, high) - max(-most, low) > inside + 1e-9:
                turned = tuple(f"-{one}".removeprefix("--") for one in column)
                moved[name] = tuple(-angle for angle in angles), turned, by_model
        (main, own), *others = ((name, angles) for name, (angles, *_) in moved.items())
        columns = tuple(one for _, column, _ in moved.values() for one in column)
        signed = tuple(one for *_, by_model in moved.values() for one in by_model)
        about = self.source, columns, signed
        return Recorded(self.times, own, main, tuple(others), *about)

    @pointwise
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        phase = episode_fraction(time, duration)
        own = self._played(self.angles, time, phase)
        companions = {name: self._played(a, time, phase) for name, a in self.others}
        if companions and self.joint:
            companions[self.joint] = own
        return replace(own, companions=companions)

    def _played(self, angles: tuple[float, ...], time: Array, phase: Array) -> Motion:
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(self.times, angles, bc_type="clamped")
        held, inside = np.minimum(time, self.end), time <= self.end
        rate, bend = (np.where(inside, spline(held, order), 0.0) for order in (1, 2))
        return Motion(time, spline(held), rate, bend, phase)


def match_joints(
    columns: Mapping[Words, Entry], joints: Sequence[str], side: str = ""
) -> dict[str, Entry]:
    """Return the entry of `columns` for each joint of a device, by the joint's name.

    Keys of `columns` are the words of a column's name, without quantity and unit. The
    driven joint is the first. A joint without a column of its name takes the one of
    equal limb and side, as OpenSim names them: `hip_flexion_r` for `right_hip`. A joint
    that names no side takes that of `side` or, by default, the right one of two.
    """
    found = {}
    limbs = {_side_and_limb(key): key for key in columns}
    for (own_side, limb), column in tuple(limbs.items()):
        if (known := _COORDINATES.get(limb)) is not None:
            limbs.setdefault((own_side, (known.joint,)), column)
    for place, joint in enumerate(joints):
        own = quantity_words(joint, ANGLE)[0]
        own_side, limb = _side_and_limb(own)
        sides = [own_side or side] if own_side or side else ["right", "left", ""]
        alike = (limbs[each, limb] for each in sides if (each, limb) in limbs)
        named = [own, *(_DRIVEN_NAMES if not place else ()), *alike]
        key = next((key for key in named if key in columns), None)
        if key is not None:
            found[joint] = columns[key]
    return found


def _side_and_limb(words: Words) -> tuple[str, Words]:
    """Return the side of a name's words, or "", and the rest without flexion."""
    sides = [SIDES[word] for word in words if word in SIDES]
    rest = tuple(w for w in words if w not in SIDES and w not in ("flexion", "flex"))
    return sides[0] if len(sides) == 1 else "", rest


_COORDINATES = {
    _side_and_limb(quantity_words(name, ANGLE)[0])[1]: own
    for name, own in opensim_files.COORDINATES.items()
}


def read_trajectory(
    path: str | Path, joints: Sequence[str] = (), driven: Sequence[str] = ()
) -> Recorded:
    """Read a motion from a table with a column of time and columns of angles.

    Time is `time_s`, `time_ms`, `time_us` or `time_ns`; it must increase from row to
    row, and is shifted to start at 0. Angles are `angle_rad`, `angle_deg`, `angle_mrad`
    or `angle_rev`, with the name of a joint before or instead of `angle`. OpenSim files
    have their units in the header.

    The columns of `joints` are read, of which the device drives `driven`, the first by
    default; one of these must have a column. By default all columns of angles are read;
    one without the name of a joint, else the first, is that of the driven joint.
    """
    path, side, chosen = split_selection(path, joints)
    names = tables.column_names(path)
    clock = tables.quantity_column(path, names, "time_s", CLOCK)
    picked = {j: selected_column(path, names, c, ANGLE) for j, c in chosen.items()}
    columns = _angle_columns(path, names, joints, side, picked)
    main = [joint for joint in driven or joints[:1] if joint in columns]
    if joints and not main:
        ways = f"{joints[0]}_angle_deg, or {tables.unit_names('angle', ANGLE)}"
        ways += f", or give one by --column {joints[0]}=NAME"
        raise no_column(path, names, f"the angle of joint {joints[0]!r}", ways)
    columns = {joint: columns[joint] for joint in (*main, *columns)}
    read = [clock._replace(limit=1e6), *columns.values()]
    times, *moved = tables.read_course(path, read, 1e-6)  # least interval [s]
    if len(times) < 4:
        raise CableError(
            f"{path} has {len(times)} rows of data, but a trajectory needs at least 4."
        )
    angles = [tuple(values.tolist()) for values in moved]
    (first, own), *others = zip(columns, angles, strict=True)
    since = tuple((times - times[0]).tolist())
    named = tuple(chosen.get(j, one.name) for j, one in columns.items())
    by_model = opensim_files.has_header(path)
    signed = tuple(by_model and name[0] not in "+-" for name in named)
    return Recorded(since, own, first, tuple(others), str(path), named, signed)


def split_selection(
    given: str | Path, joints: Sequence[str]
) -> tuple[Path, str, dict[str, str]]:
    """Split a table's text; refuse other joints, warn of a side that none needs."""
    path, side, chosen = tables.split_selection(given)
    for joint in chosen if joints else ():
        look_up("joint", joint, dict.fromkeys(joints))
    if side and all(_side_and_limb(quantity_words(j, ANGLE)[0])[0] for j in joints):
        warnings.warn(
            f"{path}: side={side} has no effect, as no joint lacks a side; choose "
            "columns by JOINT=COLUMN instead.",
            CableWarning,
            stacklevel=4,
        )
    return path, side, chosen


def columns_like(given: str, names: Sequence[str], measured: Kind) -> list[str]:
    """Return the names that are, but for unit and sign, the one that a user gives."""
    wanted = opensim_files.coordinate(given.lstrip("+-"))
    own = quantity_words(wanted, measured)[0]
    same = [name for name in names if name == wanted]
    return same or [n for n in names if quantity_words(n, measured)[0] == own]


def selected_column(
    path: Path, names: Sequence[str], given: str, measured: Kind
) -> tables.Column:
    """Return the column that a user names, with a sign and a unit if it lacks one."""
    found = columns_like(given, names, measured)
    if len(found) != 1:
        few = f"{len(found) or 'no'} columns named {given!r}"
        raise CableError(f"{path} has {few}, only {', '.join(names[:12])}.")
    wanted = unit_of(given, measured)
    unit = unit_of(found[0], measured) or wanted
    if wanted not in (None, unit):
        raise CableError(
            f"{path}: column {found[0]!r} is in {unit}, not in the {wanted} of "
            f"{given!r}; name it without a unit or in {unit}."
        )
    if unit is None:
        ways = tables.unit_names(given, measured)
        raise CableError(f"{path}: column {found[0]!r} has no unit; name it {ways}.")
    factor = measured.factors[unit] * (-1.0 if given.startswith("-") else 1.0)
    return tables.Column(found[0], factor, 1e3 if measured is ANGLE else 1e6)


def _angle_columns(
    path: Path,
    names: Sequence[str],
    joints: Sequence[str],
    side: str,
    picked: Mapping[str, tables.Column],
) -> dict[str, tables.Column]:
    if picked and not joints:
        return dict(picked)
    with_unit: dict[Words, list[str]] = {}
    without: dict[Words, list[str]] = {}
    for name in names:
        key, unit = quantity_words(name, ANGLE)
        if not key and not _names_angle(name):
            continue
        (without if unit is None else with_unit).setdefault(key, []).append(name)
    if not joints:
        angles = {k: v for k, v in without.items() if _names_angle(v[0])}
        if not with_unit and angles:
            raise _no_unit(path, next(iter(angles.values()))[0])
        if not with_unit:
            tables.quantity_column(path, names, "angle_rad", ANGLE)
        keys = sorted(with_unit, key=lambda key: key not in _DRIVEN_NAMES)
        return {"_".join(key): _single_column(path, with_unit[key]) for key in keys}
    found = match_joints(with_unit, joints, side)  # in the order of the joints
    for joint, bare in match_joints(without, joints, side).items():
        if joint not in {**found, **picked}:
            raise _no_unit(path, bare[0])
    known = [joint for joint in joints if joint in picked or joint in found]
    return {j: picked.get(j) or _single_column(path, found[j]) for j in known}


def no_column(path: Path, names: Sequence[str], what: str, ways: str) -> CableError:
    listed = f"{', '.join(names[:12])}{', ...' if len(names) > 12 else ''}"
    return CableError(f"{path} has no column of {what}, only {listed}; name it {ways}.")


def _names_angle(column: str) -> bool:
    return ANGLE.name in column.lower()


def _no_unit(path: Path, column: str) -> CableError:
    stem = column if _names_angle(column) else f"{column}_angle"
    header = ""
    if opensim_files.has_header(path):
        header = ", or write inDegrees=yes or inDegrees=no into its header"
        header += f", or give it by --column JOINT={stem}_deg"
    return CableError(
        f"{path}: the angle {column!r} has no unit; name the column {stem}_deg if it "
        f"is in degrees or {stem}_rad if it is in radians{header}."
    )


def _single_column(path: Path, columns: Sequence[str]) -> tables.Column:
    """Return the single column of a joint's angle, or the one in radians of several."""
    plain = [c for c in columns if quantity_words(c, ANGLE)[1] == ANGLE.unit]
    if len(columns) > 1 and len(plain) != 1:
        raise CableError(
            f"{path}: {' and '.join(columns)} are the angle of one joint; keep one of "
            "them."
        )
    name = columns[0] if len(columns) == 1 else plain[0]
    unit = quantity_words(name, ANGLE)[1] or ANGLE.unit
    return tables.Column(name, ANGLE.factors[unit], 1e3)
