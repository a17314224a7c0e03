"""`Device-v1` on devices of one axis and of several: the contract of Gymnasium."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv

import cc_mujoco  # noqa: F401, registers the environments
from cc_mujoco.envs._render import free_view
from shared_folder import SHARED

ID = "cc_mujoco/Device-v1"
KNEE = SHARED / "cases" / "device" / "knee_exo.xml"
DEVICES = ["exosuit", pytest.param(str(KNEE), marks=pytest.mark.shared, id="knee_exo")]


@pytest.mark.parametrize("device", DEVICES)
def test_a_device_passes_the_checker_of_gymnasium(device: str) -> None:
    env = gymnasium.make(ID, device=device, duration=0.05, disable_env_checker=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Nothing can be drawn on every machine.
        check_env(env.unwrapped, skip_render_check=True)
    inner: Any = env.unwrapped
    axes = len(inner.exo.description.axes)
    assert env.action_space.shape == (axes,)
    assert inner.drives[0].high > 0.0


OWN = Path(__file__).parents[2] / "scripts" / "examples" / "knee_exo.xml"


@pytest.mark.usefixtures("gl")
def test_an_own_device_is_drawn_for_the_checker_and_a_film(
    clips: list[Any], tmp_path: Path
) -> None:
    """It has no camera; a film has as many frames as `render_fps` promises."""
    about: dict[str, Any] = {"device": str(OWN), "duration": 0.1}
    env = gymnasium.make(ID, render_mode="rgb_array", **about)
    check_env(env.unwrapped)
    film = gymnasium.wrappers.RecordVideo(env, str(tmp_path / "film"))
    film.reset(seed=0)
    truncated = False
    while not truncated:
        *_, truncated, _ = film.step(np.zeros(env.action_space.shape, np.float32))
    film.close()
    (clip,) = clips
    assert clip.seconds == pytest.approx(0.1, abs=0.002)
    assert len(clip.frames) == pytest.approx(0.1 * env.metadata["render_fps"], abs=1)
    # Outlines before the sky are of the device, which stands in the middle.
    steps = abs(np.diff(clip.frames[0][:240].astype(int), axis=1)).max(axis=(0, 2))
    outlines = np.flatnonzero(steps > 60)
    assert 200 < outlines.min() < 427 < outlines.max() < 654


def test_a_free_camera_has_the_device_and_not_the_floor_in_view() -> None:
    arm = """<mujoco><worldbody><geom type="plane" size="50 50 1" pos="3 0 0"/>
      {far}<body pos="3 0 1"><joint axis="0 1 0"/>
      <geom type="capsule" size=".02" fromto="0 0 0 .4 0 0"/></body></worldbody>
      </mujoco>"""
    for far, middle in (
        ("", 3.2),
        ('<geom type="box" pos="0 0 1" size="9 9 .1"/>', 3.2),
        ('<geom size=".1" pos="2.9 0 1"/>', 3.1),
    ):
        model = mujoco.MjModel.from_xml_string(arm.format(far=far))
        camera = free_view(model, mujoco.MjData(model))
        assert camera.lookat == pytest.approx([middle, 0.0, 1.0], abs=0.15)
        assert 0.4 < camera.distance < 2.0


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_vector_of_a_device_is_its_single_environments(
    device: str, mode: str
) -> None:
    """Through the ends of episodes and with drawn plants.

    Bit for bit where a scene states all inertias; else the bodies that only draw, which
    a vector environment leaves out, change the last bits.
    """
    close = {"rtol": 0.0, "atol": 0.0 if device == "exosuit" else 1e-6}
    given: dict[str, Any] = {
        "device": device,
        "duration": 0.012,
        "hold": 3,
        "history": 1,
        "memory": True,
        "randomise": {"friction": (0.05, 0.2), "delay": (0, 3), "noise": (1.0, 1.0)},
    }
    autoreset = gymnasium.vector.AutoresetMode(mode)
    many = gymnasium.make_vec(ID, 3, autoreset_mode=mode, **given)
    each = SyncVectorEnv(
        [lambda: gymnasium.make(ID, disable_env_checker=True, **given)] * 3,
        autoreset_mode=autoreset,
    )
    assert many.single_action_space == each.single_action_space
    assert many.single_observation_space == each.single_observation_space
    random = np.random.default_rng(0)
    pair = [env.reset(seed=4) for env in (many, each)]
    assert np.array_equal(pair[0][0], pair[1][0])
    for _ in range(9):
        action = random.uniform(-0.3, 0.3, many.action_space.shape).astype(np.float32)
        pair = [env.step(action) for env in (many, each)]
        for one, other in zip(pair[0][:4], pair[1][:4], strict=True):
            np.testing.assert_allclose(one, other, **close)
    for env in (many, each):
        env.close()


@pytest.mark.shared
def test_a_device_is_made_from_its_id_with_a_file_of_the_user(tmp_path: Path) -> None:
    own = tmp_path / "knee.xml"
    own.write_bytes(KNEE.read_bytes())
    (tmp_path / "knee.device.toml").write_text("[axis]\ntask = 'hold:-3'\n")
    env: Any = gymnasium.make(ID, device=own, duration=0.01).unwrapped
    _, info = env.reset(seed=0)
    assert info["desired_torque_nm"] == -3.0
