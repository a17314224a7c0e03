"""Many designs at once, with perfect sensors: a study compares transmissions.

Where task and controller are known as compiled code, they run inside MuJoCo's steps,
with the same bits.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control import Controller, controller
from cc_mujoco.control._registry import Unpowered, batched_controller
from cc_mujoco.device import Plant
from cc_mujoco.device._description import Description
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._model import DeviceModel
from cc_mujoco.device._sensors import PERFECT_SENSING
from cc_mujoco.human import Trajectory, Wearer
from cc_mujoco.simulation._batch import Batch
from cc_mujoco.simulation._compiled_batch import (
    TICK_STEPS,
    CompiledEpisodes,
    law_of,
    task_of,
)
from cc_mujoco.simulation._compiled_episode import KEPT, attend
from cc_mujoco.simulation._loop import Columns
from cc_mujoco.simulation._reference_motion import MARKS, Script
from cc_mujoco.simulation._worn_device import TaskChoice, WornDevice

Array = NDArray[np.float64]

_ONE = threading.Lock()

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
