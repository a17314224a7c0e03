"""Settings of a run in `rig.toml`: the rig, its limits and its task.

    axes = RigAxes(read_axes("rig.toml"))
    law = axes.controller("pi")

`rig.toml` beside this module is an example with every key.
"""

import contextlib
import dataclasses
import itertools
import math
import socket
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from cc_mujoco._utils import user_code
from cc_mujoco._utils.toml_table import Table, finite, read_toml
from cc_mujoco._utils.user_code import named_object, user_errors
from cc_mujoco.control import Controller, axes_controller
from cc_mujoco.control._controller import SteppedController
from cc_mujoco.device._axis_columns import column_prefixes, split_by_axis
from cc_mujoco.device._device import Device
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._model import DeviceModel
from cc_mujoco.errors import CableError, naming
from cc_mujoco.hardware import _references as references
from cc_mujoco.hardware._address import (
    Address,
    CanAddress,
    CanPlace,
    DriveAddress,
    UdpAddress,
    address_of,
)
from cc_mujoco.hardware._can_bus import CanBuses, CanRig
from cc_mujoco.hardware._can_drives import Moteus, Odrive
from cc_mujoco.hardware._drive_model import Windings, device_of, drive_of
from cc_mujoco.hardware._dynamixel import Dynamixel
from cc_mujoco.hardware._limits import MAX_PERIOD, MIN_PERIOD, Limits
from cc_mujoco.hardware._loop import DrivenAxis
from cc_mujoco.hardware._references import Stiffness
from cc_mujoco.hardware._rig import DriveRig, MotorDrive, Rig, UdpRig
from cc_mujoco.hardware._watchdog import Watchdog
from cc_mujoco.human import TASKS

Kind = TypeVar("Kind", Limits, Watchdog, Stiffness)

_AXIS_TABLES = ("rig", "limits", "watchdog", "task", "servo")


@dataclass(frozen=True)
class Settings:
    """Contents of a `rig.toml` for one axis."""

    path: Path
    scene: str  # name of a device, or the file of one
    period: float  # of the loop [s]
    rig: Table  # the table `[rig]`, and so on
    limits: Limits
    watchdog: Watchdog
    task: Table
    servo: Table
    motor_lag: float | None = None  # of its torque [s]; None is that of the scene
    axis: str | None = None  # name of the axis; None is the only one of the device
    named: tuple[str, ...] = ()  # axes with a table in the file, driven or not

    def address(self) -> Address | None:
        """Return the address of the rig; None for a user's class."""
        return address_of(self.rig)

    def connect(self, buses: CanBuses | None = None) -> Rig:
        """Make the rig that `[rig]` names; it shares the open CAN `buses`."""
        return connect_rig(self.rig, {} if buses is None else buses)

    def drive(self) -> Drive:
        """Return the drive of the rig's axis, as its controller knows it."""
        return drive_of(
            self.device(),
            self.path.parent,
            self.period,
            self.limits.torque,
            axis=self.axis,
            joint_torque=self.limits.joint_torque,
            torque_rate=self.limits.torque_rate,
            motor_lag=self.motor_lag,
        )

    def device(self) -> Device:
        """Return the device that `scene` names; refuse axes that it lacks or needs."""
        device = device_of(self.scene, self.path.parent)
        names = device.axis_names
        if self.axis is None and len(names) > 1:
            raise CableError(
                f"{self.path} needs `axis`, one of {', '.join(names)}, or a table "
                "[axes.NAME] for each of them."
            )
        for name in self.named or (() if self.axis is None else (self.axis,)):
            if name not in names:
                raise CableError.unknown("axis", name, names, str(self.path))
        if self.named and (missing := [n for n in names if n not in self.named]):
            raise CableError(
                f"{self.path}, [axes] leaves out {', '.join(missing)}; give a table "
                f"[axes.{missing[0]}], with `driven = false` if no rig drives it."
            )
        return device

    def firm(self, drive: Drive) -> Stiffness:
        """Return the gains with which the servo tracks the angles of a trial."""
        given = _numbers(self.servo, Stiffness)
        if len(given) < len(dataclasses.fields(Stiffness)):
            given = {**dataclasses.asdict(Stiffness.of(drive)), **given}
        return _construct(Stiffness, self.servo, given)

    def desired(self, duration: float) -> references.Desired:
        """Return the torque that `[task]` defines, for a run of `duration` [s]."""
        table = self.task
        if (torque := table.number("torque")) is not None:
            return references.constant_course(torque)
        if (file := table.text("csv")) is not None:
            return references.course_from_csv(self.path.parent / file)
        with naming(table.where):
            if (name := table.code("name", TASKS)) is not None:
                return references.Virtual.named(name)
            shape = table.text("trajectory") or ""
            size = table.number("amplitude") or 0.0
            return references.course_from_trajectory(shape, size, duration)


