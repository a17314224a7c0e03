"""Kernels that evaluate the cables of all worlds; one thread per cable and world.

Row `cable * worlds + world` of every array belongs to a cable of a world. The state is
kept twice: committed, of the step before, and pending, of the last evaluation.

A step has three parts, see `cable/_kernel.py`. On a GPU each is a kernel of its own:
together they would take more registers than a thread has, and most cables need only two
of them. A CPU calls the three in turn, so that all rows share scratch. The last kernels
predict implicit ends, see `plugin/_implicit_ends.py`.
"""

# Warp reads the annotations of its kernels, so they are not postponed here.

from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable._newmark import NEWMARK
from cc_mujoco.warp._build import GUIDED, Paths, functions

OPTIONS: Any = {"fuse_fp": False, "max_unroll": 1}
"""Options of all kernels: rounding as written, and loops that stay loops."""
_DONE = -1
"""Status of a cable whose forces are written."""
ATTEMPTS = 3
"""Most attempts at a step in which an end may become taut or slack."""
RESET = 2
"""Value of `fresh` in the evaluation that sets a cable to rest; 1 until it steps."""
FOLLOWED, TIED = 1, 2
"""Values of `followed`: end on a tendon, displaced by the integral of its velocity; end
tied to the cable's own path."""


@wp.struct
class Moments:
    """Moments of the actuators on the degrees of freedom, in mujoco_warp's layout."""

    moment_rownnz: wp.array2d(dtype=int)
    moment_rowadr: wp.array2d(dtype=int)
    moment_colind: wp.array2d(dtype=int)
    actuator_moment: wp.array2d(dtype=float)


@wp.struct
class CableRows:
    """Arrays that an evaluation reads and writes, a row for each cable and world."""

    worlds: int  # number of worlds
    rest_in_pose: bool  # True if a reset sets cables to rest in the pose of the world
    segments: wp.array(dtype=int)  # number of segments (cables,)
    looks: wp.array(dtype=int)  # not 0 for implicit ends (cables,)
    actuators: wp.array2d(dtype=int)  # actuators at the ends (cables, 2)
    tied: wp.array2d(dtype=int)  # not 0: end tied to the cable's path (cables, 2)
    # Displacement [m] and yielding [m/N] of both ends, lever; at the end of the step,
    # displacement [m] and change by tension [m/N] of both ends (rows, 9).
    aim: wp.array2d(dtype=float)
    # In this attempt, displacement and yielding of both ends; 1 for ends that may
    # become taut, -1 slack; 1 for those that do (rows, 8).
    trial: wp.array2d(dtype=float)
    status: wp.array(dtype=int)  # status of the attempt (rows,)
    now: wp.array(dtype=int)  # index of the committed one of two states (rows,)
    stamp: wp.array(dtype=float)  # time of the last evaluation (rows,) [s]
    fresh: wp.array(dtype=int)  # 0 once a cable has taken a step, see `RESET` (rows,)
    followed: wp.array2d(dtype=int)  # 0, `FOLLOWED` or `TIED` (cables, 2)
    rest: wp.array2d(dtype=float)  # lengths of the ends in `qpos0` (cables, 2) [m]
    place: wp.array3d(dtype=float)  # displacement of followed ends (2, rows, 2) [m]
    slope: wp.array3d(dtype=float)  # moments of followed ends (2, 2 rows, nv)
    prm: wp.array2d(dtype=float)  # packed parameters (rows, size)
    state: wp.array3d(dtype=float)  # committed and pending state (2, rows, size)
    work: wp.array2d(dtype=float)  # scratch
    tensions: wp.array3d(dtype=float)  # tension of the ends (worlds, cables, 2) [N]


