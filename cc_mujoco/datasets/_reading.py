"""Reading of the files of a trial into channels in SI units.

Names and units of the columns come from `dataset.toml` or from the columns' own names:
`motor_angle_deg` is the motor angle in degrees.
"""

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils import tables
from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets import _columns as columns
from cc_mujoco.datasets._columns import DATASET_FILE
from cc_mujoco.datasets._data_findings import DataFinding, Severity
from cc_mujoco.datasets._dataset_file import DatasetFile, PartFile, TrialFile
from cc_mujoco.datasets._trials import FloatArray
from cc_mujoco.errors import CableError


class Stream(NamedTuple):
    time: FloatArray  # (rows,) [s]
    values: FloatArray  # (rows,) in the channel's unit
    path: Path  # the file
    clock: str  # the column of these times

    @property
    def interval(self) -> float:
        """Median time between readings [s], infinite if there are none."""
        change = np.diff(np.sort(self.time[np.isfinite(self.time)]))
        change = change[change > 0.0]
        return float(np.median(change)) if len(change) else np.inf

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s], NaN if there is none."""
        known = self.time[np.isfinite(self.time)]
        return (float(known.min()), float(known.max())) if len(known) else (np.nan,) * 2


def _topic_rows(values: Mapping[str, FloatArray]) -> dict[str, NDArray[np.bool_]]:
    """Return masks (rows,) of each channel's readings, if each row is of one topic.

    In a file that merges topics, few rows hold all channels of the drive, or one
    channel is in every second row at most. Otherwise the result is {}, and a blank cell
    (NaN) is a missing reading.
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
    return filled if complete < 0.5 * fewest or max(spacing) >= 2.0 else {}


@dataclass
class Recording:
    """Contents of a trial's files before checks and segmentation."""

    name: str  # name of the trial
    path: Path  # the file, or the first of several
    sha256: str  # SHA-256 of its bytes
    # (rows,) by channel in SI units, with signs and offsets applied; of a channel with
    # a clock of its own perhaps another number of rows
    values: dict[str, FloatArray]
    # [s], times of the channels that have a clock of their own
    clocks: dict[str, FloatArray]
    labels: dict[str, str]  # name in the file of every channel
    names: list[str]  # all columns of the file
    # files of the channels that are in another than `path`
    paths: dict[str, Path] = field(default_factory=dict)
    # sentences on how channels were brought to one clock
    remarks: list[str] = field(default_factory=list)
    # noticed in the rows, in order
    findings: list[DataFinding] = field(default_factory=list)

    def report(self, severity: Severity, problem: str, channel: str = "") -> None:
        """Add a finding on a channel: the file, its column and the problem."""
        place = self.column(channel) if channel else str(self.path)
        finding = DataFinding(severity, place + problem, self.name, channel)
        self.findings.append(finding)

    @property
    def rows(self) -> int:
        return len(self.values[channels.TIME])

    def column(self, channel: str) -> str:
        path = self.paths.get(channel, self.path)
        return f"{path}, column {self.labels.get(channel, channel)}"


