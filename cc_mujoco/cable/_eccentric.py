"""A proximal pulley whose axis is off its centre, or which is not round.

At pulley angle q the cable leaves it at radius r0 + e cos(q - p) + o cos(2 q - s), so
that it has wound up

    r0 q + e (sin(q - p) + sin(p)) + o/2 (sin(2 q - s) + sin(s)).

Both functions are of the signed gear, whose magnitude is r0, and of the length gear q
that a round pulley winds up.
"""

from __future__ import annotations

import math

from cc_mujoco.native import internal


@internal
def wound_length(
    length: float, gear: float, e: float, phase: float, ovality: float, second: float
) -> float:
    """Return the length wound up where a round pulley would wind up `length` [m].

    `gear` is the signed mean radius, `e` the eccentricity [m] at the angle `phase`
    [rad]; `ovality` is the amplitude of the radius twice a turn [m], at `second` [rad].
    """
    if e == 0.0 and ovality == 0.0:
        return length
    q = length / gear
    swing = e * (math.sin(q - phase) + math.sin(phase))
    if ovality != 0.0:
        swing += 0.5 * ovality * (math.sin(2.0 * q - second) + math.sin(second))
    return length + swing if gear > 0.0 else length - swing


@internal
def lever_ratio(
    length: float, gear: float, e: float, phase: float, ovality: float, second: float
) -> float:
    """Return the lever arm of a tension over the mean radius, see `wound_length`."""
    if e == 0.0 and ovality == 0.0:
        return 1.0
    q = length / gear
    wave = e * math.cos(q - phase)
    if ovality != 0.0:
        wave += ovality * math.cos(2.0 * q - second)
    return 1.0 + wave / abs(gear)
