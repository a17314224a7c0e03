r"""Tensions and motor angle of cables that slip as a whole, in closed form, compiled.

    torque, stretch = full_slip_balance(cables, sense, desired)

While a cable of wrap \(\phi\) slips in one direction s (1 where the motor winds towards
a positive torque at the joint), its tensions at motor and joint differ by the factor
\(e^{\mu \phi}\), and its stretch is that of its tension at the joint times a mean
factor. Between the two directions lies the backlash of the transmission.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cc_mujoco.device._drive import CableDrive
from cc_mujoco.native import FloatArray, FloatMatrix, compiled

PROXIMAL, DISTAL, FRICTION, COMPLIANCE, PRETENSION = range(5)
"""Columns of the table of cables: arms at motor and joint [m/rad], mu times wrap,
length over axial stiffness [m/N], pretension [N]."""


def cable_table(cables: Sequence[CableDrive]) -> FloatArray:
    """Return the table of cables (cables, 5)."""
    return np.array(
        [
            (
                one.proximal,
                one.distal,
                one.cable.friction * one.cable.wrap,
                one.cable.length / one.cable.axial_stiffness,
                one.cable.pretension,
            )
            for one in cables
        ]
    ).reshape(-1, 5)


@compiled
def _share(friction: float, slip: float) -> float:
    """Return the mean tension along a cable over that at the joint.

    `friction` is mu times wrap; `slip` is 1 towards the joint, -1 towards the motor, or
    between.
    """
    exponent = -slip * friction
    if abs(exponent) < 1e-6:
        return 1.0
    return float(math.expm1(exponent) / exponent)


@compiled
def full_slip_balance(
    cables: FloatMatrix, sense: float, desired: float
) -> tuple[float, float]:
    """Return motor torque and stretch of cables that slip as a whole.

    The stretch is the angle of the motor over the ratio, ahead of the joint [rad].
    `sense` is the direction in which the motor turns, 1 or -1 or, softly, between:
    positive towards a positive torque of the joint. `desired` is the torque at the
    joint [N m].
    """
    count = cables.shape[0]
    constant, slope = 0.0, 0.0
    for k in range(count):
        arm = cables[k, DISTAL]
        soft = cables[k, COMPLIANCE]
        unit = soft * _share(cables[k, FRICTION], np.sign(arm) * sense)
        constant -= arm * soft * cables[k, PRETENSION] / unit
        slope -= arm * arm / unit
    turned = (desired - constant) / slope
    slack = False
    for k in range(count):
        rest = cables[k, COMPLIANCE] * cables[k, PRETENSION]
        slack |= count > 1 and rest + cables[k, DISTAL] * turned < 0.0
    if slack:
        constant, slope = 0.0, 0.0
        for k in range(count):
            arm, soft = cables[k, DISTAL], cables[k, COMPLIANCE]
            if soft * cables[k, PRETENSION] + arm * turned < 0.0:
                continue
            unit = soft * _share(cables[k, FRICTION], np.sign(arm) * sense)
            constant -= arm * soft * cables[k, PRETENSION] / unit
            slope -= arm * arm / unit
        turned = (desired - constant) / slope if slope != 0.0 else turned
    torque = 0.0
    for k in range(count):
        arm, soft = cables[k, DISTAL], cables[k, COMPLIANCE]
        slip = np.sign(arm) * sense
        stretched = soft * cables[k, PRETENSION] + arm * turned
        tension = max(stretched, 0.0) / (soft * _share(cables[k, FRICTION], slip))
        torque -= cables[k, PROXIMAL] * tension * np.exp(-slip * cables[k, FRICTION])
    return float(torque), float(-turned)
