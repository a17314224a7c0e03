"""Model of a design: the scene, changed where the design says so.

    builder = Builder("wrist")
    model = builder.model({"friction": 0.1, "loops": 2})

A design changes what the physics sees. The drawing keeps its pulleys and its route.
Pulleys are solid discs of the scene's width: their inertia goes with radius^4, half of
it to either of two cables. A lever keeps its inertia.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from functools import cache, cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco import engine
from cc_mujoco.assets import scene_path
from cc_mujoco.bare import left, routes, strip
from cc_mujoco.devices import find_device
from cc_mujoco.errors import CableError
from cc_mujoco.human import Body, Wearer
from cc_mujoco.human.body import MASS, SCENES, SEGMENTS
from cc_mujoco.metrics.metric import (
    CONTINUOUS_TORQUE,
    GEARING,
    PULL_PULL,
    RESISTANCE,
    SAFE_TORQUE,
    STRENGTH,
    TORQUE_CONSTANT,
)
from cc_mujoco.simulation.compiled_episode import attend
from cc_mujoco.transmission.parameters import KEYS, PATHS, Cable, Section
from cc_mujoco.whatif import gait
from cc_mujoco.whatif.materials import ENDS, MATERIALS, Material
from cc_mujoco.whatif.motors import MOTORS, Motor
from cc_mujoco.whatif.variables import Value, read_design

Array = NDArray[np.float64]

RADII = ("motor_radius", "joint_radius")
"""Variables of a cable's proximal and distal end."""

DRAWN = ("conduit", "loops", "wrap", "bend_radius", "length", "route", "path", "mouth")
"""Variables of what leads a cable, which of an open one the scene draws."""

GEARED = ("motor", "winding_resistance", "torque_constant", "continuous_torque")
"""Variables of the motor before its gear."""

FRICTION = "material_friction"
"""Variable that says which of `ENDS` the friction of a material is."""

UNPLUGGED: dict[str, Value] = {"axial_stiffness": 1e-6, "pretension": 0.0}
"""Design of a cable that does nothing."""

_ONE = threading.Lock()


