"""Plan of a study: its protocol, designs and batches.

All errors in the specification of a study are found here, before it runs.
"""

import contextlib
import hashlib
import json
import math
import os
import pickle
import warnings
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco

from cc_mujoco._utils.provenance import code_provenance
from cc_mujoco._utils.tables import is_table
from cc_mujoco._validation import (
    MAX_DURATION,
    require_dictionary,
    require_list,
    require_number,
)
from cc_mujoco.cable._cable import SCALES
from cc_mujoco.design import _protocol as protocols
from cc_mujoco.design._bill_of_materials import EXAMPLE, read_costs
from cc_mujoco.design._designs import (
    Range,
    from_file,
    grid,
    latin_hypercube,
    read_range,
    require_count,
)
from cc_mujoco.design._evaluation import CHIRP_TIME, Design, DesignJob, joints_of_gait
from cc_mujoco.design._pareto import (
    MetricLimit,
    Objective,
    read_limits,
    read_objectives,
)
from cc_mujoco.design._protocol import EpisodeProtocol, is_stride_metric, metric_of
from cc_mujoco.design._scenarios import Across, read_across
from cc_mujoco.design._whatif_options import Assignments, Given, StudySpec
from cc_mujoco.device import Axis, Description, Device, Value, load_device
from cc_mujoco.device import _wearer_scaling as wearers
from cc_mujoco.device._device_files import is_device_file
from cc_mujoco.device._variables import split
from cc_mujoco.errors import CableError, CableWarning, import_extra, look_up
from cc_mujoco.human import Task, Trajectory, Walk, trajectory
from cc_mujoco.human import task as find_task
from cc_mujoco.human._by_text import user_classes
from cc_mujoco.metrics import Metric, find_metric, metric_key, user_metrics

_LONGEST_TEXT = 200  # length of a trajectory's `repr` above which a digest replaces it
VALUES_KEY = "values"  # of a study's description: a digest of each variable's values
GENERATION = 32  # designs per generation of a search
PIECE = 8  # designs of a generation per batch of simulations


@dataclass(frozen=True)
class Plan:
    """Executable plan of a study."""

    protocol: EpisodeProtocol
    designs: tuple[Design, ...]
    ranges: Mapping[str, Range]  # of listed designs, the values that occur
    full: bool  # true if the designs are every combination of the ranges' levels
    batches: tuple[tuple[int, ...], ...]  # indices of designs simulated together
    search: Mapping[str, Any] | None = None  # its settings, as plain JSON
    objectives: tuple[Objective, ...] = ()  # metrics to minimise or maximise
    limits: tuple[MetricLimit, ...] = ()  # bounds that a feasible design satisfies
    evaluations: int = 0  # designs that a search evaluates

    @property
    def varied(self) -> tuple[str, ...]:
        """Variables that take more than one value."""
        used = {n: {design[n] for design in self.designs} for n in self.ranges}
        return tuple(name for name, values in used.items() if len(values) > 1)

    def describe(self) -> dict[str, Any]:
        """Describe the study as a dictionary for JSON, equal for equal studies."""
        protocol, costs = self.protocol, dict(self.protocol.costs)
        played = {
            "scene": protocol.scene,
            "trajectory": protocol.sources[0],
            "task": protocol.sources[1],
            "controllers": list(protocol.controllers),
            "duration": protocol.duration,
            "seed": protocol.seed,
            "timestep": protocol.timestep,
            "metrics": list(protocol.metrics),
            "across": {name: list(v) for name, v in protocol.across.levels},
            **({"costs": costs} if costs else {}),
            "own": {find_metric(one).name: metric_key(one) for one in protocol.own},
            "rank": protocol.across.rank,
            "turned": list(protocol.across.turned),
        }
        about: dict[str, Any] = {"protocol": played, "variables": list(self.ranges)}
        if self.search is not None:
            return about | {"search": json.loads(json.dumps(self.search))}
        values = {n: dict.fromkeys(d[n] for d in self.designs) for n in self.ranges}
        return about | {
            VALUES_KEY: {name: _digest(list(each)) for name, each in values.items()},
            "designs": len(self.designs),
            "batches": len(self.batches),
            "digest": _digest(self.designs),
        }

    def with_few_designs(self, designs: Sequence[Design]) -> "Plan":
        """Return the plan of a few other designs, in batches of eight."""
        batches = batches_of(self.protocol, dict(enumerate(designs)), 8)
        few = replace(self, designs=tuple(designs), batches=batches)
        return replace(few, full=False, search=None)

    def made_by(self) -> dict[str, Any]:
        """Return the provenance of the table: versions and digests of code."""
        protocol = self.protocol
        return code_provenance(
            *protocol.code_names, *protocol.tables, files=dict(protocol.files)
        )


