"""A whole study in one call.

table = study("wrist", {"friction": "0.05:0.3:10", "loops": [1, 2, 3]})
table.sort_by("held_backlash").slice(0, 5).to_pandas()
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pyarrow as pa

from cc_mujoco.human import Trajectory
from cc_mujoco.identity import told
from cc_mujoco.metrics import Metric
from cc_mujoco.whatif.designs import Given
from cc_mujoco.whatif.evaluate import Trial
from cc_mujoco.whatif.plan import DEFAULT_CONTROLLERS, Plan, make_plan
from cc_mujoco.whatif.store import Store
from cc_mujoco.workers import WORKER_TIMEOUT, Progress, run_here, run_on_cluster


def study(
    scene: str,
    vary: Mapping[str, Given] | None = None,
    designs: str | Path | Sequence[Mapping[str, object]] | None = None,
    *,
    sampling: str = "grid",
    samples: int | None = None,
    trajectory: str | Path | Trajectory | None = None,
    task: str | None = None,
    controllers: Sequence[str] = DEFAULT_CONTROLLERS,
    duration: float = 10.0,
    seed: int = 0,
    timestep: float | None = None,
    metrics: Sequence[str | Metric] = (),
    across: Mapping[str, Given] | None = None,
    rank: str | None = None,
    costs: str | Path | None = None,
    threads: int = 0,
    scheduler: str | None = None,
    worker_timeout: float = WORKER_TIMEOUT,
    out: str | Path | None = None,
    again: bool = False,
    progress: Progress = lambda done: None,
) -> pa.Table:
    """Simulate many designs of a scene's transmission and measure each.

    Args:
        scene: `wrist` or `ankle`.
        vary: range or values of each variable, see `VARIABLES`: `"low:high:count"`,
            `"low:high:count:log"`, `"1,2,3"`, a number or a sequence of values.
        designs: instead of `vary`, the designs themselves, or a CSV or TOML file.
        sampling: `grid`, every combination; or `lhs`, a Latin hypercube.
        samples: designs of the Latin hypercube.
        trajectory: how the wearer moves, a name, the path of a CSV file or a
            `human.Trajectory`; that of the scene by default, as is the task.
        task: what the wearer should feel.
        controllers: that drive the motor; of several, the metrics of a design are
            those with the one that tracks best, and `METRIC@CONTROLLER` has each.
        duration: of the episode of each design [s].
        seed: of everything random, sampling included.
        timestep: of the physics, a divisor of 1 ms [s]; that of the scene by default.
        metrics: names of `METRICS`, or metrics of the user; by default all usual ones
            that the designs have.
        across: values of what differs from case to case, as in `vary`; `wearer`
            besides, the wearer's impedance times that of the scene. Every design is
            tried in all combinations, and a metric is the worst of its numbers there;
            `METRIC@worst_case` says in which, `METRIC@least` and `METRIC@most` are the
            ends. A design without a number in one of them has none, and one that fails
            in one of them fails.
        rank: what a metric is instead of the worst: `mean`, or `p90`, the 90th
            percentile, counted from the good end.
        costs: CSV file of what parts cost, see `costs.read_costs`; an example by
            default, by which `cost` is measured only where it is asked for.
        threads: that simulate; 0 means one per processor.
        scheduler: address of a Dask scheduler whose workers simulate instead.
        worker_timeout: time after which it gives up if there are no workers [s].
        out: folder that keeps what is finished, and the table; a study that was
            interrupted there goes on. Without one nothing is written.
        again: whether to simulate also what is finished there.
        progress: called with the number of designs done.

    Returns:
        A row per design: its number, its variables, its metrics (null where there is
        no such number) and `failed`, the reason where the simulation failed.

    Raises:
        CableError: something about the study is impossible, or `out` holds what other
            code made; raised before it runs.
    """
    plan = make_plan(
        scene,
        vary,
        designs,
        sampling=sampling,
        samples=samples,
        trajectory=trajectory,
        task=task,
        controllers=controllers,
        duration=duration,
        seed=seed,
        timestep=timestep,
        metrics=metrics,
        across=across,
        rank=rank,
        costs=costs,
    )
    folder = None if out is None else Path(out)
    return carry_out(
        plan,
        folder,
        threads,
        scheduler,
        progress,
        worker_timeout=worker_timeout,
        again=again,
    )


def carry_out(
    plan: Plan,
    folder: Path | None = None,
    threads: int = 0,
    scheduler: str | None = None,
    progress: Progress = lambda done: None,
    *,
    worker_timeout: float = WORKER_TIMEOUT,
    again: bool = False,
    say: Callable[[str], None] = lambda sentence: None,
) -> pa.Table:
    """Run what a plan still lacks and return its table; see `study`.

    `say` is called with a sentence where some of it is done already.
    """
    store = Store(plan, folder, again)
    missing, before = store.missing(), store.kept
    if before:
        say(told(before, len(plan.designs), "designs"))

    def count(done: float) -> None:
        progress(before + done)

    count(0.0)
    trial = Trial(plan.protocol)
    pieces = {n: [plan.designs[i] for i in plan.batches[n]] for n in missing}
    if scheduler is None:
        batches = run_here(trial, pieces, count, count=threads)
    else:
        batches = run_on_cluster(trial, pieces, scheduler, count, worker_timeout)
    # Closed at once if it is interrupted here, so that what is under way ends too.
    with contextlib.closing(batches):
        for number, results in batches if missing else ():
            store.keep(number, results)
    return store.table()
