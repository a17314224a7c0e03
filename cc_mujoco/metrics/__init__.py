"""Metrics: one table of the numbers of an episode or a design, with unit and meaning.

    METRICS["rms_torque_error"].compute(log)            # [N m]
    METRICS["rms_torque_error"].better                  # "low"

`play`, what-ifs, the benchmark and their pages choose from this table. A metric of the
user is a `Metric`, or `MODULE:NAME` of one on the command line.
"""

from __future__ import annotations

from cc_mujoco.metrics.metric import ArrayLog, LogLike, Metric
from cc_mujoco.metrics.table import (
    METRICS,
    find_metric,
    known_by,
    measure,
    of_cables,
    own_metrics,
)

__all__ = [
    "METRICS",
    "ArrayLog",
    "LogLike",
    "Metric",
    "find_metric",
    "known_by",
    "measure",
    "of_cables",
    "own_metrics",
]
