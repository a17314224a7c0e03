"""Effects outside the cables in a scene, and the four channels of a rig.

    add_instruments(spec, bench)
    model = spec.compile()
    ...
    read_channels(model, data).joint_torque

Angles are `jointpos` sensors. No sensor of MuJoCo adds the forces of two cables on a
pulley, so each torque is a `<tuple>` in `<custom>`, named like its column: sensors and
the weights (`prm`) of their sum. Of a sensor with several numbers the last one counts,
the component along z. Delay is an attribute of the sensors themselves, so nothing here
keeps a state: `read_channels` is right in any simulation of the scene.

    REALISATIONS["motor_inertia"].apply(spec, bench, {"motor_inertia": 2e-4})

Every entry of the table changes a scene in plain MJCF so that its motion and, but for a
lever, its measured torques show the effect. To add an effect, write its entry; they are
applied in the order of the table, mechanics before sensors.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import mujoco
import numpy as np
from mujoco import MjData, MjModel, MjsBody, MjSpec, MjsSensor, mjtObj, mjtSensor

from cc_mujoco.cable._conduit import end_stiffness
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._channels import (
    ANGLES,
    JOINT_ANGLE,
    JOINT_TORQUE,
    MOTOR_ANGLE,
    MOTOR_TORQUE,
    TORQUES,
)
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray


class Measured(NamedTuple):
    """Readings of the four channels of a rig at one instant."""

    motor_angle: float  # [rad]
    motor_torque: float  # that the motor puts into its pulley [N m]
    joint_angle: float  # [rad]
    joint_torque: float  # that the transmission puts into the joint [N m]


SensorShare = tuple[str, float]
"""Sensor in the sum that is a torque: its name, and the weight of its last number."""
_SIDES = ((MOTOR_TORQUE, "motor"), (JOINT_TORQUE, "joint"))


def read_channels(model: MjModel, data: MjData) -> Measured:
    """Return the four channels as of the last evaluation of the sensors.

    After `mj_step` that is the state at which the step began.

    Raises:
        CableError: the scene has no instruments.
    """
    motor, joint = torque_weights(model) @ data.sensordata
    places = (model.sensor_adr[sensor] for sensor in angle_sensors(model))
    proximal, distal = (data.sensordata[place] for place in places)
    return Measured(float(proximal), float(motor), float(distal), float(joint))


def torque_weights(model: MjModel) -> FloatArray:
    """Return weights (2, sensordata) of all sensor data in motor and joint torque."""
    weights = np.zeros((len(TORQUES), model.nsensordata))
    for row, channel in enumerate(TORQUES):
        index = _index(model, mjtObj.mjOBJ_TUPLE, channel, "tuple")
        start = model.tuple_adr[index]
        for item in range(start, start + model.tuple_size[index]):
            sensor = model.tuple_objid[item]
            last = model.sensor_adr[sensor] + model.sensor_dim[sensor] - 1
            weights[row, last] += model.tuple_objprm[item]
    return weights


def angle_sensors(model: MjModel) -> tuple[int, int]:
    kind = mjtObj.mjOBJ_SENSOR
    motor, joint = (_index(model, kind, name, "sensor") for name in ANGLES)
    return motor, joint


def add_instruments(spec: MjSpec, bench: Bench) -> None:
    """Add sensors of the four channels to a scene, unless it has them."""
    if bench.lever is not None:
        raise CableError(
            f"scene {bench.path}: cable {bench.names[0]} pulls a lever, whose torque "
            "is no sum of sensors"
        )
    angle = mjtSensor.mjSENS_JOINTPOS
    for name, joint in ((MOTOR_ANGLE, bench.motor), (JOINT_ANGLE, bench.joint)):
        found = spec.sensor(name)
        if found is None:
            _add_sensor(spec, name, angle, mjtObj.mjOBJ_JOINT, joint)
        elif (found.type, found.objname) != (angle, joint):
            raise CableError(
                f"scene {bench.path}: the sensor {name!r} must be a <jointpos> of "
                f"joint {joint!r}; rename it"
            )
    rims = (MOTOR_TORQUE, 0, bench.motor_radius), (JOINT_TORQUE, 1, -bench.joint_radius)
    for channel, end, radius in rims:
        actuators = [_ends(spec, cable)[end] for cable in bench.names]
        signed = zip(actuators, (radius, -radius), strict=False)
        ends = [(force_sensor(spec, actuator), weight) for actuator, weight in signed]
        parts = [(part, spec.sensor(part[0])) for part in torque_parts(spec, channel)]
        others = [part for part, own in parts if not _shows_force_of(own, actuators)]
        set_torque_parts(spec, channel, [*ends, *others])


def force_sensor(spec: MjSpec, actuator: str) -> str:
    """Return the name of an actuator's force sensor without delay, added if missing."""
    for sensor in spec.sensors:
        plain = sensor.delay == 0.0 and sensor.nsample == 0 and sensor.cutoff == 0.0
        usable = sensor.name and sensor.name == sensor_word(sensor.name)
        if _shows_force_of(sensor, [actuator]) and plain and usable:
            return str(sensor.name)
    name = sensor_word(f"{actuator}_force")
    kind = mjtSensor.mjSENS_ACTUATORFRC
    _add_sensor(spec, name, kind, mjtObj.mjOBJ_ACTUATOR, actuator)
    return name


