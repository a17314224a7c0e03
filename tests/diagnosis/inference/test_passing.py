"""The low-pass of all signals against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import butter, filtfilt

from cc_mujoco.diagnosis import low_pass


@given(
    band=st.floats(0.5, 100.0), samples=st.integers(12, 400), seed=st.integers(0, 99)
)
def test_the_low_pass_is_that_of_scipy(band: float, samples: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    signals = 5.0 + np.cumsum(random.standard_normal((2, samples)), axis=1)
    given_to = signals.copy()
    expected = filtfilt(*butter(2, band, fs=250.0), signals)
    assert low_pass(signals, band, 250.0) == pytest.approx(expected, rel=1e-7)
    assert np.array_equal(signals, given_to)


def test_one_signal_passes_as_a_row_of_many_does() -> None:
    signals = np.random.default_rng(0).standard_normal((3, 200))
    rows = low_pass(signals, 25.0, 250.0)
    assert np.array_equal(low_pass(signals[1], 25.0, 250.0), rows[1])


def test_a_band_near_half_the_rate_leaves_signals_alone() -> None:
    signals = np.random.default_rng(0).standard_normal((2, 50))
    assert low_pass(signals, 45.0, 100.0) is signals
