"""Places of a path, measured from a body close to it.

Far from the origin, positions of single precision are coarse: 4 µm at 100 m. So the
bodies of a path are placed relative to the body that carries the whole path: along the
kinematic chain from there, distances stay short. The points at which a path touches a
geom are those of mujoco_warp, projected onto the surface. Their error along the surface
changes no length to first order, as the path is the shortest of all over the surface.
"""

# Warp reads the annotations of its kernels, so they are not postponed here.

import math

import mujoco
import warp as wp

from cc_mujoco.cable import _path_geometry as geometry


@wp.struct
class Links:
    """Links: bodies between a tendon's places and the carrier of its whole path."""

    starts: wp.array(dtype=int)  # first link of each tendon (tendons,)
    numbers: wp.array(dtype=int)  # number of links, parents first (tendons,)
    carriers: wp.array(dtype=int)  # body that carries the whole path (tendons,)
    bodies: wp.array(dtype=int)  # body of each link (links,)
    above: wp.array(dtype=int)  # parent within the tendon, -1: carrier (links,)
    places: wp.array(dtype=int)  # link within the tendon, -1: carrier (all places,)


@wp.struct
class Pose:
    """Arrays of a model and its data that give the pose of bodies, sites and geoms."""

    body_parentid: wp.array(dtype=int)
    body_jntnum: wp.array(dtype=int)
    body_jntadr: wp.array(dtype=int)
    body_mocapid: wp.array(dtype=int)
    jnt_type: wp.array(dtype=int)
    jnt_qposadr: wp.array(dtype=int)
    body_pos: wp.array2d(dtype=wp.vec3)
    body_quat: wp.array2d(dtype=wp.quat)
    jnt_pos: wp.array2d(dtype=wp.vec3)
    jnt_axis: wp.array2d(dtype=wp.vec3)
    qpos0: wp.array2d(dtype=float)
    site_pos: wp.array2d(dtype=wp.vec3)
    geom_pos: wp.array2d(dtype=wp.vec3)
    geom_size: wp.array2d(dtype=wp.vec3)
    qpos: wp.array2d(dtype=float)
    mocap_pos: wp.array2d(dtype=wp.vec3)
    xpos: wp.array2d(dtype=wp.vec3)
    xquat: wp.array2d(dtype=wp.quat)
    geom_xpos: wp.array2d(dtype=wp.vec3)
    geom_xmat: wp.array2d(dtype=wp.mat33)
    ten_wrapadr: wp.array2d(dtype=int)
    wrap_obj: wp.array2d(dtype=wp.vec2i)
    wrap_xpos: wp.array2d(dtype=wp.spatial_vector)


@wp.func
def vector_of(row: wp.array(dtype=float), i: int):
    return wp.vec3(row[i], row[i + 1], row[i + 2])


@wp.func
def place_vector(places: wp.array(dtype=float), k: int, what: int):
    return vector_of(places, geometry.PLACE_SIZE * k + what)


@wp.func
def _write_vector(row: wp.array(dtype=float), i: int, v: wp.vec3):
    row[i] = v[0]  # an index that varies would need a stack
    row[i + 1] = v[1]
    row[i + 2] = v[2]


@wp.func
def _turn_of(q: wp.quat):
    """Return a quaternion of MuJoCo, real part first, as one of Warp."""
    return wp.quat(q[1], q[2], q[3], q[0])


@wp.func
def _turn_about(axis: wp.vec3, angle: float):
    """Return the rotation about an axis by series, as Warp's sine needs a stack."""
    half = 0.5 * angle
    half -= wp.static(math.pi) * wp.round(half * wp.static(1.0 / math.pi))
    q = half * half  # up to (pi / 2)^2; the opposite quaternion is the same turn
    sine = 1.0 / 120.0 - q * (1.0 / 5040.0 - q * (1.0 / 362880.0 - q / 39916800.0))
    sine = half * (1.0 - q * (1.0 / 6.0 - q * sine))
    cosine = 1.0 / 40320.0 - q * (1.0 / 3628800.0 - q / 479001600.0)
    cosine = 1.0 - q * (0.5 - q * (1.0 / 24.0 - q * (1.0 / 720.0 - q * cosine)))
    return wp.quat(axis[0] * sine, axis[1] * sine, axis[2] * sine, cosine)


@wp.func
def _is_free(pose: Pose, body: int):
    if pose.body_jntnum[body] != 1:
        return False
    return pose.jnt_type[pose.body_jntadr[body]] == wp.static(
        int(mujoco.mjtJoint.mjJNT_FREE)
    )


@wp.func
def _offset(pose: Pose, world: int, body: int):
    if _is_free(pose, body):
        i = pose.jnt_qposadr[pose.body_jntadr[body]]
        return vector_of(pose.qpos[world], i)
    if pose.body_mocapid[body] >= 0:
        return pose.mocap_pos[world, pose.body_mocapid[body]]
    return pose.body_pos[world % pose.body_pos.shape[0], body]


