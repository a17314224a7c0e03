"""Open part of a cable's path: how its pieces lengthen, and how they pull, compiled.

From one site of the tendon to the next is a span: a straight piece, or two with an arc
around a geom between them. On an open path the cable rubs at the bends, so the mesh is
that of the path: a straight piece is one node and has one tension, a site at which the
path turns is one segment, and the arc around a geom is a few. Segments beyond those
that sites and geoms need go to the arcs, or to the straight pieces of a path without
any. Of a mixed path the conduit comes first, as far as the site of its mouth.

A site may be a guide of some radius. Its corner stays where it is, so that the two
straight pieces, and their moment arms, are those of the tangents to its arc; the cable
rubs over the arc, which counts for drag per length. The arc is shorter than its
tangents by radius (2 tan(turn/2) - turn), which is neglected. A roller turns with the
cable without friction; it has neither turn nor contact here.

The cable slips on the surface of the body that bends it. A straight piece lengthens by
its unit direction times the motion of the material points at its ends, one of them the
point of the surface that it touches:

    dl = u . (dx_surface - dx_site) = d|p - a| - u . dp,

with p the place of that point in the frame of the geom. The second term is what the
surface takes along: about a pulley that turns its arc, about a cylinder on which the
path climbs also its part along the axis. Between two states it is the integral over the
great circle, or the helix, from one p to the other, by the trapezoidal rule in u. The
piece behind the geom lengthens by the rest, so that the sum is the change of the length
of the path. While a geom is not touched, both halves of the span lengthen equally,
without friction. Across its own direction the path moves over a surface without
friction, because it remains the shortest one.

Each piece pulls the bodies at its ends with its own tension, along itself. By virtual
work the generalised forces are - sum T_j dl_j/dq. An end that is tied to the tendon's
last site has the tendon as transmission of its actuator; MuJoCo then applies that one
force along the whole tendon, which is subtracted.
"""

import math

from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _moving_path as moving_path
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable import _pack as pack
from cc_mujoco.cable import _path_geometry as geometry
from cc_mujoco.cable._path_geometry import Point, direction_to, dot, place_vector
from cc_mujoco.native import FloatArray, compiled, internal

(
    _CONTACT, _EXTENT, _LENGTH, _TOTAL, _TOUCH, _LENGTH_BEFORE, _TOUCH_POINT,
    _TOUCH_DIRECTION, _ROWS,
) = 1, 2, 3, 4, 5, 6, 7, 10, 13  # fmt: skip
"""Rows of a shape, n + 1 numbers each; row 0 has the wrap angles of the segments.

Contact length of each segment [m]; at the first node of a span the number of its nodes.
Saved with the state: length of each node [m]; at the first node of a span its length
[m], kind of geom touched, length before it [m], and in the frame of the geom the point
touched first and the direction of the path there. `_ROWS` is the number of rows.
"""
_BEND, _PLAY_FACTOR, _SEATING_FACTOR = _TOTAL, _TOUCH_POINT, _TOUCH_POINT + 1
"""Rows of other use inside a conduit: wrap angle of segments that the route bends
[rad]; in the reference also `clearance_factors` and `seating_factors`."""
_AS_REFERENCE, _NOT_TOUCHING, _STRAIGHT = 0.0, -1.0, 1.0
"""Values of `_TOUCH` if no geom is touched: none saved yet, one beside the path, none
in the span."""
ROLLING = -1.0
"""Radius that stands for a guide that turns with the cable, without friction."""
MIN_NODE_LENGTH = 1e-6
"""Length that is added to the path of every node, so that none is 0 [m]."""


@compiled
def shape_size(n: int) -> int:
    """Return the number of entries of a `shape`, the result of `measure`."""
    return _ROWS * (n + 1)


@compiled
def memory_size(n: int) -> int:
    """Return the number of entries of a `memory`, the rows saved with a state."""
    return (_ROWS - _LENGTH) * (n + 1)


@internal
def angles(shape: FloatArray, n: int) -> FloatArray:
    """Wrap angle of every segment (n,) [rad]."""
    return shape[:n]


@internal
def _row(shape: FloatArray, n: int, row: int) -> FloatArray:
    return shape[row * (n + 1) : (row + 1) * (n + 1)]


@internal
def contacts(shape: FloatArray, n: int) -> FloatArray:
    """Return the length over which every segment rubs (n,) [m]."""
    return _row(shape, n, _CONTACT)[:n]


