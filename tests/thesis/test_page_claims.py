"""Claims of the page equal those of the current experiments."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from fill_readme import between, block, claim_rows

from study_marks import study_but
from thesis._outcome import Claim, claim_table, claims_of
from thesis.reproduce import EXPERIMENTS, run

FOLDER = Path(__file__).parents[2] / "scripts" / "thesis"
FAST = ("pretension", "follower", "loops", "kalman")
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e-?\d+)?")


def printed(name: str) -> list[list[str]]:
    """Return the rows of one experiment in the file of all claims."""
    rows = [list(row.values()) for row in claim_table()]
    return [row for row in rows if row[0] == name]


def stated(row: list[str]) -> Claim:
    """Return the claim that a row states."""
    _, where, text, ours, verdict, why = row
    return Claim(where, text, ours, cast("Any", verdict), why)


def same(row: list[str], name: str, claim: Claim) -> bool:
    """Return whether a row states a claim: equal words, numbers within 5 %."""
    written, now = " | ".join(row), " | ".join(claim_rows({name: [claim]})[1])
    if NUMBER.sub("#", written) != NUMBER.sub("#", now):
        return False
    old, new = (np.array(NUMBER.findall(text), dtype=float) for text in (written, now))
    return claim.timed or np.allclose(old, new, rtol=0.05, atol=0.02)


def test_every_claim_is_a_row_and_is_counted_under_its_experiment() -> None:
    claims = {
        name: [
            Claim(f"Fig. {k}", name, f"{k} N m", "agrees" if k else "misprint", "so")
            for k in range(place % 3 + 1)
        ]
        for place, name in enumerate(EXPERIMENTS)
    }
    rows = claim_rows(claims)[1:]
    assert [row[0] for row in rows] == [n for n, made in claims.items() for _ in made]
    whole = sum(map(len, claims.values()))
    agree = whole - len(EXPERIMENTS)
    counted = block(claims)
    assert counted.startswith(f"{whole} claims: {agree} agrees, 0 better, ")
    assert f"{len(EXPERIMENTS)} misprint" in counted


def test_the_page_counts_the_claims_of_the_file() -> None:
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    claims = {name: [stated(row) for row in printed(name)] for name in EXPERIMENTS}
    assert between(page, "claims") == block(claims)


@pytest.mark.parametrize("name", study_but(2, FAST))
def test_claims_are_those_of_a_run(name: str) -> None:
    claims = claims_of(name, run(name).findings)
    rows = printed(name)
    assert len(rows) == len(claims)
    for row, claim in zip(rows, claims, strict=True):
        told = f"run scripts/fill_readme.py claims: {row}\nnow {claim.ours}"
        assert same(row, name, claim), told


def test_a_changed_number_or_verdict_is_noticed() -> None:
    claim = Claim("Fig. 0", "two", "2.0 N m", "agrees", "so")
    row = claim_rows({"loops": [claim]})[1]
    assert same(row, "loops", claim)
    assert not same([cell.replace("2.0", "2.3") for cell in row], "loops", claim)
    changed = [cell.replace("agrees", "disagrees") for cell in row]
    assert not same(changed, "loops", claim)
