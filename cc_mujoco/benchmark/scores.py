"""What an episode is judged by; every score has a definition and a unit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.recording.signals import lag, loop_opening

Array = NDArray[np.float64]

SMOOTH = 0.05
"""Window of the mean that chatter is told from, and backlash measured on [s]."""
ASKED = 0.02
"""Share of the largest desired torque below which none is asked for."""
FREE_SHARE = 0.25
"""Share of the time for which none must be asked for to tell transparency."""
TAUT = 0.1
"""Share of the largest desired torque above which a cable that only pulls is taut."""
SLACK_SHARE = 0.01
"""Share of the time that cables may be slack when they must not."""


@dataclass(frozen=True)
class Score:
    """A score; the nearer to 0, the better."""

    name: str
    unit: str
    meaning: str


SCORES = (
    Score("rms_error", "Nm", "RMS of joint torque less desired torque"),
    Score("peak_error", "Nm", "largest of it"),
    Score(
        "lag",
        "ms",
        "delay of joint torque after desired, by cross-correlation, negative where it "
        "leads; none where the coefficient stays below 0.5",
    ),
    Score(
        "backlash",
        "rad",
        "between the angles at which the joint torque crosses zero on the way out and "
        "back, means over 50 ms; spring",
    ),
    Score("effort", "Nm", "RMS of the motor's torque"),
    Score("chatter", "Nm", "RMS of the motor's torque less its mean over 50 ms"),
    Score("transparency", "Nm", "RMS of joint torque while none is asked for"),
    Score(
        "failed",
        "1",
        "episodes that diverged or were slack for 1 % of the time when they must not",
    ),
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
    mean = _smooth(motor, period)
    first = (motor.size - mean.size) // 2
    rough = motor[first : first + mean.size] - mean
    delay = (
        lag(columns["time_s"], desired, torque, signed=True) if most > 0 else math.nan
    )
    angle = columns["joint_angle_rad"]
    return {
        "rms_error": _rms(error),
        "peak_error": float(np.max(np.abs(error))),
        "lag": 1e3 * delay,
        "backlash": loop_opening(_smooth(angle, period), _smooth(torque, period))
        if task == "spring"
        else math.nan,
        "effort": _rms(motor),
        "chatter": _rms(rough),
        "transparency": _rms(torque[free]) if np.mean(free) > FREE_SHARE else math.nan,
        "failed": float(np.mean(wrong) > SLACK_SHARE),
    }


def _smooth(values: Array, period: float) -> Array:
    """Mean over `SMOOTH`, where the window fits."""
    width = max(1, round(SMOOTH / period))
    return np.convolve(values, np.full(width, 1.0 / width), mode="valid")


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
