"""Curves over time as a drawing inside a page: sharp, small, light and dark."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.report._figures import BLUE, GREY, ORANGE, SKY
from cc_mujoco.report._html import Html

Array = NDArray[np.float64]

WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 480, 185, 58, 28, 40
"""Size of a drawing and the margins of its axes; it has no right margin."""
INTERVALS = 400
"""Intervals of time of which a curve shows the least and the greatest value."""
PLOT_STYLE = f"""
svg {{ display: block; width: 100%; max-width: 40rem; margin: .8rem 0; }}
svg text {{ font: 15px system-ui, "DejaVu Sans", sans-serif; fill: currentColor; }}
svg .frame {{ stroke: {GREY}; fill: none; }}
svg .limit {{ stroke: {GREY}; stroke-dasharray: 2 4; }}
svg .curve {{ fill: none; stroke-width: 1.6; stroke-linejoin: round; }}
svg .curve0 {{ stroke: {BLUE}; }} svg .curve1 {{ stroke: {ORANGE}; }}
@media (prefers-color-scheme: dark) {{ svg .curve0 {{ stroke: {SKY}; }} }}
@media print {{ svg {{ break-inside: avoid; }} svg .curve0 {{ stroke: {BLUE}; }} }}
"""
"""Style sheet of a page with drawings."""


def time_plot(
    title: str,
    time: Array,
    curves: Mapping[str, Array],
    limits: Sequence[float] = (),
) -> Html:
    """Return at most two curves over time (T,) [s] as SVG; the first lies below.

    Values that are not finite are gaps. `limits` are marked by a dotted line, where
    they are in reach of the curves.
    """
    finite = [c[np.isfinite(c)] for c in curves.values() if np.isfinite(c).any()]
    values = np.concatenate(finite) if finite else np.zeros(1)
    low, high = float(values.min()), float(values.max())
    room = max(high - low, 1e-9)
    shown = [each for each in limits if low - room <= each <= high + room]
    low, high = min(low, *shown, high), max(high, *shown, low)
    margin = 0.06 * max(high - low, 1e-9)
    low, high = low - margin, high + margin
    start, end = float(time[0]), float(max(time[-1], time[0] + 1e-9))

    def x(value: float) -> float:
        return LEFT + (WIDTH - LEFT - 8) * (value - start) / (end - start)

    def y(value: float) -> float:
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (value - low) / (high - low)

    parts = [
        f'<rect class="frame" x="{LEFT}" y="{TOP}" width="{WIDTH - LEFT - 8}" '
        f'height="{HEIGHT - TOP - BOTTOM}"/>',
        f'<text x="{LEFT}" y="{TOP - 9}">{escape(title)}</text>',
    ]
    for each in _ticks(low, high, 5):
        place = f'x="{LEFT - 5}" y="{y(each) + 4:.1f}" text-anchor="end"'
        parts.append(f"<text {place}>{each:g}</text>")
    for each in _ticks(start, end, 6):
        place = f'x="{x(each):.1f}" y="{HEIGHT - BOTTOM + 18}" text-anchor="middle"'
        parts.append(f"<text {place}>{each:g}</text>")
    parts.append(
        f'<text x="{(LEFT + WIDTH - 8) / 2}" y="{HEIGHT - 5}" text-anchor="middle">'
        "time [s]</text>"
    )
    for each in shown:
        ends = f'x1="{LEFT}" x2="{WIDTH - 8}" y1="{y(each):.1f}" y2="{y(each):.1f}"'
        parts.append(f'<line class="limit" {ends}/>')
    for number, (name, curve) in enumerate(curves.items()):
        for piece in _pieces(time, curve):
            points = " ".join(f"{x(t):.1f},{y(v):.1f}" for t, v in piece)
            parts.append(f'<polyline class="curve curve{number}" points="{points}"/>')
        if len(curves) > 1:
            right = WIDTH - 8 - 110 * (len(curves) - 1 - number)
            key = (
                f'x1="{right - 100}" x2="{right - 82}" y1="{TOP - 14}" y2="{TOP - 14}"'
            )
            parts.append(f'<line class="curve curve{number}" {key}/>')
            parts.append(f'<text x="{right - 76}" y="{TOP - 9}">{escape(name)}</text>')
    return Html(
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title)}">'
        f"{''.join(parts)}</svg>"
    )


def _ticks(low: float, high: float, most: int) -> list[float]:
    """Return round numbers in a range, at most so many."""
    rough = (high - low) / most
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(power * each for each in (1.0, 2.0, 5.0, 10.0) if power * each >= rough)
    first, last = int(np.ceil(low / step)), int(np.floor(high / step))
    return [float(f"{step * number:.10g}") for number in range(first, last + 1)]


def _pieces(time: Array, curve: Array) -> list[list[tuple[float, float]]]:
    """Return the points of a curve without gaps, thinned to what can be seen."""
    places = np.flatnonzero(np.isfinite(curve))
    if not places.size:
        return []
    pieces = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1)
    every = max(1, time.size // INTERVALS)
    found = []
    for piece in pieces:
        kept = [
            part[index]
            for part in np.array_split(piece, max(1, piece.size // every))
            for index in sorted({int(curve[part].argmin()), int(curve[part].argmax())})
        ]
        found.append([(float(time[k]), float(curve[k])) for k in kept])
    return found
