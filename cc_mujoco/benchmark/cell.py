"""One cell of the benchmark: a controller, a trajectory, a task, and all seeds.

    played = play(Cell("wrist", "stiction", "sine", "spring", seeds=(0, 1, 2)))
    played.scores["rms_error"]                  # (seeds,) [Nm]

A cell is one batch of environments. What it gives depends on nothing but the cell.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import cc_mujoco  # noqa: F401, registers the environments
from cc_mujoco import engine
from cc_mujoco.benchmark.mismatch import Mismatch
from cc_mujoco.benchmark.scores import SCORES, score
from cc_mujoco.control import controller
from cc_mujoco.devices import DEVICES
from cc_mujoco.episode import Columns, Many, Trace, run
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.recording.episode import describe
from cc_mujoco.recording.log import EpisodeLog, Recorder
from cc_mujoco.sensing import Measuring, Sensing

Array = NDArray[np.float64]

WARM_UP = 0.5
"""Beginning of an episode that no score counts [s]."""

TRACE = ("time_s", "joint_angle_rad", "joint_torque_nm", "desired_torque_nm")
KEPT = (*TRACE, "motor_torque_nm")


@dataclass(frozen=True)
class Cell:
    """What is played together."""

    scene: str
    controller: str
    trajectory: str
    task: str
    seeds: tuple[int, ...] = (0,)
    duration: float = 6.0
    """Of an episode [s]."""
    mismatch: Mismatch = field(default_factory=Mismatch)
    sensing: Sensing | None = None
    """That of the scene by default."""

    def __post_init__(self) -> None:
        """Refuse what cannot be played."""
        look_up("scene", self.scene, DEVICES)
        if not self.seeds or min(self.seeds) < 0:
            raise CableError("a cell needs at least one seed, none below 0.")
        if not self.duration > 2.0 * WARM_UP:
            raise CableError(
                f"duration must be above {2.0 * WARM_UP:g} s, not {self.duration!r}."
            )

    @property
    def name(self) -> str:
        """Name of the cell, fit for a file."""
        parts = (self.scene, self.controller, self.trajectory, self.task)
        return "-".join(
            "".join(c if c.isalnum() else "_" for c in part) for part in parts
        )


@dataclass(frozen=True)
class CellResult:
    """What a cell gave.

    Attributes:
        scores: by name, (seeds,).
        trace: columns of `TRACE` of the first seed, (samples,).
        log: of the first seed, where it was asked for.
    """

    scores: dict[str, Array]
    trace: dict[str, Array]
    log: EpisodeLog | None


def play(cell: Cell, *, record: bool = False) -> CellResult:
    """Play a cell.

    Args:
        cell: What to play.
        record: Whether the first seed's episode is logged.

    Raises:
        CableError: If a name is unknown or a controller cannot be used.
    """
    count = len(cell.seeds)
    env: Any = gymnasium.make_vec(
        DEVICES[cell.scene].environment,
        num_envs=count,
        trajectory=cell.trajectory,
        task=cell.task,
        duration=cell.duration,
        threads=1,
    )
    try:
        return _play(cell, env.unwrapped, record)
    finally:
        env.close()


def _play(cell: Cell, env: Any, record: bool) -> CellResult:
    device, count = DEVICES[cell.scene], len(cell.seeds)
    sensing = cell.sensing or device.sensing
    drive = cell.mismatch.believed(sensing.equip(env.drive), cell.seeds)
    cables = engine.cables(env.model)
    law = controller(cell.controller, drive)
    plant = Many(env, cell.seeds)
    driven = env.exo.device.driven
    measuring = Measuring(sensing, drive, driven, cell.seeds, plant.steps)
    slack = [f"slack_{name}_m" for name in driven]
    trace = Trace((*KEPT, *slack), plant.steps, plant.going)
    recorder = None
    if record:
        about = describe(env, sensing, cell.seeds[0], _about(cell))
        recorder = Recorder(cables, about)

    def observe(step: int, columns: Columns, _: object) -> None:
        if recorder is not None and plant.going[0]:
            recorder.record({name: values[0] for name, values in columns.items()})

    measure, name = measuring.measure, cell.controller
    run(plant, law, trace.keep, observe, measure=measure, name=name)
    rows = trace.columns
    first = round(WARM_UP / env.exo.period)
    found: dict[str, list[float]] = {s.name: [] for s in SCORES}
    for row in range(count):
        columns = {name: rows[name][first:, row] for name in KEPT}
        columns["slack_m"] = np.stack([rows[n][first:, row] for n in slack], axis=1)
        scored = score(
            columns,
            task=cell.task,
            period=env.exo.period,
            pull_pull=device.pull_pull,
        )
        for name, value in scored.items():
            found[name].append(value)
    return CellResult(
        {name: np.array(values) for name, values in found.items()},
        {name: rows[name][::10, 0] for name in TRACE},
        None if recorder is None else recorder.log(),
    )


def _about(cell: Cell) -> dict[str, Any]:
    """What the log of a cell says of it."""
    return {
        "trajectory": cell.trajectory,
        "task": cell.task,
        "controller": cell.controller,
        "mismatch": dataclasses.asdict(cell.mismatch),
    }
