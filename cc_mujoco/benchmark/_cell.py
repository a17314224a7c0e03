"""One cell of the benchmark: a controller, or a reference, in a condition; all seeds.

    ordinary = SUITES["v1"].conditions("wrist")[0]
    played = play(Cell(ordinary, "stiction", seeds=(0, 1, 2)))
    played.scores["rms_torque_error"]           # (seeds,) [N m]

A cell is one batch of simulations. What it gives, computing times excepted, depends on
nothing but the cell.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from cc_mujoco.benchmark import _user_entry as user_entry
from cc_mujoco.benchmark._conditions import MIN_DURATION, MODEL_ERRORS, Condition
from cc_mujoco.benchmark._plant import Belief, Draw, believed_drive, sample_plants
from cc_mujoco.benchmark._references import REFERENCES, Reference
from cc_mujoco.benchmark._scores import SCORES, episode_scores
from cc_mujoco.control import Controller
from cc_mujoco.device import Plant
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._registry import DEVICES
from cc_mujoco.device._sensors import Measuring, Sensing
from cc_mujoco.errors import CableError
from cc_mujoco.human import Spring
from cc_mujoco.metrics import ArrayLog
from cc_mujoco.metrics._metric import DRIVEN, PULL_PULL, SAFE_TORQUE, SPRING, STRENGTH
from cc_mujoco.simulation._batch import FRAME_SKIP, Fleet
from cc_mujoco.simulation._batched_controller import Unpowered
from cc_mujoco.simulation._loop import Trace, run
from cc_mujoco.simulation._worn_device import WornDevice

Array = NDArray[np.float64]

WARM_UP = 0.5 * MIN_DURATION
"""Beginning of an episode that no score counts [s]."""

TRACE_COLUMNS = ("joint_angle_rad", "joint_torque_nm", "desired_torque_nm")
PHASE_COLUMNS = ("phase_sine", "phase_cosine")
RECORDED_COLUMNS = (
    *TRACE_COLUMNS,
    *PHASE_COLUMNS,
    "motor_torque_nm",
    "least_tension_n",
    "tension_n",
)
TRACE_DECIMATION = 10
"""Control steps between two samples of a trace."""


@dataclass(frozen=True)
class Cell:
    """Episodes that are played together."""

    condition: Condition
    controller: str
    """Name of a controller or a reference."""
    seeds: tuple[int, ...] = (0,)
    belief: Belief | None = None
    """Belief; that of the condition by default."""
    sensing: Sensing | None = None
    """Sensing; that of the device by default."""

    def __post_init__(self) -> None:
        """Refuse what cannot be played."""
        if not self.seeds or min(self.seeds) < 0:
            raise CableError("a cell needs at least one seed, none below 0.")

    @property
    def name(self) -> str:
        """Name of the cell, fit for a file."""
        parts = (self.condition.scene, self.condition.name, self.controller)
        return "-".join(
            "".join(c if c.isalnum() else "_" for c in part) for part in parts
        )


@dataclass(frozen=True)
class CellResult:
    """Result of a cell.

    Attributes:
        scores: by name, (seeds,).
        plants: of every seed, what was drawn and what was believed of the cables that
            the motor winds, lists in the order of `Device.driven`.
        trace: where the condition is the ordinary one, columns (samples * seeds,).
    """

    scores: dict[str, Array]
    plants: dict[str, list[Any]]
    trace: dict[str, Array]


@dataclass
class CellSetup:
    """All that an episode of a cell needs."""

    draws: list[Draw]
    fleet: Fleet
    driven: tuple[str, ...]
    drive: Drive
    law: Controller
    sensors: Measuring
    period: float
    torque_noise: float
    """Standard deviation of the device's joint torque sensor [N m]."""


