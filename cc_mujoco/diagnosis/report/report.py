"""The report of a diagnosis: one page that needs nothing else, and its figures.

    write_report("out", diagnosis, evidence, {"presliding": "presliding"})

The page can be sent around by itself; the figures lie beside it as PNG files too.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from cc_mujoco.diagnosis.evidence import Evidence
from cc_mujoco.diagnosis.report import sections
from cc_mujoco.diagnosis.report.drawings import STEMS, draw
from cc_mujoco.diagnosis.report.excerpt import ordinary, worst
from cc_mujoco.diagnosis.verdict import Diagnosis
from cc_mujoco.diagnosis.wording import Names, headline
from cc_mujoco.figures import save, style
from cc_mujoco.files import replacing_folder
from cc_mujoco.page import (
    Html,
    illustrated,
    joined,
    listed,
    page,
    paragraph,
    picture,
)
from cc_mujoco.page import sections as page_sections

REPORT = "report.html"

TITLES = {
    "traces": "Measured and simulated",
    "gap": "How large the gap is",
    "trials": "How far off every trial is",
    "where": "Where the error lies",
    "maps": "Maps of the error",
    "candidates": "What was tried",
    "likeness": "What these data can tell apart",
    "untested": "What could not be tested",
    "next": "What to run next",
    "parameters": "Fitted parameters",
    "problems": "Data and numerics",
    "provenance": "Provenance",
}
"""Sections in their usual order."""

FIRST = {"fix-data": "problems", "fix-numerics": "problems", "tie": "next"}
"""What the reader of a verdict needs before all else."""


def write_report(
    folder: str | os.PathLike[str],
    diagnosis: Diagnosis,
    evidence: Evidence,
    titles: Mapping[str, str] | None = None,
) -> None:
    """Write `report.html` and its figures, all of them or none.

    Figures of an older report in the same folder that this one does not have go.

    Args:
        folder: to write into; made if it is not there.
        diagnosis: what is said.
        evidence: what is drawn.
        titles: id of an effect to its name in sentences; an id that is not in it has
            its underscores replaced.
    """
    names = Names(titles)
    with replacing_folder(folder) as partial:
        with style():
            drawings = draw(diagnosis, evidence, names)
            for stem, drawing in drawings.items():
                save(partial / f"{stem}.png", drawing)
        text = _page(diagnosis, evidence, names, partial)
        (partial / REPORT).write_text(text, encoding="utf-8")
    for stem in STEMS:
        if stem not in drawings:
            (Path(folder) / f"{stem}.png").unlink(missing_ok=True)


def _page(diagnosis: Diagnosis, evidence: Evidence, names: Names, figures: Path) -> str:
    parts = _sections(diagnosis, evidence, names, figures)
    there = {key: part for key, part in parts.items() if part is not None}
    first = FIRST.get(diagnosis.verdict, "trials" if diagnosis.question else None)
    order = sorted(there, key=lambda key: key != first)
    return page(
        headline(diagnosis, names),
        diagnosis.verdict,
        sections.header(diagnosis, names),
        page_sections(TITLES, {key: there[key] for key in order}),
        _left_out([key for key in TITLES if key not in there]),
    )


def _sections(
    diagnosis: Diagnosis, evidence: Evidence, names: Names, figures: Path
) -> dict[str, Html | None]:
    """Key to content, in the order of `TITLES`."""

    def drawn(stem: str, words: str) -> Html:
        path = figures / f"{stem}.png"
        return picture(path, words) if path.exists() else Html()

    most, usual = worst(evidence), ordinary(evidence)
    seconds = [
        drawn(stem, sections.excerpt_caption(excerpt, stem == "traces"))
        for stem, excerpt in (("traces", most), ("traces_ordinary", usual))
        if excerpt is not None
    ]
    gap = drawn("gap", "Weighted RMS error on held-out data, beside the noise floor.")
    maps = drawn(
        "maps", "Mean error, measured minus simulated, over what it lies along."
    )
    alike = drawn(
        "isolability",
        "Left: likeness of the changes that two effects make to the signals, once the "
        "baseline is retuned (1: the same, 0: nothing in common). Right: size of a "
        "plausible effect over the noise, grey where it is smaller.",
    )
    return {
        "traces": joined(seconds) if seconds else None,
        "gap": illustrated(sections.gap(diagnosis), gap),
        "trials": sections.trials(diagnosis),
        "where": sections.where(diagnosis),
        "maps": illustrated(sections.maps(evidence), maps),
        "candidates": sections.candidates(diagnosis, names),
        "likeness": illustrated(sections.likeness(evidence, names), alike),
        "untested": sections.untested(diagnosis, names),
        "next": sections.experiment(diagnosis, names),
        "parameters": sections.parameters(diagnosis, names),
        "problems": sections.problems(diagnosis),
        "provenance": sections.provenance(diagnosis),
    }


def _left_out(keys: list[str]) -> Html:
    """One sentence on sections for which there was nothing."""
    if not keys:
        return Html()
    words = listed([f"“{TITLES[key]}”" for key in keys])
    return paragraph(f"Left out, as there was nothing to show: {words}.", kind="small")
