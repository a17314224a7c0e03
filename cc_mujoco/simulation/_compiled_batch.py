"""A batch of compiled episodes: a record for every device, with all it points to.

if task_of(exo.task) is not None and law_of(law) is not None:
columns = CompiledEpisodes(batch, laws).play(tick)
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import SimulationError
from numpy.typing import NDArray

from cc_mujoco.control import AdaptiveModel, Controller
from cc_mujoco.control._stepped_laws import STEPS, SteppedController, stepped_law
from cc_mujoco.device._model import DeviceModel
from cc_mujoco.human import Task
from cc_mujoco.plugin import Reader
from cc_mujoco.simulation import _compiled_episode as compiled
from cc_mujoco.simulation._batch import Batch
from cc_mujoco.simulation._compiled_episode import KEPT, PER_CABLE, READ_COLUMNS, RECORD
from cc_mujoco.simulation._loop import missing_torque_error
from cc_mujoco.simulation._wiring import OF_PHASE, TASKS, parameters_of

Array = NDArray[np.float64]

TICK_STEPS = 200
"""Control steps between two calls of a tick."""


def task_of(task: Task) -> int | None:
    """Return a task as the record has it; None where Python alone knows it."""
    return TASKS.get(type(task), OF_PHASE if task.of_phase else None)


def law_of(controller: Controller | None) -> int | None:
    """Return a law as the record has it; None where Python alone knows it.

    Args:
        controller: None for a motor that gives no torque.
    """
    if controller is None:
        return compiled.UNPOWERED
    law = stepped_law(type(controller))
    is_exact = not getattr(controller, "mismatch", 0.0)
    return STEPS.index(law.step) if law is not None and is_exact else None


class CompiledEpisodes:
    """The records of the devices of a batch, and what they keep."""

    def __init__(self, batch: Batch, controllers: Sequence[Controller | None]) -> None:
        """Write them.

        Args:
            batch: Of devices of one axis and one script; `task_of` must know the task.
            controllers: One for each; `law_of` must know them.
        """
        self._batch, devices, script = batch, batch.devices, batch.script
        exo, self._hold = batch.exo, batch.wiring.hold
        steps, task = exo.steps, exo.task
        first, count = devices[0], len(devices)
        names = batch.cables
        width = len(KEPT) + PER_CABLE * len(names)
        self.kept = np.full((count, width, steps + 1), np.nan)
        """Kept columns, `KEPT` and then of each cable; NaN from a failure on."""
        self._records = np.zeros(count, RECORD)
        common = {
            "skip": exo.frame_skip,
            "steps": steps,
            "scripted": len(first.script_controls),
            "script_controls": self._hold(np.array(first.script_controls, np.int64)),
            "commands": self._hold(np.ascontiguousarray(script.commands)),
            "cables": len(names),
            "readings": self._hold(_readings(first, names)),
            "task": task_of(task),
        }
        desired: list[int] = []
        if common["task"] == OF_PHASE:
            phase = script.marks[:, 1:2]
            nothing = np.zeros_like(phase)
            torques = np.asarray(task.torque(nothing, nothing, phase), dtype=float)
            torques = np.broadcast_to(torques, (steps + 1, max(torques.shape[1], 1)))
            desired = [self._hold(np.ascontiguousarray(one)) for one in torques.T]
        else:
            common["task_parameters"] = self._hold(parameters_of(task))
        for row, law in enumerate(controllers):
            found = common | self._write_law_data(law)
            found["axis"] = batch.wiring.axis_address(row)
            found["columns"] = self.kept[row].ctypes.data
            if desired:
                found["desired"] = desired[row % len(desired)]
            for name, value in found.items():
                self._records[row][name] = value

    def _begin(self, row: int, data: mujoco.MjData) -> None:
        """Take a simulation at the start of its episode; its `ctrl` is written."""
        address = self._records[row : row + 1].ctypes.data
        compiled.begin_episode()(data._address, address)

    def _at(self, row: int, more: int = 0) -> int:
        """Control step that a device is in, so many physics steps further."""
        record = self._records[row]
        return int((record["count"] + more) // record["skip"])

    def _columns(self) -> dict[str, Array]:
        found = {name: self.kept[:, place] for place, name in enumerate(KEPT)}
        first, count = len(KEPT), len(self._batch.cables)
        parts = {"tension_n": 2, "dissipated_j": 1, "least_tension_n": 1}
        for name, each in parts.items():
            found[name] = self.kept[:, first : first + each * count]
            first += each * count
        return found

    def _write_law_data(self, made: Controller | None) -> dict[str, Any]:
        """Return what the law of a device uses."""
        place = law_of(made)
        if not isinstance(made, SteppedController):
            return {"law": place}
        law, tables, memory = made.stepped, made.law_tables(), made.fresh_memory()
        shape = np.array(tables.shape, np.int64)
        sources = np.array([READ_COLUMNS.index(name) for name in law.wound])
        taps: list[int] = []
        if isinstance(made, AdaptiveModel):
            cables = self._batch.exo.device.driven[0]
            for name, nodes in zip(cables, made.taps.nodes, strict=True):
                first = Reader(self._batch.devices[0].model, name).nodes.start
                taps += (first + nodes).tolist()
        return {
            "law": place,
            "memory": self._hold(memory),
            "memory_size": memory.size,
            "shape": self._hold(shape),
            "shape_size": shape.size,
            "tables": self._hold(np.array(tables.numbers)),
            "tables_size": len(tables.numbers),
            "sources": self._hold(sources),
            "source_count": len(sources),
            "taps": self._hold(np.array(taps, np.int64)),
            "tap_count": len(taps),
            "is_round": law.is_round,
            "seen": self._hold(np.zeros(len(sources) + len(taps))),
        }

    def play(self, tick: Callable[[float], object]) -> dict[str, Array]:
        """Play the episodes inside MuJoCo's steps.

        Args:
            tick: Called now and then with the share that is done.

        Returns:
            Columns as in `rollout.Rollout`, NaN where a device has failed.
        """
        batch, exo = self._batch, self._batch.exo
        simulations, failed, going = batch.simulations, batch.failed, batch.going
        for row, device in enumerate(batch.devices):
            simulations.start(row, device, batch.script, partial(self._begin, row))
        attended = simulations.batch.bind("userdata")[:, 0]
        for step in range(0, exo.steps, TICK_STEPS):
            for row in np.flatnonzero(going & (self._records["refused"] != 0)).tolist():
                time = self._at(row) * exo.period
                failed[row] = missing_torque_error(batch.name, time)
                self.kept[row, :, self._at(row) + 1 :] = np.nan
                going[row] = False
            tick(step / exo.steps)
            if not going.any():
                break
            last = min(step + TICK_STEPS, exo.steps)
            with contextlib.suppress(SimulationError):
                simulations.roll((last - step) * exo.frame_skip, going)
            for row in np.flatnonzero(simulations.fell & going).tolist():
                # What MuJoCo resets is attended no more; what raised is as it was.
                over = last == exo.steps and self._at(row) == last
                is_counted = simulations.batch.status[row] == 0 and (
                    over or attended[row] != 0.0
                )
                first = self._at(row, -1 if is_counted else 0) + 1
                failed[row] = simulations.why(row, first * exo.period)
                self.kept[row, :, first:] = np.nan
                going[row] = False
        return self._columns()


def _readings(device: DeviceModel, names: Sequence[str]) -> NDArray[np.int64]:
    """Locate each cable in `plugin_state` and `actuator_force`, see `Word`."""
    readers = [Reader(device.model, name) for name in names]
    ends = np.reshape(device.cable_outputs, (-1, 2))
    return np.array(
        [
            (one.nodes.start, one.nodes.stop - one.nodes.start, one.energy, *pair)
            for one, pair in zip(readers, ends, strict=True)
        ],
        dtype=np.int64,
    )
