"""The time of a recording: from recorded rows to evenly sampled stretches.

A gap, a missing reading or a masked row ends a stretch; nothing is interpolated across
it. A stretch whose sampling times jitter is resampled evenly by linear interpolation.
"""

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

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
from cc_mujoco.datasets._data_findings import Severity, warning
from cc_mujoco.datasets._dataset_file import DatasetFile
from cc_mujoco.datasets._quantization import interpolate_readings, resolution
from cc_mujoco.datasets._reading import Recording
from cc_mujoco.datasets._trials import FloatArray, TrialFacts


class _Limits(NamedTuple):
    missing: float = 0.3  # largest share of times, or of a channel's readings
    run: int = 20  # rows in order that are a recording of their own
    rate: float = 25.0  # data below are of no use [Hz]
    low_rate: float = 100.0  # data below are of limited use [Hz]
    time: float = 0.2  # shortest stretch [s]
    samples: int = 20  # and its least number of samples


_LIMITS = _Limits()
GAP_FACTOR = 3.0  # an interval longer than this multiple of the usual one is a gap


def sort_rows(recording: Recording) -> Recording | None:
    """Return the recording with the rows of every clock by increasing time.

    Rows that a logger wrote late or a database returned in any order are sorted. Rows
    without a time, and all but the first of those with equal times, are left out. The
    result is None, with an error, if two runs of rows cover the same time (recordings
    joined, a clock set), time never or only falls, or many times lack.
    """
    times = {TIME: recording.values[TIME], **recording.clocks}
    orders = {}
    for channel in recording.values:
        if channel in times:
            order = _row_order(recording, channel, times[channel])
            if order is None:
                return None
            orders[channel] = order
    return replace(
        recording,
        values={
            channel: value[orders.get(channel, orders[TIME])]
            for channel, value in recording.values.items()
        },
        clocks={channel: t[orders[channel]] for channel, t in recording.clocks.items()},
    )


def _row_order(
    recording: Recording, channel: str, time: FloatArray
) -> NDArray[np.intp] | slice | None:
    """Return rows by increasing `time` [s]; None, and a finding, if unusable."""
    if (np.diff(time) > 0).all() and np.isfinite(time).all():
        return slice(None)

    def report(severity: Severity, problem: str) -> None:
        clock = "" if channel == TIME else ", its clock"
        recording.report(severity, f"{clock} {problem}", channel)

    rows = np.flatnonzero(~np.isnan(time))
    if lost := len(time) - len(rows):
        if lost > _LIMITS.missing * len(time) or len(rows) < 2:
            report("error", f"lacks {lost} of {len(time)} times; every row needs one.")
            return None
        report("warning", f"lacks {lost} times; their rows are left out.")
    back = np.flatnonzero(np.diff(time[rows]) < 0)
    if len(back):
        k = back[0]
        problem = (
            f"goes back from {time[rows[k]]:.6g} to {time[rows[k + 1]]:.6g} s at row "
            f"{rows[k + 1] + 1}"
            f"{f', and {len(back) - 1} more times' if len(back) > 1 else ''}"
        )
        refusal = ""
        if _covers_time_twice(time[rows], back):
            refusal = (
                "; time must increase, so split recordings that were joined and bring "
                "channels to one clock."
            )
        elif len(back) > 0.9 * (len(rows) - 1):
            refusal = (
                ": time runs backwards; reverse the rows, or correct the clock if it "
                "counts down."
            )
        if refusal:
            report("error", problem + refusal)
            return None
        order = np.argsort(time[rows], kind="stable")
        far = int(np.abs(order - np.arange(len(rows))).max()) >= _LIMITS.run
        advice = "; the rows were put in the order of their times."
        report("doubt" if far else "warning", problem + advice)
        rows = rows[order]
    kept = np.diff(time[rows], prepend=-np.inf) > 0
    same = len(rows) - int(np.count_nonzero(kept))
    if same and same == len(rows) - 1:
        report("error", f"is {time[rows[0]]:.6g} s in every row; time must increase.")
        return None
    if same and channel == TIME:  # a slower sensor's stamp may stand in several rows
        first = rows[np.flatnonzero(~kept)[0]] + 1
        problem = (
            f"repeats the time of another row in {same} rows, the first of them row "
            f"{first}"
        )
        if same > 0.01 * len(rows):
            advice = "write times with more digits, or the clock is too coarse."
            report("error", f"{problem}; {advice}")
        else:
            report("warning", f"{problem}; the first of each is used.")
    rows = rows[kept]
    return slice(None) if len(rows) == len(time) and not len(back) else rows


