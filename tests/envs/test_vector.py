"""The vector environments: equal to `SyncVectorEnv` to the bit, whatever happens."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorEnv

from cc_mujoco.control import CONTROLLERS
from cc_mujoco.envs import IDS, DeviceVectorEnv
from cc_mujoco.errors import CableError
from cc_mujoco.human import TASKS, Pace, Paced, Profile, Walk, Wearer
from study_marks import study_but

COUNT = 5
WRIST = "cc_mujoco/WristHandle-v1"


def equal(a: Any, b: Any) -> None:
    """Assert that two results of reset or step agree in values and types."""
    assert len(a) == len(b)
    for x, y in zip(a, b, strict=True):
        if isinstance(x, dict):
            assert x.keys() == y.keys()
            equal(list(x.values()), [y[key] for key in x])
        elif x is None:
            assert y is None
        elif x.dtype == object:
            equal(list(x), list(y))
        else:
            assert x.dtype == y.dtype
            assert np.array_equal(x, y)


def pair(name: str, threads: int = 0, **given: Any) -> tuple[VectorEnv, VectorEnv]:
    """Return our vector environment of an id, and Gymnasium's."""
    return (
        gymnasium.make_vec(name, COUNT, threads=threads, **given),
        gymnasium.make_vec(name, COUNT, vectorization_mode="sync", **given),
    )


def march(a: VectorEnv, b: VectorEnv, steps: int) -> int:
    """Step both with equal random actions; return how many episodes ended."""
    random = np.random.default_rng(0)
    ended = 0
    for _ in range(steps):
        actions = random.uniform(-1.2, 1.2, a.action_space.shape).astype(np.float32)
        ours, theirs = a.step(actions), b.step(actions)
        equal(ours, theirs)
        ended += int((ours[2] | ours[3]).sum())
    return ended


@pytest.mark.parametrize(
    ("name", "trajectory", "threads"),
    study_but(2, [(WRIST, "reversals", 1), *((name, "multisine", 2) for name in IDS)]),
)
def test_it_equals_sync_through_autoresets(
    name: str, trajectory: str, threads: int
) -> None:
    a, b = pair(name, threads, trajectory=trajectory, duration=0.01)
    equal(a.reset(seed=3), b.reset(seed=3))
    assert march(a, b, 36) == 3 * COUNT
    equal(a.reset(seed=[7, None, 1, 1, 2**31]), b.reset(seed=[7, None, 1, 1, 2**31]))
    march(a, b, 15)
    equal(a.reset(), b.reset())
    march(a, b, 5)


@pytest.mark.parametrize("mode", ["SameStep", "Disabled"])
def test_it_equals_sync_in_the_other_autoreset_modes(mode: str) -> None:
    given = {"trajectory": "multisine", "duration": 0.01}
    a = gymnasium.make_vec(WRIST, COUNT, autoreset_mode=mode, **given)
    b = gymnasium.make_vec(
        WRIST,
        COUNT,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": AutoresetMode(mode)},
        **given,
    )
    assert a.metadata["autoreset_mode"] is AutoresetMode(mode)
    equal(a.reset(seed=3), b.reset(seed=3))
    if mode == "SameStep":
        assert march(a, b, 25) == 2 * COUNT
        return
    assert march(a, b, 10) == COUNT
    with pytest.raises(gymnasium.error.ResetNeeded, match="environments 0, 1, 2"):
        a.step(np.zeros((COUNT, 1), np.float32))
    for mask in ([1, 0, 1, 1, 0], [0, 1, 0, 0, 1]):
        chosen = np.array(mask, dtype=np.bool_)
        seeds = [5, 6, None, 8, 9]
        equal(
            a.reset(seed=seeds, options={"reset_mask": chosen}),
            b.reset(seed=seeds, options={"reset_mask": chosen}),
        )
    assert march(a, b, 9) == 0


