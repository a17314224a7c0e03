"""An episode, or many at once, from plants to logs.

    log = simulate("wrist", "pi", trajectory="sine", task="spring", seed=0)
    log["joint_torque_nm"]                                      # (T,) [N m]
    rough = Plant("wrist", {"friction": 0.2})
    logs = simulate(["wrist", rough], "model", seed=[0, 1])     # one batch

A log has the same bits whether its plant is simulated alone, in a batch or step by step
in its environment. The controller reads simulated sensors; the log holds true values.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack, overload

import numpy as np

from cc_mujoco import plugin
from cc_mujoco._utils.provenance import versions
from cc_mujoco.control import Controller
from cc_mujoco.control import _registry as registry
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._sensors import Sensing
from cc_mujoco.errors import CableError, shown, with_known_names
from cc_mujoco.human import Spring, Trajectory
from cc_mujoco.metrics._metric import Key
from cc_mujoco.simulation._episode_log import EpisodeLog, Recorder, log_file
from cc_mujoco.simulation._log_columns import AXES, MODEL_XML, columns_for
from cc_mujoco.simulation._loop import Columns, Observer, Single, Trace, run

if TYPE_CHECKING:
    import gymnasium

    from cc_mujoco.control import DistalFeedback, HysteresisTrial
    from cc_mujoco.device import Description, Device, Plant
    from cc_mujoco.simulation._worn_device import TaskChoice, WornDevice

Law = str | Controller | Callable[..., Any] | Mapping[str, Any]
"""Name of a controller, a controller, a function that makes one for a drive, or any but
the second by the name of an axis."""


class _Settings(TypedDict, total=False):
    """Arguments of `simulate` that are the same for one plant and for several."""

    trajectory: str | Path | Trajectory | None
    task: TaskChoice
    duration: float
    sensing: Sensing | None
    threads: int
    about: Mapping[str, Any] | None
    progress: Callable[[float], object] | None


@overload
def simulate(
    plants: str | Path | Device | Plant,
    controller: Law | None = ...,
    *,
    seed: int = ...,
    file: str | Path | None = ...,
    **settings: Unpack[_Settings],
) -> EpisodeLog: ...


@overload
def simulate(
    plants: list[Any] | tuple[Any, ...],
    controller: Law | None = ...,
    *,
    seed: int | Sequence[int] = ...,
    **settings: Unpack[_Settings],
) -> list[EpisodeLog]: ...


@with_known_names
def simulate(
    plants: str | Path | Device | Plant | list[Any] | tuple[Any, ...],
    controller: Law | None = None,
    *,
    trajectory: str | Path | Trajectory | None = None,
    task: TaskChoice = None,
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
        plants: Name or file of a device, a `Device` or a `Plant`, or a list of them of
            one device and of equal layout.
        controller: Name, `module:function` or file of a policy, as of
            `cc_mujoco.controller`; by default `pi_tuned` or, where the task commands
            an angle, `backlash_inverse` or `none`. Or a function that is called with
            the drive, as `module:function` is: it is made for each axis of each plant
            and knows its values; see `control.axes_controller` for different ones. Or a
            `Controller`, which knows the values of the drive that it was made for and
            reads numbers of a plant and arrays over a list of plants.
        trajectory: Motion of the wearer, see `human.trajectory`; that of the device by
            default.
        task: Torque that the wearer should feel, see `human.task`, for all axes or by
            axis; that of the device by default.
        seed: Seed of all that is random, one for all plants or one for each.
        duration: Length of the episode [s], rounded to whole control steps of 1 ms.
        sensing: Sensors of the controller; those of the device by default.
        threads: Threads that simulate; 0 means one per processor.
        about: Metadata for the logs, besides or instead of the names of trajectory,
            task and controller; see `describe` for the rest.
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
    # A list of names need not wait for these.
    from cc_mujoco.simulation._batch import Batch
    from cc_mujoco.simulation._worn_device import WornDevice

    made = _plants(plants)
    alone = not isinstance(plants, (list, tuple))
    seeds = _seeds(seed, len(made))
    if not (isinstance(threads, int) and threads >= 0):
        raise CableError(f"threads must be an integer >= 0, not {threads!r}.")
    device = made[0].description
    if controller is None:
        controller = registry.default_controller(device, task)
    trajectory = device.trajectory if trajectory is None else trajectory
    exos: dict[int, WornDevice] = {}
    for plant in made:
        if id(plant) not in exos:
            played_as = trajectory, task, duration
            exos[id(plant)] = WornDevice(device, plant.model(), *played_as)
    played = [exos[id(plant)] for plant in made]
    exo = played[0]
    sensing = device.sensing if sensing is None else sensing
    if not isinstance(sensing, Sensing):
        raise CableError(f"sensing must be a Sensing, not {sensing!r}.")
    drives = [[sensing.equip(drive) for drive in one.drives] for one in played]
    law = _law(controller, drives, exo.device.prefixes)
    labels = _label(trajectory), task_label(device, task), _label(controller)
    given = zip(("trajectory", "task", "controller"), labels, strict=True)
    about = dict(given) | dict(about or {})
    called = str(about["controller"])
    batch = Batch(played, seeds, threads=threads, name=called, whole=True, alone=alone)
    late = [plant.values.get("delay", sensing.delay) for plant in made]
    noise = [plant.noise for plant in made]
    which: Any = 0 if alone else slice(None)
    errors = {"delay": late[which], "noise": noise[which]}
    known = registry.law_drives(law, exo.drives)
    measuring = exo.controller_sensors(sensing, known, seeds[which], **errors)

    def check(step: int, _: Columns, __: object) -> None:
        for row, why in enumerate(batch.failed):
            if why:
                raise CableError(f"plant {row}: {why}.")
        if step and progress is not None:
            progress(step * exo.period)

    def go(keep: Observer) -> None:
        run(batch, law, check, keep, measure=measuring.measure, name=called)

    facts = [
        describe(played[row], plant.scene, plant, sensing, own, about)
        for row, (plant, own) in enumerate(zip(made, seeds, strict=True))
    ]
    if file is not None:
        if not alone:
            raise CableError("file takes the log of one plant; give no list of them.")
        with log_file(file, batch.cables, facts[0], exo.device.prefixes) as log:
            go(log.keep)
        return EpisodeLog.open(file)
    names = columns_for(batch.cables, exo.device.prefixes)
    trace = Trace([column.name for column in names], exo.steps)
    go(trace.keep)
    if alone:
        return EpisodeLog(trace.columns, facts[0])
    return [
        EpisodeLog({name: kept[:, row] for name, kept in trace.columns.items()}, own)
        for row, own in enumerate(facts)
    ]


def _plants(given: Any) -> list[Plant]:
    from cc_mujoco.device import Nominal, Plant

    listed: Any = given if isinstance(given, (list, tuple)) else [given]
    if not listed:
        raise CableError("plants must be at least one; the list is empty.")
    named: dict[Any, Plant] = {}
    plants: list[Plant] = []
    for row, one in enumerate(listed):
        if isinstance(one, (str, Path, Nominal)):
            one = named.setdefault(id(one), Plant(one))
        if not isinstance(one, Plant):
            raise CableError(
                f"plant {row} must be the name or file of a device, a Device or a "
                f"Plant, not {one!r}."
            )
        plants.append(one)
    first = plants[0]
    for row, plant in enumerate(plants):
        if plant.description.scene != first.description.scene:
            raise CableError(
                "the plants of a batch must be of one device, not of "
                f"{first.description.scene!r} and {plant.description.scene!r}; "
                "simulate each device by itself."
            )
        if plant.layout != first.layout:
            raise CableError(
                f"plant {row} has other segments, routes or another gait than plant 0; "
                "simulate it by itself."
            )
    return plants


def _seeds(given: Any, count: int) -> list[int]:
    single = isinstance(given, (int, np.integer))
    seeds = [given] * count if single else list(np.atleast_1d(given))
    whole = all(isinstance(one, (int, np.integer)) and one >= 0 for one in seeds)
    if len(seeds) != count or not whole:
        raise CableError(
            f"seed must be an integer from 0, or one for each of {count} plants, not "
            f"{given!r}."
        )
    return [int(one) for one in seeds]


def _law(
    given: Any, drives: Sequence[Sequence[Drive]], prefixes: Sequence[str]
) -> Controller:
    if isinstance(given, Controller):
        period = drives[0][0].period
        if given.drive.period != period:
            raise CableError(
                f"the controller is made for a period of {given.drive.period:g} s, but "
                f"the episode has one of {period:g} s."
            )
        return given
    if not (isinstance(given, (str, Mapping)) or callable(given)):
        raise CableError(
            "controller must be a name, a Controller or a function of a Drive, not "
            f"{given!r}."
        )
    return registry.batched_controller(given, drives, prefixes)


def task_label(device: Description, given: Any) -> str:
    if given is not None and not isinstance(given, Mapping):
        return _label(given)
    own = {axis.name: axis.task for axis in device.axes} | dict(given or {})
    if len(own) == 1:
        return _label(next(iter(own.values())))
    return ",".join(f"{name}={_label(task)}" for name, task in own.items())


def _label(given: Any) -> str:
    if isinstance(given, (str, Path)):
        return str(given)
    if isinstance(given, Controller):
        return given.name or type(given).__name__
    if isinstance(given, Mapping):
        return ",".join(f"{name}={_label(one)}" for name, one in given.items())
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
    """Play one episode of an environment, its wrappers included.

    Args:
        env: One of this package's environments; its `info` fills the log.
        controller: Controller of the motor, made for the environment's drive.
        sensing: Sensors of the controller; those of the device by default.
        seed: Seed of the reset and of the noise of the sensors.
        about: Metadata for the log, besides that of the device, the wearer, the
            sensors and the versions: names of trajectory, task and controller.
        progress: Called with the simulated time [s] after every control step.

    Returns:
        The log, from the reset to the last step.

    Raises:
        CableError: If the simulation diverges or the controller fails.
    """
    unwrapped: Any = getattr(env, "unwrapped", None)
    exo: WornDevice | None = getattr(unwrapped, "exo", None)
    if exo is None:
        raise CableError(
            f"env must be an environment of cc_mujoco with a device, not {shown(env)}."
        )
    sensing = sensing or exo.description.sensing
    plant = Single(env, seed)
    device = exo.device
    known = registry.law_drives(controller, exo.drives)
    measuring = exo.controller_sensors(sensing, known, seed)
    recorder = Recorder(plugin.cables(device.model), {}, device.prefixes)

    def observe(step: int, columns: Columns, _: object) -> None:
        if step == 0:  # a reset may have drawn other cables and another wearer
            made, given = unwrapped.plant, unwrapped.device
            facts = describe(exo, given, made, sensing, seed, about or {})
            recorder.metadata.update(facts)
        recorder.record(columns)
        if step and progress is not None:
            progress(float(columns["time_s"]))

    name = str((about or {}).get("controller", ""))
    run(plant, controller, observe, measure=measuring.measure, name=name)
    return recorder.log()


def describe(
    exo: WornDevice,
    device: Device,
    plant: Plant,
    sensing: Sensing,
    seed: int,
    about: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the metadata of an episode log: device, wearer, plant, sensors, versions.

    `sensing` are the sensors of the controller, `about` further metadata.
    """
    from cc_mujoco.device import Device

    description, model = exo.description, exo.device
    facts = {}
    each = description.axes, exo.drives, model.driven, exo.tasks
    for axis, drive, driven, task in zip(*each, strict=True):
        wearer = model.wearers.get(axis.limb)
        facts[axis.name] = {
            "wearer": None if wearer is None else dataclasses.asdict(wearer),
            Key.RATIO: 1.0 / drive.ratio,
            Key.DRIVEN: list(driven),
            **plant.facts(axis),
            Key.SPRING: isinstance(task, Spring),
        }
    own = next(iter(facts.values())) if len(facts) == 1 else {AXES: facts}
    found = {
        "scene": description.scene,
        **about,
        "seed": seed,
        "duration": exo.steps * exo.period,
        "sensing": sensing.to_json(),
        **own,
        "cables": {name: cable.to_config() for name, cable in plant.cables.items()},
        "versions": versions(),
    }
    if plant.values:
        found["values"] = dict(plant.values)
    # The plant of an environment has no scene of its own.
    scene = plant.xml() if isinstance(plant.device, Device) and plant.values else ""
    return {**found, MODEL_XML: scene or device.xml()}


