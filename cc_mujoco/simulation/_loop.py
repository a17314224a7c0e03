"""Loop of an episode, of one device or of many at once.

    plant = Single(env, seed=0)
    trace = Trace(("joint_torque_nm",), plant.steps)
    run(plant, controller, trace.keep, measure=measuring.measure)
    trace.columns["joint_torque_nm"]                            # (steps + 1,)

A plant gives columns, numbers or arrays over devices; the controller gets their
measurements; observers get the columns and the torque; the plant advances. Recorded
episodes, cells of the benchmark and batches of designs differ in their plants and
observers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control import Controller
from cc_mujoco.control._registry import controller_errors
from cc_mujoco.errors import CableError

Columns = Mapping[str, Any]  # columns of an episode log that the plant has

Observer = Callable[[int, Columns, NDArray[np.float64]], object]
"""Function of the control step, its columns and the torque that follows [N m]; may
raise."""


class DrivenDevice(Protocol):
    """Plant that a controller drives: one device, or several as arrays."""

    steps: int  # control steps in an episode
    prefixes: tuple[str, ...]
    """Column prefix of each axis; one that is empty for a single axis."""

    def start(self) -> Columns:
        """Begin the episode."""

    def advance(self, torque: NDArray[np.float64]) -> Columns:
        """Advance a control step with a motor torque [N m], one for all or for each.

        Of several axes the torques are (..., axes). That of one device is finite; of
        several, one whose torque is not has failed. Where the episode cannot go on
        there is a `CableError`.
        """


def run(
    plant: DrivenDevice,
    controller: Controller,
    *observers: Observer,
    measure: Callable[[Columns], Columns] = lambda columns: columns,
    name: str = "",
) -> None:
    """Play an episode.

    Args:
        plant: Device that is driven.
        controller: Controller that drives it; reset before.
        observers: Called at every control step, from the start to the end.
        measure: Measurements of the controller by columns; all columns by default.
        name: Name of the controller, for error messages; its own, or that of its class,
            by default.

    Raises:
        CableError: If the controller raises, gives torques of a wrong shape or, of one
            device, a torque that is no finite number, or the plant cannot go on.
    """

    def called() -> str:
        return name or controller.name or type(controller).__name__

    with controller_errors(called()):
        controller.reset()
    columns = plant.start()
    shape = np.shape(columns[f"{plant.prefixes[0]}joint_angle_rad"])
    axes = len(plant.prefixes)
    shapes = ((), shape) if axes == 1 else ((*shape, axes),)
    for step in range(plant.steps + 1):
        seen = measure(columns)
        with controller_errors(called()):
            torque = np.asarray(controller.torque(seen), dtype=float)
        if torque.shape not in shapes:
            each = f", or one for each of {shape[0]} environments" if shape else ""
            right = f"one number{each}" if axes == 1 else f"of shape {shapes[0]}"
            raise CableError(
                f"controller {called()!r} gave torques of shape {torque.shape}; it "
                f"must be {right}."
            )
        for observe in observers:
            observe(step, columns, torque)
        if step < plant.steps:
            if not shape and not np.isfinite(torque).all():
                at = missing_torque_error(called(), step * controller.drive.period)
                raise CableError(f"{at}; it must be a number in N m.")
            columns = plant.advance(torque)


def missing_torque_error(name: str, time: float) -> str:
    return f"controller {name!r} gave no finite torque at {time:.3f} s"


def unstable(why: str) -> CableError:
    return CableError(
        f"{why}; a softer cable, a softer wearer or a smaller time step is stable."
    )


class Single:
    """The device of one environment."""

    def __init__(
        self, env: Any, seed: int, options: Mapping[str, float] | None = None
    ) -> None:
        """Prepare one of this package's environments, wrapped or not.

        The reset has the seed and the options, values of the plant by name.
        """
        self._env, self._inner, self._seed = env, env.unwrapped, seed
        self._options = None if options is None else dict(options)
        self.steps: int = self._inner.exo.steps
        self.prefixes: tuple[str, ...] = self._inner.exo.device.prefixes

    def start(self) -> Columns:
        columns: Columns = self._env.reset(seed=self._seed, options=self._options)[1]
        return columns

    def advance(self, torque: NDArray[np.float64]) -> Columns:
        columns: Columns
        action = self._inner.action(torque)
        _, _, terminated, _, columns = self._env.step(action)
        if terminated:
            raise unstable(f"the simulation diverged at {columns['time_s']:g} s")
        return columns


class Trace:
    """Columns of an episode, kept step by step."""

    def __init__(
        self, names: Sequence[str], steps: int, going: NDArray[np.bool_] | None = None
    ) -> None:
        """Prepare for the named columns of an episode of so many control steps.

        Of many devices those of the mask `going` are kept at each step.
        """
        self._names, self._steps, self._active_mask = tuple(names), steps, going
        self.columns: dict[str, NDArray[np.float64]] = {}
        """Columns by name, (steps + 1, ...); NaN where nothing was kept."""

    def keep(self, step: int, columns: Columns, _: NDArray[np.float64]) -> None:
        """Keep the columns of a control step; an `Observer`."""
        if not self.columns:
            self.columns = {
                name: np.full((self._steps + 1, *np.shape(columns[name])), np.nan)
                for name in self._names
            }
        mask = self._active_mask
        for name, kept in self.columns.items():
            if mask is None or mask.all():
                kept[step] = columns[name]
            else:
                kept[step, mask] = columns[name][mask]
