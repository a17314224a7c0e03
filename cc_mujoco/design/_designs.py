"""Designs that a study simulates: a grid, a Latin hypercube, or a list from a file.

    vary = {"friction": "0.05:0.3:10", "loops": [1, 2, 3]}
    grid(vary)                      # 30 designs
    latin_hypercube(vary, 100, seed=0)

A range is written `low:high:count`, or `low:high:count:log` for equal ratios; values
are separated by commas. Samples and searches need no count.
"""

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.csv_files import read_sheet
from cc_mujoco._utils.toml_table import read_toml
from cc_mujoco.cable._parameter import Parameter
from cc_mujoco.design._whatif_options import Given
from cc_mujoco.device import Nominal
from cc_mujoco.device._variables import VARIABLES, Value, find
from cc_mujoco.errors import CableError

MAX_DESIGNS = 1_000_000
"""Largest number of designs, limited by memory and time: each takes about a second."""


@dataclass(frozen=True)
class Range:
    """Values that a variable may take: listed levels, or all between two ends."""

    levels: tuple[Value, ...]  # levels of a grid; empty where a range has no count
    ends: tuple[float, float] | None = None  # None where only the levels are meant
    log: bool = False

    def at(self, share: NDArray[np.float64]) -> list[Value]:
        """Return the values at fractions `share` of the range, from 0 to 1."""
        if self.ends is None:
            count = len(self.levels)
            places = np.minimum((share * count).astype(int), count - 1)
            return [self.levels[place] for place in places]
        return [float(value) for value in _between(self.ends, self.log, share)]

    def code(self, given: Sequence[Value]) -> NDArray[np.float64]:
        """Return values scaled to 0...1 (n,), texts by index, by ratio if `log`."""
        if self.ends is None and any(isinstance(each, str) for each in self.levels):
            place = {level: i for i, level in enumerate(self.levels)}
            return np.array([place[value] for value in given]) / (len(place) - 1.0)
        found = np.array(given, dtype=np.float64)
        levels = np.array(self.ends or self.levels, dtype=np.float64)
        low, high = levels.min(), levels.max()
        if self.log:
            low, high, found = np.log(low), np.log(high), np.log(found)
        return np.asarray((found - low) / (high - low))

    def shares(self, count: int) -> NDArray[np.float64]:
        """Return the fractions of the levels, or `count` ones from end to end."""
        if self.ends is not None:
            return np.linspace(0.0, 1.0, count)
        return (np.arange(len(self.levels)) + 0.5) / len(self.levels)


def read_range(
    name: str,
    given: Given,
    device: Nominal,
    among: Mapping[str, Parameter] = VARIABLES,
    kind: str = "variable",
) -> Range:
    variable = find(name, device.cables, device.axis_cables, among, kind)
    label = f"variable {name!r}"
    if isinstance(given, str) and ":" in given and not variable.text:
        found = _read_ends(name, given)
        for value in (*found.levels, *(found.ends or ())):
            variable.read(value, label)
        if variable.whole:
            whole = dict.fromkeys(round(float(level)) for level in found.levels)
            return Range(tuple(whole))
        return found
    words: Iterable[object] = given if isinstance(given, Iterable) else [given]
    if isinstance(given, str):
        words = [word.strip() for word in given.split(",")]
    levels = tuple(variable.read(word, label) for word in words)
    if not levels:
        raise CableError(f"variable {name!r} has no values; give one or more.")
    level, times = Counter(levels).most_common(1)[0]
    if times > 1:
        raise CableError(
            f"variable {name!r} is given {level!r} more than once; give it once."
        )
    return Range(levels)


def grid(ranges: Mapping[str, Range]) -> list[dict[str, Value]]:
    """Return every combination of the levels; the last variable varies fastest."""
    for name, values in ranges.items():
        if not values.levels:
            raise CableError(
                f"a grid needs to know how many values {name!r} takes; "
                "write low:high:count."
            )
    count = math.prod(len(values.levels) for values in ranges.values())
    require_count(count)
    rows = itertools.product(*(values.levels for values in ranges.values()))
    return [dict(zip(ranges, row, strict=True)) for row in rows]


