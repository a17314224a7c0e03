"""Cables whose path a joint changes: moving bends of a conduit, and open pieces.

Paths come from the scene, tabulated over the joint's angle as the data count it:
positive where the cable pulls. If other joints move the cable as well, its path is
computed at every sample of a recording, see `RecordedPath`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, ClassVar, Literal, NamedTuple, cast

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.cable import Cable
from cc_mujoco.cable._coupled_route import CoupledPath
from cc_mujoco.datasets._channels import ANGLES, other_angle
from cc_mujoco.datasets._moment_arm import Lever, make_lever, single_hinge, swept_angles
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray
from cc_mujoco.plugin import from_mjcf, to_mjcf
from cc_mujoco.plugin._path_table import (
    compute_path_table,
    compute_recorded_path,
    moving_joints,
)
from cc_mujoco.plugin._spec import read_spec

Leading = Literal["", "bent", "open", "mixed"]
"""Part of a cable that the joint moves: "" for its end only, "bent" for the bends of
its conduit, "open" for an entirely open path, "mixed" for one with a conduit."""
OPEN_PATHS = ("open", "mixed")


def path_motion(cable: Cable) -> Leading:
    """Return the parts of a cable that a joint may move, see `Leading`."""
    if cable.path in ("mixed", "open"):
        return cast("Leading", cable.path)
    return "bent" if cable.bend == "route" else ""


def tied_joint(
    model: mujoco.MjModel, name: str, where: str, driven: str = ""
) -> tuple[str, float, Lever]:
    """Return the joint that an open path turns, its moment arm at 0 [m], and its lever.

    If several joints move the path, `driven` is the one of the axis. Raises
    `CableError`, which begins with `where`, if no hinge moves the path or the arm at 0
    is zero.
    """
    joint = single_hinge(
        model, moving_joints(model, name), f"{where} lies along a path that", driven
    )
    angles = swept_angles(model, joint, 2001)
    reach = compute_path_table(model, name, joint, angles).reach
    arms = np.gradient(reach, angles)
    arm = float(np.interp(0.0, angles, arms))
    radius, lever = make_lever(angles, reach, arms, arm, where)
    return joint, radius, lever


def other_movers(model: mujoco.MjModel, name: str, joint: str, where: str) -> list[str]:
    """Return the joints that move the path of the cable `name`, except `joint`.

    Raises `CableError` if one is no hinge or its angle has the name of another channel.
    """
    others = [each for each in moving_joints(model, name) if each != joint]
    for each in others:
        if model.joint(each).type[0] != mujoco.mjtJoint.mjJNT_HINGE:
            raise CableError(
                f"{where} lies along a path that moves with joint {each!r}, which is "
                "no hinge; lock it on the rig, and take its <joint> out of the scene"
            )
        if other_angle(each) in ANGLES:
            raise CableError(
                f"{where} lies along a path that moves with joint {each!r}, whose "
                f"column {other_angle(each)} is another one; rename the joint"
            )
    return others


class PullingCable(NamedTuple):
    name: str  # name of the cable
    others: tuple[str, ...]  # joints but the driven one that move its path
    friction: float  # coefficient of friction


def pulling_cables(
    model: mujoco.MjModel, joint: str, cables: Mapping[str, Cable], where: str
) -> list[PullingCable]:
    """Return those of `cables`, which belong to other axes, that pull at a joint."""
    return [
        PullingCable(
            name,
            tuple(other_movers(model, name, joint, f"{where}: cable {name}")),
            cable.friction,
        )
        for name, cable in cables.items()
        if joint in moving_joints(model, name, pulled=True)
    ]


class CoupledScene(NamedTuple):
    path: str  # MJCF file of the scene
    sha256: str  # digest of its text
    names: tuple[str, ...]  # cables of the axis
    joint: str  # joint that moves the paths
    low: float  # smallest angle of the joint in the data [rad]
    high: float  # largest angle of the joint in the data [rad]
    sign: float  # sign of the scene's angle relative to that of the data


@dataclass(eq=False)
class RecordedPath:
    """The paths of cables along recorded angles of all joints that move them.

    The recorded angle of the driven joint has an unknown offset, delay and noise, so a
    fit asks for paths at slightly different angles. Paths are therefore tabulated along
    the recording with this joint shifted by multiples of `aside`, and interpolated.
    Twice `ramp` rows precede the samples: the way from the pose of the scene to the
    first sample, then a stay there.
    """

    scene: CoupledScene
    others: tuple[str, ...]  # joints besides the driven one
    joint: FloatArray  # (samples,) of the driven joint, in the count of the data [rad]
    # (others, samples) of the other joints, in the count of the scene [rad]
    angles: FloatArray
    # rows in which the joints go to the first sample, and stay there as long
    ramp: int = 0
    # step of the driven joint's deviations from its recorded angle [rad]
    aside: ClassVar[float] = 0.02
    _known: dict[tuple[int, int], tuple[CoupledPath, ...]] = field(
        default_factory=dict, init=False
    )

    @cached_property
    def _share(self) -> FloatArray:
        """Fraction (rows,) of the way from the scene's pose to the recorded one."""
        ahead = np.linspace(0.0, 1.0, self.ramp + 1)[:-1]
        return np.concatenate([ahead, np.ones(self.ramp + self.joint.size)])

    def thinned(self, every: int) -> "RecordedPath":
        joint, angles = self.joint[::every].copy(), self.angles[:, ::every].copy()
        return replace(self, joint=joint, angles=angles)

    def with_lead_in(self, signal: FloatArray) -> FloatArray:
        """Return a signal (samples,) preceded by its rise from 0 in the lead-in."""
        start = np.full(2 * self.ramp, signal[0])
        return np.asarray(self._share * np.concatenate([start, signal]))

    def along(self, joint: FloatArray, segments: int) -> tuple[CoupledPath, ...]:
        """Return each cable's path by row, at joint angles (samples,) [rad]."""
        aside = np.clip(joint - self.joint, -0.5, 0.5)
        aside = np.concatenate([np.full(2 * self.ramp, aside[0]), aside])
        steps = np.floor(aside / self.aside).astype(int)
        share = aside / self.aside - steps
        parts = [(k, np.flatnonzero(steps == k)) for k in np.unique(steps).tolist()]

        def joined(cable: int, ahead: int) -> CoupledPath:
            return _joined(
                [(r, self._tabulated(segments, k + ahead)[cable]) for k, r in parts]
            )

        turn = self.aside * self._share
        return tuple(
            _between(joined(cable, 0), joined(cable, 1), share, turn)
            for cable in range(len(self.scene.names))
        )

    def _tabulated(self, segments: int, step: int) -> tuple[CoupledPath, ...]:
        """Return the paths with the driven joint shifted by `step * aside` [rad]."""
        key = segments, step
        if key not in self._known:
            scene = self.scene
            model = _model_of(scene, segments)
            angles = {}
            for name, angle in zip(self.others, self.angles, strict=True):
                rest = float(model.qpos0[model.joint(name).qposadr[0]])
                angles[name] = rest + self.with_lead_in(angle - rest)
            turned = self.with_lead_in(self.joint + self.aside * step)
            poses = _poses(model, scene, turned, angles)
            found = []
            for name in scene.names:
                course = compute_recorded_path(model, name, scene.joint, poses)
                if scene.sign < 0.0:  # slopes by an angle that counts the other way
                    assert course.gain is not None and course.arm is not None
                    course = replace(course, gain=-course.gain, arm=-course.arm)
                found.append(course)
            self._known[key] = tuple(found)
        return self._known[key]


