"""Controller of many devices at once, whose drives may differ."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control import (
    AxesController,
    Controller,
    axes_controller,
    controller,
)
from cc_mujoco.control._axes import (
    DecoupledController,
    Law,
    by_axis,
    decoupled_drives,
    is_decoupled,
    is_policy,
    require_decoupling,
    sees_all_axes,
)
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._sensors import (
    MEASURED_COLUMNS,
    REFERENCE_COLUMN,
    TENSION_COLUMN,
    WINDING_COLUMNS,
)

Array = NDArray[np.float64]

PROBES = 32
"""Observations of a probe."""


class Unpowered(Controller):
    """Motors that give no torque."""

    def __init__(self, drive: Drive, axes: int = 1) -> None:
        super().__init__(drive)
        self._axes = axes

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Do nothing; see `Controller.reset`."""

    def torque(self, observation: Mapping[str, Any]) -> Any:
        if self._axes == 1:
            return 0.0
        shape = np.shape(next(iter(observation.values())))
        return np.zeros((*shape, self._axes))


class BatchedController(Controller):
    """Controller of many devices, whose drives may differ.

    Controllers work on arrays; this one gives a controller drives that are arrays too,
    if for a probe it then equals a controller for each drive bit for bit, and otherwise
    keeps a controller for each.
    """

    def __init__(
        self, name: str | Callable[[Drive], Any], drives: Sequence[Drive]
    ) -> None:
        """Prepare for the first episode, with a drive for each device."""
        super().__init__(drives[0])
        self._name, self._drives = name, tuple(drives)
        self._same = all(drive == drives[0] for drive in drives)
        # A function may know numbers only.
        of_arrays = isinstance(name, str) and ":" not in name
        self._joint = (self._same and of_arrays) or self._probe()
        if self._joint and self._same:
            self._laws = [controller(name, self._drives[0])]
        elif self._joint:
            self._laws = [controller(name, _stacked(self._drives))]
        else:
            self._laws = self._controllers_per_device()

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        for law in self._laws:
            law.reset()

    def torque(self, observation: Mapping[str, Any]) -> Array:
        """Return the torque of every motor [N m], (n,)."""
        if self._joint:
            return np.asarray(self._laws[0].torque(observation))
        return _each(self._laws, observation)

    def _controllers_per_device(self) -> list[Controller]:
        return [controller(self._name, drive) for drive in self._drives]

    def _probe(self) -> bool:
        """Return whether one controller with stacked drives equals one for each."""
        rng = np.random.default_rng(0)
        one_each = self._controllers_per_device()
        try:
            joint = controller(self._name, _stacked(self._drives))
            for law in (joint, *one_each):
                law.reset()
            for _ in range(PROBES):
                names = (*MEASURED_COLUMNS, REFERENCE_COLUMN)
                seen = {name: rng.normal(size=len(one_each)) for name in names}
                seen |= {
                    n: rng.uniform(0.5, 2.0, len(one_each)) for n in WINDING_COLUMNS
                }
                if sensors := self.drive.sensors:
                    shape = len(one_each), len(sensors), len(sensors[0].nodes)
                    seen[TENSION_COLUMN] = rng.uniform(1.0, 50.0, size=shape)
                together = np.asarray(joint.torque(seen))
                if not np.array_equal(together, _each(one_each, seen)):
                    return False
        except (TypeError, ValueError, AttributeError, IndexError):
            return False
        return True


def _each(laws: Sequence[Controller], observation: Mapping[str, Any]) -> Array:
    names = [
        n
        for n in (*MEASURED_COLUMNS, *WINDING_COLUMNS, REFERENCE_COLUMN, TENSION_COLUMN)
        if n in observation
    ]
    return np.array(
        [
            law.torque({name: observation[name][i] for name in names})
            for i, law in enumerate(laws)
        ]
    )


def _stacked(drives: Sequence[Drive]) -> Drive:
    """Return a drive whose fields are arrays over devices where they differ.

    Cables with different arms cannot be those of one drive and are refused.
    """
    differing: dict[str, list[Any]] = {}
    for field in dataclasses.fields(Drive):
        values = [getattr(drive, field.name) for drive in drives]
        if any(value != values[0] for value in values):
            differing[field.name] = values
    # Tuples are of one entry per device: the cables, where they are known.
    tuples: dict[str, Any] = {
        name: tuple(chain.from_iterable(values))
        for name, values in differing.items()
        if isinstance(values[0], tuple)
    }
    whole = dataclasses.replace(drives[0], **tuples)
    for name in differing.keys() - tuples.keys():
        # Past the checks of a drive, which are of numbers.
        object.__setattr__(whole, name, np.array(differing[name]))
    return whole


class PlantsController(Controller):
    def __init__(self, laws: Sequence[Controller]) -> None:
        super().__init__(laws[0].drive)
        self._laws = tuple(laws)

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        for law in self._laws:
            law.reset()

    def torque(self, observation: Mapping[str, Any]) -> Array:
        """Return the torque of every motor [N m], (n,) or (n, axes)."""
        return np.stack(
            [
                law.torque({name: value[row] for name, value in observation.items()})
                for row, law in enumerate(self._laws)
            ]
        )


def batched_controller(
    given: Law | Mapping[str, Law],
    drives: Sequence[Sequence[Drive]],
    prefixes: Sequence[str],
) -> Controller:
    """Make the controller of many devices, of one axis or several.

    `given` as in `control.axes_controller`; `drives` are those of every axis of each
    device.
    """
    require_decoupling(given, len(prefixes))
    if sees_all_axes(given):
        return PlantsController(
            [axes_controller(given, own, prefixes) for own in drives]
        )
    each = list(zip(*drives, strict=True))
    if len(each) > 1 and is_policy(given):
        return axes_controller(given, drives[0], prefixes)
    laws = by_axis(given, prefixes)
    if len(each) == 1:
        return BatchedController(laws[0], each[0])
    if not is_decoupled(given):
        made = [
            BatchedController(law, own) for law, own in zip(laws, each, strict=True)
        ]
        return AxesController(made, prefixes)
    if any(_arms(own) != _arms(drives[0]) for own in drives):
        return PlantsController(
            [axes_controller(given, own, prefixes) for own in drives]
        )
    changed = [decoupled_drives(own, prefixes) for own in drives]
    each = list(zip(*(own for own, _ in changed), strict=True))
    made = [BatchedController(law, own) for law, own in zip(laws, each, strict=True)]
    return DecoupledController(made, prefixes, changed[0][1])


def _arms(drives: Sequence[Drive]) -> list[Any]:
    """Return everything that the coupling of a device's axes depends on."""
    return [
        (
            one.ratio,
            one.shared_ratios,
            one.torque_noise,
            one.high,
            [(c.proximal, c.cable.pretension) for c in one.cables],
        )
        for one in drives
    ]
