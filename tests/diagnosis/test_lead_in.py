"""Every trial refers to the same pose and the same pretension, wherever it begins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.diagnosis import EFFECTS, Options, prepare, run_inference
from cc_mujoco.diagnosis._report.output import (
    rollout_difference,
    write_and_compare_scene,
)
from cc_mujoco.diagnosis._rig.simulation import SimulatedRig
from cc_mujoco.diagnosis.effects._effect import RigGeometry
from diagnosis.recorded import BENCH, dataset

ECCENTRIC = {
    "eccentricity_cosine": -4e-4,
    "eccentricity_sine": 6e-4,
    "ovality_cosine": 1e-4,
    "ovality_sine": -2e-4,
}


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("pulley_eccentricity", ECCENTRIC),
        ("configuration_dependent_wrap", {"wrap_per_angle": 0.8, "wrap_reach": 0.4}),
    ],
)
def test_a_trial_that_begins_later_ends_alike(
    name: str, values: Mapping[str, float]
) -> None:
    record = prepare(dataset(duration=6.0, chosen=(0,)), BENCH)[0][0]
    begin = int(np.argmax(np.abs(record.joint_angle[: record.time.size // 2])))
    assert abs(record.joint_angle[begin]) > 0.2
    later = replace(
        record,
        time=record.time[begin:],
        motor_angle=record.motor_angle[begin:],
        joint_angle=record.joint_angle[begin:],
        measured=record.measured[:, begin:],
        counts=record.counts[begin:],
    )
    whole, part = (
        SimulatedRig(BENCH, (each,), 8).simulate(values, (name,))[0]
        for each in (record, later)
    )
    ran_in = whole.shape[1] * 2 // 3
    scale = float(np.std(whole))
    assert part[:, ran_in - begin :] == pytest.approx(
        whole[:, ran_in:], abs=1e-3 * scale
    )


def test_friction_at_a_tension_is_the_same_in_trials_of_any_pretension() -> None:
    change = EFFECTS["tension_dependent_friction"].cables
    assert change is not None
    values = {"tension_exponent": -0.2, "pretension": 80.0}
    rig = RigGeometry(0.05, 0.05, 0.0)
    usual, loose = (
        change((BENCH.cables[0].replace(pretension=tension),), values, rig)[0]
        for tension in (80.0, 52.0)
    )
    for tension in (20.0, 52.0, 80.0, 150.0):
        here = [
            cable.friction * (tension / cable.pretension) ** cable.tension_exponent
            for cable in (usual, loose)
        ]
        assert here[0] == pytest.approx(here[1], rel=1e-12)
    assert usual.friction == BENCH.cables[0].friction


@pytest.mark.study
def test_the_repaired_scene_plays_what_the_replay_plays(tmp_path: Path) -> None:
    result = run_inference(
        dataset({"joint_gravity": {"gravity_sine": 0.4, "gravity_cosine": 0.1}}, 2.5),
        BENCH,
        Options(("joint_gravity", "motor_inertia")),
    )
    write_and_compare_scene(result, tmp_path / "scene.xml")
    _, apart, size = rollout_difference(result, tmp_path / "scene.xml")
    assert apart < 1e-4 * size
