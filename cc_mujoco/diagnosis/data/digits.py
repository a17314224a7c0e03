"""Angles of encoders that round: what is known of them between two digits.

Where a reading jumps from one digit to the next, the angle stands at the edge between
them, better known than anywhere else. In slow creep the jumps are all there is: taken
as steps, they would shake a cable that sticks.
"""

from __future__ import annotations

import math

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.data.trials import Noise

_ROUNDED = 1.5
"""Variance over that of rounding up to which the digits tell more than the mean."""


def made_whole(reading: FloatArray, noise: Noise | None) -> FloatArray:
    """The angle (samples,) behind a reading that was rounded; else the reading.

    It passes the edges when the reading jumps. Between two jumps the same way it goes
    on at the pace of its neighbours to the middle of the digit, and rests there if it
    is early; between two that go back over the same edge it turns as far as that pace
    takes a parabola, at most to the middle.

    Args:
        reading: (samples,).
        noise: of the channel; rounding must be nearly all of it.
    """
    if noise is None or not 0.0 < noise.resolution:
        return reading
    if noise.deviation > math.sqrt(_ROUNDED / 12.0) * noise.resolution:
        return reading
    step = np.diff(reading)
    before = np.flatnonzero(np.abs(step) > 0.5 * noise.resolution)
    if before.size < 3:
        return reading
    when, way = before + 0.5, np.sign(step[before])
    edge = reading[before] + 0.5 * step[before]
    dwell = np.diff(when)
    earlier = np.concatenate([dwell[:1], dwell[:-1]])
    later = np.concatenate([dwell[1:], dwell[-1:]])
    level = reading[before[:-1] + 1]
    turns = way[:-1] != way[1:]
    reach = np.where(turns, np.minimum(dwell / (earlier + later), 1.0), 1.0)
    value = edge[:-1] + reach * (level - edge[:-1])
    arrive = when[:-1] + 0.5 * np.minimum(dwell, earlier)
    leave = when[1:] - 0.5 * np.minimum(dwell, later)
    x = np.concatenate([when, arrive, leave])
    y = np.concatenate([edge, value, value])
    order = np.argsort(x, kind="stable")
    found: FloatArray = np.interp(np.arange(reading.size), x[order], y[order])
    # Before the first jump and after the last there is a digit only.
    found[: before[0] + 1] = reading[: before[0] + 1]
    found[before[-1] + 1 :] = reading[before[-1] + 1 :]
    return found
