"""Estimation of parameters while the cable runs, on a small version of each run."""

from __future__ import annotations

import numpy as np
import pytest

from cc_mujoco.cable import replay
from thesis._experiments import online as runs

MU = runs.CABLE.friction


def test_constant_parameters_give_what_a_replay_gives() -> None:
    motion = runs.strokes(3.0)
    data = runs.simulate(runs.CABLE, motion, seed=1)
    _, proximal, distal = motion
    clean = replay(
        runs.CABLE, runs.DT, u_proximal=proximal, u_distal=distal, profile=True
    )
    assert clean.direction is not None
    assert data.tension == pytest.approx(clean.tension, rel=1e-9)
    assert np.array_equal(data.direction, clean.direction)
    error = data.reading - data.tension
    assert np.std(error) == pytest.approx(runs.NOISE, rel=0.05)


def test_truth_drifts_as_stated_and_the_cable_feels_it() -> None:
    factor = runs.drift(8.0, 2.0, 1.5)
    assert factor[[0, 200]] == pytest.approx([1.0, 1.0]) and factor[-1] > 1.49
    data = runs.simulate(runs.CABLE, runs.strokes(8.0), seed=1, factor=factor)
    whole = np.flatnonzero(np.all(data.direction == data.direction[:, :1], axis=1))
    row = int(whole[data.direction[whole, 0] != 0][-1])
    ratio = abs(np.log(data.tension[row, 0] / data.tension[row, -1]))
    # A parameter changes in spells of CHUNK samples.
    assert ratio == pytest.approx(MU * factor[row] * runs.CABLE.wrap, rel=0.01)


def test_winding_cable_has_the_same_wrap() -> None:
    winding = runs.winding_path(runs.CABLE)
    assert winding.wrap == pytest.approx(runs.CABLE.wrap)
    assert winding.length == pytest.approx(runs.CABLE.length)


def test_locked_output_leaves_the_motion_partial() -> None:
    cable = runs.CABLE.replace(segments=50, pretension=20.0)
    data = runs.simulate(cable, runs.pulls(5.0, runs.PULL_DEPTH), seed=1)
    assert np.all(data.direction[:, -1] == 0) and np.any(data.direction != 0)


def test_following_measures_settling_error_and_coverage() -> None:
    time, truth = np.arange(5.0), np.full(5, 2.0)
    value = np.array([4.0, 2.5, 2.02, 1.98, 2.02])
    found = runs.tracking_statistics(time, value, np.full(5, 0.015), truth)
    assert found == pytest.approx((2.0, 0.01, 0.0075, 1.0))
    lost = runs.tracking_statistics(time, value + 1.0, np.full(5, 0.1), truth)
    assert lost.settled == np.inf and np.isnan(lost.error)


def test_slopes_of_the_model_leave_the_line_with_friction() -> None:
    ratio, exact = runs.slopes()
    assert np.all(np.diff(ratio) > 0.2)
    assert ratio[0] < 0.9 and ratio[-1] > 1.1
    # A straight line through an exponential profile misses its ends.
    assert 0.9 < exact < 0.99


@pytest.mark.study
def test_printed_law_needs_the_sign_of_motion_and_integration() -> None:
    printed, signed, summed, ours = runs.laws(duration=12.0)
    assert printed > 0.9 and signed > 0.5
    assert summed < 0.2 and ours < 0.01


@pytest.mark.parametrize(
    ("printed", "summed", "verdict"),
    [(1.0, 0.01, "in part"), (0.1, 0.01, "agrees"), (1.0, 0.5, "disagrees")],
)
def test_verdict_on_the_law_follows_the_numbers(
    printed: float, summed: float, verdict: str
) -> None:
    assert runs.claim_law([printed, 0.7, summed, 0.0]).verdict == verdict


def test_friction_that_grows_is_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "DRIFT_START", 3.0)
    found, _ = runs.follow_friction(duration=38.0)
    assert found.settled < 2.0
    # Drift is five times faster here: the error is lag, and stated.
    assert 0.01 < found.error < 0.04
    assert found.covered > 0.9


def test_stiffness_is_found_in_partial_motion_and_refused_in_mass_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(runs, "STIFFNESS_DRIFT", 1.0)
    found, before = runs.follow_stiffness(duration=24.0)
    assert found.settled < 10.0 and found.error < 0.02
    assert abs(before) < 0.02
    fooled, refused = runs.stiffness_in_mass_motion()
    assert refused == pytest.approx(1.0, abs=1e-12)
    assert abs(fooled - 1.0) > 0.2


def test_bend_is_found_from_a_uniform_start() -> None:
    before, *_ = runs.follow_bend(duration=22.0)
    assert before < 0.03
