"""A Bowden drive for a joint of any model.

>>> import mujoco
>>> import cc_mujoco
>>> spec = mujoco.MjSpec.from_string('''<mujoco><worldbody>
...   <body name="pelvis"><geom size=".1"/>
...     <body name="thigh" pos="0 0 -.1"><geom size=".05" fromto="0 0 0 0 0 -.3"
...         type="capsule"/>
...       <body name="shank" pos="0 0 -.4"><joint name="knee" axis="0 -1 0"/>
...         <geom size=".04" fromto="0 0 0 0 0 -.3" type="capsule"/></body>
...     </body></body></worldbody></mujoco>''')
>>> route = [("pelvis", (-.1, 0, .1)), ("pelvis", (0, .1, 0)), ("thigh", (.08, 0, -.2))]
>>> report = cc_mujoco.add_cable(
...     spec, "extensor", motor="pelvis", drum=0.03, torque_limit=10.0,
...     joint="knee", pulley=0.06, route=route, friction=0.1, axial_stiffness=40e3)
>>> model = spec.compile()
>>> [model.actuator(i).name for i in range(model.nu)]
['extensor_motor', 'extensor_proximal', 'extensor_distal']
"""

import dataclasses
import itertools
import math
from collections.abc import Iterable, Sequence
from numbers import Real
from typing import Any, TypeAlias

import mujoco
import numpy as np

from cc_mujoco._utils.arguments import require_kind
from cc_mujoco.cable._cable import Cable, Section
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray
from cc_mujoco.plugin import _spec as specs
from cc_mujoco.plugin._engine import PLUGIN
from cc_mujoco.plugin._mjcf import to_mjcf
from cc_mujoco.plugin._readings import moments
from cc_mujoco.plugin._tendons.account import (
    ENDS,
    AddedCables,
    actuator_label,
    order_line,
)

Place: TypeAlias = str | mujoco.MjsSite | tuple[str | mujoco.MjsBody, Sequence[float]]
"""A site or its name, or a body or its name and a position in its frame [m]."""

ROTOR_INERTIA, ROTOR_DAMPING, MOTOR_MASS = 5e-3, 1e-2, 0.5
"""Default inertia [kg m^2], damping [N m s/rad] and mass [kg] of a new rotor."""

_HINGE, _SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
_AT_JOINT = mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT


@dataclasses.dataclass(frozen=True)
class _Site:
    """A site that exists, or one to be created on a body."""

    name: str
    body: str = ""
    position: tuple[float, ...] = ()


@dataclasses.dataclass(frozen=True)
class _Drive:
    """Arguments of `add_cable` by name, valid in a specification and its copies."""

    name: str
    joint: str
    drum: float
    pulley: float | None
    lever: _Site | None
    route: tuple[_Site, ...]
    motor: str = ""
    """Name of the existing joint that is the motor; empty for a new winch."""
    mount: _Site | None = None
    """Body and position of a new winch."""
    torque_limit: float = 0.0
    rotor_inertia: float = ROTOR_INERTIA
    rotor_damping: float = ROTOR_DAMPING
    motor_mass: float = MOTOR_MASS
    replace: int | None = None

    @property
    def drawn(self) -> bool:
        return len(self.route) > 1