def batch_groups(cells: Iterable[Cell]) -> list[list[Cell]]:
    """Return the cells in groups that can be played as one batch, which costs far less.

    They have a controller, a task, a length and a device in common.
    """
    found: dict[object, list[Cell]] = {}
    for cell in cells:
        at = cell.condition
        about = at.scene, at.task, at.moving_route, at.duration
        key = cell.controller, cell.seeds, cell.sensing, *about
        found.setdefault(key, []).append(cell)
    return list(found.values())


def changed(plant: Plant, reference: Reference | None) -> Plant:
    """Return a plant as a reference changes its cables."""
    if reference is None:
        return plant
    changes = {
        f"{cable}.{key}": value
        for cable in plant.cables
        for key, value in reference.changes.items()
    }
    return Plant(plant.device, {**plant.values, **changes})


def prepare_episodes(cells: Sequence[Cell]) -> CellSetup:
    """Make all that the episodes of a group need, a row for each cell and seed.

    Raises:
        CableError: If a name is unknown or a controller cannot be used.
    """
    one = cells[0]
    at, reference, setup = one.condition, _reference(one), DEVICES[one.condition.scene]
    draws: list[Draw] = []
    beliefs: list[Belief] = []
    for cell in cells:
        draws += sample_plants(cell.condition, cell.seeds)
        own = cell.belief or Belief(MODEL_ERRORS[cell.condition.error])
        beliefs += [(reference and reference.belief) or own] * len(cell.seeds)
    exos = [
        WornDevice(
            setup,
            drawn.trajectory,
            at.task,
            at.duration,
            FRAME_SKIP,
            None,
            changed(drawn.plant, reference).model(),
        )
        for drawn in draws
    ]
    scripts = [
        exo.author.write(seeding.np_random(drawn.seed)[0])
        for exo, drawn in zip(exos, draws, strict=True)
    ]
    exo = exos[0]
    fleet = Fleet(exo, [e.device for e in exos], scripts)
    driven = exo.device.driven
    sensing = one.sensing or setup.sensing
    drive = believed_drive(sensing.equip(exo.drive), driven, draws, beliefs)
    name = reference.controller if reference else one.controller
    law = Unpowered(drive) if name is None else user_entry.make_controller(name, drive)
    read = 1 + sum(len(one.nodes) for one in drive.sensors)
    sensors = Measuring(
        sensing,
        drive,
        driven,
        [drawn.seed for drawn in draws],
        fleet.steps,
        delay=[drawn.plant.delay for drawn in draws],
        noise=[drawn.plant.noise for drawn in draws],
        bias=[drawn.bias[:read] for drawn in draws],
    )
    return CellSetup(
        draws,
        fleet,
        driven,
        drive,
        law,
        sensors,
        exo.period,
        sensing.torque_noise,
    )


def _reference(cell: Cell) -> Reference | None:
    return REFERENCES.get(cell.controller)


def play(cell: Cell) -> CellResult:
    """Play a cell by itself; see `play_group`."""
    return play_group([cell])[0]


def play_group(cells: Sequence[Cell]) -> list[CellResult]:
    """Play cells that `batch_groups` has put into one group.

    Returns:
        A result for each, the same as if it were played by itself.

    Raises:
        CableError: If a name is unknown or a controller cannot be used.
    """
    made = prepare_episodes(cells)
    fleet = made.fleet
    trace = Trace(RECORDED_COLUMNS, fleet.steps, fleet.going)
    with np.errstate(all="ignore"):  # what diverged is not a number
        run(
            fleet,
            made.law,
            trace.keep,
            measure=made.sensors.measure,
            name=cells[0].controller,
        )
    rows: dict[str, NDArray[Any]] = dict(trace.columns)
    time = np.arange(fleet.steps + 1, dtype=float) * made.period
    reference = _reference(cells[0])
    if reference is not None and reference.ideal:
        _apply_ideal_torque(made, rows)
    found: list[CellResult] = []
    for place, cell in enumerate(cells):
        count = len(cell.seeds)
        own = slice(place * count, (place + 1) * count)
        part = {name: values[:, own] for name, values in rows.items()}
        found.append(
            CellResult(
                _scores(cell, part, time, made),
                _plant_columns(made, own),
                _trace_columns(cell, part, time) if cell.condition.usual else {},
            )
        )
    return found


