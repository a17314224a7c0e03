"""Kernels of cables guided by a tendon: along an open path, or by its bends.

The path is that of the tendon in mujoco_warp's data. A row belongs to a cable of a
world, as in `_kernels.py`; rows of cables without a tendon are not changed.
"""

# Warp reads the annotations of its kernels, so they are not postponed here.

from functools import lru_cache
from types import SimpleNamespace

import warp as wp

from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _path_geometry as geometry
from cc_mujoco.warp._build import Paths, functions
from cc_mujoco.warp._kernels import OPTIONS, RESET, CableRows
from cc_mujoco.warp._place_kernels import (
    Links,
    Pose,
    place_vector,
    read_places,
    vector_of,
)


@wp.struct
class PathRows:
    """Tendons that guide the cables, and their paths."""

    tendons: wp.array(dtype=int)  # index of the tendon, -1: none (cables,)
    starts: wp.array(dtype=int)  # start of its path in `wrap_type` (cables,)
    numbers: wp.array(dtype=int)  # number of places of its path (cables,)
    mouths: wp.array(dtype=int)  # place where the conduit ends, 0: none (cables,)
    guided: wp.array(dtype=int)  # number of segments in the conduit (cables,)
    bends: wp.array(dtype=int)  # not 0 if the tendon bends the conduit (cables,)
    guides: wp.array2d(dtype=float)  # see `cable._open_path.measure` (cables, places)
    kinds: wp.array(dtype=float)  # kind as `_path_geometry.SPHERE` (all places,)
    objects: wp.array(dtype=int)  # index of site or geom (all places,)
    bodies: wp.array(dtype=int)  # body of site or geom (all places,)
    last_dofs: wp.array(dtype=int)  # last degree of freedom, -1: none (bodies,)
    parents: wp.array(dtype=int)  # degree of freedom before, -1: none (nv,)
    roots: wp.array(dtype=int)  # root body (bodies,)
    reference: wp.array2d(dtype=float)  # shape in the pose `qpos0`
    memory: wp.array3d(dtype=float)  # memory of the path, committed and pending
    shape: wp.array2d(dtype=float)  # shape of the path now
    near: wp.array2d(dtype=float)  # bodies of the path, see `_place_kernels.locate`
    places: wp.array2d(dtype=float)  # places from there, see `cable/_path_geometry.py`
    forces: wp.array2d(dtype=float)  # see `cable._open_path.pull_forces`
    gained: wp.array2d(dtype=float)  # scratch (rows, nodes)
    pulls: wp.array2d(dtype=float)  # generalised forces of the pieces (rows, nv)


@wp.func
def _draw(
    paths: PathRows, row: int, first: wp.vec3, first_body: int, second: wp.vec3,
    second_body: int, force: wp.vec3, origin: wp.vec3, centres: wp.array(dtype=wp.vec3),
    motions: wp.array(dtype=wp.spatial_vector),
):  # fmt: skip
    """Add the generalised force of a piece to `pulls`.

    `force` acts on its first body, the opposite on its second; degrees of freedom that
    move both bodies get none. Points are relative to `origin`.
    """
    i = int(paths.last_dofs[first_body])
    j = int(paths.last_dofs[second_body])
    first_arm = first + (origin - centres[paths.roots[first_body]])
    second_arm = second + (origin - centres[paths.roots[second_body]])
    while i != j:
        if i > j:
            motion = motions[i]
            way = wp.spatial_bottom(motion)
            way += wp.cross(wp.spatial_top(motion), first_arm)
            paths.pulls[row, i] = paths.pulls[row, i] + wp.dot(force, way)
            i = int(paths.parents[i])
        else:
            motion = motions[j]
            way = wp.spatial_bottom(motion)
            way += wp.cross(wp.spatial_top(motion), second_arm)
            paths.pulls[row, j] = paths.pulls[row, j] - wp.dot(force, way)
            j = int(paths.parents[j])