@lru_cache(maxsize=16)
def kernels(
    terms: frozenset[str], implicit: bool, paths: Paths = GUIDED
) -> SimpleNamespace:
    own = functions(wp.float32, terms, implicit, paths)
    has_pulley = not terms.isdisjoint(["eccentricity", "ovality"])

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def begin(
        rows: CableRows, time: wp.array(dtype=float), timestep: wp.array(dtype=float),
        lengths: wp.array2d(dtype=float), qvel: wp.array2d(dtype=float),
        moments: Moments, gears: wp.array2d(dtype=wp.spatial_vector),
    ):  # fmt: skip
        """Commit or reset the state by the time of the world; find the ends' `aim`."""
        cable, world = wp.tid()
        fresh, stamp, rest, place = rows.fresh, rows.stamp, rows.rest, rows.place
        row = cable * time.shape[0] + world
        is_reset = time[world] < stamp[row]
        if is_reset:
            fresh[row] = RESET
        elif time[world] > stamp[row]:
            rows.now[row] = 1 - rows.now[row]
            fresh[row] = 0
        elif fresh[row] == RESET:
            fresh[row] = 1
        stamp[row] = time[world]
        for end in range(2):
            actuator = rows.actuators[cable, end]
            # Small numbers round less: displacements are from the pose `qpos0` on.
            u = lengths[world, actuator] - rest[cable, end]
            if rows.followed[cable, end] == TIED:
                u = 0.0
            if rows.followed[cable, end] == FOLLOWED:
                # By its velocity, at the mean slope of the length over the step.
                moved = float(0.0)
                line, slope = 2 * row + end, rows.slope
                for i in range(moments.moment_rownnz[world, actuator]):
                    k = moments.moment_rowadr[world, actuator] + i
                    column = moments.moment_colind[world, k]
                    moment = moments.actuator_moment[world, k]
                    mean = 0.5 * (moment + slope[rows.now[row], line, column])
                    moved += mean * qvel[world, column]
                    slope[1 - rows.now[row], line, column] = moment
                if fresh[row] == 0:
                    moved *= timestep[world % timestep.shape[0]]
                    moved += place[rows.now[row], row, end]
                    # Drift from the true length decays by this share per step.
                    u = moved + 0.01 * (u - moved)
                place[1 - rows.now[row], row, end] = u
            lever = float(1.0)
            if wp.static(has_pulley):
                if end == 0:
                    gear = gears[world % gears.shape[0], actuator][0]
                    p, start = rows.prm[row], rest[cable, 0]
                    lever = own.lever_ratio(p, u + start, gear)
                    u = own.wound_length(p, u + start, gear)
                    u -= own.wound_length(p, start, gear)
            rows.aim[row, end] = u
            if end == 0:
                rows.aim[row, 4] = lever
            rows.aim[row, 2 + end] = 0.0
        if is_reset:
            first, second = float(0.0), float(0.0)
            if rows.rest_in_pose:
                first, second = float(rows.aim[row, 0]), float(rows.aim[row, 1])
            own.initialize(
                rows.prm[row], rows.segments[cable], first, second,
                rows.state[rows.now[row], row],
            )  # fmt: skip

    @wp.func
    def step_of(rows: CableRows, row: int, h: float):
        return own.step_of(
            rows.state[rows.now[row], row], rows.state[1 - rows.now[row], row],
            rows.work[row % rows.work.shape[0]], h, rows.trial[row, 0],
            rows.trial[row, 1],
        )  # fmt: skip

    @wp.func
    def try_fronts(rows: CableRows, row: int, n: int, h: float, attempt: int):
        if attempt == 0:
            for i in range(4):
                rows.trial[row, i] = rows.aim[row, i]
                rows.trial[row, 4 + i] = 0.0
        if wp.static(implicit):
            own.expect_yielding(rows.prm[row], rows.trial[row, 2], rows.trial[row, 3])
        step = step_of(rows, row, h)
        rows.status[row] = own.begin_step(rows.prm[row], n, 0, 0, step)

    @wp.func
    def solve_rest(rows: CableRows, row: int, n: int, h: float):
        if rows.status[row] == kernel.UNSOLVED:
            own.solve_step(rows.prm[row], n, 0, 0, step_of(rows, row, h))

    @wp.func
    def needs_another(rows: CableRows, row: int, n: int, attempt: int):
        """Prepare another attempt at the step; return whether one is needed."""
        if attempt == ATTEMPTS - 1:
            return False
        now, doubtful, passing = rows.now[row], bool(False), bool(False)
        for end in range(2):
            doubt = float(rows.trial[row, 4 + end])
            passes = float(0.0)
            before = rows.state[now, row, at.STATE_HEADER + end * n]
            after = rows.state[1 - now, row, at.STATE_HEADER + end * n]
            if attempt == 0:
                sense = 1.0 - 2.0 * float(end)
                gained = wp.max(after, 0.0) - wp.max(before, 0.0)
                ahead = rows.aim[row, 5 + end]
                ahead += sense * rows.aim[row, 7 + end] * gained
                rows.trial[row, end] = ahead
                relaxes = sense * (ahead - rows.state[1 - now, row, end])
                if rows.tied[row // rows.worlds, end] != 0:
                    doubt = 0.0
                elif after <= 0.0:
                    if before <= 0.0 and relaxes < 0.0:
                        doubt = 1.0
                elif before <= 0.0:
                    passes = 1.0
                elif relaxes * own.node_stiffness(rows.prm[row], n)[end * n] > after:
                    doubt = -1.0
                rows.trial[row, 4 + end] = doubt
            elif doubt == 0.0:
                passes = rows.trial[row, 6 + end]
            elif (after > 0.0) == (doubt > 0.0):
                passes = 1.0
            rows.trial[row, 6 + end] = passes
            doubtful = doubtful or doubt != 0.0
            passing = passing or passes != 0.0
        if attempt == 0 and doubtful:
            for end in range(2):
                rows.trial[row, 2 + end] = 0.0
            return True
        if attempt == 1 and not doubtful:
            return False
        for end in range(2):
            rows.trial[row, end] = rows.aim[row, end]
            rows.trial[row, 2 + end] = rows.aim[row, 2 + end]
            if rows.trial[row, 6 + end] != 0.0:
                rows.trial[row, end] = rows.aim[row, 5 + end]
                rows.trial[row, 2 + end] = rows.aim[row, 7 + end]
        return passing or attempt == 1

    @wp.func
    def finish(
        rows: CableRows, force: wp.array2d(dtype=float), cable: int, world: int,
        h: float, attempt: int,
    ):  # fmt: skip
        """Finish the step; write its forces unless there is another attempt."""
        row, n = cable * rows.worlds + world, rows.segments[cable]
        now, status = rows.now[row], rows.status[row]
        if status != kernel.OK and status != kernel.NOT_FINITE:
            own.finish_step(rows.prm[row], n, 0, 0, step_of(rows, row, h))
        if wp.static(implicit):
            if status != kernel.NOT_FINITE and rows.looks[cable] != 0:
                if needs_another(rows, row, n, attempt):
                    return
        for end in range(2):
            tension = wp.max(rows.state[1 - now, row, at.STATE_HEADER + end * n], 0.0)
            if status == kernel.NOT_FINITE:
                tension = wp.nan
            rows.tensions[world, cable, end] = tension
            pull = -tension
            if end == 0:
                pull = tension * rows.aim[row, 4]
            force[world, rows.actuators[cable, end]] = pull
        rows.status[row] = _DONE

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def fronts(rows: CableRows, timestep: wp.array(dtype=float), attempt: int):
        cable, world = wp.tid()
        row = cable * rows.worlds + world
        if attempt == 0 or rows.status[row] != _DONE:
            h = timestep[world % timestep.shape[0]]
            try_fronts(rows, row, rows.segments[cable], h, attempt)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def graph(rows: CableRows, timestep: wp.array(dtype=float)):
        cable, world = wp.tid()
        row = cable * rows.worlds + world
        solve_rest(rows, row, rows.segments[cable], timestep[world % timestep.shape[0]])

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def commit(
        rows: CableRows,
        timestep: wp.array(dtype=float),
        attempt: int,
        force: wp.array2d(dtype=float),
    ):
        cable, world = wp.tid()
        if rows.status[cable * rows.worlds + world] != _DONE:
            h = timestep[world % timestep.shape[0]]
            finish(rows, force, cable, world, h, attempt)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def evaluate(
        rows: CableRows, timestep: wp.array(dtype=float), force: wp.array2d(dtype=float)
    ):
        cable, world = wp.tid()
        row, n = cable * rows.worlds + world, rows.segments[cable]
        h = timestep[world % timestep.shape[0]]
        for attempt in range(wp.static(ATTEMPTS if implicit else 1)):
            if attempt == 0 or rows.status[row] != _DONE:
                try_fronts(rows, row, n, h, attempt)
                solve_rest(rows, row, n, h)
                finish(rows, force, cable, world, h, attempt)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def repack(
        segments: wp.array(dtype=int),
        values: wp.array3d(dtype=float),
        prm: wp.array2d(dtype=float),
    ):
        cable, world = wp.tid()
        row = cable * values.shape[1] + world
        own.pack_mesh(values[cable, world], segments[cable], prm[row])

    return SimpleNamespace(
        begin=begin, fronts=fronts, graph=graph, commit=commit, evaluate=evaluate,
        repack=repack,
    )  # fmt: skip


@wp.kernel(module="unique", enable_backward=False)
def forget(mask: wp.array(dtype=bool), stamp: wp.array(dtype=float)):
    """Let the next evaluation set the cables of worlds in `mask` to rest."""
    cable, world = wp.tid()
    if mask[world]:
        stamp[cable * mask.shape[0] + world] = wp.inf


def write_rows(target: Any, rows: Any, given: Any) -> None:
    """Write rows (m,) of a `wp.array` (n, k); the others keep their bits."""
    if given.size:
        device = target.device
        places = wp.array(rows, dtype=int, device=device)
        values = wp.array(given, dtype=float, device=device)
        wp.launch(_write, given.shape, [places, values, target], device=device)


@wp.kernel(module="unique", enable_backward=False)
def _write(
    rows: wp.array(dtype=int),
    given: wp.array2d(dtype=float),
    target: wp.array2d(dtype=float),
):
    row, column = wp.tid()
    target[rows[row], column] = given[row, column]


@wp.func
def _along(
    moments: Moments, world: int, actuator: int, lever: float,
    vector: wp.array2d(dtype=float),
):  # fmt: skip
    """Return the product of an actuator's moment, times `lever`, with a vector."""
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
        rows: CableRows, timestep: wp.array(dtype=float), moments: Moments,
        answers: wp.array3d(dtype=float), found: wp.array2d(dtype=float),
        velocities: wp.array2d(dtype=float),
    ):  # fmt: skip
        """Predict the motion of implicit ends in the step, and complete `aim`.

        `answers` (ends, worlds, nv) are the accelerations by a unit tension at each
        end, `found` (worlds, nv) those with unchanged tensions.
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
    rows: CableRows, cable: int, end: int, moments: Moments,
    right: wp.array2d(dtype=float),
):  # fmt: skip
    """Write the generalised force of a unit tension at one end to `right`."""
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
    rows: CableRows, ends: wp.array(dtype=int), moments: Moments,
    passive: wp.array2d(dtype=float), bias: wp.array2d(dtype=float),
    applied: wp.array2d(dtype=float), constraint: wp.array2d(dtype=float),
    force: wp.array2d(dtype=float), total: wp.array2d(dtype=float),
):  # fmt: skip
    """Sum the forces of the step, with tensions and constraints of the step before.

    `ends` has for each actuator twice its cable plus its end (0, 1), -1 if it holds no
    cable, -2 if it is tied to the cable's own path.
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
