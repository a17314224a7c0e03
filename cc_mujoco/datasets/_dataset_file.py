"""`dataset.toml`: meaning of the trials' columns, the rig, and facts about each trial.

`dataset.toml` beside this module is an example with every key.
"""

import fnmatch
import hashlib
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, get_args

from cc_mujoco._utils.tables import ENDINGS
from cc_mujoco._utils.toml_table import Table, read_toml
from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._data_findings import DataFinding, warning
from cc_mujoco.datasets._rig_table import LOAD_CONSTANTS, read_rig
from cc_mujoco.datasets._trials import Constant, Locked, Split, TrialFacts
from cc_mujoco.errors import CableError, naming
from cc_mujoco.report._html import list_words

MAX_DELAY = 2.0  # delay of a channel that is no slip of the pen [s]


@dataclass(frozen=True)
class Source:
    """Column of a channel: value = sign * (reading - offset) * scale * factor."""

    name: str | None = None  # column of the files; None is the channel's own name
    unit: str | None = None  # unit of the scaled readings; None is what the name says
    sign: float = 1.0  # 1 or -1
    scale: float = 1.0  # units per count, 1 if the readings are in that unit already
    offset: float = 0.0  # reading at true zero
    delay: float = 0.0  # time by which the channel comes late [s]
    clock: str | None = None  # column with the times of this channel; None is `time_s`
    noise: float | None = None  # raw standard deviation; None is not known
    resolution: float | None = None  # raw quantisation step; None is not known
    # False where no instrument measures this torque or motor angle
    measured: bool = True


@dataclass(frozen=True)
class PartFile:
    """One of several files of a trial; its clock is (reading - offset) * factor [s]."""

    file: str  # its name, `*` standing for what it shares with the trial's
    time: str | None = None  # column of its times; None is that of `[columns.time_s]`
    unit: str | None = None  # unit of these times; None is what the name says
    # reading at the trial's zero of time, in that unit; None is not known
    offset: float | None = None

    def match_wildcard(self, path: Path) -> tuple[Path, str] | None:
        """Return folder and text that `*` stands for in a path; None if no match."""
        depth = 1 + self.file.count("/")
        tail = Path(*path.parts[-depth:]).as_posix()
        found = re.fullmatch(re.escape(self.file).replace(r"\*", "([^/]*)"), tail)
        if found is None:
            return None
        return Path(*path.parts[:-depth]), (found[1] if "*" in self.file else "")


@dataclass(frozen=True)
class DatasetFile:
    """Contents of a `dataset.toml`; the default is an empty file."""

    columns: Mapping[str, Source] = field(default_factory=dict)
    rig: Mapping[str, Constant] = field(default_factory=dict)
    facts: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    files: Mapping[str, Mapping[str, PartFile]] = field(default_factory=dict)
    name: str = ""
    notes: str = ""
    path: str = ""
    sha256: str = ""

    def source(self, channel: str) -> Source:
        return self.columns.get(channel, Source())

    def factor(self, channel: str, column: str) -> float:
        """Return the factor from a column's readings to SI, without the sign."""
        unit = channels.kind_of(channel).factors[self.unit(channel, column)]
        return self.source(channel).scale * unit

    def unit(self, channel: str, column: str) -> str:
        """Return the unit of a column: declared, else named by the column, else SI."""
        measured = channels.kind_of(channel)
        spelled = channels.unit_of(column, measured)
        return self.source(channel).unit or spelled or measured.unit

    def has_substitute(self, torque: str, found: Iterable[str]) -> bool:
        """Return whether load cells, current or load stand in for a torque's column."""
        motor = torque == channels.MOTOR_TORQUE
        end = "proximal" if motor else "distal"
        tensions = (name for name in found if channels.is_tension(name))
        if any(channels.cable_end(name)[1] == end for name in tensions):
            return True
        if motor:
            return channels.MOTOR_CURRENT in found
        return self.has_known_load

    @property
    def has_known_load(self) -> bool:
        return any(name in self.rig for name in LOAD_CONSTANTS)

    def facts_of(
        self, path: Path, names: Mapping[Path, str] | None = None
    ) -> TrialFacts:
        """Return the facts of the trial in this file; the last matching table wins.

        `names` are the names of all trials by file; by default a trial has its file's
        name.
        """
        names = names or {path: path.stem}
        facts = TrialFacts()
        for pattern, known in self.facts.items():
            if _matches(path, names[path], pattern):
                facts = replace(facts, **known)
        return replace(facts, repeat_of=_resolve_trial(facts.repeat_of, names))

    def check_trials(
        self, names: Mapping[Path, str], others: Iterable[Path] = ()
    ) -> list[DataFinding]:
        """Require that each table of `[trials]` has a file; warn of missing repeats.

        A `repeat_of` that names no trial gives a warning only, as part of a dataset may
        come without the trial that another repeats. `others` are data files near the
        given ones, looked at only where a table matches no trial.
        """
        repeated = [k["repeat_of"] for k in self.facts.values() if "repeat_of" in k]
        everything = dict(names)
        if not all(_matches_any(names, name) for name in (*self.facts, *repeated)):
            everything = {path: self._trial_of(path) for path in others} | everything
        absent: list[DataFinding] = []
        for pattern, known in self.facts.items():
            where = f"{self.path}, [trials.{pattern!r}]"
            if not _matches_any(everything, pattern):
                kind = f"trial in {self.path}, [trials]"
                raise CableError.unknown(kind, pattern, everything.values())
            original = _resolve_trial(known.get("repeat_of"), names)
            if original is not None and not _matches_any(everything, original):
                there = list_words(sorted(everything.values()))
                message = (
                    f"{where}, repeat_of: there is no trial {original!r} among the "
                    f"data ({there}); the trial is used without it."
                )
                absent.append(warning(message))
            meant = [n for path, n in names.items() if _matches(path, n, pattern)]
            if original in meant:
                raise CableError(
                    f"{where}, repeat_of: {original!r} cannot repeat itself; name the "
                    "trial that was recorded first."
                )
        return absent

    def _trial_of(self, path: Path) -> str:
        for trial, parts in self.files.items():
            for part in parts.values():
                if found := part.match_wildcard(path):
                    return trial.replace("*", found[1])
        return path.stem


