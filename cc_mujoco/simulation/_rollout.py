"""Episodes of many designs at once with perfect sensors, to compare transmissions.

If task and controller are compiled, they run inside MuJoCo's steps, with results
bit-identical to those of the loop in Python.
"""

import contextlib
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import SimulationError
from numpy.typing import NDArray

from cc_mujoco.control import AdaptiveModel, Controller, controller
from cc_mujoco.control._controller import STEPS, SteppedController, stepped_law
from cc_mujoco.control._registry import Unpowered, batched_controller
from cc_mujoco.device import Plant
from cc_mujoco.device._description import Axis, Description
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._model import DeviceModel
from cc_mujoco.device._sensors import PERFECT_SENSING
from cc_mujoco.human import Task, Trajectory, Wearer
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.plugin._mjcf import make_room
from cc_mujoco.simulation import _compiled_episode as compiled
from cc_mujoco.simulation._batch import Batch
from cc_mujoco.simulation._loop import Columns, missing_torque_error
from cc_mujoco.simulation._reference_motion import MARKS
from cc_mujoco.simulation._wiring import OF_PHASE, TASK_CODES, parameters_of
from cc_mujoco.simulation._worn_device import TaskChoice, WornDevice

_one = threading.Lock()
TICK_STEPS = 200  # control steps between two calls of a tick


@dataclass(frozen=True)
class Episode:
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

    def device(
        self, model: mujoco.MjModel, data: mujoco.MjData | None = None
    ) -> DeviceModel:
        return DeviceModel(self.description, model, self.wearer, data)

    def exo(self, model: mujoco.MjModel) -> WornDevice:
        played = self.trajectory, self.task, self.duration, self.frame_skip
        return WornDevice(self.description, model, *played, self.wearer)


@dataclass(frozen=True, eq=False)
class Rollout:
    """Episodes of n designs with T samples each, the start included.

    Columns are those of an episode log, (n, T). With c cables, columns of cables are
    (n, c, T), except `tension_n` (n, 2 c, T) with the proximal and distal end of each
    cable in turn. `least_tension_n` is below 0 where a cable is slack.
    """

    columns: dict[str, Array]
    ratio: Array  # joint angle per motor angle of an unstretched cable, (n, axes)
    driven: tuple[tuple[str, ...], ...]  # names of the cables that each motor winds
    prefixes: tuple[str, ...]  # beginnings of the columns of each axis
    # with the safe torques of the guards, raised for the task where assumed
    axes: tuple[Axis, ...]
    failed: tuple[str, ...]  # why the simulation of a design failed, else empty, (n,)


def attended(plant: Plant, spare_bytes: int = 0) -> mujoco.MjModel:
    """Compile a plant's model with the plugin that runs compiled episodes.

    Its cables get room for configurations longer by `spare_bytes`, see `make_room`.
    """
    spec = plant.spec()
    if spare_bytes:
        make_room(spec, spare_bytes)
    with _one:  # two threads would register the plugin twice
        compiled.attend(spec)  # at last, as a copy of `spec` would lose the instance
    return spec.compile()


def attended_together(plants: Sequence[Plant]) -> list[mujoco.MjModel]:
    """Compile models for `play`: one of each plant, or one that all can use.

    To compile a plant takes as long as a tenth of a second of its episode.
    """
    first, *others = [plant.compiled_values for plant in plants]
    if not others or any(values != first for values in others):
        return [attended(plant) for plant in plants]
    base = Plant(plants[0].device, first)
    longest = max(max(_text_sizes(plant)) for plant in plants)
    return [attended(base, max(longest - min(_text_sizes(base)), 0))]


def _text_sizes(plant: Plant) -> list[int]:
    """Return the number of characters that configure each cable of a plant."""
    return [len("".join(one.to_config().values())) for one in plant.cables.values()]


