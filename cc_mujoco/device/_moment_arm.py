r"""Winding: angle of the round pulley that would move a cable's distal end equally.

The moment arm of a lever changes with its angle, and a cable may pass several joints.
The length \(\ell\) by which the distal end moves, over the arm \(f_0\) of the joint in
the neutral pose, is the winding angle

\[ \varphi = (\ell - \ell_0) / f_0, \qquad
   f = \partial\ell / \partial\theta_j, \qquad \lambda = f / f_0 \]

with the leverage \(\lambda\). A tension that makes the torque \(\tau\) at the joint
would make \(\tau / \lambda\) on that pulley. In these coordinates every device has
a round pulley.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.device._axis_record import MIN_LEVERAGE
from cc_mujoco.device._sensors import RATIO_COLUMN, WINDING_COLUMNS

Array = NDArray[np.float64]


class Winding(NamedTuple):
    """Winding of a distal end: its indices in MuJoCo's arrays, and its neutral pose."""

    end: int  # in `actuator_length`
    step: float  # time step [s]
    places: tuple[int, ...]  # of the arms of the end, in `actuator_moment`
    dofs: tuple[int, ...]  # of the velocities that they belong to
    own: int  # place of the joint's among these
    length: float  # in the neutral pose [m]
    arm: float  # in the neutral pose [m/rad]
    shared: tuple[tuple[str, int, float], ...] = ()
    """`RATIO_COLUMN` of every joint of another axis that the cable turns, the place of
    its arm in `actuator_moment`, and the ratio per arm [rad/m]."""

    def read(self, physics: Any) -> dict[str, Any]:
        """Return `WINDING_COLUMNS` and each `RATIO_COLUMN` after the last step.

        MuJoCo leaves lengths and arms of the start of the step; the angle is
        extrapolated by one step with the velocity after it.
        """
        moment, qvel = physics.actuator_moment.T, physics.qvel.T
        velocity = 0.0
        for place, dof in zip(self.places, self.dofs, strict=True):
            velocity = velocity + moment[place] * qvel[dof]
        wound_length = physics.actuator_length.T[self.end] - self.length
        leverage = np.maximum(moment[self.places[self.own]] / self.arm, MIN_LEVERAGE)
        values = (wound_length + self.step * velocity) / self.arm, velocity / self.arm
        found = dict(zip(WINDING_COLUMNS, (*values, leverage), strict=True))
        for name, place, scale in self.shared:
            found[name] = scale * moment[place]
        return found

    def record(self, hold: Callable[[NDArray[Any]], int]) -> dict[str, Any]:
        shared = [place for _, place, _ in self.shared]
        return {
            "wound": len(self.places),
            "arms": hold(np.array([*self.places, *self.dofs], np.int64)),
            "own_arm": self.own,
            "wound_end": self.end,
            "winding_arm": self.arm,
            "wound_length": self.length,
            "timestep": self.step,
            "shared": len(shared),
            "shared_arms": hold(np.array(shared, np.int64)),
            "shared_scales": hold(np.array([scale for *_, scale in self.shared])),
        }

    def sharing(
        self, model: mujoco.MjModel, joints: Container[str], motor: float
    ) -> Winding:
        """Return a copy whose `shared` has those of `joints` that the cable turns.

        `motor` is the arm of the proximal end at the motor [m/rad].
        """
        places = self.places[: self.own] + self.places[self.own + 1 :]
        shared = tuple(
            (RATIO_COLUMN.format(joint=joint), place, 1.0 / motor)
            for joint, place in zip(self.others(model), places, strict=True)
            if joint in joints
        )
        return self._replace(shared=shared)

    def others(self, model: mujoco.MjModel) -> tuple[str, ...]:
        """Return the joints besides the driven one that move the cable's end."""
        dofs = (dof for place, dof in enumerate(self.dofs) if place != self.own)
        return tuple(model.joint(model.dof_jntid[dof]).name for dof in dofs)


class TabledWinding(NamedTuple):
    """Winding of a cable whose conduit moves, as a table over the angle of the joint.

    The tendon of such a cable includes its conduit, whose length does not move the end.
    """

    joint_q: int  # in `qpos`
    joint_v: int
    angles: Array  # of the joint, rising (k,) [rad]
    wound: Array  # angle that is wound there (k,) [rad]
    leverage: Array  # its derivative (k,)

    def read(self, physics: Any) -> dict[str, Any]:
        angle = physics.qpos.T[self.joint_q]
        share = np.interp(angle, self.angles, self.leverage)
        velocity = share * physics.qvel.T[self.joint_v]
        leverage = np.maximum(share, MIN_LEVERAGE)
        wound = np.interp(angle, self.angles, self.wound)
        return dict(zip(WINDING_COLUMNS, (wound, velocity, leverage), strict=True))

    def record(self, hold: Callable[[NDArray[Any]], int]) -> dict[str, Any]:
        table = np.concatenate((self.angles, self.wound, self.leverage))
        return {"knots": len(self.angles), "table": hold(table)}

    def others(self, model: mujoco.MjModel) -> tuple[str, ...]:
        """Return (): only the driven joint moves the cable's end."""
        return ()


