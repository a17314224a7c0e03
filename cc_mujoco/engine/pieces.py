"""A cable that leaves its conduit: the pieces of its tendon, compiled.

From one site of the tendon to the next is a span: a straight piece, or two with an arc
around a geom between them. On an open path a bend is where the cable rubs, so the mesh
is that of the path: a straight piece is one node and has one tension, a site at which
the path turns is one segment, and the arc around a geom is a few. What `segments` is
more than sites and geoms need goes to the arcs, or to the straight pieces of a path
without any. Of a mixed path the conduit comes first, as far as the site of its mouth.

What the cable slips on is the surface of the body that bends it. A straight piece ends
on that surface, so what it gains in length is measured to a mark on the body: by how
much the piece itself is longer, and the arc from where it touches to the mark. About a
pulley that turns the pieces thus gain what the surface takes along. While a geom is
not touched, both halves of the span gain alike; nothing rubs there.

Each piece pulls the bodies at its ends with its own tension, along itself. With what
the pieces gain as measured above that is virtual work: joints feel - sum T_j dl_j/dq.
An end that is tied to the tendon's last site has the tendon as transmission of its
actuator; MuJoCo then applies that one force along the whole tendon, which is taken off.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import numpy.typing as npt

from cc_mujoco.engine import fields
from cc_mujoco.engine.memory import (
    apply_force,
    assign,
    fill,
    internal,
    load_real,
    load_word,
)
from cc_mujoco.engine.path import SHORT, Point, arc, turning

Floats = npt.NDArray[np.float64]

_SPHERE = int(mujoco.mjtGeom.mjGEOM_SPHERE)
_SITE = int(mujoco.mjtWrap.mjWRAP_SITE)

_ROWS = 8
_CONTACT, _TOTAL, _TURNED, _TOUCH, _EXTENT, _PERIOD, _LENGTH = 1, 2, 3, 4, 5, 6, 7
_SAME, _APART, _STRAIGHT = 0.0, -1.0, 4.0
"""What `_TOUCH` may be; 1, 2 or 3 is a geom touched and the axis of its mark."""
ARC = 4
"""Segments that the arc around a geom gets unless told otherwise."""
SHORTEST = 1e-6
"""Least length of a node [m]."""


@internal
def shape_size(n: int) -> int:
    """Length of what `survey` finds, for a cable of n segments."""
    return _ROWS * (n + 1)


@internal
def memory_size(n: int) -> int:
    """Length of what a state remembers of the path, for a cable of n segments."""
    return 3 * (n + 1)


@internal
def angles(shape: Floats, n: int) -> Floats:
    """Wrap angle of every segment (n,) [rad]."""
    return shape[:n]


@internal
def _row(shape: Floats, n: int, row: int) -> Floats:
    return shape[row * (n + 1) : (row + 1) * (n + 1)]


@internal
def contacts(shape: Floats, n: int) -> Floats:
    """Length over which every segment rubs (n,) [m]."""
    return _row(shape, n, _CONTACT)[:n]


@internal
def lengths(shape: Floats, n: int) -> Floats:
    """Length of path that every node stands for (n + 1,) [m]."""
    return _row(shape, n, _LENGTH)


@internal
def needed(model: int, tendon: int, mouth: int) -> int:
    """Segments that the path behind a mouth takes at least.

    `mouth` is the place of a site in the path, 0 where all of it is open.
    """
    start = fields.integer(model, fields.TENDON_ADR, tendon)
    end = start + fields.integer(model, fields.TENDON_NUM, tendon)
    # Each geom, and each site but the last; the first one too where it is a mouth.
    return end - start - mouth - (1 if mouth > 0 else 2)


@internal
def _geoms(model: int, tendon: int, mouth: int) -> int:
    """Number of geoms in the path behind a mouth."""
    start = fields.integer(model, fields.TENDON_ADR, tendon)
    count = 0
    for i in range(mouth, fields.integer(model, fields.TENDON_NUM, tendon)):
        if fields.integer(model, fields.WRAP_TYPE, start + i) != _SITE:
            count += 1
    return count


@internal
def wanted(model: int, tendon: int, mouth: int, arc_segments: int) -> int:
    """Segments that the path behind a mouth is to have, `arc_segments` for an arc."""
    more = (arc_segments - 1) * _geoms(model, tendon, mouth)
    return needed(model, tendon, mouth) + more


@internal
def _share(total: int, parts: int, i: int) -> int:
    """Size of part i of a whole number that is shared out."""
    return total // parts + (1 if i < total % parts else 0)


@internal
def _point(data: int, i: int) -> Point:
    at = load_word(data + fields.WRAP_XPOS) + 24 * i
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
def _towards(a: Point, b: Point) -> tuple[Point, float]:
    """Direction and distance [m] from a to b; no direction where it is too short."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    length = math.sqrt(x * x + y * y + z * z)
    if length <= SHORT:
        return (0.0, 0.0, 0.0), length
    return (x / length, y / length, z / length), length


