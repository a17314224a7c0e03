"""A plant: a device with some of its values changed.

    plant = Plant("wrist", {"friction": 0.1, "loops": 2, "wearer": 0.5})
    plant.cables["flexor"].friction                 # 0.1
    model = plant.model()

Values change what the physics uses; drawn pulleys and routes stay. A pulley is a solid
disc of constant width, so that its inertia grows with radius^4; on a pulley of two
cables each contributes half. A lever keeps its inertia.
"""

import itertools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from cc_mujoco import plugin
from cc_mujoco._validation import require_dictionary
from cc_mujoco.cable._cable import KEYS, PATHS, Cable, Section
from cc_mujoco.device import _strip_visuals as stripping
from cc_mujoco.device import _wearer_scaling as wearer_scaling
from cc_mujoco.device._description import Axis, Description
from cc_mujoco.device._device import Device, Nominal, find_device
from cc_mujoco.device._materials import ENDS, MATERIALS, Material
from cc_mujoco.device._motors import MOTORS, Motor
from cc_mujoco.device._variables import (
    WRITTEN,
    Value,
    of_owner,
    owner_axes,
    read_values,
    split,
)
from cc_mujoco.errors import CableError
from cc_mujoco.human import Body, Wearer
from cc_mujoco.metrics._metric import Key
from cc_mujoco.plugin._spec import compile_spec

RADII = ("motor_radius", "joint_radius")
"""Variables of the pulleys at a cable's proximal and distal end."""

GEARED = ("motor", "winding_resistance", "torque_constant", "continuous_torque")
"""Variables of the motor before its gear."""

CUFFED = ("cuff_stiffness", "cuff_damping")
"""Variables of the cuff between frame and limb."""

UNPLUGGED: dict[str, Value] = {"axial_stiffness": 1e-6, "pretension": 0.0}
"""Values of a cable that transmits nothing."""


