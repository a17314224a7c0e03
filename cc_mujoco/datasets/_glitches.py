"""Removal of readings that no motion explains: spikes, frozen and clipped sensors.

Bits are lost on a bus, a sensor resets, a driver repeats its last message. A fit by
least squares would follow a few such readings rather than the thousands beside them.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._data_findings import Severity
from cc_mujoco.datasets._quantization import resolution
from cc_mujoco.datasets._reading import Recording
from cc_mujoco.datasets._trials import FloatArray

_LOADS = channels.TORQUE, channels.FORCE, channels.CURRENT


class _Thresholds(NamedTuple):
    # Height of a spike, by usual large changes from one reading to the next. White
    # noise reaches it once in 10^100 readings.
    change: float = 8.0
    digits: float = 10.0  # and by quantisation steps
    beside: int = 10  # readings on either side that are calm
    calm_quantile: float = 0.7  # of their changes
    readings: int = 50  # fewer tell nothing
    clipped: int = 5  # equal readings at an extreme that are clipped
    repeats_by_chance: float = 1e-4  # probability of as many repeats in shorter runs
    repeat: float = 0.01  # least probability of a repeat
    noise: float = 1e-4  # median third difference of a noisy load, by its range
    counted: int = 100_000  # most readings from which sizes are estimated


_LEAST = _Thresholds()
_FROZEN = "its noise stops there; check the sensor and its driver"


def drop_glitches(recording: Recording, alone: bool = False) -> Recording:
    """Return a recording without glitches, which it reports.

    `alone` is of a single cable, whose torque is 0 while it is slack.
    """
    changed = {}
    for channel, readings in recording.values.items():
        kind = channels.kind_of(channel)
        # A model is compared with these; others would lose a column by a gap.
        if kind not in (channels.ANGLE, *_LOADS):
            continue
        time = recording.clocks.get(channel, recording.values[channels.TIME])
        lone, held = _lone(readings), {}
        if kind in _LOADS and np.isfinite(readings).sum() >= _LEAST.readings:
            lone = lone[~_impacts(recording, channel, lone)]
            held = {_FROZEN: _frozen(readings)} | _clipped(channel, readings, alone)
        held = {why: runs for why, runs in held.items() if runs}
        if not lone.size and not held:
            continue
        kept = changed[channel] = readings.copy()
        if lone.size:
            first, end = int(lone[0]), int(lone[0]) + 1
            end += end in lone
            more = f", and {lone.size - 1} more" if lone.size > 1 else ""
            problem = (
                f" reads {readings[first]:.4g} at {time[first]:.6g} s (row "
                f"{first + 1}), between {readings[first - 1]:.4g} and "
                f"{readings[end]:.4g}{more}: no motion does that, so it is left out as "
                "a glitch."
            )
            recording.report("warning", problem, channel)
            kept[lone] = np.nan
        for why, runs in held.items():
            longest = max(runs, key=lambda rows: rows.stop - rows.start)
            start, count = longest.start, longest.stop - longest.start
            more = f", and {len(runs) - 1} times more" if len(runs) > 1 else ""
            problem = (
                f" repeats {readings[start]:.4g} in {count} rows from "
                f"{time[start]:.6g} s (row {start + 1}) on{more}, left out: {why}."
            )
            severity: Severity = "warning" if why == _FROZEN else "doubt"
            recording.report(severity, problem, channel)
            for rows in runs:
                kept[rows] = np.nan
    if not changed:
        return recording
    return replace(recording, values=recording.values | changed)


def _usual_change(readings: FloatArray) -> float:
    """Return the 98th percentile of the changes between readings; inf without any."""
    change = np.abs(np.diff(readings))[:: max(1, readings.size // _LEAST.counted)]
    change = change[np.isfinite(change)]
    return float(np.quantile(change, 0.98)) if change.size else np.inf


def _least_size(readings: FloatArray) -> float:
    """Return the least height of a spike that is a glitch; inf for few readings."""
    known = readings[:: max(1, readings.size // _LEAST.counted)]
    known = known[np.isfinite(known)]
    if known.size < _LEAST.readings:
        return np.inf
    low, high = np.quantile(known, (0.01, 0.99))
    change = _LEAST.change * _usual_change(readings)
    return max(change, 0.05 * float(high - low))  # range of nearly all readings


def _lone(readings: FloatArray) -> NDArray[np.intp]:
    least = _least_size(readings)
    if np.isinf(least):
        return np.empty(0, dtype=np.intp)
    found = np.zeros(readings.size, dtype=bool)
    for length in (1, 2):  # longer ones may be a pulse
        inside = np.lib.stride_tricks.sliding_window_view(readings[1:-1], length)
        before, after = readings[: len(inside)], readings[length + 1 :]
        above = inside.min(axis=1) - np.maximum(before, after)
        below = np.minimum(before, after) - inside.max(axis=1)
        (starts,) = np.nonzero(np.maximum(above, below) > least)
        for shift in range(1, length + 1):
            found[starts + shift] = True
    rows = np.flatnonzero(found)
    if not rows.size:
        return rows
    least = max(least, _LEAST.digits * resolution(readings))
    return rows[[_is_lone(readings, int(row), least) for row in rows]]


def leaps(readings: FloatArray) -> NDArray[np.intp]:
    """Return the rows at which a channel steps by far more than it usually changes.

    An encoder that slips or is zeroed does that; a joint with inertia does not.
    """
    least = _least_size(readings)
    change = np.abs(np.diff(readings))
    rows = np.flatnonzero(change > least)
    if not rows.size:
        return rows
    least = max(least, _LEAST.digits * resolution(readings))
    return rows[[_is_calm_beside(change, int(row), least) for row in rows]] + 1


def _is_calm_beside(change: FloatArray, row: int, least: float) -> bool:
    start = max(row - _LEAST.beside, 0)
    beside = np.delete(change[start : row + _LEAST.beside + 1], row - start)
    usual = float(np.nanquantile(beside, _LEAST.calm_quantile))
    return float(change[row]) > max(least, _LEAST.change * usual)


def _is_lone(readings: FloatArray, row: int, least: float) -> bool:
    """Return whether the readings beside a spike are calm, unlike after an impact."""
    start = max(row - _LEAST.beside, 0)
    change = np.abs(np.diff(readings[start : row + _LEAST.beside + 1]))
    usual = float(np.nanquantile(change, _LEAST.calm_quantile))
    beside = np.delete(readings[start : row + _LEAST.beside + 1], row - start)
    off = abs(float(readings[row]) - float(np.nanmedian(beside)))
    return off > max(least, _LEAST.change * usual)


def _impacts(
    recording: Recording, channel: str, rows: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Return which spikes (rows,) of a load are impacts, as another load moves too."""
    seen = np.zeros(rows.size, dtype=bool)
    if channel in recording.clocks or not rows.size:
        return seen
    for other, readings in recording.values.items():
        same = other != channel and other not in recording.clocks
        if not same or channels.kind_of(other) not in _LOADS:
            continue
        moved = np.abs(readings[rows] - readings[rows - 1])
        seen |= moved > 3.0 * _usual_change(readings)  # usual large changes
    return seen


