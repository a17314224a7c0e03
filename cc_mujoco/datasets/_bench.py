"""The rig as a scene describes it: cables, pulleys and the two joints they connect."""

import hashlib
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from cc_mujoco.assets import SCENES
from cc_mujoco.cable import Cable, Driven, Transmission
from cc_mujoco.cable._coupled_route import CoupledCables, CoupledPath
from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._coupled_route import (
    OPEN_PATHS,
    CoupledScene,
    Leading,
    PullingCable,
    RecordedPath,
    other_movers,
    path_motion,
    path_tables,
    pulling_cables,
    tied_joint,
)
from cc_mujoco.datasets._moment_arm import Lever, lever_of, swept_angles
from cc_mujoco.datasets._rig_table import RATIO_KEY, MomentArm, known_arm
from cc_mujoco.datasets._trials import Constant
from cc_mujoco.device import load_device
from cc_mujoco.device._derivation import excursion, known_torque_noise
from cc_mujoco.device._device_files import locate
from cc_mujoco.device._model import joint_range
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray
from cc_mujoco.plugin import from_mjcf, route_tendon
from cc_mujoco.plugin._engine import PLUGIN
from cc_mujoco.plugin._spec import compile_spec, no_cable, read_spec


@dataclass(frozen=True)
class Bench:
    """One or two cables between a motor's joint and an output joint.

    The cables' own torque and angle at the output joint count positive where `names[0]`
    pulls.
    """

    path: Path  # path of the scene
    sha256: str  # SHA-256 of its text
    names: tuple[str, ...]  # plugin instances, first the one that pulls positive
    cables: tuple[Cable, ...]  # configured cables, in the order of `names`
    motor: str  # name of the motor's joint
    joint: str  # name of the output joint
    motor_radius: float  # radius of the motor's pulley [m]
    joint_radius: float  # radius of the joint's pulley, or arm of its lever at 0 [m]
    lever: Lever | None = None  # that the cable pulls in place of a pulley
    # Angle around the motor's pulley from the point where the agonist cable leaves it
    # to the point where the antagonist does [rad]
    exit_angle: float = math.pi
    led: Leading = ""  # parts of the cables that move with the joint, see `Leading`
    span: tuple[float, float] = (-math.inf, math.inf)  # valid joint angles [rad]
    drawn_radius: float = math.nan  # `joint_radius` before `[rig]` replaces it [m]
    axis: str = ""  # name of the axis of a device with several
    centre: float = 0.0  # joint angle about which a planned motion goes [rad]
    # Largest excursion of a planned motion from `centre` [rad]; infinite without stops
    reach: float = math.inf
    # Coefficients a, b of the moment arm 1 + a q + b q^2 over that at joint angle 0,
    # from `[rig] angle_pairs`; () without pairs
    arm: tuple[float, ...] = ()
    # True if both cable ends are fixed while a drum or the conduit moves, so that one
    # measured angle serves for both ends
    ends_held: bool = False
    # Standard deviation of the joint's torque sensor, 0 if unknown [N m]
    torque_noise: float = 0.0
    others: tuple[str, ...] = ()  # other joints that move the cables, and are recorded
    pulled_by: tuple[PullingCable, ...] = ()  # other axes' cables at the output joint
    stops: tuple[tuple[float, float], ...] = ()  # range of each of `others` [rad]
    strangers: tuple[str, ...] = ()  # cables of the scene that are not of this axis
    # By name of another axis's joint, the column of its angle in a log of the device
    angle_columns: Mapping[str, str] = field(default_factory=dict, hash=False)

    @property
    def transmission(self) -> Transmission:
        """The cables on two round pulleys; a lever is taken for one of its arm at 0."""
        return Transmission(self.cables, self.motor_radius, self.joint_radius)

    @property
    def profile(self) -> Lever | MomentArm | None:
        """The moment arm as a function of joint angle; None for a round pulley."""
        return MomentArm(self.arm) if self.arm else self.lever

    @property
    def tied(self) -> bool:
        """Return whether the joint is turned by a tendon in the open, not a pulley."""
        return self.led in OPEN_PATHS and self.lever is not None

    def courses(self, segments: int) -> tuple[CoupledPath, ...]:
        """Return each cable's path by joint angle; () if only cable ends move.

        Paths have `segments` segments. A cable in the open has at least those of the
        scene.
        """
        if not self.led:
            return ()
        return path_tables(self.coupled, max(segments, self.min_cable_segments))

    @property
    def coupled(self) -> CoupledScene:
        """Scene, cables and joint range from which paths are computed."""
        sign = 1.0 if self.lever is None else self.lever.sign
        return CoupledScene(
            str(self.path), self.sha256, self.names, self.joint, *self.span, sign
        )

    def recorded_path(
        self, joint: FloatArray, others: FloatArray, ramp: int = 0
    ) -> RecordedPath | None:
        """Return the cables' recorded paths; None if only the driven joint moves them.

        Angles are (samples,) and (others, samples) [rad]; for `ramp` see
        `RecordedPath`.
        """
        if not self.others:
            return None
        return RecordedPath(self.coupled, self.others, joint, others, ramp)

    def recorded_angles(self, with_torque: bool = True) -> dict[str, str]:
        """Return the column of the angle of every other joint that a trial must record.

        These joints move the cables or, `with_torque` of the joint measured, also the
        paths of other axes' cables, whose torque is subtracted from the measured one.
        """
        needed = dict.fromkeys(self.others)
        for cable in self.pulled_by if with_torque else ():
            needed |= dict.fromkeys(cable.others)
        plain = {joint: channels.other_angle(joint) for joint in needed}
        return plain | {j: c for j, c in self.angle_columns.items() if j in needed}

    @property
    def other_axes(self) -> tuple[str, ...]:
        """Names of the device's other axes, which are prefixes of their columns."""
        end = f".{channels.JOINT_ANGLE}"
        columns = self.angle_columns.values() if self.axis else ()
        return tuple(column.removesuffix(end) for column in columns)

    @property
    def min_cable_segments(self) -> int:
        """Least number of segments of a cable; that of the scene in the open."""
        return max(c.segments for c in self.cables) if self.led in OPEN_PATHS else 1

    def turned(self, joint: FloatArray, path: RecordedPath | None = None) -> FloatArray:
        """Return the angle by which a pulley of `joint_radius` winds as much cable.

        Angles are (samples,) [rad]; `path` is used where other joints move the cable
        too.
        """
        if path is not None:
            course = path.along(joint, self.min_cable_segments)[0]
            return np.asarray(-course.reach[2 * path.ramp :] / self.drawn_radius)
        return joint if self.profile is None else self.profile.turned(joint)

    def along_lead_in(self, path: RecordedPath) -> FloatArray:
        """Return the pulley angle (ramp + 1,) [rad] in the first half of a lead-in."""
        course = path.along(path.joint, self.min_cable_segments)[0]
        return np.asarray(-course.reach[: path.ramp + 1] / self.drawn_radius)

    def share(self, joint: FloatArray, path: RecordedPath | None = None) -> FloatArray:
        """Return the arm at joint angles over that at 0, (1,) if round; as `turned`."""
        if path is not None:
            course = path.along(joint, self.min_cable_segments)[0]
            return np.asarray(-course.slope[2 * path.ramp :] / self.drawn_radius)
        return np.ones(1) if self.profile is None else self.profile.share(joint)

    def following(
        self, joint: FloatArray, path: RecordedPath | None = None
    ) -> FloatArray:
        """Return the motor angle (samples,) [rad] at which cables keep their length."""
        ratio = self.joint_radius / self.motor_radius
        return np.asarray(ratio * self.turned(joint, path))

    def carried(self, motor: FloatArray) -> FloatArray:
        """Return the joint angle (samples,) [rad] at which cables keep their length.

        Without a round pulley it is clipped to angles of `profile`.
        """
        if self.profile is None:
            return np.asarray(self.motor_radius / self.joint_radius * motor)
        known = self.profile.joint
        return np.interp(motor, self.following(known), known)

    def replay(
        self, dt: float, motor_angle: FloatArray, joint_angle: FloatArray,
        others: FloatArray | None = None,
    ) -> Driven:  # fmt: skip
        """Simulate the cables of the scene, from rest, with both end angles prescribed.

        Args:
            dt: time between samples [s].
            motor_angle: (samples,) [rad].
            joint_angle: (samples,) [rad].
            others: (others, samples) of the other joints [rad]; None leaves them where
                they are in the scene.
        """
        segments = max(cable.segments for cable in self.cables)
        if others is not None and self.others:
            path = RecordedPath(self.coupled, self.others, joint_angle, others)
            courses = path.along(joint_angle, segments)
            places = np.arange(joint_angle.size, dtype=np.float64)
        else:
            courses, places = self.courses(segments), joint_angle
        if courses:
            drive = CoupledCables(self.cables, courses, self.motor_radius)
            played = drive.replay(dt, motor_angle=motor_angle, joint_angle=places)
            return replace(played, joint_angle=joint_angle)
        played = self.transmission.replay(
            dt, motor_angle=motor_angle, joint_angle=self.turned(joint_angle)
        )
        if self.profile is None:
            return played
        share = self.share(joint_angle)
        return replace(
            played, joint_angle=joint_angle, joint_torque=played.joint_torque * share
        )

    def known(self, constants: Mapping[str, Constant]) -> "Bench":
        """Return the bench with constants of `[rig]` in place of those of the scene.

        Args:
            constants: constants of `[rig]`, see `RIG_CONSTANTS`.

        Raises:
            CableError: `joint_radius` or `angle_pairs` is given, but the scene's tendon
                already defines the moment arm.
        """
        if self.tied and "joint_radius" in constants:
            raise CableError(
                "[rig] joint_radius is of a pulley, and in scene "
                f"{self.path} the path of cable {self.names[0]} is the arm at joint "
                f"{self.joint!r}; take it out, or correct the sites of that path"
            )
        arm = known_arm(constants)
        if arm and (self.lever is not None or self.led):
            raise CableError(
                f"scene {self.path} has the moment arm at joint {self.joint!r}; leave "
                "[rig] angle_pairs out, or give a scene with pulleys"
            )
        value = {name: constant.value for name, constant in constants.items()}
        of_cables = ("pretension", "axial_stiffness", "friction")
        cable = {name: value[name] for name in of_cables if name in value}
        return replace(
            self,
            cables=tuple(given.replace(**cable) for given in self.cables),
            motor_radius=(motor := value.get("motor_radius", self.motor_radius)),
            joint_radius=motor * value[RATIO_KEY]
            if arm
            else value.get("joint_radius", self.joint_radius),
            arm=arm,
            exit_angle=value.get("exit_angle", self.exit_angle),
        )

    @classmethod
    def of(
        cls,
        scene: str | Path,
        axis: str | None = None,
        cables: Collection[str] | None = None,
        driven: str = "",
    ) -> "Bench":
        """Read a bench from a scene.

        Args:
            scene: MJCF file, file of a description, or name of a built-in scene.
            axis: name of the axis, of a device with several.
            cables: names of the cables, in place of an axis.
            driven: joint that the cables drive, if several joints move them.

        Raises:
            CableError: the scene cannot be read, has several axes of which none is
                named, has no cable or more than two of the axis, or these do not
                connect the same two hinge joints.
        """
        source: str | Path = str(scene) if str(scene) in SCENES else Path(scene)
        _, path, table = locate(source)
        spec = read_spec(path)
        model = compile_spec(spec, path)
        present = from_mjcf(spec)
        if not present:
            raise no_cable(path)
        described, torque_noise, columns = None, 0.0, {}
        if cables is None and (axis or table or len(present) > 2):
            device = load_device(source).description
            described = device.axis(axis)
            axis = described.name if len(device.axes) > 1 else ""
            cables = described.cables
            driven = described.joint
            columns = {
                other.joint: f"{other.name}.{channels.JOINT_ANGLE}"
                for other in device.axes
                if other.name != axis
            }
            torque_noise = known_torque_noise(device)
        cables = {n: c for n, c in present.items() if cables is None or n in cables}
        if len(cables) not in (1, 2):
            where = f"axis {axis!r} of scene {path}" if axis else f"scene {path}"
            raise CableError(
                f"{where} has {len(cables)} cables; a diagnosis takes one cable "
                f"or a pull-pull pair (plugin `{PLUGIN}`)"
            )
        found = {
            name: _cable_connections(spec, model, path, name, cable, driven)
            for name, cable in cables.items()
        }
        if len({ends.motor for ends in found.values()}) > 1:
            _require_axis(source)
        # Positive motor rotation draws the agonist towards the motor: negative gear.
        order = sorted(found, key=lambda name: found[name].proximal)
        motor, proximal, joint, distal, lever = found[order[0]]
        neutral = float(model.joint(joint).qpos0[0])
        if lever is not None and neutral != 0.0:
            raise CableError(
                f"scene {path}: joint {joint!r} has `ref`, so its angle is "
                f"{neutral:.4g} rad where the cable has its pretension; of a lever a "
                "diagnosis takes that pose as 0: take `ref` out, and give the "
                "difference as `offset` of its column in dataset.toml"
            )
        kinds = {path_motion(cable) for cable in cables.values()}
        if len(kinds) > 1:
            raise CableError(
                f"scene {path}: its two cables are led unlike each other (`path` or "
                "`bend`); a diagnosis takes a pull-pull pair of like cables"
            )
        (led,) = kinds
        moved: dict[str, None] = {}
        for name in order if led or lever is not None else ():
            where = f"scene {path}: cable {name}"
            others = other_movers(model, name, found[name].joint, where)
            moved |= dict.fromkeys(others)
        if moved and lever is None:
            raise CableError(
                f"scene {path}: cable {order[0]} ends on a pulley and lies along a "
                f"route that moves with {', '.join(moved)} as well; a diagnosis "
                "follows other joints only where a cable ends at a tendon: lock them "
                "on the rig, and take their <joint> out of the scene"
            )
        if moved and not led:
            led = "bent"
        strangers = {n: cable for n, cable in present.items() if n not in order}
        segments = {cable.segments for cable in cables.values()}
        if led and len(segments) > 1:
            raise CableError(
                f"scene {path}: its two cables have unlike `segments`; give them as "
                "many each"
            )
        if len(order) == 2 and any(ends.lever for ends in found.values()):
            raise CableError(
                f"scene {path} has two cables, and {order[0] if lever else order[1]} "
                "pulls a lever; a diagnosis takes one cable to a lever, or a pull-pull "
                "pair on pulleys"
            )
        signs = [(found[n].proximal < 0.0, found[n].distal < 0.0) for n in order]
        wanted = [(True, True), (False, False)][: len(order)]
        if signs != wanted:
            raise CableError(
                f"scene {path}: the gears of its cables have signs that do not let "
                "positive motor rotation pull the joint positive; the agonist has both "
                "gears negative, the antagonist both positive"
            )
        for name in order[1:]:
            if (found[name].motor, found[name].joint) != (motor, joint):
                raise CableError(
                    f"scene {path}: cables {order[0]} and {name} connect different "
                    "joints; a pull-pull pair has both in common"
                )
            if (-found[name].proximal, -found[name].distal) != (proximal, distal):
                raise CableError(
                    f"scene {path}: cables {order[0]} and {name} have pulleys of "
                    "different radii; a pull-pull pair shares both pulleys"
                )
        index = model.joint(joint).id
        centre, reach = excursion(model, index)
        if not model.jnt_limited[index]:
            reach = math.inf
        elif described is not None:
            centre, reach = described.centre, described.reach
        centre = (1.0 if lever is None else lever.sign) * centre + 0.0
        known = swept_angles(model, joint) if lever is None else lever.joint
        return cls(
            path,
            hashlib.sha256(path.read_bytes()).hexdigest(),
            tuple(order),
            tuple(cables[name] for name in order),
            motor,
            joint,
            motor_radius=abs(proximal),
            joint_radius=abs(distal),
            lever=lever,
            led=led,
            others=tuple(moved),
            pulled_by=tuple(pulling_cables(model, joint, strangers, f"scene {path}")),
            stops=tuple(joint_range(model, other) for other in moved),
            strangers=tuple(strangers),
            angle_columns=columns,
            span=(float(known[0]), float(known[-1])),
            drawn_radius=abs(distal),
            axis=axis or "",
            torque_noise=torque_noise,
            centre=centre,
            reach=reach,
        )


