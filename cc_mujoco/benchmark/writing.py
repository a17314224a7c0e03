"""Files of a benchmark: scores, tables, figures, recordings."""

from __future__ import annotations

import os
from pathlib import Path

import mujoco

from cc_mujoco.assets import scene_path
from cc_mujoco.benchmark import drawing
from cc_mujoco.benchmark.cell import Cell, play
from cc_mujoco.benchmark.report import Results, markdown
from cc_mujoco.benchmark.runner import FIGURES, SCORES, TABLE, write_scores
from cc_mujoco.figures import save, style
from cc_mujoco.files import replacing


def write(out: str | os.PathLike[str], results: Results) -> str:
    """Write `scores.parquet`, `table.md` and the figures of every scene.

    Returns:
        The tables, as Markdown.
    """
    out = Path(out)
    write_scores(out / SCORES, results)
    text = markdown(results)
    with replacing(out / TABLE) as partial:
        partial.write_text(text, encoding="utf-8")
    for scene in dict.fromkeys(cell.scene for cell, _ in results):
        for stem in FIGURES:
            with style():
                draw = getattr(drawing, stem)
                save(out / f"{scene}-{stem}.png", draw(results, scene))
    return text


def write_recording(out: str | os.PathLike[str], cell: Cell) -> Path:
    """Play a cell again and record its first seed, as `cc-mujoco play` does.

    Returns:
        The folder of the recording.
    """
    from cc_mujoco.recording import write_episode

    log = play(cell, record=True).log
    assert log is not None
    folder = recording_folder(out, cell)
    model = mujoco.MjModel.from_xml_path(str(scene_path(cell.scene)))
    write_episode(folder, log, model)
    return folder


def recording_folder(out: str | os.PathLike[str], cell: Cell) -> Path:
    """Where `write_recording` writes."""
    return Path(out) / "recordings" / cell.name
