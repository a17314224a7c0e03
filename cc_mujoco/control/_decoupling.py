r"""Decoupling of axes whose cables pass joints in common.

    law = axes_controller("decoupled_pi", drives, prefixes)

A cable that passes two joints turns both. The torques of the joints are \(\tau =
R\,u\), with the torques of the motors \(u\) (without friction, [N m]) and the matrix
\(R\) of torque ratios in the present pose. So the torque at a joint is not only that of
the axis whose controller reads it. Here each controller gets the torque of its own
cable, \(R_{ii}\,u_i\), measured with \(u = R^{-1}\tau\) and desired with

\[ \min_u \sum_j \bigl((R u - \tau^*)_j / s_j\bigr)^2, \qquad u_i \ge l_i \]

where \(s_j\) is the torque error of the joint that counts as 1. A cable only pulls, so
its \(l_i\) is 0 or, if cables can pull against each other without any torque at a joint
(n + 1 or 2 n cables at n joints), its pretension. A loop with an integral has no error
at rest whatever the error of R is: both torques pass through the same matrix. R has no
friction: a cable that rubs between two joints pulls them unequally.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.cable._stepper import Counts
from cc_mujoco.control._cholesky import solve_active
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._sensors import RATIO_COLUMN, WINDING_COLUMNS
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal
from cc_mujoco.native import FloatArray as Array


class CouplingTables(NamedTuple):
    """Constants of a coupling; a device has `joints` joints and `axes` motors."""

    own: Counts  # place of the joint of each axis among the joints (axes,)
    least: FloatArray  # least torque of each motor (axes,) [N m]; -inf for none
    most: FloatArray  # greatest torque of each motor (axes,) [N m]
    safe: FloatArray  # safe torque of each joint (joints,) [N m]; inf for none
    scales: FloatArray  # torque error of a joint that counts as 1 (joints,) [N m]


WORK_MATRICES, WORK_VECTORS = 3, 7  # in the scratch of `Coupled`


class Coupled(NamedTuple):
    """A device in a pose, and scratch; there are at most as many joints as axes."""

    tables: CouplingTables
    ratios: FloatMatrix  # joint torque per motor torque (joints, axes) [-]
    normal: FloatMatrix  # scratch (axes, axes): normal equations of least squares
    factor: FloatMatrix
    columns: FloatMatrix  # matrix of the least squares
    unit: FloatArray  # scratch (axes,): scales of its columns
    wanted: FloatArray  # right side of the normal equations
    used: FloatArray  # 1 where an unknown is active, else 0
    left: FloatArray  # scaled joint torques beyond those of the least motor torques
    motor: FloatArray  # motor torques
    aim: FloatArray  # desired torque of each joint
    total: FloatArray  # measured torque of each joint


@internal
def _least_squares(rows: int, right: FloatArray, weight: float, work: Coupled) -> None:
    """Set `normal` and `wanted` of `work` to normal equations of least squares.

    The matrix is the first `rows` of its `columns`, which are scaled to unit norm
    first, and `weight` is that of the squared unknowns. All unknowns become active.
    """
    columns, normal, unit, count = work.columns, work.normal, work.unit, work.unit.size
    for i in range(count):
        total = 0.0
        for row in range(rows):
            total += columns[row, i] * columns[row, i]
        unit[i] = math.sqrt(total) if total > 0.0 else 1.0
        for row in range(rows):
            columns[row, i] /= unit[i]
        work.used[i] = 1.0
    for i in range(count):
        for j in range(i + 1):
            total = 0.0
            for row in range(rows):
                total += columns[row, i] * columns[row, j]
            normal[i, j] = normal[j, i] = total
        normal[i, i] += weight
        work.wanted[i] = 0.0
        for row in range(rows):
            work.wanted[i] += columns[row, i] * right[row]


@internal
def _motor_torques(work: Coupled, measured: FloatArray, found: FloatArray) -> None:
    """Compute the motor torques `found` behind joint torques `measured` (axes,) [N m].

    Torques that these do not determine are small. At a joint of two motors, each axis
    measures only the torque of its own cables.
    """
    own, count = work.tables.own, work.tables.own.size
    for i in range(count):
        for k in range(count):
            rival = i != k and own[i] == own[k]
            work.columns[i, k] = 0.0 if rival else work.ratios[own[i], k]
    # Weight of the motor torques in the inverse of the ratios.
    _least_squares(count, measured, 1e-10, work)
    found[:] = work.wanted
    solve_active(work.normal, work.used, work.factor, found)
    for i in range(count):
        found[i] /= work.unit[i]


@compiled
def distribute(work: Coupled, torques: FloatArray, found: FloatArray) -> None:
    """Compute the motor torques `found` (axes,) closest to torques (joints,) [N m].

    Murty's principal pivoting solves the optimality conditions of the least-squares
    problem exactly (K. G. Murty, "Note on a Bard-type scheme for solving the
    complementarity problem", Opsearch 11, 1974).
    """
    ratios, scales, least = work.ratios, work.tables.scales, work.tables.least
    joints, count = ratios.shape[0], ratios.shape[1]
    wanted, used, left = work.wanted, work.used, work.left
    for joint in range(joints):
        left[joint] = torques[joint]
        for i in range(count):
            if least[i] > -math.inf:
                left[joint] -= ratios[joint, i] * least[i]
            work.columns[joint, i] = ratios[joint, i] / scales[joint]
        left[joint] /= scales[joint]
    # Weight of the motor torques in the distribution, over that of the errors.
    _least_squares(joints, left, 1e-6, work)
    edge = 0.0
    for i in range(count):
        edge = max(edge, 1e-12 * abs(wanted[i]))
    for _ in range(200):  # a few steps are usual, and their number is finite
        found[:] = wanted
        solve_active(work.normal, used, work.factor, found)
        wrong = -1
        for i in range(count):
            if used[i] != 0.0:
                if found[i] < -edge and least[i] > -math.inf:
                    wrong = i
                continue
            slope = -wanted[i]
            for k in range(count):
                slope += work.normal[i, k] * found[k]
            if slope < -edge:
                wrong = i
        if wrong < 0:
            break
        used[wrong] = 1.0 - used[wrong]
    for i in range(count):
        lowest = least[i] if least[i] > -math.inf else 0.0
        found[i] = lowest + found[i] / work.unit[i]


@compiled
def own_torques(
    work: Coupled,
    measured: FloatArray,
    desired: FloatArray,
    given: FloatArray,
    wanted: FloatArray,
) -> None:
    """Compute the measured and the desired torque of each cable at its own joint.

    They are written to `given` and `wanted`. All torques are (axes,) [N m]; at a joint
    of several motors the desired torques of its axes add up.
    """
    tables, ratios = work.tables, work.ratios
    joints, count = ratios.shape[0], ratios.shape[1]
    motor, aim, total = work.motor, work.aim, work.total
    _motor_torques(work, measured, given)
    aim[:] = 0.0
    total[:] = 0.0
    for i in range(count):
        aim[tables.own[i]] += desired[i]
        total[tables.own[i]] += measured[i]
    distribute(work, aim, motor)
    # The total torque of the joint is guarded here; each law guards its own cable.
    for i in range(count):
        torque = min(motor[i], tables.most[i])
        for joint in range(joints):
            sensed, safe = total[joint], tables.safe[joint]
            if safe == math.inf:
                continue
            along = min(max(aim[joint] * np.sign(sensed), 0.0), safe)
            # Half-way from the desired to the safe torque of a joint, the cables that
            # add to it are released, as in `_guard`.
            unsafe = abs(sensed) > along + 0.5 * (safe - along)
            if unsafe and ratios[joint, i] * np.sign(sensed) > 0.0:
                torque = 0.0
        own = ratios[tables.own[i], i]
        given[i], wanted[i] = own * given[i], own * torque


def antagonists(ratios: Array, bounded: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which cables can pull without any torque at a joint, as a mask (axes,).

    They are the nonzero torques of solutions u >= 0 of R u = 0; u of an axis that is
    not `bounded`, as its cables pull both ways, may have any sign.
    """
    from scipy.optimize import linprog

    joints, axes = ratios.shape
    # Maximise the sum of s with s <= u and s <= 1: 1 wherever u can be above 0.
    cost = np.concatenate([np.zeros(axes), -np.ones(axes)])
    bounds = [(0.0, None) if b else (None, None) for b in bounded] + [(0.0, 1.0)] * axes
    solved = linprog(
        cost,
        A_ub=np.hstack([-np.eye(axes), np.eye(axes)]),
        b_ub=np.zeros(axes),
        A_eq=np.hstack([ratios, np.zeros((joints, axes))]),
        b_eq=np.zeros(joints),
        bounds=bounds,
    )
    return np.asarray(solved.x[axes:] > 0.5) & bounded


class Coupling:
    """Torque ratios of a device, and the bounds and noise of each axis."""

    def __init__(self, drives: Sequence[Drive], prefixes: Sequence[str]) -> None:
        """Prepare; refuse axes whose shares the joint torques cannot distinguish."""
        self._drives, self._prefixes = tuple(drives), tuple(prefixes)
        names = [one.joint or p for one, p in zip(drives, prefixes, strict=True)]
        self.joints = list(dict.fromkeys(names))
        """Joints whose torques are desired, in the order of the axes."""
        self._own = [self.joints.index(name) for name in names]
        neutral = np.zeros((len(self.joints), len(drives)))
        for axis, drive in enumerate(drives):
            neutral[self._own[axis], axis] = drive.ratio
            for joint, ratio in drive.shared_ratios.items():
                neutral[self.joints.index(joint), axis] = ratio
        rival = np.equal.outer(self._own, self._own) & ~np.eye(len(names), dtype=bool)
        mixing = np.where(rival, 0.0, neutral[self._own])
        # Ratios, each motor scaled to 1, are inverted up to this condition number.
        if not np.linalg.cond(mixing / np.abs(neutral).max(axis=0)) < 100.0:
            raise CableError(
                f"the cables of {', '.join(p.rstrip('.') for p in prefixes)} turn "
                "their joints in nearly the same proportions, so torques at the joints "
                "do not tell which cable pulls; decouple none of them."
            )
        noise, own, one_way, high = (
            np.array([getattr(drive, name) for drive in drives])
            for name in ("torque_noise", "ratio", "one_way", "high")
        )
        self.noise = np.abs(own) * np.sqrt(np.linalg.inv(mixing) ** 2 @ noise**2)
        """Noise of the torque of each cable at its own joint (axes,) [N m]."""
        # Torques of motors that hold the pretension of their cables [N m].
        ends = [drive.cables[:1] for drive in drives]
        held = [sum(abs(c.proximal) * c.cable.pretension for c in end) for end in ends]
        pulled = antagonists(neutral, one_way)
        safe, scales = np.full((2, len(self.joints)), math.inf)
        for place, drive in zip(self._own, drives, strict=True):
            safe[place] = min(safe[place], drive.safe_torque)
            seen = drive.observed
            scale = max(map(abs, drive.reach)) if seen is None else seen.units[4]
            scales[place] = min(scales[place], scale)
        least = np.where(one_way, np.where(pulled, held, 0.0), -math.inf)
        own_joints, most = np.array(self._own), high.astype(float)
        self.tables = CouplingTables(own_joints, least, most, safe, scales)

    def ratios(self, seen: Sequence[Mapping[str, Any]], count: int) -> Array:
        """Return the present torque ratios, (n, joints, axes), of n environments.

        `seen` are the measurements of every axis under plain names.
        """
        found = np.zeros((count, len(self.joints), len(self._drives)))
        for place, (drive, own) in enumerate(zip(self._drives, seen, strict=True)):
            leverage = own.get(WINDING_COLUMNS[2], 1.0)
            found[:, self._own[place], place] = drive.ratio * np.asarray(leverage)
            for joint in drive.shared_ratios:
                name = RATIO_COLUMN.format(joint=joint)
                if name not in own:
                    raise CableError(
                        f"joint {joint} feels the cables of axis "
                        f"{self._prefixes[place].rstrip('.')}, too; a controller that "
                        f"decouples them needs to read {self._prefixes[place]}{name}."
                    )
                found[:, self.joints.index(joint), place] = own[name]
        return found

    def own_torques(
        self, ratios: Array, measured: Array, desired: Array
    ) -> tuple[Array, Array]:
        """Return `own_torques` of n environments; all torques are (n, axes) [N m]."""
        given, wanted = np.empty((2, *measured.shape))
        for one, *torques in zip(ratios, measured, desired, given, wanted, strict=True):
            own_torques(coupled(self.tables, one), *torques)
        return given, wanted


def coupled(tables: CouplingTables, ratios: Array) -> Coupled:
    """Return a device at these torque ratios (joints, axes), with its own scratch."""
    axes = tables.own.size
    matrices = np.empty((WORK_MATRICES, axes, axes))
    return Coupled(tables, ratios, *matrices, *np.empty((WORK_VECTORS, axes)))
