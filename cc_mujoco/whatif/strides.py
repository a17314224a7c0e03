"""What the ankle of a walking wearer gets and gives, stride by stride.

The scripted wearer is a spring and a damper to the measured motion, on a leg that
swings free of the floor: what it resists with says nothing of what it would save. So
the work of the muscles is worked out beside the simulation: the moment of the ankle of
the measured walk, by inverse dynamics, less the torque that the cables gave, at the
velocity of the measured walk. That holds while motion and moment in all stay as they
were without help, which people change; and work is not metabolic cost.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.human import Pace
from cc_mujoco.human.gait import ANKLE_MOMENT
from cc_mujoco.recording.metrics import Samples

Array = NDArray[np.float64]

RATE_TIME = 0.01
"""Over which the rate of a torque is taken [s]."""


def measure_strides(log: Samples, pace: Pace, size: float = 1.0) -> dict[str, float]:
    """The metrics of the ankle over the whole strides of an episode.

    Args:
        log: of an episode in which the ankle walks.
        pace: how fast.
        size: of the moment over that of the wearer of the scene, see `Body.moment`.

    Returns:
        By name of the metric. Strides go from heel strike to heel strike, the first,
        in which the walk begins, left out; of an episode without one all are NaN.
    """
    time = log["time_s"]
    phase = np.mod(np.arctan2(log["phase_sine"], log["phase_cosine"]) / math.tau, 1.0)
    strikes = np.flatnonzero(np.diff(phase) < -0.5) + 1
    if strikes.size < 2:
        return dict.fromkeys(NAMES, math.nan)
    step, strides = float(time[1] - time[0]), strikes.size - 1
    whole = slice(int(strikes[0]), int(strikes[-1]))
    phase, given = phase[whole], log["joint_torque_nm"][whole]
    meant = np.gradient(log["reference_angle_rad"], step)[whole]
    own = size * pace.moment("ankle") * ANKLE_MOMENT(pace.phase(phase))

    def work(torque: Array, velocity: Array) -> float:
        return float(np.sum(np.maximum(torque * velocity, 0.0))) * step / strides

    alone, helped = work(own, meant), work(own - given, meant)
    gap = max(1, round(RATE_TIME / step))
    rates = np.abs(given[gap:] - given[:-gap]) / (gap * step)
    swing = phase > pace.toe_off
    found = (
        helped,
        (helped - alone) / alone,
        work(given, log["joint_velocity_rad_s"][whole]),
        float(np.max(-given)),
        float(np.max(rates)),
        float(np.max(np.abs(given[swing]))),
    )
    return dict(zip(NAMES, found, strict=True))


NAMES = (
    "wearer_work",
    "wearer_work_change",
    "assistance_work",
    "peak_assistance",
    "torque_rate",
    "swing_torque",
)
"""Metrics, in the order of `measure_strides`."""
