"""A batch of compiled episodes: a record for every device, with all that it points to.

if is_compiled(task, law):
failed = play_compiled(episodes, exo, devices, script, threads, name, tick)
columns = episodes.columns()
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import SimulationError
from numpy.typing import NDArray

from cc_mujoco.control import Controller
from cc_mujoco.control._cable_model import CableModel
from cc_mujoco.control._compiled_laws import LAW_INPUTS
from cc_mujoco.control._feed_forward import FeedForward
from cc_mujoco.control._model_based import ModelBased
from cc_mujoco.control._proportional_integral import Feedback, ProportionalIntegral
from cc_mujoco.control._stiction import StictionCompensation
from cc_mujoco.control._tuned_feedback import TunedFeedback
from cc_mujoco.device._model import DeviceModel
from cc_mujoco.device._moment_arm import MIN_LEVERAGE as LEAST_LEVERAGE
from cc_mujoco.device._moment_arm import Winding
from cc_mujoco.human import Spring, Task, Tunnel
from cc_mujoco.plugin import Reader, cables
from cc_mujoco.simulation import _compiled_episode as compiled
from cc_mujoco.simulation._batch import Simulations
from cc_mujoco.simulation._compiled_episode import KEPT, PER_CABLE, RECORD
from cc_mujoco.simulation._loop import missing_torque_error
from cc_mujoco.simulation._reference_motion import Script
from cc_mujoco.simulation._worn_device import WornDevice

Array = NDArray[np.float64]

TICK_STEPS = 200
"""Control steps between two calls of a tick."""

LAWS: dict[type[Controller], int] = {
    FeedForward: compiled.FEED_FORWARD,
    ProportionalIntegral: compiled.FEEDBACK,
    Feedback: compiled.FEEDBACK,
    TunedFeedback: compiled.TUNED,
    ModelBased: compiled.MODEL,
    StictionCompensation: compiled.STICTION,
}
"""Controllers that are known as compiled code; not their subclasses."""

TASKS: dict[type[Task], int] = {Tunnel: compiled.TUNNEL, Spring: compiled.SPRING}
"""Tasks that are; so is every one that is of the phase alone."""


def task_of(task: Task) -> int | None:
    """Return a task as the record has it; None where Python alone knows it."""
    return TASKS.get(type(task), compiled.OF_PHASE if task.of_phase else None)


def law_of(controller: Controller | None) -> int | None:
    """Return a law as the record has it; None where Python alone knows it.

    Args:
        controller: None for a motor that gives no torque.
    """
    if controller is None:
        return compiled.UNPOWERED
    if isinstance(controller, TunedFeedback) and controller.dead_sigmas:
        return None
    return LAWS.get(type(controller))


class CompiledEpisodes:
    """The records of devices of equal layout, and what they keep."""

    def __init__(
        self,
        devices: Sequence[DeviceModel],
        controllers: Sequence[Controller | None],
        task: Task,
        script: Script,
        steps: int,
        skip: int,
    ) -> None:
        """Write them.

        Args:
            devices: Of equal layout.
            controllers: One for each; `law_of` must know them.
            task: Which `task_of` must know.
            script: What the wearers do.
            steps: Control steps of the episode.
            skip: Physics steps in a control step.
        """
        first, count = devices[0], len(devices)
        names = cables(first.model)
        width = len(KEPT) + PER_CABLE * len(names)
        self.kept = np.full((count, width, steps + 1), np.nan)
        """Kept columns, `KEPT` and then of each cable; NaN from a failure on."""
        self._cables = len(names)
        self._records = np.zeros(count, RECORD)
        # Everything whose address a record holds, so that it stays.
        self._held: list[Any] = []
        self._models: list[CableModel | None] = []
        common = {
            "skip": skip,
            "steps": steps,
            "scripted": len(first.script_controls),
            "script_controls": self._hold(np.array(first.script_controls, np.int64)),
            "commands": self._hold(np.ascontiguousarray(script.commands)),
            "cables": len(names),
            "readings": self._hold(_readings(first, names)),
            "task": task_of(task),
        }
        desired: list[int] = []
        if common["task"] == compiled.OF_PHASE:
            phase = script.marks[:, 1:2]
            nothing = np.zeros_like(phase)
            torques = np.asarray(task.torque(nothing, nothing, phase), dtype=float)
            torques = np.broadcast_to(torques, (steps + 1, max(torques.shape[1], 1)))
            desired = [self._hold(np.ascontiguousarray(one)) for one in torques.T]
        else:
            given = np.zeros(3)
            own = dataclasses.astuple(task)  # type: ignore[call-overload]
            given[: len(own)] = own
            common["task_parameters"] = self._hold(given)
        for row, (device, law) in enumerate(zip(devices, controllers, strict=True)):
            found = common | self._write_device(device) | self._write_law_data(law)
            found["columns"] = self.kept[row].ctypes.data
            if desired:
                found["desired"] = desired[row % len(desired)]
            for name, value in found.items():
                self._records[row][name] = value

    def begin(self, row: int, data: mujoco.MjData) -> None:
        """Take a simulation at the start of its episode; its `ctrl` is written."""
        known = self._models[row]
        if known is not None:
            known.reset()
            known.ready(data.qpos[[self._records[row]["motor_q"]]])
        address = self._records[row : row + 1].ctypes.data
        compiled.begin_episode()(data._address, address)

    def refused(self, row: int) -> bool:
        """Return whether the controller of a device gave no finite torque."""
        return bool(self._records[row]["refused"])

    def at(self, row: int, more: int = 0) -> int:
        """Control step that a device is in, so many physics steps further."""
        record = self._records[row]
        return int((record["count"] + more) // record["skip"])

    def failed_at(self, row: int, counted: bool) -> int:
        """Control step that a device whose simulation failed did not reach.

        Args:
            row: Which.
            counted: Whether the physics step that failed has been counted, as it is
                where MuJoCo only warns, neither resets nor raises.
        """
        return self.at(row, -1 if counted else 0) + 1

    def forget(self, row: int, first: int) -> None:
        """Keep nothing of a device from a control step on."""
        self.kept[row, :, first:] = np.nan

    def columns(self) -> dict[str, Array]:
        """Columns as in `rollout.Rollout`, views of what is kept."""
        found = {name: self.kept[:, place] for place, name in enumerate(KEPT)}
        first, count = len(KEPT), self._cables
        parts = {"tension_n": 2, "dissipated_j": 1, "least_tension_n": 1}
        for name, each in parts.items():
            found[name] = self.kept[:, first : first + each * count]
            first += each * count
        return found

    def _hold(self, array: NDArray[Any]) -> int:
        """Keep an array and return its address."""
        self._held.append(array)
        return int(array.ctypes.data)

    def _write_device(self, device: DeviceModel) -> dict[str, Any]:
        """Return the places of a device in the arrays, and its numbers."""
        (axis,) = device.axes
        found = {
            **axis.places._asdict(),
            "motor_control": axis.motor_control,
            "motor_gear": axis.motor_gear,
            "motor_scale": axis.motor_scale,
            "torque_limit": axis.torque_limit,
        }
        winding = axis.winding  # `plain` axes have no table
        if isinstance(winding, Winding):
            arms = np.array([*winding.places, *winding.dofs], dtype=np.int64)
            found |= {
                "wound": len(winding.places),
                "arms": self._hold(arms),
                "own_arm": winding.own,
                "winding_arm": winding.arm,
                "wound_end": winding.end,
                "wound_length": winding.length,
                "timestep": winding.step,
                "least_leverage": LEAST_LEVERAGE,
            }
        return found

    def _write_law_data(self, law: Any) -> dict[str, Any]:
        """Return what the law of a device uses."""
        found = {"law": law_of(law), "seen": self._hold(np.zeros(len(LAW_INPUTS)))}
        self._models.append(None)
        if law is None:
            return found
        law.reset()
        self._held.append(law)  # it owns the arrays below
        found["gains"] = self._hold(law.gains.packed)
        if isinstance(law, ProportionalIntegral):
            found["memory"] = law.memory(1).ctypes.data
            found["spring"] = law.spring.ctypes.data
        if not isinstance(law, ModelBased):
            return found
        model = law.model
        self._models[-1] = model
        arrays = (
            "proximal", "distal", "packed", "state", "joint", "slip_direction", "gain",
            "arm", "new", "work", "scratch",
        )  # fmt: skip
        return found | {
            **{name: getattr(model, name).ctypes.data for name in arrays},
            "segments": self._hold(np.array(model.segments, dtype=np.int64)),
            "model_cables": model.segments.size,
            "packed_size": model.packed.shape[-1],
            "state_size": model.state.shape[-1],
            "work_size": model.work.size,
        }


def play_compiled(
    episodes: CompiledEpisodes,
    exo: WornDevice,
    devices: Sequence[DeviceModel],
    script: Script,
    threads: int = 1,
    name: str = "",
    tick: Callable[[float], object] = lambda share: None,
) -> tuple[str, ...]:
    """Play the episodes inside MuJoCo's steps.

    Args:
        episodes: What is played and kept.
        exo: Of the first device.
        devices: Those of the episodes.
        script: What the wearers do.
        threads: Threads that simulate; 0 means one per processor.
        name: Of the controller, for the reasons of failures.
        tick: Called now and then with the share that is done.

    Returns:
        Reasons of the simulations that failed, else empty.
    """
    count, skip = len(devices), exo.frame_skip
    models = [device.model for device in devices]
    simulations = Simulations(exo, count, models, threads)
    for row, device in enumerate(devices):
        simulations.start(row, device, script, partial(episodes.begin, row))
    failed = [""] * count
    going = np.ones(count, dtype=np.bool_)
    attended = simulations.batch.bind("userdata")[:, 0]
    for step in range(0, exo.steps, TICK_STEPS):
        refused = [n for n in np.flatnonzero(going).tolist() if episodes.refused(n)]
        for row in refused:
            failed[row] = missing_torque_error(name, episodes.at(row) * exo.period)
            episodes.forget(row, episodes.at(row) + 1)
        going[refused] = False
        tick(step / exo.steps)
        if not going.any():
            break
        last = min(step + TICK_STEPS, exo.steps)
        with contextlib.suppress(SimulationError):
            simulations.roll((last - step) * skip, going)
        fell = simulations.fell & going
        for row in np.flatnonzero(fell).tolist():
            # What MuJoCo resets is attended no more, and what raised is as it was.
            over = last == exo.steps and episodes.at(row) == last
            counted = simulations.batch.status[row] == 0 and (
                over or attended[row] != 0.0
            )
            first = episodes.failed_at(row, counted)
            failed[row] = simulations.why(row, first * exo.period)
            episodes.forget(row, first)
        going &= ~fell
    return tuple(failed)


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
