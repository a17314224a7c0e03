"""Columns of numbers from CSV, TSV, Parquet, OpenSim, MATLAB, HDF5 and MCAP files.

    names = column_names(path)
    time = quantity_column(path, names, "time_s", CLOCK)
    angle = quantity_column(path, names, "angle_rad", ANGLE)
    times, angles = read_course(path, [time, angle])

For the forms of CSV see `csv_files`, for the units of OpenSim's columns
`opensim_files`, and for names of columns in other formats `array_files`, `mcap_files`.
A text `TABLE:JOINT=COLUMN;JOINT=COLUMN` selects columns, see `split_selection`.
"""

import csv
import difflib
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from cc_mujoco._utils import array_files, mcap_files, opensim_files
from cc_mujoco._utils.array_files import FloatArray
from cc_mujoco._utils.parsing import unreadable
from cc_mujoco._utils.units import Kind, unit_of, words
from cc_mujoco.errors import CableError, look_up

_READERS: dict[str, ModuleType] = {
    ".mot": opensim_files,
    ".sto": opensim_files,
    ".mat": array_files,
    ".h5": array_files,
    ".hdf5": array_files,
    ".mcap": mcap_files,
}
ENDINGS = (".csv", ".tsv", ".parquet", *_READERS)
"""Endings of files that can be read, in any case."""
_MARKERS = (".c3d", ".trc")  # endings of files with the places of markers
_TABLE = re.compile(
    rf"(.+(?:{'|'.join(map(re.escape, (*ENDINGS, *_MARKERS)))}))(?::(.*))?", re.I
)


def is_table(name: str | Path) -> bool:
    return _TABLE.fullmatch(str(name)) is not None


def split_selection(given: str | Path) -> tuple[Path, str, dict[str, str]]:
    """Return path, side ("" for any) and columns by joint of a table's text."""
    found = _TABLE.fullmatch(str(given))
    if found is None or not found[2]:
        return Path(given), "", {}
    chosen = dict(piece.partition("=")[::2] for piece in found[2].split(";"))
    if not all(key and value.strip("+-") for key, value in chosen.items()):
        raise CableError(f"{given}: {found[2]!r} must be JOINT=COLUMN or side=left.")
    side = chosen.pop("side", "")
    if side:
        look_up("side", side, dict.fromkeys(("left", "right")))
    return Path(found[1]), side, chosen


def require_no_markers(path: Path) -> None:
    if path.suffix.lower() in _MARKERS:
        raise CableError(
            f"{path} has places of markers, not angles of joints; run inverse "
            "kinematics first (OpenSim, AddBiomechanics), and give its .mot file."
        )


def _reader(path: Path) -> Any:
    require_no_markers(path)
    if path.suffix.lower() in _READERS:
        return _READERS[path.suffix.lower()]
    if path.suffix.lower() != ".parquet" and opensim_files.has_header(path):
        return opensim_files
    from cc_mujoco._utils import arrow_files  # pyarrow takes long to load

    return arrow_files


def column_names(path: Path) -> list[str]:
    with _readable(path):
        names: list[str] = _reader(path).column_names(path)
    return names


