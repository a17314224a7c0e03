"""Tables in CSV files, as spreadsheets, loggers and people write them.

    sheet = read_sheet("costs.csv")
    [(row.line, row.cells) for row in sheet.rows]

`tables` reads columns of numbers, also from files too large for memory.

Cells may be separated by commas, semicolons, tabs or bars; numbers may have decimal
commas unless commas separate the cells. Text is UTF-8, UTF-16 with a byte order mark,
or else Latin-1. Comment lines (`#`) and Excel's `sep=;` may stand above the names.
"""

import codecs
import csv
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from cc_mujoco._utils.parsing import unreadable
from cc_mujoco.errors import CableError

HEAD_BYTES = 1 << 16  # bytes of a file from which `layout` is found

_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+(?:[eE][-+]?\d+)?\s*|\s*[-+]?\d+,\s*")


class Layout(NamedTuple):
    encoding: str  # encoding of the text
    top: int  # lines before the first line of data
    separator: str  # separator of cells
    decimal: str  # point or comma
    names: list[str]  # names of the columns


class Row(NamedTuple):
    """A row of data: its line number in the file, and its cells."""

    line: int  # its number in the file, from 1
    cells: list[str]  # stripped, with decimal points


class Sheet(NamedTuple):
    path: Path  # path of the file
    top: int  # number of the line that names the columns, from 1
    names: list[str]  # names of the columns
    rows: list[Row]  # lines of data that are not blank


def read_sheet(
    path: str | Path,
    what: str = "",
    require: Callable[[int], None] = lambda lines: None,
) -> Sheet:
    """Read a whole CSV file as text; an error names its content `what`.

    `require` is called with the number of rows before they are parsed, and may raise.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
        form = layout(path, content[:HEAD_BYTES])
        text = content.decode(form.encoding).removeprefix("\ufeff")
        lines = text.splitlines(keepends=True)[form.top :]
        require(len(lines))
        reader = csv.reader(lines, delimiter=form.separator)
        found = [(form.top + reader.line_num, row) for row in reader]
    except OSError as error:
        raise unreadable(f"{what} {path}".lstrip(), error) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise CableError(f"{path} is not a CSV text file: {error}.") from None
    names = list(form.names)
    while names and not names[-1]:
        names.pop()
    rows = []
    for line, cells in found:
        cells = [cell.strip() for cell in cells]
        if form.separator != ",":
            point = _DECIMAL_COMMA.fullmatch
            cells = [c.replace(",", ".") if point(c) else c for c in cells]
        while len(cells) > len(names) and not cells[-1]:
            cells.pop()
        if any(cells):
            rows.append(Row(line, cells))
    return Sheet(path, form.top, names, rows)


def layout(path: Path, head: bytes) -> Layout:
    """Return the encoding, separator and head of a CSV file by its first bytes."""
    encoding = "utf-8"
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encoding = "utf-16"
    else:
        try:
            codecs.getincrementaldecoder("utf-8")().decode(head)
        except UnicodeDecodeError:
            encoding = "latin-1"
    lines = head.decode(encoding, errors="ignore").removeprefix("\ufeff").splitlines()
    top, separator = 0, ""
    while top < len(lines):
        line = lines[top]
        if (given := re.fullmatch(r"(?i)sep=(.)\s*", line)) is not None and top == 0:
            separator = given[1]
        elif line.strip() and not line.startswith("#"):
            break
        top += 1
    if top == len(lines):
        raise CableError(f"{path} is empty; its first line must name the columns.")
    header = lines[top]
    separator = separator or max(",;\t|", key=header.count)
    names = [cell.strip() for cell in next(csv.reader([header], delimiter=separator))]
    if not all(name.isprintable() for name in names):
        raise CableError(
            f"{path} is no text; give CSV, or Parquet with the ending .parquet."
        )
    if all(is_number(name) for name in names):
        raise CableError(
            f"{path}, line {top + 1} is numbers; the first line must name the columns."
        )
    decimal = "."
    if separator != ",":
        cells = (cell for line in lines[top + 1 :] for cell in line.split(separator))
        decimal = "," if any(map(_DECIMAL_COMMA.fullmatch, cells)) else "."
    return Layout(encoding, top + 1, separator, decimal, names)


def is_number(cell: str, decimal: str = ".") -> bool:
    try:
        float(cell.strip().replace(decimal, "."))
    except ValueError:
        return False
    return True