def _poses(
    model: mujoco.MjModel,
    scene: CoupledScene,
    joint: FloatArray,
    others: Mapping[str, FloatArray],
) -> FloatArray:
    """Return `qpos` (samples, nq) with these joint angles [rad] in the scene's pose."""
    poses = np.tile(model.qpos0, (joint.size, 1))
    place = int(model.joint(scene.joint).qposadr[0])
    poses[:, place] = scene.sign * np.clip(joint, scene.low, scene.high)
    for name, angle in others.items():
        poses[:, int(model.joint(name).qposadr[0])] = angle
    return poses


def pulling_torque(
    scene: CoupledScene, cable: PullingCable, joint: FloatArray,
    others: Mapping[str, FloatArray], proximal: FloatArray | None,
    distal: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return bounds of the torque of another axis's cable at the joint [N m].

    Over a bend of angle `wrap` friction changes a tension T at most to T exp(+-friction
    wrap); this bounds the tension along the cable by those measured at its ends.
    `joint` (samples,) [rad] counts as in the data, `others` are angles by joint,
    `proximal` and `distal` are end tensions (samples,) [N], one of which may be None.
    """
    model = _model_of(scene, 0)
    poses = _poses(model, scene, joint, others)
    course = compute_recorded_path(model, cable.name, scene.joint, poses)
    assert course.gain is not None and course.arm is not None
    bent = np.cumsum(course.wrap, axis=1)
    bent = np.concatenate([np.zeros((joint.size, 1)), bent], axis=1)
    low, high = np.zeros(bent.shape), np.full(bent.shape, np.inf)
    ends = (proximal, bent), (distal, bent[:, -1:] - bent)
    for tension, between in ends:
        if tension is not None:
            taut = np.maximum(tension, 0.0)[:, None]
            low = np.maximum(low, taut * np.exp(-cable.friction * between))
            high = np.minimum(high, taut * np.exp(cable.friction * between))
    # By noise the ends may differ by more than friction can make of it.
    low, high = np.minimum(low, high), np.maximum(low, high)
    gain = course.gain.copy()
    gain[:, -1] += course.arm
    arms = -scene.sign * gain
    pulls, pushes = np.maximum(arms, 0.0), np.minimum(arms, 0.0)
    return (
        (pulls * low + pushes * high).sum(axis=1),
        (pulls * high + pushes * low).sum(axis=1),
    )


_BY_ROW = ("wrap", "contact", "gained", "distal", "length")
"""Arrays of a path by row, besides the slopes."""


def _joined(parts: Sequence[tuple[NDArray[np.intp], CoupledPath]]) -> CoupledPath:
    first = parts[0][1]
    if len(parts) == 1:
        return first
    made = {name: getattr(first, name).copy() for name in (*_BY_ROW, "gain", "arm")}
    for rows, course in parts[1:]:
        for name, values in made.items():
            if len(values):  # the lengths of a conduit are those of its sections
                values[rows] = getattr(course, name)[rows]
    return replace(first, **made)


def _between(
    here: CoupledPath, there: CoupledPath, share: FloatArray, turn: FloatArray
) -> CoupledPath:
    """Return a path between `here` and `there`, its displacements by Hermite cubics.

    `share` (rows,) is the position between them, 0 `here` and 1 `there`; `turn` (rows,)
    is the change of the joint's angle from `here` to `there` [rad].
    """

    def linear(name: str) -> FloatArray:
        a, b = getattr(here, name), getattr(there, name)
        part = share if a.ndim == 1 else share[:, None]
        return np.asarray(a + part * (b - a))

    def hermite(name: str, slopes: str) -> FloatArray:
        a, slope = getattr(here, name), getattr(here, slopes)
        rise, end = getattr(there, name) - a, getattr(there, slopes)
        part, angle = (x if a.ndim == 1 else x[:, None] for x in (share, turn))
        bend = (1.0 - part) * (angle * slope - rise) - part * (angle * end - rise)
        return np.asarray(a + part * rise + part * (1.0 - part) * bend)

    made: dict[str, Any] = {n: linear(n) for n in ("wrap", "contact", "gain", "arm")}
    made |= {"gained": hermite("gained", "gain"), "distal": hermite("distal", "arm")}
    made["length"] = linear("length") if here.open else here.length
    return replace(here, **made)


@lru_cache(maxsize=16)
def _model_of(scene: CoupledScene, segments: int) -> mujoco.MjModel:
    """Return the scene's model with `segments` segments per cable; 0 keeps its own."""
    spec = read_spec(scene.path)
    for name, cable in from_mjcf(spec).items():
        if segments and name in scene.names:
            to_mjcf(spec, name, cable.replace(segments=segments))
    return spec.compile()


@lru_cache(maxsize=16)
def path_tables(scene: CoupledScene, segments: int) -> tuple[CoupledPath, ...]:
    """Return each cable's path over the joint's range, in the sign of the data."""
    model = _model_of(scene, segments)
    ends = sorted((scene.sign * scene.low, scene.sign * scene.high))
    angles = np.linspace(ends[0], ends[1], 2001)
    found = []
    for name in scene.names:
        course = compute_path_table(model, name, scene.joint, angles)
        if scene.sign < 0.0:  # over angles that count the other way
            back = {each: getattr(course, each)[::-1].copy() for each in _BY_ROW}
            course = replace(course, joint=-course.joint[::-1], **back)
        found.append(course)
    return tuple(found)
