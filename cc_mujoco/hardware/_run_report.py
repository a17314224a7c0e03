"""Report page of a run: one sentence, a figure, the next command."""

import math
import shlex
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco.datasets._run_log import beside
from cc_mujoco.hardware._limits import Limits
from cc_mujoco.hardware._loop import RunOutcome
from cc_mujoco.hardware._replay import read_rows
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.report import _html as html
from cc_mujoco.report._figures import BLUE, GREY, ORANGE, figure, save, style

AT_LIMIT_SHARE = 0.02
"""Share of cycles at a torque limit above which the report mentions it."""


@dataclass(frozen=True)
class ReportedRun:
    """Run with a complete log."""

    log: Path
    outcome: RunOutcome
    what: str  # name of its controller, or of its trial
    scene: str  # name of a device, or the file of one
    period: float  # period of the loop [s]
    limits: Mapping[str, Limits]  # by the name of the axis in the log, see `RunLog`
    is_trial: bool = False
    """True if it played a trial of a plan, whose torque is that of a servo."""

    @property
    def page(self) -> Path:
        return beside(self.log, "report.html")


def write_run_report(run: ReportedRun) -> Path:
    """Write the page of a run beside its log; return its path."""
    rows = read_rows(run.log)
    time = rows["time_s"]
    axes = {}
    for name in run.limits:
        start = f"{name}." if name else ""
        own = {key: rows[key] for key in rows if key.startswith(start)}
        axes[name] = {key.removeprefix(start): own[key] for key in own}
    errors = {name: _errors(time, axes[name], run.limits[name]) for name in axes}
    first, *others = order = sorted(axes, key=lambda name: -errors[name][0])
    pictures = {n: _picture(n, time, axes[n], run.limits[n]) for n in order}
    title = _sentence(run, float(time[-1]), errors[first], first)
    kind = "fix-data" if run.outcome.code else "named" if _touched(run) else "none"
    head = html.paragraph("Run of a rig", kind="small"), html.element("h1", title)
    header = html.element("header", *head, pictures[first], _next(run, first))
    folds = [html.folded(f"Axis {name}", pictures[name]) for name in others]
    used = [_used(name, axes[name], run.limits[name]) for name in order]
    text = html.page(title, kind, header, *folds, *used, _timing(run))
    with replacing(run.page) as place:
        place.write_text(text, encoding="utf-8")
    return run.page


def _errors(
    time: Array, rows: Mapping[str, Array], limits: Limits
) -> tuple[float, float]:
    """Return the RMS torque error after the soft start, and the goal's RMS [N m]."""
    desired = rows["desired_torque_nm"]
    counted = np.isfinite(desired) & (time >= limits.soft_start)
    if not counted.any():
        counted = np.isfinite(desired)
    if not counted.any():
        return math.nan, math.nan
    wanted = desired[counted]
    off = rows["joint_torque_nm"][counted] - wanted
    return float(np.sqrt(np.mean(off**2))), float(np.sqrt(np.mean(wanted**2)))


def _touched(run: ReportedRun) -> list[str]:
    """Return words for each torque limit that a motor reached in many cycles."""
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
    """Return a sentence on what ran, the torque error and limits that were reached."""
    reason = run.outcome.sentence.rstrip(".")
    if run.outcome.code:
        return f"{run.what} ended after {duration:.3g} s: {reason}."
    error, size = errors
    parts = [f"{run.what} ran for {duration:.3g} s"]
    if not run.is_trial and math.isfinite(error):
        share = f", {error / size:.0%} of its RMS" if size > 1e-9 else ""
        where = f"the torque at {axis}" if axis else "the joint's torque"
        parts.append(f"{where} missed the desired one by {error:.3g} N m RMS{share}")
    touched = html.list_words(_touched(run))
    limit = f"it reached {touched}" if touched else "no limit was reached"
    return "; ".join([*parts, limit]) + "."


def _picture(
    name: str, time: Array, rows: Mapping[str, Array], limits: Limits
) -> html.Html:
    """Return a figure of an axis's torques and angle over time, with limits nearby."""
    shown = {
        "joint torque [N m]": ("joint_torque_nm", "desired_torque_nm"),
        "motor torque [N m]": ("motor_torque_nm",),
        "joint [rad]": ("joint_angle_rad",),
    }
    bounds = (), (-limits.torque, limits.torque), limits.joint_range
    with style(), tempfile.TemporaryDirectory() as folder:
        drawing = figure(7.0, 6.0)
        parts = drawing.subplots(len(shown), sharex=True)
        every = zip(parts, shown.items(), bounds, strict=True)
        for axes, (title, columns), ends in every:
            for column, color in zip(columns, (BLUE, ORANGE), strict=False):
                words = column.partition("_torque")[0].replace("joint", "measured")
                axes.plot(time, rows[column], color=color, label=words)
            if len(columns) > 1:
                axes.legend(loc="upper right")
            low, high = axes.get_ylim()
            for end in ends:
                if 2.0 * low - high <= end <= 2.0 * high - low:
                    axes.axhline(end, color=GREY, linestyle=":")
            axes.set(title=title)
        parts[-1].set(xlabel="time [s]")
        path = Path(folder) / "run.png"
        save(path, drawing)
        which = f"axis {name}" if name else "the run"
        return html.embed_picture(
            path, f"Torques and angle of {which}; limits are dotted."
        )


def _next(run: ReportedRun, axis: str) -> html.Html:
    folder = run.log.parent
    if run.outcome.code:
        why = "To see what led to it: "
        words = ["cc-mujoco", "play", run.scene, "--replay", str(run.log)]
    else:
        goal = "with all trials" if run.is_trial else "ask what the scene lacks"
        why = f"Next, {goal}: "
        source = folder if run.is_trial else run.log
        words = ["cc-mujoco", "diagnose", run.scene, str(source)]
        words += ["--axis", axis] if axis else []
        words += ["--out", str(folder.with_name(f"{folder.name}_diagnosis"))]
    return html.paragraph(why, html.element("code", shlex.join(words)), kind="lead")


def _used(name: str, rows: Mapping[str, Array], limits: Limits) -> html.Html:
    low, high = limits.joint_range
    least, most = np.min(rows["joint_angle_rad"]), np.max(rows["joint_angle_rad"])

    def row(title: str, column: str, limit: float, unit: str) -> list[str]:
        largest = float(np.abs(rows[column]).max())
        shown = [title, f"{largest:.3g} {unit}"]
        if not math.isfinite(limit):
            return [*shown, "none", "-"]
        return [*shown, f"{limit:.3g} {unit}", f"{largest / limit:.0%}"]

    ranges = f"{least:.3g} to {most:.3g} rad", f"{low:.3g} to {high:.3g} rad"
    lines = [
        row("motor torque", "motor_torque_nm", limits.torque, "N m"),
        row("motor speed", "motor_velocity_rad_s", limits.motor_speed, "rad/s"),
        row("joint torque", "joint_torque_nm", limits.joint_torque, "N m"),
        ["joint angle", *ranges, f"{(most - least) / (high - low):.0%}"],
    ]
    title = f"Limits of {name}" if name else "Limits"
    head = ("", "largest", "limit", "used")
    return html.join_pieces([html.element("h2", title), html.table(head, lines)])


def _timing(run: ReportedRun) -> html.Html:
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
    ignored = sorted(found.ignored.items())
    sentences += [f"{count} packets ignored: {why}." for why, count in ignored]
    return html.join_pieces(
        [html.element("h2", "Timing"), *map(html.paragraph, sentences)]
    )
