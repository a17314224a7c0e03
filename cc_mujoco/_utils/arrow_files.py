"""Columns of numbers from CSV and Parquet files, streamed by pyarrow.

Only the wanted columns of a large file are held in memory. For the forms of CSV see
`csv_files`.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from cc_mujoco._utils.array_files import FloatArray
from cc_mujoco._utils.csv_files import HEAD_BYTES, Layout, is_number, layout
from cc_mujoco._utils.parsing import one_sentence
from cc_mujoco.errors import CableError

_BOOLEAN_VALUES = {"true": "1", "false": "0"}


def column_names(path: Path) -> list[str]:
    with one_sentence(path, kind=pa.ArrowException):
        if path.suffix.lower() == ".parquet":
            return [str(name) for name in pq.ParquetFile(path).schema_arrow.names]
        return _layout(path).names


def read_columns(
    path: Path, names: list[str], switches: Iterable[str] = ()
) -> dict[str, FloatArray]:
    """Return columns of a file as numbers (rows,), NaN where missing; see `tables`."""
    with one_sentence(path, kind=pa.ArrowException):
        if path.suffix.lower() == ".parquet":
            return _join_batches(names, _parquet_batches(path, names))
        form = _layout(path)
        try:
            return _join_batches(names, _csv_batches(path, form, names, switches))
        except pa.ArrowInvalid as error:
            raise _csv_error(path, form, names, switches, error) from None


def _join_batches(
    names: list[str], batches: Iterable[pa.RecordBatch]
) -> dict[str, FloatArray]:
    pieces: dict[str, list[FloatArray]] = defaultdict(list)
    for batch in batches:
        for name in names:
            column = batch.column(name)
            if pa.types.is_string(column.type):
                import pyarrow.compute as pc  # takes long, and few files need it

                words = pc.utf8_lower(pc.utf8_trim_whitespace(column))
                for word, number in _BOOLEAN_VALUES.items():
                    words = pc.if_else(pc.equal(words, word), number, words)
                column = words.cast(pa.float64())
            numbers = column.to_numpy(zero_copy_only=False)
            pieces[name].append(np.array(numbers, dtype=float))
    empty = [np.empty(0)]
    # One column after the other, so that pieces are freed before the next is joined.
    return {name: np.concatenate(pieces.pop(name, empty)) for name in names}


def _parquet_batches(path: Path, names: list[str]) -> Iterator[pa.RecordBatch]:
    for batch in pq.ParquetFile(path).iter_batches(columns=names):
        columns = []
        for name in names:
            column = batch.column(name)
            try:
                columns.append(column.cast(pa.float64()))
            except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
                raise CableError(
                    f"{path}, column {name} holds {column.type}; it must hold numbers."
                ) from None
        yield pa.RecordBatch.from_arrays(columns, names)


def _layout(path: Path) -> Layout:
    with path.open("rb") as file:
        return layout(path, file.read(HEAD_BYTES))


def _csv_batches(
    path: Path, form: Layout, names: list[str], texts: Iterable[str] = ()
) -> Iterator[pa.RecordBatch]:
    # Names of their own, for the file's may be there twice.
    own = [name if name in names else f"#{k}" for k, name in enumerate(form.names)]
    blank = ["", "nan", "NaN", "NAN", "-nan", "-NaN", "NA", "<NA>", "N/A", "n/a"]
    kinds = dict.fromkeys(names, pa.float64()) | dict.fromkeys(texts, pa.string())
    try:
        reader = pa_csv.open_csv(
            path,
            pa_csv.ReadOptions(
                use_threads=False,
                block_size=1 << 23,
                column_names=own,
                skip_rows=form.top,
                encoding=form.encoding,
            ),
            pa_csv.ParseOptions(delimiter=form.separator),
            pa_csv.ConvertOptions(
                include_columns=names,
                column_types=kinds,
                null_values=[*blank, "#N/A", "null", "NULL", "None"],
                strings_can_be_null=True,
                decimal_point=form.decimal,
            ),
        )
    except pa.ArrowInvalid as error:
        if "Empty CSV" in str(error):
            return
        raise
    yield from reader


def _csv_error(
    path: Path,
    form: Layout,
    names: list[str],
    switches: Iterable[str],
    error: Exception,
) -> CableError:
    """Return the error for a CSV file with text among numbers, with its place."""
    rows = 0
    try:
        for batch in _csv_batches(path, form, names, names):
            for name in names:
                words = _BOOLEAN_VALUES if name in switches else {}
                for k, cell in enumerate(batch.column(name).to_pylist()):
                    if cell is None or cell.strip().lower() in words:
                        continue
                    if not is_number(cell, form.decimal):
                        where = f"{path}, column {name}, row {rows + k + 1} of the data"
                        if cell.strip() == name:
                            return CableError(
                                f"{where} is a second line of names; split recordings "
                                "that were joined."
                            )
                        hint = ""
                        if rows + k == 0 and not any(map(str.isdigit, cell)):
                            hint = "; delete a row of units, a column's name may end in"
                            hint += " its unit"
                        return CableError(
                            f"{where}: {cell.strip()[:40]!r} must be a number{hint}."
                        )
            rows += batch.num_rows
    except pa.ArrowInvalid as other:
        error = other
    message = " ".join(str(error).split())
    return CableError(
        f"{path} is not a table: {message[:160]}; every line must have the "
        f"{len(form.names)} cells that the first line names."
    )
