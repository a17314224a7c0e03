"""A device: a MuJoCo scene with motors and cables, and its description.

    device = Device("knee.xml")            # with knee.device.toml, if that is there
    device.description.axes[0].joint       # 'knee'
    Device("wrist")                        # one that ships with the package

A device is given by the name of a built-in scene, by an MJCF file or by the TOML file
of its description. Every function that takes a device accepts these three.
"""

import re
import threading
from collections.abc import Container, Iterable, Mapping
from functools import cached_property, lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import mujoco

from cc_mujoco import plugin
from cc_mujoco._utils import user_code
from cc_mujoco._utils.toml_table import Table, read_toml
from cc_mujoco.assets import SCENES, scene_path
from cc_mujoco.cable import Cable
from cc_mujoco.device import _strip_visuals as stripping
from cc_mujoco.device._derivation import describe
from cc_mujoco.device._description import Description
from cc_mujoco.device._device_files import HYSTERESIS_ENDING, locate
from cc_mujoco.device._mover import Mover
from cc_mujoco.errors import CableError
from cc_mujoco.human import TASKS, TRAJECTORIES, Wearer
from cc_mujoco.plugin._spec import read_spec

_ONE = threading.Lock()


class Nominal:
    """Description, cables and wearers of a device, before any value is changed."""

    def __init__(
        self,
        description: Description,
        cables: Mapping[str, Cable],
        wearers: Mapping[str, Wearer],
    ) -> None:
        self.description, self.cables, self.wearers = description, cables, wearers

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Names of the axes, in the order of the description."""
        return tuple(self.axis_cables)

    @cached_property
    def axis_cables(self) -> dict[str, tuple[str, ...]]:
        """Names of the cables that each axis's motor winds, by the axis's name."""
        return {axis.name: tuple(axis.cables) for axis in self.description.axes}


class Device(Nominal):
    """A device with the values of its scene; a `Plant` changes some of them."""

    def __init__(
        self, source: str | Path, timestep: float | None = None, **given: Any
    ) -> None:
        """Read the scene and its description.

        `source` is the name of a built-in scene, or the path of an MJCF file (`*.xml`)
        or a description (`*.toml`). `timestep` is that of the physics [s], by default
        the scene's. Keys in `given` replace those of the description, for example
        `trajectory="sine"` or `axis={"safe_torque": 40.0}`.
        """
        name, scene, table_path = locate(source)
        spec = read_spec(scene)
        table = Table(name, {})
        if table_path is not None:
            table = _resolved(read_toml(table_path), table_path.parent)
            named = table.text("scene")
            meant = scene if named is None else table_path.parent / named
            if meant.resolve() != scene.resolve():
                raise CableError(
                    f"{table_path} is the description of {named}, not of {scene.name}; "
                    "correct its `scene`, or give it another name."
                )
        measured = hysteresis_path(scene)
        if measured is not None:
            known = read_toml(measured)
            table = Table(table.where, {"hysteresis": known.content, **table.content})
        self.files = _user_files(name, scene, table_path, measured)
        """Files of the user that define the device: scene, description and what these
        include."""
        # Kept alive, as its copies, such as `spec`, refer to it.
        self._original: mujoco.MjSpec | None = None
        self.path: Path | None = scene
        """Path of the scene; None where the device was made of a specification."""
        self._read(spec, name, table, timestep, given)

    @classmethod
    def from_mjcf(cls, path: str | Path, **given: Any) -> "Device":
        """Read an MJCF file and its description; see `Device` for `given`, errors."""
        return cls(Path(path), **given)

    @classmethod
    def from_spec(
        cls, spec: mujoco.MjSpec, name: str = "device", **given: Any
    ) -> "Device":
        """Make a device from a MuJoCo specification, for example one with `add_cable`.

        The specification is copied. `given` are keys of a description, see `Device`.
        """
        made = cls.__new__(cls)
        made.files, made.path = (), None
        made._original = spec
        made._read(spec.copy(), name, Table(name, {}), None, given)
        return made

    def variant(self, scene: str | Path) -> "Device":
        """Return a device with the description of this one and another scene.

        `scene` is the path of an MJCF file, for example of one that a diagnosis wrote.
        """
        path = Path(scene)
        if not path.is_file():
            raise CableError(f"there is no file {scene}; give an MJCF file.")
        made = Device.__new__(Device)
        made.files, made.path = tuple(_files_of(path)), None
        made._original = spec = read_spec(path)
        made._read(spec.copy(), str(path), self._table, self.timestep, {})
        return made

    def _read(
        self,
        spec: mujoco.MjSpec,
        name: str,
        table: Table,
        timestep: float | None,
        given: Mapping[str, Any],
    ) -> None:
        self._given = dict(given)
        self._table = table = Table(table.where, _merged(table.content, given))
        description = describe(spec, name, table)
        # After it, since the control period is that of the scene's own time step.
        if timestep is not None:
            spec.option.timestep = timestep
        self.name, self.timestep, self.spec = name, timestep, spec
        model = spec.copy().compile()
        self.movers = {
            joint: Mover.of(model, name) for joint, name in description.movers.items()
        }
        """Wearer at every joint that it moves."""
        wearers = {joint: mover.wearer for joint, mover in self.movers.items()}
        super().__init__(description, plugin.from_mjcf(spec), wearers)
        ends = {
            name: tuple(a for a in spec.actuators if a.plugin.name == name)
            for name in self.cables
        }
        self.ends = MappingProxyType(ends)
        """Actuators of each cable, that of the proximal end first."""
        self.radii = MappingProxyType({
            name: tuple(abs(float(end.gear[0])) for end in both)
            for name, both in ends.items()
        })  # fmt: skip
        """Pulley radii by cable, proximal and distal [m]; of a lever the gear of its
        tendon."""
        self._bare: dict[tuple[str, ...], mujoco.MjSpec] = {}

    def __reduce__(self) -> Any:
        if self.path is None:
            raise CableError(
                f"device {self.name!r} was made of a specification, which another "
                "process cannot have: write it to a file and give its path."
            )
        return _restored, (self.name, self.timestep, self._given, user_code.allowed())

    @property
    def frame_skip(self) -> int:
        """Physics steps between two calls of a controller."""
        return self.description.frame_skip(float(self.spec.option.timestep))

    def stripped(self, kept: tuple[str, ...]) -> mujoco.MjSpec:
        """Return the scene without visual elements, except the tendons in `kept`."""
        with _ONE:  # two threads would each make a scene, and one would be freed in use
            if kept not in self._bare:
                self._bare[kept] = stripping.strip(self.spec, kept)
            return self._bare[kept]

    def xml(self) -> str:
        """Return the MJCF of the scene."""
        if self.name in SCENES and not self._given:
            return scene_path(self.name).read_text(encoding="utf-8")
        return str(self.spec.to_xml())


def find_device(source: str | Path | Device) -> Device:
    """Return the device of a name or a file; a `Device` is returned unchanged."""
    if isinstance(source, Device):
        return source
    if not str(source):
        raise CableError(
            "no device is given; `device` takes its name, its MJCF file or a Device."
        )
    return load_device(source)


def load_device(
    source: str | Path, timestep: float | None = None, allow: str | Iterable[str] = ()
) -> Device:
    """Return a device; repeated calls share one until a file of it changes.

    For `source` and `timestep` see `Device`. `allow` has `MODULE:NAME` of the user code
    that the files of the device may import.
    """
    user_code.allow(allow)
    name, scene, table = locate(source)
    files = _user_files(name, scene, table, hysteresis_path(scene))
    stamps = tuple((str(f), f.stat().st_mtime_ns, f.stat().st_size) for f in files)
    return _load(name, timestep, (stamps, user_code.allowed()))


@lru_cache(maxsize=32)
def _load(name: str, timestep: float | None, _key: tuple[Any, ...]) -> Device:
    return Device(name, timestep)


def _restored(
    name: str, timestep: float | None, given: dict[str, Any], names: tuple[str, ...]
) -> Device:
    """Unpickle a device in another process; `names` is the user code it may import."""
    user_code.allow(names)
    return Device(name, timestep, **given) if given else load_device(name, timestep)


def hysteresis_path(scene: Path) -> Path | None:
    """Return the `*.hysteresis.toml` beside a scene, or None without one."""
    beside = scene.with_suffix(HYSTERESIS_ENDING)
    return beside if beside.is_file() else None


def _user_files(name: str, scene: Path, *beside: Path | None) -> tuple[Path, ...]:
    """Return the files that define a user's device; () for a built-in one."""
    if name in SCENES:
        return ()
    return (*_files_of(scene), *(one for one in beside if one is not None))


