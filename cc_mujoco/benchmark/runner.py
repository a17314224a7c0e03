"""Running all cells: on several processes, keeping what is done.

Every finished cell has two files in `cells`; a later run of the same code and settings
passes over it. Cells share nothing, so the number of processes changes no bit.
"""

from __future__ import annotations

import dataclasses
import json
import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import gymnasium
import pyarrow as pa
import pyarrow.parquet as pq

from cc_mujoco.benchmark.cell import Cell, CellResult, play
from cc_mujoco.benchmark.mismatch import Mismatch
from cc_mujoco.control import controller
from cc_mujoco.devices import DEVICES
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.files import is_marked, replacing
from cc_mujoco.files import require_ours as require_ours_in
from cc_mujoco.identity import differences, made_by, seal, sealed, told

MAX_SEEDS = 10_000
"""Of more, not even the names of the results are quickly listed."""

CELLS, SCORES, TABLE = "cells", "scores.parquet", "table.md"
PARTS = ("scores", "trace")
"""Of a cell: its files."""
FIGURES = ("errors", "loops", "pareto")
"""Of a scene."""


@dataclass(frozen=True)
class Plan:
    """What to run; empty is what the scene has by default."""

    scenes: tuple[str, ...]
    controllers: tuple[str, ...]
    trajectories: tuple[str, ...] = ()
    tasks: tuple[str, ...] = ()
    seeds: int = 5
    duration: float = 6.0
    """Of an episode [s]."""
    mismatch: Mismatch = dataclasses.field(default_factory=Mismatch)

    def cells(self) -> list[Cell]:
        """All cells, in the order of tables.

        Raises:
            CableError: If there are none, a scene is unknown, or the files of two would
                have the same name.
        """
        if self.seeds > MAX_SEEDS:
            raise CableError(
                f"a benchmark has at most {MAX_SEEDS:,} seeds, not {self.seeds:,}."
            )
        if not (self.scenes and self.controllers and self.seeds >= 1):
            raise CableError(
                "a benchmark needs at least one scene, one controller and one seed."
            )
        found: dict[str, Cell] = {}
        for scene in self.scenes:
            device = look_up("scene", scene, DEVICES)
            trajectories = self.trajectories or device.trajectories
            tasks = self.tasks or device.tasks
            for trajectory, task, law in product(trajectories, tasks, self.controllers):
                seeds = tuple(range(self.seeds))
                cell = Cell(
                    scene, law, trajectory, task, seeds, self.duration, self.mismatch
                )
                # What is named twice is played once.
                other = found.setdefault(cell.name, cell)
                if other != cell:
                    raise CableError(
                        f"controllers {other.controller!r} and {law!r} would have the "
                        f"same files, {cell.name}; rename one."
                    )
        return list(found.values())

    def check(self) -> tuple[str, ...]:
        """Find out, before long work, whether every name can be used.

        Returns:
            A sentence for each scene and task that asks for more than the motor gives.

        Raises:
            CableError: If a name cannot be used.
        """
        warnings: dict[str, str] = {}
        for scene in self.scenes:
            device = look_up("scene", scene, DEVICES)
            for trajectory, task in product(
                self.trajectories or device.trajectories,
                self.tasks or device.tasks,
            ):
                env: Any = gymnasium.make(
                    device.environment,
                    disable_env_checker=True,
                    trajectory=trajectory,
                    task=task,
                    duration=self.duration,
                )
                env.reset(seed=0)
                drive = env.unwrapped.drive
                if beyond := env.unwrapped.beyond():
                    warnings[f"{scene}, {task}"] = beyond
                env.close()
            for law in self.controllers:
                controller(law, drive)
        return tuple(f"{name}: {beyond}" for name, beyond in warnings.items())


def require_ours(plan: Plan, out: str | os.PathLike[str]) -> None:
    """Find out, before long work, whether a plan's results may be written to a folder.

    Raises:
        CableError: If not; see `files.require_ours`.
    """
    cells = [f"{cell.name}.{part}.parquet" for cell in plan.cells() for part in PARTS]
    require_ours_in(
        out,
        (
            TABLE,
            SCORES,
            *(f"{scene}-{stem}.png" for scene in plan.scenes for stem in FIGURES),
            *(f"{CELLS}/{name}" for name in cells),
        ),
        lambda place: any(map(is_marked, (place / CELLS).glob("*.parquet"))),
    )


