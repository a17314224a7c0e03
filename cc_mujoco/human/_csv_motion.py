"""A trajectory read from a CSV file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cc_mujoco._utils.csv_files import read_sheet
from cc_mujoco._utils.units import ANGLE, CLOCK
from cc_mujoco.errors import CableError
from cc_mujoco.human._motion import Array, Motion, Trajectory, episode_fraction

_MIN_SAMPLES = 4
_MIN_INTERVAL = 1e-6
_MAX_TIME, _MAX_ANGLE = 1e6, 1e3


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
            episode_fraction(time, duration),
        )


def resolve_trajectory(given: str | Path | Trajectory) -> str | Trajectory:
    """Return the trajectory that is meant, or its name where it is a scripted one.

    Args:
        given: A name, a CSV file (a string ending in `.csv`, or any `Path`), or a
            trajectory.

    Raises:
        CableError: If it is none of these, or the file cannot be used.
    """
    if isinstance(given, Path) or (
        isinstance(given, str) and given.lower().endswith(".csv")
    ):
        return from_csv(given)
    if not isinstance(given, (str, Trajectory)):
        raise CableError(
            f"trajectory must be a name, the path of a CSV file or a Trajectory, "
            f"not {given!r}."
        )
    return given


def from_csv(path: str | Path) -> Recorded:
    """Read a trajectory from a CSV file with the columns `time_s` and `angle_rad`.

    The first line names the columns; time must increase from line to line and may start
    anywhere. Other units are converted by the name of the column, as of `time_ms` and
    `angle_deg`; other columns are ignored. Forms of CSV are those of `csv_files`.

    Args:
        path: The file.

    Returns:
        The trajectory, as recorded and shifted to start at time 0.

    Raises:
        CableError: If the file cannot be read or used; names file, line and column.
    """
    sheet = read_sheet(path, "the trajectory")
    clock, turned = sheet.column("time_s", CLOCK), sheet.column("angle_rad", ANGLE)
    times: list[float] = []
    angles: list[float] = []
    for row in sheet.rows:
        time = sheet.number(row, clock, -_MAX_TIME, _MAX_TIME)
        angles.append(sheet.number(row, turned, -_MAX_ANGLE, _MAX_ANGLE))
        if times and time - times[-1] < _MIN_INTERVAL:
            raise CableError(
                f"{path}, line {row.line}, column {clock.name}: {time:g} s must be at "
                f"least {_MIN_INTERVAL:g} s after the {times[-1]:g} s of the line "
                "before."
            )
        times.append(time)
    if len(times) < _MIN_SAMPLES:
        raise CableError(
            f"{path} has {len(times)} lines of data, but a trajectory needs at least "
            f"{_MIN_SAMPLES}."
        )
    return Recorded(tuple(t - times[0] for t in times), tuple(angles))
