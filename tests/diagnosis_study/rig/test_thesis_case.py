"""The case of the thesis (2.4.4): Coulomb model, viscous and Stribeck friction."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.datasets._data_findings import errors
from cc_mujoco.diagnosis import Options, load, run_inference
from rig.dataset import make_dataset
from rig.generate import facts_of, write_data
from rig.makes import MAKES
from rig.nominal import make_rig
from rig.trials import SETS, Trial

EFFECTS = MAKES["bristles"].effects

BOTH = {"viscous_friction", "stribeck_friction"}
SUSPECTS = (*sorted(BOTH), "presliding")
TRIALS, SECONDS = 5, 2.5
"""Enough of the rich trials to tell the two from one."""


@pytest.mark.study
def test_one_of_both_comes_first_and_both_are_found(
    tmp_path: Path,
    shortened: Callable[[Trial, float], Trial],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rich = SETS["rich"]
    monkeypatch.setitem(
        SETS,
        "rich",
        lambda rng: [shortened(trial, SECONDS) for trial in rich(rng)[:TRIALS]],
    )
    rig = make_rig(11)
    amounts = {name: 1.5 * EFFECTS[name].typical for name in BOTH}
    trials = make_dataset(rig, amounts, "rich", 11)
    write_data(tmp_path / "data", trials, facts_of("rich", 11))
    dataset, findings = load([tmp_path / "data"])
    assert not errors(findings)
    result = run_inference(
        dataset, Bench.of(scene_path("bench")), Options(ids=SUSPECTS)
    )
    found = result.diagnosis
    assert found.verdict == "named", found.statement
    assert {effect.id for effect in found.effects} == BOTH
    for gap in found.gap.values():
        assert gap.rmse_after < 0.9 * gap.rmse_before
        assert gap.gap_closed > 0.5
