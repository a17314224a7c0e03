"""The time of a recording: from rows as recorded to stretches sampled evenly.

A gap, a missing reading or a masked row ends a stretch; nothing is interpolated across
it. Only where times jitter inside a stretch is it sampled anew, linearly: between times
that are those of the readings, however uneven, the error is that of the chord.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.datasets._channels import (
    ANGLES,
    CLOCK,
    TEMPERATURE,
    TIME,
    VALID,
    is_further,
)
from cc_mujoco.datasets._data_findings import DataFinding, doubt, error, warning
from cc_mujoco.datasets._dataset_file import DatasetFile
from cc_mujoco.datasets._quantization import interpolate_readings, resolution
from cc_mujoco.datasets._reading import Recording
from cc_mujoco.datasets._trials import FloatArray, TrialFacts

MAX_MISSING_SHARE = 0.3
_MIN_RUN = 20  # rows in order that are a recording of their own


def sort_rows(recording: Recording) -> tuple[Recording | None, list[DataFinding]]:
    """Bring the rows of every clock of a recording into order.

    Rows that a logger wrote late or a database returned in any order are sorted. None
    where times cannot be trusted: where time goes back and is covered twice, two
    recordings were joined or a clock was set, and no order is right; where it runs
    backwards, the rows may be reversed, or the clock may count down. Rows without a
    time or with that of another are left out.
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
        # At least half again as many rows as one clock has time for
        if there > 1.5 * capacity and there - capacity >= 2.0:
            return True
    return False


GAP_FACTOR = 3.0
"""An interval longer than this multiple of the usual one is a gap."""
MIN_RATE, LOW_RATE = 25.0, 100.0
"""Rates below which data are of no use, and of limited use [Hz]."""
MIN_SEGMENT_TIME, MIN_SEGMENT_SAMPLES = 0.2, 20
"""Shortest stretch [s], and its least number of samples."""


@dataclass
class SampledTrack:
    """Evenly sampled stretches of a recording."""

    time: FloatArray  # (samples,) [s]
    values: dict[str, FloatArray]  # (samples,) by channel, finite in segments
    segments: tuple[slice, ...]  # stretches in order
    step: float  # time between samples [s]
    # quantisation step of the readings by channel, 0 if they show none
    digits: dict[str, float]


def find_segments(
    recording: Recording, facts: TrialFacts, file: DatasetFile
) -> tuple[SampledTrack | None, list[DataFinding]]:
    """Find the stretches of a recording that can be used, None if there are none.

    Its times must increase (see `sort_rows`).
    """
    name = recording.name
    findings = [warning(message, name) for message in recording.remarks]
    if recording.rows < 2:
        rows = "one row of data" if recording.rows else "no rows of data"
        message = (
            f"{recording.path} has {rows}; a trial needs at least {MIN_SEGMENT_TIME} s."
        )
        return None, [error(message, name)]
    time = recording.values[TIME]
    step = float(np.median(np.diff(time)))
    lasts = float(time[-1] - time[0])
    rate, found = _rate(recording, file, step, lasts)
    findings += found
    digits = {
        channel: resolution(value)
        for channel, value in recording.values.items()
        if channel not in (TIME, VALID)
    }
    values = _on_one_clock(recording, file, digits)
    good, found = _counted_samples(recording, time, values, facts)
    findings += found
    breaks, found = _gaps(recording, time, step)
    findings += found
    segments = _counted_runs(
        good, breaks, max(MIN_SEGMENT_SAMPLES, round(MIN_SEGMENT_TIME * rate))
    )
    if not segments:
        message = f"lasts {lasts:.3g} s; a trial needs at least {MIN_SEGMENT_TIME} s."
        if other := _suggest_time_unit(recording, file, rate, lasts):
            message = (
                f"lasts {lasts:.3g} s with {len(time)} samples, {rate:.3g} per second; "
                f"{other}."
            )
        elif lasts >= MIN_SEGMENT_TIME and len(time) < MIN_SEGMENT_SAMPLES:
            message = (
                f"has {len(time)} samples; "
                f"a trial needs at least {MIN_SEGMENT_SAMPLES}."
            )
        elif lasts >= MIN_SEGMENT_TIME:
            message = (
                f"has no stretch of {MIN_SEGMENT_TIME} s without a gap or a missing "
                "reading; record without interruption."
            )
        findings.append(error(f"{recording.path} {message}", name))
        return None, findings
    values.pop(VALID, None)
    track, found = _resample_evenly(
        recording, SampledTrack(time, values, segments, step, digits)
    )
    return track, findings + found