def latin_hypercube(
    ranges: Mapping[str, Range], count: int, seed: int
) -> list[dict[str, Value]]:
    """Return `count` designs, one in each of `count` equal parts of every range."""
    from scipy.stats import qmc

    require_count(count)
    sampler = qmc.LatinHypercube(len(ranges), rng=np.random.default_rng(seed))
    unit = sampler.random(count)
    columns = [values.at(unit[:, i]) for i, values in enumerate(ranges.values())]
    return [dict(zip(ranges, row, strict=True)) for row in zip(*columns, strict=True)]


def from_file(path: str | Path) -> list[dict[str, object]]:
    """Read designs from CSV, or from tables `[[design]]` of TOML, without checks."""
    path = Path(path)
    read = {".csv": _from_csv, ".toml": _from_toml}.get(path.suffix.lower())
    if read is None:
        raise CableError(f"{path} is neither .csv nor .toml.")
    if not (designs := read(path)):
        raise CableError(f"{path} has no designs.")
    names = list(designs[0])
    for number, design in enumerate(designs, 1):
        if set(design) != set(names):
            raise CableError(
                f"{path}: design {number} sets {', '.join(design) or 'nothing'}, but "
                f"the first sets {', '.join(names)}; all must set the same."
            )
    return [{name: design[name] for name in names} for design in designs]


def _from_toml(path: Path) -> list[dict[str, object]]:
    found = read_toml(path, "the designs ").content
    if unknown := [name for name in found if name != "design"]:
        raise CableError(
            f"{path} has {unknown[0]!r}; it must have tables [[design]] and nothing "
            "else."
        )
    designs = found.get("design", [])
    if not isinstance(designs, list) or not all(isinstance(d, dict) for d in designs):
        raise CableError(f"{path}: `design` must be tables, [[design]].")
    return designs


def _from_csv(path: Path) -> list[dict[str, object]]:
    sheet = read_sheet(path, "the designs", lambda lines: require_count(max(1, lines)))
    names = sheet.names
    if twice := [name for name in names if names.count(name) > 1]:
        raise CableError(f"{path} names {twice[0]!r} twice; name every variable once.")
    designs: list[dict[str, object]] = []
    for line, values in sheet.rows:
        if len(values) != len(names):
            raise CableError(
                f"{path}, line {line}: it must have as many values as the first line "
                "has names."
            )
        designs.append(dict(zip(names, values, strict=True)))
    return designs


def _read_ends(name: str, text: str) -> Range:
    low_text, high_text, *rest = text.split(":")
    form = f"{name}={text} is no range; write low:high:count or low:high:count:log."
    try:
        low, high = float(low_text), float(high_text)
        log = rest[-1:] == ["log"]
        counts = rest[:-1] if log else rest
        count = int(counts[0]) if counts else 0
    except ValueError:
        raise CableError(form) from None
    if len(counts) > 1:
        raise CableError(form)
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise CableError(
            f"the range {name}={text} must rise from its low to its high end."
        )
    if counts and not 2 <= count <= MAX_DESIGNS:
        raise CableError(
            f"the range {name}={text} must have 2 to {MAX_DESIGNS:,} values."
        )
    if log and low <= 0.0:
        raise CableError(f"the range {name}={text} must be above 0 to be logarithmic.")
    shares = np.linspace(0.0, 1.0, count)
    levels = [float(value) for value in _between((low, high), log, shares)]
    return Range(tuple(levels), (low, high), log)


def _between(
    ends: tuple[float, float], log: bool, share: NDArray[np.float64]
) -> NDArray[np.float64]:
    low, high = ends
    inside = low * (high / low) ** share if log else low + (high - low) * share
    found: NDArray[np.float64] = np.where(share == 1.0, high, inside)
    return found


def require_count(count: int) -> None:
    """Refuse, before designs are made, a number of them too large for a study."""
    if not isinstance(count, (int, np.integer)) or isinstance(count, bool):
        raise CableError(f"a number of designs must be whole, not {count!r}.")
    if not 1 <= count <= MAX_DESIGNS:
        fewer = "; a Latin hypercube covers many variables with few designs"
        raise CableError(
            f"a study must have 1 to {MAX_DESIGNS:,} designs, not {count:,}"
            f"{fewer if count > 1 else ''}."
        )
