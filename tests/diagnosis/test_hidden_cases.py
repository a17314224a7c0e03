"""Rigs of an independent simulation: what is said of effects that are hidden there."""

from __future__ import annotations

import pytest

from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis import Diagnosis, infer
from shared_folder import ABSENT, SHARED

CASES = SHARED / "cases" / "diagnosis"
PULLS = {"joint_gravity", "joint_stiffness"}

pytestmark = [
    pytest.mark.shared,
    pytest.mark.study,
    pytest.mark.skipif(not CASES.is_dir(), reason=ABSENT),
]


def diagnosed(name: str) -> Diagnosis:
    scene = CASES / name / "scene.xml"
    found = infer(Bench.of(scene), [CASES / name])[0].diagnosis
    # What is named is not what the data cannot show.
    told = {effect.id for effect in found.effects} | {
        rival for tie in found.ties for rival in tie
    }
    assert not told & {each.id for each in found.not_testable}
    assert not told & {each.id for each in found.confounded}
    assert f"model is {found.remaining:.1f} times the noise floor" in found.statement
    assert found.question == ""
    return found


def test_friction_without_load_is_named_alone() -> None:
    found = diagnosed("load_independent")
    assert found.verdict == "named", found.statement
    assert [each.id for each in found.missing] == ["load_independent_friction"]
    assert found.remaining < 1.5
    assert found.not_testable == ()


@pytest.mark.parametrize(
    ("case", "effect", "parameter", "value"),
    [
        ("drum", "drum_winding", "drum_growth", 0.01),
        ("drift_over_trials", "friction_by_order", "friction_per_trial", -0.4 / 7.0),
        ("ripple", "current_ripple", "ripple_order", 14.0),
    ],
)
def test_a_rare_effect_is_named_without_being_asked_for(
    case: str, effect: str, parameter: str, value: float
) -> None:
    found = diagnosed(case)
    assert found.verdict == "named", found.statement
    (named,) = found.missing
    assert named.id == effect
    assert named.parameters[parameter].value == pytest.approx(value, rel=0.01)
    assert found.remaining < 1.5


def test_drag_and_a_weight_are_both_named() -> None:
    found = diagnosed("viscous_gravity")
    assert found.verdict in ("named", "tie"), found.statement
    first, second = found.missing
    assert first.id == "viscous_friction" and second.id in PULLS
    assert {second.id, *second.rivals} <= PULLS
    assert len(found.not_testable) <= 2
