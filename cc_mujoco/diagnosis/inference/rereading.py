"""Angles as they may have been, and as they might have been read another time.

What is played has lost what its filters took: movements smaller than the play that
stills it. Read again, it would lose nothing, so the noise of a motor that goes along
with a hand, of slow creep and of rests would seem small. And it has kept what they let
pass: the ripple of digits, which would count twice where the angle moves. So what is
read again is a likely motion: with the slow movements put back, and without ripple.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.data.channels import JOINT_ANGLE, MOTOR_ANGLE
from cc_mujoco.diagnosis.data.digits import made_whole
from cc_mujoco.diagnosis.data.trials import Noise
from cc_mujoco.diagnosis.inference.passing import low_passed
from cc_mujoco.diagnosis.inference.records import Filtering, Record, play_filter

_SLOW = 1.0 / 6.0
"""Band of the movements that are put back, over that of the angles that are played."""
_PUT_BACK = 0.5
"""Share of them: some of what is slow is noise, and most of it where readings are
rounded. On rigs without effects this makes the floor what readings are off by."""
_SMOOTH = 1.0 / 5.0
"""Band of the likely motion where the angle is well under way, the same."""
_PACE = 4.0
"""Way within `_WINDOW` from which an angle is under way, over the play."""
_WINDOW = 0.05
"""[s]."""
_CLEAR = 0.2
"""Time all of which an angle has to be under way; where it rests, smoothing would make
it set out early, which a cable that sticks would feel [s]."""


def likely(record: Record, filtering: Filtering) -> Record:
    """The record along a motion whose reading may have been this one."""
    motor, joint = (
        _likely(angle, seen, width, record.dt, filtering.motion_band)
        for angle, seen, width in zip(
            (record.motor_angle, record.joint_angle),
            record.read,
            filtering.still,
            strict=True,
        )
    )
    return replace(record, motor_angle=motor, joint_angle=joint)


def _likely(
    angle: FloatArray, seen: FloatArray, width: float, dt: float, band: float
) -> FloatArray:
    from scipy.ndimage import minimum_filter1d, uniform_filter1d

    if width == 0.0:
        return angle
    hidden = low_passed(seen - angle, _SLOW * band, 1.0 / dt)
    found = angle + _PUT_BACK * hidden
    smooth = low_passed(found, _SMOOTH * band, 1.0 / dt)
    half = max(1, round(0.5 * _WINDOW / dt))
    wide = np.pad(smooth, half, mode="edge")
    moves = np.abs(wide[2 * half :] - wide[: -2 * half]) > _PACE * width
    clear = minimum_filter1d(moves.astype(float), 2 * round(0.5 * _CLEAR / dt) + 1)
    share: FloatArray = uniform_filter1d(clear, 2 * half + 1)
    return found + share * (smooth - found)


def drawn(
    record: Record,
    noise: Mapping[str, Noise],
    filtering: Filtering,
    random: np.random.Generator,
) -> Record:
    """The record as it might have been read another time."""
    angles = (record.motor_angle, record.joint_angle)
    read = [
        _read_again(record, angle, noise[name], width, filtering, random)
        for angle, name, width in zip(
            angles, (MOTOR_ANGLE, JOINT_ANGLE), filtering.still, strict=True
        )
    ]
    return replace(record, motor_angle=read[0], joint_angle=read[1])


def _read_again(
    record: Record,
    angle: FloatArray,
    noise: Noise,
    width: float,
    filtering: Filtering,
    random: np.random.Generator,
) -> FloatArray:
    """An angle read by a sensor with the same noise and digits that begin elsewhere.

    Rounding is no white noise: at rest and in slow creep the angle wanders inside a
    digit, and no filter takes that out.
    """
    if noise.deviation == 0.0:
        return angle
    thin = round(record.dt / record.step)
    size = (angle.size - 1) * thin + 1
    read = np.interp(np.arange(size) / thin, np.arange(angle.size), angle)
    digit = noise.resolution
    white = max(noise.deviation**2 - digit**2 / 12.0, 0.0)
    read += math.sqrt(white) * random.normal(size=size)
    if digit > 0.0:
        first = random.uniform(0.0, digit)
        read = first + digit * np.round((read - first) / digit)
        read = made_whole(read, noise)
    smooth = low_passed(read, filtering.motion_band, 1.0 / record.step)[::thin]
    return play_filter(smooth, width)


def unsettled(
    record: Record, filtering: Filtering, random: np.random.Generator
) -> Record:
    """The record with movements that are too small to be seen."""
    motor, joint = (
        angle + _unseen(angle, width, random)
        for angle, width in zip(
            (record.motor_angle, record.joint_angle), filtering.still, strict=True
        )
    )
    return replace(record, motor_angle=motor, joint_angle=joint)


def _unseen(angle: FloatArray, width: float, random: np.random.Generator) -> FloatArray:
    """Movement that may have happened where the angle was taken to stand still.

    As far as the play filter lets it: a servo that integrates, or a hand that lets go,
    creeps to the end of it.
    """
    moved = np.zeros(angle.size)
    edges = np.flatnonzero(np.diff(angle) != 0.0)
    for first, last in pairwise([-1, *edges.tolist(), angle.size - 1]):
        size = last - first
        if size > 2:
            bump = np.sin(np.pi * np.arange(1, size + 1) / (size + 1))
            moved[first + 1 : last + 1] = random.uniform(-width, width) * bump
    return moved