def add_cable(
    spec: mujoco.MjSpec,
    name: str,
    *,
    motor: str | mujoco.MjsJoint | mujoco.MjsBody | Place,
    joint: str | mujoco.MjsJoint,
    drum: float,
    pulley: float | None = None,
    lever: Place | None = None,
    route: Iterable[Place] = (),
    conduit: str | Iterable[tuple[float, float]] | None = None,
    replace: str | int | None = None,
    torque_limit: float | None = None,
    rotor_inertia: float | None = None,
    rotor_damping: float | None = None,
    motor_mass: float | None = None,
    **parameters: Any,
) -> AddedCables:
    """Let a motor drive a joint through a cable in a conduit.

    Writes the cable `name` with its ends `<name>_proximal` and `<name>_distal`, and as
    far as needed: a winch (body, joint and geom `<name>_winch`, actuator
    `<name>_motor`), sites (`<name>_route_1` and on, `<name>_lever`), the tendon
    `<name>_route` that draws the conduit, and the free rope `<name>_rope`. These take
    no values from defaults of the model. In keyframes new joints are at rest.

    Args:
        spec: the specification to change.
        name: name of the cable.
        motor: joint that winds the cable up as it turns in the positive sense; or
            where to mount a new winch: a body, by default at the first point of the
            route if that is on it, or a body and a position [m].
        joint: hinge or slide that the cable drives.
        drum: radius on which the motor winds the cable [m]; negative if it winds the
            cable up as it turns in the negative sense.
        pulley: radius of a round pulley on the hinge `joint` [m], on which the cable
            pulls in the positive sense of the joint; negative for the negative sense.
        lever: instead, the site to which the rope runs freely from the last point of
            the route; it must be on the other side of the joint.
        route: points of the conduit from the motor to the joint.
        conduit: sections of the conduit, as pairs or text of length and bend radius
            [m]; by default the route bends the conduit (`bend` = `"route"`), which is
            as long as the route in the pose `qpos0`. With `bend="fixed"` and no
            `conduit` it keeps the bends that the route has in that pose.
        replace: actuator to delete, by its name or its index in `spec.actuators`: the
            motor without a cable that drove the joint.
        torque_limit: largest torque of a new winch [N m]; its control is its torque.
        rotor_inertia: inertia of its rotor about the drum [kg m^2], `ROTOR_INERTIA` by
            default.
        rotor_damping: its damping [N m s/rad], `ROTOR_DAMPING` by default.
        motor_mass: its mass [kg], `MOTOR_MASS` by default.
        parameters: other parameters of the cable, by name, see `Cable`; unless given
            they are those of `Cable()`.

    Returns:
        Report on the new elements, and on other actuators that drive the joint; its
        text is a line for each.

    Raises:
        CableError: a name is unknown or taken, pulley and lever are both given or both
            missing, the joint does not move the lever, there is neither a conduit nor
            a route to draw one, a sensor reads the actuator to replace, a number is out
            of its range, or the model does not compile. The specification is as before.
    """
    require_kind("spec", spec, mujoco.MjSpec)
    if not isinstance(name, str) or not name:
        raise CableError(f"name must be the name of the new cable, not {name!r}.")
    if any(p.plugin_name == PLUGIN and p.name == name for p in spec.plugins):
        raise CableError(
            f"cable {name!r} exists already; give the new one another name."
        )
    specs.require_parameters(parameters, ("route", "path", "mouth", "conduit"))
    if isinstance(route, str) or not isinstance(route, Iterable):
        raise CableError(
            f"cable {name!r}: route is {route!r}; it must be a list of sites, or of "
            "bodies with positions, e.g. [('pelvis', (0, 0, 0.1)), 'ankle']."
        )
    winch = {
        "torque_limit": torque_limit, "rotor_inertia": rotor_inertia,
        "rotor_damping": rotor_damping, "motor_mass": motor_mass,
    }  # fmt: skip
    points = tuple(
        _site(spec, place, f"route point {i}", f"{name}_route_{i}")
        for i, place in enumerate(route, start=1)
    )
    driven = _driven_joint(spec, joint, on_pulley=pulley is not None)
    drive = _Drive(
        name, joint=driven, drum=_radius("drum", drum),
        pulley=None if pulley is None else _radius("pulley", pulley),
        lever=None if lever is None else _site(spec, lever, "lever", f"{name}_lever"),
        route=points, replace=_replaced(spec, replace, driven),
        **_motor(spec, motor, points, winch),
    )  # fmt: skip
    if (pulley is None) == (lever is None):
        raise CableError(
            f"cable {name!r} needs either pulley=, the radius of a pulley on joint "
            f"{drive.joint!r}, or lever=, the site on which its rope pulls."
        )
    if lever is not None and not points:
        raise CableError(
            f"cable {name!r} has a lever but no route; its last point must be where "
            "the conduit ends and the free rope begins."
        )
    for i, (one, next_one) in enumerate(itertools.pairwise(points)):
        if one.name == next_one.name:
            raise _same_place(name, i)
    if conduit is None and not drive.drawn:
        raise CableError(
            f"cable {name!r} needs conduit=, e.g. '0.5:0.2 0.3:inf', or a route of at "
            "least two points that draws one."
        )
    model = specs.compile_spec(spec)  # from now on its keyframes follow what is added
    cable = _cable(spec, drive, conduit, parameters)
    tried = spec.copy()
    with specs.plain_errors():
        _write(tried, model, drive, cable)
    with specs.muted_warnings():
        after = specs.compile_spec(tried)
    _require_arm(after, drive)
    _write(spec, model, drive, cable)
    return _report(model, after, drive, cable)


