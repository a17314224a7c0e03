"""Rigs of an independent simulation whose recordings invite a wrong name.

No effect of a cable explains them. What stands in `unknown` and `fix-data` is where it
is, how large, and what to do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis import Diagnosis, infer
from rig.dataset import clean_dataset, make_dataset, make_trials
from rig.generate import facts_of, write_data
from rig.makes import MAKES
from rig.nominal import make_rig
from rig.sensors import BASIC, logged

pytestmark = pytest.mark.study
Array = np.ndarray
Columns = dict[str, Array]
BENCH = Bench.of(scene_path("bench"))
TORQUES = ("motor_torque_nm", "joint_torque_nm")
ANGLES = ("motor_angle_rad", "joint_angle_rad")
SETS = "rich_standard"


def diagnosed(
    folder: Path, data: Sequence[Columns], seed: int, bench: Bench = BENCH
) -> Diagnosis:
    """Return the diagnosis of files that hold these trials."""
    write_data(folder / "data", list(data), facts_of(SETS, seed))
    return infer(bench, [folder / "data"])[0].diagnosis


@pytest.mark.parametrize("seed", [71, 72])
def test_dry_friction_of_the_joint_is_not_a_cable_s(tmp_path: Path, seed: int) -> None:
    rig = make_rig(seed, make="guides")
    data = make_dataset(rig, {"joint_friction": 0.15}, SETS, seed)
    found = diagnosed(tmp_path, data, seed)
    assert found.verdict == "named", found.statement
    assert [each.id for each in found.missing] == ["joint_friction"]
    size = found.missing[0].parameters["joint_friction"]
    assert size.value == pytest.approx(0.15, rel=0.1)


def test_dry_friction_of_the_joint_is_tied_with_a_seal_unless_cables_come_off(
    tmp_path: Path,
) -> None:
    seed, sets = 16042, "rich"
    data = make_dataset(
        make_rig(seed, make="guides"), {"joint_friction": 0.48}, sets, seed
    )
    write_data(tmp_path / "data", data, facts_of(sets, seed))
    found = infer(BENCH, [tmp_path / "data"])[0].diagnosis
    both = {"joint_friction", "load_independent_friction"}
    assert found.verdict == "tie" and both in map(set, found.ties), found.statement
    assert found.next_experiment is not None
    assert both <= {*found.next_experiment.separates}


def test_cables_off_for_half_a_trial_are_an_event_with_file_and_time(
    tmp_path: Path,
) -> None:
    seed, place = 73, 3
    rig = make_rig(seed)
    data = make_dataset(rig, {}, SETS, seed)
    trial = replace(make_trials(SETS, seed)[place], unhooked=True)
    (clean,) = clean_dataset(rig, {}, [trial], seed)
    gone = logged(clean, MAKES[rig.make].chain_of(rig), BASIC, [seed, rig.seed, 99])
    after = data[place]["time_s"] >= 4.0
    for name in TORQUES:
        data[place][name] = np.where(after, gone[name], data[place][name])
    found = diagnosed(tmp_path, data, seed)
    assert found.verdict == "none", found.statement
    (event,) = found.events
    assert event.kind == "silent" and event.file.endswith("trial_03.csv")
    assert event.time == pytest.approx(4.0, abs=0.05)


@pytest.mark.parametrize("share", [1.0, 0.3])
def test_only_seconds_of_a_trial_of_its_own_pretension_are_to_be_left_out(
    tmp_path: Path, share: float
) -> None:
    seed, place, sets = 78, 5, "rich"
    trials = make_trials(sets, seed)
    assert [t.tightness < 1.0 for t in trials] == [k == place for k in range(8)]
    data = make_dataset(make_rig(seed), {}, sets, seed)
    early = data[place]["time_s"] < share * data[place]["time_s"][-1] + 1e-9
    data[place][TORQUES[0]] += np.where(early, 0.2, 0.0)
    write_data(tmp_path / "data", list(data), facts_of(sets, seed))
    found = infer(BENCH, [tmp_path / "data"])[0].diagnosis
    if share < 1.0:
        assert found.verdict == "none", found.statement
        (event,) = found.events
        assert event.kind == "motor_torque_offset" and "trial_05" in event.spans
        assert event.size.value == pytest.approx(0.2, abs=0.02)
        return
    assert found.verdict == "unknown", found.statement
    assert "trial_05" in found.question
    assert "no other has such a pretension" in found.question
    assert found.belief is not None and "is not known" in found.belief.statement


@pytest.mark.parametrize("channel", [ANGLES[1], *TORQUES])
def test_half_a_second_on_one_channel_is_to_be_declared(
    tmp_path: Path, channel: str
) -> None:
    seed = 74
    data = make_dataset(make_rig(seed, make="guides"), {}, SETS, seed)
    for columns in data:
        time = columns["time_s"]
        columns[channel] = np.interp(time - 0.5, time, columns[channel])
    found = diagnosed(tmp_path, data, seed)
    assert found.verdict == "fix-data", found.statement
    assert channel in found.statement and not found.runner_ups
    delay = float(found.statement.partition("delay = ")[2].partition(")")[0])
    assert delay == pytest.approx(0.5, abs=0.06)


@pytest.mark.parametrize("share", [0.6, 1.5])
def test_pulleys_of_the_other_side_are_to_be_fixed(
    tmp_path: Path, share: float
) -> None:
    seed = 75
    rig = make_rig(seed, make="guides")
    rig = replace(rig, joint_radius=share * rig.joint_radius)
    data = make_dataset(rig, {}, SETS, seed)
    inverse = replace(BENCH, joint_radius=BENCH.joint_radius / share)
    found = diagnosed(tmp_path, data, seed, inverse)
    assert found.verdict == "fix-data", found.statement
    assert "swapped" in found.statement and not found.runner_ups


@pytest.mark.parametrize(
    ("names", "said"), [(TORQUES, "torque columns"), (ANGLES, "are swapped")]
)
def test_columns_that_are_swapped_in_some_trials_are_to_be_fixed(
    tmp_path: Path, names: tuple[str, str], said: str
) -> None:
    seed = 76
    data = make_dataset(make_rig(seed, make="guides"), {}, SETS, seed)
    for place in (1, 4):
        one, other = names
        columns = data[place]
        columns[one], columns[other] = columns[other], columns[one]
    found = diagnosed(tmp_path, data, seed)
    assert found.verdict == "fix-data", found.statement
    assert said in found.statement and not found.runner_ups
    assert "trial_01" in found.statement and "trial_04" in found.statement


def test_friction_that_differs_at_random_by_trial_is_found_before_any_search(
    tmp_path: Path,
) -> None:
    seed = 77
    rig = make_rig(seed)
    random = np.random.default_rng(seed)
    every = make_trials(SETS, seed)
    data = []
    for k, trial in enumerate(every):
        factor = 1.0 + 0.25 * random.standard_normal()
        own = replace(
            rig, friction_a=factor * rig.friction_a, friction_b=factor * rig.friction_b
        )
        (clean,) = clean_dataset(own, {}, [trial], seed)
        chain = MAKES[rig.make].chain_of(rig)
        data.append(logged(clean, chain, BASIC, [seed, seed, k]))
    found = diagnosed(tmp_path, data, seed)
    assert found.verdict == "unknown", found.statement
    assert "differs from trial to trial" in found.statement and not found.runner_ups