def _frozen(readings: FloatArray) -> list[slice]:
    """Return runs of at least seven rows in which a noisy load repeats one reading.

    The first of the equal readings counts as measured unless the load jumped to it.
    Runs at the largest or smallest reading without a jump are clipping, which another
    check reports. Angles are not checked, as a joint may rest.
    """
    same = np.diff(readings) == 0.0
    edges = np.flatnonzero(np.diff(same, prepend=False, append=False)).reshape(-1, 2)
    # Noise does not give eight equal readings.
    runs = edges[edges[:, 1] - edges[:, 0] >= 7]
    if not runs.size:
        return []
    within = int(np.sum(runs[:, 1] - runs[:, 0]))
    usual = (np.count_nonzero(same) - within) / max(same.size - within, 1)
    low, high = np.nanquantile(readings, (0.01, 0.99))
    third = np.abs(np.diff(readings, 3))
    alive = np.ones(third.size, dtype=bool)
    for first, last in runs.tolist():
        alive[first:last] = False
    # Repeats are usual, or so little noise is a state of rest, as in simulations.
    if usual > 0.1 or not alive.any():
        return []
    if np.nanmedian(third[alive]) < _LEAST.noise * (high - low):
        return []
    ends, least = (np.nanmin(readings), np.nanmax(readings)), _least_size(readings)
    found = []
    for first, last in runs.tolist():
        leaps_there = first > 0 and abs(readings[first] - readings[first - 1]) > least
        if leaps_there or readings[first] not in ends:
            found.append(slice(first + (not leaps_there), last + 1))
    return found


def _clipped(channel: str, readings: FloatArray, alone: bool) -> dict[str, list[slice]]:
    """Return runs of a load at its largest and its smallest reading, by the advice."""
    same = np.diff(readings) == 0.0
    ends = {"above": np.nanmax(readings), "below": np.nanmin(readings)}
    # Readings that are clipped on both sides repeat there for the same reason.
    outermost = np.isin(readings, [*ends.values()])
    elsewhere = ~(outermost[1:] & outermost[:-1])
    usual = float(same[elsewhere].mean()) if elsewhere.any() else 1.0
    if usual > 0.1:
        return {}  # coarse readings repeat everywhere
    mend = "use a sensor of wider range"
    if channel == channels.MOTOR_TORQUE:
        mend = f"ask less of the motor if this is its limit, else {mend}"
    # A slack cable, which cannot push, pulls with exactly nothing.
    kind = channels.kind_of(channel)
    slackens = kind == channels.FORCE or (alone and kind == channels.TORQUE)
    found = {}
    for side, extreme in ends.items():
        if slackens and extreme == 0.0:
            continue
        there = np.diff(readings == extreme, prepend=False, append=False)
        edges = np.flatnonzero(there).reshape(-1, 2)
        runs = edges[edges[:, 1] - edges[:, 0] >= _LEAST.clipped]
        if _repeats_despite_noise(readings, edges, usual):
            runs = edges
        elif len(runs) < 2 and (not len(runs) or np.ptp(runs) < 4 * _LEAST.clipped):
            continue
        why = f"it is cut off {side}; {mend}"
        found[why] = [slice(*run) for run in runs.tolist()]
    return found


def _repeats_despite_noise(
    readings: FloatArray, runs: NDArray[np.intp], usual: float
) -> bool:
    """Return whether runs of one reading have more repeats than noise at rest gives.

    Noise is estimated from third differences, which hardly see the motion; `usual` is
    the share of repeats among all other readings.
    """
    from scipy.special import bdtrc

    known = readings[np.isfinite(readings)]
    third = float(np.median(np.abs(np.diff(known, 3))))
    low, high = np.quantile(known, (0.01, 0.99))
    noise = third / (0.6745 * np.sqrt(20.0))
    if third < _LEAST.noise * (high - low) or noise == 0.0:
        return False  # so little noise is a state of rest, as in simulations
    chance = resolution(readings) / (2.0 * np.sqrt(np.pi) * noise)
    count = int(np.sum(runs[:, 1] - runs[:, 0]))
    repeats, chance = count - len(runs), max(chance, usual, _LEAST.repeat)
    if chance >= 1.0 or len(runs) < 3:
        return False
    return bool(bdtrc(repeats - 1, count, chance) < _LEAST.repeats_by_chance)
