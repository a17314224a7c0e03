"""Protocol by which designs are evaluated, and metrics with their columns.

A protocol is the episode of a study and, if a metric needs them, tests of the hardware
alone; see `_evaluation`.

For a device with several axes, `NAME` is a metric of the worst axis: its largest number
over the axes, or its least if more is better. `AXIS.NAME` is that of one axis. A design
without a number for one axis has none for `NAME`.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cc_mujoco._utils.provenance import file_digests
from cc_mujoco.design._scenarios import LEAST_SUFFIX, MOST_SUFFIX, Across
from cc_mujoco.device import Description, Device, load_device
from cc_mujoco.device._axis_columns import split_by_axis
from cc_mujoco.device._variables import VARIABLES
from cc_mujoco.errors import CableError
from cc_mujoco.human import Task, Trajectory
from cc_mujoco.human._by_text import user_classes
from cc_mujoco.metrics import METRICS, Metric, find_metric
from cc_mujoco.metrics._metric import Key

DEFAULT_METRICS = (
    "efficiency", "held_backlash", "rms_torque_error", "peak_wearer_torque",
    "wearer_power", "peak_torque_rate", "peak_motor_torque", "peak_motor_power",
    "rms_motor_torque", "thermal_load", "motor_heat", "electrical_power",
    "slack_margin", "slack_share", "peak_tension", "strength_used", "reflected_torque",
    "bandwidth", "response", "reflected_inertia", "cable_mass", "mass", "bend_ratio",
    "bending_stress",
)  # fmt: skip
"""Metrics that are measured by default, if designs have them."""
DEFAULT_OBJECTIVES = ("rms_torque_error", "reflected_torque", "rms_motor_torque")
"""Metrics that rank designs where no objective is given, of those that were measured:
tracking of the task, resistance without power, size of the motor."""
HELD_TESTS = ("backlash", "bandwidth")
COST_METRIC = "cost"  # metric that a table of costs is for
CONTROLLER_METRIC = "rms_torque_error"  # the least selects one of several controllers
_OF_MOTOR = ("motor_mass", Key.CONTINUOUS_TORQUE, Key.WINDING_RESISTANCE,
             Key.TORQUE_CONSTANT)  # fmt: skip
REQUIRED_VARIABLES = {
    "material": ("material",),
    "rope_density": ("material", "rope_density"),
    **{name: ("motor", name) for name in _OF_MOTOR},
}
"""Variables by the constant that they give: a metric that needs it needs designs with
one of them, since no scene has it."""


@dataclass(frozen=True)
class EpisodeProtocol:
    """Protocol by which each design of a study is simulated and measured."""

    scene: str  # name of a built-in device, or path of the file of another
    trajectory: str | Trajectory  # text, or what a table holds
    task: str | Task | Mapping[str, str | Task]  # likewise; of several axes by name
    controllers: tuple[str, ...]  # of the motors, each in an episode of its own
    duration: float  # length of the episode [s]
    seed: int
    timestep: float  # time step of the physics [s]
    metrics: tuple[str, ...]  # names of `METRICS`, also `AXIS.NAME` of several axes
    across: Across = Across()  # noqa: RUF009 - cases over which a design is judged
    costs: tuple[tuple[str, float], ...] = ()  # of each part, where that is measured
    own: tuple[str | Metric, ...] = ()  # metrics of the user among them, as given
    # Trajectory and task as given, the path of a table, or description of an object.
    sources: tuple[str, str] = ("", "")
    axes: tuple[str, ...] = ()  # names of the axes where there are several
    files: tuple[tuple[str, str], ...] = ()  # names and digests that define the scene

    @property
    def device(self) -> Device:
        """Device of the study, which designs change; its files must not change."""
        device = load_device(self.scene, self.timestep)
        now, then = device_digests(device), dict(self.files)
        for name in {**then, **now}:
            if now.get(name) != then.get(name):
                raise CableError(
                    f"{name} of the scene {self.scene} changed while the study ran; "
                    "its designs would be of two devices: run it again with --again."
                )
        return device

    def find_metrics(self) -> None:
        for given in self.own:
            find_metric(given)

    @property
    def code_names(self) -> tuple[str, ...]:
        """Names of user code whose provenance the results depend on."""
        played = []
        several = self.task.values() if isinstance(self.task, Mapping) else [self.task]
        for given in (self.trajectory, *several):
            if isinstance(given, str):
                played.append(given)
            else:
                played += user_classes(given)
        laws = split_axes(self.controllers, self.axes)
        metrics = [one for one in self.own if isinstance(one, str)]
        return (*laws, *metrics, *played)

    @property
    def tables(self) -> tuple[str, ...]:
        """Texts that identify trajectory and tasks, one for each axis."""
        return split_axes(self.sources, self.axes)


def device_digests(device: Device) -> dict[str, str]:
    """Return digests of the user's files that define a device, by file name."""
    folder = device.files[0].parent if device.files else Path()
    return file_digests(device.files, folder)


def tasks_of_axes(
    task: str | Path | Task | None, device: Description
) -> dict[str, str | Path | Task]:
    """Return the task of every axis by its name.

    `task` is one for all axes, or a text such as `hip=swing,ankle=assist`. An axis that
    it does not name keeps the device's task; so do all if `task` is None.
    """
    own: dict[str, str | Path | Task] = {axis.name: axis.task for axis in device.axes}
    if task is None:
        return own
    given = split_by_axis(task, own) if isinstance(task, str) else task
    return own | given if isinstance(given, dict) else dict.fromkeys(own, given)


def task_text(tasks: Mapping[str, str]) -> str:
    """Return a text with the tasks of all axes, which `tasks_of_axes` can read."""
    if len(tasks) == 1:
        return next(iter(tasks.values()))
    return ",".join(f"{name}={task}" for name, task in tasks.items())


