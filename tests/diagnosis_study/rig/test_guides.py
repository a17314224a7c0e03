"""The rig with guides obeys what is known of cables, by other equations than `rig`."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from rig.dataset import clean_dataset, make_trials, run, truth_of
from rig.engine import COLUMNS
from rig.guides import GUIDES, SEATING, plant_of, pull_across, settle, start
from rig.makes import MAKES
from rig.nominal import Rig, make_rig
from rig.sensors import BASIC, CHANNELS
from rig.trials import Trial
from study_marks import study_but

EFFECTS = MAKES["guides"].effects


@pytest.fixture(scope="module")
def rig() -> Rig:
    return make_rig(3, make="guides")


@pytest.fixture(scope="module")
def trial() -> Trial:
    """Two seconds with many reversals."""
    whole = make_trials("rich", 3)[4]
    return dataclasses.replace(
        whole, command=whole.command[:2001], target=whole.target[:2001]
    )


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_cable_that_slides_obeys_the_capstan_equation(rig: Rig, way: float) -> None:
    p = plant_of(rig)
    cables = start(p, 80.0, (0.0, 0.0))
    for k in range(400):
        there = way * 1e-4 * k
        near, far = settle(p, cables, 0, 80.0, there, there, 0.0, 1e-3)
    gain = math.exp(way * rig.friction_a * rig.wrap)
    assert near / far == pytest.approx(gain, rel=1e-5)
    tension = cables.tension[0]
    at_each = np.exp(way * rig.friction_a * p.bend[0])
    np.testing.assert_allclose(tension[:-1] / tension[1:], at_each, rtol=1e-4)
    assert p.bend[0].sum() == pytest.approx(rig.wrap)


def test_a_cable_that_is_let_go_is_slack_and_comes_back(rig: Rig) -> None:
    p = plant_of(rig)
    cables = start(p, 80.0, (0.0, 0.0))
    for near in [*np.linspace(0.0, -0.05, 100), *np.linspace(-0.05, 0.0, 100)]:
        settle(p, cables, 0, 80.0, near, 0.0, 0.0, 1e-3)
        assert np.all(cables.tension >= 0.0)
        if near == -0.05:
            assert cables.tension[0, 0] == 0.0
    assert cables.tension[0].max() > 40.0


@pytest.mark.parametrize(
    "effects",
    [{}, {"viscous_friction": 80.0}, {"dwell_dependent_stiction": 0.5},
     {"cable_stiffening": 2e-3}],
    ids=str,
)  # fmt: skip
def test_work_is_dissipated_or_stored(
    rig: Rig, trial: Trial, effects: dict[str, float]
) -> None:
    records = run(truth_of(rig, effects, 3), rig, trial)
    work_in, work_out, lost = (
        records[:, COLUMNS.index(f"work_{name}")] for name in ("in", "out", "friction")
    )
    assert lost[-1] > 1.0
    assert np.all(np.diff(lost[::50]) > -1e-4)
    if "cable_stiffening" not in effects:  # its springs are no straight lines
        stored = records[:, COLUMNS.index("energy_stored")]
        left = work_in - work_out - lost - (stored - stored[0])
        assert np.abs(left).max() < 1e-3 * lost[-1]


def test_half_the_step_changes_less_than_a_tenth_of_the_noise(
    rig: Rig, trial: Trial
) -> None:
    truth = truth_of(rig, {}, 3)
    one, other = (run(truth, rig, trial, refine) for refine in (1, 2))
    for name in ("motor_torque", "joint_angle", "joint_torque"):
        k = COLUMNS.index(name)
        change = np.sqrt(np.mean((one[:, k] - other[:, k]) ** 2))
        assert change < 0.1 * CHANNELS[name].floor


def test_without_effects_it_is_the_rig_of_the_other_make_to_about_the_noise(
    trial: Trial,
) -> None:
    seen = [
        clean_dataset(make_rig(3, make=make), {}, [trial], 3)[0]
        for make in ("bristles", "guides")
    ]
    floor = np.array([CHANNELS[name].floor for name in BASIC])
    assert np.all(np.sqrt(np.mean((seen[0] - seen[1]) ** 2, axis=0)) < 3.0 * floor)


@pytest.mark.parametrize("name", study_but(4, EFFECTS))
def test_an_effect_is_off_at_zero_and_shows_at_its_usual_amount(
    rig: Rig, trial: Trial, name: str
) -> None:
    short = dataclasses.replace(
        trial, command=trial.command[:1401], target=trial.target[:1401]
    )
    plain, hidden = (
        clean_dataset(rig, effects, [short], 3)[0]
        for effects in ({name: 0.0}, {name: 3.0 * EFFECTS[name].typical})
    )
    floor = np.array([CHANNELS[each].floor for each in BASIC])
    np.testing.assert_array_equal(plain, clean_dataset(rig, {}, [short], 3)[0])
    assert np.all(np.isfinite(hidden))
    if name != "unknown_snapping_conduit":  # needs more tension than this trial has
        assert np.max(np.abs(hidden - plain) / floor) > 1.0


def test_both_makes_hide_what_a_library_can_know() -> None:
    named = {*MAKES["bristles"].named, "joint_friction"}
    assert set(MAKES["guides"].named) == named
    assert not set(MAKES["guides"].unknown) & set(MAKES["bristles"].unknown)
    assert plant_of(make_rig(4)).bend.shape == (2, GUIDES)


@pytest.mark.parametrize("stretch", [1e-6, 1e-4, 1e-3, 5e-3])
def test_a_piece_that_crosses_a_gap_stretches_by_both(stretch: float) -> None:
    stiffness, room, step = 1e6, 1e-3, 1e-9
    tension, slope = pull_across(stiffness, stretch, room)
    whole = tension / stiffness + room * tension / (tension + SEATING)
    assert whole == pytest.approx(stretch, rel=1e-9)
    more = pull_across(stiffness, stretch + step, room)[0]
    assert slope == pytest.approx((more - tension) / step, rel=1e-3)
    assert pull_across(stiffness, -stretch, room) == (0.0, 0.0)
