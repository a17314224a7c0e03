"""Geometry of the path of a tendon over sites and geoms, compiled.

A path is given by its places (sites and geoms) in order: `PLACE_SIZE` numbers each. A
geom is touched at one point and left at another; a site is one point.

From these points the wrap angle of each segment of a conduit follows (`bend`); no state
is needed:

- Around a geom the path bends evenly along the arc, a great circle of a sphere or a
  helix on a cylinder.
- A site stands for a point of a smooth curve. Its turning angle is spread evenly from
  half-way to the site before it to half-way to the next, so that a polygon of equal
  chords has the even curvature of its circle and bends move along the cable without
  jumps. Sites close together make a tight bend.
- The conduit keeps its length. A path that gets shorter or longer carries its bends
  along in proportion.
"""

import math
from typing import NamedTuple

from cc_mujoco.native import FloatArray, inlined, internal

KIND, TOUCHED, FIRST, LAST, CENTRE, AXES, PLACE_SIZE = 0, 1, 2, 5, 8, 11, 20
"""Indices in a place: its kind; of a geom, 1 if the path touches it; point of a site,
or where the path first touches the geom; where it leaves the geom; centre and three
axes of the geom. `PLACE_SIZE` is the number of entries."""
SITE, SPHERE, CYLINDER = 0.0, 2.0, 3.0
"""Kinds of a place."""
MIN_PIECE_LENGTH = 1e-9
"""Length of a piece up to which it has no direction [m]."""
_MIN_ARC_ANGLE = -1e-6
"""Angle of an arc above which a negative one is a rounded 0, not a full turn [rad]."""


class Point(NamedTuple):
    """A point or a vector in space."""

    x: float
    y: float
    z: float


@internal
def place_vector(places: FloatArray, k: int, what: int) -> Point:
    i = PLACE_SIZE * k + what
    return Point(places[i], places[i + 1], places[i + 2])


@internal
def dot(a: Point, b: Point) -> float:
    return a.x * b.x + a.y * b.y + a.z * b.z


