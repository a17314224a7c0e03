"""The single environments: Gymnasium's contract, documented numbers, repeatability."""

from __future__ import annotations

import copy
import inspect
import json
import pickle
import re
import subprocess
import sys
from itertools import cycle
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from cc_mujoco import envs, plugin
from cc_mujoco.assets import scene_path
from cc_mujoco.control import CONTROLLERS
from cc_mujoco.device import find_device
from cc_mujoco.device._sensors import MEASURED_COLUMNS
from cc_mujoco.envs import IDS, DeviceEnv, DeviceVectorEnv, WalkingEnv
from cc_mujoco.envs._render import Camera
from cc_mujoco.errors import CableError
from cc_mujoco.human import (
    TASKS,
    TRAJECTORIES,
    Pace,
    Paced,
    Perturbed,
    Sine,
    Spring,
    Walk,
    Wearer,
)
from cc_mujoco.human import _gait as gait
from cc_mujoco.simulation import columns_for

WRIST, ANKLE = "cc_mujoco/WristHandle-v1", "cc_mujoco/AnkleExo-v1"


def cables_of(env: gymnasium.Env[Any, Any]) -> tuple[str, ...]:
    """Names of the cables of an environment."""
    return plugin.cables(env.unwrapped.model)


def roll(env: gymnasium.Env[Any, Any], steps: int, seed: int = 0) -> list[Any]:
    """Reset, then step with random actions; all that came back."""
    random = np.random.default_rng(9)
    seen: list[Any] = [env.reset(seed=seed)]
    for _ in range(steps):
        seen.append(env.step(random.uniform(-1, 1, 1).astype(np.float32)))
    return seen