def play(
    episode: Episode,
    models: Sequence[mujoco.MjModel],
    threads: int = 1,
    tick: Callable[[float], object] = lambda share: None,
    plants: Sequence[Plant] = (),
) -> Rollout:
    """Simulate an episode on each of several models of equal layout, one per design.

    The only of `models` may be one for all `plants`, see `attended_together`. `tick` is
    called from time to time with the fraction done.
    """
    exo, data = episode.exo(models[0]), mujoco.MjData(models[0])
    if len(models) < len(plants):
        devices = [exo.device.with_cables(plant.cables) for plant in plants]
    else:
        devices = [exo.device, *(episode.device(model, data) for model in models[1:])]
    drives = [exo.drives_of(one, PERFECT_SENSING) for one in devices]
    name, driven, prefixes = episode.controller, exo.device.driven, exo.device.prefixes
    ratio = np.array([[1.0 / drive.ratio for drive in own] for own in drives])
    called = name if isinstance(name, str) else ""
    laws = None
    if len(prefixes) == 1 and not isinstance(name, Mapping):
        laws = _compiled_laws(name, [own[0] for own in drives], devices, exo)
    batch = Batch([exo], [episode.seed], devices, threads=threads, name=called)
    if laws is not None:
        columns = _play_inside(batch, laws, tick)
    else:
        law: Controller = Unpowered(drives[0][0], axes=len(prefixes))
        if name is not None:
            law = batched_controller(name, drives, prefixes)
        measuring = exo.controller_sensors(PERFECT_SENSING, drives[0], episode.seed)
        names = [prefix + name for prefix in prefixes for name in compiled.KEPT]

        def report(step: int, _: Columns, __: object) -> None:
            if step % TICK_STEPS == 0:
                tick(step / exo.steps)

        names += ["tension_n", "dissipated_j", "least_tension_n"]
        columns = batch.play(law, measuring.measure, names, report)
        for column, values in columns.items():
            columns[column] = np.ascontiguousarray(np.moveaxis(values, 0, -1))
    # These are the same for all designs.
    shape = (len(devices), exo.steps + 1)
    columns["time_s"] = np.broadcast_to(np.arange(exo.steps + 1) * exo.period, shape)
    marks = {"reference_angle_rad": 0, "phase_sine": 2, "phase_cosine": 3}
    for axis, prefix in enumerate(prefixes):
        for column, place in marks.items():
            mark = np.ascontiguousarray(batch.script.marks[:, MARKS * axis + place])
            columns[prefix + column] = np.broadcast_to(mark, shape)
    tick(1.0)
    axes = exo.description.axes
    return Rollout(columns, ratio, driven, prefixes, axes, tuple(batch.failed))


def _compiled_laws(
    name: str | None,
    drives: Sequence[Drive],
    devices: Sequence[DeviceModel],
    exo: WornDevice,
) -> list[Controller | None] | None:
    """Return compiled controllers, one per drive; None if only Python can run them."""
    laws = [None if name is None else controller(name, drive) for drive in drives[:1]]
    plain = all(axis.plain for device in devices for axis in device.axes)
    if not plain or task_of(exo.task) is None or law_of(laws[0]) is None:
        return None
    if name is None:
        return laws * len(drives)
    return laws + [controller(name, drive) for drive in drives[1:]]


def task_of(task: Task) -> int | None:
    """Return a task's code in `EpisodeRecord`; None if only Python can compute it."""
    return TASK_CODES.get(type(task), OF_PHASE if task.of_phase else None)


def law_of(controller: Controller | None) -> int | None:
    """Return the `law` of `EpisodeRecord`, -1 for None; None if only Python runs it."""
    if controller is None:
        return compiled.UNPOWERED
    law = stepped_law(type(controller))
    is_exact = not getattr(controller, "mismatch", 0.0)
    return STEPS.index(law.step) if law is not None and is_exact else None


