"""Fusion of tension sensors along a cable whose directions of slip are known."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cc_mujoco  # noqa: F401  registers the environments
from cc_mujoco import plugin
from cc_mujoco.cable import Cable, Section
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device import Sensors
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._fusion import fuse, tension_gains
from cc_mujoco.simulation import Recorder
from thesis._estimators import TensionFusion
from thesis._literal_solver import (
    Constraint,
    sign_pattern_system,
    sign_patterns,
)

CABLE = Cable(friction=0.21, conduit=(Section(2.0, 0.28),), segments=10, pretension=20)
MESH = Mesh.of(CABLE)
EVERY = np.arange(11)


def exact(direction: np.ndarray, start: float = 30.0) -> np.ndarray:
    return start * tension_gains(MESH, direction, np.array([0]), through_rest=True)[0]


@given(st.integers(0, 35), st.integers(0, 10), st.floats(1.0, 200.0))
@settings(max_examples=40, deadline=None)
def test_gains_are_what_the_thesis_s_matrix_gives(
    pattern: int, node: int, value: float
) -> None:
    direction = sign_patterns(10)[pattern]
    known = [Constraint("displacement", 0, 0.0), Constraint("tension", node, value)]
    x = np.linalg.solve(*sign_pattern_system(MESH, direction, known))
    gain = tension_gains(MESH, direction, np.array([node]), through_rest=True)
    assert gain[0] * value == pytest.approx(x[:11], rel=1e-9)


def test_resting_segment_ties_nothing_together() -> None:
    direction = np.array([-1.0] * 3 + [0.0] * 4 + [1.0] * 3)
    tied = np.isfinite(tension_gains(MESH, direction, np.array([0, 5, 10])))
    assert tied.sum(axis=1).tolist() == [4, 1, 4]
    assert tied[0, :4].all() and tied[1, 5] and tied[2, 7:].all()


def test_inverse_variance_has_less_variance_than_any_other_unbiased_weights() -> None:
    """Gauss-Markov, against the mean and against random weights that add up to 1."""
    random = np.random.default_rng(1)
    gain = tension_gains(MESH, -np.ones(10), EVERY)
    deviation = random.uniform(0.5, 3.0, 11)
    carried = gain[:, -1] * deviation
    best = fuse(np.zeros(11), gain, deviation).deviation[-1]
    mean = fuse(np.zeros(11), gain, deviation, "mean").deviation[-1]
    assert mean == pytest.approx(np.sqrt(np.sum(carried**2)) / 11.0)
    assert best < 0.8 * mean
    weights = random.dirichlet(np.ones(11), size=500)
    assert np.all(np.sqrt(np.sum((weights * carried) ** 2, axis=1)) > best)


@pytest.mark.parametrize("weights", ["mean", "variance"])
def test_error_has_the_stated_size_and_no_bias(weights: str) -> None:
    random = np.random.default_rng(2)
    truth = exact(np.ones(10))
    deviation = np.linspace(0.5, 2.0, 11)
    reading = truth + deviation * random.normal(size=(20_000, 11))
    gain = tension_gains(MESH, np.ones(10), EVERY)
    fused = fuse(reading, gain, deviation, weights)  # type: ignore[arg-type]
    error = (fused.tension - truth) / fused.deviation
    assert np.all(np.abs(error.mean(axis=0)) < 4.0 / np.sqrt(20_000))
    assert error.std(axis=0) == pytest.approx(np.ones(11), rel=0.03)


def test_mean_is_best_where_noise_is_in_proportion_to_tension() -> None:
    gain = tension_gains(MESH, np.ones(10), EVERY)
    deviation = 0.02 * exact(np.ones(10))
    reading = exact(np.ones(10)) + np.arange(11.0)
    mean = fuse(reading, gain, deviation, "mean")
    best = fuse(reading, gain, deviation)
    assert mean.tension == pytest.approx(best.tension)


def test_loss_of_the_mean_tends_to_sinh_a_over_a() -> None:
    fine = CABLE.replace(segments=400)
    gain = tension_gains(Mesh.of(fine), np.ones(400), np.arange(401))
    ones, zeros = np.ones(401), np.zeros(401)
    loss = fuse(zeros, gain, ones, "mean").deviation / fuse(zeros, gain, ones).deviation
    angle = CABLE.friction * CABLE.wrap
    assert loss[-1] == pytest.approx(np.sinh(angle) / angle, rel=0.01)


def test_held_estimate_keeps_its_error_and_averaged_one_loses_it() -> None:
    random = np.random.default_rng(3)
    truth = exact(-np.ones(10), 60.0)
    held = TensionFusion(CABLE, Sensors.everywhere(CABLE, 1.0), at_rest="hold")
    averaged = TensionFusion(CABLE, Sensors.everywhere(CABLE, 1.0))
    reading = truth + random.normal(size=(401, 11))
    directions = np.zeros((401, 10))
    directions[0] = -1.0
    kept = held.over(reading, directions)
    assert np.all(kept.tension == kept.tension[0])
    found = averaged.over(reading, directions)
    assert np.all(np.abs(found.tension[-1] - truth) < 4.0 * found.deviation[-1])
    # 401 readings of each sensor are of one number.
    assert found.deviation[-1] == pytest.approx(
        found.deviation[0] / np.sqrt(401.0), rel=1e-6
    )


def test_node_that_moved_unseen_is_believed_again() -> None:
    fusion = TensionFusion(CABLE, Sensors((0, 10), (0.1, 0.1)))
    for _ in range(50):
        fusion.update([20.0, 20.0], np.zeros(10))
    fusion.update([23.0, 20.0], np.zeros(10))
    assert fusion.tension[0] == pytest.approx(23.0, abs=1e-6)
    assert fusion.tension[10] == pytest.approx(20.0)


def test_unseen_moving_part_is_held_and_said_to_be_unknown() -> None:
    fusion = TensionFusion(CABLE, Sensors((0,), (0.5,)))
    fusion.reset(deviation=0.1)
    direction = np.array([0.0] * 7 + [1.0] * 3)
    fusion.update([20.0], direction)
    assert np.all(fusion.tension[7:] == 20.0)
    assert np.all(fusion.deviation[7:] > 1e5)
    assert np.all(fusion.deviation[:7] <= 0.1)


@pytest.mark.parametrize("at_rest", ["hold", "average"])
def test_many_cables_at_once_are_the_same_as_one_by_one(at_rest: str) -> None:
    random = np.random.default_rng(4)
    sensors = Sensors((1, 6, 9), (0.5, 1.0, 0.2))
    direction = random.integers(-1, 2, size=(30, 4, 10))
    reading = 20.0 + random.normal(size=(30, 4, 3))
    together = TensionFusion(CABLE, sensors, at_rest=at_rest)  # type: ignore[arg-type]
    together.reset(shape=(4,))
    many = together.over(reading, direction)
    for each in range(4):
        alone = TensionFusion(CABLE, sensors, at_rest=at_rest)  # type: ignore[arg-type]
        one = alone.over(reading[:, each], direction[:, each])
        assert many.tension[:, each] == pytest.approx(one.tension, rel=1e-12)
        assert many.deviation[:, each] == pytest.approx(one.deviation, rel=1e-9)


def test_inside_an_environment_step_and_on_its_recording() -> None:
    env = gymnasium.make("cc_mujoco/WristHandle-v1", trajectory="reach", duration=0.5)
    inner = env.unwrapped
    cable = plugin.from_mjcf(inner.model)["flexor"]
    sensors = Sensors.at(cable, np.linspace(0.0, cable.length, 11).tolist(), 0.5)
    fusion = TensionFusion(cable, sensors)
    random = np.random.default_rng(5)
    recorder = Recorder(plugin.from_mjcf(inner.model), {})
    _, info = env.reset(seed=0)
    recorder.record(info)
    fusion.reset(tension=info["tension_flexor_nodes_n"], deviation=0.01)
    measured, live, over = [], [], False
    while not over:
        _, _, _, over, info = env.step(np.array([0.3], dtype=np.float32))
        recorder.record(info)
        reading = plugin.read(inner.model, inner.data, "flexor")
        seen = reading.tension[list(sensors.nodes)]
        measured.append(seen + 0.5 * random.normal(size=seen.shape))
        live.append(fusion.update(measured[-1], reading.slip))
    env.close()
    log = recorder.log()
    truth = log["tension_flexor_nodes_n"]
    error = np.array(live) - truth[1:]
    assert np.ptp(truth[:, 0]) > 5.0
    assert np.sqrt(np.mean(error[:, -1] ** 2)) < 0.5
    assert np.sqrt(np.mean(error**2)) < 0.5
    again = TensionFusion(cable, sensors)
    again.reset(tension=truth[0], deviation=0.01)
    found = again.over(measured, log["slip_flexor_direction"][1:])
    assert np.array_equal(found.tension, np.array(live))


def test_sensors_off_the_cable_are_refused() -> None:
    with pytest.raises(CableError, match="one of each per sensor"):
        Sensors((0, 1), (1.0,))
    with pytest.raises(CableError, match="must be positive"):
        Sensors((0,), (0.0,))
    with pytest.raises(CableError, match="node 11"):
        TensionFusion(CABLE, Sensors((11,), (1.0,)))
    with pytest.raises(CableError, match=r"3 m; the cable has 2 m"):
        Sensors.at(CABLE, (3.0,), 1.0)
