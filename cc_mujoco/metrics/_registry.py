"""Table of all metrics, built-in ones and those of users.

    METRICS["rms_torque_error"].compute(log)       # of an `EpisodeLog` or `ArrayLog`
    find_metric("my_module:PEAK_ANGLE")            # a `Metric` of the user
    measure(log, [METRICS["efficiency"]])          # value by metric

A value that an episode does not define is NaN.
"""

import hashlib
import inspect
import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from numbers import Real
from pathlib import Path
from typing import cast

import numpy as np

from cc_mujoco._utils.csv_files import read_sheet
from cc_mujoco._utils.user_code import named_object, user_errors
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.human import Pace
from cc_mujoco.human._gait import GAIT_MOMENTS, GaitJoint
from cc_mujoco.metrics import _formulas as torque
from cc_mujoco.metrics._metric import (
    Better,
    Key,
    LogLike,
    Metric,
    Test,
    driven_cables,
    metadata_constant,
    peak,
    rms,
)
from cc_mujoco.native import FloatArray as Array

ANKLE = GaitJoint("ankle", "ankle")
"""Joint whose strides are measured where the metadata name none."""


def stride_metrics(log: LogLike) -> dict[str, float]:
    """Return numbers of the assisted joint over an episode's whole strides, by name.

    Strides go from heel strike to heel strike. The first, in which the walk begins, is
    left out. Without a stride the result is {}.

    The scripted wearer is a spring and a damper to the measured motion, on a leg that
    swings free of the floor, so its force does not show the effort that help would
    save. The muscles' work is computed from the measured walk instead: joint moment by
    inverse dynamics less the cables' torque, times the joint velocity. This holds while
    motion and total moment are those without help, which people change; and work is not
    metabolic cost.
    """
    if Key.PACE not in log.metadata:
        return {}
    pace: Pace = log.metadata[Key.PACE]
    size = log.metadata.get(Key.MOMENT_RATIO, 1.0)
    time = log["time_s"]
    phase = np.mod(np.arctan2(log["phase_sine"], log["phase_cosine"]) / math.tau, 1.0)
    strikes = np.flatnonzero(np.diff(phase) < -0.5) + 1
    if strikes.size < 2:
        return {}
    step, count = float(time[1] - time[0]), strikes.size - 1
    whole = slice(int(strikes[0]), int(strikes[-1]))
    phase, given = phase[whole], log["joint_torque_nm"][whole]
    meant = np.gradient(log["reference_angle_rad"], step)[whole]
    joint: GaitJoint = log.metadata.get(Key.GAIT_JOINT, ANKLE)
    own = size * pace.moment(joint.part) * GAIT_MOMENTS[joint.part](pace.phase(phase))
    if joint.turned:
        own = -own
    desired = log["desired_torque_nm"][whole]
    helps = -1.0 if -desired.min() >= desired.max() else 1.0

    def work(torque: Array, velocity: Array) -> float:
        return float(np.sum(np.maximum(torque * velocity, 0.0))) * step / count

    alone, helped = work(own, meant), work(own - given, meant)
    swing = phase > pace.toe_off
    return {
        "wearer_work": helped,
        "wearer_work_change": (helped - alone) / alone,
        "assistance_work": work(given, log["joint_velocity_rad_s"][whole]),
        "peak_assistance": float(np.max(helps * given)),
        "torque_rate": torque.peak_rate(given, step),
        "swing_torque": float(np.max(np.abs(given[swing]))),
    }