def _report(
    before: mujoco.MjModel, after: mujoco.MjModel, drive: _Drive, cable: Cable
) -> AddedCables:
    name, winch, gone = drive.name, "", drive.replace
    lines = [
        f"cable {name!r}: friction {cable.friction:g}, of {cable.segments} segments, "
        f"{cable.length:.3g} m long, from the motor to joint {drive.joint!r}"
    ]
    if drive.mount is not None:
        winch = f"{name}_winch"
        place = int(after.joint(winch).qposadr[0])
        lines.append(
            f"new joint {winch!r} with motor '{name}_motor', at most "
            f"{drive.torque_limit:g} N m: number {place} in qpos, before those of "
            "joints further on in the tree"
        )
    else:
        lines.append(f"motor: joint {drive.motor!r}")
        if not _driving(after, drive.motor, name):
            lines.append(f"nothing but the cable turns joint {drive.motor!r} yet")
    if gone is not None:
        lines.append(f"{actuator_label(before, gone)}: deleted")
    if before.jnt_actfrclimited[before.joint(drive.joint).id]:
        what = "`actuatorfrcrange`, which would clamp the cable"
        lines.append(f"joint {drive.joint!r}: {what}, deleted")
    for i in _driving(after, drive.joint, name):
        servo = after.actuator_biastype[i] != mujoco.mjtBias.mjBIAS_NONE
        effect = "holds it against the cable" if servo else "adds its force"
        lines.append(
            f"{actuator_label(after, i)} drives joint {drive.joint!r} already, and "
            f"{effect}; replace= deletes one"
        )
    lines.append(order_line(after, [name], before.nu - (gone is not None)))
    return AddedCables((name,), winch, tuple(lines))


def _driving(model: mujoco.MjModel, joint: str, cable: str) -> list[int]:
    """Return the actuators with an arm at `joint`, except those of `cable`."""
    ends = [model.actuator(f"{cable}_{end}").id for end in ENDS]
    moving = np.flatnonzero(_arms(model, joint) > mujoco.mjMINVAL)
    return [int(i) for i in moving if i not in ends]


def _arms(model: mujoco.MjModel, joint: str) -> FloatArray:
    """Return the largest moment arm of every actuator at a joint (nactuator,) [m].

    Poses: `qpos0`, and seven of the joint in its range, or +-0.5 rad.
    """
    own = model.joint(joint)
    low, high = own.range if model.jnt_limited[own.id] else (-0.5, 0.5)
    poses = np.tile(model.qpos0, (8, 1))
    poses[1:, own.qposadr[0]] = np.linspace(low, high, 7)
    found = moments(model, mujoco.MjData(model), [*poses])
    arms = np.abs(found[:, model.actuator_outadr, own.dofadr[0]])
    return np.asarray(arms.max(axis=0))