def read(
    trial: Path | Sequence[TrialFile],
    file: DatasetFile,
    name: str | None = None,
    axis: str = "",
    others: Mapping[str, str] | None = None,
    further: Collection[str] = (),
    other_axes: Collection[str] = (),
) -> Recording:
    """Read the channels of a trial from its file, or several, in SI units.

    `name` is the trial's, by default that of its file. In a log of several axes columns
    may have the prefix `axis`, and those with a prefix of `other_axes` are left out.
    `others` has the column by joint for angles other than the driven joint's; `further`
    are columns outside the table of channels, read if present. Raises `CableError` if a
    column is missing or clocks of several files share no time.
    """
    parts = (TrialFile("", trial, PartFile("")),) if isinstance(trial, Path) else trial
    name = name or parts[0].path.stem
    where = " and ".join(str(part.path) for part in parts)
    tabled = [_Table.of(part, file) for part in parts]
    # In full where there are several: their columns may have the same names.
    start = f"{axis}." if axis else ""
    others = others or {}
    logged = {column: channels.other_angle(joint) for joint, column in others.items()}
    strange = tuple(f"{each}." for each in other_axes)
    kept = {*logged, *(file.source(channel).name for channel in file.columns)}
    placed = [
        (
            f"{table.part.key}.{column}"
            if len(parts) > 1
            else logged.get(column, column.removeprefix(start)),
            (table, column),
        )
        for table in tabled
        for column in table.names
        if (len(parts) == 1 or column != table.time)
        and (column in kept or not column.startswith(strange))
    ]
    alone = all(column == table.time for _, (table, column) in placed)
    if alone and (
        left := [c for t in tabled for c in t.names if c.startswith(strange)]
    ):
        raise CableError(
            f"{where} has columns of other axes alone, such as {left[-1]}; give the "
            f"axis of these data, or data of {axis!r}."
        )
    homes = dict(placed)
    # With what is there twice, which may be why another is missing.
    names = [column for column, _ in placed]
    found = columns.channel_sources(where, names, file, others)
    for column in further:
        if places := columns.columns_named(column, list(homes)):
            found[channels.further(column)] = places[0]
    for channel, column in found.items():
        table, own = homes[column]
        table.channels[channel] = own
    streams: dict[str, Stream] = {}
    for table in tabled:
        streams |= table.streams(file)
    first, several = tabled[0], len(parts) > 1
    topical = any(table.topical for table in tabled)
    recording = Recording(
        name=name,
        path=first.part.path,
        sha256=_sha256([part.path for part in parts]),
        values={channels.TIME: first.stamps}
        | {channel: streams[channel].values for channel in found},
        clocks={
            channel: stream.time
            for channel, stream in streams.items()
            if file.source(channel).clock is not None
        },
        labels={channels.TIME: first.time}
        | {c: column for table in tabled for c, column in table.channels.items()},
        names=[n for table in tabled for n in table.plain(topical, several)],
        paths={channel: stream.path for channel, stream in streams.items()},
    )
    if not several and not topical:
        return recording
    if several:
        _require_common_zero(where, tabled, name)
    return _merge_streams(recording, name if several else where, streams)


def _merge_streams(
    recording: Recording, where: str, streams: Mapping[str, Stream]
) -> Recording:
    """Return the recording with the clock of the slowest channel of the drive.

    Readings of that channel are kept, and denser channels are interpolated at its times
    later. On a faster clock most samples of the slow channel would be interpolated, and
    look like many readings without noise.
    """
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
    rates = ", ".join(
        f"{channel} {1 / stream.interval:.4g}" for channel, stream in drive.items()
    )
    remarks = [
        f"{where}: channels have times of their own (per second: {rates}); all are "
        f"read at those of {leader}, the slowest, between neighbours."
    ]
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
            and own.interval < 0.5 * stream.interval
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
    return replace(
        recording,
        values={channels.TIME: own.time[rows]} | values,
        clocks=clocks,
        labels=recording.labels | {channels.TIME: own.clock},
        paths=recording.paths | {channels.TIME: own.path},
        remarks=remarks,
    )


