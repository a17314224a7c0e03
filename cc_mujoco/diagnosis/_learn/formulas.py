"""Formulas that a learned curve may have, with one or two parameters of shape."""

import itertools
import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from cc_mujoco.diagnosis._phrases import format_number
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.native import FloatArray


class Formula(NamedTuple):
    # Functions (k, samples) of values (samples,), whose sum the torque is
    functions: Callable[..., list[FloatArray]]
    words: str  # of quantity `over`, unit `unit` and shape `a`, `w`
    place: bool = False  # whether it has a place `a`
    width: bool = False  # whether it has a width `w`, of a sine period / 2 pi


def _bump(x: FloatArray, a: float, w: float) -> FloatArray:
    return np.asarray(np.exp(-np.square((x - a) / w)))


FORMULAS: Mapping[str, Formula] = {
    "sine": Formula(
        lambda x, w: [np.sin(x / w), np.cos(x / w)], "a periodic error", width=True
    ),
    "bump": Formula(
        lambda x, a, w: [_bump(x, a, w)], "a bump at {a} {unit}", True, True
    ),
    "catch": Formula(
        lambda x, a, w: [(x - a) / w * _bump(x, a, w)],
        "a catch at {a} {unit} that pulls to or from it", True, True,
    ),
    "step": Formula(
        lambda x, a, w: [np.tanh((x - a) / w)], "a step at {a} {unit}", True, True
    ),
    "stop": Formula(
        lambda x, a: [np.maximum(x - a, 0.0)], "a rise from {a} {unit} on", True
    ),
    "start": Formula(
        lambda x, a: [np.minimum(x - a, 0.0)], "a rise up to {a} {unit}", True
    ),
    "linear": Formula(lambda x: [x], "a torque proportional to the {over}"),
    "square": Formula(lambda x: [x**2], "the square of the {over}"),
    "cube": Formula(lambda x: [x**3], "the cube of the {over}"),
    "size": Formula(lambda x: [np.abs(x)], "the size of the {over}"),
    "signed square": Formula(
        lambda x: [x * np.abs(x)], "the square of the {over}, with its sign"
    ),
}  # fmt: skip
"""Formulas of one quantity, by name."""


def shapes(formula: Formula, at: FloatArray, period: float) -> list[tuple[float, ...]]:
    """Return candidate shapes (place, width) of a formula for table points `at`."""
    span = float(at[-1] - at[0])
    widths = [share * span for share in Limit.formula_widths]
    if not formula.place:  # of a sine, up to the periods that the points resolve
        waves = np.arange(0.5, at.size / 2.5, 0.125)
        widths = (span / math.tau / waves).tolist()
        widths = [period / math.tau] if period else widths
    places = np.linspace(at[0], at[-1], 3 * at.size).tolist()
    parts = [places] * formula.place + [widths] * formula.width
    return list(itertools.product(*parts))


def best_shape(
    formula: Formula, at: FloatArray, tables: FloatArray, period: float
) -> tuple[float, ...]:
    """Return the candidate shape closest to `tables` (rows, points) at `at` (points,).

    A constant counts for nothing, as offsets are tuned.
    """
    best: tuple[float, ...] = ()
    least = math.inf
    for shape in shapes(formula, at, period):
        columns = np.array([np.ones(at.size), *formula.functions(at, *shape)]).T
        left = tables.T - columns @ np.linalg.lstsq(columns, tables.T)[0]
        if (size := float(np.sum(left**2))) < least:
            best, least = shape, size
    return best


def neighbours(
    name: str, shape: tuple[float, ...], part: float
) -> list[tuple[float, ...]]:
    """Return shapes with width times or over 1 + `part`, or place +-`part` widths."""
    formula = FORMULAS[name]
    if not formula.width:
        return []
    *place, width = shape
    found = [(*place, width * factor) for factor in (1.0 + part, 1.0 / (1.0 + part))]
    if name == "sine":  # whose many periods tell its width more exactly
        return [(width * (1.0 + by),) for by in (0.05 * part, -0.05 * part)]
    return found + [(a + by * width, width) for a in place for by in (part, -part)]


def described(name: str, over: str, unit: str, shape: tuple[float, ...]) -> str:
    formula = FORMULAS[name]
    if name == "sine":
        return f"{formula.words} of the {over}, {repeating(math.tau * shape[0], unit)}"
    place = format_number(shape[0]) if formula.place else ""
    text = formula.words.format(over=over, unit=unit, a=place)
    return f"{text}, {format_number(shape[1])} {unit} wide" if formula.width else text


def repeating(period: float, unit: str) -> str:
    """Return a period in words, of an angle as periods per turn."""
    if unit == "rad":
        return f"{format_number(math.tau / period)} per turn"
    return f"again after {format_number(period)} {unit}"
