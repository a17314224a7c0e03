"""Numbers that summarize an episode, computed from its log alone.

    for metric in measure(log):
        print(metric.name, metric.value, metric.unit)

A number that an episode cannot give (the efficiency of a direction in which nothing
arrived, for example) is NaN here and `null` in `metrics.json`; it is never made up.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.files import replacing
from cc_mujoco.recording.columns import DRIVEN, RATIO
from cc_mujoco.recording.log import EpisodeLog
from cc_mujoco.recording.signals import lag, loop_width

Array = NDArray[np.float64]

EFFICIENCY = (
    "work delivered to the side that the task means to receive it, over that work plus "
    "all that friction took; none where none arrives"
)
"""Meaning of `efficiency`, wherever it is printed."""

LEAST_ASKED = 0.01
"""Share of all work that a task demands, either way, below which it counts as none."""


@dataclass(frozen=True)
class Metric:
    """One number with its unit and what it means."""

    name: str
    value: float
    unit: str
    meaning: str


class Samples(Protocol):
    """The part of an episode log that a number needs."""

    @property
    def cables(self) -> tuple[str, ...]:
        """Names of the cables."""

    @property
    def metadata(self) -> Mapping[str, Any]:
        """Metadata of the episode."""

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column, its first axis time."""


def measure(log: EpisodeLog) -> tuple[Metric, ...]:
    """Return every metric of an episode, in a fixed order."""
    torque, time = log["joint_torque_nm"], log["time_s"]
    driven = efficiency(log)
    found = [
        Metric(
            "torque_tracking_error",
            _rms(torque - log["desired_torque_nm"]),
            "N m",
            "RMS of joint torque minus desired torque",
        ),
        Metric(
            "torque_lag",
            lag(time, log["desired_torque_nm"], torque),
            "s",
            "delay of the joint torque after the desired torque",
        ),
        Metric("peak_joint_torque", _peak(torque), "N m", "largest |joint torque|"),
        Metric("rms_joint_torque", _rms(torque), "N m", "RMS of the joint torque"),
        Metric(
            "angle_tracking_error",
            _rms(log["joint_angle_rad"] - log["reference_angle_rad"]),
            "rad",
            "RMS of joint angle minus the angle that the wearer aims for",
        ),
        Metric(
            "backlash_width",
            backlash_width(log),
            "rad",
            "width at zero torque of the loop of joint torque against twist",
        ),
        Metric("efficiency", driven.overall, "1", EFFICIENCY),
        Metric(
            "efficiency_motor_drives",
            driven.motor_drives,
            "1",
            "the same from motor to joint: friction while the motor gives more power",
        ),
        Metric(
            "efficiency_wearer_drives",
            driven.wearer_drives,
            "1",
            "the same from joint to motor: friction while the wearer gives more power",
        ),
        Metric(
            "motor_share",
            driven.motor_share,
            "1",
            "part of all work put into the cables that came from the motor",
        ),
    ]
    for cable in log.cables:
        found += [
            Metric(
                f"slack_time_{cable}",
                slack_time(log, cable),
                "s",
                f"time for which some of cable {cable} hung slack",
            ),
            Metric(
                f"dissipated_energy_{cable}",
                float(np.diff(log[f"dissipated_{cable}_j"]).sum()),
                "J",
                f"energy that cable {cable} lost to friction",
            ),
        ]
    return tuple(found)


@dataclass(frozen=True)
class Efficiency:
    """Efficiency of a transmission that either side may drive; NaN where undefined."""

    overall: float
    """Efficiency in both directions together, in (0, 1]."""
    motor_drives: float
    """Efficiency from motor to joint, in (0, 1]."""
    wearer_drives: float
    """Efficiency from joint to motor (the device is backdriven), in (0, 1]."""
    motor_share: float
    """Work put in by the motor over work put in by both sides, in [0, 1]."""


