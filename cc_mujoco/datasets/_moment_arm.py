"""A lever pulled by a cable: cable taken up and moment arm by joint angle.

In the scene it is a spatial tendon from the end of the conduit to the lever, whose
length depends on one hinge joint only. As the arm varies with the angle, the cable sees
a round pulley that turns by a nonlinear function of the joint's angle.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray


@dataclass(frozen=True, eq=False)
class Lever:
    """A lever as a round pulley whose angle is a function of the joint's.

    Angles are positive where the cable pulls, as in the data.
    """

    joint: FloatArray  # (angles,) of the joint, increasing [rad]
    # (angles,) of a pulley of the lever's arm at 0, increasing [rad]
    pulley: FloatArray
    arm: FloatArray  # (angles,) of the lever over that at 0
    sign: float  # sign of the scene's angle where the cable pulls

    def turned(self, joint: FloatArray) -> FloatArray:
        """Return the angle of `pulley` [rad] at joint angles (samples,) [rad]."""
        return np.asarray(np.interp(joint, self.joint, self.pulley))

    def share(self, joint: FloatArray) -> FloatArray:
        """Return the moment arm at joint angles (samples,) [rad] over that at 0."""
        return np.asarray(np.interp(joint, self.joint, self.arm))


def lever_of(
    model: mujoco.MjModel, tendon: str, gear: float, where: str, driven: str = ""
) -> tuple[str, float, Lever]:
    """Return the joint that a tendon turns, its moment arm at 0 [m], and its lever.

    `gear` is that of the cable's actuator; if several joints move the tendon, `driven`
    is the one to take. Raises `CableError` without a single hinge or an arm at 0.
    """
    row = model.tendon(tendon).id
    data = mujoco.MjData(model)
    dofs = _moving_dofs(model, data, row)
    names = [str(model.joint(int(model.dof_jntid[dof])).name) for dof in dofs]
    what = f"{where} ends at tendon {tendon!r}, which"
    joint = single_hinge(model, names, what, driven)
    dof = int(model.joint(joint).dofadr[0])
    place = int(model.joint(joint).qposadr[0])
    poses = np.append(swept_angles(model, joint), 0.0)
    lengths, arms = np.empty((2, poses.size))
    for k, angle in enumerate(poses):
        data.qpos[place] = angle
        mujoco.mj_fwdPosition(model, data)
        arms[k], lengths[k] = _tendon_arms(model, data, row)[dof], data.ten_length[row]
    arms *= gear
    let = gear * (lengths[:-1] - lengths[-1])
    radius, lever = make_lever(poses[:-1], let, arms[:-1], float(arms[-1]), where)
    return joint, radius, lever


def single_hinge(
    model: mujoco.MjModel, moved: Sequence[str], what: str, driven: str = ""
) -> str:
    if driven in moved:
        moved = [driven]
    if len(moved) != 1:
        movement = (
            f"moves with joints {', '.join(moved)}" if moved else "moves with none"
        )
        raise CableError(
            f"{what} {movement}; a diagnosis takes a cable that turns one hinge joint, "
            "by a pulley or a lever: name it as `joint` of an [[axis]] in the scene's "
            "description and record the angles of the others, or lock them on the rig "
            "and take their <joint> out of the scene"
        )
    if model.joint(moved[0]).type[0] != mujoco.mjtJoint.mjJNT_HINGE:
        raise CableError(f"{what} moves with joint {moved[0]!r}, which is no hinge")
    return moved[0]


def swept_angles(model: mujoco.MjModel, joint: str, count: int = 4001) -> FloatArray:
    """Return angles (count,) [rad] over a joint's range, or +-3, extended to 0."""
    index = model.joint(joint).id
    low, high = -3.0, 3.0
    if model.jnt_limited[index]:
        low, high = model.jnt_range[index]
    return np.linspace(min(low, 0.0), max(high, 0.0), count)


def make_lever(
    angles: FloatArray, let: FloatArray, arms: FloatArray, arm: float, where: str
) -> tuple[float, Lever]:
    """Return the moment arm at 0 [m], and the lever while its arm is above 0.2 of that.

    At the scene's `angles` (angles,) [rad] the lever displaces the cable's end by `let`
    [m], 0 at angle 0, with derivative `arms` [m/rad], which is `arm` at angle 0.
    """
    radius = abs(arm)
    if radius == 0.0:
        raise CableError(
            f"{where} pulls along its lever at angle 0; it has no arm there"
        )
    at, count = int(np.argmin(np.abs(angles))), angles.size
    alive = arms / arm > 0.2  # beyond, a lever is as good as dead
    first = at - int(np.argmin(alive[at::-1])) + 1 if not alive[: at + 1].all() else 0
    last = at + int(np.argmin(alive[at:])) if not alive[at:].all() else count
    kept = slice(first, last)
    # Where the cable is drawn in, the distal end moves towards the motor.
    sign = -float(np.sign(arm))
    way = int(sign)
    return radius, Lever(
        np.ascontiguousarray(sign * angles[kept][::way]),
        np.ascontiguousarray(-let[kept][::way] / radius),
        np.ascontiguousarray(arms[kept][::way] / arm),
        sign,
    )


def _tendon_arms(model: mujoco.MjModel, data: mujoco.MjData, row: int) -> FloatArray:
    """Return the derivative (nv,) of a tendon's length by each degree of freedom."""
    found = np.zeros(model.nv)
    start, count = model.ten_J_rowadr[row], model.ten_J_rownnz[row]
    part = slice(start, start + count)
    found[model.ten_J_colind[part]] = data.ten_J[part]
    return found


def _moving_dofs(model: mujoco.MjModel, data: mujoco.MjData, row: int) -> list[int]:
    random = np.random.default_rng(0)
    most = np.zeros(model.nv)
    for _ in range(8):
        speed = random.uniform(-0.5, 0.5, model.nv)
        data.qpos[:] = model.qpos0
        mujoco.mj_integratePos(model, data.qpos, speed, 1.0)
        mujoco.mj_fwdPosition(model, data)
        most = np.maximum(most, np.abs(_tendon_arms(model, data, row)))
    data.qpos[:] = model.qpos0
    return [int(k) for k in np.flatnonzero(most > 1e-6 * max(most.max(), 1e-12))]
