"""A study before it runs: how designs are tried, which ones, and in which batches.

All that can be wrong with a study is found here, before anything runs.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cc_mujoco.checks import LONGEST, listed, named, number
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.human import Trajectory
from cc_mujoco.human.recorded import given_trajectory
from cc_mujoco.identity import made_by
from cc_mujoco.metrics import METRICS, Metric, find_metric, known_by, own_metrics
from cc_mujoco.whatif import gait
from cc_mujoco.whatif.across import Across, read_across
from cc_mujoco.whatif.build import Builder
from cc_mujoco.whatif.costs import EXAMPLE, read_costs
from cc_mujoco.whatif.designs import (
    Given,
    Range,
    from_file,
    grid,
    latin_hypercube,
    read_range,
    require_count,
)
from cc_mujoco.whatif.evaluate import Design, rehearse
from cc_mujoco.whatif.metrics import (
    CHOSEN_BY,
    COST,
    USUAL,
    lacking,
    metric_of_designs,
    of_strides,
)
from cc_mujoco.whatif.pareto import Objective
from cc_mujoco.whatif.protocol import CHIRP_TIME, CONTROL_PERIOD, EpisodeProtocol

BATCH = 256
"""Most designs that are simulated together: enough that Python's share is small."""

MEMORY, SAMPLE = 250e6, 150.0
"""Most that a batch may keep, and size of a design's control step [byte]."""

_FEW = 8
"""Designs that are simulated together where there are few."""

_LONGEST_TEXT = 200
"""Characters of a trajectory's `repr` that stand in a description as they are."""

SAMPLINGS = ("grid", "lhs")

VALUES = "values"
"""Key of a study's description: a digest of each variable's values."""

DEFAULT_CONTROLLERS = ("model",)
"""It follows from a design's own cables, where fixed gains suit one design alone."""


@dataclass(frozen=True)
class Plan:
    """A study that can be run."""

    protocol: EpisodeProtocol
    designs: tuple[Design, ...]
    ranges: Mapping[str, Range]
    """Range of each variable; of a list of designs, the values that occur."""
    full: bool
    """True if the designs are every combination of the levels of the ranges."""
    batches: tuple[tuple[int, ...], ...]
    """Indices of designs that are simulated together."""
    source: str
    """Name of the trajectory, path of its CSV file, or what it is as an object."""
    search: Mapping[str, Any] | None = None
    """Settings of a search for the best, as plain JSON, where designs follow from it;
    else None."""

    @property
    def varied(self) -> tuple[str, ...]:
        """Variables that take more than one value."""
        return tuple(
            name
            for name in self.ranges
            if any(d[name] != self.designs[0][name] for d in self.designs)
        )

    def describe(self) -> dict[str, Any]:
        """Describe the study as plain JSON, equal for equal studies."""
        protocol = {
            field.name: getattr(self.protocol, field.name)
            for field in dataclasses.fields(self.protocol)
        }
        protocol |= {
            "trajectory": self.source,
            "controllers": list(self.protocol.controllers),
            "metrics": list(self.protocol.metrics),
            "across": {name: list(v) for name, v in self.protocol.across.levels},
            "rank": self.protocol.across.rank,
            "turned": list(self.protocol.across.turned),
        }
        own = self.protocol.own
        protocol["own"] = {find_metric(one).name: known_by(one) for one in own}
        if self.protocol.costs:
            protocol["costs"] = dict(self.protocol.costs)
        else:
            del protocol["costs"]
        about: dict[str, Any] = {
            "protocol": protocol,
            "variables": list(self.ranges),
        }
        if self.search is not None:
            return about | {"search": json.loads(json.dumps(self.search))}
        values = {n: dict.fromkeys(d[n] for d in self.designs) for n in self.ranges}
        return about | {
            VALUES: {name: _digest(list(each)) for name, each in values.items()},
            "designs": len(self.designs),
            "batches": len(self.batches),
            "digest": _digest(self.designs),
        }

    def made_by(self) -> dict[str, Any]:
        """Return what else makes the table, see `identity`."""
        names = *self.protocol.controllers, *self.protocol.metric_files
        return made_by(*names, trajectory=self.source)


def _digest(listed: Sequence[object]) -> str:
    return hashlib.sha256(json.dumps(listed).encode()).hexdigest()