def read_dataset_file(path: str | Path) -> DatasetFile:
    """Read a `dataset.toml`; unknown keys and impossible values are refused."""
    path = Path(path)
    top = read_toml(path)
    top.only("name", "notes", "columns", "files", "rig", "trials")
    return DatasetFile(
        columns={n: _source(t, n) for n, t in top.tables("columns").items()},
        rig=read_rig(top.table("rig")),
        facts={n: _facts(t) for n, t in top.tables("trials").items()},
        files={n: _files(t, n) for n, t in top.tables("files").items()},
        name=top.text("name") or "",
        notes=top.text("notes") or "",
        path=str(path),
        sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
    )


def _source(table: Table, channel: str) -> Source:
    with naming(table.where):
        units = channels.kind_of(channel).factors
    if channel == channels.VALID:
        table.only("name")
    elif channel == channels.TIME:
        table.only("name", "unit", "offset")
    elif table.flag("measured") is False:
        if channel not in (*channels.TORQUES, channels.MOTOR_ANGLE):
            reason = "a channel that was not recorded needs no table"
            if channel == channels.JOINT_ANGLE:
                reason = "the joint's angle must be recorded"
            raise CableError(
                f"{table.where}: `measured = false` is possible for torques and the "
                f"motor's angle only; {reason}."
            )
        table.only("measured")
        return Source(measured=False)
    else:
        table.only(*Source.__dataclass_fields__)
    sign = table.number("sign")
    if sign not in (None, 1.0, -1.0):
        raise table.wrong("sign", "1 or -1")
    scale = table.number("scale")
    if scale is not None and scale <= 0.0:
        raise table.wrong("scale", "above 0 (`sign = -1` turns a channel round)")
    delay = table.number("delay") or 0.0
    if abs(delay) > MAX_DELAY:
        raise table.wrong("delay", f"at most {MAX_DELAY:g} s (milliseconds are 0.001)")
    return Source(
        name=table.text("name"),
        unit=table.choice("unit", units),
        sign=1.0 if sign is None else sign,
        scale=1.0 if scale is None else scale,
        offset=table.number("offset") or 0.0,
        delay=delay,
        clock=table.text("clock"),
        noise=table.number("noise", 0.0),
        resolution=table.number("resolution", 0.0),
    )


def _files(table: Table, trial: str) -> dict[str, PartFile]:
    if len(table.content) < 2:
        raise CableError(
            f"{table.where} must name two files or more; one file needs no table."
        )
    parts = {}
    for key, given in table.content.items():
        content = given if isinstance(given, dict) else {"file": given}
        inner = Table(f"{table.where}, {key}", content)
        inner.only(*PartFile.__dataclass_fields__)
        name = inner.text("file")
        if not name:
            raise CableError(f"{inner.where} needs a `file`.")
        if name.count("*") != trial.count("*") or trial.count("*") > 1:
            raise inner.wrong(
                "file", "a name with one * if the trial's has one, else with none"
            )
        parts[key] = PartFile(
            file=name,
            time=inner.text("time"),
            unit=inner.choice("unit", channels.CLOCK.factors),
            offset=inner.number("offset"),
        )
    return parts