class Plant:
    """A device with some of its values changed.

    Names and bounds of `values` are checked against the table `VALUES`; `check` also
    tests whether the scene can have them. `device` is the device without the changes,
    `cables` has all cables with them, by name.
    """

    def __init__(
        self, device: str | Path | Nominal, values: Mapping[str, object] | None = None
    ) -> None:
        """Change values of a device, which may also be given by its name or file.

        `values` are by `NAME` or, for one cable alone, `CABLE.NAME`; see `VALUES`.
        """
        self.device = device if isinstance(device, Nominal) else find_device(device)
        cables = self.device.cables
        given = require_dictionary("values", values)
        self.values = read_values(given, cables, self.device.axis_cables)
        if "material_friction" in self.values and "material" not in self.values:
            raise CableError(
                "variable 'material_friction' says where in the range of a material, "
                "and needs a `material`."
            )
        self.cables: Mapping[str, Cable] = cables
        if self.values:
            self.cables = {name: self._cable(name) for name in cables}
        tight = ("pretension", "strength", "diameter", "material")
        if any(split(name)[1] in tight for name in self.values):
            self._require_strength()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Plant):
            return NotImplemented
        same = self.values == other.values and self.wearers == other.wearers
        same = same and self.description.scene == other.description.scene
        return same and dict(self.cables) == dict(other.cables)

    __hash__ = None  # type: ignore[assignment]

    @property
    def description(self) -> Description:
        """Description of the device."""
        return self.device.description

    @property
    def wearers(self) -> dict[str, Wearer]:
        """Impedance of the wearer at each driven joint that the wearer moves."""
        factor, found = float(self.values.get("wearer", 1.0)), {}
        for limb in (axis.limb for axis in self.description.axes):
            if (nominal := self.device.wearers.get(limb)) is not None:
                damping = factor * nominal.damping
                found[limb] = Wearer(factor * nominal.stiffness, damping)
        return found

    @property
    def delay(self) -> int:
        """Control steps by which measurements are late; by default the device's."""
        return int(self.values.get("delay", self.description.sensing.delay))

    @property
    def noise(self) -> float:
        """Factor of the noise of the device's sensors; 1 by default."""
        return float(self.values.get("noise", 1.0))

    @property
    def material(self) -> Material | None:
        """Rope and conduit that the value `material` names; None without it."""
        name = self.values.get("material")
        return None if name is None else MATERIALS[str(name)]

    @property
    def strength(self) -> dict[str, float]:
        """Breaking load of each cable [N]; NaN where unknown."""
        thick, nominal = self.diameters, self.description.diameter
        if (material := self.material) is not None:
            return {name: material.breaking_load(d) for name, d in thick.items()}
        load = float(self.values.get("strength", self.description.strength))
        shares = {n: d / nominal if math.isfinite(d) else 1.0 for n, d in thick.items()}
        return {name: load * share**2 for name, share in shares.items()}

    @property
    def diameters(self) -> dict[str, float]:
        """Diameter of each cable [m]; NaN where unknown."""
        nominal = self.description.diameter
        return {n: float(self._own(n).get("diameter", nominal)) for n in self.cables}

    def motor(self, axis: Axis) -> Motor:
        """Return the motor of an axis; figures that no value determines are NaN."""
        values = self._of_axis(axis)
        if "motor" in values:
            return MOTORS[str(values["motor"])]
        resistance, constant, continuous, mass = (
            float(values.get(name, math.nan)) for name in (*GEARED[1:], "motor_mass")
        )
        return Motor("", resistance, constant, continuous, mass)

    def gearing(self, axis: Axis) -> float:
        """Return rotor turns per turn of the pulley; NaN where unknown."""
        scene = math.nan if axis.gearing is None else axis.gearing
        return float(self._of_axis(axis).get("gearing", scene))

    def facts(self, axis: Axis) -> dict[str, Any]:
        """Return the constants of an axis that metrics need, without unknown ones."""
        motor = self.motor(axis)
        found = {
            Key.GEARING: self.gearing(axis),
            Key.WINDING_RESISTANCE: motor.resistance,
            Key.TORQUE_CONSTANT: motor.torque_constant,
            Key.CONTINUOUS_TORQUE: motor.continuous_torque,
        }
        known = {key: value for key, value in found.items() if not math.isnan(value)}
        return facts_of(axis, self.strength) | known

    @property
    def pulleys(self) -> dict[str, tuple[float, ...]]:
        """Radii of the pulleys at each cable's ends [m]; levers are left out."""
        scene, found = self.scene, {}
        for name, ends in scene.ends.items():
            own, each = self._own(name), zip(RADII, scene.radii[name], strict=True)
            radii = [float(own.get(key, radius)) for key, radius in each]
            on_joint = (end.trntype == mujoco.mjtTrn.mjTRN_JOINT for end in ends)
            found[name] = tuple(itertools.compress(radii, on_joint))
        return found

    @property
    def discs(self) -> list[float]:
        """Mass of every pulley as a solid disc [kg]; NaN for unknown inertia."""
        found = []
        for _, disc, radii in self._pulley_inertias():
            if radii:
                each = 2.0 * (disc or math.nan) / len(radii)
                found.append(sum(each * new**2 / old**4 for old, new in radii))
        return found

    @property
    def layout(self) -> tuple[object, ...]:
        """Key that is equal for plants that one batch can simulate together."""
        cables, axes = self.cables.values(), self.description.axes
        walks = (self.values.get(name) for name in wearer_scaling.WALKER)
        lags = (bool(self._of_axis(axis).get("motor_lag", 0.0)) for axis in axes)
        segments = (cable.segments for cable in cables)
        return (*segments, *stripping.route_tendons(cables), *walks, *lags)

    @property
    def compiled_values(self) -> dict[str, Value]:
        """Values other than those that `DeviceModel.with_cables` writes."""
        each = self.values.items()
        return {name: value for name, value in each if split(name)[1] not in WRITTEN}

    def check(self) -> None:
        """Check that the plant can be simulated.

        Raises:
            CableError: The scene lacks a part that a value changes, or a cable is too
                stiff for the time step.
        """
        scene, values = self.scene, self.values
        wearer_scaling.require_possible(self.description, values)
        bending = stripping.route_tendons(self.cables.values())
        if "leg_length" in values and bending:
            raise CableError(
                "variable 'leg_length' moves knee and ankle apart, but a cable bends "
                "as the scene draws its route along a leg; leave `bend` as it is."
            )
        for axis in self.description.axes:
            # Variables of the motor before its gear
            geared = [name for name in GEARED if name in self._of_axis(axis)]
            if geared and math.isnan(self.gearing(axis)):
                raise CableError(
                    f"variable {geared[0]!r} needs a `gearing`, since the scene "
                    f"{self.description.scene!r} does not say how its motor is geared; "
                    "vary it, or write it in [axis] of the description."
                )
            worn = [n for n in CUFFED if n in self._of_axis(axis)]
            if worn and axis.cuff is None:
                raise CableError(
                    f"variable {worn[0]!r} needs a cuff: write `stiffness` in "
                    f"[axis.cuff] of the description of {self.description.scene}."
                )
        for name, (_, distal) in scene.ends.items():
            joint = distal.trntype == mujoco.mjtTrn.mjTRN_JOINT
            if RADII[1] in self._own(name) and not (joint or self._lever(name)):
                raise CableError(
                    f"variable {RADII[1]!r} cannot be varied for cable {name!r}, whose "
                    "tendon has no lever that moves; the scene sets its moment arms."
                )
        for name, cable in self.cables.items():
            if cable.route and scene.spec.tendon(cable.route) is None:
                raise CableError(
                    f"the route of cable {name!r} must be a tendon of the scene, not "
                    f"{cable.route!r}."
                )
        self._require_strength()
        if any(cable.path != PATHS[0] for cable in self.device.cables.values()):
            # The ends of a cable are implicit where they need it, its pieces are not.
            model = self.model()
            limits = plugin.step_limits(model, mujoco.MjData(model)).values()
            step = float(scene.spec.option.timestep)
            limit = min(found.pieces for found in limits)
            if step >= limit:
                raise CableError(
                    f"the time step is {1e3 * step:.3g} ms, but the pieces of its "
                    "cables are so stiff that it must be below "
                    f"{1e3 * limit:.3g} ms."
                )

    def model(self, whole: bool = False) -> mujoco.MjModel:
        """Compile the model, without visual elements unless `whole`."""
        return compile_spec(self.spec(whole))

    def spec(self, whole: bool = False) -> mujoco.MjSpec:
        """Return the scene with the values, without visual elements unless `whole`.

        Raises:
            CableError: The plant has no scene, as that of an environment, or the scene
                has no wearer whose walk or profile the values could change.
        """
        scene = self.scene
        wearer_scaling.require_scene(self.description, self.values)
        if whole:
            spec = scene.spec.copy()
        else:
            spec = scene.stripped(stripping.route_tendons(self.cables.values())).copy()
            stripping.reserve_memory(spec, self.cables.values())
        self._apply(spec, whole)
        return spec

    def xml(self) -> str:
        """Return the MJCF of the scene with the values, visual elements included."""
        spec = self.spec(whole=True)
        compile_spec(spec)
        return str(spec.to_xml())

    @property
    def scene(self) -> Device:
        """Device of the plant, which has a scene.

        Raises:
            CableError: The plant is that of an environment, which has no scene.
        """
        if not isinstance(self.device, Device):
            raise CableError(
                f"a plant of {self.description.scene!r} has no scene to change: make "
                "it of a `Device` or its name."
            )
        return self.device

    def _of_axis(self, axis: Axis) -> dict[str, Value]:
        return of_owner(self.values, axis.name)

    def _lever(self, cable: str) -> tuple[str, ...]:
        axes = self.description.axes
        return next((axis.lever for axis in axes if cable in axis.cables), ())

    def _own(self, cable: str) -> dict[str, Value]:
        axes = owner_axes(cable, self.device.axis_cables)
        return of_owner(self.values, *axes, cable)

    def _cable(self, name: str) -> Cable:
        cable, own = self.device.cables[name], self._own(name)
        kept = [key for key in KEYS if key in own and key != "friction"]
        changes: dict[str, object] = {key: own[key] for key in kept}
        _require_guided(name, cable, own)
        where = f"cable {name!r}"
        if "conduit" in own:
            config = {"conduit": str(own["conduit"])}
            changes["conduit"] = Cable.from_config(config, where).conduit
        nominal = self.description.diameter
        diameter = float(own.get("diameter", nominal))
        stiffness = cable.axial_stiffness
        # Of a material the diameter says all, else it scales the rope that is there.
        varied = "material" if self.material is not None else "diameter"
        if varied in own and math.isnan(diameter if varied == "material" else nominal):
            raise CableError(
                f"variable {varied!r} needs the diameter of the rope as it is: "
                "write `diameter` in [rope] of the description of "
                f"{self.description.scene}."
            )
        if "diameter" in own:
            stiffness = (diameter / nominal) ** 2 * stiffness
        friction = own.get("friction")
        if (material := self.material) is not None:
            # Sources do not separate static and kinetic friction; the scene does.
            end = str(self.values.get("material_friction", ENDS[1]))
            friction = material.friction.at(end)
            stiffness = material.axial_stiffness(diameter)
        changes.setdefault("axial_stiffness", stiffness)
        kinetic = cable.friction if friction is None else float(friction)
        if "break_away" in own:
            changes["static_friction"] = float(own["break_away"]) * kinetic
        try:
            changes.setdefault("conduit", _conduit(cable, own))
            if friction is not None and "static_friction" not in changes:
                return cable.with_friction(kinetic, **changes)
            return cable.replace(**changes | {"friction": kinetic})
        except CableError as error:
            raise CableError(f"{where}: {error}.") from None

    def _require_strength(self) -> None:
        loads = self.strength
        for name, cable in self.cables.items():
            if cable.pretension >= loads[name]:
                raise CableError(
                    f"the pretension of cable {name!r} is {cable.pretension:g} N; it "
                    f"must be below the breaking load of {loads[name]:g} N, which "
                    "`strength` sets."
                )

    def _pulley_inertias(self) -> list[tuple[str, float, list[tuple[float, float]]]]:
        """Return joint, inertia [kg m^2] and old and new radii [m] of each pulley."""
        scene, found = self.scene, []
        for axis in self.description.axes:
            discs = (axis.drum, axis.motor_pulley), (axis.joint, axis.joint_pulley)
            for place, (joint, disc) in enumerate(discs):
                radii = []
                for name, ends in scene.ends.items():
                    if ends[place].target == joint:
                        nominal = scene.radii[name][place]
                        own = self._own(name).get(RADII[place], nominal)
                        radii.append((nominal, float(own)))
                found.append((joint, disc, radii))
        return found

    def _apply(self, spec: mujoco.MjSpec, whole: bool) -> None:
        for name, cable in self.cables.items():
            cable = cable if whole else stripping.remaining_cable(spec, cable)
            plugin.to_mjcf(spec, name, cable)
            own = self._own(name)
            ends = (a for a in spec.actuators if a.plugin.name == name)
            for end, key in zip(ends, RADII, strict=True):
                if key in own:
                    self._set_radius(spec, name, end, float(own[key]))
        self._resize(spec, wearer_scaling.body_of(self.values))
        if "wearer" in self.values:
            for name, wearer in self.wearers.items():
                actuator = spec.actuator(self.description.movers[name])
                self.scene.movers[name].impose(actuator, wearer)
        for axis in self.description.axes:
            self._apply_motor(spec, axis)
        for name, disc, radii in self._pulley_inertias():
            more = sum((radius / nominal) ** 4 - 1.0 for nominal, radius in radii)
            if disc and more:
                turning = spec.joint(name)
                # A disc has half of its axial inertia about its diameters.
                about = 0.5 * (1.0 + np.abs(turning.axis))
                inertia = disc / len(radii) * more * about
                turning.parent.inertia = turning.parent.inertia + inertia

    def _apply_motor(self, spec: mujoco.MjSpec, axis: Axis) -> None:
        values = self._of_axis(axis)
        motor, drum = spec.actuator(axis.motor), spec.joint(axis.drum)
        if "motor_torque" in values:
            torque, ratio = values["motor_torque"], motor.gainprm[0] * motor.gear[0]
            limit = float(torque) / abs(ratio)
            motor.ctrlrange = [-limit, limit]
            motor.forcerange = [0.0, 0.0]
        if "rotor_inertia" in values:
            drum.armature = float(values["rotor_inertia"])
        elif "motor" in values:
            drum.armature = self.motor(axis).rotor_inertia * self.gearing(axis) ** 2
        for name in CUFFED:
            if name in values and axis.cuff is not None:
                strap = spec.tendon(axis.cuff.tendon)
                getattr(strap, name.removeprefix("cuff_"))[0] = float(values[name])
        if "motor_damping" in values:
            drum.damping = [float(values["motor_damping"]), 0.0, 0.0]
        if "motor_friction" in values:
            drum.frictionloss = float(values["motor_friction"])
        if "motor_lag" in values:
            lag = float(values["motor_lag"])
            dynamics = mujoco.mjtDyn
            motor.dyntype = dynamics.mjDYN_FILTEREXACT if lag else dynamics.mjDYN_NONE
            motor.dynprm[0] = lag

    def _resize(self, spec: mujoco.MjSpec, body: Body) -> None:
        """Scale masses, inertias and lengths of a leg to a wearer of another size.

        The part of a device worn on a segment keeps its mass, distributed as the
        segment's. The ends of the free rope keep their places relative to the ankle.
        All joints of a leg turn about y, so that products of inertia have no effect and
        are left out.
        """
        if body == Body():
            return
        for name, share in Body.SEGMENTS.items():
            if (part := spec.body(name)) is None:
                raise CableError(
                    "variables 'body_mass' and 'leg_length' scale the bodies "
                    f"{', '.join(Body.SEGMENTS)} of a leg, but the scene "
                    f"{self.description.scene!r} has no body {name!r}."
                )
            limb, place = share * Body.mass, np.array(part.ipos)
            worn, limb_now = part.mass - limb, body.heavier * limb
            spread = np.array(part.inertia) / part.mass
            offset = (body.longer - 1.0) * place
            total = worn + limb_now
            part.ipos = place + limb_now / total * offset
            part.mass = total
            apart = worn * limb_now / total * (offset @ offset - offset**2)
            part.inertia = (worn + limb_now * body.longer**2) * spread + apart
        for name in ("shank", "foot"):
            part = spec.body(name)
            down = (body.longer - 1.0) * np.array(part.pos)
            part.pos = np.array(part.pos) + down
        for axis in self.description.axes:
            for name in axis.lever:
                site = spec.site(name)
                if site.parent.name == "shank":
                    site.pos = np.array(site.pos) + down

    def _set_radius(
        self, spec: mujoco.MjSpec, cable: str, end: Any, radius: float
    ) -> None:
        if end.trntype == mujoco.mjtTrn.mjTRN_JOINT:
            end.gear = [math.copysign(radius, end.gear[0]), 0, 0, 0, 0, 0]
            return
        lever = self._lever(cable)
        last = spec.site(lever[-1])
        offset = np.array(last.pos)
        joints = last.parent.joints
        for hinge in [j for j in joints if j.type == mujoco.mjtJoint.mjJNT_HINGE][:1]:
            offset = offset - hinge.pos
            offset -= (offset @ hinge.axis) * np.array(hinge.axis)
        # The coordinate of its body in which the lever is farthest from the joint
        place = int(np.abs(offset).argmax())
        for name in lever:
            site = spec.site(name)
            moved = np.array(site.pos)
            moved[place] = math.copysign(radius, moved[place])
            site.pos = moved


