"""A cable that leaves its conduit: the pieces of its tendon, compiled.

From one site of the tendon to the next is a span: a straight piece, or two with an arc
around a geom between them. On an open path a bend is where the cable rubs, so the mesh
is that of the path: a straight piece is one node and has one tension, a site at which
the path turns is one segment, and the arc around a geom is a few. What `segments` is
more than sites and geoms need goes to the arcs, or to the straight pieces of a path
without any. Of a mixed path the conduit comes first, as far as the site of its mouth.

A site may be a guide of some radius. Its corner stays where it is, so that the two
straight pieces, and their moment arms, are those of the tangents to its arc; the cable
rubs over the arc, which counts for drag per length. What the arc is shorter than its
tangents, radius (2 tan(turn/2) - turn), is neglected. A roller turns with the cable and
takes nothing; it has neither turn nor contact here.

The cable slips on the surface of the body that bends it. What a straight piece gains in
length is its unit direction times the motion of the material points at its ends, one of
them the point of the surface that it touches:

    dl = u . (dx_surface - dx_site) = d|p - a| - u . dp,

with p the place of that point in the frame of the geom. The second term is what the
surface takes along: about a pulley that turns its arc, about a cylinder on which the
path climbs also its part along the axis. Between two states it is the integral over the
great circle, or the helix, from one p to the other, by the trapezoidal rule in u. The
piece behind the geom gains the rest, so that all gains add up to the change of the
length of the path. While a geom is not touched, both halves of the span gain equally,
without friction. Across its own direction the path moves over a surface without
friction, because it remains the shortest one.

Each piece pulls the bodies at its ends with its own tension, along itself. With these
gains that is virtual work: joints feel - sum T_j dl_j/dq.
An end that is tied to the tendon's last site has the tendon as transmission of its
actuator; MuJoCo then applies that one force along the whole tendon, which is taken off.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import numpy.typing as npt

from cc_mujoco.plugin import _mj_struct as mj_struct
from cc_mujoco.plugin._config import ROLLING
from cc_mujoco.plugin._ffi import (
    apply_force,
    assign,
    fill,
    internal,
    load_real,
    load_word,
)
from cc_mujoco.plugin._path import MIN_PIECE_LENGTH, Point, angle_between, arc

Floats = npt.NDArray[np.float64]

_SPHERE = int(mujoco.mjtGeom.mjGEOM_SPHERE)
_SITE = int(mujoco.mjtWrap.mjWRAP_SITE)

_CONTACT, _EXTENT = 1, 2
_LENGTH, _TOTAL, _TOUCH, _LENGTH_BEFORE, _TOUCH_POINT, _TOUCH_DIRECTION = (
    3,
    4,
    5,
    6,
    7,
    10,
)
_ROWS = _TOUCH_DIRECTION + 3
"""Rows of a shape, for every node; those of a span are at its first node. From
`_LENGTH` on they are remembered: length of the node, length of the span, what is
touched, length before the geom, and, in the frame of the geom, place of the point
touched first and direction in which the path arrives there."""
_AS_REFERENCE, _NOT_TOUCHING, _STRAIGHT, _ON_SPHERE, _ON_CYLINDER = (
    0.0,
    -1.0,
    1.0,
    2.0,
    3.0,
)
"""Values that `_TOUCH` may have."""
ARC_SEGMENTS = 4
"""Default number of segments of the arc around a geom."""
MIN_NODE_LENGTH = 1e-6
"""Length added to the path of every node, as none may have length 0 [m]."""


@internal
def shape_size(n: int) -> int:
    """Return the size of the result of `measure_path` for a cable of n segments."""
    return _ROWS * (n + 1)


@internal
def memory_size(n: int) -> int:
    """Return the size of the path memory in the state of a cable of n segments."""
    return (_ROWS - _LENGTH) * (n + 1)


@internal
def angles(shape: Floats, n: int) -> Floats:
    """Wrap angle of every segment (n,) [rad]."""
    return shape[:n]


@internal
def _row(shape: Floats, n: int, row: int) -> Floats:
    return shape[row * (n + 1) : (row + 1) * (n + 1)]


@internal
def contacts(shape: Floats, n: int) -> Floats:
    """Return the length over which every segment rubs (n,) [m]."""
    return _row(shape, n, _CONTACT)[:n]


@internal
def lengths(shape: Floats, n: int) -> Floats:
    """Return the length of path that every node represents (n + 1,) [m]."""
    return _row(shape, n, _LENGTH)


@internal
def _store_vector(shape: Floats, n: int, row: int, j: int, v: Point) -> None:
    """Write a vector at node j, into three rows."""
    for i in range(3):
        _row(shape, n, row + i)[j] = v[i]


@internal
def min_segments(model: int, tendon: int, mouth: int) -> int:
    """Return the segments that the path behind a mouth takes at least.

    `mouth` is the place of a site in the path, 0 where all of it is open.
    """
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    end = start + mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    # Each geom, and each site but the last; the first one too where it is a mouth.
    return end - start - mouth - (1 if mouth > 0 else 2)


@internal
def geom_count(model: int, tendon: int, mouth: int) -> int:
    """Return the number of geoms in the path behind a mouth."""
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    count = 0
    for i in range(mouth, mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)):
        if mj_struct.integer(model, mj_struct.WRAP_TYPE, start + i) != _SITE:
            count += 1
    return count


@internal
def wanted_segments(model: int, tendon: int, mouth: int, arc_segments: int) -> int:
    """Return the requested segments behind a mouth, `arc_segments` for an arc."""
    more = (arc_segments - 1) * geom_count(model, tendon, mouth)
    return min_segments(model, tendon, mouth) + more


@internal
def _part_size(total: int, parts: int, i: int) -> int:
    """Return the size of part i of a whole number that is shared out."""
    return total // parts + (1 if i < total % parts else 0)


@internal
def _point(data: int, i: int) -> Point:
    at = load_word(data + mj_struct.WRAP_XPOS) + 24 * i
    return load_real(at), load_real(at + 8), load_real(at + 16)


@internal
def _dot(a: Point, b: Point) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@internal
def _cross(a: Point, b: Point) -> Point:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@internal
def _direction_to(a: Point, b: Point) -> tuple[Point, float]:
    """Return direction and distance [m] from a to b, zero direction if too short."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    length = math.sqrt(x * x + y * y + z * z)
    if length <= MIN_PIECE_LENGTH:
        return (0.0, 0.0, 0.0), length
    return (x / length, y / length, z / length), length


