"""Conditions of any device, which follow from its description."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cc_mujoco import cli
from cc_mujoco.benchmark import (
    REFERENCES,
    SUITES,
    Cell,
    Condition,
    _position,
    batch_groups,
    play,
    play_group,
)
from cc_mujoco.benchmark._conditions import Together
from cc_mujoco.benchmark._plant import (
    EFFECTS,
    LAG_NAME,
    effect_values,
    sample_plants,
)
from cc_mujoco.benchmark._runner import provenance
from cc_mujoco.device import find_device
from cc_mujoco.errors import CableError
from cc_mujoco.human import Hold, Perturbed

GENERIC = SUITES["generic"]
KNEE = """
<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.001"><flag contact="disable"/></option>
  <extension><plugin plugin="cc_mujoco.cable">
    <instance name="rope">
      <config key="conduit" value="0.3:inf 0.3:0.2"/>
      <config key="segments" value="8"/>
      <config key="axial_stiffness" value="40000"/>
      <config key="pretension" value="8"/>
      <config key="friction" value="0.12"/>
    </instance>
  </plugin></extension>
  <worldbody>
    <body><joint name="drum" axis="0 1 0" armature="1e-3" damping="0.02"/>
      <geom size="0.02" mass="0.1"/></body>
    <body><joint name="knee" axis="0 1 0" range="0 2" damping="0.3"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.04" mass="3"/></body>
  </worldbody>
  <actuator>
    <motor name="winch" joint="drum" ctrlrange="-10 10"/>
    <general name="human" joint="knee" ctrlrange="0 2" gainprm="300"
      biastype="affine" biasprm="0 -300 -6"/>
    <plugin plugin="cc_mujoco.cable" instance="rope" joint="drum" gear="-0.02"/>
    <plugin plugin="cc_mujoco.cable" instance="rope" joint="knee" gear="0.05"/>
  </actuator>
</mujoco>
"""


@pytest.fixture
def knee(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the file of a device of the user's, in the working directory."""
    monkeypatch.chdir(tmp_path)
    Path("knee.xml").write_text(KNEE)
    return "knee.xml"


def short(scene: str) -> dict[str, Condition]:
    """Return the conditions of a device by name, cut to little more than a second."""
    return {
        one.name: dataclasses.replace(one, duration=1.05)
        for one in GENERIC.conditions(scene)
    }


def test_conditions_of_any_device_have_the_names_of_v1(knee: str) -> None:
    names = {one.name for one in SUITES["v1"].conditions("wrist")}
    found = short(knee)
    assert set(found) == names | {*tuple(EFFECTS)[:4], LAG_NAME, "own-rough"}
    assert all(one.label == "knee" for one in found.values())
    usual = found["ordinary-rough"]
    jolted = found["jolted"].trajectory
    assert isinstance(jolted, Perturbed) and jolted.base == usual.trajectory
    motion = usual.trajectory.sample(4.0, 0.01, np.random.default_rng(0))
    assert motion.angle[0] == pytest.approx(find_device(knee).description.axis().centre)
    assert motion.angle.min() > 0.0


def test_a_device_that_nobody_wears_has_no_conditions_of_a_wearer(knee: str) -> None:
    Path("knee.device.toml").write_text("[wearer.knee]\nnone = true\n")
    names = set(short(knee))
    assert not names & {"wearer-soft", "wearer-stiff", "reversals", "jolted"}
    assert "ordinary-rough" in names and "viscous" in names


def test_an_effect_is_in_the_plant_and_in_no_belief(knee: str) -> None:
    conditions = short(knee)
    for name in ("viscous", "seals", "presliding", "load-independent"):
        (drawn,) = sample_plants(conditions[name], (0,))
        changed = effect_values(find_device(knee), name)
        assert changed and set(changed) <= set(drawn.plant.values)
        assert not set(changed) & set(drawn.known.values)
        assert (
            drawn.known.cables["rope"].friction == drawn.plant.cables["rope"].friction
        )
    drag = effect_values(find_device(knee), "seals")["rope.seal_distal"]
    # A tenth of the tension of the torque that counts as 1, at both ends together.
    unit = find_device(knee).description.axis().units["desired_torque_nm"]
    assert drag == pytest.approx(0.05 * unit / 0.05)


def test_a_motor_that_lags_gives_its_torque_later(knee: str) -> None:
    conditions = short(knee)
    lagging = dataclasses.replace(conditions["motor-lag"], delay=(0, 0), noise=0.0)
    usual = dataclasses.replace(lagging, structure="")
    errors = []
    for condition in (usual, lagging):
        found = play(Cell(condition, "none", (0,)))
        assert found.scores["failed"][0] == 0.0
        errors.append(found.scores["rms_motor_torque"][0])
    assert errors[0] != errors[1]


