"""Columns of numbers from OpenSim's motion and storage files, `.mot` and `.sto`.

Their columns have names without units; a unit is appended here: `time_s`,
`knee_angle_r_deg` if the header has `inDegrees=yes` (`_rad` for `no`),
`knee_angle_r_moment_nm`. Lengths, such as `pelvis_tx`, and all angles of a file without
`inDegrees` keep their names. A state of Moco, `/jointset/knee_r/knee_angle_r/value`, is
named by its coordinate; Moco's other states and controls keep their names.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from cc_mujoco._utils.array_files import FloatArray
from cc_mujoco.errors import CableError


def _header(path: Path) -> tuple[list[str], int]:
    degrees, ended, suffix = {"yes": "_deg", "no": "_rad"}, False, ""
    with path.open(encoding="utf-8-sig") as file:
        for count, line in enumerate(file, start=1):
            text = line.strip()
            if ended and text:
                return [_with_unit(column, suffix) for column in line.split()], count
            if text.lower() == "endheader":
                ended = True
            elif found := re.fullmatch(r"indegrees\s*=\s*(yes|no)", text.lower()):
                suffix = degrees[found[1]]
    raise CableError(
        f"{path} is no OpenSim file; a line 'endheader' and then one that names "
        "the columns must stand above the data."
    )


def _with_unit(column: str, angle: str) -> str:
    """Return a column's name with its unit; `angle` is the unit of joint angles."""
    name = re.sub(r"/.*/([^/]+)/value", r"\1", column)
    word = name.lower()
    if word == "time":
        return "time_s"
    if name.startswith("/") or word.endswith(("_tx", "_ty", "_tz")):
        return name
    if word.endswith("_moment"):
        return f"{name}_nm"
    return name + ("_n" if word.endswith("_force") else angle)


def column_names(path: Path) -> list[str]:
    return _header(path)[0]


def read_columns(
    path: Path, wanted: Iterable[str], _switches: Iterable[str] = ()
) -> dict[str, FloatArray]:
    names, top = _header(path)
    rows: list[list[float]] = []
    with path.open(encoding="utf-8-sig") as file:
        for number, line in enumerate(file, start=1):
            cells = line.split()
            if number <= top or not cells:
                continue
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
    table = np.array(rows, dtype=float).reshape(-1, len(names))
    return {name: table[:, names.index(name)].copy() for name in wanted}
