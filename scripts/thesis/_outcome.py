"""Outcome of reproducing one thing of the thesis: claims, figures, data."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
else:  # imported where one is drawn
    Axes = Figure = object

Verdict = Literal["agrees", "better", "in part", "disagrees", "cannot", "misprint"]

Progress = Callable[[float], None]  # takes the share of the work that is done, 0 to 1


@dataclass(frozen=True)
class Claim:
    """One statement of the thesis and the finding of this package."""

    where: str  # figure, table, equation or section of the thesis
    printed: str  # the claim, in few words, with its numbers
    ours: str  # what we find, with numbers and units
    # `agrees`; `better` where ours keeps the claim and goes beyond it; `in part`;
    # `disagrees`; `cannot` where the printed text does not give what a test needs;
    # `misprint` where a printed formula cannot be meant
    verdict: Verdict
    why: str  # one sentence
    # whether `ours` holds times or speed ratios, which differ from run to run
    timed: bool = False


def rms(values: ArrayLike) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.asarray(values) ** 2)))


def round_down_ratio(ratio: float) -> str:
    """Return a ratio of times rounded down to 1, 2 or 5 times a power of ten.

    So much of it other machines find, too.
    """
    power = 10.0 ** math.floor(math.log10(ratio))
    step = max(step for step in (1.0, 2.0, 5.0) if step * power <= ratio * (1 + 1e-9))
    return f"{step * power:.12g}"


@dataclass(frozen=True)
class ExperimentOutcome:
    """Outcome of one experiment."""

    claims: tuple[Claim, ...]  # lines of the summary table
    figures: Mapping[str, Figure]  # file stem to figure
    # file stem to columns, each column (rows,); a column's name ends with its unit
    # where it has one (`torque_nm`)
    tables: Mapping[str, Mapping[str, ArrayLike]]