def _covers_time_twice(time: FloatArray, back: NDArray[np.intp]) -> bool:
    edges = np.concatenate([[0], back + 1, [len(time)]])
    runs = [time[a:b] for a, b in itertools.pairwise(edges) if b - a >= _LIMITS.run]
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


@dataclass
class SampledTrack:
    time: FloatArray  # (samples,) [s]
    values: dict[str, FloatArray]  # (samples,) by channel, finite in segments
    segments: tuple[slice, ...]  # stretches in order
    step: float  # time between samples [s]
    # quantisation step of the readings by channel, 0 if they show none
    digits: dict[str, float]

    @property
    def counts(self) -> list[int]:
        return [part.stop - part.start for part in self.segments]

    def thinned(
        self, thin: Callable[[FloatArray], FloatArray], counts: Iterable[int]
    ) -> "SampledTrack":
        """Apply `thin` to time and signals; `counts` are the new segments' sizes."""
        values = {channel: thin(value) for channel, value in self.values.items()}
        segments = tuple(part for part in _slices(counts) if part.stop > part.start)
        return replace(self, time=thin(self.time), values=values, segments=segments)


def _slices(counts: Iterable[int]) -> tuple[slice, ...]:
    ends = itertools.accumulate(counts, initial=0)
    return tuple(slice(a, b) for a, b in itertools.pairwise(ends))


def find_segments(
    recording: Recording, facts: TrialFacts, file: DatasetFile
) -> SampledTrack | None:
    """Return the usable stretches of a recording, evenly sampled; None without any.

    The times must increase, as `sort_rows` leaves them.
    """
    for remark in recording.remarks:
        recording.findings.append(warning(remark, recording.name))
    if recording.rows < 2:
        rows = "one row of data" if recording.rows else "no rows of data"
        problem = f" has {rows}; a trial needs at least {_LIMITS.time} s."
        recording.report("error", problem)
        return None
    time = recording.values[TIME]
    step = float(np.median(np.diff(time)))
    lasts = float(time[-1] - time[0])
    rate = 1.0 / step
    other_unit = _suggest_time_unit(recording, file, rate, lasts)
    pace = f": {rate:.4g} samples per second"
    if rate < _LIMITS.rate:
        pace += " are too few to see friction at reversals; record at 200 or more"
        more = f", or {other_unit}" if other_unit else ""
        recording.report("error", f"{pace}{more}.", TIME)
    elif rate < _LIMITS.low_rate:
        pace += " blur what happens at reversals; 200 or more are better."
        recording.report("warning", pace, TIME)
    digits = {
        channel: resolution(value)
        for channel, value in recording.values.items()
        if channel not in (TIME, VALID)
    }
    values = _on_one_clock(recording, file, digits)
    good = _counted_samples(recording, values, facts)
    fewest = max(_LIMITS.samples, round(_LIMITS.time * rate))
    segments = _counted_runs(good, _gaps(recording, time, step), fewest)
    if not segments:
        problem = f"lasts {lasts:.3g} s; a trial needs at least {_LIMITS.time} s."
        if other_unit:
            problem = (
                f"lasts {lasts:.3g} s with {len(time)} samples, {rate:.3g} per second; "
                f"{other_unit}."
            )
        elif lasts >= _LIMITS.time and len(time) < _LIMITS.samples:
            problem = (
                f"has {len(time)} samples; a trial needs at least {_LIMITS.samples}."
            )
        elif lasts >= _LIMITS.time:
            problem = (
                f"has no stretch of {_LIMITS.time} s without a gap or a missing "
                "reading; record without interruption."
            )
        recording.report("error", f" {problem}")
        return None
    values.pop(VALID, None)
    track = SampledTrack(time, values, segments, step, digits)
    return _resample_evenly(recording, track)


