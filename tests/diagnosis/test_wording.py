"""Words and numbers of the report: right digits, true signs, honest sentences."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.diagnosis._phrases import (
    MINUS,
    effect_name,
    format_fitted,
    format_interval,
    format_number,
    gap_sentence,
    headline,
)
from cc_mujoco.diagnosis._verdict import Gap
from cc_mujoco.estimation import Estimate
from diagnosis.report_examples import DIAGNOSES


def test_headlines_name_what_is_missing() -> None:
    stribeck, play, soft = map(
        effect_name, ("stribeck_friction", "backlash", "end_compliance")
    )
    assert headline(DIAGNOSES["named"]) == f"Missing: {stribeck}"
    off = replace(DIAGNOSES["named"], remaining=4.31)
    assert headline(off) == (
        f"Missing: {stribeck}; the remaining error is 4.3 times the noise floor"
    )
    tie = replace(DIAGNOSES["tie"], effects=DIAGNOSES["named"].effects)
    tie = replace(tie, ties=(("backlash", "end_compliance"),))
    assert headline(tie) == f"Missing: {stribeck} and either {play} or {soft}"
    tie = replace(tie, ties=(("stribeck_friction", "backlash"),))
    assert headline(tie) == f"Missing: either {stribeck} or {play}"
    part = replace(DIAGNOSES["unknown"], effects=DIAGNOSES["named"].effects)
    assert "one trial was recorded differently" in headline(part)
    part = replace(part, question="")
    assert "only in part" in headline(part)


def test_a_gap_that_widens_or_was_never_there_is_said_so() -> None:
    worse = Gap(0.1, 0.2, 0.05, -4.0, (-5.0, -3.0))
    assert "rises from 0.100 N m to 0.200 N m" in gap_sentence("motor_torque_nm", worse)
    below = Gap(0.04, 0.039, 0.05, float("nan"), (float("nan"), float("nan")))
    assert "there is no gap above it" in gap_sentence("motor_torque_nm", below)
    lost = Gap(float("nan"), float("nan"), 0.05, float("nan"), (0.0, 0.0))
    assert gap_sentence("motor_torque_nm", lost) == (
        "Motor torque: the error could not be determined."
    )
    same = Gap(0.1, 0.1, 0.05, 0.0, (0.0, 0.0))
    assert gap_sentence("motor_torque_nm", same) == (
        "Motor torque: the weighted RMS error is 0.100 N m; the noise floor is "
        "0.050 N m."
    )


def read(text: str) -> float:
    digits = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
    return float(text.replace(MINUS, "-").replace("·10", "e").translate(digits))


@given(
    st.floats(-1e12, 1e12, allow_subnormal=False),
    st.floats(1e-12, 1e12),
)
def test_numbers_keep_the_digits_that_their_spread_leaves(
    value: float, spread: float
) -> None:
    error = abs(read(format_number(value, spread)) - value)
    assert error <= 0.051 * spread + 1e-9 * abs(value)
    if abs(value) > 1e-300:
        assert read(format_number(value)) == pytest.approx(value, rel=0.006)


def test_numbers_that_are_not_there_are_said_so() -> None:
    assert format_number(float("nan")) == "not determined"
    assert format_number(float("-inf")) == f"{MINUS}∞"
    assert format_number(-0.0001, 0.1) == "0.00"
    unknown = Estimate(0.0012, "s", (float("nan"), float("nan")))
    assert (format_fitted(unknown), format_interval(unknown)) == (
        "0.00120",
        "not determined",
    )
