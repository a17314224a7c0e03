"""The README's rates are those of the cases that stand below them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hidden_rig.effects import NAMED, UNKNOWN

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
BLOCK = README.partition("<!-- diagnosis: begin -->")[2].partition("<!-- diagnosis")[0]
STUDIES = dict(re.findall(r"\*\*(\w+)\*\*\n(.*?</details>)", BLOCK, re.S))


def rows(text: str) -> list[list[str]]:
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in text.splitlines()
        if line.startswith("| ")
    ]


@pytest.mark.parametrize("study", ["final", "second"])
def test_rates_are_those_of_the_cases(study: str) -> None:
    above, _, below = STUDIES[study].partition("<details>")
    rates = {row[0]: row for row in rows(above)}
    cases = rows(below)[1:]
    single = [case for case in cases if case[0] in NAMED]
    right = [
        case
        for case in single
        if case[2] in ("named", "tie") and case[3].split(", ")[0] == case[0]
    ]
    foreign = [case for case in cases if case[0] in UNKNOWN]
    empty = [case for case in cases if case[0] == "none"]
    for kind, of, good in (
        ("named", single, right),
        ("unknown", foreign, [case for case in foreign if case[2] == "unknown"]),
        ("none", empty, [case for case in empty if case[2] == "none"]),
    ):
        if of:
            assert rates[kind][1:3] == [str(len(of)), f"{len(good) / len(of):.0%}"]
    assert len(foreign) == len(UNKNOWN) and len(empty) == 10


def test_every_effect_of_the_library_was_hidden_once() -> None:
    hidden = [case[0] for case in rows(STUDIES["final"].partition("<details>")[2])]
    assert all(hidden.count(name) == 1 for name in NAMED)
