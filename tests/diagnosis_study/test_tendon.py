"""The finger's tendon is diagnosed, on a rig of closed forms and on MuJoCo's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tendon import HIDDEN, OTHERWISE, recorded

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis import Options, run_inference
from cc_mujoco.diagnosis._report.output import (
    rollout_difference,
    write_and_compare_scene,
)

FINGER = Bench.of(scene_path("finger"))
FEW = ("viscous_friction", "end_compliance", "load_independent_friction")
pytestmark = pytest.mark.study


@pytest.mark.parametrize("rig", ["closed forms", "MuJoCo"])
@pytest.mark.parametrize("name", ["none", "viscous_friction", "end_compliance"])
def test_an_effect_in_the_tendon_is_named_and_repaired(
    tmp_path: Path, rig: str, name: str
) -> None:
    data = recorded(rig, HIDDEN[name], 1, seconds=3.0 if rig == "closed forms" else 2.0)
    result = run_inference(data, FINGER, Options(ids=FEW))
    found = result.diagnosis
    wanted = [] if name == "none" else [name]
    assert [each.id for each in found.missing] == wanted, found.statement
    assert found.baseline.parameters["friction"].value == pytest.approx(
        OTHERWISE["friction"], rel=0.02
    )
    assert "joint_radius" not in found.baseline.parameters
    for effect in found.missing:
        value = effect.parameters[name]
        assert value.value == pytest.approx(HIDDEN[name][name], rel=0.1)
    if wanted:  # viscous friction makes 1.4 floors in RMS, which leaves little to close
        assert all(gap.gap_closed > 0.75 for gap in found.gap.values())
    path = tmp_path / "scene.xml"
    write_and_compare_scene(result, path)
    _, apart, size = rollout_difference(result, path)
    assert apart < 2e-3 * size
    assert Bench.of(path).cables[0].friction == pytest.approx(0.22, rel=0.02)


def test_what_a_tied_tendon_cannot_have_is_told() -> None:
    data = recorded("closed forms", {}, 2, seconds=3.0)
    found = run_inference(data, FINGER, Options(ids=FEW)).diagnosis
    told = {each.id: each.reason for each in found.not_testable}
    assert "nothing has play" in told["backlash"]
    assert "at every angle" in told["configuration_dependent_wrap"]
    assert np.isfinite(found.gap["joint_torque_nm"].rmse_before)
