"""Episode log: the true course of an episode as columns of samples with units.

The Parquet file, metrics, figure and Rerun recording all come from one log.

    recorder = Recorder(("flexor", "extensor"), {"scene": "wrist", "seed": 0})
    recorder.record(info)              # once per step; `info` as environments give it
    log = recorder.log()
    log["joint_torque_nm"]             # (T,) array; node columns are (T, nodes)
    log.write("log.parquet")
    EpisodeLog.read("log.parquet")     # equal to `log`, bit for bit
    EpisodeLog.open("log.parquet")     # likewise, with every column read on demand

A long episode is written by `log_file` while it runs, and opened: neither needs memory
that grows with its length. `pieces`, `rows` and `thinned` read such a log in parts.
"""

from __future__ import annotations

import difflib
import json
import os
from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.atomic_io import METADATA_KEY, replacing
from cc_mujoco._utils.parsing import parse_json
from cc_mujoco._validation import require_dictionary
from cc_mujoco.errors import CableError
from cc_mujoco.simulation import _log_columns as log_columns
from cc_mujoco.simulation._log_columns import AXES, columns_for

PIECE_ROWS = 16_384
"""Samples in a row group of a log's file, and so in a piece of a column."""


class EpisodeLog:
    """An immutable table of samples with metadata.

    Every column of `columns_for(cables)` is present. Scalar columns are `(T,)`, list
    columns `(T, n)`; all arrays are read-only.
    """

    def __init__(
        self, columns: Mapping[str, NDArray[Any]], metadata: Mapping[str, Any]
    ) -> None:
        """Check and freeze the columns.

        Args:
            columns: One array per column name, first axis time.
            metadata: JSON-serializable description of the episode.

        Raises:
            CableError: If a column is missing, unknown, or has a wrong shape, or the
                metadata cannot be written as JSON.
        """
        columns = require_dictionary("columns", columns)
        self._take_names(columns)
        names = [column.name for column in self.schema]
        for name in columns:
            if name not in names:
                raise CableError.unknown("log column", name, names)
        arrays = {}
        for column in self.schema:
            given = _require_column(columns, column.name, "log")
            array = np.array(given, dtype=column.dtype)
            if array.ndim != 1 + column.listed:
                raise CableError(
                    f"log column {column.name!r} has shape {array.shape}, not "
                    f"{'(T, n)' if column.listed else '(T,)'}."
                )
            array.setflags(write=False)
            arrays[column.name] = array
        rows = {name: len(array) for name, array in arrays.items()}
        if len(set(rows.values())) > 1:
            raise CableError(f"log columns must have equal lengths, not {rows}.")
        self._columns: _Columns = _Arrays(arrays, rows["time_s"])
        self.metadata: dict[str, Any] = json.loads(_to_json(metadata))

    def _take_names(self, names: Iterable[str]) -> None:
        self.cables = log_columns.cables_in(names)
        self.prefixes = log_columns.prefixes_in(names) or ("",)
        """Beginnings of the columns of each axis; empty where there is only one."""
        self.schema = columns_for(self.cables, self.prefixes)

    @classmethod
    def _over(cls, columns: _Columns, metadata: Mapping[str, Any]) -> EpisodeLog:
        log = cls.__new__(cls)
        log._take_names(columns)
        log._columns, log.metadata = columns, dict(metadata)
        return log

    def __len__(self) -> int:
        return self._columns.count

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return one column; raise `CableError` with the nearest name if unknown."""
        return self._columns.known(name)[name]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, EpisodeLog):
            return NotImplemented
        names = self._columns.keys()
        if self.metadata != other.metadata or names != other._columns.keys():
            return False
        pairs = ((self[name], other[name]) for name in names)
        return all(
            one.shape == its.shape and one.tobytes() == its.tobytes()
            for one, its in pairs
        )

    __hash__ = None  # type: ignore[assignment]

    @property
    def columns(self) -> Mapping[str, NDArray[Any]]:
        """All columns by name, in file order."""
        return dict(self._columns)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes; () if there is only one."""
        return tuple(prefix.rstrip(".") for prefix in self.prefixes if prefix)

    def each_axis(self) -> list[tuple[str, EpisodeLog | AxisLog]]:
        """Return (name, log) of every axis; the name of a single axis is ""."""
        if not self.axes:
            return [("", self)]
        return [(name, AxisLog(self, name)) for name in self.axes]

    def axis(self, name: str | None = None) -> EpisodeLog | AxisLog:
        """Return the log of one axis, whose columns have no prefix.

        The default is the only axis. Raises `CableError` for an unknown name, or for
        None if there are several axes.
        """
        if name is None and not self.axes:
            return self
        if name is None:
            raise CableError(
                f"the log has the axes {', '.join(self.axes)}; name one of them."
            )
        if name not in self.axes:
            raise CableError.unknown("axis of the log", name, self.axes)
        return AxisLog(self, name)

    def pieces(self, name: str) -> Iterator[NDArray[Any]]:
        """Yield the rows of a column in order, at most `PIECE_ROWS` at a time."""
        yield from self._columns.known(name).pieces(name)

    def rows(self, name: str, samples: NDArray[np.integer]) -> NDArray[Any]:
        """Return the rows of a column at increasing indices (n,), without loading all.

        They are (n,) of a scalar column, (n, width) of a list column.
        """
        return self._columns.known(name).rows(name, samples)

    def thinned(self, most: int) -> EpisodeLog:
        """Return every k-th sample, with the least k that leaves at most `most`.

        Its columns are read on demand. A log of at most `most` samples returns itself.
        """
        every = -(-len(self) // most)
        if every <= 1:
            return self
        kept = _KeptRows(self._columns, np.arange(0, len(self), every))
        return EpisodeLog._over(kept, self.metadata)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write a Parquet file; a file at `path` is replaced when this one is complete.

        Units and meanings are in the field metadata, the log's metadata is JSON under
        the schema metadata key `cc_mujoco`.
        """
        with log_file(path, self.cables, self.metadata, self.prefixes) as file:
            names = [column.name for column in self.schema]
            for arrays in zip(*map(self.pieces, names), strict=True):
                file.append(dict(zip(names, arrays, strict=True)))

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> EpisodeLog:
        """Read a file that `write` made; see `open` for the errors."""
        log = cls.open(path)
        return cls(log.columns, log.metadata)

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> EpisodeLog:
        """Open a file that `write` or `log_file` made, and read columns on demand.

        Every access to a column reads it again. The file must stay where it is.

        Raises:
            CableError: If the file is not Parquet or not an episode log.
            FileNotFoundError: If there is no such file.
        """
        columns = _FileColumns(path)
        return cls._over(columns, columns.metadata)


class _Columns(Mapping[str, NDArray[Any]]):
    """Columns by name; single rows of a column can be read without the others."""

    def __init__(self, names: Iterable[str], count: int) -> None:
        self.names, self.count = tuple(names), count

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def known(self, name: str) -> _Columns:
        """Return these columns; raise `CableError` if none has that name."""
        if name not in self.names:
            raise CableError.unknown("log column", name, self.names)
        return self

    def __getitem__(self, name: str) -> NDArray[Any]:
        whole = self.rows(name, np.arange(self.count))
        whole.setflags(write=False)
        return whole

    @abstractmethod
    def rows(self, name: str, samples: NDArray[np.integer]) -> NDArray[Any]: ...

    def pieces(self, name: str) -> Iterator[NDArray[Any]]:
        for start in range(0, max(self.count, 1), PIECE_ROWS):
            end = min(start + PIECE_ROWS, self.count)
            yield self.rows(name, np.arange(start, end))


class _Arrays(_Columns):
    def __init__(self, arrays: Mapping[str, NDArray[Any]], count: int) -> None:
        super().__init__(arrays, count)
        self._arrays = arrays

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self._arrays[name]

    def rows(self, name: str, samples: NDArray[np.integer]) -> NDArray[Any]:
        return np.asarray(self._arrays[name][samples])


class _FileColumns(_Columns):
    def __init__(self, path: str | os.PathLike[str]) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        self._path = Path(path).absolute()
        try:
            with pq.ParquetFile(self._path) as file:
                self._footer, self._schema = file.metadata, file.schema_arrow
        except pa.ArrowInvalid as error:
            raise CableError(f"{path} is not a Parquet file: {error}.") from error
        super().__init__(self._schema.names, self._footer.num_rows)
        metadata = (self._schema.metadata or {}).get(METADATA_KEY)
        if metadata is None:
            raise CableError(f"{path} is a Parquet file, but not an episode log.")
        try:
            self.metadata: dict[str, Any] = parse_json(metadata)
        except ValueError as error:
            raise CableError(f"{path}: its metadata cannot be read: {error}.") from None
        groups = range(self._footer.num_row_groups)
        sizes = [self._footer.row_group(group).num_rows for group in groups]
        self._starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.intp)

    def rows(self, name: str, samples: NDArray[np.integer]) -> NDArray[Any]:
        import pyarrow as pa
        import pyarrow.parquet as pq

        field = self._schema.field(name)
        listed = pa.types.is_fixed_size_list(field.type)
        shape = (field.type.list_size,) if listed else ()
        kind = field.type.value_type if listed else field.type
        # `to_pandas_dtype` needs pandas in pyarrow 18.
        dtype = pa.nulls(0, kind).to_numpy(zero_copy_only=False).dtype
        found = np.empty((len(samples), *shape), dtype=dtype)
        groups = np.searchsorted(self._starts, samples, side="right") - 1
        with pq.ParquetFile(self._path, metadata=self._footer) as file:
            for group in np.unique(groups).tolist():
                chunk = file.read_row_group(group, columns=[name]).column(0)
                chunk = chunk.combine_chunks()
                values = (chunk.flatten() if listed else chunk).to_numpy()
                own = groups == group
                row = samples[own] - self._starts[group]
                found[own] = values.reshape(-1, *shape)[row]
        return found


class _KeptRows(_Columns):
    """A selection of rows of other columns; scalar columns are cached."""

    def __init__(self, whole: _Columns, kept: NDArray[np.integer]) -> None:
        super().__init__(whole.names, len(kept))
        self._whole, self._kept = whole, kept
        self._remembered: dict[str, NDArray[Any]] = {}

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name in self._remembered:
            return self._remembered[name]
        found = super().__getitem__(name)
        if found.ndim == 1:
            self._remembered[name] = found
        return found

    def rows(self, name: str, samples: NDArray[np.integer]) -> NDArray[Any]:
        return self._whole.rows(name, self._kept[samples])


class LogFile:
    """Episode log that is written to a file during the episode; see `log_file`."""

    def __init__(
        self,
        path: Path,
        cables: Iterable[str],
        metadata: Mapping[str, Any],
        prefixes: Iterable[str] = ("",),
    ) -> None:
        """Prepare; the file is created with the first samples."""
        self._path, self._schema = path, columns_for(cables, prefixes)
        self._metadata = _to_json(metadata).encode()
        self._writer: Any = None
        self._pending: dict[str, NDArray[Any]] = {}
        self._count = 0

    def keep(self, step: int, columns: Mapping[str, Any], _: Any) -> None:
        """Append the columns of a control step; an `Observer` for `run`."""
        if not self._pending:
            for column in self._schema:
                shape = PIECE_ROWS, *np.shape(columns[column.name])
                self._pending[column.name] = np.empty(shape, column.dtype)
        for name, kept in self._pending.items():
            kept[self._count] = columns[name]
        self._count += 1
        if self._count == PIECE_ROWS:
            self._flush()

    def append(self, columns: Mapping[str, NDArray[Any]]) -> None:
        """Write columns by name, (rows,) or (rows, width), as one Parquet row group."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        fields, arrays = [], []
        for column in self._schema:
            array = pa.array(columns[column.name].reshape(-1))
            if column.listed:
                width = columns[column.name].shape[1]
                array = pa.FixedSizeListArray.from_arrays(array, width)
            about = {"unit": column.unit, "meaning": column.meaning}
            fields.append(pa.field(column.name, array.type, False, about))
            arrays.append(array)
        schema = pa.schema(fields, {METADATA_KEY: self._metadata})
        if self._writer is None:
            self._writer = pq.ParquetWriter(self._path, schema, compression="zstd")
        table = pa.Table.from_arrays(arrays, schema=schema)
        self._writer.write_table(table)

    def close(self) -> None:
        if self._count:
            self._flush()
        if self._writer is None:
            raise CableError("nothing was recorded: keep at least one sample.")
        self._writer.close()

    def discard(self) -> None:
        if self._writer is not None:
            with suppress(OSError):  # a full disk was reported already
                self._writer.close()

    def _flush(self) -> None:
        self.append({name: kept[: self._count] for name, kept in self._pending.items()})
        self._count = 0


@contextmanager
def log_file(
    path: str | os.PathLike[str],
    cables: Iterable[str],
    metadata: Mapping[str, Any],
    prefixes: Iterable[str] = ("",),
) -> Iterator[LogFile]:
    """Yield a log to fill during an episode; `path` appears if the block succeeds.

        with log_file("log.parquet", batch.cables, about) as file:
            run(plant, controller, file.keep)
        log = EpisodeLog.open("log.parquet")

    Memory holds `PIECE_ROWS` samples, however long the episode is.

    Args:
        path: File to write, with the ending `.parquet`; an existing file is replaced
            when this one is complete.
        cables: Names of the cables whose columns every sample contains.
        metadata: JSON-serializable description of the episode.
        prefixes: Prefix of the columns of each axis.

    Raises:
        CableError: If nothing was recorded or the file cannot be written.
    """
    if Path(path).suffix.lower() != ".parquet":
        raise CableError(f"a log is a Parquet file; {path} must end in .parquet.")
    with replacing(path) as partial:
        file = LogFile(partial, cables, metadata, prefixes)
        try:
            yield file
            file.close()
        except BaseException:
            file.discard()
            raise


class AxisLog:
    """Log of one of several axes; its columns have no prefix."""

    def __init__(self, whole: EpisodeLog, name: str) -> None:
        self._whole, self._prefix, self.name = whole, f"{name}.", name
        facts = whole.metadata.get(AXES, {}).get(name, {})
        self.metadata: dict[str, Any] = {**whole.metadata, **facts}
        self.cables = whole.cables

    def __len__(self) -> int:
        return len(self._whole)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self._whole[self._own_name(name)]

    def pieces(self, name: str) -> Iterator[NDArray[Any]]:
        return self._whole.pieces(self._own_name(name))

    def _own_name(self, name: str) -> str:
        own = self._prefix + name
        names = (column.name for column in self._whole.schema)
        return own if own in names else name


class Recorder:
    """Collects samples into an `EpisodeLog`."""

    def __init__(
        self,
        cables: Iterable[str],
        metadata: Mapping[str, Any],
        prefixes: Iterable[str] = ("",),
    ) -> None:
        """Prepare an empty log with the columns of these cables and axis prefixes.

        `metadata` describes the episode and must be JSON-serializable.
        """
        self.metadata = dict(metadata)
        self._schema = columns_for(cables, prefixes)
        self._rows: dict[str, list[Any]] = {c.name: [] for c in self._schema}

    def record(self, info: Mapping[str, Any]) -> None:
        """Append one sample from `info`; keys that are not columns are ignored.

        Raises `CableError` if a column is missing or its length has changed.
        """
        row = []
        for column in self._schema:
            given = _require_column(info, column.name, "sample")
            value = np.array(given, dtype=column.dtype)
            earlier = self._rows[column.name]
            shape = earlier[0].shape if earlier else value.shape
            if value.ndim != column.listed or value.shape != shape:
                expected = "a list" if column.listed else "a number"
                raise CableError(
                    f"column {column.name!r} of sample {len(earlier)} has shape "
                    f"{value.shape}; expected {expected} of shape "
                    f"{shape if earlier else '(n,)' if column.listed else '()'}."
                )
            row.append(value)
        for column, value in zip(self._schema, row, strict=True):
            self._rows[column.name].append(value)

    def log(self) -> EpisodeLog:
        """Return the samples recorded so far; at least one is needed."""
        if not self._rows["time_s"]:
            raise CableError("nothing was recorded: call record(info) at least once.")
        columns = {name: np.stack(rows) for name, rows in self._rows.items()}
        return EpisodeLog(columns, self.metadata)


def _require_column(values: Mapping[str, Any], name: str, where: str) -> Any:
    if name not in values:
        near = difflib.get_close_matches(name, values, n=1)
        hint = f"; its nearest name is {near[0]!r}" if near else ""
        raise CableError(f"the {where} has no column {name!r}{hint}.")
    return values[name]


def _to_json(metadata: Mapping[str, Any]) -> str:
    try:
        return json.dumps(metadata, allow_nan=False, sort_keys=True)
    except (TypeError, ValueError) as error:
        raise CableError(f"log metadata must be plain JSON: {error}.") from error