def _digest(listed: Sequence[object]) -> str:
    return hashlib.sha256(json.dumps(listed).encode()).hexdigest()


def make_plan(spec: StudySpec) -> Plan:
    """Return the plan of a study; that of a search has no designs yet."""
    if spec.evaluations is not None:
        return _plan_search(spec, spec.evaluations)
    goals = read_objectives(spec.objectives)
    vary = _assigned("vary", "VARIABLE", spec.vary)
    if (not vary) == (spec.designs is None):
        raise CableError(
            f"{'neither' if not vary else 'both'} `vary` (--vary VARIABLE=VALUES) "
            f"{'nor' if not vary else 'and'} `designs` (--designs FILE) "
            f"{'is' if not vary else 'are'} given; give one of them."
        )
    rows: Sequence[Mapping[str, object]] = []
    if isinstance(spec.designs, (str, Path)):
        rows = from_file(spec.designs)
    elif spec.designs is not None:
        if isinstance(spec.designs, Mapping) or not isinstance(spec.designs, Iterable):
            raise CableError(f"designs must be a file or a list, not {spec.designs!r}.")
        each = enumerate(spec.designs)
        rows = [require_dictionary(f"design {i}", row) for i, row in each]
    variables_given = dict.fromkeys(vary or (name for row in rows[:1] for name in row))
    protocol = _make_protocol(spec, goals, variables_given)
    look_up("sampling", spec.sampling, dict.fromkeys(("grid", "lhs")))
    if (spec.sampling == "lhs") != (spec.samples is not None):
        raise CableError("sampling 'lhs' needs a number of samples, a grid has none.")
    ranges: dict[str, Range] = {}
    if spec.designs is None:
        device = protocol.device
        ranges = {name: read_range(name, v, device) for name, v in vary.items()}
        samples, seed = spec.samples, spec.seed
        rows = (
            grid(ranges) if samples is None else latin_hypercube(ranges, samples, seed)
        )
    cases = protocol.across
    cases.require_disjoint(dict.fromkeys(name for row in rows for name in row))
    require_count(len(rows) * len(cases.cases))
    checked = _check(protocol, rows)
    _require_strides(protocol, checked)
    if spec.designs is not None:
        _require_distinct(cases, checked)
        for name in checked[0]:
            ranges[name] = Range(tuple(dict.fromkeys(each[name] for each in checked)))
    measured = protocol.metrics
    return Plan(
        protocol,
        tuple(checked),
        ranges,
        spec.designs is None and spec.samples is None,
        _batches(protocol, checked),
        objectives=read_objectives(spec.objectives, measured),
        limits=read_limits(spec.subject_to, measured, cases.several),
    )


def _plan_search(spec: StudySpec, evaluations: int) -> Plan:
    if spec.designs is not None or spec.sampling != "grid" or spec.samples:
        raise CableError(
            "--optimise chooses the designs itself: give --vary, and neither "
            "--designs nor --sampling nor --samples."
        )
    sampler = f"TPE of optuna {require_optuna().__version__}"
    vary = _assigned("vary", "VARIABLE", spec.vary)
    chosen = metrics_of(spec.metrics)
    limits = read_limits(spec.subject_to, across=bool(spec.across))
    goals = read_objectives(spec.objectives)
    if not 1 <= len(goals) <= 4:
        raise CableError(
            f"a search has 1 to 4 objectives, not {len(goals)}; what need not be best "
            "but good enough is a limit (--subject-to)."
        )
    measured: tuple[Objective | MetricLimit | Metric, ...] = (*goals, *limits, *chosen)
    names = tuple(dict.fromkeys(each.name for each in measured))
    protocol = _make_protocol(replace(spec, metrics=names), goals, vary)
    if not vary:
        raise CableError("a search needs something to vary.")
    protocol.across.require_disjoint(vary)
    device = protocol.device
    ranges = {name: read_range(name, v, device) for name, v in vary.items()}
    walkers = {
        n: Range(r.ends or (min(r.levels), max(r.levels)))
        for n, r in ranges.items()
        if n in wearers.WALKER
    }
    _require_strides(protocol, grid(walkers))
    if isinstance(evaluations, int) and evaluations < 1:
        raise CableError(f"a search must try at least 1 design, not {evaluations}.")
    require_count(evaluations)
    settings = {
        "objectives": [goal.text for goal in goals],
        "subject_to": [limit.text for limit in limits],
        "ranges": {n: [list(r.levels), r.ends, r.log] for n, r in ranges.items()},
        "generation": [GENERATION, PIECE],
        "sampler": sampler,
    }
    return Plan(protocol, (), ranges, False, (), settings, goals, limits, evaluations)


