"""Keys of a live episode: what they change, and what the screen says of it."""

from __future__ import annotations

import math
from typing import Any

import pytest

from cc_mujoco.cable import Cable
from cc_mujoco.control import CONTROLLERS
from cc_mujoco.viz import _live_controls as keys
from cc_mujoco.viz._live_controls import (
    MAX_STEPS,
    STEP_FACTOR,
    Knobs,
    state_rows,
    wrap_sentence,
)

CABLES = {
    "flexor": Cable(friction=0.2, static_friction=0.3, pretension=10.0),
    "heel": Cable(friction=0.1, pretension=5.0),
}
COLUMNS = {
    "time_s": 1.26,
    "joint_torque_nm": 1.0,
    "desired_torque_nm": 2.0,
    "tension_heel_proximal_n": 12.0,
    "tension_heel_distal_n": 3.0,
}


@pytest.fixture
def knobs() -> Knobs:
    return Knobs(CABLES, "pi")


def told(knobs: Knobs, **other: Any) -> dict[str, str]:
    """Return the texts on the screen by name."""
    how = {"controller": "pi", "pretension": 1.0, "factor": 1.0, "highest": 50.0}
    return dict(state_rows(knobs, COLUMNS, ["heel"], **(how | other)))


def test_untouched_they_give_the_scene(knobs: Knobs) -> None:
    assert knobs.options() == {
        "flexor.friction": 0.2,
        "flexor.static_friction": 0.3,
        "flexor.pretension": 10.0,
        "heel.friction": 0.1,
        "heel.pretension": 5.0,
    }
    assert (knobs.controller, knobs.paused, knobs.restart, knobs.quit) == (
        "pi",
        False,
        False,
        False,
    )


def test_friction_goes_up_and_down_with_that_at_rest(knobs: Knobs) -> None:
    knobs.press(keys.UP)
    knobs.press(keys.UP)
    knobs.press(keys.DOWN)
    options = knobs.options()
    assert options["flexor.friction"] == pytest.approx(0.2 * STEP_FACTOR)
    assert options["flexor.static_friction"] == pytest.approx(0.3 * STEP_FACTOR)
    assert options["heel.friction"] == pytest.approx(0.1 * STEP_FACTOR)
    assert options["heel.pretension"] == 5.0


def test_pretension_is_asked_for_apart_from_the_one_that_is_laid(knobs: Knobs) -> None:
    knobs.press(keys.END)
    assert knobs.options()["heel.pretension"] == pytest.approx(5.0 / STEP_FACTOR)
    assert knobs.options(pretension=1.0)["heel.pretension"] == 5.0


@pytest.mark.parametrize("key", [keys.UP, keys.DOWN, keys.HOME, keys.END])
def test_there_is_an_end_to_every_change(knobs: Knobs, key: int) -> None:
    for _ in range(MAX_STEPS + 5):
        knobs.press(key)
    factor = knobs.friction * knobs.pretension
    assert abs(math.log(factor, STEP_FACTOR)) == pytest.approx(MAX_STEPS)


def test_controllers_follow_each_other_around(knobs: Knobs) -> None:
    names = list(CONTROLLERS)
    after = names[(names.index("pi") + 1) % len(names)]
    knobs.press(keys.RIGHT)
    assert knobs.controller == after
    for _ in names:
        knobs.press(keys.LEFT)
    assert knobs.controller == after


def test_a_controller_from_outside_is_among_them() -> None:
    knobs = Knobs(CABLES, "mine:law")
    assert knobs.controller == "mine:law"
    knobs.press(keys.RIGHT)
    assert knobs.controller == next(iter(CONTROLLERS))
    knobs.press(keys.LEFT)
    assert knobs.controller == "mine:law"


def test_pause_restart_and_quit(knobs: Knobs) -> None:
    knobs.press(keys.SPACE)
    assert knobs.paused
    knobs.press(keys.ENTER)
    assert knobs.restart and not knobs.paused
    knobs.press(keys.ESCAPE)
    assert knobs.quit


def test_any_other_key_means_nothing(knobs: Knobs) -> None:
    before = vars(knobs).copy()
    named = {v for k, v in vars(keys).items() if k.isupper() and isinstance(v, int)}
    for key in set(range(32, 350)) - named:
        knobs.press(key)
    assert vars(knobs) == before


def test_the_screen_says_what_runs(knobs: Knobs) -> None:
    said = told(knobs, factor=0.998)
    assert said["time"] == "1.3 s, 1.00 of real time"
    assert said["controller"] == "pi"
    assert said["friction"] == said["pretension"] == "as in the scene"
    assert said["joint torque"] == "1.00 of 2.00 N m"
    assert said["heel"] == "12.0 N at the motor, 3.0 N at the joint"
    assert said["brightest"].startswith("50 N")
    assert told(knobs, factor=math.nan)["time"] == "1.3 s"


def test_the_screen_says_what_was_changed_and_what_is_to_come(knobs: Knobs) -> None:
    for key in (keys.UP, keys.HOME, keys.SPACE):
        knobs.press(key)
    said = told(knobs)
    assert said["friction"] == "1.25 times the scene's"
    late = "as in the scene; 1.25 times the scene's at the next start"
    assert said["pretension"] == late
    assert told(knobs, pretension=STEP_FACTOR)["pretension"] == "1.25 times the scene's"
    assert said["time"] == "1.3 s, paused"


def test_the_font_of_the_screen_has_all_letters(knobs: Knobs) -> None:
    rows = (*knobs.help, *told(knobs).items())
    assert all(word.isascii() for row in rows for word in row)


def test_a_long_sentence_has_several_lines() -> None:
    assert wrap_sentence("") == ()
    lines = [line for _, line in wrap_sentence("a word " * 30)]
    assert len(lines) > 1 and max(map(len, lines)) <= 60


def test_a_slider_is_a_factor_and_stays_within_its_ends(knobs: Knobs) -> None:
    knobs.slide(0, 2.0)
    knobs.slide(1, 0.0)
    assert knobs.friction == pytest.approx(2.0)
    assert knobs.pretension == pytest.approx(STEP_FACTOR**-MAX_STEPS)
    knobs.press(keys.UP)
    assert knobs.friction == pytest.approx(2.0 * STEP_FACTOR)
    for place in range(len(CONTROLLERS)):
        knobs.slide(2, place + 0.3)
        assert knobs.slides[2] == place
        assert knobs.controller == list(CONTROLLERS)[place]
