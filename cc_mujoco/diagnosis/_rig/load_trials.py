"""Joint torque from the motion of a known load, where no sensor measures it.

The load is declared in `[rig]`: a spring, an inertia, a damper, a weight. What it takes
to move it as it moved is what the transmission put into the joint.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cc_mujoco.cable import Parameter
from cc_mujoco.datasets._rig_table import LOAD_CONSTANTS
from cc_mujoco.datasets._trials import Constant
from cc_mujoco.diagnosis._rig.lowpass import low_pass
from cc_mujoco.estimation._least_squares import Tuned
from cc_mujoco.native import FloatArray

REST_ANGLE_DEVIATION = 0.01
"""Standard deviation of the angle at which a spring rests, unless declared [rad]."""
_PARAMETERS = {
    parameter.name: parameter
    for parameter in (
        Parameter("load_stiffness", "N m/rad", "stiffness of the spring", scale="log"),
        Parameter("load_inertia", "kg m^2", "inertia of the load", scale="log"),
        Parameter("load_damping", "N m s/rad", "viscous damping", scale="log"),
        Parameter("load_weight", "N m", "largest moment of the weight", scale="log"),
        Parameter("load_rest_angle", "rad", "joint angle where the spring rests"),
    )
}


def load_values(constants: Mapping[str, Constant]) -> dict[str, float]:
    """Return the declared values of a load by name."""
    return {name: constant.value for name, constant in constants.items()}


def load_torque(
    angle: FloatArray, step: float, values: Mapping[str, float], tilt: float = 0.0
) -> FloatArray:
    """Return the torque that moves a load (samples,) [N m].

    Args:
        angle: of the joint (samples,), smooth [rad].
        step: time between samples [s].
        values: of `RIG_CONSTANTS`, SI; what is missing is not there.
        tilt: angle by which the rig was turned about the joint's axis [rad].
    """
    speed = np.gradient(angle, step)
    stretch = angle - values.get("load_rest_angle", 0.0)
    lift = np.sin(angle + tilt - values.get("load_hanging_angle", 0.0))
    found: FloatArray = (
        values.get("load_stiffness", 0.0) * stretch
        + values.get("load_damping", 0.0) * speed
        + values.get("load_inertia", 0.0) * np.gradient(speed, step)
        + values.get("load_weight", 0.0) * lift
    )
    return found


def load_noise(
    constants: Mapping[str, Constant],
    deviation: float,
    rate: float,
    bands: tuple[float, float],
) -> float:
    """Return the standard deviation of a load's torque due to angle noise [N m].

    Where the angle is rounded, its error is slow and passes every filter.

    Args:
        constants: of the load.
        deviation: of the angle [rad].
        rate: samples per second [Hz].
        bands: to which torques and angles are low-passed [Hz].
    """
    values = load_values(constants)
    noise = deviation * np.random.default_rng(0).standard_normal(8192)
    moving = {n: v for n, v in values.items() if n in ("load_inertia", "load_damping")}
    shaken = load_torque(low_pass(noise, bands[1], rate), 1.0 / rate, moving)
    passed = float(np.std(low_pass(shaken, bands[0], rate)))
    slope = values.get("load_stiffness", 0.0) + values.get("load_weight", 0.0)
    return math.hypot(passed, slope * deviation)


def load_parameters(constants: Mapping[str, Constant]) -> list[Tuned]:
    """Return the uncertain quantities of a load, as parameters of a fit."""
    found = []
    for name in LOAD_CONSTANTS:
        known = constants.get(name, Constant(0.0))
        if known.uncertainty > 0.0:
            relative = known.uncertainty / known.value
            found.append(
                Tuned(
                    _PARAMETERS[name],
                    known.value,
                    relative,
                    -10.0,
                    10.0,
                    1.0,
                )
            )
    if "load_stiffness" in constants:
        rest = constants.get("load_rest_angle", Constant(0.0))
        scale = rest.uncertainty or REST_ANGLE_DEVIATION
        found.append(
            Tuned(_PARAMETERS["load_rest_angle"], rest.value, scale, -10.0, 10.0, 1.0)
        )
    return found