def _suggest_time_unit(
    recording: Recording, file: DatasetFile, rate: float, lasts: float
) -> str:
    """Return the declaration for times in another unit, or "" if none fits."""
    label = recording.labels.get(TIME, TIME)
    now = CLOCK.factors[file.unit(TIME, label)]
    for unit, factor in CLOCK.factors.items():
        scale = factor / now
        # No rig samples at 5 kHz.
        likely = MIN_RATE < rate / scale < 5e3 and scale * lasts >= MIN_SEGMENT_TIME
        if scale != 1.0 and likely:
            if set(recording.paths.values()) - {recording.path}:
                return f"check the `unit` of its files in [files]; {unit!r} would do"
            return (
                f"declare [columns.{TIME}] unit = {unit!r} if that is what {label} "
                "holds"
            )
    return ""


def _rate(
    recording: Recording, file: DatasetFile, step: float, lasts: float
) -> tuple[float, list[DataFinding]]:
    """Return the sampling rate [Hz], with a finding if it is too low."""
    rate = 1.0 / step
    message = f"{recording.column(TIME)}: {rate:.4g} samples per second"
    if rate < MIN_RATE:
        text = (
            f"{message} are too few to see friction at reversals; record at 200 or more"
        )
        if other := _suggest_time_unit(recording, file, rate, lasts):
            text += f", or {other}"
        return rate, [error(f"{text}.", recording.name, TIME)]
    if rate < LOW_RATE:
        text = f"{message} blur what happens at reversals; 200 or more are better."
        return rate, [warning(text, recording.name, TIME)]
    return rate, []


def _on_one_clock(
    recording: Recording, file: DatasetFile, digits: dict[str, float]
) -> dict[str, FloatArray]:
    """Return values at the common times, interpolated for delays and other clocks."""
    time = recording.values[TIME]
    values = {}
    for channel, value in recording.values.items():
        if channel == TIME:
            continue
        delay = file.source(channel).delay
        clock = recording.clocks.get(channel)
        if clock is not None or delay != 0.0:
            own = time if clock is None else clock
            digit = digits[channel] if channel in ANGLES else 0.0
            value = _interpolate(time + delay, own, value, digit)
        if channel == VALID and clock is not None:  # between 1 and 0 nothing counts
            value = np.where((value > 0.0) & (value < 1.0), 0.0, value)
        values[channel] = value
    return values


def _interpolate(
    wanted: FloatArray, clock: FloatArray, values: FloatArray, digit: float
) -> FloatArray:
    """Return values at other times, NaN outside, in gaps and near missing readings."""
    if len(clock) < 2:
        return np.full_like(wanted, np.nan)
    interval = np.diff(clock)
    after = np.clip(np.searchsorted(clock, wanted), 1, len(clock) - 1)
    found = interpolate_readings(wanted, clock, values, digit)
    found[interval[after - 1] > GAP_FACTOR * np.median(interval)] = np.nan
    return found


def _counted_samples(
    recording: Recording,
    time: FloatArray,
    values: dict[str, FloatArray],
    facts: TrialFacts,
) -> tuple[NDArray[np.bool_], list[DataFinding]]:
    """Return which samples count: none missing or masked, in declared stretches."""
    name = recording.name
    findings = []
    good = np.ones(len(time), dtype=bool)
    mask = values.get(VALID)
    if mask is not None:
        if not np.isin(mask[~np.isnan(mask)], (0.0, 1.0)).all():
            problem = "holds other numbers than 0 and 1; 1 means that the row counts."
            findings.append(error(f"{recording.column(VALID)} {problem}", name, VALID))
        good &= mask == 1.0
        if not good.any():
            problem = "is 1 in no row; 1 means that the row counts."
            findings.append(error(f"{recording.column(VALID)} {problem}", name, VALID))
    if facts.valid is not None:
        inside = np.zeros(len(time), dtype=bool)
        for start, stop in facts.valid:
            inside |= (time >= start) & (time <= stop)
        if not inside.any():
            problem = f"has no sample in the stretches declared valid, {facts.valid}"
            ends = f"its times are {time[0]:.6g} to {time[-1]:.6g} s"
            findings.append(error(f"{recording.path} {problem}; {ends}.", name))
        good &= inside
    total = max(1, int(np.count_nonzero(good)))
    for channel, value in tuple(values.items()):
        missing = np.isnan(value)
        lost = int(np.count_nonzero(missing & good)) if missing.any() else 0
        if channel == VALID or not lost:
            continue
        problem = f"{recording.column(channel)} lacks {lost} of {total} usable readings"
        # A column that is not compared is worth no trial.
        if channel == TEMPERATURE or is_further(channel):
            del values[channel]
            findings.append(warning(f"{problem}; it is left out.", name, channel))
        elif lost > MAX_MISSING_SHARE * total:
            advice = "repair the sensor or leave the trial out."
            findings.append(error(f"{problem}; {advice}", name, channel))
        else:
            advice = "the trial is split there and nothing is filled in."
            findings.append(warning(f"{problem}; {advice}", name, channel))
    for channel, value in values.items():
        if channel != VALID:
            good &= ~np.isnan(value)
    return good, findings


