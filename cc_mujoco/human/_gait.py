"""Level walking as harmonic series: joint angles and the assistance of a soft exosuit.

    >>> from cc_mujoco.human._gait import GAIT_ANGLES, assistance
    >>> round(GAIT_ANGLES["ankle"](0.5), 2)          # rad, dorsiflexed before push-off
    0.23
    >>> round(assistance(0.1), 2), round(assistance(0.52), 1)
    (0.0, 1.0)

The gait cycle runs from one heel strike (phase 0) to the next of the same leg. Angles
are in the convention of the data: ankle positive in dorsiflexion, knee negative in
flexion, hip positive in flexion. `gait.csv` states the source and the fit errors.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cc_mujoco.human._pace import Real


@dataclass(frozen=True)
class Harmonics:
    """Fourier series in the phase p, of period 1.

    f(p) = sum over k of a_k cos(2 pi k p) + b_k sin(2 pi k p), k = 0 .. n.
    """

    coefficients: tuple[tuple[float, float], ...]  # pairs (a_k, b_k), from k = 0

    def __call__(self, phase: Real) -> Real:
        """Evaluate the series at phases, elementwise, with equal bits for scalars."""
        turn = 2 * np.pi * phase
        cosine, sine = np.cos(turn), np.sin(turn)
        if not isinstance(turn, np.ndarray):
            cosine, sine = float(cosine), float(sine)
        # Horner's rule on the real part of sum (a_k - i b_k) z^k with z = exp(i turn).
        # In real arithmetic, because complex products round differently in vectors.
        last_a, last_b = self.coefficients[-1]
        real, imaginary = last_a + 0 * cosine, -last_b + 0 * cosine
        for a, b in reversed(self.coefficients[:-1]):
            before = real
            real = before * cosine - imaginary * sine + a
            imaginary = before * sine + imaginary * cosine - b
        return real

    def derivative(self) -> Harmonics:
        pairs = enumerate(self.coefficients)
        turned = ((2 * np.pi * k * b, -2 * np.pi * k * a) for k, (a, b) in pairs)
        return Harmonics(tuple(turned))


def _read_profiles() -> dict[str, Harmonics]:
    pairs: dict[str, list[tuple[float, float]]] = {}
    with Path(__file__).with_name("gait.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(line for line in file if line[0] != "#"):
            pair = float(row["cosine"]), float(row["sine"])
            pairs.setdefault(row["profile"], []).append(pair)
    return {name: Harmonics(tuple(own)) for name, own in pairs.items()}


_PROFILES = _read_profiles()

GAIT_ANGLES = {name: _PROFILES[name] for name in ("ankle", "knee", "hip")}
"""Joint angles [rad] over the gait cycle."""

GAIT_MOMENTS = {name: _PROFILES[f"{name}_moment"] for name in GAIT_ANGLES}
"""Moments of the muscles about the joints over the gait cycle [N m], of the same walk,
positive as the angles are: that of the ankle is negative in plantarflexion."""

GAIT_PERIOD = 1.23
"""Duration of a gait cycle of the measured walk [s]."""


def assistance(phase: Real) -> Real:
    """Return the plantarflexion assistance at a phase, as a fraction of its peak [-].

    It is elementwise. It is the square of a harmonic series, hence smooth and never
    negative, and at most 0.01 where the source has no assistance.
    """
    root = _PROFILES["assistance_root"](phase)
    return root * root


SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}


class GaitJoint(NamedTuple):
    """Joint of a device, and the joint of the measured gait whose angle it follows."""

    name: str
    part: str  # of the measured leg: `ankle`, `knee` or `hip`
    other_leg: bool = False  # half a cycle behind the first leg
    turned: bool = False  # its positive direction is opposite to that of the data
    shift: float = 0.0  # added to its angle, so that it stays in the range [rad]


def gait_joints(joints: Mapping[str, tuple[float, float]]) -> tuple[GaitJoint, ...]:
    """Return the joints of a device that a gait moves, in the order given.

    >>> for joint in gait_joints({"left_knee": (0.0, 2.0), "knee_r": (-2.0, 0.0)}):
    ...     print(*joint)
    left_knee knee False True 0.017
    knee_r knee True False -0.017

    A joint takes part if its name contains `ankle`, `knee` or `hip` and no word of
    another axis, such as `adduction`. The leg of the first joint that names a side
    leads, the other follows half a cycle later. A joint is turned if its range [rad]
    contains the angles of the gait only with the opposite sign, such as a knee with
    positive flexion. It is shifted by up to 0.03 rad if its range falls short of them,
    such as a knee that cannot hyperextend.
    """
    other_axes = {"adduction", "abduction", "rotation", "inversion", "eversion"}
    other_axes |= {"x", "z", "yaw", "roll"}
    found, lead = [], ""
    for name, ends in joints.items():
        spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)  # `LeftKnee`
        words = [word for word in re.split(r"[^a-z]+", spaced.lower()) if word]
        part = next((one for one in GAIT_ANGLES if one in name.lower()), "")
        if not part or other_axes.intersection(words):
            continue
        side = next((SIDES[word] for word in words if word in SIDES), "")
        lead = lead or side
        is_other = bool(side and side != lead)
        found.append(GaitJoint(name, part, is_other, *_fit(part, ends)))
    return tuple(found)


def _fit(part: str, ends: tuple[float, float]) -> tuple[bool, float]:
    """Return whether a range needs the gait's angles negated, and a shift [rad]."""
    # The largest excursion at any speed
    angles = 1.1 * GAIT_ANGLES[part](np.linspace(0.0, 1.0, 2001))
    least, most = float(angles.min()), float(angles.max())
    for turned, (low, high) in ((False, (least, most)), (True, (-most, -least))):
        up, down = max(ends[0] - low, 0.0), max(high - ends[1], 0.0)
        if max(up, down) <= 0.03 and not (up and down):
            return turned, math.ceil(1e3 * up) / 1e3 - math.ceil(1e3 * down) / 1e3
    return False, 0.0
