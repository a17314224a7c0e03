"""Many devices at once: one batch of simulations, each on a model of its own.

    batch = Batch([worn], seeds=[0])
    sensors = worn.controller_sensors(sensing, worn.drives, [0])
    law = controller("pi", worn.drive)
    columns = batch.play(law, sensors.measure, ["joint_torque_nm"])

The arithmetic of a device is that of the environment played alone, number by number, so
its results are the same bits in any company and on any number of threads.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from typing import Protocol

import mujoco
import numpy as np
from gymnasium.utils import seeding
from mujoco import batch as mujoco_batch
from numpy.typing import NDArray

from cc_mujoco._utils.exclusive import exclusive
from cc_mujoco.control import Controller
from cc_mujoco.device import Plant
from cc_mujoco.device._axis_record import Physics
from cc_mujoco.device._model import DeviceModel, physics_of
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.plugin import Reader, cables, untimed
from cc_mujoco.simulation import _loop as loop
from cc_mujoco.simulation._loop import Columns, Observer
from cc_mujoco.simulation._reference_motion import Script
from cc_mujoco.simulation._wiring import Wiring
from cc_mujoco.simulation._worn_device import WornDevice

Mask = NDArray[np.bool_]


class Worlds(Protocol):
    """Simulations of n devices of one layout, as an environment advances them.

    `Simulations` has them in MuJoCo, `_warp_worlds.WarpWorlds` in mujoco_warp.
    """

    physics: Physics
    """Positions, velocities and the results of the last physics step, (n, ...)."""

    @property
    def warned(self) -> Mask:
        """Mask of the simulations whose episode ended with a warning, (n,)."""

    def clear(self, rows: NDArray[np.intp]) -> None:
        """Forget the past of some simulations, which `start` follows."""

    def vary(self, row: int, plant: Plant) -> None:
        """Give a simulation a plant, that of its device's model now."""

    def start(self, row: int, device: DeviceModel, script: Script) -> None:
        """Bring a simulation to the start of an episode."""

    def advance(self, control: Array, going: Mask) -> None:
        """Advance some by a sample, with (n, physics steps, controls)."""


class Simulations:
    """Simulations of n devices of one layout, advanced together by MuJoCo."""

    def __init__(
        self,
        exo: WornDevice,
        count: int,
        models: Sequence[mujoco.MjModel] | None = None,
        threads: int = 0,
    ) -> None:
        """Make n simulations, on the model of `exo` or on one each.

        `start` every one before it is advanced. 0 threads are one per processor.
        """
        device = exo.device
        # Different cables in one simulation's memory would be read anew in every step.
        own = bool(exo.plants.varied) or models is not None
        self.batch = mujoco_batch.Batch(device.model, count, threads, persistent=own)
        if models is not None:
            self.batch.set_models(models)
        self._device = device
        self._bound = Physics(*(self.batch.bind(name) for name in Physics._fields))
        self._was_reset = self._bound.detached()
        self.physics = self._bound
        """Positions, velocities and the results of the last physics step, (n, ...)."""
        self._data = mujoco.MjData(device.model)
        self._ended = self.batch.warning[:, :, 1]
        self._calm = bytes(self._ended.nbytes)

    @exclusive
    def clear(self, rows: NDArray[np.intp]) -> None:
        self.batch.reset(rows, stage=mujoco.mjtStage.mjSTAGE_NONE.value)

    @exclusive
    def vary(self, row: int, plant: Plant) -> None:
        # What defines a plant
        for name in ("plugin_attr", "actuator_gainprm", "actuator_biasprm"):
            self.batch.expand(name)[row] = getattr(self._device.model, name)

    @exclusive
    def start(
        self,
        row: int,
        device: DeviceModel,
        script: Script,
        prepare: Callable[[mujoco.MjData], object] = lambda data: None,
    ) -> None:
        """Bring a simulation to the start of an episode; `prepare` may change it."""
        same = device is self._device
        data = self._data if same else mujoco.MjData(device.model)
        device.start(data, script.angles, script.part(0).commands[0])
        prepare(data)
        kind = mujoco.mjtState.mjSTATE_INTEGRATION.value
        mujoco.mj_getState(device.model, data, self.batch.state[row], kind)
        if self.physics is self._bound:
            # MuJoCo has no results for the batch where a start followed its last step.
            self._was_reset.take(self._bound)
            self.physics = self._was_reset
        self.physics.take(physics_of(data), row)

    def advance(self, control: Array, going: Mask) -> None:
        """Advance by a sample; see `Worlds`, and `roll` for what it raises."""
        self.roll(control.shape[1], going, control)

    @exclusive
    def roll(self, steps: int, going: Mask, control: Array | None = None) -> None:
        """Advance some by physics steps, by default with the controls in their states.

        If MuJoCo raises there is a `SimulationError` of `mujoco.batch`; see `why`.
        """
        # `all` and `any` of NumPy take several times as long for small arrays.
        ids = going if b"\0" in going.tobytes() else None
        if control is not None and ids is not None:
            control = control[ids]
        self.physics = self._bound
        with untimed():
            self.batch.rollout(steps, control, record=(), ids=ids)

    @property
    def warned(self) -> Mask:
        if self._ended.tobytes() == self._calm:
            return np.zeros(len(self._ended), np.bool_)
        warned: Mask = self._ended.any(axis=1)
        return warned

    @property
    def fell(self) -> Mask:
        """Mask of the simulations that ended with a warning or an error, (n,)."""
        fell: Mask = self.warned | (self.batch.status != 0)
        return fell

    def why(self, row: int, time: float) -> str:
        if error := self.batch.error(int(row)):
            return f"MuJoCo raised at {time:.3f} s: {error}"
        first = int(np.flatnonzero(self.batch.warning[row, :, 1])[0])
        kind = mujoco.mjtWarning(first).name
        return f"the simulation diverged at {time:.3f} s ({kind})"


