"""The page of a study: what it says of designs that are made up here."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from html import unescape
from pathlib import Path

import pyarrow as pa
import pytest

from cc_mujoco.design import StudySpec, make_plan, read_limits
from cc_mujoco.design._follow_up import Around, Price
from cc_mujoco.design._protocol import DEFAULT_OBJECTIVES
from cc_mujoco.design._report import write_report
from cc_mujoco.design._report_text import (
    RankedStudy,
    common_values,
    confidence,
    controllers,
    failures,
    goals_of,
    header,
    limit_slack,
)
from cc_mujoco.report._html import Html

GOALS = ("rms_torque_error", "peak_tension")
FOLDER = Path("/runs/liner")


def finding(
    errors: Sequence[float | None],
    tensions: Sequence[float | None],
    limits: Sequence[str] = (),
    goals: Sequence[str] = GOALS,
    failed: Sequence[str | None] | None = None,
) -> tuple[RankedStudy, pa.Table]:
    plan = make_plan(
        StudySpec(
            "wrist",
            designs=[
                {"friction": 0.1 + 0.1 * (n % 4), "pretension": 10.0 + n}
                for n in range(len(errors))
            ],
            metrics=GOALS,
            objectives=goals,
            subject_to=limits,
        )
    )
    table = pa.table(
        {
            "design": range(len(errors)),
            **{n: [d[n] for d in plan.designs] for n in plan.ranges},
            "rms_torque_error": pa.array(errors, pa.float64()),
            "peak_tension": pa.array(tensions, pa.float64()),
            "failed": pa.array(failed or [None] * len(errors), pa.string()),
        }
    )
    return RankedStudy(plan, table), table


def said(page: str | None) -> str:
    return unescape(re.sub(r"<style>.*</style>|<[^>]+>", " ", page or "", flags=re.S))


def written(folder: Path, found: RankedStudy) -> str:
    write_report(folder, found, "cc-mujoco <x>")
    return (folder / "report.html").read_text(encoding="utf-8")


def test_without_objectives_three_usual_ones_rank() -> None:
    plan = make_plan(StudySpec("wrist", {"friction": [0.1, 0.2]}, duration=0.2))
    values = {name: [1.0, 2.0] for name in plan.protocol.metrics}
    every = goals_of(plan, pa.table(values))
    assert [goal.name for goal in every] == list(DEFAULT_OBJECTIVES)
    assert not any(goal.high for goal in every)
    without = pa.table(values | {"reflected_torque": pa.nulls(2, pa.float64())})
    assert len(goals_of(plan, without)) == 2
    few = make_plan(
        StudySpec(
            "wrist",
            {"friction": [0.1, 0.2]},
            duration=0.2,
            metrics=["efficiency", "slack_margin", "peak_tension", "strength_used"],
        )
    )
    names = [goal.name for goal in goals_of(few, pa.table(
        {name: [1.0, 2.0] for name in few.protocol.metrics}))]  # fmt: skip
    assert names == ["efficiency", "slack_margin", "peak_tension"]


def test_the_page_without_objectives_names_those_it_ranks_by(tmp_path: Path) -> None:
    found, _ = finding([3.0, 1.0, 2.0, 4.0], [50.0, 60.0, 40.0, 70.0], goals=())
    page = said(written(tmp_path, found))
    assert "least rms torque error and least peak tension (no objective" in page
    assert found.front.sum() == 2
    assert (tmp_path / "answer.png").exists()


def test_what_an_earlier_report_had_besides_goes_with_it(tmp_path: Path) -> None:
    found, table = finding([3.0, 1.0, 2.0, 4.0], [50.0, 60.0, 40.0, 70.0])
    for name in ("pareto.png", "mine.parquet"):
        (tmp_path / name).touch()
    one = replace(found.plan, objectives=found.plan.objectives[:1])
    write_report(tmp_path, RankedStudy(one, table))
    assert not (tmp_path / "pareto.png").exists()
    assert (tmp_path / "mine.parquet").exists()


def test_the_page_begins_with_the_best_design_and_needs_nothing_else(
    tmp_path: Path,
) -> None:
    found, _ = finding([3.0, 1.0, 2.0, 4.0], [50.0, 60.0, 40.0, 70.0],
                           ["peak_tension<=55"])  # fmt: skip
    page = written(tmp_path, found)
    assert not re.search(r"(src|href)=\"(?!data:|#)", page)
    assert "<script" not in page and "default-src 'none'" in page
    text = " ".join(said(page).split())
    lead = "Best in all objectives of those tried is design 2, friction 0.3 and "
    assert lead in text and "with peak_tension<=55, which 2 keep" in text
    assert text.index(lead) < text.index("2* 2 40 0.3 12") < text.index("0 3 50 0.1 10")
    assert "cc-mujoco <x>" in text


def test_without_a_good_design_the_page_says_what_stands_in_the_way(
    tmp_path: Path,
) -> None:
    found, _ = finding([3.0, 1.0], [50.0, 60.0], ["peak_tension<=20"])
    text = " ".join(said(written(tmp_path, found)).split())
    assert "No design is good enough." in text
    assert "The nearest is design 0, friction 0.1 and pretension 10 N: peak" in text
    assert "peak_tension<=20 0 of 2 2" in text
    assert text.index("peak_tension<=20 0 of 2") < text.rindex("What matters")
    assert "The best designs" not in text


def test_a_limit_excludes_alone_what_keeps_all_others() -> None:
    limits = ["peak_tension<=55", "rms_torque_error<=2.5"]
    found, _ = finding([3.0, 1.0, 2.0, 4.0], [50.0, 60.0, 40.0, 70.0], limits)
    text = " ".join(said(limit_slack(found)).split())
    assert "peak_tension<=55 2 of 4 1 40 N 15 N" in text
    assert "rms_torque_error<=2.5 2 of 4 1 2 N m 0.5 N m" in text


@pytest.mark.parametrize(
    ("errors", "ends"),
    [
        ([1.0, 2.0, 3.0, 4.0], "friction at the low end and pretension at the low end"),
        ([2.0, 1.0, 3.0, 4.0], ""),
        ([4.0, 2.0, 3.0, 1.0], "friction at the high end and pretension at the high"),
    ],
)
def test_a_best_design_at_the_end_of_a_range_is_said_to_be(
    errors: list[float], ends: str
) -> None:
    found, _ = finding(errors, [1.0] * 4, goals=GOALS[:1])
    text = said(confidence(found))
    assert ends in text and ("wider range" in text) == bool(ends)
    top = said(header(found, Html(), FOLDER))
    assert ("vary friction and pretension further" in top) == bool(ends)


def test_the_first_screen_says_how_sure_it_is_and_what_is_next() -> None:
    errors = [1.0, 1.01, 3.0, 4.0]
    top = said(header(finding(errors, [1.0] * 4, goals=GOALS[:1])[0], Html(), FOLDER))
    top = " ".join(top.split())
    assert "How sure: 1 other design is as good to within 5%" in top
    assert "Next: " in top
    assert "cc-mujoco whatif-show /runs/liner 0" in top
    lone, _ = finding([1.0, 2.0, 3.0, 4.0], [1.0] * 4, goals=GOALS[:1])
    alone = said(header(lone, Html(), FOLDER))
    assert "No other design is" in alone and "stands alone" in alone


def test_a_better_neighbour_is_said_to_be_one() -> None:
    found, _ = finding([1.0, 2.0, 3.0, 4.0], [1.0] * 4, goals=GOALS[:1])
    beside = {"friction": 0.15, "pretension": 9.0}

    def text(*, gives: float, kept: bool = True, limit: str = "") -> str:
        (eased,) = read_limits([limit]) if limit else (None,)
        price = Price(GOALS[0], eased, math.nan, 1.0, 0.5, gives, kept, beside)
        found.nearby = Around(0, (), (price,))
        return said(confidence(found))

    assert (
        "beside it, friction 0.15 and pretension 9 N gives rms torque error 0.6 N m"
        in (text(gives=0.6))
    )
    for other in (
        text(gives=1.2),
        text(gives=0.999),
        text(gives=math.nan),
        text(gives=0.6, kept=False),
        text(gives=0.6, limit="peak_tension<=2"),
    ):
        assert "not the optimum" not in other


def test_of_several_controllers_the_page_says_whose_ranks_are_alike() -> None:
    designs = [{"friction": 0.1 * n} for n in range(1, 5)]
    laws = ("none", "pi")
    plan = make_plan(
        StudySpec(
            "wrist",
            designs=designs,
            metrics=GOALS,
            controllers=laws,
            objectives=GOALS[:1],
        )
    )
    table = pa.table(
        {
            "design": range(4),
            "friction": [d["friction"] for d in designs],
            "rms_torque_error": [1.0, 2.0, 3.0, 4.0],
            "rms_torque_error@none": [4.0, 3.5, 3.2, 4.0],
            "rms_torque_error@pi": [1.0, 2.0, 3.0, None],
            "controller": ["pi", "pi", "pi", "none"],
            "failed": pa.array([None] * 4, pa.string()),
        }
    )
    found = RankedStudy(plan, table)
    text = " ".join(said(controllers(found)).split())
    assert "none 1 of 4 4 -0.11" in text
    assert "pi 3 of 4 1 1.00" in text
    alone, _ = finding([1.0, 2.0], [1.0, 2.0])
    assert controllers(alone) is None
    assert "--controllers with several names" in said(confidence(alone))


def test_failures_are_counted_by_reason_whatever_their_numbers() -> None:
    why = ["diverged at 0.125 s (X)", "diverged at 1.5 s (X)", None, "impossible: y"]
    found, _ = finding([None, None, None, None], [None, None, 1.0, None], failed=why)
    text = said(failures(found))
    assert "2 designs, the first: diverged at 0.125 s (X)." in text
    assert "1 design: impossible: y." in text
    assert "1 design ran, but has no rms torque error." in text


def test_what_follows_a_variable_is_not_called_fixed() -> None:
    found, _ = finding([3.0, 1.0], [50.0, 60.0])
    told = " ".join(said(common_values(found)).split())
    assert "static friction in the scene's proportion to friction" in told