def calibration_trials(
    plants: Sequence[str | Path | Device | Plant], duration: float = 12.0
) -> list[HysteresisTrial]:
    """Simulate trials that calibrate hysteresis, as on a bench, one for each plant.

    The joint moves slowly in loops of many sizes. On a bench a camera, for example,
    measures the joint although the device has no sensor there; the simulated trial has
    the joint angle too. `fit_hysteresis` takes it.

    Args:
        plants: Plants of one device with one axis, see `simulate`.
        duration: Length of the trial [s].

    Returns:
        The trial of each plant.

    Raises:
        CableError: The device has several axes, its wearer moves the joint, or a
            plant cannot be simulated.
    """
    from cc_mujoco.control import DistalFeedback, HysteresisTrial
    from cc_mujoco.device import DeviceModel, Plant
    from cc_mujoco.device._model import joint_range
    from cc_mujoco.human import Loops, Position

    made = [one if isinstance(one, Plant) else Plant(one) for one in plants]
    description = made[0].description
    axis = description.axis()
    if axis.limb in description.movers:
        raise CableError(
            f"a wearer moves joint {axis.limb!r} of {description.scene!r}; hysteresis "
            "is calibrated where cables and springs alone move the joint."
        )
    model = DeviceModel.of(made[0])
    low, high = joint_range(model.model, axis.joint)
    # The swing is 15 % beyond the reach of the device, and 5 % short of the stops.
    room = 0.95 * min(high - axis.centre, axis.centre - low)
    course = Loops(min(1.15 * axis.reach, room), axis.centre)
    sensing = dataclasses.replace(description.sensing, joint_sensor=True)
    played: Any = {"trajectory": course, "task": Position(), "duration": duration}

    def uncalibrated(drive: Drive) -> DistalFeedback:
        # Integral gain of the feedback that leads the joint through the trial [1/s]
        return DistalFeedback(dataclasses.replace(drive, hysteresis={}), gain=30.0)

    logs = simulate(made, uncalibrated, sensing=sensing, **played)
    ratio = model.axes[0].ratio
    return [
        HysteresisTrial.of(log["motor_angle_rad"], log["joint_angle_rad"], ratio)
        for log in logs
    ]
