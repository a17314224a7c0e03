"""Bends of a moving conduit: turning angles along a spatial tendon, compiled.

MuJoCo computes the path of a tendon at every evaluation: sites, and the two points at
which it touches and leaves a geom that it wraps. From these points the wrap angle of
each segment of a cable follows, without memory of its own:

- Around a geom the path bends evenly along the arc, a great circle of a sphere or a
  helix on a cylinder.
- A site stands for a point of a smooth curve. Its turning angle is spread evenly from
  half-way to the site before it to half-way to the next, so that a polygon of equal
  chords has the even curvature of its circle and bends move along the cable without
  jumps. Sites close together make a tight bend.
- The conduit keeps its length. A path that gets shorter or longer carries its bends
  along in proportion.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import numpy.typing as npt

from cc_mujoco.plugin import _mj_struct as mj_struct
from cc_mujoco.plugin._ffi import fill, internal, load_real, load_word

Floats = npt.NDArray[np.float64]
Point = tuple[float, float, float]

_SPHERE = int(mujoco.mjtGeom.mjGEOM_SPHERE)
_PULLEY = int(mujoco.mjtWrap.mjWRAP_PULLEY)

MIN_PIECE_LENGTH = 1e-9
"""Pieces of the path below this length have no direction [m]."""
_MIN_ARC_ANGLE = -1e-6
"""An arc's angle above this is 0 with rounding, not almost a full turn [rad]."""


@internal
def has_branches(model: int, tendon: int) -> bool:
    """Return whether a spatial tendon has pulleys, which divide it into branches."""
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    for i in range(
        start, start + mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    ):
        if mj_struct.integer(model, mj_struct.WRAP_TYPE, i) == _PULLEY:
            return True
    return False