@pytest.mark.parametrize(
    "options",
    [
        {"frictoin": 0.2},
        {"reset_mask": np.zeros(2, dtype=np.bool_)},
        {"reset_mask": [1, 1]},
        {"reset_mask": np.array([True, False])},
    ],
    ids=["unknown", "none", "no bool", "never reset"],
)
def test_options_that_mean_nothing_are_refused(options: dict[str, Any]) -> None:
    many = gymnasium.make_vec(WRIST, 2, duration=0.01)
    with pytest.raises(CableError, match=r"option|unknown variation"):
        many.reset(options=options)
    with pytest.raises(CableError, match="unknown variation"):
        gymnasium.make(WRIST, duration=0.01).reset(options=options)


def test_an_autoreset_mode_that_is_none_is_refused() -> None:
    with pytest.raises(CableError, match="autoreset_mode must be one of NextStep"):
        gymnasium.make_vec(WRIST, 2, autoreset_mode="Never")


def test_it_equals_sync_over_a_long_episode(name: str) -> None:
    a, b = pair(name, duration=0.45, frame_skip=9)
    equal(a.reset(seed=0), b.reset(seed=0))
    assert march(a, b, 105) == COUNT


def test_it_equals_sync_where_episodes_end_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo logs its warnings to a file
    # Just too stiff for the time step: unstable at a time that depends on the motion.
    wearer = Wearer(stiffness=80e3, damping=0.0)
    a, b = pair(WRIST, trajectory="multisine", duration=0.05, wearer=wearer)
    equal(a.reset(seed=1), b.reset(seed=1))
    random = np.random.default_rng(0)
    seen = set()
    for _ in range(120):
        actions = random.uniform(-1, 1, (COUNT, 1)).astype(np.float32)
        ours, theirs = a.step(actions), b.step(actions)
        equal(ours, theirs)
        seen.add(tuple(ours[2] | ours[3]))
    assert len(seen) > 5


def test_it_equals_sync_under_a_time_limit() -> None:
    a, b = pair(WRIST, duration=0.1, max_episode_steps=7)
    equal(a.reset(seed=0), b.reset(seed=0))
    assert march(a, b, 30) == 3 * COUNT


@pytest.mark.study
def test_it_equals_async_in_spawned_processes() -> None:
    a = gymnasium.make_vec(WRIST, 1, trajectory="reach", duration=0.02)
    b = gymnasium.make_vec(
        WRIST,
        1,
        vectorization_mode="async",
        vector_kwargs={"context": "spawn"},
        trajectory="reach",
        duration=0.02,
    )
    try:
        equal(a.reset(seed=3), b.reset(seed=3))
        for _ in range(50):
            actions = np.full((1, 1), 0.3, np.float32)
            equal(a.step(actions), b.step(actions))
    finally:
        b.close()


def test_it_is_what_make_vec_makes_and_says_what_it_is(name: str) -> None:
    env = gymnasium.make_vec(name, 3)
    assert isinstance(env, DeviceVectorEnv)
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert env.spec is not None
    single = gymnasium.make(name)
    assert env.single_observation_space == single.observation_space
    assert env.single_action_space == single.action_space
    assert env.observation_space.shape == (3, *single.observation_space.shape)
    observation, _ = env.reset(seed=0)
    assert observation in env.observation_space
    env.close()
    env.close()


def test_results_are_the_callers_own(name: str) -> None:
    env = gymnasium.make_vec(name, 2, duration=1.0)
    observation, info = env.reset(seed=0)
    kept = observation.copy(), {key: value.copy() for key, value in info.items()}
    env.step(np.ones((2, 1), np.float32))
    equal((observation, info), kept)
    for value in info.values():
        value[...] = 1
    again = gymnasium.make_vec(name, 2, duration=1.0)
    again.reset(seed=0)
    actions = np.ones((2, 1), np.float32)
    again.step(actions)
    equal(env.step(actions), again.step(actions))