def _add_sensor(
    spec: MjSpec, name: str, kind: mjtSensor, shown: mjtObj, target: str
) -> MjsSensor:
    return spec.add_sensor(name=name, type=kind, objtype=shown, objname=target)


def sensor_word(name: str) -> str:
    """Return a sensor name without blanks, which would split a `<tuple>` list."""
    return "_".join(name.split())


def torque_parts(spec: MjSpec, channel: str) -> list[SensorShare]:
    found = spec.tuple(channel)
    if found is None:
        return []
    pairs = zip(found.objname, found.objprm, strict=True)
    return [(str(name), float(weight)) for name, weight in pairs]


def set_torque_parts(spec: MjSpec, channel: str, wanted: list[SensorShare]) -> None:
    found = spec.tuple(channel) or spec.add_tuple(name=channel)
    found.objtype = [int(mjtObj.mjOBJ_SENSOR)] * len(wanted)
    found.objname = [name for name, _ in wanted]
    found.objprm = [weight for _, weight in wanted]


def add_torque_part(spec: MjSpec, channel: str, sensor: str, weight: float) -> None:
    """Add a sensor, times a weight, to the sum that is the torque of a channel."""
    set_torque_parts(spec, channel, [*torque_parts(spec, channel), (sensor, weight)])


def _ends(spec: MjSpec, cable: str) -> tuple[str, str]:
    """Return the names of both actuators at a cable's ends; name those without."""
    proximal, distal = (
        actuator
        for actuator in spec.actuators
        if actuator.plugin.name == cable  # a written scene has no `plugin_name` here
    )
    for actuator, end in ((proximal, "proximal"), (distal, "distal")):
        name = actuator.name or f"{cable}_{end}"
        while not actuator.name and spec.actuator(name) is not None:
            name += "_"
        actuator.name = name
    return str(proximal.name), str(distal.name)


def _shows_force_of(sensor: MjsSensor | None, actuators: list[str]) -> bool:
    force = mjtSensor.mjSENS_ACTUATORFRC
    return sensor is not None and sensor.type == force and sensor.objname in actuators


def _index(model: MjModel, kind: mjtObj, name: str, what: str) -> int:
    index = mujoco.mj_name2id(model, kind, name)
    if index < 0:
        raise CableError(
            f"the scene has no {what} {name!r}; give it the four channels with "
            "`instrument`"
        )
    return int(index)


Values = Mapping[str, float]
Realise = Callable[[MjSpec, Bench, Values], None]

CLOCK_SENSOR, UNIT_SENSOR = "instrument_clock", "instrument_one"
"""Sensors that show the time and the number 1; they are never late."""


