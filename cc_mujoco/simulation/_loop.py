"""Control loop of an episode, of one device or of many at once.

    plant = Single(env, seed=0)
    trace = Trace(("joint_torque_nm",), plant.steps)
    run(plant, controller, trace.keep, measure=measuring.measure)
    trace.columns["joint_torque_nm"]                            # (steps + 1,)

At each control step the plant gives columns (numbers, or arrays over devices), the
controller gets measurements of them and returns a torque, observers get columns and
torque, and the plant advances. Recorded episodes, cells of the benchmark and batches of
designs differ in their plants and observers.
"""

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
    """Plant for `run`: one device, or several whose columns are arrays over devices."""

    steps: int  # control steps in an episode
    prefixes: tuple[str, ...]
    """Column prefix of each axis; one that is empty for a single axis."""

    def start(self) -> Columns:
        """Begin the episode; return its columns at the start."""

    def advance(self, torque: NDArray[np.float64]) -> Columns:
        """Advance a control step with motor torques [N m]; return the columns.

        The torque is a number for all devices or (devices,), with several axes (...,
        axes). For one device it is finite; of several, one whose torque is not finite
        has failed. Raises `CableError` if the episode cannot go on.
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
        controller: Controller that drives it; it is reset first.
        observers: Called at every control step, from the start to the end.
        measure: Function from the columns to the controller's measurements; by
            default the columns themselves.
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
    """One environment as a `DrivenDevice`."""

    def __init__(
        self, env: Any, seed: int, options: Mapping[str, float] | None = None
    ) -> None:
        """Prepare one of this package's environments, wrapped or not.

        It is reset with `seed` and `options`, which are parameters of the plant by
        name.
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
    """Recorder of some columns of an episode, in memory."""

    def __init__(
        self, names: Sequence[str], steps: int, going: NDArray[np.bool_] | None = None
    ) -> None:
        """Prepare for columns `names` of an episode of `steps` control steps.

        With a mask `going` (devices,), which may change, others' values stay NaN.
        """
        self._names, self._steps, self._active_mask = tuple(names), steps, going
        self.columns: dict[str, NDArray[np.float64]] = {}
        """Columns by name, (steps + 1, ...); NaN where nothing was kept."""

    def keep(self, step: int, columns: Columns, _: NDArray[np.float64]) -> None:
        """Record the columns of a control step; an `Observer` for `run`."""
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
