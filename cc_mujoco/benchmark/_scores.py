"""Metrics of an episode of the benchmark.

Every axis of a device has its own scores, under `AXIS.NAME` where there are several.
Then a score of the device is the mean over its axes, as its reward is, but an episode
has failed if any axis has.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.metrics import METRICS

SCORES = tuple(
    METRICS[name]
    for name in (
        "rms_torque_error", "peak_torque_error", "torque_lag", "spring_backlash",
        "rms_motor_torque", "peak_motor_torque", "chatter", "slack_under_load",
        "failed",
    )
)  # fmt: skip
"""All scores of an episode, in the order of tables; the nearer to 0, the better."""

ANGLE_SCORES = tuple(
    METRICS[name]
    for name in (
        "rms_angle_error", "peak_angle_error", "rms_motor_torque",
        "peak_motor_torque", "chatter", "failed",
    )
)  # fmt: skip
"""Scores of an episode whose task commands an angle."""

SAFETY_SCORES = (METRICS["peak_over_safe"], *SCORES)
"""Scores of an episode with a fault of a sensor or a strap."""

EVERY_SCORE = tuple(dict.fromkeys((*ANGLE_SCORES[:2], *SAFETY_SCORES)))
"""All, in the order of tables."""

ERRORS = "peak_over_safe", "rms_torque_error", "rms_angle_error"
"""Scores by which controllers are ranked: of a fault, of a torque, or of a commanded
angle."""


def ranked_score(names: Iterable[str]) -> str:
    """Return the score by which results with these columns are ranked."""
    return next(error for error in ERRORS if error in names)


def score_columns(names: Sequence[str]) -> list[str]:
    """Return the names that are scores, of a device or an axis."""
    known = {score.name for score in EVERY_SCORE}
    return [name for name in names if name.rpartition(".")[2] in known]


def axis_errors(columns: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the RMS errors of every axis, (seeds, axes), from scores (seeds,)."""
    error = ranked_score(columns)
    of_axes = [n for n in columns if n.endswith(f".{error}")] or [error]
    return np.stack([np.asarray(columns[name]) for name in of_axes], axis=-1)
