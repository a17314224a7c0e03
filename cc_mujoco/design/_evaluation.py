"""Rows of the table from designs: build, play what the metrics need, measure."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import mujoco
import numpy as np

from cc_mujoco._utils.provenance import code_provenance
from cc_mujoco._workers import Tick
from cc_mujoco.control import controller
from cc_mujoco.design import _walking_designs as walking_designs
from cc_mujoco.design._bill_of_materials import parts_of
from cc_mujoco.design._protocol import (
    CHIRP_SHARE,
    CHIRP_TIME,
    CONTROL_PERIOD,
    SWING_TIME,
    ChirpTorque,
    EpisodeProtocol,
    NoMotion,
    SineTorque,
)
from cc_mujoco.design._scenarios import LEAST_SUFFIX, Case
from cc_mujoco.design._study_metrics import (
    CONTROLLER_METRIC,
    by_case,
    by_controller,
    is_stride_metric,
    number_columns,
    record_of,
    wants_high,
)
from cc_mujoco.device import Plant
from cc_mujoco.device._sensors import PERFECT_SENSING
from cc_mujoco.device._variables import WEARER, Value
from cc_mujoco.device._wearer_scaling import body_of, pace_of
from cc_mujoco.human import Spring, Wearer
from cc_mujoco.human import task as find_task
from cc_mujoco.metrics import METRICS, ArrayLog, measure
from cc_mujoco.metrics._clamped import SWING_PERIODS
from cc_mujoco.metrics._metric import GAIT_JOINT, MOMENT_RATIO, PACE, SPRING, Test
from cc_mujoco.metrics._torque import first_unsafe_sample
from cc_mujoco.simulation._rollout import Episode, Rollout, attended, play

Design = dict[str, Value]


class DesignResult(NamedTuple):
    """Outcome of one design."""

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

    Args:
        protocol: how they are tried.
        designs: as `Across.check` returns them.
        tick: called now and then with the share that is done; may raise to stop.

    Returns:
        One result per design, whatever becomes of the others. Of several controllers
        it is that with the least tracking error, the first of equals; one that fails
        is out, and the design with it only where all do. Over several cases the
        controller is one and the same: that whose tracking error over them is least,
        of those that fail in none.
    """
    protocol.find_metrics()
    builder = load_device(protocol.scene, protocol.timestep)
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
    """Try designs in one case."""
    plants = [Plant(builder, {**design, **case}) for design in designs]
    models = [attended(plant) for plant in plants]
    wearer = plants[0].wearer if WEARER.name in case else None
    tests = episodes(protocol, builder, wearer, plants[0].values)
    laws = protocol.controllers
    found: list[dict[str, dict[str, float]]] = [{n: {} for n in laws} for _ in designs]
    failed: list[dict[str, str]] = [{} for _ in designs]
    if any(METRICS[name].test == "parts" for name in protocol.metrics):
        for each, plant, model in zip(found, plants, models, strict=True):
            parts = parts_of(plant, model, dict(protocol.costs))
            for law in laws:
                each[law] |= _values("parts", ArrayLog({}, metadata=parts), protocol)
    walking: dict[str, Any] = {}
    if any(is_stride_metric(name) for name in protocol.metrics):
        walking[GAIT_JOINT] = walking_designs.gait_joint(builder)
    total = sum(episode.duration for _, _, episode in tests)
    done = 0.0
    for test, law, episode in tests:
        start, part = done / total, episode.duration / total
        if test == "episode":
            task = walking_designs.tasks_of(
                [plant.values for plant in plants], episode.task
            )
            episode = dataclasses.replace(episode, task=task)
        played = play(episode, models, tick=_partial_tick(tick, start, part))
        for index, why in enumerate(played.failed):
            if not why and test == "episode":
                why = _unsafe_reason(played, index, builder.setup.safe_torque)
            of = (law,) if law else laws
            if why:
                where = "" if test == "episode" else f"{test} test: "
                failed[index] = dict.fromkeys(of, where + why) | failed[index]
                continue
            row = _measure(test, played, index, plants[index], protocol, walking)
            for name in of:
                found[index][name] |= row
        done += episode.duration
    return [_Tried(*pair) for pair in zip(found, failed, strict=True)]


def _result(protocol: EpisodeProtocol, tried: Sequence[_Tried]) -> DesignResult:
    """Return the result of a design from its outcome in each case."""
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
    metrics = {name: over(name, best) for name in protocol.metrics}
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
    wearer: Wearer | None = None,
    design: Mapping[str, Value] | None = None,
) -> list[tuple[Test, str, Episode]]:
    """Return the episodes that the metrics of a protocol need.

    Args:
        protocol: how designs are tried.
        builder: of the scene.
        wearer: who moves the joint; that of the scene by default.
        design: whose wearer walks; as fast as was measured by default.

    Returns:
        Test, name of the controller, episode; no name where the test is of the
        hardware alone.

    Raises:
        CableError: the trajectory or the task cannot be played.
    """
    main = walking_designs.episode_of(
        design or {}, _main_episode(protocol, builder, wearer)
    )
    needed = {METRICS[name].test for name in protocol.metrics}
    found: list[tuple[Test, str, Episode]] = []
    if "episode" in needed:
        found += [
            ("episode", law, dataclasses.replace(main, controller=law))
            for law in protocol.controllers
        ]
    if "backdrive" in needed:
        found.append(("backdrive", "", dataclasses.replace(main, task="transparent")))
    if needed & {"backlash", "bandwidth"}:
        held, most, one_way = _held_episode(main, Plant(builder).model())
        # A cable that only pulls swings between nothing and its most.
        share, bias = (0.5, 0.5) if one_way else (1.0, 0.0)
        if "backlash" in needed:
            slow = dataclasses.replace(
                held,
                task=SineTorque(share * most, bias * most),
                duration=SWING_PERIODS * SWING_TIME,
                controller="none",
            )
            found.append(("backlash", "", slow))
        if "bandwidth" in needed:
            chirp = ChirpTorque(CHIRP_SHARE * most, 2.5 * CHIRP_SHARE * bias * most)
            fast = dataclasses.replace(held, task=chirp, duration=CHIRP_TIME)
            found += [
                ("bandwidth", law, dataclasses.replace(fast, controller=law))
                for law in protocol.controllers
            ]
    return found