@lru_cache(maxsize=16)
def path_kernels(terms: frozenset[str], yields: bool, kind: Paths) -> SimpleNamespace:
    own = functions(wp.float32, terms, yields, kind)
    has_open = kind.lengthens != 0.0
    has_bends, has_play = kind.bent, "clearance" in terms

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def survey(
        rows: CableRows, paths: PathRows, links: Links, pose: Pose,
        lengths: wp.array2d(dtype=float),
    ):  # fmt: skip
        cable, world = wp.tid()
        tendon = paths.tendons[cable]
        if tendon < 0:
            return
        row, n = cable * rows.worlds + world, rows.segments[cable]
        shape, places = paths.shape[row], paths.places[row]
        number, mouth = paths.numbers[cable], paths.mouths[cable]
        guided = paths.guided[cable]
        read_places(
            links, pose, tendon, world, paths.starts[cable], number, paths.kinds,
            paths.objects, paths.near[row], places,
        )  # fmt: skip
        if wp.static(has_open):
            if guided < n:
                reference = paths.reference[row]
                reach = own.measure(
                    places, number, mouth, guided, n, paths.guides[cable], shape
                )
                own.keep_conduit(shape, reference, n, guided)
                if wp.static(has_bends):
                    if paths.bends[cable] != 0:
                        own.bend(
                            places, mouth + 1, lengths[world, tendon] - reach,
                            own.contacts(reference, n), guided, shape,
                        )  # fmt: skip
                        own.remember_bends(shape, n, guided)
                return
        if wp.static(has_bends):
            inside = own.contact_length(rows.prm[row], n)
            own.bend(places, number, lengths[world, tendon], inside, n, shape)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def lay(rows: CableRows, paths: PathRows):
        cable, world = wp.tid()
        if paths.tendons[cable] < 0:
            return
        row, n = cable * rows.worlds + world, rows.segments[cable]
        prm, shape, now = rows.prm[row], paths.shape[row], rows.now[row]
        if wp.static(has_open):
            if paths.guided[cable] < n:
                if rows.fresh[row] == RESET:
                    if rows.rest_in_pose:
                        own.save_path(shape, n, paths.memory[now, row])
                    else:
                        for i in range(paths.memory.shape[2]):
                            paths.memory[now, row, i] = 0.0
                own.lay(
                    prm, n, rows.state[now, row], shape, paths.reference[row],
                    paths.memory[now, row], paths.gained[row],
                )  # fmt: skip
                own.save_path(shape, n, paths.memory[1 - now, row])
                return
        if wp.static(has_bends):
            own.set_path(prm, n, shape, own.contact_length(prm, n))
            if wp.static(has_play):
                if rows.fresh[row] == RESET:
                    # Mounted in the bends of the pose.
                    if rows.rest_in_pose:
                        own.rest_in(prm, n, shape, rows.state[now, row])
                    else:
                        bends = paths.reference[row]
                        own.rest_in(prm, n, bends, rows.state[now, row])

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def pull(
        rows: CableRows, paths: PathRows, pending: int,
        gears: wp.array2d(dtype=wp.spatial_vector), centres: wp.array2d(dtype=wp.vec3),
        motions: wp.array2d(dtype=wp.spatial_vector),
    ):  # fmt: skip
        """Compute the forces of all pieces, in the pending or the committed state."""
        cable, world = wp.tid()
        row, n = cable * rows.worlds + world, rows.segments[cable]
        guided, tendon = paths.guided[cable], paths.tendons[cable]
        if tendon < 0 or guided == n:
            return
        for i in range(paths.pulls.shape[1]):
            paths.pulls[row, i] = 0.0
        which = int(rows.now[row])
        tied = float(0.0)
        if pending != 0:
            which = 1 - which
            for end in range(2):
                if rows.tied[cable, end] != 0:
                    gear = gears[world % gears.shape[0], rows.actuators[cable, end]][0]
                    if end == 1:
                        gear = -gear
                    place = at.STATE_HEADER + end * n
                    tied += gear * wp.max(rows.state[which, row, place], 0.0)
        places, forces = paths.places[row], paths.forces[row]
        origin = vector_of(paths.near[row], 0)
        number = paths.numbers[cable]
        own.pull_forces(
            places, number, paths.mouths[cable], paths.shape[row], n, guided,
            own.tensions(rows.state[which, row], n), tied, -1, forces,
        )  # fmt: skip
        k, start = int(0), paths.starts[cable]
        while k < number - 1:
            here, i = place_vector(places, k, geometry.FIRST), 6 * k
            body = int(paths.bodies[start + k])
            if paths.kinds[start + k + 1] != geometry.SITE:
                k += 1
                if places[geometry.PLACE_SIZE * k + geometry.TOUCHED] != 0.0:
                    on = int(paths.bodies[start + k])
                    _draw(
                        paths, row, here, body,
                        place_vector(places, k, geometry.FIRST), on,
                        vector_of(forces, i), origin, centres[world], motions[world],
                    )  # fmt: skip
                    here, body = place_vector(places, k, geometry.LAST), on
                    i += 3
            k += 1
            _draw(
                paths, row, here, body, place_vector(places, k, geometry.FIRST),
                paths.bodies[start + k], vector_of(forces, i), origin, centres[world],
                motions[world],
            )  # fmt: skip

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def repack(rows: CableRows, paths: PathRows, values: wp.array3d(dtype=float)):
        cable, world = wp.tid()
        row, n = cable * rows.worlds + world, rows.segments[cable]
        if paths.tendons[cable] >= 0:
            own.expect_change(rows.prm[row])
            if wp.static(has_open):
                if paths.guided[cable] < n:
                    own.pack_reference(
                        values[cable, world], n, paths.guided[cable],
                        paths.reference[row], rows.prm[row],
                    )  # fmt: skip

    return SimpleNamespace(survey=survey, lay=lay, pull=pull, repack=repack)


@wp.kernel(module="unique", enable_backward=False)
def add_pulls(
    worlds: int,
    cables: int,
    pulls: wp.array2d(dtype=float),
    total: wp.array2d(dtype=float),
):
    """Add the forces `pulls` of all cables to `total` (worlds, nv), in order."""
    world, i = wp.tid()
    whole = total[world, i]
    for cable in range(cables):
        whole += pulls[cable * worlds + world, i]
    total[world, i] = whole
