"""The records of a batch: one for every design, with all that it points to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control import Controller, laws
from cc_mujoco.control.feed_forward import FeedForward
from cc_mujoco.control.model import CableModel
from cc_mujoco.control.model_based import ModelBased
from cc_mujoco.control.proportional_integral import Feedback, ProportionalIntegral
from cc_mujoco.control.stiction import StictionCompensation
from cc_mujoco.engine import Reader, cables
from cc_mujoco.envs.device import Device
from cc_mujoco.envs.script import Script
from cc_mujoco.human import Spring, Task, Tunnel
from cc_mujoco.whatif.inner.plugin import instant
from cc_mujoco.whatif.inner.record import KEPT, PER_CABLE, Asked, Law, Number, Word

Array = NDArray[np.float64]

LAWS: dict[type[Controller], Law] = {
    FeedForward: Law.FEED_FORWARD,
    ProportionalIntegral: Law.FEEDBACK,
    Feedback: Law.FEEDBACK,
    ModelBased: Law.MODEL,
    StictionCompensation: Law.STICTION,
}
"""Controllers that are known as compiled code; not their subclasses."""


def asked_by(task: Task) -> Asked | None:
    """Return how a task is asked inside a step; None where Python alone knows it."""
    if type(task) is Tunnel:
        return Asked.TUNNEL
    if type(task) is Spring:
        return Asked.SPRING
    return Asked.OF_PHASE if task.of_phase else None


def law_of(controller: Controller | None) -> Law | None:
    """Return the law of a controller inside a step; None where Python alone knows it.

    Args:
        controller: None for a motor that gives no torque.
    """
    if controller is None:
        return Law.UNPOWERED
    return LAWS.get(type(controller))


class Players:
    """The records of designs of equal layout, and what they keep."""

    def __init__(
        self,
        devices: Sequence[Device],
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
            task: Which `asked_by` must know.
            script: What the wearers do.
            steps: Control steps of the episode.
            skip: Physics steps in a control step.
        """
        first, count = devices[0], len(devices)
        names = cables(first.model)
        width = len(KEPT) + PER_CABLE * len(names)
        self.kept = np.full((count, width, steps + 1), np.nan)
        """Kept columns, `record.KEPT` and then of each cable; NaN from a failure on."""
        self._cables = len(names)
        self._words = np.zeros((count, len(Word)), dtype=np.int64)
        numbers = np.zeros((count, len(Number)))
        # Everything whose address a record holds, so that it stays.
        self._held: list[Any] = [numbers]
        self._models: list[CableModel | None] = []
        readings = self._hold(_readings(first, names))
        commands = self._hold(np.ascontiguousarray(script.commands))
        controls = self._hold(np.array(first.script_controls, dtype=np.int64))
        kind = asked_by(task)
        assert kind is not None
        desired = np.zeros((count, 0))
        if kind is Asked.OF_PHASE:
            phase = script.marks[:, 1:2]
            nothing = np.zeros_like(phase)
            asked = np.asarray(task.torque(nothing, nothing, phase), dtype=float)
            asked = np.broadcast_to(asked, (steps + 1, max(asked.shape[1], 1)))
            desired = self._hold(np.ascontiguousarray(asked.T))
        for row, (device, law) in enumerate(zip(devices, controllers, strict=True)):
            words, own = self._words[row], numbers[row]
            self._describe(words, own, device)
            known = law_of(law)
            assert known is not None
            words[Word.LAW], words[Word.ASKED] = known, kind
            words[Word.SKIP], words[Word.STEPS] = skip, steps
            words[Word.SCRIPTED] = len(controls)
            words[Word.SCRIPT_CONTROLS] = controls.ctypes.data
            words[Word.COMMANDS] = commands.ctypes.data
            words[Word.CABLES], words[Word.READINGS] = len(names), readings.ctypes.data
            words[Word.NUMBERS] = own.ctypes.data
            words[Word.COLUMNS] = self.kept[row].ctypes.data
            if desired.size:
                each = desired[row % len(desired)]
                words[Word.DESIRED] = each.ctypes.data
            if isinstance(task, Tunnel):
                own[Number.HALF_WIDTH] = task.half_width
                own[Number.MOST] = task.limit
            if isinstance(task, (Tunnel, Spring)):
                own[Number.STIFFNESS] = task.stiffness
            self._instruct(words, own, law)

    def begin(self, row: int, data: mujoco.MjData) -> None:
        """Take a simulation at the start of its episode; its `ctrl` is written."""
        words, known = self._words[row], self._models[row]
        if known is not None:
            known.reset()
            known.ready(data.qpos[[words[Word.MOTOR_Q]]])
        instant()(data._address, words.ctypes.data)

    def refused(self, row: int) -> bool:
        """Return whether the controller of a design gave no finite torque."""
        return bool(self._words[row, Word.REFUSED])

    def at(self, row: int, more: int = 0) -> int:
        """Control step that a design is in, so many physics steps further."""
        count, skip = self._words[row, [Word.COUNT, Word.SKIP]]
        return int((count + more) // skip)

    def failed_at(self, row: int, counted: bool) -> int:
        """Control step that a design whose simulation failed did not reach.

        Args:
            row: Which.
            counted: Whether the physics step that failed has been counted, as it is
                where MuJoCo only warns, neither resets nor raises.
        """
        return self.at(row, -1 if counted else 0) + 1

    def forget(self, row: int, first: int) -> None:
        """Keep nothing of a design from a control step on."""
        self.kept[row, :, first:] = np.nan

    def columns(self) -> dict[str, Array]:
        """Columns as in `simulate.Rollout`, views of what is kept."""
        found = {name: self.kept[:, place] for place, name in enumerate(KEPT)}
        first, count = len(KEPT), self._cables
        parts = {"tension_n": 2, "dissipated_j": 1, "least_tension_n": 1}
        for name, each in parts.items():
            found[name] = self.kept[:, first : first + each * count]
            first += each * count
        return found

    def _hold(self, array: NDArray[Any]) -> NDArray[Any]:
        self._held.append(array)
        return array

    def _describe(self, words: NDArray[np.int64], own: Array, device: Device) -> None:
        """Write the places of the device in the arrays, and its numbers."""
        places, winding = device.places, device.winding
        words[Word.MOTOR_CONTROL] = device.motor_control
        words[Word.MOTOR_Q], words[Word.MOTOR_V] = places.motor_q, places.motor_v
        words[Word.JOINT_Q], words[Word.JOINT_V] = places.joint_q, places.joint_v
        words[Word.MOTOR_OUT] = places.motor_out
        words[Word.WEARER_OUT] = places.wearer_out
        own[Number.MOTOR_GEAR], own[Number.SCALE] = (
            device.motor_gear,
            device.motor_scale,
        )
        own[Number.LIMIT] = device.torque_limit
        if winding is not None:
            arms = np.array([*winding.places, *winding.dofs], dtype=np.int64)
            words[Word.WOUND] = len(winding.places)
            words[Word.ARMS] = self._hold(arms).ctypes.data
            words[Word.WOUND_OWN] = winding.own
            own[Number.LEVERAGE_ARM] = winding.arm

    def _instruct(
        self, words: NDArray[np.int64], own: Array, law: Controller | None
    ) -> None:
        """Write the data that the law of a design uses."""
        seen = self._hold(np.zeros(16))
        words[Word.SEEN] = seen.ctypes.data
        self._models.append(None)
        if law is None:
            return
        law.reset()
        self._held.append(law)  # it owns the arrays below
        if isinstance(law, ProportionalIntegral):
            gains = self._hold(law.gains.packed)
            words[Word.MEMORY] = law.memory(1).ctypes.data
            own[Number.CABLE_STIFFNESS] = law.stiffness[0]
        else:
            drive = law.drive
            limits = laws.Gains(drive.ratio, drive.low, drive.high, drive.period)
            gains = self._hold(limits.packed)
        words[Word.GAINS] = gains.ctypes.data
        if not isinstance(law, ModelBased):
            return
        model = law.model
        self._models[-1] = model
        arrays = {
            Word.SEGMENTS: self._hold(np.array(model.segments, dtype=np.int64)),
            Word.PROXIMAL: model.proximal,
            Word.DISTAL: model.distal,
            Word.PACKED: model.packed,
            Word.STATE: model.state,
            Word.JOINT: model.joint,
            Word.SLIP_DIRECTION: model.slip_direction,
            Word.GAIN: model.gain,
            Word.ARM: model.arm,
            Word.NEW: model.new,
            Word.WORK: model.work,
            Word.SCRATCH: model.scratch,
        }
        for word, array in arrays.items():
            words[word] = array.ctypes.data
        words[Word.MODEL_CABLES] = model.segments.size
        words[Word.PACKED_SIZE], words[Word.STATE_SIZE] = (
            model.packed.shape[-1],
            model.state.shape[-1],
        )
        words[Word.WORK_SIZE] = model.work.size


def _readings(device: Device, names: Sequence[str]) -> NDArray[np.int64]:
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
