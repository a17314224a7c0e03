"""Kernels that predict stiff ends over a step, see `plugin/_implicit_ends.py`."""

# Warp reads the annotations of its kernels, so they are not postponed here.

from functools import lru_cache
from typing import Any

import warp as wp

from cc_mujoco.cable import _layout as at
from cc_mujoco.cable._newmark import NEWMARK
from cc_mujoco.warp._build import GUIDED, Paths, functions
from cc_mujoco.warp._kernels import OPTIONS, CableRows, Moments


@wp.func
def _along(
    moments: Moments, world: int, actuator: int, lever: float,
    vector: wp.array2d(dtype=float),
):  # fmt: skip
    """Return an end's moment times `lever`, multiplied by a vector (worlds, nv)."""
    total = float(0.0)
    for i in range(moments.moment_rownnz[world, actuator]):
        k = moments.moment_rowadr[world, actuator] + i
        column = moments.moment_colind[world, k]
        total += lever * moments.actuator_moment[world, k] * vector[world, column]
    return total


@wp.func
def _add_moment(
    moments: Moments, world: int, actuator: int, force: float,
    total: wp.array2d(dtype=float),
):  # fmt: skip
    """Add the generalised force of an actuator's `force` to `total` (worlds, nv)."""
    for i in range(moments.moment_rownnz[world, actuator]):
        k = moments.moment_rowadr[world, actuator] + i
        column = moments.moment_colind[world, k]
        pushed = moments.actuator_moment[world, k] * force
        total[world, column] = total[world, column] + pushed


@lru_cache(maxsize=16)
def look_ahead_kernel(terms: frozenset[str], paths: Paths = GUIDED) -> Any:
    end_stiffness = functions(wp.float32, terms, True, paths).end_stiffness

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def look_ahead(
        rows: CableRows,
        timestep: wp.array(dtype=float),
        moments: Moments,
        answers: wp.array3d(dtype=float),
        found: wp.array2d(dtype=float),
        velocities: wp.array2d(dtype=float),
    ):
        """Extrapolate the displacement of the ends over the step, with a compliance.

        Columns 5 to 8 of `aim` become displacements [m], then changes by tension [m/N].
        """
        cable, world = wp.tid()
        if rows.looks[cable] == 0:
            return
        aim, worlds = rows.aim, rows.worlds
        row = cable * worlds + world
        h = timestep[world % timestep.shape[0]]
        for end in range(2):
            aim[row, 5 + end] = aim[row, end]
            aim[row, 7 + end] = 0.0
            if rows.tied[cable, end] != 0:
                continue
            mobility = float(0.0)
            for other in range(2 * rows.segments.shape[0]):
                if rows.tied[other // 2, other % 2] != 0:
                    continue
                a = rows.actuators[other // 2, other % 2]
                moved = _along(moments, world, a, 1.0, answers[2 * cable + end])
                if other % 2 == 0:
                    moved *= aim[(other // 2) * worlds + world, 4]
                mobility += wp.abs(moved)
            actuator = rows.actuators[cable, end]
            lever = float(1.0)
            if end == 0:
                lever = aim[row, 4]
            ahead = _along(moments, world, actuator, lever, found)
            stiffness = end_stiffness(rows.prm[row], rows.segments[cable], end == 1)
            square = h * h * mobility * stiffness
            share, stable = float(0.0), wp.static(NEWMARK.stability_limit)
            if square > stable:
                share = 1.0 - stable / square
            beta = share * h * h / stable
            speed = lever * velocities[world, actuator]
            aim[row, 5 + end] = aim[row, end] + h * speed + h * h * ahead
            aim[row, 7 + end] = h * h * mobility
            gain = wp.static(NEWMARK.velocity_gain) * share * share * h
            aim[row, end] += gain * speed + beta * ahead
            aim[row, 2 + end] = beta * mobility

    return look_ahead


@wp.kernel(module="unique", enable_backward=False)
def moment_row(
    rows: CableRows,
    cable: int,
    end: int,
    moments: Moments,
    right: wp.array2d(dtype=float),
):
    """Write the generalised force of a unit tension at one end (worlds, nv)."""
    world = wp.tid()
    for i in range(right.shape[1]):
        right[world, i] = 0.0
    actuator = rows.actuators[cable, end]
    lever = float(1.0)
    if end == 0:
        lever = rows.aim[cable * rows.worlds + world, 4]
    _add_moment(moments, world, actuator, lever, right)


@wp.kernel(module="unique", enable_backward=False)
def add_forces(
    rows: CableRows,
    ends: wp.array(dtype=int),
    moments: Moments,
    passive: wp.array2d(dtype=float),
    bias: wp.array2d(dtype=float),
    applied: wp.array2d(dtype=float),
    constraint: wp.array2d(dtype=float),
    force: wp.array2d(dtype=float),
    total: wp.array2d(dtype=float),
):
    """Sum the forces of the step, with tensions and constraints of the step before.

    `ends` is twice the cable, plus the end (0, 1), of each actuator; -1 for others, -2
    for an end that is tied to the cable's own path.
    """
    world = wp.tid()
    for i in range(total.shape[1]):
        total[world, i] = passive[world, i] - bias[world, i] + applied[world, i]
        if rows.fresh[world] == 0:
            total[world, i] = total[world, i] + constraint[world, i]
    for actuator in range(ends.shape[0]):
        pull = float(force[world, actuator])
        if ends[actuator] == -2:
            pull = 0.0
        if ends[actuator] >= 0:
            cable, end = ends[actuator] // 2, ends[actuator] % 2
            row = cable * rows.worlds + world
            place = at.STATE_HEADER + end * rows.segments[cable]
            pull = wp.max(rows.state[rows.now[row], row, place], 0.0)
            if end == 0:
                pull = pull * rows.aim[row, 4]
            else:
                pull = -pull
        _add_moment(moments, world, actuator, pull, total)