def _built_in() -> Iterator[Metric]:
    """Yield the metrics of `metrics.csv` with their formulas.

    One without a formula here is a constant of a design, in the metadata under its
    name.
    """
    formulas: dict[str, Callable[..., float]] = {
        "rms_torque_error": lambda log: rms(torque.torque_error(log)),
        "peak_torque_error": lambda log: peak(torque.torque_error(log)),
        "torque_lag": torque.torque_lag,
        "rms_angle_error": lambda log: rms(torque.angle_error(log)),
        "peak_angle_error": lambda log: peak(torque.angle_error(log)),
        "peak_joint_torque": lambda log: peak(log["joint_torque_nm"]),
        "peak_over_safe": lambda log: (
            peak(log["joint_torque_nm"]) / metadata_constant(log, Key.SAFE_TORQUE)
        ),
        "unstable": lambda log: float(
            torque.is_unstable(log, log.metadata.get(Key.SAFE_TORQUE, math.inf))
        ),
        "rms_joint_torque": lambda log: rms(log["joint_torque_nm"]),
        "peak_wearer_torque": lambda log: peak(log["wearer_torque_nm"]),
        "wearer_power": lambda log: torque.mean_positive(
            log["wearer_torque_nm"] * log["joint_velocity_rad_s"]
        ),
        "peak_torque_rate": lambda log: torque.peak_rate(
            log["joint_torque_nm"], float(log["time_s"][1] - log["time_s"][0])
        ),
        "reflected_torque": lambda log: rms(log["joint_torque_nm"]),
        "peak_motor_torque": lambda log: peak(log["motor_torque_nm"]),
        "rms_motor_torque": lambda log: rms(log["motor_torque_nm"]),
        "chatter": lambda log: torque.ripple(
            log["motor_torque_nm"], torque.period_of(log)
        ),
        "peak_motor_power": lambda log: float(np.max(torque.motor_power(log))),
        "thermal_load": torque.thermal_load,
        "motor_heat": lambda log: float(np.mean(torque.motor_heat(log))),
        "electrical_power": lambda log: torque.mean_positive(
            torque.motor_power(log) + torque.motor_heat(log)
        ),
        "efficiency": lambda log: torque.efficiency(log).overall,
        "efficiency_motor_drives": lambda log: torque.efficiency(log).motor_drives,
        "efficiency_wearer_drives": lambda log: torque.efficiency(log).wearer_drives,
        "motor_share": lambda log: torque.efficiency(log).motor_share,
        "dissipated_energy_{cable}": lambda log, cable: float(
            np.diff(log[f"dissipated_{cable}_j"]).sum()
        ),
        "twist_backlash": torque.twist_backlash,
        "spring_backlash": torque.spring_backlash,
        "held_backlash": torque.held_backlash,
        "slack_margin": lambda log: float(torque.least_tension(log).min()),
        "slack_share": lambda log: float(np.mean(torque.least_tension(log) <= 0.0)),
        "slack_under_load": torque.slack_under_load,
        "slack_time_{cable}": torque.slack_time,
        "peak_tension": lambda log: max(
            torque.peak_tension(log, cable) for cable in driven_cables(log)
        ),
        "strength_used": torque.strength_used,
        "failed": torque.failed,
        "bandwidth": torque.bandwidth,
        "response": lambda log: float(torque.torque_response(log)[1][0]),
    }
    strides = ("wearer_work", "wearer_work_change", "assistance_work",
               "peak_assistance", "torque_rate", "swing_torque")  # fmt: skip
    for name in strides:
        formulas[name] = lambda log, name=name: stride_metrics(log).get(name, math.nan)
    for row in read_sheet(Path(__file__).with_name("metrics.csv")).rows:
        name, unit, better, test, needs, meaning = row.cells
        compute = formulas.get(name)
        yield Metric(
            name,
            unit,
            meaning,
            compute or partial(metadata_constant, key=name),
            cast("Better", better.strip("-")),
            cast("Test", test),
            tuple(needs.split()),
            whole=not compute and name != "reflected_inertia",
        )


METRICS: dict[str, Metric] = {metric.name: metric for metric in _built_in()}
"""Every metric by name, those of the user once `find_metric` has found them."""

_built_in_names = frozenset(METRICS)
_origins: dict[str, str | Metric] = {}
"""Metrics of the user as they were given, by name."""