class Builder:
    """Makes the models of designs of one scene.

    Models are bare (see `strip`) unless asked for whole.
    """

    def __init__(self, name: str, timestep: float | None = None) -> None:
        """Read the scene.

        Args:
            name: key of `devices.DEVICES`.
            timestep: of the physics [s]; that of the scene by default.
        """
        self.device = find_device(name)
        self.spec = _scene(name, timestep)
        self._read = name, timestep
        self.cables = engine.from_mjcf(self.spec)
        """The cables as they stand in the scene."""

    def model(self, design: Mapping[str, Value], whole: bool = False) -> mujoco.MjModel:
        """The model of a design.

        Raises:
            CableError: the design is impossible.
        """
        spec = self._base(design, whole).copy()
        self._apply(spec, design, whole)
        if not whole:  # at last, as a copy loses what no element refers to
            attend(spec)
        return spec.compile()

    def xml(self, design: Mapping[str, Value]) -> str:
        """MJCF of a design, whole."""
        spec = self.spec.copy()
        self._apply(spec, design, whole=True)
        spec.compile()
        return str(spec.to_xml())

    def cables_of(self, design: Mapping[str, Value]) -> dict[str, Cable]:
        """The cables of a design, by name.

        Raises:
            CableError: the design is impossible.
        """
        found = {}
        for name, cable in self.cables.items():
            own = _own(design, name)
            diameter = float(own.get("diameter", self.device.diameter))
            stiffer = (diameter / self.device.diameter) ** 2
            cable = _conduit(cable, own)
            stiffness = cable.axial_stiffness * stiffer
            friction = own.get("friction")
            if (material := material_of(design)) is not None:
                # Sources do not tell the two frictions apart; the scene does.
                friction = material.friction.at(str(design.get(FRICTION, ENDS[1])))
                stiffness = material.axial_stiffness(diameter)
            if friction is not None:
                if "static_friction" in own:  # which follows below
                    cable = cable.replace(static_friction=0.0)
                try:
                    cable = cable.with_friction(float(friction))
                except CableError as error:
                    raise CableError(f"cable {name!r}: {error}") from None
            config = cable.replace(axial_stiffness=stiffness).to_config()
            config |= {key: _text(own[key]) for key in KEYS if key in own}
            found[name] = Cable.from_config(config, f"cable {name!r}")
        return found

    def strength(self, design: Mapping[str, Value]) -> dict[str, float]:
        """Breaking load of each cable [N]."""
        thick = self.diameters(design)
        if (material := material_of(design)) is not None:
            return {name: material.breaking_load(d) for name, d in thick.items()}
        given = float(design.get("strength", self.device.strength))
        return {n: given * (d / self.device.diameter) ** 2 for n, d in thick.items()}

    def diameters(self, design: Mapping[str, Value]) -> dict[str, float]:
        """Diameter of each cable [m]."""
        return {
            name: float(_own(design, name).get("diameter", self.device.diameter))
            for name in self.cables
        }

    def motor(self, design: Mapping[str, Value]) -> Motor:
        """The motor as far as a design says what it is."""
        if "motor" in design:
            return MOTORS[str(design["motor"])]
        return Motor(
            resistance=float(design.get("winding_resistance", math.nan)),
            torque_constant=float(design.get("torque_constant", math.nan)),
            continuous_torque=float(design.get("continuous_torque", math.nan)),
            mass=float(design.get("motor_mass", math.nan)),
        )

    def gearing(self, design: Mapping[str, Value]) -> float:
        """Turns of the rotor per turn of its pulley; NaN where nobody says."""
        scene = self.device.gearing
        return float(design.get("gearing", math.nan if scene is None else scene))

    def facts(self, design: Mapping[str, Value]) -> dict[str, Any]:
        """Return the constants of a design that metrics need, as far as known."""
        motor = self.motor(design)
        found = {
            GEARING: self.gearing(design),
            RESISTANCE: motor.resistance,
            TORQUE_CONSTANT: motor.torque_constant,
            CONTINUOUS_TORQUE: motor.continuous_torque,
        }
        return {
            STRENGTH: self.strength(design),
            SAFE_TORQUE: self.device.safe_torque,
            PULL_PULL: self.device.pull_pull,
            **{key: value for key, value in found.items() if not math.isnan(value)},
        }

    def wearer(self, factor: float) -> Wearer:
        """The wearer of the scene, so many times as stiff and as damped."""
        actuator = self.spec.actuator(self.device.mover)
        stiffness, damping = float(actuator.gainprm[0]), -float(actuator.biasprm[2])
        return Wearer(factor * stiffness, factor * damping)

    def check(self, design: Mapping[str, object]) -> dict[str, Value]:
        """Find out whether a design can be simulated.

        Returns:
            The design with its values as they are used.

        Raises:
            CableError: names, values or their combination are impossible, or the time
                step is too long for so stiff a design.
        """
        read = read_design(design, self.cables)
        if FRICTION in read and "material" not in read:
            raise CableError(
                f"variable {FRICTION!r} says where in the range of a material, and "
                "needs a `material`."
            )
        gait.require_possible(self.device, read)
        if gait.LEG_LENGTH in read and routes(self.cables_of(read).values()):
            raise CableError(
                f"variable {gait.LEG_LENGTH!r} moves knee and ankle apart, but a cable "
                "bends as the scene draws its route along a leg; leave `bend` as it is."
            )
        geared = [name for name in GEARED if name in read]
        if geared and math.isnan(self.gearing(read)):
            raise CableError(
                f"variable {geared[0]!r} needs a `gearing`, since the scene "
                f"{self.device.scene!r} does not say how its motor is geared."
            )
        for name, cable in self.cables.items():
            self._require_drawn(name, cable, _own(read, name))
        for name, cable in self.cables_of(read).items():
            if cable.route and self.spec.tendon(cable.route) is None:
                raise CableError(
                    f"the route of cable {name!r} must be a tendon of the scene, not "
                    f"{cable.route!r}."
                )
        loads = self.strength(read)
        for name, cable in self.cables_of(read).items():
            if cable.pretension >= loads[name]:
                raise CableError(
                    f"the pretension of cable {name!r} is {cable.pretension:g} N; it "
                    f"must be below the breaking load of {loads[name]:g} N, which "
                    "`strength` sets."
                )
        if any(cable.path != PATHS[0] for cable in self.cables.values()):
            # The ends of a cable are implicit where they need it, its pieces are not.
            limits = engine.step_limits(self.model(read)).values()
            step = float(self.spec.option.timestep)
            limit = min(found.pieces for found in limits)
            if step >= limit:
                raise CableError(
                    f"the time step is {1e3 * step:.3g} ms, but the pieces of its "
                    "cables are so stiff that it must be below "
                    f"{1e3 * limit:.3g} ms."
                )
        return read

    def _require_drawn(self, name: str, cable: Cable, own: Mapping[str, Value]) -> None:
        """Refuse to vary what the drawing of a scene decides.

        Raises:
            CableError: an open cable's path is varied, or a lever that cannot be moved.
        """
        wrong = [key for key in DRAWN if key in own and cable.path != PATHS[0]]
        if wrong:
            raise CableError(
                f"variable {wrong[0]!r} cannot be varied for cable {name!r}, which "
                "leaves its conduit; the scene draws its path."
            )
        if "material" in own and cable.path != PATHS[0]:
            raise CableError(
                f"variable 'material' is a rope in a conduit, which cable {name!r} "
                "leaves; vary its friction, axial_stiffness and strength instead."
            )
        lever = [a for a in self.spec.actuators if a.plugin.name == name][1]
        joint = lever.trntype == mujoco.mjtTrn.mjTRN_JOINT
        if RADII[1] in own and not (joint or self.device.lever):
            raise CableError(
                f"variable {RADII[1]!r} cannot be varied for cable {name!r}, whose "
                "tendon has no lever that moves; the scene draws its path."
            )

    def _heavier(self, design: Mapping[str, Value]) -> dict[str, float]:
        """Return inertia of a design's pulleys above the scene's, by joint [kg m^2]."""
        found = {}
        for place, (joint, disc) in enumerate(self._discs()):
            on = [name for name in self.radii if self._target(name, place) == joint]
            more = 0.0
            for name in on:
                nominal = self.radii[name][place]
                radius = _own(design, name).get(RADII[place], nominal)
                more += (float(radius) / nominal) ** 4 - 1.0
            if disc and more:
                found[joint] = disc / len(on) * more
        return found

    def pulleys(self, design: Mapping[str, Value]) -> dict[str, tuple[float, ...]]:
        """Radii of the pulleys that each cable winds on [m]; a lever is none."""
        found = {}
        for name, nominal in self.radii.items():
            own = _own(design, name)
            ends = [a for a in self.spec.actuators if a.plugin.name == name]
            found[name] = tuple(
                float(own.get(key, radius))
                for key, radius, end in zip(RADII, nominal, ends, strict=True)
                if end.trntype == mujoco.mjtTrn.mjTRN_JOINT
            )
        return found

    def discs(self, design: Mapping[str, Value]) -> list[float]:
        """Mass of every pulley [kg], that of a solid disc of its inertia."""
        found = []
        for place, (joint, disc) in enumerate(self._discs()):
            on = [name for name in self.radii if self._target(name, place) == joint]
            if disc and on:
                found.append(
                    sum(
                        2.0
                        * disc
                        / len(on)
                        * float(_own(design, name).get(RADII[place], nominal)) ** 2
                        / nominal**4
                        for name, nominal in ((n, self.radii[n][place]) for n in on)
                    )
                )
        return found

    def _discs(self) -> tuple[tuple[str, float], ...]:
        """Joint and inertia [kg m^2] of the scene's pulleys, at the motor first."""
        device = self.device
        return ("motor", device.motor_pulley), (device.joint, device.joint_pulley)

    def _target(self, cable: str, end: int) -> str:
        """Name of the joint or tendon that an end of a cable is on."""
        ends = [a for a in self.spec.actuators if a.plugin.name == cable]
        return str(ends[end].target)

    @cached_property
    def radii(self) -> dict[str, tuple[float, float]]:
        """Pulley radii of the scene, by cable; of a lever the gear of its tendon."""
        found = {}
        for name in self.cables:
            proximal, distal = (
                abs(float(a.gear[0]))
                for a in self.spec.actuators
                if a.plugin.name == name
            )
            found[name] = proximal, distal
        return found

    def layout(self, design: Mapping[str, Value]) -> tuple[object, ...]:
        """Equal for designs that can be in one batch: their models, and their walk."""
        cables = self.cables_of(design).values()
        walker = (design.get(name) for name in gait.WALKER)
        return (*(cable.segments for cable in cables), *routes(cables), *walker)

    def _base(self, design: Mapping[str, Value], whole: bool) -> mujoco.MjSpec:
        """The scene that a design changes: whole, or what the design needs of it."""
        if whole:
            return self.spec
        kept = routes(self.cables_of(design).values())
        with _ONE:  # two threads would make two, and what one stands on would go
            bare, _ = _stripped(*self._read, kept)
        return bare

    def _apply(
        self, spec: mujoco.MjSpec, design: Mapping[str, Value], whole: bool
    ) -> None:
        for name, cable in self.cables_of(design).items():
            engine.to_mjcf(spec, name, cable if whole else left(spec, cable))
            own = _own(design, name)
            proximal, distal = (a for a in spec.actuators if a.plugin.name == name)
            for end, key in zip((proximal, distal), RADII, strict=True):
                if key in own:
                    self._set_radius(spec, end, float(own[key]))
        self._resize(spec, gait.body_of(design))
        motor, joint = spec.actuator("motor"), spec.joint("motor")
        if "motor_torque" in design:
            limit = float(design["motor_torque"]) / motor.gear[0]
            motor.ctrlrange = [-limit, limit]
        if "rotor_inertia" in design:
            joint.armature = float(design["rotor_inertia"])
        elif "motor" in design:
            rotor = self.motor(design).rotor_inertia
            joint.armature = rotor * self.gearing(design) ** 2
        for name, more in self._heavier(design).items():
            turning = spec.joint(name)
            # A disc has half of it about its diameters.
            disc = 0.5 * (1.0 + np.abs(turning.axis))
            turning.parent.inertia = turning.parent.inertia + more * disc
        if "motor_damping" in design:
            joint.damping = [float(design["motor_damping"]), 0.0, 0.0]

    def _resize(self, spec: mujoco.MjSpec, body: Body) -> None:
        """Give a leg the inertia and the lengths of a wearer of another size.

        What is worn on a segment stays as heavy, spread as the segment is, and the ends
        of the free rope stay where they are about the ankle. All joints of a leg turn
        about y, so that products of inertia are felt nowhere and are left out.
        """
        if body == SCENES:
            return
        for name, share in SEGMENTS.items():
            part = spec.body(name)
            limb, place = share * MASS, np.array(part.ipos)
            worn, limb_now = part.mass - limb, body.heavier * limb
            spread = np.array(part.inertia) / part.mass
            apart = (body.longer - 1.0) * place
            total = worn + limb_now
            part.ipos = place + limb_now / total * apart
            part.mass = total
            part.inertia = (worn + limb_now * body.longer**2) * spread + (
                worn * limb_now / total * (apart @ apart - apart**2)
            )
        for name in ("shank", "foot"):
            part = spec.body(name)
            down = (body.longer - 1.0) * np.array(part.pos)
            part.pos = np.array(part.pos) + down
        for name in self.device.lever:
            site = spec.site(name)
            if site.parent.name == "shank":
                site.pos = np.array(site.pos) + down

    def _set_radius(self, spec: mujoco.MjSpec, end: object, radius: float) -> None:
        """Give an end of a cable another pulley, or move its lever."""
        actuator: mujoco.MjsActuator = end
        if actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT:
            gear = math.copysign(radius, actuator.gear[0])
            actuator.gear = [gear, 0, 0, 0, 0, 0]
            return
        for name in self.device.lever:
            site = spec.site(name)
            site.pos = [math.copysign(radius, site.pos[0]), *site.pos[1:]]