def _facts(table: Table) -> dict[str, Any]:
    table.only(*TrialFacts.__dataclass_fields__)
    known: dict[str, Any] = {
        "split": table.choice("split", get_args(Split)),
        "locked": table.choice("locked", get_args(Locked)),
    }
    right = "a list of [from, to] in seconds, from before to"
    if (stretches := table.pairs("valid", right)) is not None:
        if any(start >= stop for start, stop in stretches):
            raise table.wrong("valid", right)
        known["valid"] = tuple(stretches)
    torques = "known_motor_torque", "known_joint_torque"
    numbers = "pretension", "temperature", "tilt", *torques
    known |= {name: table.number(name) for name in numbers}
    texts = "repeat_of", "load_cell", "occasion", "notes"
    known |= {name: table.text(name) for name in texts}
    known |= {name: table.flag(name) for name in ("exclude", "unhooked", "swapped")}
    if abs(known["tilt"] or 0.0) > 2.0 * math.pi:
        raise table.wrong("tilt", "an angle in radians, at most a turn either way")
    tension = known["pretension"]
    if tension is not None and tension <= 0.0:
        raise table.wrong(
            "pretension", "more than 0 (`unhooked = true`: the cables were off)"
        )
    cell = known["load_cell"]
    if cell is not None and not channels.is_tension(cell):
        raise table.wrong("load_cell", "a channel such as tension_agonist_distal_n")
    for other, verb in (("pretension", "have"), ("load_cell", "pull at")):
        if known["unhooked"] and known[other]:
            raise CableError(
                f"{table.where}: cables that were off (`unhooked = true`) {verb} no "
                f"`{other}`; leave one of them out."
            )
    return {key: value for key, value in known.items() if value is not None}


def _resolve_trial(given: str | None, names: Mapping[Path, str]) -> str | None:
    """Return the trial of a name or file name, or the name itself without suffix."""
    if given is None or given in names.values():
        return given
    bare = Path(given)
    if bare.suffix.lower() in ENDINGS:
        bare = bare.with_suffix("")
    return next((n for path, n in names.items() if path.name == given), bare.as_posix())


def _matches_any(names: Mapping[Path, str], pattern: str) -> bool:
    return any(_matches(path, name, pattern) for path, name in names.items())


def _matches(path: Path, name: str, pattern: str) -> bool:
    """Return whether a pattern of `[trials]` matches a file by its name or its path.

    A pattern with folders is compared with as many last parts of the path, because the
    trial's name holds folders only where two files have equal names.
    """
    tail = Path(*path.parts[-1 - pattern.count("/") :])
    called = (name, tail.as_posix(), tail.with_suffix("").as_posix())
    return any(fnmatch.fnmatchcase(text, pattern) for text in called)


@dataclass(frozen=True)
class TrialFile:
    key: str  # name in `dataset.toml`; empty if the trial is this file
    path: Path  # the file
    times: PartFile  # source of its times


def group_files(
    files: Iterable[Path], file: DatasetFile
) -> tuple[list[Path], dict[str, tuple[TrialFile, ...]]]:
    alone: list[Path] = []
    found: dict[tuple[str, Path, str], dict[str, TrialFile]] = {}
    for path in files:
        meant = [
            ((pattern, *place), TrialFile(key, path, part))
            for pattern, parts in file.files.items()
            for key, part in parts.items()
            if (place := part.match_wildcard(path)) is not None
        ]
        if len(meant) > 1:
            owners = " and ".join(f"{of[0]!r}, {part.key}" for of, part in meant)
            raise CableError(
                f"{file.path}, [files]: {path} is {owners}; a file is of one trial, "
                "once."
            )
        if not meant:
            alone.append(path)
        for of, part in meant:
            found.setdefault(of, {})[part.key] = part
    trials: dict[str, tuple[TrialFile, ...]] = {}
    for (pattern, folder, star), given in found.items():
        name, where = pattern.replace("*", star), f"{file.path}, [files.{pattern!r}]"
        for key, wanted in file.files[pattern].items():
            if key not in given:
                absent = folder / wanted.file.replace("*", star)
                raise CableError(
                    f"{where}: {absent}, the {key} of {name!r}, was not given or does "
                    "not exist."
                )
        if name in trials:
            raise CableError(
                f"{where}: {trials[name][0].path} and {next(iter(given.values())).path}"
                f" are both of trial {name!r}; give one of them, or other names."
            )
        trials[name] = tuple(given[key] for key in file.files[pattern])
    return alone, trials