@internal
def _angle(a: Point, b: Point) -> float:
    """Angle between two directions [rad]; 0 where one is none."""
    return turning(a, b) if _dot(a, a) > 0.0 and _dot(b, b) > 0.0 else 0.0


@internal
def _axis(data: int, geom: int, i: int) -> Point:
    """Axis i of a geom's frame."""
    at = load_word(data + fields.GEOM_XMAT) + 72 * geom + 8 * i
    return load_real(at), load_real(at + 24), load_real(at + 48)


@internal
def _mark(
    model: int, data: int, geom: int, p: Point, d: Point, marked: int
) -> tuple[float, float, int]:
    """Where a mark on a geom is, from the point p at which the path arrives along d.

    Returns:
        Path along the surface from p to the mark, negative behind it, and once around
        [m]; the axis of the geom that is its mark: `marked`, or the best if that is -1.
    """
    at = load_word(data + fields.GEOM_XPOS) + 24 * geom
    c = load_real(at), load_real(at + 8), load_real(at + 16)
    r = p[0] - c[0], p[1] - c[1], p[2] - c[2]
    normal = _cross(r, d)
    slope = 1.0  # cosine of the angle at which a helix climbs
    if fields.integer(model, fields.GEOM_TYPE, geom) != _SPHERE:
        axis = _axis(data, geom, 2)
        sense = 1.0 if _dot(normal, axis) >= 0.0 else -1.0
        normal = sense * axis[0], sense * axis[1], sense * axis[2]
        low = _dot(r, normal)
        r = r[0] - low * normal[0], r[1] - low * normal[1], r[2] - low * normal[2]
        slope = math.sqrt(max(1.0 - _dot(d, normal) ** 2, 0.0))
        marked = 0
    size = math.sqrt(_dot(normal, normal))
    radius = math.sqrt(_dot(r, r))
    if not (size > 0.0 and radius > 0.0):
        return 0.0, 1.0, max(marked, 0)
    normal = normal[0] / size, normal[1] / size, normal[2] / size
    if marked < 0:
        least = 2.0
        for i in range(3):
            off = abs(_dot(_axis(data, geom, i), normal))
            if off < least:
                least, marked = off, i
    mark = _axis(data, geom, marked)
    ahead = math.atan2(_dot(normal, _cross(r, mark)), _dot(r, mark))
    around = radius * slope
    return around * ahead, 2.0 * math.pi * around, marked


