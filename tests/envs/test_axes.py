"""Environments of devices with several axes."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from cc_mujoco import CONTROLLERS, simulate
from cc_mujoco.control import axes_controller
from cc_mujoco.device import find_device
from cc_mujoco.errors import CableError
from cc_mujoco.human import TASKS, Hold
from cc_mujoco.simulation import play

SEVERAL = ["exosuit", "bilateral", "hand"]


def make(device: str, **given: Any) -> Any:
    """Return an environment of a device."""
    return gymnasium.make(
        "cc_mujoco/Device-v1", device=device, disable_env_checker=True, **given
    ).unwrapped


@pytest.mark.parametrize("device", SEVERAL)
def test_an_action_and_a_frame_belong_to_every_axis(device: str) -> None:
    env = make(device, duration=0.05)
    axes = find_device(device).description.axes
    assert env.action_space.shape == (len(axes),)
    frame = sum(len(axis.units) for axis in axes)
    assert env.observation_space.shape == (frame,)
    check_env(env, skip_render_check=True)


@pytest.mark.parametrize("device", SEVERAL)
def test_a_vector_is_its_environments_bit_for_bit(device: str) -> None:
    given: dict[str, Any] = {
        "device": device,
        "duration": 0.02,
        "history": 1,
        "randomise": {"friction": (0.05, 0.2), "noise": (0.5, 2.0), "delay": (0, 2)},
    }
    many = gymnasium.make_vec("cc_mujoco/Device-v1", num_envs=2, **given)
    each = [make(**given) for _ in range(2)]
    random = np.random.default_rng(0)
    seen, _ = many.reset(seed=3)
    for row, env in enumerate(each):
        first, _ = env.reset(seed=3 + row)
        assert np.array_equal(seen[row], first)
    for _ in range(15):
        action = random.uniform(-1.0, 1.0, many.action_space.shape).astype(np.float32)
        seen, reward, *_, info = many.step(action)
        for row, env in enumerate(each):
            one, value, *_, own = env.step(action[row])
            assert np.array_equal(seen[row], one)
            assert reward[row] == value
            assert all(np.array_equal(info[name][row], own[name]) for name in own)


def test_the_reward_is_the_mean_over_axes() -> None:
    env = make("exosuit", duration=0.02)
    env.reset(seed=0)
    axes = find_device("exosuit").description.axes
    action = np.array([0.5, -0.25], np.float32)
    *_, info = env.step(action)
    costs = [
        min(
            abs(
                info[f"{axis.name}.joint_torque_nm"]
                - info[f"{axis.name}.desired_torque_nm"]
            )
            / axis.torque_scale,
            10.0,
        )
        for axis in axes
    ]
    assert info["reward_tracking"] == pytest.approx(-1e-3 * np.mean(costs))
    effort = -0.05 * 1e-3 * np.mean(np.square(action))
    assert info["reward_effort"] == pytest.approx(effort)


def test_a_log_is_the_same_from_the_environment_and_from_a_batch() -> None:
    env = make("exosuit", duration=0.05)
    law = axes_controller("pi", env.drives, env.exo.device.prefixes)
    stepped = play(env, law, seed=2)
    alone = simulate("exosuit", "pi", seed=2, duration=0.05)
    together = simulate(["exosuit", "exosuit"], "pi", seed=[2, 5], duration=0.05)
    for name in alone.columns:
        assert np.array_equal(stepped[name], alone[name]), name
        assert np.array_equal(together[0][name], alone[name]), name


def test_an_axis_of_a_log_has_plain_names_and_its_own_facts() -> None:
    log = simulate("exosuit", "none", duration=0.01)
    assert log.axes == ("hip", "ankle")
    ankle = log.axis("ankle")
    assert np.array_equal(ankle["joint_angle_rad"], log["ankle.joint_angle_rad"])
    assert ankle.metadata["driven"] == ["heel"]
    assert ankle.metadata["safe_torque"] == 60.0
    with pytest.raises(CableError, match="name one of them"):
        log.axis()
    with pytest.raises(CableError, match="unknown axis of the log 'anckle'"):
        log.axis("anckle")


def test_controllers_and_tasks_may_differ_by_axis() -> None:
    env = make("exosuit", task={"hip": "transparent", "ankle": Hold(-5.0)})
    assert env.exo.tasks == (TASKS["transparent"], Hold(-5.0))
    text = make("exosuit", task="hip=swing:8,middle=0.5,ankle=hold:-4").exo.tasks
    assert text[1] == Hold(-4.0)
    assert text[0].peak == 8.0
    prefixes = env.exo.device.prefixes
    law: Any = axes_controller("hip=none,ankle=pi", env.drives, prefixes)
    assert [type(one) for one in law.laws] == [CONTROLLERS["none"], CONTROLLERS["pi"]]
    for wrong, message in (
        ("hip=none", "axis 'ankle' has no controller"),
        ({"hipp": "pi", "ankle": "pi"}, "unknown axis 'hipp'"),
        ("hipp=pi,ankle=pi", "unknown axis 'hipp'"),
        ("hip=pi,hip=none,ankle=pi", "axis 'hip' is given twice"),
        ("hip=pi,ankle=pi,knee=pi", r"unknown axis 'knee'\. .*hip"),
        ("pii", "did you mean 'pi'"),
    ):
        with pytest.raises(CableError, match=message):
            axes_controller(wrong, env.drives, prefixes)


def all_axes(drives: Any) -> Any:
    """Return a law that sees all axes."""
    assert len(drives) == 2
    return lambda seen: np.array(
        [0.1 * seen["hip.desired_torque_nm"], 100.0 + 0.0 * seen["ankle.phase_sine"]]
    )


all_axes.ALL_AXES = True  # type: ignore[attr-defined]


def test_a_controller_of_the_user_may_see_all_axes() -> None:
    log = simulate("exosuit", all_axes, duration=0.02)
    hip, ankle = log["hip.motor_torque_nm"], log["ankle.motor_torque_nm"]
    assert hip[-1] == pytest.approx(0.1 * log["hip.desired_torque_nm"][-3], rel=0.05)
    assert ankle[-1] == 15.0, "beyond the limit of its motor"
    both = simulate(["exosuit", "exosuit"], all_axes, seed=[0, 1], duration=0.02)
    assert np.array_equal(both[0]["hip.motor_torque_nm"], hip)


def test_both_legs_walk_half_a_cycle_apart() -> None:
    log = simulate("bilateral", "none", duration=0.5)
    phases = [
        np.arctan2(log[f"{side}_hip.phase_sine"], log[f"{side}_hip.phase_cosine"])
        for side in ("left", "right")
    ]
    difference = np.abs(np.angle(np.exp(1j * (phases[0] - phases[1]))))
    assert difference == pytest.approx(np.pi, abs=1e-6)


@pytest.mark.study
def test_a_model_follows_a_cable_that_other_axes_wind() -> None:
    errors = {}
    for law in ("none", "predictive"):
        log = simulate("exosuit", {"ankle": law, "hip": "none"}, duration=1.6, seed=1)
        own = log.axis("ankle")
        error = (own["joint_torque_nm"] - own["desired_torque_nm"])[800:]
        errors[law] = np.sqrt(np.mean(error**2))
    assert errors["predictive"] < 0.2 * errors["none"]
