"""A scene that is watched: sliders, keys and refusals, without a window."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from cc_mujoco import cli, plugin
from cc_mujoco.assets import scene_path
from cc_mujoco.errors import CableError
from cc_mujoco.viz._live_controls import ENTER, ESCAPE, HOME, UP
from cc_mujoco.viz._view import read_scene, view
from cc_mujoco.viz._viewer import Frame

SCENE = """<mujoco>
  <extension><plugin plugin="cc_mujoco.cable"><instance name="flexor">
    <config key="conduit" value="0.5:0.2"/><config key="axial_stiffness" value="4000"/>
    <config key="pretension" value="10"/><config key="friction" value="0.1"/>
    <config key="segments" value="8"/>
  </instance></plugin></extension>
  <worldbody>
    <body><joint name="drum" armature="1e-3" damping="0.01"/><geom size="0.02"/></body>
    <body pos="1 0 0"><joint stiffness="2" damping="0.1"/><geom size="0.05"/></body>
  </worldbody>
  <actuator>
    <position name="friction" joint="drum" kp="5" ctrlrange="-2 2"/>
    <plugin plugin="cc_mujoco.cable" instance="flexor" joint="drum" gear="-0.02"/>
    <plugin plugin="cc_mujoco.cable" instance="flexor" joint="{joint}" gear="-0.06"/>
  </actuator>
</mujoco>""".replace("<joint stiffness", '<joint name="elbow" stiffness').replace(
    "{joint}", "elbow"
)


class Window:
    """A screen that does things by itself, each at a step."""

    highest = 50.0

    def __init__(self, does: dict[int, Callable[[Any], object]]) -> None:
        self.does, self.step, self.open = does, 0, True
        self.frames: list[Frame] = []

    def __call__(
        self, model: Any, cables: Any, highest: float, press: Any, sliders: Any
    ) -> Window:
        self.model, self.cables, self.press, self.sliders = (
            model,
            cables,
            press,
            sliders,
        )
        self.shown = mujoco.MjData(sliders.model)
        return self

    def __enter__(self) -> Window:
        return self

    def __exit__(self, *_: object) -> None:
        self.open = False

    def push(self, data: Any) -> None:
        self.step += 1
        self.data = data
        self.does.get(self.step, lambda window: None)(self)
        self.sliders.write(self.shown)
        self.sliders.read(self.shown)

    def show(self, frame: Frame) -> None:
        self.frames.append(frame)

    def said(self, name: str) -> str:
        return dict(self.frames[-1].texts[0])[name]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "elbow.xml"
    path.write_text(SCENE)
    return path


def test_sliders_move_the_actuators_and_change_the_cables(file: Path) -> None:
    kept: dict[str, Any] = {}

    def wind(window: Any) -> None:
        window.shown.ctrl[0] = 0.3

    def look(window: Any) -> None:
        kept["ctrl"] = window.data.ctrl[0]
        kept["angle"] = window.frames[-1].qpos[0]
        window.press(UP)
        window.press(HOME)

    def after(window: Any) -> None:
        kept["friction"] = plugin.from_mjcf(window.model)["flexor"].friction
        kept["pretension"] = plugin.from_mjcf(window.model)["flexor"].pretension
        kept["text"] = window.said("pretension")
        window.press(ENTER)

    def again(window: Any) -> None:
        kept["time"] = window.data.time
        kept["laid"] = plugin.from_mjcf(window.model)["flexor"].pretension
        window.press(ESCAPE)

    window = Window({2: wind, 200: look, 300: after, 310: again})
    view(str(file), screen=window)
    assert window.cables == ("flexor",)
    own = window.sliders.model
    names = [own.actuator(place).name for place in range(own.nu)]
    assert names == ["friction", "", "", "friction of cables", "pretension"]
    assert kept["ctrl"] == pytest.approx(0.3)
    assert kept["angle"] == pytest.approx(0.3, abs=0.1)
    assert kept["friction"] == pytest.approx(0.125)
    assert kept["pretension"] == pytest.approx(10.0)
    assert kept["text"] == "as in the scene; 1.25 times the scene's at the next start"
    assert kept["laid"] == pytest.approx(12.5)
    assert kept["time"] < 0.05
    assert np.isfinite(window.frames[-1].qpos).all()
    assert not any("controller" in meaning for _, meaning in window.frames[-1].texts[1])


def test_scene_that_cannot_be_shown_is_refused_in_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "still.xml").write_text("<mujoco><worldbody/></mujoco>")
    (tmp_path / "wrong.xml").write_text("<mujoco><nonsense/></mujoco>")
    for name, said in (
        ("still.xml", "has no joint"),
        ("wrong.xml", "wrong.xml does not load"),
        ("none.xml", "there is no file"),
    ):
        with pytest.raises(CableError, match=said):
            view(str(tmp_path / name))
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert cli.main(["view", "wrst"]) == 2
    assert "did you mean 'wrist'?" in capsys.readouterr().err


def test_a_description_opens_its_scene(tmp_path: Path) -> None:
    scene, description = tmp_path / "mine.xml", tmp_path / "mine.device.toml"
    shutil.copy(scene_path("bench"), scene)
    description.write_text('meaning = "a bench"\n')
    assert read_scene(str(description))[0] == scene
    with pytest.raises(CableError, match=r"did you mean 'wrist'.*its MJCF file"):
        read_scene("wirst")
