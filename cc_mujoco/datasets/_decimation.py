"""Decimation of long trials, so that fits take minutes."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from cc_mujoco.datasets._clock import SampledTrack
from cc_mujoco.datasets._data_findings import DataFinding, warning
from cc_mujoco.datasets._trials import FloatArray

MAX_TRIAL_SAMPLES = 60_000
"""Largest number of samples of a trial: two minutes at `MIN_AVERAGED_RATE`."""
MIN_AVERAGED_RATE = 500.0
"""Lower bound of the sampling rate after averaging [Hz]."""
WINDOW_COUNT = 12
"""Evenly spread stretches that are kept where averaging is not enough."""


def decimate(
    track: SampledTrack, path: str, name: str, most: int = MAX_TRIAL_SAMPLES
) -> tuple[SampledTrack, list[DataFinding]]:
    """Average neighbours, then keep evenly spread stretches, to few samples."""
    before, rate = _sample_count(track), 1.0 / track.step
    if before <= most:
        return track, []
    remarks = []
    block = int(min(-(-before // most), rate // MIN_AVERAGED_RATE))
    if block > 1:
        track = _average_neighbours(track, block)
        remarks.append(
            f"every {block} samples were averaged, to {1.0 / track.step:.5g} Hz"
        )
    if _sample_count(track) > most:
        length = most // WINDOW_COUNT
        track = _even_windows(track, length)
        remarks.append(
            f"{WINDOW_COUNT} evenly spread stretches of {length * track.step:.4g} s "
            "are used"
        )
    sentence = f"{path} has {before} samples at {rate:.5g} Hz; {' and '.join(remarks)}."
    return track, [warning(sentence, name)]


def _sample_count(track: SampledTrack) -> int:
    return sum(part.stop - part.start for part in track.segments)


def _average_neighbours(track: SampledTrack, block: int) -> SampledTrack:
    """Return the means of so many neighbours, never across the end of a segment."""
    counts = [(part.stop - part.start) // block for part in track.segments]

    def means(values: FloatArray) -> FloatArray:
        return np.concatenate(
            [
                values[part.start : part.start + count * block]
                .reshape(count, block)
                .mean(axis=1)
                for part, count in zip(track.segments, counts, strict=True)
            ]
        )

    ends = np.cumsum([0, *counts])
    parts = (slice(int(a), int(b)) for a, b in itertools.pairwise(ends))
    return replace(
        track,
        time=means(track.time),
        values={channel: means(value) for channel, value in track.values.items()},
        segments=tuple(part for part in parts if part.stop > part.start),
        step=track.step * block,
    )


def _even_windows(track: SampledTrack, length: int) -> SampledTrack:
    """Return the first `length` samples of each of `WINDOW_COUNT` equal parts."""
    total = _sample_count(track)
    cuts = np.linspace(0, total, WINDOW_COUNT + 1).astype(int)[:-1]
    rows, parts, passed, kept = [], [], 0, 0
    for part in track.segments:
        count = part.stop - part.start
        for cut in cuts:
            start = max(cut, passed)
            stop = min(cut + length, passed + count)
            if stop > start:
                shift = part.start - passed
                rows.append(np.arange(start + shift, stop + shift))
                parts.append(slice(kept, kept + int(stop - start)))
                kept += int(stop - start)
        passed += count
    index = np.concatenate(rows)
    values = {channel: value[index] for channel, value in track.values.items()}
    return replace(track, time=track.time[index], values=values, segments=tuple(parts))