@pytest.mark.study
def test_every_condition_and_reference_is_played(knee: str) -> None:
    conditions = short(knee)
    cells = [Cell(condition, "pi", (0,)) for condition in conditions.values()]
    for group in batch_groups(cells):
        for cell, found in zip(group, play_group(group), strict=True):
            error = found.scores["rms_torque_error"][0]
            assert np.isfinite(error), cell.condition.name
    for name in REFERENCES:
        found = play(Cell(conditions["own-rough"], name, (0,)))
        assert found.scores["failed"][0] == 0.0


def test_axes_of_a_device_have_scores_of_their_own() -> None:
    conditions = short("exosuit")
    assert isinstance(conditions["reversals"].trajectory, Together)
    assert conditions["reversals"].task == (Hold(5.0), Hold(-15.0))
    cell = Cell(conditions["ordinary-rough"], "hip=pi,ankle=none", (0, 1))
    found = play(cell)
    each = [found.scores[f"{axis}.rms_torque_error"] for axis in ("hip", "ankle")]
    assert np.allclose(found.scores["rms_torque_error"], np.mean(each, axis=0))
    assert len(found.plants["plant_friction"][0]) == 2
    alone = play(dataclasses.replace(cell, seeds=(1,)))
    for name, values in alone.scores.items():
        assert np.array_equal(values, found.scores[name][1:], equal_nan=True)


def test_all_effects_reach_both_axes() -> None:
    values = effect_values(find_device("exosuit"), "viscous")
    assert {name.partition(".")[0] for name in values} == {"thigh", "heel"}
    sealed = effect_values(find_device("exosuit"), "seals")
    assert {name.partition(".")[0] for name in sealed} == {"heel"}


@pytest.mark.usefixtures("undrawn")
def test_a_file_is_benchmarked_and_verified_until_it_changes(
    knee: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["benchmark", knee, "--controllers", "pi", "--seeds", "1"]
    words += ["--conditions", "ordinary-rough", "--duration", "1.05", "--workers", "1"]
    assert cli.main(words) == 0
    shown = capsys.readouterr().out
    assert "The safe torque of device knee is assumed: " in shown
    assert "nan" not in shown
    results = Path("runs", "benchmark", "results.parquet")
    table = pq.read_table(results)
    assert set(table["scene"].to_pylist()) == {"knee"}
    assert Path("runs", "benchmark", "knee-pareto.png").exists()
    verify = ["benchmark", "--verify", str(results), "--rows", "1"]
    assert cli.main(verify) == 0
    before = provenance([], [knee])["files"]
    Path(knee).write_text(KNEE.replace('value="8"', 'value="9"'))
    assert provenance([], [knee])["files"] != before
    capsys.readouterr()
    assert cli.main(verify) == 2
    assert "knee.xml" in capsys.readouterr().err


def test_suites_say_what_they_cannot_play(knee: str) -> None:
    with pytest.raises(CableError, match="not exosuit: `--suite generic`"):
        SUITES["v1"].conditions("exosuit")
    for scene in (knee, "hand"):
        with pytest.raises(CableError, match=f"not {scene}: `--suite generic` plays"):
            SUITES["v1"].conditions(scene)
    with pytest.raises(CableError, match="did you mean 'wrist'"):
        SUITES["v1"].conditions("wrst")


def test_a_commanded_angle_has_a_suite_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = {
        one.name: dataclasses.replace(one, duration=1.02)
        for one in SUITES["position"].conditions("endoscope")
    }
    assert len(found) == 8
    drawn = sample_plants(found["friction-doubled-stale"], (3,))[0]
    own, known = (one.cables["tendon"].friction for one in (drawn.plant, drawn.known))
    assert own == pytest.approx(2.0 * known)
    wrong = {"linear": {"slope": 0.5, "offset": 0.0}}
    monkeypatch.setattr(_position, "fresh_fits", lambda *_: [wrong])
    cells = [Cell(found[f"ordinary-{way}"], "linear") for way in ("stale", "fitted")]
    assert batch_groups(cells) == [cells]
    stale, fitted = (one.scores for one in play_group(cells))
    assert "rms_torque_error" not in stale
    assert fitted["rms_angle_error"] > 1.5 * stale["rms_angle_error"]
    with pytest.raises(CableError, match="`--suite generic` plays it"):
        SUITES["position"].conditions("wrist")