def read_columns(
    path: Path, names: Iterable[str], switches: Iterable[str] = ()
) -> dict[str, FloatArray]:
    """Return the columns of a file as numbers (rows,) by name, NaN where missing.

    Names must be unique in the file. In CSV columns of `switches` may hold true and
    false, read as 1 and 0. Columns of MATLAB and HDF5 files may differ in length.
    """
    with _readable(path):
        read: dict[str, FloatArray]
        read = _reader(path).read_columns(path, list(names), switches)
    return read


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Turn errors of an unreadable or non-text file into a `CableError`."""
    try:
        yield
    except (UnicodeError, csv.Error) as error:
        raise CableError(f"{path} is not a text file: {error}.") from None
    except OSError as error:
        raise unreadable(path, error) from None


def quantity_column(
    path: Path, names: Sequence[str], name: str, measured: Kind
) -> "Column":
    """Return the column of a quantity, as `angle_rad`, in any unit (`Angle [deg]`)."""
    stem = name.rpartition("_")[0]
    found = {}
    for other in names:
        unit = unit_of(other, measured)
        if unit is not None and "_".join(words(other)[:-1]) == stem:
            found[other] = Column(other, measured.factors[unit])
    if name in found:
        return found[name]
    if len(found) > 1:
        raise CableError(
            f"{path}: {' and '.join(found)} are both {name}; keep one of them."
        )
    if not found:
        raise _missing_quantity(path, names, name, measured)
    return next(iter(found.values()))


def _missing_quantity(
    path: Path, names: Sequence[str], name: str, measured: Kind
) -> CableError:
    stem = name.rpartition("_")[0]
    start = f"{path}: there is no column {name!r}"
    near = next(iter(difflib.get_close_matches(name, names, 1, 0.4)), "")
    if near and (unit := unit_of(near, measured)) is not None:
        return CableError(f"{start}; if it is {near!r}, name it {stem}_{unit.lower()}.")
    advice = f"; if it is {near!r}, name it by its unit" if near else "; name it"
    return CableError(f"{start}{advice}: {unit_names(stem, measured)}.")


def unit_names(stem: str, measured: Kind) -> str:
    return " or ".join(f"{stem}_{unit.lower()}" for unit in measured.factors)


class Column(NamedTuple):
    """A column of a file, and the conversion of its numbers to SI."""

    name: str  # in the file
    factor: float  # factor that its numbers are multiplied by
    limit: float = math.inf  # largest absolute number, converted


def read_course(
    path: Path, columns: Sequence[Column], interval: float = 0.0, is_rising: bool = True
) -> tuple[FloatArray, ...]:
    """Return columns (rows,) in SI, without rows that are blank in all of them.

    The first of `columns` must increase from row to row, by at least `interval` in SI
    if that is not 0, unless `is_rising` is False.
    """
    names = column_names(path)
    for column in columns:
        if names.count(column.name) > 1:
            raise CableError(
                f"{path} has several columns {column.name}; keep one of them."
            )
    read = read_columns(path, dict.fromkeys(column.name for column in columns))
    if len({len(values) for values in read.values()}) > 1:
        raise CableError(
            f"{path}: {' and '.join(read)} have different numbers of rows; each row "
            "needs them all."
        )
    blank = np.all([np.isnan(values) for values in read.values()], axis=0)
    found = [column.factor * read[column.name][~blank] for column in columns]
    for column, values in zip(columns, found, strict=True):
        _require_range(path, column, values)
    rising, over = columns[0], found[0]
    step = np.diff(over)
    early = np.flatnonzero((step <= 0.0) | (step < interval))
    if is_rising and early.size:
        row, unit = int(early[0]) + 1, rising.factor
        least = f"at least {interval / unit:g} above" if interval else "above"
        raise CableError(
            f"{path}, column {rising.name}, row {row + 1} of the data: "
            f"{over[row] / unit:g} must be {least} the {over[row - 1] / unit:g} of the "
            "row before."
        )
    return tuple(found)


def _require_range(path: Path, column: Column, values: FloatArray) -> None:
    wrong = np.flatnonzero(~(np.isfinite(values) & (np.abs(values) <= column.limit)))
    if not wrong.size:
        return
    row = int(wrong[0])
    among = "a finite number"
    if math.isfinite(column.limit):
        end = column.limit / abs(column.factor)
        among = f"a number between {-end:g} and {end:g}"
    given = values[row] / column.factor
    text = "is missing; it" if np.isnan(given) else f"is {given:g}; it"
    raise CableError(
        f"{path}, column {column.name}, row {row + 1} of the data {text} must be "
        f"{among}."
    )
