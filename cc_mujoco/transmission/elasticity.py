"""Tension and stretch of a piece of cable: linear, or stiffer the more it is pulled.

With stiffening, EA grows as EA (1 + s T), so that

    strain(T) = ln(1 + s T) / (s EA),    T(strain) = (exp(s EA strain) - 1) / s,

as strands bed in (bedding-in stiffness of stranded cables). A slack cable, of negative
tension, is linear. `spring` is a compliance in series [m/N]. Tension follows from
stretch alone, so no path of motion leaves anything behind.
"""

from __future__ import annotations

import math

from cc_mujoco.compiled import internal

STIFFEST = 100.0
"""Beyond this multiple of its first stiffness a cable stiffens no more."""


@internal
def stretch_of(
    tension: float, length: float, ea: float, stiffening: float, spring: float
) -> float:
    """Stretch [m] at a tension [N]."""
    if tension <= 0.0 or stiffening == 0.0:
        return tension * (length / ea + spring)
    most = STIFFEST - 1.0
    x = stiffening * tension
    strain = math.log1p(min(x, most))
    if x > most:
        strain += (x - most) / STIFFEST
    return length * strain / (stiffening * ea) + spring * tension


@internal
def compliance_at(
    tension: float, length: float, ea: float, stiffening: float, spring: float
) -> float:
    """Derivative of the stretch by the tension [m/N]."""
    factor = min(1.0 + stiffening * max(tension, 0.0), STIFFEST)
    return length / (ea * factor) + spring


@internal
def tension_of(
    stretch: float, length: float, ea: float, stiffening: float, spring: float
) -> float:
    """Tension [N] at a stretch [m], by Newton's method on a concave function."""
    if stretch <= 0.0 or stiffening == 0.0:
        return stretch / (length / ea + spring)
    tension = 0.0
    if spring == 0.0:
        # Exact without a spring, and then refined once like the rest.
        exponent = min(stiffening * ea * stretch / length, math.log(STIFFEST))
        tension = math.expm1(exponent) / stiffening
    for _ in range(100):
        error = stretch - stretch_of(tension, length, ea, stiffening, spring)
        change = error / compliance_at(tension, length, ea, stiffening, spring)
        tension += change
        if abs(change) <= 1e-15 * tension:
            break
    return max(tension, 0.0)


@internal
def energy_at(
    tension: float, length: float, ea: float, stiffening: float, spring: float
) -> float:
    """Elastic energy [J] at a tension [N]; none where slack."""
    if tension <= 0.0:
        return 0.0
    energy = 0.5 * spring * tension**2
    most = STIFFEST - 1.0
    x = min(stiffening * tension, most)
    if x < 1e-3:
        # Series of x - ln(1 + x), which loses its digits here.
        series = 0.5 - x * (1.0 / 3.0 - x * (0.25 - x * 0.2))
        return energy + length / ea * tension**2 * series
    energy += length * (x - math.log1p(x)) / (ea * stiffening**2)
    beyond = tension - most / stiffening
    if beyond > 0.0:
        mean = tension - 0.5 * beyond
        energy += length * mean * beyond / (ea * STIFFEST)
    return energy
