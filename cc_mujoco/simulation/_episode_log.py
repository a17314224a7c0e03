"""The episode log: what happened, sample by sample, with units.

One log feeds everything that is made of an episode: the Parquet file, the metrics,
the figure and the Rerun recording.

    recorder = Recorder(("flexor", "extensor"), {"scene": "wrist", "seed": 0})
    recorder.record(info)              # once per step; `info` as environments give it
    log = recorder.log()
    log["joint_torque_nm"]             # (T,) array; node columns are (T, nodes)
    log.write("log.parquet")
    EpisodeLog.read("log.parquet")     # equal to `log`, bit for bit
"""

from __future__ import annotations

import difflib
import json
import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.atomic_io import METADATA_KEY, replacing
from cc_mujoco.errors import CableError
from cc_mujoco.simulation._log_columns import (
    AXES,
    LogColumn,
    cables_in,
    columns_for,
    prefixes_in,
)

"""Key of the Parquet schema metadata that holds the log's metadata as JSON."""


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
        self.cables = cables_in(columns)
        self.prefixes = prefixes_in(columns) or ("",)
        """Beginnings of the columns of each axis; empty where there is only one."""
        self.schema = columns_for(self.cables, self.prefixes)
        names = [column.name for column in self.schema]
        for name in columns:
            if name not in names:
                raise CableError.unknown("log column", name, names)
        self._columns = {
            column.name: _frozen_array(
                column, _require_column(columns, column.name, "log")
            )
            for column in self.schema
        }
        rows = {name: len(array) for name, array in self._columns.items()}
        if len(set(rows.values())) > 1:
            raise CableError(f"log columns must have equal lengths, not {rows}.")
        self.metadata: dict[str, Any] = json.loads(_to_json(metadata))

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self._columns["time_s"])

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return one column.

        Raises:
            CableError: If there is no such column; names the nearest match.
        """
        if name not in self._columns:
            raise CableError.unknown("log column", name, self._columns)
        return self._columns[name]

    def __eq__(self, other: object) -> bool:
        """Compare samples bit for bit, and metadata."""
        if not isinstance(other, EpisodeLog):
            return NotImplemented
        return (
            self.metadata == other.metadata
            and self._columns.keys() == other._columns.keys()
            and all(
                array.shape == other[name].shape
                and array.tobytes() == other[name].tobytes()
                for name, array in self._columns.items()
            )
        )

    __hash__ = None  # type: ignore[assignment]

    @property
    def columns(self) -> Mapping[str, NDArray[Any]]:
        """All columns by name, in file order."""
        return dict(self._columns)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes; none where there is only one."""
        return tuple(prefix.rstrip(".") for prefix in self.prefixes if prefix)

    def axis(self, name: str | None = None) -> EpisodeLog | AxisLog:
        """Return the log of one axis, with plain names; by default of the only one.

        Raises:
            CableError: There is no such axis, or none is named and there are several.
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

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write a Parquet file; an older file at `path` stays until this is whole.

        Units and meanings are in the field metadata, the log's metadata is JSON under
        the schema metadata key `cc_mujoco`.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        fields, arrays = [], []
        for column in self.schema:
            array = pa.array(self[column.name].reshape(-1))
            if column.listed:
                width = self[column.name].shape[1]
                array = pa.FixedSizeListArray.from_arrays(array, width)
            about = {"unit": column.unit, "meaning": column.meaning}
            fields.append(pa.field(column.name, array.type, False, about))
            arrays.append(array)
        schema = pa.schema(fields, {METADATA_KEY: _to_json(self.metadata).encode()})
        table = pa.Table.from_arrays(arrays, schema=schema)
        with replacing(path) as partial:
            pq.write_table(table, partial, compression="zstd")

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> EpisodeLog:
        """Read a file that `write` made.

        Raises:
            CableError: If the file is not Parquet or not an episode log.
            FileNotFoundError: If there is no such file.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            table = pq.read_table(path)
        except pa.ArrowInvalid as error:
            raise CableError(f"{path} is not a Parquet file: {error}.") from error
        metadata = (table.schema.metadata or {}).get(METADATA_KEY)
        if metadata is None:
            raise CableError(f"{path} is a Parquet file, but not an episode log.")
        columns = {}
        for field in table.schema:
            array = table.column(field.name).combine_chunks()
            if pa.types.is_fixed_size_list(field.type):
                values = array.flatten().to_numpy()
                columns[field.name] = values.reshape(len(table), field.type.list_size)
            else:
                columns[field.name] = array.to_numpy()
        return cls(columns, json.loads(metadata))


class AxisLog:
    """Log of one axis of several: its columns under plain names."""

    def __init__(self, whole: EpisodeLog, name: str) -> None:
        """Take the log of the device and the name of the axis."""
        self._whole, self._prefix, self.name = whole, f"{name}.", name
        facts = whole.metadata.get(AXES, {}).get(name, {})
        self.metadata: dict[str, Any] = {**whole.metadata, **facts}
        self.cables = whole.cables

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self._whole)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return one column of the axis, or of the device; see `EpisodeLog`."""
        own = self._prefix + name
        return self._whole[own if own in self._whole.columns else name]


class Recorder:
    """Collector of samples for an `EpisodeLog`."""

    def __init__(
        self,
        cables: Iterable[str],
        metadata: Mapping[str, Any],
        prefixes: Iterable[str] = ("",),
    ) -> None:
        """Prepare an empty log.

        Args:
            cables: Names of the cables whose columns every sample brings.
            metadata: JSON-serializable description of the episode.
            prefixes: Beginnings of the columns of each axis.
        """
        self.metadata = dict(metadata)
        self._schema = columns_for(cables, prefixes)
        self._rows: dict[str, list[Any]] = {c.name: [] for c in self._schema}

    def record(self, info: Mapping[str, Any]) -> None:
        """Append one sample; keys that are not columns are ignored.

        Raises:
            CableError: If a column is missing or its list has another length than in
                the sample before.
        """
        row = []
        for column in self._schema:
            value = np.array(
                _require_column(info, column.name, "sample"), dtype=column.dtype
            )
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
        """Return the samples so far.

        Raises:
            CableError: If nothing was recorded.
        """
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


def _frozen_array(column: LogColumn, values: NDArray[Any]) -> NDArray[Any]:
    array = np.array(values, dtype=column.dtype)
    if array.ndim != 1 + column.listed:
        expected = "(T, n)" if column.listed else "(T,)"
        raise CableError(
            f"log column {column.name!r} has shape {array.shape}, not {expected}."
        )
    array.setflags(write=False)
    return array


def _to_json(metadata: Mapping[str, Any]) -> str:
    try:
        return json.dumps(metadata, allow_nan=False, sort_keys=True)
    except (TypeError, ValueError) as error:
        raise CableError(f"log metadata must be plain JSON: {error}.") from error
