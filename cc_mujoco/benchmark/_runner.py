"""Run of all cells, on several processes or a cluster; finished cells are kept.

Every finished cell has its files in `cells`; a later run of the same code and settings
skips it. Cells are independent, so results do not depend on where they run.
"""

import contextlib
import hashlib
import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from cc_mujoco._utils import atomic_io
from cc_mujoco._utils.atomic_io import is_marked, replacing
from cc_mujoco._utils.provenance import (
    earlier_results_message,
    file_digests,
    provenance_differences,
    read_provenance,
    with_provenance,
)
from cc_mujoco._workers.cluster import WORKER_TIMEOUT, run_on_cluster
from cc_mujoco._workers.local_executor import Tick, run_here
from cc_mujoco.benchmark._cell import (
    Cell,
    CellResult,
    batch_groups,
    play_group,
    prepare_episodes,
    score_columns,
)
from cc_mujoco.benchmark._conditions import REFERENCES, SCALE_CONTROLLER, Condition
from cc_mujoco.benchmark._plant import require_key
from cc_mujoco.benchmark._position import WITH_SENSOR
from cc_mujoco.benchmark._suites import SUITES, Suite
from cc_mujoco.benchmark._user_entry import Entry, controller_provenance
from cc_mujoco.control._registry import batched_controller
from cc_mujoco.device import find_device
from cc_mujoco.device._description import device_label
from cc_mujoco.errors import CableError, look_up

CELLS_FOLDER, RESULTS_FILE = "cells", "results.parquet"
REPORT_FILE = "report.html"  # which a user may have changed


@dataclass(frozen=True)
class BenchmarkPlan:
    """Selection of cells to run; an empty selection means all of the suite.

    As a `local_executor.Job` its pieces are groups of cells.
    """

    controllers: tuple[str, ...]
    suite: str = "v1"
    scenes: tuple[str, ...] = ()
    conditions: tuple[str, ...] = ()  # by name, of the devices that have them
    seeds: int | None = None  # their number; that of the suite by default
    first_seed: int = 0  # the others follow; a judge may choose it afterwards
    duration: float | None = None  # of an episode [s]; the conditions' by default
    key: str = field(default="", repr=False)
    """Secret of the run, see `_plant.new_key`; "" where seeds alone give the plants."""

    @property
    def _suite(self) -> Suite:
        return look_up("suite", self.suite, SUITES)

    def players(self) -> tuple[str, ...]:
        """Return the references, `none` and the controllers, without repeats."""
        names = *self._suite.references, SCALE_CONTROLLER, *self.controllers
        return tuple(dict.fromkeys(names))

    def played(self) -> list[Condition]:
        """Return all selected conditions."""
        scenes = tuple(dict.fromkeys(self.scenes or self._suite.scenes))
        labels: dict[str, str] = {}
        for scene in scenes:
            other = labels.setdefault(device_label(scene), scene)
            if other != scene:
                raise CableError(
                    f"devices {other!r} and {scene!r} would have the same name, "
                    f"{device_label(scene)!r}, in tables and files; rename one."
                )
        found = [one for scene in scenes for one in self._suite.conditions(scene)]
        names = {condition.name: None for condition in found}
        for name in self.conditions:
            look_up("condition", name, names)
        if self.conditions:
            found = [c for c in found if c.name in self.conditions]
        if self.duration is not None:
            found = [replace(c, duration=self.duration) for c in found]
        return found

    def made_by(self) -> dict[str, Any]:
        return provenance(self.controllers, [at.scene for at in self.played()])

    def cells(self) -> list[Cell]:
        """Return all cells, in the order of tables; their file names must differ."""
        if not self.controllers:
            raise CableError("a benchmark needs at least one controller.")
        for name in self.controllers:
            if name in REFERENCES:
                raise CableError(
                    f"{name!r} is a reference, which every table has; it is no "
                    "controller."
                )
        count = self._suite.seeds if self.seeds is None else self.seeds
        if not 1 <= count <= 1000:  # more results are not listed quickly
            raise CableError(f"a benchmark has 1 to 1,000 seeds, not {count:,}.")
        most = 2**31
        if not 0 <= self.first_seed <= most:
            raise CableError(
                f"the first seed must be 0 to {most:,}, not {self.first_seed:,}."
            )
        require_key(self.key)
        seeds = tuple(range(self.first_seed, self.first_seed + count))
        found: dict[str, Cell] = {}
        for condition in self.played():
            for name in self.players():
                cell = Cell(condition, name, seeds, key=self.key)
                # Names that are given twice are played once.
                other = found.setdefault(cell.name, cell)
                if other != cell:
                    raise CableError(
                        f"controllers {other.controller!r} and {name!r} would have the "
                        f"same files, {cell.name}; rename one."
                    )
        return list(found.values())

    def rehearse(self) -> None:
        """Build every condition and controller once, so that errors show early."""
        shortest = {c.scene: replace(c, duration=1.1) for c in self.played()}
        self.cells()
        for condition in shortest.values():
            made = prepare_episodes([Cell(condition, SCALE_CONTROLLER)])
            for name in self.controllers:
                has = name in WITH_SENSOR
                drives = [
                    tuple(replace(d, joint_sensor=d.joint_sensor or has) for d in own)
                    for own in made.drives
                ]
                batched_controller(name, drives, made.batch.prefixes, Entry)

    def size(self, piece: Sequence[Cell]) -> int:
        return len(piece)

    def do(self, piece: Sequence[Cell], tick: Tick) -> list[pa.Table]:
        results = play_group(piece)
        found = []
        for cell, result in zip(piece, results, strict=True):
            entry = cell.controller not in REFERENCES and cell.condition.usual
            times = time_steps(cell) if entry else (None, None)
            found.append(_table(cell, result, *times))
        return found


