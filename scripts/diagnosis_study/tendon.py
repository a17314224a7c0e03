"""Diagnoses by `cc-mujoco diagnose` of a tendon in the open, the finger of the scenes.

    python scripts/diagnosis_study/tendon.py --out runs/tendon

Two rigs hide an effect each: one of closed forms that shares no code with the package
(`rig/posts.py`), and the scene itself with the effect in it, played by MuJoCo at steps
of 0.25 ms. Both are recorded at 500 Hz with noise and encoders. Cases that are done are
kept; the table is printed as Markdown.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from kept_cases import findings, kept, words

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench, Dataset, Noise, Trial, TrialFacts
from cc_mujoco.diagnosis import repair_scene, rollout, run_inference
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.report import _markdown as markdown
from rig.posts import Tendon, played

STEP, FINE = 0.002, 8
DIGIT = 2.0 * np.pi / 2**17
TORQUE = {"motor_torque_nm": 4e-4, "joint_torque_nm": 6e-4}
"""Standard deviation of the noise [N m]."""
OTHERWISE: dict[str, float] = {
    "friction": 0.22, "axial_stiffness": 1850.0, "pretension": 5.3,
}  # fmt: skip
"""Values of the rig that differ from the scene's, for the baseline to tune."""
HIDDEN: dict[str, dict[str, float]] = {
    "none": {},
    "more friction": {"friction": 0.32},
    "viscous_friction": {"viscous_friction": 300.0},
    "load_independent_friction": {"load_independent_friction": 30.0},
    "end_compliance": {"end_compliance": 2e-5},
    "torque_sensor_offset": {"joint_torque_bias": 0.02},
}
"""Cases; friction is the baseline's to tune, and no effect."""
_KEYS = {
    "axial_stiffness": "stiffness",
    "load_independent_friction": "drag",
    "viscous_friction": "viscosity",
    "end_compliance": "compliance",
}


def motions(bench: Bench, seconds: float) -> list[tuple[str, float, Array, Array]]:
    """Return trials: notes, relative pretension, motor and joint angles [rad]."""
    t = STEP * np.arange(round(seconds / STEP))
    pull = 0.5 - 0.5 * np.cos(1.3 * t)
    swept = 0.45 * np.sin(2.0 * np.pi * (0.15 * t + 0.12 * t**2))
    slow = 0.5 * np.sin(1.7 * t)
    ladder = 0.3 * np.interp(t % 4.0, [0, 1, 2, 2.4, 2.6, 4], [0, 1, 1, -1, -1, 0])
    held = np.full(t.size, 0.2)
    wound = 0.15 * (1.0 - np.cos(3.0 * t)) + 0.04 * np.sin(11.0 * t)
    return [
        ("swept", 1.0, bench.following(swept) + 0.2 * pull, swept),
        ("slow", 1.0, bench.following(slow) + 0.3 * pull, slow),
        ("stops", 1.0, bench.following(ladder) + 0.15 * pull, ladder),
        ("held", 1.0, bench.following(held) + 0.12 + wound, held),
        ("taut", 2.0, bench.following(slow) + 0.25 * pull, slow),
        ("test", 1.0, bench.following(0.7 * slow) + 0.2 * pull**2, 0.7 * slow),
    ]


def shown(
    rig: str, bench: Bench, hidden: Mapping[str, float], angles: tuple[Array, Array],
    tension: float,
) -> tuple[Array, Array]:  # fmt: skip
    """Return the torques (samples,) [N m] that a rig gives at motor and joint."""
    values = {**OTHERWISE, **hidden}
    values["pretension"] *= tension
    bias = values.pop("joint_torque_bias", 0.0)
    at = np.arange(angles[0].size)
    fine = np.arange(FINE * (at.size - 1) + 1) / FINE
    motor, joint = (np.interp(fine, at, angle) for angle in angles)
    # From rest in the pose 0 the finger comes to its place, then the motor winds: a
    # winch remembers the tension at which it wound, 1.3 mN m in a trial held at a load.
    ramp = np.linspace(0.0, 1.0, 200)[:-1]
    led = bench.following(ramp * joint[0])
    tight = led[-1] + ramp * (motor[0] - led[-1])
    motor = np.concatenate([led, tight, motor])
    joint = np.concatenate([ramp * joint[0], np.full(ramp.size, joint[0]), joint])
    dt = STEP / FINE
    if rig == "closed forms":
        own = {_KEYS.get(name, name): value for name, value in values.items()}
        torques = played(Tendon(**own), dt, motor, joint)
    else:
        cables = tuple(cable.replace(**values) for cable in bench.cables)
        with tempfile.TemporaryDirectory() as folder:
            scene = Path(folder) / "scene.xml"
            scene.write_text(repair_scene(bench, cables, {}).to_xml(), encoding="utf-8")
            torques = rollout(scene, dt * np.arange(motor.size), motor, joint)
    kept = slice(2 * ramp.size, None, FINE)
    return torques[0][kept], torques[1][kept] + bias


def recorded(
    rig: str, hidden: Mapping[str, float], seed: int, seconds: float = 8.0
) -> Dataset:
    bench = Bench.of(scene_path("finger"))
    random = np.random.default_rng(seed)
    trials = []
    for notes, tension, motor, joint in motions(bench, seconds):
        torques = shown(rig, bench, hidden, (motor, joint), tension)
        loud = [
            torque + size * random.standard_normal(torque.size)
            for torque, size in zip(torques, TORQUE.values(), strict=True)
        ]
        digits = [DIGIT * np.round(angle / DIGIT) for angle in (motor, joint)]
        facts = TrialFacts(
            pretension=bench.cables[0].pretension * tension,
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


def diagnosed(rig: str, name: str, seed: int) -> dict[str, Any]:
    data = recorded(rig, HIDDEN[name], seed)
    bench = Bench.of(scene_path("finger"))
    began = time.process_time()
    found = run_inference(data, bench).diagnosis
    missing = {each.id for each in found.missing}
    return {
        **findings(found),
        "refined": [e.id for e in found.effects if e.id not in missing],
        "unseen": {each.id: each.reason for each in found.not_testable},
        "seconds": time.process_time() - began,
    }


def main(out: Path, seed: int = 1) -> None:
    rows = []
    for name in HIDDEN:
        for rig in ("closed forms", "MuJoCo"):
            path = out / f"{name}, {rig}, {seed}.json"
            case = kept(path, partial(diagnosed, rig, name, seed))
            rows.append((name, rig, *words(case)))
            print(*rows[-1], f"{case['seconds']:.0f} s", sep=" | ", flush=True)
    print(markdown.table(("hidden", "rig", "verdict", "named", "ties"), rows))


if __name__ == "__main__":
    tyro.cli(main)
