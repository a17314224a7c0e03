"""Running all cells: on several processes, keeping what is done.

Every finished cell has two files in `cells`; a later run of the same code and settings
passes over it. Cells share nothing, so the number of processes changes no bit.
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.util
import json
import multiprocessing
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import cc_mujoco
from cc_mujoco.benchmark.cell import Cell, Played, play
from cc_mujoco.benchmark.conditions import CONDITIONS
from cc_mujoco.benchmark.mismatch import Mismatch
from cc_mujoco.control import controller
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.files import replacing

KEY = b"cc_mujoco"
"""Of the metadata that say what a file was made by."""


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
        if not (self.scenes and self.controllers and self.seeds >= 1):
            raise CableError(
                "a benchmark needs at least one scene, one controller and one seed."
            )
        found: dict[str, Cell] = {}
        for scene in self.scenes:
            condition = look_up("scene", scene, CONDITIONS)
            trajectories = self.trajectories or condition.trajectories
            tasks = self.tasks or condition.tasks
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
            condition = look_up("scene", scene, CONDITIONS)
            for trajectory, task in product(
                self.trajectories or condition.trajectories,
                self.tasks or condition.tasks,
            ):
                env: Any = gymnasium.make(
                    condition.environment,
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
                controller(law, condition.sensing.equip(drive))
        return tuple(f"{name}: {beyond}" for name, beyond in warnings.items())


def run(
    plan: Plan,
    out: str | os.PathLike[str],
    *,
    workers: int = 1,
    again: bool = False,
    finished: Callable[[Cell, bool], None] = lambda cell, fresh: None,
) -> list[tuple[Cell, Played]]:
    """Run every cell that is not done and return all, in the order of the plan.

    Args:
        plan: What to run.
        out: Folder; cells lie in `cells` inside.
        workers: Processes.
        again: Run also what is done.
        finished: Called with every cell as it comes, and whether it was run just now.

    Raises:
        CableError: If a name is unknown or a controller cannot be used.
    """
    folder = Path(out) / "cells"
    folder.mkdir(parents=True, exist_ok=True)
    cells = plan.cells()
    left = []
    for cell in cells:
        if not again and _read(folder, cell) is not None:
            finished(cell, False)
        else:
            left.append(cell)
    if workers == 1 or len(left) <= 1:
        for cell in left:
            _write(folder, cell, play(cell))
            finished(cell, True)
    else:
        # A fresh interpreter each: threads of the parent would not survive a fork.
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(min(workers, len(left)), context) as pool:
            try:
                going = {pool.submit(play, cell): cell for cell in left}
                for done in as_completed(going):
                    _write(folder, going[done], done.result())
                    finished(going[done], True)
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    played = []
    for cell in cells:
        result = _read(folder, cell)
        if result is None:
            raise CableError(
                f"{folder}: {cell.name} was played and then changed by another run; "
                "runs of their own need folders of their own."
            )
        played.append((cell, result))
    return played


def write_scores(
    path: str | os.PathLike[str], played: Sequence[tuple[Cell, Played]]
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


def _write(folder: Path, cell: Cell, played: Played) -> None:
    about = {KEY: _fingerprint(cell).encode()}
    for stem, columns in (("trace", played.trace), ("scores", played.scores)):
        table = pa.table(columns).replace_schema_metadata(about)
        with replacing(folder / f"{cell.name}.{stem}.parquet") as partial:
            pq.write_table(table, partial)


def _read(folder: Path, cell: Cell) -> Played | None:
    """A finished cell of the same code and settings, or None."""
    found = []
    for stem in ("scores", "trace"):
        try:
            table = pq.read_table(folder / f"{cell.name}.{stem}.parquet")
        except (OSError, pa.ArrowInvalid):
            return None
        if (table.schema.metadata or {}).get(KEY) != _fingerprint(cell).encode():
            return None
        found.append({name: table[name].to_numpy() for name in table.column_names})
    return Played(found[0], found[1], None)


def _fingerprint(cell: Cell) -> str:
    """Digest of a cell, of the package and of a controller from outside."""
    text = json.dumps(dataclasses.asdict(cell), sort_keys=True)
    digest = hashlib.sha256(text.encode())
    digest.update(_code().encode())
    name = cell.controller
    if name.endswith(".zip") and os.path.isfile(name):
        digest.update(Path(name).read_bytes())
    elif ":" in name:
        source = _source(name.partition(":")[0])
        if source is not None:
            digest.update(source.read_bytes())
    return digest.hexdigest()[:24]


def _source(module: str) -> Path | None:
    here = os.getcwd()
    sys.path.insert(0, here)
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        return None
    finally:
        sys.path.remove(here)
    return Path(spec.origin) if spec and spec.origin else None


@cache
def _code() -> str:
    """Digest of all that decides a cell: the package, its environments and scenes."""
    from cc_mujoco import assets, envs

    digest = hashlib.sha256()
    for module, pattern in ((cc_mujoco, "*.py"), (envs, "*.py"), (assets, "*.xml")):
        root = Path(str(module.__file__)).parent
        for source in sorted(root.rglob(pattern)):
            digest.update(source.relative_to(root).as_posix().encode())
            digest.update(source.read_bytes())
    digest.update(np.__version__.encode())
    return digest.hexdigest()
