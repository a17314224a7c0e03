"""Uneven times: what is read does not depend on order, zero or jitter of the clock."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco.datasets import TrialFacts
from cc_mujoco.datasets._channels import MAIN_CHANNELS, TIME
from cc_mujoco.datasets._clock import SampledTrack, find_segments, sort_rows
from cc_mujoco.datasets._data_findings import DataFinding, errors
from cc_mujoco.datasets._dataset_file import DatasetFile
from cc_mujoco.datasets._reading import Recording
from cc_mujoco.datasets._trials import FloatArray

STEP = 2.0**-9  # so that times and what is added to them are exact
SPEED = 9.0  # of the signal [rad/s]


def recorded(time: FloatArray, values: FloatArray | None = None) -> Recording:
    values = np.sin(SPEED * time) if values is None else values
    return Recording(
        name="run",
        path=Path("run.csv"),
        sha256="",
        values={TIME: time}
        | {name: values + k for k, name in enumerate(MAIN_CHANNELS)},
        clocks={},
        labels={},
        names=[TIME, *MAIN_CHANNELS],
    )


def read_out(recording: Recording) -> tuple[SampledTrack | None, list[DataFinding]]:
    ordered = sort_rows(recording)
    if ordered is None:
        return None, recording.findings
    return find_segments(ordered, TrialFacts(), DatasetFile()), recording.findings


def jittered(seed: int, jitter: float, rows: int = 400) -> FloatArray:
    """Return the times of a clock that is uneven by up to a fraction of its step."""
    rng = np.random.default_rng(seed)
    off = rng.uniform(-jitter, jitter, rows)
    return np.round((np.arange(rows) + off) * 1024.0) / 1024.0 * STEP


def told(findings: list[DataFinding]) -> str:
    return " ".join(finding.statement for finding in findings)


SEEDS = st.integers(0, 10**6)


@settings(max_examples=10)
@given(seed=SEEDS, jitter=st.floats(0.0, 0.5))
def test_a_smooth_signal_is_read_back_to_within_the_chord(
    seed: int, jitter: float
) -> None:
    time = jittered(seed, jitter)
    track, findings = read_out(recorded(time))
    assert track is not None and errors(findings) == []
    assert track.segments == (slice(0, 400),)
    even = np.arange(400) * track.step + track.time[0]
    off = float(np.abs(track.time - even).max())
    chord = SPEED**2 * float(np.diff(time).max()) ** 2 / 8.0
    for k, name in enumerate(MAIN_CHANNELS):
        missed = np.abs(track.values[name] - np.sin(SPEED * track.time) - k)
        assert missed.max() <= chord + 1e-12
    assert off <= 0.1 * track.step


@settings(max_examples=15)
@given(
    seed=SEEDS,
    jitter=st.sampled_from((0.0, 0.3)),
    shift=st.integers(-(2**20), 2**30),
    mix=st.sampled_from(("all", "halves", "late")),
    gap=st.booleans(),
)
def test_order_of_rows_and_zero_of_time_change_nothing(
    seed: int, jitter: float, shift: int, mix: str, gap: bool
) -> None:
    time = jittered(seed, jitter)
    if gap:
        time[150:] += 0.25
    expected, _ = read_out(recorded(time))
    rng = np.random.default_rng(seed)
    rows = np.arange(len(time))
    if mix == "all":
        rng.shuffle(rows)
    elif mix == "halves":
        rows = np.roll(rows, 200)
    else:  # single rows written up to five rows late
        for k in rng.integers(0, 390, 3):
            rows[k : k + 6] = np.roll(rows[k : k + 6], -1)
    found, findings = read_out(
        recorded((time + shift)[rows], np.sin(SPEED * time)[rows])
    )
    assert expected is not None and found is not None and errors(findings) == []
    said = [f for f in findings if "put in the order of their times" in f.statement]
    assert [f.severity for f in said] == ["warning" if mix == "late" else "doubt"]
    assert found.segments == expected.segments
    assert found.step == pytest.approx(expected.step, rel=1e-9)
    assert found.time - shift == pytest.approx(expected.time, abs=1e-6)
    for name in MAIN_CHANNELS:
        assert found.values[name] == pytest.approx(expected.values[name], abs=1e-5)


@pytest.mark.parametrize("late", [0, 10])
def test_time_that_runs_backwards_is_refused(late: int) -> None:
    """Rows in reverse and a clock that counts down look the same."""
    time = np.arange(400)[::-1] * STEP
    time[100 : 100 + late] = time[100 : 100 + late][::-1]
    track, findings = read_out(recorded(time))
    assert track is None
    assert "s at row 2, and" in told(errors(findings))
    assert "time runs backwards; reverse the rows" in told(errors(findings))


@settings(max_examples=8)
@given(seed=SEEDS, jitter=st.floats(0.0, 0.3), first=st.integers(30, 370))
def test_a_gap_splits_and_nothing_is_read_across_it(
    seed: int, jitter: float, first: int
) -> None:
    time = jittered(seed, jitter)
    time[first:] += 10 * STEP
    track, findings = read_out(recorded(time))
    assert track is not None and "has a gap of" in told(findings)
    for part in track.segments:
        inside = track.time[part]
        home = time[:first] if inside[0] < time[first - 1] else time[first:]
        assert home[0] <= inside[0] and inside[-1] <= home[-1] + 1e-9


@settings(max_examples=8)
@given(seed=SEEDS, overlap=st.integers(30, 350), off=st.floats(0.0, 0.9))
def test_recordings_that_were_joined_are_not_sorted(
    seed: int, overlap: int, off: float
) -> None:
    """Neither one that begins anew nor a clock that was set back."""
    time = jittered(seed, 0.2, 800)
    time[400:] -= (overlap + off) * STEP
    track, findings = read_out(recorded(time))
    assert track is None
    assert "at row 401; time must increase, so split" in told(findings)


@pytest.mark.parametrize("row", [1, 200, 398])
def test_rows_are_named_as_they_stand_in_the_file(row: int) -> None:
    time = np.arange(400) * STEP
    time[row] = time[row - 1]
    _, findings = read_out(recorded(time))
    assert f"in 1 rows, the first of them row {row + 1}" in told(findings)
    # A time that is missing before does not move the count.
    time = np.arange(400) * STEP
    time[0], time[row + 1] = np.nan, time[row] - STEP / 2
    _, findings = read_out(recorded(time))
    assert f"at row {row + 2}" in told(findings)


def test_readings_in_bunches_are_times_of_arrival() -> None:
    rng = np.random.default_rng(0)
    bunches = np.repeat(np.arange(50) * 8.0, 8) + np.tile(np.arange(8) * 0.01, 50)
    for time in (bunches * STEP, np.sort(rng.uniform(0.0, 0.8, 400))):
        _, findings = read_out(recorded(time))
        assert "not those of arrival" in told(errors(findings))


def test_a_second_clock_out_of_order_is_sorted_or_told() -> None:
    time = np.arange(800) * STEP
    plain = recorded(time)
    rows = np.random.default_rng(0).permutation(800)
    plain.values["joint_angle_rad"] = np.sin(SPEED * time)[rows]
    plain.clocks["joint_angle_rad"] = time[rows]
    track, findings = read_out(plain)
    assert track is not None and errors(findings) == []
    assert track.values["joint_angle_rad"] == pytest.approx(np.sin(SPEED * time))
    plain.clocks["joint_angle_rad"] = np.concatenate([time[:400], time[:400]])
    track, findings = read_out(plain)
    assert track is None and "its clock goes back" in told(errors(findings))


def test_a_stamp_of_a_slower_sensor_may_stand_in_several_rows() -> None:
    time = np.arange(800) * STEP
    plain = recorded(time)
    held = time - np.arange(800) % 2 * STEP
    plain.values["joint_angle_rad"] = np.sin(SPEED * held)
    plain.clocks["joint_angle_rad"] = held
    track, findings = read_out(plain)
    assert track is not None and errors(findings) == []
    (part,) = track.segments
    truth = np.sin(SPEED * track.time[part])
    assert track.values["joint_angle_rad"][part] == pytest.approx(truth, abs=2e-4)