@internal
def lengths(shape: FloatArray, n: int) -> FloatArray:
    """Return the length of path that every node represents (n + 1,) [m]."""
    return _row(shape, n, _LENGTH)


@internal
def _store_vector(shape: FloatArray, n: int, row: int, j: int, v: Point) -> None:
    _row(shape, n, row)[j] = v.x
    _row(shape, n, row + 1)[j] = v.y
    _row(shape, n, row + 2)[j] = v.z


@internal
def fewest_segments(number: int, mouth: int) -> int:
    """Return the least number of segments behind the `mouth` of a path.

    It has `number` places; the conduit ends at place `mouth`, 0 if all is open.
    """
    # One for each geom and site but the last, and but the first unless it is a mouth.
    return number - mouth - (1 if mouth > 0 else 2)


@internal
def _part_size(total: int, parts: int, i: int) -> int:
    """Return the size of part i of `total` divided into near-equal whole parts."""
    return total // parts + (1 if i < total % parts else 0)


@internal
def _angle(a: Point, b: Point) -> float:
    """Return the angle between two directions [rad]; 0 if either has no length."""
    if dot(a, a) > 0.0 and dot(b, b) > 0.0:
        return geometry.angle_between(a, b)
    return 0.0


@internal
def _surface_travel(
    touch: float, first: Point, u: Point, last: Point, v: Point
) -> float:
    """Return the length of path that a moving geom carries away from a piece [m].

    The piece first touched the geom, of kind `touch`, at `first` in direction u and
    now does at `last` in direction v, all in the frame of the geom.
    """
    p, q, axis = first, last, Point(0.0, 0.0, 1.0)
    along = 0.0
    if touch != geometry.SPHERE:
        along = 0.5 * (u.z + v.z) * (q.z - p.z)
        p, q = Point(first.x, first.y, 0.0), Point(last.x, last.y, 0.0)
    normal = geometry.cross(p, q)
    size = math.sqrt(dot(normal, normal))
    if not size > 0.0:
        return along
    if touch == geometry.SPHERE:
        axis = Point(normal.x / size, normal.y / size, normal.z / size)
    turned = math.atan2(dot(axis, normal), dot(p, q))
    # Directions have a part across the surface where the path touches it from inside.
    arm = 0.5 * (dot(u, geometry.cross(axis, p)) + dot(v, geometry.cross(axis, q)))
    return along + arm * turned


