"""Values of fitted parameters with 95 % intervals, and what the data do not tell."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.inference.fitting import Masks, Problem
from cc_mujoco.diagnosis.inference.plant import Tuned
from cc_mujoco.diagnosis.inference.slopes import Slopes
from cc_mujoco.diagnosis.verdict import Value

_FLAT = 1e-12
FREE = 0.3
"""Relative standard deviation beyond which a combination is not determined."""


def covariance(problem: Problem, at: FloatArray, masks: Masks) -> FloatArray:
    """Of the places of all parameters; weights already count what is independent."""
    jacobian = Slopes(problem).jacobian(at, masks)
    values, vectors = np.linalg.eigh(jacobian.T @ jacobian)
    values = np.maximum(values, _FLAT * max(float(values[-1]), 1e-300))
    found: FloatArray = (vectors / values) @ vectors.T
    return found


def estimates(
    problem: Problem,
    at: FloatArray,
    masks: Masks,
    places: Sequence[FloatArray] = (),
) -> dict[str, Value]:
    """Value and interval of every parameter.

    Args:
        problem: the model.
        at: where it was fitted to all data.
        masks: samples that took part.
        places: where it was fitted with a part of the trials left out in turn. A model
            that is a little wrong fits every trial otherwise, and noise does not tell
            how much: the jackknife does.
    """
    variance = np.diag(covariance(problem, at, masks))
    if len(places) > 1:
        apart = np.array(places) - np.mean(places, axis=0)
        variance = variance + (1.0 - 1.0 / len(places)) * np.sum(apart**2, axis=0)
    return {
        parameter.name: _value(parameter, float(place), float(deviation))
        for parameter, place, deviation in zip(
            problem.tuned, at, np.sqrt(variance), strict=True
        )
    }


def _value(parameter: Tuned, place: float, deviation: float) -> Value:
    reach = min(
        1.96 * deviation, 50.0 / parameter.scale if parameter.factor else math.inf
    )
    ends = sorted((parameter.value(place - reach), parameter.value(place + reach)))
    return Value(parameter.value(place), parameter.unit, (ends[0], ends[1]))


def undetermined(problem: Problem, at: FloatArray, masks: Masks) -> tuple[str, ...]:
    """A sentence for each combination of parameters that only priors determine."""
    found = []
    whole = Slopes(problem).jacobian(at, masks)
    priors = sum(math.isfinite(parameter.prior) for parameter in problem.tuned)
    data = whole[: whole.shape[0] - priors]
    values, vectors = np.linalg.eigh(data.T @ data)
    for value, vector in zip(values, vectors.T, strict=True):
        deviation = 1.0 / math.sqrt(max(float(value), 1e-300))
        # In units of priors: beyond one, the data say less than what was known before.
        if deviation < 1.0:
            continue
        parts = [
            (p, float(w))
            for p, w in zip(problem.tuned, vector, strict=True)
            if abs(w) > 0.3
        ]
        names = " against ".join(p.name for p, _ in parts)
        if len(parts) == 1:
            found.append(f"{names} hardly changes the outputs; its value is a guess.")
        else:
            found.append(
                f"{names}: changed together these hardly change the outputs; only what "
                "was known before tells them apart."
            )
    found.append(
        "friction counts only times the wrap angle; the wrap of the scene is taken."
    )
    return tuple(found)
