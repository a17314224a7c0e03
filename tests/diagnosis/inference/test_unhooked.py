"""A trial without its cables (`unhooked = true`) shows what is not in the cables."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.datasets import Dataset, Trial, TrialFacts
from cc_mujoco.diagnosis import fit_baseline, plant_of, prepare
from cc_mujoco.diagnosis._checks.mechanics import check_lead
from cc_mujoco.diagnosis._checks.readings import check_bench, check_trials
from cc_mujoco.diagnosis._fit.fit import prepare_start
from cc_mujoco.diagnosis._fit.trials import find_outlier_trial
from cc_mujoco.errors import CableError
from diagnosis.recorded import BENCH, DT, NOISE, dataset

TRUTH = {"friction": 0.13, "axial_stiffness": 47e3, "pretension": 82.0}
GRAVITY = 0.5


def unhooked(duration: float = 3.0) -> Trial:
    """Motor and joint moved by themselves, the joint with a weight [N m]."""
    time = np.arange(0.0, duration, DT)
    random = np.random.default_rng(7)
    motor, joint = 0.7 * np.sin(2.5 * time), -0.6 * np.sin(2.5 * time + 0.1)
    noise = [random.normal(0.0, n.deviation, time.size) for n in NOISE.values()]
    return Trial(
        "off",
        time,
        motor + noise[0],
        noise[2],
        joint + noise[1],
        noise[3] - GRAVITY * np.sin(joint),
        (slice(0, time.size),),
        DT,
        facts=TrialFacts(unhooked=True),
        path="off.csv",
    )


@pytest.fixture(scope="module")
def data() -> Dataset:
    weight = {"joint_gravity": {"gravity_sine": GRAVITY, "gravity_cosine": 0.0}}
    usual = dataset(weight, changes=TRUTH, duration=2.5, seed=2)
    return replace(usual, trials=(*usual.trials, unhooked()))


def test_cables_that_were_taken_off_pull_nothing(data: Dataset) -> None:
    start, records, filtering = prepare_start(data, BENCH)
    assert start.bench is BENCH
    off = records[-1]
    assert off.unhooked and np.mean(off.counts) > 0.9
    found = fit_baseline(data, plant_of(data, BENCH, records), filtering, 0)
    weight = {"gravity_sine": GRAVITY, "gravity_cosine": 0.0}
    wider = found.problem.with_effect("joint_gravity", weight)
    x = wider.placed(found.whole.x, weight)
    for problem, place, size in (
        (found.problem, found.whole.x, GRAVITY * np.sin(off.joint_angle)),
        (wider, x, 0.0),
    ):
        (played,) = problem.plant.limited([off]).simulate(
            problem.values(place), problem.effects
        )
        left = (off.measured - played)[:, off.counts]
        assert np.std(left[0]) < 0.02  # the noise of the sensor
        assert np.std(left[1] + np.broadcast_to(size, off.time.shape)[off.counts]) < (
            0.02
        )
    requested = find_outlier_trial(found.problem, found.whole.x)
    assert requested is None or "off" not in requested.trials


def test_no_check_expects_cables_that_were_taken_off(data: Dataset) -> None:
    off = data.trials[-1]
    hooked = replace(off, facts=TrialFacts())
    assert check_trials([hooked]) + check_bench([hooked], BENCH)
    assert (
        not check_trials([off]) + check_bench([off], BENCH) + check_lead([off], BENCH)
    )


def test_a_file_declares_it(tmp_path: Path) -> None:
    from cc_mujoco.datasets._dataset_file import read_dataset_file

    path = tmp_path / "dataset.toml"
    path.write_text("[trials.off]\nunhooked = true\n", encoding="utf-8")
    assert read_dataset_file(path).facts["off"] == {"unhooked": True}
    for text, said in (
        ("pretension = 0\n", "pretension must be more than 0 .*unhooked = true"),
        ("pretension = 3\nunhooked = true\n", "leave one of them out"),
    ):
        path.write_text(f"[trials.off]\n{text}", encoding="utf-8")
        with pytest.raises(CableError, match=said):
            read_dataset_file(path)


def test_known_weights_and_exchanged_sensors_show_whose_gain_is_wrong(
    data: Dataset,
) -> None:
    """Both torques by hand, on a trial without cables."""
    off = unhooked()
    facts = TrialFacts(unhooked=True, known_motor_torque=1.5, known_joint_torque=-2.0)
    plain = replace(off, name="weights", facts=facts)
    swapped = replace(off, name="swapped", facts=replace(facts, swapped=True))
    records, _ = prepare(replace(data, trials=(plain, swapped)), BENCH)
    gain = {"motor_torque_gain": 0.1, "joint_torque_gain": 0.0}
    shown = plant_of(data, BENCH, records).simulate(gain, ("torque_sensor_gain",))
    inside = slice(200, -200)
    for torques, expected in zip(shown, ((1.65, -2.0), (1.5, -2.2)), strict=True):
        np.testing.assert_allclose(torques[0][inside], expected[0], rtol=1e-3)
        np.testing.assert_allclose(torques[1][inside], expected[1], rtol=1e-3)