def _gaps(
    recording: Recording, time: FloatArray, step: float
) -> tuple[NDArray[np.intp], list[DataFinding]]:
    """Return the rows after a gap, and whether the rest comes in bunches."""
    name = recording.name
    change = np.diff(time)
    gap = change > GAP_FACTOR * step
    findings = []
    if gap.any():
        longest = int(np.argmax(change))
        findings.append(
            warning(
                f"{recording.column(TIME)} has {np.count_nonzero(gap)} gaps, the "
                f"longest of {change[longest]:.4g} s at {time[longest]:.6g} s; the "
                "trial is split there and nothing is filled in.",
                name,
                TIME,
            )
        )
    bunched = np.count_nonzero((change < 0.1 * step) | gap)
    if bunched > 0.05 * len(change):
        findings.append(
            error(
                f"{recording.column(TIME)}: {bunched / len(change):.0%} of the "
                f"intervals are less than a tenth of the usual {1e3 * step:.4g} ms or "
                f"more than {GAP_FACTOR:g} times as long, as where readings arrive in "
                "bunches; use the times of the sampling clock, not those of arrival.",
                name,
                TIME,
            )
        )
    return np.flatnonzero(gap) + 1, findings


def _counted_runs(
    good: NDArray[np.bool_], breaks: NDArray[np.intp], fewest: int
) -> tuple[slice, ...]:
    """Return the runs of valid samples that are long enough and have no gap."""
    edges = np.flatnonzero(np.diff(good, prepend=False, append=False))
    runs = []
    for start, stop in edges.reshape(-1, 2):
        inside = breaks[(breaks > start) & (breaks < stop)]
        ends = [start, *inside, stop]
        runs += [(a, b) for a, b in itertools.pairwise(ends)]
    return tuple(slice(int(a), int(b)) for a, b in runs if b - a >= fewest)


def _resample_evenly(
    recording: Recording, track: SampledTrack
) -> tuple[SampledTrack, list[DataFinding]]:
    time, segments = track.time, track.segments
    spans = [
        (time[part][0], time[part][-1], part.stop - part.start) for part in segments
    ]
    step = sum(b - a for a, b, _ in spans) / sum(n - 1 for _, _, n in spans)
    off = max(
        float(np.abs(time[part] - (a + step * np.arange(n))).max())
        for part, (a, _, n) in zip(segments, spans, strict=True)
    )
    if off <= 0.1 * step:
        return replace(track, step=step), []
    # By rounding the last time may lie beyond the last reading.
    grids = [
        np.minimum(a + step * np.arange(int((b - a) / step + 1e-6) + 1), b)
        for a, b, _ in spans
    ]
    values = {
        channel: np.concatenate(
            [
                interpolate_readings(grid, time[part], value[part], digit)
                for grid, part in zip(grids, segments, strict=True)
            ]
        )
        for channel, value in track.values.items()
        for digit in [track.digits.get(channel, 0.0) if channel in ANGLES else 0.0]
    }
    ends = np.cumsum([0, *(len(grid) for grid in grids)])
    parts = tuple(slice(int(a), int(b)) for a, b in itertools.pairwise(ends))
    message = (
        f"{recording.column(TIME)} is off an even clock by up to {1e3 * off:.3g} ms; "
        f"the readings were interpolated at {1 / step:.5g} Hz."
    )
    even = SampledTrack(np.concatenate(grids), values, parts, step, track.digits)
    return even, [warning(message, recording.name, TIME)]


MAX_TRIAL_SAMPLES = 60_000
"""Largest number of samples of a trial: two minutes at `MIN_AVERAGED_RATE`."""
MIN_AVERAGED_RATE = 500.0
"""Lower bound of the sampling rate after averaging [Hz]."""
WINDOW_COUNT = 12
"""Evenly spread stretches that are kept where averaging is not enough."""


def decimate(
    track: SampledTrack, path: str, name: str
) -> tuple[SampledTrack, list[DataFinding]]:
    """Average neighbours, then keep evenly spread stretches, to few samples."""
    before, rate = _sample_count(track), 1.0 / track.step
    if before <= MAX_TRIAL_SAMPLES:
        return track, []
    remarks = []
    block = int(min(-(-before // MAX_TRIAL_SAMPLES), rate // MIN_AVERAGED_RATE))
    if block > 1:
        track = _average_neighbours(track, block)
        remarks.append(
            f"every {block} samples were averaged, to {1.0 / track.step:.5g} Hz"
        )
    if _sample_count(track) > MAX_TRIAL_SAMPLES:
        length = MAX_TRIAL_SAMPLES // WINDOW_COUNT
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
    """Return means over blocks of samples, never across the end of a segment."""
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
