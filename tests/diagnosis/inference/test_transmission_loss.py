"""Loss by direction and load, on a dynamometer by equations of its own."""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np
import pytest

from cc_mujoco.datasets._smoothing import velocity_noise
from cc_mujoco.diagnosis._partial.loss import (
    DRIVEN,
    LossFit,
    SceneLaw,
    _blocks,
    _Law,
    fit_loss,
    strokes_of,
)
from cc_mujoco.diagnosis._rig.records import compared_band, low_pass
from diagnosis.dynamometer import (
    CURRENT_NOISE,
    CURRENT_STEP,
    ENCODER,
    STEP,
    Dynamometer,
)

BAND = compared_band(1.0 / STEP)
LOAD_NOISE = math.hypot(CURRENT_NOISE, CURRENT_STEP / math.sqrt(12.0)) * math.sqrt(
    2.0 * BAND * STEP
)
SCENE = SceneLaw(0.3, 0.0)


def fitted(rig: Dynamometer, seed: int = 1, **motion: bool | float) -> LossFit:
    """Return the fit to one recording."""
    signals = np.array(rig.record(seed, **motion))
    speed = velocity_noise(ENCODER / math.sqrt(12.0), STEP)
    strokes = strokes_of(0, *low_pass(signals, BAND, 1.0 / STEP), STEP, speed)
    return fit_loss(strokes, LOAD_NOISE, SCENE)


def test_a_joint_that_rests_makes_no_stroke() -> None:
    still = np.zeros(500)
    assert strokes_of(0, still, still, still, STEP, 0.0) == []


def test_a_draw_without_a_load_that_drives_the_motor_is_no_number() -> None:
    signals = low_pass(np.array(Dynamometer().record(1)), BAND, 1.0 / STEP)
    blocks = _blocks(strokes_of(0, *signals, STEP, 0.01), 0.3)
    law = _Law.of(blocks, 0.0)
    back = np.array([np.any(block.columns[:, DRIVEN]) for block in blocks])
    every, without = law.solve(np.array([np.ones(back.size), ~back]))[:, law.active]
    assert np.isfinite(every).all() and np.isnan(without).all()


def test_exponent_and_loss_are_found_whatever_gain_and_zero_are() -> None:
    for gain, zero in ((1.0, 0.0), (1.05, 0.1)):
        found = fitted(Dynamometer(gain=gain, zero=zero)).values
        assert found["friction_exponent"].value == pytest.approx(0.35, rel=0.01)
        assert found["load_independent_loss"].value == pytest.approx(0.15, abs=0.01)
        assert found["gain"].value == pytest.approx(gain, rel=0.005)
        assert found["zero"].value == pytest.approx(zero, abs=0.01)
        assert "drag" not in found
        least = found["breakaway_excess"].ci95[0]
        assert least < 0.02


def test_breakaway_is_distinguished_from_sliding_and_drag_from_loss() -> None:
    found = fitted(Dynamometer(breakaway=0.4, drag=0.2))
    assert found.values["breakaway_excess"].value == pytest.approx(0.4, rel=0.06)
    assert found.values["drag"].value == pytest.approx(0.2, rel=0.1)
    assert found.values["friction_exponent"].value == pytest.approx(0.35, rel=0.01)
    assert 0.06 < found.breakaway_at < 0.16 < found.settling


def test_one_direction_gives_no_number() -> None:
    found = fitted(Dynamometer(), one_way=True)
    assert found.values == {}
    assert "one direction only" in found.refused


def test_a_constant_load_gives_the_whole_loss_only() -> None:
    found = fitted(Dynamometer(), constant_load=True)
    whole = 2.0 * math.sinh(0.35) + 0.15
    assert found.values["total_loss"].value == pytest.approx(whole, rel=0.01)
    assert not {"friction_exponent", "load_independent_loss"} & set(found.values)
    assert any("load hardly varies" in each for each in found.undetermined)


def test_strokes_too_short_to_slide_give_no_number() -> None:
    found = fitted(Dynamometer(), stroke=0.03)
    assert found.values == {}
    assert "longer strokes" in found.refused


def test_the_law_of_a_scene_is_that_of_two_cables_until_one_is_slack() -> None:
    law = SceneLaw(0.3, 1.0)
    taut, slack = law.torque(np.array([1.0, 5.0]), 1.0)
    assert taut == pytest.approx(1.5 * math.exp(-0.3) - 0.5 * math.exp(0.3))
    assert slack == pytest.approx(5.0 * math.exp(-0.3))
    assert law.torque(np.array([-1.0]), -1.0)[0] == pytest.approx(-taut)


@pytest.mark.study
@pytest.mark.parametrize(
    "rig",
    [
        Dynamometer(),
        Dynamometer(exponent=0.8, loss=0.05, drag=0.1),
        Dynamometer(gain=1.04, zero=-0.1, breakaway=0.3),
    ],
)
def test_intervals_hold_the_hidden_values_in_repeated_recordings(
    rig: Dynamometer,
) -> None:
    """Fewer than 52 of 60 have a probability below 1 % where 95 % should."""
    hidden = asdict(rig)
    names = {
        "friction_exponent": "exponent",
        "load_independent_loss": "loss",
        "gain": "gain",
        "zero": "zero",
    }
    held = dict.fromkeys(names, 0)
    for seed in range(60):
        found = fitted(rig, seed, seconds=20.0).values
        for name, own in names.items():
            held[name] += found[name].holds(hidden[own])
    assert min(held.values()) >= 52, held
