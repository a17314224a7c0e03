"""Controllers of a device with several axes.

    law = axes_controller("pi", drives, prefixes)               # one each, all the same
    law = axes_controller("hip=predictive,ankle=pi", drives, prefixes)
    law = axes_controller({"hip": "predictive", "ankle": make}, drives, prefixes)

    law = axes_controller("decoupled_pi", drives, prefixes)  # see `_decoupling`

Controllers act on one axis and see the columns of that axis under plain names. A
function with the attribute `ALL_AXES = True` is called with the drives of all axes; its
controller sees all columns and returns the torques of all motors.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils import user_code
from cc_mujoco._utils.provenance import POLICY_ENDING, is_user_controller
from cc_mujoco.control._controller import Controller, limit_torques
from cc_mujoco.control._decoupling import Coupling
from cc_mujoco.control._policy import Policy
from cc_mujoco.control._registry import CONTROLLERS, controller
from cc_mujoco.control._user_controller import External, controller_errors
from cc_mujoco.device._axis_columns import axis_columns, split_by_axis
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError

Law = str | Callable[..., Any]
"""Name of a controller, or a function that makes one for a drive."""

DECOUPLED = "decoupled_"
"""Prefix of the name of a controller whose axes are decoupled."""

OWN_COLUMNS = "joint_torque_nm", "desired_torque_nm"
"""Columns that hold the torques of the own cable where axes are decoupled."""

ALL_AXES = "ALL_AXES"
"""Attribute of a function that makes one controller for all axes."""


class AxesController(Controller):
    """One controller for each axis of a device."""

    def __init__(self, laws: Sequence[Controller], prefixes: Sequence[str]) -> None:
        """Prepare for the first episode: a law and a column prefix for each axis."""
        super().__init__(laws[0].drive)
        self.laws, self._prefixes = tuple(laws), tuple(prefixes)

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        for law in self.laws:
            law.reset(where)

    def given(self, torque: Any) -> None:
        for law, own in zip(self.laws, torque, strict=True):
            law.given(own)

    def torque(self, observation: Mapping[str, Any]) -> NDArray[np.float64]:
        """Return the torque of every motor [N m], (..., axes)."""
        torques = [
            law.torque(axis_columns(observation, prefix, self._prefixes))
            for law, prefix in zip(self.laws, self._prefixes, strict=True)
        ]
        return np.stack(np.broadcast_arrays(*torques), axis=-1)


class DecoupledController(AxesController):
    """One controller per axis, which receives the torque of its own cable alone."""

    def __init__(
        self,
        laws: Sequence[Controller],
        prefixes: Sequence[str],
        coupling: Coupling,
    ) -> None:
        """Prepare; the laws of all axes are of the drives of `decoupled_drives`."""
        super().__init__(laws, prefixes)
        self._coupling = coupling

    def torque(self, observation: Mapping[str, Any]) -> NDArray[np.float64]:
        """Return the torque of every motor [N m], (..., axes)."""
        seen = [
            axis_columns(observation, prefix, self._prefixes)
            for prefix in self._prefixes
        ]
        measured, desired = (
            np.stack([np.atleast_1d(own[name]) for own in seen], axis=-1)
            for name in OWN_COLUMNS
        )
        ratios = self._coupling.ratios(seen, len(measured))
        given, wanted = self._coupling.own_torques(ratios, measured, desired)
        many = np.ndim(seen[0][OWN_COLUMNS[0]]) > 0
        torques = []
        for place, (law, own) in enumerate(zip(self.laws, seen, strict=True)):
            pair = given[:, place], wanted[:, place]
            values = pair if many else (float(one[0]) for one in pair)
            changed = dict(zip(OWN_COLUMNS, values, strict=True))
            torques.append(law.torque({**own, **changed}))
        return np.stack(np.broadcast_arrays(*torques), axis=-1)


def decoupled_drives(
    drives: Sequence[Drive], prefixes: Sequence[str]
) -> tuple[list[Drive], Coupling]:
    coupling = Coupling(drives, prefixes)
    found = [
        dataclasses.replace(drive, torque_noise=float(noise))
        for drive, noise in zip(drives, coupling.noise, strict=True)
    ]
    return found, coupling


def is_decoupled(given: Law | Mapping[str, Law]) -> bool:
    return isinstance(given, str) and given.startswith(DECOUPLED)


class _ExternalOfAll(External):
    """User function of the measurements of all axes, with the motors' limits."""

    def __init__(
        self, drives: tuple[Drive, ...], make: Callable[..., Any], name: str
    ) -> None:
        super().__init__(drives[0], lambda _: make(drives), name)
        self._drives = drives

    def limited(self, torque: Any) -> Any:
        return limit_torques(torque, self._drives)


def _for_all_axes(given: Law) -> Any:
    """Return the function that makes one controller for all axes, or None."""
    if isinstance(given, str):
        if not is_user_controller(given) or "=" in given or is_decoupled(given):
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
    """Return whether a function makes one controller for all axes."""
    return not isinstance(given, Mapping) and _for_all_axes(given) is not None


def runs_code(given: Law | Mapping[str, Law]) -> bool:
    """Return whether a controller has code of its own: `module:name`, or a function.

    The file of a policy has none: it is numbers.
    """
    if isinstance(given, str):
        laws: Iterable[Law] = named_laws(given)
    else:
        laws = given.values() if isinstance(given, Mapping) else [given]
    return any(
        not isinstance(law, str)
        or (is_user_controller(law) and not law.endswith(POLICY_ENDING))
        for law in laws
    )


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
        CableError: There is no such controller or axis, or an axis has none; or a
            single axis is to be decoupled.
    """
    require_decoupling(given, len(drives))
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
    if not is_decoupled(given):
        made = [controller(law, one) for law, one in zip(laws, drives, strict=True)]
        return AxesController(made, prefixes)
    own, coupling = decoupled_drives(drives, prefixes)
    made = [controller(law, one) for law, one in zip(laws, own, strict=True)]
    return DecoupledController(made, prefixes, coupling)


def require_decoupling(given: Law | Mapping[str, Law], axes: int) -> None:
    """Refuse a `decoupled_NAME` with an unknown NAME, or of a single axis."""
    if not isinstance(given, str) or not is_decoupled(given):
        return
    for name in named_laws(given):
        if not is_user_controller(name) and name not in CONTROLLERS:
            error = CableError.unknown("suffix", name, CONTROLLERS)
            raise CableError(f"controller {given!r}: {error}")
    if axes == 1:
        raise CableError(
            f"controller {given!r} decouples several driven axes, and here is one; "
            f"take {given.removeprefix(DECOUPLED)!r}."
        )


def by_axis(given: Law | Mapping[str, Law], prefixes: Sequence[str]) -> list[Law]:
    """Return the controller of every axis, as it is given."""
    names = [prefix.rstrip(".") for prefix in prefixes]
    if isinstance(given, str):
        given = split_by_axis(given.removeprefix(DECOUPLED), names)
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
    given = given.removeprefix(DECOUPLED)
    pairs = [re.fullmatch(r"\s*[\w-]+=(.*)", part) for part in given.split(",")]
    return [pair[1].strip() for pair in pairs if pair] if all(pairs) else [given]


def law_drives(law: Controller, drives: Sequence[Drive]) -> Sequence[Drive]:
    """Return the drives of a controller: its own, or those of the device if many."""
    if isinstance(law, AxesController):
        return [one.drive for one in law.laws]
    return [law.drive] if len(drives) == 1 else drives
