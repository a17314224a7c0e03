"""Page on a run of a rig: one sentence, one picture, the next command."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco.datasets._run_log import beside
from cc_mujoco.hardware._limits import Limits
from cc_mujoco.hardware._loop import RunOutcome
from cc_mujoco.hardware._replay import read_rows
from cc_mujoco.report._figures import BLUE, GREY, ORANGE, SKY
from cc_mujoco.report._html import (
    Html,
    element,
    folded,
    join_pieces,
    list_words,
    page,
    paragraph,
    table,
)

Array = NDArray[np.float64]

WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 480, 185, 58, 28, 40
"""Size of a drawing and the margins of its axes; it has no right margin."""
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
    every = max(1, time.size // 400)
    found = []
    for piece in pieces:
        kept = [
            part[index]
            for part in np.array_split(piece, max(1, piece.size // every))
            for index in sorted({int(curve[part].argmin()), int(curve[part].argmax())})
        ]
        found.append([(float(time[k]), float(curve[k])) for k in kept])
    return found


AT_LIMIT_SHARE = 0.02
"""Share of the cycles at a limit of the torque from which on that is reported."""


@dataclass(frozen=True)
class ReportedRun:
    """A run whose log is complete."""

    log: Path
    outcome: RunOutcome
    what: str
    """Name of its controller, or of its trial."""
    scene: str
    """Name of a device, or the file of one."""
    period: float
    """Period of the loop [s]."""
    limits: Mapping[str, Limits]
    """Limits by the name of the axis in the log, empty of a device with one."""
    is_trial: bool = False
    """True if it played a trial of a plan, whose torque is that of a servo."""

    @property
    def page(self) -> Path:
        """Path of the page, beside the log."""
        return beside(self.log, "report.html")


def write_run_report(run: ReportedRun) -> Path:
    """Write the page of a run beside its log, and return its path."""
    rows = read_rows(run.log)
    time = rows["time_s"]
    axes = {
        name: {
            key.removeprefix(f"{name}.") if name else key: column
            for key, column in rows.items()
            if key.startswith(f"{name}." if name else "")
        }
        for name in run.limits
    }
    errors = {name: _errors(time, axes[name], run.limits[name]) for name in axes}
    order = sorted(axes, key=lambda name: -errors[name][0])
    pictures = {n: _picture(n, time, axes[n], run.limits[n]) for n in order}
    title = _sentence(run, float(time[-1]), errors[order[0]], order[0])
    kind = "fix-data" if run.outcome.code else "named" if _touched(run) else "none"
    text = page(
        title,
        kind,
        element(
            "header",
            paragraph("Run of a rig", kind="small"),
            element("h1", title),
            pictures[order[0]],
            _next(run, order[0]),
        ),
        *(folded(f"Axis {name}", pictures[name]) for name in order[1:]),
        *(_used(name, axes[name], run.limits[name]) for name in order),
        _timing(run),
        style=PLOT_STYLE,
    )
    with replacing(run.page) as place:
        place.write_text(text, encoding="utf-8")
    return run.page


def _errors(
    time: Array, rows: Mapping[str, Array], limits: Limits
) -> tuple[float, float]:
    """Return the RMS error after the soft start, and the RMS of the desired torque."""
    desired = rows["desired_torque_nm"]
    counted = np.isfinite(desired) & (time >= limits.soft_start)
    if not counted.any():
        counted = np.isfinite(desired)
    if not counted.any():
        return math.nan, math.nan
    off = rows["joint_torque_nm"][counted] - desired[counted]
    return float(np.sqrt(np.mean(off**2))), float(
        np.sqrt(np.mean(desired[counted] ** 2))
    )


def _touched(run: ReportedRun) -> list[str]:
    """Return the limits of the torque that a motor often reached."""
    cycles = max(1, run.outcome.cycles)
    counts = {"torque": run.outcome.limited, "rate": run.outcome.rate_limited}
    return [
        f"its {name} limit in {count / cycles:.0%} of the cycles"
        for name, count in counts.items()
        if count > AT_LIMIT_SHARE * cycles
    ]


def _sentence(
    run: ReportedRun, duration: float, errors: tuple[float, float], axis: str
) -> str:
    """Return what ran, how well the torque was followed and which limits it reached."""
    reason = run.outcome.sentence.rstrip(".")
    if run.outcome.code:
        return f"{run.what} ended after {duration:.3g} s: {reason}."
    error, size = errors
    parts = [f"{run.what} ran for {duration:.3g} s"]
    if not run.is_trial and math.isfinite(error):
        share = f", {error / size:.0%} of its RMS" if size > 1e-9 else ""
        where = f"the torque at {axis}" if axis else "the joint's torque"
        parts.append(f"{where} missed the desired one by {error:.3g} N m RMS{share}")
    touched = _touched(run)
    limit = f"it reached {list_words(touched)}" if touched else "no limit was reached"
    return "; ".join([*parts, limit]) + "."


def _picture(name: str, time: Array, rows: Mapping[str, Array], limits: Limits) -> Html:
    start = f"{name}: " if name else ""
    torque = {"measured": rows["joint_torque_nm"], "desired": rows["desired_torque_nm"]}
    commanded = {"commanded": rows["motor_torque_nm"]}
    angle = {"measured": rows["joint_angle_rad"]}
    bounds = (-limits.torque, limits.torque)
    return join_pieces(
        [
            time_plot(f"{start}joint torque [N m]", time, torque),
            time_plot(
                f"{start}motor torque [N m], limit dotted", time, commanded, bounds
            ),
            time_plot(
                f"{start}joint [rad], range dotted", time, angle, limits.joint_range
            ),
        ]
    )


def _next(run: ReportedRun, axis: str) -> Html:
    folder = run.log.parent
    if run.outcome.code:
        words = ["cc-mujoco", "play", run.scene, "--replay", str(run.log)]
        return paragraph(
            "To see what led to it: ", element("code", shlex.join(words)), kind="lead"
        )
    source = folder if run.is_trial else run.log
    words = ["cc-mujoco", "diagnose", run.scene, str(source)]
    words += ["--axis", axis] if axis else []
    words += ["--out", str(folder.with_name(f"{folder.name}_diagnosis"))]
    why = (
        "Next, with all trials: "
        if run.is_trial
        else "Next, ask what the scene lacks: "
    )
    return paragraph(why, element("code", shlex.join(words)), kind="lead")


def _used(name: str, rows: Mapping[str, Array], limits: Limits) -> Html:
    low, high = limits.joint_range
    angle = rows["joint_angle_rad"]

    def largest(key: str) -> float:
        return float(np.abs(rows[key]).max())

    def row(title: str, value: float, limit: float, unit: str) -> list[str]:
        if not math.isfinite(limit):
            return [title, f"{value:.3g} {unit}", "none", "-"]
        shown = [title, f"{value:.3g} {unit}", f"{limit:.3g} {unit}"]
        return [*shown, f"{value / limit:.0%}"]

    lines = [
        row("motor torque", largest("motor_torque_nm"), limits.torque, "N m"),
        row(
            "motor speed", largest("motor_velocity_rad_s"), limits.motor_speed, "rad/s"
        ),
        row("joint torque", largest("joint_torque_nm"), limits.joint_torque, "N m"),
        [
            "joint angle",
            f"{angle.min():.3g} to {angle.max():.3g} rad",
            f"{low:.3g} to {high:.3g} rad",
            f"{(angle.max() - angle.min()) / (high - low):.0%}",
        ],
    ]
    title = f"Limits of {name}" if name else "Limits"
    head = ("", "largest", "limit", "used")
    return join_pieces([element("h2", title), table(head, lines)])


def _timing(run: ReportedRun) -> Html:
    found = run.outcome
    sentences = [
        f"{found.cycles} cycles of {run.period * 1e3:g} ms, {found.missed} missed, "
        f"{found.without_reading} without a new reading."
    ]
    if late := found.late.quantiles():
        sentences.append(
            f"Late by {late['p50_us']:g} us (median), {late['p99_us']:g} us (99 %), "
            f"{late['longest_us']:g} us (longest)."
        )
    sentences += [
        f"{n} packets ignored: {why}." for why, n in sorted(found.ignored.items())
    ]
    return join_pieces([element("h2", "Timing"), *map(paragraph, sentences)])