def facts_of(axis: Axis, strength: Mapping[str, float]) -> dict[str, Any]:
    """Return the constants of an axis that metrics need, without unknown ones."""
    found: dict[str, Any] = {Key.PULL_PULL: axis.pull_pull}
    known = {name: load for name, load in strength.items() if not math.isnan(load)}
    if known:
        found[Key.STRENGTH] = known
    if math.isfinite(axis.safe_torque):
        found[Key.SAFE_TORQUE] = axis.safe_torque
    return found


def _require_guided(name: str, cable: Cable, own: Mapping[str, Value]) -> None:
    """Refuse variables of an open cable that its path in the scene determines."""
    if cable.path == PATHS[0]:
        return
    drawn = ("conduit", "loops", "wrap", "bend_radius", "length")
    wrong = [key for key in (*drawn, "route", "path", "mouth") if key in own]
    if wrong:
        raise CableError(
            f"variable {wrong[0]!r} cannot be varied for cable {name!r}, which "
            "leaves its conduit; the scene draws its path."
        )
    if "material" in own:
        raise CableError(
            f"variable 'material' is a rope in a conduit, which cable {name!r} "
            "leaves; vary its friction, axial_stiffness and strength instead."
        )


def _conduit(cable: Cable, own: Mapping[str, Value]) -> tuple[Section, ...]:
    sections = cable.conduit
    if "length" in own:
        longer = float(own["length"]) / cable.length
        sections = tuple(
            x._replace(length=longer * x.length, radius=longer * x.radius)
            for x in sections
        )
    total = sum(s.length for s in sections)
    if "loops" in own:
        turned = 2.0 * math.pi * float(own["loops"])
        sections = (Section(total, total / turned if turned else math.inf),)
    radii = [s.radius for s in sections]
    if "wrap" in own:
        if not cable.wrap:
            raise CableError("`wrap` cannot be varied, as its conduit has no bends")
        tighter = float(own["wrap"]) / cable.wrap
        radii = [radius / tighter if tighter else math.inf for radius in radii]
    elif "bend_radius" in own:
        bent = float(own["bend_radius"])
        radii = [bent if radius < math.inf else radius for radius in radii]
    bends = zip(sections, radii, strict=True)
    return tuple(section._replace(radius=radius) for section, radius in bends)
