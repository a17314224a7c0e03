"""Variables of the wearer: walking speed, body, and torque profile at the ankle.

    pace_of({"gait_speed": 1.4})
    profile_of({"peak_time": 50.0, "fall": 9.0})

Designs that set none of them leave the walk of the scene unchanged, bit for bit.
"""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from cc_mujoco.device._description import Axis, Description
from cc_mujoco.device._variables import Value
from cc_mujoco.errors import CableError
from cc_mujoco.human import Body, Pace, Profile, Task, Trajectory, Walk, scale_task
from cc_mujoco.human import task as find_task
from cc_mujoco.human._profile import Profiles

WALKER = ("gait_speed", "body_mass", "leg_length")
"""Variables of who walks: designs that are simulated together have them in common."""
PROFILE = ("onset", "peak_time", "peak_torque", "fall")
"""Fields of `human.Profile`, and variables."""


def body_of(design: Mapping[str, Value]) -> Body:
    mass = float(design.get("body_mass", Body.mass))
    return Body(mass, float(design.get("leg_length", Body.leg)))


def pace_of(design: Mapping[str, Value]) -> Pace:
    return body_of(design).pace(speed_of(design))


def speed_of(design: Mapping[str, Value]) -> float | None:
    """Return the walking speed that a design sets [m/s]; None if it sets none."""
    return float(design["gait_speed"]) if "gait_speed" in design else None


def profile_of(design: Mapping[str, Value]) -> Profile | None:
    """Return a design's torque profile or None; its peak follows from the wearer."""
    said = {name: float(design[name]) for name in PROFILE if name in design}
    if not said:
        return None
    toe_off = 100.0 * pace_of(design).toe_off
    share = body_of(design).moment * pace_of(design).moment("ankle")
    said.setdefault("peak_torque", share * Profile.peak_torque)
    # A default must not refuse a walk whose stance is shorter.
    rest = toe_off - said.get("peak_time", Profile.peak_time)
    if "fall" not in said and 0.1 <= rest < Profile.fall:
        said["fall"] = rest
    return Profile(**said, toe_off=toe_off)


def require_possible(device: Description, design: Mapping[str, Value]) -> None:
    """Refuse a design whose walk or torque profile is impossible in the scene."""
    require_scene(device, design)
    pace_of(design)
    profile, helped = profile_of(design), helped_axis(device)
    if profile and helped and profile.peak_torque > helped.safe_torque:
        raise CableError(
            f"`peak_torque` is {profile.peak_torque:g} N m; it must be at most the "
            f"{helped.safe_torque:g} N m that the cables may put into joint "
            f"{helped.joint!r}."
        )


def helped_axis(device: Description) -> Axis | None:
    """Return the axis that assists the ankle's push-off; None if there is none."""
    helped = (axis for axis in device.axes if axis.task.partition(":")[0] == "assist")
    return next(helped, None)


def require_scene(device: Description, names: Collection[str]) -> None:
    """Refuse variables of a walk or of a profile in a scene whose wearer has none."""
    for name in (*WALKER, *PROFILE):
        walks = device.trajectory == "walk"
        if name in names and not (walks if name in WALKER else helped_axis(device)):
            what = "walks" if name in WALKER else "is helped in push-off"
            scenes = (
                "'ankle', 'bilateral' and 'exosuit'" if name in WALKER else "'ankle'"
            )
            raise CableError(
                f"variable {name!r} needs a wearer who {what}, as in {scenes}, but "
                f"the scene is {device.scene!r}."
            )
    if "leg_length" in names and not any(axis.lever for axis in device.axes):
        raise CableError(
            "variable 'leg_length' moves knee and ankle apart, but the scene "
            f"{device.scene!r} draws the paths of its cables along a leg of "
            f"{Body.leg:g} m; vary 'body_mass' alone, or choose the scene 'ankle'."
        )


def trajectory_of(
    design: Mapping[str, Value], trajectory: str | Trajectory
) -> str | Trajectory:
    if "gait_speed" in design or "leg_length" in design:
        return Walk.at(speed_of(design), body_of(design))
    return trajectory


def tasks_of(
    designs: Sequence[Mapping[str, Value]],
    given: str | Path | Task | Mapping[str, str | Path | Task] | None,
    device: Description,
) -> str | Path | Task | Mapping[str, str | Path | Task] | None:
    """Return the task `given` for the wearer of designs that are simulated together.

    The wearer is the same in all. Torque profiles of the designs, a row for each,
    replace the task of `helped_axis`, or the only task.
    """
    walker, helped = designs[0], helped_axis(device)

    def scaled(task: str | Path | Task) -> str | Path | Task:
        if not any(name in walker for name in WALKER):
            return task
        return scale_task(find_task(task), pace_of(walker), body_of(walker).moment)

    found = given
    if isinstance(given, Mapping):
        found = {name: scaled(task) for name, task in given.items()}
    elif given is not None:
        found = scaled(given)
    profiles = [one for one in map(profile_of, designs) if one is not None]
    if not profiles or helped is None:
        return found
    profile = Profiles(profiles) if len(profiles) > 1 else profiles[0]
    return {**found, helped.name: profile} if isinstance(found, Mapping) else profile
