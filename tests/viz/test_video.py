"""Videos: what a frame shows, and what is said where none can be made."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from cc_mujoco import cli
from cc_mujoco.assets import scene_path
from cc_mujoco.errors import CableError
from cc_mujoco.viz import OffscreenRenderer
from cc_mujoco.viz import _offscreen_renderer as offscreen_renderer
from cc_mujoco.viz import _video as video
from cc_mujoco.viz._episode_files import VIDEO_FILE
from cc_mujoco.viz._video import LAYOUT, Strips

SECONDS = 0.2


@pytest.fixture(scope="module")
def gl() -> None:
    try:
        offscreen_renderer.require_opengl()
    except CableError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(scene_path("wrist")))


def pictures(path: Path) -> list[Any]:
    av = pytest.importorskip("av")
    with av.open(str(path)) as film:
        return [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]


def cursor(frame: Any, strips: Strips) -> int:
    """Column of the line that marks the moment in every plot."""
    dark = np.ones(frame.shape[1], bool)
    for top, bottom in strips.rows:
        dark &= (frame[top:bottom] < 90).all(axis=(0, 2))
    # Not the plots' own upright at their left, one pixel wide.
    columns = np.flatnonzero(dark)
    return int(columns.max())


@pytest.mark.usefixtures("gl", "undrawn")
def test_play_leaves_30_frames_a_second_and_takes_an_old_video_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["play", "wrist", "--duration", str(SECONDS), "--out", "here"]
    assert cli.main([*words, "--video"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"^video: 0\.2 s of it in \S+ s, \S+ times as fast", said, re.M)
    frames = pictures(tmp_path / "here" / VIDEO_FILE)
    assert len(frames) == round(30 * SECONDS)
    assert {frame.shape for frame in frames} == {(720, 1280, 3)}
    top, height, left, width = LAYOUT.scene
    scenes = [f[top : top + height, left : left + width] for f in frames]
    # The colours of the conduits, if nothing else.
    moved = np.abs(scenes[0].astype(int) - scenes[-1])
    assert (moved > 40).any(axis=2).sum() > 100
    assert cli.main(words) == 0
    assert not (tmp_path / "here" / VIDEO_FILE).exists()
    told = f"{Path('here') / VIDEO_FILE} is deleted, as it showed an earlier episode."
    assert told in capsys.readouterr().out.splitlines()
    assert cli.main(words) == 0
    assert "deleted" not in capsys.readouterr().out
    (tmp_path / "here" / VIDEO_FILE).write_bytes(b"of my holidays")
    assert cli.main(words) == 2
    assert "video.mp4 is not as an earlier run wrote it" in capsys.readouterr().err
    assert (tmp_path / "here" / VIDEO_FILE).read_bytes() == b"of my holidays"


@pytest.mark.usefixtures("gl")
def test_the_file_is_whole_or_not_there(
    make_log: Any, model: mujoco.MjModel, tmp_path: Path
) -> None:
    pytest.importorskip("av")
    log = make_log(rows=40, nq=model.nq, nodes=21)

    def stopped(time: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        video.write_video(tmp_path / "a.mp4", log, model, stopped)
    assert not list(tmp_path.iterdir())


def test_the_moment_is_marked_where_the_time_axis_has_it(make_log: Any) -> None:
    log = make_log()
    strips = Strips(log, 20.0)
    _, height, _, width = LAYOUT.scene
    scene = np.full((height, width, 3), 7, np.uint8)
    assert (
        strips.column(log["time_s"][0]),
        strips.column(log["time_s"][-1]),
    ) == LAYOUT.plots
    assert len(strips.rows) == 2 + len(log.cables)
    before = None
    for time in (0.5, 1.4, 2.3):
        frame = strips.frame(scene, time)
        share = time / log["time_s"][-1]
        expected = LAYOUT.plots[0] + share * (LAYOUT.plots[1] - LAYOUT.plots[0])
        assert cursor(frame, strips) == pytest.approx(expected, abs=1.5)
        assert (frame[LAYOUT.scene[0] : LAYOUT.scene[0] + height, :width] == 7).all()
        # Lines before the moment are darker than the same ones after it.
        ink = int(255 * frame.size - frame.sum(dtype=np.int64))
        assert before is None or ink > before
        before = ink


@pytest.mark.parametrize("count", [1, 8, 20])
def test_a_title_of_any_length_stays_above_the_scene(
    make_log: Any, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    log, title = make_log(), ", ".join(count * ["left_knee=spring:2"])
    monkeypatch.setattr(video, "episode_title", lambda _: "")
    plain = Strips(log, 20.0).frame(np.zeros((632, 760, 3), np.uint8), 0.0).copy()
    monkeypatch.setattr(video, "episode_title", lambda _: title)
    frame = Strips(log, 20.0).frame(np.zeros((632, 760, 3), np.uint8), 0.0)
    rows, columns = np.nonzero((frame != plain).any(axis=2))
    top, left = LAYOUT.scene[0], LAYOUT.plots[0]
    assert 0 < rows.min() and rows.max() < top and columns.max() < left - 20
    assert columns.max() > 100


@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize(("high", "shown"), [(0.4, True), (3.0, False)])
def test_what_stands_still_is_whole_if_that_needs_little_more_room(
    high: float, shown: bool
) -> None:
    xml = f"""<mujoco><worldbody><light pos="0 -3 3" dir="0 1 -1"/>
      <camera pos="0 -4 0" xyaxes="1 0 0 0 0 1"/>
      <geom type="box" size=".1 .1 .1" pos="0 0 {high}" rgba="1 0 0 1"/>
      <body><joint type="slide" axis="1 0 0"/><geom size=".1" rgba="0 1 0 1"/></body>
    </worldbody></mujoco>"""
    model, poses = mujoco.MjModel.from_xml_string(xml), np.array([[-0.5], [0.5]])
    with OffscreenRenderer(model, (), 1.0, poses, (120, 160)) as place:
        picture = place.picture(poses[0], {}).astype(int)
    red = (picture[..., 0] > 2 * picture[..., 1]) & (picture[..., 0] > 60)
    assert red.any() == shown
    assert not red[[0, -1]].any()


@pytest.mark.usefixtures("gl")
def test_what_moves_stands_before_and_behind_what_does_not(make_log: Any) -> None:
    """Both layers together are what MuJoCo draws at once, shadows apart."""
    xml = """<mujoco><worldbody><light pos="0 -3 3" dir="0 1 -1" castshadow="false"/>
      <camera pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>
      <geom type="box" size=".2 .2 .2" rgba="1 0 0 1"/>
      <body><joint type="slide" axis="0 1 0"/><geom size=".1" rgba="0 1 0 1"/></body>
    </worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    poses = np.array([[-0.6], [0.6]])
    with OffscreenRenderer(model, (), 1.0, poses, (120, 160)) as place:
        front, behind = (place.picture(pose, {}).astype(int) for pose in poses)
    middle = slice(50, 70), slice(70, 90)
    assert (front[middle][..., 1] > front[middle][..., 0]).all()
    assert (behind[middle][..., 0] > behind[middle][..., 1]).all()


