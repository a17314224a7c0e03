"""Effect of a model-form error on the parameters, which no trial tells.

A rig has what its scene has not: ends that give a little, seals that hold a little (the
effects of ordinary size), and forms that are not those of the library. All trials share
that, so they agree about parameters that are off. But where the model is off, it is off
in directions beside those of its parameters as well, and there the residuals show it:
what they show of effects of which a rig has none, or hardly any, is the size of such
errors, as negative controls are that of a bias (Schuemie et al., Stat. Med. 33, 2014).
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.inference.fitting import Masks, Problem
from cc_mujoco.diagnosis.inference.jacobian import jacobian
from cc_mujoco.diagnosis.inference.plausibility import usual

_NEW = 1e-3
"""Part of a signature's length below which nothing of it is left."""


def form_error(
    slopes: FloatArray, residual: FloatArray, spread: FloatArray, controls: FloatArray
) -> FloatArray:
    r"""Covariance (parameters, parameters) by errors of form, beside that of noise.

    The error is taken as a sum of the controls' signatures, isotropic in their span:
    with an orthonormal basis Q of it, r = J b + Q c + noise, c of variance v each. Of
    that the residuals of a fit keep M Q c, M = I - J H^-1 J^T. So their square along
    the q directions of M Q has the mean q + v tr(Q^T M Q), which gives v (moments, as
    of DerSimonian and Laird, Control. Clin. Trials 7, 1986), and the fit is off by
    H^-1 J^T Q c. Along no direction is v more than the largest of the controls makes:
    what is larger than any rig has is no form but something that is missing.

    Args:
        slopes: (data, parameters) J, those of priors left out.
        residual: (data,) in units of their noise.
        spread: (parameters, parameters) H^-1, priors included.
        controls: (data, controls) changes of the residuals by each, as large as a rig
            may have it.
    """
    nothing = np.zeros_like(spread)
    size = np.linalg.norm(controls, axis=0)
    controls = controls[:, size > 0.0] / size[size > 0.0]
    if not controls.size:
        return nothing
    base = _basis(controls)
    into = base.T @ slopes @ spread
    beside = base - slopes @ into.T
    kept = float(np.sum(base * beside))
    shown = _basis(beside) if np.linalg.norm(beside) > _NEW else beside[:, :0]
    if not shown.size:
        return nothing
    along = shown.T @ residual
    excess = float(along @ along) - shown.shape[1]
    most = float(np.max(size)) ** 2
    found: FloatArray = min(max(excess, 0.0) / kept, most) * (into.T @ into)
    return found


def _basis(columns: FloatArray) -> FloatArray:
    """Orthonormal (rows, k) of what columns of length 1 at most span."""
    left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    found: FloatArray = left[:, sizes > _NEW]
    return found


def controls_of(problem: Problem, x: FloatArray, masks: Masks) -> FloatArray:
    """Changes of the residuals (data, controls) by effects of their ordinary size.

    Of those that the model has not: what it has is fitted.
    """
    count = sum(
        len(record.measured) * int(np.sum(mask))
        for record, mask in zip(problem.plant.records, masks, strict=True)
    )
    wider, sizes = problem, []
    for name, effect in problem.plant.library.effects.items():
        if name in problem.effects:
            continue
        if all(parameter.ordinary > 0.0 for parameter in effect.parameters):
            wider = wider.with_effect(name, {})
            sizes += [usual(problem, x, parameter) for parameter in effect.parameters]
            place = np.concatenate([x, np.zeros(len(wider.tuned) - x.size)])
            # One after another: derivatives that are known are taken over.
            slopes = jacobian(wider, place, masks)
    if wider is problem:
        return np.zeros((count, 0))
    scales = [each.scale for each in wider.tuned[x.size :]]
    found: FloatArray = slopes[:count, x.size :] * np.array(sizes) / scales
    return found
