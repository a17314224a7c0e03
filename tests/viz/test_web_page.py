"""Pages of episodes: what they hold, and that they need nothing else."""

from __future__ import annotations

import base64
import json
import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco import cli
from cc_mujoco.assets import scene_path
from cc_mujoco.metrics._metric import value_text
from cc_mujoco.report._html import page, table
from cc_mujoco.simulation import EpisodeLog
from cc_mujoco.viz import PAGE_FILE
from cc_mujoco.viz import _episode_files as episode_files
from cc_mujoco.viz._web_page import write_page

plotly = pytest.importorskip("plotly.offline")


class Elements(HTMLParser):
    """Attributes of all elements, and what stands in those with an id."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.attributes: list[tuple[str, str, str]] = []
        self.held: dict[str, str] = {}
        self.code: list[str] = []
        self._open: dict[str, str | None] = {}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        self._open = {"tag": tag, **dict(attrs)}

    def handle_data(self, data: str) -> None:
        name = self._open.get("id")
        if name:
            self.held[name] = self.held.get(name, "") + data
        elif self._open.get("tag") == "script":
            self.code.append(data)

    def handle_endtag(self, tag: str) -> None:
        self._open = {}


def unpacked(field: dict[str, Any]) -> Any:
    raw = base64.b64decode(field["bdata"])
    return np.frombuffer(raw, "<" + field["dtype"]).reshape(field["shape"])


def read(path: Path) -> Any:
    return json.loads(Elements(path.read_text("utf-8")).held["episode"])


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(scene_path("wrist")))


@pytest.fixture
def made(make_log: Any, model: mujoco.MjModel, tmp_path: Path) -> tuple[Any, Path]:
    log = make_log(rows=60, nq=model.nq, nodes=21)
    write_page(tmp_path / PAGE_FILE, log, model)
    return log, tmp_path / PAGE_FILE


def test_a_page_states_what_the_guard_did(
    make_log: Any, model: mujoco.MjModel, tmp_path: Path
) -> None:
    about = {"guard": ["the guard braked joint 'wrist': at 1 s."]}
    write_page(
        tmp_path / PAGE_FILE, make_log(rows=9, nq=model.nq, metadata=about), model
    )
    page = (tmp_path / PAGE_FILE).read_text("utf-8")
    assert "Here the guard braked joint &#x27;wrist&#x27;: at 1 s." in page


def test_play_leaves_a_page_of_its_log_and_takes_an_old_one_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        episode_files, "write_summary", lambda path, _: Path(path).touch()
    )
    words = ["play", "wrist", "--duration", "0.2", "--out", "here"]
    assert cli.main([*words, "--html"]) == 0
    log = EpisodeLog.read(tmp_path / "here" / "log.parquet")
    data = read(tmp_path / "here" / PAGE_FILE)
    time, frames = unpacked(data["time"]), unpacked(data["frames"])
    assert np.array_equal(time, log["time_s"].astype("f4"))
    lines = {
        (number, line["label"]): unpacked(line["values"])
        for number, panel in enumerate(data["panels"])
        for line in panel["lines"]
    }
    expected = {
        (0, "delivered"): log["joint_torque_nm"],
        (0, "desired"): log["desired_torque_nm"],
        (1, "motor"): log["motor_torque_nm"],
        (2, "joint"): np.degrees(log["joint_angle_rad"]),
        (3, "motor end"): log["tension_flexor_proximal_n"],
        (4, "joint end"): log["tension_extensor_distal_n"],
    }
    for key, values in expected.items():
        assert np.array_equal(lines[key], values.astype("f4")), key
    shown = np.searchsorted(time, frames)
    assert np.array_equal(time[shown], frames)
    assert np.diff(frames) == pytest.approx(1 / 30, abs=1e-3)
    for line in data["scene"]["lines"]:
        if "name" in line:
            nodes = log[f"tension_{line['name']}_nodes_n"][shown]
            assert np.array_equal(unpacked(line["tension"]), nodes.astype("f4"))
    assert cli.main(words) == 0
    assert not (tmp_path / "here" / PAGE_FILE).exists()


def test_a_page_needs_nothing_but_itself(made: tuple[Any, Path]) -> None:
    _, path = made
    text = path.read_text("utf-8")
    found = Elements(text)
    assert not [a for a in found.attributes if a[1] in ("src", "href", "srcset")]
    assert "@import" not in text[: text.index("</style>")]
    (rule,) = [a[2] for a in found.attributes if "default-src" in a[2]]
    allowed = dict(part.strip().split(" ", 1) for part in rule.split(";"))
    assert allowed["default-src"] == "'none'"
    assert not re.search(r"https?:|\*|eval", rule)
    library, player = found.code
    assert library.strip() == plotly.get_plotlyjs().strip()
    named = re.findall(r'getElementById\("(\w+)"\)', player)
    listed = re.findall(r"\[([^\]]*)\]\.map\(\(id\)", player)
    ids = {*named, *re.findall(r"\w+", " ".join(listed))}
    assert len(ids) > 5
    assert ids <= {a[2] for a in found.attributes if a[1] == "id"}


def test_the_data_of_a_page_are_small(
    made: tuple[Any, Path], make_log: Any, model: mujoco.MjModel
) -> None:
    """20 s stay below 10 MB: what a second adds is bounded."""
    log, path = made
    once = path.stat().st_size
    longer = make_log(rows=460, nq=model.nq, nodes=21)
    write_page(path, longer, model)
    seconds = longer["time_s"][-1] - log["time_s"][-1]
    grown = (path.stat().st_size - once) / seconds
    assert once + 20 * grown < 8e6
    assert grown > 0


def test_of_a_long_episode_even_samples_are_shown(
    make_log: Any, model: mujoco.MjModel, tmp_path: Path
) -> None:
    time = np.linspace(0.0, 1.0, 20_001)
    log = make_log(rows=len(time), nq=model.nq, time_s=time)
    write_page(tmp_path / PAGE_FILE, log, model)
    data = read(tmp_path / PAGE_FILE)
    assert np.array_equal(unpacked(data["time"]), time[::3].astype("f4"))
    values = unpacked(data["panels"][1]["lines"][0]["values"])
    assert np.array_equal(values, log["motor_torque_nm"][::3].astype("f4"))
    assert "one in 3 is shown" in (tmp_path / PAGE_FILE).read_text("utf-8")


def test_bodies_and_cables_are_where_the_simulation_has_them(
    made: tuple[Any, Path], model: mujoco.MjModel
) -> None:
    log, path = made
    page_data = read(path)
    scene, frames = page_data["scene"], unpacked(page_data["frames"])
    poses = unpacked(scene["poses"]).reshape(scene["poses"]["shape"][0], -1, 3, 4)
    data = mujoco.MjData(model)
    moving = np.flatnonzero(model.body_weldid != 0)
    last = int(np.abs(log["time_s"] - frames[-1]).argmin())
    data.qpos[:] = log["qpos"][last]
    mujoco.mj_fwdPosition(model, data)
    for row, body in enumerate(moving.tolist()):
        assert poses[-1, row, :, 3] == pytest.approx(data.xpos[body], abs=1e-6)
        turned = data.xmat[body].reshape(3, 3)
        assert poses[-1, row, :, :3] == pytest.approx(turned, abs=1e-6)
    low, high = np.array(scene["box"]).T
    for mesh in scene["meshes"]:
        corners = unpacked(mesh["vertices"]).astype(float)
        assert unpacked(mesh["triangles"]).max() == len(corners) - 1
        for pose in poses[[0, -1], mesh["body"]] if mesh["body"] >= 0 else ():
            turned = corners @ pose[:, :3].T + pose[:, 3]
            assert (turned >= low).all()
            assert (turned <= high).all()
    cables = [line for line in scene["lines"] if "name" in line]
    assert [line["name"] for line in cables] == ["flexor", "extensor"]
    for line in cables:
        nodes = unpacked(line["nodes"])
        assert (nodes[0], nodes[-1]) == (0.0, 20.0)
        assert (np.diff(nodes) > 0).all()
    ropes = [line for line in scene["lines"] if "rope" in line]
    assert [line["rope"] for line in ropes] == ["flexor", "extensor"]
    for line in ropes:
        distal = log[f"tension_{line['rope']}_distal_n"][last]
        tension = unpacked(line["tension"]).reshape(line["tension"]["shape"])
        assert tension[-1] == pytest.approx(distal, rel=1e-6)


@pytest.mark.parametrize("width", [1.2, 2.0])
def test_all_that_moves_is_in_the_first_view(
    made: tuple[Any, Path], width: float
) -> None:
    scene = read(made[1])["scene"]
    low, high = np.array(scene["box"]).T
    scale = np.prod(high - low) ** (1 / 3)
    look = {k: np.array([v[a] for a in "xyz"]) for k, v in scene["camera"].items()}
    forward = look["center"] - look["eye"]
    forward /= np.linalg.norm(forward)
    assert look["up"] @ forward == pytest.approx(0.0, abs=1e-9)
    right = np.cross(forward, look["up"])
    reached = 0.0
    for line in scene["lines"]:
        points = unpacked(line["points"]).reshape(-1, 3).astype(float)
        seen = (points - 0.5 * (low + high)) / scale - look["eye"]
        # Of 45 degrees upwards, as plotly.js has it.
        half = np.tan(np.radians(22.5)) * (seen @ forward)
        assert (half > 0).all()
        reached = max(reached, float((np.abs(seen @ look["up"]) / half).max()))
        assert (np.abs(seen @ right) <= width * half).all()
    assert 0.4 < reached <= 1.0


def test_a_model_whose_cables_have_no_route_has_a_page(
    make_log: Any, tmp_path: Path
) -> None:
    xml = """<mujoco><worldbody><geom type="plane" size="0 0 1"/><body>
      <joint/><geom size=".1"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    write_page(tmp_path / PAGE_FILE, make_log(rows=3, nq=1), model)
    scene = read(tmp_path / PAGE_FILE)["scene"]
    assert scene["lines"] == []
    assert {mesh["body"] for mesh in scene["meshes"]} == {-1, 0}


def test_without_plotly_nothing_is_played(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    assert cli.main(["play", "wrist", "--duration", "1000", "--html"]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said == (
        "cc-mujoco: a page of an episode needs plotly: pip install 'cc_mujoco[html]'."
    )
    assert not list(tmp_path.iterdir())


def test_data_cannot_end_its_element_and_only_scripts_allow_scripts() -> None:
    harmful = json.dumps("</script><p>")
    text = page("t", "k", data={"here": harmful}, scripts=("let x = 1 < 2;",))
    assert Elements(text).held["here"] == harmful.replace("<", "\\u003c")
    assert json.loads(Elements(text).held["here"]) == "</script><p>"
    assert "script-src" in text
    assert "script-src" not in page("t", "k")


@given(value=st.floats(allow_nan=True), words=st.text("ab -e.5", max_size=8))
def test_a_number_in_a_table_is_not_broken(value: float, words: str) -> None:
    number = value_text(value)
    cells = re.findall(r"<td[^>]*>", table(["a", "b"], [[number, f"a{words}"]]))
    assert cells == ['<td class="number">', "<td>"]
