"""Vector environments in mujoco_warp: those of MuJoCo but for rounding."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import warp as wp

import cc_mujoco  # noqa: F401, registers the environments
from cc_mujoco.assets import scene_path
from cc_mujoco.errors import CableError

ID, COUNT = "cc_mujoco/Device-v1", 3
# Where friction drops at break-away, rounding decides in which step that is.
DRAWN: dict[str, Any] = {
    "friction": (0.05, 0.2),
    "break_away": (1, 1),
    "wrap": (5, 9),
    "viscous_friction": (1, 3),
    "wearer": (0.5, 2),
    "delay": (0, 3),
    "noise": (0, 2),
}


def gathered(info: dict[str, Any], name: str) -> np.ndarray:
    """Return the column `name` of all axes, joined."""
    keys = [key for key in info if key[0] != "_" and key.endswith(name)]
    return np.concatenate([info[key].reshape(len(info[key]), -1) for key in keys], 1)


def make(backend: str, **given: Any) -> Any:
    chosen = {"device": "wrist", "hold": 2, "autoreset_mode": "Disabled", **given}
    env = gymnasium.make_vec(ID, COUNT, backend=backend, **chosen)
    return env.unwrapped


@pytest.fixture(scope="module")
def env() -> Iterator[Any]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wp.config, "optimization_level", 0)
        yield make("warp", duration=0.08, randomise=DRAWN)


def play(env: Any, steps: int, seed: int = 0) -> list[Any]:
    random, found = np.random.default_rng(seed), []
    for _ in range(steps):
        actions = random.uniform(-0.4, 0.4, env.action_space.shape)
        found.append(env.step(actions.astype(np.float32)))
    return found


def test_an_episode_is_that_of_mujoco_but_for_rounding(env: Any) -> None:
    other = make("mujoco", duration=0.08, randomise=DRAWN)
    (seen, info), (right, told) = env.reset(seed=5), other.reset(seed=5)
    assert [plant.values for plant in env.plants] == [
        plant.values for plant in other.plants
    ]
    np.testing.assert_array_equal(seen, right)
    for key, value in told.items():
        np.testing.assert_array_equal(info[key], value)
    largest: dict[str, float] = {}
    for ours, theirs in zip(play(env, 40), play(other, 40), strict=True):
        np.testing.assert_allclose(ours[0], theirs[0], rtol=0, atol=2e-5)
        np.testing.assert_allclose(ours[1], theirs[1], rtol=0, atol=2e-8)
        np.testing.assert_array_equal(ours[2], theirs[2])
        np.testing.assert_array_equal(ours[3], theirs[3])
        assert ours[4].keys() == theirs[4].keys()
        for key, value in theirs[4].items():
            error = np.abs(np.subtract(ours[4][key], value, dtype=float)).max()
            largest[key] = max(largest.get(key, 0.0), float(error))
    assert theirs[3].all()
    assert largest["joint_angle_rad"] < 1e-7
    assert largest["tension_flexor_nodes_n"] < 3e-4
    assert largest["dissipated_flexor_j"] < 3e-7
    assert largest["time_s"] == largest["reference_angle_rad"] == 0.0


def test_a_partial_reset_leaves_the_others_bit_for_bit(env: Any) -> None:
    runs = []
    for masked in (False, True):
        env.reset(seed=1)
        play(env, 10)
        if masked:
            mask = np.array([False, True, False])
            seen, _ = env.reset(seed=[None, 1, None], options={"reset_mask": mask})
            assert np.isfinite(seen).all()
        runs.append(play(env, 10, seed=1))
    for whole, part in zip(*runs, strict=True):
        np.testing.assert_array_equal(whole[0][[0, 2]], part[0][[0, 2]])
        np.testing.assert_array_equal(whole[1][[0, 2]], part[1][[0, 2]])
        assert (whole[0][1] != part[0][1]).any()


def test_an_episode_does_not_depend_on_the_one_before(env: Any) -> None:
    runs = []
    for seed in (1, 2, 1):
        env.reset(seed=seed)
        runs.append(np.stack([step[0] for step in play(env, 8)]))
    np.testing.assert_array_equal(runs[0], runs[2])
    assert (runs[0] != runs[1]).any()


def test_a_sample_that_is_replayed_is_that_of_its_steps(
    env: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    worlds, runs = env.simulations, []
    for _ in range(2):
        env.reset(seed=1)
        runs.append(np.stack([step[0] for step in play(env, 8)]))
        monkeypatch.setattr(worlds, "_take_sample", worlds._step_sample)
    np.testing.assert_array_equal(*runs)


def test_a_world_that_diverges_ends_alone(env: Any) -> None:
    env.reset(seed=1)
    play(env, 3)
    right = play(env, 2)
    env.reset(seed=1)
    play(env, 3)
    velocities = env.simulations.data.qvel.numpy()
    velocities[1] = 1e30
    env.simulations.data.qvel.assign(velocities)
    seen, reward, terminated, truncated, _ = play(env, 1)[0]
    assert terminated.tolist() == [False, True, False]
    assert not truncated.any()
    assert np.isfinite(seen).all() and np.isfinite(reward).all()
    np.testing.assert_array_equal(seen[[0, 2]], right[0][0][[0, 2]])


def test_tensions_are_on_the_device_without_a_copy(env: Any) -> None:
    env.reset(seed=1)
    (step,) = play(env, 1)
    tensions = env.simulations.cables.tensions
    assert isinstance(tensions, wp.array)
    found = step[4]["tension_flexor_proximal_n"]
    np.testing.assert_array_equal(tensions.numpy()[:, 0, 0], found)


def test_a_term_that_is_not_in_the_kernel_is_refused(env: Any) -> None:
    with pytest.raises(CableError, match=r"grease_drag is off.*`randomise`"):
        env.reset(seed=1, options={"grease_drag": 1.0})


def test_an_own_device_goes_through_autoresets_as_in_mujoco(tmp_path: Path) -> None:
    scene = Path(scene_path("wrist"))
    (tmp_path / "mine.xml").write_bytes(scene.read_bytes())
    table = scene.with_name("wrist_handle.device.toml").read_text("utf-8")
    (tmp_path / "mine.toml").write_text(
        table.replace('task = "tunnel"', 'task = "spring"'), "utf-8"
    )
    given = {
        "device": str(tmp_path / "mine.toml"),
        "duration": 0.008,
        "autoreset_mode": "SameStep",
        "randomise": DRAWN,
    }
    ours, theirs = make("warp", **given), make("mujoco", **given)
    np.testing.assert_array_equal(ours.reset(seed=2)[0], theirs.reset(seed=2)[0])
    for (seen, _, _, over, info), (right, _, _, due, told) in zip(
        play(ours, 9), play(theirs, 9), strict=True
    ):
        np.testing.assert_allclose(seen, right, rtol=0, atol=2e-5)
        np.testing.assert_array_equal(over, due)
        if due.any():
            np.testing.assert_array_equal(seen, right)
            for last, due_last in zip(
                info["final_obs"], told["final_obs"], strict=True
            ):
                np.testing.assert_allclose(last, due_last, rtol=0, atol=2e-5)
    assert [p.values for p in ours.plants] == [p.values for p in theirs.plants]


@pytest.mark.study
@pytest.mark.parametrize(
    ("device", "limit", "duration"),
    [("wrist", 1e-2, 4.0), ("ankle", 1e-3, 4.0), ("endoscope", 1e-3, 4.0)]
    + [(device, 1e-3, 1.0) for device in ("finger", "exosuit", "hand", "bilateral")],
)
def test_a_whole_episode_agrees(device: str, limit: float, duration: float) -> None:
    given = {"device": device, "duration": duration, "hold": 1}
    ours, theirs = make("warp", **given), make("mujoco", **given)
    ours.reset(seed=0), theirs.reset(seed=0)
    angles, returns = [], np.zeros((2, COUNT))
    shift = np.arange(COUNT)[:, None]
    for step in range(theirs.exo.steps):
        wave = np.sin(4.0 * step * theirs.exo.period + shift)
        actions = np.broadcast_to(0.1 * wave, theirs.action_space.shape)
        results = [env.step(actions.astype(np.float32)) for env in (ours, theirs)]
        angles.append([gathered(result[4], "joint_angle_rad") for result in results])
        returns += [result[1] for result in results]
    assert np.diff(angles, axis=1).std() < limit * np.abs(angles).max()
    np.testing.assert_allclose(*returns, rtol=limit)


@pytest.mark.parametrize(
    ("given", "what"),
    [
        ({"backend": "mjx"}, "backend"),
        ({"backend": "warp", "threads": 2}, "threads are of backend='mujoco'"),
    ],
)
def test_arguments_that_cannot_be_are_refused(given: dict[str, Any], what: str) -> None:
    with pytest.raises(CableError, match=what):
        make(**given)


@pytest.mark.parametrize(
    ("option", "what"),
    [
        ('integrator="RK4"', "not RK4"),
        ('integrator="implicitfast" solver="PGS"', "PGS is unsupported"),
    ],
)
def test_a_device_that_mujoco_warp_cannot_have_is_named(
    tmp_path: Path, option: str, what: str
) -> None:
    text = Path(scene_path("wrist")).read_text("utf-8")
    scene = tmp_path / "mine.xml"
    scene.write_text(text.replace('integrator="implicitfast"', option), "utf-8")
    with pytest.raises(CableError, match=rf"mine.xml' cannot .*='warp': .*{what}"):
        make("warp", device=str(scene))
