"""Rows in the order of their times, as a recording must have them before it is cut.

Rows that a logger wrote late or a database returned in any order are sorted. Where time
goes back and is covered twice, two recordings were joined or a clock was set, and no
order is right. Nor is it known where time runs backwards: the rows may be reversed, or
the clock may count down.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.datasets._channels import TIME
from cc_mujoco.datasets._data_findings import DataFinding, doubt, error, warning
from cc_mujoco.datasets._reading import Recording
from cc_mujoco.datasets._trials import FloatArray

MAX_MISSING_SHARE = 0.3
_MIN_RUN = 20  # rows in order that are a recording of their own


def sort_rows(recording: Recording) -> tuple[Recording | None, list[DataFinding]]:
    """Bring the rows of every clock of a recording into order.

    None if its times cannot be trusted. Rows without a time or with that of another are
    left out.
    """
    rows, findings = _row_order(recording, TIME, recording.values[TIME])
    if rows is None:
        return None, findings
    values, clocks = {}, {}
    for channel, value in recording.values.items():
        clock = recording.clocks.get(channel)
        if clock is None:
            values[channel] = value[rows]
            continue
        own, found = _row_order(recording, channel, clock)
        findings += found
        if own is None:
            return None, findings
        values[channel], clocks[channel] = value[own], clock[own]
    return replace(recording, values=values, clocks=clocks), findings


def _row_order(
    recording: Recording, channel: str, time: FloatArray
) -> tuple[NDArray[np.intp] | slice | None, list[DataFinding]]:
    """Return rows of a clock by increasing time, or None if it is unreliable."""
    if (np.diff(time) > 0).all() and np.isfinite(time).all():
        return slice(None), []
    name, where = recording.name, recording.column(channel)
    if channel != TIME:
        where += ", its clock"
    findings: list[DataFinding] = []
    rows = np.flatnonzero(~np.isnan(time))
    if lost := len(time) - len(rows):
        if lost > MAX_MISSING_SHARE * len(time) or len(rows) < 2:
            message = f"{where} lacks {lost} of {len(time)} times; every row needs one."
            return None, [error(message, name, channel)]
        message = f"{where} lacks {lost} times; their rows are left out."
        findings.append(warning(message, name, channel))
    back = np.flatnonzero(np.diff(time[rows]) < 0)
    if len(back):
        k = back[0]
        message = (
            f"{where} goes back from {time[rows[k]]:.6g} to {time[rows[k + 1]]:.6g} s "
            f"at row {rows[k + 1] + 1}"
            f"{f', and {len(back) - 1} more times' if len(back) > 1 else ''}"
        )
        if _covers_time_twice(time[rows], back):
            message += (
                "; time must increase, so split recordings that were joined and bring "
                "channels to one clock."
            )
            return None, [*findings, error(message, name, channel)]
        if len(back) > 0.9 * (len(rows) - 1):
            message += (
                ": time runs backwards; reverse the rows, or correct the clock if it "
                "counts down."
            )
            return None, [*findings, error(message, name, channel)]
        message += "; the rows were put in the order of their times."
        order = np.argsort(time[rows], kind="stable")
        far = int(np.abs(order - np.arange(len(rows))).max()) >= _MIN_RUN
        findings.append((doubt if far else warning)(message, name, channel))
        rows = rows[order]
    kept = np.diff(time[rows], prepend=-np.inf) > 0
    same = len(rows) - int(np.count_nonzero(kept))
    if same and same == len(rows) - 1:
        message = f"{where} is {time[rows[0]]:.6g} s in every row; time must increase."
        return None, [*findings, error(message, name, channel)]
    if same and channel == TIME:  # a slower sensor's stamp may stand in several rows
        first = rows[np.flatnonzero(~kept)[0]] + 1
        message = (
            f"{where} repeats the time of another row in {same} rows, the first of "
            f"them row {first}"
        )
        if same > 0.01 * len(rows):
            advice = "write times with more digits, or the clock is too coarse."
            findings.append(error(f"{message}; {advice}", name, channel))
        else:
            advice = "the first of each is used."
            findings.append(warning(f"{message}; {advice}", name, channel))
    rows = rows[kept]
    return (slice(None) if len(rows) == len(time) and not len(back) else rows), findings


def _covers_time_twice(time: FloatArray, back: NDArray[np.intp]) -> bool:
    """Return whether two runs of rows in order cover the same time."""
    edges = np.concatenate([[0], back + 1, [len(time)]])
    runs = [time[a:b] for a, b in itertools.pairwise(edges) if b - a >= _MIN_RUN]
    runs.sort(key=lambda run: float(run[0]))
    for before, after in itertools.pairwise(runs):
        start, stop = after[0], min(before[-1], after[-1])
        step = max(float(np.median(np.diff(run))) for run in (before, after))
        if stop < start or step == 0.0:
            continue
        there = sum(
            int(np.searchsorted(run, stop, "right") - np.searchsorted(run, start))
            for run in (before, after)
        )
        capacity = (stop - start) / step + 1.0
        # rows over those that a clock has time for
        if there > 1.5 * capacity and there - capacity >= 2.0:
            return True
    return False
