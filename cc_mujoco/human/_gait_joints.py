"""Joints of a device that take part in a gait, found by their names.

>>> from cc_mujoco.human._gait_joints import gait_joints
>>> for joint in gait_joints({"left_knee": (0.0, 2.0), "knee_r": (-2.0, 0.0)}):
...     print(*joint)
left_knee knee False True 0.017
knee_r knee True False -0.017
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from cc_mujoco.human._gait import GAIT_ANGLES

SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}


class GaitJoint(NamedTuple):
    """Joint of a device, and the measured joint that moves it."""

    name: str
    part: str  # of the measured leg: `ankle`, `knee` or `hip`
    other_leg: bool = False  # half a cycle behind the first leg
    turned: bool = False  # its positive direction is opposite to that of the data
    shift: float = 0.0  # added to its angle, so that it stays in the range [rad]


def gait_joints(joints: Mapping[str, tuple[float, float]]) -> tuple[GaitJoint, ...]:
    """Return the joints of a device that a gait moves.

    A joint takes part if its name contains `ankle`, `knee` or `hip` and no word of
    another axis, such as `adduction`. The leg of the first joint that names a side is
    the first leg. A joint is turned where its range [rad] holds the angles of the gait
    with the opposite sign only, such as a knee whose flexion is positive, and shifted
    by up to 0.03 rad where it stops short of them, such as a knee that cannot
    hyperextend. The driven joint is the first.
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
    """Return whether a joint is turned, and its shift [rad]."""
    # The largest excursion at any speed
    angles = 1.1 * GAIT_ANGLES[part](np.linspace(0.0, 1.0, 2001))
    least, most = float(angles.min()), float(angles.max())
    for turned, (low, high) in ((False, (least, most)), (True, (-most, -least))):
        up, down = max(ends[0] - low, 0.0), max(high - ends[1], 0.0)
        if max(up, down) <= 0.03 and not (up and down):
            return turned, math.ceil(1e3 * up) / 1e3 - math.ceil(1e3 * down) / 1e3
    return False, 0.0