def find_metric(given: str | Metric) -> Metric:
    """Return a metric by name or by `MODULE:NAME` of a user's, or the metric given.

    A user's metric is added to `METRICS`. Raises `CableError` if it is unknown or its
    name cannot be that of a column.
    """
    found: object = given
    if isinstance(given, str):
        if ":" not in given:
            return look_up("metric", given, METRICS)
        found = named_object("metric", given, "metric")
    if not isinstance(found, Metric):
        raise CableError(
            f"metric {given!r} must be a Metric(name, unit, meaning, compute), not "
            f"{found!r}."
        )
    if METRICS.get(found.name) is found and found.name in _built_in_names:
        return found
    if not re.fullmatch(r"[^\W\d]\w*", found.name) or found.name in _built_in_names:
        raise CableError(
            f"metric {given!r} is called {found.name!r}; it needs a name of letters, "
            "digits and _ that no metric of the package has."
        )
    # `MODULE:NAME` of one that is in the module of its function
    place = getattr(found.compute, "__module__", "")
    inside = vars(sys.modules[place]) if place in sys.modules else {}
    names = (name for name, value in inside.items() if value is found)
    name = "" if place == "__main__" else next(names, "")
    _origins[found.name] = f"{place}:{name}" if name else given
    METRICS[found.name] = found
    return found


def user_metrics(names: Iterable[str]) -> tuple[str | Metric, ...]:
    """Return the users' metrics among `names`, as `MODULE:NAME` or as given."""
    return tuple(_origins[name] for name in names if name in _origins)


def metric_key(given: str | Metric) -> str:
    """Return a text that identifies a user's metric across runs.

    It is its `MODULE:NAME`, else a digest of its source code, else (without source) of
    the object's identity, which lasts for this process only.
    """
    if isinstance(given, str):
        return given
    try:
        source = inspect.getsource(given.compute)
    except (OSError, TypeError):
        source = str(id(given))
    about = repr((given.unit, given.meaning, given.better, given.test, source))
    return hashlib.sha256(about.encode()).hexdigest()[:24]


def expand_cable_metrics(
    metrics: Iterable[Metric], cables: Iterable[str]
) -> list[Metric]:
    """Return the metrics, those of a cable once for every cable, in a block."""
    metrics = tuple(metrics)
    each = [metric for metric in metrics if metric.per_cable]
    found = [metric for metric in metrics if not metric.per_cable]
    return found + [metric.of(cable) for cable in cables for metric in each]


def measure(log: LogLike, metrics: Iterable[Metric]) -> dict[Metric, float]:
    """Return the value of each metric for an episode.

    Raises `CableError` if a user's metric raises or gives no real number.
    """
    found: dict[Metric, float] = {}
    for metric in metrics:
        with user_errors(f"metric {metric.name!r}"):
            value = metric.compute(log)
        if not isinstance(value, Real):
            raise CableError(f"metric {metric.name!r} gave {value!r}, not a number.")
        found[metric] = float(value)
    return found


def measure_axes(
    log: LogLike, metrics: Iterable[Metric]
) -> Iterator[tuple[str, Metric, float]]:
    """Yield (axis, metric, value) for every number of an episode.

    Metrics of one axis come first, axis by axis. The axis is "" if the device has only
    one, and for metrics of a cable or of the device as a whole.

    Args:
        log: Log of an episode; one of several axes is an `EpisodeLog`.
        metrics: Metrics, those of cables as `expand_cable_metrics` gives them.
    """
    rest, axes = list(metrics), getattr(log, "axes", ())
    each = [metric for metric in rest if axes and metric.of_axis]
    rest = [metric for metric in rest if not (axes and metric.of_axis)]
    for axis in axes:
        own: LogLike = log.axis(axis)  # type: ignore[attr-defined]
        yield from ((axis, *pair) for pair in measure(own, each).items())
    yield from (("", *pair) for pair in measure(log, rest).items())
