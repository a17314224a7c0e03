"""What an episode is judged by; every score has a definition and a unit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.episode import unsafe_from
from cc_mujoco.recording.signals import lag, loop_opening

Array = NDArray[np.float64]

SMOOTH = 0.05
"""Window of the mean that chatter is told from, and backlash measured on [s]."""
THIN = 5
"""Samples in a step of the correlation, whose peak is refined beyond it."""
TAUT = 0.1
"""Share of the largest desired torque above which a cable that only pulls is taut."""


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
        "back, means over 50 ms; where a spring is asked for",
    ),
    Score("effort", "Nm", "RMS of the motor's torque"),
    Score("chatter", "Nm", "RMS of the motor's torque less its mean over 50 ms"),
    Score(
        "slack",
        "1",
        "share of the time with a slack cable where more than a tenth of the largest "
        "torque is asked for; of two cables that pull against each other, both slack",
    ),
    Score(
        "failed",
        "1",
        "episodes that diverged, or put more than the device's `safe_torque` into the "
        "joint for 10 ms, or tore a cable",
    ),
)
"""All scores of an episode, in the order of tables."""


@dataclass(frozen=True)
class Limits:
    """What an episode is judged against."""

    torque: float
    """Most that the cables may put into the joint [Nm]."""
    strength: float
    """Breaking load of a cable [N]."""
    pull_pull: bool
    """Whether two cables pull against each other."""


def score(
    columns: Mapping[str, Array], *, spring: bool, period: float, limits: Limits
) -> dict[str, float]:
    """Score one episode.

    Args:
        columns: time, angle, joint torque, desired torque, motor torque, slack of the
            cables that the motor winds (`slack`, (samples, cables)) and tensions
            (`tension_n`, (samples, ends)), without the warm-up.
        spring: Whether a spring is asked for.
        period: Time between samples [s].
        limits: What is safe.

    Returns:
        By name, NaN where an episode cannot tell.
    """
    torque, desired = columns["joint_torque_nm"], columns["desired_torque_nm"]
    motor = columns["motor_torque_nm"]
    if not np.all(np.isfinite(torque)):
        return {s.name: math.nan for s in SCORES} | {"failed": 1.0}
    error = torque - desired
    most = float(np.max(np.abs(desired)))
    hanging = columns["slack"]
    wrong = (
        hanging.all(axis=1)
        if limits.pull_pull
        else hanging.any(axis=1) & (np.abs(desired) > TAUT * most)
    )
    mean = _smooth(motor, period)
    first = (motor.size - mean.size) // 2
    rough = motor[first : first + mean.size] - mean
    delay = (
        lag(columns["time_s"][::THIN], desired[::THIN], torque[::THIN], signed=True)
        if most > 0
        else math.nan
    )
    angle = columns["joint_angle_rad"]
    unsafe = unsafe_from(torque, limits.torque, period) is not None
    torn = bool(np.max(columns["tension_n"]) > limits.strength)
    return {
        "rms_error": _rms(error),
        "peak_error": float(np.max(np.abs(error))),
        "lag": 1e3 * delay,
        "backlash": loop_opening(_smooth(angle, period), _smooth(torque, period))
        if spring
        else math.nan,
        "effort": _rms(motor),
        "chatter": _rms(rough),
        "slack": float(np.mean(wrong)),
        "failed": float(unsafe or torn),
    }


def _smooth(values: Array, period: float) -> Array:
    """Mean over `SMOOTH`, where the window fits."""
    width = max(1, round(SMOOTH / period))
    return np.convolve(values, np.full(width, 1.0 / width), mode="valid")


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
