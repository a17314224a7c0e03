"""The effects that a policy was trained on: in its file, and in tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.assets import POLICIES
from cc_mujoco.benchmark import (
    SCORES,
    STRUCTURES,
    SUITES,
    Cell,
    CellResult,
    declare_training,
    overview_table,
    play,
    trained_on,
)
from cc_mujoco.benchmark._report import conditions_table
from cc_mujoco.benchmark._results import by_device
from cc_mujoco.control import Network, read_policy, write_policy
from cc_mujoco.device import DeviceModel, find_device
from cc_mujoco.errors import CableError
from cc_mujoco.simulation._worn_device import WornDevice

PLAYED = {"ordinary-rough": 0.2, "structure-viscous": 0.3, "structure-seals": 0.7}


@pytest.fixture
def policy(tmp_path: Path) -> str:
    """Return the file of a policy that gives no torque."""
    device = find_device("wrist")
    model = DeviceModel.of(device).model
    (observed,) = WornDevice(device.description, model).observed
    size = observed.space.shape[0]
    layers = (np.zeros((1, size)),), (np.zeros(1),)
    network = Network(*layers, "tanh", False, np.zeros(size), np.ones(size))
    path = tmp_path / "idle.safetensors"
    write_policy(path, network, observed)
    return str(path)


def test_a_file_states_its_training_and_stays_the_policy(policy: str) -> None:
    assert trained_on("pi") == "" and trained_on(policy) == "not stated"
    before, observed = read_policy(policy)
    declare_training(policy, ["viscous", "tremor", "viscous"])
    assert trained_on(policy) == "tremor, viscous"
    declare_training(policy, [])
    assert trained_on(policy) == "no effect"
    after, same = read_policy(policy)
    assert np.array_equal(before.weights[0], after.weights[0]) and observed == same
    with pytest.raises(CableError, match="there is no such file"):
        trained_on("absent.safetensors")
    with pytest.raises(CableError, match=r"unknown effect 'viscus'.*viscous"):
        declare_training(policy, ["viscus"])
    condition = SUITES["v2"].conditions("wrist")[0]
    assert play(Cell(condition, policy)).plants["trained_on"] == ["no effect"]


def test_a_table_has_the_mean_over_effects_that_no_policy_was_trained_on() -> None:
    conditions = {one.name: one for one in SUITES["v2"].conditions("wrist")}
    results = []
    for name, error in PLAYED.items():
        for law, factor in {"none": 1.0, "pi": 2.0, "p.safetensors": error}.items():
            scores = {s.name: np.zeros(2) for s in SCORES}
            scores["rms_torque_error"] = np.full(2, factor)
            plants = {"failure": ["", ""], "trained_on": ["tremor, viscous"] * 2}
            if "." not in law:
                del plants["trained_on"]
            cell = Cell(conditions[name], law, (0, 1))
            results.append((cell, CellResult(scores, plants)))
    head, rows = overview_table(results)
    assert head == ["controller", "trained on", "wrist", "wrist, unseen effects"]
    cells = {row[0]: row[1:] for row in rows}
    assert cells["`pi`"][::2] == ["-", "2.000"]
    trained, error, unseen = cells["`p.safetensors`"]
    assert (trained, unseen) == ("tremor, viscous", "0.700")
    assert error.startswith("0.400")
    rows = conditions_table(by_device(results)[0])[1]
    assert [row[-1] for row in rows] == ["0.20 (seen)", "0.30 (seen)", "0.70"]
    assert (
        len(overview_table([r for r in results if "." not in r[0].controller])[0]) == 2
    )


def test_a_policy_that_states_nothing_has_no_unseen_effects() -> None:
    condition = SUITES["v3"].conditions("wrist")[1]
    results = [
        (
            Cell(condition, law),
            CellResult({s.name: np.full(1, 0.5) for s in SCORES}, plants),
        )
        for law, plants in {
            "none": {"failure": [""]},
            "p.safetensors": {"failure": [""], "trained_on": ["not stated"]},
        }.items()
    ]
    head, rows = overview_table(results)
    assert head[-1] == "wrist, unseen effects" and rows[1][1] == "not stated"
    assert [row[-1] for row in rows] == ["-", "-"]


@pytest.mark.parametrize("name", POLICIES)
def test_policies_of_the_package_state_their_training(name: str) -> None:
    assert set(trained_on(name).split(", ")) <= set(STRUCTURES)