def _cable(
    spec: mujoco.MjSpec,
    drive: _Drive,
    conduit: str | Iterable[tuple[float, float]] | None,
    parameters: dict[str, Any],
) -> Cable:
    given = dict(parameters)
    if drive.drawn:
        given["route"] = f"{drive.name}_route"
    if isinstance(conduit, str):
        where = f"cable {drive.name!r}"
        given["conduit"] = Cable.from_config({"conduit": conduit}, where).conduit
    elif conduit is not None:
        given["conduit"] = conduit
    else:
        drawn = spec.copy()
        with specs.plain_errors():
            _write_path(drawn, drive)
        model = specs.compile_spec(drawn)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        points = np.array([data.site(site.name).xpos for site in drive.route])
        sections = _drawn_sections(points, drive.name)
        if given.setdefault("bend", "route") == "route":
            length = sum(section.length for section in sections)
            wrap = sum(section.length / section.radius for section in sections)
            sections = (Section(length, length / wrap if wrap else math.inf),)
        given["conduit"] = sections
    return Cable(**given)


def _drawn_sections(points: FloatArray, cable: str) -> tuple[Section, ...]:
    """Return the sections of a conduit through `points` (P, 3) [m].

    The turn at a point is spread evenly from half-way to the point before it to
    half-way to the next.
    """
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    if not np.all(lengths > 0.0):
        raise _same_place(cable, int(np.argmin(lengths)))
    along = steps / lengths[:, None]
    turns = np.arctan2(
        np.linalg.norm(np.cross(along[:-1], along[1:]), axis=1),
        np.sum(along[:-1] * along[1:], axis=1),
    )
    sections = [Section(float(lengths[0]) / 2.0, math.inf)]
    for turn, length in zip(turns, (lengths[:-1] + lengths[1:]) / 2.0, strict=True):
        radius = float(length / turn) if turn > 1e-9 else math.inf
        sections.append(Section(float(length), radius))
    return (*sections, Section(float(lengths[-1]) / 2.0, math.inf))


def _same_place(cable: str, index: int) -> CableError:
    return CableError(
        f"points {index + 1} and {index + 2} of the route of cable {cable!r} are at "
        "the same place; every point must differ from the next."
    )


def _require_arm(model: mujoco.MjModel, drive: _Drive) -> None:
    """Raise a `CableError` if the joint does not change the length of the rope."""
    distal = model.actuator(f"{drive.name}_distal").id
    lever = drive.lever
    if lever is not None and _arms(model, drive.joint)[distal] < mujoco.mjMINVAL:
        sites = drive.route[-1].name, lever.name
        bodies = [model.body(model.site(site).bodyid[0]).name for site in sites]
        raise CableError(
            f"joint {drive.joint!r} does not move the rope of cable {drive.name!r}, "
            f"from body {bodies[0]!r} to body {bodies[1]!r}; the joint must lie "
            "between the last point of the route and the lever, and off their line."
        )


def _write(
    spec: mujoco.MjSpec, model: mujoco.MjModel, drive: _Drive, cable: Cable
) -> None:
    if drive.replace is not None:
        specs.delete_actuator(spec, model, drive.replace)
    _write_path(spec, drive)
    others = [a.target for a in spec.actuators if a.trntype in _AT_JOINT]
    if drive.joint not in others:  # it limited a motor, as `effort` in a URDF does
        spec.joint(drive.joint).actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
    motor = drive.motor
    if drive.mount is not None:
        motor = f"{drive.name}_winch"
        _write_winch(spec, drive, drive.mount, motor)
    # Cable that the motor winds up moves to proximal. So does what a pulley pays out as
    # it turns the way it is pulled.
    winding = (spec.joint(motor), -drive.drum)
    if drive.pulley is not None:
        distal = (spec.joint(drive.joint), -drive.pulley)
    else:
        distal = (spec.tendon(f"{drive.name}_rope"), 1.0)
    to_mjcf(spec, drive.name, cable, winding, distal)


