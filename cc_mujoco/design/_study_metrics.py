"""Metrics of a study: the possible ones, their columns and their records."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from cc_mujoco.design._protocol import EpisodeProtocol
from cc_mujoco.design._scenarios import LEAST_SUFFIX, MOST_SUFFIX
from cc_mujoco.device._variables import VARIABLES, WEARER
from cc_mujoco.errors import CableError
from cc_mujoco.metrics import METRICS, ArrayLog, Metric, find_metric
from cc_mujoco.metrics._metric import (
    CONTINUOUS_TORQUE,
    DRIVEN,
    PACE,
    RATIO,
    TORQUE_CONSTANT,
    WINDING_RESISTANCE,
)
from cc_mujoco.simulation._rollout import Rollout

DEFAULT_METRICS = (
    "efficiency",
    "held_backlash",
    "rms_torque_error",
    "peak_wearer_torque",
    "wearer_power",
    "peak_torque_rate",
    "peak_motor_torque",
    "peak_motor_power",
    "rms_motor_torque",
    "thermal_load",
    "motor_heat",
    "electrical_power",
    "slack_margin",
    "slack_share",
    "peak_tension",
    "strength_used",
    "reflected_torque",
    "bandwidth",
    "response",
    "reflected_inertia",
    "cable_mass",
    "mass",
    "bend_ratio",
    "bending_stress",
)
"""Metrics that are measured where none is chosen, of designs that have them."""
DEFAULT_OBJECTIVES = ("rms_torque_error", "reflected_torque", "rms_motor_torque")
"""Metrics that rank designs where no objective is given, of those that were measured:
how well the task is done, how the device feels without power, how large its motor is.
"""
COST_METRIC = "cost"
"""Metric that a table of costs is for."""
CONTROLLER_METRIC = "rms_torque_error"
"""Metric that is least with the best of several controllers."""
REQUIRED_VARIABLES = {
    "material": ("material",),
    "rope_density": ("material", "rope_density"),
    "motor_mass": ("motor", "motor_mass"),
    **{
        k: ("motor", k)
        for k in (CONTINUOUS_TORQUE, WINDING_RESISTANCE, TORQUE_CONSTANT)
    },
}
"""Variables of which a design must have one for a metric that needs this constant,
since no scene has it."""
_RESERVED_COLUMNS = {"design", "failed", "controller", WEARER.name, *VARIABLES}
"""Columns of a table that are no metrics."""


def metric_of_designs(given: str | Metric) -> Metric:
    """Return a metric that the designs of a study can have.

    Raises:
        CableError: There is no such metric, or it is of no design.
    """
    metric = find_metric(given)
    if metric.name in _RESERVED_COLUMNS:
        raise CableError(
            f"metric {metric.name!r} cannot be measured in a what-if, whose table "
            "has another column of that name."
        )
    if metric.per_cable:
        raise CableError(
            f"metric {metric.name!r} is of each cable; a what-if needs one that is of "
            "the design."
        )
    return metric


def missing_variables(metric: Metric, names: Collection[str]) -> tuple[str, ...]:
    """Return variables of which designs with these names lack one; () if none."""
    for key in metric.needs:
        ways = REQUIRED_VARIABLES.get(key, ())
        if ways and not any(name in names for name in ways):
            return ways
    return ()


def is_stride_metric(name: str) -> bool:
    """Return whether a metric is of the strides of a joint that walks."""
    return PACE in METRICS[name].needs


def by_controller(protocol: EpisodeProtocol) -> dict[str, tuple[str, str]]:
    """Return the columns of the metrics for each of several controllers.

    Returns:
        Metric and controller by name of the column, `METRIC@CONTROLLER`; nothing where
        there is one controller.
    """
    if len(protocol.controllers) == 1:
        return {}
    return {
        f"{name}@{law}": (name, law)
        for law in protocol.controllers
        for name in protocol.metrics
        if METRICS[name].driven
    }


def by_case(protocol: EpisodeProtocol) -> dict[str, str]:
    """Return the columns of least and greatest number over the cases of a design.

    Returns:
        Metric by name of the column; nothing where there are no cases.
    """
    if not protocol.across.several:
        return {}
    ends = (LEAST_SUFFIX, MOST_SUFFIX)
    return {f"{name}@{end}": name for name in protocol.metrics for end in ends}


def number_columns(protocol: EpisodeProtocol) -> tuple[str, ...]:
    """Return the columns of all numbers that a design has."""
    return (*protocol.metrics, *by_controller(protocol), *by_case(protocol))


def wants_high(protocol: EpisodeProtocol, name: str) -> bool:
    """Return whether more of a metric is better in a study."""
    return METRICS[name].high != (name in protocol.across.turned)


def record_of(
    played: Rollout, index: int, cables: tuple[str, ...], facts: Mapping[str, Any]
) -> ArrayLog:
    """Return one design of a batch in the shape of an episode log.

    The tension of nodes is that of the node with least (T, 1).
    """
    columns = {name: values[index] for name, values in played.columns.items()}
    lost, ends, least = (
        columns.pop(name) for name in ("dissipated_j", "tension_n", "least_tension_n")
    )
    for place, cable in enumerate(cables):
        columns[f"dissipated_{cable}_j"] = lost[place]
        columns[f"tension_{cable}_proximal_n"] = ends[2 * place]
        columns[f"tension_{cable}_distal_n"] = ends[2 * place + 1]
        nodes = np.maximum(least[place], 0.0)[:, None]
        columns[f"tension_{cable}_nodes_n"] = nodes
    ratio = float(played.ratio[index])
    return ArrayLog(columns, cables, {RATIO: ratio, DRIVEN: played.driven, **facts})