def _apply_ideal_torque(made: CellSetup, rows: Mapping[str, NDArray[Any]]) -> None:
    """Apply the desired torque to the joint, with delay and motor limits."""
    desired = rows["desired_torque_nm"]
    for row, drawn in enumerate(made.draws):
        late = np.maximum(np.arange(len(desired)) - drawn.plant.delay, 0)
        given = np.clip(desired[late, row], *made.drive.reach)
        rows["joint_torque_nm"][:, row] = given
        rows["motor_torque_nm"][:, row] = given / made.drive.ratio
    rows["least_tension_n"][:] = 1.0  # such a transmission is never slack


def _scores(
    cell: Cell, rows: Mapping[str, NDArray[Any]], time: Array, made: CellSetup
) -> dict[str, Array]:
    """Return the scores of every seed (seeds,), without the warm-up."""
    setup, cables = DEVICES[cell.condition.scene], made.fleet.cables
    about = {
        DRIVEN: made.driven,
        STRENGTH: dict.fromkeys(cables, setup.strength),
        SAFE_TORQUE: setup.safe_torque,
        PULL_PULL: setup.pull_pull,
        SPRING: isinstance(cell.condition.task, Spring),
    }
    first = round(WARM_UP / made.period)
    found: dict[str, list[float]] = {s.name: [] for s in SCORES}
    for row in range(len(cell.seeds)):
        columns = {name: values[first:, row] for name, values in rows.items()}
        columns["time_s"] = time[first:]
        ends, least = columns.pop("tension_n"), columns.pop("least_tension_n")
        for place, cable in enumerate(cables):
            columns[f"tension_{cable}_proximal_n"] = ends[:, 2 * place]
            columns[f"tension_{cable}_distal_n"] = ends[:, 2 * place + 1]
            columns[f"tension_{cable}_nodes_n"] = least[:, [place]]
        for name, value in episode_scores(ArrayLog(columns, cables, about)).items():
            found[name].append(value)
    return {name: np.array(values) for name, values in found.items()}


def _plant_columns(made: CellSetup, own: slice) -> dict[str, list[Any]]:
    """Return columns of the sampled and the believed parameters, for some rows."""
    found: dict[str, list[Any]] = {}
    believed_of = made.drive.cable_drives
    for drawn, row in zip(made.draws[own], believed_of[own], strict=True):
        plant = drawn.plant
        actual = [plant.cables[name] for name in made.driven]
        known = [cable_drive.cable for cable_drive in row]
        columns: dict[str, Any] = {
            f"{who}_{key}": [getattr(cable, key) for cable in cables]
            for who, cables in (("plant", actual), ("believed", known))
            for key in ("friction", "axial_stiffness", "pretension")
        }
        columns |= {
            "plant_wrap": [cable.wrap for cable in actual],
            "plant_delay": plant.delay,
            "plant_noise": plant.noise,
            "plant_bias": drawn.bias[0] * made.torque_noise,
            "plant_wearer": plant.wearer.stiffness,
        }
        for name, value in columns.items():
            found.setdefault(name, []).append(value)
    return found


def _trace_columns(
    cell: Cell, rows: Mapping[str, NDArray[Any]], time: Array
) -> dict[str, Array]:
    count = len(cell.seeds)
    thin = slice(None, None, TRACE_DECIMATION)
    phase = (
        np.arctan2(rows[PHASE_COLUMNS[0]], rows[PHASE_COLUMNS[1]])[thin]
        / (2.0 * np.pi)
        % 1.0
    )
    found = {name: rows[name][thin].ravel() for name in TRACE_COLUMNS}
    found["phase"] = phase.ravel()
    found["time_s"] = np.repeat(time[thin], count)
    found["seed"] = np.tile(np.array(cell.seeds, dtype=float), time[thin].size)
    return found
