"""Metrics of tests in which the joint is held: a slow swing, and a chirp."""

from __future__ import annotations

import math

import numpy as np

from cc_mujoco.metrics._metric import Array, Key, LogLike
from cc_mujoco.metrics._signals import loop_width

SWING_PERIODS = 2
"""Periods of the slow swing; the last but a quarter is measured, trough to trough."""
CHIRP_LOW, CHIRP_HIGH = 0.5, 60.0  # range of the chirp [Hz]
MIN_GAIN = 0.05  # joint torque per desired torque; below it nothing arrives


def held_backlash(log: LogLike) -> float:
    """Return the width of the last loop of the swing at half its height [rad].

    Against twist, motor angle times ratio minus joint angle. A cable that only pulls
    has no loop about zero, so the loop is taken about its middle.
    """
    ratio = log.metadata[Key.RATIO]
    swing = (log["time_s"].size - 1) / SWING_PERIODS
    # From trough to trough, so that both crossings of the middle lie inside.
    last = slice(
        round((SWING_PERIODS - 1.25) * swing), round((SWING_PERIODS - 0.25) * swing) + 1
    )
    torque, desired = log["joint_torque_nm"][last], log["desired_torque_nm"][last]
    if not np.ptp(torque) >= MIN_GAIN * np.ptp(desired):
        return math.nan
    twist = ratio * log["motor_angle_rad"][last] - log["joint_angle_rad"][last]
    middle = 0.5 * (torque.max() + torque.min())
    return loop_width(twist, torque - middle)


def bandwidth(log: LogLike) -> float:
    """Return the frequency at which the response has fallen 3 dB below its lowest [Hz].

    It lies, on a logarithmic scale, between the centres of bands. It is `CHIRP_HIGH` if
    the response stays above, and 0 if its lowest band is below `MIN_GAIN`.
    """
    centre, gain = torque_response(log)
    if np.isnan(gain[0]):
        return math.nan
    if gain[0] < MIN_GAIN:
        return 0.0
    below = np.flatnonzero(gain < gain[0] / math.sqrt(2.0))
    if below.size == 0:
        return CHIRP_HIGH
    k = int(below[0])
    share = (gain[k - 1] - gain[0] / math.sqrt(2.0)) / (gain[k - 1] - gain[k])
    return float(centre[k - 1] * (centre[k] / centre[k - 1]) ** share)


def torque_response(log: LogLike) -> tuple[Array, Array]:
    """Return centres of bands [Hz], and joint torque per desired torque in each.

    The response is the cross spectrum of the two torques over the power spectrum of the
    desired one, each summed over bands of a sixth of an octave, of which the lowest is
    an octave; NaN where the samples are too rare for `CHIRP_HIGH`.
    """
    desired, actual = log["desired_torque_nm"], log["joint_torque_nm"]
    wanted = np.fft.rfft(desired - desired.mean())
    found = np.fft.rfft(actual - actual.mean())
    frequency = np.fft.rfftfreq(desired.size, float(log["time_s"][1]))
    octaves = math.log2(CHIRP_HIGH / CHIRP_LOW)
    # The lowest lines are few, so the lowest band is an octave.
    upper = np.arange(1.0, octaves + 1e-9, 1.0 / 6)  # six in an octave
    edges = CHIRP_LOW * 2.0 ** np.concatenate([[0.0], upper])
    if not frequency[-1] > edges[-1]:
        return np.sqrt(edges[1:] * edges[:-1]), np.full(upper.size, np.nan)
    places = np.searchsorted(frequency, edges)
    cross = np.add.reduceat(found * wanted.conj(), places)[:-1]
    power = np.add.reduceat(np.abs(wanted) ** 2, places)[:-1]
    gain = np.abs(cross) / power
    return np.sqrt(edges[1:] * edges[:-1]), gain
