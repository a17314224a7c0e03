"""Directions of slip that nobody knows: own solutions, consensus, partial motion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.cable import Cable, Section, replay
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device import Sensors
from cc_mujoco.estimation._fusion import tension_gains
from thesis._directions import (
    CONDITIONS,
    Moment,
    SensorConsensus,
    excess_moment,
    fuse_correlated,
    likeliest_pattern,
    majority_directions,
    median_last_moving,
    own_solutions,
    sensor_votes,
)
from thesis._literal_solver import Constraint, sign_patterns, solve

CABLE = Cable(friction=0.1, conduit=(Section(2.0, 0.28),), segments=10, pretension=20)
MESH = Mesh.of(CABLE)
EVERY = np.arange(11)


def moment(condition: str) -> Moment:
    return Moment.of(MESH, CONDITIONS[condition](10), 50.0, 5e-4)


@pytest.mark.parametrize("condition", CONDITIONS)
def test_own_solution_is_that_of_the_thesis_s_solver(condition: str) -> None:
    truth = moment(condition)
    random = np.random.default_rng(1)
    reading = truth.tension + 2.0 * random.normal(size=(6, 11))
    proximal = truth.displacement[0]
    first = truth.pattern
    own = own_solutions(MESH, truth.before, np.full(6, proximal), reading, EVERY, first)
    for row in range(6):
        for node in range(0, 11, 2):
            others = [p for p in sign_patterns(10) if not np.array_equal(p, first)]
            known = [
                Constraint("displacement", 0, proximal),
                Constraint("tension", node, reading[row, node]),
            ]
            found = solve(MESH, truth.before, known, [first, *others])
            assert own.pattern[row, node].tolist() == found.pattern.tolist()
            assert own.tension[row, node] == pytest.approx(found.tension, rel=1e-9)


@pytest.mark.parametrize("condition", CONDITIONS)
def test_moment_is_its_own_solution_without_noise(condition: str) -> None:
    truth = moment(condition)
    proximal = truth.displacement[0]
    own = own_solutions(
        MESH, truth.before, proximal, truth.tension, EVERY, truth.pattern
    )
    assert np.all(own.pattern == truth.pattern)
    assert np.all(own.fitting > 0)
    found = likeliest_pattern(
        MESH, truth.before, proximal, truth.tension, EVERY, np.ones(11)
    )
    assert found.tolist() == truth.pattern.tolist()


def test_all_readings_at_once_err_less_often_than_the_vote() -> None:
    truth = Moment.of(
        Mesh.of(CABLE.replace(friction=0.21)), CONDITIONS["stretching"](10), 50.0, 5e-4
    )
    mesh = Mesh.of(CABLE.replace(friction=0.21))
    random = np.random.default_rng(2)
    reading = truth.tension + 2.0 * random.normal(size=(300, 11))
    known = mesh, truth.before, np.full(300, truth.displacement[0]), reading, EVERY
    voted = majority_directions(own_solutions(*known, first=truth.pattern).pattern)
    best = likeliest_pattern(*known, np.full(11, 2.0), first=truth.pattern)
    wrong_vote, wrong = (np.mean(p != truth.pattern) for p in (voted, best))
    assert wrong < 0.3 * wrong_vote


@given(st.lists(st.integers(0, 11), min_size=1, max_size=12))
def test_median_is_believed_by_a_sensor_and_in_the_middle(nodes: list[int]) -> None:
    middle = median_last_moving(nodes)
    assert middle in nodes
    assert 2 * sum(node < middle for node in nodes) <= len(nodes)
    assert 2 * sum(node > middle for node in nodes) <= len(nodes)


def test_printed_example_of_the_median() -> None:
    assert median_last_moving([6, 7, 9, 7, 0, 0, 0]) == 6


def test_equal_votes_leave_the_direction() -> None:
    votes = np.array([[1.0, 1.0, -1.0], [-1.0, 1.0, -1.0]])
    assert majority_directions(votes, [-1.0, -1.0, 1.0]).tolist() == [-1.0, 1.0, -1.0]


@pytest.mark.parametrize("condition", CONDITIONS)
def test_extrapolation_is_worse_than_interpolation(condition: str) -> None:
    truth = moment(condition)
    _, own = sensor_votes(MESH, truth, Sensors.everywhere(CABLE, 0.5), 300, 3)
    error = own.tension - truth.tension
    carried = 0.5 * tension_gains(MESH, truth.pattern, EVERY, through_rest=True)
    worse = np.sqrt(np.mean(error**2, axis=0)) / carried
    sensor, node = np.indices(worse.shape)
    assert np.mean(worse[node > sensor]) > 1.2 * np.mean(worse[node < sensor])
    assert np.diag(worse) == pytest.approx(np.ones(11), rel=0.15)


def test_excess_moment_is_nonnegative_and_none_at_the_sensor_itself() -> None:
    truth = moment("compressing")
    sensors = Sensors.everywhere(CABLE, 0.5)
    _, own = sensor_votes(MESH, truth, sensors, 500, 4)
    error = own.tension[..., -1] - truth.tension[-1]
    excess = excess_moment(MESH, truth, sensors, error)
    assert np.min(np.linalg.eigvalsh(excess)) > -1e-9
    assert excess[10, 10] < 0.1
    assert excess[2, 2] > 10.0 * excess[10, 10]


def test_generalised_least_squares_beats_every_other_weights() -> None:
    random = np.random.default_rng(5)
    root = random.normal(size=(5, 5))
    covariance = root @ root.T + np.eye(5)
    weight = fuse_correlated(np.eye(5), covariance)
    assert np.sum(weight) == pytest.approx(1.0)
    others = random.dirichlet(np.ones(5), size=200)
    variance = np.einsum("ki,ij,kj->k", others, covariance, others)
    assert np.all(variance >= weight @ covariance @ weight)


def test_partial_motion_from_both_ends_matches_the_kernel_without_noise() -> None:
    dt = 0.01
    time = np.arange(0.0, 2.4, dt)
    knots = [0.0, 1.0, 1.4, 2.4]
    proximal = -0.03 * np.interp(time, knots, [0.0, 1.0, 1.0, 0.2])
    distal = -0.02 * np.interp(time, knots, [0.0, 0.7, 0.7, 0.0])
    true = replay(CABLE, dt, u_proximal=proximal, u_distal=distal, profile=True)
    assert true.tension is not None and true.direction is not None
    consensus = SensorConsensus(CABLE, Sensors.everywhere(CABLE, 1e-9))
    directions, tension = [], []
    for u, row in zip(proximal.tolist(), true.tension, strict=True):
        tension.append(consensus.update(u, row).copy())
        directions.append(consensus.direction.copy())
    partial = np.any(true.direction == 0, axis=1) & np.any(true.direction != 0, axis=1)
    assert np.count_nonzero(partial) > 20
    assert np.mean(np.array(directions) == true.direction) > 0.99
    error = np.array(tension) - true.tension
    # The last segment to join is taken for moving, with the noisier factor.
    assert np.sqrt(np.mean(error**2)) < 0.01 * np.max(true.tension)
    assert np.median(np.abs(error)) < 1e-3


def test_a_resting_cable_stays_at_rest_but_not_by_the_printed_rule() -> None:
    random = np.random.default_rng(6)
    pull = -np.linspace(0.0, 0.03, 60)
    true = replay(CABLE, 0.01, u_proximal=pull, u_distal=0.5 * pull, profile=True)
    assert true.tension is not None
    drift = []
    for threshold in (5.0, 0.0):
        consensus = SensorConsensus(
            CABLE, Sensors.everywhere(CABLE, 1e-3), threshold=threshold
        )
        for u, row in zip(pull.tolist(), true.tension, strict=True):
            consensus.update(u, row + 1e-3 * random.normal(size=11))
        for _ in range(100):
            consensus.update(
                float(pull[-1]), true.tension[-1] + 1e-3 * random.normal(size=11)
            )
        drift.append(np.max(np.abs(consensus.tension - true.tension[-1])))
    assert drift[0] < 0.02
    assert drift[1] > 20.0 * drift[0]
