"""The study of the diagnosis: what it hides, and rates that are those of its cases."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import diagnose_benchmark
import pytest
from diagnose_benchmark import cases, is_alone, is_right, judged, run, summary
from diagnose_benchmark import word_of as went
from hypothesis import given
from hypothesis import strategies as st

from rig import dataset
from rig.makes import MAKES
from rig.trials import SETS, Trial

MAKE = MAKES["bristles"]
KINDS = {"named": MAKE.named, "unknown": MAKE.unknown, "none": ("none",)}
FEW = ("backlash", "presliding", "joint_gravity")
STRENGTHS = (2.0, 4.0)
LEARNED = {"before": 5.0, "after": 2.0, "closed": 0.7, "curves": "one", "formulas": ""}


@st.composite
def judged_cases(draw: st.DrawFn) -> dict[str, Any]:
    """Return a possible result of the diagnosis of a case, with its seed."""
    kind = draw(st.sampled_from([*KINDS, "pair", "event"]))
    event = {"found": draw(st.booleans()), "kinds": draw(st.sampled_from([[], ["x"]]))}
    if kind == "pair":
        hidden = FEW[:2]
    elif kind == "event":
        hidden = ("event:slip",)
    else:
        hidden = (draw(st.sampled_from(FEW if kind == "named" else list(KINDS[kind]))),)
    named = draw(st.lists(st.sampled_from(FEW), unique=True, max_size=2))
    verdict = draw(st.sampled_from(["named", "tie"] if named else ["none", "unknown"]))
    again = draw(st.sampled_from([[], ["backlash"], list(hidden)]))
    steps = [
        {
            "verdict": verdict,
            "named": named,
            "ties": [[named[0], "backlash"]] if verdict == "tie" else [],
        }
    ]
    if verdict == "tie" and again:
        steps.append({"verdict": "named", "named": again, "ties": []})
    return {
        "trials": draw(st.sampled_from(["rich", "restful"])),
        "protocol": "bare",
        "misfit": 1.2,
        "steps": steps,
        "proposed": ["", ""][: len(steps)],
        "odds": [0.9, None][: len(steps)],
        "kind": kind,
        "hidden": "none" if kind == "none" else "+".join(hidden),
        "effects": () if kind in ("none", "event") else hidden,
        "event": event | {"late": 0.01},
        "strength": 0.0 if kind == "none" else draw(st.sampled_from(STRENGTHS)),
        "closed": 0.5,
        "learned": LEARNED,
        "intervals": {"friction": [1.0, 0.9, 1.1, draw(st.floats(0.8, 1.2))]},
    }


def rows(text: str) -> list[list[str]]:
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in text.splitlines()
        if line.startswith("| ")
    ]


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
    found = {"verdict": verdict, "named": [*named], "ties": [[*t] for t in ties]}
    record = {"kind": kind, "effects": [*hidden], "steps": [found]}
    assert is_right(record, -1) == right


@pytest.mark.parametrize(
    ("right", "alone", "found", "kinds", "verdict", "named"),
    [
        ("right", True, True, ["slip"], "none", []),
        ("right", False, True, ["slip"], "named", ["backlash"]),
        ("right", False, True, ["slip"], "unknown", []),
        ("wrong", False, False, ["gain"], "none", []),
        ("missed", False, False, [], "unknown", []),
    ],
)
def test_an_event_is_right_if_found_and_alone_if_the_rest_is_right(
    right: str,
    alone: bool,
    found: bool,
    kinds: list[str],
    verdict: str,
    named: list[str],
) -> None:
    step = {"verdict": verdict, "named": named, "ties": []}
    event = {"found": found, "kinds": kinds, "late": 0.0}
    record = {"kind": "event", "effects": [], "steps": [step], "event": event}
    assert went(record, -1) == right
    assert is_alone(record) == alone


@given(st.lists(judged_cases(), min_size=1, max_size=30))
def test_rates_count_the_cases_below_them(judgements: list[dict[str, Any]]) -> None:
    records = [
        record | {"seed": seed, "make": f"make {seed % 2}"}
        for seed, record in enumerate(judgements)
    ]
    above, below = summary(records).split("<details>")
    rates = {tuple(row[:2]): row[2:] for row in rows(above) if len(row) == 9}
    rates.pop(("hidden", "R"))
    for (named, size), row in rates.items():
        kind, _, motions = named.partition(", ")
        assert motions == "motions alone"
        own = [
            r for r in records
            if r["kind"] == kind and size in ("-", f"{r['strength']:g}")
        ]  # fmt: skip
        count, once, alone, *others = row
        assert int(count) == len(own)
        assert int(once) == sum(went(r, 0) == "right" for r in own)
        many, low, _, high, _ = alone.replace("(", "").replace(")", "").split()
        assert int(many) == sum(map(is_alone, own))
        assert int(low) <= round(100 * int(many) / len(own)) <= int(high)
        last = [went(r, -1) for r in own]
        assert last.count("right") + sum(map(int, others)) == len(own)
    assert sum(int(row[0]) for row in rates.values()) == len(records)
    given_rows = [row for row in rows(below) if len(row) == 3 and row[1].isdigit()]
    first = [r["steps"][0]["verdict"] for r in records]
    assert {row[0]: int(row[1]) for row in given_rows} == {
        verdict: first.count(verdict) for verdict in set(first)
    }
    failed = [row for row in rows(below) if len(row) == 11 and row[0] != "make"]
    assert len(failed) == sum(not is_alone(r) for r in records)
    unknown = [r for r in records if r["kind"] == "unknown"]
    unexplained = [r for r in unknown if r["steps"][0]["verdict"] == "unknown"]
    curves = [row for row in rows(below) if len(row) == 7 and row[0] != "hidden"]
    assert len(curves) == (len(unknown) if unexplained else 0)
    sentence = f"Of {len(unexplained)} `unknown` rigs {len(unexplained)} have curves"
    assert not unexplained or f"{sentence}, which close 0.70" in below
    calm = [r for r in records if r["kind"] != "event"]
    alarms = sum(not r["event"]["found"] for r in calm)
    sentence = f"Events in rigs without one: {alarms} of {len(calm)} ("
    assert (sentence in above) == bool(calm)
    (odds,) = (row for row in rows(above) if row[0] == "0.85 to 0.92")
    assert int(odds[1]) == len(records)


def test_every_effect_is_hidden_in_rigs_of_its_own_at_every_strength() -> None:
    hidden, makes = [*MAKES["guides"].effects, "none", "none"], ("guides", "bristles")
    found = list(cases(hidden, makes, STRENGTHS, ("bare",), 7, rounds=2))
    rigs: dict[int, set[str]] = {}
    for case in found:
        rigs.setdefault(case.seed, set()).add(case.hidden)
    assert all(len(names) == 1 for names in rigs.values())
    each = [(c.make, c.hidden, c.strength) for c in found]
    for make in makes:
        assert each.count((make, "none", 0.0)) == 4
        for name in MAKES[make].effects:
            for size in STRENGTHS:
                known = name in MAKES["guides"].effects
                assert each.count((make, name, size)) == 2 * known


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

    monkeypatch.setattr(diagnose_benchmark, "make_dataset", in_other_units)
    record = run("bristles", "bare", "none", 0.0, 3031)
    (found,) = record["steps"]
    assert (found["verdict"], found["named"]) == ("fix-data", [])
    assert "perhaps it is in mNm" in found["said"]
    assert went(record, -1) == "wrong"
