"""Report of a diagnosis: a self-contained page, and its figures.

    write_report("out", diagnosis, evidence, {"presliding": "presliding"})

The page can be sent around by itself; the figures are also PNG files next to it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from cc_mujoco._utils.atomic_io import replacing_folder
from cc_mujoco.diagnosis._phrases import Names, headline
from cc_mujoco.diagnosis._report import sections
from cc_mujoco.diagnosis._report.drawings import FIGURE_STEMS, draw_figures
from cc_mujoco.diagnosis._report.excerpt import ordinary_excerpt, worst_excerpt
from cc_mujoco.diagnosis._report_data import Evidence
from cc_mujoco.diagnosis._verdict import Diagnosis
from cc_mujoco.report._figures import save, style
from cc_mujoco.report._html import (
    Html,
    embed_picture,
    folded,
    illustrated,
    join_pieces,
    list_words,
    page,
    paragraph,
    scrolled,
)
from cc_mujoco.report._html import sections as page_sections

REPORT_PAGE = "report.html"

SECTION_TITLES = {
    "unknown": "What is known of it",
    "traces": "Measured and simulated",
    "gap": "How large the gap is",
    "occasions": "What changed between occasions",
    "trials": "How far off every trial is",
    "where": "Where the error lies",
    "maps": "Maps of the error",
    "candidates": "What was tried",
    "likeness": "What these data can distinguish",
    "untested": "What these data hide",
    "next": "What to run next",
    "parameters": "Fitted parameters",
    "problems": "Data and numerics",
    "provenance": "Provenance",
}
"""Sections in their usual order."""

FIRST_SECTION = {"fix-data": "problems", "fix-numerics": "problems", "tie": "next"}
"""Section that comes first, by verdict."""


def write_report(
    folder: str | os.PathLike[str],
    diagnosis: Diagnosis,
    evidence: Evidence,
    titles: Mapping[str, str] | None = None,
) -> None:
    """Write `report.html` and its figures, all of them or none.

    Figures of an older report in the folder are deleted if this one does not have them.

    Args:
        folder: to write into; made if it is absent.
        diagnosis: the verdict and its reasons.
        evidence: the data of the figures.
        titles: id of an effect to its name in sentences; an id that is not in it has
            its underscores replaced.
    """
    names = Names(titles)
    with replacing_folder(folder) as partial:
        with style():
            drawings = draw_figures(diagnosis, evidence, names)
            for stem, drawing in drawings.items():
                save(partial / f"{stem}.png", drawing)
        text = _page(diagnosis, evidence, names, partial)
        (partial / REPORT_PAGE).write_text(text, encoding="utf-8")
    for stem in FIGURE_STEMS:
        if stem not in drawings:
            (Path(folder) / f"{stem}.png").unlink(missing_ok=True)


def _page(diagnosis: Diagnosis, evidence: Evidence, names: Names, figures: Path) -> str:
    parts = _sections(diagnosis, evidence, names, figures)
    if diagnosis.verdict != "unknown":
        del parts["unknown"]
    there = {key: part for key, part in parts.items() if part is not None}
    first = FIRST_SECTION.get(
        diagnosis.verdict, "trials" if diagnosis.question else None
    )
    order = sorted(there, key=lambda key: key != first)
    return page(
        headline(diagnosis, names),
        diagnosis.verdict,
        sections.header(diagnosis, names, _gap_picture(figures)),
        page_sections(SECTION_TITLES, {key: there[key] for key in order}),
        _omitted_sections([key for key, part in parts.items() if part is None]),
    )


def _gap_picture(figures: Path) -> Html:
    """Return the picture at the top, empty without an error to draw."""
    path = figures / "gap.png"
    words = "Weighted RMS error on held-out data, beside the noise floor."
    return embed_picture(path, words) if path.exists() else Html()


def _sections(
    diagnosis: Diagnosis, evidence: Evidence, names: Names, figures: Path
) -> dict[str, Html | None]:
    """Return the content of each section by key, in the order of `SECTION_TITLES`."""

    def drawn(stem: str, words: str) -> Html:
        path = figures / f"{stem}.png"
        return embed_picture(path, words) if path.exists() else Html()

    most, usual = worst_excerpt(evidence), ordinary_excerpt(evidence)
    seconds = []
    if most is not None:
        seconds.append(drawn("traces", sections.excerpt_caption(most, True)))
    if usual is not None:
        ordinary = drawn("traces_ordinary", sections.excerpt_caption(usual, False))
        seconds.append(folded("Ordinary seconds", ordinary) if ordinary else Html())
    maps = drawn(
        "maps", "Mean error, measured minus simulated, over what it lies along."
    )
    figure = drawn(
        "isolability",
        "Left: similarity of the changes that two effects make to the signals, once "
        "the baseline is retuned (1: the same, 0: nothing in common). Right: size of a "
        "plausible effect over the noise, grey where it is smaller.",
    )
    return {
        "unknown": sections.unknown(diagnosis),
        "traces": join_pieces(seconds) if seconds else None,
        "gap": sections.gap(diagnosis),
        "occasions": sections.occasions(diagnosis, names),
        "trials": sections.trials(diagnosis),
        "where": sections.error_location(diagnosis),
        "maps": illustrated(sections.maps(evidence), maps),
        "candidates": sections.candidates(diagnosis, names),
        "likeness": illustrated(
            sections.effect_similarity(evidence, names),
            folded("All effects", scrolled(figure)) if figure else Html(),
        ),
        "untested": sections.untested_effects(diagnosis, names),
        "next": sections.experiment(diagnosis, names),
        "parameters": sections.parameters(diagnosis, names),
        "problems": sections.problems(diagnosis),
        "provenance": (
            folded("Inputs, versions and settings", known)
            if (known := sections.provenance(diagnosis)) is not None
            else None
        ),
    }


def _omitted_sections(keys: list[str]) -> Html:
    """Return one sentence on sections for which there was nothing."""
    if not keys:
        return Html()
    words = list_words([f"“{SECTION_TITLES[key]}”" for key in keys])
    return paragraph(f"Left out, as there was nothing to show: {words}.", kind="small")
