"""Columns of numbers from tables that OpenSim, Moco and AddBiomechanics write.

A header that ends with the line `endheader` stands above the table, whose cells tabs,
blanks or commas separate. Its columns have names without units; a unit is appended
here: `time_s`, `knee_angle_r_deg` if the header has `inDegrees=yes` (`_rad` for `no`),
`knee_angle_r_moment_nm`. Lengths, such as `pelvis_tx`, and all angles of a file without
`inDegrees` keep their names. A state of Moco, `/jointset/knee_r/knee_angle_r/value`, is
named by its coordinate; Moco's other states and controls keep their names.
"""

import re
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cc_mujoco._utils.array_files import FloatArray
from cc_mujoco.errors import CableError, CableWarning


class Coordinate(NamedTuple):
    """Coordinate of OpenSim's models: the joint, and what its two signs mean."""

    joint: str
    positive: str
    negative: str


COORDINATES = {
    "hip_flexion": Coordinate("hip", "flexion", "extension"),
    "knee_angle": Coordinate("knee", "extension", "flexion"),
    "ankle_angle": Coordinate("ankle", "dorsiflexion", "plantarflexion"),
    "lumbar_extension": Coordinate("lumbar", "extension", "flexion"),
    "arm_flex": Coordinate("shoulder", "flexion", "extension"),
    "elbow_flex": Coordinate("elbow", "flexion", "extension"),
    "wrist_flex": Coordinate("wrist", "flexion", "extension"),
}
"""Coordinates by their names without `_r` and `_l`: those of gait2354, gait2392 and
Hamner2010, and the same but for the knee of Rajagopal2016, whose flexion is positive
(https://github.com/opensim-org/opensim-models; its issue 127 compares the knees)."""


def has_header(path: Path) -> bool:
    with path.open("rb") as file:
        return bool(re.search(rb"(?mi)^[ \t]*endheader[ \t\r]*$", file.read(1 << 16)))


def coordinate(column: str) -> str:
    """Return a column's name without the path that Moco writes around a coordinate."""
    found = re.fullmatch(r"(?:.*/)?([^/]+)/value|/jointset/[^/]+/([^/]+)", column)
    return (found[1] or found[2]) if found else column


def _header(path: Path) -> tuple[list[str], int, dict[str, str]]:
    """Return names of columns, the number of their line, and the header's entries."""
    ended, facts = False, dict[str, str]()
    with path.open(encoding="utf-8-sig") as file:
        for count, line in enumerate(file, start=1):
            text = line.strip().lower()
            if ended and text:
                unit = {"yes": "_deg", "no": "_rad"}.get(facts.get("indegrees", ""), "")
                columns = line.replace(",", " ").split()
                return [_with_unit(c, unit) for c in columns], count, facts
            ended |= text == "endheader"
            key, equals, value = text.partition("=")
            if equals:
                facts[key.strip()] = value.strip()
    raise CableError(
        f"{path} is no OpenSim file; a line 'endheader' and then one that names "
        "the columns must stand above the data."
    )


def _with_unit(column: str, angle: str) -> str:
    """Return a column's name with its unit; `angle` is the unit of joint angles."""
    name = coordinate(column)
    word = name.lower()
    if word == "time":
        return "time_s"
    if "/" in name or word.endswith(("_tx", "_ty", "_tz")):
        return name
    if word.endswith("_moment"):
        return f"{name}_nm"
    return name + ("_n" if word.endswith("_force") else angle)


def column_names(path: Path) -> list[str]:
    return _header(path)[0]


def read_columns(
    path: Path, wanted: Iterable[str], _switches: Iterable[str] = ()
) -> dict[str, FloatArray]:
    """Return columns (rows,) by name; warn if the header miscounts rows or columns."""
    names, top, facts = _header(path)
    rows: list[list[float]] = []
    with path.open(encoding="utf-8-sig") as file:
        for number, line in enumerate(file, start=1):
            if number <= top or not line.strip():
                continue
            cells = line.replace(",", " ").split()
            try:
                rows.append([float(cell) for cell in cells])
            except ValueError as error:
                raise CableError(
                    f"{path}, line {number}: {error}; every cell must be a number."
                ) from None
            if len(cells) != len(names):
                raise CableError(
                    f"{path}, line {number} has {len(cells)} cells; it must have the "
                    f"{len(names)} that line {top} names."
                )
    for key, count in (("nRows", len(rows)), ("nColumns", len(names))):
        stated = facts.get(key.lower(), str(count))
        if stated != str(count):
            warnings.warn(
                f"{path}: its header has {key}={stated}, but there are {count}; all of "
                "these are read.",
                CableWarning,
                stacklevel=4,
            )
    table = np.array(rows, dtype=float).reshape(-1, len(names))
    return {name: table[:, names.index(name)].copy() for name in wanted}
