"""Channels that were sampled at times of their own, brought to one clock.

The drive needs both angles and both torques at the same instants. These are those of
the slowest of the four: its readings stay as they are, and the others, which are
denser, are read between neighbours. On the faster clock most samples of the slow
channel would be inventions, which look like many readings without noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._trials import FloatArray
from cc_mujoco.errors import CableError

# Complete rows, over the rows of the rarest channel, of one topic.
_SAME_TOPIC_SHARE = 0.5
_MIN_RATE_RATIO = 0.5  # rate of a further channel over that of the drive, to be of use


class Stream(NamedTuple):
    """Readings of a channel at their times.

    Attributes:
        time: (rows,) [s].
        values: (rows,) in the channel's unit.
        path: the file.
    """

    time: FloatArray
    values: FloatArray
    path: Path

    @property
    def interval(self) -> float:
        """Usual time between readings [s], infinite if there are none."""
        change = np.diff(np.sort(self.time[np.isfinite(self.time)]))
        change = change[change > 0.0]
        return float(np.median(change)) if len(change) else np.inf

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s], NaN if there is none."""
        known = self.time[np.isfinite(self.time)]
        return (float(known.min()), float(known.max())) if len(known) else (np.nan,) * 2


class Joined(NamedTuple):
    """Channels on one clock, or with the times of their own.

    Attributes:
        leader: the channel whose times are those of the trial.
        time: (rows,) [s], its times within what all of the drive share.
        values: by channel; (rows,) those of the leader's rows, else as recorded.
        clocks: [s], times of the channels that are not in the leader's rows.
        remarks: a sentence each on what was done.
    """

    leader: str
    time: FloatArray
    values: dict[str, FloatArray]
    clocks: dict[str, FloatArray]
    remarks: list[str]


def topic_rows(
    values: Mapping[str, FloatArray],
) -> dict[str, NDArray[np.bool_]]:
    """Return the rows of each channel, if a row belongs to one topic.

    That is so if few rows hold all channels of the drive, or one of them is in every
    second row at most; elsewhere a blank cell (NaN) is a missing reading. Returns masks
    (rows,) by channel, {} if the rows are not those of topics.
    """
    filled = {channel: ~np.isnan(value) for channel, value in values.items()}
    drive = [filled[channel] for channel in channels.MAIN_CHANNELS if channel in filled]
    fewest = min((int(np.count_nonzero(mask)) for mask in drive), default=0)
    if fewest < 2:
        return {}
    complete = int(np.count_nonzero(np.logical_and.reduce(drive)))
    if complete == len(drive[0]):
        return {}
    spacing = [float(np.median(np.diff(np.flatnonzero(mask)))) for mask in drive]
    return (
        filled if complete < _SAME_TOPIC_SHARE * fewest or max(spacing) >= 2.0 else {}
    )


def merge_streams(where: str, streams: Mapping[str, Stream]) -> Joined:
    """Return the channels of several clocks on that of the slowest of the drive."""
    drive = {c: streams[c] for c in channels.MAIN_CHANNELS if c in streams}
    leader = max(drive, key=lambda channel: drive[channel].interval)
    own = drive[leader]
    first = max(drive, key=lambda channel: drive[channel].span[0])
    last = min(drive, key=lambda channel: drive[channel].span[1])
    start, stop = drive[first].span[0], drive[last].span[1]
    if not start < stop:
        raise CableError(
            f"{where}: {first} begins at {start:.12g} s ({drive[first].path}) and "
            f"{last} ends at {stop:.12g} s ({drive[last].path}); they share no time: "
            "give the offset between their clocks."
        )
    rows = ~((own.time < start) | (own.time > stop))
    remarks = [_rate_sentence(where, leader, drive)]
    before = min(stream.span[0] for stream in drive.values())
    after = max(stream.span[1] for stream in drive.values())
    cut = (start - before) + (after - stop)
    if cut > max(stream.interval for stream in drive.values()):
        remarks.append(
            f"{where}: only {start:.6g} to {stop:.6g} s, which all channels of the "
            f"drive cover, count; {cut:.3g} s do not."
        )
    values, clocks = {}, {}
    for channel, stream in streams.items():
        if (
            channel not in (*drive, channels.TEMPERATURE, channels.VALID)
            and own.interval < _MIN_RATE_RATIO * stream.interval
        ):
            remarks.append(
                f"{where}: {channel} has {1 / stream.interval:.3g} readings per "
                f"second, less than half of the {1 / own.interval:.4g} of {leader}, "
                "and is left out."
            )
        elif np.array_equal(stream.time, own.time, equal_nan=True):
            values[channel] = stream.values[rows]
        else:
            values[channel], clocks[channel] = stream.values, stream.time
    return Joined(leader, own.time[rows], values, clocks, remarks)


def _rate_sentence(where: str, leader: str, drive: Mapping[str, Stream]) -> str:
    """Return the sentence that names the clock of the channels."""
    rates = ", ".join(
        f"{channel} {1 / stream.interval:.4g}" for channel, stream in drive.items()
    )
    return (
        f"{where}: channels have times of their own (per second: {rates}); all are "
        f"read at those of {leader}, the slowest, between neighbours."
    )
