"""Readings of the devices' controllers: encoder resolution, noise, delay."""

from __future__ import annotations

import math
import types
from typing import Any

import gymnasium
import numpy as np
import pytest

import cc_mujoco  # noqa: F401
from cc_mujoco.device import (
    PERFECT_SENSING,
    TENSION_COLUMN,
    Measuring,
    Sensing,
    Sensors,
)
from cc_mujoco.device._sensors import MEASURED_COLUMNS
from cc_mujoco.errors import CableError


def readings(sensing: Sensing, seeds: tuple[int, ...], steps: int = 30) -> list[Any]:
    """Return the measurements of a wrist that the motor turns."""
    env = gymnasium.make_vec("cc_mujoco/WristHandle-v1", len(seeds), threads=1)
    wrist = env.unwrapped
    drive = sensing.equip(wrist.drive)
    measuring = Measuring(sensing, drive, ("flexor", "extensor"), seeds, steps)
    _, info = env.reset(seed=0)
    found = []
    for _ in range(steps):
        found.append((info, measuring.measure(info)))
        *_, info = env.step(wrist.action(np.full(len(seeds), 0.5)))
    env.close()
    return found


def test_perfect_sensors_tell_the_truth() -> None:
    for info, seen in readings(PERFECT_SENSING, (0, 1)):
        for name in MEASURED_COLUMNS:
            assert np.array_equal(seen[name], info[name])
        assert seen[TENSION_COLUMN].shape == (2, 2, 3)
        assert np.array_equal(
            seen[TENSION_COLUMN][:, 1, 2], info["tension_extensor_distal_n"]
        )


def test_encoders_step_and_measurements_are_late() -> None:
    coarse = Sensing(0.0, 0.0, motor_steps=100.0, joint_steps=0.0, delay=3)
    rows = readings(coarse, (0,))
    for _, seen in rows:
        count = seen["motor_angle_rad"] * 100.0 / (2.0 * math.pi)
        assert count == pytest.approx(np.round(count), abs=1e-9)
    for late, early in zip(rows[3:], rows, strict=False):
        assert late[1]["joint_angle_rad"] == early[0]["joint_angle_rad"]


def test_a_seed_is_the_same_noise_in_any_company() -> None:
    sensing = Sensing(0.1, 1.0)
    together, alone = readings(sensing, (4, 7)), readings(sensing, (7,))
    for (_, many), (_, one) in zip(together, alone, strict=True):
        assert many["joint_torque_nm"][1] == one["joint_torque_nm"][0]
        assert np.array_equal(many[TENSION_COLUMN][1], one[TENSION_COLUMN][0])
    noise = [
        seen["joint_torque_nm"] - info["joint_torque_nm"] for info, seen in together
    ]
    assert np.std(noise[5:]) > 0.03


DRIVE: Any = types.SimpleNamespace(
    commands_angle=False,
    period=1e-3,
    sensors=2 * (Sensors((0, 12, 25), (1.0,) * 3),),
    shared_ratios={},
)
CABLES = "flexor", "extensor"


def columns(values: Any) -> dict[str, Any]:
    """Return columns of wrists at which everything has the same value, by wrist."""
    values = np.asarray(values, dtype=float)
    found: dict[str, Any] = {name: values.copy() for name in MEASURED_COLUMNS}
    nodes = np.repeat(values[..., None], 26, axis=-1)
    return found | {f"tension_{cable}_nodes_n": nodes for cable in CABLES}


def test_each_wrist_has_its_own_delay() -> None:
    measuring = Measuring(
        PERFECT_SENSING, DRIVE, CABLES, (0, 1, 2), 50, delay=(0, 1, 3)
    )
    for step in range(9):
        seen = measuring.measure(columns([step] * 3))
        late = max(step - 1, 0), max(step - 3, 0)
        assert list(seen["joint_angle_rad"]) == [step, *late]
        assert np.array_equal(seen["joint_angle_rad"], seen[TENSION_COLUMN][:, 1, 2])


def test_the_tension_of_a_slack_cable_is_0_before_the_noise() -> None:
    measuring = Measuring(Sensing(0.0, 1.0, delay=0), DRIVE, CABLES, 0, 400)
    found = np.array(
        [measuring.measure(columns(-50.0))[TENSION_COLUMN] for _ in range(400)]
    )
    assert found.min() == 0.0
    assert np.mean(found > 0.0) == pytest.approx(0.5, abs=0.05)


def test_a_negative_delay_is_refused() -> None:
    with pytest.raises(CableError, match="delay"):
        Sensing(0.0, 0.0, delay=-1)
