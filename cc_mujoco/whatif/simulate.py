"""Many designs at once: one batch of simulations, each on a model of its own.

The arithmetic of a design is that of the environment played alone, number by number, so
its results are the same bits in any company and on any number of threads. A study
compares transmissions, so its sensors are perfect, where the benchmark, which plays its
drawn plants as such a batch too, has noisy ones.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from gymnasium.utils import seeding
from mujoco.batch import Batch, SimulationError
from numpy.typing import NDArray

from cc_mujoco.control import Drive, controller
from cc_mujoco.devices import Setup
from cc_mujoco.engine import Reader, cables, untimed
from cc_mujoco.envs.device import Device, Physics, physics_of
from cc_mujoco.envs.exo import Exo
from cc_mujoco.envs.script import Script
from cc_mujoco.envs.winding import Winding
from cc_mujoco.episode import Columns, Trace, no_torque, run
from cc_mujoco.human import Task, Trajectory, Wearer
from cc_mujoco.sensing import PERFECT, Measuring
from cc_mujoco.whatif.inner.players import Players, asked_by, law_of
from cc_mujoco.whatif.inner.record import KEPT
from cc_mujoco.whatif.laws import Laws, Unpowered
from cc_mujoco.workers import Tick

Array = NDArray[np.float64]

FRAME_SKIP = 2
"""Physics steps in a control step of the devices as they are."""

TICK_STEPS = 200
"""Control steps between two calls of a tick."""

COLUMNS = (*KEPT, "tension_n", "dissipated_j", "least_tension_n")
"""Columns that change from step to step."""

_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)


@dataclass(frozen=True)
class Episode:
    """Episode that all designs of a batch play."""

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
class Rollout:
    """An episode of n designs at T control steps, the reset included.

    Attributes:
        columns: those of an episode log, (n, T). Those of c cables are (n, c, T) and
            `tension_n`, proximal and distal end of each cable in turn, (n, 2 c, T);
            `least_tension_n` is below 0 where a cable is slack.
        ratio: joint angle per motor angle of an unstretched cable, (n,).
        driven: names of the cables that the motor winds.
        failed: why the simulation of a design failed, empty where it did not, (n,).
    """

    columns: dict[str, Array]
    ratio: Array
    driven: tuple[str, ...]
    failed: tuple[str, ...]


def play(
    episode: Episode,
    models: Sequence[mujoco.MjModel],
    threads: int = 1,
    tick: Tick = lambda share: None,
) -> Rollout:
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
    drives = [PERFECT.equip(device.drive(exo.period)) for device in devices]
    name, driven = episode.controller, exo.device.driven
    ratio = np.array([1.0 / drive.ratio for drive in drives])
    players = _players(name, drives, devices, exo, script)
    if players is not None:
        failed = _play_inside(players, exo, devices, script, threads, name or "", tick)
        columns = players.columns() | _scripted(script, exo, len(devices))
        tick(1.0)
        return Rollout(columns, ratio, driven, failed)
    law = Unpowered(drives[0]) if name is None else Laws(name, drives)
    fleet = Fleet(exo, devices, (script,), threads, name or "")
    measuring = Measuring(PERFECT, drives[0], driven, episode.seed, exo.steps)
    trace = Trace(COLUMNS, exo.steps, fleet.going)

    def tell(step: int, _: Columns, __: object) -> None:
        if step % TICK_STEPS == 0:
            tick(step / exo.steps)

    with np.errstate(all="ignore"):  # designs that failed hold what is not a number
        run(fleet, law, trace.keep, tell, measure=measuring.measure, name=name or "")
    columns = {}
    while trace.columns:  # what is turned is let go, so that memory holds it once
        name, kept = trace.columns.popitem()
        columns[name] = np.ascontiguousarray(np.moveaxis(kept, 0, -1))
    columns |= _scripted(script, exo, len(devices))
    tick(1.0)
    return Rollout(columns, ratio, driven, tuple(fleet.failed))


def _scripted(script: Script, exo: Exo, count: int) -> dict[str, Array]:
    """Columns that are the same for all designs, (n, T)."""
    shape = (count, exo.steps + 1)
    time = np.arange(exo.steps + 1) * exo.period
    columns = {"time_s": np.broadcast_to(time, shape)}
    names = {"reference_angle_rad": 0, "phase_sine": 2, "phase_cosine": 3}
    for name, place in names.items():
        mark = np.ascontiguousarray(script.marks[:, place])
        columns[name] = np.broadcast_to(mark, shape)
    return columns


def _players(
    name: str | None,
    drives: Sequence[Drive],
    devices: Sequence[Device],
    exo: Exo,
    script: Script,
) -> Players | None:
    """Return the players inside MuJoCo's steps; None where Python alone knows how."""
    laws = [None if name is None else controller(name, drive) for drive in drives[:1]]
    if asked_by(exo.task) is None or law_of(laws[0]) is None:
        return None
    if name is not None:
        laws += [controller(name, drive) for drive in drives[1:]]
    else:
        laws *= len(drives)
    return Players(devices, laws, exo.task, script, exo.steps, exo.frame_skip)