def angle_offset(spec: MjSpec, bench: Bench, values: Values) -> None:
    """Shift the reference of the joint by the offset between joint and motor angle."""
    sign = 1.0 if bench.lever is None else bench.lever.sign
    offset = sign * values["joint_angle_offset"]
    # A specification keeps the unit of its file.
    unit = math.degrees(1.0) if spec.compiler.degree else 1.0
    spec.joint(bench.joint).ref -= offset * unit


def torque_offset(spec: MjSpec, bench: Bench, values: Values) -> None:
    for channel, side in _SIDES:
        add_constant(spec, channel, values[f"{side}_torque_offset"])


def gain(spec: MjSpec, bench: Bench, values: Values) -> None:
    for channel, side in _SIDES:
        factor = 1.0 + values[f"{side}_torque_gain"]
        parts = torque_parts(spec, channel)
        set_torque_parts(spec, channel, [(name, factor * w) for name, w in parts])


def cross_talk(spec: MjSpec, bench: Bench, values: Values) -> None:
    parts = {channel: torque_parts(spec, channel) for channel, _ in _SIDES}
    for (channel, side), (other, _) in zip(_SIDES, _SIDES[::-1], strict=True):
        share = values[f"{side}_torque_cross_talk"]
        for sensor, weight in parts[other]:
            add_torque_part(spec, channel, sensor, share * weight)


def bias(spec: MjSpec, bench: Bench, values: Values) -> None:
    for channel, side in _SIDES:
        add_constant(spec, channel, values[f"{side}_torque_bias"])
        drift = values[f"{side}_torque_drift"]
        if drift != 0.0:
            _ensure_sensor(spec, CLOCK_SENSOR, mjtSensor.mjSENS_CLOCK)
            add_torque_part(spec, channel, CLOCK_SENSOR, drift)


def delay(spec: MjSpec, bench: Bench, values: Values) -> None:
    """Delay sensors; where one reading comes early, delay all others instead."""
    side = values["joint_delay"]
    motor, joint = values["motor_torque_delay"], values["joint_torque_delay"]
    late = {MOTOR_ANGLE: 0.0, JOINT_ANGLE: side}
    late |= {MOTOR_TORQUE: motor, JOINT_TORQUE: side + joint}
    common = max(0.0, -min(late.values()))
    for channel, own in late.items():
        if own + common < 0.5 * spec.option.timestep:
            continue
        if channel in (MOTOR_ANGLE, JOINT_ANGLE):
            _delay_sensor(spec, spec.sensor(channel), own + common)
            continue
        delayed = []
        for name, weight in torque_parts(spec, channel):
            if name not in (CLOCK_SENSOR, UNIT_SENSOR):
                seen = spec.sensor(name)
                name = sensor_word(f"{channel}_{name}")
                copy = _add_sensor(spec, name, seen.type, seen.objtype, seen.objname)
                _delay_sensor(spec, copy, own + common)
            delayed.append((name, weight))
        set_torque_parts(spec, channel, delayed)


def add_constant(spec: MjSpec, channel: str, value: float) -> None:
    """Add a constant to a channel [N m], by a sensor that always shows 1."""
    if value != 0.0:
        axis = {"objtype": mjtObj.mjOBJ_XBODY, "objname": "world"}
        _ensure_sensor(spec, UNIT_SENSOR, mjtSensor.mjSENS_FRAMEZAXIS, **axis)
        add_torque_part(spec, channel, UNIT_SENSOR, value)


def _delay_sensor(spec: MjSpec, sensor: MjsSensor, delay: float) -> None:
    sensor.delay = delay
    sensor.interp = 1
    # Enough to be played at half the time step, too.
    sensor.nsample = 2 * math.ceil(delay / spec.option.timestep) + 4


def _ensure_sensor(spec: MjSpec, name: str, kind: mjtSensor, **shown: Any) -> None:
    found = spec.sensor(name)
    if found is None:
        spec.add_sensor(name=name, type=kind, **shown)
    elif found.type != kind:
        raise CableError(f"the scene has a sensor {name!r} of its own; rename it")


GRAVITY_ACTUATOR = "joint_gravity"
"""Name of the actuator that exerts the torque of a weight."""


def rim_stiffness(bench: Bench, radius: float) -> float:
    """Return the sum of the cables' larger end stiffnesses about a pulley [N m/rad]."""
    return sum(max(end_stiffness(cable)) for cable in bench.cables) * radius**2