def run(
    plan: Plan,
    out: str | os.PathLike[str],
    *,
    workers: int = 1,
    again: bool = False,
    finished: Callable[[Cell, bool], None] = lambda cell, fresh: None,
    say: Callable[[str], None] = lambda sentence: None,
) -> list[tuple[Cell, CellResult]]:
    """Run every cell that is not done and return all, in the order of the plan.

    Args:
        plan: What to run.
        out: Folder; cells lie in `cells` inside.
        workers: Processes.
        again: Run also what is done.
        finished: Called with every cell as it comes, and whether it was run just now.
        say: Called with a sentence on what an earlier run left, if it left something.

    Raises:
        CableError: If a name is unknown, a controller cannot be used or the folder
            cannot be written or holds files that are not a benchmark's.
    """
    require_ours(plan, out)
    plan.check()
    folder = Path(out) / CELLS
    folder.mkdir(parents=True, exist_ok=True)
    cells = plan.cells()
    left: list[Cell] = []
    changed: list[str] = []
    for cell in cells:
        there, other = _read(folder, cell)
        changed += other
        if again or there is None:
            left.append(cell)
    kept = [cell for cell in cells if cell not in left]
    if kept or changed:
        say(told(len(kept), len(cells), "cells", changed))
    for cell in kept:
        finished(cell, False)
    if workers == 1 or len(left) <= 1:
        for cell in left:
            _write(folder, cell, *_work(cell))
            finished(cell, True)
    else:
        # A fresh interpreter each: threads of the parent would not survive a fork.
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(min(workers, len(left)), context) as pool:
            try:
                going = {pool.submit(_work, cell): cell for cell in left}
                for done in as_completed(going):
                    _write(folder, going[done], *done.result())
                    finished(going[done], True)
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    played = []
    for cell in cells:
        result, other = _read(folder, cell)
        if result is None:
            why = ", ".join(other) or "the file"
            raise CableError(
                f"{folder}: {cell.name} was played and then differed in {why}; leave "
                "code and folder alone while a benchmark runs, and run it again."
            )
        played.append((cell, result))
    return played


def write_scores(
    path: str | os.PathLike[str], played: Sequence[tuple[Cell, CellResult]]
) -> None:
    """Write the scores of all episodes as Parquet, a row each."""
    columns: dict[str, list[Any]] = {}
    for cell, result in played:
        about = {
            name: getattr(cell, name)
            for name in ("scene", "controller", "trajectory", "task")
        }
        for place, seed in enumerate(cell.seeds):
            row = about | {"seed": seed}
            row |= {name: float(v[place]) for name, v in result.scores.items()}
            for name, value in row.items():
                columns.setdefault(name, []).append(value)
    with replacing(path) as partial:
        pq.write_table(pa.table(columns), partial)


def _work(cell: Cell) -> tuple[CellResult, dict[str, Any]]:
    """Play a cell; also what made it, in the process that did."""
    played = play(cell)
    return played, _about(cell)


def _about(cell: Cell) -> dict[str, Any]:
    """What decides a cell, whose controller was made before."""
    makers = made_by(cell.controller, cell.trajectory)
    return {"cell": json.loads(json.dumps(dataclasses.asdict(cell))), "made_by": makers}


def _write(folder: Path, cell: Cell, played: CellResult, about: dict[str, Any]) -> None:
    for stem, columns in (("trace", played.trace), ("scores", played.scores)):
        table = sealed(pa.table(columns), about)
        with replacing(folder / f"{cell.name}.{stem}.parquet") as partial:
            pq.write_table(table, partial)


def _read(folder: Path, cell: Cell) -> tuple[CellResult | None, list[str]]:
    """A finished cell; None, and how it differs, if it is not of this code."""
    found: list[dict[str, Any]] = []
    now = _about(cell)
    for stem in PARTS:
        try:
            table = pq.read_table(folder / f"{cell.name}.{stem}.parquet")
        except (OSError, pa.ArrowInvalid):
            return None, []
        then = seal(table)
        if then != now:
            then = then if isinstance(then, dict) else {}
            if then.get("cell", now["cell"]) != now["cell"]:
                return None, ["their settings"]
            return None, differences(then.get("made_by"), now["made_by"])
        found.append({name: table[name].to_numpy() for name in table.column_names})
    return CellResult(found[0], found[1], None), []
