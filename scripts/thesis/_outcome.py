"""Result of reproducing a part of the thesis: claims and figures."""

from __future__ import annotations

import csv
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.report._figures import COLORS, figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Verdict = Literal["agrees", "better", "in part", "disagrees", "cannot", "misprint"]

Progress = Callable[[float], None]  # takes the share of the work that is done, 0 to 1

CLAIM_FILE = Path(__file__).with_name("claims.csv")


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


class Claim(NamedTuple):
    """One statement of the thesis and our finding, a row of `claims.csv`."""

    where: str  # figure, table, equation or section of the thesis
    printed: str  # the claim, in few words, with its numbers
    ours: str
    verdict: Verdict
    why: str
    timed: bool = False


def claim_table() -> list[dict[str, str]]:
    with CLAIM_FILE.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def claims_of(experiment: str, findings: Iterable[Finding]) -> tuple[Claim, ...]:
    """Return an experiment's claims in `claims.csv`, with new findings."""
    rows = [row for row in claim_table() if row["experiment"] == experiment]
    return tuple(
        Claim(row["where"], row["printed"], ours, verdict, why or row["why"], timed)
        for row, (ours, verdict, why, timed) in zip(rows, findings, strict=True)
    )


Curve = tuple[ArrayLike, ArrayLike] | tuple[ArrayLike, ArrayLike, str]
"""Abscissa and ordinate, and Matplotlib's format if it is not a line."""


@dataclass(frozen=True)
class Panel:
    """One diagram of a figure."""

    title: str
    x: str  # quantity of the abscissa, with its unit
    y: str  # quantity of the ordinate, with its unit
    curves: Mapping[str, Curve]  # by label
    # how `Axes` draws them; for bars, abscissas are names
    kind: Literal["plot", "semilogx", "semilogy", "loglog", "bar"] = "plot"
    limits: tuple[float | None, float | None] = (None, None)  # of the ordinate


@dataclass(frozen=True)
class Outcome:
    # of the claims that `claims.csv` has of it, in their order
    findings: tuple[Finding, ...]
    figures: Mapping[str, Sequence[Panel]]  # file stem to diagrams


def passing(items: Sequence[Any], progress: Progress) -> Iterator[Any]:
    """Yield items, and report the fraction done to `progress`."""
    for count, item in enumerate(items, start=1):
        yield item
        progress(count / len(items))


def rms(values: ArrayLike) -> float:
    return float(np.sqrt(np.mean(np.asarray(values) ** 2)))


def round_down_ratio(ratio: float) -> str:
    """Return a ratio of times rounded down to 1, 2 or 5 times a power of ten.

    Other machines reproduce it to this precision.
    """
    power = 10.0 ** math.floor(math.log10(ratio))
    step = max(step for step in (1.0, 2.0, 5.0) if step * power <= ratio * (1 + 1e-9))
    return f"{step * power:.12g}"


def drawn(panels: Sequence[Panel]) -> Figure:
    columns = min(len(panels), 2)
    rows = math.ceil(len(panels) / columns)
    drawing = figure(5.5 * columns, 3.9 * rows)
    for place, panel in enumerate(panels):
        axes = drawing.add_subplot(rows, columns, place + 1)
        curves = zip(panel.curves.items(), itertools.cycle(COLORS), strict=False)
        for number, ((label, (x, y, *form)), color) in enumerate(curves):
            looks = {"color": color, "label": label}
            if panel.kind == "bar":
                width = 0.8 / len(panel.curves)
                at = np.arange(np.size(x)) + width * number
                axes.bar(at, y, width, **looks)
                axes.set_xticks(at - 0.5 * width * number, x)
            else:
                getattr(axes, panel.kind)(_thinned(x), _thinned(y), *form, **looks)
        axes.set(title=panel.title, xlabel=panel.x, ylabel=panel.y, ylim=panel.limits)
        axes.legend()
    return drawing


def write_data(path: Path, panels: Sequence[Panel]) -> None:
    """Write the points of all curves as CSV, one in a row."""
    with path.open("w", newline="", encoding="utf-8") as file:
        to = csv.writer(file, lineterminator="\n")
        to.writerow(("panel", "curve", "abscissa", "ordinate", "x", "y"))
        for panel in panels:
            for label, (x, y, *_) in panel.curves.items():
                head = panel.title, label, panel.x, panel.y
                points = zip(_thinned(x).tolist(), _thinned(y).tolist(), strict=True)
                to.writerows((*head, *point) for point in points)


def _thinned(values: ArrayLike) -> np.ndarray:
    every = np.asarray(values)
    return every[:: max(1, every.size // 1000)]  # to about 1000 points