@internal
def _angle(a: Point, b: Point) -> float:
    """Return the angle between two directions [rad]; 0 where one is none."""
    return angle_between(a, b) if _dot(a, a) > 0.0 and _dot(b, b) > 0.0 else 0.0


@internal
def _axis(data: int, geom: int, i: int) -> Point:
    """Return axis i of a geom's frame."""
    at = load_word(data + mj_struct.GEOM_XMAT) + 72 * geom + 8 * i
    return load_real(at), load_real(at + 24), load_real(at + 48)


@internal
def _in_geom_frame(data: int, geom: int, v: Point) -> Point:
    """Return a vector in the frame of a geom."""
    return (
        _dot(_axis(data, geom, 0), v),
        _dot(_axis(data, geom, 1), v),
        _dot(_axis(data, geom, 2), v),
    )


@internal
def _surface_travel(touch: float, p: Point, u: Point, q: Point, v: Point) -> float:
    """Return the path length that a surface carries away from the piece [m].

    The path touched the surface at p, arriving along u, and does so at q along v; all
    are in the frame of the geom.
    """
    axis = 0.0, 0.0, 1.0
    along = 0.0
    if touch == _ON_CYLINDER:
        along = 0.5 * (u[2] + v[2]) * (q[2] - p[2])
        p, q = (p[0], p[1], 0.0), (q[0], q[1], 0.0)
    normal = _cross(p, q)
    size = math.sqrt(_dot(normal, normal))
    if not size > 0.0:
        return along
    if touch == _ON_SPHERE:
        axis = normal[0] / size, normal[1] / size, normal[2] / size
    turned = math.atan2(_dot(axis, normal), _dot(p, q))
    # Directions have a part across the surface where the path touches it from inside.
    arm = 0.5 * (_dot(u, _cross(axis, p)) + _dot(v, _cross(axis, q)))
    return along + arm * turned