def read_settings(path: str | Path, allow: str | Iterable[str] = ()) -> Settings:
    """Return the settings of a `rig.toml` that drives one axis; see `read_axes`."""
    first, *others = read_axes(path, allow)
    if others:
        names = ", ".join(str(each.axis) for each in (first, *others))
        raise CableError(
            f"{path} drives the axes {names}, and here one is driven; give a file in "
            "which all others have `driven = false`."
        )
    return first


def read_axes(
    path: str | Path, allow: str | Iterable[str] = ()
) -> tuple[Settings, ...]:
    """Return the settings of every axis that a `rig.toml` drives.

    `allow` has `MODULE:NAME` of user code that the file may name. An error is one
    sentence on the file, the key and its allowed values.
    """
    user_code.allow(allow)
    path = Path(path)
    top = read_toml(path)
    top.only("scene", "axis", "period", "motor_lag", *_AXIS_TABLES, "axes")
    scene = _require_value(top, "scene", top.text("scene"))
    period = _require_value(top, "period", top.number("period"))
    if not MIN_PERIOD * (1 - 1e-9) <= period <= MAX_PERIOD * (1 + 1e-9):
        allowed = f"{MIN_PERIOD:g} to {MAX_PERIOD:g} s (500 Hz to 2 kHz)"
        raise top.wrong("period", allowed)
    if "axes" not in top.content:
        return (_axis(path, scene, period, top, top.text("axis")),)
    if "axis" in top.content:
        raise CableError(
            f"{path} has `axis` and [axes]; give one of them: the name of the one axis "
            "that it drives, or a table for each."
        )
    tables = top.tables("axes")
    for table in tables.values():
        table.only(*_AXIS_TABLES, "motor_lag", "driven")
    driven = {n: t for n, t in tables.items() if t.flag("driven") is not False}
    if not driven:
        raise CableError(
            f"{path}, [axes] has no axis that is driven; it needs a table [axes.NAME]."
        )
    found = []
    for name, table in driven.items():
        one = _axis(path, scene, period, _merged(path, top, name, table), name)
        found.append(dataclasses.replace(one, named=tuple(tables)))
    for one, other in itertools.combinations(found, 2):
        pair = f"{path}, axes {one.axis} and {other.axis}"
        require_distinct(pair, one.rig, other.rig)
    return tuple(found)


def _axis(
    path: Path, scene: str, period: float, top: Table, name: str | None
) -> Settings:
    lag = top.number("motor_lag")
    if lag is not None and not 0.0 <= lag <= 0.02:  # a loop is made for no slower one
        raise top.wrong("motor_lag", "0 to 0.02 s; 3 ms are 0.003")
    table = top.table("limits")
    limits = _limits(table)
    with naming(table.where):
        limits.stop_steps(period)
    rig, dog, task, servo = map(top.table, ("rig", "watchdog", "task", "servo"))
    _numbers(servo, Stiffness)  # refuses what it cannot have
    if (rig.text("class") is None) == (rig.text("address") is None):
        raise CableError(f"{rig.where} needs either `address` or `class`.")
    address_of(rig)  # refuses what it cannot be
    watchdog = _construct(Watchdog, dog, _numbers(dog, Watchdog))
    _check_task(task)
    return Settings(path, scene, period, rig, limits, watchdog, task, servo, lag, name)


def _merged(path: Path, top: Table, name: str, own: Table) -> Table:
    lag = own.content.get("motor_lag", top.content.get("motor_lag"))
    content: dict[str, Any] = {} if lag is None else {"motor_lag": lag}
    for key in _AXIS_TABLES:
        usual, given = top.table(key).content, own.table(key).content
        content[key] = given if key == "task" and given else {**usual, **given}
    return Table(f"{path}, axis {name}", content)


def _limits(table: Table) -> Limits:
    table.only(*(field.name for field in dataclasses.fields(Limits)))
    for key in ("torque", "torque_rate", "motor_speed", "joint_range"):
        _require_value(table, key, table.content.get(key))
    pair = table.content["joint_range"]
    ends = [finite(end) for end in pair] if isinstance(pair, list) else []
    if len(ends) != 2 or None in ends:
        raise table.wrong("joint_range", "two angles in rad, [least, greatest]")
    given = _numbers(table, Limits, "joint_range")
    return _construct(Limits, table, {**given, "joint_range": tuple(ends)})


