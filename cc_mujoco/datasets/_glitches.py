"""Single readings that no motion explains: bits lost on a bus, a sensor that resets.

A least-squares fit would follow one such reading rather than the thousands beside it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._data_findings import DataFinding, warning
from cc_mujoco.datasets._quantization import resolution
from cc_mujoco.datasets._reading import Recording
from cc_mujoco.datasets._trials import FloatArray

_LONGEST = 2
"""Most readings in a row that are one glitch: longer ones may be a pulse."""
_CHANGE_QUANTILE, _CHANGE_RATIO = 0.98, 8.0
"""A glitch leaves the line through its neighbours by so many usual large changes from
one reading to the next. White noise does so once in 10^100 readings."""
_MIN_RANGE_SHARE, _MIN_DIGITS = 0.05, 10.0
"""Least size over the range of nearly all readings, and over their digit."""
_BESIDE, _BESIDE_QUANTILE = 10, 0.7
"""Readings on either side, and the share of their changes, that are calm."""
_COMMON_RATIO = 3.0
"""Usual large changes by which another load moves where both feel a real impact."""
_MIN_READINGS = 50


def drop_glitches(recording: Recording) -> tuple[Recording, list[DataFinding]]:
    """Return a recording whose glitches are missing readings, and what was found.

    Args:
        recording: whose times increase, see `sort_rows`.
    """
    values, findings = dict(recording.values), []
    for channel, readings in recording.values.items():
        if channel in (channels.TIME, channels.VALID):
            continue
        rows = _glitches(readings)
        if channels.kind_of(channel) in _LOADS:
            rows = rows[~_impacts(recording, channel, rows)]
        if not rows.size:
            continue
        kept = readings.copy()
        kept[rows] = np.nan
        values[channel] = kept
        first = int(rows[0])
        time = recording.clocks.get(channel, recording.values[channels.TIME])
        more = f", and {rows.size - 1} more are alike" if rows.size > 1 else ""
        message = (
            f"{recording.column(channel)} reads {readings[first]:.4g} at "
            f"{time[first]:.6g} s (row {first + 1}), between {readings[first - 1]:.4g} "
            f"and {_after(readings, rows):.4g}{more}: no motion does that, so it is "
            "left out as a glitch."
        )
        findings.append(warning(message, recording.name, channel))
    if not findings:
        return recording, []
    return replace(recording, values=values), findings


_LOADS = (channels.TORQUE, channels.FORCE, channels.CURRENT)


def _after(readings: FloatArray, rows: NDArray[np.intp]) -> float:
    """Return the reading after the first glitch."""
    row = int(rows[0]) + 1
    return float(readings[row + 1] if row in rows else readings[row])


def _usual_change(readings: FloatArray) -> float:
    """Return a large change from one reading to the next, as it is usual."""
    change = np.abs(np.diff(readings))
    return float(np.nanquantile(change, _CHANGE_QUANTILE)) if change.size else 0.0


def _glitches(readings: FloatArray) -> NDArray[np.intp]:
    """Return the rows of glitches."""
    known = readings[np.isfinite(readings)]
    if known.size < _MIN_READINGS:
        return np.empty(0, dtype=np.intp)
    low, high = np.quantile(known, (0.01, 0.99))
    least = max(
        _CHANGE_RATIO * _usual_change(readings), _MIN_RANGE_SHARE * float(high - low)
    )
    found = np.zeros(readings.size, dtype=bool)
    for length in range(1, _LONGEST + 1):
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
    least = max(least, _MIN_DIGITS * resolution(readings))
    return rows[[_is_lone(readings, int(row), least) for row in rows]]


def _is_lone(readings: FloatArray, row: int, least: float) -> bool:
    """Return whether readings beside a row are calm; a transient rings on."""
    start = max(row - _BESIDE, 0)
    change = np.abs(np.diff(readings[start : row + _BESIDE + 1]))
    usual = float(np.nanquantile(change, _BESIDE_QUANTILE))
    beside = np.delete(readings[start : row + _BESIDE + 1], row - start)
    off = abs(float(readings[row]) - float(np.nanmedian(beside)))
    return off > max(least, _CHANGE_RATIO * usual)


def _impacts(
    recording: Recording, channel: str, rows: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Return which rows of a load are a real impact: another load feels it, too."""
    felt = np.zeros(rows.size, dtype=bool)
    if channel in recording.clocks or not rows.size:
        return felt
    for other, readings in recording.values.items():
        same = other != channel and other not in recording.clocks
        if not same or other in (channels.TIME, channels.VALID):
            continue
        if channels.kind_of(other) not in _LOADS:
            continue
        moved = np.abs(readings[rows] - readings[rows - 1])
        felt |= moved > _COMMON_RATIO * max(_usual_change(readings), 1e-300)
    return felt
