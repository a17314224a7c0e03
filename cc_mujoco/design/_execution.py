"""Execution of a study or a search, from its specification or its plan.

table = study("wrist", {"friction": "0.05:0.3:10", "loops": [1, 2, 3]})
table.sort_by("held_backlash").slice(0, 5).to_pandas()

A search samples designs in generations, whose size does not depend on the machine. The
same seed thus gives the same designs on any number of threads, and an interrupted
search continues by sampling them again. The sampler is Optuna's multi-objective
tree-structured Parzen estimator (Y. Ozaki et al., "Multiobjective tree-structured
Parzen estimator", Journal of Artificial Intelligence Research 73, 2022).
"""

import contextlib
import dataclasses
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pyarrow as pa

from cc_mujoco._utils.provenance import earlier_results_message
from cc_mujoco._workers.cluster import run_on_cluster
from cc_mujoco._workers.local_executor import Progress, run_here
from cc_mujoco.control import CONTROLLERS
from cc_mujoco.control._controller import stepped_law
from cc_mujoco.design import _whatif_options as whatif
from cc_mujoco.design._designs import Range
from cc_mujoco.design._evaluation import Design, DesignJob, DesignResult, episodes
from cc_mujoco.design._pareto import Objective
from cc_mujoco.design._plan import (
    GENERATION,
    PIECE,
    Plan,
    batches_of,
    make_plan,
    require_optuna,
)
from cc_mujoco.design._protocol import number_columns
from cc_mujoco.design._results_store import Store
from cc_mujoco.device import Plant, Value
from cc_mujoco.device._wearer_scaling import PROFILE, pace_of
from cc_mujoco.errors import CableError, refuse_unknown
from cc_mujoco.human import Profile
from cc_mujoco.simulation._rollout import attended_together, play


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
        out: folder that keeps finished designs and the table; a study that was
            interrupted there continues. Without one nothing is written.
        progress: called with the number of designs done.
        fields: other fields of `StudySpec` and `Execution`.

    Returns:
        A row per design: its number, its variables, its metrics (null if one has no
        number) and `failed`, the reason if the simulation failed. Over several cases a
        metric is the worst of its numbers; `METRIC@worst_case` names that case,
        `METRIC@least` and `METRIC@most` are the extremes. Of several controllers,
        `METRIC@CONTROLLER` has each.
    """
    how = {field.name for field in dataclasses.fields(whatif.Execution)}
    what = {field.name for field in dataclasses.fields(whatif.StudySpec)}
    refuse_unknown(fields, how | what)
    how &= set(fields)
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
        vary: `"low:high"` or `"low:high:log"` for all values in between; with a count,
            or a list of values, only these.
        objectives: `METRIC`, `min:METRIC` or `max:METRIC`.
        subject_to: limits, `METRIC>=NUMBER` or `METRIC<=NUMBER`.
        evaluations: number of designs; if an earlier run in `out` had fewer, it is
            continued, if it finished more, its table stays.
        fields: other arguments of `study`; by default only the metrics of objectives
            and limits are measured.

    Returns:
        A row per design in the order of the search, as from `study`. `objective_costs`
        and `pareto_rows` find the best of them.
    """
    fields |= {"objectives": objectives, "subject_to": subject_to}
    return study(scene, vary, evaluations=evaluations, **fields)