@dataclass
class _Table:
    part: TrialFile  # the file
    names: list[str]  # names of its columns, and of the stamps that two columns make up
    time: str  # the column of its times
    second: float  # factor of that column's unit
    offset: float  # reading at zero of the trial's time
    channels: dict[str, str] = field(default_factory=dict)  # column by channel
    # (rows,) [s], once they are read
    stamps: FloatArray = field(default_factory=lambda: np.empty(0))
    topical: bool = False  # whether its rows belong to topics

    @classmethod
    def of(cls, part: TrialFile, file: DatasetFile) -> "_Table":
        names = tables.column_names(part.path)
        names += [stem for stem in columns.stamp_columns(names) if stem not in names]
        source, given = file.source(channels.TIME), part.times
        given = replace(
            given, time=given.time or source.name, unit=given.unit or source.unit
        )
        time, unit = columns.time_column(str(part.path), names, given, file)
        offset = source.offset if given.offset is None else given.offset
        return cls(part, names, time, channels.CLOCK.factors[unit], offset)

    def streams(self, file: DatasetFile) -> dict[str, Stream]:
        path = self.part.path
        clocks = {
            channel: columns.find_column(
                str(path), f"the clock of {channel}", clock, self.names
            )
            for channel in self.channels
            if (clock := file.source(channel).clock) is not None
        }
        wanted = dict.fromkeys([self.time, *self.channels.values(), *clocks.values()])
        pairs = columns.stamp_columns(self.names)
        single = dict.fromkeys(
            piece for name in wanted for piece in pairs.get(name, (name,))
        )
        for column in single:
            if self.names.count(column) > 1:
                raise CableError(
                    f"{path} has {self.names.count(column)} columns {column}; names "
                    "must differ."
                )
        switch = self.channels.get(channels.VALID)
        raw = tables.read_columns(path, single, [switch] if switch else [])
        for name in wanted:
            if name in pairs:
                whole, nano = pairs[name]
                raw[name] = (raw[whole] + 1e-9 * raw[nano]) / self.second
        # What is farther than these limits is taken for missing.
        self.stamps = _scale(raw[self.time], self.offset, self.second, 1e11)
        streams = {}
        for channel, column in self.channels.items():
            source, time, clock = file.source(channel), self.stamps, self.time
            if channel in clocks:
                clock = clocks[channel]
                time = raw[clock] * self.second
            factor = source.sign * file.factor(channel, column)
            value = _scale(raw[column], source.offset, factor, 1e6)
            if len(value) != len(time):
                raise CableError(
                    f"{path}, column {column} has {len(value)} readings, but its "
                    f"times, column {clock}, are {len(time)}; every reading needs one."
                )
            label = source.clock or self.time
            streams[channel] = Stream(time, value, path, label)
        rows = len(self.stamps)
        known = {c: s.values for c, s in streams.items() if len(s.values) == rows}
        kept = _topic_rows(known)
        self.topical = bool(kept)
        for channel in clocks.keys() - kept.keys():  # may have fewer rows than the file
            stream = streams[channel]
            kept[channel] = ~(np.isnan(stream.time) & np.isnan(stream.values))
        for channel, mask in kept.items():
            stream = streams[channel]
            streams[channel] = stream._replace(
                time=stream.time[mask], values=stream.values[mask]
            )
        return streams

    def plain(self, topical: bool, several: bool) -> list[str]:
        """Return the columns but stamps and, of one of `several` files, its times."""
        known = columns.stamp_columns(self.names)
        left = {*known, *(name for pair in known.values() for name in pair)}
        if several:
            left.add(self.time)
        return [
            name
            for name in self.names
            if name not in left and not (topical and name.endswith("stamp"))
        ]


def _require_common_zero(where: str, tabled: Sequence[_Table], name: str) -> None:
    unknown = []
    for table in tabled:
        known = table.stamps[np.isfinite(table.stamps)]
        begins = abs(float(known.min())) if len(known) else np.inf
        if table.part.times.offset is None and begins < 1.0:
            unknown.append(table)
    if len(unknown) > 1:
        keys = " and ".join(table.part.key for table in unknown)
        last = unknown[-1].part
        raise CableError(
            f"{where}: the times of {keys} all begin at about 0 s, perhaps each at the "
            "start of its own file; give the reading of one clock when the other is at "
            f"0 in {DATASET_FILE}, [files], or 0 if they are one clock: {last.key} = "
            f"{{ file = ..., offset = ... }} (trial {name!r})."
        )


def _scale(
    reading: FloatArray, offset: float, factor: float, limit: float
) -> FloatArray:
    """Return (reading - offset) * factor, NaN where its size exceeds `limit`."""
    value = reading if offset == 0.0 else reading - offset
    value = value if factor == 1.0 else value * factor
    if not (len(value) and -limit < value.min() and value.max() < limit):
        value = np.where(np.abs(value) < limit, value, np.nan)
    return value


def _sha256(paths: Sequence[Path]) -> str:
    """Return a file's SHA-256; for several files that of their joined digests."""
    hashes = []
    for path in paths:
        with path.open("rb") as file:
            hashes.append(hashlib.file_digest(file, "sha256").hexdigest())
    if len(hashes) == 1:
        return hashes[0]
    return hashlib.sha256("".join(hashes).encode()).hexdigest()
