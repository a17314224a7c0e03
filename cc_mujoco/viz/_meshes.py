"""Geoms of a MuJoCo model as triangles, for viewers without primitive shapes.

What is round is a profile turned about the z axis of the geom. Vertices are shared
along smooth surfaces and separate at edges, so that averaged normals show both.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SHAPE = mujoco.mjtGeom
ROUND_SIDES = (10, 24)
"""Sides of a round shape: when it is small and when it is large."""
LARGE_RADIUS = 0.025
"""Radius of what is large, over the reach of what there is to see."""
SPHERE_RINGS = 5
"""Rings from the pole of a sphere to its equator."""


class TriangleMesh(NamedTuple):
    """Triangles in the frame of what they belong to."""

    vertices: Array
    """Points (V, 3) [m]."""
    triangles: NDArray[np.int32]
    """Numbers of their corners (F, 3), anticlockwise as seen from outside."""


def geom_mesh(model: mujoco.MjModel, geom: int, reach: float) -> TriangleMesh:
    """Return the triangles of a geom in its own frame.

    Height fields and signed distance fields are their bounding boxes. `reach` of what
    there is to see [m] is half the side at which a larger plane is cut off, and decides
    how finely a round shape is drawn.
    """
    kind, (x, y, z) = model.geom_type[geom], model.geom_size[geom]
    if kind == SHAPE.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        return TriangleMesh(
            np.asarray(model.mesh_vert[first : first + count], dtype=np.float64),
            np.asarray(model.mesh_face[face : face + faces], dtype=np.int32),
        )
    if kind == SHAPE.mjGEOM_PLANE:
        x, y = (min(half, reach) if half > 0 else reach for half in (x, y))
        corners = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]])
        return TriangleMesh(corners, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32))
    if kind == SHAPE.mjGEOM_SPHERE:
        return _ball(np.array([x, x, x]), reach)
    if kind == SHAPE.mjGEOM_ELLIPSOID:
        return _ball(np.array([x, y, z]), reach)
    if kind == SHAPE.mjGEOM_CAPSULE:
        dome = _dome() * x
        dome[:, 1] += y
        return _revolve([np.concatenate([(dome * [1, -1])[::-1], dome])], x / reach)
    if kind == SHAPE.mjGEOM_CYLINDER:
        low, high = [x, -y], [x, y]
        sides = ([[0, -y], low], [low, high], [high, [0, y]])
        return _revolve([np.array(side) for side in sides], x / reach)
    if kind == SHAPE.mjGEOM_BOX:
        return _box(np.zeros(3), model.geom_size[geom])
    return _box(model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:])


def join_meshes(meshes: list[TriangleMesh]) -> TriangleMesh:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    faces = [m.triangles + start for m, start in zip(meshes, starts, strict=True)]
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    return TriangleMesh(vertices, np.concatenate(faces).astype(np.int32))


def _dome() -> Array:
    """Return radius and height of a unit half ball, from equator to pole."""
    angle = np.linspace(0.0, 0.5 * np.pi, SPHERE_RINGS + 1)
    return np.stack([np.cos(angle) * (angle < 0.5 * np.pi), np.sin(angle)], axis=1)


def _ball(halves: Array, reach: float) -> TriangleMesh:
    dome = _dome()
    profile = np.concatenate([(dome[1:] * [1, -1])[::-1], dome])
    ball = _revolve([profile], float(halves.max()) / reach)
    return TriangleMesh(ball.vertices * halves, ball.triangles)


def _revolve(profiles: list[Array], size: float) -> TriangleMesh:
    """Turn profiles about z; each is smooth, and edges are between them.

    They have radius and height of points (P, 2), the lowest first; `size` is the radius
    over the reach of what there is to see.
    """
    sides = ROUND_SIDES[int(size > LARGE_RADIUS)]
    turn = np.arange(sides) * (2.0 * np.pi / sides)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    here = np.arange(sides)
    beside = (here + 1) % sides
    meshes = []
    for profile in profiles:
        rings = [np.c_[radius * circle, np.full(sides, z)] for radius, z in profile]
        faces = []
        for ring, (low, high) in enumerate(pairwise(profile[:, 0])):
            a, b = ring * sides + here, ring * sides + beside
            if low > 0:
                faces.append(np.stack([a, b, b + sides], axis=1))
            if high > 0:
                faces.append(np.stack([a, b + sides, a + sides], axis=1))
        meshes.append(TriangleMesh(np.concatenate(rings), np.concatenate(faces)))
    return join_meshes(meshes)


def _box(center: Array, half: Array) -> TriangleMesh:
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)
    meshes = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            # Cyclic axes keep the order of the corners; the far side turns it.
            corners = np.roll(np.c_[square, np.full(4, side)], axis + 1, axis=1)
            faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
            meshes.append(
                TriangleMesh(
                    corners * half + center, faces if side > 0 else faces[:, ::-1]
                )
            )
    return join_meshes(meshes)
