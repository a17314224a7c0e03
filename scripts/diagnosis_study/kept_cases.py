"""Cases of a study kept in files, so that finished ones are not repeated."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco._utils.command_options import progress_options

if TYPE_CHECKING:
    from cc_mujoco.diagnosis import Diagnosis

Record = dict[str, Any]


def kept(path: Path, make: Callable[[], Record]) -> Record:
    """Return the record in the file `path`; if it is missing, make and write it."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(make(), indent=1), encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))


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


def complete(
    out: Path,
    keys: tuple[str, ...],
    cases: Iterable[tuple[Any, ...]],
    make: Callable[..., Record],
    table: Callable[[list[Record]], str],
) -> list[Record]:
    """Make the cases that a folder lacks; print and keep the table; return records.

    `keys` are the fields of a record that identify its case, in the order of `cases`.
    """
    out.mkdir(parents=True, exist_ok=True)
    lines = Lines(out / "cases.jsonl")
    done = lines.done(*keys)
    missing = [case for case in cases if case not in done]
    for case in tqdm(missing, unit="case", **progress_options()):
        lines.add(make(*case))
        with replacing(out / "table.md") as partial:
            partial.write_text(table(lines.records), encoding="utf-8")
    print(table(lines.records))
    return lines.records


def findings(found: Diagnosis) -> Record:
    """Return a diagnosis as a record: verdict, effects, ties and their numbers."""
    return {
        "verdict": found.verdict,
        "named": [each.id for each in found.missing],
        "ties": [list(group) for group in found.ties],
        "values": {
            key: value.value
            for each in found.effects
            for key, value in each.parameters.items()
        },
        "baseline": {k: v.value for k, v in found.baseline.parameters.items()},
        "gap": {
            c: (g.noise_floor, g.rmse_before, g.rmse_after)
            for c, g in found.gap.items()
        },
        "statement": found.statement,
    }


def words(case: Record) -> tuple[str, str, str]:
    """Return verdict, named effects and ties of `findings` as cells of a table."""
    ties = "; ".join(" or ".join(group) for group in case["ties"])
    return case["verdict"], ", ".join(case["named"]) or "-", ties or "-"
