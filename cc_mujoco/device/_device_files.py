"""Files of a device, found by its name or path without loading MuJoCo.

    locate("wirst")                        # CableError: did you mean 'wrist'?

A command thus refuses a misspelt name before anything is compiled. Beside a scene
`endoscope.xml`, `endoscope.hysteresis.toml` may give parameters of controllers:

    [bend.backlash_inverse]                # axis and controller
    slope_up = 1.58
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco._utils.toml_table import Table, finite, read_toml
from cc_mujoco.assets import SCENES, scene_path
from cc_mujoco.device._description import ENDING
from cc_mujoco.errors import CableError

SCENE_ENDINGS = (".xml", ".mjz", ".urdf")
FILE_ENDINGS = (*SCENE_ENDINGS, ".toml")


def is_device_file(source: str | Path) -> bool:
    """Return whether `source` ends as a device file and is no built-in name."""
    return str(source) not in SCENES and Path(source).suffix in FILE_ENDINGS


def locate(source: str | Path) -> tuple[str, Path, Path | None]:
    """Return name, path of the scene and path of the description, None without one."""
    if not isinstance(source, str | Path):
        raise CableError(
            f"device must be a name, the path of a file or a Device, not {source!r}."
        )
    name = str(source)
    if isinstance(source, str) and name in SCENES:
        scene = scene_path(name)
        table = scene.with_suffix(ENDING)
        return name, scene, table if table.is_file() else None
    path = Path(source)
    if path.suffix not in FILE_ENDINGS and path.is_file():
        raise CableError(
            f"{name} is no model of a device, whose name ends in "
            f"{', '.join(SCENE_ENDINGS)} (in lower case), nor its description (.toml)."
        )
    if path.is_dir():
        raise CableError(f"{name} is a folder; give the MJCF file of a device in it.")
    if path.suffix not in FILE_ENDINGS:
        raise CableError(
            f"{CableError.unknown('device', name, SCENES)} A device of your own is "
            "given by its MJCF file, for example knee.xml."
        )
    if not path.is_file():
        raise CableError(f"there is no file {name}; give an MJCF file of a device.")
    if path.suffix == ".toml":
        stem = path.name.removesuffix(ENDING).removesuffix(".toml")
        given = read_toml(path).text("scene")
        tried = [path.parent / (given or stem + ending) for ending in SCENE_ENDINGS]
        scene = next((file for file in tried if file.is_file()), tried[0])
        if not scene.is_file():
            raise CableError(
                f"{path}: there is no scene {scene}; write its path as `scene`."
            )
        return name, scene, path
    beside = path.with_suffix(ENDING)
    if os.path.lexists(beside) and not beside.is_file():
        raise CableError(f"{beside}, the description of {name}, is no file.")
    return name, path, beside if beside.is_file() else None


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
    """Write the parameters of an axis from `control.fit_hysteresis` to a new file."""
    place = Path(path)
    if place.exists():
        raise CableError(
            f"{place} is there and is not overwritten; remove it, or name another file."
        )
    lines = ["# Hysteresis of the device, written by `cc-mujoco calibrate`."]
    for law, values in parameters.items():
        lines += ["", f"[{axis}.{law}]"]
        for key, value in values.items():
            given = list(value) if isinstance(value, (list, tuple)) else value
            lines.append(f"{key} = {given!r}")
    with replacing(place) as partial:
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8")
