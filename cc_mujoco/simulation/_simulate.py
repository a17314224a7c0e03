"""An episode, or many at once, from plants to logs.

    log = simulate("wrist", "pi", motion="sine", task="spring", seed=0)
    log["joint_torque_nm"]                                      # (T,) [N m]
    rough = Plant("wrist", {"friction": 0.2})
    logs = simulate(["wrist", rough], "model", seed=[0, 1])     # one batch

A log has the same bits whether its plant is simulated alone, in a batch or step by step
in its environment. The controller reads sensors; the log holds the truth.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from cc_mujoco import plugin
from cc_mujoco._utils.provenance import versions
from cc_mujoco.assets import scene_path
from cc_mujoco.cable import Cable
from cc_mujoco.control import Controller
from cc_mujoco.control import controller as make_controller
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._sensors import Measuring, Sensing
from cc_mujoco.errors import CableError
from cc_mujoco.human import Spring, Task, Trajectory
from cc_mujoco.metrics._metric import (
    DRIVEN,
    PULL_PULL,
    RATIO,
    SAFE_TORQUE,
    SPRING,
    STRENGTH,
)
from cc_mujoco.simulation._episode_log import EpisodeLog, Recorder, log_file
from cc_mujoco.simulation._log_columns import MODEL_XML, columns_for
from cc_mujoco.simulation._loop import Columns, Observer, Single, Trace, run

if TYPE_CHECKING:
    import gymnasium

    from cc_mujoco.device import Plant
    from cc_mujoco.simulation._worn_device import WornDevice

Law = str | Controller | Callable[[Drive], Any]
"""Name of a controller, a controller, or a function that makes one of a drive."""


@overload
def simulate(
    plants: str | Plant,
    controller: Law = ...,
    *,
    motion: str | Path | Trajectory | None = ...,
    task: str | Path | Task | None = ...,
    seed: int = ...,
    duration: float = ...,
    sensing: Sensing | None = ...,
    threads: int = ...,
    about: Mapping[str, Any] | None = ...,
    progress: Callable[[float], object] | None = ...,
    file: str | Path | None = ...,
) -> EpisodeLog: ...


@overload
def simulate(
    plants: list[Any] | tuple[Any, ...],
    controller: Law = ...,
    *,
    motion: str | Path | Trajectory | None = ...,
    task: str | Path | Task | None = ...,
    seed: int | Sequence[int] = ...,
    duration: float = ...,
    sensing: Sensing | None = ...,
    threads: int = ...,
    about: Mapping[str, Any] | None = ...,
    progress: Callable[[float], object] | None = ...,
) -> list[EpisodeLog]: ...


def simulate(
    plants: str | Plant | list[Any] | tuple[Any, ...],
    controller: Law = "pi",
    *,
    motion: str | Path | Trajectory | None = None,
    task: str | Path | Task | None = None,
    seed: int | Sequence[int] = 0,
    duration: float = 10.0,
    sensing: Sensing | None = None,
    threads: int = 0,
    about: Mapping[str, Any] | None = None,
    progress: Callable[[float], object] | None = None,
    file: str | Path | None = None,
) -> EpisodeLog | list[EpisodeLog]:
    """Simulate an episode of a plant, or of several plants of one device at once.

    Args:
        plants: Name of a device or a `Plant`, or a list of them of one device and of
            equal layout.
        controller: Name, `module:function` or file of a policy, as of
            `cc_mujoco.control._controller`, or a function that is called with the
            drive, as `module:function` is: it is made for each plant and knows its
            values. Or a `Controller`, which knows the values of the drive that it was
            made for and reads numbers of a plant and arrays over a list of plants.
        motion: Motion of the wearer, see `human.trajectory`; that of the device by
            default.
        task: Torque that the wearer should feel, see `human.task`; that of the device
            by default.
        seed: Seed of all that is random, one for all plants or one for each.
        duration: Length of the episode [s], rounded to whole control steps of 1 ms.
        sensing: Sensors of the controller; those of the device by default.
        threads: Threads that simulate; 0 means one per processor.
        about: Metadata for the logs, besides or instead of the names of motion
            (`trajectory`), task and controller; see `describe` for the rest.
        progress: Called with the simulated time [s] after every control step.
        file: Parquet file to which the log of a single plant is written while the
            episode runs, so that a long one needs no memory; it is there whole or not
            at all.

    Returns:
        The log of a plant, or the logs of several, from the start to the last step.
        That of a file reads its columns on demand, see `EpisodeLog.open`.

    Raises:
        CableError: If an argument cannot be used, a simulation diverges or the
            controller fails.
    """
    from gymnasium.utils import seeding  # a list of names need not wait for these

    from cc_mujoco.device import Plant
    from cc_mujoco.simulation._batch import FRAME_SKIP, Alone, Fleet
    from cc_mujoco.simulation._worn_device import WornDevice

    alone = isinstance(plants, (str, Plant))
    made = _plants(plants)
    seeds = _seeds(seed, len(made))
    if not (isinstance(threads, int) and threads >= 0):
        raise CableError(f"threads must be an integer >= 0, not {threads!r}.")
    setup = made[0].setup
    motion = setup.trajectory if motion is None else motion
    task = setup.task if task is None else task
    exos = {
        key: WornDevice(setup, motion, task, duration, FRAME_SKIP, None, plant.model())
        for key, plant in {id(plant): plant for plant in made}.items()
    }
    played = [exos[id(plant)] for plant in made]
    exo = played[0]
    sensing = setup.sensing if sensing is None else sensing
    if not isinstance(sensing, Sensing):
        raise CableError(f"sensing must be a Sensing, not {sensing!r}.")
    law = _law(controller, [sensing.equip(one.drive) for one in played], alone)
    given = {"trajectory": motion, "task": task, "controller": controller}
    about = {key: _label(one) for key, one in given.items()} | dict(about or {})
    called = str(about["controller"])
    scripts = [
        one.author.write(seeding.np_random(own)[0])
        for one, own in zip(played, seeds, strict=True)
    ]
    devices = [one.device for one in played]
    fleet = Fleet(exo, devices, scripts, threads, called, whole=True)
    late = [plant.values.get("delay", sensing.delay) for plant in made]
    noise = [plant.noise for plant in made]
    measuring = Measuring(
        sensing,
        law.drive,
        exo.device.driven,
        seeds[0] if alone else seeds,
        exo.steps,
        delay=late[0] if alone else late,
        noise=noise[0] if alone else noise,
    )

    def check(step: int, _: Columns, __: object) -> None:
        for row, why in enumerate(fleet.failed):
            if why:
                raise CableError(f"plant {row}: {why}.")
        if step and progress is not None:
            progress(step * exo.period)

    def go(keep: Observer) -> None:
        plant = Alone(fleet) if alone else fleet
        run(plant, law, check, keep, measure=measuring.measure, name=called)

    facts = [
        describe(played[row], plant.cables, sensing, own, about) | _facts(plant)
        for row, (plant, own) in enumerate(zip(made, seeds, strict=True))
    ]
    if file is not None:
        if not alone:
            raise CableError("file takes the log of one plant; give no list of them.")
        with log_file(file, fleet.cables, facts[0]) as log:
            go(log.keep)
        return EpisodeLog.open(file)
    trace = Trace([column.name for column in columns_for(fleet.cables)], exo.steps)
    go(trace.keep)
    if alone:
        return EpisodeLog(trace.columns, facts[0])
    return [
        EpisodeLog({name: kept[:, row] for name, kept in trace.columns.items()}, own)
        for row, own in enumerate(facts)
    ]


def _plants(given: Any) -> list[Plant]:
    """Return the plants that are given, one for each name."""
    from cc_mujoco.device import Plant

    listed: Any = [given] if isinstance(given, (str, Plant)) else given
    if not isinstance(listed, Sequence) or not listed:
        raise CableError(
            "plants must be the name of a device, a Plant or a list of them, not "
            f"{given!r}."
        )
    named = {name: Plant(name) for name in listed if isinstance(name, str)}
    plants = [named[one] if isinstance(one, str) else one for one in listed]
    first = plants[0]
    for row, plant in enumerate(plants):
        if not isinstance(plant, Plant):
            raise CableError(
                f"plant {row} must be the name of a device or a Plant, not {plant!r}."
            )
        if plant.setup is not first.setup:
            raise CableError(
                "the plants of a batch must be of one device, not of "
                f"{first.setup.scene!r} and {plant.setup.scene!r}; simulate each "
                "device by itself."
            )
        if plant.layout != first.layout:
            raise CableError(
                f"plant {row} has other segments, routes or another gait than plant 0; "
                "simulate it by itself."
            )
    return plants


def _facts(plant: Plant) -> dict[str, Any]:
    """Return the metadata of a plant whose values are not those of its device."""
    if not plant.values:
        return {}
    return {**plant.facts, MODEL_XML: plant.xml(), "values": dict(plant.values)}


def _seeds(given: Any, count: int) -> list[int]:
    """Return a seed for each of several plants."""
    single = isinstance(given, (int, np.integer))
    seeds = [given] * count if single else list(np.atleast_1d(given))
    whole = all(isinstance(one, (int, np.integer)) and one >= 0 for one in seeds)
    if len(seeds) != count or not whole:
        raise CableError(
            f"seed must be an integer from 0, or one for each of {count} plants, not "
            f"{given!r}."
        )
    return [int(one) for one in seeds]


def _law(given: Any, drives: Sequence[Drive], alone: bool) -> Controller:
    """Return the controller of a plant, or of several."""
    from cc_mujoco.simulation._batched_controller import BatchedController

    if isinstance(given, Controller):
        period = drives[0].period
        if given.drive.period != period:
            raise CableError(
                f"the controller is made for a period of {given.drive.period:g} s, but "
                f"the episode has one of {period:g} s."
            )
        return given
    if not (isinstance(given, str) or callable(given)):
        raise CableError(
            "controller must be a name, a Controller or a function of a Drive, not "
            f"{given!r}."
        )
    return (
        make_controller(given, drives[0]) if alone else BatchedController(given, drives)
    )


def _label(given: Any) -> str:
    """Return the name of a motion, a task or a controller for the metadata."""
    if isinstance(given, (str, Path)):
        return str(given)
    if isinstance(given, Controller):
        return given.name or type(given).__name__
    return str(getattr(given, "__qualname__", type(given).__name__))


def play(
    env: gymnasium.Env[Any, Any],
    controller: Controller,
    *,
    sensing: Sensing | None = None,
    seed: int = 0,
    about: Mapping[str, Any] | None = None,
    progress: Callable[[float], object] | None = None,
) -> EpisodeLog:
    """Play one episode of an environment as it is, its wrappers included.

    Args:
        env: One of this package's environments; its `info` fills the log.
        controller: What drives the motor, made for the environment's drive.
        sensing: What the controller sees with; the sensors of the device by default.
        seed: Seed of the reset and of the noise of the sensors.
        about: Metadata for the log, besides that of the device, the wearer, the
            sensors and the versions: names of trajectory, task and controller.
        progress: Called with the simulated time in seconds after every step.

    Returns:
        The log, from the reset to the last step.

    Raises:
        CableError: If the simulation diverges or the controller fails.
    """
    exo: WornDevice = env.unwrapped.exo  # type: ignore[attr-defined]
    sensing = sensing or exo.setup.sensing
    plant = Single(env, seed)
    driven = exo.device.driven
    measuring = Measuring(sensing, controller.drive, driven, seed, plant.steps)
    recorder = Recorder(plugin.cables(exo.device.model), {})

    def observe(step: int, columns: Columns, _: object) -> None:
        if step == 0:  # a reset may have drawn other cables and another wearer
            own = plugin.from_mjcf(exo.device.model)
            recorder.metadata.update(describe(exo, own, sensing, seed, about or {}))
        recorder.record(columns)
        if step and progress is not None:
            progress(float(columns["time_s"]))

    name = str((about or {}).get("controller", ""))
    run(plant, controller, observe, measure=measuring.measure, name=name)
    return recorder.log()


def describe(
    exo: WornDevice,
    cables: Mapping[str, Cable],
    sensing: Sensing,
    seed: int,
    about: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the metadata of the log of an episode.

    Args:
        exo: Device, wearer, motion and task.
        cables: Those of the device, by name.
        sensing: What the controller saw with.
        seed: Of the episode.
        about: Further metadata.
    """
    setup, wearer = exo.setup, exo.device.wearers[0]
    return {
        "scene": setup.scene,
        **about,
        "seed": seed,
        "duration": exo.steps * exo.period,
        "sensing": sensing.to_json(),
        "wearer": dataclasses.asdict(wearer),
        RATIO: 1.0 / exo.drive.ratio,
        DRIVEN: list(exo.device.driven),
        STRENGTH: dict.fromkeys(cables, setup.strength),
        SAFE_TORQUE: setup.safe_torque,
        PULL_PULL: setup.pull_pull,
        SPRING: isinstance(exo.task, Spring),
        "cables": {name: cable.to_config() for name, cable in cables.items()},
        "versions": versions(),
        MODEL_XML: scene_path(setup.scene).read_text(encoding="utf-8"),
    }