def rehearse(protocol: EpisodeProtocol, builder: Device) -> None:
    """Make all that a protocol needs, and play nothing.

    Raises:
        CableError: trajectory, task or controller cannot be used.
    """
    model = Plant(builder).model()
    played = [episode for _, _, episode in episodes(protocol, builder)]
    for episode in played or [_main_episode(protocol, builder)]:
        exo = episode.exo(model)
        exo.author.write(np.random.default_rng(protocol.seed))
    drive = PERFECT_SENSING.equip(exo.drive)
    for law in protocol.controllers:
        controller(law, drive)


@dataclass(frozen=True)
class DesignJob:
    """A protocol as a `_workers.Job` whose pieces are designs of equal layout."""

    protocol: EpisodeProtocol

    def rehearse(self) -> None:
        """See `Job.rehearse`."""
        rehearse(
            self.protocol, load_device(self.protocol.scene, self.protocol.timestep)
        )

    def made_by(self) -> dict[str, Any]:
        """See `Job.made_by`; what tables hold goes with the protocol."""
        self.protocol.find_metrics()
        return code_provenance(*self.protocol.code_names)

    def size(self, piece: Sequence[Design]) -> int:
        """Return the number of designs."""
        return len(piece)

    def do(self, piece: Sequence[Design], tick: Tick) -> list[DesignResult]:
        """Try designs; see `evaluate`."""
        return evaluate(self.protocol, piece, tick)


def _main_episode(
    protocol: EpisodeProtocol, builder: Device, wearer: Wearer | None = None
) -> Episode:
    """Return the main episode of a study, without a controller."""
    return Episode(
        builder.setup,
        protocol.trajectory,
        protocol.task,
        protocol.duration,
        protocol.frame_skip,
        protocol.seed,
        None,
        wearer,
    )


def _held_episode(main: Episode, model: mujoco.MjModel) -> tuple[Episode, float, bool]:
    """Return the episode with the joint held at rest.

    Returns:
        The episode; the largest torque of the motor at the joint without friction, in
        the direction in which it pulls [N m]; whether it only pulls. Both are those of
        the scene as it stands, which `model` is.
    """
    device = main.device(model)
    drive = device.drive(CONTROL_PERIOD)
    joint = model.joint(main.setup.joint)
    inertia = float(model.dof_M0[int(joint.dofadr[0])])
    wearer = Wearer.ideal(inertia, float(model.opt.timestep))
    held = dataclasses.replace(main, trajectory=NoMotion(), wearer=wearer)
    return held, drive.high * drive.ratio, drive.one_way


def _measure(
    test: Test,
    played: Rollout,
    index: int,
    plant: Plant,
    protocol: EpisodeProtocol,
    walking: Mapping[str, Any],
) -> dict[str, float]:
    """Return the metrics of one test of a design, by name.

    Args:
        test: that was played.
        played: with all designs of the batch.
        index: of the design in the batch.
        plant: of the design.
        protocol: how designs are tried.
        walking: metadata of strides, empty where none is measured.
    """
    facts = plant.facts | {SPRING: isinstance(find_task(protocol.task), Spring)}
    if walking:
        facts |= {
            **walking,
            PACE: pace_of(plant.values),
            MOMENT_RATIO: body_of(plant.values).moment,
        }
    log = record_of(played, index, tuple(plant.cables), facts)
    return _values(test, log, protocol)


def _values(test: Test, log: ArrayLog, protocol: EpisodeProtocol) -> dict[str, float]:
    chosen = (METRICS[name] for name in protocol.metrics)
    found = measure(log, (metric for metric in chosen if metric.test == test))
    return {metric.name: value for metric, value in found.items()}


def _unsafe_reason(played: Rollout, index: int, safe: float) -> str:
    """Return why the torque of a design is a failure; empty where it is none."""
    time = played.columns["time_s"][index]
    torque = played.columns["joint_torque_nm"][index]
    first = first_unsafe_sample(torque, safe, float(time[1] - time[0]))
    if first is None:
        return ""
    return f"the joint torque exceeds the safe {safe:g} N m at {time[first]:.3f} s"


def _partial_tick(tick: Tick, start: float, part: float) -> Callable[[float], None]:
    return lambda share: tick(start + part * share)
