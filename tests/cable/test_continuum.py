"""The oracle against closed forms, itself on a finer path, and recorded solutions."""

from __future__ import annotations

import json
from itertools import pairwise, product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from cable.continuum import Continuum, solve
from cable.motions import MOTIONS, motion
from shared_folder import SHARED
from study_marks import study_but

REFERENCE = SHARED / "reference" / "cable"

WRIST = [(2.0, 0.28)]
BENDS = [(0.8, 0.15), (0.6, np.inf), (0.6, 0.4)]
STRAIGHT_ENDS = [(0.3, np.inf), (0.5, 0.2), (0.4, np.inf), (0.5, 0.2), (0.3, np.inf)]
CABLES = {
    "wrist": (WRIST, 0.21, 4e3, 10.0),
    "three_bends": (BENDS, 0.08, 6e3, 20.0),
    "straight_ends": (STRAIGHT_ENDS, 0.15, 5e3, 15.0),
}


def rest_stretch(name: str) -> float:
    sections, _, stiffness, pretension = CABLES[name]
    return pretension * sum(length for length, *_ in sections) / stiffness


def stretch_along(cable: Continuum, stiffness: float, points: int = 20_001) -> float:
    x = np.linspace(0.0, sum(length for length, _ in cable.sections), points)
    return np.trapezoid([cable.tension(p) for p in x], x) / stiffness


@pytest.mark.shared
@pytest.mark.parametrize(
    ("cable", "name"),
    study_but(
        4, [("wrist", "random_reversals"), *(("three_bends", name) for name in MOTIONS)]
    ),
)
def test_agrees_with_recorded_solutions(cable: str, name: str) -> None:
    file = f"{cable}__{name}.csv"
    recorded = json.loads((REFERENCE / "parameters.json").read_text())[file]
    sections, friction, stiffness, pretension = CABLES[cable]
    assert recorded["friction"] == friction
    assert recorded["axial_stiffness_n"] == stiffness
    assert recorded["pretension_n"] == pretension
    data = np.loadtxt(REFERENCE / file, delimiter=",", skiprows=1).T
    tension = solve(sections, friction, stiffness, pretension, data[0], data[1])
    error = np.sqrt(np.mean((np.stack(tension) - data[2:]) ** 2, axis=1))
    assert error.max() <= 5e-4 * data[2:].max()


@pytest.mark.parametrize("end", [0, 1])
def test_pull_at_one_end_follows_the_closed_form(end: int) -> None:
    """T0 e^f at the pulled end while the front f creeps, one capstan slope after."""
    sections, friction, stiffness, pretension = CABLES["wrist"]
    length, radius = sections[0]
    density, wrap = radius / (friction * stiffness), friction * length / radius
    front = np.linspace(0.0, wrap, 40)
    pull = pretension * density * (np.expm1(front) - front)
    slip = pull[-1] * np.linspace(1.1, 3.0, 10)
    rest = pretension * length / stiffness
    distal = (rest + slip) / (density * np.expm1(wrap))

    locked = np.zeros(50)
    moved = np.concatenate([pull, slip])
    ends = (-moved, locked) if end == 0 else (locked, moved)
    tension = solve(sections, friction, stiffness, pretension, *ends)
    expected = np.concatenate([pretension * np.exp(front), distal * np.exp(wrap)])
    np.testing.assert_allclose(tension[end], expected, rtol=1e-10)
    expected = np.concatenate([np.full(40, pretension), distal])
    np.testing.assert_allclose(tension[1 - end], expected, rtol=1e-10)


@pytest.mark.parametrize("cable", CABLES)
@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_full_slip_ratio_is_the_capstan_factor(cable: str, direction: float) -> None:
    sections, friction, stiffness, pretension = CABLES[cable]
    u = direction * np.linspace(0.0, 1.0, 30)
    proximal, distal = solve(sections, friction, stiffness, pretension, u, u)
    wrap = sum(length / radius for length, radius, *_ in sections)
    factor = np.exp(direction * friction * wrap)
    np.testing.assert_allclose(distal[1:] / proximal[1:], factor, rtol=1e-12)


