"""Derivatives shared between fits equal those of the fitted residuals."""

from __future__ import annotations

from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cc_mujoco.diagnosis import Problem, Record, TorqueDerivatives, fit, prepare
from cc_mujoco.diagnosis._fit.problem import jacobian
from cc_mujoco.diagnosis._rig import records as replays_of
from cc_mujoco.diagnosis._rig.simulation import (
    TORQUE_OFFSETS,
    SimulatedRig,
    baseline_parameters,
)
from cc_mujoco.estimation._least_squares import Tuned
from cc_mujoco.native import FloatArray
from diagnosis.recorded import BENCH, dataset

RECORDS: list[Record] = []
COUNTS: list[NDArray[np.bool_]] = []
FREE: list[Tuned] = []


@pytest.fixture(scope="module", autouse=True)
def records() -> None:
    """Prepare the records that all tests fit when the first of them runs."""
    RECORDS[:], _ = prepare(dataset(duration=3.0), BENCH)
    COUNTS[:] = [record.counts for record in RECORDS]
    FREE[:] = baseline_parameters(BENCH, RECORDS, {})


def problem(plant: SimulatedRig, floor: float = 0.05) -> Problem:
    flat = tuple(np.full(r.measured.shape, floor) for r in RECORDS)
    return Problem(plant, tuple(FREE), (), flat, flat, 0.2)


@pytest.fixture
def replays(monkeypatch: pytest.MonkeyPatch) -> list[replays_of.Setting]:
    """Return the settings of replays, one for every record."""
    found: list[replays_of.Setting] = []
    replay = replays_of.replay

    def noted(record: Record, setting: replays_of.Setting) -> replays_of.Played:
        found.append(setting)
        return replay(record, setting)

    monkeypatch.setattr(replays_of, "replay", noted)
    monkeypatch.setattr(replays_of, "REPLAYS", WeakKeyDictionary())
    return found


def apart(found: FloatArray, wanted: FloatArray) -> float:
    return float(np.linalg.norm(found - wanted) / np.linalg.norm(wanted))


def differenced(one: Problem, x: FloatArray, index: int) -> FloatArray:
    step = 1e-3 if one.tuned[index].factor else 0.02
    moved = x.copy()
    moved[index] += step
    return (one.residual(moved, COUNTS) - one.residual(x, COUNTS)) / step


def test_derivatives_are_differences_of_the_residual() -> None:
    one = problem(SimulatedRig(BENCH, tuple(RECORDS), 8))
    x = np.zeros(len(FREE))
    found = jacobian(one, x, COUNTS)
    for index, parameter in enumerate(FREE):
        # Friction's corners make differences depend on the step.
        exact = parameter.name in TORQUE_OFFSETS
        off = apart(found[:, index], differenced(one, x, index))
        assert off < (0.02 if exact else 0.3), parameter.name


def test_derivatives_follow_simulations_elsewhere() -> None:
    """Without a difference more, the change from place to place is what was seen."""
    one = problem(SimulatedRig(BENCH, tuple(RECORDS), 8), 5.0)  # no error is large
    x = np.zeros(len(FREE))
    stale = jacobian(one, x, COUNTS)
    there = x.copy()
    there[[0, 1, 5]] = 0.04, 0.03, 0.2
    change = one.residual(there, COUNTS) - one.residual(x, COUNTS)
    followed = jacobian(one, there, COUNTS)
    assert apart(followed @ there, change) < 0.02 < apart(stale @ there, change)


def test_derivatives_are_taken_anew_where_they_fail(
    replays: list[replays_of.Setting],
) -> None:
    one = problem(SimulatedRig(BENCH, tuple(RECORDS), 8))
    x = np.zeros(len(FREE))
    jacobian(one, x, COUNTS)
    x[0] = 1.5
    replays.clear()
    jacobian(one, x, COUNTS)
    assert len(replays) > len(FREE)
    fresh = replace(one, slopes=TorqueDerivatives())
    index = one.names.index("axial_stiffness")
    wanted = jacobian(fresh, x, COUNTS)[:, index]
    assert apart(jacobian(one, x, COUNTS)[:, index], wanted) < 0.3


def test_a_wider_model_begins_with_derivatives_of_the_narrower(
    replays: list[replays_of.Setting],
) -> None:
    one = problem(SimulatedRig(BENCH, tuple(RECORDS), 8))
    x = np.zeros(len(FREE))
    narrow = jacobian(one, x, COUNTS)
    replays.clear()
    start = {"viscous_friction": 50.0}
    wider = one.with_effect("viscous_friction", start)
    wide = jacobian(wider, wider.placed(x, start), COUNTS)
    assert len(replays) == 2 * len(RECORDS)  # there, and a step from there
    off = wider.names.index("axial_stiffness")
    assert apart(wide[:, off], narrow[:, off]) < 0.5
    replays.clear()
    start = {"motor_inertia": 1e-4}
    wider = one.with_effect("motor_inertia", start)
    jacobian(wider, wider.placed(x, start), COUNTS)
    assert not replays


def test_what_only_a_torque_sensor_shows_needs_no_replay(
    replays: list[replays_of.Setting],
) -> None:
    jacobian(
        problem(SimulatedRig(BENCH, tuple(RECORDS), 8)), np.zeros(len(FREE)), COUNTS
    )
    sensors = sum("torque" in parameter.name for parameter in FREE)
    assert sensors == 4
    assert len(replays) == len(RECORDS) * (1 + len(FREE) - sensors)


def test_replays_that_are_shared_are_those_that_are_taken_anew(
    replays: list[replays_of.Setting],
) -> None:
    plant = SimulatedRig(BENCH, tuple(RECORDS), 8)
    values = problem(plant).values(np.full(len(FREE), 0.01))
    effects = ("viscous_friction", "joint_gravity")
    values |= {"viscous_friction": 9.0, "gravity_sine": 0.1, "gravity_cosine": 0.2}
    first = plant.simulate(values, effects)
    again = plant.simulate(values, effects)
    other = plant.simulate(values | {"gravity_sine": 0.3}, effects)
    assert len(replays) == len(RECORDS)
    fresh = plant.limited([replace(record) for record in RECORDS])
    for values_, found in ((values, again), (values | {"gravity_sine": 0.3}, other)):
        for a, b in zip(found, fresh.simulate(values_, effects), strict=True):
            np.testing.assert_array_equal(a, b)
    assert not np.array_equal(first[0], other[0])


def test_fits_of_one_neighbourhood_share_their_derivatives(
    replays: list[replays_of.Setting],
) -> None:
    one = problem(SimulatedRig(BENCH, tuple(RECORDS), 8))
    first = fit(one, np.zeros(len(FREE)), COUNTS)
    alone = len(replays)
    again = fit(one, first.x, COUNTS)
    assert len(replays) - alone < 0.2 * alone
    assert again.cost == pytest.approx(first.cost, rel=1e-2)


def test_a_fit_ends_where_plain_least_squares_does() -> None:
    one = problem(SimulatedRig(BENCH, tuple(RECORDS), 8), 5.0)
    low, high = (np.array([getattr(p, side) for p in FREE]) for side in ("low", "high"))
    plain = least_squares(
        lambda x: one.residual(x, COUNTS),
        np.zeros(len(FREE)),
        jac=lambda x: jacobian(replace(one, slopes=TorqueDerivatives()), x, COUNTS),
        bounds=(low - 1e-9, high + 1e-9),
        x_scale="jac",
        max_nfev=12,
    )
    assert fit(one, np.zeros(len(FREE)), COUNTS).cost <= 1.01 * plain.cost
