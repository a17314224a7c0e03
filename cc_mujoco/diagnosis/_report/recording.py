"""Evidence of a diagnosis as a Rerun recording: every sample, to zoom into.

    write_recording("evidence.rrd", evidence)

`rerun evidence.rrd` opens it as a finished layout, one tab a trial, at the trial where
the baseline errs most. Recordings of equal evidence compare equal.
"""

import hashlib
import os

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from cc_mujoco.diagnosis import _phrases as words
from cc_mujoco.diagnosis._phrases import format_share as share_of
from cc_mujoco.diagnosis._report import drawings
from cc_mujoco.diagnosis._verdict import MODELS, Evidence, Map, TrialTrace
from cc_mujoco.native import FloatArray
from cc_mujoco.report import _markdown as markdown
from cc_mujoco.report._figures import BLUE, GREEN, GREY, ORANGE, PINK
from cc_mujoco.viz._plot_axes import plot
from cc_mujoco.viz._rerun_file import recording

TIMELINE = "trial_time"
"""Time since the start of a trial; trials share it."""

LINE_STYLES = {"measured": (GREY, 2.5), "before": (ORANGE, 1.5), "after": (BLUE, 1.5)}


def write_recording(path: str | os.PathLike[str], evidence: Evidence) -> None:
    both = drawings.model_changed(evidence)
    with recording(path, recording_id(evidence), _blueprint(evidence)) as rec:
        rec.log("about", _about(evidence), static=True)
        for trace in evidence.traces:
            _log_trace(rec, trace, both)
        for each in evidence.maps:
            _log_map(rec, each, both)


def recording_id(evidence: Evidence) -> str:
    """Return an id that is the same for equal evidence, and only for it."""
    digest = hashlib.sha256()

    def add(name: str, *arrays: FloatArray) -> None:
        digest.update(repr(name).encode())
        for array in arrays:
            digest.update(f"{array.dtype}{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())

    for trace in evidence.traces:
        add(trace.trial, trace.time, trace.motor_angle, trace.joint_angle, trace.counts)
        for kind in (trace.measured, trace.before, trace.after):
            for name, values in kind.items():
                add(name, values)
    for each in evidence.maps:
        name = f"{each.channel}/{each.axis}/{each.unit}/{each.share}/{each.chance}"
        add(name, each.centre, each.before, each.after, each.band)
    isolability = evidence.isolability
    add("/".join(isolability.ids), isolability.cosines, isolability.visible)
    return digest.hexdigest()[:32]


def _log_trace(rec: rr.RecordingStream, trace: TrialTrace, both: bool) -> None:
    index = [rr.TimeColumn(TIMELINE, duration=trace.time)]

    def send(parts: list[str], values: FloatArray, color: str, width: float) -> None:
        path = rr.new_entity_path(["trials", trace.trial, *parts])
        look = rr.SeriesLines(names=[parts[-1]], colors=[_rgba(color)], widths=[width])
        rec.log(path, look, static=True)
        rec.send_columns(path, index, [*rr.Scalars.columns(scalars=values)])

    for name, measured in trace.measured.items():
        send([name, "measured"], measured, *LINE_STYLES["measured"])
        models = [("before", trace.before, trace.error(name))]
        if both:
            models.append(("after", trace.after, trace.error(name, "after")))
        for kind, played, error in models:
            send([name, kind], played[name], *LINE_STYLES[kind])
            send([f"{name}_error", kind], error, *LINE_STYLES[kind])
    send(["motion", "motor"], trace.motor_angle, GREEN, 1.5)
    send(["motion", "joint"], trace.joint_angle, PINK, 1.5)


def _log_map(rec: rr.RecordingStream, each: Map, both: bool) -> None:
    kinds = {"before": each.before, **({"after": each.after} if both else {})}
    for kind, values in kinds.items():
        there = np.isfinite(values)
        if there.any():
            at, color = each.centre[there], _rgba(LINE_STYLES[kind][0])
            bars = rr.BarChart(values[there], abscissa=at, color=color)
            rec.log(_map_path(each, kind), bars, static=True)


def _about(evidence: Evidence) -> rr.TextDocument:
    maps = [
        (
            words.capitalise(words.channel_name(each.channel)),
            f"{words.plain_name(each.axis)} [{each.unit or '1'}]",
            share_of(each.share),
            share_of(each.chance),
        )
        for each in drawings.ranked_maps(evidence)
    ]
    pairs = [
        (words.effect_name(one), words.effect_name(other), f"{cosine:.2f}")
        for one, other, cosine in drawings.confounded_pairs(evidence.isolability)
    ]
    parts = [
        "# Evidence of a diagnosis",
        "Measured torques are grey, those simulated before orange, those simulated "
        f"with the named effects blue. {words.SIGN_NOTE}",
        "# Maps of the error",
        markdown.table(("", "over", "share", "by chance"), maps, numbers=(2, 3)),
        "# Effects that are similar",
        markdown.table(("", "", "likeness"), pairs, numbers=[2]),
    ]
    weak = drawings.invisible_effects(evidence.isolability)
    if weak:
        parts.append(f"Smaller than the noise, if present: {words.effect_names(weak)}.")
    return rr.TextDocument("\n\n".join(parts), media_type=rr.MediaType.MARKDOWN)


def _blueprint(evidence: Evidence) -> rrb.Blueprint:
    about = rrb.TextDocumentView(origin="/about", name="About")
    tabs: list[rrb.Container | rrb.View] = [_trial_tab(t) for t in evidence.traces]
    if evidence.maps:
        views = []
        for each in drawings.ranked_maps(evidence):
            quantity = f"{words.plain_name(each.axis)} [{each.unit or '1'}]"
            channel = words.capitalise(words.channel_name(each.channel))
            name = f"{channel}, mean error [{words.TORQUE_UNIT}] over {quantity}"
            views.append(rrb.BarChartView(origin=_map_path(each), name=name))
        tabs.append(rrb.Grid(*views, name="Maps of the error"))
    shown = drawings.excerpts(evidence)
    trials = [trace.trial for trace in evidence.traces]
    first = trials.index(shown[0].trace.trial) if shown else 0
    whole = rrb.Tabs(*tabs, about, active_tab=first)
    panel = rrb.TimePanel(state="collapsed", timeline=TIMELINE)
    return rrb.Blueprint(whole, panel, collapse_panels=True)


def _trial_tab(trace: TrialTrace) -> rrb.Vertical:
    def view(part: str, name: str, *lines: FloatArray) -> rrb.TimeSeriesView:
        origin = rr.new_entity_path(["trials", trace.trial, part])
        return plot(origin, name, trace.time, lines, room=0.12)

    views = []
    for name, measured in trace.measured.items():
        title = words.capitalise(words.channel_name(name))
        lines = measured, trace.before[name], trace.after[name]
        errors = (trace.error(name, model) for model in MODELS)
        views.append(view(name, f"{title} [{words.TORQUE_UNIT}]", *lines))
        views.append(
            view(f"{name}_error", f"{title}, error [{words.TORQUE_UNIT}]", *errors)
        )
    views.append(view("motion", "Angles [rad]", trace.motor_angle, trace.joint_angle))
    return rrb.Vertical(*views, name=trace.trial)


def _map_path(each: Map, *more: str) -> str:
    return rr.new_entity_path(["maps", each.channel, each.axis, *more])


def _rgba(color: str) -> int:
    return int(f"{color[1:]}FF", 16)
