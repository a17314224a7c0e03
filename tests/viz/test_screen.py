"""Window of a live episode: painted contents, and errors without a screen."""

from __future__ import annotations

import contextlib
import sys
import time
import types
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from cc_mujoco import cli, plugin
from cc_mujoco.assets import scene_path
from cc_mujoco.cable import Cable
from cc_mujoco.errors import CableError
from cc_mujoco.viz import _viewer as screen
from cc_mujoco.viz._live_controls import (
    RIGHT,
    STEP_FACTOR,
    UP,
    Knobs,
    Sliders,
)
from cc_mujoco.viz._viewer import Frame, Screen, require_screen, round_up_tension
from virtual_screen import run_in_a_window

CABLES = ("flexor", "extensor")
TEXTS = (("left", "right"), ("below", "beside")), (("key", "meaning"),)

IN_A_WINDOW = """
import sys, threading, time
import gymnasium, mujoco
from cc_mujoco.viz import _live as live, _viewer as screen
from cc_mujoco.viz._live_controls import ESCAPE, UP

class Watched(screen.Screen):
    def __init__(self, model, cables, highest, press, sliders):
        super().__init__(model, cables, highest, press, sliders)
        def keys():
            while self.painted < 2:
                time.sleep(0.02)
            press(UP)
            while self.painted < 5:
                time.sleep(0.02)
            said.update(self._frame.texts[0], capsules=self._viewer.user_scn.ngeom)
            press(ESCAPE)
        threading.Thread(target=keys, daemon=True).start()

said = {}
env = gymnasium.make("cc_mujoco/WristHandle-v1", disable_env_checker=True)
live.live(env, "pi", screen=Watched)
print(said["friction"], said["capsules"])
"""


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(scene_path("wrist")))


class Viewer:
    """Fake of MuJoCo's viewer without a window."""

    def __init__(self, model: Any, data: Any, **how: Any) -> None:
        self.model, self.data, self.how = model, data, how
        self.cam, self.perturb = mujoco.MjvCamera(), mujoco.MjvPerturb()
        self.user_scn = mujoco.MjvScene(model, 1000)
        self.texts: list[Any] = []
        self.running = True

    def lock(self) -> Any:
        return contextlib.nullcontext()

    def sync(self) -> None:
        pass

    def set_texts(self, texts: list[Any]) -> None:
        self.texts = texts

    def is_running(self) -> bool:
        return self.running

    def close(self) -> None:
        self.running = False


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[Viewer]:
    """Replace MuJoCo's viewer by fakes, and return those opened."""
    found: list[Viewer] = []

    def launch(*given: Any, **how: Any) -> Viewer:
        found.append(Viewer(*given, **how))
        return found[-1]

    fake = types.SimpleNamespace(launch_passive=launch)
    monkeypatch.setattr(screen, "_viewer", lambda *_: fake)
    return found


def until(true: Callable[[], Any]) -> None:
    deadline = time.monotonic() + 20.0
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.002)


def frame(model: mujoco.MjModel, newtons: float) -> Frame:
    nodes = {name: np.full(21, newtons) for name in CABLES}
    return Frame(model.qpos0.copy(), nodes, TEXTS)


def tendons_shown(model: mujoco.MjModel) -> set[int]:
    data, scene = mujoco.MjData(model), mujoco.MjvScene(model, 1000)
    mujoco.mj_fwdPosition(model, data)
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    camera, option = mujoco.MjvCamera(), mujoco.MjvOption()
    mujoco.mjv_updateScene(model, data, option, None, camera, everything, scene)
    tendon = mujoco.mjtObj.mjOBJ_TENDON
    shown = scene.geoms[: scene.ngeom]
    return {geom.objid for geom in shown if geom.objtype == tendon}


def test_cables_are_painted_in_place_of_their_tendons(
    model: mujoco.MjModel, opened: list[Viewer]
) -> None:
    pressed: list[int] = []
    with Screen(model, CABLES, 10.0, pressed.append) as window:
        (viewer,) = opened
        assert viewer.model is not model  # the viewer's thread reads it as it likes
        drawn = [plugin.route_tendon(model, cable) for cable in CABLES]
        assert tendons_shown(model) >= set(drawn)
        assert tendons_shown(viewer.model).isdisjoint(drawn)
        viewer.how["key_callback"](32)
        assert pressed == [32]
        assert window.open and viewer.user_scn.ngeom == 0
        window.show(frame(model, 7.0))
        until(lambda: window.painted > 1)
        geoms = viewer.user_scn.geoms[: viewer.user_scn.ngeom]
        assert len(geoms) >= 2 * 20  # and no more with every frame
        assert {geom.type for geom in geoms} == {mujoco.mjtGeom.mjGEOM_CAPSULE}
        left, below = viewer.texts
        assert left[2:] == ("left\nbelow", "right\nbeside")
        assert below[2:] == ("key", "meaning")
        assert window.highest == 10.0
        cool = np.array(geoms[0].rgba)
        window.show(frame(model, 130.0))
        until(lambda: window.highest == 200.0)
        painted = window.painted
        until(lambda: window.painted > painted + 1)
        assert not np.array_equal(viewer.user_scn.geoms[0].rgba, cool)
    assert not viewer.running