@internal
def measure_path(
    model: int,
    data: int,
    tendon: int,
    mouth: int,
    guided: int,
    n: int,
    guides: Floats,
    shape: Floats,
) -> tuple[int, float]:
    """Measure the open part of a path at the last evaluated position.

    Args:
        model: address of the model.
        data: address of the data.
        tendon: index of a spatial tendon without pulleys.
        mouth: place in its path of the site at which the conduit ends; 0: none.
        guided: number of segments in the conduit.
        n: number of segments in all.
        guides: of every place behind the mouth, see `attachments.read_guides`.
        shape: out, `shape_size(n)`; that of the segments and nodes behind the conduit.

    Returns:
        Number of points of the path as far as the mouth, and length from there on [m].
    """
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    number = mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    place = max(mouth, 1)  # of the first guide
    first = at = mj_struct.integer(data, mj_struct.TEN_WRAPADR, tendon)
    points, reach = 1, 0.0
    wraps = geom_count(model, tendon, mouth)
    spare = n - guided - min_segments(model, tendon, mouth) + wraps
    spans = number - 1 - mouth - wraps
    turn, contact = angles(shape, n), contacts(shape, n)
    extent, length = _row(shape, n, _EXTENT), lengths(shape, n)
    total, touch = _row(shape, n, _TOTAL), _row(shape, n, _TOUCH)
    fill(shape[_EXTENT * (n + 1) :], 0.0)
    seen, span = 0, 0  # geoms and spans
    j = guided
    k = 0
    arriving = (0.0, 0.0, 0.0)
    while k < number - 1:
        geom = -1
        if mj_struct.integer(model, mj_struct.WRAP_TYPE, start + k + 1) != _SITE:
            geom = mj_struct.integer(model, mj_struct.WRAP_OBJID, start + k + 1)
        touched = (
            geom >= 0 and mj_struct.integer(data, mj_struct.WRAP_OBJ, at + 1) == geom
        )
        a = p = q = _point(data, at)
        b = _point(data, at + (3 if touched else 1))
        leaving, straight = _direction_to(a, b)
        behind, left, right, around = leaving, straight, 0.0, 0.0
        corner = 0.0
        if touched:
            p, q = _point(data, at + 1), _point(data, at + 2)
            leaving, left = _direction_to(a, p)
            behind, right = _direction_to(q, b)
            chord, distance = _direction_to(p, q)
            if left <= MIN_PIECE_LENGTH:
                leaving = chord if distance > MIN_PIECE_LENGTH else behind
            if distance > MIN_PIECE_LENGTH:
                around, corner = arc(model, data, geom, p, q, leaving)
            else:
                corner = _angle(leaving, behind)
            if right <= MIN_PIECE_LENGTH:
                behind = leaving
        if k == mouth:
            points = at - first + 1
        if k >= mouth:
            if k > 0:
                guide, turned = guides[k - place], _angle(arriving, leaving)
                # The arc of a guide: what it cuts off the corner is neglected.
                turn[j] = turned if guide != ROLLING else 0.0
                contact[j] = turned * guide if guide > 0.0 else 0.0
                j += 1
            if geom >= 0:
                m = _part_size(spare, wraps, seen)
                seen += 1
            else:
                m = _part_size(spare, spans, span) if wraps == 0 else 0
            span += 1
            reach += left + around + right
            total[j], extent[j] = left + around + right, m + 1.0
            rolls = geom >= 0 and guides[k + 1 - place] == ROLLING
            for i in range(m):
                turn[j + i] = 0.0 if rolls else corner / m
                contact[j + i] = 0.0 if rolls else around / m
                length[j + i] = MIN_NODE_LENGTH + around / m
            if touched:
                length[j] = MIN_NODE_LENGTH + left + 0.5 * around / m
                length[j + m] = MIN_NODE_LENGTH + right + 0.5 * around / m
                centre = load_word(data + mj_struct.GEOM_XPOS) + 24 * geom
                kind = mj_struct.integer(model, mj_struct.GEOM_TYPE, geom)
                touch[j] = _ON_SPHERE if kind == _SPHERE else _ON_CYLINDER
                _row(shape, n, _LENGTH_BEFORE)[j] = left
                from_centre = (
                    p[0] - load_real(centre),
                    p[1] - load_real(centre + 8),
                    p[2] - load_real(centre + 16),
                )
                _store_vector(
                    shape, n, _TOUCH_POINT, j, _in_geom_frame(data, geom, from_centre)
                )
                _store_vector(
                    shape, n, _TOUCH_DIRECTION, j, _in_geom_frame(data, geom, leaving)
                )
            else:
                for i in range(m + 1):
                    length[j + i] = MIN_NODE_LENGTH + straight / (m + 1)
                touch[j] = _NOT_TOUCHING if geom >= 0 else _STRAIGHT
            j += m
        # Sites in one place have no path between them, and rub as one.
        if _dot(behind, behind) > 0.0:
            arriving = behind
        at += 3 if touched else 1
        k += 2 if geom >= 0 else 1
    return points, reach