@pytest.mark.parametrize(
    ("sections", "friction"), [([(1.5, np.inf)], 0.3), ([(1.0, 0.2), (0.5, 0.1)], 0.0)]
)
def test_frictionless_cable_is_a_spring(
    sections: list[tuple[float, float]], friction: float
) -> None:
    rng = np.random.default_rng(0)
    u = rng.normal(scale=5e-3, size=(2, 200))
    u -= u[:, :1]
    proximal, distal = solve(sections, friction, 3e3, 4.0, u[0], u[1])
    expected = np.maximum(4.0 + 3e3 / 1.5 * (u[1] - u[0]), 0.0)
    np.testing.assert_allclose(proximal, expected, atol=1e-9)
    np.testing.assert_allclose(distal, expected, atol=1e-9)


@pytest.mark.parametrize("sections", [WRIST, STRAIGHT_ENDS])
def test_equal_pull_at_both_ends_leaves_the_null_point_in_the_middle(
    sections: list[tuple[float, float]],
) -> None:
    cable = Continuum(sections, 0.2, 4e3, 10.0)
    length = sum(length for length, *_ in sections)
    for _ in range(50):
        cable.move(-1e-3, 1e-3)
    wrap = 0.2 * sum(length / radius for length, radius, *_ in sections)
    ends, middle = cable.tension(0.0), cable.tension(0.5 * length)
    assert cable.tension(length) == pytest.approx(ends, rel=1e-12)
    assert ends / middle == pytest.approx(np.exp(0.5 * wrap), rel=1e-12)
    assert stretch_along(cable, 4e3) == pytest.approx(cable.stretch, rel=1e-5)


