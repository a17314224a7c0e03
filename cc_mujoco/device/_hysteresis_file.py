"""File of a device's hysteresis parameters, beside its scene.

endoscope.hysteresis.toml, beside endoscope.xml

[bend.backlash_inverse]         # axis and controller
slope_up = 1.58
...
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco._utils.toml_table import Table, finite
from cc_mujoco.errors import CableError

HYSTERESIS_ENDING = ".hysteresis.toml"
Parameters = dict[str, dict[str, Any]]
"""Numbers and lists of numbers by controller and name."""


def hysteresis_of(table: Table) -> dict[str, Parameters]:
    found: dict[str, Parameters] = {}
    for axis in table.content:
        for law, values in table.tables(axis).items():
            for key, value in values.content.items():
                listed = value if isinstance(value, list) else [value]
                if not listed or any(finite(number) is None for number in listed):
                    raise values.wrong(key, "a finite number or a list of them")
            found.setdefault(axis, {})[law] = dict(values.content)
    return found


def write_hysteresis(
    path: str | os.PathLike[str], axis: str, parameters: Mapping[str, Mapping[str, Any]]
) -> None:
    """Write the file of an axis, which must not be there.

    `parameters` are those of `control.fit_hysteresis`.
    """
    place = Path(path)
    if place.exists():
        raise CableError(
            f"{place} is there and is not overwritten; remove it, or name another file."
        )
    lines = ["# Hysteresis of the device, written by `cc-mujoco calibrate`."]
    for law, values in parameters.items():
        lines += ["", f"[{axis}.{law}]"]
        for key, value in values.items():
            listed = isinstance(value, (list, tuple))
            text = ", ".join(f"{number!r}" for number in (value if listed else [value]))
            lines.append(f"{key} = [{text}]" if listed else f"{key} = {text}")
    with replacing(place) as partial:
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8")
