"""Many devices at once in mujoco_warp, on a GPU or a processor.

Arithmetic is in single precision. An episode starts from MuJoCo's state, rounded;
plants, scripts and sensors are those of `_batch.Simulations`.
"""

from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from numpy.typing import NDArray

from cc_mujoco.cable._cable import BREAK_AWAY, TERMS
from cc_mujoco.device import Device, Plant
from cc_mujoco.device._axis_record import Physics
from cc_mujoco.device._model import DeviceModel, physics_of
from cc_mujoco.device._variables import split
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.plugin._engine import PLUGIN
from cc_mujoco.simulation._batch import Mask
from cc_mujoco.simulation._reference_motion import Script
from cc_mujoco.simulation._worn_device import WornDevice
from cc_mujoco.warp import attach, without_plugin
from cc_mujoco.warp._kernels import write_rows


class WarpWorlds:
    """Simulations of n devices of equal layout, advanced together by mujoco_warp.

    See `_batch.Worlds`. A simulation that an `advance` leaves out must be started anew
    before it is advanced again.

    Attributes:
        model: `mujoco_warp.Model`.
        data: `mujoco_warp.Data`; its arrays are on the device of Warp.
        cables: `cc_mujoco.warp.AttachedCables`, with the tensions of all worlds.
    """

    def __init__(self, exo: WornDevice, count: int, device: Device) -> None:
        """Make `count` worlds; call `start` for each before it is advanced.

        Raises `CableError` if mujoco_warp or its cables cannot simulate the scene.
        """
        spec, self._device = Plant(device).spec(), exo.device
        model = self._device.model
        try:
            plain = without_plugin(spec).compile()
        except CableError as error:
            raise _refusal(device, error) from None
        plugins = [actuator.plugin.plugin_name for actuator in spec.actuators]
        cabled = self._cabled = np.array([name == PLUGIN for name in plugins], np.bool_)
        # Fields that define how a wearer moves a joint
        impedances = "actuator_gainprm", "actuator_biasprm"
        for name in impedances:
            getattr(plain, name)[~cabled] = getattr(model, name)[~cabled]
        try:
            self.model = mjw.put_model(plain)
        except NotImplementedError as error:  # a feature that mujoco_warp lacks
            raise _refusal(device, error) from None
        self.data = mjw.make_data(plain, nworld=count)
        laid: Any = {"terms": _terms(exo), "rest_in_pose": True}
        self.cables = attach(self.model, self.data, spec, **laid)
        self._skip, self._count = exo.frame_skip, count
        self._control = np.zeros((self._skip, count, model.nu), np.float32)
        self._controls = wp.zeros(self._control.shape, dtype=float)
        self._impedances = {}
        for name in impedances:
            value = np.repeat(getattr(plain, name)[None], count, axis=0)
            dtype = getattr(self.model, name).dtype
            setattr(self.model, name, wp.array(value, dtype=dtype))
            self._impedances[name] = value
        self._plants: dict[int, Plant] = {}
        """Plants that are not written to the worlds yet."""
        self._mj_data = mujoco.MjData(model)
        neutral = mujoco.MjData(model)
        mujoco.mj_forward(model, neutral)
        self._neutral = physics_of(neutral)
        shapes = ((count, *field.shape) for field in self._neutral)
        self.physics = Physics(*map(np.zeros, shapes))
        """Positions, velocities and the results of the last physics step, (n, ...)."""
        # Initial fields of an episode; others follow from them or are 0
        self._begun = {}
        for name in ("qpos", "qvel", "act", "qacc_warmstart"):
            shape = count, *getattr(neutral, name).shape
            self._begun[name] = np.zeros(shape, np.float32)
        self._fresh = np.zeros(count, dtype=np.bool_)
        self._warned = np.zeros(count, dtype=np.bool_)
        self._step_sample()  # compiles
        self._require_order(neutral)
        # A replay launches some hundred kernels a step without Python.
        with wp.ScopedCapture() as capture:
            self._step_sample()
        self._graph = capture.graph

    @property
    def warned(self) -> Mask:
        """Mask (n,) of simulations that diverged, by the limit `mujoco.mjMAXVAL`."""
        return self._warned.copy()

    def clear(self, rows: NDArray[np.intp]) -> None:
        self._warned[rows] = False

    def vary(self, row: int, plant: Plant) -> None:
        """Give a simulation a plant; refuse a friction term that was not compiled."""
        for name, cable in plant.cables.items():
            for term in cable.terms.keys() - self.cables.terms:
                raise CableError(
                    f"cable {name!r}: {term} is off in the kernels of backend='warp'; "
                    f"name it in `randomise`, for example {term!r}: (0, 1)."
                )
        self._plants[int(row)] = plant
        for name, value in self._impedances.items():
            own = getattr(self._device.model, name)
            value[row, ~self._cabled] = own[~self._cabled]

    def start(self, row: int, device: DeviceModel, script: Script) -> None:
        data = self._mj_data
        device.start(data, script.angles, script.part(0).commands[0])
        for name, value in self._begun.items():
            value[row] = getattr(data, name)
        self._fresh[row] = True
        for field, own in zip(self.physics, physics_of(data), strict=True):
            field[row] = own

    def advance(self, control: Array, going: Mask) -> None:
        with wp.ScopedDevice(self.data.time.device):
            self._advance(control, going)

    def _advance(self, control: Array, going: Mask) -> None:
        if self._plants:
            for name in self.cables.names:
                own = {row: plant.cables[name] for row, plant in self._plants.items()}
                self.cables.assign(name, own)
            for name, value in self._impedances.items():
                getattr(self.model, name).assign(value)
            self._plants.clear()
        if self._fresh.any():
            self._reset(self._fresh)
            rows = np.flatnonzero(self._fresh)
            for name, value in self._begun.items():
                write_rows(getattr(self.data, name), rows, value[rows])
            self._fresh[:] = False
        self._control[...] = np.swapaxes(control, 0, 1)
        self._controls.assign(self._control)
        self._take_sample()
        state = self.cables.plugin_state()
        which = slice(None) if going.all() else going
        for name, field in zip(Physics._fields, self.physics, strict=True):
            its_own = name != "plugin_state"
            now = getattr(self.data, name).numpy() if its_own else state
            field[which] = now[which]
        self._notice(going)

    def _take_sample(self) -> None:
        wp.capture_launch(self._graph)

    def _step_sample(self) -> None:
        for step in range(self._skip):
            wp.copy(self.data.ctrl, self._controls[step])
            mjw.step(self.model, self.data)

    def _reset(self, mask: Mask) -> None:
        mjw.reset_data(self.model, self.data, wp.array(mask, dtype=bool))
        self.cables.reset(mask)

    def _notice(self, going: Mask) -> None:
        """Mark diverged rows of `going`, and reset them to `qpos0`, as MuJoCo does."""
        largest = [
            np.abs(getattr(self.data, name).numpy()).max(axis=1, initial=0.0)
            for name in ("qpos", "qvel", "qacc")
        ]
        diverged = going & ~np.all(np.less_equal(largest, mujoco.mjMAXVAL), axis=0)
        if not diverged.any():
            return
        self._warned |= diverged
        for field, own in zip(self.physics, self._neutral, strict=True):
            field[diverged] = own
        self._reset(diverged)

    def _require_order(self, data: mujoco.MjData) -> None:
        """Raise `CableError` if mujoco_warp has another order of actuator moments."""
        for name in ("moment_rownnz", "moment_rowadr", "moment_colind"):
            found = getattr(self.data, name).numpy()[0]
            if not np.array_equal(found, getattr(data, name)):
                raise CableError(
                    f"the scene {self._device.description.scene!r} cannot be simulated "
                    "with backend='warp': mujoco_warp orders the moments of its "
                    "actuators otherwise than MuJoCo."
                )


def _refusal(device: Device, error: Exception) -> CableError:
    return CableError(
        f"device {device.name!r} cannot be simulated with backend='warp': "
        f"{str(error).rstrip('.')}."
    )


def _terms(exo: WornDevice) -> tuple[str, ...]:
    names = {split(name)[1] for name in exo.plants.varied}
    if "break_away" in names:
        names.add(BREAK_AWAY.name)
    return tuple(name for name in TERMS if name in names)
