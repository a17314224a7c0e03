"""Gait of the wearer of a design, and the assistance at the ankle.

    episode_of({"gait_speed": 1.4}, episode)         # its walk, its task
    tasks_of([{"peak_time": 50.0}, {"peak_time": 54.0}], task)

A design or a case that sets neither is simulated as in the study, bit for bit.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path

from cc_mujoco.design._protocol import EpisodeProtocol
from cc_mujoco.design._study_metrics import is_stride_metric
from cc_mujoco.device import Description, Device, Plant
from cc_mujoco.device._model import joint_range
from cc_mujoco.device._variables import Value
from cc_mujoco.device._wearer_scaling import (
    ASSIST,
    LEG_LENGTH,
    PROFILE,
    SHORTEST,
    SPEED,
    WALK,
    WALKER,
    body_of,
    helped_axis,
    pace_of,
    profile_of,
    require_scene,
    speed_of,
    trajectory_of,
)
from cc_mujoco.errors import CableError
from cc_mujoco.human import Profile, Task, Walk, scale_task
from cc_mujoco.human import task as find_task
from cc_mujoco.human._gait_joints import GaitJoint, gait_joints
from cc_mujoco.human._profile import Profiles
from cc_mujoco.simulation._rollout import Episode
from cc_mujoco.simulation._worn_device import TaskChoice


def require_played(
    device: Description,
    names: Collection[str],
    trajectory: str,
    tasks: Mapping[str, str],
) -> None:
    """Refuse to vary a walk or a profile that a study does not play."""
    require_scene(device, names)
    for name in (SPEED, LEG_LENGTH):
        if name in names and trajectory != WALK:
            raise CableError(
                f"variable {name!r} is of trajectory {WALK!r}, but the study plays "
                f"{trajectory!r}."
            )
    helped = helped_axis(device)
    for name in PROFILE:
        task = "" if helped is None else tasks[helped.name]
        if name in names and task.partition(":")[0] != ASSIST:
            raise CableError(
                f"variable {name!r} is of task {ASSIST!r}, but the study plays "
                f"{task!r}."
            )


def joints_of_gait(builder: Device) -> dict[str, GaitJoint]:
    """Return the parts in a walk of the joints that a device drives, by axis."""
    model, axes = Plant(builder).model(), builder.description.axes
    found = gait_joints({axis.limb: joint_range(model, axis.limb) for axis in axes})
    walking = {joint.name: joint for joint in found}
    return {axis.name: walking[axis.limb] for axis in axes if axis.limb in walking}


def require_strides(
    protocol: EpisodeProtocol, designs: Iterable[Mapping[str, Value]]
) -> None:
    """Refuse to measure strides in episodes too short for one.

    `designs` are those that walk slowest, at least. A metric without a number in one
    case would be compared over the others.
    """
    stride_metrics = [name for name in protocol.metrics if is_stride_metric(name)]
    if not stride_metrics:
        return
    walkers = {tuple((n, d[n]) for n in WALKER if n in d) for d in designs}
    period = protocol.device.description.period
    for case in protocol.across.cases:
        ends = []
        for walker in walkers:
            with contextlib.suppress(CableError):  # impossible; reported elsewhere
                ends.append(_whole_stride({**dict(walker), **case}, period))
        if ends and max(ends) > protocol.duration:
            slowest = " of who walks slowest" if len(set(ends)) > 1 else ""
            raise CableError(
                f"metric {stride_metrics[0]!r} is of whole strides, of which the "
                f"first{slowest} ends {max(ends):.4g} s after the start; the episode "
                f"of {protocol.duration:g} s must be longer."
            )


def _whole_stride(design: Mapping[str, Value], period: float) -> float:
    """Return the end of the first stride walked at full cadence all along [s]."""
    walk = Walk.at(speed_of(design), body_of(design))
    # By the end of the start half of it has been walked; one sample tells the strike.
    return 0.5 * walk.start + 2.0 * walk.period + period


def episode_of(design: Mapping[str, Value], episode: Episode) -> Episode:
    """Return an episode with the gait and the task of the wearer of a design."""
    return dataclasses.replace(
        episode,
        trajectory=trajectory_of(design, episode.trajectory),
        task=_each_task(episode.task, lambda task: _task_of_wearer(task, design)),
    )


def fit_profile(
    design: Mapping[str, Value],
    ranges: Mapping[str, tuple[float, float, bool]],
    cases: Sequence[Mapping[str, Value]] = ({},),
) -> dict[str, Value]:
    """Return a design with a possible profile: it ends with the stance at the latest.

    How late a peak may be depends on the least fall, how long a fall on the peak, and
    how late an onset, too. A sampler draws each variable from its full range; the draw
    is mapped to the same fraction of the range that is left. So all designs are
    possible and the longest fall is an edge, not a slope across two variables.

    `ranges` are the ends of the drawn variables, and whether on a logarithmic scale;
    the profile has to fit into the shortest stance of all `cases`.
    """
    found = dict(design)
    if not any(name in design for name in PROFILE):
        return found
    try:
        toe_off = min(100.0 * pace_of({**design, **case}).toe_off for case in cases)
    except CableError:  # impossible, which is reported where designs are checked
        return found
    least = ranges["fall"][0] if "fall" in ranges else design.get("fall", SHORTEST)
    peak = float(design.get("peak_time", Profile.peak_time))
    if "peak_time" in ranges:
        found["peak_time"] = peak = _rescale(
            peak, *ranges["peak_time"], toe_off - float(least)
        )
    for name, most in (("fall", toe_off - peak), ("onset", peak - SHORTEST)):
        if name in ranges:
            found[name] = _rescale(float(design[name]), *ranges[name], most)
    return found


def _rescale(value: float, low: float, high: float, log: bool, most: float) -> float:
    """Return a value of low...high mapped to the same fraction of low...most."""
    most *= 1.0 - 1e-12  # rounding must not take a sum beyond its limit
    if most >= high:
        return value
    if most <= low:
        return low
    if log:
        share = math.log(value / low) / math.log(high / low)
        return min(low * math.pow(most / low, share), most)
    return min(low + (value - low) * (most - low) / (high - low), most)


def tasks_of(
    designs: Sequence[Mapping[str, Value]], task: TaskChoice, device: Description
) -> TaskChoice:
    """Return the task of designs simulated together: `task`, or their profiles."""
    found = [profile_of(design) for design in designs]
    profiles = [profile for profile in found if profile is not None]
    return _with_profile(task, Profiles(profiles) if profiles else None, device)


def task_of(
    design: Mapping[str, Value], task: TaskChoice, device: Description
) -> TaskChoice:
    own = _each_task(task, lambda one: _task_of_wearer(one, design))
    return _with_profile(own, profile_of(design), device)


def _with_profile(
    task: TaskChoice, profile: Task | None, device: Description
) -> TaskChoice:
    """Return a task with a profile, if there is one, at the axis that is helped."""
    helped = helped_axis(device)
    if profile is None or helped is None:
        return task
    return {**task, helped.name: profile} if isinstance(task, Mapping) else profile


def _each_task(
    task: TaskChoice, change: Callable[[str | Path | Task], str | Path | Task]
) -> TaskChoice:
    if isinstance(task, Mapping):
        return {name: change(one) for name, one in task.items()}
    return None if task is None else change(task)


def _task_of_wearer(
    task: str | Path | Task, design: Mapping[str, Value]
) -> str | Path | Task:
    """Return a task for the wearer of a design, who may walk differently.

    Tasks that do not follow the gait are returned unchanged.
    """
    if not any(name in design for name in WALKER):
        return task
    return scale_task(find_task(task), pace_of(design), body_of(design).moment)
