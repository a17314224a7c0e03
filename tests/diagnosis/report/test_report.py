"""The report page: whole, self-contained, escaped, and true to the diagnosis."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cc_mujoco.diagnosis._report.output as report_module
from cc_mujoco.diagnosis import Diagnosis
from cc_mujoco.diagnosis._phrases import MINUS, effect_names, headline
from cc_mujoco.diagnosis._report.drawings import FIGURE_STEMS
from cc_mujoco.diagnosis._report.output import write_report
from cc_mujoco.diagnosis._report.sections import next_command
from cc_mujoco.diagnosis._verdict import Evidence, Gap, NotTestable, Occasions
from cc_mujoco.errors import CableError
from cc_mujoco.report._html import Html, element
from diagnosis.report_examples import DIAGNOSES, NOTHING, TITLES, evidence, maps

VOID = {"meta", "img"}


class Page(HTMLParser):
    """Reads a page and fails on an element that is closed in the wrong place."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.links: list[str] = []
        self.images: list[str] = []
        self.ids: list[str] = []
        self.headings: list[str] = []
        self.text = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.tags.append(tag)
        self.links += [values[key] or "" for key in ("href", "src") if key in values]
        if "id" in values:
            self.ids.append(values["id"] or "")
        if tag == "img":
            assert values["alt"]
            self.images.append(values["src"] or "")
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" in self.open:
            return
        self.text += data
        if self.open and self.open[-1] in ("h1", "h2"):
            self.headings.append(data)


