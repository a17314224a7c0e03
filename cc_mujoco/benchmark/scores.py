"""What an episode is judged by; every score has a definition and a unit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.recording.signals import lag, loop_width

Array = NDArray[np.float64]

SMOOTH = 0.05
"""Window of the mean from which chatter is told [s]."""
ASKED = 0.02
"""Share of the largest desired torque below which none is asked for."""
TAUT = 0.1
"""Share of the largest desired torque above which a cable that only pulls is taut."""
SLACK_SHARE = 0.01
"""Share of the time that cables may be slack when they must not."""


@dataclass(frozen=True)
class Score:
    """A score, smaller is better."""

    name: str
    unit: str
    meaning: str


SCORES = (
    Score("rms_error", "Nm", "RMS of joint torque less desired torque"),
    Score("peak_error", "Nm", "largest of it"),
    Score("lag", "ms", "delay of joint torque after desired, by cross-correlation"),
    Score("backlash", "rad", "width of the torque-angle loop at zero torque; spring"),
    Score("effort", "Nm", "RMS of the motor's torque"),
    Score("chatter", "Nm", "RMS of the motor's torque less its mean over 50 ms"),
    Score("transparency", "Nm", "RMS of joint torque where none is asked for"),
    Score("failed", "1", "diverged, or slack for 1 % of the time when it must not be"),
)
"""All scores, in the order of tables."""


def score(
    columns: Mapping[str, Array], *, task: str, period: float, pull_pull: bool
) -> dict[str, float]:
    """Score one episode.

    Args:
        columns: time, angle, joint torque, desired torque, motor torque and the slack
            of every cable (`slack_m`, (samples, cables)), without the warm-up.
        task: Its name.
        period: Time between samples [s].
        pull_pull: Whether it is a failure only if all cables are slack at once, else
            whenever more than `TAUT` is asked for.

    Returns:
        By name, NaN where an episode cannot tell.
    """
    torque, desired = columns["joint_torque_nm"], columns["desired_torque_nm"]
    motor = columns["motor_torque_nm"]
    if not np.all(np.isfinite(torque)):
        return {s.name: math.nan for s in SCORES} | {"failed": 1.0}
    error = torque - desired
    most = float(np.max(np.abs(desired)))
    free = np.abs(desired) <= ASKED * most
    slack = columns["slack_m"] > 0.0
    wrong = (
        slack.all(axis=1)
        if pull_pull
        else slack.any(axis=1) & (np.abs(desired) > TAUT * most)
    )
    width = max(1, round(SMOOTH / period))
    mean = np.convolve(motor, np.full(width, 1.0 / width), mode="valid")
    first = (width - 1) // 2
    rough = motor[first : first + mean.size] - mean
    delay = lag(columns["time_s"], desired, torque) if most > 0.0 else math.nan
    spring = task == "spring"
    return {
        "rms_error": _rms(error),
        "peak_error": float(np.max(np.abs(error))),
        "lag": 1e3 * delay,
        "backlash": loop_width(columns["joint_angle_rad"], torque)
        if spring
        else math.nan,
        "effort": _rms(motor),
        "chatter": _rms(rough),
        "transparency": _rms(torque[free]) if np.mean(free) > 0.05 else math.nan,
        "failed": float(np.mean(wrong) > SLACK_SHARE),
    }


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
