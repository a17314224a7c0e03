"""Environments of `scripts/train_policy.py`."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
import pytest
import train_policy

from cc_mujoco.device._model import joint_range


def made(scene: str, fixed: bool) -> list[Any]:
    """Return a few short environments of the script."""
    options = {"envs": 4, "seconds": 0.01, "fixed": fixed, "smoothness": 0.01}
    return train_policy.make(argparse.Namespace(scene=scene, **options))


@pytest.mark.parametrize("scene", [*train_policy.PLAYED, "exosuit"])
def test_plants_are_drawn_around_those_of_the_scene_or_are_one(scene: str) -> None:
    for fixed in (False, True):
        for env in made(scene, fixed):
            env.reset(seed=0)
            *_, rewards, _, _, _ = env.step(
                np.full(env.action_space.shape, 0.1, np.float32)
            )
            assert np.isfinite(rewards).all()
            nominal = env.exo.plants.nominal.cables
            for plant in env.plants:
                for name, cable in plant.cables.items():
                    ratio = cable.axial_stiffness / nominal[name].axial_stiffness
                    assert 0.7 <= ratio <= 1.3
                    assert (ratio == 1.0) == fixed


def test_every_device_begins_with_small_actions_and_taut_cables() -> None:
    assert set(train_policy.DEVIATIONS) == set(train_policy.PLAYED)
    assert set(train_policy.TAUT) == set(train_policy.PLAYED)
    deviation, means = train_policy.first_actions("exosuit")
    assert -4.0 <= deviation <= -1.0
    assert len(means) == 2 and all(0.0 < mean < 0.2 for mean in means)


def test_the_bench_has_the_motor_and_the_hand_of_its_scene() -> None:
    device = made("bench", True)[0].exo.device
    (axis,) = device.axes
    assert (axis.ratio, axis.torque_limit) == (pytest.approx(1.0), 10.0)
    assert device.wearers["joint"] == train_policy.HAND
    assert joint_range(device.model, "joint") == (-np.inf, np.inf)
    assert (device.frame_skip, device.description.period) == (10, 1e-3)
