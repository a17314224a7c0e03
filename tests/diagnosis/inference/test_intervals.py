"""Intervals of fits: of trials that disagree, of errors that all trials share."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import stdtrit

from cc_mujoco.cable import Parameter
from cc_mujoco.diagnosis import prepare
from cc_mujoco.diagnosis._fit import problem as fitting
from cc_mujoco.diagnosis._fit.intervals import (
    Spread,
    disagreement,
    estimates,
    fit_covariance,
    form_error,
    law_error,
    noise_covariance,
    parts_of,
)
from cc_mujoco.diagnosis._judge import deviating_parameters
from cc_mujoco.diagnosis._phrases import format_interval
from cc_mujoco.diagnosis._rig.simulation import SimulatedRig, baseline_parameters
from cc_mujoco.estimation._least_squares import Tuned, covariance
from cc_mujoco.native import FloatArray
from diagnosis.recorded import BENCH, dataset

TRIALS, SAMPLES = 7, 40
PARTS = np.repeat(np.arange(TRIALS), SAMPLES)


def fitted(slopes: FloatArray, data: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Place and residual of a linear fit, residual = data + slopes x."""
    x = -np.linalg.lstsq(slopes, data, rcond=None)[0]
    return x, data + slopes @ x


@given(st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_leaving_out_by_a_step_is_leaving_out(seed: int) -> None:
    random = np.random.default_rng(seed)
    slopes = random.normal(size=(PARTS.size, 3)) * random.uniform(0.2, 5.0, 3)
    data = random.normal(size=PARTS.size) + 0.3 * random.normal(size=TRIALS)[PARTS]
    x, residual = fitted(slopes, data)
    squares = []
    for part in range(TRIALS):
        kept = PARTS != part
        there, _ = fitted(slopes[kept], data[kept])
        moved = np.diag(covariance(slopes[kept]) - covariance(slopes))
        squares.append((there - x) ** 2 / moved)
    found = disagreement(slopes, residual, PARTS)
    assert found.factor == pytest.approx(np.mean(squares, axis=0), rel=1e-6)
    assert np.all((found.freedom > 1.0) & (found.freedom < TRIALS))


def test_equal_trials_have_one_degree_of_freedom_less() -> None:
    slopes = np.tile(np.random.default_rng(0).normal(size=(SAMPLES, 2)), (TRIALS, 1))
    found = disagreement(slopes, np.ones(PARTS.size), PARTS)
    assert found.freedom == pytest.approx(np.full(2, TRIALS - 1.0))


def test_trials_that_disagree_are_covered_as_often_as_is_said() -> None:
    """Every trial has a value of its own; of 1000 fits 95 % hold their mean."""
    random = np.random.default_rng(1)
    hits, plain = [], []
    for _ in range(1000):
        slopes = random.normal(size=(PARTS.size, 2))
        own = random.normal(size=(TRIALS, 2))
        data = np.sum(slopes * own[PARTS], axis=1) + random.normal(size=PARTS.size)
        x, residual = fitted(slopes, data)
        found = disagreement(slopes, residual, PARTS)
        size = np.sqrt(np.diag(covariance(slopes)) * found.factor)
        hits += list(np.abs(x) < stdtrit(found.freedom, 0.975) * size)
        plain += list(np.abs(x) < 1.96 * size)
    assert 0.935 < np.mean(hits) < 0.965
    assert np.mean(plain) < 0.92


def test_what_a_single_trial_tells_is_not_said_to_be_in_dispute() -> None:
    """Without it the parameter runs as far as its prior lets it, as noise would do."""
    random = np.random.default_rng(2)
    factors = []
    for _ in range(200):
        slopes = random.normal(size=(PARTS.size, 2))
        slopes[PARTS > 0, 1] = 0.0
        slopes = np.vstack([slopes, [0.0, 1e-2]])
        data = np.append(random.normal(size=PARTS.size), 0.0)
        _, residual = fitted(slopes, data)
        found = disagreement(slopes, residual, PARTS)
        factors.append(found.factor[1])
    assert np.mean(factors) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("size", [0.0, 3.0])
def test_an_error_of_form_is_as_large_as_it_makes_fits_err(size: float) -> None:
    """Its directions are half hidden by the parameters; the rest shows their size."""
    random = np.random.default_rng(3)
    slopes = random.normal(size=(200, 3))
    controls = random.normal(size=(200, 4)) + 0.7 * slopes[:, [0, 1, 2, 0]]
    base, _ = np.linalg.qr(controls)
    noise = covariance(slopes)
    wrong, told = [], []
    for _ in range(3000):
        error = base @ (size * random.normal(size=4))
        x, residual = fitted(slopes, error + random.normal(size=200))
        told.append(form_error(slopes, residual, noise, controls))
        wrong.append(x)
    beyond = np.cov(np.array(wrong).T) - noise
    mean = np.mean(told, axis=0)
    if size:
        assert np.diag(mean) == pytest.approx(np.diag(beyond), rel=0.1)
    else:
        assert np.max(np.diag(mean) / np.diag(noise)) < 0.5


@pytest.mark.parametrize("wrong", [0.05, 0.2])
def test_a_law_that_is_wrong_by_a_share_moves_parameters_by_that_share(
    wrong: float,
) -> None:
    random = np.random.default_rng(4)
    slopes = random.normal(size=(PARTS.size, 2))
    change = slopes @ [3.0, -1.0] + 2.0 * random.normal(size=PARTS.size)
    prior = np.array([[0.0, 0.1]])
    moved, _ = fitted(slopes, -change)
    beside = change - slopes @ moved
    excess = float(np.sum((wrong * beside) ** 2))
    found = law_error(np.concatenate([slopes, prior]), 1, change, excess)
    assert np.sqrt(np.diag(found)) == pytest.approx(wrong * np.abs(moved), rel=1e-3)
    assert not law_error(slopes, 0, change, 0.0).any()


def test_without_controls_or_room_beside_the_model_no_form_is_wrong() -> None:
    slopes = np.random.default_rng(4).normal(size=(50, 2))
    noise, residual = covariance(slopes), np.ones(50)
    for controls in (np.zeros((50, 0)), np.zeros((50, 2)), slopes):
        assert np.all(form_error(slopes, residual, noise, controls) == 0.0)


def _record(group: str, count: int) -> Any:
    return SimpleNamespace(group=group, measured=np.zeros((2, count)))


def test_trials_are_left_out_with_their_repetitions_and_of_two_their_pieces() -> None:
    records = [_record(group, 24) for group in ("a", "b", "c", "a")]
    masks = [np.ones(24, dtype=bool) for _ in records]
    assert parts_of(records, masks).tolist() == np.repeat([0, 1, 2, 0], 48).tolist()
    masks[2][:] = False
    pieces = parts_of(records, masks)
    assert pieces.size == 3 * 48
    assert len(set(pieces.tolist())) == 3 * 12
    # Both torques of a sample are in one piece.
    assert np.array_equal(pieces[:24], pieces[24:48])


def test_a_spread_has_all_that_noise_makes_and_a_t_for_every_parameter() -> None:
    records, _ = prepare(dataset(duration=1.5), BENCH)
    floor = tuple(np.full(record.measured.shape, 0.05) for record in records)
    free = baseline_parameters(BENCH, records, {})
    problem = fitting.Problem(SimulatedRig(BENCH, records, 4), free, (), floor, floor)
    counts = [record.counts for record in records]
    x = fitting.fit_until_settled(problem, np.zeros(len(free)), counts).x
    noise, whole = (
        noise_covariance(problem, x, counts),
        fit_covariance(problem, x, counts),
    )
    least = np.linalg.eigvalsh(whole.covariance - noise.covariance)[0]
    assert least > -1e-9 * np.max(np.diag(whole.covariance))
    assert np.all(whole.freedom > 0.0)
    wide, slim = (estimates(problem, x, each) for each in (whole, noise))
    for name, estimate in wide.items():
        assert estimate.ci95[0] <= slim[name].ci95[0]
        assert estimate.ci95[1] >= slim[name].ci95[1]
    assert isinstance(whole, Spread)


@pytest.mark.parametrize("deviation", [0.5, 5.0, 1e9])
def test_an_interval_over_many_powers_of_ten_is_not_determined(
    deviation: float,
) -> None:
    records, _ = prepare(dataset(duration=1.5), BENCH)
    free = baseline_parameters(BENCH, records, {})
    problem = fitting.Problem(SimulatedRig(BENCH, records, 4), free, (), (), ())
    place = [parameter.name for parameter in free].index("axial_stiffness")
    variance, x = 1e-6 * np.eye(len(free)), np.zeros(len(free))
    variance[place, place], x[place] = deviation**2, 3.0
    found = estimates(problem, x, Spread(variance, np.full(len(free), np.inf)))
    # The laws of other effects widen a value as noise of their variance does.
    known = np.full(len(free), np.inf)
    wider = estimates(problem, x, Spread(variance, known, np.diag(variance)))
    assert wider == estimates(problem, x, Spread(2.0 * variance, known))
    unsure = {name for name, each in found.items() if not math.isfinite(each.ci95[0])}
    assert unsure == ({"axial_stiffness"} if deviation > 4.0 else set())
    assert found["axial_stiffness"].holds(1.0) is (deviation > 4.0)
    (far,) = deviating_parameters(problem, x, found, ()) or (None,)
    assert (far is None) is (deviation > 4.0)
    shown = format_interval(found["axial_stiffness"])
    assert (shown == "not determined") is (deviation > 4.0)


def test_a_fit_whose_end_is_told_goes_on_along_a_flat_valley(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The cost of what no model explains hides that a valley goes on downhill."""

    def residual(x: FloatArray, _masks: object = None) -> FloatArray:
        valley = [3.0 * (x[1] - x[0] ** 2 / 5.0), 0.5 * (x[0] - 4.0)]
        return np.array([*valley, *np.full(4000, 1.0)])

    def slopes(_problem: object, x: FloatArray, _masks: object = None) -> FloatArray:
        found = np.zeros((4002, 2))
        found[0] = -1.2 * x[0], 3.0
        found[1, 0] = 0.5
        return found

    free = tuple(Tuned(Parameter(n), 0.0, 1.0, -9.0, 9.0) for n in ("a", "b"))
    problem: Any = SimpleNamespace(residual=residual, tuned=free)
    problem.coarse = problem
    monkeypatch.setattr(fitting, "jacobian", slopes)
    off = []
    for fit in (fitting.fit, fitting.fit_until_settled):
        x = fit(problem, np.array([1.0, 0.2]), []).x
        off.append(abs(x[0] - 4.0) * 0.5)
    assert off[0] > 0.5
    assert off[1] < 0.1


def test_a_fit_of_coarse_simulations_ends_where_that_of_fine_ones_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A coarse fit alone ends tenths away."""
    time = np.linspace(0.0, 2.0, 50)
    measured = 1.3 * np.exp(-0.7 * time) + 0.05 * np.sin(9.0 * time)

    def decay(rate: float, steps: int) -> FloatArray:
        """Return exp(-rate time) by implicit Euler steps."""
        return np.asarray((1.0 + rate * time / steps) ** -steps)

    def problem_of(steps: int, defect: FloatArray) -> Any:
        def residual(x: FloatArray, _masks: object = None) -> FloatArray:
            return np.asarray(x[0] * decay(x[1], steps) + defect - measured)

        made: Any = SimpleNamespace(residual=residual, tuned=free)
        made.coarse = made
        return made

    def slopes(problem: Any, x: FloatArray, _masks: object = None) -> FloatArray:
        ahead = [problem.residual(x + 1e-6 * way) for way in np.eye(2)]
        return np.transpose(ahead - problem.residual(x)) / 1e-6

    free = tuple(Tuned(Parameter(n), 0.0, 1.0, -9.0, 9.0) for n in ("a", "b"))
    monkeypatch.setattr(fitting, "jacobian", slopes)
    fine, coarse = problem_of(64, 0.0 * time), problem_of(1, 0.0 * time)
    start, masks = np.array([1.0, 0.3]), [np.ones(50, bool)]
    expected = fitting.fit(fine, start, masks).x
    assert np.max(np.abs(fitting.fit(coarse, start, masks).x - expected)) > 0.1

    def corrected(x: FloatArray, _seen: object) -> Any:
        return problem_of(1, x[0] * (decay(x[1], 64) - decay(x[1], 1)))

    fine.coarse, fine.corrected = coarse, corrected
    found = fitting.fit_until_settled(fine, start, masks)
    assert found.x == pytest.approx(expected, abs=5e-3)
    assert found.cost == pytest.approx(0.5 * np.sum(fine.residual(found.x) ** 2))
