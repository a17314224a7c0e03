"""The study of the diagnosis: what it hides, and rates that are those of its cases."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import proposal_loop
import pytest
from diagnose_benchmark import cases, is_right, judged, run, summary, went
from hypothesis import given
from hypothesis import strategies as st

from rig import dataset
from rig.makes import MAKES
from rig.trials import SETS, Trial

MAKE = MAKES["bristles"]
KINDS = {"named": MAKE.named, "unknown": MAKE.unknown, "none": ("none",)}
FEW = ("backlash", "presliding", "joint_gravity")
STRENGTHS = (2.0, 4.0)


@st.composite
def judged_cases(draw: st.DrawFn) -> dict[str, Any]:
    """Return a possible result of the diagnosis of a case, with its seed."""
    kind = draw(st.sampled_from([*KINDS, "pair"]))
    if kind == "pair":
        hidden = FEW[:2]
    else:
        hidden = (draw(st.sampled_from(FEW if kind == "named" else list(KINDS[kind]))),)
    named = draw(st.lists(st.sampled_from(FEW), unique=True, max_size=2))
    verdict = draw(st.sampled_from(["named", "tie"] if named else ["none", "unknown"]))
    again = draw(st.sampled_from([None, ["backlash"], list(hidden)]))
    settled = again and {"verdict": "named", "named": again}
    return {
        "trials": draw(st.sampled_from(["rich", "restful"])),
        "seconds": draw(st.floats(1.0, 500.0)),
        "misfit": 1.2,
        "settled": settled if verdict == "tie" else None,
        "kind": kind,
        "hidden": () if kind == "none" else hidden,
        "strength": draw(st.sampled_from(STRENGTHS)),
        "reached": 2.0,
        "verdict": verdict,
        "named": named,
        "ties": [[named[0], "backlash"]] if verdict == "tie" else [],
        "closed": 0.5,
    }


def rows(text: str) -> list[list[str]]:
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in text.splitlines()
        if line.startswith("| ")
    ]


def right(kind: str, case: list[str]) -> bool:
    hidden, _, _, _, _, verdict, named, ties = case[:8]
    if kind != "named":
        return verdict == kind
    first = named.split(", ")[0] == hidden and hidden not in ties
    return first and verdict in ("named", "tie")


@pytest.mark.parametrize(
    ("word", "kind", "hidden", "verdict", "named", "ties"),
    [
        ("right", "none", "", "none", "", []),
        ("wrong", "none", "", "named", "a", []),
        ("wrong", "none", "", "unknown", "", []),
        ("wrong", "none", "", "fix-data", "", []),
        ("right", "unknown", "x", "unknown", "a", []),
        ("missed", "unknown", "x", "none", "", []),
        ("wrong", "unknown", "x", "tie", "a", ["ab"]),
        ("right", "named", "a", "named", "ab", []),
        ("wrong", "named", "a", "named", "ba", []),
        ("right", "named", "a", "tie", "ab", ["bc"]),
        ("tie", "named", "a", "tie", "b", ["ab"]),
        ("missed", "named", "a", "tie", "b", ["abc"]),
        ("missed", "named", "a", "unknown", "b", ["ab"]),
        ("missed", "named", "a", "none", "", []),
        ("missed", "named", "a", "fix-numerics", "", []),
        ("right", "pair", "ab", "named", "bca", []),
        ("tie", "pair", "ab", "tie", "ac", ["bc"]),
        ("half", "pair", "ab", "tie", "ac", ["bcd"]),
        ("half", "pair", "ab", "named", "cb", []),
        ("wrong", "pair", "ab", "named", "c", []),
    ],
)
def test_a_case_is_judged_by_what_was_hidden_and_what_was_said(
    word: str, kind: str, hidden: str, verdict: str, named: str, ties: list[str]
) -> None:
    assert judged(kind, [*hidden], verdict, [*named], [[*tie] for tie in ties]) == word


@pytest.mark.parametrize(
    ("right", "kind", "hidden", "verdict", "named", "ties"),
    [
        (True, "none", "", "none", "", []),
        (False, "none", "", "unknown", "", []),
        (True, "unknown", "x", "unknown", "a", []),
        (False, "unknown", "x", "named", "a", []),
        (True, "named", "a", "named", "a", []),
        (False, "named", "a", "named", "ab", []),
        (False, "named", "a", "unknown", "a", []),
        (True, "named", "a", "tie", "b", ["bca"]),
        (False, "named", "a", "tie", "b", ["bc"]),
        (True, "pair", "ab", "named", "ba", []),
        (False, "pair", "ab", "named", "b", []),
    ],
)
def test_a_verdict_is_right_if_it_names_all_that_is_hidden_and_no_more(
    right: bool, kind: str, hidden: str, verdict: str, named: str, ties: list[str]
) -> None:
    record = {
        "kind": kind,
        "hidden": [*hidden],
        "verdict": verdict,
        "named": [*named],
        "ties": [[*tie] for tie in ties],
    }
    assert is_right(record) == right


@given(st.lists(judged_cases(), min_size=1, max_size=30))
def test_rates_count_the_cases_below_them(
    told: list[dict[str, Any]],
) -> None:
    records = [
        record | {"seed": seed, "make": f"make {seed % 2}"}
        for seed, record in enumerate(told)
    ]
    above, between, below = summary(records).split("<details>")
    listed = [row for row in rows(below) if row[0] != "hidden"]
    assert len(listed) == len(records)
    given_rows = [row for row in rows(between) if len(row) == 3 and row[1].isdigit()]
    assert sum(int(row[1]) for row in given_rows) == len(records)
    rates = {tuple(row[:3]): row[3:5] for row in rows(between) if len(row) == 9}
    for kind, names in KINDS.items():
        of_kind = [case for case in listed if case[0] in names]
        for make, size in {
            (case[1], "-" if kind == "none" else case[2]) for case in of_kind
        }:
            mine = [
                case for case in of_kind if case[1] == make and size in ("-", case[2])
            ]
            good = sum(right(kind, case) for case in mine) / len(mine)
            count, told_rate = rates[kind, make, size]
            rate, low, _, high = told_rate.replace("(", "").replace(")", "").split()
            assert (count, rate) == (str(len(mine)), f"{good:.0%}")
            assert int(low) <= round(100 * good) <= int(high)
    single = [r for r in records if r["kind"] == "named" and r["settled"]]
    well = [r for r in single if set(r["hidden"]) <= set(r["settled"]["named"])]
    ties = re.findall(r"of the\s(\d+)\sof single effects in (\d+)", above)
    assert [tuple(map(int, each)) for each in ties] in ([], [(len(single), len(well))])
    assert bool(ties) == any(r["settled"] for r in records)


@pytest.mark.parametrize("seeds", [1, 2])
def test_every_effect_is_hidden_at_every_strength(seeds: int) -> None:
    found = list(cases("final", seeds, STRENGTHS, [*KINDS]))
    assert len({case["seed"] for case in found}) == len(found)
    hidden = [(case["hidden"], case["strength"]) for case in found]
    for size in STRENGTHS:
        for name in MAKE.effects:
            assert hidden.count(((name,), size)) == seeds
        assert hidden.count(((), size)) >= 10 * seeds


@pytest.mark.study
def test_a_case_meets_the_checks_that_the_command_makes(
    monkeypatch: pytest.MonkeyPatch, shortened: Callable[[Trial, float], Trial]
) -> None:
    whole, rich = dataset.make_dataset, SETS["rich"]
    monkeypatch.setitem(
        SETS, "rich", lambda rng: [shortened(trial, 5.0) for trial in rich(rng)]
    )

    def in_other_units(*args: Any) -> list[dict[str, Any]]:
        return [
            {
                name: values[:5000] * (1e3 if name.endswith("torque_nm") else 1.0)
                for name, values in columns.items()
            }
            for columns in whole(*args)
        ]

    monkeypatch.setattr(proposal_loop, "make_dataset", in_other_units)
    case = next(cases("final", 1, [2.0], ["none"]))
    found = run(case)
    assert (found["verdict"], found["named"]) == ("fix-data", [])
    assert "perhaps it is in mNm" in found["said"]
    assert went(found) == "wrong"