@internal
def max_piece_stiffness(shape: Floats, stiffness: Floats, n: int) -> float:
    """Return the largest stiffness of the straight pieces, from the nodes' [N/m]."""
    extent, most = _row(shape, n, _EXTENT), 0.0
    for j in range(n + 1):
        if extent[j] != 0.0:
            last = j + int(extent[j]) - 1
            most = max(most, stiffness[j], stiffness[last])
    return most


@internal
def save_path(shape: Floats, n: int, memory: Floats) -> None:
    """Write the path memory of a state."""
    assign(memory, shape[_LENGTH * (n + 1) :])


@internal
def _previous_value(
    reference: Floats, memory: Floats, n: int, j: int, row: int
) -> float:
    """Return the value of a row at node j in a state, see `lengthen`."""
    at = (row - _LENGTH) * (n + 1) + j
    if memory[(_TOUCH - _LENGTH) * (n + 1) + j] == _AS_REFERENCE:
        return float(reference[_LENGTH * (n + 1) + at])
    return float(memory[at])


@internal
def previous_lengths(reference: Floats, memory: Floats, n: int) -> Floats:
    """Return the path length of every node in a state (n + 1,) [m], see `lengthen`."""
    # Every node has a length, unless nothing is remembered yet.
    return lengths(reference, n) if memory[0] == 0.0 else memory[: n + 1]


@internal
def _previous_vector(
    reference: Floats, memory: Floats, n: int, j: int, row: int
) -> Point:
    return (
        _previous_value(reference, memory, n, j, row),
        _previous_value(reference, memory, n, j, row + 1),
        _previous_value(reference, memory, n, j, row + 2),
    )


@internal
def _vector(shape: Floats, n: int, j: int, row: int) -> Point:
    return (
        float(_row(shape, n, row)[j]),
        float(_row(shape, n, row + 1)[j]),
        float(_row(shape, n, row + 2)[j]),
    )


@internal
def path_growth(shape: Floats, reference: Floats, memory: Floats, n: int) -> float:
    """Return by how much the path is longer than in a state [m]; as `lengthen`."""
    extent, total = _row(shape, n, _EXTENT), _row(shape, n, _TOTAL)
    grown = 0.0
    for j in range(n + 1):
        if extent[j] != 0.0:
            grown += total[j] - _previous_value(reference, memory, n, j, _TOTAL)
    return grown


@internal
def lengthen(
    shape: Floats, reference: Floats, memory: Floats, n: int, gained: Floats
) -> None:
    """Compute the lengthening of the path at every node since a state.

    Args:
        shape: the path now, of `measure_path`.
        reference: the same in the pose `qpos0`.
        memory: of the state; where it is 0, that of a reset, the reference counts.
        n: number of segments.
        gained: out, (n + 1,) [m].
    """
    fill(gained, 0.0)
    extent, touch = _row(shape, n, _EXTENT), _row(shape, n, _TOUCH)
    total, left = _row(shape, n, _TOTAL), _row(shape, n, _LENGTH_BEFORE)
    for j in range(n + 1):
        if extent[j] == 0.0:
            continue
        m = int(extent[j]) - 1
        grown = total[j] - _previous_value(reference, memory, n, j, _TOTAL)
        if touch[j] == _STRAIGHT:
            for i in range(m + 1):
                gained[j + i] = grown / (m + 1)
            continue
        first = 0.5 * grown
        before = _previous_value(reference, memory, n, j, _TOUCH)
        if touch[j] != _NOT_TOUCHING and touch[j] == before:
            first = left[j] - _previous_value(reference, memory, n, j, _LENGTH_BEFORE)
            first -= _surface_travel(
                before,
                _previous_vector(reference, memory, n, j, _TOUCH_POINT),
                _previous_vector(reference, memory, n, j, _TOUCH_DIRECTION),
                _vector(shape, n, j, _TOUCH_POINT),
                _vector(shape, n, j, _TOUCH_DIRECTION),
            )
        gained[j] = first
        gained[j + m] = grown - first


