"""The README's rates are those of the cases that stand below them."""

from __future__ import annotations

from pathlib import Path

import pytest

from hidden_rig.effects import NAMED, UNKNOWN

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
BLOCK = README.partition("<!-- diagnosis: begin -->")[2].partition("<!-- diagnosis")[0]
ABOVE, _, BELOW = BLOCK.partition("<details>")


def rows(text: str) -> list[list[str]]:
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in text.splitlines()
        if line.startswith("| ")
    ]


CASES = [row for row in rows(BELOW) if row[0] != "hidden"]
RATES = {
    (row[0], row[1]): row
    for row in rows(ABOVE)
    if row[0] in ("named", "unknown", "none") and len(row) == 8
}


def right(kind: str, case: list[str]) -> bool:
    hidden, _, _, _, verdict, named, ties = case[:7]
    if kind != "named":
        return verdict == kind
    first = named.split(", ")[0] == hidden and hidden not in ties
    return first and verdict in ("named", "tie")


@pytest.mark.parametrize("kind", ["named", "unknown", "none"])
def test_rates_are_those_of_the_cases(kind: str) -> None:
    hidden = {"named": NAMED, "unknown": UNKNOWN, "none": ("none",)}[kind]
    of_kind = [case for case in CASES if case[0] in hidden]
    for size in {case[1] for case in of_kind} if kind != "none" else {"-"}:
        cases = [case for case in of_kind if size in ("-", case[1])]
        good = [case for case in cases if right(kind, case)]
        rate = RATES[kind, size]
        assert rate[2:4] == [str(len(cases)), f"{len(good) / len(cases):.0%}"]


def test_every_effect_was_hidden_at_every_strength() -> None:
    hidden = [(case[0], case[1]) for case in CASES]
    for size in {case[1] for case in CASES if case[0] in NAMED}:
        assert all(hidden.count((name, size)) == 1 for name in NAMED)
    assert all((name, "2") in hidden for name in UNKNOWN)
    assert sum(case[0] == "none" for case in CASES) >= 10


def test_the_confusion_table_counts_every_single_case() -> None:
    single = [case for case in CASES if "," not in case[0]]
    told = [row for row in rows(ABOVE) if len(row) == 2 and row[0] != "hidden"]
    counts = [
        int(part.rsplit(" ", 1)[1]) for row in told for part in row[1].split(", ")
    ]
    assert sum(counts) == len(single)