def _scene(name: str, timestep: float | None) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_file(str(scene_path(name)))
    if timestep is not None:
        spec.option.timestep = timestep
    return spec


@cache
def _stripped(
    name: str, timestep: float | None, kept: tuple[str, ...]
) -> tuple[mujoco.MjSpec, mujoco.MjSpec]:
    """The scene stripped, to be copied; stripping it takes a tenth of a second.

    Behind it stands the scene: MuJoCo's copies point into what they are copies of.
    """
    whole = _scene(name, timestep)
    return strip(whole, kept), whole


def material_of(design: Mapping[str, Value]) -> Material | None:
    """The pair of materials that a design names; None where it names none."""
    return MATERIALS[str(design["material"])] if "material" in design else None


def _own(design: Mapping[str, Value], cable: str) -> dict[str, Value]:
    """Return the values of a design for a cable; those that name it take precedence."""
    own = {name: value for name, value in design.items() if "." not in name}
    start = f"{cable}."
    return own | {
        name[len(start) :]: value
        for name, value in design.items()
        if name.startswith(start)
    }


def _text(value: Value) -> str:
    return value if isinstance(value, str) else repr(value)


def _conduit(cable: Cable, own: Mapping[str, Value]) -> Cable:
    """The cable in the conduit that a design asks for."""
    sections = cable.conduit
    if "length" in own:
        longer = float(own["length"]) / cable.length
        sections = tuple(
            Section(longer * s.length, longer * s.radius) for s in sections
        )
    total = sum(s.length for s in sections)
    if "loops" in own:
        radius = total / (2.0 * math.pi * float(own["loops"]))
        sections = (Section(total, radius),)
    elif "wrap" in own:
        tighter = float(own["wrap"]) / cable.wrap
        sections = tuple(Section(s.length, s.radius / tighter) for s in sections)
    elif "bend_radius" in own:
        radius = float(own["bend_radius"])
        sections = tuple(
            Section(s.length, radius if s.radius < math.inf else s.radius)
            for s in sections
        )
    return cable.replace(conduit=sections)
