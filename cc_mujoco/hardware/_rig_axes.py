"""Axes that a `rig.toml` drives, on the model of their device.

axes = RigAxes(read_axes("rig.toml"))
law = axes_controller("pi", axes.drives, axes.prefixes)
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

from cc_mujoco.control import Controller, axes_controller
from cc_mujoco.control._controller import SteppedController
from cc_mujoco.control._registry import AxesController
from cc_mujoco.device._axis_columns import column_prefixes, split_by_axis
from cc_mujoco.device._device import bare_model
from cc_mujoco.device._model import DeviceModel
from cc_mujoco.errors import CableError
from cc_mujoco.hardware._can_bus import CanBuses
from cc_mujoco.hardware._drive_model import Windings
from cc_mujoco.hardware._loop import DrivenAxis
from cc_mujoco.hardware._references import Desired, TorqueTable
from cc_mujoco.hardware._rig import Rig
from cc_mujoco.hardware._settings import Settings


def laws_of(law: Controller) -> tuple[Controller, ...]:
    return law.laws if isinstance(law, AxesController) else (law,)


class RigAxes:
    """Axes that a rig drives, in the order of the device."""

    def __init__(self, settings: Sequence[Settings]) -> None:
        self.device = device = settings[0].device()
        every = device.axis_names

        def place(axis: Settings) -> int:
            return 0 if axis.axis is None else axis.device().axis_names.index(axis.axis)

        self.settings = tuple(sorted(settings, key=place))
        places = [place(each) for each in self.settings]
        self.names = tuple(every[k] for k in places)
        self.prefixes = column_prefixes(self.names)
        """Beginnings of the columns of each axis, as a controller sees them."""
        self.log_names = ("",) if len(every) == 1 else self.names
        """Names of the axes in a log, see `RunLog`."""
        self.drives = tuple(each.drive() for each in self.settings)
        models = DeviceModel(device.description, bare_model(device).compile()).axes
        self.windings = Windings([models[k] for k in places])
        self._measuring = {
            model.axis.joint: model.axis.name
            for model in models
            if model.axis.name not in self.names
        }
        """Axes that are not driven, by the joint that they would measure."""

    def controller(self, name: str) -> Controller:
        """Return a controller of all axes, see `control.axes_controller`."""
        if len(self.names) == 1 and self.log_names != ("",):
            named = split_by_axis(name, self.names)
            name = named if isinstance(named, str) else named[self.names[0]]
        law = axes_controller(name, self.drives, self.prefixes)
        for axis, one, missing in zip(
            self.names, laws_of(law), self.windings.unmeasured, strict=False
        ):
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

    def desired(self, duration: float) -> list[Desired]:
        found = [each.desired(duration) for each in self.settings]
        for name, desired, drive, each in zip(
            self.names, found, self.drives, self.settings, strict=True
        ):
            if not isinstance(desired, TorqueTable):
                continue
            try:
                desired.require_within(drive, each.limits)
            except CableError as error:
                of = f"axis {name}: " if len(self.names) > 1 else ""
                raise CableError(f"{of}{error}") from None
        return found

    def driven(
        self, rigs: Sequence[Rig], desired: Sequence[Desired]
    ) -> list[DrivenAxis]:
        limits = [each.limits for each in self.settings]
        dogs = [each.watchdog for each in self.settings]
        return [*map(DrivenAxis, rigs, self.drives, desired, limits, dogs, self.names)]

    def connect(self) -> list[Rig]:
        """Make the rig of every axis; those on one CAN bus share it."""
        buses: CanBuses = {}
        rigs: list[Rig] = []
        with contextlib.ExitStack() as closing:
            for each in self.settings:
                rigs.append(each.connect(buses))
                closing.callback(rigs[-1].close)
            closing.pop_all()
        return rigs
