"""Cell of the benchmark: a controller or a reference in one condition, with all seeds.

    ordinary = SUITES["v1"].conditions("wrist")[0]
    played = play(Cell(ordinary, "stiction", seeds=(0, 1, 2)))
    played.scores["rms_torque_error"]           # (seeds,) [N m]

A cell is one batch of simulations. Its results, computing times excepted, depend on
nothing but the cell.

Every axis of a device has its own scores, under `AXIS.NAME` if there are several. The
device's score is then the mean over its axes, but an episode has failed if any axis
has.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.benchmark import _conditions as conditions
from cc_mujoco.benchmark import _faults as faults
from cc_mujoco.benchmark._bristles import BristleChains
from cc_mujoco.benchmark._conditions import Condition
from cc_mujoco.benchmark._plant import BRISTLES, ActuationFaults, Draw, sample_plants
from cc_mujoco.benchmark._position import (
    WITH_SENSOR,
    PositionCondition,
    position_drives,
)
from cc_mujoco.benchmark._training import KEY as TRAINED_ON
from cc_mujoco.benchmark._training import trained_on
from cc_mujoco.benchmark._user_entry import Entry, end_entries
from cc_mujoco.control import Controller, PlantsController, Unpowered
from cc_mujoco.control._registry import batched_controller
from cc_mujoco.device import UNPLUGGED, DeviceModel, Plant
from cc_mujoco.device._axis_columns import axis_columns
from cc_mujoco.device._drive import CableDrive, Drive
from cc_mujoco.device._plant import facts_of
from cc_mujoco.device._sensors import REFERENCE_COLUMN, AxesMeasuring, Sensing
from cc_mujoco.errors import CableError
from cc_mujoco.human import Spring
from cc_mujoco.metrics import METRICS, ArrayLog, LogLike, Metric, measure
from cc_mujoco.metrics._metric import Key
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.simulation._batch import Batch
from cc_mujoco.simulation._worn_device import WornDevice


def _metrics(names: str) -> tuple[Metric, ...]:
    return tuple(METRICS[name] for name in names.split())


SCORES = _metrics(
    "rms_torque_error peak_torque_error torque_lag spring_backlash rms_motor_torque "
    "peak_motor_torque chatter slack_under_load failed"
)
"""All scores of an episode, in the order of tables; the nearer to 0, the better."""
# Scores of an episode whose task commands an angle
ANGLE_SCORES = _metrics(
    "rms_angle_error peak_angle_error rms_motor_torque peak_motor_torque chatter failed"
)
SAFETY_SCORES = (METRICS["peak_over_safe"], *SCORES)  # with a fault of sensor or strap
EVERY_SCORE = tuple(dict.fromkeys((*ANGLE_SCORES[:2], *SAFETY_SCORES)))  # in this order
CUT_SHARE = "cut_share"  # column: an entry's torques beyond the motor's, as a share
FAILURE = "failure"  # column: reason why the episode ended early, else empty


@dataclass(frozen=True)
class Cell:
    """A controller in a condition, with the seeds of its episodes."""

    condition: Condition
    controller: str  # name of a controller or a reference
    seeds: tuple[int, ...] = (0,)
    belief: conditions.Belief | None = None  # that of the condition by default
    sensing: Sensing | None = None  # that of the device by default
    key: str = field(default="", repr=False)  # secret of the run, see `_plant.new_key`

    def __post_init__(self) -> None:
        if not self.seeds or min(self.seeds) < 0:
            raise CableError("a cell needs at least one seed, none below 0.")

    @property
    def name(self) -> str:
        """Name of the cell without characters that file names cannot have."""
        parts = (self.condition.label, self.condition.name, self.controller)
        return "-".join(
            "".join(c if c.isalnum() else "_" for c in part) for part in parts
        )


@dataclass(frozen=True)
class CellResult:
    scores: dict[str, Array]  # by name (seeds,), see `episode_scores`
    # True and assumed parameters of the driven cables by name, a list over seeds each
    plants: dict[str, list[Any]]


class CellSetup(NamedTuple):
    """Everything that the episodes of cells need, an entry for each cell and seed."""

    draws: list[Draw]
    batch: Batch
    # every axis of each plant, as controllers know it
    drives: Sequence[tuple[Drive, ...]]
    law: Controller
    sensors: AxesMeasuring | faults.FaultySensors
    torque_noise: float  # standard deviation of the device's joint torque sensor [N m]
    facts: list[dict[str, Any]]  # constants that scores need, of every axis


def batch_groups(cells: Iterable[Cell]) -> list[list[Cell]]:
    """Return cells in groups that can be simulated as one batch."""
    found: dict[object, list[Cell]] = {}
    for cell in cells:
        at = cell.condition
        about = at.scene, at.task, at.moving_route, _structure_key(cell), at.duration
        own = cell.controller, cell.seeds, cell.sensing, cell.key, at.known
        key = *own, *about
        found.setdefault(key, []).append(cell)
    return list(found.values())


def _structure_key(cell: Cell) -> object:
    """Return a key that is equal for cells whose unknown effects allow one batch."""
    at = cell.condition
    timed = (*faults.FAULTS, *faults.EVENTS, BRISTLES)
    if at.known or at.structure in timed or isinstance(at, PositionCondition):
        return at.structure
    (drawn,) = sample_plants(at, cell.seeds[:1])
    cuffs = (bool(axis.cuff) for axis in drawn.plant.description.axes)
    return *cuffs, *drawn.plant.layout


def believed_drives(
    drives: Sequence[Drive],
    driven: Sequence[Sequence[str]],
    draws: Sequence[Draw],
    beliefs: Sequence[conditions.Belief],
) -> list[tuple[Drive, ...]]:
    """Return, for each plant, the drive of each axis with cables as assumed.

    `drives` are those of the axes, with true moment arms; `driven` has the names of
    each axis's cables. `draws` and `beliefs` (errors of the parameters) have an entry
    per plant.
    """
    found: list[tuple[Drive, ...]] = []
    for drawn, belief in zip(draws, beliefs, strict=True):
        random = np.random.default_rng([drawn.seed, 3])
        cables = drawn.known.cables
        own = []
        for drive, names in zip(drives, driven, strict=True):
            believed = [belief.of(cables[name], random) for name in names]
            pairs = zip(believed, drive.cables, strict=True)
            known = tuple(CableDrive(c, s.proximal, s.distal) for c, s in pairs)
            own.append(dataclasses.replace(drive, cables=known))
        found.append(tuple(own))
    return found


def prepare_episodes(cells: Sequence[Cell]) -> CellSetup:
    one = cells[0]
    at, reference = one.condition, conditions.REFERENCES.get(one.controller)
    draws: list[Draw] = []
    beliefs: list[conditions.Belief] = []
    for cell in cells:
        draws += sample_plants(cell.condition, cell.seeds, cell.key)
        error = conditions.MODEL_ERRORS[cell.condition.error]
        own = cell.belief or conditions.Belief(error)
        beliefs += [(reference and reference.belief) or own] * len(cell.seeds)
    description, seeds = draws[0].plant.description, [drawn.seed for drawn in draws]
    tasks = at.tasks(description)
    changes = reference.changes if reference else {}
    bristly = at.structure == BRISTLES and not changes
    if bristly:  # instead of the cables of the engine
        changes = UNPLUGGED
    models = []
    for plant in (drawn.plant for drawn in draws):
        if changes:
            each = product(plant.cables, changes.items())
            changed = {f"{cable}.{key}": value for cable, (key, value) in each}
            plant = Plant(plant.device, {**plant.values, **changed})
        models.append(plant.model())
    pairs = zip(models, [drawn.trajectory for drawn in draws], strict=True)
    exos = [WornDevice(description, m, t, tasks, at.duration) for m, t in pairs]
    exo, prefixes = exos[0], exos[0].device.prefixes
    batch = Batch(exos, seeds, name=one.controller)
    if bristly:
        batch.transmission = BristleChains(batch, [d.known for d in draws], seeds)
    fails = at.structure in (*faults.FAULTS, *faults.EVENTS)
    onsets = faults.fault_onsets(seeds, exo.period) if fails else []
    hindered = [drawn.actuation for drawn in draws]
    if at.structure in faults.PLANT_EVENTS:
        batch.actuate = faults.PlantEvent(at.structure, batch, onsets, exo.period)
    elif not (all(h.is_plain for h in hindered) or (reference and reference.ideal)):
        batch.actuate = ActuationFaults(hindered, prefixes)
    sensing, known = one.sensing or description.sensing, exo.drives
    name = reference.controller if reference else one.controller
    fitted: list[Drive] = []
    drives: Sequence[tuple[Drive, ...]]
    if isinstance(at, PositionCondition):
        if one.controller in WITH_SENSOR:
            sensing = dataclasses.replace(sensing, joint_sensor=True)
        plants = [(cell.condition, cell.seeds, cell.key) for cell in cells]
        if name in (None, conditions.SCALE_CONTROLLER):  # which have no parameters
            plants = []
        drive, fitted = position_drives(at, sensing.equip(known[0]), plants)
        drives = [(drive,)] * len(draws)
    else:
        if at.structure:
            known = DeviceModel.of(draws[0].known).drives(exo.period)
        equipped = [sensing.equip(drive) for drive in known]
        drives = believed_drives(equipped, exo.device.driven, draws, beliefs)
    law: Controller
    if name is None:
        law = Unpowered(drives[0][0], len(prefixes))
    elif fitted:
        made = (batched_controller(name, [(d,)], prefixes, Entry) for d in fitted)
        law = PlantsController(list(made))
    else:
        law = batched_controller(name, drives, prefixes, Entry)
    biases = []
    for n, drive in enumerate(drives[0]):
        count = 1 + sum(len(own.nodes) for own in drive.sensors)
        biases.append([drawn.bias[n][:count] for drawn in draws])
    delay = [drawn.plant.delay for drawn in draws]
    noise = [drawn.plant.noise for drawn in draws]
    whole = exo.controller_sensors(
        sensing, drives[0], seeds, biases, delay=delay, noise=noise
    )
    sensors: AxesMeasuring | faults.FaultySensors = whole
    if fails:
        ratios = {p: drive.ratio for p, drive in zip(prefixes, drives[0], strict=True)}
        sensors = faults.FaultySensors(at.structure, onsets, whole, ratios, exo.period)
    strength = dict.fromkeys(batch.cables, description.strength)
    facts = []
    for axis, driven in zip(description.axes, exo.device.driven, strict=True):
        # Where the safe torque is unknown, no torque is a failure.
        safe = {Key.SAFE_TORQUE: math.inf, **facts_of(axis, strength)}
        springy = isinstance(tasks[axis.name], Spring)
        facts.append({**safe, Key.DRIVEN: driven, Key.SPRING: springy})
    return CellSetup(draws, batch, drives, law, sensors, sensing.torque_noise, facts)


def play(cell: Cell) -> CellResult:
    return play_group([cell])[0]


def play_group(cells: Sequence[Cell]) -> list[CellResult]:
    """Simulate a group from `batch_groups`, each cell as if it were alone."""
    end_entries()
    try:
        made = prepare_episodes(cells)
        rows = _play(made, isinstance(cells[0].condition, PositionCondition))
    except CableError as error:
        raise CableError(f"{_places(cells)}: {error}") from error
    batch = made.batch
    time = np.arange(batch.steps + 1, dtype=float) * batch.exo.period
    cut = _cut_shares(made.law)
    count = len(cells[0].seeds)
    rows["time_s"] = np.repeat(time[:, None], count * len(cells), axis=1)
    reference = conditions.REFERENCES.get(cells[0].controller)
    if reference is not None and reference.ideal:
        _apply_ideal_torque(made, rows)
    if reference is not None and reference.changes == UNPLUGGED:
        rows["least_tension_n"][:] = 1.0  # no cable is there that could be slack
    found: list[CellResult] = []
    for place, cell in enumerate(cells):
        own = slice(place * count, (place + 1) * count)
        part = {name: values[:, own] for name, values in rows.items()}
        scores = _scores(cell, part, made)
        about = _plant_columns(made, own)
        about[FAILURE] = batch.failed[own]
        if text := trained_on(cell.controller):
            about[TRAINED_ON] = [text] * count
        if cut:
            about[CUT_SHARE] = cut[own]
        found.append(CellResult(scores, about))
    return found


def _places(cells: Sequence[Cell]) -> str:
    """Return words for conditions and seeds, as `wrist ordinary-rough, seeds 0, 1`."""
    names = list(dict.fromkeys(cell.condition.name for cell in cells))
    if len(names) > 3:
        names[2:] = [f"{len(names) - 2} others"]
    seeds = ", ".join(map(str, cells[0].seeds[:5]))
    more = ", ..." if len(cells[0].seeds) > 5 else ""
    which = "seeds" if len(cells[0].seeds) > 1 else "seed"
    return f"{cells[0].condition.label} {', '.join(names)}, {which} {seeds}{more}"


def _play(made: CellSetup, of_angle: bool) -> dict[str, NDArray[Any]]:
    """Play the episodes; return the columns that scores need (steps + 1, episodes)."""
    batch = made.batch
    names = ["joint_angle_rad", "joint_torque_nm", "desired_torque_nm"]
    names.append("motor_torque_nm")
    if of_angle:
        names.append(REFERENCE_COLUMN)
    kept = [prefix + name for prefix in batch.prefixes for name in names]
    kept += ["least_tension_n", "tension_n"]
    return {**batch.play(made.law, made.sensors.measure, kept)}


def _cut_shares(law: Controller) -> list[float]:
    """Return the share of torques that were cut, by plant; [] of a built-in law."""
    entries = law.laws if isinstance(law, PlantsController) else [law]
    return [
        float(count) / max(one.calls, 1)
        for one in entries
        if isinstance(one, Entry)
        for count in one.cut
    ]


def _apply_ideal_torque(made: CellSetup, rows: Mapping[str, NDArray[Any]]) -> None:
    for drive, prefix in zip(made.drives[0], made.batch.prefixes, strict=True):
        desired = rows[f"{prefix}desired_torque_nm"]
        for row, drawn in enumerate(made.draws):
            late = np.maximum(np.arange(len(desired)) - drawn.plant.delay, 0)
            given = np.clip(desired[late, row], *drive.reach)
            rows[f"{prefix}joint_torque_nm"][:, row] = given
            rows[f"{prefix}motor_torque_nm"][:, row] = given / drive.ratio


def _scores(
    cell: Cell, rows: Mapping[str, NDArray[Any]], made: CellSetup
) -> dict[str, Array]:
    """Return the scores of a cell by name, (seeds,), without the warm-up."""
    cables, prefixes = made.batch.cables, made.batch.prefixes
    of_angle = isinstance(cell.condition, PositionCondition)
    scores = ANGLE_SCORES if of_angle else SCORES
    if cell.condition.structure in faults.FAULTS:
        scores = SAFETY_SCORES
    first = round(conditions.WARM_UP / made.batch.exo.period)
    episodes: list[dict[str, float]] = []
    for row in range(len(cell.seeds)):
        columns = {name: values[first:, row] for name, values in rows.items()}
        ends, least = columns.pop("tension_n"), columns.pop("least_tension_n")
        for place, cable in enumerate(cables):
            columns[f"tension_{cable}_proximal_n"] = ends[:, 2 * place]
            columns[f"tension_{cable}_distal_n"] = ends[:, 2 * place + 1]
            columns[f"tension_{cable}_nodes_n"] = least[:, [place]]
        of_axes = []
        for prefix, own in zip(prefixes, made.facts, strict=True):
            log = ArrayLog(axis_columns(columns, prefix, prefixes), cables, own)
            of_axes.append(episode_scores(log, scores))
        found: dict[str, float] = {}
        for name in of_axes[0]:
            over = max if name == "failed" else np.mean
            found[name] = float(over([each[name] for each in of_axes]))
        if len(of_axes) > 1:
            for prefix, each in zip(prefixes, of_axes, strict=True):
                found |= {prefix + name: value for name, value in each.items()}
        episodes.append(found)
    return {name: np.array([e[name] for e in episodes]) for name in episodes[0]}


def episode_scores(log: LogLike, scores: Sequence[Metric] = SCORES) -> dict[str, float]:
    """Return the scores of an episode by name, NaN where a score is undefined.

    If the simulation diverged, all are NaN except `failed`.
    """
    whole = bool(np.all(np.isfinite(log["joint_torque_nm"])))
    measured = measure(log, (s for s in scores if whole or s.name == "failed"))
    return {s.name: measured.get(s, math.nan) for s in scores}


def _plant_columns(made: CellSetup, own: slice) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    names = list(chain.from_iterable(made.batch.exo.device.driven))
    for drawn, drives in zip(made.draws[own], made.drives[own], strict=True):
        plant = drawn.plant
        actual = [plant.cables[name] for name in names]
        known = [one.cable for drive in drives for one in drive.cables]
        columns: dict[str, Any] = {}
        for who, cables in (("plant", actual), ("believed", known)):
            for key in ("friction", "axial_stiffness", "pretension"):
                columns[f"{who}_{key}"] = [getattr(cable, key) for cable in cables]
        columns |= {
            "plant_wrap": [cable.wrap for cable in actual],
            "plant_delay": plant.delay,
            "plant_noise": plant.noise,
            "plant_bias": [bias[0] * made.torque_noise for bias in drawn.bias],
            "plant_wearer": [one.stiffness for one in plant.wearers.values()],
        }
        for name, value in columns.items():
            found.setdefault(name, []).append(value)
    return found


def ranked_score(names: Iterable[str]) -> str:
    """Return the score by which controllers are ranked: a peak, else an RMS error."""
    errors = "peak_over_safe", "rms_torque_error", "rms_angle_error"
    return next(error for error in errors if error in names)


def score_columns(names: Sequence[str]) -> list[str]:
    known = {score.name for score in EVERY_SCORE}
    return [name for name in names if name.rpartition(".")[2] in known]


def axis_errors(columns: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the ranked score of every axis (seeds, axes) from columns (seeds,)."""
    error = ranked_score(columns)
    of_axes = [n for n in columns if n.endswith(f".{error}")] or [error]
    return np.stack([np.asarray(columns[name]) for name in of_axes], axis=-1)
