"""Episodes that are watched: what keys do to them, without a window."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numpy as np
import pytest

import cc_mujoco
from cc_mujoco import cli, plugin
from cc_mujoco.control import StictionCompensation, controller
from cc_mujoco.errors import CableError
from cc_mujoco.simulation import play
from cc_mujoco.viz import _live as living
from cc_mujoco.viz import _live_controls as keys
from cc_mujoco.viz import _viewer as viewer
from cc_mujoco.viz._viewer import Frame

Press = Callable[[int], None]
SCENE = "cc_mujoco/WristHandle-v1"


class Window:
    """A screen that presses keys by itself, before a step or at a look while paused."""

    highest = 50.0

    def __init__(
        self, before: Mapping[int, Any], paused: Callable[[Any], None] | None = None
    ) -> None:
        self.before, self.paused = dict(before), paused
        self.step, self.open = 0, True
        self.frames: list[Frame] = []
        self.press: Press = lambda key: None

    def __call__(
        self, model: Any, cables: Any, highest: float, press: Press, sliders: Any
    ) -> Window:
        self.press = press
        assert sliders.model.nq == model.nq
        assert 0.0 < highest < 1e3
        return self

    def __enter__(self) -> Window:
        return self

    def __exit__(self, *_: object) -> None:
        self.open = False

    def push(self, data: Any) -> None:
        self.step += 1
        do = self.before.get(self.step, ())
        for key in do() or () if callable(do) else do:
            self.press(key)

    def show(self, frame: Frame) -> None:
        self.frames.append(frame)
        if self.paused is not None and "paused" in self.said("time"):
            self.paused(self)

    def said(self, name: str) -> str:
        """Return a text of the latest frame by name."""
        return dict(self.frames[-1].texts[0])[name]

    @property
    def note(self) -> str:
        """The sentence below."""
        return " ".join(line for name, line in self.frames[-1].texts[0] if not name)


def make(duration: float = 1.0) -> Any:
    return gymnasium.make(SCENE, disable_env_checker=True, duration=duration)


def tension(env: Any) -> float:
    now = cc_mujoco.read(env.unwrapped.model, env.unwrapped.data, "flexor")
    return now.tension_proximal


def cable(env: Any) -> Any:
    return plugin.from_mjcf(env.unwrapped.model)["flexor"]


def test_untouched_it_is_the_episode_that_is_recorded() -> None:
    env, found = make(), []
    window = Window(
        {
            41: lambda: found.append(env.unwrapped.data.qpos.copy()),
            42: (keys.ESCAPE,),
        }
    )
    living.live(env, "pi", seed=3, screen=window)
    other = make(0.04)
    log = play(other, controller("pi", other.unwrapped.drive), seed=3)
    assert np.array_equal(found[0], log["qpos"][40])
    assert not window.open


def test_friction_acts_at_once_and_pretension_at_the_next_start() -> None:
    env, found = make(), []

    def look() -> None:
        found.append((cable(env).friction, cable(env).pretension, tension(env)))

    window = Window(
        {
            1: look,
            2: (keys.UP, keys.HOME),
            4: look,
            5: (keys.ENTER,),
            6: look,
            7: (keys.DOWN, keys.END, keys.ENTER),
            8: look,
            9: (keys.ESCAPE,),
        }
    )
    living.live(env, "pi", screen=window)
    frictions, pretensions, laid = zip(*found, strict=True)
    assert np.divide(frictions, frictions[0]) == pytest.approx([1, 1.25, 1.25, 1])
    assert np.divide(pretensions, pretensions[0]) == pytest.approx([1, 1, 1.25, 1])
    assert np.divide(laid, laid[0])[[0, 2, 3]] == pytest.approx([1, 1.25, 1], rel=0.01)


def test_more_friction_costs_more() -> None:
    lost = []
    for key in (keys.DOWN, keys.UP):
        env = make()
        living.live(env, "none", screen=Window({2: (key,) * 5, 400: (keys.ESCAPE,)}))
        now = cc_mujoco.read(env.unwrapped.model, env.unwrapped.data, "flexor")
        lost.append(abs(np.log(now.tension_proximal / now.tension_distal)))
    assert lost[1] > 2.0 * lost[0] > 0.0


def test_a_controller_takes_over_in_the_middle() -> None:
    env = make()
    window = Window({20: (keys.RIGHT, keys.SPACE), 21: (keys.ESCAPE,)}, resume)
    living.live(env, "model", screen=window)
    assert window.said("controller") == "stiction"
    assert env.unwrapped.data.time == pytest.approx(0.021)


def resume(window: Window) -> None:
    """Go on after the third look at a pause."""
    if sum("paused" in dict(frame.texts[0])["time"] for frame in window.frames) == 3:
        window.press(keys.SPACE)


def test_while_paused_time_stands_still_and_changes_are_made() -> None:
    env, times = make(), []

    def paused(window: Window) -> None:
        times.append(env.unwrapped.data.time)
        if len(times) == 2:
            window.press(keys.UP)
        if len(times) == 4:
            assert cable(env).friction == pytest.approx(1.25 * 0.21)
            window.press(keys.ESCAPE)

    living.live(env, "pi", screen=Window({5: (keys.SPACE,)}, paused))
    assert times == pytest.approx([0.005] * 4)


def test_an_episode_that_ends_begins_anew() -> None:
    env, times = make(0.01), []
    window = Window({12: lambda: times.append(env.unwrapped.data.time)})
    window.before[13] = (keys.ESCAPE,)
    living.live(env, "pi", screen=window)
    assert times == pytest.approx([0.001])


def test_closing_the_window_ends_it() -> None:
    env = make()
    window = Window({})
    window.before[7] = lambda: setattr(window, "open", False)
    living.live(env, "pi", screen=window)
    assert window.step == 7


def test_a_controller_that_cannot_be_made_leaves_the_other_at_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*_: Any) -> None:
        raise CableError("not with this cable.")

    monkeypatch.setattr(StictionCompensation, "__init__", refuse)
    env, looks = make(), []

    def paused(window: Window) -> None:
        looks.append((window.said("controller"), window.note))
        if len(looks) == 3:
            window.press(keys.ESCAPE)

    keyed = {3: (keys.RIGHT,), 30: (keys.SPACE,)}
    living.live(env, "model", screen=Window(keyed, paused))
    assert looks[-1] == ("model", "not with this cable.")


def test_what_goes_wrong_is_said_and_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    env, notes = make(), []
    data = env.unwrapped.data

    def break_it() -> None:
        data.qvel[:] = np.nan

    def paused(window: Window) -> None:
        notes.append(window.note)
        window.press(keys.ENTER if len(notes) == 1 else keys.ESCAPE)

    window = Window({4: break_it, 6: (keys.SPACE,)}, paused)
    living.live(env, "pi", screen=window)
    assert notes[0].startswith("the simulation diverged at 0.00")
    assert notes[1] == ""  # anew


def test_a_controller_that_there_is_not_opens_no_window() -> None:
    window = Window({})
    with pytest.raises(CableError, match="did you mean 'stiction'"):
        living.live(make(), "stictoin", screen=window)
    assert not window.frames


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--video"], "--video does not go with --live."),
        (["--html"], "--html does not go with --live."),
        (["--out", "here"], "--out does not go with --live."),
        (["--replay", "log.csv"], "--live does not go with --replay."),
    ],
)
def test_a_window_writes_nothing(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["play", "wrist", "--live", *words]) == 2
    assert said in capsys.readouterr().err


def test_the_command_plays_what_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    called: list[Any] = []

    def live(env: Any, name: str, seed: int) -> None:
        inner = env.unwrapped
        called.append((inner.exo.description.scene, inner.exo.steps, name, seed))

    monkeypatch.setattr(viewer, "require_screen", lambda: None)
    monkeypatch.setattr(living, "live", live)
    words = ["play", "finger", "--controller", "none", "--duration", "0.3"]
    assert cli.main([*words, "--seed", "4", "--live"]) == 0
    assert called == [("finger", 300, "none", 4)]