def _assigned(field: str, what: str, given: Assignments) -> Mapping[str, Given]:
    """Return the values of each name, from a mapping or texts `NAME=VALUES`."""
    if not isinstance(given, (list, tuple)) or not all(
        isinstance(text, str) for text in given
    ):
        return require_dictionary(field, given)
    found: dict[str, Given] = {}
    for text in given:
        name, equals, values = text.partition("=")
        if not equals or not name or not values:
            raise CableError(f"{field}: {text!r} must be {what}=VALUES.")
        if name in found:
            raise CableError(f"{field} gives {name!r} twice.")
        found[name] = values
    return found


def require_optuna() -> Any:
    optuna = import_extra("optuna", "a search needs Optuna", "search")
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    return optuna


def _make_protocol(
    spec: StudySpec, goals: Sequence[Objective], named: Iterable[str]
) -> EpisodeProtocol:
    """Return the protocol for designs that set the variables `named`."""
    if not isinstance(spec.scene, (str, Path)):
        raise CableError(
            "a study needs the name or the file of a device, as its workers load it "
            f"themselves, not {spec.scene!r}."
        )
    is_file = is_device_file(spec.scene)
    scene = os.path.abspath(spec.scene) if is_file else str(spec.scene)
    builder = load_device(scene, spec.timestep)
    _ = builder.frame_skip  # of a time step that divides the control period
    home = builder.description
    axes = tuple(a.name for a in home.axes) if len(home.axes) > 1 else ()
    chosen = tuple(dict.fromkeys(metric.name for metric in metrics_of(spec.metrics)))
    decisive = [goal.name for goal in goals]
    decisive += [limit.name for limit in read_limits(spec.subject_to)]
    protocols.require_axes([*chosen, *decisive], axes)
    laws = require_list("controllers", spec.controllers)
    if not laws:
        raise CableError("a study needs a controller.")
    for name in laws:
        if laws.count(name) > 1:
            raise CableError(f"controller {name!r} is given twice.")
    require_number("duration", spec.duration, 0.05, MAX_DURATION, "s")
    if not (isinstance(spec.seed, int) and spec.seed >= 0):
        raise CableError(f"seed must be an integer >= 0, not {spec.seed!r}.")
    turned = [goal.name for goal in goals if goal.high != metric_of(goal.name).high]
    across = _assigned("across", "NAME", spec.across)
    cases = read_across(across, spec.rank, builder, turned)
    given_motion = home.trajectory if spec.trajectory is None else spec.trajectory
    given_tasks = protocols.tasks_of_axes(spec.task, home)
    texts = {name: _source("task", one) for name, one in given_tasks.items()}
    sources = _source("trajectory", given_motion), protocols.task_text(texts)
    motion: str | Trajectory = sources[0]
    if is_table(sources[0]) or not isinstance(given_motion, (str, Path)):
        motion = trajectory(given_motion)
    tasks: dict[str, str | Task] = {**texts}
    for axis in home.axes:
        given, text = given_tasks[axis.name], texts[axis.name]
        if is_table(text) or not isinstance(given, (str, Path)):
            tasks[axis.name] = find_task(given, home.limbs(axis))
    variables_named = {split(name)[1] for name in (*named, *cases.names)}
    for name in variables_named:
        needed = SCALES.get(name, name)
        every = [getattr(cable, needed, 1.0) for cable in builder.cables.values()]
        if name in SCALES and needed not in variables_named and not any(every):
            raise CableError(
                f"variable {name!r} has no effect: {needed} is 0; vary it, too."
            )
    _require_played(home, variables_named, sources[0], texts)
    unheld = _unheld_reason(builder)
    for name in chosen:
        metric = metric_of(name)
        if is_stride_metric(name) and not (
            sources[0] == "walk" and joints_of_gait(builder)
        ):
            raise CableError(
                f"metric {name!r} is of the strides of an assisted ankle, knee or hip; "
                f"it needs a device that drives one, as 'ankle', 'exosuit' and "
                "'bilateral' do, and the trajectory 'walk'."
            )
        if unheld and metric.test in protocols.HELD_TESTS:
            raise CableError(f"metric {name!r} holds the joints, but {unheld}.")
        if variables := protocols.missing_variables(metric, variables_named):
            ways = " or ".join(map(repr, variables))
            raise CableError(
                f"metric {name!r} needs what no scene says: give every design "
                f"{ways} (--vary, one value is enough)."
            )
    for name in dict.fromkeys(decisive):
        if fact := protocols.missing_fact(metric_of(name), variables_named, home):
            raise CableError(
                f"metric {name!r} needs {fact} of the description of {home.scene}."
            )
    if chosen and len(laws) > 1 and protocols.CONTROLLER_METRIC not in chosen:
        chosen = (*chosen, protocols.CONTROLLER_METRIC)
    usual: tuple[str, ...] = protocols.DEFAULT_METRICS
    if spec.costs is not None:
        usual = (*usual, protocols.COST_METRIC)

    def can_be_had(metric: Metric) -> bool:
        held = metric.test in protocols.HELD_TESTS
        known = not protocols.missing_variables(metric, variables_named)
        return known and not (unheld and held)

    measured = chosen or tuple(name for name in usual if can_be_had(metric_of(name)))
    # A number of one axis that decides is measured where that of all axes is.
    measured += tuple(
        name
        for name in dict.fromkeys(decisive)
        if name not in measured and protocols.split_metric(name)[1] in measured
    )
    priced = read_costs(EXAMPLE if spec.costs is None else spec.costs)
    if spec.costs is not None and protocols.COST_METRIC not in measured:
        raise CableError(
            f"costs are for the metric {protocols.COST_METRIC!r}, which is not among "
            "those measured."
        )
    protocol = EpisodeProtocol(
        scene,
        motion,
        tasks if axes else next(iter(tasks.values())),
        laws,
        spec.duration,
        spec.seed,
        float(builder.spec.option.timestep),
        measured,
        cases,
        tuple(priced.items()) if protocols.COST_METRIC in measured else (),
        user_metrics(measured),
        sources,
        axes,
        tuple(protocols.device_digests(builder).items()),
    )
    DesignJob(protocol).rehearse()
    _warn_of_pulleys(variables_named, builder)
    return protocol


