"""Files of a device, found by its name or path without loading MuJoCo.

    locate("wirst")                        # CableError: did you mean 'wrist'?

So a command refuses a misspelt name before anything is compiled.
"""

from __future__ import annotations

import os
from pathlib import Path

from cc_mujoco._utils.toml_table import read_toml
from cc_mujoco.assets import SCENES, scene_path
from cc_mujoco.device._description import ENDING
from cc_mujoco.errors import CableError

FILE_ENDINGS = (".xml", ".toml")


def is_device_file(source: str | Path) -> bool:
    """Return whether a device is given by a file, not by the name of a built-in one."""
    return str(source) not in SCENES and Path(source).suffix in FILE_ENDINGS


def locate(source: str | Path) -> tuple[str, Path, Path | None]:
    """Return the name of a device, its scene and the file of its description."""
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
            f"{name} is no MJCF file of a device (.xml, in lower case) or TOML file."
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
        scene_name = read_toml(path).text("scene") or f"{stem}.xml"
        scene = path.parent / scene_name
        if not scene.is_file():
            raise CableError(
                f"{path}: there is no scene {scene}; write its path as `scene`."
            )
        return name, scene, path
    beside = path.with_suffix(ENDING)
    if os.path.lexists(beside) and not beside.is_file():
        raise CableError(f"{beside}, the description of {name}, is no file.")
    return name, path, beside if beside.is_file() else None
