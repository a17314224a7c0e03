"""Diagnosis of commanded and measured positions, on rigs of other equations.

The joint is a body that a spring with a gap drives against friction. It is integrated,
and no play operator is in it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis import infer
from cc_mujoco.diagnosis._verdict import Diagnosis
from cc_mujoco.native import FloatArray

STEP, SUBSTEPS, SECONDS = 0.004, 8, 6.0
STIFFNESS, INERTIA, DAMPING, FRICTION = 100.0, 5e-4, 0.02, 0.05
NOISE = 1e-4
DECLARED = """\
[columns.motor_torque_nm]
measured = false
[columns.joint_torque_nm]
measured = false
"""


def driven(motor: FloatArray, gap: float) -> FloatArray:
    """Return the angle of a joint (trials, samples) that a spring with a gap drives."""
    step = STEP / SUBSTEPS
    angle, speed = motor[:, 0].copy(), np.zeros(len(motor))
    found = np.empty_like(motor)
    for k in range(motor.shape[1]):
        found[:, k] = angle
        for j in range(SUBSTEPS):
            ahead = motor[:, min(k + 1, motor.shape[1] - 1)]
            there = motor[:, k] + (ahead - motor[:, k]) * j / SUBSTEPS
            apart = there - angle
            pull = STIFFNESS * (apart - np.clip(apart, -0.5 * gap, 0.5 * gap))
            free = speed + step / INERTIA * (pull - DAMPING * speed)
            speed = np.sign(free) * np.maximum(
                np.abs(free) - step / INERTIA * FRICTION, 0.0
            )
            angle = angle + step * speed
    return found


def diagnosed(
    folder: Path, gap: float | None, lag: float = 0.0, last: int = -1
) -> Diagnosis:
    """Return the diagnosis of two trials of a rig, of a rigid one without a gap.

    `last` is the number of samples of the second trial, all unless given.
    """
    time = np.arange(0.0, SECONDS, STEP)

    def motions(t: FloatArray) -> FloatArray:
        slow = 0.4 * np.sin(1.5 * t) + 0.1 * np.sin(4.1 * t)
        return np.array([slow, 0.3 * np.sin(6.0 * t) * np.sin(0.5 * t)])

    joint = motions(time) if gap is None else driven(motions(time - lag), gap)
    random = np.random.default_rng(1)
    for place, (motor, angle) in enumerate(zip(motions(time), joint, strict=True)):
        table = np.array([time, *(np.array([motor, angle]))])
        table[1:] += NOISE * random.standard_normal(table[1:].shape)
        table = table[:, : last if place else -1]
        np.savetxt(
            folder / f"trial_{place}.csv",
            table.T,
            delimiter=",",
            header="time_s,motor_angle_rad,joint_angle_rad",
            comments="",
        )
    (folder / "dataset.toml").write_text(DECLARED, encoding="utf-8")
    result, _ = infer(Bench.of(scene_path("bench")), [folder])
    return result.diagnosis


def test_a_trial_too_short_to_count_changes_nothing(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, 0.04, last=60)
    assert found.ties == (("backlash", "end_compliance"),)
    zone = found.baseline.parameters["dead_zone"]
    assert zone.value == pytest.approx(0.041, rel=0.01)


def test_a_gap_is_measured_and_ties_with_stretch(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, 0.02)
    assert found.verdict == "tie"
    assert found.ties == (("backlash", "end_compliance"),)
    # Friction bends the spring on either side of the gap.
    zone = found.baseline.parameters["dead_zone"]
    assert zone.value == pytest.approx(0.02 + 2.0 * FRICTION / STIFFNESS, rel=0.05)
    assert "at once" in found.statement
    assert "play cannot be distinguished from a cable that stretches" in found.statement
    assert "Angles only, without a torque" in found.instruments


def test_a_lag_is_no_dead_zone(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, 0.0, lag=0.03)
    values = found.baseline.parameters
    drag = DAMPING / STIFFNESS  # the spring gives by as much per speed
    assert values["lag"].value == pytest.approx(0.03 + drag, abs=3e-4)
    assert values["dead_zone"].value == pytest.approx(
        2.0 * FRICTION / STIFFNESS, rel=0.2
    )
    assert ("sensor_delay", "viscous_friction") in found.ties
    assert found.remaining < 1.5


def test_a_rigid_drive_has_neither(tmp_path: Path) -> None:
    assert diagnosed(tmp_path, None).verdict == "none"
