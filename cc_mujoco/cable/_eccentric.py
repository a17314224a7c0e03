"""Proximal pulley whose axis is off its centre, or which is not round.

At pulley angle q the cable leaves it at radius r0 + e cos(q - p) + o cos(2 q - s), so
that it has wound up

    r0 q + e (sin(q - p) + sin(p)) + o/2 (sin(2 q - s) + sin(s)).

Both functions take the signed `gear`, whose magnitude is r0 [m], and the `length` gear
q that a round pulley winds up [m].
"""

import math

from cc_mujoco.cable._friction import PLACE
from cc_mujoco.native import FloatArray, internal


@internal
def is_round(prm: FloatArray) -> bool:
    return float(prm[PLACE.eccentricity]) == 0.0 and float(prm[PLACE.ovality]) == 0.0


@internal
def wound_length(prm: FloatArray, length: float, gear: float) -> float:
    """Return the length [m] wound up where a round pulley winds up `length` [m]."""
    if is_round(prm):
        return length
    q, ovality = length / gear, prm[PLACE.ovality]
    e, phase = prm[PLACE.eccentricity], prm[PLACE.eccentricity_phase]
    swing = e * (math.sin(q - phase) + math.sin(phase))
    if ovality != 0.0:
        second = prm[PLACE.ovality_phase]
        swing += 0.5 * ovality * (math.sin(2.0 * q - second) + math.sin(second))
    return float(length + swing if gear > 0.0 else length - swing)


@internal
def lever_ratio(prm: FloatArray, length: float, gear: float) -> float:
    """Return the lever arm of the tension over the mean radius [-]."""
    if is_round(prm):
        return 1.0
    q = length / gear
    wave = prm[PLACE.eccentricity] * math.cos(q - prm[PLACE.eccentricity_phase])
    if prm[PLACE.ovality] != 0.0:
        wave += prm[PLACE.ovality] * math.cos(2.0 * q - prm[PLACE.ovality_phase])
    return float(1.0 + wave / abs(gear))