@internal
def angle_between(a: Point, b: Point) -> float:
    """Return the angle between two directions [rad]; both of length 1."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    # The square of the sine of half the angle; arcsine by its series where it is small.
    q = 0.25 * (x * x + y * y + z * z)
    if q < 0.01:
        series = 35.0 / 1152.0 + q * (63.0 / 2816.0 + q * (231.0 / 13312.0))
        series = 3.0 / 40.0 + q * (5.0 / 112.0 + q * series)
        return 2.0 * math.sqrt(q) * (1.0 + q * (1.0 / 6.0 + q * series))
    u = a[1] * b[2] - a[2] * b[1]
    v = a[2] * b[0] - a[0] * b[2]
    w = a[0] * b[1] - a[1] * b[0]
    dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return math.atan2(math.sqrt(u * u + v * v + w * w), dot)


@internal
def _distribute_angle(
    out: Floats,
    length: Floats,
    scale: float,
    begin: float,
    end: float,
    angle: float,
    j: int,
    stop: float,
) -> tuple[int, float]:
    """Add an angle evenly over the path from `begin` to `end` [m].

    `scale` is metres of segments, of `length` each, per metre of path; what lies
    outside goes to the nearest end. Nothing begins before segment j, which ends at
    `stop`; the same of the next part of the path is returned.
    """
    last = out.size - 1
    a = max(begin * scale, 0.0)
    b = max(end * scale, a)
    while j < last and stop <= a:
        j += 1
        stop += length[j]
    while j < last and stop < b:
        part = angle * (stop - a) / (b - a)
        out[j] += part
        angle, a = angle - part, stop
        j += 1
        stop += length[j]
    out[j] += angle
    return j, stop


@internal
def arc(
    model: int,
    data: int,
    geom: int,
    p: tuple[float, float, float],
    q: tuple[float, float, float],
    d: tuple[float, float, float],
) -> tuple[float, float]:
    """Return the length [m] and turning angle [rad] of the path around a geom.

    It touches at p, arriving in direction d, and leaves at q.
    """
    at = load_word(data + mj_struct.GEOM_XPOS) + 24 * geom
    c = load_real(at), load_real(at + 8), load_real(at + 16)
    r = p[0] - c[0], p[1] - c[1], p[2] - c[2]
    s = q[0] - c[0], q[1] - c[1], q[2] - c[2]
    # The path turns about this axis.
    x = r[1] * d[2] - r[2] * d[1]
    y = r[2] * d[0] - r[0] * d[2]
    z = r[0] * d[1] - r[1] * d[0]
    along = 0.0
    if mj_struct.integer(model, mj_struct.GEOM_TYPE, geom) != _SPHERE:
        frame = load_word(data + mj_struct.GEOM_XMAT) + 72 * geom
        axis = load_real(frame + 16), load_real(frame + 40), load_real(frame + 64)
        sense = 1.0 if x * axis[0] + y * axis[1] + z * axis[2] >= 0.0 else -1.0
        x, y, z = sense * axis[0], sense * axis[1], sense * axis[2]
        low = r[0] * x + r[1] * y + r[2] * z
        high = s[0] * x + s[1] * y + s[2] * z
        r = r[0] - low * x, r[1] - low * y, r[2] - low * z
        s = s[0] - high * x, s[1] - high * y, s[2] - high * z
        along = high - low
    size = math.sqrt(x * x + y * y + z * z)
    cross = (
        x * (r[1] * s[2] - r[2] * s[1])
        + y * (r[2] * s[0] - r[0] * s[2])
        + z * (r[0] * s[1] - r[1] * s[0])
    )
    turned = math.atan2(cross / size, r[0] * s[0] + r[1] * s[1] + r[2] * s[2])
    if turned < _MIN_ARC_ANGLE:
        turned += 2.0 * math.pi
    turned = max(turned, 0.0)
    radius = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    around = radius * turned
    length = math.sqrt(around * around + along * along)
    # A helix bends less than its circle.
    return length, turned * around / length if length > 0.0 else 0.0


@internal
def bend(
    model: int,
    data: int,
    tendon: int,
    count: int,
    total: float,
    segments: Floats,
    out: Floats,
) -> None:
    """Wrap angle of each segment of a conduit along a path.

    Args:
        model: address of the model.
        data: address of the data; the path is that of its last evaluated position.
        tendon: index of a spatial tendon without pulleys.
        count: number of points of its path that the conduit follows, from the first.
        total: length of the path up to there [m].
        segments: length of each segment (n,) [m].
        out: out, wrap angles from the first point to the last (n,) [rad].
    """
    fill(out, 0.0)
    if not total > 0.0:
        return
    scale = segments.sum() / total
    start = mj_struct.integer(data, mj_struct.TEN_WRAPADR, tendon)
    points = load_word(data + mj_struct.WRAP_XPOS) + 24 * start
    p = load_real(points), load_real(points + 8), load_real(points + 16)
    d, directed = (0.0, 0.0, 0.0), False  # in which the path arrives at p
    wrapped = -1  # the geom that the path touches at p
    reached = 0.0  # length of the path up to p
    corner, begin, angle = (
        0.0,
        0.0,
        0.0,
    )  # the last site: where, its bend from, its turn
    j, stop = 0, segments[0]
    for i in range(1, count):
        points += 24
        q = load_real(points), load_real(points + 8), load_real(points + 16)
        x, y, z = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        length = math.sqrt(x * x + y * y + z * z)
        geom = mj_struct.integer(data, mj_struct.WRAP_OBJ, start + i)
        leaves = geom >= 0 and geom == wrapped
        wrapped = -1 if leaves else geom
        if length <= MIN_PIECE_LENGTH:
            continue
        if leaves and directed:
            length, turned = arc(model, data, geom, p, q, d)
            # What the site before turns is yet to be spread, over what lies before.
            _distribute_angle(
                out, segments, scale, reached, reached + length, turned, j, stop
            )
            directed = False
        else:
            x, y, z = x / length, y / length, z / length
            if directed:
                middle = 0.5 * (corner + reached)
                j, stop = _distribute_angle(
                    out, segments, scale, begin, middle, angle, j, stop
                )
                angle = angle_between(d, (x, y, z))
                corner, begin = reached, middle
            d, directed = (x, y, z), True
        p = q
        reached += length
    middle = 0.5 * (corner + reached)
    _distribute_angle(out, segments, scale, begin, middle, angle, j, stop)
