"""Cases of a study kept in files, so that finished ones are not repeated."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from tqdm import tqdm

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco._utils.command_options import progress_options

Record = dict[str, Any]


class Lines:
    """Records of cases in a file of JSON lines."""

    def __init__(self, path: Path) -> None:
        """Read those that are there."""
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        self._path = path
        self.records: list[Record] = [json.loads(line) for line in text.splitlines()]

    def done(self, *keys: str) -> set[tuple[Any, ...]]:
        """Return the values of `keys` in each record, which identify finished cases."""
        return {tuple(record[key] for key in keys) for record in self.records}

    def add(self, record: Record) -> None:
        self.records.append(record)
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(record) + "\n")


def keep(
    lines: Lines,
    page: Path,
    made: Iterable[Record],
    count: int,
    table: Callable[[list[Record]], str],
) -> None:
    """Keep `count` records as they are made; print and keep the table of all."""
    for record in tqdm(made, total=count, unit="case", **progress_options()):
        lines.add(record)
        with replacing(page) as partial:
            partial.write_text(table(lines.records), encoding="utf-8")
    print(table(lines.records))


def complete(
    out: Path,
    keys: tuple[str, ...],
    cases: Iterable[tuple[Any, ...]],
    make: Callable[..., Record],
    table: Callable[[list[Record]], str],
) -> None:
    """Make the cases that a folder lacks; print and keep the table.

    `keys` are the fields of a record that identify its case, in the order of `cases`.
    """
    out.mkdir(parents=True, exist_ok=True)
    lines = Lines(out / "cases.jsonl")
    done = lines.done(*keys)
    missing = [case for case in cases if case not in done]
    made = (make(*case) for case in missing)
    keep(lines, out / "table.md", made, len(missing), table)
