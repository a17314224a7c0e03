"""Reports of effects that tuning hides and of parameters tuned far from the scene."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cc_mujoco.diagnosis import (
    EFFECTS,
    DiagnosisResult,
    Options,
    fit_baseline,
    plant_of,
    prepare,
    run_inference,
)
from cc_mujoco.diagnosis._fit.intervals import Spread, estimates
from cc_mujoco.diagnosis._judge import (
    _suspected_unit,
    confounded_effects,
    detectability,
    deviating_parameters,
    untestable_effects,
)
from cc_mujoco.diagnosis._rig.simulation import BASELINE, REMEDIES
from cc_mujoco.diagnosis._search.candidates import Changes
from cc_mujoco.diagnosis._thresholds import Limit
from diagnosis.recorded import BENCH, dataset

HIDDEN = {"load_independent_friction": 8.0, "seal_proximal": 0.0, "seal_distal": 0.0}
IDS = ("load_independent_friction", "joint_gravity")


@pytest.fixture(scope="module")
def swallowed() -> DiagnosisResult:
    """Friction that needs no tension, on motions at one pretension."""
    data = dataset({IDS[0]: HIDDEN}, 2.5, seed=3, chosen=(0, 2))
    return run_inference(data, BENCH, Options(IDS))


def test_what_the_baseline_swallows_is_told_with_its_size(
    swallowed: DiagnosisResult,
) -> None:
    found = swallowed.diagnosis
    assert found.verdict == "none"
    (away,) = found.deviating
    assert away.parameter == "pretension"
    assert away.given == pytest.approx(80.0)
    assert away.tuned.value > 105.0
    assert "friction that needs no tension" in away.statement
    assert "second pretension" in away.statement
    assert away.statement[1:] in found.statement
    hidden = {each.id: each for each in found.confounded}
    assert set(hidden) == {"load_independent_friction"}
    size = float(hidden[IDS[0]].explains.split()[-2])
    assert size == pytest.approx(8.0, rel=0.5)


def test_cables_of_different_friction_are_told() -> None:
    data = dataset(duration=2.5, seed=3, chosen=(0, 2), balance=0.125)
    found = run_inference(data, BENCH, Options(IDS[1:])).diagnosis
    assert found.verdict == "none"
    (away,) = found.deviating
    assert away.parameter == "friction_balance"
    assert away.tuned.value == pytest.approx(0.125, rel=0.1)
    assert "pull each cable by itself" in found.statement


def test_nothing_runs_away_on_a_rig_like_the_scene() -> None:
    data = dataset(duration=1.5, seed=3, chosen=(0, 2), changes={"pretension": 84.0})
    assert run_inference(data, BENCH, Options(IDS[:1])).diagnosis.deviating == ()


def test_a_stiffness_far_from_the_scene_is_told_though_nobody_declared_it() -> None:
    data = dataset(duration=1.5, seed=3, changes={"axial_stiffness": 3e5})
    (away,) = run_inference(data, BENCH, Options(IDS[1:])).diagnosis.deviating
    assert away.parameter == "axial_stiffness"
    assert "angles in turns" in away.statement


def unseen(hidden: dict[str, dict[str, float]]) -> tuple[set[str], float]:
    """Return the untestable effects, and the misfit of the tuned scene."""
    data = dataset(hidden, 2.0, seed=3)
    records, filtering = prepare(data, BENCH)
    base = fit_baseline(data, plant_of(data, BENCH, records), filtering, 0)
    others = [name for name in EFFECTS if name not in hidden]
    shown = detectability(base.problem, base.whole.x, others, Changes())
    listed = untestable_effects(shown, confounded_effects(shown))
    reasons, least = {each.id: each.reason for each in listed}, shown.least
    assert least == pytest.approx(math.sqrt(Limit.floor_misfit**2 - 1.0))
    for each in shown.changes:
        left = np.linalg.norm(shown.left(each.made), axis=0)
        assert (each.effect.id in reasons) == (left.max() < least), reasons
        if each.effect.id in reasons and 10.0 * left.max() > least:
            assert "cannot be seen" in reasons[each.effect.id]
    return {each.id for each in listed}, base.crossed.misfit


def test_what_data_cannot_show_does_not_depend_on_what_is_missing() -> None:
    """Other effects, however large, do not count as noise."""
    nothing, small = unseen({})
    drag, large = unseen({"viscous_friction": {"viscous_friction": 400.0}})
    assert small < 1.5 and large > 5.0
    assert drag <= nothing
    assert len(nothing) <= 3


def test_a_unit_is_suspected_only_where_its_factor_is_about_right() -> None:
    assert _suspected_unit(1.0 / 6.0) == _suspected_unit(6.0) == "turns"
    assert _suspected_unit(57.0) == "degrees or radians"
    assert _suspected_unit(3.5) == _suspected_unit(1.0) == _suspected_unit(20.0) == ""
    assert not any("times" in remedy for remedy in REMEDIES.values())
    assert BASELINE.keys() <= REMEDIES.keys()


def test_parameters_of_effects_do_not_deviate() -> None:
    """They are tuned with the model, but the scene gives no values for them."""
    data = dataset(duration=1.0, seed=3, chosen=(0, 2))
    records, filtering = prepare(data, BENCH)
    base = fit_baseline(data, plant_of(data, BENCH, records), filtering, 0)
    for name, effect in EFFECTS.items():
        if name in base.problem.plant.library.effects:
            wider = base.problem.with_effect(name, dict(effect.starts[0]))
            far = wider.placed(base.whole.x, dict(effect.starts[0]))
            priors = np.array([each.prior for each in wider.tuned[base.whole.x.size :]])
            far[base.whole.x.size :] += np.where(np.isinf(priors), 3.0, 4.0 * priors)
            near = Spread(1e-9 * np.eye(far.size), np.full(far.size, np.inf))
            tuned = estimates(wider, far, near)
            assert deviating_parameters(wider, far, tuned, ()) == (), name
