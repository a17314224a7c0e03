"""Kernels that evaluate the cables of all worlds; one thread per cable and world.

Row `cable * worlds + world` of every array belongs to a cable of a world. The state is
kept twice: committed, of the step before, and pending, of the evaluation made last.
"""

# Warp reads the annotations of its kernels, so they are not postponed here.

from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _layout as at
from cc_mujoco.warp._build import functions

_ECCENTRICITY, _PHASE = law.INDEX["eccentricity"], law.INDEX["eccentricity_phase"]
_OVALITY, _OVALITY_PHASE = law.INDEX["ovality"], law.INDEX["ovality_phase"]
_PULLEY_TERMS = frozenset(["eccentricity", "ovality"])
_SCALARS = at.SCALARS
_TENSIONS = at.STATE_HEADER

OPTIONS: Any = {"fuse_fp": False, "max_unroll": 1}
"""Options of all kernels: rounding as written, and loops that stay loops."""
STABILITY_LIMIT = 2.5
"""Square of step times frequency up to which looking ahead changes nothing."""
_VELOCITY_GAIN = 0.25
_DRAW = 0.01
"""Share of the error of a followed end that a step takes away."""


@lru_cache(maxsize=16)
def kernels(terms: frozenset[str], implicit: bool) -> SimpleNamespace:
    """Return the kernels for cables with these terms.

    Args:
        terms: parameters whose terms may be on.
        implicit: whether ends look ahead, see `plugin/_implicit_ends.py`.
    """
    own = functions(wp.float32, terms, implicit)
    step, initialize, pack_mesh = own.step, own.initialize, own.pack_mesh
    end_stiffness, expect_yielding = own.end_stiffness, own.expect_yielding
    node_stiffness = own.node_stiffness
    wound_length, lever_ratio = own.wound_length, own.lever_ratio
    has_pulley = not _PULLEY_TERMS.isdisjoint(terms)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def begin(
        time: wp.array(dtype=float),
        timestep: wp.array(dtype=float),
        lengths: wp.array2d(dtype=float),
        qvel: wp.array2d(dtype=float),
        rownnz: wp.array2d(dtype=int),
        rowadr: wp.array2d(dtype=int),
        colind: wp.array2d(dtype=int),
        moment: wp.array2d(dtype=float),
        gears: wp.array2d(dtype=wp.spatial_vector),
        segments: wp.array(dtype=int),
        actuators: wp.array2d(dtype=int),
        followed: wp.array2d(dtype=int),
        rest: wp.array2d(dtype=float),
        rest_in_pose: bool,
        prm: wp.array2d(dtype=float),
        stamp: wp.array(dtype=float),
        now: wp.array(dtype=int),
        fresh: wp.array(dtype=int),
        place: wp.array3d(dtype=float),
        slope: wp.array3d(dtype=float),
        state: wp.array3d(dtype=float),
        aim: wp.array2d(dtype=float),
    ):
        """Commit or reset by the time of the world, and find where the ends are."""
        cable, world = wp.tid()
        row = cable * time.shape[0] + world
        is_reset = time[world] < stamp[row]
        if is_reset:
            fresh[row] = 1
        elif time[world] > stamp[row]:
            now[row] = 1 - now[row]
            fresh[row] = 0
        stamp[row] = time[world]
        for end in range(2):
            actuator = actuators[cable, end]
            # Small numbers round less: displacements are from the pose `qpos0` on.
            u = lengths[world, actuator] - rest[cable, end]
            if followed[cable, end] != 0:
                # By its velocity, at the mean slope of the length over the step.
                moved = float(0.0)
                line = 2 * row + end
                for i in range(rownnz[world, actuator]):
                    k = rowadr[world, actuator] + i
                    column = colind[world, k]
                    mean = 0.5 * (moment[world, k] + slope[now[row], line, column])
                    moved += mean * qvel[world, column]
                    slope[1 - now[row], line, column] = moment[world, k]
                if fresh[row] == 0:
                    moved *= timestep[world % timestep.shape[0]]
                    moved += place[now[row], row, end]
                    u = moved + _DRAW * (u - moved)
                place[1 - now[row], row, end] = u
            lever = float(1.0)
            if wp.static(has_pulley):
                if end == 0:
                    gear = gears[world % gears.shape[0], actuator][0]
                    p, start = prm[row], rest[cable, 0]
                    lever = lever_ratio(
                        u + start, gear, p[_ECCENTRICITY], p[_PHASE], p[_OVALITY],
                        p[_OVALITY_PHASE],
                    )  # fmt: skip
                    u = wound_length(
                        u + start, gear, p[_ECCENTRICITY], p[_PHASE], p[_OVALITY],
                        p[_OVALITY_PHASE],
                    ) - wound_length(
                        start, gear, p[_ECCENTRICITY], p[_PHASE], p[_OVALITY],
                        p[_OVALITY_PHASE],
                    )  # fmt: skip
            aim[row, end] = u
            if end == 0:
                aim[row, 4] = lever
            aim[row, 2 + end] = 0.0
        if is_reset:
            first, second = float(0.0), float(0.0)
            if rest_in_pose:
                first, second = float(aim[row, 0]), float(aim[row, 1])
            initialize(prm[row], segments[cable], first, second, state[now[row], row])

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def evaluate(
        worlds: int,
        looks: wp.array(dtype=int),
        timestep: wp.array(dtype=float),
        segments: wp.array(dtype=int),
        actuators: wp.array2d(dtype=int),
        aim: wp.array2d(dtype=float),
        now: wp.array(dtype=int),
        prm: wp.array2d(dtype=float),
        state: wp.array3d(dtype=float),
        work: wp.array2d(dtype=float),
        tensions: wp.array3d(dtype=float),
        force: wp.array2d(dtype=float),
    ):
        """Take the step from the committed to the pending state; apply the tensions."""
        cable, world = wp.tid()
        row = cable * worlds + world
        n = segments[cable]
        pending = state[1 - now[row], row]
        own_prm = prm[row]
        committed = state[now[row], row]
        u, v = float(aim[row, 0]), float(aim[row, 1])
        yields = wp.vec2(aim[row, 2], aim[row, 3])
        ahead, passes, doubt = wp.vec2(0.0), wp.vec2(0.0), wp.vec2(0.0)
        status, is_last = int(0), bool(False)
        for stage in range(wp.static(3 if implicit else 1)):
            if wp.static(implicit):
                expect_yielding(own_prm, yields[0], yields[1])
            status = step(
                own_prm, n, committed, 0, u, 0, v,
                timestep[world % timestep.shape[0]], pending,
                work[row % work.shape[0]],
            )  # fmt: skip
            if wp.static(implicit):
                # Does an end become taut or slack? See `plugin/_slack_passage.py`.
                if status != 0 or is_last or looks[cable] == 0:
                    break
                for end in range(2):
                    before = committed[_TENSIONS + end * n]
                    after = pending[_TENSIONS + end * n]
                    if stage == 0:
                        sense = 1.0 - 2.0 * float(end)
                        gained = wp.max(after, 0.0) - wp.max(before, 0.0)
                        ahead[end] = (
                            aim[row, 5 + end] + sense * aim[row, 7 + end] * gained
                        )
                        relaxes = sense * (ahead[end] - pending[end])
                        if after <= 0.0:
                            if before <= 0.0 and relaxes < 0.0:
                                doubt[end] = 1.0
                        elif before <= 0.0:
                            passes[end] = 1.0
                        elif relaxes * node_stiffness(own_prm, n)[end * n] > after:
                            doubt[end] = -1.0
                    elif doubt[end] != 0.0:
                        passes[end] = 0.0
                        if (after > 0.0) == (doubt[end] > 0.0):
                            passes[end] = 1.0
                doubtful = doubt[0] != 0.0 or doubt[1] != 0.0
                if stage == 0 and doubtful:
                    u, v = float(ahead[0]), float(ahead[1])
                    yields = wp.vec2(0.0)
                else:
                    if stage == 0 and passes[0] == 0.0 and passes[1] == 0.0:
                        break
                    is_last = True
                    u, v = float(aim[row, 0]), float(aim[row, 1])
                    yields = wp.vec2(aim[row, 2], aim[row, 3])
                    if passes[0] != 0.0:
                        u = aim[row, 5]
                        yields[0] = aim[row, 7]
                    if passes[1] != 0.0:
                        v = aim[row, 6]
                        yields[1] = aim[row, 8]
        for end in range(2):
            tension = wp.max(pending[_TENSIONS + end * n], 0.0)
            if status != 0:
                tension = wp.nan
            tensions[world, cable, end] = tension
            pull = -tension
            if end == 0:
                pull = tension * aim[row, 4]
            force[world, actuators[cable, end]] = pull

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def repack(
        segments: wp.array(dtype=int),
        values: wp.array3d(dtype=float),
        prm: wp.array2d(dtype=float),
    ):
        """Pack the parameters of all worlds anew, on the meshes that they have."""
        cable, world = wp.tid()
        pack_mesh(
            values[cable, world], segments[cable], prm[cable * values.shape[1] + world]
        )

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def look_ahead(
        worlds: int,
        looks: wp.array(dtype=int),
        timestep: wp.array(dtype=float),
        segments: wp.array(dtype=int),
        actuators: wp.array2d(dtype=int),
        rownnz: wp.array2d(dtype=int),
        rowadr: wp.array2d(dtype=int),
        colind: wp.array2d(dtype=int),
        moment: wp.array2d(dtype=float),
        answers: wp.array3d(dtype=float),
        found: wp.array2d(dtype=float),
        velocities: wp.array2d(dtype=float),
        prm: wp.array2d(dtype=float),
        aim: wp.array2d(dtype=float),
    ):
        """Move the ends to where the step takes their tensions, and let them yield.

        Columns 5 to 8 of `aim` are where the step leads, and how that yields.
        """
        cable, world = wp.tid()
        if looks[cable] == 0:
            return
        row = cable * worlds + world
        h = timestep[world % timestep.shape[0]]
        for end in range(2):
            mobility = float(0.0)
            for other in range(2 * segments.shape[0]):
                a = actuators[other // 2, other % 2]
                moved = float(0.0)
                for i in range(rownnz[world, a]):
                    k = rowadr[world, a] + i
                    moved += (
                        moment[world, k]
                        * answers[2 * cable + end, world, colind[world, k]]
                    )
                if other % 2 == 0:
                    moved *= aim[(other // 2) * worlds + world, 4]
                mobility += wp.abs(moved)
            actuator = actuators[cable, end]
            lever = float(1.0)
            if end == 0:
                lever = aim[row, 4]
            ahead = float(0.0)
            for i in range(rownnz[world, actuator]):
                k = rowadr[world, actuator] + i
                ahead += lever * moment[world, k] * found[world, colind[world, k]]
            square = (
                h * h * mobility * end_stiffness(prm[row], segments[cable], end == 1)
            )
            share = float(0.0)
            if square > STABILITY_LIMIT:
                share = 1.0 - STABILITY_LIMIT / square
            beta = share * h * h / STABILITY_LIMIT
            speed = lever * velocities[world, actuator]
            aim[row, 5 + end] = aim[row, end] + h * speed + h * h * ahead
            aim[row, 7 + end] = h * h * mobility
            gain = _VELOCITY_GAIN * share * share * h
            aim[row, end] += gain * speed + beta * ahead
            aim[row, 2 + end] = beta * mobility

    return SimpleNamespace(
        begin=begin, evaluate=evaluate, repack=repack, look_ahead=look_ahead
    )


@wp.kernel(module="unique", enable_backward=False)
def moment_row(
    cable: int,
    end: int,
    worlds: int,
    actuators: wp.array2d(dtype=int),
    rownnz: wp.array2d(dtype=int),
    rowadr: wp.array2d(dtype=int),
    colind: wp.array2d(dtype=int),
    moment: wp.array2d(dtype=float),
    aim: wp.array2d(dtype=float),
    right: wp.array2d(dtype=float),
):
    """Write the generalised force of a unit tension of one end (worlds, nv)."""
    world = wp.tid()
    for i in range(right.shape[1]):
        right[world, i] = 0.0
    actuator = actuators[cable, end]
    lever = float(1.0)
    if end == 0:
        lever = aim[cable * worlds + world, 4]
    for i in range(rownnz[world, actuator]):
        k = rowadr[world, actuator] + i
        right[world, colind[world, k]] = lever * moment[world, k]


@wp.kernel(module="unique", enable_backward=False)
def add_forces(
    worlds: int,
    segments: wp.array(dtype=int),
    ends: wp.array(dtype=int),
    aim: wp.array2d(dtype=float),
    now: wp.array(dtype=int),
    fresh: wp.array(dtype=int),
    state: wp.array3d(dtype=float),
    rownnz: wp.array2d(dtype=int),
    rowadr: wp.array2d(dtype=int),
    colind: wp.array2d(dtype=int),
    moment: wp.array2d(dtype=float),
    passive: wp.array2d(dtype=float),
    bias: wp.array2d(dtype=float),
    applied: wp.array2d(dtype=float),
    constraint: wp.array2d(dtype=float),
    force: wp.array2d(dtype=float),
    total: wp.array2d(dtype=float),
):
    """Add up the forces of the step, with tensions and constraints as they were.

    `ends` is twice the cable and the end of each actuator, -1 of others.
    """
    world = wp.tid()
    for i in range(total.shape[1]):
        total[world, i] = passive[world, i] - bias[world, i] + applied[world, i]
        if fresh[world] == 0:
            total[world, i] = total[world, i] + constraint[world, i]
    for actuator in range(ends.shape[0]):
        pull = float(force[world, actuator])
        if ends[actuator] >= 0:
            cable, end = ends[actuator] // 2, ends[actuator] % 2
            row = cable * worlds + world
            place = _TENSIONS + end * segments[cable]
            pull = wp.max(state[now[row], row, place], 0.0)
            if end == 0:
                pull = pull * aim[row, 4]
            else:
                pull = -pull
        for i in range(rownnz[world, actuator]):
            k = rowadr[world, actuator] + i
            column = colind[world, k]
            total[world, column] = total[world, column] + moment[world, k] * pull


@wp.kernel(module="unique", enable_backward=False)
def forget(mask: wp.array(dtype=bool), stamp: wp.array(dtype=float)):
    """Make the next evaluation of some worlds lay their cables at rest."""
    cable, world = wp.tid()
    if mask[world]:
        stamp[cable * mask.shape[0] + world] = wp.inf


@wp.kernel(module="unique", enable_backward=False)
def write_rows(
    rows: wp.array(dtype=int),
    given: wp.array2d(dtype=float),
    target: wp.array2d(dtype=float),
):
    """Write given rows in place of some rows of an array."""
    row, column = wp.tid()
    target[rows[row], column] = given[row, column]
