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

from cc_mujoco.diagnosis.data.lever import Lever, only, shaped, swept
from cc_mujoco.engine import from_mjcf, route_tendon, to_mjcf
from cc_mujoco.engine.course import course_of, movers
from cc_mujoco.errors import CableError
from cc_mujoco.page import listed
from cc_mujoco.transmission import Cable
from cc_mujoco.transmission.led import CoupledPath

Leading = Literal["", "bent", "open", "mixed"]
"""What the joint moves of a cable: its end only, the bends of its conduit, or pieces in
the open, all of it or behind a conduit."""
OPEN = ("open", "mixed")
ANGLES = 2001
"""Angles at which a path is known."""


def leading(cable: Cable) -> Leading:
    """Return what a joint may move of a cable."""
    if cable.path == "mixed":
        return "mixed"
    if cable.path == "open":
        return "open"
    return "bent" if cable.bend == "route" else ""


def ties(model: mujoco.MjModel, name: str, cable: Cable, tendon: str) -> bool:
    """Return whether a cable that ends at a tendon is tied to its own path's end."""
    if leading(cable) not in OPEN:
        return False
    return route_tendon(model, name) == int(model.tendon(tendon).id)


def tied(model: mujoco.MjModel, name: str, where: str) -> tuple[str, float, Lever]:
    """The joint that an open path turns, its arm at 0 [m], and the path as a lever.

    Raises:
        CableError: the path moves with no joint, with several or with one that is no
            hinge, or it has no arm at 0.
    """
    joint = only(model, movers(model, name), f"{where} lies along a path that")
    angles = swept(model, joint, ANGLES)
    reach = course_of(model, name, joint, angles).reach
    arms = np.gradient(reach, angles)
    arm = float(np.interp(0.0, angles, arms))
    radius, lever = shaped(angles, reach, arms, arm, where)
    return joint, radius, lever


def require_led(model: mujoco.MjModel, name: str, joint: str, where: str) -> None:
    """See to it that no joint but the one that a cable turns moves its path.

    Raises:
        CableError: another one does.
    """
    others = [each for each in movers(model, name) if each != joint]
    if others:
        raise CableError(
            f"{where} lies along a route that moves with {listed(others)}; a diagnosis "
            f"takes a route that only the joint it turns moves, {joint!r}"
        )


class CoupledScene(NamedTuple):
    """Scene whose paths are tabulated.

    Attributes:
        path: of the scene.
        sha256: of its text.
        names: of its cables.
        joint: that moves them.
        low: least angle of the joint in the data [rad].
        high: largest.
        sign: of the scene's angle over that of the data.
    """

    path: str
    sha256: str
    names: tuple[str, ...]
    joint: str
    low: float
    high: float
    sign: float


@lru_cache(maxsize=16)
def courses(scene: CoupledScene, segments: int) -> tuple[CoupledPath, ...]:
    """Paths of the cables of a scene at the angles of the data."""
    spec = mujoco.MjSpec.from_file(scene.path)
    for name, cable in from_mjcf(spec).items():
        to_mjcf(spec, name, cable.replace(segments=segments))
    model = spec.compile()
    ends = sorted((scene.sign * scene.low, scene.sign * scene.high))
    angles = np.linspace(ends[0], ends[1], ANGLES)
    found = (course_of(model, name, scene.joint, angles) for name in scene.names)
    return tuple(found if scene.sign > 0.0 else map(_turned, found))


def _turned(course: CoupledPath) -> CoupledPath:
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
