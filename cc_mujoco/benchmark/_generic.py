"""Conditions of the suite `generic`, derived from the description of a device.

The ordinary condition has the trajectory and task of the device, and the sizes of all
others are scaled to these. Names are those of `v1` where they mean the same.
"""

from collections.abc import Sequence

import numpy as np

from cc_mujoco.benchmark._conditions import (
    DEFAULT_CONDITION,
    OWN_LINER,
    Condition,
    Together,
    crossed_conditions,
    is_walk,
    named_condition,
    varied_conditions,
)
from cc_mujoco.benchmark._plant import EFFECTS, LAG_NAME, has_effect
from cc_mujoco.device import Description, DeviceModel, find_device
from cc_mujoco.errors import CableError
from cc_mujoco.human import TASKS, Hold, Perturbed, Task, Trajectory, task, trajectory
from cc_mujoco.simulation._worn_device import axis_trajectories


def generic_conditions(scene: str) -> list[Condition]:
    """Return all conditions of a device, whose task must not command an angle."""
    device, model = find_device(scene), DeviceModel.of(scene)
    plain, tasks = plain_condition(scene), device_motion(model)[1]
    found = varied_conditions(plain, bool(device.wearers))
    if device.wearers:
        found += _other_motions(plain, model, tasks)
    silent = (TASKS["transparent"],) * len(tasks)
    if tasks != silent:
        found.append(named_condition(plain, "zero-torque", task=silent))
    found += [
        named_condition(plain, name, structure=name)
        for name in (*tuple(EFFECTS)[:4], LAG_NAME)
        if has_effect(device, name)
    ]
    name = f"{OWN_LINER}-{DEFAULT_CONDITION[1]}"
    own = named_condition(plain, name, transmission=OWN_LINER)
    return [*found, own, *crossed_conditions(plain)]


def plain_condition(scene: str) -> Condition:
    """Return an unnamed condition with the device's own trajectory and tasks."""
    motion, tasks = device_motion(DeviceModel.of(scene))
    if any(one.commands_angle for one in tasks):
        raise CableError(
            f"the task of {scene} commands an angle; `--suite position` plays it."
        )
    return Condition(scene, "", motion, tasks)


def device_motion(model: DeviceModel) -> tuple[Trajectory, tuple[Task, ...]]:
    own = model.description
    motion = joint_trajectory(own, axis_trajectories(model, None))
    return motion, tuple(task(axis.task, own.limbs(axis)) for axis in own.axes)


def _other_motions(
    plain: Condition, model: DeviceModel, tasks: tuple[Task, ...]
) -> list[Condition]:
    description, axes = model.description, model.description.axes
    reversals = [trajectory("reversals", axis.reach, axis.centre) for axis in axes]
    # A reversal has no gait: what followed it is held.
    still = tuple(map(_held, tasks)) if is_walk(plain.trajectory) else tasks
    turning = joint_trajectory(description, reversals)
    found = [named_condition(plain, "reversals", trajectory=turning, task=still)]
    plain_motion = plain.trajectory
    sizes = [_jolt(plain_motion, model, axis.limb, axis.reach) for axis in axes]
    # A bump needs room between the motion and the stops.
    if min(sizes) < 1e-3:  # [rad]
        return found
    pairs = zip([axis.limb for axis in axes], sizes, strict=True)
    jolted = [
        Perturbed(trajectory_of(plain_motion, limb), limb, size) for limb, size in pairs
    ]
    bumpy = joint_trajectory(description, jolted)
    return [*found, named_condition(plain, "jolted", trajectory=bumpy)]


def joint_trajectory(
    description: Description, each: Sequence[Trajectory]
) -> Trajectory:
    if all(one == each[0] for one in each) and (len(each) == 1 or is_walk(each[0])):
        return each[0]
    limbs = (axis.limb for axis in description.axes)
    return Together(tuple(zip(limbs, each, strict=True)))


def trajectory_of(source: Trajectory, joint: str) -> Trajectory:
    return dict(source.parts)[joint] if isinstance(source, Together) else source


def _held(one: Task) -> Task:
    """Return `Hold` at half the peak torque of a task that follows the gait."""
    if not one.follows_gait:
        return one
    phases = np.linspace(0.0, 1.0, 1001)
    still = np.zeros_like(phases)
    demand = np.asarray(one.torque(still, still, phases))
    half = 0.5 * float(demand[np.abs(demand).argmax()])
    return Hold(float(f"{half:.3g}"))


def _jolt(source: Trajectory, model: DeviceModel, joint: str, reach: float) -> float:
    """Return the size of a bump [rad], by `reach` [rad] and the distance to stops."""
    motion = source.sample(Condition.duration, 0.01, np.random.default_rng(0))
    angle = motion.companions.get(joint, motion).angle
    low, high = model.ranges[joint]
    room = 0.5 * min(float(angle.min()) - low, high - float(angle.max()))
    return float(f"{min(0.1, 0.25 * reach, room):.2g}")