@internal
def cross(a: Point, b: Point) -> Point:
    return Point(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


@internal
def between(a: Point, b: Point) -> Point:
    return Point(b.x - a.x, b.y - a.y, b.z - a.z)


@inlined
def direction_to(a: Point, b: Point) -> tuple[Point, float]:
    """Return direction and distance [m] from a to b; zero direction if too close."""
    way = between(a, b)
    length = math.sqrt(way.x * way.x + way.y * way.y + way.z * way.z)
    if length <= MIN_PIECE_LENGTH:
        return Point(0.0, 0.0, 0.0), length
    return Point(way.x / length, way.y / length, way.z / length), length


@internal
def in_geom_frame(places: FloatArray, k: int, v: Point) -> Point:
    return Point(
        dot(place_vector(places, k, AXES), v),
        dot(place_vector(places, k, AXES + 3), v),
        dot(place_vector(places, k, AXES + 6), v),
    )


@inlined
def angle_between(a: Point, b: Point) -> float:
    """Return the angle between two directions of length 1 [rad]."""
    off = between(a, b)
    # The square of the sine of half the angle; arcsine by its series where it is small.
    q = 0.25 * (off.x * off.x + off.y * off.y + off.z * off.z)
    if q < 0.01:
        series = 35.0 / 1152.0 + q * (63.0 / 2816.0 + q * (231.0 / 13312.0))
        series = 3.0 / 40.0 + q * (5.0 / 112.0 + q * series)
        return 2.0 * math.sqrt(q) * (1.0 + q * (1.0 / 6.0 + q * series))
    normal = cross(a, b)
    size = math.sqrt(normal.x * normal.x + normal.y * normal.y + normal.z * normal.z)
    return math.atan2(size, dot(a, b))


@internal
def arc(places: FloatArray, k: int, d: Point) -> tuple[float, float]:
    """Return length [m] and turning angle [rad] of the path around the geom of place k.

    The path arrives there in direction d.
    """
    p, q = place_vector(places, k, FIRST), place_vector(places, k, LAST)
    c = place_vector(places, k, CENTRE)
    r, s = between(c, p), between(c, q)
    # The path turns about this axis.
    axis = cross(r, d)
    along = 0.0
    if places[PLACE_SIZE * k + KIND] != SPHERE:
        own = place_vector(places, k, AXES + 6)
        sense = 1.0 if dot(axis, own) >= 0.0 else -1.0
        axis = Point(sense * own.x, sense * own.y, sense * own.z)
        low = dot(r, axis)
        high = dot(s, axis)
        r = Point(r.x - low * axis.x, r.y - low * axis.y, r.z - low * axis.z)
        s = Point(s.x - high * axis.x, s.y - high * axis.y, s.z - high * axis.z)
        along = high - low
    size = math.sqrt(dot(axis, axis))
    turned = math.atan2(dot(axis, cross(r, s)) / size, dot(r, s))
    if turned < _MIN_ARC_ANGLE:
        turned += 2.0 * math.pi
    turned = max(turned, 0.0)
    radius = math.sqrt(dot(r, r))
    around = radius * turned
    length = math.sqrt(around * around + along * along)
    # A helix bends less than its circle.
    if length > 0.0:
        return length, turned * around / length
    return length, 0.0


class _Bent(NamedTuple):
    """Segments of a conduit that is laid along a path."""

    angles: FloatArray  # wrap angle of each segment so far (n,) [rad]
    lengths: FloatArray  # length of each segment (n,) [m]
    n: int  # number of segments
    scale: float  # length of the conduit over length of the path


@inlined
def _distribute_angle(
    bent: _Bent, begin: float, end: float, angle: float, j: int, stop: float
) -> tuple[int, float]:
    """Spread an angle [rad] evenly over the path from `begin` to `end` [m].

    Angle outside of the conduit goes to its nearest segment. The search begins at
    segment j, which ends at `stop` [m]; return both of the last segment reached.
    """
    last, here, until, left = bent.n - 1, j, stop, angle
    a = max(begin * bent.scale, 0.0)
    b = max(end * bent.scale, a)
    while here < last and until <= a:
        here += 1
        until += bent.lengths[here]
    while here < last and until < b:
        part = left * (until - a) / (b - a)
        bent.angles[here] += part
        left, a = left - part, until
        here += 1
        until += bent.lengths[here]
    bent.angles[here] += left
    return here, until


@internal
def bend(
    places: FloatArray, count: int, total: float, segments: FloatArray, n: int,
    out: FloatArray,
) -> None:  # fmt: skip
    """Set the wrap angle `out` (n,) of each segment of a conduit along a path [rad].

    It follows the first `count` of `places`, the last a site, over a path `total` [m]
    long; `segments` (n,) are the lengths of its segments [m].
    """
    whole = 0.0
    for j in range(n):
        out[j] = 0.0
        whole += segments[j]
    if not total > 0.0:
        return
    bent = _Bent(out, segments, n, whole / total)
    p = place_vector(places, 0, FIRST)
    d, directed = Point(0.0, 0.0, 0.0), False  # in which the path arrives at p
    reached = 0.0  # length of the path up to p
    # Of the last site: its place on the path, where its bend begins, its turn.
    corner, begin, angle = 0.0, 0.0, 0.0
    at, stop = 0, segments[0]
    for k in range(1, count):
        is_site = places[PLACE_SIZE * k + KIND] == SITE
        points = 1
        if not is_site:
            points = 2 if places[PLACE_SIZE * k + TOUCHED] != 0.0 else 0
        for side in range(points):
            q = place_vector(places, k, FIRST)
            if side == 1:
                q = place_vector(places, k, LAST)
            way, length = direction_to(p, q)
            if length <= MIN_PIECE_LENGTH:
                continue
            if side == 1 and directed:
                length, turned = arc(places, k, d)
                # The turn of the site before is spread later, over what lies before.
                _distribute_angle(bent, reached, reached + length, turned, at, stop)
                directed = False
            else:
                if directed:
                    middle = 0.5 * (corner + reached)
                    at, stop = _distribute_angle(bent, begin, middle, angle, at, stop)
                    angle = angle_between(d, way)
                    corner, begin = reached, middle
                d, directed = way, True
            p = q
            reached += length
    middle = 0.5 * (corner + reached)
    _distribute_angle(bent, begin, middle, angle, at, stop)