def _unheld_reason(builder: Device) -> str:
    """Return why a device's joints cannot be held for a test, as a clause, or ""."""
    joints = [axis.limb for axis in builder.description.axes]
    for joint in joints:
        if joint not in builder.movers:
            return f"joint {joint!r} has no wearer to hold it: write [wearer.{joint}]"
        if joints.count(joint) > 1:
            return f"two axes drive joint {joint!r}, whose torques are one"
    return ""


def _warn_of_pulleys(named: Collection[str], builder: Device) -> None:
    def on_pulley(axis: Axis) -> bool:  # a cable winds on the joint itself
        distal = [builder.ends[cable][1] for cable in axis.cables]
        return any(end.trntype == mujoco.mjtTrn.mjTRN_JOINT for end in distal)

    axes = builder.description.axes
    motor = all(axis.motor_pulley for axis in axes)
    joint = all(axis.joint_pulley or not on_pulley(axis) for axis in axes)
    for end, is_known in (("motor", motor), ("joint", joint)):
        if f"{end}_radius" in named and not is_known:
            warnings.warn(
                f"variable '{end}_radius' leaves the inertia of the pulley as it is, "
                f"which nobody knows: write `{end}_pulley` in [axis] of the "
                f"description of {builder.name}.",
                CableWarning,
                stacklevel=2,
            )


def metrics_of(given: Sequence[str | Metric]) -> list[Metric]:
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise CableError(f"metrics must be a list of texts, not {given!r}.")
    return [protocols.metric_of_designs(one) for one in given]


def _source(kind: str, given: str | Path | Trajectory | Task) -> str:
    """Return a text that identifies a trajectory or a task in the plan's description.

    It has the parameters of objects of this package. For those of users it is a digest
    of their whole content, as the text of an array may leave numbers out.
    """
    if isinstance(given, (str, Path)):
        text = str(given)
        return os.path.abspath(text) if is_table(text) else text
    text = repr(given)
    own = not user_classes(given)
    if own and len(text) <= _LONGEST_TEXT:
        return text
    content = text.encode()
    if not own:
        try:
            content = pickle.dumps(given)
        except Exception as error:
            raise CableError(
                f"{kind} {text[:_LONGEST_TEXT]} cannot be sent to another process "
                f"({error}); a study needs one of a class in a module."
            ) from None
    return f"{type(given).__name__} {hashlib.sha256(content).hexdigest()}"


