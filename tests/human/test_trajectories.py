"""Every trajectory keeps the promises of `cc_mujoco.human._motion`."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco.errors import CableError
from cc_mujoco.human import (
    TRAJECTORIES,
    Chirp,
    Motion,
    Multisine,
    Ramp,
    Reach,
    Reversals,
    Scripted,
    Sine,
    Sweep,
    Trajectory,
    Walk,
    trajectory,
)

NAMES = "sweep ramp sine chirp multisine reach reversals walk".split()


def sample(recipe: Trajectory, duration: float = 20.0, dt: float = 1e-3) -> Motion:
    return recipe.sample(duration, dt, np.random.default_rng(7))


def check_consistent(motion: Motion) -> None:
    """Check that angle and velocity are integrals of velocity and acceleration."""
    dt = motion.time[1]
    for value, slope in (
        (motion.angle, motion.velocity),
        (motion.velocity, motion.acceleration),
    ):
        step = np.diff(value) / dt
        mean = (slope[1:] + slope[:-1]) / 2
        # The trapezoid is wrong by at most the change of the slope within a step; a
        # wrong factor or sign anywhere is wrong by the slope itself.
        change = np.abs(np.diff(slope)).max()
        assert np.abs(step - mean).max() <= change + 1e-9
        assert change < 0.2 * np.abs(slope).max()
        assert np.sqrt(np.mean((step - mean) ** 2)) < 1e-2 * np.sqrt(np.mean(slope**2))


def check_promises(recipe: Scripted, motion: Motion) -> None:
    for values in (motion.time, motion.angle, motion.velocity, motion.acceleration):
        assert values.shape == motion.time.shape
        assert np.isfinite(values).all()
    start = motion.angle[0]
    assert motion.velocity[0] == motion.acceleration[0] == 0
    assert start == 0 or isinstance(recipe, Walk)
    assert np.abs(motion.angle).max() <= recipe.amplitude * (1 + 1e-12)
    assert motion.phase.min() >= 0 and motion.phase.max() < 1


def test_registry_names() -> None:
    assert list(TRAJECTORIES) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_promises(name: str) -> None:
    motion = sample(TRAJECTORIES[name])
    assert motion.time.size == 20_001
    assert motion.time[-1] == 20.0
    check_promises(TRAJECTORIES[name], motion)
    check_consistent(motion)


@pytest.mark.parametrize("name", NAMES)
def test_deterministic_and_random(name: str) -> None:
    recipe = TRAJECTORIES[name]
    first, again = sample(recipe), sample(recipe)
    other = recipe.sample(20.0, 1e-3, np.random.default_rng(8))
    for column in ("time", "angle", "velocity", "acceleration", "phase"):
        assert np.array_equal(getattr(first, column), getattr(again, column))
    differs = not np.array_equal(first.angle, other.angle)
    assert differs == (name in {"multisine", "reach", "reversals"})


@pytest.mark.parametrize("name", NAMES)
def test_time_step_samples_the_same_motion(name: str) -> None:
    fine, coarse = sample(TRAJECTORIES[name]), sample(TRAJECTORIES[name], dt=4e-3)
    np.testing.assert_allclose(fine.angle[::4], coarse.angle, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_limit_scales_down_and_never_up(name: str) -> None:
    assert np.abs(sample(trajectory(name, limit=0.2)).angle).max() <= 0.2
    assert trajectory(name, limit=6.0) is TRAJECTORIES[name]


def test_sweep_is_experiment_2() -> None:
    motion = sample(TRAJECTORIES["sweep"])
    degrees = np.rad2deg(motion.angle)
    assert degrees.max() >= 20 and degrees.min() <= -20
    held = (np.abs(degrees) >= 20) & (motion.velocity == 0)
    # Six and a half periods, each with two holds of half a second.
    assert held.mean() == pytest.approx(1 / 3, abs=0.02)
    assert np.all(motion.angle[(motion.time > 1) & (motion.time < 1.5)] == 0.4)
    assert motion.angle[2750] == -0.4


def test_ramp_is_section_4_3_2() -> None:
    motion = sample(TRAJECTORIES["ramp"], duration=30.0)
    assert motion.angle[15_000] == pytest.approx(1.5, abs=1e-12)
    assert motion.angle[-1] == pytest.approx(0, abs=1e-12)
    assert motion.angle.argmax() in range(14_990, 15_010)
    constant = np.abs(motion.velocity - 0.1) < 0.001
    assert constant[motion.time < 15].mean() > 0.98
    back = np.abs(motion.velocity + 0.1) < 0.001
    assert back[motion.time > 15].mean() > 0.98


def test_sine_reaches_its_amplitude_and_frequency() -> None:
    motion = sample(Sine(amplitude=0.5, frequency=0.25, fade=1.0))
    later = motion.time > 1
    expected = 0.5 * np.sin(0.5 * np.pi * motion.time[later])
    np.testing.assert_allclose(motion.angle[later], expected, atol=1e-12)


def test_chirp_sweeps_its_band() -> None:
    motion = sample(Chirp(low=0.5, high=4.0, fade=0.5))
    crossings = motion.time[1:][np.diff(np.sign(motion.angle)) != 0]
    half_periods = np.diff(crossings)
    assert 0.5 / half_periods[0] == pytest.approx(0.5, rel=0.2)
    assert 0.5 / half_periods[-1] == pytest.approx(4.0, rel=0.05)


def test_multisine_lines_and_crest() -> None:
    recipe = Multisine(amplitude=0.5, low=0.2, high=1.0, period=10.0, fade=0.01)
    angle = sample(recipe, duration=20.0).angle[10_000:20_000]
    spectrum = np.abs(np.fft.rfft(angle)) / angle.size
    lines = np.flatnonzero(spectrum > 1e-6)
    assert lines.tolist() == list(range(2, 11))
    np.testing.assert_allclose(spectrum[lines] * lines, spectrum[2] * 2, rtol=1e-6)
    assert 0.99 * 0.5 < np.abs(angle).max() <= 0.5
    one = sample(dataclasses.replace(recipe, draws=1)).angle[10_000:]
    crest = 0.5 / np.sqrt(np.mean(angle**2))
    assert crest < 2.5
    assert crest < np.abs(one).max() / np.sqrt(np.mean(one**2))


def test_multisine_is_the_best_of_its_draws() -> None:
    recipe = Multisine(low=0.2, high=1.0, draws=20, fade=0.01)
    one, lines = dataclasses.replace(recipe, draws=1), 9
    draws = []
    for number in range(recipe.draws):
        random = np.random.default_rng(3)
        random.uniform(size=number * lines)
        draws.append(one.sample(10.0, 0.01, random).angle)
    best = max(draws, key=lambda angle: np.sum(angle**2))
    found = recipe.sample(10.0, 0.01, np.random.default_rng(3)).angle
    assert np.array_equal(found, best)
    assert not np.array_equal(found, draws[0])


def test_reversals_alternate_with_small_and_large_extents() -> None:
    motion = sample(TRAJECTORIES["reversals"], duration=60.0)
    turns = motion.angle[1:-1][np.diff(np.sign(motion.velocity))[:-1] != 0]
    extents = np.abs(np.diff(turns[np.abs(turns) > 0]))
    extents = extents[extents > 1e-3]
    assert extents.size > 40
    assert extents.min() >= 0.05 * 0.6 - 1e-4
    assert extents.max() > 5 * extents.min()


def test_reach_extends_without_changing_its_beginning() -> None:
    short = sample(TRAJECTORIES["reach"], duration=5.0)
    long = sample(TRAJECTORIES["reach"], duration=20.0)
    assert np.array_equal(short.angle, long.angle[: short.angle.size])


amplitudes = st.floats(0.01, 3.0)
spans = st.floats(0.05, 5.0)
recipes = st.one_of(
    st.builds(Sweep, amplitudes, spans, st.floats(0.0, 2.0)),
    st.builds(Ramp, amplitudes, spans, st.just(0.025)),
    st.builds(Sine, amplitudes, st.floats(0.01, 5.0), spans),
    st.builds(
        lambda a, low, ratio, fade: Chirp(a, low, low * ratio, fade),
        amplitudes,
        st.floats(0.01, 1.0),
        st.floats(1.1, 10.0),
        spans,
    ),
    st.builds(
        lambda a, low, fade: Multisine(a, low, low + 1.0, 4.0, 4, fade),
        amplitudes,
        st.floats(0.01, 2.0),
        spans,
    ),
    st.builds(
        lambda a, t, more, dwell: Reach(a, t, t + more, dwell),
        amplitudes,
        spans,
        spans,
        spans,
    ),
    st.builds(
        lambda a, t, more, least: Reversals(a, t, t + more, least),
        amplitudes,
        spans,
        spans,
        st.floats(0.0, 1.0),
    ),
    st.builds(Walk, amplitudes, st.floats(0.5, 3.0), spans),
)


@settings(deadline=None, derandomize=True, max_examples=150)
@given(recipes, st.floats(0.2, 8.0), st.integers(0, 2**32))
def test_promises_for_any_parameters(
    recipe: Scripted, duration: float, seed: int
) -> None:
    dt = 1e-3
    motion = recipe.sample(duration, dt, np.random.default_rng(seed))
    assert motion.time.size == round(duration / dt) + 1
    check_promises(recipe, motion)
    # Midpoint by cubic Hermite interpolation of the ends against the sampled middle.
    middle = (motion.angle[:-2] + motion.angle[2:]) / 2
    middle -= 2 * dt / 8 * (motion.velocity[2:] - motion.velocity[:-2])
    bound = dt**2 * np.abs(np.diff(motion.acceleration)).max(initial=0.0)
    assert np.abs(middle - motion.angle[1:-1]).max() <= bound + 1e-12


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Sweep(amplitude=0), "Sweep.amplitude must be a number in [0.001, 6.2"),
        (lambda: Sine(frequency=float("nan")), "Sine.frequency must be a number in"),
        (lambda: Sweep(hold=-1), "Sweep.hold must be a number in [0, 10000] s, not -1"),
        (lambda: Ramp(leg=1.0, corner=0.6), "Ramp.corner must be a number in [0.001, "),
        (lambda: Reach(fastest=2.0), "Reach.slowest must be at least Reach.fastest ="),
        (lambda: Chirp(low=3.0), "Chirp.high must be above Chirp.low = 3 Hz, not 2 Hz"),
        (lambda: Multisine(low=0.11, high=0.19), "Multisine must have 1 to 1000 lines"),
        (
            lambda: Walk(period=float("inf")),
            "Walk.period must be a number in [0.2, 20] s",
        ),
        (lambda: trajectory("swep"), "unknown trajectory 'swep': did you mean 'sweep'"),
        (lambda: sample(Sweep(), dt=0.0), "dt must be a positive number of seconds"),
        (lambda: sample(Sweep(), float("inf")), "duration must be a positive number"),
        (lambda: sample(Sweep(), 1.0, 2.0), "dt must not exceed the duration of 1 s"),
    ],
)
def test_errors(build: object, message: str) -> None:
    assert callable(build)
    with pytest.raises(CableError) as caught:
        build()
    text = str(caught.value)
    assert text.startswith(message)
    assert text.endswith(".")


KNEE = {"knee": (0.0, 2.0)}


@pytest.mark.parametrize("name", [name for name in NAMES if name != "walk"])
def test_a_centre_moves_the_motion_and_its_start(name: str) -> None:
    centred = sample(trajectory(name, 0.9, 1.0, KNEE))
    assert centred.angle[0] == 1.0 and centred.velocity[0] == 0.0
    assert centred.angle.min() >= 0.1 and centred.angle.max() <= 1.9
    plain = sample(trajectory(name, 0.9))
    assert np.array_equal(centred.velocity, plain.velocity)
    np.testing.assert_allclose(centred.angle - 1.0, plain.angle, atol=1e-15)


@pytest.mark.parametrize("name", NAMES)
def test_a_centre_of_zero_changes_nothing(name: str) -> None:
    joints = {"ankle": (-0.9, 0.6), "knee": (-2.1, 0.15), "hip": (-0.7, 2.0)}
    assert trajectory(name, 6.0, 0.0, joints) is TRAJECTORIES[name]


def test_numbers_change_the_parameters() -> None:
    assert trajectory("sine:0.3") == Sine(amplitude=0.3)
    assert trajectory("sine:frequency=2, fade=0.5") == Sine(frequency=2.0, fade=0.5)
    assert trajectory("multisine:0.2,draws=4") == Multisine(amplitude=0.2, draws=4)


def test_an_amplitude_that_is_given_is_not_reduced() -> None:
    assert trajectory("sine:0.3", limit=0.2) == Sine(amplitude=0.3)
    assert trajectory("sine:frequency=2", limit=0.2) == Sine(0.2, frequency=2.0)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("sien:0.3", "unknown trajectory 'sien': did you mean 'sine'"),
        ("sine:", "'' must be a number, the amplitude of 'sine'"),
        ("sine:0.1,0.2", "'0.2' must be FIELD=NUMBER with FIELD one of amplitude, fre"),
        ("sine:amplitude=1,amplitude=2", "gives 'amplitude' twice"),
        ("sine:frequency=0", "Sine.frequency must be a number"),
        ("multisine:draws=1.5", "'1.5' must be a whole number, the draws of"),
        (3, "must be a name, the path of a table or a Trajectory, not 3"),
    ],
)
def test_wrong_texts_are_one_sentence(given: str, message: str) -> None:
    with pytest.raises(CableError, match=message):
        trajectory(given)


@pytest.mark.parametrize("ends", [(0.0, 2.0), (-0.3, 2.0), (-2.1, 0.15), (-2.0, 0.0)])
def test_a_knee_walks_within_its_range(ends: tuple[float, float]) -> None:
    motion = sample(trajectory("walk", 1.0, 0.0, {"my_knee": ends}))
    assert ends[0] <= motion.angle.min() and motion.angle.max() <= ends[1]
    measured = sample(Walk()).companions["knee"]
    sign = 1.0 if ends[0] < -1.0 else -1.0
    assert np.array_equal(motion.velocity, sign * measured.velocity)
    assert np.ptp(motion.angle - sign * measured.angle) < 1e-12
    assert np.array_equal(motion.phase, measured.phase)
    check_consistent(motion)


def test_the_other_leg_is_half_a_cycle_later() -> None:
    free = (-np.inf, np.inf)
    names = ("knee_r", "hip_flexion_r", "knee_l", "hip_flexion_l", "hip_adduction_l")
    walk = trajectory("walk", 1.0, 0.0, dict.fromkeys((*names, "toe"), free))
    motion = sample(walk)
    assert tuple(motion.companions) == names[:4]
    right, left = motion.companions["knee_r"], motion.companions["knee_l"]
    assert np.array_equal(motion.angle, right.angle)
    difference = np.mod(left.phase - right.phase, 1.0)
    np.testing.assert_allclose(difference, 0.5, atol=1e-12)
    assert left.velocity[0] == right.velocity[0] == 0.0
    check_consistent(left)
    assert isinstance(walk, Walk)
    assert walk.describe() == (
        "the walk moves knee_r (as knee), hip_flexion_r (as hip), knee_l (as knee, "
        "half a cycle later), hip_flexion_l (as hip, half a cycle later)"
    )


def test_a_walk_needs_the_driven_joint() -> None:
    with pytest.raises(CableError, match="drives the joint 'wrist'; choose another"):
        trajectory("walk", joints={"wrist": (-1.0, 1.0)})


MODULE = """
import numpy as np
from dataclasses import dataclass
from cc_mujoco.human import Motion, Sine, Trajectory

class Still(Trajectory):
    def _motion(self, time, duration, rng):
        still = 0.0 * time
        return Motion(time, still, still, still, still)

class Broken(Trajectory):
    def _motion(self, time, duration, rng):
        return 1 / 0

class Short(Trajectory):
    def _motion(self, time, duration, rng):
        return Motion(time, time[:2], time, time, time)

slow = Sine(frequency=0.2)
number = 3
"""


def test_trajectories_of_the_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my_motions.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "my_motions", raising=False)
    assert trajectory("my_motions:slow") == Sine(frequency=0.2)
    assert not sample(trajectory("my_motions:Still")).angle.any()
    with pytest.raises(
        CableError,
        match=r"'my_motions:Broken' raised ZeroDivisionError in .*my_motions\.py, line",
    ):
        sample(trajectory("my_motions:Broken"))
    with pytest.raises(CableError, match="`angle` must be 20001 finite numbers"):
        sample(trajectory("my_motions:Short"))
    with pytest.raises(CableError, match="must be a Trajectory, or a function"):
        trajectory("my_motions:number")
    with pytest.raises(CableError, match="has no object 'nothing'"):
        trajectory("my_motions:nothing")
