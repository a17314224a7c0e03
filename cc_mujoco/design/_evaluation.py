"""Rows of the table from designs: build, play what the metrics need, measure."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import mujoco
import numpy as np

from cc_mujoco._utils.provenance import code_provenance
from cc_mujoco._workers import Tick
from cc_mujoco.control import axes_controller
from cc_mujoco.design._bill_of_materials import inertias_of, parts_of
from cc_mujoco.design._protocol import (
    CHIRP_SHARE,
    CHIRP_TIME,
    SWING_TIME,
    ChirpTorque,
    EpisodeProtocol,
    NoMotion,
    SineTorque,
    device_digests,
)
from cc_mujoco.design._scenarios import LEAST_SUFFIX, Case
from cc_mujoco.design._study_metrics import (
    CONTROLLER_METRIC,
    by_axis,
    by_case,
    by_controller,
    is_stride_metric,
    metric_of,
    number_columns,
    over_axes,
    split_metric,
    wants_high,
)
from cc_mujoco.device import Axis, Description, Device, Plant
from cc_mujoco.device._axis_columns import axis_columns
from cc_mujoco.device._model import joint_range
from cc_mujoco.device._sensors import PERFECT_SENSING
from cc_mujoco.device._variables import Value
from cc_mujoco.device._wearer_scaling import (
    WALKER,
    body_of,
    helped_axis,
    pace_of,
    profile_of,
    trajectory_of,
)
from cc_mujoco.human import Spring, Task, Wearer, scale_task
from cc_mujoco.human import task as find_task
from cc_mujoco.human._gait_joints import GaitJoint, gait_joints
from cc_mujoco.human._profile import Profiles
from cc_mujoco.metrics import ArrayLog, Metric, measure
from cc_mujoco.metrics._clamped import SWING_PERIODS
from cc_mujoco.metrics._metric import (
    DRIVEN,
    GAIT_JOINT,
    MOMENT_RATIO,
    PACE,
    RATIO,
    SPRING,
    Test,
)
from cc_mujoco.metrics._torque import first_unsafe_sample
from cc_mujoco.simulation._rollout import Episode, Rollout, attended, play
from cc_mujoco.simulation._worn_device import TaskChoice

Design = dict[str, Value]

LOCKED_SHARE = 1.5
"""Inertia of a joint with all others locked over that with none, above which the
latter counts: twice the inertia of an ideal wearer is at the edge of stability."""


class DesignResult(NamedTuple):
    metrics: dict[str, float]
    """All `number_columns`; NaN where one cannot be had."""
    failed: str
    """Why it failed in simulation, where it diverged or put more into the joint than is
    safe; empty where it did not."""
    controller: str = ""
    """The one that metrics are of; empty where the design failed."""
    worst: tuple[str, ...] = ()
    """The worst case of every metric; empty where there are none or it failed."""
    out: Mapping[str, str] = MappingProxyType({})
    """Why controllers are out, by name; of one that is not there is none."""


def evaluate(
    protocol: EpisodeProtocol,
    designs: Sequence[Design],
    tick: Tick = lambda share: None,
) -> list[DesignResult]:
    """Try designs of equal layout (numbers of segments) together.

    Returns one result per design, whatever becomes of the others. Of several
    controllers it is that with the least tracking error, the first of equals; one that
    fails is out, and the design with it only where all do. Over several cases the
    controller is one and the same: that whose tracking error over them is least, of
    those that fail in none.

    `tick` is called now and then with the share that is done; may raise to stop.
    """
    protocol.find_metrics()
    builder = protocol.device
    cases = protocol.across.cases
    tried = [
        _try_case(
            protocol,
            builder,
            case,
            designs,
            _partial_tick(tick, n / len(cases), 1 / len(cases)),
        )
        for n, case in enumerate(cases)
    ]
    return [
        _result(protocol, [case[index] for case in tried])
        for index in range(len(designs))
    ]


class _Tried(NamedTuple):
    """Results of a design in one case by controller: metrics, or why it failed."""

    rows: dict[str, dict[str, float]]
    failed: dict[str, str]


def _try_case(
    protocol: EpisodeProtocol,
    builder: Device,
    case: Case,
    designs: Sequence[Design],
    tick: Tick,
) -> list[_Tried]:
    plants = [Plant(builder, {**design, **case}) for design in designs]
    models = [attended(plant) for plant in plants]
    tests = episodes(protocol, builder, plants[0].values)
    laws = protocol.controllers
    found: list[dict[str, dict[str, float]]] = [{n: {} for n in laws} for _ in designs]
    failed: list[dict[str, str]] = [{} for _ in designs]
    if any(metric_of(name).test == "parts" for name in protocol.metrics):
        for each, plant, model in zip(found, plants, models, strict=True):
            row = _measure_parts(plant, model, protocol)
            for law in laws:
                each[law] |= row
    strides: Mapping[str, GaitJoint] = {}
    if any(is_stride_metric(name) for name in protocol.metrics):
        strides = joints_of_gait(builder)
    total = sum(episode.duration for _, _, episode in tests)
    done = 0.0
    for test, law, episode in tests:
        start, part = done / total, episode.duration / total
        if test == "episode":
            task = tasks_of(
                [plant.values for plant in plants],
                episode.task,
                builder.description,
            )
            episode = dataclasses.replace(episode, task=task)
        played = play(episode, models, tick=_partial_tick(tick, start, part))
        for index, why in enumerate(played.failed):
            if not why and test == "episode":
                why = _unsafe_reason(played, index, builder.description.axes)
            of = (law,) if law else laws
            if why:
                where = "" if test == "episode" else f"{test} test: "
                failed[index] = dict.fromkeys(of, where + why) | failed[index]
                continue
            row = _measure(test, played, index, plants[index], protocol, strides)
            for name in of:
                found[index][name] |= row
        done += episode.duration
    return [_Tried(*pair) for pair in zip(found, failed, strict=True)]


def _result(protocol: EpisodeProtocol, tried: Sequence[_Tried]) -> DesignResult:
    across = protocol.across
    failed: dict[str, str] = {}
    for case, one in zip(across.cases, tried, strict=True):
        where = f"in case {across.label(case)}: " if across.several else ""
        failed = {law: where + why for law, why in one.failed.items()} | failed
    good = [law for law in protocol.controllers if law not in failed]
    if not good:
        none = dict.fromkeys(number_columns(protocol), math.nan)
        return DesignResult(none, failed[protocol.controllers[0]], out=failed)

    def each(name: str, law: str) -> list[float]:
        return [one.rows[law].get(name, math.nan) for one in tried]

    def over(name: str, law: str) -> float:
        return across.of(each(name, law), wants_high(protocol, name))

    best = good[0]
    if len(protocol.controllers) > 1:
        best = min(good, key=lambda law: over(CONTROLLER_METRIC, law))
    columns = *protocol.metrics, *by_axis(protocol)
    metrics = {name: over(name, best) for name in columns}
    for column, (name, law) in by_controller(protocol).items():
        metrics[column] = over(name, law) if law in good else math.nan
    if not across.several:
        return DesignResult(metrics, "", best, out=failed)
    for column, name in by_case(protocol).items():
        end = np.min if column.endswith(LEAST_SUFFIX) else np.max
        metrics[column] = float(end(each(name, best)))
    worst = tuple(
        across.worst(each(name, best), wants_high(protocol, name))
        for name in protocol.metrics
    )
    return DesignResult(metrics, "", best, worst, failed)


def episodes(
    protocol: EpisodeProtocol,
    builder: Device,
    design: Mapping[str, Value] | None = None,
) -> list[tuple[Test, str, Episode]]:
    """Return the episodes that the metrics of a protocol need.

    Args:
        protocol: how designs are tried.
        builder: of the scene.
        design: whose wearer walks; as fast as was measured by default.

    Returns:
        Test, name of the controller, episode; no name where the test is of the
        hardware alone.

    Raises:
        CableError: the trajectory or the task cannot be played.
    """
    main = episode_of(design or {}, _main_episode(protocol, builder))
    needed = {metric_of(name).test for name in protocol.metrics}
    found: list[tuple[Test, str, Episode]] = []
    if "episode" in needed:
        found += [
            ("episode", law, dataclasses.replace(main, controller=law))
            for law in protocol.controllers
        ]
    if "backdrive" in needed:
        found.append(("backdrive", "", dataclasses.replace(main, task="transparent")))
    if needed & {"backlash", "bandwidth"}:
        held, swings, chirps = _held_episode(main, Plant(builder).model())
        if "backlash" in needed:
            slow = dataclasses.replace(
                held,
                task=swings,
                duration=SWING_PERIODS * SWING_TIME,
                controller="none",
            )
            found.append(("backlash", "", slow))
        if "bandwidth" in needed:
            fast = dataclasses.replace(held, task=chirps, duration=CHIRP_TIME)
            found += [
                ("bandwidth", law, dataclasses.replace(fast, controller=law))
                for law in protocol.controllers
            ]
    return found


def beyond_motor(protocol: EpisodeProtocol, design: Design) -> str:
    """Return a sentence if the task exceeds the motor or the safe torque of a design.

    See `WornDevice.beyond`; it is empty otherwise.
    """
    builder = protocol.device
    values = {**design, **protocol.across.cases[0]}
    plant = Plant(builder, values)
    main = episode_of(values, _main_episode(protocol, builder))
    task = tasks_of([plant.values], main.task, builder.description)
    exo = dataclasses.replace(main, task=task).exo(plant.model())
    return exo.beyond(exo.author.write(np.random.default_rng(protocol.seed)))


def rehearse(protocol: EpisodeProtocol, builder: Device) -> None:
    """Make all that a protocol needs, and play nothing."""
    model = Plant(builder).model()
    played = [episode for _, _, episode in episodes(protocol, builder)]
    for episode in played or [_main_episode(protocol, builder)]:
        exo = episode.exo(model)
        exo.author.write(np.random.default_rng(protocol.seed))
    drives = [PERFECT_SENSING.equip(drive) for drive in exo.drives]
    for law in protocol.controllers:
        axes_controller(law, drives, exo.device.prefixes)


@dataclass(frozen=True)
class DesignJob:
    """A protocol as a `_workers.Job` whose pieces are designs of equal layout."""

    protocol: EpisodeProtocol

    def rehearse(self) -> None:
        rehearse(self.protocol, self.protocol.device)

    def made_by(self) -> dict[str, Any]:
        self.protocol.find_metrics()
        files = device_digests(self.protocol.device)
        return code_provenance(*self.protocol.code_names, files=files)

    def size(self, piece: Sequence[Design]) -> int:
        return len(piece)

    def do(self, piece: Sequence[Design], tick: Tick) -> list[DesignResult]:
        """Try designs; see `evaluate`."""
        return evaluate(self.protocol, piece, tick)


def _main_episode(protocol: EpisodeProtocol, builder: Device) -> Episode:
    """Return the main episode of a study, without a controller."""
    return Episode(
        builder.description,
        protocol.trajectory,
        protocol.task,
        protocol.duration,
        builder.frame_skip,
        protocol.seed,
        None,
    )


def _least_inertia(model: mujoco.MjModel, joint: str) -> float:
    """Return the inertia of a joint in the neutral pose [kg m^2].

    The other joints are locked; where that makes it `LOCKED_SHARE` times as large as if
    they are free, they are free.
    """
    dof = int(model.joint(joint).dofadr[0])
    locked, yielding = float(model.dof_M0[dof]), 1.0 / float(model.dof_invweight0[dof])
    return locked if locked < LOCKED_SHARE * yielding else yielding


def _held_episode(
    main: Episode, model: mujoco.MjModel
) -> tuple[Episode, dict[str, Task], dict[str, Task]]:
    """Return the episode with the joints held at rest, and two torques of each axis.

    A slow swing and a chirp. They are shares of the largest of each motor at its joint
    without friction, in the direction in which it pulls, of the scene as it stands,
    which `model` is.
    """
    device, step = main.device(model), float(model.opt.timestep)
    drives = device.drives(main.frame_skip * step)
    swings: dict[str, Task] = {}
    chirps: dict[str, Task] = {}
    wearers, angles = {}, {}
    for axis, drive in zip(device.axes, drives, strict=True):
        name, limb = axis.axis.name, axis.axis.limb
        wearers[limb] = Wearer.ideal(_least_inertia(model, limb), step)
        angles[limb] = axis.axis.centre
        # A cable that only pulls swings between nothing and its most.
        share, bias = (0.5, 0.5) if drive.one_way else (1.0, 0.0)
        most = drive.high * drive.ratio
        swings[name] = SineTorque(share * most, bias * most)
        chirps[name] = ChirpTorque(CHIRP_SHARE * most, 2.5 * CHIRP_SHARE * bias * most)
    still = NoMotion(tuple(angles.items()))
    held = dataclasses.replace(main, trajectory=still, wearer=wearers)
    return held, swings, chirps


def unheld_reason(builder: Device) -> str:
    """Return why joints cannot be held for a test, as a part of a sentence, or ""."""
    joints = [axis.limb for axis in builder.description.axes]
    for joint in joints:
        if joint not in builder.movers:
            return f"joint {joint!r} has no wearer to hold it: write [wearer.{joint}]"
        if joints.count(joint) > 1:
            return f"two axes drive joint {joint!r}, whose torques are one"
    return ""


def _measure(
    test: Test,
    played: Rollout,
    index: int,
    plant: Plant,
    protocol: EpisodeProtocol,
    strides: Mapping[str, GaitJoint],
) -> dict[str, float]:
    """Return the metrics of one test of a design by column, also those of each axis.

    The design has place `index` in the batch that was played. `strides` has parts in a
    walk by axis, empty where no stride is measured.
    """
    logs = {}
    for place, axis in enumerate(plant.description.axes):
        facts = plant.facts(axis)
        task = protocol.task
        if isinstance(task, Mapping):
            task = task[axis.name]
        facts[SPRING] = isinstance(find_task(task, (axis.limb,)), Spring)
        if axis.name in strides:
            facts |= {
                GAIT_JOINT: strides[axis.name],
                PACE: pace_of(plant.values),
                MOMENT_RATIO: body_of(plant.values).moment,
            }
        logs[axis.name] = _record_of(played, index, tuple(plant.cables), facts, place)
    return _values(test, logs, protocol)


def _measure_parts(
    plant: Plant, model: mujoco.MjModel, protocol: EpisodeProtocol
) -> dict[str, float]:
    """Return the metrics of the parts of a design by column."""
    whole, axes = parts_of(plant, dict(protocol.costs)), plant.description.axes
    logs = {
        axis.name: ArrayLog({}, metadata=whole | own)
        for axis, own in zip(axes, inertias_of(plant, model), strict=True)
    }
    return _values("parts", logs, protocol)


def _values(
    test: Test, logs: Mapping[str, ArrayLog], protocol: EpisodeProtocol
) -> dict[str, float]:
    """Return the metrics of a test by column, from the log of each axis."""
    first = next(iter(logs.values()))
    chosen = [m for m in map(metric_of, protocol.metrics) if m.test == test]
    if not protocol.axes:
        return _by_name(first, chosen)
    found = _by_name(first, [metric for metric in chosen if not metric.of_axis])
    owns = dict.fromkeys(split_metric(m.name)[1] for m in chosen if m.of_axis)
    for axis, log in logs.items():
        # A stride is that of one joint, which the others do not have.
        there = [n for n in owns if PACE in log.metadata or not is_stride_metric(n)]
        values = _by_name(log, [metric_of(name) for name in there])
        found |= {f"{axis}.{name}": value for name, value in values.items()}
    return found | over_axes(protocol, found)


def _by_name(log: ArrayLog, metrics: Sequence[Metric]) -> dict[str, float]:
    return {metric.name: value for metric, value in measure(log, metrics).items()}


def _unsafe_reason(played: Rollout, index: int, axes: Sequence[Axis]) -> str:
    """Return why the torque of a design is a failure; empty where it is none."""
    time = played.columns["time_s"][index]
    for axis, prefix in zip(axes, played.prefixes, strict=True):
        torque, safe = played.columns[f"{prefix}joint_torque_nm"], axis.safe_torque
        first = first_unsafe_sample(torque[index], safe, float(time[1] - time[0]))
        if first is not None:
            where = f" of axis {axis.name}" if prefix else ""
            return (
                f"the joint torque{where} exceeds the safe {safe:g} N m at "
                f"{time[first]:.3f} s"
            )
    return ""


def _partial_tick(tick: Tick, start: float, part: float) -> Callable[[float], None]:
    return lambda share: tick(start + part * share)


def _record_of(
    played: Rollout,
    index: int,
    cables: tuple[str, ...],
    facts: Mapping[str, Any],
    axis: int = 0,
) -> ArrayLog:
    """Return one axis of a design of a batch in the shape of an episode log.

    The tension of nodes is that of the node with least (T, 1).
    """
    prefixes = played.prefixes
    own = axis_columns(played.columns, prefixes[axis], prefixes)
    columns = {name: values[index] for name, values in own.items()}
    lost, ends, least = (
        columns.pop(name) for name in ("dissipated_j", "tension_n", "least_tension_n")
    )
    for place, cable in enumerate(cables):
        columns[f"dissipated_{cable}_j"] = lost[place]
        columns[f"tension_{cable}_proximal_n"] = ends[2 * place]
        columns[f"tension_{cable}_distal_n"] = ends[2 * place + 1]
        nodes = np.maximum(least[place], 0.0)[:, None]
        columns[f"tension_{cable}_nodes_n"] = nodes
    ratio = float(played.ratio[index, axis])
    driven = played.driven[axis]
    return ArrayLog(columns, cables, {RATIO: ratio, DRIVEN: driven, **facts})


def episode_of(design: Mapping[str, Value], episode: Episode) -> Episode:
    """Return an episode with the gait and the task of the wearer of a design."""
    return dataclasses.replace(
        episode,
        trajectory=trajectory_of(design, episode.trajectory),
        task=_each_task(episode.task, lambda task: _task_of_wearer(task, design)),
    )


def tasks_of(
    designs: Sequence[Mapping[str, Value]], task: TaskChoice, device: Description
) -> TaskChoice:
    """Return the task of designs simulated together: `task`, or their profiles."""
    found = [profile_of(design) for design in designs]
    profiles = [profile for profile in found if profile is not None]
    return _with_profile(task, Profiles(profiles) if profiles else None, device)


def task_of(
    design: Mapping[str, Value], task: TaskChoice, device: Description
) -> TaskChoice:
    own = _each_task(task, lambda one: _task_of_wearer(one, design))
    return _with_profile(own, profile_of(design), device)


def _with_profile(
    task: TaskChoice, profile: Task | None, device: Description
) -> TaskChoice:
    """Return a task with a profile, if there is one, at the axis that is helped."""
    helped = helped_axis(device)
    if profile is None or helped is None:
        return task
    return {**task, helped.name: profile} if isinstance(task, Mapping) else profile


def _each_task(
    task: TaskChoice, change: Callable[[str | Path | Task], str | Path | Task]
) -> TaskChoice:
    if isinstance(task, Mapping):
        return {name: change(one) for name, one in task.items()}
    return None if task is None else change(task)


def _task_of_wearer(
    task: str | Path | Task, design: Mapping[str, Value]
) -> str | Path | Task:
    """Return a task for the wearer of a design, who may walk differently.

    Tasks that do not follow the gait are returned unchanged.
    """
    if not any(name in design for name in WALKER):
        return task
    return scale_task(find_task(task), pace_of(design), body_of(design).moment)


def joints_of_gait(builder: Device) -> dict[str, GaitJoint]:
    """Return the parts in a walk of the joints that a device drives, by axis."""
    model, axes = Plant(builder).model(), builder.description.axes
    found = gait_joints({axis.limb: joint_range(model, axis.limb) for axis in axes})
    walking = {joint.name: joint for joint in found}
    return {axis.name: walking[axis.limb] for axis in axes if axis.limb in walking}
