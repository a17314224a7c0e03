"""Data sets made with the package's own model, for tests of what is made of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cc_mujoco.assets import scene_path
from cc_mujoco.cable import Transmission
from cc_mujoco.datasets import Bench, Dataset, Noise, Trial
from cc_mujoco.diagnosis import EFFECTS
from cc_mujoco.diagnosis.effects._effect import RigGeometry, Signals

DT = 0.004
BENCH = Bench.of(scene_path("bench"))
NOISE = {
    "motor_angle_rad": Noise(2e-5, 0.0, "declared"),
    "joint_angle_rad": Noise(2e-5, 0.0, "declared"),
    "motor_torque_nm": Noise(0.02, 0.0, "declared"),
    "joint_torque_nm": Noise(0.02, 0.0, "declared"),
}
CELL = 0.3
"""Noise of a load cell [N]."""


def motions(duration: float, seed: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Motor and joint angle of strokes, a locked joint, both moved, locked again."""
    time = np.arange(0.0, duration, DT)
    random = np.random.default_rng(seed)
    phase = random.uniform(0.0, 6.0, 4)
    stroke = 0.7 * np.sin(2.5 * time) + 0.2 * np.sin(0.7 * time + phase[0])
    locked = 0.06 * np.sin(3.0 * time) + 0.03 * np.sin(7.0 * time + phase[1])
    fast = 0.3 * np.sin(6.0 * time + phase[2]) - 0.3 * np.sin(phase[2])
    wind = 0.03 * np.sin(1.7 * time + phase[3]) - 0.03 * np.sin(phase[3])
    again = 0.05 * np.sin(4.0 * time) + 0.04 * np.sin(1.3 * time)
    return [
        (stroke, 0.97 * stroke),
        (locked, 0.0 * locked),
        (fast, fast + wind),
        (again, 0.0 * again),
    ]


def dataset(
    effects: Mapping[str, Mapping[str, float]] | None = None,
    duration: float = 6.0,
    seed: int = 0,
    changes: Mapping[str, float] | None = None,
    chosen: Sequence[int] = (0, 1, 2),
    balance: float = 0.0,
    bench: Bench = BENCH,
    cells: bool = False,
) -> Dataset:
    """Trials of a bench whose cables differ by `changes` and that has these effects.

    The first has this share more of friction than both on average, the second less.
    With `cells` the trials have the tension of every end of a cable, too.
    """
    effects = effects or {}
    cables = tuple(cable.replace(**dict(changes or {})) for cable in bench.cables)
    cables = tuple(
        cable.replace(friction=cable.friction * (1.0 + side))
        for cable, side in zip(cables, (balance, -balance), strict=False)
    )
    rig = RigGeometry(bench.motor_radius, bench.joint_radius, bench.exit_angle)
    for name, values in effects.items():
        change = EFFECTS[name].cables
        if change is not None:
            cables = change(cables, values, rig)
    play = effects.get("backlash", {}).get("backlash", 0.0)
    drive = Transmission(cables, rig.motor_radius, rig.joint_radius, backlash=play)
    random = np.random.default_rng(seed + 1)
    trials = []
    every = motions(duration, seed)
    for place in chosen:
        motor, joint = (angle - angle[0] for angle in every[place])
        played = drive.replay(DT, motor_angle=motor, joint_angle=joint)
        time = DT * np.arange(motor.size)
        shown = Signals(
            DT, time, motor, joint, played.motor_torque, played.joint_torque
        )
        for name, values in effects.items():
            act = EFFECTS[name].torques
            if act is not None:
                shown = act(shown, values)
        noise = [random.normal(0.0, n.deviation, motor.size) for n in NOISE.values()]
        trials.append(
            Trial(
                f"trial_{place}",
                time,
                motor + noise[0],
                shown.motor + noise[2],
                joint + noise[1],
                shown.joint + noise[3],
                (slice(0, motor.size),),
                DT,
                path=f"trial_{place}.csv",
                tensions={
                    f"tension_{name}_{end}_n": pull[k]
                    + random.normal(0.0, CELL, motor.size)
                    for end, pull in (
                        ("proximal", played.tension_proximal),
                        ("distal", played.tension_distal),
                    )
                    for k, name in enumerate(bench.names)
                    if cells
                },
            )
        )
    return Dataset(tuple(trials), noise=NOISE)
