"""Springs that hold the ends of a cable, from a measured curve of force over extension.

    soft = fit_soft_end(extension, force, unloading=(back, force_back))
    cable.replace(end_compliance=soft.compliance, end_hardening=soft.hardening,
                  end_loss=soft.loss)

The law is that of `_elasticity.py`: extension = C ln(1 + h T) / h in loading from no
force, C T where h is 0. In MJCF the key `end_compliance` takes the loading curve itself
as words `extension:force`, and `fit_curve` gives its spring to plugin and Python alike.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco._utils.arguments import numbers
from cc_mujoco.cable._cable import PARAMETERS
from cc_mujoco.cable._parameter import Parameter
from cc_mujoco.errors import CableError, shown
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal

CURVE_TOLERANCE = 0.05
"""Error of an extension, by the range of its curve, above which a fit is no good."""
_TOLERANCE = Parameter("tolerance", low=0.0, high=1.0, low_open=True)
"""Bounds of a tolerance of that error."""
_BOUNDS = {p.name: p for p in PARAMETERS}


class SoftEnd(NamedTuple):
    """Parameters of a spring at an end of a cable, and how well they fit a table."""

    compliance: float  # at no tension [m/N]
    hardening: float  # [1/N], 0 where the spring is linear
    loss: float  # share of the work of loading
    residual: float  # largest error of an extension, by the range of the table


@internal
def _spring(points: FloatMatrix, count: int, x: float) -> SoftEnd:
    """Return the best spring whose hardening times the largest force is exp(x)."""
    first, top = points[0, 1], points[count - 1, 1]
    h = math.exp(x) / top
    across = along = worst = 0.0
    for i in range(count):
        shape = math.log1p(h * (points[i, 1] - first) / (1.0 + h * first)) / h
        across += shape * (points[i, 0] - points[0, 0])
        along += shape * shape
    scale = across / along
    for i in range(count):
        shape = math.log1p(h * (points[i, 1] - first) / (1.0 + h * first)) / h
        worst = max(worst, abs(scale * shape - (points[i, 0] - points[0, 0])))
    worst /= points[count - 1, 0] - points[0, 0]
    # As linear as any table can show: no hardening.
    return SoftEnd(scale, h if h * top > 1e-4 else 0.0, 0.0, worst)


@compiled
def fit_curve(points: FloatMatrix, count: int) -> SoftEnd:
    """Fit the spring to a loading curve of `count` rows, extension [m] and force [N].

    Its numbers are NaN unless the rows are at least 4, and rise from 0 N or more.
    """
    rises = count >= 4 and 0.0 <= points[0, 1] < points[count - 1, 1]
    for i in range(1, count):
        further = points[i, 0] > points[i - 1, 0]
        rises = rises and further and points[i, 1] >= points[i - 1, 1]
    if not rises:
        return SoftEnd(math.nan, math.nan, math.nan, math.nan)
    low, high = math.log(1e-6), math.log(1e4)
    for _ in range(60):
        step = 0.6180339887498949 * (high - low)  # of the golden section
        left, right = _spring(points, count, high - step), low + step
        if left.residual < _spring(points, count, right).residual:
            high = right
        else:
            low = high - step
    return _spring(points, count, low)


def fit_soft_end(
    extension: ArrayLike,
    force: ArrayLike,
    *,
    unloading: tuple[ArrayLike, ArrayLike] | None = None,
    tolerance: float = CURVE_TOLERANCE,
) -> SoftEnd:
    """Fit the spring at an end of a cable to a measured loading curve.

    Args:
        extension: extensions (k,) [m], rising, at least 4; their zero does not matter.
        force: forces (k,) [N], rising.
        unloading: extensions and forces [N] of the way back from the last point to no
            force, falling, for `loss`; loading must begin at no force, too.
        tolerance: largest `residual` that is accepted.

    Raises:
        CableError: other curves, a residual above `tolerance`, or parameters beyond the
            ranges of a `Cable`.
    """
    _TOLERANCE.check(tolerance)
    stretch, pull = _rising("loading", extension, force, 1.0)
    soft = fit_curve(np.column_stack([stretch, pull]), stretch.size)
    if soft.residual > tolerance:
        raise CableError(
            f"the loading curve is up to {soft.residual:.2g} of its range off "
            f"C ln(1 + h T) / h; no spring of a cable is within {tolerance:g} of it"
        )
    if unloading is not None:
        try:
            back, eased = unloading
        except (TypeError, ValueError):
            raise CableError(
                "unloading must be the pair of its extensions and its forces, not "
                f"{shown(unloading)}"
            ) from None
        back, eased = _rising("unloading", back, eased, -1.0)
        if max(pull[0], eased[0]) > 1e-2 * pull[-1]:
            raise CableError(
                "a loss is that of a loop from no force; the curves begin and end at "
                f"{pull[0]:g} N and {eased[0]:g} N"
            )
        returned = np.trapezoid(eased, back) / np.trapezoid(pull, stretch)
        soft = soft._replace(loss=1.0 - float(returned))
    for name, value in zip(("compliance", "hardening", "loss"), soft, strict=False):
        bounds = _BOUNDS[f"end_{name}"]
        if not bounds.admits(value):
            raise CableError(f"the {name} is {value:.3g}; it must be {bounds.allowed}")
    return soft


def _rising(
    what: str, extension: ArrayLike, force: ArrayLike, way: float
) -> tuple[FloatArray, FloatArray]:
    """Return checked extensions and forces in rising order; `way` -1 reverses them."""
    up = numbers(f"extension of the {what} curve", extension)
    pull = numbers(f"force of the {what} curve", force)
    if up.ndim != 1 or up.shape != pull.shape or up.size < 4:
        raise CableError(f"a {what} curve is two arrays of 4 or more numbers each")
    up, pull = up[:: int(way)], pull[:: int(way)]
    if np.any(np.diff(up) <= 0.0) or np.any(np.diff(pull) < 0.0) or not 0 <= pull[0]:
        raise CableError(
            f"extension and force of a {what} curve must "
            f"{'rise' if way > 0.0 else 'fall'} together, with no force below 0"
        )
    if pull[-1] == pull[0]:
        raise CableError(f"the {what} curve has one force, {pull[0]:g} N")
    return up, pull