class Simulation:
    """A simulation of one device, whose model and data others may look at."""

    def __init__(self, device: DeviceModel) -> None:
        self.data = mujoco.MjData(device.model)
        self.physics = Physics(*(field[None] for field in physics_of(self.data)))
        """Positions, velocities and the results of the last physics step, (1, ...)."""
        self.warned = np.zeros(1, np.bool_)
        """True where its episode ended with a warning, (1,)."""
        self._model, self._control = device.model, self.data.ctrl
        self._warnings = self.data.warning.number
        self._buffer, self._rows = np.zeros(0), list(np.zeros((0, 0)))
        self._no_warnings = bytes(self._warnings.nbytes)
        written = [*device.motor_controls, *device.script_controls]
        self._others = np.delete(np.arange(device.model.nu), written)

    def clear(self, rows: NDArray[np.intp]) -> None:
        self.warned = np.zeros(1, np.bool_)

    def vary(self, row: int, plant: Plant) -> None:
        """Take a plant, which the model has already; see `Worlds`."""

    def start(self, row: int, device: DeviceModel, script: Script) -> None:
        device.start(self.data, script.angles, script.part(0).commands[0])

    def advance(self, control: Array, going: Mask) -> None:
        """Advance by a sample, or until a warning; see `Worlds`."""
        model, data, given = self._model, self.data, self._control
        if self._others.size:  # those of the user stay what they are
            control[0][:, self._others] = given[self._others]
        if control is not self._buffer:
            self._buffer, self._rows = control, list(control[0])
        for now in self._rows:
            given[:] = now
            mujoco.mj_step(model, data)
            if self._warnings.tobytes() != self._no_warnings:
                self.warned = np.ones(1, np.bool_)
                break


