"""Files of trials, found and read: channels in SI units under their own names.

What a file calls its columns, and in which units, comes from its `dataset.toml` or from
the names themselves: `motor_angle_deg` is the motor angle in degrees.
"""

from __future__ import annotations

import difflib
import hashlib
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cc_mujoco.diagnosis.data import channels, tables
from cc_mujoco.diagnosis.data.dataset_file import DatasetFile
from cc_mujoco.diagnosis.data.trials import FloatArray
from cc_mujoco.errors import CableError

LARGEST, LATEST = 1e6, 1e11
"""Readings and times [s] beyond these are taken for missing."""
DATASET_FILE = "dataset.toml"


@dataclass
class Recording:
    """What a file holds, before it is checked and cut.

    Attributes:
        name: of the trial.
        path: the file.
        sha256: of its bytes.
        values: (rows,) by channel in SI units, with signs and offsets applied.
        clocks: (rows,) [s], times of the channels that have a clock of their own.
        labels: name in the file of every channel.
        names: all columns of the file.
    """

    name: str
    path: Path
    sha256: str
    values: dict[str, FloatArray]
    clocks: dict[str, FloatArray]
    labels: dict[str, str]
    names: list[str]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.values[channels.TIME])

    def column(self, channel: str) -> str:
        """File and column of a channel, for a sentence."""
        return f"{self.path}, column {self.labels.get(channel, channel)}"


def data_files(paths: Iterable[str | os.PathLike[str]]) -> list[Path]:
    """Data files in these files and folders, each once, folders sorted by name.

    Raises:
        CableError: a path does not exist or is no data file, or there is none in all.
    """
    found: dict[Path, Path] = {}
    given = [Path(path) for path in paths]
    for path in given:
        if path.is_dir():
            files = [file for file in sorted(path.rglob("*")) if _is_data(file, path)]
        elif not path.exists():
            raise CableError(f"{path} does not exist; give data files or folders.")
        elif path.suffix.lower() not in tables.ENDINGS:
            raise CableError(
                f"{path} is no data file; its name must end in "
                f"{' or '.join(tables.ENDINGS)}."
            )
        else:
            files = [path]
        for file in files:
            found.setdefault(file.resolve(), file)
    if not found:
        places = ", ".join(str(path) for path in given) or "nothing"
        raise CableError(
            f"there is no data file in {places}; trials are files whose names end in "
            f"{' or '.join(tables.ENDINGS)}."
        )
    return list(found.values())


def around(files: Iterable[Path], dataset_file: str) -> Iterator[Path]:
    """Data files in the folders of these files and of their `dataset.toml`."""
    folders = [path.parent for path in files]
    if dataset_file:
        folders.append(Path(dataset_file).parent)
    for folder in dict.fromkeys(folders):
        yield from (path for path in folder.rglob("*") if _is_data(path, folder))


def trial_names(files: Iterable[Path]) -> dict[Path, str]:
    """Names of the trials in these files: no longer than it takes to differ."""
    files = list(files)
    for depth in range(1, 1 + max((len(path.parts) for path in files), default=0)):
        ends = [Path(*path.parts[-depth:]) for path in files]
        for names in ([end.with_suffix("") for end in ends], ends):
            if len(set(names)) == len(files):
                return dict(zip(files, (n.as_posix() for n in names), strict=True))
    return {path: path.as_posix() for path in files}


def beside(files: Iterable[Path]) -> Path | None:
    """The `dataset.toml` in the folder of the data files, or None.

    Raises:
        CableError: there are several, so that one must be named.
    """
    folders = dict.fromkeys(path.parent for path in files)
    found = [folder / DATASET_FILE for folder in folders]
    found = [path for path in found if path.is_file()]
    if len(found) > 1:
        raise CableError(
            f"there are {' and '.join(map(str, found))}; give the one that counts."
        )
    return found[0] if found else None


