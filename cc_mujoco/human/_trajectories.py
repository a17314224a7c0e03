"""Trajectories by text: names, numbers, recorded motions and those of the user.

    >>> from cc_mujoco.human import trajectory
    >>> trajectory("sweep")
    Sweep(amplitude=0.4, move=1.0, hold=0.5)
    >>> trajectory("sweep", limit=0.3).amplitude       # made to fit an ankle
    0.3
    >>> trajectory("sine:0.2,frequency=2").frequency
    2.0

Defaults suit a wrist, except those of `walk`, which is an ankle's. Parameters are
changed with `dataclasses.replace`; `Trajectory` says what all have in common.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cc_mujoco._utils.tables import is_table
from cc_mujoco._utils.user_code import user_errors
from cc_mujoco._validation import require_number
from cc_mujoco.errors import CableError
from cc_mujoco.human._motion import Array, Motion, Scripted, Trajectory
from cc_mujoco.human._parsing import given_fields, user_object, with_numbers
from cc_mujoco.human._perturbed import Disturbed
from cc_mujoco.human._recorded import Recorded, read_trajectory
from cc_mujoco.human._scripted import (
    Chirp,
    Multisine,
    Ramp,
    Reach,
    Reversals,
    Sine,
    Sweep,
)
from cc_mujoco.human._walking import Walk

TRAJECTORIES: dict[str, Scripted] = {
    "sweep": Sweep(),
    "ramp": Ramp(),
    "sine": Sine(),
    "chirp": Chirp(),
    "multisine": Multisine(),
    "reach": Reach(),
    "reversals": Reversals(),
    "walk": Walk(),
}
"""Every scripted trajectory with its default parameters."""


@dataclass(frozen=True)
class Centred(Trajectory):
    """A scripted trajectory about another angle than 0, where it starts at rest."""

    base: Trajectory
    """Trajectory about 0."""
    centre: float
    """Angle that is added [rad]."""

    @property
    def is_pointwise(self) -> bool:
        """Return whether the trajectory about 0 is."""
        return self.base.is_pointwise

    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        motion = self.base._motion(time, duration, rng)
        return replace(motion, angle=motion.angle + self.centre)


@dataclass(frozen=True)
class UserTrajectory(Trajectory):
    """A trajectory of the user's own class, whose errors are reported in a sentence."""

    name: str
    """`MODULE:NAME`."""
    own: Trajectory

    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        with user_errors(f"trajectory {self.name!r}"):
            motion = self.own._motion(time, duration, rng)
        if not isinstance(motion, Motion):
            raise CableError(
                f"trajectory {self.name!r} gave {motion!r}; it must be a Motion."
            )
        for each in ("angle", "velocity", "acceleration", "phase"):
            values = np.asarray(getattr(motion, each))
            if values.shape != time.shape or not np.isfinite(values).all():
                raise CableError(
                    f"trajectory {self.name!r}: `{each}` must be {time.size} finite "
                    f"numbers, one for each time, not an array {values.shape}."
                )
        return motion


def trajectory(
    given: str | Path | Trajectory,
    limit: float | None = None,
    centre: float = 0.0,
    joints: Mapping[str, tuple[float, float]] | None = None,
) -> Trajectory:
    """Return the trajectory that is meant, made to fit a device.

    A named one moves about `centre`, where it starts at rest, and its default amplitude
    is reduced to `limit`; an amplitude that is given is not. With `centre` 0 it is the
    entry of `TRAJECTORIES`, bit for bit. `walk` has the angles of the gait on the
    joints that take part in it and is not moved to `centre`, see `Walk.on_joints`; a
    recorded motion, and one of the user, stays what it is.

    Args:
        given: A key of `TRAJECTORIES`, also with numbers (`sine:0.3`,
            `chirp:0.2,high=5`); a table (a `Path`, or a text that ends as one, see
            `read_trajectory`); `MODULE:NAME` of a `Trajectory` or a function that
            returns one; or a trajectory.
        limit: Largest excursion of named trajectories from `centre` [rad]; none by
            default.
        centre: Angle about which named trajectories move [rad].
        joints: Range [rad] by name of the joints that the wearer moves, the driven one
            first; by default joints are not checked.

    Raises:
        CableError: If there is no such trajectory, it cannot be read or made, or it
            does not move the driven joint.
    """
    require_number("centre", centre, -1e3, 1e3, "rad")
    if isinstance(given, Trajectory):
        return _on_joints(given, joints)
    if isinstance(given, Path) or (isinstance(given, str) and is_table(given)):
        return read_trajectory(given, tuple(joints or ()))
    if not isinstance(given, str):
        raise CableError(
            "trajectory must be a name, the path of a table or a Trajectory, not "
            f"{given!r}."
        )
    name, colon, _ = given.partition(":")
    if colon and name not in TRAJECTORIES:
        made = user_object(
            "trajectory", given, TRAJECTORIES, Trajectory, UserTrajectory
        )
        return _on_joints(made, joints)
    found = with_numbers("trajectory", given, TRAJECTORIES)
    chosen = {"", "amplitude"}.intersection(given_fields(given))
    if not chosen and limit is not None and found.amplitude > limit:
        found = replace(found, amplitude=limit)
    if centre and not isinstance(found, Walk):
        return Centred(found, float(centre))
    return _on_joints(found, joints)


def _on_joints(
    found: Trajectory, joints: Mapping[str, tuple[float, float]] | None
) -> Trajectory:
    """Return a trajectory with the names of a device's joints."""
    if not joints:
        return found
    if isinstance(found, Disturbed):
        return replace(found, base=_on_joints(found.base, joints))
    if isinstance(found, Walk):
        return found.on_joints(joints)
    if isinstance(found, Recorded):
        return found.on_joints(tuple(joints))
    return found