def test_the_mouse_pushes_what_is_simulated(
    model: mujoco.MjModel, opened: list[Viewer]
) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    body = int(np.flatnonzero(model.body_weldid)[-1])
    with Screen(model, CABLES, 10.0, print) as window:
        mouse = opened[0].perturb
        mouse.select, mouse.scale, mouse.localmass = body, 1.0, 1.0
        mouse.active = mujoco.mjtPertBit.mjPERT_TRANSLATE
        mouse.refselpos[:] = data.xpos[body] + [0.0, 0.1, 0.0]
        window.show(frame(model, 1.0))
        until(lambda: window.painted > 1)
        window.push(data)
        assert data.xfrc_applied[body].any()
        mouse.active = 0
        painted = window.painted
        until(lambda: window.painted > painted + 1)
        window.push(data)
        assert not data.xfrc_applied.any()
        data.xfrc_applied[body, 2] = 1.0
        window.push(data)  # a hand that is off leaves others' forces alone
        assert data.xfrc_applied[body, 2] == 1.0


def test_it_looks_on_as_the_first_camera_does(
    model: mujoco.MjModel, opened: list[Viewer]
) -> None:
    with Screen(model, CABLES, 10.0, print):
        camera, shown = opened[0].cam, opened[0].model
        scene = mujoco.MjvScene(shown, 1000)
        data, option = mujoco.MjData(shown), mujoco.MjvOption()
        mujoco.mj_forward(shown, data)
        own = mujoco.MjvCamera()
        own.type, own.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
        seen = []
        for which in (camera, own):
            every = mujoco.mjtCatBit.mjCAT_ALL
            mujoco.mjv_updateScene(shown, data, option, None, which, every, scene)
            eye = scene.camera[0]
            seen.append(np.concatenate([eye.forward, eye.up, [eye.frustum_top]]))
        assert seen[0] == pytest.approx(seen[1], abs=0.01)


def test_sliders_turn_the_knobs_and_follow_the_keys(
    model: mujoco.MjModel, opened: list[Viewer]
) -> None:
    knobs = Knobs({name: Cable() for name in CABLES}, "pi")
    spec = mujoco.MjSpec.from_file(str(scene_path("wrist")))
    sliders = Sliders(knobs, spec)
    with Screen(model, CABLES, 10.0, knobs.press, sliders) as window:
        viewer = opened[0]
        assert viewer.how["show_right_ui"]
        shown = viewer.model
        groups = shown.actuator_group
        names = [shown.actuator(i).name for i in np.flatnonzero(groups != 5)]
        assert names == ["friction", "pretension", "controller"]
        assert shown.nu == model.nu + 3
        window.show(frame(model, 1.0))
        until(lambda: window.painted > 0)
        controls = viewer.data.ctrl
        assert list(controls[-3:-1]) == [1.0, 1.0]
        knobs.press(UP)
        until(lambda: controls[-3] == STEP_FACTOR)
        controls[-2:] = 2.0, 0.4
        first = knobs.sliders[2].low
        until(lambda: knobs.slides[2] == first)
        assert knobs.slides == pytest.approx((STEP_FACTOR, 2.0, first))
        assert controls[-1] == 0.4  # the slider stays under the mouse
        knobs.press(RIGHT)
        until(lambda: controls[-1] == first + 1.0)
        assert controls[-3] == STEP_FACTOR


@pytest.mark.parametrize(
    ("tension", "scale"), [(0.0, 1e-3), (7.0, 10.0), (10.0, 10.0), (10.1, 20.0)]
)
def test_the_scale_of_colours_has_round_ends(tension: float, scale: float) -> None:
    assert round_up_tension(tension) == pytest.approx(scale)


def test_without_a_display_one_sentence_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert cli.main(["play", "wrist", "--live"]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert "--live needs a screen, and neither DISPLAY nor WAYLAND_DISPLAY is" in said
    assert not list(tmp_path.iterdir())


def test_a_display_that_is_none_is_told_with_the_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def opens() -> bool:
        warnings.warn("(65550) b'X11: Failed to open display :9'", stacklevel=1)
        return False

    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("DISPLAY", ":9")
    monkeypatch.setattr(screen, "_viewer", lambda *_: None)
    monkeypatch.setattr(screen, "_opens_window", opens)
    reason = r"does not work \(X11: Failed to open display :9\);"
    with pytest.raises(CableError, match=reason):
        require_screen()


def test_without_glfw_the_sentence_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("DISPLAY", ":9")
    monkeypatch.setitem(sys.modules, "mujoco.viewer", None)
    monkeypatch.delattr(mujoco, "viewer", raising=False)
    with pytest.raises(CableError, match="needs a screen with OpenGL by GLFW"):
        require_screen()


@pytest.mark.parametrize("inside", [False, True])
def test_on_macos_it_takes_mjpython(
    monkeypatch: pytest.MonkeyPatch, inside: bool
) -> None:
    fake = types.SimpleNamespace(_MJPYTHON=object() if inside else None)
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(screen, "_viewer", lambda *_: fake)
    if inside:
        require_screen()
        return
    with pytest.raises(CableError, match=r"`mjpython -m cc_mujoco\.cli` in place"):
        require_screen()


def test_in_a_window_that_is_one_it_runs_and_ends() -> None:
    friction, capsules = run_in_a_window(IN_A_WINDOW).rsplit(" ", 1)
    assert friction == "1.25 times the scene's"
    assert int(capsules) >= 2 * 20  # segments of the cables