def _check_task(table: Table) -> None:
    keys = ("torque", "csv", "name", "trajectory")
    table.only(*keys, "amplitude")
    given = [key for key in keys if key in table.content]
    if len(given) != 1:
        raise CableError(f"{table.where} needs one of {', '.join(keys)}.")
    if ("amplitude" in table.content) != (given == ["trajectory"]):
        raise CableError(
            f"{table.where}: `amplitude`, in N m, belongs to `trajectory` and to "
            "nothing else."
        )


def _require_value(table: Table, key: str, value: Any) -> Any:
    if value is None:
        raise CableError(f"{table.where} needs `{key}`.")
    return value


def _numbers(table: Table, kind: type, *others: str) -> dict[str, float]:
    """Return the numbers of a table with fields of `kind` as keys, except `others`."""
    names = [field.name for field in dataclasses.fields(kind)]
    table.only(*names)
    given = {name: table.number(name) for name in names if name not in others}
    found = {name: value for name, value in given.items() if value is not None}
    for name, value in found.items():
        if isinstance(getattr(kind, name, None), int):
            if value != math.floor(value):
                raise table.wrong(name, "a whole number of cycles")
            found[name] = int(value)
    return found


def _construct(kind: type[Kind], table: Table, given: dict[str, Any]) -> Kind:
    with naming(table.where):
        return kind(**given)


def connect_rig(table: Table, buses: CanBuses) -> Rig:
    """Make the rig of a table, sharing open CAN `buses`; nothing is sent."""
    address = address_of(table)
    if address is None:
        return _user_rig(table, table.code("class") or "")
    with naming(table.where):
        if isinstance(address, UdpAddress):
            return UdpRig(address.host, address.port)
        if isinstance(address, CanAddress):
            return CanRig(address, buses)
    joint = connect_rig(address.joint, buses)
    place, node = address.place, address.node
    with contextlib.ExitStack() as closing, naming(table.where):
        closing.callback(joint.close)
        drive: MotorDrive
        if isinstance(place, str):
            drive = Dynamixel(place, node, address.baud_rate, address.torque_per_ampere)
        else:
            kind = Odrive if address.protocol == "odrive" else Moteus
            drive = kind(place, node, buses)
        rig = DriveRig(drive, joint, address.gear, address.zero)
        closing.pop_all()
    return rig


def require_distinct(pair: str, one: Table, other: Table) -> None:
    """Refuse two axes, named by `pair`, whose commands would reach the same motor."""
    if one.content == other.content:
        raise CableError(
            f"{pair} have the same rig; give each its own address, or keys, in its "
            "[axes.NAME.rig]."
        )
    for mine, theirs in itertools.product(_addresses(one), _addresses(other)):
        _require_distinct(pair, mine, theirs)


def _addresses(rig: Table) -> list[Address]:
    """Return the addresses of a rig and of its joint sensors, if these are separate."""
    address = address_of(rig)
    joint = address_of(address.joint) if isinstance(address, DriveAddress) else None
    return [each for each in (address, joint) if each is not None]


def _require_distinct(pair: str, mine: Address, theirs: Address) -> None:
    """Refuse two addresses that reach the same rig; `pair` names both axes."""
    if isinstance(mine, UdpAddress) and isinstance(theirs, UdpAddress):
        if mine.port == theirs.port and _machine(mine) == _machine(theirs):
            raise CableError(f"{pair} have the same address.")
    bus, other = (a.place if isinstance(a, DriveAddress) else a for a in (mine, theirs))
    if isinstance(bus, str) and bus == other:
        raise CableError(f"{pair} are on the same port; give each servo its own.")
    if not (isinstance(bus, CanPlace) and isinstance(other, CanPlace)):
        return
    if (bus.channel, bus.interface) != (other.channel, other.interface):
        return
    if bus.bus != other.bus:
        raise CableError(
            f"{pair} are on the same CAN bus and open it differently; give `bus` "
            "once, in [rig]."
        )
    if isinstance(mine, DriveAddress) and isinstance(theirs, DriveAddress):
        if (mine.protocol, mine.node) == (theirs.protocol, theirs.node):
            raise CableError(
                f"{pair} both are {mine.protocol} {mine.node} on {bus.channel!r}; give "
                "each axis the `node` of its drive."
            )
    if isinstance(mine, CanAddress) and isinstance(theirs, CanAddress):
        own, others = ({a.command_id, a.reading_id} for a in (mine, theirs))
        if same := own & others:
            raise CableError(
                f"{pair} both use the identifier {min(same):#x} on {mine.channel!r}; "
                "give each axis a command_id and a reading_id of its own."
            )