def test_controllers_drive_all_environments_at_once(name: str) -> None:
    env = gymnasium.make_vec(name, 3, trajectory="reversals", duration=0.2)
    single = gymnasium.make(name, trajectory="reversals", duration=0.2)
    many = CONTROLLERS["pi"](env.unwrapped.drive)
    one = CONTROLLERS["pi"](single.unwrapped.drive)
    _, infos = env.reset(seed=5)
    _, info = single.reset(seed=7)
    for _ in range(150):
        *_, infos = env.step(env.unwrapped.action(many.torque(infos)))
        *_, info = single.step(single.unwrapped.action(one.torque(info)))
        assert infos["joint_torque_nm"][2] == info["joint_torque_nm"]


def test_a_pickled_vector_environment_gives_the_same(name: str) -> None:
    env = gymnasium.make_vec(name, 2, duration=0.1).unwrapped
    copy = pickle.loads(pickle.dumps(env))
    equal(env.reset(seed=0), copy.reset(seed=0))
    actions = np.full((2, 1), 0.5, np.float32)
    equal(env.step(actions), copy.step(actions))


def test_what_is_only_seen_is_there_only_to_be_rendered(name: str) -> None:
    simulated, drawn = (
        gymnasium.make_vec(name, 1, render_mode=mode).unwrapped.model
        for mode in (None, "rgb_array")
    )
    assert (simulated.nq, simulated.nv, simulated.nu) == (drawn.nq, drawn.nv, drawn.nu)
    assert simulated.nlight == simulated.nmat == 0
    assert simulated.ngeom < drawn.ngeom
    assert simulated.nbody <= drawn.nbody


@pytest.mark.usefixtures("gl")
def test_pictures_are_those_of_the_single_environments() -> None:
    given = {"duration": 0.5, "render_mode": "rgb_array"}
    a = gymnasium.make_vec(WRIST, 2, **given)
    b = gymnasium.make(WRIST, **given)
    a.reset(seed=0)
    b.reset(seed=1)
    for _ in range(200):
        a.step(np.ones((2, 1), np.float32))
        b.step(np.ones(1, np.float32))
    pictures = a.render()
    assert len(pictures) == 2
    assert np.array_equal(pictures[1], b.render())
    a.close()
    b.close()


@pytest.mark.parametrize(
    ("argument", "value"),
    [("num_envs", 0), ("num_envs", 2.0), ("threads", -1), ("render_mode", "human")],
)
def test_bad_arguments_are_refused(name: str, argument: str, value: Any) -> None:
    given = {"num_envs": 2, argument: value}
    with pytest.raises(CableError, match=argument.replace("_", "[_ ]")):
        gymnasium.make_vec(name, **given)


def test_bad_calls_are_refused(name: str) -> None:
    env = gymnasium.make_vec(name, 2)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros((2, 1), np.float32))
    env.reset(seed=0)
    with pytest.raises(CableError, match="finite"):
        env.step(np.array([[0.0], [np.nan]], np.float32))
    for bad in (0.5, np.zeros(2), np.zeros(1), np.zeros((1, 1)), np.zeros((2, 2))):
        with pytest.raises(CableError, match=r"shape \(2, 1\)"):
            env.step(bad)
    with pytest.raises(CableError, match="seed"):
        env.reset(seed=[1, 2, 3])


@pytest.mark.parametrize(
    ("name", "given"),
    [
        (
            "cc_mujoco/AnkleExo-v1",
            {"trajectory": Walk.at(1.5), "task": Profile(peak_time=50.0)},
        ),
        (
            "cc_mujoco/HipKneeExosuit-v2",
            {"trajectory": Walk.at(0.8), "task": Paced(TASKS["swing"], Pace(0.8))},
        ),
    ],
)
def test_another_speed_and_profile_are_the_same_in_both(
    name: str, given: dict[str, Any]
) -> None:
    ours, theirs = pair(name, duration=0.2, **given)
    equal(ours.reset(seed=0), theirs.reset(seed=0))
    march(ours, theirs, 201)
    ours.close()
    theirs.close()