@internal
def measure(
    places: FloatArray, number: int, mouth: int, guided: int, n: int,
    guides: FloatArray, shape: FloatArray,
) -> float:  # fmt: skip
    """Measure the open part of a path; return its length from the mouth on [m].

    The path has `number` of `places`, see `_path_geometry.py`; the first, the last and
    place `mouth` are sites. There the conduit of `guided` of the `n` segments ends; 0:
    no conduit. `guides` have for each place behind the mouth 0, `ROLLING` or the radius
    of a guide [m]. The result is `shape` of `shape_size(n)`, but for the conduit.
    """
    first = max(mouth, 1)  # place of the first guide
    reach, wraps = 0.0, 0  # geoms behind the mouth
    for k in range(mouth, number):
        if places[geometry.PLACE_SIZE * k + geometry.KIND] != geometry.SITE:
            wraps += 1
    spare = n - guided - fewest_segments(number, mouth) + wraps
    spans = number - 1 - mouth - wraps
    turn, contact = angles(shape, n), contacts(shape, n)
    extent, length = _row(shape, n, _EXTENT), lengths(shape, n)
    total, touch = _row(shape, n, _TOTAL), _row(shape, n, _TOUCH)
    for i in range(_EXTENT * (n + 1), _ROWS * (n + 1)):
        shape[i] = 0.0
    seen, span, j, k = 0, 0, guided, 0  # geoms and spans so far, node, place
    arriving = Point(0.0, 0.0, 0.0)
    while k < number - 1:
        place = geometry.PLACE_SIZE * (k + 1)
        kind, ahead, touched = places[place + geometry.KIND], k + 1, False
        if kind != geometry.SITE:
            ahead, touched = k + 2, places[place + geometry.TOUCHED] != 0.0
        a = place_vector(places, k, geometry.FIRST)
        b = place_vector(places, ahead, geometry.FIRST)
        leaving, straight = direction_to(a, b)
        behind, p = leaving, a
        left, right, around, corner = straight, 0.0, 0.0, 0.0
        if touched:
            p = place_vector(places, k + 1, geometry.FIRST)
            q = place_vector(places, k + 1, geometry.LAST)
            leaving, left = direction_to(a, p)
            behind, right = direction_to(q, b)
            chord, distance = direction_to(p, q)
            if left <= geometry.MIN_PIECE_LENGTH:
                leaving = behind
                if distance > geometry.MIN_PIECE_LENGTH:
                    leaving = chord
            if distance > geometry.MIN_PIECE_LENGTH:
                around, corner = geometry.arc(places, k + 1, leaving)
            else:
                corner = _angle(leaving, behind)
            if right <= geometry.MIN_PIECE_LENGTH:
                behind = leaving
        if k >= mouth:
            if k > 0:
                guide, turned = guides[k - first], _angle(arriving, leaving)
                # The arc of a guide: what it cuts off the corner is neglected.
                turn[j] = turned if guide != ROLLING else 0.0
                contact[j] = turned * guide if guide > 0.0 else 0.0
                j += 1
            m, rolls = 0, False
            if kind != geometry.SITE:
                m = _part_size(spare, wraps, seen)
                rolls = guides[k + 1 - first] == ROLLING
                seen += 1
            elif wraps == 0:
                m = _part_size(spare, spans, span)
            span += 1
            reach += left + around + right
            total[j], extent[j] = left + around + right, float(m) + 1.0
            for i in range(m):
                turn[j + i] = 0.0 if rolls else corner / float(m)
                contact[j + i] = 0.0 if rolls else around / float(m)
                length[j + i] = MIN_NODE_LENGTH + around / float(m)
            if touched:
                half = 0.5 * around / float(m)
                length[j] = MIN_NODE_LENGTH + left + half
                length[j + m] = MIN_NODE_LENGTH + right + half
                touch[j] = kind
                _row(shape, n, _LENGTH_BEFORE)[j] = left
                arm = geometry.between(place_vector(places, k + 1, geometry.CENTRE), p)
                own = geometry.in_geom_frame(places, k + 1, arm)
                _store_vector(shape, n, _TOUCH_POINT, j, own)
                own = geometry.in_geom_frame(places, k + 1, leaving)
                _store_vector(shape, n, _TOUCH_DIRECTION, j, own)
            else:
                for i in range(m + 1):
                    length[j + i] = MIN_NODE_LENGTH + straight / (float(m) + 1.0)
                touch[j] = _NOT_TOUCHING if kind != geometry.SITE else _STRAIGHT
            j += m
        # Sites in one place have no path between them, and rub as one.
        if dot(behind, behind) > 0.0:
            arriving = behind
        k = ahead
    return reach


@internal
def max_piece_stiffness(shape: FloatArray, stiffness: FloatArray, n: int) -> float:
    """Return the largest `stiffness` (n + 1,) of a node at an end of a span [N/m]."""
    extent, most, j = _row(shape, n, _EXTENT), 0.0, 0
    while j <= n:
        size = int(extent[j])
        if size > 0:
            most = max(most, stiffness[j], stiffness[j + size - 1])
        j += max(size, 1)
    return most


@internal
def save_path(shape: FloatArray, n: int, memory: FloatArray) -> None:
    own = memory[: memory_size(n)]
    own[:] = shape[_LENGTH * (n + 1) : _ROWS * (n + 1)]


@internal
def _previous_value(
    reference: FloatArray, memory: FloatArray, n: int, j: int, row: int
) -> float:
    """Return an entry of `memory` at node j; where 0, as after a reset, of `reference`.

    `row` is that of a shape, from `_LENGTH` on.
    """
    at = (row - _LENGTH) * (n + 1) + j
    if memory[(_TOUCH - _LENGTH) * (n + 1) + j] == _AS_REFERENCE:
        return float(reference[_LENGTH * (n + 1) + at])
    return float(memory[at])


@internal
def previous_lengths(reference: FloatArray, memory: FloatArray, n: int) -> FloatArray:
    """Return lengths of path of the nodes in `memory` (n + 1,) [m], see `lengthen`."""
    return _previous_row(reference, memory, n, _LENGTH)