def test_uneven_pull_moves_each_side_by_its_own_displacement() -> None:
    """From slack every strain is new, so both sides' stretch is their end's travel."""
    cable = Continuum(WRIST, 0.21, 4e3, 0.0)
    cable.move(-1e-3, 4e-3)
    x = np.linspace(0.0, 2.0, 20_001)
    tension = np.array([cable.tension(p) for p in x])
    null = int(np.argmin(tension))
    assert np.trapezoid(tension[: null + 1], x[: null + 1]) / 4e3 == pytest.approx(
        1e-3, rel=1e-3
    )
    assert np.trapezoid(tension[null:], x[null:]) / 4e3 == pytest.approx(4e-3, rel=1e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_null_point_drifts_as_the_balance_of_each_side_demands(sign: float) -> None:
    """Each side obeys dT_end / T_end = dstretch / (density |T_end - T_null|)."""
    sections, friction, stiffness, _ = CABLES["wrist"]
    density, wrap = 0.28 / (friction * stiffness), friction * 2.0 / 0.28
    cable = Continuum(sections, friction, stiffness, 0.0)
    cable.move(-0.03, 0.03)
    cable.move(-sign * 22e-3, sign * 22e-3)  # far enough for the fronts to meet
    assert cable.profile is not None
    assert cable.profile.slopes == [-sign, sign]

    def rates(_: float, tension: NDArray[np.float64]) -> NDArray[np.float64]:
        null = np.sqrt(tension.prod() * np.exp(-sign * wrap))
        slip_direction = sign * np.array([4e-3, 1e-3])
        rate: NDArray[np.float64] = (
            tension * slip_direction / (density * sign * (tension - null))
        )
        return rate

    start = [cable.tension(0.0), cable.tension(2.0)]
    path = solve_ivp(rates, (0.0, 1.0), start, rtol=1e-10, atol=1e-10)
    for _ in range(5):
        cable.move(-sign * 4e-3 / 5, sign * 1e-3 / 5)
    end = [cable.tension(0.0), cable.tension(2.0)]
    np.testing.assert_allclose(end, path.y[:, -1], rtol=1e-7)


def test_small_closed_cycle_repeats_and_takes_work() -> None:
    """Creep at one end: the loop closes, and the far end never feels it."""
    sections, friction, stiffness, pretension = CABLES["three_bends"]
    travel = np.array([0.0, -4e-4, 0.0, -4e-4, 0.0, -4e-4])
    u = np.interp(np.linspace(0, 5, 501), np.arange(6), travel)
    proximal, distal = solve(
        sections, friction, stiffness, pretension, u, np.zeros(501)
    )
    np.testing.assert_allclose(distal, pretension, rtol=1e-12)
    np.testing.assert_allclose(proximal[101:301], proximal[301:501], rtol=1e-10)
    taken = [-np.trapezoid(proximal[i : i + 201], u[i : i + 201]) for i in (100, 300)]
    assert taken[0] > 0.0
    assert taken[1] == pytest.approx(taken[0], rel=1e-10)


@pytest.mark.parametrize("cable", CABLES)
def test_slack_is_exactly_zero_and_forgets(cable: str) -> None:
    sections, friction, stiffness, pretension = CABLES[cable]
    rest = rest_stretch(cable)
    loosen = np.array([0.0, 2.0, 3.0, 0.5, 0.0]) * rest
    proximal, distal = solve(
        sections, friction, stiffness, pretension, loosen, np.zeros_like(loosen)
    )
    np.testing.assert_array_equal(proximal[1:3], 0.0)
    np.testing.assert_array_equal(distal[1:3], 0.0)
    assert proximal[4] > distal[4] > 0.0

    fresh = Continuum(sections, friction, stiffness, 0.0)
    fresh.move(-rest, 0.0)
    assert proximal[4] == pytest.approx(fresh.tension(0.0), rel=1e-12)


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("cable", CABLES)
def test_path_is_exact_so_finer_samples_change_nothing(cable: str, name: str) -> None:
    sections, friction, stiffness, pretension = CABLES[cable]
    rng = np.random.default_rng(7)
    u = motion(name, rest_stretch(cable), rng, samples=81)
    coarse = np.stack(solve(sections, friction, stiffness, pretension, *u))
    fine_at = np.linspace(0.0, 80.0, 241)
    fine_u = [np.interp(fine_at, np.arange(81), end) for end in u]
    fine = np.stack(solve(sections, friction, stiffness, pretension, *fine_u))
    np.testing.assert_allclose(fine[:, ::3], coarse, atol=1e-8 * coarse.max())
    assert np.all(coarse >= 0.0)


@pytest.mark.parametrize(("cable", "name"), study_but(2, product(CABLES, MOTIONS)))
def test_strain_adds_up_and_slope_stays_in_the_cone(cable: str, name: str) -> None:
    sections, friction, stiffness, pretension = CABLES[cable]
    solver = Continuum(sections, friction, stiffness, pretension)
    u = motion(name, rest_stretch(cable), np.random.default_rng(3), samples=41)
    steps = [(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(zip(*u, strict=True))]
    for i, (proximal, distal) in enumerate(steps):
        solver.move(proximal, distal)
        if solver.profile is not None:
            slope = np.diff(solver.profile.log_tension) / np.diff(solver.profile.knots)
            np.testing.assert_allclose(slope, solver.profile.slopes, atol=1e-6)
            assert np.abs(solver.profile.slopes).max() <= 1.0
        if i % 8 == 7:
            expected = max(solver.stretch, 0.0)
            actual = stretch_along(solver, stiffness, 2001)
            assert actual == pytest.approx(expected, rel=1e-4, abs=1e-12)


@pytest.mark.parametrize("name", MOTIONS)
def test_motions_start_at_rest_and_repeat_with_their_seed(name: str) -> None:
    first = motion(name, 0.005, np.random.default_rng(2), samples=500)
    again = motion(name, 0.005, np.random.default_rng(2), samples=500)
    other = motion(name, 0.005, np.random.default_rng(5), samples=500)
    np.testing.assert_array_equal(first, again)
    assert np.abs(np.subtract(first, other)).max() > 1e-3
    assert [end[0] for end in first] == pytest.approx([0.0, 0.005], abs=1e-15)


@pytest.mark.shared
@pytest.mark.parametrize("name", sorted(set(MOTIONS) - {"random_reversals"}))
def test_nominal_motions_are_the_recorded_ones(name: str) -> None:
    file = REFERENCE / f"wrist__{name}.csv"
    recorded = np.loadtxt(file, delimiter=",", skiprows=1, usecols=(0, 1)).T
    np.testing.assert_allclose(motion(name, 0.005), recorded, atol=1e-5)


@pytest.mark.parametrize("share", [0.15, 0.2, 0.25])
def test_release_beside_a_long_straight_end_makes_no_jump(share: float) -> None:
    """The share of compliance on one side of the null point is not monotone there."""
    pulled, released = np.linspace(0.0, 1e-3, 200), np.linspace(0.0, 5e-4, 200)
    distal = np.concatenate([pulled, 1e-3 - released * (1.0 - share) / share])
    proximal = -np.concatenate([pulled, 1e-3 - released])
    sections = [(0.315, 0.087), (0.65, np.inf)]
    friction = 1.55 * 0.087 / 0.315
    tensions = solve(sections, friction, 4e3, 10.0, proximal, distal)
    for tension in tensions:
        assert np.max(np.abs(np.diff(tension[205:]))) < 0.7