def _write_path(spec: mujoco.MjSpec, drive: _Drive) -> None:
    for site in (*drive.route, drive.lever):
        if site is not None and site.body:
            at = {"name": site.name, "pos": site.position, "size": [0.004] * 3}
            specs.add_element(spec.body(site.body), "site", **at)
    paths = {"route": drive.route} if drive.drawn else {}
    if drive.lever is not None:
        paths["rope"] = (drive.route[-1], drive.lever)
    for kind, sites in paths.items():
        width, shade = (0.003, 0.1) if kind == "route" else (0.0015, 0.7)  # m, of grey
        tendon = specs.add_element(
            spec, "tendon", name=f"{drive.name}_{kind}", width=width,
            rgba=[shade, shade, shade, 1.0],
        )  # fmt: skip
        for site in sites:
            tendon.wrap_site(site.name)


def _write_winch(spec: mujoco.MjSpec, drive: _Drive, mount: _Site, name: str) -> None:
    """Write a motor with its drum, a cylinder about the y axis of its body."""
    radius, width, mass = abs(drive.drum), 0.02, drive.motor_mass
    about, across = 0.5 * mass * radius**2, mass * (radius**2 / 4.0 + width**2 / 12.0)
    body = spec.body(mount.body).add_body(name=name, pos=mount.position)
    body.explicitinertial = True
    body.mass, body.ipos, body.inertia = mass, [0.0] * 3, [across, about, across]
    specs.add_element(
        body, "joint", name=name, axis=[0.0, 1.0, 0.0],
        limited=mujoco.mjtLimited.mjLIMITED_FALSE, armature=drive.rotor_inertia,
        damping=[drive.rotor_damping, 0.0, 0.0],
    )  # fmt: skip
    # Its mass is for models that infer all inertias.
    specs.add_element(
        body, "geom", name=name, type=mujoco.mjtGeom.mjGEOM_CYLINDER, mass=mass,
        size=[radius, width / 2.0, 0.0], contype=0, conaffinity=0,
        quat=[math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0], rgba=[0.2, 0.2, 0.25, 1.0],
    )  # fmt: skip
    specs.add_element(
        spec, "actuator", name=f"{drive.name}_motor", trntype=mujoco.mjtTrn.mjTRN_JOINT,
        target=name, ctrllimited=mujoco.mjtLimited.mjLIMITED_TRUE,
        ctrlrange=[-drive.torque_limit, drive.torque_limit],
    )  # fmt: skip


def _name(kind: str, thing: Any, found: Iterable[Any]) -> str:
    name = thing if isinstance(thing, str) else getattr(thing, "name", None)
    if not name:
        raise CableError(
            f"{kind} must be given by name, or be an element that has one, not "
            f"{thing!r}."
        )
    elements = list(found)
    names = [x.name for x in elements if x.name]
    if name not in names:
        if elements and not names:
            raise CableError(
                f"unknown {kind} {name!r}: none of the {len(elements)} here has a "
                "name; give it one first."
            )
        raise CableError.unknown(kind, name, names)
    return str(name)


def _site(spec: mujoco.MjSpec, place: Any, what: str, name: str) -> _Site:
    if isinstance(place, str | mujoco.MjsSite):
        return _Site(_name("site", place, spec.sites))
    if isinstance(place, Sequence) and len(place) == 2:
        position = np.asarray(place[1], dtype=object)
        numbers = position.shape == (3,) and all(isinstance(x, Real) for x in position)
        if numbers and np.all(np.isfinite(position.astype(float))):
            body = _name("body", place[0], spec.bodies)
            return _Site(name, body, tuple(float(x) for x in position))
    raise CableError(
        f"{what} must be a site, or a body and a position in metres, e.g. "
        f"('pelvis', (0, 0.1, 0)), not {place!r}."
    )


