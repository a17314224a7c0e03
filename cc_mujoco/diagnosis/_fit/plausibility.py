"""Checks that fitted effects are possible, significant and larger than ordinary.

Plausible sizes are those of the bench, scaled to the rig. `EffectParameter.typical` is
for a bench of `Limit.tension`, `Limit.radius`, `Limit.length` and `Limit.stiffness`. On
another rig forces scale with the tension, torques with tension and radius, stretches
with the stretch of the cable.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cc_mujoco.cable import Cable
from cc_mujoco.diagnosis._fit.fitting import Problem
from cc_mujoco.diagnosis._rig.bench_simulation import plausible_range
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis.effects import ANTAGONIST, EFFECTS, EffectParameter
from cc_mujoco.estimation._least_squares import MAX_FREEDOM
from cc_mujoco.native import FloatArray

IMPLAUSIBLE_PREFIX = "fits only with"
"""Beginning of the reason not to name an effect whose size is impossible."""
_OF_STRETCH = ("bristle_length",)
_OF_STRAIN = ("bedding_strain", "bedding_strain_antagonist")
_AT_MOTOR = ("motor_", "cogging_", "eccentricity_", "ovality_")
_TORQUES = ("N m", "N m/s", "N m/rad", "kg m^2")


def implausibility(problem: Problem, x: FloatArray) -> str:
    """Describe impossible effects of a model; empty if there are none."""
    values = problem.values(x)
    for name in problem.effects:
        for parameter in problem.plant.library.effects[name].parameters:
            low, high = plausible_range(parameter, problem.plant)
            value = values[parameter.name]
            slack = 1e-3 * parameter.typical
            if not low - slack <= value <= high + slack:
                unit = f" {parameter.unit}".removesuffix(" 1")
                return (
                    f"{IMPLAUSIBLE_PREFIX} {parameter.name} {value:.3g}{unit}, which "
                    f"is beyond {low:.3g} to {high:.3g}{unit}"
                )
        together = problem.plant.library.effects[name].implausible
        if together is not None and (reason := together(values)):
            return f"{IMPLAUSIBLE_PREFIX} {reason}"
    return ""


def doubtful_effects(
    problem: Problem, x: FloatArray, covariance: FloatArray, freedom: FloatArray
) -> list[str]:
    """Return the effects of a model that may have size 0 given all others.

    Their joint interval of the sizes contains 0, by the F distribution. For a single
    size it is the reported interval. `covariance` (parameters, parameters) of the
    places has `freedom` (parameters,) degrees of freedom.
    """
    from scipy.special import fdtri

    found = {}
    for name in problem.effects:
        index = amplitude_indices(problem, [name])
        size = x[index]
        # Where an undetermined shape makes the size uncertain, a large size with one
        # shape is a small one with another, and none is 0: the test is of the size at
        # its shape, and allows for the choice of the shape.
        shape = shape_indices(problem, name)
        part = covariance[np.ix_(index, index)]
        if shape:
            across = covariance[np.ix_(index, shape)]
            within = covariance[np.ix_(shape, shape)]
            part = part - across @ np.linalg.solve(within, across.T)
        contrast = np.linalg.solve(part, size).astype(np.float64)
        square = float(size @ contrast)
        count = len(index) + len(shape)
        known = _effective_freedom(contrast, np.diag(part), freedom[index])
        found[name] = square / (
            count * float(fdtri(count, known, Limit.nonzero_confidence))
        )
    return [name for name, evidence in found.items() if evidence < 1.0]


def _effective_freedom(
    contrast: FloatArray, variance: FloatArray, freedom: FloatArray
) -> float:
    """Return the degrees of freedom of a sum of sizes with these weights.

    F. Satterthwaite, Biometrics Bulletin 2, 1946.
    """
    shares = contrast**2 * variance
    total = float(np.sum(shares))
    if not total > 0.0:
        return MAX_FREEDOM
    found = total**2 / max(float(np.sum(shares**2 / freedom)), 1e-300)
    return min(found, MAX_FREEDOM)


def is_ordinary(problem: Problem, x: FloatArray, name: str) -> bool:
    """Return whether an effect of a model is no larger than any rig may have.

    The conduit of a scene holds its cable evenly from end to end; conduits of rigs do
    not, and good sensors see it.
    """
    values = problem.values(x)
    sizes = {"": 0.0}
    for parameter in problem.plant.library.effects[name].parameters:
        if not parameter.ordinary:
            return False
        other = ANTAGONIST if ANTAGONIST in parameter.name else ""
        size = abs(values[parameter.name]) / max_ordinary_size(problem, x, parameter)
        sizes[other] = sizes.get(other, 0.0) + size
    return max(sizes.values()) <= 1.0


def max_ordinary_size(
    problem: Problem, x: FloatArray, parameter: EffectParameter
) -> float:
    """Return the largest size of a parameter that any rig may have, above 0."""
    cables = problem.plant.cables(problem.values(x), problem.effects)
    sizes = [
        parameter.ordinary * _reference_size(parameter.ordinary_of, c) for c in cables
    ]
    return max(min(sizes), 1e-12)


def _reference_size(of: str, cable: Cable) -> float:
    """Return the reference of the ordinary size of an effect's parameter."""
    if of == "cable":
        return cable.length / cable.axial_stiffness
    return cable.pretension / (cable.length if of == "pretension per length" else 1.0)


def shape_indices(problem: Problem, name: str) -> list[int]:
    own = {p.name for p in EFFECTS[name].parameters if not p.linear}
    return [k for k, parameter in enumerate(problem.tuned) if parameter.name in own]


def amplitude_indices(problem: Problem, names: Sequence[str]) -> list[int]:
    off = {
        parameter.name
        for name in names
        for parameter in EFFECTS[name].parameters
        if parameter.size
    }
    return [k for k, parameter in enumerate(problem.tuned) if parameter.name in off]


def plausible_size(
    parameter: EffectParameter, problem: Problem, x: FloatArray
) -> float:
    """Compute the size of an effect's parameter that is plausible on a rig."""
    bench = problem.plant.bench
    cable = problem.plant.cables(problem.values(x), problem.effects)[0]
    tension = cable.pretension / Limit.tension
    length = cable.length / Limit.length
    soft = Limit.stiffness / cable.axial_stiffness
    at_motor = parameter.name.startswith(_AT_MOTOR)
    radius = (bench.motor_radius if at_motor else bench.joint_radius) / Limit.radius
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
