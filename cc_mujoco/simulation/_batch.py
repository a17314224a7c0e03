"""Many devices at once: one batch of simulations, each on a model of its own.

    batch = Batch([worn], seeds=[0])
    sensors = worn.controller_sensors(sensing, worn.drives, [0])
    law = controller("pi", worn.drive)
    columns = batch.play(law, sensors.measure, ["joint_torque_nm"])

Results of a device are bit-identical to those of its environment played alone, whatever
the other devices of the batch and the number of threads.
"""

import contextlib
from collections.abc import Callable, Sequence
from typing import Any, Protocol

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
from cc_mujoco.plugin import untimed
from cc_mujoco.simulation import _loop as loop
from cc_mujoco.simulation._loop import Columns, Observer
from cc_mujoco.simulation._reference_motion import Script
from cc_mujoco.simulation._wiring import Wiring
from cc_mujoco.simulation._worn_device import WornDevice

Mask = NDArray[np.bool_]


class Worlds(Protocol):
    """Simulations of n devices of equal layout, as environments advance them.

    Implemented in MuJoCo by `Simulations`, in mujoco_warp by `_warp_worlds.WarpWorlds`.
    """

    physics: Physics
    """Positions, velocities and the results of the last physics step, (n, ...)."""

    @property
    def warned(self) -> Mask:
        """Mask (n,) of simulations that a MuJoCo warning ended, such as divergence."""

    def clear(self, rows: NDArray[np.intp]) -> None:
        """Clear the warnings of some simulations, each of which is then to `start`."""

    def vary(self, row: int, plant: Plant) -> None:
        """Copy the wearer and cables of a plant into the model of a simulation."""

    def start(self, row: int, device: DeviceModel, script: Script) -> None:
        """Bring a simulation to the start of an episode with this wearer's script."""

    def advance(self, control: Array, going: Mask) -> None:
        """Advance rows `going` a sample by `control` (n, physics steps, controls)."""


class OtherCables(Protocol):
    """Cables by other equations than the plugin's, for `Batch.transmission`."""

    def pull(self) -> None:
        """Apply the forces of the next physics step to the simulations."""

    def show(self, columns: dict[str, Any]) -> None:
        """Write the torques and tensions that acted into the columns."""


