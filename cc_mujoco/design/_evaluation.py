"""Evaluation of designs: compile, simulate the tests that metrics need, measure.

Besides the episode of the protocol, metrics may need these tests:

- `backdrive`: the wearer moves along the same trajectory and the motor gives no torque;
- `backlash`: the joint is held, and the motor's torque is a slow sine, as in Experiment
  1 of the thesis;
- `bandwidth`: the joint is held, and the desired torque is a chirp.
"""

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

import mujoco
import numpy as np

from cc_mujoco._utils.provenance import code_provenance
from cc_mujoco._workers.local_executor import Tick
from cc_mujoco.control import axes_controller
from cc_mujoco.design import _protocol as protocols
from cc_mujoco.design._bill_of_materials import inertias_of, parts_of
from cc_mujoco.design._protocol import EpisodeProtocol, metric_of
from cc_mujoco.design._scenarios import LEAST_SUFFIX
from cc_mujoco.device import Device, Plant
from cc_mujoco.device._axis_columns import axis_columns
from cc_mujoco.device._model import joint_range
from cc_mujoco.device._sensors import PERFECT_SENSING
from cc_mujoco.device._variables import Value
from cc_mujoco.device._wearer_scaling import body_of, pace_of, tasks_of, trajectory_of
from cc_mujoco.human import Spring, Task, Trajectory, Wearer
from cc_mujoco.human import task as find_task
from cc_mujoco.human._gait import GaitJoint, gait_joints
from cc_mujoco.human._motion import Motion, episode_fraction
from cc_mujoco.metrics import METRICS, ArrayLog, measure
from cc_mujoco.metrics import _formulas as formulas
from cc_mujoco.metrics._metric import Key, Test
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.simulation._rollout import Episode, Rollout, attended_together, play

Real = TypeVar("Real", float, Array)
Design = dict[str, Value]

SWING_TIME = 2.0
"""Period of the sine in the backlash test [s]; its amplitude is the largest torque of
the scene's motor without friction."""

CHIRP_TIME = 6.0  # duration of the chirp that the bandwidth is measured with [s]


@dataclass(frozen=True)
class NoMotion(Trajectory):
    """Trajectory at rest: joints keep their angles. Phase: fraction of the episode."""

    angles: tuple[tuple[str, float], ...] = ()  # of joints [rad], 0 for all others

    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        still, phase = np.zeros_like(time), episode_fraction(time, duration)
        held = {n: Motion(time, still + a, still, still, phase) for n, a in self.angles}
        return Motion(time, still, still, still, phase, held)


@dataclass(frozen=True)
class SineTorque(Task):
    """Desired torque that is a sine of `SWING_PERIODS` periods."""

    of_phase = True
    amplitude: float  # signed [N m]
    bias: float  # constant part [N m]; a cable that only pulls needs one

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        wave = self.bias + self.amplitude * np.sin(self._turn(phase))
        torque: Real = 0.0 * angle + wave
        return torque

    def _turn(self, phase: Any) -> Any:
        return 2.0 * math.pi * formulas.SWING_PERIODS * phase


@dataclass(frozen=True)
class ChirpTorque(SineTorque):
    """Desired torque whose frequency grows exponentially with the phase."""

    def _turn(self, phase: Any) -> Any:
        octaves = math.log(formulas.CHIRP_HIGH / formulas.CHIRP_LOW)
        cycles = formulas.CHIRP_LOW * CHIRP_TIME * np.expm1(octaves * phase) / octaves
        return 2.0 * math.pi * cycles


class DesignResult(NamedTuple):
    """Result of one design: metrics, reason of a failure, controller of the metrics."""

    metrics: dict[str, float]  # all `number_columns`; NaN where one cannot be had
    failed: str  # why it diverged or was unsafe for the joint; empty where it was not
    controller: str = ""  # the one that metrics are of; empty where the design failed
    worst: tuple[str, ...] = ()  # the worst case of every metric, if there are any
    out: Mapping[str, str] = MappingProxyType({})  # why controllers are out, by name


def evaluate(
    protocol: EpisodeProtocol,
    designs: Sequence[Design],
    tick: Tick = lambda share: None,
) -> list[DesignResult]:
    """Simulate and measure designs of equal layout (numbers of segments) together.

    The result has an entry per design; a failure does not affect the others. Of several
    controllers it is that with the least tracking error over all cases, the first if
    equal, among those that fail in no case; a design fails if none is left.

    `tick` is called repeatedly with the share that is done; it may raise to stop.
    """
    protocol.find_metrics()
    device, cases = protocol.device, protocol.across.cases
    tried: list[list[_Tried]] = []
    for case in cases:
        before = len(tried)
        plants = [Plant(device, {**design, **case}) for design in designs]
        models = attended_together(plants)
        tests = episodes(protocol, [plant.values for plant in plants])
        whole = sum(episode.duration for _, _, episode in tests)
        scores = _Scores(protocol, plants, models)
        done = 0.0
        for test, law, episode in tests:
            start, part = before + done / whole, episode.duration / whole

            def passed(share: float, start: float = start, part: float = part) -> None:
                tick((start + part * share) / len(cases))

            scores.add(test, law, play(episode, models, tick=passed, plants=plants))
            done += episode.duration
        tried.append(scores.tried)
    return [_result(protocol, each) for each in zip(*tried, strict=True)]


