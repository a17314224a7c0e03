"""Claims of the page equal those of the current experiments."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from fill_readme import block

from cc_mujoco.thesis import EXPERIMENTS, Claim, run, table

PAGE = (Path(__file__).parents[2] / "cc_mujoco" / "thesis" / "README.md").read_text(
    encoding="utf-8"
)
FAST = ("pretension", "loops", "follower", "kalman")
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e-?\d+)?")


def printed(name: str, page: str = PAGE) -> list[str]:
    """Return the rows of one experiment's table on a page."""
    start = page.index(f"**{name}**: {EXPERIMENTS[name]}")
    rows = page[start:].partition("|---|---|---|---|---|\n")[2]
    return rows.partition("\n\n")[0].splitlines()


def same(row: str, claim: Claim) -> bool:
    """Return whether a row states a claim: equal words, numbers within 5 %."""
    now = table([claim]).splitlines()[-1]
    if NUMBER.sub("#", row) != NUMBER.sub("#", now):
        return False
    old, new = (np.array(NUMBER.findall(text), dtype=float) for text in (row, now))
    return claim.timed or np.allclose(old, new, rtol=0.05, atol=0.02)


def test_every_claim_gets_its_row_under_its_experiment_and_is_counted() -> None:
    claims = {
        name: [
            Claim(f"Fig. {k}", name, f"{k} N m", "agrees" if k else "misprint", "so")
            for k in range(place % 3 + 1)
        ]
        for place, name in enumerate(EXPERIMENTS)
    }
    text = block(claims)
    for name, made in claims.items():
        assert printed(name, text) == table(made).splitlines()[-len(made) :]
    whole = sum(map(len, claims.values()))
    agree = whole - len(EXPERIMENTS)
    first = text.splitlines()[0]
    assert first.startswith(f"{whole} claims: {agree} agrees, 0 better, ")
    assert f"{len(EXPERIMENTS)} misprint" in first


@pytest.mark.parametrize("name", FAST)
def test_claims_are_those_of_a_run(name: str) -> None:
    claims = run(name).claims
    rows = printed(name)
    assert len(rows) == len(claims)
    for row, claim in zip(rows, claims, strict=True):
        assert same(row, claim), f"run scripts/fill_readme.py: {row}\nnow {claim.ours}"


def test_a_changed_number_or_verdict_is_noticed() -> None:
    claim = Claim("Fig. 0", "two", "2.0 N m", "agrees", "so")
    row = table([claim]).splitlines()[-1]
    assert same(row, claim)
    assert not same(row.replace("2.0", "2.3"), claim)
    assert not same(row.replace("agrees", "disagrees"), claim)
