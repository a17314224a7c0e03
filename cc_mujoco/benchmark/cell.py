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
from cc_mujoco.control.external import blamed
from cc_mujoco.devices import DEVICES
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.recording.columns import RATIO
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
class Played:
    """What a cell gave.

    Attributes:
        scores: by name, (seeds,).
        trace: columns of `TRACE` of the first seed, (samples,).
        log: of the first seed, where it was asked for.
    """

    scores: dict[str, Array]
    trace: dict[str, Array]
    log: EpisodeLog | None


def play(cell: Cell, *, record: bool = False) -> Played:
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


def _play(cell: Cell, env: Any, record: bool) -> Played:
    device, count = DEVICES[cell.scene], len(cell.seeds)
    sensing = cell.sensing or device.sensing
    drive = cell.mismatch.believed(sensing.equip(env.drive), cell.seeds)
    cables = engine.cables(env.model)
    steps = env.exo.steps
    law = controller(cell.controller, drive)
    measuring = Measuring(sensing, drive, cables, cell.seeds, steps)
    recorder = Recorder(cables, _about(cell, env)) if record else None
    rows = np.full((steps + 1, len(KEPT), count), np.nan)
    slack = np.zeros((steps + 1, count, len(cables)))
    going = np.ones(count, dtype=np.bool_)
    with blamed(cell.controller):
        law.reset()
    _, info = env.reset(seed=list(cell.seeds))
    for step in range(steps + 1):
        for place, name in enumerate(KEPT):
            rows[step, place, going] = info[name][going]
        for place, name in enumerate(cables):
            slack[step, :, place] = info[f"slack_{name}_m"]
        if recorder is not None and going[0]:
            recorder.record({name: values[0] for name, values in info.items()})
        if step == steps:
            break
        seen = measuring.measure(info)
        with blamed(cell.controller):
            torque = _one_each(law.torque(seen), cell)
        usable = np.where(np.isfinite(torque), torque, 0.0)
        _, _, diverged, _, info = env.step(env.action(usable))
        # A controller that gives no number has failed, as one that diverges.
        going &= ~diverged & np.isfinite(torque)
    first = round(WARM_UP / env.exo.period)
    found: dict[str, list[float]] = {s.name: [] for s in SCORES}
    for row in range(count):
        columns = dict(zip(KEPT, rows[first:, :, row].T, strict=True))
        columns["slack_m"] = slack[first:, row]
        scored = score(
            columns,
            task=cell.task,
            period=env.exo.period,
            pull_pull=device.pull_pull,
        )
        for name, value in scored.items():
            found[name].append(value)
    trace = {name: rows[::10, place, 0] for place, name in enumerate(TRACE)}
    return Played(
        {name: np.array(values) for name, values in found.items()},
        trace,
        None if recorder is None else recorder.log(),
    )


def _one_each(torque: Any, cell: Cell) -> Array:
    """A torque for every seed, from one for each or one for all."""
    given = np.asarray(torque, dtype=float)
    if given.shape not in ((), (len(cell.seeds),)):
        raise CableError(
            f"controller {cell.controller!r} gave torques of shape {given.shape}; it "
            f"must be one number, or one for each of {len(cell.seeds)} environments."
        )
    return np.broadcast_to(given, len(cell.seeds))


def _about(cell: Cell, env: Any) -> dict[str, Any]:
    """Metadata of a log."""
    return {
        "scene": cell.scene,
        "trajectory": cell.trajectory,
        "task": cell.task,
        "controller": cell.controller,
        "seed": cell.seeds[0],
        "duration": cell.duration,
        "mismatch": dataclasses.asdict(cell.mismatch),
        RATIO: 1.0 / env.drive.ratio,
    }
