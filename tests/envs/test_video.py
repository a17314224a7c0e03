"""Pictures and videos: 30 a second, in real time; the camera needs no OpenGL."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from cc_mujoco.envs import IDS, RecordVideo
from study_marks import study_but

WRIST, SECONDS = "cc_mujoco/WristHandle-v1", 0.3


class Counting:
    """Fake camera whose pictures contain their number."""

    taken = 0

    def __init__(self, model: Any) -> None:
        Counting.taken = 0

    def picture(self, qpos: Any) -> Any:
        Counting.taken += 1
        return np.full((2, 2, 3), Counting.taken % 256, np.uint8)

    def close(self) -> None:
        pass


@pytest.fixture(autouse=True)
def fakes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cc_mujoco.envs._render.Camera", Counting)


@pytest.mark.parametrize(
    ("name", "wrapper", "frame_skip", "hold"),
    study_but(
        2,
        [
            (WRIST, gymnasium.wrappers.RecordVideo, 2, 1),
            (WRIST, gymnasium.wrappers.RecordVideo, 100, 1),
            (WRIST, gymnasium.wrappers.RecordVideo, 2, 5),
            *((name, RecordVideo, 2, 1) for name in IDS),
            (WRIST, RecordVideo, 100, 1),
            (WRIST, RecordVideo, 2, 5),
            (WRIST, RecordVideo, 4, 50),
        ],
    ),
)
def test_a_video_lasts_as_long_as_the_episode(
    name: str,
    wrapper: Any,
    frame_skip: int,
    hold: int,
    tmp_path: Path,
    clips: list[Any],
) -> None:
    about = {"frame_skip": frame_skip, "hold": hold, "render_mode": "rgb_array"}
    env = gymnasium.make(name, duration=SECONDS, **about)
    film = wrapper(env, str(tmp_path / "video"), episode_trigger=lambda episode: True)
    for _ in range(2):
        film.reset(seed=0)
        truncated = False
        while not truncated:
            *_, truncated, _ = film.step(np.zeros(env.action_space.shape, np.float32))
    film.close()
    assert len(clips) == 2
    rate = min(30.0, 1.0 / (0.0005 * frame_skip * hold))
    for clip in clips:
        assert clip.seconds == pytest.approx(SECONDS, abs=1.5 / rate)
        shown = {id(frame) for frame in clip.frames}
        assert len(shown) == pytest.approx(SECONDS * rate, abs=2)
    assert Counting.taken == pytest.approx(2.0 * SECONDS * rate, abs=4)
    if wrapper is RecordVideo:
        assert len(clips[0].frames) == pytest.approx(SECONDS * rate, abs=2)


def test_a_new_episode_and_a_second_look_are_drawn_anew(name: str) -> None:
    env = gymnasium.make(name, duration=1.0, render_mode="rgb_array")
    still = np.zeros(1, np.float32)
    env.reset(seed=0)
    first = env.render()
    assert env.render() is not first, "somebody may have moved the joints"
    env.step(still)
    last = env.render()
    env.step(still)
    assert env.render() is last
    taken = Counting.taken
    env.reset(seed=0)
    env.step(still)
    env.step(still)
    env.render()
    assert Counting.taken == taken + 1
    env.close()


def test_a_vector_environment_draws_as_often(name: str) -> None:
    envs = gymnasium.make_vec(name, 3, duration=0.5, render_mode="rgb_array")
    envs.reset(seed=0)
    for _ in range(200):
        envs.step(np.zeros((3, 1), np.float32))
        assert len(envs.render()) == 3
    assert Counting.taken == pytest.approx(3 * 0.2 * 30, abs=3)
    envs.close()
