"""Readings that no motion explains are left out, and nothing else is."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._data_findings import DataFinding
from cc_mujoco.datasets._glitches import drop_glitches, leaps
from cc_mujoco.datasets._reading import Recording

TIME = np.arange(2000) / 500.0
TORQUE = channels.JOINT_TORQUE


def recording(**loads: np.ndarray) -> Recording:
    """Return a recording of an angle and torques."""
    values = {
        channels.TIME: TIME,
        channels.MOTOR_ANGLE: np.round(800.0 * np.sin(2.0 * TIME)) / 400.0,
        **loads,
    }
    return Recording("slow", Path("slow.csv"), "", values, {}, {}, list(values))


def swing(seed: int, noise: float = 0.02) -> np.ndarray:
    """Return a torque with friction's steps at reversals, and white noise."""
    random = np.random.default_rng(seed)
    clean = 8.0 * np.sin(3.0 * TIME) + 2.0 * np.sign(np.cos(3.0 * TIME))
    return clean + noise * random.normal(size=TIME.size)


def missing(found: Recording, channel: str = TORQUE) -> list[int]:
    """Return the rows of a channel that are missing."""
    return np.flatnonzero(np.isnan(found.values[channel])).tolist()


def without_glitches(given: Recording) -> tuple[Recording, list[DataFinding]]:
    kept = drop_glitches(given)
    return kept, kept.findings


@given(
    seed=st.integers(0, 2**31),
    row=st.integers(1, TIME.size - 3),
    length=st.sampled_from((1, 2)),
    size=st.floats(3.0, 1e5),
    sign=st.sampled_from((-1.0, 1.0)),
)
def test_a_glitch_is_found_and_nothing_beside_it(seed, row, length, size, sign):
    # Beside a reversal the torque itself moves by 4 N m.
    torque = swing(seed)
    near = np.abs(np.diff(np.sign(np.cos(3.0 * TIME))))[max(row - 12, 0) : row + 13]
    size += 6.0 * bool(near.any())
    torque[row : row + length] += sign * size
    kept, findings = without_glitches(recording(**{TORQUE: torque}))
    assert missing(kept) == list(range(row, row + length))
    (finding,) = findings
    assert f"(row {row + 1})" in finding.statement
    assert finding.severity == "warning"


@given(seed=st.integers(0, 2**31), noise=st.sampled_from((0.0, 1e-4, 0.02, 1.0)))
def test_nothing_is_dropped_where_there_is_no_glitch(seed, noise):
    given_values = recording(**{TORQUE: swing(seed, noise)})
    kept, findings = without_glitches(given_values)
    assert kept is given_values
    assert not findings


def test_a_transient_that_rings_stays():
    ringing = 3.0 * np.exp(-TIME / 0.02) * np.cos(800.0 * TIME)
    kept, findings = without_glitches(recording(**{TORQUE: swing(1) * 0.05 + ringing}))
    assert not findings
    assert not missing(kept)


def test_a_step_stays():
    step = np.where(TIME > 2.0, 50.0, 0.0) + swing(2)
    assert not without_glitches(recording(**{TORQUE: step}))[1]


def test_an_impact_that_both_torques_feel_stays():
    motor, joint = swing(3), swing(4)
    motor[700] += 5.0
    joint[700] += 9.0
    both = {channels.MOTOR_TORQUE: motor, TORQUE: joint}
    assert not without_glitches(recording(**both))[1]


def test_several_glitches_take_one_sentence():
    torque = swing(5)
    torque[[100, 500, 900]] = 1e4
    kept, (finding,) = without_glitches(recording(**{TORQUE: torque}))
    assert missing(kept) == [100, 500, 900]
    assert "and 2 more" in finding.statement
    assert finding.statement.startswith("slow.csv, column joint_torque_nm reads 1e+04")


def test_a_coarse_encoder_may_jump_by_some_digits():
    angle = np.round(4.0 * np.sin(0.2 * TIME)) / 4.0
    angle[300] += 1.0
    values = recording(**{TORQUE: swing(6)})
    values.values[channels.MOTOR_ANGLE] = angle
    assert not missing(without_glitches(values)[0], channels.MOTOR_ANGLE)


def test_an_angle_that_leaps_for_a_reading_is_a_glitch():
    values = recording(**{TORQUE: swing(7)})
    values.values[channels.MOTOR_ANGLE][1234] = -3.0
    kept, (finding,) = without_glitches(values)
    assert missing(kept, channels.MOTOR_ANGLE) == [1234]
    assert "motor_angle_rad reads -3 at 2.468 s" in finding.statement


def test_a_slow_sensor_between_missing_readings_is_left_alone():
    torque = swing(13)
    torque[1::2] = np.nan
    assert not without_glitches(recording(**{TORQUE: torque}))[1]


