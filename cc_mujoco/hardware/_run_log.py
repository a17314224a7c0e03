"""Log of a run: its rows as they are measured, and a record of its settings.

`log.csv` is written in blocks, so that a killed process loses at most one block; if it
is killed while writing, the last line may be incomplete. Columns are those of an
episode log (`cc_mujoco.simulation._log_columns`) as far as a rig measures them, so that
`cc-mujoco diagnose` can read it.
"""

import contextlib
import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from cc_mujoco._utils import atomic_io
from cc_mujoco.datasets._run_log import DEFAULT_LOG_NAME, RUN_MARK, page_of
from cc_mujoco.errors import CableError
from cc_mujoco.hardware._packet import Readings

RUN_COLUMNS = (
    "time_s", "motor_angle_rad", "motor_velocity_rad_s", "motor_torque_nm",
    "joint_angle_rad", "joint_velocity_rad_s", "joint_torque_nm", "desired_torque_nm",
    "command_torque_nm", "controller_torque_nm", "late_s", "work_s", "cycle",
)  # fmt: skip
"""Columns of a row of one axis: time by the rig's clock; its measurements;
`motor_torque_nm`, the torque commanded before them; the desired torque; the torque
commanded in this cycle; the one that the controller requested (NaN without a request);
delay of the cycle and time until its command was sent; number of the cycle."""
_AXIS_COLUMNS = RUN_COLUMNS[1:-3]
SAMPLE_TIME = "sample_time_s"
"""Column of each of several axes: time of its reading by its own rig's clock, since its
first reading in the log. `time_s` is that of the first axis."""


class AxisRow(NamedTuple):
    """Part of a row that belongs to one axis."""

    seen: Readings
    before: float  # torque that the motor was commanded when the reading came [N m]
    desired: float = math.nan
    """Desired torque at the joint [N m]; NaN if the controller was not called."""
    command: float = math.nan  # torque that is commanded in this cycle [N m]
    wish: float = math.nan
    """Torque that the controller requested [N m]; NaN if it was not called."""


def run_columns(axes: Sequence[str] = ("",)) -> tuple[str, ...]:
    """Return the columns of a log; those of an axis begin with its name.

    The name of a device's only axis is empty.
    """
    own = (SAMPLE_TIME, *_AXIS_COLUMNS) if len(axes) > 1 else _AXIS_COLUMNS
    starts = [f"{axis}." if axis else "" for axis in axes]
    named = [f"{start}{name}" for start in starts for name in own]
    return (RUN_COLUMNS[0], *named, *RUN_COLUMNS[-3:])


def files_of(name: str) -> tuple[str, str]:
    """Return the names of a run's two files: rows and record."""
    rows = f"{name}.csv"
    return rows, page_of(Path(rows)).name


def require_free(folder: str | os.PathLike[str], name: str = DEFAULT_LOG_NAME) -> None:
    """Refuse a folder that holds the files of a run, which are never replaced.

    Also refuse one with unrelated files, unless the run is a trial. Call it before a
    rig is connected; `name` is that of the run's files.
    """
    atomic_io.require_writable(folder)
    if _is_empty(Path(folder), name):
        return
    for file in files_of(name):
        if os.path.lexists(Path(folder, file)):
            raise CableError(
                f"{folder} holds {file}; measured data are never replaced, name "
                "another folder to write to."
            )
    atomic_io.require_ours(folder, lambda _: name != DEFAULT_LOG_NAME)


def _is_empty(folder: Path, name: str) -> bool:
    """Return whether the folder has a run's files that hold no measurement."""
    rows, page = (folder / file for file in files_of(name))
    try:
        # A longer file has rows.
        header = rows.read_bytes() if rows.stat().st_size < 65536 else b""
        names = header.decode().removesuffix("\n").split(",")
        ends = [name for name in names if name.endswith(_AXIS_COLUMNS[0])]
        axes = [name.removesuffix(_AXIS_COLUMNS[0]).rstrip(".") for name in ends]
        bare = bool(axes) and names == [*run_columns(axes)]
        return bare and page.read_text(encoding="utf-8")[:1] == "{"
    except (OSError, ValueError):
        return False


