"""Columns of numbers from MCAP files, the recordings of ROS 2 and of Foxglove.

A column has the name of its topic and field, `/joint_states/position[0]`, as in
PlotJuggler. If a message names the elements of its arrays, as `sensor_msgs/JointState`
does, these are used: `/joint_states/position/knee`. There is a row for every message,
with NaN in the columns of other topics. `__time` is the time at which a message was
recorded [s]. Messages of ROS 2 and in JSON are decoded. The libraries mcap and
mcap-ros2-support are needed.
"""

from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from cc_mujoco._utils.array_files import FloatArray
from cc_mujoco._utils.parsing import one_sentence, parse_json
from cc_mujoco.errors import CableError


def column_names(path: Path) -> list[str]:
    return list(_table(path))


def read_columns(
    path: Path, names: Iterable[str], _switches: Iterable[str] = ()
) -> dict[str, FloatArray]:
    table = _table(path)
    return {name: table[name].copy() for name in names}


def _table(path: Path) -> dict[str, FloatArray]:
    """Return all columns (messages,) of a file by name, from a cache after one read."""
    with one_sentence(path, "`mcap recover` keeps what is whole"):
        seen = path.stat()
        return _read_table(path, seen.st_mtime_ns, seen.st_size)


@lru_cache(maxsize=4)
def _read_table(path: Path, _modified: int, _size: int) -> dict[str, FloatArray]:
    times: list[float] = []
    cells: dict[str, dict[int, float]] = {}  # by column and row
    undecoded: set[str] = set()
    for topic, encoding, time, message in _messages(path):
        if message is None:
            undecoded.add(encoding)
            continue
        numbers = list(_numbers(topic, message))
        for name, value in numbers:
            cells.setdefault(name, {})[len(times)] = value
        if numbers:
            times.append(1e-9 * time)
    if not times:
        kinds = ", ".join(sorted(undecoded))
        reason = f"its messages are {kinds}" if kinds else "it has none with numbers"
        raise CableError(
            f"{path} holds no message of ROS 2 (cdr) or in JSON that has numbers: "
            f"{reason}."
        )
    table = {"__time": np.array(times)}
    for name, found in cells.items():
        table[name] = np.full(len(times), np.nan)
        table[name][[*found]] = [*found.values()]
    return table


def _messages(path: Path) -> Iterator[tuple[str, str, int, Any]]:
    """Yield each message's topic, encoding, time [ns] and content (None if unknown)."""
    try:
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ModuleNotFoundError:
        raise CableError(
            f"{path} needs mcap to be read: pip install 'cc_mujoco[mcap]', or "
            "convert it to CSV."
        ) from None
    factory = DecoderFactory()
    decoders: dict[int, Callable[[bytes], Any] | None] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            encoding = channel.message_encoding
            if encoding == "json":
                decoders[channel.id] = parse_json
            elif channel.id not in decoders:
                decoders[channel.id] = factory.decoder_for(encoding, schema)
            decode = decoders[channel.id]
            content = None if decode is None else decode(message.data)
            yield channel.topic, encoding, message.log_time, content


def _numbers(name: str, value: Any) -> Iterator[tuple[str, float]]:
    if isinstance(value, bool | int | float):
        yield name, float(value)
    elif isinstance(value, str | bytes) or value is None:
        return
    elif isinstance(value, list | tuple):
        if len(value) <= 64:  # longer ones are images or scans
            for k, element in enumerate(value):
                yield from _numbers(f"{name}[{k}]", element)
    else:
        fields = value
        if not isinstance(value, dict):
            fields = {slot: getattr(value, slot) for slot in value.__slots__}
        labels = _labels(fields.get("name"))
        for key, inner in fields.items():
            if labels and isinstance(inner, list) and len(inner) == len(labels):
                for label, element in zip(labels, inner, strict=True):
                    yield from _numbers(f"{name}/{key}/{label}", element)
            else:
                yield from _numbers(f"{name}/{key}", inner)


def _labels(names: object) -> list[str]:
    """Return a message's field `name` if it lists distinct texts, else []."""
    if not isinstance(names, list) or len(set(map(str, names))) < len(names):
        return []
    return names if all(isinstance(name, str) and name for name in names) else []
