"""A proximal pulley whose axis is off its centre.

At pulley angle q the cable leaves it at radius r0 + e cos(q - phase), so that it has
wound up r0 q + e (sin(q - phase) + sin(phase)). Both functions are of the signed gear,
whose magnitude is r0, and of the length gear q that a round pulley winds up.
"""

from __future__ import annotations

import math

from cc_mujoco.compiled import compiled


@compiled
def wound(length: float, gear: float, eccentricity: float, phase: float) -> float:
    """Displacement of the cable on the pulley [m]."""
    if eccentricity == 0.0:
        return length
    swing = math.sin(length / gear - phase) + math.sin(phase)
    return length + math.copysign(eccentricity, gear) * swing


@compiled
def lever(length: float, gear: float, eccentricity: float, phase: float) -> float:
    """Radius over mean radius, with which a tension acts on the pulley."""
    if eccentricity == 0.0:
        return 1.0
    return 1.0 + eccentricity / abs(gear) * math.cos(length / gear - phase)
