"""Report of a device: values from its scene, assumed values, unknown values.

print(account(device))
write_description(device, "knee.device.toml")
"""

import math
import os
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import NamedTuple

import mujoco

from cc_mujoco._utils.atomic_io import replacing, require_writable
from cc_mujoco._utils.user_code import without_mark
from cc_mujoco.device._derivation import UNITS
from cc_mujoco.device._description import ASSUMED, GIVEN, SCENE, Axis
from cc_mujoco.device._device import Device
from cc_mujoco.device._model import DeviceModel
from cc_mujoco.device._sensors import Sensing
from cc_mujoco.errors import CableError

ORIGINS = {GIVEN: "given", SCENE: "from the scene", ASSUMED: "assumed"}
SENSORS = {
    "torque_noise": ("N m", "standard deviation of the joint torque sensor"),
    "tension_noise": ("N", "standard deviation of every tension sensor"),
    "motor_steps": ("", "steps of the motor's encoder in a turn, 0 is exact"),
    "joint_steps": ("", "steps of the joint's encoder in a turn, 0 is exact"),
    "cutoff": ("Hz", "of the low-pass of both velocities"),
    "delay": ("", "control steps by which measurements are late"),
    "joint_sensor": ("", "false: controllers read no angle, torque or tension there"),
}
"""Unit and meaning of the fields of `Sensing`."""
IMPEDANCE = (("stiffness", "N m/rad"), ("damping", "N m s/rad"))


class Property(NamedTuple):
    table: str  # of the file; empty for the top
    key: str
    value: object  # None or NaN where unknown
    unit: str
    meaning: str
    origin: str  # one of `ORIGINS`
    axis: str = ""  # name of the axis that it belongs to, where there are several

    @property
    def known(self) -> bool:
        value = math.nan if self.value is None else self.value
        return not isinstance(value, float) or math.isfinite(value)

    @property
    def place(self) -> str:
        table = self.table
        if self.axis:
            table = self.axis + table.removeprefix("axis")
        return f"{table}.{self.key}" if table else self.key


def properties(device: Device) -> Iterator[Property]:
    """Yield every property that a description file can hold, in the file's order."""
    found = device.description
    origin = found.sources.get

    def top(
        key: str, value: object, unit: str, meaning: str, table: str = ""
    ) -> Property:
        return Property(table, key, value, unit, meaning, origin(key, SCENE))

    motion = without_mark(found.trajectory)
    yield top("meaning", found.meaning, "", "the device in a line")
    yield top("trajectory", motion, "", "nominal motion of the wearer")
    yield top("period", found.period, "s", "time between two calls of a controller")
    if "root" in found.sources:
        roots = (joint.type for joint in device.spec.joints)
        held = "free" if mujoco.mjtJoint.mjJNT_FREE in roots else "held"
        yield top("root", held, "", "body on a free joint: held or free")
    yield top("strength", found.strength, "N", "breaking load of a cable", "rope")
    yield top("diameter", found.diameter, "m", "of a cable", "rope")
    for key in (field.name for field in fields(Sensing)):
        value, where = getattr(found.sensing, key), origin(f"sensors.{key}", ASSUMED)
        yield Property("sensors", key, value, *SENSORS[key], where)
    several = len(found.axes) > 1
    for axis in found.axes:
        for row in _axis_properties(device, axis, several):
            yield row._replace(axis=axis.name if several else "")
    for joint in dict.fromkeys((*found.movers, *(a.limb for a in found.axes))):
        name, table = found.movers.get(joint), f"wearer.{joint}"
        where = origin(table, SCENE)
        if name is None:
            yield Property(table, "none", True, "", "moved by other actuators", where)
            continue
        if where != ASSUMED:
            yield Property(table, "actuator", name, "", "of the wearer", where)
        for key, unit in IMPEDANCE:
            value = getattr(device.wearers[joint], key)
            yield Property(table, key, value, unit, "of the wearer", where)


def _axis_properties(device: Device, axis: Axis, several: bool) -> Iterator[Property]:
    label = f"{axis.name}." if several else ""
    origin = device.description.sources.get
    table = "axis"

    def own(
        key: str, value: object, unit: str, meaning: str, default: str = SCENE
    ) -> Property:
        where = origin(f"{label}axis.{key}", default)
        return Property(table, key, value, unit, meaning, where)

    yield own("name", axis.name, "", "name of the axis")
    yield own("motor", axis.motor, "", f"actuator that turns {axis.drum}")
    yield own("joint", axis.limb, "", "joint that the cables drive")
    yield own("torque", axis.torque, "N m", "largest torque of the motor")
    task = without_mark(axis.task)
    yield own("task", task, "", "what the wearer should feel by default", ASSUMED)
    yield own("reach", axis.reach, "rad", "largest excursion of named trajectories")
    yield own("centre", axis.centre, "rad", "angle about which they move")
    meaning = "most that is safe at the joint, which a guard keeps"
    yield own("safe_torque", axis.safe_torque, "N m", meaning)
    for key, unit in (("safe_speed", "rad/s"), ("safe_power", "W")):
        meaning = f"{key[5:]} of the joint beyond which the guard brakes the motor"
        yield own(key, getattr(axis, key), unit, meaning)
    for part, disc in (("motor", axis.motor_pulley), ("joint", axis.joint_pulley)):
        meaning = f"inertia of the {part}'s pulley"
        yield own(f"{part}_pulley", disc or None, "kg m^2", meaning)
    yield own("gearing", axis.gearing, "", "turns of the rotor per turn of its pulley")
    yield own("lever", list(axis.lever) or None, "", "sites that move with the lever")
    if axis.cuff is not None:
        for key, unit in IMPEDANCE:
            value = getattr(axis.cuff, key)
            yield Property("axis.cuff", key, value, unit, "of the cuff", GIVEN)
        inertia = axis.cuff.inertia
        yield Property("axis.cuff", "inertia", inertia, "kg m^2", "of the frame", GIVEN)
    table = "axis.observation"
    units = ("rad", "rad/s", "rad", "rad/s", "N m", "N m")
    for (key, column), unit in zip(UNITS.items(), units, strict=True):
        where = origin(f"{label}axis.observation.{key}", ASSUMED)
        yield Property(table, key, axis.units[column], unit, "counts as 1", where)
    phase = "phase_sine" in axis.units
    where = origin(f"{label}axis.observation.phase", ASSUMED)
    yield Property(table, "phase", phase, "", "the phase of a gait is observed", where)


