"""The finger's tendon is diagnosed, on trials that MuJoCo plays with an effect in it.

Played at steps of 0.25 ms, recorded at 500 Hz with noise and encoders.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench, Dataset, Noise, Trial, TrialFacts
from cc_mujoco.diagnosis import Options, rollout, run_inference, write
from cc_mujoco.diagnosis import repair_scene as repaired
from cc_mujoco.diagnosis._report.output import (
    rollout_difference,
    write_and_compare_scene,
)

FINGER = Bench.of(scene_path("finger"))
FEW = ("viscous_friction", "end_compliance", "load_independent_friction")
STEP, FINE = 0.002, 8
DIGIT = 2.0 * np.pi / 2**17
TORQUE = {"motor_torque_nm": 4e-4, "joint_torque_nm": 6e-4}
"""Standard deviation of the noise [N m]."""
OTHERWISE = {"friction": 0.22, "axial_stiffness": 1850.0, "pretension": 5.3}
"""Values that differ from the scene's, for the baseline to tune."""
HIDDEN = {
    "none": {},
    "viscous_friction": {"viscous_friction": 300.0},
    "end_compliance": {"end_compliance": 2e-5},
}
Array = np.ndarray
pytestmark = pytest.mark.study


def motions(seconds: float) -> list[tuple[str, float, Array, Array]]:
    """Return trials: notes, relative pretension, motor and joint angles [rad]."""
    t = STEP * np.arange(round(seconds / STEP))
    pull = 0.5 - 0.5 * np.cos(1.3 * t)
    swept = 0.45 * np.sin(2.0 * np.pi * (0.15 * t + 0.12 * t**2))
    slow = 0.5 * np.sin(1.7 * t)
    ladder = 0.3 * np.interp(t % 4.0, [0, 1, 2, 2.4, 2.6, 4], [0, 1, 1, -1, -1, 0])
    held = np.full(t.size, 0.2)
    wound = 0.15 * (1.0 - np.cos(3.0 * t)) + 0.04 * np.sin(11.0 * t)
    follow = FINGER.following
    return [
        ("swept", 1.0, follow(swept) + 0.2 * pull, swept),
        ("slow", 1.0, follow(slow) + 0.3 * pull, slow),
        ("stops", 1.0, follow(ladder) + 0.15 * pull, ladder),
        ("held", 1.0, follow(held) + 0.12 + wound, held),
        ("taut", 2.0, follow(slow) + 0.25 * pull, slow),
        ("test", 1.0, follow(0.7 * slow) + 0.2 * pull**2, 0.7 * slow),
    ]


def shown(scene: Path, angles: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the torques (samples,) [N m] of motor and joint in a scene."""
    at = np.arange(angles[0].size)
    fine = np.arange(FINE * (at.size - 1) + 1) / FINE
    motor, joint = (np.interp(fine, at, angle) for angle in angles)
    # From rest in the pose 0 the finger comes to its place, then the motor winds: a
    # winch remembers the tension at which it wound, 1.3 mN m in a trial held at a load.
    ramp = np.linspace(0.0, 1.0, 200)[:-1]
    led = FINGER.following(ramp * joint[0])
    tight = led[-1] + ramp * (motor[0] - led[-1])
    motor = np.concatenate([led, tight, motor])
    joint = np.concatenate([ramp * joint[0], np.full(ramp.size, joint[0]), joint])
    torques = rollout(scene, STEP / FINE * np.arange(motor.size), motor, joint)
    kept = slice(2 * ramp.size, None, FINE)
    return torques[0][kept], torques[1][kept]


def recorded(folder: Path, hidden: dict[str, float], seconds: float = 2.0) -> Dataset:
    random, trials = np.random.default_rng(1), []
    for notes, tension, motor, joint in motions(seconds):
        values = {**OTHERWISE, **hidden}
        values["pretension"] *= tension
        cables = tuple(cable.replace(**values) for cable in FINGER.cables)
        write(folder / f"{notes}.xml", repaired(FINGER, cables, {}))
        torques = shown(folder / f"{notes}.xml", (motor, joint))
        loud = [
            torque + size * random.standard_normal(torque.size)
            for torque, size in zip(torques, TORQUE.values(), strict=True)
        ]
        digits = [DIGIT * np.round(angle / DIGIT) for angle in (motor, joint)]
        facts = TrialFacts(
            pretension=FINGER.cables[0].pretension * tension,
            split="test" if notes == "test" else None,
        )
        trials.append(
            Trial(
                notes, STEP * np.arange(motor.size), digits[0], loud[0], digits[1],
                loud[1], (slice(0, motor.size),), STEP, facts=facts,
                path=f"{notes}.csv",
            )
        )  # fmt: skip
    noise = {name: Noise(size, 0.0, "declared") for name, size in TORQUE.items()}
    for name in ("motor_angle_rad", "joint_angle_rad"):
        noise[name] = Noise(DIGIT / np.sqrt(12.0), DIGIT, "declared")
    return replace(Dataset(tuple(trials)), noise=noise)


@pytest.mark.parametrize("name", list(HIDDEN))
def test_an_effect_in_the_tendon_is_named_and_repaired(
    tmp_path: Path, name: str
) -> None:
    data = recorded(tmp_path, HIDDEN[name])
    result = run_inference(data, FINGER, Options(ids=FEW))
    found = result.diagnosis
    wanted = [] if name == "none" else [name]
    assert [each.id for each in found.missing] == wanted, found.statement
    assert found.baseline.parameters["friction"].value == pytest.approx(
        OTHERWISE["friction"], rel=0.02
    )
    assert "joint_radius" not in found.baseline.parameters
    for effect in found.missing:
        value = effect.parameters[name]
        assert value.value == pytest.approx(HIDDEN[name][name], rel=0.1)
    if wanted:  # viscous friction makes 1.4 floors in RMS, which leaves little to close
        assert all(gap.gap_closed > 0.75 for gap in found.gap.values())
    reasons = {each.id: each.reason for each in found.not_testable}
    assert "nothing has play" in reasons["backlash"]
    assert "at every angle" in reasons["configuration_dependent_wrap"]
    path = tmp_path / "scene.xml"
    write_and_compare_scene(result, path)
    _, difference, size = rollout_difference(result, path)
    assert difference < 2e-3 * size
    assert Bench.of(path).cables[0].friction == pytest.approx(0.22, rel=0.02)
