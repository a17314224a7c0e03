"""The word for what a search found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from cc_mujoco.diagnosis import _judge as verdict_rules
from cc_mujoco.diagnosis._judge import Stretch, cause_classes, verdict_of
from cc_mujoco.diagnosis._phrases import class_statement
from cc_mujoco.diagnosis._rig.simulation import BASELINE
from cc_mujoco.diagnosis._search.candidates import Round
from cc_mujoco.diagnosis._search.search import Found, is_needed, only_refines
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import Deviating, FoundEffect, Gap
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.diagnosis.effects._causes import CLASSES
from cc_mujoco.estimation import Estimate

GAP = {"motor_torque_nm": Gap(0.05, 0.04, 0.02, 0.43, (0.3, 0.5))}
CLOSED = {"motor_torque_nm": Gap(0.05, 0.025, 0.02, 0.89, (0.8, 0.95))}
ALIKE = ("stribeck_friction", "dwell_dependent_stiction")
GAIN = "torque_sensor_gain"
REASON = "fits only with joint_torque_gain -0.83, which is beyond -0.3 to 0.3"


def search(misfit: float, left: float, reason: str = "") -> Any:
    """Return a search that changed the misfit from one value to another."""
    sure = {"problem": SimpleNamespace(inflation=1.0), "errors": ()}
    before = SimpleNamespace(misfit=misfit, **sure)
    # The refused candidate takes a quarter of the error.
    near = 1.0 + 0.75 * (misfit - 1.0)
    crossed = SimpleNamespace(misfit_by=lambda _: near)
    last = SimpleNamespace(id=GAIN, reason=reason, crossed=crossed, reduction=0.4)
    return SimpleNamespace(
        before=before,
        after=SimpleNamespace(misfit=left, **sure),
        rounds=(SimpleNamespace(candidates=(last,), before=before),),
    )


def outcome(
    names: tuple[str, ...],
    gap: dict[str, Gap],
    ties: tuple[tuple[str, ...], ...] = (),
    refining: tuple[str, ...] = (),
) -> Found:
    """Return the result of a search that found effects."""
    found = [FoundEffect(name, {}, 1.0) for name in names]
    found += [
        FoundEffect(name, {}, 1.0, share=0.02, refinement=True) for name in refining
    ]
    return found_effects(found, gap, ties)


def found_effects(
    effects: Sequence[FoundEffect],
    gap: dict[str, Gap],
    ties: tuple[tuple[str, ...], ...] = (),
) -> Found:
    """Return the result of a search without its course and its model."""
    unused: Any = None
    held: Any = SimpleNamespace(gap=gap)
    course = unused, unused, unused, unused
    return Found(*course, held, {}, tuple(effects), ties, None, "", {})


def verdict(course: Any, found: Found, **more: Any) -> tuple[str, str]:
    """Return the verdict where the search took this course."""
    return verdict_of(replace(found, search=course), **more)


@pytest.mark.parametrize(
    ("left", "rivals", "expected"),
    [
        (1.0, ALIKE[:1], "named"),
        (1.0, ALIKE, "tie"),
        (1.6, ALIKE[:1], "named"),
        (2.6, ALIKE[:1], "unknown"),
        (2.6, ALIKE, "unknown"),
        (1.2, ALIKE, "tie"),
    ],
)
def test_effects_that_leave_most_of_the_error_are_not_the_answer(
    left: float, rivals: tuple[str, ...], expected: str
) -> None:
    ties = (rivals,) if len(rivals) > 1 else ()
    found = outcome(rivals[:1], GAP, ties)
    said, statement = verdict(search(3.0, left), found)
    assert said == expected
    if expected == "unknown":
        assert "takes 20 % of the RMS error above the noise" in statement
        assert "leaves 2.60 times the noise floor" in statement
        assert "none of the effects" not in statement


def test_a_cable_that_stiffens_may_be_one_with_clearance() -> None:
    """Both have one law, so the statement says what distinguishes them."""
    name = "cable_stiffening"
    for rivals in ((name,), ("end_compliance", name)):
        found = outcome(rivals[:1], CLOSED, (rivals,) if len(rivals) > 1 else ())
        classes = cause_classes(rivals)
        said = verdict(search(3.0, 1.0), found, classes=classes)[1]
        assert "strands that settle or clearance" in said
        assert "photographs of a bend, slack and taut" in said
    assert "clearance" not in class_statement(*cause_classes(rivals[:1]))


def test_a_late_sensor_is_drag_only_where_the_data_do_not_decide() -> None:
    one, other = "sensor_delay", "load_independent_friction"
    assert cause_classes([one]) == cause_classes([other]) == ()
    tied = cause_classes([one, other])
    assert [each.name for each in tied] == [other]
    found = outcome((one,), CLOSED, ((one, other),))
    said = verdict(search(3.0, 1.0), found, classes=tied)[1]
    assert said.count("half the speed") == 1


def test_every_class_is_of_an_effect_or_of_what_is_tuned() -> None:
    for name, each in CLASSES.items():
        assert name in EFFECTS or name in BASELINE
        assert len(each.causes) > 1 and each.separated_by[0].islower()


def test_of_two_rivals_that_were_added_either_may_be_the_one_that_stayed() -> None:
    one, other = ALIKE
    before: Any = SimpleNamespace()
    step = Round((), one, (one,), 1.0, before, (other,))
    assert step.tied(ALIKE, ALIKE) == (one,)
    assert step.tied((one,), ALIKE) == (one, other)
    assert step.tied((other,), ALIKE) == (other, one)
    assert step.tied((), ALIKE) == ()
    assert step.tied((one,), (one,)) == (one,)
    assert step._replace(rivals=(one, GAIN)).tied((one,), ALIKE) == (one, other, GAIN)


@pytest.mark.parametrize("names", [ALIKE[:1], ALIKE])
def test_what_is_named_for_little_is_called_a_hint(names: tuple[str, ...]) -> None:
    ties = (names,) if len(names) > 1 else ()
    for misfit, hint in ((1.6, True), (1.9, False)):
        found = outcome(names[:1], CLOSED, ties)
        said = verdict(search(misfit, 1.0), found)[1]
        assert ("this is a hint only" in said) is hint


def test_a_little_that_nothing_explains_is_called_a_hint(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(verdict_rules.fitting, "excess", lambda model: math.inf)
    for misfit, hint in ((1.6, True), (1.9, False)):
        said, told = verdict(search(misfit, misfit), outcome((), GAP))
        assert said == "unknown"
        assert ("this is a hint only" in told) is hint


def test_a_model_that_stays_far_off_has_to_close_the_gap_as_well() -> None:
    found = outcome(ALIKE[:1], GAP)
    far = search(20.0, 8.0)  # 63 % of the error
    assert verdict(far, found)[0] == "unknown"
    assert verdict(far, outcome(ALIKE[:1], CLOSED))[0] == "named"


def test_an_effect_of_few_moments_closes_the_gap() -> None:
    found = outcome(ALIKE[:1], CLOSED)
    assert verdict(search(3.0, 2.6), found)[0] == "named"


def test_little_error_is_within_what_effect_free_rigs_reach() -> None:
    found = outcome(ALIKE[:1], GAP)
    assert verdict(search(1.6, 1.45), found)[0] == "named"


def test_a_refinement_is_told_but_not_called_missing() -> None:
    found = outcome(ALIKE[:1], CLOSED, refining=("sensor_delay",))
    said, statement = verdict(search(3.0, 1.0), found)
    assert said == "named"
    missing, refines = statement.split(". ", 1)
    assert "Stribeck" in missing
    assert "late" not in missing
    assert "recorded late refines the model" in refines


def test_half_of_the_error_is_not_closed_whatever_its_square() -> None:
    half = Gap(0.30, 0.15, 0.02, 0.54, (0.5, 0.6))  # 75 % of the square
    far = search(12.0, 4.5)
    for channels in (["motor_torque_nm"], ["motor_torque_nm", "joint_torque_nm"]):
        found = outcome(ALIKE[:1], dict.fromkeys(channels, half))
        said, statement = verdict(far, found)
        assert said == "unknown"
        assert "is 7.5 times the noise floor" in statement
        assert "that of the tuned scene 15.0 times" in statement


@pytest.mark.parametrize("expected", ["named", "tie"])
def test_how_far_the_repaired_model_is_off_is_told_with_the_name(
    expected: str,
) -> None:
    ties = (ALIKE,) if expected == "tie" else ()
    said, statement = verdict(search(3.0, 1.0), outcome(ALIKE[:1], CLOSED, ties))
    assert said == expected
    assert "the error of the repaired model is 1.2 times the noise" in statement


def test_no_effect_of_a_tie_is_told_as_sure() -> None:
    names = ("backlash", "viscous_friction", "joint_gravity")
    ties = (
        ("viscous_friction", "friction_drift"),
        ("joint_gravity", "joint_stiffness"),
    )
    said, statement = verdict(search(5.0, 1.0), outcome(names, CLOSED, ties))
    assert said == "tie"
    sure, *groups = statement.partition(". ")[0].split(", and ")
    assert sure == "Missing: play between pulley and joint"
    assert [" or " in group for group in groups] == [True, True]
    assert "gravity on the joint or a spring on the joint" in groups[1]


@pytest.mark.parametrize(
    ("other", "own", "left", "refinement"),
    [
        ("joint_gravity", 14.9, 1.0, False),
        ("joint_gravity", Limit.finding_error - 0.1, 1.0, True),
        ("joint_gravity", 14.9, 16.0, True),  # what is left is more than it takes
        ("sensor_delay", 14.9, 1.0, True),  # easily confused with viscous friction
    ],
)
def test_a_second_effect_that_is_large_by_itself_is_a_finding(
    other: str, own: float, left: float, refinement: bool
) -> None:
    shares = {"viscous_friction": 0.95, other: 0.03}
    sizes = {"viscous_friction": 80.0, other: own}
    assert only_refines(other, shares, sizes, left) is refinement
    assert not only_refines("viscous_friction", shares, sizes, left)


@pytest.mark.parametrize(
    ("needed", "without", "given"),
    [
        (True, [8.0, 9.0, 7.0], [1.2, 1.3, 1.2]),
        (True, [8.0, 9.0, 1.0], [1.2, 1.3, 1.0]),  # the last trial is at rest
        (False, [8.0, 9.0, 4.0], [1.2, 1.3, 4.0]),  # it contradicts
        (False, [8.0, 1.0, 1.0], [1.2, 1.0, 1.0]),  # one trial alone asks for it
        (False, [1.2, 1.2, 1.2], [1.2, 1.2, 1.2]),
    ],
)
def test_an_effect_stays_if_most_trials_and_all_that_do_not_fit_need_it(
    needed: bool, without: list[float], given: list[float]
) -> None:
    more, less = (dict(zip("abc", each, strict=True)) for each in (without, given))
    assert is_needed(more, less) == needed


def test_a_refinement_tells_what_it_cannot_be_told_from() -> None:
    little = FoundEffect(
        "joint_gravity",
        {},
        1.0,
        share=0.02,
        refinement=True,
        rivals=("joint_stiffness",),
    )
    found = found_effects((FoundEffect("backlash", {}, 1.0), little), CLOSED)
    said, statement = verdict(search(3.0, 1.0), found)
    assert said == "named"
    assert "ravity on the joint or a spring on the joint refines" in statement


def test_what_any_rig_may_have_is_told_but_not_called_missing() -> None:
    usual = FoundEffect("end_compliance", {}, 1.0, ordinary=True)
    alone = found_effects((usual,), CLOSED)
    said, statement = verdict(search(1.4, 1.1), alone)
    assert said == "none" and "Nothing is missing" in statement
    assert "the error of the model is 1.10 times the noise floor" in statement
    assert "no larger than uneven bends and loose ends" in statement
    beside = found_effects((FoundEffect("backlash", {}, 1.0), usual), CLOSED)
    said, statement = verdict(search(3.0, 1.0), beside)
    assert said == "named"
    assert "end fitting" not in statement.partition(". ")[0]


def test_what_fits_only_with_an_impossible_size_is_evidence_for_the_unknown() -> None:
    found = outcome(ALIKE[:1], GAP)
    said, statement = verdict(search(3.0, 2.6, REASON), found)
    assert said == "unknown"
    assert f"gain of a torque sensor {REASON}" in statement
    _, plain = verdict(search(3.0, 2.6, "its gain is 1.2"), found)
    assert "gain of a torque sensor" not in plain


@pytest.mark.parametrize("reason", ["joint_delay runs to its bound", REASON])
def test_unknown_gives_the_refused_effect_its_share_what_remains_and_why(
    reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(verdict_rules.fitting, "excess", lambda model: math.inf)
    said, statement = verdict(search(9.0, 9.0, reason), outcome((), GAP))
    assert said == "unknown"
    assert "What comes closest is gain of a torque sensor" in statement
    assert "25 % of the RMS error above the noise and leaves 7.00" in statement
    assert f"refused: {reason}" in statement
    assert "none of the effects" not in statement


@pytest.mark.parametrize("misfit", [1.1, 4.0])
def test_nothing_is_missing_only_if_no_stretch_is_beyond_its_limit(
    misfit: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(verdict_rules.fitting, "excess", lambda model: 0.0)
    found = search(misfit, misfit)
    assert verdict(found, outcome((), GAP))[0] == "none"
    stretch = Stretch("trial_06", 4.0, 8.0, "joint_torque_nm", 80.0, 1.2, True, 1.1)
    said, statement = verdict(found, outcome((), GAP), stretch=stretch)
    assert said == "unknown"
    assert "trial_06 transmits nothing from 4.0 s to 8.0 s" in statement
    assert "80.0 times the noise floor" in statement
    beside = stretch._replace(rest=3.0)
    said, statement = verdict(found, outcome((), GAP), stretch=beside)
    assert said == "unknown" and "rial_06 transmits nothing from" in statement


@pytest.mark.parametrize("idle", [False, True])
@pytest.mark.parametrize("extreme", ["", "pretension", "tilt", "load"])
def test_a_trial_that_is_the_extreme_of_a_condition_is_kept(
    extreme: str, idle: bool
) -> None:
    said = Stretch(
        "trial_05", 0.2, 8.0, "motor_torque_nm", 18.0, 0.2, idle, 1.1, extreme
    ).question
    assert ("leave them out" in said) is not extreme
    assert (f"Keep the trial, as no other has such a {extreme};" in said) is bool(
        extreme
    )


def test_what_the_cables_off_trials_show_is_not_a_cable_s() -> None:
    for name, expected in ((ALIKE[0], "unknown"), ("joint_inertia", "named")):
        found = outcome((name,), CLOSED)
        said, statement = verdict(search(20.0, 1.2), found, unhooked=11.8)
        assert said == expected
        assert ("no cable causes" in statement) is (expected == "unknown")
    near = outcome(ALIKE[:1], CLOSED)
    assert verdict(search(20.0, 1.2), near, unhooked=1.5)[0] == "named"


def test_a_parameter_that_ran_away_is_told_where_nothing_is_missing() -> None:
    told = "pretension had to be tuned to 59 N, where 40 N is given: ..."
    away = Deviating("pretension", 40.0, Estimate(59.0, "N", (57.0, 61.0)), 3.9, told)
    found = outcome((), GAP)
    said, statement = verdict(search(1.0, 1.0), found, deviating=(away,))
    assert said == "none"
    assert "Pretension had to be tuned to 59 N" in statement