class _Tried(NamedTuple):
    rows: dict[str, dict[str, float]]
    failed: dict[str, str]


class _Scores:
    """Metrics and failures of plants in one case, collected test by test."""

    def __init__(
        self,
        protocol: EpisodeProtocol,
        plants: Sequence[Plant],
        models: Sequence[mujoco.MjModel],
    ) -> None:
        self._protocol = protocol
        laws = protocol.controllers
        self.tried = [_Tried({law: {} for law in laws}, {}) for _ in plants]
        self._metrics = [metric_of(name) for name in protocol.metrics]
        walks = any(Key.PACE in metric.needs for metric in self._metrics)
        strides = joints_of_gait(protocol.device) if walks else {}
        self._facts = [_facts(protocol, plant, strides) for plant in plants]
        self._cables = tuple(plants[0].cables)
        if all(metric.test != "parts" for metric in self._metrics):
            return
        for one, plant, model in zip(self.tried, plants, itertools.cycle(models)):
            whole = parts_of(plant, dict(protocol.costs))
            own = inertias_of(plant, model)
            found = self._measured("parts", [ArrayLog({}, (), whole | x) for x in own])
            for law in laws:
                one.rows[law] |= found

    def add(self, test: Test, law: str, played: Rollout) -> None:
        """Add a test of the controller `law`; "" is a test of the hardware alone."""
        laws = (law,) if law else self._protocol.controllers
        where = "" if test == "episode" else f"{test} test: "
        for row, one in enumerate(self.tried):
            why = played.failed[row]
            if not why and test == "episode":
                why = self._unsafe_reason(played, row)
            if why:
                failed = dict.fromkeys(laws, where + why)
                one.failed.update(failed | one.failed)
                continue
            logs = [self._log(played, row, n) for n in range(len(played.axes))]
            found = self._measured(test, logs)
            for name in laws:
                one.rows[name] |= found

    def _measured(self, test: Test, logs: Sequence[ArrayLog]) -> dict[str, float]:
        """Return the metrics of a test by column, from the log of each axis."""
        protocol = self._protocol
        chosen = [metric for metric in self._metrics if metric.test == test]
        if not protocol.axes:
            return {m.name: value for m, value in measure(logs[0], chosen).items()}
        whole = [metric for metric in chosen if not metric.of_axis]
        found = {m.name: value for m, value in measure(logs[0], whole).items()}
        names = (m.name.rpartition(".")[2] for m in chosen if m.of_axis)
        owns = [METRICS[name] for name in dict.fromkeys(names)]
        for axis, log in zip(protocol.axes, logs, strict=True):
            # A stride is that of one joint, which the others do not have.
            walks = Key.PACE in log.metadata
            values = measure(log, (m for m in owns if walks or Key.PACE not in m.needs))
            found |= {f"{axis}.{m.name}": value for m, value in values.items()}
        return found | protocols.over_axes(protocol, found)

    def _log(self, played: Rollout, row: int, axis: int) -> ArrayLog:
        """Return one axis of a design as a log, with the least tension of nodes."""
        own = axis_columns(played.columns, played.prefixes[axis], played.prefixes)
        columns = {name: values[row] for name, values in own.items()}
        names = "dissipated_j", "tension_n", "least_tension_n"
        lost, ends, least = map(columns.pop, names)
        for place, cable in enumerate(self._cables):
            columns[f"dissipated_{cable}_j"] = lost[place]
            columns[f"tension_{cable}_proximal_n"] = ends[2 * place]
            columns[f"tension_{cable}_distal_n"] = ends[2 * place + 1]
            columns[f"tension_{cable}_nodes_n"] = np.maximum(least[place], 0.0)[:, None]
        ratio, driven = float(played.ratio[row, axis]), played.driven[axis]
        known = {Key.RATIO: ratio, Key.DRIVEN: driven}
        known |= self._facts[row][axis]
        if math.isfinite(played.axes[axis].safe_torque):
            known[Key.SAFE_TORQUE] = played.axes[axis].safe_torque
        return ArrayLog(columns, self._cables, known)

    def _unsafe_reason(self, played: Rollout, row: int) -> str:
        """Return why a design's joint torque is unsafe; "" if it is safe."""
        time = played.columns["time_s"][row]
        for axis, prefix in zip(played.axes, played.prefixes, strict=True):
            torque = played.columns[f"{prefix}joint_torque_nm"][row]
            safe, period = axis.safe_torque, float(time[1] - time[0])
            first = formulas.first_unsafe_sample(torque, safe, period)
            if first is not None:
                where = f" of axis {axis.name}" if prefix else ""
                assumed = "assumed " if axis.safe_is_assumed else ""
                return (
                    f"the joint torque{where} exceeds the {assumed}safe {safe:g} N m "
                    f"at {time[first]:.3f} s"
                )
        return ""


