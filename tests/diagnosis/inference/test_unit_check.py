"""Torques in another unit or of another sign than the scene's are not fitted away."""

from __future__ import annotations

import functools
import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cc_mujoco.datasets import Bench, Dataset, Trial
from cc_mujoco.diagnosis import Diagnosis, Options, run_inference
from diagnosis.recorded import BENCH, NOISE, dataset
from study_marks import study_but

README = Path(__file__).parents[3] / "README.md"
IDS = ("viscous_friction",)


def readme_scene() -> str:
    """Return the scene of the front page, with a servo in place of its motor."""
    (scene,) = re.findall(r"```xml\n(.*?)```", README.read_text("utf-8"), re.S)
    motor = '<motor name="motor" joint="motor" ctrlrange="-1 1"/>'
    assert motor in scene
    return str(scene.replace(motor, '<position joint="motor" kp="20" kv="0.1"/>'))


def read_as(data: Dataset, motor: float = 1.0, joint: float = 1.0) -> Diagnosis:
    trials = tuple(
        replace(
            each,
            motor_torque=motor * np.asarray(each.motor_torque),
            joint_torque=joint * np.asarray(each.joint_torque),
        )
        for each in data.trials
    )
    return run_inference(replace(data, trials=trials), BENCH, Options(IDS)).diagnosis


@pytest.mark.parametrize(
    ("unit", "factor"),
    study_but(3, [("lbfin", 8.85), ("kgfcm", 10.2), ("Ncm", 100.0), ("mNm", 1000.0)]),
)
def test_torques_in_another_unit_are_told_with_the_unit(
    unit: str, factor: float
) -> None:
    data = dataset(duration=1.5, seed=3)
    for motor, joint in ((factor, factor), (1.0, factor)):
        found = read_as(data, motor, joint)
        assert found.verdict == "fix-data"
        assert unit in found.statement
        assert ("motor torque is" in found.statement) == (motor != 1.0)


@pytest.mark.parametrize(("motor", "joint"), [(-1.0, -1.0), (1.0, -1.0)])
def test_torques_of_the_other_sign_are_told(motor: float, joint: float) -> None:
    found = read_as(dataset(duration=1.5, seed=3), motor, joint)
    assert found.verdict == "fix-data"
    assert "joint torque is the negative" in found.statement


def test_torques_of_a_rig_with_half_the_friction_are_taken() -> None:
    data = dataset(duration=1.5, seed=3, changes={"friction": 0.05})
    assert read_as(data).verdict == "none"


@functools.cache
def lone_cable() -> np.ndarray:
    """Return rows of a rig with more friction than its scene knows, in scene units."""
    model = mujoco.MjModel.from_xml_string(
        readme_scene().replace('"friction" value="0.1"', '"friction" value="0.4"')
    )
    data = mujoco.MjData(model)
    rows = np.empty((2000, 5))
    for i in range(2000 * 8):
        data.ctrl[0] = 2.0 + np.sin(5.0 * data.time) * min(data.time, 1.0)
        mujoco.mj_step(model, data)
        if i % 8 == 7:
            rows[i // 8] = data.time, *data.qpos, *data.actuator_force[1:3]
    random = np.random.default_rng(0)
    rows[:, 1:3] += 1e-4 * random.normal(size=(2000, 2))
    rows[:, 3:] *= (-0.02, -0.104)
    return rows


@pytest.mark.parametrize(
    ("motor", "joint"), study_but(3, [(1, 1), (1, -1), (-1, 1), (-1, -1)])
)
def test_a_lone_cable_never_pushes(tmp_path: Path, motor: float, joint: float) -> None:
    """However much friction the scene does not know, and so whatever correlates."""
    now, *angles, near, far = lone_cable().T
    trial = Trial("t", now, angles[0], -motor * near, angles[1], joint * far,
                  (slice(0, now.size),), 0.004, path="t.csv")  # fmt: skip
    path = tmp_path / "scene.xml"
    path.write_text(readme_scene(), encoding="utf-8")
    found = run_inference(
        Dataset((trial,), noise=NOISE), Bench.of(path), Options(IDS)
    ).diagnosis
    assert (found.verdict == "fix-data") == (motor < 0 or joint < 0)
    assert ("motor torque is the negative" in found.statement) == (motor < 0)
    assert ("joint torque is the negative" in found.statement) == (joint < 0)


def test_data_that_have_nothing_to_do_with_a_slack_cable_are_judged(
    tmp_path: Path,
) -> None:
    """Nothing that an effect changes shows in torques, as the cable never pulls."""
    path = tmp_path / "scene.xml"
    path.write_text(readme_scene(), encoding="utf-8")
    bench = Bench.of(path)
    time = np.arange(0.0, 4.0, 0.004)
    motor = 1.5 * np.sin(1.9 * time) * (1.0 + 0.3 * np.sin(1.3 * time))
    random = np.random.default_rng(0)
    noisy = [
        level + spread * random.normal(size=time.size)
        for level, spread in ((motor, 1e-4), (motor * 0.02 / 0.104, 1e-4), (2.0, 0.01))
    ]
    trial = Trial("t", time, noisy[0], noisy[2], noisy[1], -5.0 * noisy[2],
                  (slice(0, time.size),), 0.004, path="t.csv")  # fmt: skip
    found = run_inference(Dataset((trial,), noise=NOISE), bench).diagnosis
    assert found.verdict != "none"
