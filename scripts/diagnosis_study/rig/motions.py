"""Motions asked of the motor and of the environment.

Every function returns angles [rad] at 1 kHz over `DURATION`. Corners are rounded over
20 ms, as the motion profile of any drive does.
"""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Array = NDArray[np.float64]

RATE = 1000
LEAD = 0.6
"""Unrecorded time before each trial [s], in which the drive approaches its start."""
DURATION = 8.0  # recorded length of a trial [s]

TIME: Array = np.arange(int(RATE * DURATION) + 1) / RATE


def rounded(path: Array, width: float = 0.02) -> Array:
    """Return the path with its corners rounded over `width` seconds."""
    size = int(width * RATE) // 2 * 2 + 1
    window = np.hanning(size + 2)[1:-1]
    padded = np.pad(path, size // 2, mode="edge")
    return np.convolve(padded, window / window.sum(), mode="valid")


def via(times: Array, angles: Array) -> Array:
    """Return straight lines through points, with rounded corners."""
    return rounded(np.interp(TIME, times, angles))


def speed_ladder(speeds: Array, reach: float) -> Array:
    """Return constant speeds to and fro, as many as time allows.

    Each rung lasts equally long; slow ones turn short of `reach`.
    """
    rung = DURATION / len(speeds)
    angle = np.zeros_like(TIME)
    for k, speed in enumerate(speeds):
        inside = TIME >= k * rung
        # A triangle that starts and, as rungs hold whole periods, ends at zero.
        periods = max(1, round(rung * speed / (4 * reach)))
        height = min(reach, speed * rung / (4 * periods))
        phase = (TIME[inside] - k * rung) / rung * periods
        triangle = 1 - 4 * np.abs((phase + 0.25) % 1 - 0.5)
        angle[inside] = height * triangle
    return rounded(angle)


def multisine(rng: Generator, low: float, high: float, rms: float) -> Array:
    """Return a multisine of random phases at multiples of 1/8 Hz, limited in speed.

    Amplitudes fall as 1 / frequency, so that every line adds the same speed.
    """
    lines = np.unique(np.round(np.geomspace(low, high, 9) * DURATION)) / DURATION
    phases = rng.uniform(0, 2 * np.pi, lines.size)
    wave = np.sin(2 * np.pi * np.outer(TIME, lines) + phases) / lines
    path = wave.sum(axis=1)
    return np.asarray(path * rms / np.std(path))


def minimum_jerk(rng: Generator, reach: float, dwells: Array) -> Array:
    """Return minimum-jerk moves within `reach` [rad] with a rest [s] after each."""
    moves = len(dwells)
    weights = rng.uniform(0.7, 1.3, moves)
    lengths = weights / weights.sum() * (DURATION - float(np.sum(dwells)))
    ends = reach * rng.uniform(0.4, 1.0, moves) * np.where(np.arange(moves) % 2, -1, 1)
    angle = np.zeros_like(TIME)
    start, clock = 0.0, 0.0
    for length, end, dwell in zip(lengths, ends, dwells, strict=True):
        s = np.clip((TIME - clock) / length, 0, 1)
        share = s**3 * (10 - 15 * s + 6 * s**2)
        angle = np.where(clock <= TIME, start + (end - start) * share, angle)
        start, clock = end, clock + length + dwell
    return angle


def chirp(low: float, high: float, reach: float) -> Array:
    """Return a sine of rising frequency and constant peak speed."""
    growth = np.log(high / low) / DURATION
    phase = 2 * np.pi * low * (np.exp(growth * TIME) - 1) / growth
    return np.asarray(reach * np.exp(-0.75 * growth * TIME) * np.sin(phase))


def micro_reversals(rng: Generator, reach: float, speed: float) -> Array:
    """Return a slow triangle, each flank broken by backward steps of many sizes."""
    times, angles, direction = [0.0], [0.0], 1.0
    sizes = np.geomspace(0.004, 0.12, 12)
    rng.shuffle(sizes)
    k = 0
    while times[-1] < DURATION:
        for change in (0.28 * reach, -sizes[k % sizes.size]):
            angles.append(angles[-1] + direction * change)
            times.append(times[-1] + abs(change) / speed)
        if abs(angles[-1]) > reach:
            direction = -np.sign(angles[-1])
        k += 1
    return via(np.array(times), np.array(angles))