@pytest.mark.usefixtures("gl")
def test_a_cable_has_the_colour_of_its_tension(model: mujoco.MjModel) -> None:
    pose = model.qpos0
    with OffscreenRenderer(model, ("flexor",), 50.0, pose[None], (180, 240)) as place:
        shown = {
            name: place.picture(pose, {"flexor": np.full(21, tension)}).astype(int)
            for name, tension in (("high", 50.0), ("low", 1.0), ("slack", 0.0))
        }
    differ = (np.abs(shown["high"] - shown["low"]) > 60).any(axis=2)
    assert differ.sum() > 100
    high, low, slack = (shown[name][differ] for name in ("high", "low", "slack"))
    assert (high[:, 1] > high[:, 2]).mean() > 0.9  # yellow
    assert (low[:, 2] > low[:, 1]).mean() > 0.9  # violet
    assert np.ptp(slack, axis=1).mean() < 30.0  # grey


def test_without_pyav_nothing_is_played(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "av", None)
    assert cli.main(["play", "wrist", "--duration", "1000", "--video"]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said == "cc-mujoco: a video needs PyAV: pip install 'cc_mujoco[video]'."
    assert not list(tmp_path.iterdir())


def test_without_opengl_nothing_is_played(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    pytest.importorskip("av")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    util = importlib.import_module("ctypes.util")
    monkeypatch.setattr(util, "find_library", lambda name: None)
    assert cli.main(["play", "wrist", "--duration", "1000", "--video"]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert "a video needs OpenGL by EGL or OSMesa, and what is here does not" in said
    assert not list(tmp_path.iterdir())
