"""Walk of the wearer of a design, and the help that the ankle asks for.

    played_by({"gait_speed": 1.4}, episode)         # its walk, its task
    tasks_of([{"peak_time": 50.0}, {"peak_time": 54.0}], task)

A design or a case that says nothing of either plays what the study plays, bit for bit.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Collection, Iterable, Mapping, Sequence

from cc_mujoco.devices import Setup
from cc_mujoco.errors import CableError
from cc_mujoco.human import Profile, Task, Walk, paced
from cc_mujoco.human import task as find_task
from cc_mujoco.human.profile import Profiles
from cc_mujoco.plant.variables import Value
from cc_mujoco.plant.walker import (
    ASSIST,
    LEG_LENGTH,
    PROFILE,
    SHORTEST,
    SPEED,
    WALK,
    WALKER,
    body_of,
    pace_of,
    profile_of,
    require_scene,
    speed_of,
    trajectory_of,
)
from cc_mujoco.simulation.rollout import Episode
from cc_mujoco.whatif.metrics import of_strides
from cc_mujoco.whatif.protocol import CONTROL_PERIOD, EpisodeProtocol


def require_played(
    device: Setup, names: Collection[str], trajectory: str, task: str
) -> None:
    """Refuse to vary a walk or a profile that a study does not play.

    Raises:
        CableError: the variable, and what the study would have to play.
    """
    require_scene(device, names)
    for name in (SPEED, LEG_LENGTH):
        if name in names and trajectory != WALK:
            raise CableError(
                f"variable {name!r} is of trajectory {WALK!r}, but the study plays "
                f"{trajectory!r}."
            )
    for name in PROFILE:
        if name in names and task != ASSIST:
            raise CableError(
                f"variable {name!r} is of task {ASSIST!r}, but the study plays "
                f"{task!r}."
            )


def require_strides(
    protocol: EpisodeProtocol, designs: Iterable[Mapping[str, Value]]
) -> None:
    """Refuse to measure strides in episodes too short for one.

    Args:
        protocol: how designs are tried.
        designs: those that walk slowest among them, at least.

    Raises:
        CableError: a metric that is asked for has no number of one of them, in one of
            the cases at least; the others would be compared without it.
    """
    asked = [name for name in protocol.metrics if of_strides(name)]
    if not asked:
        return
    said = {tuple((n, d[n]) for n in WALKER if n in d) for d in designs}
    for case in protocol.across.cases:
        ends = []
        for walker in said:
            with contextlib.suppress(CableError):  # nobody walks so; said elsewhere
                ends.append(_whole_stride({**dict(walker), **case}))
        if ends and max(ends) > protocol.duration:
            slowest = " of who walks slowest" if len(set(ends)) > 1 else ""
            raise CableError(
                f"metric {asked[0]!r} is of whole strides, of which the first{slowest} "
                f"ends {max(ends):.4g} s after the start; the episode of "
                f"{protocol.duration:g} s must be longer."
            )


def _whole_stride(design: Mapping[str, Value]) -> float:
    """Return the end of the first stride walked at full cadence all along [s]."""
    walk = Walk.at(speed_of(design), body_of(design))
    # By the end of the start half of it has been walked; one sample tells the strike.
    return 0.5 * walk.start + 2.0 * walk.period + CONTROL_PERIOD


def played_by(design: Mapping[str, Value], episode: Episode) -> Episode:
    """An episode as the wearer of a design walks it, help and all."""
    return dataclasses.replace(
        episode,
        trajectory=trajectory_of(design, episode.trajectory),
        task=_paced(episode.task, design),
    )


def fitted(
    design: Mapping[str, Value],
    ranges: Mapping[str, tuple[float, float, bool]],
    cases: Sequence[Mapping[str, Value]] = ({},),
) -> dict[str, Value]:
    """A design whose profile ends with the stance at the latest and rises before.

    How late a peak may be depends on the least fall, how long a fall on the peak, and
    how late an onset, too. What a sampler draws in ranges that know nothing of it is
    taken for the place in the range that is left, so that all of them are possible and
    the longest fall is an edge, not a slope across two variables.

    Args:
        design: As it was drawn.
        ranges: Ends of the variables that are drawn between them, and whether on a
            logarithmic scale.
        cases: What differs from case to case; the profile has to fit into the shortest
            stance.
    """
    found = dict(design)
    if not any(name in design for name in PROFILE):
        return found
    try:
        toe_off = min(100.0 * pace_of({**design, **case}).toe_off for case in cases)
    except CableError:  # nobody walks so, which is said where designs are checked
        return found
    least = ranges["fall"][0] if "fall" in ranges else design.get("fall", SHORTEST)
    peak = float(design.get("peak_time", Profile.peak_time))
    if "peak_time" in ranges:
        found["peak_time"] = peak = _squeezed(
            peak, *ranges["peak_time"], toe_off - float(least)
        )
    for name, most in (("fall", toe_off - peak), ("onset", peak - SHORTEST)):
        if name in ranges:
            found[name] = _squeezed(float(design[name]), *ranges[name], most)
    return found


def _squeezed(value: float, low: float, high: float, log: bool, most: float) -> float:
    """The place in low...most that a value has in low...high."""
    most *= 1.0 - 1e-12  # rounding must not take a sum beyond its limit
    if most >= high:
        return value
    if most <= low:
        return low
    if log:
        share = math.log(value / low) / math.log(high / low)
        return min(low * math.pow(most / low, share), most)
    return min(low + (value - low) * (most - low) / (high - low), most)


def tasks_of(designs: Sequence[Mapping[str, Value]], task: str | Task) -> str | Task:
    """The task of designs that are simulated together: `task`, or their profiles."""
    found = [profile_of(design) for design in designs]
    profiles = [profile for profile in found if profile is not None]
    return Profiles(profiles) if profiles else task


def task_of(design: Mapping[str, Value], task: str) -> str | Task:
    """The task of one design."""
    profile = profile_of(design)
    if profile is not None:
        return profile
    return _paced(task, design)


def _paced(task: str | Task, design: Mapping[str, Value]) -> str | Task:
    """A task as the wearer of a design has it, who may walk otherwise or be another.

    Those that do not follow the gait stay what they are.
    """
    if not any(name in design for name in WALKER):
        return task
    found = find_task(task) if isinstance(task, str) else task
    return paced(found, pace_of(design), body_of(design).moment)