def make_plan(
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
    goals: Sequence[Objective] = (),
    costs: str | Path | None = None,
) -> Plan:
    """Plan a study; the arguments are those of `study`.

    `goals` says where more of a metric is better or worse than is usual, which
    decides which case is the worst.

    Raises:
        CableError: what is wrong, in one sentence.
    """
    vary = named("vary", vary)
    if (not vary) == (designs is None):
        raise CableError("give what to vary, or a list of designs, and not both.")
    rows: Sequence[Mapping[str, object]] = []
    if isinstance(designs, (str, Path)):
        rows = from_file(designs)
    elif designs is not None:
        if isinstance(designs, Mapping) or not isinstance(designs, Iterable):
            raise CableError(f"designs must be a file or a list, not {designs!r}.")
        rows = [named(f"design {i}", row) for i, row in enumerate(designs)]
    said = dict.fromkeys(vary or (name for row in rows[:1] for name in row))
    protocol, builder = _trial(
        scene, trajectory, task, controllers, duration, seed, timestep, metrics,
        across, rank, goals, costs, said,
    )  # fmt: skip
    look_up("sampling", sampling, dict.fromkeys(SAMPLINGS))
    if (sampling == "lhs") != (samples is not None):
        raise CableError("sampling 'lhs' needs a number of samples, a grid has none.")
    ranges: dict[str, Range] = {}
    if designs is None:
        ranges = {
            name: read_range(name, given, builder.cables)
            for name, given in vary.items()
        }
        if samples is not None:
            rows = latin_hypercube(ranges, samples, seed)
        else:
            rows = grid(ranges)
    cases = protocol.across
    cases.require_apart(dict.fromkeys(name for row in rows for name in row))
    require_count(len(rows) * len(cases.cases))
    checked = _check(cases, builder, rows)
    gait.require_strides(protocol, checked)
    if designs is not None:
        _require_apart(checked)
        names = list(checked[0])
        ranges = {n: Range(tuple(dict.fromkeys(d[n] for d in checked))) for n in names}
    full = designs is None and samples is None
    source = _source(builder.device.trajectory if trajectory is None else trajectory)
    batches = _batches(cases, builder, checked, max(duration, CHIRP_TIME))
    return Plan(protocol, tuple(checked), ranges, full, batches, source)


def empty_plan(
    scene: str,
    *,
    trajectory: str | Path | Trajectory | None = None,
    task: str | None = None,
    controllers: Sequence[str] = DEFAULT_CONTROLLERS,
    duration: float = 10.0,
    seed: int = 0,
    timestep: float | None = None,
    metrics: Sequence[str | Metric] = (),
    across: Mapping[str, Given] | None = None,
    rank: str | None = None,
    goals: Sequence[Objective] = (),
    costs: str | Path | None = None,
    named: Iterable[str] = (),
) -> tuple[Plan, Builder]:
    """A plan without designs, and the builder of its scene; see `make_plan`.

    `named` are the variables that designs will have.

    Raises:
        CableError: what is wrong, in one sentence.
    """
    protocol, builder = _trial(
        scene, trajectory, task, controllers, duration, seed, timestep, metrics,
        across, rank, goals, costs, named,
    )  # fmt: skip
    source = _source(builder.device.trajectory if trajectory is None else trajectory)
    return Plan(protocol, (), {}, False, (), source), builder


def _read_controllers(names: Sequence[str]) -> tuple[str, ...]:
    """Controllers, each once.

    Raises:
        CableError: there is none, or one is given twice.
    """
    found = listed("controllers", names)
    if not found:
        raise CableError("a study needs a controller.")
    for name in found:
        if found.count(name) > 1:
            raise CableError(f"controller {name!r} is given twice.")
    return found


def _trial(
    scene: str,
    trajectory: str | Path | Trajectory | None,
    task: str | None,
    laws: Sequence[str],
    duration: float,
    seed: int,
    timestep: float | None,
    metrics: Sequence[str | Metric],
    across: Mapping[str, Given] | None,
    rank: str | None,
    goals: Sequence[Objective],
    costs: str | Path | None,
    named: Iterable[str],
) -> tuple[EpisodeProtocol, Builder]:
    """Return the protocol of the designs, and the builder of the scene."""
    builder = Builder(scene, timestep)
    step = float(builder.spec.option.timestep)
    skip = round(CONTROL_PERIOD / step) if step > 0.0 else 0
    if skip < 1 or not math.isclose(skip * step, CONTROL_PERIOD):
        raise CableError(
            f"the time step must divide the {1e3 * CONTROL_PERIOD:g} ms between two "
            f"calls of the controller, which {1e3 * step:g} ms does not."
        )
    chosen = tuple(dict.fromkeys(metric.name for metric in metrics_of(metrics)))
    laws = _read_controllers(laws)
    number("duration", duration, 0.05, LONGEST, "s")
    if not (isinstance(seed, int) and seed >= 0):
        raise CableError(f"seed must be an integer >= 0, not {seed!r}.")
    turned = [goal.name for goal in goals if goal.high != METRICS[goal.name].high]
    cases = read_across(across, rank, builder.cables, turned)
    home = builder.device
    given_motion = home.trajectory if trajectory is None else trajectory
    motion, source = given_trajectory(given_motion), _source(given_motion)
    said = {name.rpartition(".")[2] for name in (*named, *cases.names)}
    given = home.task if task is None else task
    gait.require_played(home, said, source, given)
    for name in chosen:
        if of_strides(name) and (home.joint, source) != ("ankle", gait.WALK):
            raise CableError(
                f"metric {name!r} is of the strides of an ankle; it needs the scene "
                f"'ankle' and the trajectory {gait.WALK!r}."
            )
        if variables := lacking(METRICS[name], said):
            ways = " or ".join(map(repr, variables))
            raise CableError(
                f"metric {name!r} needs what no scene says: give every design "
                f"{ways} (--vary, one value is enough)."
            )
    if chosen and len(laws) > 1 and CHOSEN_BY not in chosen:
        chosen = (*chosen, CHOSEN_BY)
    measured = chosen or _had(said, costs is not None)
    priced = read_costs(EXAMPLE if costs is None else costs)
    if costs is not None and COST not in measured:
        raise CableError(
            f"costs are for the metric {COST!r}, which is not among those measured."
        )
    protocol = EpisodeProtocol(
        scene,
        motion,
        given,
        laws,
        duration,
        seed,
        step,
        measured,
        cases,
        tuple(priced.items()) if COST in measured else (),
        own_metrics(measured),
    )
    rehearse(protocol, builder)
    return protocol, builder


