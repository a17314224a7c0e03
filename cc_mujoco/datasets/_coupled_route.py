"""Cables that the joint leads: bends that move with it, and pieces in the open.

The scene's own path, at every angle of the joint, in the angles of the data: positive
where the cable pulls.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Literal, NamedTuple

import mujoco
import numpy as np

from cc_mujoco.cable import Cable
from cc_mujoco.cable._coupled_route import CoupledPath
from cc_mujoco.datasets._moment_arm import Lever, make_lever, single_hinge, swept_angles
from cc_mujoco.errors import CableError
from cc_mujoco.plugin import from_mjcf, route_tendon, to_mjcf
from cc_mujoco.plugin._path_table import compute_path_table, moving_joints
from cc_mujoco.report._html import list_words

Leading = Literal["", "bent", "open", "mixed"]
"""Part of a cable that the joint moves: "" for its end only, "bent" for the bends of
its conduit, "open" for an entirely open path, "mixed" for one with a conduit."""
OPEN_PATHS = ("open", "mixed")
ANGLE_COUNT = 2001
"""Number of joint angles at which a path is sampled."""


def path_motion(cable: Cable) -> Leading:
    """Return which parts of a cable a joint may move."""
    if cable.path == "mixed":
        return "mixed"
    if cable.path == "open":
        return "open"
    return "bent" if cable.bend == "route" else ""


def is_tied_to_path(
    model: mujoco.MjModel, name: str, cable: Cable, tendon: str
) -> bool:
    """Return whether a cable ends at the tendon that draws its own path."""
    if path_motion(cable) not in OPEN_PATHS:
        return False
    return route_tendon(model, name) == int(model.tendon(tendon).id)


def tied_joint(
    model: mujoco.MjModel, name: str, where: str
) -> tuple[str, float, Lever]:
    """Return the joint that an open path turns, its moment arm at 0 [m], and its lever.

    Raises:
        CableError: the path moves with no joint, with several or with one that is no
            hinge, or it has no arm at 0.
    """
    joint = single_hinge(
        model, moving_joints(model, name), f"{where} lies along a path that"
    )
    angles = swept_angles(model, joint, ANGLE_COUNT)
    reach = compute_path_table(model, name, joint, angles).reach
    arms = np.gradient(reach, angles)
    arm = float(np.interp(0.0, angles, arms))
    radius, lever = make_lever(angles, reach, arms, arm, where)
    return joint, radius, lever


def require_single_mover(
    model: mujoco.MjModel, name: str, joint: str, where: str
) -> None:
    """Require that only the joint that a cable turns moves its path.

    Raises:
        CableError: another one does.
    """
    others = [each for each in moving_joints(model, name) if each != joint]
    if others:
        raise CableError(
            f"{where} lies along a route that moves with {list_words(others)}; a "
            f"diagnosis takes a route that only the joint it turns moves, {joint!r}: "
            "lock the others on the rig, and take their <joint> out of the scene"
        )


class CoupledScene(NamedTuple):
    """Scene whose paths are tabulated.

    Attributes:
        path: MJCF file of the scene.
        sha256: digest of its text.
        names: names of its cables.
        joint: joint that moves the paths.
        low: smallest angle of the joint in the data [rad].
        high: largest angle of the joint in the data [rad].
        sign: sign of the scene's angle relative to that of the data.
    """

    path: str
    sha256: str
    names: tuple[str, ...]
    joint: str
    low: float
    high: float
    sign: float


@lru_cache(maxsize=16)
def path_tables(scene: CoupledScene, segments: int) -> tuple[CoupledPath, ...]:
    """Return the paths of the cables of a scene at the angles of the data."""
    spec = mujoco.MjSpec.from_file(scene.path)
    for name, cable in from_mjcf(spec).items():
        to_mjcf(spec, name, cable.replace(segments=segments))
    model = spec.compile()
    ends = sorted((scene.sign * scene.low, scene.sign * scene.high))
    angles = np.linspace(ends[0], ends[1], ANGLE_COUNT)
    found = (
        compute_path_table(model, name, scene.joint, angles) for name in scene.names
    )
    return tuple(found if scene.sign > 0.0 else map(_reverse_angles, found))


def _reverse_angles(course: CoupledPath) -> CoupledPath:
    """Return the same course over angles that count the other way."""
    return replace(
        course,
        joint=-course.joint[::-1],
        wrap=course.wrap[::-1].copy(),
        contact=course.contact[::-1].copy(),
        length=course.length[::-1].copy(),
        gained=course.gained[::-1].copy(),
        distal=course.distal[::-1].copy(),
    )