@internal
def apply_pulls(
    model: int,
    data: int,
    tendon: int,
    mouth: int,
    shape: Floats,
    n: int,
    guided: int,
    node: Floats,
    tied: float,
    aside: int,
    scratch: int,
    target: int,
) -> None:
    """Add the forces of the pieces on the degrees of freedom.

    Args:
        model: address of the model.
        data: address of the data, at the position of `shape`.
        tendon: index of the tendon.
        mouth: as in `measure_path`.
        shape: of `measure_path`.
        n: number of segments.
        guided: as in `measure_path`.
        node: tension of the nodes (n + 1,) [N], negative where slack.
        tied: force along the whole tendon that MuJoCo applies [N], positive where it
            lengthens it.
        aside: axis of the world along which a piece without length pulls, since it has
            no direction; -1 where it does not pull.
        scratch: address of six numbers, of which the last three are 0.
        target: address of the sum (nv,).
    """
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    number = mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    at = mj_struct.integer(data, mj_struct.TEN_WRAPADR, tendon)
    extent = _row(shape, n, _EXTENT)
    j, k = guided, 0
    if mouth > 0:
        j += 1
    while k < number - 1:
        geom = -1
        if mj_struct.integer(model, mj_struct.WRAP_TYPE, start + k + 1) != _SITE:
            geom = mj_struct.integer(model, mj_struct.WRAP_OBJID, start + k + 1)
        touched = (
            geom >= 0 and mj_struct.integer(data, mj_struct.WRAP_OBJ, at + 1) == geom
        )
        ahead = k + (2 if geom >= 0 else 1)
        left, right = 0.0, 0.0
        if k >= mouth:
            m = int(extent[j]) - 1
            left, right = max(node[j], 0.0), max(node[j + m], 0.0)
            if not touched:
                left = right = 0.5 * (left + right)
            j += m + 1
        left, right = left + tied, right + tied
        first = mj_struct.integer(model, mj_struct.WRAP_OBJID, start + k)
        last = mj_struct.integer(model, mj_struct.WRAP_OBJID, start + ahead)
        here = mj_struct.integer(model, mj_struct.SITE_BODY, first)
        there = mj_struct.integer(model, mj_struct.SITE_BODY, last)
        if touched:
            on = mj_struct.integer(model, mj_struct.GEOM_BODY, geom)
            _pull_together(
                model, data, at, here, at + 1, on, left, aside, scratch, target
            )
            _pull_together(
                model, data, at + 2, on, at + 3, there, right, aside, scratch, target
            )
            at += 3
        else:
            _pull_together(
                model, data, at, here, at + 1, there, left, aside, scratch, target
            )
            at += 1
        k = ahead


@internal
def _pull_together(
    model: int,
    data: int,
    first: int,
    first_body: int,
    second: int,
    second_body: int,
    tension: float,
    aside: int,
    scratch: int,
    target: int,
) -> None:
    """Draw two points of the path, on two bodies, towards each other."""
    if tension == 0.0 or first_body == second_body:
        return
    d, length = _direction_to(_point(data, first), _point(data, second))
    if length <= MIN_PIECE_LENGTH:
        if aside < 0:
            return
        d = (
            1.0 if aside == 0 else 0.0,
            1.0 if aside == 1 else 0.0,
            1.0 if aside == 2 else 0.0,
        )
    points = load_word(data + mj_struct.WRAP_XPOS)
    if mj_struct.is_movable(model, first_body):
        apply_force(
            model, data, scratch, points + 24 * first, first_body, target,
            tension * d[0], tension * d[1], tension * d[2],
        )  # fmt: skip
    if mj_struct.is_movable(model, second_body):
        apply_force(
            model, data, scratch, points + 24 * second, second_body, target,
            -tension * d[0], -tension * d[1], -tension * d[2],
        )  # fmt: skip
