"""The comparison as a table: `cc-mujoco diagnose` and the naive ways, case by case."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from cc_mujoco.report import table

Record = dict[str, Any]
Judge = Callable[[Record], str]

HEAD = (
    "method", "named: cases", "right", "in a tie of two", "missed", "wrong",
    "first in its ranking", "none: false alarms", "unknown: wrongly named",
)  # fmt: skip


def comparison(records: Sequence[Record], judge: Judge) -> str:
    """Return a table in Markdown; every method on the same cases.

    Args:
        records: of cases; those without naive answers do not count.
        judge: one word for how a case went, from a record of the diagnosis.
    """
    both = [record for record in records if "naive" in record]
    ranked = [(record, _ranking(record)) for record in both]
    rows = [_row("diagnose", ranked, judge)]
    for method in ("binned", "sparse", "bic"):
        told = [
            (_as_diagnosis(record, guess), list(guess["ranking"]))
            for record in both
            if (guess := record["naive"].get(method))
        ]
        if told:
            rows.append(_row(method, told, judge))
        else:
            rows.append([method, "not run", *[""] * (len(HEAD) - 2)])
    return table(HEAD, rows)


def _as_diagnosis(record: Record, guess: Record) -> Record:
    """Return the record as if the diagnosis had guessed so."""
    named = [guess["named"]] if guess["named"] else []
    verdict = "named" if named else "none"
    return {**record, "verdict": verdict, "named": named, "ties": []}


def _ranking(record: Record) -> list[str]:
    """Return the effects that the diagnosis refitted first, the best first."""
    rounds = record.get("candidates") or [[]]
    return [candidate[0] for candidate in rounds[0]]


def _row(
    method: str, told: Sequence[tuple[Record, list[str]]], judge: Judge
) -> list[str]:
    def share(kind: str, *words: str) -> str:
        of = [judge(record) for record, _ in told if record["kind"] == kind]
        return _percent(sum(word in words for word in of), len(of))

    named = [pair for pair in told if pair[0]["kind"] == "named"]
    first = sum(ranking[:1] == list(record["hidden"]) for record, ranking in named)
    return [
        method,
        str(len(named)),
        *(share("named", word) for word in ("right", "tie", "missed", "wrong")),
        _percent(first, len(named)),
        share("none", "wrong"),
        share("unknown", "wrong"),
    ]


def _percent(part: int, whole: int) -> str:
    return f"{part / whole:.0%} of {whole}" if whole else "-"
