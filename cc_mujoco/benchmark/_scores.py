"""Metrics that an episode of the benchmark is judged by."""

from __future__ import annotations

import math

import numpy as np

from cc_mujoco.metrics import METRICS, LogLike, measure

SCORES = tuple(
    METRICS[name]
    for name in (
        "rms_torque_error",
        "peak_torque_error",
        "torque_lag",
        "spring_backlash",
        "rms_motor_torque",
        "chatter",
        "slack_under_load",
        "failed",
    )
)
"""All scores of an episode, in the order of tables; the nearer to 0, the better."""


def episode_scores(log: LogLike) -> dict[str, float]:
    """Return the scores of an episode by name, NaN where it has none.

    An episode that diverged has none but `failed`.
    """
    whole = bool(np.all(np.isfinite(log["joint_torque_nm"])))
    measured = measure(log, (s for s in SCORES if whole or s.name == "failed"))
    return {s.name: measured.get(s, math.nan) for s in SCORES}
