"""Odds of a verdict, from squared errors of models in blocks."""

from __future__ import annotations

import math
import re
from pathlib import Path
from statistics import NormalDist
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cc_mujoco import diagnosis
from cc_mujoco.diagnosis._judge import (
    STUDIED,
    Stretch,
    _worded,
    belief_in_verdict,
    one_time,
    probabilities,
)
from cc_mujoco.diagnosis._phrases import format_odds
from cc_mujoco.diagnosis._search.candidates import comparison_z
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import Alternative, Verdict

BLOCKS = 64
NOISE = np.tile([0.5, 1.5], BLOCKS // 2)


def errors(size: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return squared errors of this mean, the same relative noise in each."""
    return size * NOISE


def test_without_noise_the_acceptance_threshold_is_two_deviations() -> None:
    start = np.full(BLOCKS, 2.0)
    z = comparison_z(0.9 * start, start, float(start.sum()))
    assert math.isclose(z, Limit.min_z)
    assert math.isclose(Limit.min_reduction, 0.1)


def test_noise_and_discrepancy_add_as_squares() -> None:
    better, worse = errors(1.0), errors(2.0)
    before = 40.0 * BLOCKS
    difference = worse - better
    noise = np.std(difference) * math.sqrt(BLOCKS)
    form = min(Limit.form_error_share * before, better.sum())
    expected = difference.sum() / math.hypot(noise, form)
    assert math.isclose(comparison_z(better, worse, before), expected)


def test_a_model_that_leaves_little_has_little_discrepancy() -> None:
    before, better, worse = 900.0 * BLOCKS, errors(2.0), errors(32.0)
    assert comparison_z(better, worse, before) == 6.0  # the most that is given
    assert comparison_z(20.0 * better, 20.0 * better + worse, before) < 1.0


def test_effects_whose_forms_meet_stay_undecided() -> None:
    before, better, worse = 900.0 * BLOCKS, errors(2.0), errors(32.0)
    assert comparison_z(better, worse, before, Limit.meeting_form_share) < 0.2


def test_probabilities_add_up_and_agree_with_pairwise_odds() -> None:
    found = probabilities({"a": 1.0, "b": 0.0, "c": 6.0})
    assert math.isclose(sum(found.values()), 1.0)
    assert math.isclose(found["b"], found[""])
    odds = NormalDist().cdf(1.0) / NormalDist().cdf(-1.0)
    assert math.isclose(found[""] / found["a"], odds)
    assert found["c"] < 1e-8


def test_rates_are_those_of_the_page() -> None:
    page = Path(diagnosis.__file__).with_name("validation.md").read_text("utf-8")
    odds = page[page.index("## Odds") : page.index("## Intervals")]
    rates = re.findall(r"`(\w+)`\s+(\d+) %", odds)
    right = {name: rate for name, (rate, _) in STUDIED.items()}
    assert {name: int(rate) / 100 for name, rate in rates} == right
    far = re.search(r"above (\d+) of (\d+)", odds)
    assert far is not None
    assert (int(far[1]), int(far[2])) == (Limit.far_off_right, Limit.far_off_names)
    most = re.findall(r"`(\w+)` (?:verdicts )?left at most (\d+\.\d)", odds)
    left = {name: size for name, (_, size) in STUDIED.items()}
    assert {name: float(size) for name, size in most} == left


@pytest.mark.parametrize("rest", [1.0, 2.0])
@pytest.mark.parametrize("by_trial", ["", "Friction differs from trial to trial."])
def test_what_happened_once_has_no_rate(rest: float, by_trial: str) -> None:
    stretch = Stretch("trial", 1.0, 2.0, "motor_torque_nm", 20.0, 0.1, False, rest)
    assert one_time(stretch, by_trial) is (rest == 1.0 or bool(by_trial))
    assert not one_time(None, "")


@pytest.mark.parametrize("left", [1.0, 3.0])
def test_odds_of_a_verdict_are_those_of_the_classes(left: float) -> None:
    nothing: Any = SimpleNamespace(rounds=())
    only = " and nothing else" if left < Limit.max_explained_error else ""
    for name, cause in (
        ("backlash", ""),
        ("end_compliance", ", by any of its causes,"),
    ):
        found = belief_in_verdict(nothing, "named", [name], [], left)
        assert f"that this{cause}{only} is missing" in found.statement
        tie = ["viscous_friction", name]
        found = belief_in_verdict(nothing, "tie", tie[:1], [tie], left)
        assert f"one of the tied effects{cause} acts" in found.statement


@pytest.mark.parametrize("kind", STUDIED)
@pytest.mark.parametrize("factor", [0.99, 1.01, 50.0])
def test_no_rate_is_given_beyond_what_study_rigs_left(
    kind: Verdict, factor: float
) -> None:
    left = factor * STUDIED[kind][1]
    nothing: Any = SimpleNamespace(rounds=())
    found = belief_in_verdict(nothing, kind, [], [], left)
    known = factor < 1.0
    assert math.isfinite(found.probability) is known
    assert ("is not known: it leaves" in found.statement) is not known
    assert known or ("%" not in found.statement and "dds" not in found.statement)


@pytest.mark.parametrize(
    ("probability", "words"), [(0.8, "80:20"), (1.0, "99:1"), (0.0, "1:99")]
)
def test_odds_are_never_certain(probability: float, words: str) -> None:
    assert format_odds(probability) == words


def test_odds_of_one_alternative_are_said_once() -> None:
    other = Alternative("outside", 0.05)
    lone = _worded("named", 0.95, [other], 1.2).statement
    assert lone.endswith("nothing else is missing; otherwise something else acts.")
    two = _worded("named", 0.8, [other, Alternative("nothing", 0.15)], 1.2).statement
    assert "nothing is missing (odds 15:85) or something else acts (odds 5:95)" in two


@pytest.mark.parametrize("kind", ["named", "tie"])
def test_a_name_that_leaves_more_is_never_all_of_it(kind: Verdict) -> None:
    other = Alternative("outside", 0.5)
    for left, complete in ((Limit.max_explained_error, True), (3.2, False)):
        said = _worded(kind, 0.5, [other], left).statement
        assert ("times the noise floor is left" in said) is not complete
        assert ("nothing else" in said) is (complete and kind == "named")


@pytest.mark.parametrize("kind", ["none", "unknown"])
def test_what_compares_no_models_has_a_rate_and_no_odds(kind: Verdict) -> None:
    nothing: Any = SimpleNamespace(rounds=())
    said = belief_in_verdict(nothing, kind, [], [], 1.0).statement
    rate = f"{100.0 * STUDIED[kind][0]:.0f} %"
    assert f"{rate} of such verdicts were right" in said and "dds" not in said