class Simulations:
    """Simulations of n devices of equal layout, advanced together by MuJoCo."""

    def __init__(
        self,
        exo: WornDevice,
        count: int,
        models: Sequence[mujoco.MjModel] | None = None,
        threads: int = 0,
        written: bool = False,
    ) -> None:
        """Make `count` simulations, on the model of `exo` or on `models`, one each.

        Call `start` for each before `advance`. 0 threads means one per processor. With
        `written`, `models` are that of `exo`, and the devices have cables of their own.
        """
        device = exo.device
        # Different cables in one simulation's memory would be read anew in every step.
        own = bool(exo.plants.varied) or models is not None
        self.batch = mujoco_batch.Batch(device.model, count, threads, persistent=own)
        if models is not None and not written:
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
        self._copy(row, "plugin_attr", "actuator_gainprm", "actuator_biasprm")

    def _copy(self, row: int, *fields: str) -> None:
        """Copy fields of the device's model to the model of a simulation."""
        for name in fields:
            self.batch.expand(name)[row] = getattr(self._device.model, name)

    @exclusive
    def start(
        self,
        row: int,
        device: DeviceModel,
        script: Script,
        prepare: Callable[[mujoco.MjData], object] = lambda data: None,
    ) -> None:
        """Start an episode of a simulation; `prepare` may change its data last."""
        data = self._data  # to make others takes as long as half an episode
        device.start(data, script.angles, script.part(0).commands[0])
        prepare(data)
        if device.written:
            self._copy(row, "plugin_attr")
        kind = mujoco.mjtState.mjSTATE_INTEGRATION.value
        mujoco.mj_getState(device.model, data, self.batch.state[row], kind)
        if self.physics is self._bound:
            # MuJoCo has no results for the batch where a start followed its last step.
            self._was_reset.take(self._bound)
            self.physics = self._was_reset
        self.physics.take(physics_of(data), row)

    def advance(self, control: Array, going: Mask) -> None:
        """Advance by one sample, see `Worlds.advance`; raises as `roll` does."""
        self.roll(control.shape[1], going, control)

    @exclusive
    def roll(self, steps: int, going: Mask, control: Array | None = None) -> None:
        """Advance the simulations `going` (n,) by `steps` physics steps.

        Without `control` the controls stay. Raises `mujoco.batch.SimulationError`, see
        `why`.
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
        """Mask (n,) of simulations that ended with a MuJoCo warning or an error."""
        fell: Mask = self.warned | (self.batch.status != 0)
        return fell

    def why(self, row: int, time: float) -> str:
        if error := self.batch.error(int(row)):
            return f"MuJoCo raised at {time:.3f} s: {error}"
        first = int(np.flatnonzero(self.batch.warning[row, :, 1])[0])
        kind = mujoco.mjtWarning(first).name
        return f"the simulation diverged at {time:.3f} s ({kind})"


class Simulation:
    """`Worlds` of one device whose `MjModel` and `MjData` are accessible."""

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
        """Do nothing, as the model has the plant already; see `Worlds`."""

    def start(self, row: int, device: DeviceModel, script: Script) -> None:
        device.start(self.data, script.angles, script.part(0).commands[0])

    def advance(self, control: Array, going: Mask) -> None:
        """Advance by one sample, or until a MuJoCo warning; see `Worlds`."""
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
    """Episodes of n devices of equal layout, prepared together and played once.

    It is a `DrivenDevice` with arrays (n, ...) or, if `alone`, with numbers.
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
        """Write the wearers' scripts and make the simulations.

        Args:
            worn: Devices with their wearers, trajectories and tasks.
            seeds: Random seed of each wearer's motion.
            devices: Variants of the only `worn`, played with its script instead of it.
            threads: Threads that simulate; 0 means one per processor.
            name: Name of the controller, for the reasons of failures.
            whole: True for all columns of an episode log, (n, ...); False for those
                that sensors measure, `least_tension_n`, `tension_n` and
                `dissipated_j`.
            alone: True for the only device to give columns of numbers, and to raise
                `CableError` when its simulation fails.
        """
        exo, devices = worn[0], devices or [one.device for one in worn]
        self._scripts = [
            one.author.write(seeding.np_random(seed)[0])
            for one, seed in zip(worn, seeds, strict=True)
        ]
        self.actuate: Callable[[int, Columns, Array], Array] | None = None
        """Function of control step, its columns and the commanded torque, which
        returns that of the motors [N m]; None: they give the commanded one."""
        models = [device.model for device in devices]
        count = len(devices)
        self.steps, self.cables = exo.steps, tuple(devices[0].readers)
        self.transmission: OtherCables | None = None
        """Cables that pull instead of the unplugged ones of the plugin, if any."""
        self.going: Mask = np.ones(count, dtype=np.bool_)
        """Mask of the devices that have not failed."""
        self.failed = [""] * count  # reasons of those that failed; else empty
        written = bool(devices[0].written)
        self.simulations = Simulations(exo, count, models, threads, written)
        self.devices = devices
        self.exo, self.name, self._whole, self._alone = exo, name, whole, alone
        self.prefixes = exo.device.prefixes  # beginnings of the columns of each axis
        self.wiring = Wiring(exo, devices[:1] if written else devices, count)
        self._samples = np.zeros(count, np.int64)
        self._every = np.ones(count, np.bool_)
        self._limit = np.stack([device.torque_limits for device in devices])
        readers = devices[0].readers.values()
        self._nodes = [reader.nodes for reader in readers]
        self._tensions = [f"tension_{name}_nodes_n" for name in self.cables]
        self._energies = np.array([reader.energy for reader in readers])
        self._outputs = np.array([out for reader in readers for out in reader.outputs])
        self._warnings = self.simulations.batch.warning[:, :, 1]
        self._status = self.simulations.batch.status
        self._step = 0
        self._columns: Columns = {}

    @property
    def script(self) -> Script:
        """Script of the first device's wearer."""
        return self._scripts[0]

    def play(
        self,
        law: Controller,
        measure: Callable[[Columns], Columns],
        names: Sequence[str],
        *observers: Observer,
    ) -> dict[str, Array]:
        """Play the episode; a device whose simulation fails is NaN from then on.

        Args:
            law: Controller of all devices.
            measure: Function from the columns to the controller's measurements.
            names: Names of the columns to return.
            observers: Called at every control step, see `run`, which tells the errors.

        Returns:
            Columns by name, (steps + 1, n, ...).
        """
        trace = loop.Trace(names, self.steps, self.going)
        with np.errstate(all="ignore"):  # diverged columns are NaN
            loop.run(self, law, trace.keep, *observers, measure=measure, name=self.name)
        return trace.columns

    def reload(self) -> None:
        """Continue with the parameters that the models of `devices` have now."""
        self.simulations.batch.set_models([device.model for device in self.devices])

    @exclusive
    def start(self) -> Columns:
        """Start all simulations, once per batch; see `DrivenDevice.start`."""
        if self._step:
            raise CableError("a batch is played once; make another one.")
        for row, device in enumerate(self.devices):
            script = self._scripts[row % len(self._scripts)]
            self.simulations.start(row, device, script)
            self.wiring.seat(row, script)
        return self._read(self.simulations.physics)

    @exclusive
    def advance(self, torque: Array) -> Columns:
        """Advance a control step; see `DrivenDevice.advance`."""
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
            if self.transmission is None:
                self.simulations.advance(control, self.going)
            else:
                for now in np.split(control, control.shape[1], axis=1):
                    self.transmission.pull()
                    self.simulations.advance(now, self.going)
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
        if self.transmission is not None:
            self.transmission.show(columns)
        self._columns = columns
        if self._alone:
            return {name: value[0] for name, value in columns.items()}
        return columns
