"""A whole study in one call, and the run of a plan.

table = study("wrist", {"friction": "0.05:0.3:10", "loops": [1, 2, 3]})
table.sort_by("held_backlash").slice(0, 5).to_pandas()
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import pyarrow as pa

from cc_mujoco._utils.provenance import earlier_results_message
from cc_mujoco._workers import Progress
from cc_mujoco.control import CONTROLLERS
from cc_mujoco.control._controller import stepped_law
from cc_mujoco.design import _whatif_options as whatif
from cc_mujoco.design._evaluation import episodes
from cc_mujoco.design._plan import Plan, make_plan
from cc_mujoco.design._results_store import Store
from cc_mujoco.design._search import run_batches, search
from cc_mujoco.device import Plant
from cc_mujoco.simulation._rollout import attended, play


def study(
    scene: str | whatif.StudySpec,
    vary: whatif.Assignments = None,
    designs: str | Path | Sequence[Mapping[str, object]] | None = None,
    *,
    out: str | Path | None = None,
    progress: Progress = lambda done: None,
    **fields: Any,
) -> pa.Table:
    """Simulate many designs of a scene's transmission and measure each.

    Args:
        scene: name of the device, or a whole specification.
        vary: range or values of each variable, see `VARIABLES`: `"low:high:count"`,
            `"low:high:count:log"`, `"1,2,3"`, a number or a sequence of values.
        designs: instead of `vary`, the designs themselves, or a CSV or TOML file.
        out: folder that keeps what is finished, and the table; a study that was
            interrupted there goes on. Without one nothing is written.
        progress: called with the number of designs done.
        fields: other fields of `StudySpec` and `Execution`.

    Returns:
        A row per design: its number, its variables, its metrics (null where there is
        no such number) and `failed`, the reason where the simulation failed. Over cases
        a metric is the worst of its numbers; `METRIC@worst_case` says in which case,
        `METRIC@least` and `METRIC@most` are the ends. Of several controllers,
        `METRIC@CONTROLLER` has each.

    Raises:
        CableError: something about the study is impossible, or `out` holds what other
            code made; raised before it runs.
    """
    how = {field.name for field in dataclasses.fields(whatif.Execution)} & set(fields)
    execution = whatif.Execution(**{name: fields.pop(name) for name in how})
    spec = scene if isinstance(scene, whatif.StudySpec) else whatif.StudySpec(scene)
    chosen = {"vary": vary, "designs": designs}
    fields |= {name: value for name, value in chosen.items() if value is not None}
    plan = make_plan(dataclasses.replace(spec, **fields))
    folder = None if out is None else Path(out)
    if plan.search is not None:
        return search(plan, folder, execution, progress)[1]
    return carry_out(plan, folder, execution, progress)


def optimise(
    scene: str,
    vary: whatif.Assignments,
    objectives: Sequence[str],
    subject_to: Sequence[str] = (),
    *,
    evaluations: int = 400,
    **fields: Any,
) -> pa.Table:
    """Search for the designs that are best by one to four objectives, within limits.

    Args:
        scene: name of the device.
        vary: `"low:high"` or `"low:high:log"` for all that lies between; with a count,
            or a list of values, only these.
        objectives: `METRIC`, `min:METRIC` or `max:METRIC`.
        subject_to: limits, `METRIC>=NUMBER` or `METRIC<=NUMBER`.
        evaluations: designs that are tried; with more than an earlier run in `out`
            had, that is gone on with, with fewer than it finished its table stays.
        fields: other arguments of `study`; what is measured is by default only what
            objectives and limits need.

    Returns:
        A row per design in the order in which they were tried, as of `study`.
        `objective_costs` and `pareto_rows` find the best of them.

    Raises:
        CableError: something about the search is impossible, or Optuna is not
            installed; raised before it runs.
    """
    return study(
        scene,
        vary,
        objectives=objectives,
        subject_to=subject_to,
        evaluations=evaluations,
        **fields,
    )


def carry_out(
    plan: Plan,
    folder: Path | None = None,
    execution: whatif.Execution = whatif.HERE,
    progress: Progress = lambda done: None,
    say: Callable[[str], None] = lambda sentence: None,
) -> pa.Table:
    """Run the missing parts of a plan of designs and return its table; see `study`.

    `say` is called with a sentence where some of it is done already.
    """
    store = Store(plan, folder, execution.again)
    missing, before = store.missing(), store.kept
    if before:
        say(earlier_results_message(before, len(plan.designs), "designs"))

    def count(done: float) -> None:
        progress(before + done)

    count(0.0)
    run_batches(store, missing, execution, count)
    return store.table()


SAMPLE_TIME = 0.1
"""Simulated time of a sample [s]."""


def wait_sentences(plan: Plan, threads: int) -> Iterator[str]:
    """Yield that slow controllers are timed, then how long each takes if that is long.

    Of a search nothing is known in advance. 0 `threads` means one per processor.
    """
    known = {law: stepped_law(kind) for law, kind in CONTROLLERS.items()}
    slow = [  # policies and users' laws, too
        law
        for law in plan.protocol.controllers
        if (own := known.get(law)) is None or own.plans
    ]
    if not slow or not plan.designs:
        return
    yield f"timing {', '.join(slow)} for an estimate"
    (fast,) = whatif.DEFAULT_CONTROLLERS
    cases = len(plan.designs) * len(plan.protocol.across.cases)
    share = cases / (threads or os.cpu_count() or 1)
    usual = _seconds_per_design(plan, fast)
    for law in slow:
        each = _seconds_per_design(plan, law)
        if each * share > 20.0:  # [s]
            yield (
                f"{law} takes about {_rough(each * share)} for {len(plan.designs)} "
                f"designs; {fast} is {each / usual:.0f} times faster."
            )


def _seconds_per_design(plan: Plan, law: str) -> float:
    protocol = dataclasses.replace(plan.protocol, controllers=(law,))
    # A sample of at most eight, played together as the designs of the study are
    designs = [plan.designs[row] for row in plan.batches[0][:8]]
    values = [{**design, **protocol.across.cases[0]} for design in designs]
    models = [attended(Plant(protocol.device, own)) for own in values]
    played = [one for _, own, one in episodes(protocol) if own]
    if not played:
        return 0.0
    sample = dataclasses.replace(played[0], duration=SAMPLE_TIME)
    play(sample, models)  # compiles
    start = perf_counter()
    play(sample, models)
    spent = (perf_counter() - start) / (SAMPLE_TIME * len(models))
    return spent * sum(one.duration for one in played)


def _rough(seconds: float) -> str:
    for unit, size in (("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} seconds"
