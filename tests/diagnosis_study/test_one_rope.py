"""One cable: its plan is recorded on an independent rig, and diagnosed by files.

The second cable of the rig has no friction and next to no stiffness, so it pulls with
its pretension alone: it is the weight that hangs at the joint. Torques are counted from
what it pulls.
"""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnose_benchmark import trial_of

from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis import Diagnosis, infer, plan
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.hardware._references import Planned, read_plan
from diagnosis.rigs import alone
from rig.dataset import run, truth_of
from rig.engine import COLUMNS
from rig.generate import write_data
from rig.makes import Truth
from rig.nominal import Rig, make_rig
from rig.sensors import BASIC, logged, sampled
from rig.trials import Trial

REACH, SPEED = 0.8, 2.5
IDS = ("viscous_friction", "end_compliance")
SEED = 41
_LIMP = 1e-3
"""Stiffness of a piece of the weight's cable [N/m]."""
Columns = dict[str, np.ndarray]


def rope(rig: Rig, hidden: dict[str, float]) -> Truth:
    """Return a rig whose second cable pulls with a constant force."""
    truth = truth_of(rig, hidden, SEED)
    plant = truth.plant
    piece, friction = plant.piece.copy(), plant.friction.copy()
    piece[1], friction[1] = _LIMP, 0.0
    return truth._replace(plant=plant._replace(piece=piece, friction=friction))


def played(truth: Truth, rig: Rig, trial: Trial) -> tuple[np.ndarray, np.ndarray]:
    """Return records with the torques of the first cable, and its end tensions [N]."""
    records = run(truth, rig, trial)
    if not trial.unhooked:
        pull = rig.pretension * trial.tightness
        for name, radius in (
            ("motor_torque", rig.motor_radius), ("joint_torque", rig.joint_radius),
        ):  # fmt: skip
            records[:, COLUMNS.index(name)] += radius * pull
    ends = [COLUMNS.index(f"tension_a_{end}") for end in ("proximal", "distal")]
    return records, records[:, ends]


def trials_of(folder: Path) -> list[tuple[Planned, Trial]]:
    """Return the trials of a plan, as the rig plays them."""
    facts = tomllib.loads((folder / "dataset.toml").read_text())["trials"]
    return [(each, trial_of(each, facts[each.name])) for each in read_plan(folder)]


def recorded(folder: Path, rig: Rig, hidden: dict[str, float], out: Path) -> float:
    """Record a plan, and return the largest share of a trial that is slack."""
    truth = rope(rig, hidden)
    data, slack = [], []
    for k, (_, trial) in enumerate(trials_of(folder)):
        records, ends = played(truth, rig, trial)
        if not trial.unhooked:
            slack.append(float(np.mean(ends.min(axis=1) <= 0.0)))
        clean = sampled(records, rig, truth.chain, BASIC)
        data.append(logged(clean, truth.chain, BASIC, [SEED, rig.seed, k]))
    write_data(out, data, (folder / "dataset.toml").read_text())
    for k in reversed(range(len(data))):  # a plan counts from 1
        (out / f"trial_{k:02d}.csv").rename(out / f"trial_{k + 1:02d}.csv")
    return max(slack)


@pytest.mark.study
def test_a_rig_with_one_cable_stays_taut_in_what_is_planned(tmp_path: Path) -> None:
    plan(alone(tmp_path), tmp_path / "plan", ids=IDS, reach=REACH, speed=SPEED)
    rig = make_rig(SEED, make="guides")
    truth, hung = rope(rig, {}), 0
    for planned, trial in trials_of(tmp_path / "plan"):
        if trial.unhooked:
            continue
        hung += "weight" in planned.notes
        short = replace(trial, command=trial.command[:8000], target=trial.target[:8000])
        _, ends = played(truth, rig, short)
        assert ends.min() > 0.3 * rig.pretension * trial.tightness
        assert np.ptp(ends) > 0.1 * rig.pretension
    assert hung >= 1


@pytest.mark.study
@pytest.mark.parametrize(
    ("hidden", "amount"),
    [
        ("", 0.0),
        ("viscous_friction", 60.0),
        ("end_compliance", 4e-5),
        ("joint_friction", 0.3),
    ],
)
def test_a_plan_of_one_cable_is_recorded_taut_and_diagnosed(
    tmp_path: Path, hidden: str, amount: float
) -> None:
    scene = alone(tmp_path)
    plan(scene, tmp_path / "plan", reach=REACH, speed=SPEED)
    rig = make_rig(SEED, make="guides")
    effects = {hidden: amount} if hidden else {}
    slack = recorded(tmp_path / "plan", rig, effects, tmp_path / "data")
    assert slack <= Limit.max_slack
    found: Diagnosis = infer(Bench.of(scene), [tmp_path / "data"])[0].diagnosis
    assert found.verdict == ("named" if hidden else "none"), found.statement
    assert [each.id for each in found.missing] == ([hidden] if hidden else [])
    assert max(each.slack for each in found.trials) <= Limit.max_slack