def _motor(
    spec: mujoco.MjSpec,
    motor: Any,
    route: tuple[_Site, ...],
    winch: dict[str, float | None],
) -> dict[str, Any]:
    joints = [joint.name for joint in spec.joints if joint.name]
    bodies = [body.name for body in spec.bodies if body.name]
    label = motor if isinstance(motor, str) else getattr(motor, "name", None)
    named = isinstance(motor, str)
    is_joint = motor in joints if named else isinstance(motor, mujoco.MjsJoint)
    if named and is_joint and motor in bodies:
        raise CableError(
            f"motor {motor!r} is both a joint and a body; pass the element itself "
            "instead of its name."
        )
    given = {key: value for key, value in winch.items() if value is not None}
    if is_joint:
        name = _name("joint", motor, spec.joints)
        if spec.joint(name).type != _HINGE:
            raise CableError(
                f"motor must be a hinge, which turns a drum; joint {name!r} is none."
            )
        if given:
            raise CableError(
                f"{next(iter(given))} is that of a new winch, and joint {name!r} "
                "exists; change its actuator, or give a body as the motor."
            )
        return {"motor": name}
    if isinstance(motor, str | mujoco.MjsBody):
        if named and motor not in bodies:
            raise CableError.unknown("joint or body", motor, joints + bodies)
        on_it = route[:1] if route and route[0].body == label else ()
        position = on_it[0].position if on_it else (0.0, 0.0, 0.0)
        motor = (motor, position)
    mount = _site(spec, motor, "motor", "")
    if not mount.body:
        raise CableError(
            f"motor must be a joint, a body, or a body and a position, not {motor!r}."
        )
    if "torque_limit" not in given:
        raise CableError(
            f"the new winch on body {mount.body!r} needs torque_limit=, the largest "
            "torque of its motor in N m."
        )
    for key, value in given.items():
        least = "above" if key != "rotor_damping" else "of at least"
        number = isinstance(value, Real) and math.isfinite(value)
        if not number or value < 0.0 or (value == 0.0 and key != "rotor_damping"):
            raise CableError(f"{key} must be a number {least} 0, not {value!r}.")
    return {"mount": mount, **{key: float(value) for key, value in given.items()}}


def _driven_joint(spec: mujoco.MjSpec, joint: Any, on_pulley: bool) -> str:
    name = _name("joint", joint, spec.joints)
    kind = spec.joint(name).type
    if kind != _HINGE and (on_pulley or kind != _SLIDE):
        what = "a hinge, which turns a pulley" if on_pulley else "a hinge or a slide"
        raise CableError(f"joint must be {what}, and joint {name!r} is none.")
    return name


def _radius(what: str, radius: Any) -> float:
    number = isinstance(radius, Real) and math.isfinite(radius)
    if not number or not 0.0 < abs(radius) < 1.0:  # larger ones are in millimetres
        raise CableError(
            f"{what} must be a radius in metres below 1, and not 0, e.g. {what}=0.03, "
            f"not {radius!r}."
        )
    return float(radius)


def _replaced(spec: mujoco.MjSpec, actuator: Any, driven: str) -> int | None:
    if actuator is None:
        return None
    if isinstance(actuator, mujoco.MjsActuator):
        actuator = actuator.name or actuator.id
    found = specs.find_element("actuator", actuator, spec.actuators)
    if found.trntype not in _AT_JOINT or found.target != driven:
        here = [
            a.name or str(i) for i, a in enumerate(spec.actuators) if a.target == driven
        ]
        others = f"; at it are {', '.join(here)}" if here else "; nothing is at it"
        raise CableError(
            f"replace must be an actuator at joint {driven!r}, and {actuator!r} pulls "
            f"{found.target!r}{others}."
        )
    for sensor in spec.sensors:
        reads = sensor.objtype == mujoco.mjtObj.mjOBJ_ACTUATOR
        if reads and found.name and sensor.objname == found.name:
            raise CableError(
                f"sensor {sensor.name!r} reads actuator {found.name!r}, which replace "
                "would delete; delete the sensor first."
            )
    return list(spec.actuators).index(found)