def same(a: Any, b: Any) -> bool:
    """Equality to the bit of whatever environments return."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, (list, tuple)):
        return len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and np.array_equal(a, b)


def test_gymnasium_has_nothing_to_complain_about(name: str) -> None:
    env = gymnasium.make(name, duration=0.5)
    check_env(env.unwrapped, skip_render_check=True)


def test_all_names_are_imported_without_a_training_library() -> None:
    code = (
        "import sys\n"
        "sys.modules |= dict.fromkeys(('rsl_rl', 'stable_baselines3', 'torch'))\n"
        "from cc_mujoco.envs import *\n"
        "assert DeviceVectorEnv and save_policy and 'RslRl' not in globals()\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=300)


@pytest.mark.usefixtures("gl")
def test_gymnasium_has_nothing_to_complain_about_rendering() -> None:
    env = gymnasium.make(WRIST, duration=0.5, render_mode="rgb_array")
    check_env(env.unwrapped)
    env.close()


@pytest.mark.usefixtures("gl")
def test_rendering_shows_the_pose_and_does_not_touch_the_simulation() -> None:
    drawn = gymnasium.make(WRIST, duration=1.0, render_mode="rgb_array")
    plain = gymnasium.make(WRIST, duration=1.0)
    drawn.reset(seed=0)
    plain.reset(seed=0)
    first = drawn.render()
    assert first.dtype == np.uint8
    assert first.shape[2] == 3
    assert first.std() > 10
    action = np.ones(1, dtype=np.float32)
    for _ in range(300):
        a, b = drawn.step(action), plain.step(action)
        if drawn.unwrapped.data.time < 0.002:
            drawn.render()
        assert same(a, b)
    assert not np.array_equal(first, drawn.render())
    drawn.close()


@pytest.mark.usefixtures("gl")
def test_a_video_is_written_without_a_screen(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    env = gymnasium.make(WRIST, duration=0.2, hold=5, render_mode="rgb_array")
    film = envs.RecordVideo(env, str(tmp_path))
    roll(film, 40)
    film.close()
    (written,) = tmp_path.glob("*.mp4")
    assert written.stat().st_size > 1000


def test_random_actions_stay_finite_and_inside_the_spaces(name: str) -> None:
    env = gymnasium.make(name, duration=0.25)
    random = np.random.default_rng(2)
    env.reset(seed=0)
    for _ in range(600):
        action = random.uniform(-1, 1, 1).astype(np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        assert observation in env.observation_space
        assert np.isfinite(observation).all()
        assert np.isfinite(reward)
        assert all(np.isfinite(value).all() for value in info.values())
        assert not terminated
        if truncated:
            env.reset()


def test_observations_are_of_the_size_of_one(name: str) -> None:
    env = gymnasium.make(name, duration=2.0)
    law = CONTROLLERS["pi"](env.unwrapped.drive)
    seen, info = env.reset(seed=0)
    frames, truncated = [], False
    while not truncated:
        action = env.unwrapped.action(law.torque(info))
        seen, _, _, truncated, info = env.step(action)
        frames.append(seen)
    sizes = np.sqrt(np.mean(np.square(frames), axis=0))
    assert (sizes[:4] > 0.05).all()
    assert (sizes < 3.0).all()


def test_info_is_a_fresh_log_row_of_floats_and_own_arrays(name: str) -> None:
    env = gymnasium.make(name, duration=0.1)
    rows = [row[-1] for row in roll(env, 20)]
    columns = columns_for(cables_of(env))
    for row in rows:
        assert {column.name for column in columns} | {
            "reward_tracking",
            "reward_effort",
            "reward_smoothness",
        } == row.keys()
        for column in columns:
            value = row[column.name]
            if column.listed:
                assert value.dtype == column.dtype
                assert not np.shares_memory(value, env.unwrapped.data.plugin_state)
                assert not np.shares_memory(value, env.unwrapped.data.qpos)
            else:
                assert type(value) is float
    assert len({id(row) for row in rows}) == len(rows)
    assert rows[0]["time_s"] == 0.0
    assert rows[20]["time_s"] == pytest.approx(0.02)


def test_info_agrees_with_the_engine(name: str) -> None:
    env = gymnasium.make(name, duration=0.4)
    model, data = env.unwrapped.model, env.unwrapped.data
    info = roll(env, 150)[-1][-1]
    for cable in cables_of(env):
        reading = plugin.read(model, data, cable)
        assert info[f"tension_{cable}_proximal_n"] == reading.tension_proximal
        assert info[f"tension_{cable}_distal_n"] == reading.tension_distal
        assert info[f"moving_{cable}_fraction"] == reading.moving_fraction
        assert info[f"slack_{cable}_m"] == reading.slack
        assert info[f"dissipated_{cable}_j"] == reading.dissipated > 0.0
        assert np.array_equal(info[f"tension_{cable}_nodes_n"], reading.tension)
        assert np.array_equal(info[f"slip_{cable}_direction"], reading.slip)
    assert np.array_equal(info["qpos"], data.qpos)
    assert info["motor_torque_nm"] == data.actuator("motor").force[0]
    assert info["wearer_torque_nm"] == data.actuator("wearer").force[0]


def test_joint_torque_of_the_wrist_is_radius_times_tension_difference() -> None:
    for row in roll(gymnasium.make(WRIST, duration=0.4), 150):
        info = row[-1]
        pull = info["tension_flexor_distal_n"] - info["tension_extensor_distal_n"]
        assert info["joint_torque_nm"] == pytest.approx(0.104 * pull, abs=1e-12)


def test_a_taut_ankle_cable_pulls_into_plantarflexion() -> None:
    env = gymnasium.make(ANKLE, duration=0.5)
    env.reset(seed=0)
    for _ in range(300):
        *_, info = env.step(env.unwrapped.action(20.0))
    lever = -info["joint_torque_nm"] / info["tension_plantarflexor_distal_n"]
    assert 0.1 < lever < 0.14
    assert info["joint_torque_nm"] < -20.0


@pytest.mark.parametrize(("frame_skip", "smoothness"), [(2, 0.0), (6, 0.25)])
def test_rewards_are_the_documented_sum_per_second(
    frame_skip: int, smoothness: float
) -> None:
    for device in ("wrist", "ankle", "finger"):
        scale = find_device(device).description.axis().torque_scale
        env = gymnasium.make(
            "cc_mujoco/Device-v1",
            device=device,
            duration=0.2,
            frame_skip=frame_skip,
            smoothness=smoothness,
        )
        period, before = 0.0005 * frame_skip, 0.0
        env.reset(seed=0)
        for action in (-3.0, -0.4, 0.0, 0.7):
            _, reward, _, _, info = env.step(np.full(1, action, np.float32))
            error = abs(info["joint_torque_nm"] - info["desired_torque_nm"])
            used = float(np.float32(min(max(action, -1.0), 1.0)))
            tracking = -period * min(error / scale, 10.0)
            assert info["reward_tracking"] == pytest.approx(tracking)
            assert info["reward_effort"] == pytest.approx(-period * 0.05 * used**2)
            change = -smoothness * abs(used - before)
            assert info["reward_smoothness"] == pytest.approx(change)
            terms = [info[f"reward_{n}"] for n in ("tracking", "effort", "smoothness")]
            assert reward == terms[0] + terms[1] + terms[2]
            before = used


def test_the_first_change_of_an_episode_is_from_nothing() -> None:
    env = gymnasium.make(WRIST, duration=0.1, smoothness=1.0)
    for _ in range(2):
        env.reset(seed=0)
        for change in (0.5, 0.0):
            *_, info = env.step(np.full(1, 0.5, np.float32))
            assert info["reward_smoothness"] == -change


@pytest.mark.parametrize("vector", [False, True])
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"foo": 1}, r"unknown argument 'foo'\. Available: .*smoothness, task"),
        ({"smoothness": True}, "smoothness must be a number in .*not True"),
        ({"durration": 1.0}, "did you mean 'duration'"),
        ({"smoothness": -1.0}, "smoothness must be a number in"),
    ],
)
def test_arguments_that_are_none_are_one_sentence(
    vector: bool, given: Any, message: str
) -> None:
    with pytest.raises(CableError, match=message) as raised:
        gymnasium.make_vec(WRIST, 2, **given) if vector else gymnasium.make(
            WRIST, **given
        )
    assert str(raised.value).endswith(".")


def test_a_frame_is_what_the_documentation_says(name: str) -> None:
    env = gymnasium.make(name, duration=0.2)
    device = find_device(IDS[name]).description.axis()
    units, ratio = [*device.units.values()], env.unwrapped.drive.ratio
    for row in roll(env, 100):
        seen, info = row[0], row[-1]
        joint, desired = info["joint_angle_rad"], info["desired_torque_nm"]
        frame = [
            info["motor_angle_rad"] / ratio - joint,
            info["motor_velocity_rad_s"] / ratio,
            joint,
            info["joint_velocity_rad_s"],
            desired - info["joint_torque_nm"],
            desired,
            *((info["phase_sine"], info["phase_cosine"]) if len(units) > 6 else ()),
        ]
        wanted = np.clip(np.array(frame) / units, -10.0, 10.0)
        assert seen == pytest.approx(wanted, rel=1e-6, abs=1e-9)
    assert env.observation_space.shape == seen.shape == (len(units),)
    assert env.observation_space.dtype == np.float32


@pytest.fixture(scope="module")
def walked() -> tuple[gymnasium.Env[Any, Any], list[Any]]:
    """Return the ankle environment and its results over more than two strides."""
    env = gymnasium.make(ANKLE, duration=3.0)
    return env, roll(env, 2500)


def test_the_gait_phase_of_the_ankle_runs_with_the_walk(
    walked: tuple[gymnasium.Env[Any, Any], list[Any]],
) -> None:
    env, rows = walked
    seen = np.array([row[0][6:] for row in rows])
    angle = np.unwrap(np.arctan2(seen[:, 0], seen[:, 1]))
    period = TRAJECTORIES["walk"].period  # type: ignore[attr-defined]
    late = angle[-1] - angle[-501]
    assert late == pytest.approx(2 * np.pi * 500 * env.unwrapped.exo.period / period)


def test_an_action_is_a_torque_of_the_motor(name: str) -> None:
    env = gymnasium.make(name, duration=0.2)
    env.reset(seed=0)
    drive = env.unwrapped.drive
    for share in (-2.0, -0.5, 0.25, 1.0):
        wanted = share * drive.high
        *_, info = env.step(env.unwrapped.action(wanted))
        limited = min(max(wanted, drive.low), drive.high)
        assert info["motor_torque_nm"] == pytest.approx(limited, rel=1e-6)


def test_the_drive_tells_the_ideal_ratio() -> None:
    wrist = gymnasium.make(WRIST).unwrapped.drive
    assert (wrist.ratio, wrist.low, wrist.high) == (pytest.approx(5.2), -1.0, 1.0)
    assert (wrist.period, wrist.one_way) == (0.001, False)
    ankle = gymnasium.make(ANKLE).unwrapped.drive
    assert ankle.ratio == pytest.approx(-4.8, rel=0.05)
    assert ankle.one_way


def test_an_episode_starts_at_rest_with_every_cable_at_pretension(name: str) -> None:
    shifted = Sine(amplitude=0.2)
    for trajectory in (None, shifted, "reach"):
        chosen = {} if trajectory is None else {"trajectory": trajectory}
        env = gymnasium.make(name, duration=1.0, **chosen)
        _, info = env.reset(seed=0)
        model = env.unwrapped.model
        for cable, config in plugin.from_mjcf(model).items():
            nodes = info[f"tension_{cable}_nodes_n"]
            assert np.array_equal(nodes, np.full_like(nodes, config.pretension))
            assert info[f"moving_{cable}_fraction"] == 0.0
            assert info[f"dissipated_{cable}_j"] == 0.0
        assert info["joint_angle_rad"] == info["reference_angle_rad"]
        assert info["joint_velocity_rad_s"] == info["motor_velocity_rad_s"] == 0.0


def test_a_start_away_from_the_middle_strains_no_cable(tmp_path: Path) -> None:
    file = tmp_path / "held.csv"
    lines = [f"{time},{0.25}" for time in range(6)]
    file.write_text("time_s,angle_rad\n" + "\n".join(lines) + "\n")
    for name, device in IDS.items():
        if device == "exosuit":
            continue
        env = gymnasium.make(name, trajectory=str(file), duration=0.2)
        _, info = env.reset(seed=0)
        assert info["joint_angle_rad"] == 0.25
        assert abs(info["motor_angle_rad"]) > 0.3
        still = env.unwrapped.action(0.0)
        if device == "wrist":
            for _ in range(100):
                *_, info = env.step(still)
            assert info["joint_angle_rad"] == pytest.approx(0.25, abs=1e-6)
            assert info["tension_flexor_distal_n"] == pytest.approx(10.0, abs=1e-3)
            assert info["dissipated_flexor_j"] == pytest.approx(0.0, abs=1e-6)


def test_equal_seeds_give_equal_episodes_and_others_do_not(name: str) -> None:
    make = {"trajectory": "multisine", "duration": 0.15}
    a, b = gymnasium.make(name, **make), gymnasium.make(name, **make)
    first = roll(a, 150, seed=4)
    assert same(first, roll(b, 150, seed=4))
    assert same(first, roll(a, 150, seed=4)), "something of the first episode stayed"
    other = roll(b, 150, seed=5)
    assert not same(first, other)


@pytest.mark.parametrize("seed", [1.5, np.int64(3), [1, 2.5], [np.int64(1), 2]])
def test_a_seed_of_a_vector_is_refused_as_that_of_one(seed: Any) -> None:
    name = "cc_mujoco/WristHandle-v1"
    env = gymnasium.make_vec(name, 2, vectorization_mode="vector_entry_point")
    with pytest.raises(gymnasium.error.Error, match="must be a python integer"):
        env.reset(seed=seed)
    env.close()


def test_episodes_of_one_seed_differ_where_the_trajectory_is_random() -> None:
    env = gymnasium.make(WRIST, trajectory="multisine", duration=0.2)
    ends = []
    for seed in (4, None, None):
        env.reset(seed=seed)
        truncated = False
        while not truncated:
            *_, truncated, info = env.step(np.zeros(1, np.float32))
        ends.append(info["reference_angle_rad"])
    assert len(set(ends)) == 3


def test_pickled_environments_continue_the_line(name: str) -> None:
    env = gymnasium.make(name, duration=0.1, task=Spring(2.0)).unwrapped
    again = pickle.loads(pickle.dumps(env))
    assert same(roll(env, 50), roll(again, 50))


@pytest.mark.parametrize("nominal", [False, True])
def test_a_copy_goes_on_from_the_same_step_to_the_bit(name: str, nominal: bool) -> None:
    make: dict[str, Any] = {"duration": 0.2, "trajectory": "multisine", "hold": 2}
    make["smoothness"] = 0.1
    ranges = {
        "friction": (0.02, 0.1),
        "wearer": (0.8, 1.2),
        "delay": (3, 3),
        "noise": (1, 1),
    }
    env = gymnasium.make(
        name, randomise=None if nominal else ranges, history=2, memory=True, **make
    )
    never = copy.deepcopy(env)
    with pytest.raises(gymnasium.error.ResetNeeded):
        never.step(np.zeros(1, np.float32))
    env.reset(options={"friction": 0.03})
    roll(env, 20)
    twin = copy.deepcopy(env)
    both = []
    random = np.random.default_rng(3).uniform(-1, 1, (100, 1)).astype(np.float32)
    for one in (env, twin):  # one after the other: nothing is shared
        seen = [one.step(action) for action in random[:80]]
        assert seen[-1][3]
        seen += [one.reset(), *(one.step(action) for action in random[80:])]
        both.append(seen)
    assert same(*both)
    assert twin.unwrapped.plant.values == env.unwrapped.plant.values


def test_a_copy_of_what_was_changed_by_hand_is_refused() -> None:
    env = gymnasium.make(WRIST, duration=0.1)
    env.reset(seed=0)
    env.unwrapped.model.opt.gravity[2] = 0.0
    with pytest.raises(CableError, match="give the changed model as the argument"):
        copy.deepcopy(env)


@pytest.mark.parametrize(("skip", "hold"), [(1, 1), (2, 1), (3, 2), (4, 5)])
def test_a_step_takes_what_the_drive_says(skip: int, hold: int) -> None:
    env = gymnasium.make(WRIST, duration=0.1, frame_skip=np.int64(skip), hold=hold)
    env = env.unwrapped
    env.reset(seed=0)
    for step in (1, 2):
        info = env.step(np.zeros(1, np.float32))[-1]
        assert info["time_s"] == pytest.approx(step * env.drive.period)
        assert env.data.time == pytest.approx(step * env.drive.period)
    assert env.drive.period == pytest.approx(5e-4 * skip * hold)
    env.model.opt.timestep = 1e-3
    with pytest.raises(CableError, match=r"0\.001 s now.*`frame_skip`"):
        env.reset()


def test_a_variant_of_the_scene_is_played_and_pickled() -> None:
    spec = mujoco.MjSpec.from_file(str(scene_path("wrist")))
    for cable, config in plugin.from_mjcf(spec).items():
        plugin.to_mjcf(spec, cable, config.replace(pretension=25.0))
    env = gymnasium.make(WRIST, duration=0.1, model=spec.compile()).unwrapped
    first = roll(env, 50)
    assert first[0][-1]["tension_extensor_proximal_n"] == 25.0
    assert same(first, roll(pickle.loads(pickle.dumps(env)), 50))


def test_the_specification_is_json_and_makes_the_same_environment(name: str) -> None:
    env = gymnasium.make(name, duration=0.2, trajectory="chirp")
    text = env.spec.to_json()
    json.loads(text)
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(text))
    assert same(roll(env, 50), roll(again, 50))


@pytest.mark.parametrize("frame_skip", [1, 2, 5])
def test_the_frame_skip_is_the_control_period(name: str, frame_skip: int) -> None:
    env = gymnasium.make(name, duration=0.1, frame_skip=frame_skip)
    env.reset(seed=0)
    steps, truncated = 0, False
    while not truncated:
        *_, truncated, info = env.step(np.zeros(1, np.float32))
        steps += 1
    assert steps == round(0.1 / (0.0005 * frame_skip))
    assert info["time_s"] == pytest.approx(0.1)
    assert env.unwrapped.data.time == pytest.approx(0.1)
    assert env.unwrapped.metadata["render_fps"] == round(2000 / frame_skip)


@pytest.mark.parametrize(
    ("trajectory", "task"),
    [
        (trajectory, task)
        for (trajectory, task) in zip(TRAJECTORIES, cycle(TASKS), strict=False)
    ],
)
def test_every_trajectory_and_every_task_plays(
    name: str, trajectory: str, task: str
) -> None:
    joint = find_device(IDS[name]).description.axis().joint
    if trajectory == "walk" and joint not in gait.GAIT_ANGLES:
        trajectory = "sweep"
    env = gymnasium.make(name, trajectory=trajectory, task=task, duration=0.05)
    law = CONTROLLERS["pi"](env.unwrapped.drive)
    _, info = env.reset(seed=1)
    truncated = False
    while not truncated:
        measured = {column: info[column] for column in MEASURED_COLUMNS}
        action = env.unwrapped.action(law.torque(measured))
        observation, _, terminated, truncated, info = env.step(action)
        assert not terminated
        assert observation in env.observation_space


def test_the_wearer_follows_the_reference_the_stiffer_the_closer() -> None:
    errors = []
    for wearer in (None, Wearer(500.0, 4.0), Wearer(5000.0, 10.0)):
        env = gymnasium.make(WRIST, trajectory="sweep", duration=0.8, wearer=wearer)
        rows = [row[-1] for row in roll(env, 800)]
        errors.append(
            max(
                abs(row["joint_angle_rad"] - row["reference_angle_rad"]) for row in rows
            )
        )
    assert errors[0] > 5 * errors[1] > 25 * errors[2]
    assert errors[2] < 0.003


def test_hip_and_knee_walk_along(
    walked: tuple[gymnasium.Env[Any, Any], list[Any]],
) -> None:
    env, rows = walked
    qpos = np.array([row[-1]["qpos"] for row in rows])
    model = env.unwrapped.model
    hip, knee = (qpos[:, model.joint(name).qposadr[0]] for name in ("hip", "knee"))
    assert np.ptp(hip) > 0.5
    assert np.ptp(knee) > 0.8


@pytest.mark.parametrize(
    ("name", "low", "high"), [(WRIST, 0.1, 1.0), (ANKLE, 1.0, 6.0)]
)
def test_feedback_tracks_better_than_none(name: str, low: float, high: float) -> None:
    errors = {}
    for law in ("none", "pi"):
        env = gymnasium.make(name, task="transparent", duration=1.0)
        drive = CONTROLLERS[law](env.unwrapped.drive)
        _, info = env.reset(seed=0)
        squares, truncated = [], False
        while not truncated:
            action = env.unwrapped.action(drive.torque(info))
            *_, truncated, info = env.step(action)
            squares.append(info["joint_torque_nm"] ** 2)
        errors[law] = np.sqrt(np.mean(squares))
    assert errors["pi"] < 0.7 * errors["none"]


def test_an_unstable_simulation_ends_the_episode(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo logs its warning to a file
    # Far stiffer than the time step allows.
    wearer = Wearer(stiffness=1e9, damping=0.0)
    env = gymnasium.make(WRIST, trajectory="sine", wearer=wearer).unwrapped
    clean = env.reset(seed=0)
    terminated = False
    while not terminated:
        result = env.step(np.ones(1, np.float32))
        observation, reward, terminated, truncated, _ = result
        assert np.isfinite(observation).all()
        assert np.isfinite(reward)
        assert not truncated
    assert same(clean, env.reset(seed=0))
    *_, terminated, _, _ = env.step(np.zeros(1, np.float32))
    assert not terminated, "a trace of the instability"


def test_an_action_that_is_no_number_is_refused(name: str) -> None:
    env = gymnasium.make(name, duration=0.1).unwrapped
    env.reset(seed=0)
    for bad in (np.nan, np.inf):
        with pytest.raises(CableError, match="finite"):
            env.step(np.full(1, bad, np.float32))


@pytest.mark.parametrize(
    ("kind", "task", "said"),
    [
        ("wrist", "spring", ""),
        ("wrist", "transparent", ""),
        ("wrist", "assist", r"-30 to 0 N m at joint 'wrist', .* -5.2 to 5.2 N m"),
        ("wrist", Spring(50.0), "-20 to 20 N m"),
        ("ankle", "assist", ""),
        ("ankle", "spring", r"-0.3 to 0.3 N m at joint 'ankle', .* -240 to 0 N m"),
    ],
)
def test_a_task_beyond_the_motor_is_told_with_both_torques(
    kind: Any, task: Any, said: str
) -> None:
    trajectory = "walk" if kind == "ankle" and task == "assist" else "sweep"
    env = DeviceEnv(kind, trajectory=trajectory, task=task, duration=5.0)
    env.reset(seed=0)
    assert re.search(said, env.beyond()) if said else env.beyond() == ""


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (0.5, r"shape \(1,\).*not of shape \(\)"),
        (np.float32(0.5), r"not of shape \(\)"),
        (np.zeros(2), r"not of shape \(2,\)"),
        (np.zeros((1, 1)), r"not of shape \(1, 1\)"),
        (np.zeros(0), r"not of shape \(0,\)"),
        ([[0.5], [0.5, 0.5]], r"array of shape \(1,\)"),
        (["strong"], "must be of numbers"),
        (np.array([1j]), "must be of numbers"),
        (None, r"not of shape \(\)"),
    ],
)
def test_an_action_of_another_shape_or_kind_is_one_sentence(
    name: str, action: Any, words: str
) -> None:
    env = gymnasium.make(name, duration=0.1).unwrapped
    env.reset(seed=0)
    with pytest.raises(CableError, match=words) as raised:
        env.step(action)
    assert str(raised.value).endswith(".")
    env.step([0.5])


@pytest.mark.parametrize(
    ("argument", "value", "message"),
    [
        ("trajectory", "sweeep", "did you mean 'sweep'"),
        ("trajectory", "missing.csv", r"cannot read .*missing\.csv"),
        ("trajectory", Sine(amplitude=3.0), "must stay in"),
        ("trajectory", 3, "trajectory must be"),
        ("task", "tunel", "did you mean 'tunnel'"),
        ("task", 3, "task must be"),
        ("duration", 0.0, "duration must be"),
        ("duration", -1.0, "duration must be"),
        ("duration", float("nan"), "duration must be"),
        ("duration", float("inf"), "duration must be"),
        ("duration", "long", "duration must be"),
        ("frame_skip", 0, "frame_skip must be"),
        ("frame_skip", 1.5, "frame_skip must be"),
        ("frame_skip", True, "frame_skip must be"),
        ("wearer", "strong", "wearer must be"),
        ("render_mode", "ansi", "human, rgb_array"),
        ("model", "x", "model must be a mujoco.MjModel, not 'x'"),
    ],
)
@pytest.mark.parametrize("kind", ["wrist", "ankle"])
def test_bad_arguments_are_one_sentence(
    kind: Any, argument: str, value: Any, message: str
) -> None:
    with pytest.raises(CableError, match=message) as raised:
        DeviceEnv(kind, **{argument: value}).reset(seed=0)
    assert str(raised.value).endswith(".")


@pytest.mark.parametrize("make", [DeviceEnv, DeviceVectorEnv, WalkingEnv])
def test_every_argument_of_another_kind_is_one_sentence(make: Any) -> None:
    usual = {DeviceEnv: {"device": "wrist"}, WalkingEnv: {}}.get(
        make, {"device": "wrist", "num_envs": 1}
    )
    taken = [p.name for p in inspect.signature(make).parameters.values()]
    for name in (name for name in taken if name not in ("unknown", "memory")):
        with pytest.raises(CableError):
            make(**{**usual, name: object()})


@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_a_device_of_ones_own_has_to_be_given(make: Any) -> None:
    with pytest.raises(CableError, match="no device is given"):
        make("cc_mujoco/Device-v1")


def test_stepping_before_reset_is_refused() -> None:
    with pytest.raises(gymnasium.error.ResetNeeded):
        DeviceEnv("wrist").step(np.zeros(1, np.float32))


@pytest.mark.parametrize("motion", ["walk", Perturbed(Walk(), "ankle")])
def test_a_joint_that_does_not_walk_is_not_made_to(motion: Any) -> None:
    for device in (find_device("wrist").description, find_device("finger").description):
        joint = device.axis().joint
        wrong = f"a walk moves .*'{joint}'; choose another trajectory"
        with pytest.raises(CableError, match=wrong):
            DeviceEnv(device.scene, trajectory=motion)


def test_help_by_name_has_the_pace_of_the_walk_as_in_a_what_if() -> None:
    for scene, joint in (("ankle", "ankle"), ("exosuit", "hip")):
        quick = DeviceEnv(scene, trajectory=Walk.at(1.6)).exo.tasks[0]
        pace = Pace(1.6)
        own = TASKS[{"ankle": "assist", "hip": "swing"}[joint]]
        assert quick == Paced(own, pace, pace.moment(joint))
        shaken = Perturbed(Walk.at(1.6))
        assert DeviceEnv(scene, trajectory=shaken).exo.tasks[0] == quick
        given = DeviceEnv(scene, trajectory=Walk.at(1.6), task=own)
        assert given.exo.tasks[0] is own
        assert DeviceEnv(scene).exo.tasks[0] is own


@pytest.mark.parametrize("vector", [False, True])
def test_an_info_read_late_is_that_of_its_step(vector: bool) -> None:
    """Columns are computed when they are read, of the step that returned them."""

    def play(read_at_once: bool) -> list[dict[str, Any]]:
        make = gymnasium.make_vec if vector else gymnasium.make
        env = make("cc_mujoco/WristHandle-v1", duration=0.02)
        _, info = env.reset(seed=3)
        infos = [info]
        for _ in range(12):
            if read_at_once:
                dict(infos[-1])
            infos.append(env.step(env.action_space.sample() * 0 + 0.3)[-1])
        env.close()
        return infos

    for late, early in zip(play(False), play(True), strict=True):
        if not vector:
            numbers = json.loads(json.dumps(late, default=np.ndarray.tolist))
            assert numbers["time_s"] == early["time_s"]
        assert "joint_velocity_rad_s" in late
        assert list(late) == list(early)
        for name, value in pickle.loads(pickle.dumps(late)).items():
            assert np.array_equal(value, early[name]), name
        assert {**late}.keys() == copy.deepcopy(late).keys() == late.keys()


def test_an_episode_that_is_over_asks_for_a_reset() -> None:
    env = gymnasium.make("cc_mujoco/AnkleExo-v1", duration=0.01).unwrapped
    env.reset(seed=0)
    while not env.step(np.zeros(1, np.float32))[3]:
        pass
    for _ in range(2):
        with pytest.raises(gymnasium.error.ResetNeeded, match="over"):
            env.step(np.zeros(1, np.float32))
    env.reset()
    env.step(np.zeros(1, np.float32))


def test_a_picture_without_opengl_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """MuJoCo ends the process where a second window is tried."""
    tries = []

    def refuse(*_: object) -> None:
        tries.append(1)
        raise mujoco.FatalError("no OpenGL\ncontext")

    monkeypatch.setattr(mujoco, "Renderer", refuse)
    monkeypatch.setattr(Camera, "_refusal", "")
    for _ in range(2):
        env = gymnasium.make(WRIST, render_mode="rgb_array")
        env.reset(seed=0)
        with pytest.raises(CableError, match="set MUJOCO_GL=egl"):
            env.render()
    assert len(tries) == 1