def test_a_column_that_is_not_compared_is_left_alone():
    values = recording(**{TORQUE: swing(11)})
    values.values[channels.TEMPERATURE] = np.where(TIME == TIME[500], 200.0, 21.0)
    values.values[channels.further("load")] = swing(12) + 1e3 * (TIME == TIME[9])
    assert not without_glitches(values)[1]


@given(
    seed=st.integers(0, 2**31),
    start=st.integers(0, TIME.size - 200),
    length=st.integers(8, TIME.size - 300),
)
def test_a_stretch_without_noise_is_left_out(seed, start, length):
    torque = swing(seed)
    length = min(length, TIME.size - start)
    # An extreme may be clipped, and a torque that leaps at a reversal freezes there.
    assume(torque.min() < torque[start] < torque.max())
    assume(abs(torque[start] - torque[start - 1]) < 1.0 if start else True)
    torque[start + 1 : start + length] = torque[start]
    kept, findings = without_glitches(recording(**{TORQUE: torque}))
    frozen = set(range(start + 1, start + length))
    assert frozen <= set(missing(kept))
    assert len(missing(kept)) <= len(frozen) + 1
    assert f"in {len(frozen)} rows from" in findings[-1].statement


@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_a_torque_at_rest_in_a_simulation_stays(noise):
    random = np.random.default_rng(8)
    torque = np.where(np.cos(3.0 * TIME) > 0.0, 8.0 * np.sin(3.0 * TIME), 8.0)
    torque += noise * random.normal(size=TIME.size) * (torque != 8.0)
    torque[:100] = 1.0
    assert not without_glitches(recording(**{TORQUE: torque}))[1]


def test_coarse_readings_may_repeat():
    torque = np.round(swing(9), 1)
    torque[600:640] = torque[600]
    assert not without_glitches(recording(**{TORQUE: torque}))[1]


def test_a_torque_that_drops_out_to_an_extreme_is_left_out():
    torque = swing(14) + 15.0
    torque[800:815] = 0.0
    kept, (finding,) = without_glitches(recording(**{TORQUE: torque}))
    assert missing(kept) == list(range(800, 815))
    assert "repeats 0 in 15 rows from 1.6 s (row 801) on" in finding.statement


def test_clipped_readings_are_left_out_with_their_time():
    torque = np.minimum(swing(10), 7.0)
    kept, (finding,) = without_glitches(recording(**{TORQUE: torque}))
    flat = np.flatnonzero(torque == 7.0)
    assert set(missing(kept)) <= set(flat.tolist())
    assert len(missing(kept)) > 0.8 * flat.size  # few lone readings reach it
    assert finding.severity == "doubt" and "it is cut off above" in finding.statement
    (start,) = re.findall(r"from ([0-9.]+) s", finding.statement)
    assert torque[np.argmin(np.abs(TIME - float(start)))] == 7.0


def test_few_clipped_readings_of_a_noisy_sensor_are_left_out():
    torque = 0.005 * np.round(swing(10) / 0.005)
    limit = np.sort(torque)[-25]
    kept, (finding,) = without_glitches(
        recording(**{TORQUE: np.minimum(torque, limit)})
    )
    flat = np.flatnonzero(torque >= limit)
    assert missing(kept) == flat.tolist() and "cut off above" in finding.statement


@given(
    seed=st.integers(0, 2**31),
    step=st.sampled_from((0.001, 0.005, 0.02, 0.05)),
    speed=st.sampled_from((0.0, 0.2, 1.0)),
    noise=st.sampled_from((0.01, 0.03)),
)
def test_rounded_readings_at_an_extreme_are_not_clipped(seed, step, speed, noise):
    random = np.random.default_rng(seed)
    torque = 2.0 * np.cos(speed * TIME) + noise * random.normal(size=TIME.size)
    torque = step * np.round(torque / step)
    assume(0 < np.mean(np.diff(torque) == 0.0) < 0.3)
    _, found = without_glitches(recording(**{TORQUE: torque}))
    assert not [each for each in found if "cut off" in each.statement]


@pytest.mark.parametrize("rows", [3, 49])
def test_few_readings_are_left_alone(rows):
    torque = np.zeros(rows)
    torque[rows // 2] = 100.0
    short = Recording(
        "short", Path("s.csv"), "", {channels.TIME: TIME[:rows], TORQUE: torque}, {},
        {}, [],
    )  # fmt: skip
    assert not without_glitches(short)[1]


@given(
    row=st.integers(1, TIME.size - 2),
    size=st.floats(0.4, 5.0),
    sign=st.sampled_from((-1.0, 1.0)),
)
def test_an_encoder_that_slips_leaps(row, size, sign):
    angle = 2.0 * np.sin(2.0 * TIME)
    assert not leaps(angle).size
    angle[row:] += sign * size
    assert leaps(angle).tolist() == [row]


def test_a_motor_that_starts_at_once_does_not_leap():
    assert not leaps(np.maximum(TIME - 2.0, 0.0) * 30.0).size
    assert not leaps(np.abs(np.sin(5.0 * TIME))).size
