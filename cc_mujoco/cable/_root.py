"""Bracket of the root of a growing function, narrowed by regula falsi, compiled.

    bracket = root.UNKNOWN
    for _ in range(most):
        bracket = root.narrowed(bracket, at, error)      # error at this place
        if root.encloses(bracket):
            at = root.between(bracket)
        else:                                            # search further, step by step

The Illinois rule halves the error of an end that stays while the other moves twice, so
that both close in: M. Dowell and P. Jarratt, "A modified regula falsi method", BIT 11,
1971.
"""

import math
from typing import NamedTuple

from cc_mujoco.native import internal


class Bracket(NamedTuple):
    """Places on either side of a root, and the errors there."""

    low: float  # largest place known to lie before the root; -inf until one is found
    f_low: float  # error there, halved by the Illinois rule; negative
    high: float  # smallest place known to lie at or beyond it; inf until one is found
    f_high: float  # error there, halved by the Illinois rule
    side: float  # 1 if the last place became `high`, -1 if `low`, 0 at first


UNKNOWN = Bracket(-math.inf, 0.0, math.inf, 0.0, 0.0)
"""Bracket before the first evaluation."""


@internal
def narrowed(bracket: Bracket, at: float, error: float) -> Bracket:
    """Return the bracket after evaluating an `error`, negative below the root."""
    if error < 0.0:
        halved = 0.5 if bracket.side < 0.0 else 1.0
        return Bracket(at, error, bracket.high, halved * bracket.f_high, -1.0)
    halved = 0.5 if bracket.side > 0.0 else 1.0
    return Bracket(bracket.low, halved * bracket.f_low, at, error, 1.0)


@internal
def encloses(bracket: Bracket) -> bool:
    """Return whether places on both sides of the root are known."""
    return bracket.low > -math.inf and bracket.high < math.inf


@internal
def between(bracket: Bracket) -> float:
    """Return the next place to evaluate, within a bracket that encloses the root."""
    low, high = bracket.low, bracket.high
    at = low - bracket.f_low * (high - low) / (bracket.f_high - bracket.f_low)
    return 0.5 * (low + high) if at <= low or at >= high else at
