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

from collections.abc import Callable, Container, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.device._axis_record import MIN_LEVERAGE
from cc_mujoco.device._sensors import RATIO_COLUMN, WINDING_COLUMNS
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.plugin._readings import moments


class Winding(NamedTuple):
    """Winding of a distal end: its indices in MuJoCo's arrays, and its neutral pose."""

    end: int  # index in `actuator_length`
    step: float  # time by which the wound angle is extrapolated [s]
    places: tuple[int, ...]  # indices of the end's arms in `actuator_moment`
    dofs: tuple[int, ...]  # index in `qvel` of the joint of each arm
    own: int  # index of the driven joint among `dofs`
    length: float  # `actuator_length` in the neutral pose [m]
    arm: float  # arm at the driven joint in the neutral pose [m/rad]
    others: tuple[str, ...]  # joints besides the driven one that move the end
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


class TabledWinding(NamedTuple):
    """Winding of a cable whose conduit moves, as a table over the angle of the joint.

    The tendon of such a cable includes its conduit, whose length does not move the end.
    """

    joint_q: int  # index of the joint in `qpos`
    joint_v: int  # index of its velocity in `qvel`
    angles: Array  # of the joint, rising (k,) [rad]
    wound: Array  # wound angle at each, see `WINDING_COLUMNS` (k,) [rad]
    leverage: Array  # derivative of the wound angle by the joint's (k,)
    others: tuple[str, ...] = ()  # only the driven joint moves the cable's end

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


class Actuator(NamedTuple):
    """Actuator at a joint, which is neither its wearer nor its cable."""

    out: int  # in `actuator_force`
    gear: float
    place: int  # of its arm in `actuator_moment`; -1 if the gear is the arm


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


class Arms:
    """Moment arms of all actuators over the ranges of the joints [m/rad, m/m or 1]."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Evaluate the arms in five poses and, at last, `qpos0`; `data` are changed."""
        self.model, self._data = model, data
        *found, self.neutral = moments(model, data, [*_poses(model), model.qpos0])
        """Signed arms in the pose `qpos0`, (outputs, nv)."""
        self._swept = np.array(found)
        swept = np.abs([self.neutral, *found])
        self.most, self.mean = swept.max(axis=0), swept.mean(axis=0)
        """Largest and mean absolute arms, (outputs, nv)."""

    def _row(self, out: int) -> tuple[int, list[int]]:
        """Return the index of an output's first arm in `actuator_moment`, all dofs."""
        start, count = self._data.moment_rowadr[out], self._data.moment_rownnz[out]
        return int(start), self._data.moment_colind[start : start + count].tolist()

    def winding(
        self, end: int, joint: str, joints: Container[str], motor: float
    ) -> Winding | None:
        """Return the winding of output `end`; None if a round pulley moves it equally.

        Its `shared` has those of `joints` that the cable turns; `motor` is the arm of
        the proximal end at the motor [m/rad].
        """
        model, (start, dofs) = self.model, self._row(end)
        own = dofs.index(int(model.joint(joint).dofadr[0]))
        arm, arms = float(self.neutral[end, dofs[own]]), self._swept[:, end, dofs]
        least = 1e-9 * abs(arm)  # less is rounding
        moves = np.abs(arms).max(axis=0) > least
        if not np.delete(moves, own).any() and np.ptp(arms[:, own]) < least:
            return None
        moved = np.flatnonzero(moves).tolist()
        names = {n: model.joint(model.dof_jntid[dofs[n]]).name for n in moved}
        others = {n: name for n, name in names.items() if n != own}
        return Winding(
            end,
            float(model.opt.timestep),
            places=tuple(start + n for n in moved),
            dofs=tuple(dofs[n] for n in moved),
            own=moved.index(own),
            length=float(self._data.actuator_length[end]),
            arm=arm,
            others=tuple(others.values()),
            shared=tuple(
                (RATIO_COLUMN.format(joint=name), start + n, 1.0 / motor)
                for n, name in others.items()
                if name in joints
            ),
        )

    def others(self, dof: int, known: Container[int]) -> tuple[Actuator, ...]:
        """Return the actuators that move `dof`, except the outputs `known`."""
        model, found = self.model, []
        for actuator in range(model.nu):
            out = int(model.actuator_outadr[actuator])
            start, dofs = self._row(out)
            if out in known or dof not in dofs:
                continue
            on_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
            place = -1 if on_joint else start + dofs.index(dof)
            found.append(Actuator(out, float(model.actuator_gear[actuator, 0]), place))
        return tuple(found)


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