def _facts(
    protocol: EpisodeProtocol, plant: Plant, strides: Mapping[str, GaitJoint]
) -> list[dict[str, Any]]:
    """Return the constants of each axis; `strides` has joints of a gait by axis."""
    found = []
    for axis in plant.description.axes:
        task = protocol.task
        if isinstance(task, Mapping):
            task = task[axis.name]
        facts = plant.facts(axis)
        found_task = find_task(task, plant.description.limbs(axis))
        facts[Key.SPRING] = isinstance(found_task, Spring)
        if axis.name in strides:
            facts[Key.GAIT_JOINT] = strides[axis.name]
            facts[Key.PACE] = pace_of(plant.values)
            facts[Key.MOMENT_RATIO] = body_of(plant.values).moment
        found.append(facts)
    return found


def _result(protocol: EpisodeProtocol, tried: Sequence[_Tried]) -> DesignResult:
    across = protocol.across
    failed: dict[str, str] = {}
    for case, one in zip(across.cases, tried, strict=True):
        where = f"in case {across.label(case)}: " if across.several else ""
        failed = {law: where + why for law, why in one.failed.items()} | failed
    good = [law for law in protocol.controllers if law not in failed]
    if not good:
        none = dict.fromkeys(protocols.number_columns(protocol), math.nan)
        return DesignResult(none, failed[protocol.controllers[0]], out=failed)

    def each(name: str, law: str) -> list[float]:
        return [one.rows[law].get(name, math.nan) for one in tried]

    def over(name: str, law: str) -> float:
        return across.of(each(name, law), protocols.wants_high(protocol, name))

    best = good[0]
    if len(protocol.controllers) > 1:
        best = min(good, key=lambda law: over(protocols.CONTROLLER_METRIC, law))
    columns = *protocol.metrics, *protocols.by_axis(protocol)
    metrics = {name: over(name, best) for name in columns}
    for column, (name, law) in protocols.by_controller(protocol).items():
        metrics[column] = over(name, law) if law in good else math.nan
    if not across.several:
        return DesignResult(metrics, "", best, out=failed)
    for column, name in protocols.by_case(protocol).items():
        end = np.min if column.endswith(LEAST_SUFFIX) else np.max
        metrics[column] = float(end(each(name, best)))
    high = {name: protocols.wants_high(protocol, name) for name in protocol.metrics}
    worst = tuple(across.worst(each(name, best), high[name]) for name in high)
    return DesignResult(metrics, "", best, worst, failed)


def episodes(
    protocol: EpisodeProtocol, designs: Sequence[Mapping[str, Value]] = ({},)
) -> list[tuple[Test, str, Episode]]:
    """Return the episodes that the metrics of a protocol need.

    Each comes with its test and the name of its controller, "" if the test is of the
    hardware alone. The wearer is that of the first of `designs`, who by default walks
    at the measured speed.
    """
    main = _main_episode(protocol, designs)
    needed = {metric_of(name).test for name in protocol.metrics}
    held, swings, chirps = main, None, None
    if needed & {"backlash", "bandwidth"}:
        held, swings, chirps = _held_episode(main, Plant(protocol.device).model())
    slow, unpowered = (
        formulas.SWING_PERIODS * SWING_TIME,
        dataclasses.replace(held, controller="none"),
    )
    tests: dict[Test, Episode] = {
        "episode": main,
        "backdrive": dataclasses.replace(main, task="transparent"),
        "backlash": dataclasses.replace(unpowered, task=swings, duration=slow),
        "bandwidth": dataclasses.replace(held, task=chirps, duration=CHIRP_TIME),
    }
    driven = ("episode", "bandwidth")
    return [
        (test, law, dataclasses.replace(one, controller=law) if law else one)
        for test, one in tests.items()
        if test in needed
        for law in (protocol.controllers if test in driven else ("",))
    ]


def beyond_motor(protocol: EpisodeProtocol, design: Design) -> str:
    """Return why the task exceeds a design's motor or safe torque, or ""."""
    plant = Plant(protocol.device, {**design, **protocol.across.cases[0]})
    exo = _main_episode(protocol, [plant.values]).exo(plant.model())
    return exo.beyond(exo.author.write(np.random.default_rng(protocol.seed)))


