"""Costs of parts: a small table that is meant to be replaced.

    read_costs("mine.csv")          # part,per,cost with a line for each part

`costs.csv` beside this file has round figures that are only an example. A line for a
motor of `MOTORS` or a material of `MATERIALS` goes before that of `motor` or `rope`.
"""

from __future__ import annotations

import math
from pathlib import Path

from cc_mujoco.csv_files import read_sheet
from cc_mujoco.errors import CableError
from cc_mujoco.plant import MATERIALS, MOTORS

EXAMPLE = Path(__file__).with_name("costs.csv")
"""The table that holds unless another is given."""

PARTS = {
    "motor": "piece",
    "pulley": "piece",
    "rope": "m",
    "conduit": "m",
    "fittings": "cable",
}
"""Parts that every table has, and what a cost is per."""

_ALLOWED = (
    PARTS
    | dict.fromkeys(MOTORS, PARTS["motor"])
    | dict.fromkeys(MATERIALS, PARTS["rope"])
)
_HEAD = ["part", "per", "cost"]


def read_costs(path: str | Path = EXAMPLE) -> dict[str, float]:
    """Costs by part, in whatever money the table is in.

    Raises:
        CableError: the file is no such table; says where and what would be right.
    """
    path = Path(path)
    sheet = read_sheet(path, "the costs")
    if sheet.names != _HEAD:
        raise CableError(f"{path} must begin with the line {','.join(_HEAD)}.")
    found: dict[str, float] = {}
    for _, row in sheet.rows:
        if len(row) != len(_HEAD):
            raise CableError(f"{path}: the line {','.join(row)!r} must have 3 cells.")
        part, per, amount = row
        if part not in _ALLOWED:
            raise CableError.unknown("part", part, _ALLOWED)
        if part in found:
            raise CableError(f"{path} gives the cost of {part!r} twice.")
        if per != _ALLOWED[part]:
            raise CableError(
                f"{path}: the cost of {part!r} must be per {_ALLOWED[part]}, not per "
                f"{per!r}."
            )
        try:
            cost = float(amount)
        except ValueError:
            cost = math.nan
        if not 0.0 <= cost < math.inf:
            raise CableError(
                f"{path}: the cost of {part!r} must be a number of at least 0, not "
                f"{amount!r}."
            )
        found[part] = cost
    if missing := [part for part in PARTS if part not in found]:
        raise CableError(f"{path} lacks the cost of {', '.join(missing)}.")
    return found