def _play_inside(
    players: Players,
    exo: Exo,
    devices: Sequence[Device],
    script: Script,
    threads: int,
    name: str,
    tick: Tick,
) -> tuple[str, ...]:
    """Play the episodes of `players`; return why designs failed."""
    count, skip = len(devices), exo.frame_skip
    models = [device.model for device in devices]
    batch = Batch(models[0], count, threads, persistent=True)
    batch.set_models(models)
    for row, device in enumerate(devices):
        data = mujoco.MjData(device.model)
        device.start(data, script.angles, script.commands[0])
        players.begin(row, data, device.model)
        mujoco.mj_getState(device.model, data, batch.state[row], _STATE)
    failed = [""] * count
    going = np.ones(count, dtype=np.bool_)
    attended = batch.bind("userdata")[:, 0]
    for step in range(0, exo.steps, TICK_STEPS):
        refused = [n for n in np.flatnonzero(going).tolist() if players.refused(n)]
        for row in refused:
            failed[row] = no_torque(name, players.at(row) * exo.period)
            players.forget(row, players.at(row) + 1)
        going[refused] = False
        tick(step / exo.steps)
        if not going.any():
            break
        last = min(step + TICK_STEPS, exo.steps)
        with untimed(), contextlib.suppress(SimulationError):
            batch.rollout(
                (last - step) * skip, record=(), ids=None if going.all() else going
            )
        fell = batch.warning[:, :, 1].any(axis=1) | (batch.status != 0)
        for row in np.flatnonzero(fell & going).tolist():
            # What MuJoCo resets is attended no more, and what raised is as it was.
            over = last == exo.steps and players.at(row) == last
            counted = batch.status[row] == 0 and (over or attended[row] != 0.0)
            first = players.failed_at(row, counted)
            failed[row] = why_failed(batch, row, first * exo.period)
            players.forget(row, first)
        going &= ~fell
    return tuple(failed)


def why_failed(batch: Batch, row: int, time: float) -> str:
    """Describe why a simulation ended with a warning or an error at a time."""
    if error := batch.error(int(row)):
        return f"MuJoCo raised at {time:.3f} s: {error}"
    first = int(np.flatnonzero(batch.warning[row, :, 1])[0])
    kind = mujoco.mjtWarning(first).name
    return f"the simulation diverged at {time:.3f} s ({kind})"