def _files_of(scene: Path) -> list[Path]:
    """Return a scene and every existing file that it includes or loads."""
    found, waiting = [], [scene]
    while waiting:
        path = waiting.pop()
        if path in found:
            continue
        found.append(path)
        if path.suffix != ".xml":
            continue
        text = path.read_text(encoding="utf-8", errors="replace")
        value = r"""\s*=\s*["']([^"']*)["']"""  # of an attribute in XML
        folders = {"", *re.findall(rf"(?:mesh|texture|asset)dir{value}", text)}
        for name in re.findall(rf"\bfile{value}", text):
            for folder in folders:
                for base in (scene.parent, path.parent):
                    if (base / folder / name).is_file():
                        waiting.append(base / folder / name)
    return list(dict.fromkeys(found))


def _merged(content: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return `content` with the values of `given`, merged recursively in tables."""
    found = dict(content)
    for key, value in given.items():
        inner = found.get(key)
        if isinstance(value, Mapping) and isinstance(inner, Mapping):
            found[key] = _merged(inner, value)
        elif isinstance(value, Mapping) and isinstance(inner, list) and len(inner) == 1:
            found[key] = [_merged(inner[0], value)]
        elif value is not None:
            found[key] = dict(value) if isinstance(value, Mapping) else value
    return found


def _resolved(table: Table, folder: Path) -> Table:
    """Return a description with full paths of its `trajectory` and `task` files."""

    def beside(given: Any, key: str, free: Container[str]) -> Any:
        if not isinstance(given, str):
            return given
        if (folder / given).is_file():
            return str(folder / given)
        return user_code.named_in_file(
            given, table.where, key, free=free, deferred=True
        )

    def resolved(content: Any, key: str, free: Container[str]) -> Any:
        if not isinstance(content, dict) or key not in content:
            return content
        return {**content, key: beside(content[key], key, free)}

    content = resolved(table.content, "trajectory", TRAJECTORIES)
    if isinstance(axes := content.get("axis"), list):
        listed = [resolved(axis, "task", TASKS) for axis in axes]
        return Table(table.where, {**content, "axis": listed})
    if axes is not None:
        content = {**content, "axis": resolved(axes, "task", TASKS)}
    return Table(table.where, content)