def provenance(controllers: Iterable[str], scenes: Iterable[str]) -> dict[str, Any]:
    """Return the provenance of controllers and scenes: code, versions, user's files."""
    found = controller_provenance(*controllers)
    for scene in dict.fromkeys(scenes):
        found["files"] |= file_digests(find_device(scene).files, Path(scene).parent)
    return found


def require_ours(out: str | os.PathLike[str]) -> None:
    cells = Path(out, CELLS_FOLDER)
    atomic_io.require_ours(out, lambda _: any(map(is_marked, cells.glob("*.parquet"))))
    atomic_io.require_unmodified(out, [REPORT_FILE])


def run(
    plan: BenchmarkPlan,
    out: str | os.PathLike[str],
    *,
    workers: int = 1,
    scheduler: str | None = None,
    worker_timeout: float = WORKER_TIMEOUT,
    again: bool = False,
    progress: Callable[[float], None] = lambda done: None,
    say: Callable[[str], None] = lambda sentence: None,
) -> list[tuple[Cell, CellResult]]:
    """Run every cell that is not finished; return all, in the order of the plan.

    Args:
        plan: Selection of cells.
        out: Folder; cells lie in `cells` inside.
        workers: Processes; 0 means one per processor.
        scheduler: Address of a Dask scheduler whose workers run the cells instead.
        worker_timeout: Time without any worker after which to give up [s].
        again: Run finished cells again.
        progress: Called with the number of finished cells.
        say: Called with a sentence about results of an earlier run, if there are any.
    """
    require_ours(out)
    plan.rehearse()
    folder = Path(out) / CELLS_FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    cells = plan.cells()
    left: list[Cell] = []
    changed: list[str] = []
    for cell in cells:
        there, other = _read(folder, cell)
        changed += other
        if again or there is None:
            left.append(cell)
    kept = len(cells) - len(left)
    if kept or changed:
        say(earlier_results_message(kept, len(cells), "cells", changed))
    progress(float(kept))
    pieces = dict(enumerate(batch_groups(left)))

    def count(done: float) -> None:
        progress(kept + done)

    if scheduler is None:
        playing = run_here(plan, pieces, count, count=workers, processes=True)
    else:
        playing = run_on_cluster(plan, pieces, scheduler, count, worker_timeout)
    with contextlib.closing(playing):
        finished: Iterable[tuple[int, Any]] = playing if pieces else ()
        if plan.key:  # an entry could read plants and errors of its own plants
            finished = list(finished)
        for number, found in finished:
            for cell, table in zip(pieces[number], found, strict=True):
                with replacing(_file(folder, cell)) as partial:
                    pq.write_table(table, partial)
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


def _file(folder: Path, cell: Cell) -> Path:
    return folder / f"{cell.name}.scores.parquet"


def _cell_key(cell: Cell) -> dict[str, Any]:
    at = cell.condition
    text = repr(cell).replace(repr(at), at.text, 1)
    if cell.key:
        # An entry may read the files of finished cells while others are played.
        text += hashlib.sha256(cell.key.encode()).hexdigest()
    return {"cell": text, "made_by": provenance([cell.controller], [at.scene])}


def _table(
    cell: Cell, result: CellResult, median: float | None, worst: float | None
) -> pa.Table:
    columns = {**result.scores, **result.plants}
    columns |= {"step_median_s": [median] * len(cell.seeds)}
    columns |= {"step_worst_s": [worst] * len(cell.seeds)}
    return with_provenance(pa.table(columns), _cell_key(cell))


def _read(folder: Path, cell: Cell) -> tuple[CellResult | None, list[str]]:
    """Return a finished cell, or None and differences of its code from the present."""
    now = _cell_key(cell)
    try:
        table = pq.read_table(_file(folder, cell))
    except (OSError, pa.ArrowInvalid):
        return None, []
    then = read_provenance(table)
    if then != now:
        then = then if isinstance(then, dict) else {}
        if then.get("cell", now["cell"]) != now["cell"]:
            return None, ["their settings"]
        return None, provenance_differences(then.get("made_by"), now["made_by"])
    names = score_columns(table.column_names)
    scores = {name: table[name].to_numpy() for name in names}
    return CellResult(scores, table.drop_columns(names).to_pydict()), []


def time_steps(cell: Cell) -> tuple[float, float]:
    """Return the median and the worst processor time of a controller's step [s]."""
    # 1.1 s are timed, after compilation.
    short = replace(cell.condition, duration=1.1)
    made = prepare_episodes([replace(cell, condition=short, seeds=cell.seeds[:1])])
    law = batched_controller(cell.controller, made.drives, made.batch.prefixes, Entry)
    law.reset()
    taken: list[float] = []

    def timed(seen: Mapping[str, Any]) -> Mapping[str, Any]:
        one = {n: v[0] if v.ndim > 1 else float(v[0]) for n, v in seen.items()}
        begun = time.thread_time()
        law.torque(one)
        spent = time.thread_time() - begun
        taken.append(law.spent if isinstance(law, Entry) else spent)
        return seen

    made.batch.play(made.law, lambda columns: timed(made.sensors.measure(columns)), ())
    # The first calls fill caches.
    counted = np.array(taken[round(len(taken) / 3) :])
    return float(np.median(counted)), float(np.max(counted))
