"""Controllers of a device with several axes.

    law = axes_controller("pi", drives, prefixes)               # one each, all the same
    law = axes_controller("hip=predictive,ankle=pi", drives, prefixes)
    law = axes_controller({"hip": "predictive", "ankle": make}, drives, prefixes)

Controllers act on one axis and see the columns of that axis under plain names. A
function with the attribute `ALL_AXES = True` is called with the drives of all axes; its
controller sees all columns and returns the torques of all motors.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils import user_code
from cc_mujoco._utils.provenance import POLICY_ENDING, is_user_controller
from cc_mujoco.control._controller import Controller, limit_torques
from cc_mujoco.control._policy import Policy
from cc_mujoco.control._registry import controller
from cc_mujoco.control._user_controller import External, controller_errors
from cc_mujoco.device._axis_columns import axis_columns, split_by_axis
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError

Law = str | Callable[..., Any]
"""Name of a controller, or a function that makes one of a drive."""

ALL_AXES = "ALL_AXES"
"""Attribute of a function that makes one controller for all axes."""


class AxesController(Controller):
    """One controller for each axis of a device."""

    def __init__(self, laws: Sequence[Controller], prefixes: Sequence[str]) -> None:
        """Prepare for the first episode.

        Args:
            laws: One for each axis.
            prefixes: Beginnings of the columns of each axis.
        """
        super().__init__(laws[0].drive)
        self.laws, self._prefixes = tuple(laws), tuple(prefixes)

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Reset every axis; see `Controller.reset`."""
        for law in self.laws:
            law.reset(where)

    def given(self, torque: Any) -> None:
        """Accept the torques that the motors got (axes,); see `Controller.given`."""
        for law, own in zip(self.laws, torque, strict=True):
            law.given(own)

    def torque(self, observation: Mapping[str, Any]) -> NDArray[np.float64]:
        """Return the torque of every motor [N m], (..., axes)."""
        torques = [
            law.torque(axis_columns(observation, prefix, self._prefixes))
            for law, prefix in zip(self.laws, self._prefixes, strict=True)
        ]
        return np.stack(np.broadcast_arrays(*torques), axis=-1)


class _ExternalOfAll(External):
    """User function of the measurements of all axes, with the motors' limits."""

    def __init__(
        self, drives: tuple[Drive, ...], make: Callable[..., Any], name: str
    ) -> None:
        """Make the function, as `External` does, of the drives of all axes."""
        super().__init__(drives[0], lambda _: make(drives), name)
        self._drives = drives

    def limited(self, torque: Any) -> Any:
        """Return torques (..., axes) clipped to the limits of the motors [N m]."""
        return limit_torques(torque, self._drives)


def _for_all_axes(given: Law) -> Any:
    """Return the function that makes one controller for all axes, or None."""
    if isinstance(given, str):
        if not is_user_controller(given) or "=" in given:
            return None
        if given.endswith(POLICY_ENDING):
            return None
        given = user_code.named_object("controller", given, "function")
    return given if getattr(given, ALL_AXES, False) else None


def is_policy(given: Law | Mapping[str, Law]) -> bool:
    """Return whether a controller is the file of a policy, which has all axes."""
    return (
        isinstance(given, str)
        and named_laws(given) == [given]
        and given.endswith(POLICY_ENDING)
    )


def sees_all_axes(given: Law | Mapping[str, Law]) -> bool:
    """Return whether a function makes one controller for all axes.

    Raises:
        CableError: It is a `module:function` that cannot be found.
    """
    return not isinstance(given, Mapping) and _for_all_axes(given) is not None


def axes_controller(
    given: Law | Mapping[str, Law], drives: Sequence[Drive], prefixes: Sequence[str]
) -> Controller:
    """Make the controller of a device.

    Args:
        given: For all axes, or by the name of an axis: a mapping, or a text such as
            `hip=predictive,ankle=pi`.
        drives: Of every axis.
        prefixes: Beginnings of the columns of each axis.

    Returns:
        The controller; of a device with one axis that of the axis.

    Raises:
        CableError: There is no such controller or axis, or an axis has none.
    """
    if len(drives) == 1 and not isinstance(given, Mapping):
        return controller(given, drives[0])
    if not isinstance(given, Mapping) and (make := _for_all_axes(given)) is not None:
        name = given if isinstance(given, str) else make.__qualname__
        with controller_errors(name):
            made = make(tuple(drives))
        if isinstance(made, Controller):
            return made
        return _ExternalOfAll(tuple(drives), make, name)
    if is_policy(given):
        return Policy(drives, str(given), prefixes)
    laws = by_axis(given, prefixes)
    return AxesController(
        [controller(law, drive) for law, drive in zip(laws, drives, strict=True)],
        prefixes,
    )


def by_axis(given: Law | Mapping[str, Law], prefixes: Sequence[str]) -> list[Law]:
    """Return the controller of every axis, as it is given.

    Raises:
        CableError: There is no such axis, or an axis has none.
    """
    names = [prefix.rstrip(".") for prefix in prefixes]
    if isinstance(given, str):
        given = split_by_axis(given, names)
    if not isinstance(given, Mapping):
        return [given] * len(names)
    for name in given:
        if name not in names:
            raise CableError.unknown("axis", name, names)
    missing = [name for name in names if name not in given]
    if missing:
        raise CableError(
            f"axis {missing[0]!r} has no controller; write {missing[0]}=NAME as well."
        )
    return [given[name] for name in names]


def named_laws(given: str) -> list[str]:
    """Return the controllers of a name: several of `hip=model,ankle=pi`."""
    pairs = [re.fullmatch(r"\s*[\w-]+=(.*)", part) for part in given.split(",")]
    return [pair[1].strip() for pair in pairs if pair] if all(pairs) else [given]


def law_drives(law: Controller, drives: Sequence[Drive]) -> Sequence[Drive]:
    """Return the drives that a controller was made for, those of the device if many."""
    if isinstance(law, AxesController):
        return [one.drive for one in law.laws]
    return [law.drive] if len(drives) == 1 else drives
