"""Long trials made short enough for fits that take minutes."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from cc_mujoco.diagnosis.data.clock import SampledTrack
from cc_mujoco.diagnosis.data.findings import DataFinding, warning
from cc_mujoco.diagnosis.data.trials import FloatArray

MOST = 60_000
"""Samples that a trial may keep: two minutes at `ENOUGH`."""
ENOUGH = 500.0
"""Averaging does not bring the rate below this [Hz]."""
WINDOWS = 12
"""Where averaging is not enough, so many stretches are kept, evenly spread."""


def thinned(
    track: SampledTrack, path: str, name: str, most: int = MOST
) -> tuple[SampledTrack, list[DataFinding]]:
    """Average neighbours, then keep evenly spread stretches, until few samples remain.

    Args:
        track: the trial; returned as it is if it has at most `most` samples.
        path: its file, for the sentence.
        name: name of the trial.
        most: samples to keep.
    """
    before, rate = _samples(track), 1.0 / track.step
    if before <= most:
        return track, []
    told = []
    block = int(min(-(-before // most), rate // ENOUGH))
    if block > 1:
        track = _averaged(track, block)
        told.append(
            f"every {block} samples were averaged, to {1.0 / track.step:.5g} Hz"
        )
    if _samples(track) > most:
        length = most // WINDOWS
        track = _windows(track, length)
        told.append(
            f"{WINDOWS} evenly spread stretches of {length * track.step:.4g} s are used"
        )
    sentence = f"{path} has {before} samples at {rate:.5g} Hz; {' and '.join(told)}."
    return track, [warning(sentence, name)]


def _samples(track: SampledTrack) -> int:
    return sum(part.stop - part.start for part in track.segments)


def _averaged(track: SampledTrack, block: int) -> SampledTrack:
    """Means of so many neighbours, never across the end of a segment."""
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


def _windows(track: SampledTrack, length: int) -> SampledTrack:
    """The first `length` samples of each of `WINDOWS` equal shares."""
    total = _samples(track)
    cuts = np.linspace(0, total, WINDOWS + 1).astype(int)[:-1]
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
