"""Assignment of the columns of a file to channels and units.

A column in a struct, group, topic or file of a trial may be called by its last name
alone (`motor_angle_deg` for `data.motor_angle_deg`) if only one column has that name.
"""

import difflib
import json
import re
from collections.abc import Collection, Sequence

from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._dataset_file import DatasetFile, PartFile
from cc_mujoco.errors import CableError, naming
from cc_mujoco.report._html import list_words

DATASET_FILE = "dataset.toml"


def stamp_columns(names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return (seconds, nanoseconds) columns of ROS time stamps, by the stamp's name."""
    found = {}
    nanoseconds = {"sec": ("nanosec", "nsec"), "secs": ("nsecs",)}
    for name in names:
        if (stamp := re.fullmatch(r"(.*stamp[._/])(secs?)", name)) is not None:
            for nano in nanoseconds[stamp[2]]:
                if stamp[1] + nano in names:
                    found[stamp[1][:-1]] = (name, stamp[1] + nano)
    return found


def columns_named(name: str, names: Sequence[str]) -> list[str]:
    if name in names:
        return [name]
    return [full for full in names if channels.bare_name(full) == name]


def find_column(
    where: str, what: str, name: str, names: Sequence[str], used: Sequence[str] = ()
) -> str:
    """Return the column `name`; its error proposes none that is `used` by others."""
    column = _only_column(where, columns_named(name, names), what)
    if column is None:
        raise _missing_column(where, what, name, names, used)
    return column


def _only_column(where: str, places: Sequence[str], channel: str) -> str | None:
    distinct = list(dict.fromkeys(places))
    if len(distinct) > 1:
        raise CableError(
            f"{where} has {' and '.join(distinct)}; say in {DATASET_FILE} which of "
            f"them is {channel}: [columns.{channel}], name."
        )
    return distinct[0] if distinct else None


def time_column(
    where: str, names: Sequence[str], given: PartFile, file: DatasetFile
) -> tuple[str, str]:
    if given.time is not None:
        places = [find_column(where, channels.TIME, given.time, names)]
    else:
        places = _spelled_columns(channels.TIME, names)
        # PlotJuggler calls it `__time`.
        places = places or columns_named("__time", names) or [*stamp_columns(names)]
    name = _only_column(where, places, channels.TIME)
    if name is None:
        absent = [c for c in channels.REQUIRED_CHANNELS if _is_absent(c, names, file)]
        if draft := _draft(where, absent, names, file):
            raise CableError(draft)
        raise _missing_column(where, channels.TIME, channels.TIME, names)
    spelled = channels.unit_of(name, channels.CLOCK)
    return name, given.unit or spelled or channels.CLOCK.unit


def channel_sources(
    where: str, names: Sequence[str], file: DatasetFile, others: Collection[str] = ()
) -> dict[str, str]:
    """Return the column of every channel of a trial but its time.

    `where` names the trial in errors, and `names` are its columns. `others` are joints
    besides the driven one whose angles are needed. A torque may be missing if something
    replaces it, see `DatasetFile.has_substitute`.
    """
    with naming(where):
        tensions = [channels.tension_channel(channels.bare_name(n)) for n in names]
    optional = [channel for channel in tensions if channel]
    optional += [channels.MOTOR_CURRENT, channels.TEMPERATURE, channels.VALID]
    found: dict[str, str] = {}
    absent = []
    needed = [channels.other_angle(joint) for joint in others]
    for channel in file.columns:
        if channels.is_other_angle(channel) and channel not in needed:
            known = [*channels.REQUIRED_CHANNELS, *needed]
            raise CableError.unknown(f"channel in {file.path}", channel, known)
    needed += channels.MAIN_CHANNELS
    for channel in dict.fromkeys([*needed, *file.columns, *optional]):
        source = file.source(channel)
        if channel == channels.TIME or not source.measured:
            continue
        column: str | None
        if source.name is not None:
            rest = [file.source(other).name for other in file.columns]
            used = [other for other in rest if other and other != source.name]
            column = find_column(where, channel, source.name, names, used)
        else:
            column = _only_column(where, _spelled_columns(channel, names), channel)
        if column is not None:
            found[channel] = column
        elif channel in needed or channel in file.columns:
            absent.append(channel)
    absent = [
        channel
        for channel in absent
        if not (channel in channels.TORQUES and file.has_substitute(channel, found))
    ]
    if draft := _draft(where, absent, names, file):
        raise CableError(draft)
    for channel in absent:
        taken = list(found.values())
        raise _missing_column(where, channel, channel, names, taken)
    return found


def _spelled_columns(channel: str, names: Sequence[str]) -> list[str]:
    own = channels.spellings(channel)
    return [full for word in own for full in columns_named(word, names)]


def _is_absent(channel: str, names: Sequence[str], file: DatasetFile) -> bool:
    source = file.source(channel)
    mapped = source.name is not None or not source.measured
    return not (mapped or _spelled_columns(channel, names))


def _draft(
    where: str, absent: Sequence[str], names: Sequence[str], file: DatasetFile
) -> str:
    """Return an error that maps several `absent` channels, "" if no more than one.

    Its lines are TOML as it is, with the unit that a column's name ends in, or SI.
    """
    lines: list[str] = []
    used = {file.source(channel).name for channel in file.columns}
    for channel in absent:
        free = _free_columns(channel, [name for name in names if name not in used])
        free = [n for n in free if channel.partition("_")[0] in _sides(n)] or free
        measured = channels.kind_of(channel)
        same_kind = [name for name in free if channels.unit_of(name, measured)]
        spelled = channel.rpartition("_")[0].replace("_", " ")
        column = _nearest_name(spelled, same_kind, 0.0) or _nearest_name(spelled, free)
        if column:
            used.add(column)
            unit = channels.unit_of(column, measured) or measured.unit
            pair = f"name = {_quoted(column)}, unit = {_quoted(unit)}"
            lines.append(f"columns.{channel} = {{ {pair} }}")
    if len(lines) < 2:
        return ""
    listing = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    return (
        f"{where} has no columns {list_words(absent)}, only {listing}; check these "
        f"lines and put them at the top of {DATASET_FILE}:\n" + "\n".join(lines) + "\n"
    )


def _quoted(text: str) -> str:
    return repr(text) if "'" not in text and text.isprintable() else json.dumps(text)


def _free_columns(channel: str, names: Sequence[str]) -> list[str]:
    taken = set[str]().union(*map(channels.spellings, channels.REQUIRED_CHANNELS))
    return [
        name
        for name in names
        if name not in taken
        and not channels.tension_channel(name)
        and not _names_other_side(name, channel)
    ]


def _missing_column(
    where: str, channel: str, name: str, names: Sequence[str], used: Sequence[str] = ()
) -> CableError:
    listing = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    if channel != name:
        able = [n for n in names if n not in used and not _names_other_side(n, channel)]
        near = _nearest_name(name, able)
        hint = f" (is it {near!r}?)" if near else ""
        return CableError(
            f"{where} has no column {name!r} for {channel}{hint}: {listing}."
        )
    missing = f"{where} has no column {channel!r}, only {listing}"
    if twice := [n for n in dict.fromkeys(names) if names.count(n) > 1]:
        missing += f" ({' and '.join(map(repr, twice))} more than once)"
    measured = channels.kind_of(channel)
    free = _free_columns(channel, [name for name in names if name not in used])
    same_kind = [n for n in free if channels.unit_of(n, measured)]
    if column := _nearest_name(name, same_kind, 0.0):
        return CableError(
            f"{missing}; if it is {column!r}, say so in {DATASET_FILE}, which converts "
            f"it: [columns.{channel}] name = {column!r}, unit = "
            f"{channels.unit_of(column, measured)!r}."
        )
    others = [n for n in free if channels.explain_unknown_column(n)]
    plain = [n for n in free if n not in others]
    if near := _nearest_name(name, plain):
        missing += f" (is it {near!r}?)"
    elif other := _nearest_name(name, others, 0.4):
        return CableError(
            f"{missing}; {other!r} is {channels.explain_unknown_column(other)}."
        )
    listing = f"{missing}; rename one or map it in {DATASET_FILE}"
    if channel in channels.TORQUES:
        listing += f", or declare [columns.{channel}] measured = false"
    if channel == channels.MOTOR_ANGLE:
        listing += (
            f", or declare [columns.{channel}] measured = false; without this angle "
            "there is nothing to play through the cables, and only their loss by "
            "direction and load can be found"
        )
    if channel == channels.JOINT_ANGLE:
        listing += "; without this angle there is nothing to play through the cables"
    if channels.is_other_angle(channel):
        listing += "; this joint moves a cable, too, so its angle must be recorded"
    return CableError(f"{listing}.")


def _names_other_side(column: str, channel: str) -> bool:
    side, named = channel.partition("_")[0], _sides(column)
    return side in _SIDES and bool(named) and side not in named


_SIDES = {
    "motor": "motor drive actuator proximal input pulley",
    "joint": "joint handle output distal load finger wrist elbow shoulder hip knee "
    "ankle",
}


def _sides(column: str) -> list[str]:
    """Return the sides of the transmission that a column's name states."""
    word = column.lower()
    named = [s for s, words in _SIDES.items() if any(w in word for w in words.split())]
    short = {"m": "motor", "mot": "motor", "j": "joint", "jnt": "joint"}
    parts = re.split(r"[^a-z]+", re.sub(r"\bn[ .*]m\b", "", word))
    return [*named, *(short[part] for part in parts if part in short)]


def _nearest_name(name: str, names: Sequence[str], cutoff: float = 0.6) -> str:
    return next(iter(difflib.get_close_matches(name, names, 1, cutoff)), "")