def carry_out(
    plan: Plan,
    folder: Path | None = None,
    execution: whatif.Execution = whatif.HERE,
    progress: Progress = lambda done: None,
    say: Callable[[str], None] = lambda sentence: None,
) -> pa.Table:
    """Simulate the unfinished designs of a plan; return the table, see `study`.

    `say` is called with a sentence if an earlier run has finished some.
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


SAMPLE_TIME = 0.1  # simulated time of a sample [s]


def wait_sentences(plan: Plan, threads: int) -> Iterator[str]:
    """Yield sentences: slow controllers are timed, and each that takes long.

    Nothing is known of a search in advance. 0 `threads` means one per processor.
    """
    known = {law: stepped_law(kind) for law, kind in CONTROLLERS.items()}
    fast_laws = {law for law, own in known.items() if own is not None and not own.plans}
    # Policies and users' laws are slow, too.
    slow = [law for law in plan.protocol.controllers if law not in fast_laws]
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
    plants = [Plant(protocol.device, own) for own in values]
    models = attended_together(plants)
    played = [one for _, own, one in episodes(protocol) if own]
    if not played:
        return 0.0
    sample = dataclasses.replace(played[0], duration=SAMPLE_TIME)
    play(sample, models, plants=plants)  # compiles
    start = perf_counter()
    play(sample, models, plants=plants)
    spent = (perf_counter() - start) / (SAMPLE_TIME * len(plants))
    return spent * sum(one.duration for one in played)


def _rough(seconds: float) -> str:
    for unit, size in (("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} seconds"


def search(
    plan: Plan,
    folder: Path | None = None,
    execution: whatif.Execution = whatif.HERE,
    progress: Progress = lambda done: None,
    say: Callable[[str], None] = lambda sentence: None,
) -> tuple[Plan, pa.Table]:
    """Run a search; return its plan, with the designs, and table; see `optimise`."""
    goals, limits, evaluations = plan.objectives, plan.limits, plan.evaluations
    store = Store(plan, folder, execution.again)
    if store.finished > evaluations:
        say(
            f"All {store.finished} designs kept of a search that has finished, more "
            f"than the {evaluations} requested; --again runs {evaluations} anew."
        )
        evaluations = store.finished
    elif store.kept:
        kept = min(store.kept, evaluations)
        say(earlier_results_message(kept, evaluations, "designs"))
    levels = [len(values.levels) for values in plan.ranges.values()]
    if all(levels) and math.prod(levels) < evaluations:
        evaluations = math.prod(levels)
        say(f"The ranges have {evaluations} designs, so all of them are tried.")
    optuna = require_optuna()
    options: dict[str, Any] = {"multivariate": True, "constant_liar": True}
    options |= {"seed": plan.protocol.seed, "n_startup_trials": GENERATION}
    sampler = optuna.samplers.TPESampler(**options)
    directions = ["minimize"] * len(goals)
    study = optuna.create_study(directions=directions, sampler=sampler)
    space = {name: _distribution(optuna, r) for name, r in plan.ranges.items()}
    worst = [0.0] * len(goals)
    tried: set[tuple[Any, ...]] = set()
    random = np.random.default_rng(plan.protocol.seed)
    while len(plan.designs) < evaluations:
        done = len(plan.designs)
        count = min(GENERATION, evaluations - done)
        trials = [_new_trial(study, space, tried, random) for _ in range(count)]
        designs = [_design_of_trial(plan, one.params) for one in trials]
        plan, refused = _with_designs(plan, designs)
        store.plan = plan
        for number, result in refused.items():
            store.keep(number, [result])
        missing = store.missing()
        left = sum(len(plan.batches[n]) for n in missing)

        def tell(more: float, before: float = done + count - left) -> None:
            progress(before + more)

        run_batches(store, missing, execution, tell)
        results = store.results(done)
        if not done:
            for sentence in _missing_objectives(goals, results):
                say(sentence)
        for one, result in zip(trials, results, strict=True):
            costs = [goal.cost(result.metrics) for goal in goals]
            beyond = {limit.text: limit.beyond(result.metrics) for limit in limits}
            none = any(math.isnan(number) for number in (*costs, *beyond.values()))
            if none:
                # A design that gives no numbers counts as far beyond all limits.
                costs, beyond = list(worst), dict.fromkeys(beyond, 1e6)
            worst = [max(pair) for pair in zip(worst, costs, strict=True)]
            for name, size in {**beyond, "numbers": float(none)}.items():
                one.set_constraint(name, size)
            study.tell(one, costs)
        progress(len(plan.designs))
    return plan, store.table()


def run_batches(
    store: Store,
    batches: Sequence[int],
    execution: whatif.Execution,
    progress: Progress,
) -> None:
    if not batches:
        return
    plan = store.plan
    trial = DesignJob(plan.protocol)
    pieces = {n: [plan.designs[i] for i in plan.batches[n]] for n in batches}
    scheduler, timeout = execution.scheduler, execution.worker_timeout
    if scheduler is None:
        found = run_here(trial, pieces, progress, count=execution.threads)
    else:
        found = run_on_cluster(trial, pieces, scheduler, progress, timeout)
    # Closed at once if it is interrupted here, so that what is under way ends too.
    with contextlib.closing(found):
        for number, results in found:
            store.keep(number, results)


def _new_trial(
    study: Any, space: Mapping[str, Any], tried: set[tuple[Any, ...]], random: Any
) -> Any:
    """Return a trial of a design that is not in `tried`; one must exist."""
    out = require_optuna().trial.TrialState.FAIL
    for _ in range(20):  # the sampler may repeat what was tried before
        trial = study.ask(space)
        if (place := tuple(trial.params.values())) not in tried:
            tried.add(place)
            return trial
        study.tell(trial, state=out)
    while True:
        params = {name: _random_choice(each, random) for name, each in space.items()}
        if (place := tuple(params.values())) not in tried:
            tried.add(place)
            study.enqueue_trial(params)
            return study.ask(space)


def _random_choice(values: Any, random: Any) -> Any:
    if hasattr(values, "choices"):
        return values.choices[random.integers(len(values.choices))]
    if isinstance(values.low, int):
        return int(random.integers(values.low, values.high + 1))
    return float(random.uniform(values.low, values.high))


def _missing_objectives(
    goals: Sequence[Objective], results: Sequence[DesignResult]
) -> list[str]:
    many = len(results)
    reasons = [result.failed for result in results if result.failed]
    first = f"; {len(reasons)} failed, the first: {reasons[0]}" if reasons else ""
    return [
        f"None of the first {many} designs has a number for {goal.name}, by which the "
        f"search goes{first.rstrip('.')}; Ctrl-C keeps what there is."
        for goal in goals
        if all(math.isnan(goal.cost(result.metrics)) for result in results)
    ]


def _distribution(optuna: Any, values: Range) -> Any:
    kinds = optuna.distributions
    if values.ends is not None and not values.levels:
        return kinds.FloatDistribution(*values.ends, log=values.log)
    if any(isinstance(level, str) for level in values.levels):
        return kinds.CategoricalDistribution(values.levels)
    # Levels are in an order, which the place of a level keeps.
    return kinds.IntDistribution(0, len(values.levels) - 1)


def _design_of_trial(plan: Plan, parameters: Mapping[str, Any]) -> Design:
    """Return the design of a sampler's trial, with a possible torque profile."""
    found: Design = {}
    between: dict[str, tuple[float, float, bool]] = {}
    for name, values in plan.ranges.items():
        one = parameters[name]
        found[name] = sorted(values.levels)[one] if isinstance(one, int) else one
        if values.ends is not None and not values.levels:
            between[name] = (*values.ends, values.log)
    return fit_profile(found, between, plan.protocol.across.cases)