def _play_inside(
    batch: Batch,
    controllers: Sequence[Controller | None],
    tick: Callable[[float], object],
) -> dict[str, Array]:
    """Play the episodes inside MuJoCo's steps; return columns as in `Rollout`.

    The devices have one axis and one script; `task_of` and `law_of` must know the task
    and the controllers, one per device. A failed device's columns end NaN.
    """
    exo, count = batch.exo, len(batch.devices)
    simulations, failed, going = batch.simulations, batch.failed, batch.going
    width = len(compiled.KEPT) + 4 * len(batch.cables)
    kept = np.full((count, width, exo.steps + 1), np.nan)
    records = np.zeros(count, compiled.RECORD)
    common, desired = _shared_record(batch)
    for row, law in enumerate(controllers):
        found = common | _law_record(batch, law)
        found["axis"] = batch.wiring.axis_address(row)
        found["columns"] = kept[row].ctypes.data
        if desired:
            found["desired"] = desired[row % len(desired)]
        for name, value in found.items():
            records[row][name] = value

    def begin(row: int, data: mujoco.MjData) -> None:
        address = records[row : row + 1].ctypes.data
        compiled.begin_episode()(data._address, address)

    def step_of(row: int, more: int = 0) -> int:
        return int((records[row]["count"] + more) // exo.frame_skip)

    def fail(row: int, why: str, first: int) -> None:
        failed[row], going[row] = why, False
        kept[row, :, first:] = np.nan

    for row, device in enumerate(batch.devices):
        simulations.start(row, device, batch.script, partial(begin, row))
    attended = simulations.batch.bind("userdata")[:, 0]
    for step in range(0, exo.steps, TICK_STEPS):
        for row in np.flatnonzero(going & (records["refused"] != 0)).tolist():
            now = step_of(row)
            why = missing_torque_error(batch.name, now * exo.period)
            fail(row, why, now + 1)
        tick(step / exo.steps)
        if not going.any():
            break
        last = min(step + TICK_STEPS, exo.steps)
        with contextlib.suppress(SimulationError):
            simulations.roll((last - step) * exo.frame_skip, going)
        for row in np.flatnonzero(simulations.fell & going).tolist():
            # A reset by MuJoCo clears `userdata`; an error leaves the state as it was.
            over = last == exo.steps and step_of(row) == last
            raised = simulations.batch.status[row] != 0
            is_counted = not raised and (over or attended[row] != 0.0)
            first = step_of(row, -1 if is_counted else 0) + 1
            fail(row, simulations.why(row, first * exo.period), first)
    columns = {name: kept[:, place] for place, name in enumerate(compiled.KEPT)}
    first = len(compiled.KEPT)
    for name, each in ("tension_n", 2), ("dissipated_j", 1), ("least_tension_n", 1):
        columns[name] = kept[:, first : first + each * len(batch.cables)]
        first += each * len(batch.cables)
    return columns


def _shared_record(batch: Batch) -> tuple[dict[str, Any], list[int]]:
    """Return fields that all records share, and addresses of a phase task's torques."""
    exo, script, hold = batch.exo, batch.script, batch.wiring.hold
    device, task = batch.devices[0], exo.task
    common = {
        "skip": exo.frame_skip,
        "steps": exo.steps,
        "scripted": len(device.script_controls),
        "script_controls": hold(np.array(device.script_controls, np.int64)),
        "commands": hold(np.ascontiguousarray(script.commands)),
        "cables": len(batch.cables),
        "readings": hold(_readings(device)),
        "task": task_of(task),
    }
    if common["task"] != OF_PHASE:
        return common | {"task_parameters": hold(parameters_of(task))}, []
    phase = script.marks[:, 1:2]
    nothing = np.zeros_like(phase)
    torques = np.asarray(task.torque(nothing, nothing, phase), dtype=float)
    torques = np.broadcast_to(torques, (exo.steps + 1, max(torques.shape[1], 1)))
    return common, [hold(np.ascontiguousarray(one)) for one in torques.T]


def _law_record(batch: Batch, made: Controller | None) -> dict[str, Any]:
    place, hold = law_of(made), batch.wiring.hold
    if not isinstance(made, SteppedController):
        return {"law": place}
    law, tables, memory = made.stepped, made.law_tables(), made.fresh_memory()
    taps: list[int] = []
    if isinstance(made, AdaptiveModel):
        cables = batch.exo.device.driven[0]
        for name, nodes in zip(cables, made.taps.nodes, strict=True):
            first = batch.devices[0].readers[name].nodes.start
            taps += (first + nodes).tolist()
    sources = [compiled.READ_COLUMNS.index(name) for name in law.wound]
    found = {"law": place, "is_round": law.is_round}
    for name, size, array in (
        ("memory", "memory_size", memory),
        ("shape", "shape_size", np.array(tables.shape, np.int64)),
        ("tables", "tables_size", np.array(tables.numbers)),
        ("sources", "source_count", np.array(sources)),
        ("taps", "tap_count", np.array(taps, np.int64)),
    ):
        found |= {name: hold(array), size: array.size}
    return found | {"seen": hold(np.zeros(len(sources) + len(taps)))}


def _readings(device: DeviceModel) -> NDArray[np.int64]:
    """Return the `readings` of `EpisodeRecord` (cables, 5), indices in `mjData`."""
    rows = []
    for one in device.readers.values():
        nodes = one.nodes.start, one.nodes.stop - one.nodes.start
        rows.append((*nodes, one.energy, *one.outputs))
    return np.array(rows, dtype=np.int64)