def _suggest_time_unit(
    recording: Recording, file: DatasetFile, rate: float, lasts: float
) -> str:
    """Return advice on a unit of time that gives a likely rate, "" without one."""
    label = recording.labels.get(TIME, TIME)
    now = CLOCK.factors[file.unit(TIME, label)]
    for unit, factor in CLOCK.factors.items():
        scale = factor / now
        # No rig samples at 5 kHz.
        likely = _LIMITS.rate < rate / scale < 5e3 and scale * lasts >= _LIMITS.time
        if scale != 1.0 and likely:
            if set(recording.paths.values()) - {recording.path}:
                return f"check the `unit` of its files in [files]; {unit!r} would do"
            return (
                f"declare [columns.{TIME}] unit = {unit!r} if that is what {label} "
                "holds"
            )
    return ""


def _on_one_clock(
    recording: Recording, file: DatasetFile, digits: dict[str, float]
) -> dict[str, FloatArray]:
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
    """Return values at times `wanted` [s]; NaN outside `clock` and in its gaps."""
    if len(clock) < 2:
        return np.full_like(wanted, np.nan)
    interval = np.diff(clock)
    after = np.clip(np.searchsorted(clock, wanted), 1, len(clock) - 1)
    found = interpolate_readings(wanted, clock, values, digit)
    found[interval[after - 1] > GAP_FACTOR * np.median(interval)] = np.nan
    return found


def _counted_samples(
    recording: Recording, values: dict[str, FloatArray], facts: TrialFacts
) -> NDArray[np.bool_]:
    """Return the mask (rows,) of usable rows; delete uncompared channels with gaps."""
    time = recording.values[TIME]
    good = np.ones(len(time), dtype=bool)
    mask = values.get(VALID)
    if mask is not None:
        if not np.isin(mask[~np.isnan(mask)], (0.0, 1.0)).all():
            problem = " holds other numbers than 0 and 1; 1 means that the row counts."
            recording.report("error", problem, VALID)
        good &= mask == 1.0
        if not good.any():
            problem = " is 1 in no row; 1 means that the row counts."
            recording.report("error", problem, VALID)
    if facts.valid is not None:
        inside = np.zeros(len(time), dtype=bool)
        for start, stop in facts.valid:
            inside |= (time >= start) & (time <= stop)
        if not inside.any():
            problem = f" has no sample in the stretches declared valid, {facts.valid}"
            ends = f"its times are {time[0]:.6g} to {time[-1]:.6g} s"
            recording.report("error", f"{problem}; {ends}.")
        good &= inside
    total = max(1, int(np.count_nonzero(good)))
    for channel, value in tuple(values.items()):
        missing = np.isnan(value)
        lost = int(np.count_nonzero(missing & good)) if missing.any() else 0
        if channel == VALID or not lost:
            continue
        severity: Severity = "warning"
        advice = "the trial is split there and nothing is filled in."
        # A column that is not compared is worth no trial.
        if channel == TEMPERATURE or is_further(channel):
            del values[channel]
            advice = "it is left out."
        elif lost > _LIMITS.missing * total:
            severity, advice = "error", "repair the sensor or leave the trial out."
            rows = np.flatnonzero(missing & good)
            fails = rows[-1] - rows[0] == lost - 1 and not good[rows[-1] + 1 :].any()
            if fails and total - lost > _LIMITS.run:
                severity, moment = "doubt", f"{time[rows[0]]:.6g} s"
                advice = f"did the sensor fail at {moment}? What follows is left out."
        problem = f" lacks {lost} of {total} usable readings; {advice}"
        recording.report(severity, problem, channel)
    for channel, value in values.items():
        if channel != VALID:
            good &= ~np.isnan(value)
    return good


def _gaps(recording: Recording, time: FloatArray, step: float) -> NDArray[np.intp]:
    """Return rows after gaps in `time` [s]; report gaps and rows bunched in time."""
    change = np.diff(time)
    gap = change > GAP_FACTOR * step
    if gap.any():
        longest, count = int(np.argmax(change)), np.count_nonzero(gap)
        problem = (
            f" has {'a gap' if count == 1 else f'{count} gaps, the longest'} of "
            f"{change[longest]:.4g} s at {time[longest]:.6g} s; the trial is split "
            "there and nothing is filled in."
        )
        recording.report("warning", problem, TIME)
    bunched = np.count_nonzero((change < 0.1 * step) | gap)
    if bunched > 0.05 * len(change):
        problem = (
            f": {bunched / len(change):.0%} of the intervals are less than a tenth of "
            f"the usual {1e3 * step:.4g} ms or more than {GAP_FACTOR:g} times as long, "
            "as where readings arrive in bunches; use the times of the sampling clock, "
            "not those of arrival."
        )
        recording.report("error", problem, TIME)
    return np.flatnonzero(gap) + 1


