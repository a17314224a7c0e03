"""A residual that follows one formula gets the name of that formula."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from baselines.features import FAMILIES
from baselines.methods import BINS, in_bins, regressed
from baselines.signals import Signals
from cc_mujoco.diagnosis.effects import usual_effects

Faulty = Callable[..., Signals]
Residual = Callable[[Any], dict[str, np.ndarray]]


def late(torque: np.ndarray, by: float, step: float = 0.004) -> np.ndarray:
    """Return a torque delayed by some seconds."""
    at = step * np.arange(torque.size)
    return np.interp(at - by, at, torque)


FAULTS: dict[str, Residual] = {
    "viscous_friction": lambda m: {"motor": 1.2 * m.speed, "joint": -0.9 * m.speed},
    "stribeck_friction": lambda m: {
        "motor": 0.2 * np.sign(m.speed) * np.exp(-abs(m.speed) / 0.012)
    },
    "tension_dependent_friction": lambda m: {
        "motor": 0.05 * np.sign(m.speed) * abs(m.torque[0])
    },
    "configuration_dependent_wrap": lambda m: {
        "motor": 0.1 * np.sign(m.speed) * m.joint
    },
    "friction_drift": lambda m: {"motor": 0.005 * np.sign(m.speed) * m.time},
    "backlash": lambda m: {"joint": 0.1 * np.sign(m.torque[1])},
    "pulley_eccentricity": lambda m: {
        "motor": 0.2 * np.cos(m.motor - 1.0),
        "joint": 0.1 * np.cos(m.motor - 1.0),
    },
    "motor_cogging": lambda m: {"motor": 0.1 * np.cos(12.0 * m.motor - 0.5)},
    "joint_gravity": lambda m: {"joint": -0.2 * np.cos(m.joint - 0.8)},
    "joint_inertia": lambda m: {
        "joint": -3e-3 * np.gradient(np.gradient(m.joint, 0.004), 0.004)
    },
    "motor_inertia": lambda m: {
        "motor": 3e-3 * np.gradient(np.gradient(m.motor, 0.004), 0.004)
    },
    "torque_sensor_gain": lambda m: {"motor": 0.08 * m.torque[0]},
    "torque_sensor_offset": lambda m: {"joint": 0.01 * m.time},
    "sensor_delay": lambda m: {"joint": late(m.torque[1], 0.03) - m.torque[1]},
}


@pytest.mark.parametrize("name", FAULTS)
def test_the_binned_residual_gets_its_name(
    name: str, faulty: Faulty, motion: Any
) -> None:
    guess = regressed([faulty(**FAULTS[name](motion))])
    assert guess.named == guess.ranking[0] == name
    assert 0.1 < guess.share <= 1.0


@pytest.mark.parametrize(
    "name",
    [
        "viscous_friction",
        "stribeck_friction",
        "motor_cogging",
        "motor_inertia",
        "torque_sensor_offset",
        "sensor_delay",
    ],
)
def test_the_sparse_model_of_a_residual_is_led_by_its_name(
    name: str, faulty: Faulty, motion: Any
) -> None:
    pytest.importorskip("pysindy")
    from baselines.methods import selected

    guess = selected([faulty(**FAULTS[name](motion))])
    assert guess.named == guess.ranking[0] == name
    assert 0.1 < guess.share <= 1.0


def test_noise_and_offsets_get_no_name(faulty: Faulty) -> None:
    guess = regressed([faulty(motor=0.5, joint=-0.3)])
    assert guess.named is None
    assert guess.share < 0.05


def test_a_sparse_model_of_noise_is_empty(faulty: Faulty) -> None:
    pytest.importorskip("pysindy")
    from baselines.methods import selected

    guess = selected([faulty(motor=0.5, joint=-0.3)])
    assert guess == (None, (), pytest.approx(0.0, abs=1e-12))


def test_what_is_below_the_threshold_is_ranked_but_not_named(
    faulty: Faulty, motion: Any
) -> None:
    seen = [faulty(**FAULTS["viscous_friction"](motion))]
    guess = regressed(seen, least=0.99)
    assert guess.named is None
    assert guess.ranking[0] == "viscous_friction"


def test_samples_that_do_not_count_have_no_say(faulty: Faulty, motion: Any) -> None:
    clean = faulty()
    spoilt = clean.residual.copy()
    spoilt[:, :20] += 1e3
    assert not clean.counts[:20].any()
    before, after = regressed([clean]), regressed([clean._replace(residual=spoilt)])
    assert before == after


def test_every_effect_of_the_library_has_a_look() -> None:
    assert [family.id for family in FAMILIES] == list(usual_effects())


def test_bins_hold_as_many_samples_each_but_never_split_equal_ones() -> None:
    assert set(np.bincount(in_bins(np.linspace(3.0, -2.0, 4000)))) == {4000 // BINS}
    two = in_bins(np.repeat([-1.0, 1.0], [300, 500]))
    assert np.bincount(two).tolist() == [300, 500]