def split_axes(texts: Iterable[str], axes: Iterable[str]) -> tuple[str, ...]:
    """Return the texts, with ones such as `hip=pi,ankle=model` split into values."""
    names = tuple(axes)
    found: list[str] = []
    for text in texts:
        parts = split_by_axis(text, names)
        found += parts.values() if isinstance(parts, dict) else [parts]
    return tuple(found)


def split_metric(name: str) -> tuple[str, str]:
    """Return axis and metric of `AXIS.NAME`; the axis of `NAME` is ""."""
    axis, _, own = name.rpartition(".")
    return axis, own


def known_metric(name: str) -> Metric | None:
    """Return the metric of a column `NAME` or `AXIS.NAME`; None if it is no metric."""
    axis, own = split_metric(name)
    found = METRICS.get(own)
    if found is None or not axis:
        return found
    return replace(found, name=name, meaning=f"{axis}: {found.meaning}")


def metric_of(name: str) -> Metric:
    """Return the metric of a column `NAME` or `AXIS.NAME`, which must exist."""
    found = known_metric(name)
    if found is None:
        raise KeyError(name)
    return found


def metric_of_designs(given: str | Metric) -> Metric:
    axis = ""
    if isinstance(given, str) and ":" not in given:
        axis, given = split_metric(given)
    metric = find_metric(given)
    if metric.name in ("design", "failed", "controller", "wearer", *VARIABLES):
        raise CableError(
            f"metric {metric.name!r} cannot be measured in a what-if, whose table "
            "has another column of that name."
        )
    if metric.per_cable:
        raise CableError(
            f"metric {metric.name!r} is of each cable; a what-if needs one that is of "
            "the design."
        )
    if axis and not metric.of_axis:
        raise CableError(
            f"metric {metric.name!r} is of the device as a whole; write "
            f"{metric.name!r}, not '{axis}.{metric.name}'."
        )
    return metric_of(f"{axis}.{metric.name}") if axis else metric


def require_axes(names: Sequence[str], axes: Sequence[str]) -> None:
    for name in names:
        axis, own = split_metric(name)
        if axis and not axes:
            raise CableError(
                f"metric {name!r} names an axis, but the device has only one; write "
                f"{own!r}."
            )
        if axis and axis not in axes:
            raise CableError.unknown("axis", axis, axes)


def missing_variables(metric: Metric, names: Collection[str]) -> tuple[str, ...]:
    """Return variables of which a metric needs one that `names` lacks; else ()."""
    for key in metric.needs:
        ways = REQUIRED_VARIABLES.get(key, ())
        if ways and not any(name in names for name in ways):
            return ways
    return ()


def missing_fact(
    metric: Metric, names: Collection[str], device: Description
) -> str | None:
    """Return, as a clause, what a metric needs and the device lacks; else None."""
    rope = math.isnan(device.diameter) and "diameter" not in names
    own = metric.name.rpartition(".")[2]
    if own in ("cable_mass", "mass", "bend_ratio", "bending_stress") and rope:
        return "the diameter of the rope: write `diameter` in [rope]"
    if Key.STRENGTH in metric.needs and math.isnan(device.strength):
        if not {"strength", "material"} & set(names):
            return "the breaking load of the rope: write `strength` in [rope]"
    if own == "mass" and not all(axis.motor_pulley for axis in device.axes):
        return "the inertia of the drum: write `motor_pulley` in [axis]"
    return None


def is_stride_metric(name: str) -> bool:
    """Return whether a metric is measured over the strides of a walking joint."""
    return Key.PACE in metric_of(name).needs


def by_axis(protocol: EpisodeProtocol) -> dict[str, str]:
    """Return the metric of each column `AXIS.METRIC`; {} for one axis."""
    names = (n for n in protocol.metrics if "." not in n and METRICS[n].of_axis)
    columns = {f"{axis}.{name}": name for name in names for axis in protocol.axes}
    return {c: name for c, name in columns.items() if c not in protocol.metrics}


def over_axes(
    protocol: EpisodeProtocol, found: Mapping[str, float]
) -> dict[str, float]:
    """Return each metric of the worst axis, from `AXIS.METRIC` in `found`."""
    worst = {}
    for name in protocol.metrics:
        each = [found[n] for a in protocol.axes if (n := f"{a}.{name}") in found]
        if each:
            end = min if wants_high(protocol, name) else max
            worst[name] = math.nan if any(map(math.isnan, each)) else end(each)
    return worst


def by_controller(protocol: EpisodeProtocol) -> dict[str, tuple[str, str]]:
    """Return metric and controller of each column `METRIC@CONTROLLER`, {} for one."""
    if len(protocol.controllers) == 1:
        return {}
    driven = [name for name in protocol.metrics if metric_of(name).driven]
    pairs = ((name, law) for law in protocol.controllers for name in driven)
    return {f"{name}@{law}": (name, law) for name, law in pairs}


def by_case(protocol: EpisodeProtocol) -> dict[str, str]:
    """Return the metric of each column `METRIC@least` or `METRIC@most` over cases."""
    if not protocol.across.several:
        return {}
    ends = (LEAST_SUFFIX, MOST_SUFFIX)
    return {f"{name}@{end}": name for name in protocol.metrics for end in ends}


def number_columns(protocol: EpisodeProtocol) -> tuple[str, ...]:
    more = (*by_axis(protocol), *by_controller(protocol), *by_case(protocol))
    return (*protocol.metrics, *more)


def wants_high(protocol: EpisodeProtocol, name: str) -> bool:
    own = name.rpartition(".")[2]
    turned = not {name, own}.isdisjoint(protocol.across.turned)
    return METRICS[own].high != turned