class Fleet:
    """The simulations of a batch, a device each; a `Plant`."""

    def __init__(
        self,
        exo: Exo,
        devices: Sequence[Device],
        scripts: Sequence[Script],
        threads: int = 1,
        controller: str = "",
    ) -> None:
        """Make the batch.

        Args:
            exo: Of the first device.
            devices: Of equal layout.
            scripts: What the wearer does, one for all or for each.
            threads: That simulate.
            controller: Name of what drives them, for the reasons of failures.
        """
        models = [device.model for device in devices]
        count = len(devices)
        self.steps, self.cables = exo.steps, cables(models[0])
        self.going = np.ones(count, dtype=np.bool_)
        """Mask of the designs that have not failed."""
        self.failed = [""] * count
        """Reasons of those that failed; else empty."""
        self._exo, self._devices, self._controller = exo, devices, controller
        self._winding = Winding.over([device.winding for device in devices])
        self._angles = [scripts[row % len(scripts)].angles for row in range(count)]
        self._commands = np.stack([script.commands for script in scripts])
        self._marks = np.stack([script.marks for script in scripts])
        self._scale = np.array([device.motor_scale for device in devices])
        self._limit = np.array([device.torque_limit for device in devices])
        readers = [Reader(models[0], name) for name in self.cables]
        self._nodes = [reader.nodes for reader in readers]
        self._tensions = [f"tension_{name}_nodes_n" for name in self.cables]
        self._energies = np.array([reader.energy for reader in readers])
        self._outputs = np.array(exo.device.cable_outputs)
        self._batch = Batch(models[0], count, threads, persistent=True)
        self._batch.set_models(models)
        self._bound = Physics(*(self._batch.bind(name) for name in Physics._fields))
        self._warnings = self._batch.warning[:, :, 1]
        self._status = self._batch.status
        self._control = np.zeros((count, exo.frame_skip, models[0].nu))
        self._step = 0

    def start(self) -> Columns:
        """Bring all to the start; see `Plant.start`."""
        # Results that MuJoCo has not yet for the batch.
        now = self._bound.apart()
        for row, device in enumerate(self._devices):
            data = mujoco.MjData(device.model)
            commands = self._commands[row % len(self._commands), 0]
            device.start(data, self._angles[row], commands)
            mujoco.mj_getState(device.model, data, self._batch.state[row], _STATE)
            now.take(physics_of(data), row)
        return self._columns(now)

    def advance(self, torque: Array) -> Columns:
        """Go a control step; see `Plant.advance`."""
        control, device, skip = self._control, self._exo.device, self._exo.frame_skip
        if not np.isfinite(torque).all():
            self._refuse(np.isfinite(torque))
        # `np.clip` takes several times as long for small arrays.
        share = np.minimum(np.maximum(torque / self._limit, -1.0), 1.0)
        # The actions of the environments are of single precision.
        share = share.astype(np.float32).astype(np.float64)
        control[:, :, device.motor_control] = (share * self._scale)[:, None]
        first = self._step * skip
        commands = self._commands[:, first : first + skip]
        control[:, :, device.script_controls] = commands
        everyone = self.going.all()
        chosen = control if everyone else control[self.going]
        # What raised shows in the status of the batch.
        with untimed(), contextlib.suppress(SimulationError):
            self._batch.rollout(
                skip, chosen, record=(), ids=None if everyone else self.going
            )
        self._step += 1
        if self._warnings.any() or self._status.any():
            fell = self._warnings.any(axis=1) | (self._status != 0)
            if (fell & self.going).any():
                self._note(fell & self.going, self._step * self._exo.period)
        return self._columns(self._bound)

    def _columns(self, now: Physics) -> Columns:
        """Return what can be measured now, and what is kept of it beside."""
        state = now.plugin_state
        columns: dict[str, Any] = self._exo.device.read_motion(now, self._winding)
        _, phase, sine, cosine = self._marks[:, self._step].T
        count = self.going.size
        told = np.empty((3, count))
        told[0] = self._exo.task.torque(
            columns["joint_angle_rad"], columns["joint_velocity_rad_s"], phase
        )
        told[1], told[2] = sine, cosine
        columns["desired_torque_nm"] = told[0]
        columns["phase_sine"], columns["phase_cosine"] = told[1], told[2]
        least = np.empty((count, len(self.cables)))
        for place, name in enumerate(self._tensions):
            columns[name] = nodes = state[:, self._nodes[place]]
            nodes.min(axis=1, out=least[:, place])
        columns["least_tension_n"] = least
        columns["tension_n"] = np.abs(now.actuator_force[:, self._outputs])
        columns["dissipated_j"] = state[:, self._energies]
        return columns

    def _refuse(self, finite: NDArray[np.bool_]) -> None:
        time = self._step * self._exo.period
        for row in np.flatnonzero(self.going & ~finite):
            self.failed[row] = no_torque(self._controller, time)
        self.going &= finite

    def _note(self, fell: NDArray[np.bool_], time: float) -> None:
        self.going &= ~fell
        for row in np.flatnonzero(fell).tolist():
            self.failed[row] = why_failed(self._batch, row, time)