def backlash(spec: MjSpec, bench: Bench, values: Values) -> None:
    """Add play by a pulley whose tendon to the joint is limited to +-play/2 [rad]."""
    play = values["backlash"]
    if play < 0.0:
        raise CableError(f"backlash is {play!r} rad; it must be 0 or more")
    name, step = f"{bench.joint}_pulley", spec.option.timestep
    # With it the cables swing with 1 / step, half of what an explicit force allows.
    inertia = rim_stiffness(bench, bench.joint_radius) * step**2
    joint = spec.joint(bench.joint)
    model = spec.compile()
    index = model.joint(bench.joint).id
    body = model.jnt_bodyid[index]
    place, turn = model.body_pos[body], model.body_quat[body]
    pulley = joint.parent.parent.add_body(name=name, pos=place, quat=turn)
    _set_isotropic_inertia(pulley, model.jnt_pos[index], inertia)
    # All attributes are set, because a scene may have defaults.
    place, axis = model.jnt_pos[index], model.jnt_axis[index]
    free: Any = {"limited": False, "armature": 0.0, "frictionloss": 0.0}
    free |= {"type": mujoco.mjtJoint.mjJNT_HINGE, "ref": joint.ref}
    hinge = pulley.add_joint(name=name, pos=place, axis=axis, **free)
    hinge.damping[:] = 0.0
    hinge.stiffness[:] = 0.0
    for actuator in spec.actuators:
        if actuator.plugin.name in bench.names and actuator.target == bench.joint:
            actuator.target = name
    stop: Any = {"limited": True, "range": [-play / 2.0, play / 2.0], "margin": 0.0}
    stop["solref_limit"] = [4.0 * step, 1.0]
    stop["solimp_limit"] = [0.999, 0.9999, play / 1000.0, 0.5, 2.0]
    tendon = spec.add_tendon(name=f"{bench.joint}_backlash", **stop)
    tendon.frictionloss, tendon.armature = 0.0, 0.0
    tendon.stiffness[:] = 0.0
    tendon.damping[:] = 0.0
    tendon.damping[0] = 2.0 * 0.02 * inertia / step
    tendon.wrap_joint(name, 1.0)
    tendon.wrap_joint(bench.joint, -1.0)
    _keep_keyframes(spec, model, bench.joint, name)


def _keep_keyframes(spec: MjSpec, before: MjModel, joint: str, pulley: str) -> None:
    """Insert the new pulley's state, that of its joint, into all keyframes."""
    after = spec.compile()
    old, new = before.joint(joint), after.joint(pulley)
    keys = zip(spec.keys, before.key_qpos, before.key_qvel, strict=True)
    for key, pose, speed in keys:
        key.qpos = np.insert(pose, new.qposadr[0], pose[old.qposadr[0]])
        key.qvel = np.insert(speed, new.dofadr[0], speed[old.dofadr[0]])


def cogging(spec: MjSpec, bench: Bench, values: Values) -> None:
    """Load the motor by a torque: cosine cos(order q) + sine sin(order q) [N m]."""
    order = values["cogging_order"]
    cosine, sine = values["cogging_cosine"], values["cogging_sine"]
    if cosine == sine == 0.0:
        return
    add_wave(spec, bench, "motor", "motor_cogging", order, sine, cosine)


def gravity(spec: MjSpec, bench: Bench, values: Values) -> None:
    """Add a torque that opposes the joint: sine sin(q) + cosine cos(q) [N m]."""
    cosine, sine = values["gravity_cosine"], values["gravity_sine"]
    if bench.lever is not None:
        cosine *= bench.lever.sign  # angle and torque are both turned round
    add_wave(spec, bench, "joint", GRAVITY_ACTUATOR, 1.0, -sine, -cosine)


def tilt_rig(model: MjModel, tilt: float) -> None:
    """Turn a rig with a found weight about its joint's axis by `tilt` [rad]."""
    number = mujoco.mj_name2id(model, mjtObj.mjOBJ_ACTUATOR, GRAVITY_ACTUATOR)
    if number >= 0:
        model.actuator_biasprm[number, 2] += tilt  # phase of the ripple