@internal
def survey(
    model: int,
    data: int,
    tendon: int,
    mouth: int,
    guided: int,
    n: int,
    memory: Floats,
    reference: Floats,
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
        memory: `memory_size(n)`, of the committed state.
        reference: the path in the pose `qpos0`, or 0 where that is not known yet.
        shape: out, `shape_size(n)`; that of the segments and nodes behind the conduit.

    Returns:
        Number of points of the path as far as the mouth, and length from there on [m].
    """
    start = fields.integer(model, fields.TENDON_ADR, tendon)
    number = fields.integer(model, fields.TENDON_NUM, tendon)
    first = at = fields.integer(data, fields.TEN_WRAPADR, tendon)
    points, reach = 1, 0.0
    wraps = _geoms(model, tendon, mouth)
    spare = n - guided - needed(model, tendon, mouth) + wraps
    spans = number - 1 - mouth - wraps
    turn, contact = angles(shape, n), contacts(shape, n)
    total, turned = _row(shape, n, _TOTAL), _row(shape, n, _TURNED)
    touch, extent = _row(shape, n, _TOUCH), _row(shape, n, _EXTENT)
    period, length = _row(shape, n, _PERIOD), lengths(shape, n)
    fill(extent, 0.0)
    seen, span = 0, 0  # geoms and spans
    j = guided
    k = 0
    arriving = (0.0, 0.0, 0.0)
    while k < number - 1:
        geom = -1
        if fields.integer(model, fields.WRAP_TYPE, start + k + 1) != _SITE:
            geom = fields.integer(model, fields.WRAP_OBJID, start + k + 1)
        touched = geom >= 0 and fields.integer(data, fields.WRAP_OBJ, at + 1) == geom
        a = p = q = _point(data, at)
        b = _point(data, at + (3 if touched else 1))
        leaving, straight = _towards(a, b)
        behind, left, right, around = leaving, straight, 0.0, 0.0
        corner = 0.0
        if touched:
            p, q = _point(data, at + 1), _point(data, at + 2)
            leaving, left = _towards(a, p)
            behind, right = _towards(q, b)
            chord, apart = _towards(p, q)
            if left <= SHORT:
                leaving = chord if apart > SHORT else behind
            if apart > SHORT:
                around, corner = arc(model, data, geom, p, q, leaving)
            else:
                corner = _angle(leaving, behind)
            if right <= SHORT:
                behind = leaving
        if k == mouth:
            points = at - first + 1
        if k >= mouth:
            if k > 0:
                turn[j], contact[j] = _angle(arriving, leaving), 0.0
                j += 1
            if geom >= 0:
                m = _share(spare, wraps, seen)
                seen += 1
            else:
                m = _share(spare, spans, span) if wraps == 0 else 0
            span += 1
            reach += left + around + right
            total[j], extent[j] = left + around + right, m + 1.0
            for i in range(m):
                turn[j + i], contact[j + i] = corner / m, around / m
                length[j + i] = around / m
            if touched:
                length[j] = left + 0.5 * around / m
                length[j + m] = right + 0.5 * around / m
                known = touch_of(memory, n, j)
                if known == _SAME:
                    known = _row(reference, n, _TOUCH)[j]
                marked = int(known) - 1 if 0.0 < known < _STRAIGHT else -1
                ahead, once, marked = _mark(model, data, geom, p, leaving, marked)
                turned[j], period[j], touch[j] = left + ahead, once, marked + 1.0
            else:
                for i in range(m + 1):
                    length[j + i] = straight / (m + 1)
                turned[j], period[j] = 0.0, 1.0
                touch[j] = _APART if geom >= 0 else _STRAIGHT
            j += m
        # Sites in one place have no path between them, and rub as one.
        if _dot(behind, behind) > 0.0:
            arriving = behind
        at += 3 if touched else 1
        k += 2 if geom >= 0 else 1
    return points, reach


@internal
def touch_of(memory: Floats, n: int, j: int) -> float:
    """What a state remembers of whether the span from node j touched a geom."""
    return float(memory[2 * (n + 1) + j])


@internal
def remember(shape: Floats, n: int, memory: Floats) -> None:
    """Write what a state remembers of a path."""
    assign(memory, shape[_TOTAL * (n + 1) : (_TOUCH + 1) * (n + 1)])


@internal
def _before(
    reference: Floats, memory: Floats, n: int, j: int
) -> tuple[float, float, float]:
    """Total, turned and touch of the span from node j in a state, see `lengthen`."""
    touch = touch_of(memory, n, j)
    if touch == _SAME:
        return (
            _row(reference, n, _TOTAL)[j],
            _row(reference, n, _TURNED)[j],
            _row(reference, n, _TOUCH)[j],
        )
    return memory[j], memory[n + 1 + j], touch


@internal
def growth(shape: Floats, reference: Floats, memory: Floats, n: int) -> float:
    """By how much the path is longer than in a state [m]; as `lengthen`."""
    extent, total = _row(shape, n, _EXTENT), _row(shape, n, _TOTAL)
    grown = 0.0
    for j in range(n + 1):
        if extent[j] != 0.0:
            grown += total[j] - _before(reference, memory, n, j)[0]
    return grown


@internal
def lengthen(
    shape: Floats, reference: Floats, memory: Floats, n: int, gained: Floats
) -> None:
    """What the path at every node has gained in length since a state.

    Args:
        shape: the path now, of `survey`.
        reference: the same in the pose `qpos0`.
        memory: of the state; where it is 0, that of a reset, the reference counts.
        n: number of segments.
        gained: out, (n + 1,) [m].
    """
    fill(gained, 0.0)
    extent, touch = _row(shape, n, _EXTENT), _row(shape, n, _TOUCH)
    total, turned = _row(shape, n, _TOTAL), _row(shape, n, _TURNED)
    period = _row(shape, n, _PERIOD)
    for j in range(n + 1):
        if extent[j] == 0.0:
            continue
        m = int(extent[j]) - 1
        before = _before(reference, memory, n, j)
        grown = total[j] - before[0]
        if touch[j] == _STRAIGHT:
            for i in range(m + 1):
                gained[j + i] = grown / (m + 1)
            continue
        left = 0.5 * grown
        if touch[j] > 0.0 and touch[j] == before[2]:
            left = turned[j] - before[1]
            left -= period[j] * np.rint(left / period[j])
        gained[j] = left
        gained[j + m] = grown - left


@internal
def pull(
    model: int,
    data: int,
    tendon: int,
    mouth: int,
    shape: Floats,
    n: int,
    guided: int,
    node: Floats,
    tied: float,
    scratch: int,
    target: int,
) -> None:
    """Add the forces of the pieces on the degrees of freedom.

    Args:
        model: address of the model.
        data: address of the data, at the position of `shape`.
        tendon: index of the tendon.
        mouth: as in `survey`.
        shape: of `survey`.
        n: number of segments.
        guided: as in `survey`.
        node: tension of the nodes (n + 1,) [N], negative where slack.
        tied: force along the whole tendon that MuJoCo applies [N], positive where it
            lengthens it.
        scratch: address of six numbers, of which the last three are 0.
        target: address of the sum (nv,).
    """
    start = fields.integer(model, fields.TENDON_ADR, tendon)
    number = fields.integer(model, fields.TENDON_NUM, tendon)
    at = fields.integer(data, fields.TEN_WRAPADR, tendon)
    extent = _row(shape, n, _EXTENT)
    j, k = guided, 0
    if mouth > 0:
        j += 1
    while k < number - 1:
        geom = -1
        if fields.integer(model, fields.WRAP_TYPE, start + k + 1) != _SITE:
            geom = fields.integer(model, fields.WRAP_OBJID, start + k + 1)
        touched = geom >= 0 and fields.integer(data, fields.WRAP_OBJ, at + 1) == geom
        ahead = k + (2 if geom >= 0 else 1)
        left, right = 0.0, 0.0
        if k >= mouth:
            m = int(extent[j]) - 1
            left, right = max(node[j], 0.0), max(node[j + m], 0.0)
            if not touched:
                left = right = 0.5 * (left + right)
            j += m + 1
        left, right = left + tied, right + tied
        first = fields.integer(model, fields.WRAP_OBJID, start + k)
        last = fields.integer(model, fields.WRAP_OBJID, start + ahead)
        here = fields.integer(model, fields.SITE_BODY, first)
        there = fields.integer(model, fields.SITE_BODY, last)
        if touched:
            on = fields.integer(model, fields.GEOM_BODY, geom)
            _draw(model, data, at, here, at + 1, on, left, scratch, target)
            _draw(model, data, at + 2, on, at + 3, there, right, scratch, target)
            at += 3
        else:
            _draw(model, data, at, here, at + 1, there, left, scratch, target)
            at += 1
        k = ahead


@internal
def _draw(
    model: int,
    data: int,
    first: int,
    first_body: int,
    second: int,
    second_body: int,
    tension: float,
    scratch: int,
    target: int,
) -> None:
    """Draw two points of the path, on two bodies, towards each other."""
    if tension == 0.0 or first_body == second_body:
        return
    d, length = _towards(_point(data, first), _point(data, second))
    if length <= SHORT:
        return
    points = load_word(data + fields.WRAP_XPOS)
    if fields.moves(model, first_body):
        apply_force(
            model, data, scratch, points + 24 * first, first_body, target,
            tension * d[0], tension * d[1], tension * d[2],
        )  # fmt: skip
    if fields.moves(model, second_body):
        apply_force(
            model, data, scratch, points + 24 * second, second_body, target,
            -tension * d[0], -tension * d[1], -tension * d[2],
        )  # fmt: skip