class RunLog:
    """Log of a run: its rows, and a record of its settings and outcome."""

    def __init__(
        self,
        folder: str | os.PathLike[str],
        about: Mapping[str, Any],
        rows: int,
        name: str = DEFAULT_LOG_NAME,
        axes: Sequence[str] = ("",),
    ) -> None:
        """Create both files of this name in a folder; see `require_free`.

        `about` has the settings of the run for JSON, `rows` is the number of rows in a
        block; the name of a device's only axis is empty.
        """
        require_free(folder, name)
        rows_file, about_file = files_of(name)
        self._folder = Path(folder)
        self._page = self._folder / about_file
        self._about = {**RUN_MARK, **about}
        self._rows = rows
        self._block: list[str] = []
        self._starts: list[float] = []
        self._folder.mkdir(parents=True, exist_ok=True)
        # With blanks, as a full disk leaves no place for the outcome.
        self._tell({"outcome": "running, or killed"}, 4096)
        self._path = self._folder / rows_file
        if _is_empty(self._folder, name):
            os.unlink(self._path)
        # Unbuffered: what is written is the system's, not this process's.
        self._file = open(self._path, "xb", buffering=0)
        self._size = 0
        self._disk_is_full = False
        try:
            self._write((",".join(run_columns(axes)) + "\n").encode())
        except CableError:
            self._file.close()
            self._path.unlink()
            self._page.unlink()
            raise

    def row(
        self, axes: Sequence[AxisRow], late: float, work: float, cycle: int
    ) -> None:
        """Append the row of a cycle that began `late` and worked for `work` [s]."""
        if not self._starts:
            self._starts = [axis.seen.time for axis in axes]
        row = [axes[0].seen.time - self._starts[0]]
        for start, (seen, before, *others) in zip(self._starts, axes, strict=True):
            time, angle, velocity, *joint, _ = seen
            if len(axes) > 1:
                row.append(time - start)
            row += (angle, velocity, before, *joint, *others)
        row += (late, work, cycle)
        self._block.append(",".join(repr(float(value)) for value in row))
        if len(self._block) >= self._rows:
            self.flush()

    def close(self, outcome: Mapping[str, Any]) -> None:
        """Complete both files, with the outcome of the run for JSON."""
        try:
            self.flush()
        finally:
            self._file.close()
            self._tell(outcome)

    def flush(self) -> None:
        """Write the remaining rows."""
        data = "".join(f"{row}\n" for row in self._block).encode()
        self._block.clear()
        if data and not self._disk_is_full:
            self._write(data)

    def _write(self, data: bytes) -> None:
        """Write complete lines, as many as the disk has room for."""
        done = 0
        try:
            while done < len(data):
                done += self._file.write(data[done:]) or 0
        except OSError as error:
            self._disk_is_full = True
            self._size += data[:done].rfind(b"\n") + 1
            with contextlib.suppress(OSError):
                os.ftruncate(self._file.fileno(), self._size)
            raise CableError(
                f"{self._path} cannot be written: {error.strerror or error}; it ends "
                "with its last whole line."
            ) from error
        self._size += done

    def _tell(self, outcome: Mapping[str, Any], spare: int = 0) -> None:
        """Write the run record; `spare` blanks keep disk space for the outcome."""
        text = json.dumps({**self._about, **outcome}, indent=1) + "\n"
        data = text.encode() + b" " * spare
        try:
            with atomic_io.replacing(self._page) as partial:
                partial.write_bytes(data)
        except CableError:
            # A full disk still has the bytes that the page has.
            if not self._page.is_file() or self._page.stat().st_size < len(data):
                raise
            with open(self._page, "r+b", buffering=0) as page:
                page.write(data.ljust(self._page.stat().st_size))