def _check(
    protocol: EpisodeProtocol, rows: Sequence[Mapping[str, object]]
) -> list[Design]:
    across, device = protocol.across, protocol.device
    checked: list[Design] = []
    wrong: list[tuple[int, str]] = []
    for index, row in enumerate(rows):
        try:
            checked.append(across.check(device, row))
        except CableError as error:
            wrong.append((index, str(error).rstrip(".")))
    if wrong:
        index, why = wrong[0]
        which = f"design {index} ({across.label(rows[index])})"
        many = f" ({len(wrong)} of {len(rows)} are impossible)"
        raise CableError(f"{which} is impossible: {why}{many if wrong[1:] else ''}.")
    if not checked:
        raise CableError("there are no designs.")
    return checked


def _require_distinct(across: Across, designs: Sequence[Design]) -> None:
    """Refuse duplicate designs, which would count twice in all ranks."""
    seen: dict[tuple[object, ...], int] = {}
    for index, design in enumerate(designs):
        first = seen.setdefault(tuple(design.items()), index)
        if first != index:
            raise CableError(
                f"designs {first} and {index} (counted from 0) are the same, "
                f"{across.label(design)}; give each once."
            )


def _batches(
    protocol: EpisodeProtocol, designs: Sequence[Design]
) -> tuple[tuple[int, ...], ...]:
    """Group designs of equal layout into batches, at least eight if there are enough.

    They do not depend on the machine, so that another one can continue the study.
    """
    about, longest = protocol.device.description, max(protocol.duration, CHIRP_TIME)
    steps = longest / about.period * len(about.axes)
    # A batch may keep 250 MB, and a design keeps 150 bytes per control step.
    capacity = int(250e6 / 150.0 / steps)
    # Of 256 designs together Python's share is small; eight batches keep workers busy.
    size = max(1, min(256, capacity, math.ceil(len(designs) / 8)))
    return batches_of(protocol, dict(enumerate(designs)), size)


def batches_of(
    protocol: EpisodeProtocol, designs: Mapping[int, Design], size: int
) -> tuple[tuple[int, ...], ...]:
    """Return batches of at most `size` design numbers of equal layout."""
    across, device = protocol.across, protocol.device
    layouts: dict[tuple[object, ...], list[int]] = {}
    for index, design in designs.items():
        layouts.setdefault(across.layout(device, design), []).append(index)
    pieces = (m[i : i + size] for m in layouts.values() for i in range(0, len(m), size))
    return tuple(map(tuple, pieces))


def _require_played(
    device: Description,
    names: Collection[str],
    trajectory: str,
    tasks: Mapping[str, str],
) -> None:
    """Refuse variables of a walk or a torque profile that the study does not play."""
    wearers.require_scene(device, names)
    for name in ("gait_speed", "leg_length"):
        if name in names and trajectory != "walk":
            raise CableError(
                f"variable {name!r} is of trajectory 'walk', but the study plays "
                f"{trajectory!r}."
            )
    helped = wearers.helped_axis(device)
    for name in wearers.PROFILE:
        task = "" if helped is None else tasks[helped.name]
        if name in names and task.partition(":")[0] != "assist":
            raise CableError(
                f"variable {name!r} is of task 'assist', but the study plays {task!r}."
            )


def _require_strides(
    protocol: EpisodeProtocol, designs: Iterable[Mapping[str, Value]]
) -> None:
    """Refuse metrics of strides if episodes are too short for the slowest walk."""
    stride_metrics = [name for name in protocol.metrics if is_stride_metric(name)]
    if not stride_metrics:
        return
    walkers = {tuple((n, d[n]) for n in wearers.WALKER if n in d) for d in designs}
    period = protocol.device.description.period
    for case in protocol.across.cases:
        ends = []
        for walker in walkers:
            with contextlib.suppress(CableError):  # impossible; reported elsewhere
                design = {**dict(walker), **case}
                walk = Walk.at(wearers.speed_of(design), wearers.body_of(design))
                # At full cadence all along. By the end of the start half of it has been
                # walked; one sample tells the strike.
                ends.append(0.5 * walk.start + 2.0 * walk.period + period)
        if ends and max(ends) > protocol.duration:
            slowest = " of who walks slowest" if len(set(ends)) > 1 else ""
            raise CableError(
                f"metric {stride_metrics[0]!r} is of whole strides, of which the "
                f"first{slowest} ends {max(ends):.4g} s after the start; the episode "
                f"of {protocol.duration:g} s must be longer."
            )