@internal
def _previous_row(
    reference: FloatArray, memory: FloatArray, n: int, row: int
) -> FloatArray:
    # Every node has a length, unless nothing is saved yet.
    if memory[0] == 0.0:
        return _row(reference, n, row)
    return _row(memory, n, row - _LENGTH)


@internal
def _previous_vector(
    reference: FloatArray, memory: FloatArray, n: int, j: int, row: int
) -> Point:
    return Point(
        _previous_value(reference, memory, n, j, row),
        _previous_value(reference, memory, n, j, row + 1),
        _previous_value(reference, memory, n, j, row + 2),
    )


@internal
def _vector(shape: FloatArray, n: int, j: int, row: int) -> Point:
    return Point(
        _row(shape, n, row)[j], _row(shape, n, row + 1)[j], _row(shape, n, row + 2)[j]
    )


@internal
def path_growth(
    shape: FloatArray, reference: FloatArray, memory: FloatArray, n: int
) -> float:
    """Return the growth of the path since `memory` was saved [m], see `lengthen`."""
    extent, total = _row(shape, n, _EXTENT), _row(shape, n, _TOTAL)
    grown, j = 0.0, 0
    while j <= n:
        size = int(extent[j])
        if size > 0:
            grown += total[j] - _previous_value(reference, memory, n, j, _TOTAL)
        j += max(size, 1)
    return grown


@internal
def lengthen(
    shape: FloatArray, reference: FloatArray, memory: FloatArray, n: int,
    gained: FloatArray,
) -> None:  # fmt: skip
    """Set `gained` (n + 1,) to the growth of the path at every node since `memory` [m].

    `shape` is the path now, `memory` what is saved of it with a state. Where that is 0,
    as after a reset, `reference` counts, the path in the pose `qpos0`.
    """
    gained[:] = 0.0
    extent, touch = _row(shape, n, _EXTENT), _row(shape, n, _TOUCH)
    total, left = _row(shape, n, _TOTAL), _row(shape, n, _LENGTH_BEFORE)
    ahead = 0
    while ahead <= n:
        j, size = ahead, int(extent[ahead])
        ahead += max(size, 1)
        if size == 0:
            continue
        m = size - 1
        grown = total[j] - _previous_value(reference, memory, n, j, _TOTAL)
        if touch[j] == _STRAIGHT:
            for i in range(m + 1):
                gained[j + i] = grown / float(m + 1)
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


@compiled
def store_conduit(
    inside: FloatArray, reference: FloatArray, n: int, guided: int
) -> None:
    """Copy the mesh of a conduit of `guided` segments to the `reference` of a path.

    `inside` are the packed parameters of a cable in that conduit alone.
    """
    angles(reference, n)[:guided] = at.segment_angles(inside, guided)
    contacts(reference, n)[:guided] = at.contact_length(inside, guided)
    lengths(reference, n)[: guided + 1] = at.node_length(inside, guided)
    play = _row(reference, n, _PLAY_FACTOR)
    seating = _row(reference, n, _SEATING_FACTOR)
    play[:guided] = at.clearance_factors(inside, guided)
    seating[:guided] = at.seating_factors(inside, guided)


@compiled
def pack_reference(
    values: FloatArray, n: int, guided: int, reference: FloatArray, prm: FloatArray
) -> None:
    """Pack a cable on an open path, in the pose `qpos0`, to `prm`.

    `values` are in the order of `PARAMETERS`, `guided` is as in `measure`, and
    `reference` is the shape in that pose, with its conduit.
    """
    at.segment_angles(prm, n)[:] = angles(reference, n)
    at.contact_length(prm, n)[:] = contacts(reference, n)
    length, whole = at.node_length(prm, n), 0.0
    length[:] = lengths(reference, n)
    for i in range(n + 1):
        whole += length[i]
    prm[at.LENGTH] = whole
    prm[at.GUIDED] = float(guided)
    play, seating = at.clearance_factors(prm, n), at.seating_factors(prm, n)
    play[:], seating[:] = 0.0, 1.0
    for j in range(guided):
        play[j] = _row(reference, n, _PLAY_FACTOR)[j]
        seating[j] = _row(reference, n, _SEATING_FACTOR)[j]
    pack.pack_mesh(values, n, prm)
    pack.expect_change(prm)
    pack.expect_lengthening(prm)


