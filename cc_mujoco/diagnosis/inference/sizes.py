"""Sizes of effects that are plausible on a rig: those of the bench, scaled to it.

`EffectParameter.typical` is what a bench of `TENSION`, `RADIUS`, `LENGTH` and
`STIFFNESS` may have. On another rig forces go with the tension, torques with tension
and radius, stretches with the stretch of the cable.
"""

from __future__ import annotations

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.effects import EffectParameter
from cc_mujoco.diagnosis.inference.fitting import Problem

TENSION, RADIUS, LENGTH, STIFFNESS = 80.0, 0.05, 2.0, 5e4
"""Pretension [N], radius of pulleys [m], length [m] and stiffness [N] of the bench."""
_OF_STRETCH = ("bristle_length",)
_OF_STRAIN = ("bedding_strain", "bedding_strain_antagonist")
_AT_MOTOR = ("motor_", "cogging_", "eccentricity_", "ovality_")
_TORQUES = ("N m", "N m/s", "N m/rad", "kg m^2")


def plausible_size(
    parameter: EffectParameter, problem: Problem, x: FloatArray
) -> float:
    """Compute the size of an effect's parameter that is plausible on a rig.

    Args:
        parameter: one of the sizes of an effect.
        problem: the model of the rig.
        x: where it was fitted.
    """
    bench = problem.plant.bench
    cable = problem.plant.cables(problem.values(x), problem.effects)[0]
    tension = cable.pretension / TENSION
    length = cable.length / LENGTH
    soft = STIFFNESS / cable.axial_stiffness
    at_motor = parameter.name.startswith(_AT_MOTOR)
    radius = (bench.motor_radius if at_motor else bench.joint_radius) / RADIUS
    scale = 1.0
    if parameter.name in _OF_STRETCH:
        scale = tension * soft * length
    elif parameter.name in _OF_STRAIN:
        scale = tension * soft
    elif parameter.unit in _TORQUES:
        scale = tension * radius
    elif parameter.unit == "N":
        scale = tension
    elif parameter.unit == "N/m":
        scale = tension / length
    elif parameter.unit == "N s/m^2":
        scale = tension / length / radius
    elif parameter.unit == "m/N":
        scale = soft * length
    elif parameter.unit == "m":
        scale = radius
    elif parameter.unit == "1/J":
        scale = 1.0 / (tension * radius)
    return parameter.typical * scale
