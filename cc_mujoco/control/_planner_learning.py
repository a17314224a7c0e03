"""Friction and sensor bias of a planning controller, from the torque on the rotor."""

from __future__ import annotations

import numpy as np

from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._layout import segment_angles, slips, tensions
from cc_mujoco.control._planner_memory import (
    BIAS,
    DISTURBANCE,
    FRICTION,
)
from cc_mujoco.control._planner_parameters import (
    LEARNING,
    MIN_FRICTION_TORQUE,
    NOISE,
    PERIOD,
    RATIO,
    ZEROING,
)
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal

_FRICTION_FACTOR_BOUNDS = 0.2, 3.0
"""Bounds of the factor of friction."""
_MAX_FRICTION_ERROR = 0.3
"""Relative error of friction up to which a bias may be estimated."""
_MAX_BIAS_RATIO = 2.0
"""Greatest bias of the torque sensor, over its significant torque."""
_COULOMB = law.INDEX["friction"]


@compiled
def learn(
    cables: stepper.Cables, state: FloatMatrix, memory: FloatArray, tune: FloatArray
) -> None:
    """Adapt friction and bias to the torque on the rotor that the model lacks.

    While all segments slip, the load grows with the logarithm of friction by r T mu phi
    of every cable, with the tension T at the motor, whose sign is that of the slip; and
    by the bias of the torque sensor, over the ratio, whatever the slip. Friction takes
    the step of a normalised gradient, the bias its share by the two variances.
    """
    sensitivity = 0.0
    for k in range(cables.n.size):
        n = cables.n[k]
        slip = slips(state[k], n)
        sign = np.sign(slip[0])
        for j in range(n):
            if slip[j] * sign <= 0.0:
                return
        sensitivity += _load_slope(cables, k, state[k], sign) ** 2
    unexplained = min(
        max(memory[DISTURBANCE], -tune[MIN_FRICTION_TORQUE]), tune[MIN_FRICTION_TORQUE]
    )
    biased = (tune[NOISE] / tune[RATIO]) ** 2
    share = biased / (
        biased + (_MAX_FRICTION_ERROR * _MAX_FRICTION_ERROR) * sensitivity
    )
    step = tune[ZEROING] * tune[PERIOD] * share * unexplained * tune[RATIO]
    most = _MAX_BIAS_RATIO * tune[NOISE]
    memory[BIAS] = min(max(memory[BIAS] + step, -most), most)
    rate = (
        tune[LEARNING]
        * tune[PERIOD]
        * unexplained
        / (tune[MIN_FRICTION_TORQUE] ** 2 + sensitivity)
    )
    low, high = np.log(_FRICTION_FACTOR_BOUNDS[0]), np.log(_FRICTION_FACTOR_BOUNDS[1])
    for k in range(cables.n.size):
        sign = np.sign(slips(state[k], cables.n[k])[0])
        factor = memory[FRICTION + k] - rate * _load_slope(cables, k, state[k], sign)
        memory[FRICTION + k] = min(max(factor, low), high)


@internal
def _load_slope(
    cables: stepper.Cables, k: int, state: FloatArray, sign: float
) -> float:
    """Return the derivative of the motor's load by the logarithm of friction [N m]."""
    n, wrap = cables.n[k], 0.0
    angles = segment_angles(cables.prm[k], n)
    for j in range(n):
        wrap += angles[j]
    pull = cables.proximal[k] * sign * max(tensions(state, n)[0], 0.0)
    return float(pull * (cables.prm[k, _COULOMB] * wrap))


@compiled
def friction_factors(memory: FloatArray, factor: FloatArray) -> None:
    """Compute the factor on the friction of every cable (cables,)."""
    for k in range(factor.size):
        factor[k] = np.exp(memory[FRICTION + k])
