"""Page of an episode in a browser: it plays without messages in the console."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import matplotlib.image
import mujoco
import numpy as np
import pytest

from cc_mujoco.assets import scene_path
from cc_mujoco.report import _html as html
from cc_mujoco.viz._web_page import write_page

pytest.importorskip("plotly.offline")
BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))),
    None,
)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="needs Chromium")
SAID = re.compile(r':CONSOLE:\d+\] "(.*)", source:')
HARMLESS = re.compile(r"GPU stall due to ReadPixels|Canvas2D: Multiple readback")
"""Performance notes of Chromium with software rendering, caused by plotly.js."""
WIDE, HIGH = 1000, 700


def run(folder: Path, *words: str) -> str:
    """Return the output of the browser."""
    folder.mkdir()
    command = [
        str(BROWSER),
        *("--headless", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader"),
        *("--disable-quic", "--no-first-run", "--disable-background-networking"),
        *("--disable-component-update", "--disable-sync", "--hide-scrollbars"),
        f"--user-data-dir={folder / 'profile'}",
        "--enable-logging=stderr",
        *words,
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240)
    return done.stderr


def shown(page: Path, folder: Path, address: str = "") -> tuple[Any, list[str]]:
    """Return a picture of a page (height, width, 3) and the messages of its console."""
    stderr = run(
        folder,
        f"--window-size={WIDE},{HIGH}",
        "--virtual-time-budget=20000",
        f"--screenshot={folder / 'shot.png'}",
        f"{page.as_uri()}{address}",
    )
    said = [line for line in SAID.findall(stderr) if not HARMLESS.search(line)]
    return matplotlib.image.imread(folder / "shot.png")[..., :3], said


def test_a_page_moves_with_its_time_and_the_console_is_silent(
    make_log: Any, tmp_path: Path
) -> None:
    model = mujoco.MjModel.from_xml_path(str(scene_path("wrist")))
    rows = 200
    qpos = np.zeros((rows, model.nq))
    qpos[:, model.jnt_qposadr[model.joint("wrist").id]] = np.linspace(-0.5, 0.5, rows)
    log = make_log(rows=rows, nq=model.nq, nodes=21, qpos=qpos)
    page = tmp_path / "episode.html"
    write_page(page, log, model)
    end = float(log["time_s"][-1])
    early, said = shown(page, tmp_path / "early", f"#t={0.1 * end:.2f}")
    assert not said
    late, said = shown(page, tmp_path / "late", f"#t={0.9 * end:.2f}")
    assert not said
    # The scene is at the left, the plots and their cursor at the right.
    changed = np.abs(early - late).max(axis=2) > 0.1
    assert changed[100 : HIGH - 200, : WIDE // 2].mean() > 0.002
    assert changed[:, WIDE // 2 :].any()
    assert np.ptp(early[100 : HIGH - 200, : WIDE // 2]) > 0.5


@pytest.mark.study
def test_a_tall_picture_is_printed_on_one_sheet(tmp_path: Path) -> None:
    tall, page = tmp_path / "tall.png", tmp_path / "page.html"
    matplotlib.image.imsave(tall, np.full((3000, 1000, 3), 0.5))
    page.write_text(html.page("t", "named", html.embed_picture(tall, "words")), "utf-8")
    sheets = tmp_path / "sheets.pdf"
    run(tmp_path / "print", f"--print-to-pdf={sheets}", page.as_uri())
    assert len(re.findall(rb"/Type /Page\b", sheets.read_bytes())) == 1


def test_a_page_that_cannot_be_shown_is_noticed(tmp_path: Path) -> None:
    page = tmp_path / "broken.html"
    page.write_text("<script>nothing.here()</script>", encoding="utf-8")
    _, said = shown(page, tmp_path / "broken")
    assert any("nothing is not defined" in line for line in said)
