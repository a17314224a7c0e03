"""Winding of a cable, as controllers receive it: that of an equivalent round pulley."""

from __future__ import annotations

import dataclasses
from typing import Any

import gymnasium
import numpy as np
import pytest

from cc_mujoco.control import CONTROLLERS, as_round_pulley, controller
from cc_mujoco.device._axis_record import Physics
from cc_mujoco.device._model import DeviceModel, physics_of
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.envs import IDS
from cc_mujoco.errors import CableError
from cc_mujoco.simulation._wiring import Wiring

WRIST, ANKLE, EXOSUIT = (name for name, device in IDS.items() if device != "finger")


def walked(name: str, steps: int = 600) -> tuple[Any, dict[str, np.ndarray]]:
    """Return an environment, and the columns of its first axis at constant torque."""
    env: Any = gymnasium.make(name).unwrapped
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape, np.float32)
    action[0] = 0.2
    log = [env.exo.axis_columns(env.step(action)[-1], 0) for _ in range(steps)]
    columns = {n: np.array([info[n] for info in log]) for n in log[0] if n != "qpos"}
    return env, columns


def test_on_a_round_pulley_it_is_the_joint() -> None:
    env, log = walked(WRIST, 50)
    assert np.array_equal(log["winding_angle_rad"], log["joint_angle_rad"])
    assert np.array_equal(log["winding_velocity_rad_s"], log["joint_velocity_rad_s"])
    assert (log["leverage_ratio"] == 1.0).all()
    assert env.drives[0].crossed == ()


def test_at_a_lever_tension_times_leverage_is_the_torque() -> None:
    env, log = walked(ANKLE)
    arm = env.drives[0].cables[0].distal
    ((cable,),) = env.exo.device.driven
    pull = -arm * log["leverage_ratio"] * log[f"tension_{cable}_distal_n"]
    assert np.ptp(log["leverage_ratio"]) > 0.005
    assert pull == pytest.approx(log["joint_torque_nm"], rel=1e-6, abs=1e-6)
    assert env.drives[0].crossed == ()


@pytest.mark.parametrize("name", [ANKLE, EXOSUIT])
def test_the_angle_moves_with_the_velocity(name: str) -> None:
    env, log = walked(name)
    angle, velocity = log["winding_angle_rad"], log["winding_velocity_rad_s"]
    between = 0.5 * (velocity[1:] + velocity[:-1]) * env.exo.period
    assert np.diff(angle) == pytest.approx(between, abs=2e-5)
    assert np.ptp(angle) > 0.03


def test_a_cable_over_two_joints_is_wound_by_both_and_says_so() -> None:
    env, log = walked(EXOSUIT)
    off = log["winding_angle_rad"] - log["joint_angle_rad"]
    assert env.drives[0].crossed == ("knee",)
    assert np.ptp(off) > 0.2
    for name in set(CONTROLLERS) & {"model", "stiction", "predictive", "disturbance"}:
        law = controller(name, env.drives[0])
        seen = {n: v[-1] for n, v in log.items() if n not in WINDING_COLUMNS}
        with pytest.raises(CableError, match="joint knee winds the cables too"):
            law.torque(seen)


def test_several_devices_are_read_with_their_own_arms() -> None:
    env, _ = walked(ANKLE, 5)
    exo, longer = env.exo, DeviceModel(env.exo.description, env.model)
    (axis,) = longer.axes
    axis.winding = axis.winding._replace(arm=2.0 * axis.winding.arm)
    wiring = Wiring(exo, [exo.device, longer], 2)
    for row in range(2):
        wiring.seat(row, exo.author.write(np.random.default_rng(0)))
    now = physics_of(env.data)
    both = Physics(*(np.repeat(field[None], 2, axis=0) for field in now))
    found = wiring.columns(wiring.read(both, np.full(2, 5)))
    for name, value in exo.device.axes[0].winding.read(now).items():
        assert np.array_equal(found[name], value * np.array([1.0, 0.5]))


def test_torques_and_motion_are_those_of_a_round_pulley() -> None:
    env, log = walked(ANKLE, 3)
    seen = {name: values[-1] for name, values in log.items()}
    seen["leverage_ratio"] = 0.5
    found = as_round_pulley(seen, env.drives[0])
    assert found["joint_torque_nm"] == 2.0 * seen["joint_torque_nm"]
    assert found["desired_torque_nm"] == 2.0 * seen["desired_torque_nm"]
    assert found["joint_angle_rad"] == seen["winding_angle_rad"]
    assert found["motor_angle_rad"] == seen["motor_angle_rad"]
    bare = {name: value for name, value in seen.items() if name not in WINDING_COLUMNS}
    with pytest.raises(CableError, match="pull a lever"):
        as_round_pulley(bare, env.drives[0])
    assert (
        as_round_pulley(bare, dataclasses.replace(env.drives[0], lever=False)) is bare
    )
    crossing = dataclasses.replace(env.drives[0], crossed=("hip", "knee"))
    with pytest.raises(CableError, match="joint hip, knee winds"):
        as_round_pulley(bare, crossing)
