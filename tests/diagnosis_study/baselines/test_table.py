"""The table of the comparison counts what every method said."""

from __future__ import annotations

from typing import Any

from baselines.table import comparison


def judge(record: dict[str, Any]) -> str:
    """Right, wrong or missed, by the first name."""
    if not record["named"]:
        return "missed"
    return "right" if record["named"] == record["hidden"] else "wrong"


def case(kind: str, hidden: str, binned: str | None) -> dict[str, Any]:
    """Return a case whose effect the diagnosis does not name."""
    ranking = [binned or "backlash"]
    return {
        "kind": kind,
        "hidden": [hidden] if hidden else [],
        "named": [],
        "verdict": "none",
        "candidates": [[["backlash", 0.1, "too little"]]],
        "naive": {"binned": {"named": binned, "ranking": ranking, "share": 0.5}},
    }


RECORDS = [
    case("named", "backlash", "backlash"),
    case("named", "backlash", None),
    case("named", "presliding", "backlash"),
    case("none", "", "backlash"),
    case("none", "", None),
    case("unknown", "unknown_reflex", "viscous_friction"),
]


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_rows_count_cases_and_words() -> None:
    lines = comparison(RECORDS, judge).splitlines()
    _, rule, diagnosis, binned, sparse, _ = lines
    third = ["33% of 3"]
    assert cells(binned) == [
        "binned",
        "3",
        *third,
        "0% of 3",
        *third,
        *third,
        "67% of 3",
        "50% of 2",
        "100% of 1",
    ]
    assert cells(diagnosis)[2:6] == ["0% of 3", "0% of 3", "100% of 3", "0% of 3"]
    assert cells(sparse)[1] == "not run"
    assert {line.count("|") for line in (rule, diagnosis, binned, sparse)} == {10}


def test_cases_without_naive_names_do_not_count() -> None:
    plain = {key: value for key, value in RECORDS[0].items() if key != "naive"}
    assert comparison([*RECORDS, plain], judge) == comparison(RECORDS, judge)
