"""Table of the columns of an episode log: names, units and meanings.

They hold true values, not the measurements of a controller (`device._sensors`). The
dictionary `info` of an environment has exactly these keys, so the table documents both.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

from cc_mujoco._utils.csv_files import read_sheet


@dataclass(frozen=True)
class LogColumn:
    name: str  # name, ending in the unit; `{cable}` stands for the name of a cable
    unit: str  # SI unit, `1` for a pure number, `mixed` where entries differ
    meaning: str  # one line for a reader who sees only the file
    listed: bool = False  # true when every row holds a list of values instead of one
    dtype: str = "float64"  # NumPy name of the element type


MODEL_XML, AXES = "model_xml", "axes"
"""Metadata keys: the MJCF of the model, and the facts of each axis by name, of a device
with several."""

TIME_COLUMN, POSE_COLUMN = (
    LogColumn("time_s", "s", "simulated time"),
    LogColumn("qpos", "mixed", "generalized coordinates (rad, m)", listed=True),
)


def _columns(of: str) -> tuple[LogColumn, ...]:
    """Return the columns of `log_columns.csv` that belong to an `axis` or a `cable`."""
    sheet = read_sheet(Path(__file__).with_name("log_columns.csv"))
    rows = (row.cells for row in sheet.rows if row.cells[0] == of)
    return tuple(
        LogColumn(name, unit, meaning, kind == "list", dtype)
        for _, name, unit, kind, dtype, meaning in rows
    )


AXIS_COLUMNS, CABLE_COLUMNS = _columns("axis"), _columns("cable")
"""Columns that every log has for each axis, of several begun with its name, and for
each cable."""


def columns_for(
    cables: Iterable[str], prefixes: Iterable[str] = ("",)
) -> tuple[LogColumn, ...]:
    """Return the columns of a log with these cables and axis prefixes, in order."""
    axes, own = product(prefixes, AXIS_COLUMNS), product(cables, CABLE_COLUMNS)
    return (
        TIME_COLUMN,
        *(replace(column, name=prefix + column.name) for prefix, column in axes),
        POSE_COLUMN,
        *(replace(column, name=column.name.format(cable=c)) for c, column in own),
    )


def prefixes_in(names: Iterable[str]) -> tuple[str, ...]:
    """Return the axis prefixes of these columns, in order."""
    end = AXIS_COLUMNS[0].name
    return tuple(name[: -len(end)] for name in names if name.endswith(end))


def cables_in(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the cables that have columns among these, in order."""
    start, end = CABLE_COLUMNS[-2].name.split("{cable}")
    own = [name for name in names if name.startswith(start) and name.endswith(end)]
    return tuple(name[len(start) : -len(end)] for name in own)