@dataclass(frozen=True)
class DesignJob:
    """A `local_executor.Job` whose pieces are batches of designs of equal layout."""

    protocol: EpisodeProtocol

    def rehearse(self) -> None:
        """Load and compile all that the protocol needs, without a simulation."""
        protocol = self.protocol
        model = Plant(protocol.device).model()
        played = [episode for _, _, episode in episodes(protocol)]
        for episode in played or [_main_episode(protocol)]:
            exo = episode.exo(model)
            exo.author.write(np.random.default_rng(protocol.seed))
        drives = [PERFECT_SENSING.equip(drive) for drive in exo.drives]
        for law in protocol.controllers:
            axes_controller(law, drives, exo.device.prefixes)

    def made_by(self) -> dict[str, Any]:
        self.protocol.find_metrics()
        files = protocols.device_digests(self.protocol.device)
        return code_provenance(*self.protocol.code_names, files=files)

    def size(self, piece: Sequence[Design]) -> int:
        return len(piece)

    def do(self, piece: Sequence[Design], tick: Tick) -> list[DesignResult]:
        return evaluate(self.protocol, piece, tick)


def _main_episode(
    protocol: EpisodeProtocol, designs: Sequence[Mapping[str, Value]] = ({},)
) -> Episode:
    device = protocol.device
    return Episode(
        device.description,
        trajectory_of(designs[0], protocol.trajectory),
        tasks_of(designs, protocol.task, device.description),
        protocol.duration,
        device.frame_skip,
        protocol.seed,
        None,
    )


def _held_episode(
    main: Episode, model: mujoco.MjModel
) -> tuple[Episode, dict[str, SineTorque], dict[str, ChirpTorque]]:
    """Return an episode with the joints held, and two torques for each axis.

    These are a slow sine and a chirp, as shares of the largest torque of each motor at
    its joint without friction, in the direction in which it pulls, in the model of the
    scene. A joint is held by an ideal wearer for its inertia in the neutral pose with
    the others locked or, if that is 1.5 times as large or more, with the others free:
    at twice its inertia an ideal wearer is at the limit of stability. Joints of one
    limb that move each other are held more softly by the same measure.
    """
    device, step = main.device(model), float(model.opt.timestep)
    drives = device.drives(main.frame_skip * step)
    swings: dict[str, SineTorque] = {}
    chirps: dict[str, ChirpTorque] = {}
    wearers, angles = {}, {}
    dofs = [int(model.joint(axis.axis.limb).dofadr[0]) for axis in device.axes]
    locked, free = model.dof_M0[dofs], 1.0 / model.dof_invweight0[dofs]
    held_inertia = np.where(locked < 1.5 * free, locked, free)
    coupled = _inverse_inertia(model, dofs) * held_inertia
    worst = float(np.abs(np.linalg.eigvals(coupled)).max())
    if worst > 1.5:
        held_inertia = held_inertia / worst
    for axis, drive, inertia in zip(device.axes, drives, held_inertia, strict=True):
        name, limb = axis.axis.name, axis.axis.limb
        wearers[limb] = Wearer.ideal(float(inertia), step)
        angles[limb] = axis.axis.centre
        # A cable that only pulls swings between nothing and its most.
        share, bias = (0.5, 0.5) if drive.one_way else (1.0, 0.0)
        most = drive.high * drive.ratio
        swings[name] = SineTorque(share * most, bias * most)
        chirps[name] = ChirpTorque(0.2 * most, 2.5 * 0.2 * bias * most)
    still = NoMotion(tuple(angles.items()))
    held = dataclasses.replace(main, trajectory=still, wearer=wearers)
    return held, swings, chirps


def _inverse_inertia(model: mujoco.MjModel, dofs: Sequence[int]) -> Array:
    """Return the accelerations of degrees of freedom by their forces in `qpos0`."""
    data, forces = mujoco.MjData(model), np.zeros((len(dofs), model.nv))
    mujoco.mj_forward(model, data)
    forces[np.arange(len(dofs)), dofs] = 1.0
    found = np.empty_like(forces)
    mujoco.mj_solveM(model, data, found, forces)
    return found[:, dofs]


def joints_of_gait(device: Device) -> dict[str, GaitJoint]:
    """Return the joint of a gait that each axis of a device follows, by axis."""
    model, axes = Plant(device).model(), device.description.axes
    found = gait_joints({axis.limb: joint_range(model, axis.limb) for axis in axes})
    walking = {joint.name: joint for joint in found}
    return {axis.name: walking[axis.limb] for axis in axes if axis.limb in walking}
