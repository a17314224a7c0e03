"""Many designs at once, with perfect sensors: a study compares transmissions.

Where task and controller are known as compiled code, they run inside MuJoCo's steps,
with the same bits.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import SimulationError
from numpy.typing import NDArray

from cc_mujoco.control import AdaptiveModel, Controller, controller
from cc_mujoco.control._controller import STEPS, SteppedController, stepped_law
from cc_mujoco.control._registry import Unpowered, batched_controller
from cc_mujoco.device import Plant
from cc_mujoco.device._description import Description
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._model import DeviceModel
from cc_mujoco.device._sensors import PERFECT_SENSING
from cc_mujoco.human import Task, Trajectory, Wearer
from cc_mujoco.plugin import Reader
from cc_mujoco.simulation import _compiled_episode as compiled
from cc_mujoco.simulation._batch import Batch
from cc_mujoco.simulation._compiled_episode import (
    KEPT,
    PER_CABLE,
    READ_COLUMNS,
    RECORD,
    attend,
)
from cc_mujoco.simulation._loop import Columns, missing_torque_error
from cc_mujoco.simulation._reference_motion import MARKS, Script
from cc_mujoco.simulation._wiring import OF_PHASE, TASKS, parameters_of
from cc_mujoco.simulation._worn_device import TaskChoice, WornDevice

Array = NDArray[np.float64]

_ONE = threading.Lock()
TICK_STEPS = 200
"""Control steps between two calls of a tick."""

CABLE_NAMES = ("tension_n", "dissipated_j", "least_tension_n")
"""Columns of all cables that change from step to step; `KEPT` are those of an axis."""


@dataclass(frozen=True)
class Episode:
    """Episode that all designs of a batch play."""

    description: Description
    trajectory: str | Trajectory
    task: TaskChoice
    duration: float
    frame_skip: int
    seed: int
    controller: str | Mapping[str, str] | None
    """Name, for all axes or by axis; without one the motors give no torque."""
    wearer: Wearer | Mapping[str, Wearer] | None = None
    """At the only driven joint, or by joint; that of the models by default."""

    def device(self, model: mujoco.MjModel) -> DeviceModel:
        return DeviceModel(self.description, model, self.wearer)

    def exo(self, model: mujoco.MjModel) -> WornDevice:
        return WornDevice(
            self.description,
            model,
            self.trajectory,
            self.task,
            self.duration,
            self.frame_skip,
            self.wearer,
        )


@dataclass(frozen=True, eq=False)
class Rollout:
    """An episode of n designs at T control steps, the reset included.

    Attributes:
        columns: those of an episode log, (n, T). Those of c cables are (n, c, T) and
            `tension_n`, proximal and distal end of each cable in turn, (n, 2 c, T);
            `least_tension_n` is below 0 where a cable is slack.
        ratio: joint angle per motor angle of an unstretched cable, (n, axes).
        driven: names of the cables that each motor winds.
        prefixes: beginnings of the columns of each axis.
        failed: why the simulation of a design failed, empty where it did not, (n,).
    """

    columns: dict[str, Array]
    ratio: Array
    driven: tuple[tuple[str, ...], ...]
    prefixes: tuple[str, ...]
    failed: tuple[str, ...]


def attended(plant: Plant) -> mujoco.MjModel:
    """Compile the bare model of a plant that may be played inside MuJoCo's steps."""
    spec = plant.spec()
    with _ONE:  # two threads would register the plugin twice
        attend(spec)  # at last, as a copy loses what no element refers to
    return spec.compile()


def play(
    episode: Episode,
    models: Sequence[mujoco.MjModel],
    threads: int = 1,
    tick: Callable[[float], object] = lambda share: None,
) -> Rollout:
    """Play an episode on each of several models of equal layout, one per design.

    `tick` is called now and then with the share that is done.
    """
    exo = episode.exo(models[0])
    devices = [exo.device, *(episode.device(model) for model in models[1:])]
    drives = [
        [PERFECT_SENSING.equip(drive) for drive in exo.drives_of(device)]
        for device in devices
    ]
    name, driven, prefixes = episode.controller, exo.device.driven, exo.device.prefixes
    ratio = np.array([[1.0 / drive.ratio for drive in own] for own in drives])
    called = name if isinstance(name, str) else ""
    laws = None
    if len(prefixes) == 1 and not isinstance(name, Mapping):
        laws = _compiled_laws(name, [own[0] for own in drives], devices, exo)
    batch = Batch([exo], [episode.seed], devices, threads=threads, name=called)
    if laws is not None:
        columns = CompiledEpisodes(batch, laws).play(tick)
        columns |= _scripted(batch.script, exo, len(devices))
        tick(1.0)
        return Rollout(columns, ratio, driven, prefixes, tuple(batch.failed))
    law: Controller
    if name is None:
        law = Unpowered(drives[0][0], axes=len(prefixes))
    else:
        law = batched_controller(name, drives, prefixes)
    measuring = exo.controller_sensors(PERFECT_SENSING, drives[0], episode.seed)
    kept_names = [prefix + name for prefix in prefixes for name in KEPT]

    def report(step: int, _: Columns, __: object) -> None:
        if step % TICK_STEPS == 0:
            tick(step / exo.steps)

    kept = batch.play(law, measuring.measure, (*kept_names, *CABLE_NAMES), report)
    columns = {}
    while kept:  # what is turned is let go, so that memory holds it once
        name, values = kept.popitem()
        columns[name] = np.ascontiguousarray(np.moveaxis(values, 0, -1))
    columns |= _scripted(batch.script, exo, len(devices))
    tick(1.0)
    return Rollout(columns, ratio, driven, prefixes, tuple(batch.failed))


def _scripted(script: Script, exo: WornDevice, count: int) -> dict[str, Array]:
    """Return the columns that are the same for all designs, (n, T)."""
    shape = (count, exo.steps + 1)
    time = np.arange(exo.steps + 1) * exo.period
    columns = {"time_s": np.broadcast_to(time, shape)}
    names = {"reference_angle_rad": 0, "phase_sine": 2, "phase_cosine": 3}
    for axis, prefix in enumerate(exo.device.prefixes):
        for name, place in names.items():
            mark = np.ascontiguousarray(script.marks[:, MARKS * axis + place])
            columns[prefix + name] = np.broadcast_to(mark, shape)
    return columns


def _compiled_laws(
    name: str | None,
    drives: Sequence[Drive],
    devices: Sequence[DeviceModel],
    exo: WornDevice,
) -> list[Controller | None] | None:
    """Return the laws that run inside MuJoCo's steps; None where only Python can."""
    laws = [None if name is None else controller(name, drive) for drive in drives[:1]]
    plain = all(axis.plain for device in devices for axis in device.axes)
    if not plain or task_of(exo.task) is None or law_of(laws[0]) is None:
        return None
    if name is None:
        return laws * len(drives)
    return laws + [controller(name, drive) for drive in drives[1:]]


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
