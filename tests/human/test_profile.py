"""The assistance profile of four numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.errors import CableError
from cc_mujoco.human import Assist, Profile
from cc_mujoco.human._profile import Profiles

PHASE = np.linspace(0.0, 1.0, 4001)
STILL = np.zeros_like(PHASE)


@st.composite
def profiles(draw: st.DrawFn) -> Profile:
    peak = draw(st.floats(1.0, 65.0))
    onset = draw(st.floats(0.0, peak - 0.2))
    fall = draw(st.floats(0.1, 66.0 - peak))
    return Profile(onset, peak, draw(st.floats(0.0, 60.0)), fall)


def torque(profile: Profile) -> np.ndarray:
    return profile.torque(STILL, STILL, PHASE)


@given(profiles())
def test_a_profile_is_continuous_and_nothing_outside(profile: Profile) -> None:
    found, percent = -torque(profile), 100.0 * PHASE
    outside = (percent <= profile.onset) | (percent >= profile.end)
    assert np.all(found[outside] == 0.0)
    assert np.all(found >= 0.0)
    # A cubic that is level at both ends is steepest in the middle, by 3/2.
    shortest = min(profile.peak_time - profile.onset, profile.fall)
    steepest = 1.5 * profile.peak_torque / shortest
    assert np.abs(np.diff(found)).max() <= steepest * np.diff(percent)[0] * (1 + 1e-9)
    before = percent <= profile.peak_time
    assert np.all(np.diff(found[before]) >= 0.0)
    assert np.all(np.diff(found[~before]) <= 0.0)


@given(profiles())
def test_the_peak_is_when_and_as_large_as_said(profile: Profile) -> None:
    at = profile.torque(0.0, 0.0, profile.peak_time / 100.0)
    assert type(at) is float
    assert at == pytest.approx(-profile.peak_torque)
    assert torque(profile).min() >= -profile.peak_torque


@given(st.lists(profiles(), min_size=1, max_size=5))
def test_together_profiles_have_the_bits_of_each(several: list[Profile]) -> None:
    together = Profiles(several)
    for phase in PHASE[::97]:
        still = np.zeros(len(several))
        found = together.torque(still, still, np.array([phase]))
        each = [profile.torque(0.0, 0.0, float(phase)) for profile in several]
        assert found.tolist() == each
        # As in an environment, where a phase is a NumPy scalar.
        assert each == [profile.torque(0.0, 0.0, phase) for profile in several]


def test_the_default_is_near_the_shape_of_the_assistance() -> None:
    error = torque(Profile()) - Assist().torque(STILL, STILL, PHASE)
    assert np.sqrt(np.mean(error**2)) < 0.02 * Assist().peak


@pytest.mark.parametrize(
    ("numbers", "says"),
    [
        ({"onset": 50.0, "peak_time": 45.0}, "`onset` must be 0.1 % or more before"),
        ({"onset": 53.4}, "`onset` must be 0.1 % or more before `peak_time`"),
        (
            {"fall": 20.0},
            "ends at 73.4 %.*toe-off at 66 %; `fall` must be at most 12.6",
        ),
        ({"peak_time": 80.0}, "`peak_time` must be below 65.9 %"),
        ({"toe_off": 63.0}, "`fall` must be at most 9.6 %"),
        ({"fall": 0.0}, r"Profile.fall must be a number in \[0.1, 100\]"),
        ({"peak_torque": -1.0}, "Profile.peak_torque"),
        ({"onset": float("nan")}, "Profile.onset"),
    ],
)
def test_what_is_no_profile_is_refused(numbers: dict[str, float], says: str) -> None:
    with pytest.raises(CableError, match=says):
        Profile(**numbers)