def add_wave(
    spec: MjSpec,
    bench: Bench,
    side: Literal["motor", "joint"],
    name: str,
    order: float,
    sine: float,
    cosine: float,
) -> None:
    """Add sine sin(order q) + cosine cos(order q) to the torque of a side [N m].

    The angle q is that of the side; the load of the motor and its sensor have opposite
    signs.
    """
    sign, joint = (-1.0, bench.motor) if side == "motor" else (1.0, bench.joint)
    _add_periodic_torque(spec, name, joint, order, sign * sine, sign * cosine)
    if bench.lever is None:
        add_torque_part(spec, f"{side}_torque_nm", force_sensor(spec, name), sign)


def _add_periodic_torque(
    spec: MjSpec, name: str, joint: str, order: float, sine: float, cosine: float
) -> None:
    """Add an actuator with the torque sine sin(order q) + cosine cos(order q)."""
    actuator = spec.add_actuator(name=name)
    actuator.trntype, actuator.target = mujoco.mjtTrn.mjTRN_JOINT, joint
    actuator.gear, actuator.forcelimited = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], False
    wave = [math.hypot(sine, cosine), order, math.atan2(cosine, sine)]
    # Without an input the motor constant has no effect, but MuJoCo 3 refuses zero.
    still: Any = {"motorconst": [1e-300, 0.0], "resistance": 1.0}
    actuator.set_to_dcmotor(cogging=wave, ctrlspec=Limit.no_input, **still)


def stiffness(spec: MjSpec, bench: Bench, values: Values) -> None:
    """Add a spring to the joint, in parallel with the spring it has."""
    added, moment = values["joint_stiffness"], values["joint_stiffness_moment"]
    sign = 1.0 if bench.lever is None else bench.lever.sign
    joint = spec.joint(bench.joint)
    # A specification keeps the unit of its file.
    unit = math.degrees(1.0) if spec.compiler.degree else 1.0
    present, rest = float(joint.stiffness[0]), float(joint.springref) / unit
    total = present + added
    joint.stiffness[0] = total
    if total != 0.0 and not any(joint.stiffness[1:]):
        joint.springref = unit * (present * rest - sign * moment) / total
    elif rest != 0.0:
        raise CableError(
            f"joint {bench.joint!r} has a spring about {rest:g} rad that another "
            "one cannot be added to; take it out of the scene"
        )
    elif moment != 0.0:  # a spring that is not linear stays where it rests
        name = "joint_stiffness_moment"
        _add_periodic_torque(spec, name, bench.joint, 0.0, 0.0, -sign * moment)
    if bench.lever is not None:
        return
    angle, kind = "joint_stiffness_angle", mjtSensor.mjSENS_JOINTPOS
    _add_sensor(spec, angle, kind, mjtObj.mjOBJ_JOINT, bench.joint)
    add_torque_part(spec, JOINT_TORQUE, angle, -added)
    add_constant(spec, JOINT_TORQUE, -moment)


def inertia(side: Literal["motor", "joint"]) -> Realise:
    """Return a function that adds inertia between a side's sensor and its pulley."""
    channel, sign = (MOTOR_TORQUE, 1.0) if side == "motor" else (JOINT_TORQUE, -1.0)

    def add(spec: MjSpec, bench: Bench, values: Values) -> None:
        name, size = getattr(bench, side), values[f"{side}_inertia"]
        if size == 0.0:
            return
        model, joint = spec.compile(), spec.joint(name)
        index = model.joint(name).id
        present = model.dof_M0[model.jnt_dofadr[index]]
        if present + size <= 0.0:
            raise CableError(
                f"joint {name!r} has an inertia of {present:.3g} kg m^2, so "
                f"{size:.3g} cannot be added; give the scene's joint its whole inertia"
            )
        joint.armature += size
        if bench.lever is not None:
            return
        # No sensor shows armature, but one the torque on a body that rides along.
        joint.armature -= Limit.probe_inertia
        shown = sensor_word(f"{name}_acceleration")
        place = model.jnt_pos[index]
        probe = joint.parent.add_body(name=f"{name}_acceleration", pos=place)
        _set_isotropic_inertia(probe, np.zeros(3), Limit.probe_inertia)
        along = np.empty(4)
        mujoco.mju_quatZ2Vec(along, model.jnt_axis[index])
        site = probe.add_site(name=shown, pos=[0.0] * 3, quat=along, rgba=[0.0] * 4)
        site.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        _add_sensor(spec, shown, mjtSensor.mjSENS_TORQUE, mjtObj.mjOBJ_SITE, shown)
        add_torque_part(spec, channel, shown, sign * size / Limit.probe_inertia)

    return add