def written(folder: Path, diagnosis: Diagnosis, shown: Evidence) -> Page:
    write_report(folder, diagnosis, shown)
    return Page((folder / "report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def named(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Page]:
    folder = tmp_path_factory.mktemp("named") / "out"
    return folder, written(folder, DIAGNOSES["named"], evidence())


@pytest.mark.parametrize("verdict", DIAGNOSES)
def test_verdict_is_the_first_thing_said(tmp_path: Path, verdict: str) -> None:
    diagnosis = DIAGNOSES[verdict]
    page = written(tmp_path, diagnosis, NOTHING)
    assert page.headings[0] == headline(diagnosis)
    assert page.text.index(diagnosis.statement) < page.text.index(page.headings[1])
    assert [tag for tag in page.tags if tag == "script"] == []
    assert len(set(page.ids)) == len(page.ids)


def test_pictures_are_inside_and_beside(named: tuple[Path, Page]) -> None:
    folder, page = named
    beside = [(folder / f"{stem}.png").read_bytes() for stem in FIGURE_STEMS]
    inside = [base64.b64decode(each.partition(",")[2]) for each in page.images]
    assert sorted(inside) == sorted(beside)
    assert all(each.startswith(b"\x89PNG") for each in inside)


def test_nothing_outside_the_page_is_referred_to(named: tuple[Path, Page]) -> None:
    folder, page = named
    anchors = [link for link in page.links if link.startswith("#")]
    assert {f"#{each}" for each in page.ids} == set(anchors)
    rest = [link for link in page.links if not link.startswith("#")]
    assert all(link.startswith("data:image/png;base64,") for link in rest)
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert "http://" not in text and "https://" not in text and "@import" not in text
    assert not re.search(r"url\(", text)


def test_what_people_wrote_is_escaped(tmp_path: Path) -> None:
    page = written(tmp_path, DIAGNOSES["fix-data"], NOTHING)
    assert "<b>has</b>" in page.text and "b" not in page.tags
    hostile = '</section><script>"&'
    everywhere = replace(
        DIAGNOSES["named"],
        statement=hostile,
        not_testable=(NotTestable(hostile, hostile),),
        provenance={hostile: [hostile]},
        problems=(hostile,),
        where=(replace(DIAGNOSES["named"].where[0], statement=hostile, axis=hostile),),
    )
    page = written(tmp_path, everywhere, NOTHING)
    assert page.text.count(hostile) >= 7 and "script" not in page.tags


def test_every_number_of_the_diagnosis_is_said(named: tuple[Path, Page]) -> None:
    text = named[1].text
    for said in (
        "falls from 0.083 N m to 0.031 N m; the noise floor is 0.027 N m; 96 %",
        "95 % interval 98 % to 99.7 %",
        "in 98 % of resamplings",
        "62 % of the error of the joint torque follows the joint speed.",
        "static excess",
        "0.312",
        "0.288 to 0.336",
        "0.00720 to ∞",
        "4123",
        "3990 to 4260",
        f"{MINUS}3.2·10⁻⁵",
        "Friction and wrap enter only as their product.",
        "gap < noise",
        "below the threshold of 0.15",
        f"{MINUS}5 %",
        "the trials last 20 s together",
        "12 samples of joint_torque_nm are clipped",
        "9f" * 32,
        "mujoco 4.0.0",
        "0.333 to 0.031",
        "4.77 to 1.20",
    ):
        assert said in text, said


def test_tie_says_first_what_to_run(tmp_path: Path) -> None:
    page = written(tmp_path, DIAGNOSES["tie"], NOTHING)
    assert page.headings[1] == "What to run next"
    assert f"It separates {effect_names(TITLES)}." in page.text
    assert "0.12 N m RMS of joint torque, four times the noise." in page.text


@pytest.mark.parametrize("verdict", ["named", "tie", "none", "unknown"])
def test_a_question_is_asked_once_before_all_sections(
    tmp_path: Path, verdict: str
) -> None:
    told = "Do load cells and torque sensor read the same pulley?"
    requested = replace(DIAGNOSES[verdict], question=told)
    page = written(tmp_path, requested, NOTHING)
    assert page.text.count(told) == 1
    assert page.text.index(told) < page.text.index(page.headings[1])


def test_a_trial_that_contradicts_the_others_is_asked_about_first(
    tmp_path: Path,
) -> None:
    diagnosis = DIAGNOSES["unknown"]
    page = written(tmp_path, diagnosis, NOTHING)
    assert page.headings[0].endswith("or one trial was recorded differently")
    assert page.text.index(diagnosis.question) < page.text.index(page.headings[1])
    assert page.headings[1] == "How far off every trial is"
    table = page.text[page.text.index("over the floor") :]
    assert table.index("monday/") < table.index("b & <c>")  # the worst first
    assert "21.2" in table and "0.333" in table


@pytest.mark.parametrize("verdict", ["fix-data", "fix-numerics"])
def test_faults_come_first_and_the_rest_is_left_out(
    tmp_path: Path, verdict: str
) -> None:
    page = written(tmp_path, DIAGNOSES[verdict], NOTHING)
    assert page.headings[1] == "Data and numerics"
    left_out = page.text[page.text.index("Left out") :]
    for title in ("Maps of the error", "Measured and simulated", "How large the gap"):
        assert title in left_out and title not in page.headings
    assert page.images == []


def test_maps_within_chance_and_without_data_are_said_to_be_so(tmp_path: Path) -> None:
    empty = np.full(15, np.nan)
    weak = tuple(
        replace(each, share=0.01, chance=0.05, before=empty, after=empty)
        for each in maps()[:2]
    )
    shown = replace(NOTHING, maps=weak)
    lost = {"motor_torque_nm": Gap(*[float("nan")] * 4, (0.0, 0.0))}
    page = written(tmp_path, replace(DIAGNOSES["none"], gap=lost), shown)
    assert "No map shows more than chance would" in page.text
    assert len(page.images) == 2


def test_figures_of_an_older_report_go(tmp_path: Path) -> None:
    (tmp_path / "maps.png").write_bytes(b"old")
    (tmp_path / "mine.png").write_bytes(b"mine")
    write_report(tmp_path, DIAGNOSES["fix-data"], NOTHING)
    assert {file.name for file in tmp_path.iterdir()} == {"report.html", "mine.png"}


def test_report_is_written_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> str:
        raise OSError("disk full")

    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "report.html").write_text("old")
    monkeypatch.setattr(report_module.html, "page", fail)
    with pytest.raises(CableError, match=r"out: disk full"):
        write_report(folder, DIAGNOSES["named"], NOTHING)
    assert [file.name for file in tmp_path.rglob("*")] == ["out", "report.html"]
    assert (folder / "report.html").read_text() == "old"


def test_same_diagnosis_gives_the_same_page(tmp_path: Path) -> None:
    for folder in ("one", "two"):
        write_report(tmp_path / folder, DIAGNOSES["named"], NOTHING)
    one, two = (tmp_path / name / "report.html" for name in ("one", "two"))
    assert one.read_bytes() == two.read_bytes()


@given(st.text(), st.text())
def test_text_is_escaped_and_markup_is_not(text: str, value: str) -> None:
    made = element("p", text, Html("<br>"), class_=value)
    inside = made.partition(">")[2].removesuffix("</p>").removesuffix("<br>")
    assert "<" not in inside and '"' not in inside
    assert made.startswith('<p class="') and made.partition(">")[0].count('"') == 2


def test_a_tie_of_several_occasions_is_run_again_and_not_continued() -> None:
    tie = replace(DIAGNOSES["tie"], provenance={"command": "cc-mujoco diagnose S A B"})
    assert "--continue" in str(next_command(tie))
    occasions = Occasions(("A", "B"), (), (), "Nothing changed.")
    several = str(next_command(replace(tie, occasions=occasions)))
    assert "--continue" not in several and "cc-mujoco diagnose S A B" in several
