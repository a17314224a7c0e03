r"""Decoupling of axes whose cables pass joints in common.

    law = axes_controller("decoupled_pi", drives, prefixes)

A cable that passes two joints turns both. The torques of the joints are
\(\tau = R\,u\), with what the motors give \(u\) (without friction, [N m]) and the
matrix \(R\) of torque ratios in the pose of the moment. Controllers of one axis each
then meet a torque that is not theirs. Here each of them gets the torque of its own
cable, \(R_{ii}\,u_i\), measured with \(u = R^{-1}\tau\) and desired with

\[ \min_u \sum_j \bigl((R u - \tau^*)_j / s_j\bigr)^2, \qquad u_i \ge l_i \]

where \(s_j\) is the torque error of the joint that counts as 1. A cable only pulls, so
its \(l_i\) is 0 or, where cables can pull against each other without any torque at a
joint (n + 1 or 2 n cables at n joints), its pretension. A loop with an integral has no
error at rest whatever the error of R is: both torques pass through the same matrix. R
knows no friction: a cable that rubs between two joints pulls them unequally.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.device._drive import Drive
from cc_mujoco.device._sensors import RATIO_COLUMN, WINDING_COLUMNS
from cc_mujoco.errors import CableError

Array = NDArray[np.float64]

LEAST_SHARE = 1e-6
"""Weight of torques of the motors in the distribution, over that of the errors."""
WORST_CONDITION = 100.0
"""Largest condition number of the ratios, each motor scaled to 1, that is inverted."""
SINGULAR_SHARE = 1e-10
"""Weight of the torques of the motors in the inverse of the ratios."""
RELEASE_SHARE = 0.5
"""Share of the way from the desired to the safe torque of a joint beyond which the
cables that add to it let go, as in `_guard`."""
PIVOTS = 200
"""Most steps of the distribution; a few are usual, and it is finite."""


def distribute(ratios: Array, torques: Array, scales: Array, least: Array) -> Array:
    """Return the torques of the motors that come closest to torques of the joints.

    Murty's principal pivoting solves the optimality conditions of the least-squares
    problem exactly (K. G. Murty, "Note on a Bard-type scheme for solving the
    complementarity problem", Opsearch 11, 1974).

    Args:
        ratios: Torque at every joint per torque of every motor, (n, joints, axes) [-].
        torques: Desired at the joints, (n, joints) [N m].
        scales: Torque error of each joint that counts as 1, (joints,) [N m].
        least: Least torque of each motor, (axes,) [N m]; -inf for none.

    Returns:
        (n, axes) [N m].
    """
    bounded = np.isfinite(least)
    lowest = np.where(bounded, least, 0.0)
    left = torques - (ratios * lowest).sum(axis=-1)
    weighted = ratios / scales[:, None]
    unit = np.sqrt((weighted * weighted).sum(axis=-2))
    unit = np.where(unit > 0.0, unit, 1.0)
    columns = weighted / unit[:, None, :]
    count = len(least)
    normal = (columns[:, :, :, None] * columns[:, :, None, :]).sum(axis=1)
    normal = normal + LEAST_SHARE * np.eye(count)
    wanted = (columns * (left / scales)[:, :, None]).sum(axis=1)
    edge = 1e-12 * np.abs(wanted).max(axis=-1, keepdims=True)
    used = np.ones(wanted.shape, dtype=np.bool_)
    found = wanted
    for _ in range(PIVOTS):
        both = used[:, :, None] & used[:, None, :]
        system = np.where(both, normal, np.eye(count))
        found = np.linalg.solve(system, np.where(used, wanted, 0.0)[..., None])[..., 0]
        slope = (normal * found[:, None, :]).sum(axis=-1) - wanted
        wrong = np.where(used, (found < -edge) & bounded, slope < -edge)
        rows = wrong.any(axis=-1)
        if not rows.any():
            break
        last = count - 1 - np.argmax(wrong[rows, ::-1], axis=-1)
        used[np.flatnonzero(rows), last] ^= True
    return np.asarray(lowest + np.where(used, found, 0.0) / unit)


def internal(ratios: Array, bounded: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which cables can pull without any torque at a joint (axes,).

    They are the support of the torques u > 0 with R u = 0 (of pull-pull axes any u).

    Args:
        ratios: Torque at every joint per torque of every motor, (joints, axes) [-].
        bounded: Axes whose cables only pull.
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
    """Torque ratios of a device, and what follows from them for each axis."""

    def __init__(self, drives: Sequence[Drive], prefixes: Sequence[str]) -> None:
        """Take what the axes have in common.

        Raises:
            CableError: The torques of two axes cannot be told apart at their joints.
        """
        self._drives, self._prefixes = tuple(drives), tuple(prefixes)
        names = [
            drive.joint or prefix
            for drive, prefix in zip(drives, prefixes, strict=True)
        ]
        self._joints = list(dict.fromkeys(names))
        self._own = [self._joints.index(name) for name in names]
        self._rival = np.array(
            [
                [i != k and names[i] == names[k] for k in range(len(names))]
                for i in range(len(names))
            ]
        )
        neutral = np.zeros((len(self._joints), len(drives)))
        for axis, drive in enumerate(drives):
            neutral[self._own[axis], axis] = drive.ratio
            for joint, ratio in drive.shared_ratios.items():
                neutral[self._joints.index(joint), axis] = ratio
        mixing = self._mixing(neutral[None])[0]
        scaled = mixing / np.abs(neutral).max(axis=0)
        if not np.linalg.cond(scaled) < WORST_CONDITION:
            raise CableError(
                f"the cables of {', '.join(p.rstrip('.') for p in prefixes)} turn "
                "their joints in nearly the same proportions, so torques at the joints "
                "do not tell which cable pulls; decouple none of them."
            )
        noise = np.array([drive.torque_noise for drive in drives])
        own = np.array([drive.ratio for drive in drives])
        self.noise = np.abs(own) * np.sqrt(np.linalg.inv(mixing) ** 2 @ noise**2)
        """Noise of the torque of each cable at its own joint (axes,) [N m]."""
        one_way = np.array([drive.one_way for drive in drives])
        pretension = np.array([_pretension(drive) for drive in drives])
        pulled = internal(neutral, one_way)
        self._least = np.where(one_way, np.where(pulled, pretension, 0.0), -math.inf)
        self._most = np.array([drive.high for drive in drives])
        self._safe = np.full(len(self._joints), math.inf)
        scales = np.full(len(self._joints), math.inf)
        for place, drive in zip(self._own, drives, strict=True):
            self._safe[place] = min(self._safe[place], drive.safe_torque)
            scales[place] = min(scales[place], _scale(drive))
        self._scales = scales

    def ratios(self, seen: Sequence[Mapping[str, Any]], count: int) -> Array:
        """Return the torque ratios of the moment, (n, joints, axes).

        Args:
            seen: Measurements of every axis under plain names.
            count: Number of environments, n.

        Raises:
            CableError: A `device.RATIO_COLUMN` is missing.
        """
        found = np.zeros((count, len(self._joints), len(self._drives)))
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
                found[:, self._joints.index(joint), place] = own[name]
        return found

    def _mixing(self, ratios: Array) -> Array:
        """Return the measured torque per motor torque, (n, axes, axes).

        At a joint of two motors each measures the torque of its own cables.
        """
        return np.where(self._rival, 0.0, ratios[:, self._own, :])

    def own_torques(
        self, ratios: Array, measured: Array, desired: Array
    ) -> tuple[Array, Array]:
        """Return measured and desired torque of each cable at its own joint (n, axes).

        Args:
            ratios: Of the moment, (n, joints, axes).
            measured: Torques at the joint of every axis (n, axes) [N m].
            desired: Desired there (n, axes) [N m]; at a joint of several motors the
                desired torques of its axes add up.
        """
        own = ratios[:, self._own, np.arange(len(self._own))]
        given = _solve(self._mixing(ratios), measured)
        wanted = np.zeros((len(ratios), len(self._joints)))
        total = np.zeros_like(wanted)
        for axis, joint in enumerate(self._own):
            wanted[:, joint] += desired[:, axis]
            total[:, joint] += measured[:, axis]
        torque = np.minimum(
            distribute(ratios, wanted, self._scales, self._least), self._most
        )
        # What the joint feels in all is guarded here; each law guards its own cable.
        aim = np.clip(wanted * np.sign(total), 0.0, self._safe)
        unsafe = np.abs(total) > aim + RELEASE_SHARE * (self._safe - aim)
        pushing = ratios * np.sign(total)[..., None] > 0.0
        released = (unsafe[..., None] & pushing).any(axis=1)
        return own * given, own * np.where(released, 0.0, torque)


def _solve(matrix: Array, right: Array) -> Array:
    """Return x with matrix x = right (n, k), a small one where that is singular."""
    unit = np.abs(matrix).max(axis=1)
    unit = np.where(unit > 0.0, unit, 1.0)
    scaled = matrix / unit[:, None, :]
    normal = (scaled[:, :, :, None] * scaled[:, :, None, :]).sum(axis=1)
    normal = normal + SINGULAR_SHARE * np.eye(matrix.shape[-1])
    found = np.linalg.solve(normal, (scaled * right[..., None]).sum(axis=1)[..., None])
    return np.asarray(found[..., 0] / unit)


def _pretension(drive: Drive) -> float:
    """Return the torque of a motor that holds the pretension of its cable [N m]."""
    if not drive.cables:
        return 0.0
    first = drive.cables[0]
    return abs(first.proximal) * first.cable.pretension


def _scale(drive: Drive) -> float:
    """Return the torque error of an axis that counts as 1 [N m]."""
    if drive.observed is not None:
        return drive.observed.units[4]
    return max(map(abs, drive.reach))
