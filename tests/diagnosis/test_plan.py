"""Trials that are planned show every effect of the library, and are ready to play."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.datasets._columns import DATASET_FILE
from cc_mujoco.datasets._dataset_file import read_dataset_file
from cc_mujoco.datasets._torques import expected_instruments
from cc_mujoco.diagnosis import MOTION_STEP, plan
from cc_mujoco.diagnosis._propose.experiment import (
    LEAST,
    MOST,
    USUAL,
    TrialSettings,
    middle_angle,
    motions,
)
from cc_mujoco.diagnosis._propose.planning import PLAN_PAGE, TrialPlan, planned
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.errors import CableError
from hardware.devices import ARM, KNEE, written
from study_marks import study_but

REACH, SPEED = 0.8, 3.0
ANKLE_RANGE = 'name="ankle" type="hinge" axis="0 -1 0" range="-0.9 0.6"'
IDS = (
    "viscous_friction",
    "end_compliance",
    "joint_gravity",
    "joint_stiffness",
    "torque_sensor_offset",
)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[TrialPlan, Path]:
    out = tmp_path_factory.mktemp("plan") / "out"
    return plan(scene_path("bench"), out, reach=REACH, speed=SPEED, ids=IDS), out


def test_effects_show_and_are_told_from_each_other(
    made: tuple[TrialPlan, Path],
) -> None:
    found, _ = made
    assert {each.id for each in found.resolved} == set(IDS)
    assert len(found.trials) < 10
    assert all(each.separation >= Limit.min_clarity for each in found.resolved)
    assert all(each.clarity >= each.separation for each in found.resolved)
    assert sum(motion.tilt > 0.0 for motion in found.trials) == 1
    hooked = [motion.pretension > 0.0 for motion in found.trials]
    assert hooked == [True] * (len(hooked) - 2) + [False] * 2
    assert found.trials[-1].known_torques == (2.0, 2.0)


def test_a_rig_twice_as_strong_has_the_same_plan(made: tuple[TrialPlan, Path]) -> None:
    """Forces, torques, stiffness and noise double, and so do plausible sizes."""
    usual, _ = made
    bench = Bench.of(scene_path("bench"))
    cables = tuple(
        cable.replace(
            pretension=2.0 * cable.pretension,
            axial_stiffness=2.0 * cable.axial_stiffness,
        )
        for cable in bench.cables
    )
    strong = planned(replace(bench, cables=cables), REACH, SPEED, {}, {}, IDS)
    described = [
        [
            re.sub(r"[(].* at the .*[)]", "", motion.description)
            for motion in plan.trials
        ]
        for plan in (usual, strong)
    ]
    assert described[0] == described[1]
    known = {each.id: each for each in usual.resolved}
    for each in strong.resolved:
        soft = each.id == "end_compliance"
        grown = 0.5 if soft else 2.0
        assert each.plausible == pytest.approx(grown * known[each.id].plausible)
        # Changes are simulated at the size of the bench; soft ends are not linear.
        slack = 0.25 if soft else 1e-3
        assert each.separation == pytest.approx(known[each.id].separation, rel=slack)
        assert each.least == pytest.approx(grown * known[each.id].least, rel=slack)


def test_files_are_what_the_page_says(made: tuple[TrialPlan, Path]) -> None:
    found, out = made
    page = (out / PLAN_PAGE).read_text(encoding="utf-8")
    facts = read_dataset_file(out / "dataset.toml").facts
    for k, motion in enumerate(found.trials, start=1):
        table = np.genfromtxt(out / f"motion_{k:02d}.csv", delimiter=",", names=True)
        np.testing.assert_allclose(table["motor_angle_rad"], motion.motor, atol=1e-6)
        assert np.allclose(np.diff(table["time_s"]), MOTION_STEP)
        assert f"motion_{k:02d}.csv" in page
        told = facts[f"trial_{k:02d}"]
        assert told.get("pretension", 0.0) == pytest.approx(80.0 * motion.pretension)
        assert told.get("unhooked", False) is (motion.pretension == 0.0)
        assert told.get("tilt", 0.0) == pytest.approx(motion.tilt, abs=1e-3)
    assert all(name in page for name in IDS)
    assert "If the rig cannot be turned" in page


@pytest.mark.parametrize("settings", [USUAL, LEAST, MOST])
@pytest.mark.parametrize("fastest", [SPEED, 0.3])
def test_motions_stay_within_the_limits_and_have_no_jumps(
    settings: TrialSettings, fastest: float
) -> None:
    bench = Bench.of(scene_path("bench"))
    for motion in motions(bench, REACH, fastest, settings=settings):
        beyond = "times the range" in motion.description
        reach = REACH * settings.size * (4.0 if beyond else 1.0)
        assert np.max(np.abs(motion.motor)) <= reach * (1.0 + 1e-9)
        speed = np.abs(np.diff(motion.motor)) / MOTION_STEP
        assert np.max(speed) <= fastest * 1.01, motion.description
        if motion.pretension == 0.0:
            continue
        taut = tuple(
            cable.replace(pretension=motion.pretension * cable.pretension)
            for cable in bench.cables
        )
        played = replace(bench, cables=taut).transmission.replay(
            MOTION_STEP, motor_angle=motion.motor, joint_angle=motion.joint
        )
        assert played.tension_proximal.min() > 0.0, motion.description
        assert played.tension_distal.min() > 0.0, motion.description


def test_limits_that_are_none_and_files_of_others_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CableError, match="reach is 0; it must be more than 0"):
        plan(scene_path("bench"), tmp_path / "a", reach=0.0)
    (tmp_path / "motion_01.csv").write_text("mine", encoding="utf-8")
    with pytest.raises(CableError, match="which no such run wrote"):
        plan(scene_path("bench"), tmp_path, reach=0.5)
    assert (tmp_path / "motion_01.csv").read_text(encoding="utf-8") == "mine"


def test_a_reach_in_degrees_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CableError, match=r"more than a turn of joint .* in radians"):
        plan(scene_path("bench"), tmp_path / "a", reach=45.0)
    assert not (tmp_path / "a").exists()


def test_what_was_corrected_in_a_plan_is_not_replaced(
    made: tuple[TrialPlan, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "cc_mujoco.diagnosis._propose.planning.planned", lambda *_: made[0]
    )
    for reach in (0.8, 0.4):  # another plan in the place of one that nobody touched
        plan(scene_path("bench"), tmp_path, reach=reach, ids=IDS[:2])
    facts = tmp_path / "dataset.toml"
    mine = facts.read_text(encoding="utf-8") + "# It slipped in trial 2.\n"
    facts.write_text(mine, encoding="utf-8")
    with pytest.raises(CableError, match="is not as an earlier run wrote it"):
        plan(scene_path("bench"), tmp_path, reach=0.8, ids=IDS[:2])
    assert facts.read_text(encoding="utf-8") == mine


def told(folder: Path, text: str) -> Path:
    path = folder / "known.toml"
    path.write_text(text, encoding="utf-8")
    return path


NO_JOINT = "[columns.joint_torque_nm]\nmeasured = false\n"
CELLS = "".join(
    f"[columns.tension_{cable}_proximal_n]\nnoise = 0.1\n"
    for cable in ("agonist", "antagonist")
)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("", ("torque sensor", "torque sensor")),
        (NO_JOINT, ("torque sensor", None)),
        (CELLS, ("load cells", "torque sensor")),
        (
            CELLS + "[columns.motor_torque_nm]\nnoise = 0.1\n",
            ("torque sensor", "torque sensor"),
        ),
        ("[rig]\ntorque_constant = 0.5\n", ("motor current", "torque sensor")),
        (f"[rig]\nload_stiffness = 4.0\n{NO_JOINT}", ("torque sensor", "known load")),
    ],
)
def test_instruments_are_expected_by_what_is_declared(
    tmp_path: Path, text: str, wanted: tuple[str | None, str | None]
) -> None:
    file = read_dataset_file(told(tmp_path, text))
    assert expected_instruments(file, Bench.of(scene_path("bench"))) == wanted


@pytest.mark.parametrize(
    ("text", "unseen", "said"),
    [
        (NO_JOINT, {"joint_gravity", "joint_stiffness"}, "joint's torque not at all"),
        (CELLS, set(), "motor's torque from load cells, 0.00707 N m of noise"),
        pytest.param(
            f"[rig]\nload_stiffness = 4.0\n{NO_JOINT}",
            set(),
            "from known load",
            marks=pytest.mark.study,
        ),
    ],
)
def test_a_plan_says_what_other_instruments_cannot_show(
    tmp_path: Path, text: str, unseen: set[str], said: str
) -> None:
    file = told(tmp_path, text)
    ids = IDS[2:]  # those that take no replay
    found = plan(scene_path("bench"), tmp_path / "out", dataset_toml=file, ids=ids)
    page = (tmp_path / "out" / PLAN_PAGE).read_text(encoding="utf-8")
    assert said in page
    assert set(found.hidden) == unseen
    assert {each.id for each in found.resolved} == set(ids) - unseen
    assert all(f"| {name} | " in page for name in unseen)
    again = read_dataset_file(tmp_path / "out" / DATASET_FILE)  # of the recordings
    bench = Bench.of(scene_path("bench"))
    assert expected_instruments(again, bench) == expected_instruments(
        read_dataset_file(file), bench
    )
    assert again.columns.keys() == read_dataset_file(file).columns.keys()
    turns = all("turning its load" in motion.description for motion in found.trials)
    assert turns is ("known load" in said)


def test_no_torque_at_all_is_no_plan(tmp_path: Path) -> None:
    file = told(tmp_path, f"{NO_JOINT}[columns.motor_torque_nm]\nmeasured = false\n")
    with pytest.raises(CableError, match="neither torque is measured"):
        plan(scene_path("bench"), tmp_path / "out", dataset_toml=file)


@pytest.mark.study
def test_a_tendon_in_the_open_is_planned_within_its_range(tmp_path: Path) -> None:
    bench = Bench.of(scene_path("finger"))
    found = plan(bench.path, tmp_path / "out", ids=IDS[:2])
    for motion in found.trials:
        assert motion.joint.min() > bench.span[0]
        assert motion.joint.max() < bench.span[1]
    assert all(each.separation > Limit.min_clarity for each in found.resolved)
    with pytest.raises(CableError, match="its lever is not known"):
        plan(bench.path, tmp_path / "far", reach=3.0)


@pytest.mark.parametrize("limits", [(0.0, 1.2), (-0.1, 1.2), (-1.2, 0.0), (-1.2, 1.2)])
def test_motions_stay_where_the_joint_can_turn(limits: tuple[float, float]) -> None:
    """A range that begins at 0 has its middle elsewhere."""
    bench = replace(Bench.of(scene_path("finger")), span=limits)
    swing = 0.5 * float(np.ptp(bench.following(np.array(limits))))
    for reach in (0.3 * swing, swing):
        for motion in motions(bench, reach, SPEED):
            if motion.usual:
                assert motion.joint.min() > limits[0] - 1e-3
                assert motion.joint.max() < limits[1] + 1e-3
    at_rest = abs(middle_angle(bench, 0.3 * swing)) < 1e-9
    assert at_rest is (limits == (-1.2, 1.2))


def test_a_lever_that_turns_to_one_side_has_a_plan(tmp_path: Path) -> None:
    text = Path(scene_path("ankle")).read_text(encoding="utf-8")
    assert ANKLE_RANGE in text
    scene = tmp_path / "one_sided.xml"
    scene.write_text(
        text.replace(ANKLE_RANGE, ANKLE_RANGE.replace("-0.9", "0")),
        encoding="utf-8",
    )
    found = plan(scene, tmp_path / "out", ids=IDS[2:4])
    low, high = Bench.of(scene).span
    for motion in found.trials:
        assert low - 1e-3 < motion.joint.min() < motion.joint.max() < high + 1e-3


def test_a_lone_cable_stays_taut_in_every_planned_trial(tmp_path: Path) -> None:
    found = plan("ankle", tmp_path / "out", ids=IDS[:2])
    assert len(found.slack) == len(found.trials)
    assert max(found.slack) <= Limit.max_slack
    hooked = [trial for trial in found.trials if trial.pretension]
    loads = ("weight of", "spring", "locked")
    assert all(any(load in t.description for load in loads) for t in hooked)
    page = (tmp_path / "out" / PLAN_PAGE).read_text(encoding="utf-8")
    assert "slack" in page and "joint free" not in page


def test_the_noise_of_a_plan_is_declared_or_described(tmp_path: Path) -> None:
    scene = written(tmp_path, KNEE, "knee.xml")
    (tmp_path / "knee.device.toml").write_text("[sensors]\ntorque_noise = 0.7\n")
    described = plan(scene, tmp_path / "described", ids=IDS[:1])
    assert described.noise["joint_torque_nm"] == 0.7
    assert "the joint's torque from torque sensor, 0.700 N m of noise" in (
        tmp_path / "described" / PLAN_PAGE
    ).read_text(encoding="utf-8")
    dataset = tmp_path / "dataset.toml"
    dataset.write_text("[columns.joint_torque_nm]\nnoise = 0.2\n")
    declared = plan(scene, tmp_path / "declared", dataset_toml=dataset, ids=IDS[:1])
    assert declared.noise["joint_torque_nm"] == 0.2


@pytest.mark.parametrize("text", study_but(2, [ARM, KNEE]))
def test_a_plan_stays_within_the_joints_own_motions(tmp_path: Path, text: str) -> None:
    scene = written(tmp_path, text)
    axis = "elbow" if text is ARM else None
    found = plan(scene, tmp_path / "out", axis=axis, ids=IDS[2:4])
    bench = Bench.of(scene, axis)
    least = min(motion.joint.min() for motion in found.trials)
    most = max(motion.joint.max() for motion in found.trials)
    assert bench.centre - bench.reach - 1e-3 < least
    assert most < bench.centre + bench.reach + 1e-3
    assert most - least > 0.3
    with pytest.raises(CableError, match="it must be at most"):
        plan(scene, tmp_path / "far", axis=axis, reach=9.0)


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        (("tension_flexor_proximal_n",), "unknown load cell 'tension_flexor_proximal"),
        (("tension_agonist_distal_n",), "tension_antagonist_distal_n as well"),
    ],
)
def test_load_cells_that_make_no_torque_are_refused(
    tmp_path: Path, cells: tuple[str, ...], said: str
) -> None:
    text = "[columns.joint_torque_nm]\nmeasured = false\n"
    text += "".join(f"[columns.{name}]\nnoise = 0.05\n" for name in cells)
    with pytest.raises(CableError, match=said):
        plan(scene_path("bench"), tmp_path / "out", dataset_toml=told(tmp_path, text))
    assert not (tmp_path / "out").exists()
