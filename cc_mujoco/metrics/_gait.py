"""Assistance and work at the assisted joint of a walking wearer, stride by stride.

The scripted wearer is a spring and a damper to the measured motion, on a leg that
swings free of the floor: its resistance does not show what it would save. So the work
of the muscles is computed separately from the simulation: the moment of the joint in
the measured walk, by inverse dynamics, less the torque that the cables gave, at the
velocity of the measured walk. That holds while motion and moment in all stay as they
were without help, which people change; and work is not metabolic cost.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cc_mujoco.human import Pace
from cc_mujoco.human._gait import GAIT_MOMENTS
from cc_mujoco.human._gait_joints import GaitJoint
from cc_mujoco.metrics._metric import GAIT_JOINT, MOMENT_RATIO, PACE, Array, LogLike
from cc_mujoco.metrics._torque import peak_rate

ANKLE = GaitJoint("ankle", "ankle")
"""Joint whose strides are measured where the metadata name none."""


class Strides(NamedTuple):
    """Numbers of a joint over the whole strides of an episode; NaN without one."""

    wearer_work: float = math.nan
    wearer_work_change: float = math.nan
    assistance_work: float = math.nan
    peak_assistance: float = math.nan
    torque_rate: float = math.nan
    swing_torque: float = math.nan


def stride_metrics(log: LogLike) -> Strides:
    """Return the numbers of the assisted joint over the whole strides of an episode.

    Strides go from heel strike to heel strike. The first, in which the walk begins, is
    left out.
    """
    if PACE not in log.metadata:
        return Strides()
    pace: Pace = log.metadata[PACE]
    size = log.metadata.get(MOMENT_RATIO, 1.0)
    time = log["time_s"]
    phase = np.mod(np.arctan2(log["phase_sine"], log["phase_cosine"]) / math.tau, 1.0)
    strikes = np.flatnonzero(np.diff(phase) < -0.5) + 1
    if strikes.size < 2:
        return Strides()
    step, count = float(time[1] - time[0]), strikes.size - 1
    whole = slice(int(strikes[0]), int(strikes[-1]))
    phase, given = phase[whole], log["joint_torque_nm"][whole]
    meant = np.gradient(log["reference_angle_rad"], step)[whole]
    joint: GaitJoint = log.metadata.get(GAIT_JOINT, ANKLE)
    own = size * pace.moment(joint.part) * GAIT_MOMENTS[joint.part](pace.phase(phase))
    if joint.turned:
        own = -own
    desired = log["desired_torque_nm"][whole]
    helps = -1.0 if -desired.min() >= desired.max() else 1.0

    def work(torque: Array, velocity: Array) -> float:
        return float(np.sum(np.maximum(torque * velocity, 0.0))) * step / count

    alone, helped = work(own, meant), work(own - given, meant)
    swing = phase > pace.toe_off
    return Strides(
        helped,
        (helped - alone) / alone,
        work(given, log["joint_velocity_rad_s"][whole]),
        float(np.max(helps * given)),
        peak_rate(given, step),
        float(np.max(np.abs(given[swing]))),
    )