@wp.func
def _moved(pose: Pose, world: int, body: int, start: wp.vec3, parent_turn: wp.quat):
    at = wp.vec3(start[0], start[1], start[2])
    fixed = _turn_of(pose.body_quat[world % pose.body_quat.shape[0], body])
    turn = parent_turn * fixed
    first = pose.body_jntadr[body]
    for joint in range(first, first + pose.body_jntnum[body]):
        kind, i = pose.jnt_type[joint], pose.jnt_qposadr[joint]
        arm = pose.jnt_pos[world % pose.jnt_pos.shape[0], joint]
        axis = pose.jnt_axis[world % pose.jnt_axis.shape[0], joint]
        if kind == wp.static(int(mujoco.mjtJoint.mjJNT_SLIDE)):
            way = pose.qpos[world, i] - pose.qpos0[world % pose.qpos0.shape[0], i]
            at += wp.quat_rotate(turn, axis) * way
        else:
            at += wp.quat_rotate(turn, arm)
            if kind == wp.static(int(mujoco.mjtJoint.mjJNT_BALL)):
                q = pose.qpos[world]
                own = wp.quat(q[i + 1], q[i + 2], q[i + 3], q[i])
                turn = turn * wp.normalize(own)
            else:
                angle = pose.qpos[world, i] - pose.qpos0[world % pose.qpos0.shape[0], i]
                turn = turn * _turn_about(axis, angle)
            at -= wp.quat_rotate(turn, arm)
    return at


@wp.func
def locate(
    links: Links, pose: Pose, tendon: int, world: int, near: wp.array(dtype=float)
):
    """Locate the links of a tendon relative to a point, its first link at rest.

    `near` becomes that point in the world, then the vectors from it to all links.
    """
    start = links.starts[tendon]
    carrier = links.carriers[tendon]
    turn = _turn_of(pose.xquat[world, carrier])
    origin = wp.vec3(0.0, 0.0, 0.0)
    if links.numbers[tendon] > 0:
        origin = _offset(pose, world, links.bodies[start])
    _write_vector(near, 0, pose.xpos[world, carrier] + wp.quat_rotate(turn, origin))
    for k in range(links.numbers[tendon]):
        body, above = links.bodies[start + k], links.above[start + k]
        parent_turn = _turn_of(pose.xquat[world, pose.body_parentid[body]])
        offset = _offset(pose, world, body)
        at = wp.vec3(0.0, 0.0, 0.0)
        if above < 0:
            offset -= origin
        else:
            at = vector_of(near, 3 * above + 3)
        at += wp.quat_rotate(parent_turn, offset)
        if not _is_free(pose, body):
            at = _moved(pose, world, body, at, parent_turn)
        _write_vector(near, 3 * k + 3, at)


@wp.func
def _attached(
    links: Links, pose: Pose, tendon: int, world: int, place: int, own: wp.vec3,
    near: wp.array(dtype=float),
):  # fmt: skip
    """Return the vector from the point of `near` to point `own` of a place's body."""
    link, start = links.places[place], links.starts[tendon]
    if link >= 0:
        turn = _turn_of(pose.xquat[world, links.bodies[start + link]])
        return vector_of(near, 3 * link + 3) + wp.quat_rotate(turn, own)
    turn = _turn_of(pose.xquat[world, links.carriers[tendon]])
    if links.numbers[tendon] == 0:
        return wp.quat_rotate(turn, own)
    return wp.quat_rotate(turn, own - _offset(pose, world, links.bodies[start]))


@wp.func
def _on_surface(kind: float, radius: float, axis: wp.vec3, arm: wp.vec3):
    """Return the point on a sphere or cylinder closest to `arm`, from its centre."""
    along = wp.vec3(0.0, 0.0, 0.0)
    if kind != geometry.SPHERE:
        along = wp.dot(arm, axis) * axis
    return along + radius * wp.normalize(arm - along)


@wp.func
def _path_point(points: wp.array(dtype=wp.spatial_vector), i: int):
    if i % 2 == 0:
        return wp.spatial_top(points[i // 2])
    return wp.spatial_bottom(points[i // 2])


@wp.func
def read_places(
    links: Links, pose: Pose, tendon: int, world: int, start: int, number: int,
    kinds: wp.array(dtype=float), objects: wp.array(dtype=int),
    near: wp.array(dtype=float), places: wp.array(dtype=float),
):  # fmt: skip
    """Write a path's places as in `_path_geometry.py`, from the point of `near`."""
    locate(links, pose, tendon, world, near)
    points, wrapped = pose.wrap_xpos[world], pose.wrap_obj[world]
    point = int(pose.ten_wrapadr[world, tendon])
    for k in range(number):
        place, i = start + k, geometry.PLACE_SIZE * k
        kind, thing = kinds[place], objects[place]
        places[i] = kind
        if kind == geometry.SITE:
            own = pose.site_pos[world % pose.site_pos.shape[0], thing]
            at = _attached(links, pose, tendon, world, place, own, near)
            _write_vector(places, i + geometry.FIRST, at)
            point += 1
        else:
            places[i + geometry.TOUCHED] = 0.0
            pair = wrapped[point // 2]
            touched = pair[1]
            if point % 2 == 0:
                touched = pair[0]
            if touched == thing:
                places[i + geometry.TOUCHED] = 1.0
                own = pose.geom_pos[world % pose.geom_pos.shape[0], thing]
                centre = _attached(links, pose, tendon, world, place, own, near)
                frame = wp.transpose(pose.geom_xmat[world, thing])
                radius = pose.geom_size[world % pose.geom_size.shape[0], thing][0]
                for side in range(2):
                    arm = _path_point(points, point + side)
                    arm -= pose.geom_xpos[world, thing]
                    arm = _on_surface(kind, radius, frame[2], arm)
                    # The last point follows the first one.
                    _write_vector(places, i + geometry.FIRST + 3 * side, centre + arm)
                point += 2
                _write_vector(places, i + geometry.CENTRE, centre)
                axes = i + geometry.AXES
                _write_vector(places, axes, frame[0])
                _write_vector(places, axes + 3, frame[1])
                _write_vector(places, axes + 6, frame[2])
