"""A load cell in one cable (`load_cell`) takes the place of the torque at its end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cc_mujoco.datasets import Dataset, TrialFacts
from cc_mujoco.datasets._dataset_file import DatasetFile
from cc_mujoco.datasets._torques import add_derived_torques, expected_instruments
from cc_mujoco.diagnosis import plant_of, prepare
from cc_mujoco.diagnosis._checks.content import noise_of
from cc_mujoco.diagnosis._checks.readings import check_load_cells
from cc_mujoco.diagnosis._fit.noise_floor import noise_floor
from cc_mujoco.diagnosis._propose.experiment import motions, trial_table
from diagnosis.recorded import BENCH, CELL, dataset

CHANNEL = "tension_antagonist_distal_n"
GAIN = {"motor_torque_gain": 0.1, "joint_torque_gain": 0.1}


def declared(channel: str, data: Dataset) -> Dataset:
    first, cell = data.trials
    facts = TrialFacts(load_cell=channel, pretension=BENCH.cables[0].pretension)
    return replace(data, trials=(first, replace(cell, facts=facts)))


@pytest.fixture(scope="module")
def data() -> Dataset:
    found = declared(CHANNEL, dataset(duration=2.5, chosen=(0, 1), cells=True))
    return replace(found, noise=noise_of(found, DatasetFile()))


def test_it_shows_the_tension_of_its_cable_and_no_fault_of_a_torque_sensor(
    data: Dataset,
) -> None:
    records, filtering = prepare(data, BENCH)
    plant = plant_of(data, BENCH, records)
    plain = plant.simulate({})
    wrong = plant.simulate(GAIN, ("torque_sensor_gain",))
    for record, torques, faulty in zip(records, plain, wrong, strict=True):
        left = (record.measured - torques)[:, record.counts]
        assert np.std(left, axis=1) == pytest.approx([0.02, 0.02], abs=0.02)
        cell = record.load_cell is not None
        np.testing.assert_allclose(faulty[0], 1.1 * torques[0], atol=1e-12)
        np.testing.assert_allclose(faulty[1], (1.1 - 0.1 * cell) * torques[1])
    trial, radius = data.trials[1], BENCH.joint_radius
    pull = trial.tensions[CHANNEL] - BENCH.cables[0].pretension
    assert np.ptp(records[1].measured[1]) == pytest.approx(
        radius * np.ptp(pull), rel=0.05
    )
    assert np.corrcoef(records[1].measured[1], -pull[: records[1].time.size])[0, 1] > 0
    floor = noise_floor(data, plant, filtering, {}).noise
    ratio = np.min(floor[1][1]) / (radius * CELL * filtering.passed**0.5)
    assert ratio == pytest.approx(1.0, rel=0.1)


def test_it_is_no_second_opinion_on_the_torque_sensor(data: Dataset) -> None:
    _, instruments, findings = add_derived_torques(data.trials, DatasetFile(), BENCH)
    assert instruments == data.instruments
    named = [f for f in findings if "Beside" in f.statement]
    assert len(named) == 2  # of the first trial, whose cells are at both ends


@pytest.mark.parametrize(
    ("channel", "sentence"),
    [
        ("tension_antagonist_proximal_n", ""),
        ("tension_left_distal_n", "has no such column; record it there, or name"),
    ],
)
def test_one_that_the_data_lack_is_an_error(
    data: Dataset, channel: str, sentence: str
) -> None:
    found = [f.statement for f in check_load_cells(declared(channel, data), BENCH)]
    assert bool(found) == bool(sentence) and all(sentence in each for each in found)


def test_a_plan_has_the_trial_of_a_cell_that_is_declared() -> None:
    channel = "tension_agonist_distal_n"
    file = DatasetFile(columns={channel: DatasetFile().source(channel)})
    assert expected_instruments(file, BENCH) == expected_instruments(
        DatasetFile(), BENCH
    )
    every = motions(BENCH, 0.8, 3.0, cells=file.columns)
    cells = [each for each in every if each.load_cell]
    assert [each.standard for each in cells] == [False, True]
    assert f'load_cell = "{channel}"' in trial_table("trial_09", cells[1], 80.0)
