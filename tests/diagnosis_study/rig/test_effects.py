"""Every effect changes the data, and none does when it is off."""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from rig import strength
from rig.dataset import run, truth_of
from rig.makes import MAKES, Truth
from rig.nominal import Rig, make_rig
from rig.sensors import BASIC, CHANNELS, Chain, logged, sampled
from rig.trials import Trial
from study_marks import study_but

MAKE = MAKES["bristles"]
EFFECTS = MAKE.effects

FLOORS = np.array([CHANNELS[name].floor for name in BASIC])
ISSUED = """
    viscous_friction stribeck_friction presliding load_independent_friction
    asymmetric_friction tension_dependent_friction dwell_dependent_stiction
    configuration_dependent_wrap pretension_loss friction_drift backlash
    pulley_eccentricity motor_cogging cable_stiffening end_compliance joint_gravity
    joint_stiffness joint_inertia motor_inertia torque_sensor_gain
    torque_sensor_offset sensor_delay
""".split()


def seen(truth: Truth, rig: Rig, trial: Trial) -> NDArray[np.float64]:
    return sampled(run(truth, rig, trial), rig, truth.chain, BASIC)


@pytest.fixture(scope="module")
def plain(reversing: Trial) -> NDArray[np.float64]:
    rig = make_rig(3)
    return seen(truth_of(rig, {}, seed=3), rig, reversing)


def test_ids_are_those_of_the_verdicts_and_unknowns_say_so() -> None:
    assert set(MAKE.named) == set(ISSUED)
    assert len(MAKE.unknown) >= 6
    assert all(name.startswith("unknown_") for name in MAKE.unknown)


@pytest.mark.parametrize("name", study_but(4, EFFECTS))
def test_a_large_amount_shows(
    rig: Rig, reversing: Trial, plain: NDArray[np.float64], name: str
) -> None:
    effect = EFFECTS[name]
    truth = truth_of(rig, {name: min(4 * effect.typical, effect.limit)}, seed=3)
    change = (seen(truth, rig, reversing) - plain) / FLOORS
    assert 0.5 < np.sqrt(np.mean(change**2, axis=0)).max() < 300


@pytest.mark.parametrize("name", study_but(4, EFFECTS))
def test_amount_zero_is_nothing_to_the_last_bit(
    rig: Rig, reversing: Trial, shortened: Callable[[Trial, float], Trial], name: str
) -> None:
    """Though phases, places and signs have been drawn."""
    begun = shortened(reversing, 0.3)
    plain = seen(truth_of(rig, {}, seed=3), rig, begun)
    rng = np.random.default_rng([3, zlib.crc32(name.encode())])
    off = EFFECTS[name].hide(truth_of(rig, {}, seed=3), 0.0, rng)
    assert np.array_equal(seen(off, rig, begun), plain)


def test_noise_does_not_know_what_is_hidden() -> None:
    clean = np.zeros((400, 4))
    once = logged(clean, Chain(), BASIC, [3, 3, 0])
    other = logged(clean + 1.0, Chain(), BASIC, [3, 3, 0])
    for name in BASIC:
        column, resolution = CHANNELS[name].column, CHANNELS[name].resolution
        assert np.abs(other[column] - once[column] - 1).max() < 1.01 * resolution
        assert np.std(once[column]) == pytest.approx(CHANNELS[name].floor, rel=0.12)


def test_two_effects_hide_together(rig: Rig) -> None:
    both = {"viscous_friction": 20.0, "sensor_delay": 0.004}
    truth = truth_of(rig, both, seed=3)
    assert truth.plant.viscous == 20.0
    assert truth.chain.delay == 0.004


@pytest.fixture
def one_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(strength.LOOKED_AT, "ramps", (5,))


@pytest.mark.study
@pytest.mark.usefixtures("one_trial")
def test_calibration_reaches_the_strength_asked_for() -> None:
    rig = make_rig(11)
    amount = strength.calibrate(rig, "joint_gravity", 2.0, "ramps", seed=11)
    found = strength.measure(rig, {"joint_gravity": amount}, "ramps", seed=11)
    assert found.refit == pytest.approx(2.0, rel=0.06)
    assert found.refit <= found.raw


@pytest.mark.study
@pytest.mark.usefixtures("one_trial")
def test_what_a_refit_can_absorb_does_not_count() -> None:
    """An offset that the bench's makers would believe leaves nothing behind."""
    rig = make_rig(11)
    found = strength.measure(rig, {"torque_sensor_offset": 0.03}, "ramps", seed=11)
    assert found.refit < 0.25 * found.raw
    large = strength.measure(rig, {"torque_sensor_offset": 0.3}, "ramps", seed=11)
    assert large.refit > 0.7 * large.raw