@internal
def keep_conduit(shape: FloatArray, reference: FloatArray, n: int, guided: int) -> None:
    """Copy the mesh of the conduit, of `guided` segments, to `shape`."""
    angle, contact, length = angles(shape, n), contacts(shape, n), lengths(shape, n)
    own_angle, own_contact = angles(reference, n), contacts(reference, n)
    own_length = lengths(reference, n)
    for j in range(guided):
        angle[j], contact[j] = own_angle[j], own_contact[j]
    for i in range(guided + 1 if guided > 0 else 0):
        length[i] = own_length[i]


@internal
def remember_bends(shape: FloatArray, n: int, guided: int) -> None:
    """Copy the wrap angles of `guided` segments to a row that is saved with states."""
    kept, angle = _row(shape, n, _BEND), angles(shape, n)
    for j in range(guided):
        kept[j] = angle[j]


@internal
def bends_of(shape: FloatArray, n: int) -> FloatArray:
    """Return the saved wrap angles of segments that the route bends, else 0 [rad]."""
    return _row(shape, n, _BEND)


@internal
def lay(
    prm: FloatArray, n: int, state: FloatArray, shape: FloatArray,
    reference: FloatArray, memory: FloatArray, gained: FloatArray,
) -> bool:  # fmt: skip
    """Move a packed cable to the path `shape`; return whether its parameters changed.

    `memory` is that of `state`, `reference` the shape in the pose `qpos0`; `gained`
    becomes the growth of the path at every node (n + 1,) [m].
    """
    tension = at.tensions(state, n)
    nodes.recall_springs(prm, state)
    lengthen(shape, reference, memory, n, gained)
    before = previous_lengths(reference, memory, n)
    was = _previous_row(reference, memory, n, _BEND)
    bends = pack.set_path(prm, n, angles(shape, n), contacts(shape, n))
    changed = moving_path.carry(
        prm, n, tension, before, lengths(shape, n), gained, was, bends_of(shape, n)
    )
    return changed or bends


@internal
def pull_forces(
    places: FloatArray, number: int, mouth: int, shape: FloatArray, n: int, guided: int,
    node: FloatArray, tied: float, aside: int, forces: FloatArray,
) -> None:  # fmt: skip
    """Compute the forces of the pieces of a path on the points where they begin.

    The point where a piece ends gets the opposite force. Arguments up to `guided` are
    as in `measure`; `node` are tensions [N], negative where slack. `tied` is the force
    along the whole tendon that MuJoCo applies [N], positive if it lengthens it, which
    is subtracted. A piece without length pulls along axis `aside` of the world; -1: no.

    `forces` (6 * (number - 1),) [N] get two vectors for each place but the last: of the
    piece that begins at this site, and, if it ends at a geom, of that behind the geom.
    """
    extent = _row(shape, n, _EXTENT)
    for i in range(6 * (number - 1)):
        forces[i] = 0.0
    j, k = guided, 0
    if mouth > 0:
        j += 1
    while k < number - 1:
        place, ahead, touched = geometry.PLACE_SIZE * (k + 1), k + 1, False
        if places[place + geometry.KIND] != geometry.SITE:
            ahead, touched = k + 2, places[place + geometry.TOUCHED] != 0.0
        left, right = 0.0, 0.0
        if k >= mouth:
            m = int(extent[j]) - 1
            left, right = max(node[j], 0.0), max(node[j + m], 0.0)
            if not touched:
                left = right = 0.5 * (left + right)
            j += m + 1
        left, right = left + tied, right + tied
        a = place_vector(places, k, geometry.FIRST)
        b = place_vector(places, ahead, geometry.FIRST)
        if touched:
            p = place_vector(places, k + 1, geometry.FIRST)
            q = place_vector(places, k + 1, geometry.LAST)
            _store_pull(forces, 6 * k, a, p, left, aside)
            _store_pull(forces, 6 * k + 3, q, b, right, aside)
        else:
            _store_pull(forces, 6 * k, a, b, left, aside)
        k = ahead


@internal
def _store_pull(
    forces: FloatArray, i: int, first: Point, second: Point, tension: float, aside: int
) -> None:
    """Write the force [N] of a piece on its first point, towards its second."""
    d, length = direction_to(first, second)
    if length <= geometry.MIN_PIECE_LENGTH:
        d = Point(float(aside == 0), float(aside == 1), float(aside == 2))
    forces[i] = tension * d.x
    forces[i + 1] = tension * d.y
    forces[i + 2] = tension * d.z