def _machine(address: UdpAddress) -> str:
    """Return the IP address of a host, or its name if that cannot be resolved."""
    try:
        return str(socket.getaddrinfo(address.host, address.port)[0][4][0])
    except OSError:
        return address.host


def _user_rig(table: Table, name: str) -> Rig:
    """Return a rig of the class `name`, importable also from the current folder."""
    others = {key: value for key, value in table.content.items() if key != "class"}
    kind = named_object(f"{table.where}, class", name, "class")
    with user_errors(f"{table.where}, class {name!r}"):
        made = kind(**others)
    if not isinstance(made, Rig):
        raise CableError(
            f"{table.where}, class {name!r} makes no rig; it needs read(), "
            "write(torque) and close()."
        )
    return made


class RigAxes:
    """Axes that a rig drives, in the order of the device."""

    def __init__(self, settings: Sequence[Settings]) -> None:
        self.device = device = settings[0].device()
        every = device.axis_names
        own = {every.index(each.axis or every[0]): each for each in settings}
        places = sorted(own)
        self.settings = tuple(own[k] for k in places)
        self.names = tuple(every[k] for k in places)
        self.prefixes = column_prefixes(self.names)
        """Beginnings of the columns of each axis, as a controller sees them."""
        self.log_names = ("",) if len(every) == 1 else self.names
        """Names of the axes in a log, see `RunLog`."""
        self.drives = tuple(each.drive() for each in self.settings)
        models = DeviceModel.of(device).axes
        self.windings = Windings([models[k] for k in places])
        self._measuring = {
            model.axis.joint: model.axis.name
            for model in models
            if model.axis.name not in self.names
        }
        """Axes that are not driven, by the joint that they would measure."""

    def controller(self, name: str) -> Controller:
        """Return a controller of all axes; see `control.axes_controller`."""
        if len(self.names) == 1 and self.log_names != ("",):
            named = split_by_axis(name, self.names)
            name = named if isinstance(named, str) else named[self.names[0]]
        law = axes_controller(name, self.drives, self.prefixes)
        laws, unmeasured = getattr(law, "laws", (law,)), self.windings.unmeasured
        for axis, one, missing in zip(self.names, laws, unmeasured, strict=False):
            has_model = isinstance(one, SteppedController) and one.stepped.has_model
            if not (missing and (has_model or hasattr(one, "model"))):
                continue
            others = [self._measuring[j] for j in missing if j in self._measuring]
            known = len(others) == len(missing)
            hint = f"drive {' and '.join(others)}, whose rig does; " if known else ""
            of = f" of axis {axis}" if len(self.names) > 1 else ""
            raise CableError(
                f"controller {name!r}{of} needs to know how joint {', '.join(missing)} "
                f"winds the cable too, which the rig does not measure; {hint}none, "
                "feedback and pi need not."
            )
        return law

    def desired(self, duration: float) -> list[references.Desired]:
        found = [each.desired(duration) for each in self.settings]
        each_axis = zip(self.names, found, self.drives, self.settings, strict=True)
        for name, desired, drive, own in each_axis:
            alone = contextlib.nullcontext() if len(self.names) == 1 else None
            if isinstance(desired, references.TorqueTable):
                with alone or naming(f"axis {name}"):
                    desired.require_within(drive, own.limits)
        return found

    def driven(
        self, rigs: Sequence[Rig], desired: Sequence[references.Desired]
    ) -> list[DrivenAxis]:
        limits = [each.limits for each in self.settings]
        dogs = [each.watchdog for each in self.settings]
        return [*map(DrivenAxis, rigs, self.drives, desired, limits, dogs, self.names)]

    def connect(self) -> list[Rig]:
        """Make the rig of every axis; rigs on the same CAN bus share it."""
        buses: CanBuses = {}
        rigs: list[Rig] = []
        with contextlib.ExitStack() as closing:
            for each in self.settings:
                rigs.append(each.connect(buses))
                closing.callback(rigs[-1].close)
            closing.pop_all()
        return rigs
