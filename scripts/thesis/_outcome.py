"""Findings on the claims of the thesis, and the table of both."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

Verdict = Literal["agrees", "better", "in part", "disagrees", "cannot", "misprint"]

CLAIM_FILE = Path(__file__).with_name("claims.csv")
COLUMNS = ("experiment", "where", "printed", "ours", "verdict", "why")
"""Columns of `claims.csv`: `where` is a figure, table, equation or section."""


class Finding(NamedTuple):
    """Result of this package on a claim of the thesis."""

    ours: str  # with numbers and units
    # `agrees`; `better` where ours keeps the claim and goes beyond it; `in part`;
    # `disagrees`; `cannot` where the printed text does not give what a test needs;
    # `misprint` where a printed formula cannot be meant
    verdict: Verdict
    why: str = ""  # one sentence; that of `claims.csv` where it has no numbers of ours
    # whether `ours` holds times or speed ratios, which differ from run to run
    timed: bool = False


def claim_table() -> list[dict[str, str]]:
    with CLAIM_FILE.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def claims_of(experiment: str, findings: Iterable[Finding]) -> list[dict[str, str]]:
    """Return an experiment's rows of `claims.csv`, with new findings."""
    rows = [row for row in claim_table() if row["experiment"] == experiment]
    return [
        {**row, "ours": ours, "verdict": verdict, "why": why or row["why"]}
        for row, (ours, verdict, why, _) in zip(rows, findings, strict=True)
    ]


def rms(values: ArrayLike) -> float:
    return float(np.sqrt(np.mean(np.asarray(values) ** 2)))


def round_down_ratio(ratio: float) -> str:
    """Return a ratio of times rounded down to 1, 2 or 5 times a power of ten.

    Other machines reproduce it to this precision.
    """
    power = 10.0 ** math.floor(math.log10(ratio))
    step = max(step for step in (1.0, 2.0, 5.0) if step * power <= ratio * (1 + 1e-9))
    return f"{step * power:.12g}"