def open_winding(
    model: mujoco.MjModel, tendon: int, mouth: int, joint: str
) -> TabledWinding | None:
    """Return the winding of a cable that leaves its conduit at the site `mouth`.

    None if other joints move the part of the tendon outside the conduit.
    """
    own = model.joint(joint)
    place, dof = int(own.qposadr[0]), int(own.dofadr[0])
    neutral = float(model.qpos0[place])
    low, high = neutral - 1.0, neutral + 1.0
    if model.jnt_limited[own.id]:
        span = float(own.range[1] - own.range[0])
        low, high = own.range[0] - 0.1 * span, own.range[1] + 0.1 * span
    data = mujoco.MjData(model)

    def length(qpos: Array, angle: float) -> float:
        """Return the length of the tendon from the mouth to its end [m]."""
        data.qpos[:] = qpos
        data.qpos[place] = angle
        mujoco.mj_fwdPosition(model, data)
        start = int(data.ten_wrapadr[tendon])
        points = data.wrap_xpos.reshape(-1, 3)[start : start + data.ten_wrapnum[tendon]]
        at = np.linalg.norm(points - data.site_xpos[mouth], axis=1).argmin()
        guided = np.linalg.norm(np.diff(points[: at + 1], axis=0), axis=1).sum()
        return float(data.ten_length[tendon] - guided)

    first = length(model.qpos0, neutral)
    if any(abs(length(qpos, neutral) - first) > 1e-6 for qpos in _poses(model)):
        return None
    angles = np.union1d(np.linspace(low, high, 401), [neutral])
    lengths = np.array([length(model.qpos0, angle) for angle in angles.tolist()])
    slope = np.gradient(lengths, angles)
    arm = float(np.interp(neutral, angles, slope))
    if not arm:
        return None
    return TabledWinding(place, dof, angles, (lengths - first) / arm, slope / arm)


class MeasuredWinding:
    """Winding of a distal end from measured angles of joints, without a simulation."""

    def __init__(self, model: mujoco.MjModel, winding: Winding | TabledWinding) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        self._winding: Winding | TabledWinding = winding
        if isinstance(winding, TabledWinding):
            self._velocities = [winding.joint_v]
        else:
            # A measured pose is that of the same instant.
            self._winding = winding._replace(step=0.0)
            self._velocities = list(winding.dofs)
        joints = [int(model.dof_jntid[dof]) for dof in self._velocities]
        self.joints = tuple(model.joint(joint).name for joint in joints)
        """Joints that have to be measured, in the order of `read`."""
        self._angles = model.jnt_qposadr[joints]

    def read(
        self, angles: Sequence[float], velocities: Sequence[float]
    ) -> dict[str, float]:
        """Return `WINDING_COLUMNS` at angles [rad], velocities [rad/s] of `joints`."""
        model, data = self._model, self._data
        data.qpos[self._angles] = angles
        data.qvel[self._velocities] = velocities
        if isinstance(self._winding, Winding):  # a table needs the angle alone
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_tendon(model, data)
            mujoco.mj_transmission(model, data)
        return {name: float(v) for name, v in self._winding.read(data).items()}


def winding_of(
    model: mujoco.MjModel, data: mujoco.MjData, end: int, joint: str
) -> Winding | None:
    """Return the winding of output `end`; None if a round pulley moves it equally.

    `data` are overwritten.
    """
    dof = int(model.joint(joint).dofadr[0])
    mujoco.mj_resetData(model, data)
    mujoco.mj_fwdPosition(model, data)
    start, count = int(data.moment_rowadr[end]), int(data.moment_rownnz[end])
    dofs = data.moment_colind[start : start + count].copy()
    own, length = dofs.tolist().index(dof), float(data.actuator_length[end])
    arm = float(data.actuator_moment[start + own])
    found = []
    for qpos in _poses(model):
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(model, data)
        found.append(data.actuator_moment[start : start + count].copy())
    arms, least = np.array(found), 1e-9 * abs(arm)  # less is rounding
    moves = np.abs(arms).max(axis=0) > least
    if not np.delete(moves, own).any() and np.ptp(arms[:, own]) < least:
        return None
    places = tuple((start + np.flatnonzero(moves)).tolist())
    moved, place = tuple(dofs[moves].tolist()), int(moves[:own].sum())
    return Winding(end, float(model.opt.timestep), places, moved, place, length, arm)


class Arms:
    """Moment arms of all actuators over the ranges of the joints [m/rad, m/m or 1]."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Evaluate the arms in `qpos0` and five poses over the joints' ranges."""
        self.model = model
        data = mujoco.MjData(model)
        swept = np.abs(moments(model, data, [model.qpos0, *_poses(model)]))
        self.most, self.mean = swept.max(axis=0), swept.mean(axis=0)
        """Largest and mean absolute arms, (outputs, nv)."""
        self._neutral = neutral_moments(model, data)

    def neutral(self, out: int, joint: int) -> float:
        """Return the signed arm of output `out` at `joint` in the pose `qpos0`."""
        return float(self._neutral[out, self.model.jnt_dofadr[joint]])


def neutral_moments(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Return the moment arms of all actuators in the pose `qpos0`, (outputs, nv)."""
    return np.asarray(moments(model, data, [model.qpos0])[0])


def moments(
    model: mujoco.MjModel, data: mujoco.MjData, poses: Sequence[Array]
) -> Array:
    """Return the moment arms of all actuators in each pose, (poses, outputs, nv).

    `data` are overwritten.
    """
    mujoco.mj_resetData(model, data)
    found = np.zeros((len(poses), model.nout, model.nv))
    for dense, qpos in zip(found, poses, strict=True):
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(model, data)
        sparse = data.moment_rownnz, data.moment_rowadr, data.moment_colind
        mujoco.mju_sparse2dense(dense, data.actuator_moment, *sparse)
    return found


def _poses(model: mujoco.MjModel) -> list[Array]:
    """Return five poses, with limited joints at 10, 30, 50, 70, 90 % of their range."""
    single = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    swept = np.isin(model.jnt_type, single) & (model.jnt_limited != 0)
    places, (low, high) = model.jnt_qposadr[swept], model.jnt_range[swept].T
    poses = []
    for share in np.linspace(0.1, 0.9, 5):
        qpos = model.qpos0.copy()
        qpos[places] = low + share * (high - low)
        poses.append(qpos)
    return poses