def efficiency(log: Samples) -> Efficiency:
    r"""Return how much of the work put into the cables arrives where it should.

    The task defines where: with the power \(\tau_d \omega_j\) that it demands, work is
    meant for the joint while that is positive, for the motor while it is negative (a
    virtual spring that is being loaded), for nobody while it is zero. With the power of
    the motor into the cables \(P_m = \tau_m \omega_m\) and of the cables into the joint
    \(P_j = \tau_j \omega_j\)

    \[ \eta = \frac{W}{W + D}, \quad W_\text{motor drives} = \int_{\tau_d \omega_j > 0}
       P_j\,dt, \quad W_\text{wearer drives} = -\int_{\tau_d \omega_j < 0} P_m\,dt \]

    where \(D\) is what friction took of the cables that the motor winds: at all times
    of both \(W\) together, and for a direction alone while \(P_m + P_j\) has its sign,
    positive for the motor. So is the loss of winding up before any work is demanded for
    the motor's. \(W + D\) is the work put in without what the elastic cable only keeps
    for later, so storage cannot lift the ratio above 1; in steady motion it is the
    plain ratio of power out to power in, \(e^{-\mu \theta}\) for one cable.

    A side that receives no work on the whole (friction takes more than the task means
    to pass on, or that side has to help) has no efficiency: NaN; nor has one for which
    less than `LEAST_ASKED` is meant, which is a tremble of the joint.
    """
    time = log["time_s"]
    motor = _work(time, log["motor_torque_nm"] * log["motor_velocity_rad_s"])
    joint = _work(time, log["joint_torque_nm"] * log["joint_velocity_rad_s"])
    asked = _work(time, log["desired_torque_nm"] * log["joint_velocity_rad_s"])
    lost = np.zeros_like(motor)
    for cable in wound(log):
        lost += np.diff(log[f"dissipated_{cable}_j"])
    to_joint = _meant(joint, asked)
    to_motor = _meant(-motor, -asked)
    motor_in = float(np.maximum(motor, 0).sum())
    wearer_in = float(np.maximum(-joint, 0).sum())
    return Efficiency(
        overall=_efficiency(to_joint + to_motor, float(lost.sum())),
        motor_drives=_efficiency(to_joint, float(lost[motor + joint > 0].sum())),
        wearer_drives=_efficiency(to_motor, float(lost[motor + joint < 0].sum())),
        motor_share=_divide(motor_in, motor_in + wearer_in),
    )


def wound(log: Samples) -> tuple[str, ...]:
    """Return the names of the cables that the motor winds."""
    return tuple(log.metadata.get(DRIVEN, log.cables))


def backlash_width(log: Samples) -> float:
    r"""Return how far the joint can lag the motor with no torque between them, in rad.

    The twist is \(\theta_m\,\rho - \theta_j\), with \(\rho\) the joint angle per motor
    angle of an unstretched cable (metadata `ratio`). Against twist, not against joint
    angle, the loop shows the transmission and not the virtual environment that the
    task displays. The width is `loop_width`; NaN without a ratio.
    """
    ratio = log.metadata.get(RATIO)
    if ratio is None:
        return math.nan
    twist = ratio * log["motor_angle_rad"] - log["joint_angle_rad"]
    return loop_width(twist, log["joint_torque_nm"])


def slack_time(log: EpisodeLog, cable: str) -> float:
    """Return for how many seconds a cable had slack (column `slack_{cable}_m` > 0)."""
    slack = log[f"slack_{cable}_m"] > 0
    return float(_work(log["time_s"], slack.astype(float)).sum())


def write_metrics(
    path: str | os.PathLike[str], found: Iterable[Metric]
) -> dict[str, dict[str, Any]]:
    """Write metrics as JSON and return what was written; NaN becomes `null`."""
    content: dict[str, dict[str, Any]] = {
        metric.name: {
            "value": metric.value if math.isfinite(metric.value) else None,
            "unit": metric.unit,
            "meaning": metric.meaning,
        }
        for metric in found
    }
    with replacing(path) as partial:
        partial.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n")
    return content


def _work(time: Array, power: Array) -> Array:
    """Trapezoidal integral of each interval between two samples, (T-1,)."""
    return 0.5 * (power[1:] + power[:-1]) * np.diff(time)


def _peak(values: Array) -> float:
    return float(np.max(np.abs(values)))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _meant(arrived: Array, asked: Array) -> float:
    """Return work that arrived while some was demanded; 0 if that was next to none."""
    wanted = asked > 0
    if not asked[wanted].sum() > LEAST_ASKED * np.abs(asked).sum():
        return 0.0
    return max(float(arrived[wanted].sum()), 0.0)


def _efficiency(delivered: float, lost: float) -> float:
    return _divide(delivered, delivered + lost) if delivered > 0 else math.nan


def _divide(part: float, whole: float) -> float:
    return float(part / whole) if whole > 0 else math.nan
