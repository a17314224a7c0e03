"""A trajectory read from a CSV file."""

from __future__ import annotations

import csv
import difflib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from cc_mujoco.errors import CableError
from cc_mujoco.human.motion import Array, Motion, Trajectory, progress

COLUMNS = ("time_s", "angle_rad")
"""Columns that a trajectory file must have; others are ignored."""

_SHORTEST = 4
_CLOSEST = 1e-6
_LIMITS = {"time_s": 1e6, "angle_rad": 1e3}


@dataclass(frozen=True)
class Recorded(Trajectory):
    """A recorded motion, joined by a cubic spline and held at its last angle.

    The spline starts and ends at rest, so that an episode can begin without a jerk and
    the hold that follows the end continues the motion. Phase: fraction of the episode.
    """

    times: tuple[float, ...]
    """Times of the samples from the first [s], increasing from 0."""
    angles: tuple[float, ...]
    """Angles [rad]."""

    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(self.times, self.angles, bc_type="clamped")
        inside = time <= self.times[-1]
        held = np.minimum(time, self.times[-1])
        return Motion(
            time,
            spline(held),
            np.where(inside, spline(held, 1), 0.0),
            np.where(inside, spline(held, 2), 0.0),
            progress(time, duration),
        )


def from_csv(path: str | Path) -> Recorded:
    """Read a trajectory from a CSV file with the columns `time_s` and `angle_rad`.

    The first line names the columns; time must increase from line to line and may start
    anywhere.

    Args:
        path: The file.

    Returns:
        The trajectory, as recorded and shifted to start at time 0.

    Raises:
        CableError: If the file cannot be read or used; names file, line and column.
    """
    path = Path(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            times, angles = _columns(path, file)
    except OSError as error:
        reason = error.strerror or str(error)
        raise CableError(f"cannot read the trajectory {path}: {reason}.") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise CableError(f"{path} is not a CSV text file: {error}.") from error
    return Recorded(tuple(t - times[0] for t in times), tuple(angles))


def _columns(path: Path, file: TextIO) -> tuple[list[float], list[float]]:
    """Read and check both columns."""
    reader = csv.reader(file)
    header = [name.strip() for name in next(reader, [])]
    places = [_place(path, header, name) for name in COLUMNS]
    times: list[float] = []
    angles: list[float] = []
    for row in reader:
        if not any(cell.strip() for cell in row):
            continue
        line = reader.line_num
        time, angle = (
            _number(path, line, name, row[place] if place < len(row) else "")
            for name, place in zip(COLUMNS, places, strict=True)
        )
        if times and time - times[-1] < _CLOSEST:
            raise CableError(
                f"{path}, line {line}, column time_s: {time:g} s must be at least "
                f"{_CLOSEST:g} s after the {times[-1]:g} s of the line before."
            )
        times.append(time)
        angles.append(angle)
    if len(times) < _SHORTEST:
        raise CableError(
            f"{path} has {len(times)} lines of data, but a trajectory needs at least "
            f"{_SHORTEST}."
        )
    return times, angles


def _place(path: Path, header: list[str], name: str) -> int:
    """Index of a column."""
    if name in header:
        return header.index(name)
    near = difflib.get_close_matches(name, header, n=1, cutoff=0.4)
    hint = f"; did you mean to rename {near[0]!r}?" if near else "."
    raise CableError(f"{path}, line 1: there is no column {name!r}{hint}")


def _number(path: Path, line: int, name: str, text: str) -> float:
    """Value of one cell."""
    limit = _LIMITS[name]
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= limit:
        raise CableError(
            f"{path}, line {line}, column {name}: {text.strip()!r} must be a number "
            f"between {-limit:g} and {limit:g}."
        )
    return value