def _require_axis(source: str | Path) -> None:
    try:
        device = load_device(source).description
    except CableError:
        return
    device.axis()


class _Ends(NamedTuple):
    """Joint and gear [m] at both ends of a cable; a lever's gear is its arm at 0."""

    motor: str
    proximal: float
    joint: str
    distal: float
    lever: Lever | None


def _cable_connections(
    spec: mujoco.MjSpec, model: mujoco.MjModel, path: Path, name: str, cable: Cable,
    driven: str,
) -> _Ends:  # fmt: skip
    """Return joint and gear at each end; if several joints move it, take `driven`."""
    ends: list[tuple[str, float]] = []
    lever = None
    for actuator in spec.actuators:
        if actuator.plugin.name != name:
            continue
        if ends and actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON:
            where = f"scene {path}: cable {name}"
            gear, tendon = float(actuator.gear[0]), str(actuator.target)
            row = int(model.tendon(tendon).id)
            if path_motion(cable) in OPEN_PATHS and route_tendon(model, name) == row:
                turned, arm, lever = tied_joint(model, name, where, driven)
            else:
                turned, arm, lever = lever_of(model, tendon, gear, where, driven)
            ends.append((turned, -arm))
            continue
        joint = spec.joint(actuator.target)
        hinge = joint is not None and joint.type == mujoco.mjtJoint.mjJNT_HINGE
        if actuator.trntype != mujoco.mjtTrn.mjTRN_JOINT or not hinge:
            raise CableError(
                f"scene {path}: cable {name} ends at {actuator.target!r}; a diagnosis "
                "needs its proximal end on the pulley of a hinge joint, and its distal "
                "end on another or on a lever"
            )
        ends.append(
            (driven_joint(model, str(actuator.target)), float(actuator.gear[0]))
        )
    (motor, proximal), (output, distal) = ends
    return _Ends(motor, proximal, output, distal, lever)


def driven_joint(model: mujoco.MjModel, joint: str) -> str:
    """Return the joint that a pulley with play drives, else the joint itself.

    Play is a limited fixed tendon whose length is the pulley angle less the joint's.
    """
    pulley = model.joint(joint).id
    for tendon in np.flatnonzero(model.tendon_limited):
        first, count = model.tendon_adr[tendon], model.tendon_num[tendon]
        wraps = slice(first, first + count)
        if count != 2 or (model.wrap_type[wraps] != mujoco.mjtWrap.mjWRAP_JOINT).any():
            continue
        ends, coefficients = model.wrap_objid[wraps], model.wrap_prm[wraps]
        if ends[0] == pulley and coefficients[0] == -coefficients[1]:
            return str(model.joint(int(ends[1])).name)
    return joint