def read(path: Path, file: DatasetFile, name: str | None = None) -> Recording:
    """Read the channels of one file.

    Args:
        path: the file.
        file: what its columns mean.
        name: of the trial; None is the file's name without ending.

    Raises:
        CableError: the file cannot be read, lacks a column or holds text.
    """
    names = tables.column_names(path)
    sources = _sources(path, names, file)
    clocks = {
        channel: clock
        for channel in sources
        if (clock := file.source(channel).clock) is not None
    }
    for channel, clock in clocks.items():
        if clock not in names:
            raise _missing(path, f"the clock of {channel}", clock, names)
    wanted = dict.fromkeys([name for name, _ in sources.values()] + [*clocks.values()])
    for column in wanted:
        if names.count(column) > 1:
            raise CableError(
                f"{path} has {names.count(column)} columns {column}; names must differ."
            )
    switches = [sources[channels.VALID][0]] if channels.VALID in sources else []
    columns = tables.read_columns(path, wanted, switches)
    # The clocks first: conversion may happen in place.
    second = channels.CLOCK.factors[sources[channels.TIME][1]]
    times = {channel: columns[clock] * second for channel, clock in clocks.items()}
    values = {
        channel: _converted(columns[column], channel, unit, file)
        for channel, (column, unit) in sources.items()
    }
    return Recording(
        name=path.stem if name is None else name,
        path=path,
        sha256=_sha256(path),
        values=values,
        clocks=times,
        labels={channel: column for channel, (column, _) in sources.items()},
        names=names,
    )


def _sources(
    path: Path, names: list[str], file: DatasetFile
) -> dict[str, tuple[str, str]]:
    """Column and unit of every channel that a file has."""
    optional = [channel for name in names if (channel := _tension(path, name))]
    optional += [channels.TEMPERATURE, channels.VALID]
    sources = {}
    for channel in dict.fromkeys([*channels.REQUIRED, *file.columns, *optional]):
        source = file.source(channel)
        own = channels.spellings(channel)
        if source.name is not None:
            places = [source.name] if source.name in names else []
            expected = source.name
        else:
            places = [name for name in own if name in names]
            expected = channel
        if len(places) > 1:
            raise CableError(
                f"{path} has {' and '.join(places)}; say in {DATASET_FILE} which of "
                f"them is {channel}: [columns.{channel}], name."
            )
        if places:
            name = places[0]
            sources[channel] = (name, file.unit(channel, name))
        elif channel in channels.REQUIRED or channel in file.columns:
            raise _missing(path, channel, expected, names)
    return sources


def _converted(
    reading: FloatArray, channel: str, unit: str, file: DatasetFile
) -> FloatArray:
    """Readings as values in the channel's own unit; what no rig has is missing."""
    source = file.source(channel)
    factor = source.sign * channels.kind(channel).factors[unit]
    value = reading if source.offset == 0.0 else reading - source.offset
    value = value if factor == 1.0 else value * factor
    limit = LATEST if channel == channels.TIME else LARGEST
    if not (len(value) and -limit < value.min() and value.max() < limit):
        value = np.where(np.abs(value) < limit, value, np.nan)
    return value


def _tension(path: Path, column: str) -> str:
    """Channel of a column that is a tension by its name, else empty."""
    try:
        return channels.tension(column)
    except CableError as error:
        raise CableError(f"{path}: {error}") from None


def _missing(path: Path, channel: str, name: str, names: list[str]) -> CableError:
    """The error for a column that is not there.

    Args:
        path: the file.
        channel: that it is for, or what else.
        name: of the column.
        names: of all columns.
    """
    told = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    if channel != name:
        near = _nearest(name, names)
        hint = f" (is it {near!r}?)" if near else ""
        return CableError(f"{path} has no column {name!r} for {channel}{hint}: {told}.")
    missing = f"{path} has no column {channel!r}, only {told}"
    measured = channels.kind(channel)
    taken = {own for other in channels.REQUIRED for own in channels.spellings(other)}
    free = [n for n in names if n not in taken and not channels.tension(n)]
    alike = [n for n in free if channels.unit_of(n, measured)]
    if column := _nearest(name, alike, 0.0):
        return CableError(
            f"{missing}; if it is {column!r}, say so in {DATASET_FILE}, which converts "
            f"it: [columns.{channel}] name = {column!r}, unit = "
            f"{channels.unit_of(column, measured)!r}."
        )
    others = [n for n in free if channels.no_channel(n)]
    plain = [n for n in free if n not in others]
    if near := _nearest(name, plain):
        missing += f" (is it {near!r}?)"
    elif other := _nearest(name, others, 0.4):
        return CableError(f"{missing}; {other!r} is {channels.no_channel(other)}.")
    return CableError(f"{missing}; rename one or map it in {DATASET_FILE}.")


def _nearest(name: str, names: list[str], cutoff: float = 0.6) -> str:
    """The name most like another, or empty."""
    return next(iter(difflib.get_close_matches(name, names, 1, cutoff)), "")


def _is_data(path: Path, folder: Path) -> bool:
    """Whether a path inside a folder is a data file that is not hidden."""
    hidden = any(part.startswith(".") for part in path.relative_to(folder).parts)
    return not hidden and path.is_file() and path.suffix.lower() in tables.ENDINGS


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
