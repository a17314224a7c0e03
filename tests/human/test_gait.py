"""The harmonic gait profiles and the walking trajectory made of them."""

from __future__ import annotations

import numpy as np
import pytest

from cc_mujoco.human import GAIT_ANGLES, GAIT_PERIOD, Walk, assistance
from cc_mujoco.human._gait import GAIT_MOMENTS, Harmonics
from shared_folder import SHARED

DATA = SHARED / "data" / "gait"
PHASE = np.linspace(0.0, 1.0, 2001)


def test_harmonics_and_derivative() -> None:
    series = Harmonics(((0.5, 0.0), (1.0, -2.0), (0.25, 0.75)))
    turn = 2 * np.pi * PHASE
    expected = (
        0.5
        + np.cos(turn)
        - 2 * np.sin(turn)
        + 0.25 * np.cos(2 * turn)
        + 0.75 * np.sin(2 * turn)
    )
    np.testing.assert_allclose(series(PHASE), expected, atol=1e-13)
    slope = np.gradient(expected, PHASE)[1:-1]
    np.testing.assert_allclose(series.derivative()(PHASE)[1:-1], slope, atol=1e-3)


@pytest.mark.parametrize("name", ["ankle", "knee", "hip"])
def test_scalars_and_arrays_give_the_same_bits(name: str) -> None:
    expected = [GAIT_ANGLES[name](float(phase)) for phase in PHASE]
    assert all(type(value) is float for value in expected)
    assert GAIT_ANGLES[name](PHASE).tolist() == expected
    assert GAIT_ANGLES[name](PHASE[::-3]).tolist() == expected[::-3]


def test_ranges_are_those_of_level_walking() -> None:
    degrees = {
        name: np.rad2deg(profile(PHASE)) for name, profile in GAIT_ANGLES.items()
    }
    assert degrees["ankle"].min() == pytest.approx(-8.8, abs=0.5)
    assert degrees["ankle"].max() == pytest.approx(14.4, abs=0.5)
    # The knee bends most in swing; the hip is most extended before it.
    assert 0.6 < PHASE[degrees["knee"].argmin()] < 0.8
    assert -75 < degrees["knee"].min() < -55
    assert 0.4 < PHASE[degrees["hip"].argmin()] < 0.6


def test_assistance_is_a_push_off() -> None:
    shape = assistance(PHASE)
    assert shape.min() >= 0
    assert shape.max() == pytest.approx(1, abs=1e-5)
    assert 0.5 < PHASE[shape.argmax()] < 0.55
    assert shape[(PHASE < 0.2) | (PHASE > 0.7)].max() < 0.01


def test_walk_has_the_gait_period_and_companions() -> None:
    motion = Walk().sample(10.0, 1e-3, np.random.default_rng(0))
    assert sorted(motion.companions) == ["ankle", "hip", "knee"]
    assert np.array_equal(motion.companions["ankle"].angle, motion.angle)
    # The smooth start costs half its duration.
    cycles = np.unwrap(motion.phase, period=1.0)
    assert cycles[-1] == pytest.approx((10.0 - 0.5) / GAIT_PERIOD)
    later = motion.time > 1
    for name, joint in motion.companions.items():
        profile = GAIT_ANGLES[name]
        expected = profile(motion.phase)
        np.testing.assert_allclose(joint.angle, expected, rtol=5e-3)
        np.testing.assert_allclose(
            np.gradient(joint.angle, 1e-3)[later][:-1],
            joint.velocity[later][:-1],
            atol=1e-3,
        )
        assert joint.velocity[0] == 0


def test_the_amplitude_of_a_walk_is_the_peak_of_the_ankle_rounded_up() -> None:
    peak = np.abs(GAIT_ANGLES["ankle"](np.linspace(0.0, 1.0, 10_001))).max()
    assert Walk.amplitude == np.ceil(1e3 * peak) / 1e3


def test_walk_scales_all_joints() -> None:
    rng = np.random.default_rng(0)
    full, half = Walk(), Walk(amplitude=Walk().amplitude / 2)
    a, b = full.sample(3.0, 0.01, rng), half.sample(3.0, 0.01, rng)
    np.testing.assert_allclose(a.angle, 2 * b.angle)
    np.testing.assert_allclose(a.companions["hip"].angle, 2 * b.companions["hip"].angle)


def refit(period: float) -> tuple[dict[str, np.ndarray], float]:
    """Fit one cycle from heel strike; return coefficients and error in all angles."""
    walk = np.genfromtxt(DATA / "ankle_walk_tidy.csv", delimiter=",", names=True)
    time, found, error = walk["t_s"] - 0.60, {}, 0.0
    turn = 2 * np.pi * np.outer(time / period, np.arange(9))
    matrix = np.stack([np.cos(turn), np.sin(turn)], axis=2).reshape(time.size, -1)
    cycle = (time > -1e-3) & (time < period - 1e-3)
    for name in ("ankle", "knee", "hip"):
        angle, moment = np.deg2rad(walk[f"{name}_r_deg"]), walk[f"{name}_r_moment_Nm"]
        for key, part in ((name, angle), (f"{name}_moment", moment)):
            fit = np.linalg.lstsq(matrix[cycle], part[cycle], rcond=None)[0]
            found[key] = fit.reshape(-1, 2)
        whole = np.linalg.lstsq(matrix, angle, rcond=None)[0]
        error += np.sqrt(np.mean((matrix @ whole - angle) ** 2))
    return found, error


@pytest.mark.shared
def test_shipped_profiles_are_least_squares_of_the_measured_cycle() -> None:
    table, error = refit(GAIT_PERIOD)
    moments = {f"{name}_moment": own for name, own in GAIT_MOMENTS.items()}
    for name, own in (GAIT_ANGLES | moments).items():
        np.testing.assert_allclose(own.coefficients, table[name], atol=2e-6)
    assert np.rad2deg(error) < 1.5  # half a degree a joint
    # Of all periods this one leaves the least error over the whole recording.
    assert error < min(refit(GAIT_PERIOD + step)[1] for step in (-0.005, 0.005))


@pytest.mark.shared
def test_shipped_assistance_is_the_digitised_shape() -> None:
    shape = np.genfromtxt(
        DATA / "ankle_assistance_shape.csv", delimiter=",", names=True
    )
    error = assistance(shape["gait_cycle_fraction"]) - shape["assistance_normalised"]
    assert np.sqrt(np.mean(error**2)) < 0.01
