"""The shipped bench, a motion of it, and what every effect adds to its torques."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench

Signal = np.ndarray
Torques = tuple[Signal, Signal]

BENCH = Bench.of(scene_path("bench"))
DT = 0.002
TIME = DT * np.arange(500)
JOINT = 0.05 + 0.4 * np.sin(6.9 * TIME) + 0.1 * np.sin(9.0 * TIME)
MOTOR = 0.1 + JOINT + 0.04 * np.sin(10.7 * TIME + 1.0)


def acceleration(angle: Signal) -> Signal:
    """Second derivative by central differences, twice."""
    return np.gradient(np.gradient(angle, DT), DT)


def late(torque: Signal, by: float) -> Signal:
    """Return a torque delayed by `by` seconds, its first value held at the start."""
    return np.interp(TIME - by, TIME, torque)


def alone(folder: Path) -> Path:
    """Return a scene with the agonist of the shipped bench, without instruments."""
    root = ElementTree.parse(BENCH.path).getroot()
    plugins = root.find("extension/plugin")
    assert plugins is not None
    for parent, gone in (
        (plugins, "instance[@name='antagonist']"),
        (root.find("actuator"), "plugin[@instance='antagonist']"),
    ):
        assert parent is not None
        for entry in parent.findall(gone):
            parent.remove(entry)
    for name in ("sensor", "custom"):
        entry = root.find(name)
        assert entry is not None
        root.remove(entry)
    path = folder / "alone.xml"
    ElementTree.ElementTree(root).write(path)
    return path


Formula = Callable[[Signal, Signal], Torques]

EFFECTS: dict[str, tuple[Mapping[str, float], Formula]] = {
    "motor_cogging": (
        {"cogging_cosine": 0.1, "cogging_sine": -0.2, "cogging_order": 7.0},
        lambda m, j: (m + 0.1 * np.cos(7 * MOTOR) - 0.2 * np.sin(7 * MOTOR), j),
    ),
    "joint_gravity": (
        {"gravity_sine": 0.5, "gravity_cosine": -0.3},
        lambda m, j: (m, j - 0.5 * np.sin(JOINT) + 0.3 * np.cos(JOINT)),
    ),
    "joint_stiffness": (
        {"joint_stiffness": 0.7, "joint_stiffness_moment": 0.2},
        lambda m, j: (m, j - 0.7 * JOINT - 0.2),
    ),
    "joint_inertia": (
        {"joint_inertia": 1e-3},
        lambda m, j: (m, j - 1e-3 * acceleration(JOINT)),
    ),
    "motor_inertia": (
        {"motor_inertia": -2.5e-4},
        lambda m, j: (m - 2.5e-4 * acceleration(MOTOR), j),
    ),
    "torque_offset": (
        {"motor_torque_offset": 0.2, "joint_torque_offset": -0.1},
        lambda m, j: (m + 0.2, j - 0.1),
    ),
    "torque_sensor_gain": (
        {"motor_torque_gain": 0.05, "joint_torque_gain": -0.1},
        lambda m, j: (1.05 * m, 0.9 * j),
    ),
    "torque_sensor_offset": (
        {
            "motor_torque_bias": 0.2,
            "joint_torque_bias": -0.3,
            "motor_torque_drift": 0.05,
            "joint_torque_drift": -0.1,
        },
        lambda m, j: (m + 0.2 + 0.05 * TIME, j - 0.3 - 0.1 * TIME),
    ),
    "sensor_cross_talk": (
        {"motor_torque_cross_talk": 0.05, "joint_torque_cross_talk": -0.02},
        lambda m, j: (m + 0.05 * j, j - 0.02 * m),
    ),
    "sensor_delay": (
        {"joint_delay": 0.0, "motor_torque_delay": 0.0, "joint_torque_delay": 0.0053},
        lambda m, j: (m, late(j, 0.0053)),
    ),
}
"""Values, and what the torques with the effect are, from those without."""

MECHANICAL = (
    "motor_cogging",
    "joint_gravity",
    "joint_stiffness",
    "joint_inertia",
    "motor_inertia",
)