def _with_designs(
    plan: Plan, designs: Sequence[Design]
) -> tuple[Plan, dict[int, DesignResult]]:
    """Return the plan with more designs, and results for the impossible ones."""
    device = plan.protocol.device
    first, batch = len(plan.designs), len(plan.batches)
    checked: list[Design] = []
    refused: dict[int, str] = {}
    for place, design in enumerate(designs):
        try:
            checked.append(plan.protocol.across.check(device, design))
        except CableError as error:
            checked.append(design)
            refused[first + place] = f"impossible: {str(error).rstrip('.')}"
    possible = {i: d for i, d in enumerate(checked, first) if i not in refused}
    together = batches_of(plan.protocol, possible, PIECE)
    batches = [*together, *((index,) for index in refused)]
    none = dict.fromkeys(number_columns(plan.protocol), math.nan)
    first = batch + len(together)
    results = {n: DesignResult(none, w) for n, w in enumerate(refused.values(), first)}
    designs, every = (*plan.designs, *checked), (*plan.batches, *batches)
    return dataclasses.replace(plan, designs=designs, batches=every), results


def fit_profile(
    design: Mapping[str, Value],
    ranges: Mapping[str, tuple[float, float, bool]],
    cases: Sequence[Mapping[str, Value]] = ({},),
) -> dict[str, Value]:
    """Return a design whose torque profile ends by toe-off.

    The latest peak depends on the shortest fall; the longest fall and the latest onset
    depend on the peak. A draw from the full range of a variable is mapped to the same
    fraction of the possible range, so that every design is possible and the longest
    fall is at the end of its range. `ranges` has low end, high end and whether
    logarithmic of each drawn variable. The profile has to end within the shortest
    stance of all `cases`.
    """
    found = dict(design)
    if not any(name in design for name in PROFILE):
        return found
    try:
        toe_off = min(100.0 * pace_of({**design, **case}).toe_off for case in cases)
    except CableError:  # impossible, which is reported where designs are checked
        return found
    shortest = 0.1  # rise and fall [% of the stride]
    least = ranges["fall"][0] if "fall" in ranges else design.get("fall", shortest)
    peak = float(design.get("peak_time", Profile.peak_time))
    if "peak_time" in ranges:
        peak = _rescale(peak, *ranges["peak_time"], toe_off - float(least))
        found["peak_time"] = peak
    for name, most in (("fall", toe_off - peak), ("onset", peak - shortest)):
        if name in ranges:
            found[name] = _rescale(float(design[name]), *ranges[name], most)
    return found


def _rescale(value: float, low: float, high: float, log: bool, most: float) -> float:
    """Map a value of low...high to low...most, at the same fraction of the range."""
    most *= 1.0 - 1e-12  # rounding must not take a sum beyond its limit
    if most >= high:
        return value
    if most <= low:
        return low
    if log:
        share = math.log(value / low) / math.log(high / low)
        return min(low * math.pow(most / low, share), most)
    return min(low + (value - low) * (most - low) / (high - low), most)
