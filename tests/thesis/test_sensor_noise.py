"""Noise of sensors from data: unbiased, convergent, nonnegative, followed in time."""

from __future__ import annotations

import numpy as np
import pytest

from cc_mujoco.cable import Cable, Section
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device import Sensors
from cc_mujoco.estimation._fusion import tension_gains
from thesis._experiments.noise import (
    LinearModel,
    SensorNoise,
    autocovariance_least_squares,
    autocovariances,
    innovations,
    trend_model,
)

CABLE = Cable(friction=0.21, conduit=(Section(2.0, 0.28),), segments=10)
NODES = (0, 4, 7, 10)
FACTORS = 1.0 / tension_gains(Mesh.of(CABLE), -np.ones(10), np.array(NODES))[:, -1]
DEVIATION = np.array([2.0, 0.5, 1.0, 0.3])
WANDER = 1e-4


def recording(samples: int, random: np.random.Generator) -> np.ndarray:
    """Return readings of a tension that follows the local-trend model."""
    step = np.sqrt(WANDER) * random.normal(size=samples)
    rate = np.cumsum(step) - step
    tension = 50.0 + np.cumsum(rate + 0.5 * step)
    noise = DEVIATION * random.normal(size=(samples, len(NODES)))
    return tension[:, None] * FACTORS + noise


def estimates(samples: int, runs: int, *, nonnegative: bool) -> np.ndarray:
    random = np.random.default_rng(7)
    model = trend_model(FACTORS)
    rows = []
    for _ in range(runs):
        innovation = innovations(model, recording(samples + 50, random))[50:]
        found = autocovariance_least_squares(innovation, model, nonnegative)
        rows.append(np.concatenate(found))
    return np.array(rows)


def test_autocovariances_of_a_filter_that_is_simulated() -> None:
    """An AR(1) state seen by one sensor, against a long simulation."""
    model = LinearModel(
        np.array([[0.9]]), np.array([[1.0]]), np.array([[1.0]]), np.array([[0.3]])
    )
    random = np.random.default_rng(8)
    count = 60_000
    push, noise = 0.5 * random.normal(size=count), 2.0 * random.normal(size=count)
    state = np.zeros(count)
    for i in range(1, count):
        state[i] = 0.9 * state[i - 1] + push[i - 1]
    seen = innovations(model, (state + noise)[:, None])[100:, 0]
    measured = [np.mean(seen[lag:] * seen[: seen.size - lag]) for lag in range(5)]
    expected = autocovariances(model) @ np.array([0.25, 4.0])
    assert measured == pytest.approx(expected, abs=0.1)


def test_unbiased_without_bounds_and_recovers_unequal_sensors() -> None:
    found = estimates(1000, 60, nonnegative=False)
    error = found.mean(axis=0) - np.array([WANDER, *DEVIATION**2])
    assert np.all(np.abs(error) < 4.0 * found.std(axis=0) / np.sqrt(60))


def test_scatter_falls_with_the_root_of_the_length() -> None:
    short = estimates(300, 30, nonnegative=False).std(axis=0)
    long = estimates(1200, 30, nonnegative=False).std(axis=0)
    assert np.mean((short / long)[1:]) == pytest.approx(2.0, rel=0.3)


def test_bounded_variances_are_nonnegative_where_free_ones_are_not() -> None:
    free = estimates(60, 40, nonnegative=False)
    assert np.min(free) < 0.0
    assert np.min(estimates(60, 40, nonnegative=True)) >= 0.0


def running(noise: SensorNoise, deviation: np.ndarray, samples: int, seed: int) -> None:
    """Update with a tension that varies at random, in both directions of motion."""
    random = np.random.default_rng(seed)
    for i in range(samples):
        slip_direction = 1.0 if (i // 100) % 2 else -1.0
        gain = tension_gains(
            Mesh.of(CABLE), np.full(10, slip_direction), np.array([10])
        )[0, list(NODES)]
        truth = random.uniform(10.0, 90.0) * gain
        noise.update(
            truth + deviation * random.normal(size=4), np.full(10, slip_direction)
        )


def test_sensor_noise_needs_no_model_of_the_tension() -> None:
    noise = SensorNoise(CABLE, Sensors(NODES, (1.0,) * 4), memory=1e6)
    running(noise, DEVIATION, 3000, 10)
    assert noise.deviation == pytest.approx(DEVIATION, rel=0.1)


def test_sensor_noise_follows_a_sensor_that_changes() -> None:
    noise = SensorNoise(CABLE, Sensors(NODES, (1.0,) * 4), memory=200.0)
    running(noise, DEVIATION, 800, 11)
    before = noise.deviation
    running(noise, DEVIATION[::-1], 1600, 12)
    assert before == pytest.approx(DEVIATION, rel=0.3)
    assert noise.deviation == pytest.approx(DEVIATION[::-1], rel=0.3)


def test_sensor_noise_learns_nothing_from_rest_or_partial_motion() -> None:
    noise = SensorNoise(CABLE, Sensors(NODES, (1.0, 2.0, 3.0, 4.0)))
    for direction in (np.zeros(10), np.repeat([-1.0, 0.0], 5), np.repeat([1, -1], 5)):
        for _ in range(100):
            noise.update([50.0, 1.0, 1.0, 1.0], direction)
    assert noise.learnt == 0.0
    assert noise.deviation.tolist() == [1.0, 2.0, 3.0, 4.0]