class Batch:
    """Episodes of n devices of one layout, prepared together and played once.

    A `DrivenDevice`, of arrays (n, ...) or, if it is `alone`, of numbers.
    """

    def __init__(
        self,
        worn: Sequence[WornDevice],
        seeds: Sequence[int],
        devices: Sequence[DeviceModel] = (),
        *,
        threads: int = 1,
        name: str = "",
        whole: bool = False,
        alone: bool = False,
    ) -> None:
        """Write the scripts and make the simulations.

        Args:
            worn: Devices with their wearers, trajectories and tasks.
            seeds: Seed of what each of their wearers does.
            devices: Variants of the only `worn` that play its script in its place.
            threads: Threads that simulate; 0 means one per processor.
            name: Name of the controller, for the reasons of failures.
            whole: Whether the columns are those of an episode log, (n, ...), rather
                than what sensors measure and `least_tension_n`, `tension_n` and
                `dissipated_j`.
            alone: Whether the only device gives columns of numbers and raises where
                its simulation fails.
        """
        exo, devices = worn[0], devices or [one.device for one in worn]
        self._scripts = [
            one.author.write(seeding.np_random(seed)[0])
            for one, seed in zip(worn, seeds, strict=True)
        ]
        self.actuate: Callable[[int, Columns, Array], Array] | None = None
        """Returns the torque of the motors of a control step, its columns and the
        torque that the controller commands, which it is by default [N m]."""
        models = [device.model for device in devices]
        count = len(devices)
        self.steps, self.cables = exo.steps, cables(models[0])
        self.going: Mask = np.ones(count, dtype=np.bool_)
        """Mask of the devices that have not failed."""
        self.failed = [""] * count
        """Reasons of those that failed; else empty."""
        self.simulations = Simulations(exo, count, models, threads)
        self.devices = devices
        self.exo, self.name, self._whole, self._alone = exo, name, whole, alone
        self.prefixes = exo.device.prefixes
        """Beginnings of the columns of each axis."""
        self.wiring = Wiring(exo, devices, count)
        self._samples = np.zeros(count, np.int64)
        self._every = np.ones(count, np.bool_)
        self._limit = np.stack([device.torque_limits for device in devices])
        readers = [Reader(models[0], name) for name in self.cables]
        self._nodes = [reader.nodes for reader in readers]
        self._tensions = [f"tension_{name}_nodes_n" for name in self.cables]
        self._energies = np.array([reader.energy for reader in readers])
        self._outputs = np.array(exo.device.cable_outputs)
        self._warnings = self.simulations.batch.warning[:, :, 1]
        self._status = self.simulations.batch.status
        self._step = 0
        self._columns: Columns = {}

    @property
    def script(self) -> Script:
        """Script of the first device."""
        return self._scripts[0]

    def play(
        self,
        law: Controller,
        measure: Callable[[Columns], Columns],
        names: Sequence[str],
        *observers: Observer,
    ) -> dict[str, Array]:
        """Play the episode; one whose simulation fails is NaN from then on.

        Args:
            law: Controller of all devices.
            measure: Returns what the controller reads of the columns.
            names: Names of the columns to keep.
            observers: As of `run`, and so are errors.

        Returns:
            Columns by name, (steps + 1, n, ...).
        """
        trace = loop.Trace(names, self.steps, self.going)
        with np.errstate(all="ignore"):  # what diverged is not a number
            loop.run(self, law, trace.keep, *observers, measure=measure, name=self.name)
        return trace.columns

    def reload(self) -> None:
        """Play on with the values that the models of `devices` have now."""
        self.simulations.batch.set_models([device.model for device in self.devices])

    @exclusive
    def start(self) -> Columns:
        """Bring all to the start, once; see `DrivenDevice.start`."""
        if self._step:
            raise CableError("a batch is played once; make another one.")
        for row, device in enumerate(self.devices):
            script = self._scripts[row % len(self._scripts)]
            self.simulations.start(row, device, script)
            self.wiring.seat(row, script)
        return self._read(self.simulations.physics)

    @exclusive
    def advance(self, torque: Array) -> Columns:
        """Go a control step; see `DrivenDevice.advance`."""
        if self._alone:
            torque = np.reshape(torque, (1, -1))
        if self.actuate is not None:
            torque = self.actuate(self._step, self._columns, torque)
        if torque.shape in ((), self.going.shape):  # of one motor, or for all of them
            torque = np.full(self.going.size, torque)[:, None]
        finite: Mask = np.all(np.isfinite(torque), axis=1)
        if not finite.all():
            for row in np.flatnonzero(self.going & ~finite).tolist():
                time = self._step * self.exo.period
                self.failed[row] = loop.missing_torque_error(self.name, time)
            self.going &= finite
        # `np.clip` takes several times as long for small arrays.
        share = np.minimum(np.maximum(torque / self._limit, -1.0), 1.0)
        # The actions of the environments are of single precision.
        share = share.astype(np.float32).astype(np.float64)
        control = self.wiring.controls(share, self._samples, self._every)
        # What raised shows in the status of the batch.
        with contextlib.suppress(mujoco_batch.SimulationError):
            self.simulations.advance(control, self.going)
        self._step += 1
        if self._warnings.any() or self._status.any():
            fell = self.simulations.fell & self.going
            for row in np.flatnonzero(fell).tolist():
                time = self._step * self.exo.period
                self.failed[row] = self.simulations.why(row, time)
            self.going &= ~fell
        if self._alone and self.failed[0]:
            raise loop.unstable(self.failed[0])
        return self._read(self.simulations.physics)

    def _read(self, now: Physics) -> Columns:
        state, count = now.plugin_state, self.going.size
        columns = self.wiring.columns(self.wiring.read(now, self._samples))
        if self._whole:
            columns |= self.exo.device.read_cables(now.qpos.copy(), state.copy())
        else:
            least = np.empty((count, len(self.cables)))
            for place, name in enumerate(self._tensions):
                columns[name] = nodes = state[:, self._nodes[place]]
                nodes.min(axis=1, out=least[:, place])
            columns["least_tension_n"] = least
            columns["tension_n"] = np.abs(now.actuator_force[:, self._outputs])
            columns["dissipated_j"] = state[:, self._energies]
        self._columns = columns
        if self._alone:
            return {name: value[0] for name, value in columns.items()}
        return columns