def _counted_runs(
    good: NDArray[np.bool_], breaks: NDArray[np.intp], fewest: int
) -> tuple[slice, ...]:
    """Return the runs of `good` rows without a break and of at least `fewest` rows."""
    edges = np.flatnonzero(np.diff(good, prepend=False, append=False))
    runs = []
    for start, stop in edges.reshape(-1, 2):
        inside = breaks[(breaks > start) & (breaks < stop)]
        ends = [start, *inside, stop]
        runs += [(a, b) for a, b in itertools.pairwise(ends)]
    return tuple(slice(int(a), int(b)) for a, b in runs if b - a >= fewest)


def _resample_evenly(recording: Recording, track: SampledTrack) -> SampledTrack:
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
        return replace(track, step=step)
    # By rounding the last time may lie beyond the last reading.
    grids = [
        np.minimum(a + step * np.arange(int((b - a) / step + 1e-6) + 1), b)
        for a, b, _ in spans
    ]
    values = {}
    for channel, value in track.values.items():
        digit = track.digits.get(channel, 0.0) if channel in ANGLES else 0.0
        pieces = [
            interpolate_readings(grid, time[part], value[part], digit)
            for grid, part in zip(grids, segments, strict=True)
        ]
        values[channel] = np.concatenate(pieces)
    problem = (
        f" is off an even clock by up to {1e3 * off:.3g} ms; the readings were "
        f"interpolated at {1 / step:.5g} Hz."
    )
    recording.report("warning", problem, TIME)
    parts = _slices(map(len, grids))
    return SampledTrack(np.concatenate(grids), values, parts, step, track.digits)


def decimate(recording: Recording, track: SampledTrack) -> SampledTrack:
    """Return a track of at most 60,000 samples.

    Blocks of samples are averaged down to 500 Hz at least. If that is not enough, 12
    windows evenly spread over the track are kept.
    """
    before, rate, most = sum(track.counts), 1.0 / track.step, 60_000
    if before <= most:
        return track
    remarks = []
    block = int(min(-(-before // most), rate // 500.0))
    if block > 1:
        track = _average_neighbours(track, block)
        remarks.append(
            f"every {block} samples were averaged, to {1.0 / track.step:.5g} Hz"
        )
    if sum(track.counts) > most:
        count = 12
        length = most // count
        track = _even_windows(track, length, count)
        remarks.append(
            f"{count} evenly spread stretches of {length * track.step:.4g} s are used"
        )
    done = " and ".join(remarks)
    recording.report("warning", f" has {before} samples at {rate:.5g} Hz; {done}.")
    return track


def _average_neighbours(track: SampledTrack, block: int) -> SampledTrack:
    blocks = [count // block for count in track.counts]
    whole = [
        slice(part.start, part.start + count * block)
        for part, count in zip(track.segments, blocks, strict=True)
    ]

    def means(values: FloatArray) -> FloatArray:
        kept = np.concatenate([values[part] for part in whole])
        return np.asarray(kept.reshape(-1, block).mean(axis=1))

    return replace(track.thinned(means, blocks), step=track.step * block)


def _even_windows(track: SampledTrack, length: int, count: int) -> SampledTrack:
    """Return the first `length` samples of each of `count` equal parts of the track."""
    rows = np.concatenate([np.arange(part.start, part.stop) for part in track.segments])
    segment = np.repeat(np.arange(len(track.segments)), track.counts)
    pieces: list[NDArray[np.intp]] = []
    for cut in np.linspace(0, rows.size, count + 1).astype(int)[:-1]:
        window = slice(cut, cut + length)
        ends = np.flatnonzero(np.diff(segment[window])) + 1
        pieces += np.split(rows[window], ends)
    index = np.concatenate(pieces)
    return track.thinned(lambda values: values[index], map(len, pieces))