def metrics_of(given: Sequence[str | Metric]) -> list[Metric]:
    """Return the metrics that are chosen for a study.

    Raises:
        CableError: They are no list, or there is no such metric.
    """
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise CableError(f"metrics must be a list of texts, not {given!r}.")
    return [metric_of_designs(one) for one in given]


def _source(trajectory: str | Path | Trajectory) -> str:
    """Return the text by which a trajectory is known again in a description."""
    if isinstance(trajectory, (str, Path)):
        return str(trajectory)
    text = repr(trajectory)
    if len(text) <= _LONGEST_TEXT:
        return text
    return f"{type(trajectory).__name__} {hashlib.sha256(text.encode()).hexdigest()}"


def _had(said: Collection[str], costs: bool) -> tuple[str, ...]:
    """Metrics that designs with these variables have, and are measured unasked."""
    return tuple(
        name
        for name in (*USUAL, COST)
        if not lacking(METRICS[name], said) and (costs or name != COST)
    )


def _check(
    across: Across, builder: Builder, rows: Sequence[Mapping[str, object]]
) -> list[Design]:
    """Every design as it is used.

    Raises:
        CableError: designs are impossible; says which is the first, why, and how many.
    """
    checked: list[Design] = []
    wrong: list[tuple[int, str]] = []
    for index, row in enumerate(rows):
        try:
            checked.append(across.check(builder, row))
        except CableError as error:
            wrong.append((index, str(error).rstrip(".")))
    if wrong:
        index, why = wrong[0]
        text = ", ".join(f"{name}={_short(v)}" for name, v in rows[index].items())
        many = (
            f" ({len(wrong)} of {len(rows)} are impossible)" if len(wrong) > 1 else ""
        )
        raise CableError(f"design {index} ({text}) is impossible: {why}{many}.")
    if not checked:
        raise CableError("there are no designs.")
    return checked


def _require_apart(designs: Sequence[Design]) -> None:
    """Refuse a list that has a design twice, which would count twice in all ranks.

    Raises:
        CableError: says which are the same.
    """
    seen: dict[tuple[object, ...], int] = {}
    for index, design in enumerate(designs):
        first = seen.setdefault(tuple(design.items()), index)
        if first != index:
            text = ", ".join(f"{name}={_short(v)}" for name, v in design.items())
            raise CableError(
                f"designs {first} and {index} (counted from 0) are the same, {text}; "
                "give each once."
            )


def _short(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _batches(
    across: Across, builder: Builder, designs: Sequence[Design], longest: float
) -> tuple[tuple[int, ...], ...]:
    """Designs of equal layout together, at least eight batches for the threads.

    Nothing about the machine counts, so that a study is resumed on any other.
    """
    room = int(MEMORY / SAMPLE * CONTROL_PERIOD / longest)
    size = max(1, min(BATCH, room, math.ceil(len(designs) / 8)))
    layouts = {i: across.layout(builder, d) for i, d in enumerate(designs)}
    return batches_of(layouts, size)


def batches_of(
    layout: Mapping[int, tuple[object, ...]], size: int
) -> tuple[tuple[int, ...], ...]:
    """Designs of equal layout together, `size` of them at most."""
    layouts: dict[tuple[object, ...], list[int]] = {}
    for index, one in layout.items():
        layouts.setdefault(one, []).append(index)
    return tuple(
        tuple(members[i : i + size])
        for members in layouts.values()
        for i in range(0, len(members), size)
    )


def few(plan: Plan, builder: Builder, designs: Sequence[Design]) -> Plan:
    """The study with other designs, so few that small batches suit them."""
    across = plan.protocol.across
    layouts = {i: across.layout(builder, d) for i, d in enumerate(designs)}
    return dataclasses.replace(
        plan,
        designs=tuple(designs),
        full=False,
        batches=batches_of(layouts, _FEW),
        search=None,
    )
