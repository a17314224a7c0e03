"""A measured drive: what the bench lacks is named, for held-out loads, too."""

from __future__ import annotations

from pathlib import Path

import pytest

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.datasets._data_findings import errors
from cc_mujoco.diagnosis import Options, load, run_inference
from shared_folder import SHARED

STUDY = Path(__file__).parents[2] / "scripts" / "diagnosis_study"
DATA = SHARED / "data" / "davinci"
FITTED, HELD_OUT = ("freq4_load0", "freq4_load8"), ("freq4_load2", "freq2_load6")
SUSPECTS = ("end_compliance", "load_independent_friction", "viscous_friction")


ROWS = 2000
"""Ten seconds."""


@pytest.mark.shared
def test_compliance_and_friction_without_load_close_the_gap_on_other_loads(
    tmp_path: Path,
) -> None:
    for name in (*FITTED, *HELD_OUT):
        file = f"tool4_{name}.csv"
        lines = (DATA / file).read_text(encoding="utf-8").splitlines(keepends=True)
        (tmp_path / file).write_text("".join(lines[: 1 + ROWS]), encoding="utf-8")
    files = sorted(tmp_path.iterdir())
    dataset, findings = load(files, STUDY / "davinci.toml")
    assert not errors(findings)
    found = run_inference(
        dataset, Bench.of(scene_path("bench")), Options(SUSPECTS)
    ).diagnosis
    named = [effect.id for effect in found.effects]
    assert named[0] == "end_compliance"
    assert "viscous_friction" not in named
    for gap in found.gap.values():
        assert gap.rmse_after < 0.85 * gap.rmse_before