def _set_isotropic_inertia(body: MjsBody, centre: FloatArray, inertia: float) -> None:
    """Give a body the same inertia about every axis, and a milligram of mass."""
    body.mass, body.ipos, body.inertia = 1e-6, centre, [inertia] * 3
    body.explicitinertial = True


@dataclass(frozen=True)
class _Realisation:
    apply: Realise  # changes a scene
    # Whether it needs a pulley, or torques as sums of sensors; a lever has neither
    pulley: bool = True
    # Means of the realisation, and advice to a user of the scene; by default the
    # `scene_note` of the effect
    note: str = ""
    # Names of its values, those of the effect unless given; 0 is off
    parameters: tuple[str, ...] = ()


REALISATIONS: dict[str, _Realisation] = {
    "angle_offset": _Realisation(
        angle_offset,
        pulley=False,
        note="`ref` of the joint: where it is when the cables are at rest",
        parameters=("joint_angle_offset",),
    ),
    "backlash": _Realisation(backlash),
    "motor_cogging": _Realisation(cogging, pulley=False),
    "joint_gravity": _Realisation(gravity, pulley=False),
    "joint_stiffness": _Realisation(stiffness, pulley=False),
    "joint_inertia": _Realisation(inertia("joint"), pulley=False),
    "motor_inertia": _Realisation(inertia("motor"), pulley=False),
    "sensor_cross_talk": _Realisation(cross_talk),
    "torque_sensor_gain": _Realisation(gain),
    "torque_offset": _Realisation(
        torque_offset,
        note="a constant in the sums that are the torques",
        parameters=("motor_torque_offset", "joint_torque_offset"),
    ),
    "torque_sensor_offset": _Realisation(bias),
    "sensor_delay": _Realisation(delay),
}
"""Every effect outside the cable, and the offsets that a baseline has tuned, by id."""


def realisations() -> dict[str, _Realisation]:
    """Return the table of effects that edit the scene, mechanics before sensors."""
    whole = dict(REALISATIONS)
    for effect in EFFECTS.values():
        if effect.edit_spec is not None:
            whole[effect.id] = _Realisation(effect.edit_spec)
        if effect.id in whole:
            names = tuple(parameter.name for parameter in effect.parameters)
            note, entry = effect.scene_note, whole[effect.id]
            whole[effect.id] = replace(entry, note=note, parameters=names)
    late = {"torque_offset", *(e.id for e in EFFECTS.values() if e.sensor)}
    return {name: whole[name] for name in sorted(whole, key=late.__contains__)}


def is_realisable(bench: Bench, name: str) -> bool:
    return not unrealisable_reason(bench, name)


def unrealisable_reason(bench: Bench, name: str) -> str:
    """Return the reason why a scene cannot have an effect; "" if it can."""
    realisation, effect = realisations().get(name), EFFECTS.get(name)
    if realisation is not None:
        if bench.lever is not None and realisation.pulley:
            return (
                "it takes pulleys at both ends, and the joint of this scene has a lever"
            )
        return ""
    outside = effect and (effect.torques or effect.joint_arm or effect.motor_arm)
    if effect is None or effect.cables is None or outside:
        usual = "nothing says how MuJoCo has it (method `edit_spec` of its class)"
        if effect is not None and effect.rare:  # of the library
            usual = "this package has no form of it in MuJoCo"
        return (effect and effect.scene_note) or usual
    return ""  # keys of the cables
