"""A search for the best designs instead of trying them all.

    plan, table = optimise("wrist", {"friction": "0.05:0.2", "loops": [1, 2, 3]},
                           ["reflected_torque"], ["slack_margin>=2"], evaluations=200)

Designs are asked for in generations of a size that does not depend on the machine, and
simulated as a study's are; so the same seed gives the same designs on any number of
threads, and an interrupted search goes on by asking for them again. The sampler is
Optuna's multi-objective tree-structured Parzen estimator (Y. Ozaki et al.,
"Multiobjective tree-structured Parzen estimator", Journal of Artificial Intelligence
Research 73, 2022).
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from cc_mujoco.checks import named
from cc_mujoco.errors import CableError
from cc_mujoco.human import Trajectory
from cc_mujoco.identity import told
from cc_mujoco.metrics import Metric
from cc_mujoco.whatif import gait
from cc_mujoco.whatif.across import plant
from cc_mujoco.whatif.build import Builder
from cc_mujoco.whatif.designs import Given, Range, read_range, require_count
from cc_mujoco.whatif.evaluate import Design, Result, Trial
from cc_mujoco.whatif.metrics import numbers
from cc_mujoco.whatif.pareto import (
    Limit,
    Objective,
    read_limits,
    read_objectives,
)
from cc_mujoco.whatif.plan import (
    DEFAULT_CONTROLLERS,
    Plan,
    batches_of,
    empty_plan,
    metrics_of,
)
from cc_mujoco.whatif.store import Store
from cc_mujoco.workers import WORKER_TIMEOUT, Progress, run_here, run_on_cluster

GENERATION = 32
"""Designs that are asked for together."""
PIECE = 8
"""Designs of a generation that are simulated together."""
MOST_OBJECTIVES = 4
AGAIN = 20
"""Most times in a row that the sampler may ask for what was tried before."""
_IMPOSSIBLE = 1e6
"""Excess over its limits of a design that gives no numbers."""


def optimise(
    scene: str,
    vary: Mapping[str, Given],
    objectives: Sequence[str],
    subject_to: Sequence[str] = (),
    *,
    evaluations: int = 400,
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
    """Search for the designs that are best by one to four objectives, within limits.

    Args:
        scene: name of the device.
        vary: `"low:high"` or `"low:high:log"` for all that lies between; with a count,
            or a list of values, only these.
        objectives: `METRIC`, `min:METRIC` or `max:METRIC`.
        subject_to: limits, `METRIC>=NUMBER` or `METRIC<=NUMBER`.
        evaluations: designs that are tried; with more than an earlier run in `out`
            had, that is gone on with, with fewer than it finished its table stays.
        trajectory: as in `study`, as are all others; what is measured is by default
            only what objectives and limits ask for.
        task: see `study`.
        controllers: see `study`.
        duration: see `study` [s].
        seed: see `study`; also of the sampler.
        timestep: see `study` [s].
        metrics: measured besides.
        across: see `study`; limits hold in every case, whatever the rank.
        rank: see `study`.
        costs: see `study`.
        threads: see `study`.
        scheduler: see `study`.
        worker_timeout: see `study` [s].
        out: see `study`.
        again: see `study`.
        progress: called with the number of designs done.

    Returns:
        A row per design in the order in which they were tried, as of `study`. Which of
        them are best say `pareto.costs` and `pareto.pareto`.

    Raises:
        CableError: something about the search is impossible, or Optuna is not
            installed; raised before it runs.
    """
    plan, goals, limits = make_search(
        scene,
        vary,
        objectives,
        subject_to,
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
    _, table = search(
        plan,
        goals,
        limits,
        evaluations,
        folder,
        threads,
        scheduler,
        progress,
        worker_timeout=worker_timeout,
        again=again,
    )
    return table


def make_search(
    scene: str,
    vary: Mapping[str, Given],
    objectives: Sequence[str],
    subject_to: Sequence[str] = (),
    *,
    metrics: Sequence[str | Metric] = (),
    **trial: Any,
) -> tuple[Plan, tuple[Objective, ...], tuple[Limit, ...]]:
    """A plan without designs, what makes a design good, and its limits.

    Args:
        scene: see `optimise`, as are all others.
        vary: see there.
        objectives: see there.
        subject_to: see there.
        metrics: see there.
        trial: how designs are tried: trajectory, task, controllers, duration, seed,
            timestep, across, rank, costs.

    Raises:
        CableError: what is wrong, in one sentence.
    """
    _optuna()
    vary, chosen = named("vary", vary), metrics_of(metrics)
    limits = read_limits(subject_to, across=bool(trial.get("across")))
    goals = read_objectives(objectives)
    if not 1 <= len(goals) <= MOST_OBJECTIVES:
        raise CableError(
            f"a search has 1 to {MOST_OBJECTIVES} objectives, not {len(goals)}; what "
            "need not be best but good enough is a limit (--subject-to)."
        )
    measured = (*(goal.name for goal in goals), *(limit.name for limit in limits))
    plan, builder = empty_plan(
        scene,
        metrics=tuple(dict.fromkeys((*measured, *(one.name for one in chosen)))),
        goals=goals,
        named=vary,
        **trial,
    )
    if not vary:
        raise CableError("a search needs something to vary.")
    plan.protocol.across.require_apart(vary)
    ranges = {name: read_range(name, v, builder.cables) for name, v in vary.items()}
    ends = {n: r.ends or (min(r.levels), max(r.levels)) for n, r in ranges.items()
            if n in gait.WALKER}  # fmt: skip
    gait.require_strides(
        plan.protocol,
        [dict(zip(ends, c, strict=True)) for c in itertools.product(*ends.values())],
    )
    asked = {
        "objectives": [goal.text for goal in goals],
        "subject_to": [limit.text for limit in limits],
        "ranges": {
            name: [list(values.levels), values.ends, values.log]
            for name, values in ranges.items()
        },
        "generation": [GENERATION, PIECE],
        "sampler": f"TPE of optuna {_optuna().__version__}",
    }
    return dataclasses.replace(plan, ranges=ranges, search=asked), goals, limits


def search(
    plan: Plan,
    goals: Sequence[Objective],
    limits: Sequence[Limit],
    evaluations: int,
    folder: Path | None = None,
    threads: int = 0,
    scheduler: str | None = None,
    progress: Progress = lambda done: None,
    *,
    worker_timeout: float = WORKER_TIMEOUT,
    again: bool = False,
    say: Callable[[str], None] = lambda sentence: None,
) -> tuple[Plan, pa.Table]:
    """Carry a search out; see `optimise`.

    Returns:
        The plan with its designs, and their table.
    """
    if isinstance(evaluations, int) and evaluations < 1:
        raise CableError(f"a search must try at least 1 design, not {evaluations}.")
    require_count(evaluations)
    optuna = _optuna()
    store = Store(plan, folder, again)
    if store.finished > evaluations:
        say(
            f"All {store.finished} designs kept of a search that has finished, more "
            f"than the {evaluations} asked for; --again runs {evaluations} anew."
        )
        evaluations = store.finished
    elif store.kept:
        say(told(min(store.kept, evaluations), evaluations, "designs"))
    if (all_of_them := _count(plan)) < evaluations:
        say(f"The ranges have {all_of_them} designs, so all of them are tried.")
        evaluations = int(all_of_them)
    builder = Builder(plan.protocol.scene, plan.protocol.timestep)
    study = optuna.create_study(
        directions=["minimize"] * len(goals),
        sampler=optuna.samplers.TPESampler(
            seed=plan.protocol.seed,
            multivariate=True,
            constant_liar=True,
            n_startup_trials=GENERATION,
        ),
    )
    space = {name: _distribution(optuna, r) for name, r in plan.ranges.items()}
    trial = Trial(plan.protocol)
    worst = [0.0] * len(goals)
    tried: set[tuple[Any, ...]] = set()
    random = np.random.default_rng(plan.protocol.seed)
    while len(plan.designs) < evaluations:
        done = len(plan.designs)
        count = min(GENERATION, evaluations - done)
        asked = [_new(study, space, tried, random) for _ in range(count)]
        designs = [_design(plan, one.params) for one in asked]
        plan, refused = _grown(plan, builder, designs)
        store.plan = plan
        for number, result in refused.items():
            store.keep(number, [result])
        missing = store.missing()
        pieces = {n: [plan.designs[i] for i in plan.batches[n]] for n in missing}
        tell = _counting(progress, done + count - sum(map(len, pieces.values())))
        if scheduler is None:
            found = run_here(trial, pieces, tell, count=threads)
        else:
            found = run_on_cluster(trial, pieces, scheduler, tell, worker_timeout)
        # Closed at once if it is interrupted here, so that what is under way ends too.
        with contextlib.closing(found):
            for number, results in found if missing else ():
                store.keep(number, results)
        results = store.results(done)
        if not done:
            for sentence in _lacking(goals, results):
                say(sentence)
        for one, result in zip(asked, results, strict=True):
            costs = [goal.cost(result.metrics) for goal in goals]
            beyond = {limit.text: limit.beyond(result.metrics) for limit in limits}
            none = any(math.isnan(number) for number in (*costs, *beyond.values()))
            if none:
                costs, beyond = list(worst), dict.fromkeys(beyond, _IMPOSSIBLE)
            worst = [max(pair) for pair in zip(worst, costs, strict=True)]
            for name, size in {**beyond, "numbers": float(none)}.items():
                one.set_constraint(name, size)
            study.tell(one, costs)
        progress(len(plan.designs))
    return plan, store.table()


def _count(plan: Plan) -> float:
    """Return the number of designs within the ranges."""
    levels = [values.levels for values in plan.ranges.values()]
    return math.prod(len(each) for each in levels) if all(levels) else math.inf


def _new(
    study: Any, space: Mapping[str, Any], tried: set[tuple[Any, ...]], random: Any
) -> Any:
    """A trial of a design that was not tried before, of which there must be one.

    A sampler that has found the best of a few values asks for it again and again.
    """
    out = _optuna().trial.TrialState.FAIL
    for _ in range(AGAIN):
        asked = study.ask(space)
        if (place := tuple(asked.params.values())) not in tried:
            tried.add(place)
            return asked
        study.tell(asked, state=out)
    while True:
        params = {name: _any_of(values, random) for name, values in space.items()}
        if (place := tuple(params.values())) not in tried:
            tried.add(place)
            study.enqueue_trial(params)
            return study.ask(space)


def _any_of(values: Any, random: Any) -> Any:
    """One of the values of a distribution, any as likely as another."""
    if hasattr(values, "choices"):
        return values.choices[random.integers(len(values.choices))]
    if isinstance(values.low, int):
        return int(random.integers(values.low, values.high + 1))
    return float(random.uniform(values.low, values.high))


def _lacking(goals: Sequence[Objective], results: Sequence[Result]) -> list[str]:
    """A sentence for each objective that none of some designs has a number of."""
    many = len(results)
    reasons = [result.failed for result in results if result.failed]
    first = f"; {len(reasons)} failed, the first: {reasons[0]}" if reasons else ""
    return [
        f"None of the first {many} designs has a number for {goal.name}, by which the "
        f"search goes{first.rstrip('.')}; Ctrl-C keeps what there is."
        for goal in goals
        if all(math.isnan(goal.cost(result.metrics)) for result in results)
    ]


def _optuna() -> Any:
    try:
        import optuna
    except ImportError:
        raise CableError(
            "a search needs Optuna: pip install 'cc_mujoco[search]'."
        ) from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    return optuna


def _distribution(optuna: Any, values: Range) -> Any:
    kinds = optuna.distributions
    if values.ends is not None and not values.levels:
        return kinds.FloatDistribution(*values.ends, log=values.log)
    if any(isinstance(level, str) for level in values.levels):
        return kinds.CategoricalDistribution(values.levels)
    # Levels are in an order, which the place of a level keeps.
    return kinds.IntDistribution(0, len(values.levels) - 1)


def _design(plan: Plan, asked: Mapping[str, Any]) -> Design:
    """A design from what the sampler asked for.

    What decides before any simulation whether a design can be is no concern of the
    sampler's: see `gait.fitted`.
    """
    found: Design = {}
    between: dict[str, tuple[float, float, bool]] = {}
    for name, values in plan.ranges.items():
        one = asked[name]
        found[name] = sorted(values.levels)[one] if isinstance(one, int) else one
        if values.ends is not None and not values.levels:
            between[name] = (*values.ends, values.log)
    cases = [plant(case) for case in plan.protocol.across.cases]
    return gait.fitted(found, between, cases)


def _grown(
    plan: Plan, builder: Builder, designs: Sequence[Design]
) -> tuple[Plan, dict[int, Result]]:
    """The plan with more designs; results of batches whose design is impossible."""
    first, batch = len(plan.designs), len(plan.batches)
    checked: list[Design] = []
    refused: dict[int, str] = {}
    for place, design in enumerate(designs):
        try:
            checked.append(plan.protocol.across.check(builder, design))
        except CableError as error:
            checked.append(design)
            refused[first + place] = f"impossible: {str(error).rstrip('.')}"
    possible = [i for i in range(first, first + len(designs)) if i not in refused]
    across = plan.protocol.across
    layouts = {i: across.layout(builder, checked[i - first]) for i in possible}
    batches = [*batches_of(layouts, PIECE), *((index,) for index in refused)]
    none = dict.fromkeys(numbers(plan.protocol), math.nan)
    return (
        dataclasses.replace(
            plan,
            designs=(*plan.designs, *checked),
            batches=(*plan.batches, *batches),
        ),
        {
            batch + len(batches) - len(refused) + place: Result(none, why)
            for place, why in enumerate(refused.values())
        },
    )


def _counting(progress: Progress, before: int) -> Progress:
    return lambda done: progress(before + done)
