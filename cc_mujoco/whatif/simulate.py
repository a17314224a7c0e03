"""Many designs at once: one batch of simulations, each on a model of its own.

The arithmetic of a design is that of the environment played alone, number by number, so
its results are the same bits in any company and on any number of threads.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from gymnasium.utils import seeding
from mujoco.batch import Batch, SimulationError
from numpy.typing import NDArray

from cc_mujoco.devices import Setup
from cc_mujoco.engine import Reader, cables
from cc_mujoco.envs.device import Device, Physics
from cc_mujoco.envs.exo import Exo
from cc_mujoco.envs.script import Script
from cc_mujoco.human import Task, Trajectory, Wearer
from cc_mujoco.sensing import TENSIONS
from cc_mujoco.whatif.laws import Laws
from cc_mujoco.whatif.sensing import Taps, equip

Array = NDArray[np.float64]

Tick = Callable[[float], None]
"""Takes the share that is done, 0 to 1; may raise to stop."""

TICK_STEPS = 200
"""Control steps between two calls of a tick."""

_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)


@dataclass(frozen=True)
class Episode:
    """What all designs of a batch play."""

    setup: Setup
    trajectory: str | Trajectory
    task: str | Task
    duration: float
    frame_skip: int
    seed: int
    controller: str | None
    """Name; without one the motor gives no torque."""
    wearer: Wearer | None = None

    def device(self, model: mujoco.MjModel) -> Device:
        """The device on a model."""
        return Device(self.setup, self.wearer, model)

    def exo(self, model: mujoco.MjModel) -> Exo:
        """Device, wearer, trajectory and task on a model.

        Raises:
            CableError: the episode cannot be played.
        """
        return Exo(
            self.setup,
            self.trajectory,
            self.task,
            self.duration,
            self.frame_skip,
            self.wearer,
            model,
        )


@dataclass(frozen=True, eq=False)
class Played:
    """An episode of n designs at T control steps, the reset included.

    Attributes:
        columns: those of an episode log, (n, T). Those of c cables are (n, c, T) and
            `tension_n`, proximal and distal end of each cable in turn, (n, 2 c, T);
            `least_tension_n` is below 0 where a cable is slack.
        ratio: joint angle per motor angle of an unstretched cable, (n,).
        failed: why the simulation of a design failed, empty where it did not, (n,).
    """

    columns: dict[str, Array]
    ratio: Array
    failed: tuple[str, ...]


def play(
    episode: Episode,
    models: Sequence[mujoco.MjModel],
    threads: int = 1,
    tick: Tick = lambda share: None,
) -> Played:
    """Play an episode on each of several models of equal layout.

    Args:
        episode: what to play.
        models: one per design.
        threads: that simulate.
        tick: called now and then.

    Raises:
        CableError: the episode itself cannot be played.
    """
    exo = episode.exo(models[0])
    rng, _ = seeding.np_random(episode.seed)
    script = exo.author.write(rng)
    devices = [exo.device, *(episode.device(model) for model in models[1:])]
    drives = [equip(device.drive(exo.period)) for device in devices]
    law = None if episode.controller is None else Laws(episode.controller, drives)
    fleet = _Fleet(exo, devices, script, threads)
    with np.errstate(all="ignore"):  # designs that failed hold what is not a number
        for step in range(exo.steps):
            seen = fleet.observe(step)
            fleet.advance(step, None if law is None else law.torque(seen))
            if step % TICK_STEPS == 0:
                tick(step / exo.steps)
        fleet.observe(exo.steps)
        columns = fleet.columns()
    tick(1.0)
    ratio = np.array([1.0 / drive.ratio for drive in drives])
    return Played(columns, ratio, tuple(fleet.failed))


class _Fleet:
    """The simulations of a batch, and what is kept of them."""

    def __init__(
        self, exo: Exo, devices: Sequence[Device], script: Script, threads: int
    ) -> None:
        models = [device.model for device in devices]
        count, steps = len(devices), exo.steps + 1
        self._exo, self._script, self._device = exo, script, exo.device
        self._scale = np.array([device.motor_scale for device in devices])
        self._limit = np.array([device.torque_limit for device in devices])
        readers = [Reader(models[0], name) for name in cables(models[0])]
        self._nodes = [reader.nodes for reader in readers]
        self._energies = [reader.energy for reader in readers]
        self._taps = Taps(readers, equip(devices[0].drive(exo.period)))
        self._batch = Batch(models[0], count, threads, persistent=True)
        self._batch.set_models(models)
        self._bound = Physics(*(self._batch.bind(name) for name in Physics._fields))
        self._warnings = self._batch.warning[:, :, 1]
        self._status = self._batch.status
        self._now = self._start(devices)
        self._kept = Physics(*(np.zeros((steps, *a.shape)) for a in self._now))
        self._kept = self._kept._replace(
            plugin_state=np.zeros((steps, count, len(readers)))
        )
        self._least = np.zeros((steps, count, len(readers)))
        self._desired = np.zeros((steps, count))
        self._control = np.zeros((count, exo.frame_skip, models[0].nu))
        self._alive = np.ones(count, dtype=np.bool_)
        self.failed = [""] * count

    def _start(self, devices: Sequence[Device]) -> Physics:
        """Bring all to the start; results that MuJoCo has not yet for the batch."""
        now = self._bound._replace(
            actuator_force=self._bound.actuator_force.copy(),
            qfrc_actuator=self._bound.qfrc_actuator.copy(),
        )
        for row, device in enumerate(devices):
            data = mujoco.MjData(device.model)
            device.start(data, self._script.angles, self._script.commands[0])
            mujoco.mj_getState(device.model, data, self._batch.state[row], _STATE)
            now.actuator_force[row] = data.actuator_force
            now.qfrc_actuator[row] = data.qfrc_actuator
        return now

    def observe(self, step: int) -> dict[str, Array]:
        """Keep the present as that of a control step; return what can be measured."""
        now, kept = self._now, self._kept
        seen: dict[str, Array] = self._device.read_motion(now)
        _, phase, sine, cosine = self._script.marks[step]
        self._desired[step] = self._exo.task.torque(
            seen["joint_angle_rad"], seen["joint_velocity_rad_s"], phase
        )
        # A copy, for what is kept is not the controller's to change.
        seen["desired_torque_nm"] = self._desired[step].copy()
        seen["phase_sine"] = np.full_like(self._desired[step], sine)
        seen["phase_cosine"] = np.full_like(self._desired[step], cosine)
        kept.qpos[step], kept.qvel[step] = now.qpos, now.qvel
        kept.actuator_force[step] = now.actuator_force
        kept.qfrc_actuator[step] = now.qfrc_actuator
        kept.plugin_state[step] = now.plugin_state[:, self._energies]
        seen[TENSIONS] = self._taps.read(now.plugin_state)
        for place, nodes in enumerate(self._nodes):
            now.plugin_state[:, nodes].min(axis=1, out=self._least[step, :, place])
        return seen

    def advance(self, step: int, torque: Array | None) -> None:
        """Go a control step with motor torques (n,) [Nm], none by default."""
        control, device, skip = self._control, self._device, self._exo.frame_skip
        if torque is not None:
            # `np.clip` takes several times as long for small arrays.
            share = np.minimum(np.maximum(torque / self._limit, -1.0), 1.0)
            # The actions of the environments are of single precision.
            share = share.astype(np.float32).astype(np.float64)
            control[:, :, device.motor_control] = (share * self._scale)[:, None]
        commands = self._script.commands[step * skip : (step + 1) * skip]
        control[:, :, device.wearer_controls] = commands
        everyone = not any(self.failed)
        chosen = control if everyone else control[self._alive]
        # What raised shows in the status of the batch.
        with contextlib.suppress(SimulationError):
            self._batch.rollout(
                skip, chosen, record=(), ids=None if everyone else self._alive
            )
        self._now = self._bound
        if self._warnings.any() or self._status.any():
            fell = self._warnings.any(axis=1) | (self._status != 0)
            if (fell & self._alive).any():
                self._note(fell & self._alive, (step + 1) * self._exo.period)

    def columns(self) -> dict[str, Array]:
        """What `Played` holds."""
        count = len(self.failed)
        kept = self._kept
        columns = dict(self._device.read_motion(kept))
        columns["desired_torque_nm"] = self._desired.T
        ends = kept.actuator_force[:, :, self._device.cable_outputs]
        columns["tension_n"] = np.abs(ends).transpose(1, 2, 0)
        columns["dissipated_j"] = kept.plugin_state.transpose(1, 2, 0)
        columns["least_tension_n"] = self._least.transpose(1, 2, 0)
        columns = {name: np.ascontiguousarray(a) for name, a in columns.items()}
        time = np.arange(len(self._desired)) * self._exo.period
        reference = np.ascontiguousarray(self._script.marks[:, 0])
        shape = (count, time.size)
        columns["time_s"] = np.broadcast_to(time, shape)
        columns["reference_angle_rad"] = np.broadcast_to(reference, shape)
        return columns

    def _note(self, fell: NDArray[np.bool_], time: float) -> None:
        self._alive &= ~fell
        for row in np.flatnonzero(fell):
            if error := self._batch.error(int(row)):
                self.failed[row] = f"MuJoCo raised at {time:.3f} s: {error}"
            else:
                first = int(np.flatnonzero(self._batch.warning[row, :, 1])[0])
                kind = mujoco.mjtWarning(first).name
                self.failed[row] = f"the simulation diverged at {time:.3f} s ({kind})"
