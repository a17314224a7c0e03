"""The path of a tendon in many poses: turns, contacts, lengths of its pieces, compiled.

`sweep` makes the poses: every joint that moves the tendon over its range by itself, all
of them together from one end of their ranges to the other, and random ones. The same
model gives the same poses each time.
"""

import math

import mujoco
import numpy as np

from cc_mujoco.cable import _open_path as open_path
from cc_mujoco.cable._route import ancestors
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal
from cc_mujoco.plugin import _attachments as attachments
from cc_mujoco.plugin import _config as config
from cc_mujoco.plugin import _ffi as ffi
from cc_mujoco.plugin import _path as path
from cc_mujoco.plugin import _stability_limits as stability_limits
from cc_mujoco.plugin._ffi import MjData, MjModel
from cc_mujoco.plugin._path import OpenPath
from cc_mujoco.plugin._warnings import RANDOM_POSES

SWEEP_POSES = 21
"""Number of poses from end to end of one joint's range, or of all joints together."""


def survey(
    model: mujoco.MjModel, data: mujoco.MjData, tendon: int, poses: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Measure the path of a spatial tendon without pulleys in some poses (k, nq).

    The `qpos` of `data` is left at the last pose.

    Returns:
        For the p places between its ends the turning angles (k, p) [rad] and lengths of
        contact with geoms (k, p) [m], 0 at sites; then the lengths of the pieces from
        place to place (k, p + 1) [m], each with half of the arcs beside it.
    """
    places = int(model.tendon_num[tendon]) - 2
    turn, contact = np.zeros((2, len(poses), places))
    length = np.zeros((len(poses), places + 1))
    _measure(model._address, data._address, tendon, poses, turn, contact, length)
    return turn, contact, length


@compiled
def _measure(
    model: MjModel, data: MjData, tendon: int, poses: FloatMatrix, turn: FloatMatrix,
    contact: FloatMatrix, length: FloatMatrix,
) -> None:  # fmt: skip
    n = path.min_segments(model, tendon, 0)
    ffi.mark_stack(data)
    led = _borrow_path(data, tendon, n)
    for row in range(poses.shape[0]):
        data.qpos[: poses.shape[1]] = poses[row]
        ffi.evaluate_bodies(model, data)
        ffi.evaluate_tendons(model, data)
        path.measure_path(model, data, led)
        turn[row, :] = open_path.angles(led.measured, n)
        contact[row, :] = open_path.contacts(led.measured, n)
        length[row, :] = open_path.lengths(led.measured, n)
    ffi.free_stack(data)


@internal
def _borrow_path(data: MjData, tendon: int, n: int) -> OpenPath:
    """Return an open path of n segments on MuJoCo's stack, without guides."""
    guides = ffi.borrow_floats(data, n)
    shape = ffi.borrow_floats(data, open_path.shape_size(n))
    guides[:] = 0.0
    shape[:] = 0.0
    return OpenPath(tendon, 0, 0, n, guides, shape)


def piece_timesteps(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    tendon: int,
    axial_stiffness: float,
    poses: FloatArray,
) -> FloatArray:
    """Return time steps below which the pieces of a tendon would be stable (k,) [s].

    They hold for one cable of `axial_stiffness` EA [N] on an open path along the
    tendon, with the default number of segments and no other cables. The `qpos` of
    `data` is left at the last of the `poses` (k, nq).
    """
    found = np.full(len(poses), math.inf)
    for i, pose in enumerate(poses if model.nv else ()):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        mujoco.mj_makeM(model, data)
        mujoco.mj_factorM(model, data)
        found[i] = _timestep(model._address, data._address, tendon, axial_stiffness)
    return found


@compiled
def _timestep(
    model: MjModel, data: MjData, tendon: int, axial_stiffness: float
) -> float:
    n = path.default_segments(model, tendon, 0)
    ffi.mark_stack(data)
    led = _borrow_path(data, tendon, n)
    path.measure_path(model, data, led)
    moment = ffi.borrow_rows(data, n + 1, model.nv)
    limit, stiffness = ffi.borrow_floats(data, n + 1), ffi.borrow_floats(data, n + 1)
    length = open_path.lengths(led.measured, n)
    for i in range(n + 1):
        stiffness[i] = axial_stiffness / length[i]
    stability_limits.node_moments(model, data, led, stiffness, moment)
    stability_limits.spring_timesteps(model, data, moment, 0, limit)
    shortest = float(limit[0])
    for i in range(1, n + 1):
        shortest = min(shortest, float(limit[i]))
    ffi.free_stack(data)
    return shortest


@compiled
def read_guides(model: MjModel, instance: int, tendon: int, out: FloatArray) -> None:
    """Write a cable's guides by place of its route to `out` (p,); before a mouth: 0."""
    place = 0
    if config.is_mixed(ffi.attributes(model, instance)):
        place = attachments.find_mouth(model, instance, tendon)
    first = max(place - 1, 0)
    attachments.read_guides(model, instance, tendon, place, out[first:])


def spanned_joints(model: mujoco.MjModel, tendon: int) -> list[int]:
    """Return the joints that move one part of a spatial tendon against another."""
    start = int(model.tendon_adr[tendon])
    bodies = set()
    for k in range(start, start + int(model.tendon_num[tendon])):
        sites = [int(model.wrap_objid[k])]
        if model.wrap_type[k] != mujoco.mjtWrap.mjWRAP_SITE:
            bodies.add(int(model.geom_bodyid[sites[0]]))
            sites = [int(model.wrap_prm[k])]  # the side site, -1: none
        bodies.update(int(model.site_bodyid[site]) for site in sites if site >= 0)
    chains = [set(ancestors(model, body)) for body in bodies]
    separate = chains[0].union(*chains) - chains[0].intersection(*chains)
    return [j for j in range(model.njnt) if int(model.jnt_bodyid[j]) in separate]


def sweep(model: mujoco.MjModel, rest: FloatArray, tendon: int) -> FloatArray:
    """Return poses over the ranges of the joints of a tendon (k, nq), `rest` first.

    Equalities between joints are ignored, so some poses may be out of reach. A joint
    without a range moves to either side: a slide by the length of the tendon, a hinge
    by half a turn.
    """
    low, high = np.zeros((2, model.nv))
    dofs: list[int] = []
    for joint in spanned_joints(model, tendon):
        first = int(model.jnt_dofadr[joint])
        below, above = _range(model, rest, joint, float(model.tendon_length0[tendon]))
        own = slice(first, first + len(below))
        low[own], high[own] = below, above
        dofs += range(first, first + len(below))
    shares = np.linspace(0.0, 1.0, SWEEP_POSES)[:, None]
    moves = [np.zeros((1, model.nv))]
    if dofs:
        for dof in dofs:
            alone = np.zeros((SWEEP_POSES, model.nv))
            alone[:, dof] = low[dof] + shares[:, 0] * (high[dof] - low[dof])
            moves.append(alone)
        moves.append(low + shares * (high - low))
        random = np.random.default_rng(0).random((RANDOM_POSES, model.nv))
        moves.append(low + random * (high - low))
    whole = np.concatenate(moves)
    poses = np.tile(rest, (len(whole), 1))
    for pose, move in zip(poses, whole, strict=True):
        mujoco.mj_integratePos(model, pose, move, 1.0)
    return poses


def _range(
    model: mujoco.MjModel, rest: FloatArray, joint: int, reach: float
) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest motion of a joint from `rest` [rad or m]."""
    kind, limited = model.jnt_type[joint], bool(model.jnt_limited[joint])
    if kind == mujoco.mjtJoint.mjJNT_FREE:
        far = np.array(3 * [reach] + 3 * [math.pi])
    elif kind == mujoco.mjtJoint.mjJNT_BALL:
        far = np.full(3, model.jnt_range[joint, 1] if limited else math.pi)
    elif limited:
        here = rest[model.jnt_qposadr[joint]]
        return model.jnt_range[joint, :1] - here, model.jnt_range[joint, 1:] - here
    else:
        far = np.array([reach if kind == mujoco.mjtJoint.mjJNT_SLIDE else math.pi])
    return -far, far
