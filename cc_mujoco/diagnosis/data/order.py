"""Rows in the order of their times, as a recording must have them before it is cut.

Rows that a logger wrote late or a database returned in any order are sorted. Where time
goes back and is covered twice, two recordings were joined or a clock was set, and no
order is right.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis.data.channels import TIME
from cc_mujoco.diagnosis.data.findings import DataFinding, error, warning
from cc_mujoco.diagnosis.data.reading import Recording
from cc_mujoco.diagnosis.data.trials import FloatArray

MANY_MISSING = 0.3
_MANY_DUPLICATES = 0.01
_RUN = 20  # rows in order that are a recording of their own
_TWICE = 1.5  # rows over those that a clock has time for


def in_order(recording: Recording) -> tuple[Recording | None, list[DataFinding]]:
    """Bring the rows of every clock of a recording into order.

    Returns:
        The recording, None if its times cannot be trusted, and what was noticed. Rows
        without a time or with that of another are left out.
    """
    rows, findings = _order(recording, TIME, recording.values[TIME])
    if rows is None:
        return None, findings
    values, clocks = {}, {}
    for channel, value in recording.values.items():
        clock = recording.clocks.get(channel)
        if clock is None:
            values[channel] = value[rows]
            continue
        own, found = _order(recording, channel, clock)
        findings += found
        if own is None:
            return None, findings
        values[channel], clocks[channel] = value[own], clock[own]
    return replace(recording, values=values, clocks=clocks), findings


def _order(
    recording: Recording, channel: str, time: FloatArray
) -> tuple[NDArray[np.intp] | slice | None, list[DataFinding]]:
    """Rows of a clock by increasing time, or None where it cannot be trusted."""
    if (np.diff(time) > 0).all() and np.isfinite(time).all():
        return slice(None), []
    name, where = recording.name, recording.column(channel)
    if channel != TIME:
        where += ", its clock"
    findings: list[DataFinding] = []
    rows = np.flatnonzero(~np.isnan(time))
    if lost := len(time) - len(rows):
        if lost > MANY_MISSING * len(time) or len(rows) < 2:
            told = f"{where} lacks {lost} of {len(time)} times; every row needs one."
            return None, [error(told, name, channel)]
        told = f"{where} lacks {lost} times; their rows are left out."
        findings.append(warning(told, name, channel))
    back = np.flatnonzero(np.diff(time[rows]) < 0)
    if len(back):
        k = back[0]
        told = (
            f"{where} goes back from {time[rows[k]]:.6g} to {time[rows[k + 1]]:.6g} s "
            f"at row {rows[k + 1] + 1}"
            f"{f', and {len(back) - 1} more times' if len(back) > 1 else ''}"
        )
        if _twice(time[rows], back):
            told += (
                "; time must increase, so split recordings that were joined and bring "
                "channels to one clock."
            )
            return None, [*findings, error(told, name, channel)]
        told += "; the rows were put in the order of their times."
        findings.append(warning(told, name, channel))
        rows = rows[np.argsort(time[rows], kind="stable")]
    kept = np.diff(time[rows], prepend=-np.inf) > 0
    same = len(rows) - int(np.count_nonzero(kept))
    if same and same == len(rows) - 1:
        told = f"{where} is {time[rows[0]]:.6g} s in every row; time must increase."
        return None, [*findings, error(told, name, channel)]
    if same and channel == TIME:  # a slower sensor's stamp may stand in several rows
        first = rows[np.flatnonzero(~kept)[0]] + 1
        told = (
            f"{where} repeats the time of another row in {same} rows, the first of "
            f"them row {first}"
        )
        if same > _MANY_DUPLICATES * len(rows):
            advice = "write times with more digits, or the clock is too coarse."
            findings.append(error(f"{told}; {advice}", name, channel))
        else:
            advice = "the first of each is used."
            findings.append(warning(f"{told}; {advice}", name, channel))
    rows = rows[kept]
    return (slice(None) if len(rows) == len(time) and not len(back) else rows), findings


def _twice(time: FloatArray, back: NDArray[np.intp]) -> bool:
    """Return whether two runs of rows in order cover the same time.

    Args:
        time: (rows,) [s].
        back: rows after which time goes back.
    """
    edges = np.concatenate([[0], back + 1, [len(time)]])
    runs = [time[a:b] for a, b in itertools.pairwise(edges) if b - a >= _RUN]
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
        room = (stop - start) / step + 1.0
        if there > _TWICE * room and there - room >= 2.0:
            return True
    return False
