"""Claims of the page equal those of the current experiments."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from fill_readme import between, block

from study_marks import study_unless
from thesis._outcome import Finding, claim_table, claims_of
from thesis.reproduce import EXPERIMENTS, run

FOLDER = Path(__file__).parents[2] / "scripts" / "thesis"
DAILY = ("pretension", "loops")
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e-?\d+)?")


def same(row: dict[str, str], now: dict[str, str], timed: bool = False) -> bool:
    """Return whether a row states a claim: equal words, numbers within 5 %."""
    texts = [" | ".join(each.values()) for each in (row, now)]
    written, found = (NUMBER.sub("#", text) for text in texts)
    if written != found:
        return False
    old, new = (np.array(NUMBER.findall(text), dtype=float) for text in texts)
    return timed or np.allclose(old, new, rtol=0.05, atol=0.02)


def test_the_page_counts_the_claims_of_the_file() -> None:
    rows = claim_table()
    assert list(dict.fromkeys(row["experiment"] for row in rows)) == list(EXPERIMENTS)
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert between(page, "claims") == block(rows)
    counts = Counter(row["verdict"] for row in rows)
    assert f"{len(rows)} claims: {counts['agrees']} agrees, " in block(rows)


@pytest.mark.parametrize("name", study_unless(lambda name: name in DAILY, EXPERIMENTS))
def test_claims_are_those_of_a_run(name: str) -> None:
    findings = run(name)
    rows = [row for row in claim_table() if row["experiment"] == name]
    claims = claims_of(name, findings)
    for row, claim, finding in zip(rows, claims, findings, strict=True):
        told = f"run scripts/fill_readme.py claims: {row}\nnow {claim['ours']}"
        assert same(row, claim, finding.timed), told


def test_a_changed_number_or_verdict_is_noticed() -> None:
    row = claims_of("magnitudes", [Finding("2.0 N m", "agrees", "so")] * 2)[0]
    assert same(row, row)
    assert not same(row, {**row, "ours": "2.3 N m"})
    assert same(row, {**row, "ours": "2.3 N m"}, timed=True)
    assert not same(row, {**row, "verdict": "disagrees"})