def account(device: Device) -> str:
    """Return lines of text on the axes, and on what is given, derived or assumed."""
    found = device.description
    model = DeviceModel(found, device.spec.copy().compile())
    axes = f"{len(found.axes)} {'axis' if len(found.axes) == 1 else 'axes'}"
    cables = f"{len(device.cables)} {'cable' if len(device.cables) == 1 else 'cables'}"
    lines = [f"{device.name}: {axes}, {cables}; {found.meaning}"]
    for axis in model.axes:
        ends = "a lever or a path" if axis.winding else "a round pulley"
        lines.append(
            f"  {axis.axis.name}: motor {axis.axis.motor} winds "
            f"{', '.join(axis.axis.cables)} and drives joint {axis.axis.joint} by "
            f"{ends}; up to {abs(axis.ratio) * axis.torque_limit:.3g} N m at the joint "
            "without friction"
        )
        if others := axis.crossed:
            lines.append(f"    its cables also cross joint {', '.join(others)}")
        for name in axis.axis.cables:
            if name in axis.driven:
                lines.append(f"    {axis.describe_pull(name)}")
            else:
                lines.append(
                    f"    its cable {name} pulls {device.ends[name][1].target}, whose "
                    "torque is not measured; `joint` in [axis] chooses"
                )
    everything = list(properties(device))
    for kind, heading in (
        (GIVEN, "given by the description"),
        (SCENE, "derived from the scene"),
        (ASSUMED, "assumed"),
    ):
        rows = [p for p in everything if p.origin == kind and p.known]
        if rows:
            lines += ["", heading]
        for row in rows:
            value = f"{_toml(row.value)} {row.unit}".rstrip()
            lines.append(f"  {row.place:32} {value:24} {row.meaning}")
    missing = [p for p in everything if not p.known]
    if missing:
        lines += ["", "missing; what needs them shows - or says so"]
        lines += [f"  {row.place:32} {row.meaning}" for row in missing]
    return "\n".join(lines)


def description_text(device: Device) -> str:
    """Return the text of a complete description file, for a user to edit."""
    name = Path(device.name).name
    lines = [
        f"# Description of the device in {name}.",
        "# Take the # before a key away to change it; the rest follows the scene.",
    ]
    if device.path is not None:
        lines.append(f"scene = {_toml(device.path.name)}")
    several = len(device.description.axes) > 1
    table = ""
    for row in properties(device):
        heading = row.table
        if row.table == "axis":
            heading = "[axis]" if several else "axis"
        new_axis = row.table == "axis" and row.key == "name"
        if row.table != table or new_axis:
            lines += ["", f"[{_quoted(heading)}]"]
            table = row.table
        unit = f" [{row.unit}]" if row.unit else ""
        if not row.known:
            lines.append(f"# {row.key} =  # {row.meaning}{unit}; unknown")
            continue
        # What the scene tells, and what follows from it, stays as the scene has it.
        names_axis = several and row.key == "motor"
        off = "" if row.origin == GIVEN or names_axis else "# "
        comment = f"# {row.meaning}{unit}; {ORIGINS[row.origin]}"
        lines.append(f"{off}{row.key} = {_toml(row.value)}  {comment}")
    return "\n".join(lines) + "\n"


def require_new_file(path: str | os.PathLike[str]) -> None:
    """Refuse a path to which a description cannot be written, or that exists."""
    if Path(path).exists():
        raise CableError(f"{path} is there already; give another name with --out.")
    if not Path(path).parent.is_dir():
        raise CableError(f"cannot write {path}: there is no such folder.")
    require_writable(Path(path).parent)


def write_description(device: Device, path: str | os.PathLike[str]) -> None:
    require_new_file(path)
    with replacing(path) as partial:
        Path(partial).write_text(description_text(device), encoding="utf-8")


def _quoted(heading: str) -> str:
    """Return a TOML table heading, with parts in quotes where TOML needs them."""
    if heading.startswith("wearer."):
        joint = heading.removeprefix("wearer.")
        bare = joint.replace("_", "").replace("-", "").isalnum() and joint.isascii()
        return heading if bare else f"wearer.{_toml(joint)}"
    return heading


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return f'"{escaped}"'
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_toml(one) for one in value) + "]"
    if isinstance(value, float):
        text = f"{value:.6g}"
        return text if any(c in text for c in ".einf") else f"{text}.0"
    return str(value)
