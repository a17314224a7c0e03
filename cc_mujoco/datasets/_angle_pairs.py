"""Moment arm at the joint from pairs of angles, where no scene has the lever.

With the cable taut and slow, the motor's angle m is where the cable keeps its length:
m = c + R/r (q + a q^2/2 + b q^3/3) for a moment arm R (1 + a q + b q^2) at the joint
and a motor pulley of radius r. A least-squares polynomial through pairs (m, q) gives
R/r, a and b.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from cc_mujoco.datasets._trials import Constant
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray

MIN_PAIRS = 5
"""Pairs from which an arm can be fitted and its error estimated."""
_CURVED_PAIRS = 7
"""Pairs from which on the arm may be curved."""
_MIN_SHARE = 0.2
"""Least arm over that at 0 within the pairs; a lever beyond is as good as dead."""
RATIO_KEY, SLOPE_KEY, CURVE_KEY = "lever_ratio", "lever_slope", "lever_curve"
"""Constants that stand for the pairs: R/r, a [1/rad] and b [1/rad^2]."""


class FittedArm(NamedTuple):
    """Moment arm at the joint.

    Attributes:
        ratio: R/r with its standard deviation.
        coefficients: a [1/rad] and b [1/rad^2].
    """

    ratio: Constant
    coefficients: tuple[float, float]


def fit_angle_pairs(pairs: Sequence[Sequence[float]], where: str) -> FittedArm:
    """Return the arm through pairs of motor and joint angle [rad]."""
    motor, joint = np.array(pairs, dtype=np.float64).T
    if len(pairs) < MIN_PAIRS or len(set(joint.tolist())) < MIN_PAIRS:
        raise CableError(
            f"{where} has {len(set(joint.tolist()))} different joint angles; give "
            f"{MIN_PAIRS} pairs [motor, joint] or more, over the whole range."
        )
    degree = 3 if len(pairs) >= _CURVED_PAIRS else 2
    design = np.vander(joint, degree + 1, increasing=True)
    size = np.linalg.lstsq(design, motor)[0]
    left = motor - design @ size
    freedom = max(len(pairs) - degree - 1, 1)
    spread = np.linalg.inv(design.T @ design) * float(left @ left) / freedom
    ratio = float(size[1])
    arm = Polynomial(size).deriv()(np.linspace(joint.min(), joint.max(), 101)) / ratio
    if ratio <= 0.0 or float(arm.min()) < _MIN_SHARE:
        raise CableError(
            f"{where}: the joint does not follow the motor over the whole range (arm "
            f"{float(arm.min()):.2g} of that at 0 at least); give pairs that increase "
            "together, with the cable taut."
        )
    more = [k * float(size[k]) / ratio for k in range(2, degree + 1)]
    doubt = float(np.sqrt(spread[1, 1]))
    return FittedArm(Constant(ratio, doubt), (more[0], more[1] if degree > 2 else 0.0))


def arm_constants(found: FittedArm) -> dict[str, Constant]:
    slope, curve = found.coefficients
    return {
        RATIO_KEY: found.ratio,
        SLOPE_KEY: Constant(slope),
        CURVE_KEY: Constant(curve),
    }


def known_arm(constants: Mapping[str, Constant]) -> tuple[float, ...]:
    """Return the coefficients of a known arm, () without angle pairs."""
    if RATIO_KEY not in constants:
        return ()
    return constants[SLOPE_KEY].value, constants[CURVE_KEY].value


def wound_angle(arm: Sequence[float], joint: FloatArray) -> FloatArray:
    """Return a pulley's angle that takes as much cable as the joint (samples,)."""
    found: FloatArray = Polynomial((1.0, *arm)).integ()(joint)
    return found


def arm_share(arm: Sequence[float], joint: FloatArray) -> FloatArray:
    """Return the arm over that at 0 (samples,)."""
    found: FloatArray = Polynomial((1.0, *arm))(joint)
    return found
