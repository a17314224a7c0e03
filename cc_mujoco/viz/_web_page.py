"""The web page of an episode: one file that a browser plays without a server.

    write_page("episode.html", log, env.unwrapped.model, measure(log))

It shows the scene in 3-D and plots of torques, angles and tensions at the same time. It
is drawn by plotly.js, which is inside the page (`pip install 'cc_mujoco[html]'`).
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from html import escape
from pathlib import Path
from string import Template
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco.errors import import_extra
from cc_mujoco.metrics import Metric
from cc_mujoco.metrics._metric import value_text
from cc_mujoco.report import _html as html
from cc_mujoco.report._figures import TENSION_COLORS
from cc_mujoco.simulation._episode_log import EpisodeLog
from cc_mujoco.viz import _film_plots as plots
from cc_mujoco.viz._cable_lines import SLACK_COLOR
from cc_mujoco.viz._film_plots import FRAME_RATE, MAX_SAMPLES, Panel, highest_tension
from cc_mujoco.viz._plot_axes import axis_limits
from cc_mujoco.viz._summary import episode_title
from cc_mujoco.viz._web_scene import encode_array, web_scene


def require_page() -> None:
    """Raise `CableError` if no page can be made, because plotly is missing."""
    _plotly()


def write_page(
    path: str | os.PathLike[str],
    log: EpisodeLog,
    model: mujoco.MjModel,
    metrics: Mapping[Metric, float] = MappingProxyType({}),
) -> None:
    """Write the page of an episode with `metrics` below, replacing an older one."""
    library = _plotly()
    highest, count = highest_tension(log), len(log)
    log = log.thinned(MAX_SAMPLES)
    # At most 6000 frames: a longer episode shows fewer per second.
    rate = plots.frame_rate(log["time_s"], FRAME_RATE, 6_000)
    samples = plots.frame_samples(log["time_s"], rate)
    panels = [*plots.torques(log), *plots.angles(log), *plots.tensions(log)]
    every = math.ceil(len(log) / 10_000)  # samples of a line: of more, every k-th
    shares = _shares(log, count, every, rate)
    time = log["time_s"]
    shown = []
    for panel in panels:
        lines = []
        for line in panel.lines:
            look = {"label": line.label, "color": line.color, "dashed": line.dashed}
            lines.append({**look, "values": encode_array(line.values[::every])})
        reach = axis_limits(time, [line.values for line in panel.lines])
        shown.append({"range": reach, "lines": lines})
    data = {
        "time": encode_array(time[::every]),
        "frames": encode_array(time[samples]),
        "panels": shown,
        "scene": web_scene(log, model, samples),
        "highest": highest,
        "colors": _colors(),
    }
    style, script, template = (
        Path(__file__).with_name(f"web_page.{kind}").read_text(encoding="utf-8")
        for kind in ("css", "js", "html")
    )
    title, figures = escape(episode_title(log)), "".join(map(_figure, panels))
    colors, slack = ",".join(color for _, color in _colors()[2:]), _rgb(SLACK_COLOR)
    gradient = f"linear-gradient(90deg,{colors})"
    text = {"title": title, "plots": figures, "gradient": gradient, "slack": slack}
    text |= {"highest": f"{highest:.3g}", "shares": escape(shares)}
    body = html.Html(Template(template.replace("\n", "")).substitute(text))
    if metrics:
        rows = [
            (m.name.replace("_", " "), value_text(value), m.unit, m.meaning)
            for m, value in metrics.items()
        ]
        results = html.table(("", "", "unit", "meaning"), rows)
        body = html.join_pieces([body, html.element("h2", "Results"), results])
    content = json.dumps(data, separators=(",", ":"), allow_nan=False)
    own: Any = {"style": style, "scripts": (library, script)}
    own["data"] = {"episode": content}
    page = html.page(episode_title(log), "episode", body, **own)
    with replacing(path) as partial:
        partial.write_text(page, encoding="utf-8")


def _colors() -> list[tuple[float, str]]:
    """Return plotly's colour scale of tension over its maximum, grey below 0.001."""
    import matplotlib

    shares = np.linspace(0.0, 1.0, 17)
    tones = matplotlib.colormaps[TENSION_COLORS](shares, bytes=True)[:, :3]
    slack = _rgb(SLACK_COLOR)
    shares[0] = 1e-3
    scale = zip(shares.tolist(), map(_rgb, tones), strict=True)
    return [(0.0, slack), (1e-3, slack), *scale]


def _rgb(color: NDArray[np.uint8]) -> str:
    return "#" + bytes(color[:3]).hex()


def _shares(log: EpisodeLog, count: int, every: int, rate: float) -> str:
    text = f"{count} samples over {log['time_s'][-1]:g} s."
    every *= -(-count // len(log))
    if every > 1:
        text += f" Of the samples one in {every} is shown."
    if rate < FRAME_RATE:
        text += f" The scene has {rate:.3g} frames in every second."
    return text


def _figure(panel: Panel) -> str:
    keys = ""
    for line in panel.lines:
        look = "dashed" if line.dashed else "line"
        keys += f'<span><i class="{look}" style="color:{line.color}"></i> '
        keys += f"{escape(line.label)} <b></b></span>"
    return (
        f'<section><div class="key"><h3>{escape(panel.title)} [{panel.unit}]</h3>'
        f'{keys}</div><div class="frame"><div class="plot"></div>'
        '<div class="cursor"></div></div></section>'
    )


def _plotly() -> str:
    needs = "a page of an episode needs plotly"
    return str(import_extra("plotly.offline", needs, "html").get_plotlyjs())
