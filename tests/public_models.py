"""Knee exoskeletons on public humanoids, read from the wheels that are installed."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import mujoco
import pytest

import cc_mujoco

FOLDERS = {"gymnasium": "envs/mujoco/assets", "dm_control": "suite"}
"""Place of `humanoid.xml` by package; the bodies of both have the same names."""


MODELS = FOLDERS | {"mjlab": "asset_zoo", "myosuite": "simhive/myo_sim"}
"""Folder of models by package; those of mjlab are from mujoco_menagerie."""


def folder(package: str) -> Path:
    """Return the folder of models; skips the test where it is not installed."""
    found = importlib.util.find_spec(package)
    if found is None or found.origin is None:
        pytest.skip(f"{package} is not installed")
    return Path(found.origin).parent / MODELS[package]


def humanoid(package: str) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_file(str(folder(package) / "humanoid.xml"))


def with_knee_exoskeleton(package: str) -> mujoco.MjSpec:
    """Return a humanoid whose right knee a cable stretches instead of its motor."""
    spec = humanoid(package)
    cc_mujoco.add_cable(
        spec,
        "extensor",
        motor="pelvis",
        drum=0.03,
        torque_limit=20.0,
        joint="right_knee",
        route=[
            ("pelvis", (-0.12, -0.05, 0.1)),
            ("pelvis", (-0.05, -0.19, 0.0)),
            ("right_thigh", (0.08, -0.04, -0.1)),
            ("right_thigh", (0.08, 0.0, -0.3)),
        ],
        lever=("right_shin", (0.08, 0.0, -0.05)),
        replace="right_knee",
        friction=0.1,
        axial_stiffness=40e3,
    )
    return spec
