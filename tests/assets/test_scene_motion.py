"""The shipped scenes in motion: stable at the shipped step, strong enough, slack."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import pytest

import cc_mujoco.plugin  # noqa: F401  (registers the plugin)
from cc_mujoco.assets import scene_path

STIFFEST = {"wrist": "15000", "ankle": "200000"}


def load(scene: str, **changes: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Load a scene with some keys of its cables changed."""
    root = ElementTree.parse(scene_path(scene)).getroot()
    for key, value in changes.items():
        for entry in root.findall(f".//instance/config[@key='{key}']"):
            entry.set("value", value)
    text = ElementTree.tostring(root, encoding="unicode")
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def cable_forces(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Tensions of all cable ends, in the order of the sensors."""
    names = [model.sensor(i).name for i in range(model.nsensor)]
    return np.array(
        [abs(data.sensor(name).data[0]) for name in names if "tension" in name]
    )


@pytest.mark.parametrize("scene", STIFFEST)
def test_the_stiffest_sensible_cable_is_stable_under_random_torque(scene: str) -> None:
    model, data = load(scene, axial_stiffness=STIFFEST[scene])
    rng = np.random.default_rng(1)
    torque = model.actuator("motor").ctrlrange[1]
    for step in range(6000):
        if step % 150 == 0:
            data.actuator("motor").ctrl[0] = rng.uniform(-torque, torque)
            data.actuator("wearer").ctrl[0] = rng.uniform(-0.3, 0.3)
        mujoco.mj_step(model, data)
    assert np.isfinite(data.qpos).all()
    assert all(warning.number == 0 for warning in data.warning)
    # Left alone, everything comes to rest: nothing is fed by the time step.
    data.ctrl[:] = 0
    mujoco.mj_step(model, data, 8000)
    assert np.abs(data.qvel[1:]).max() < 1e-3
    before = data.qpos[1:].copy()
    mujoco.mj_step(model, data, 2000)
    np.testing.assert_allclose(data.qpos[1:], before, atol=1e-3)


def test_the_motor_flexes_the_wrist_past_the_break_through() -> None:
    model, data = load("wrist", static_friction="0")
    for torque in np.linspace(0, 1, 2000):
        data.actuator("motor").ctrl[0] = torque
        mujoco.mj_step(model, data)
    proximal, distal, slack_proximal, slack_distal = cable_forces(model, data)
    assert data.qpos[0] > 0.1
    assert data.qpos[1] > 0.005
    assert proximal / distal == pytest.approx(np.exp(0.21 * 2 / 0.28), rel=0.05)
    assert slack_proximal < 1
    assert slack_distal < 5


def test_a_hundred_newton_metres_reach_the_ankle() -> None:
    model, data = load("ankle")
    for torque in np.linspace(0, 34, 2000):
        data.actuator("motor").ctrl[0] = torque
        mujoco.mj_step(model, data)
    mujoco.mj_step(model, data, 500)
    proximal, distal = cable_forces(model, data)
    assert 0.12 * distal > 100
    assert proximal < 2000  # rope of this size breaks above 8 kN
    assert data.joint("ankle").qpos[0] < 0


def test_paying_out_the_rope_frees_the_ankle() -> None:
    model, data = load("ankle")
    data.actuator("motor").ctrl[0] = -1
    for angle in np.linspace(0, 0.3, 3000):
        data.actuator("wearer").ctrl[0] = angle
        mujoco.mj_step(model, data)
    assert data.joint("ankle").qpos[0] > 0.28
    assert cable_forces(model, data).max() == 0
    assert data.joint("motor").qpos[0] > -8.5
