"""Efficiency of a transmission that either side may drive."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cc_mujoco.metrics._metric import Array, LogLike, driven_cables

MIN_TASK_WORK_SHARE = 0.01
"""Part of all work that a task asks for, either way, which is next to nothing."""


@dataclass(frozen=True)
class Efficiency:
    """Efficiency of a transmission that either side may drive; NaN where undefined."""

    overall: float
    """Both directions together, in (0, 1]."""
    motor_drives: float
    """Motor to joint, in (0, 1]."""
    wearer_drives: float
    """Joint to motor (the device is backdriven), in (0, 1]."""
    motor_share: float
    """Work put in by the motor over work put in by both sides, in [0, 1]."""


def efficiency(log: LogLike) -> Efficiency:
    r"""Return how much of the work put into the cables arrives where it should.

    The task says where: with the power \(\tau_d \omega_j\) that it asks for, work is
    meant for the joint while that is positive, for the motor while it is negative (a
    virtual spring that is being loaded), for nobody while it is zero. With the power of
    the motor into the cables \(P_m = \tau_m \omega_m\) and of the cables into the joint
    \(P_j = \tau_j \omega_j\)

    \[ \eta = \frac{W}{W + D}, \quad W_\text{motor drives} = \int_{\tau_d \omega_j > 0}
       P_j\,dt, \quad W_\text{wearer drives} = -\int_{\tau_d \omega_j < 0} P_m\,dt \]

    where \(D\) is what friction took of the cables that the motor winds: at all times
    of both \(W\) together, and for a direction alone while \(P_m + P_j\) has its sign,
    positive for the motor. So the loss of winding up before any work is desired counts
    for the motor. \(W + D\) is the work put in, without the energy that the elastic
    cable stores, so storage cannot lift the ratio above 1; in steady motion it is the
    plain ratio of power out to power in, \(e^{-\mu \theta}\) for one cable.

    A side that receives no work on the whole (friction takes more than the task means
    to pass on, or that side has to help) has no efficiency: NaN; nor has one for which
    less than `MIN_TASK_WORK_SHARE` is meant, which is a tremble of the joint.
    """
    time = log["time_s"]
    motor = work_between_samples(
        time, log["motor_torque_nm"] * log["motor_velocity_rad_s"]
    )
    joint = work_between_samples(
        time, log["joint_torque_nm"] * log["joint_velocity_rad_s"]
    )
    task_work = work_between_samples(
        time, log["desired_torque_nm"] * log["joint_velocity_rad_s"]
    )
    lost = np.zeros_like(motor)
    for cable in driven_cables(log):
        lost += np.diff(log[f"dissipated_{cable}_j"])
    to_joint = _useful_work(joint, task_work)
    to_motor = _useful_work(-motor, -task_work)
    motor_in = float(np.maximum(motor, 0).sum())
    wearer_in = float(np.maximum(-joint, 0).sum())
    return Efficiency(
        overall=_efficiency(to_joint + to_motor, float(lost.sum())),
        motor_drives=_efficiency(to_joint, float(lost[motor + joint > 0].sum())),
        wearer_drives=_efficiency(to_motor, float(lost[motor + joint < 0].sum())),
        motor_share=_divide(motor_in, motor_in + wearer_in),
    )


def work_between_samples(time: Array, power: Array) -> Array:
    """Return the trapezoidal integral between each two samples (T-1,)."""
    return 0.5 * (power[1:] + power[:-1]) * np.diff(time)


def _useful_work(arrived: Array, task_work: Array) -> float:
    """Return the work that arrived while work was desired, unless nearly none was."""
    wanted = task_work > 0
    if not task_work[wanted].sum() > MIN_TASK_WORK_SHARE * np.abs(task_work).sum():
        return 0.0
    return max(float(arrived[wanted].sum()), 0.0)


def _efficiency(delivered: float, lost: float) -> float:
    return _divide(delivered, delivered + lost) if delivered > 0 else math.nan


def _divide(part: float, whole: float) -> float:
    return float(part / whole) if whole > 0 else math.nan
