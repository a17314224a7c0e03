"""The report's figures: what is drawn, that it is labelled, and what is left out."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cc_mujoco.diagnosis._report.drawings import (
    FIGURE_STEMS,
    confounded_pairs,
    draw_excerpt,
    draw_isolability,
    excerpts,
    figures,
    invisible_effects,
    model_changed,
    shown_maps,
)
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import Diagnosis, Evidence, Isolability, TrialTrace
from cc_mujoco.report import style
from diagnosis.report_examples import (
    DIAGNOSES,
    NOTHING,
    TITLES,
    evidence,
    isolability,
    maps,
    trace,
)


def draw_figures(diagnosis: Diagnosis, shown: Evidence) -> dict[str, Figure]:
    with style():
        return {stem: draw() for stem, draw in figures(diagnosis, shown).items()}


@pytest.fixture(scope="module")
def drawn() -> dict[str, Figure]:
    return draw_figures(DIAGNOSES["named"], evidence())


def panels(drawing: Figure) -> list[Axes]:
    return [axes for axes in drawing.get_axes() if axes.axison]


def legend(axes: Axes) -> list[str]:
    return axes.get_legend_handles_labels()[1]


def test_every_axis_says_its_unit(drawn: dict[str, Figure]) -> None:
    assert tuple(drawn) == FIGURE_STEMS
    for stem, drawing in drawn.items():
        sharing = stem in ("gap", "traces", "traces_ordinary")
        for axes in panels(drawing):
            last = axes is panels(drawing)[-1]
            if stem != "isolability" and (last or not sharing):
                assert "[" in axes.get_xlabel(), stem
            if stem not in ("gap", "isolability"):
                assert "[" in axes.get_ylabel(), stem
    labels = [axes.get_xlabel() for axes in drawn["isolability"].get_axes()]
    assert {"size over noise [1]", "cosine of signatures [1]"} <= set(labels)


def test_gap_bars_are_as_long_as_the_errors(drawn: dict[str, Figure]) -> None:
    gaps = DIAGNOSES["named"].gap.values()
    for axes, gap in zip(panels(drawn["gap"]), gaps, strict=True):
        lengths = [bar.get_width() for bar in axes.patches]
        assert lengths == [gap.noise_floor, gap.rmse_before, gap.rmse_after]


def test_a_model_that_did_not_change_is_drawn_once() -> None:
    drawn = draw_figures(DIAGNOSES["tie"], evidence(closed=False))
    assert not model_changed(evidence(closed=False))
    assert len(panels(drawn["gap"])[0].patches) == 2
    assert legend(panels(drawn["traces"])[0]) == ["measured", "simulation"]
    assert "after" not in legend(panels(drawn["maps"])[0])


def test_nothing_is_drawn_of_nothing() -> None:
    assert figures(DIAGNOSES["fix-data"], NOTHING) == {}


def test_maps_beyond_chance_come_first_and_alone() -> None:
    shown = shown_maps(evidence())
    shares = [each.share for each in shown]
    assert shares == sorted(shares, reverse=True)
    assert {each.axis for each in shown} == {"joint speed", "motion since reversal"}
    weak = tuple(replace(each, share=0.01, chance=0.05) for each in maps())
    assert len(shown_maps(Evidence((), weak, isolability()))) == 2


def test_bins_in_decades_have_a_logarithmic_axis(drawn: dict[str, Figure]) -> None:
    scales = {axes.get_xlabel(): axes.get_xscale() for axes in panels(drawn["maps"])}
    assert scales["motion since reversal [m]"] == "log"
    assert scales["joint speed [rad/s]"] == "linear"


@given(
    start=st.floats(2.0, 18.0),
    seconds=st.floats(1.0, 8.0),
    index=st.integers(0, 1),
)
@settings(max_examples=30, deadline=None)
def test_worst_excerpt_holds_the_burst_of_error(
    start: float, seconds: float, index: int
) -> None:
    traces = [trace("a", 20.0, True), trace("b", 20.0, True, seed=1)]
    hit = traces[index]
    burst = (hit.time >= start) & (hit.time <= start + 0.3)
    channel = "joint_torque_nm"
    measured = {**hit.measured, channel: hit.measured[channel] + 9.0 * burst}
    traces[index] = replace(hit, measured=measured)
    found, _ = excerpts(Evidence(tuple(traces), (), isolability())) or (None, None)
    assert found is not None and found.trace is traces[index]
    time = found.trace.time[found.part]
    assert time[0] <= start + 0.15 <= time[-1] + 1e-9
    assert time[-1] - time[0] <= Limit.max_excerpt + 1e-6


def test_run_in_is_never_shown_however_wrong() -> None:
    hit = trace("a", 20.0, True)
    wrong = {k: v + 50.0 * (hit.time < 1.0) for k, v in hit.measured.items()}
    one = Evidence((replace(hit, measured=wrong),), (), isolability())
    shown = excerpts(one)
    assert shown is not None
    for found in shown:
        assert found.trace.time[found.part][0] >= 1.0


def test_stretches_of_one_trial_may_differ_in_length() -> None:
    one, other = trace("a", 20.0, True), trace("a", 9.0, True, seed=1)
    hit = {k: v + 5.0 * (one.time > 15.0) for k, v in one.measured.items()}
    parts = Evidence((replace(one, measured=hit), other), (), isolability())
    drawings = draw_figures(DIAGNOSES["named"], parts)
    assert {"traces", "traces_ordinary"} <= set(drawings)


def test_readings_that_are_missing_do_not_count_and_leave_a_break() -> None:
    hit = trace("a", 20.0, True)
    lost = {k: np.where(hit.time > 10, np.nan, v) for k, v in hit.measured.items()}
    found, _ = excerpts(
        Evidence((replace(hit, measured=lost),), (), isolability())
    ) or (None, None)
    assert found is not None and np.isfinite(found.error)
    kept = (hit.time < 15) | (hit.time > 16)
    cut = TrialTrace(
        "cut",
        hit.time[kept],
        hit.motor_angle[kept],
        hit.joint_angle[kept],
        *({k: v[kept] for k, v in m.items()} for m in (hit.measured, hit.before)),
        {k: v[kept] for k, v in hit.after.items()},
        hit.counts[kept],
    )
    found, _ = excerpts(Evidence((cut,), (), isolability())) or (None, None)
    assert found is not None
    with style():
        whole = found._replace(part=slice(0, len(cut.time)))
        line = panels(draw_excerpt(whole, True))[0].get_lines()[0]
    assert np.isnan(np.asarray(line.get_ydata(), float)).sum() == 1


def test_a_trial_of_which_nothing_counts_has_no_excerpt() -> None:
    hit = trace("a", 5.0, True)
    empty = replace(hit, counts=np.zeros_like(hit.counts))
    assert excerpts(Evidence((empty,), (), isolability())) is None


def test_alike_effects_stand_side_by_side() -> None:
    with style():
        drawing = draw_isolability(isolability(), 7.0)
    assert drawing is not None
    rows = [label.get_text() for label in drawing.get_axes()[0].get_yticklabels()]
    words = [row.rpartition("  ")[0] for row in rows]
    assert (
        abs(
            words.index(TITLES["presliding"]) - words.index(TITLES["stribeck_friction"])
        )
        == 1
    )
    assert len(set(words)) == len(isolability().ids)


def test_pairs_and_invisible_effects_are_listed() -> None:
    alike = np.array([[1.0, 0.95, 0.2], [0.95, 1.0, 0.97], [0.2, 0.97, 1.0]])
    few = Isolability(("a", "b", "c"), alike, np.array([0.5, 3.0, np.nan]))
    assert [pair[:2] for pair in confounded_pairs(few)] == [("c", "b"), ("b", "a")]
    assert invisible_effects(few) == ["a", "c"]


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_effects_can_be_drawn(count: int) -> None:
    whole = isolability()
    few = Isolability(
        whole.ids[:count], whole.cosines[:count, :count], whole.visible[:count]
    )
    with style():
        assert draw_isolability(few, 7.0) is not None


def test_global_state_is_left_alone() -> None:
    sys.modules.pop("matplotlib.pyplot", None)
    draw_figures(DIAGNOSES["none"], evidence(False))
    assert "matplotlib.pyplot" not in sys.modules
