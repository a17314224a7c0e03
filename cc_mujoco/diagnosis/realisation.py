"""How MuJoCo has the effects that are not in the cable.

    REALISATIONS["joint_stiffness"].apply(spec, bench, {"joint_stiffness": 0.5})

Every entry changes a scene so that it moves as the effect says, and so that the torques
that `instruments.measured` reads show it. All of it is plain MJCF: actuators without
input, hinges, tendons, springs, armature, sensors with delay. To add an effect, write
its entry; entries are applied in the order of the table, mechanics before sensors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.bench import Bench
from cc_mujoco.diagnosis.instruments import (
    JOINT_ANGLE,
    JOINT_TORQUE,
    MOTOR_ANGLE,
    MOTOR_TORQUE,
    Part,
    add_part,
    force_sensor,
    parts,
    set_parts,
)
from cc_mujoco.engine.config import PLUGIN
from cc_mujoco.errors import CableError
from cc_mujoco.transmission import Cable

Values = Mapping[str, float]

PROBE_INERTIA = 1e-6
"""Of the body whose torque shows an acceleration [kg m^2]."""
PLAY_DAMPING = 0.02
"""Damping ratio of a pulley that swings in its play on the cables alone."""
NO_INPUT = 16
"""`ctrlspec` of an actuator with `input="none"`: it adds nothing to `ctrl`."""
CLOCK, ONE = "instrument_clock", "instrument_one"
"""Sensors that show the time and the number 1."""


@dataclass(frozen=True)
class Realisation:
    """How MuJoCo has one effect.

    Attributes:
        parameters: names of its values; 0 is off, and leaves the scene as it was.
        note: with what, and what a user of the scene should know.
        apply: changes a scene.
    """

    parameters: tuple[str, ...]
    note: str
    apply: Callable[[mujoco.MjSpec, Bench, Values], None]


def end_stiffness(cable: Cable) -> float:
    """Stiffness of a cable's end where only its last segment moves [N/m]."""
    return 2.0 * cable.segments * cable.axial_stiffness / cable.length


def rim_stiffness(bench: Bench, radius: float) -> float:
    """The same of all cables, about a pulley of this radius [Nm/rad]."""
    return sum(end_stiffness(cable) for cable in bench.cables) * radius**2


def _backlash(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    """Joint and pulley on hinges of their own, coupled by a tendon with two limits."""
    play = values["backlash"]
    if play < 0.0:
        raise CableError(f"backlash is {play!r} rad; it must be 0 or more")
    name, step = f"{bench.joint}_pulley", spec.option.timestep
    # The cables' stiffness and this inertia swing with 1 / step, half of what an
    # explicit force allows.
    inertia = rim_stiffness(bench, bench.joint_radius) * step**2
    joint = spec.joint(bench.joint)
    model = spec.compile()
    index = model.joint(bench.joint).id
    body = model.jnt_bodyid[index]
    pulley = joint.parent.parent.add_body(
        name=name,
        pos=model.body_pos[body],
        quat=model.body_quat[body],
    )
    _weightless(pulley, model.jnt_pos[index], inertia)
    pulley.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        pos=model.jnt_pos[index],
        axis=model.jnt_axis[index],
        ref=joint.ref,
    )
    for actuator in spec.actuators:
        own = actuator.plugin.plugin_name == PLUGIN
        if own and actuator.plugin.name in bench.names:
            if actuator.target == bench.joint:
                actuator.target = name
    tendon = spec.add_tendon(
        name=f"{bench.joint}_backlash",
        limited=True,
        range=[-play / 2.0, play / 2.0],
        solref_limit=[4.0 * step, 1.0],
        solimp_limit=[0.99, 0.9999, play / 100.0, 0.5, 2.0],
    )
    tendon.damping[0] = 2.0 * PLAY_DAMPING * inertia / step
    tendon.wrap_joint(name, 1.0)
    tendon.wrap_joint(bench.joint, -1.0)


def _cogging(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    order = values["cogging_order"]
    cosine, sine = values["cogging_cosine"], values["cogging_sine"]
    if cosine == sine == 0.0:
        return
    _wave(spec, "motor_cogging", bench.motor, order, -sine, -cosine)
    add_part(spec, MOTOR_TORQUE, force_sensor(spec, "motor_cogging"), -1.0)


def _gravity(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    cosine, sine = values["gravity_cosine"], values["gravity_sine"]
    if cosine == sine == 0.0:
        return
    _wave(spec, "joint_gravity", bench.joint, 1.0, -sine, -cosine)
    add_part(spec, JOINT_TORQUE, force_sensor(spec, "joint_gravity"), 1.0)


def _wave(
    spec: mujoco.MjSpec,
    name: str,
    joint: str,
    order: float,
    sine: float,
    cosine: float,
) -> None:
    """Torque sine sin(order q) + cosine cos(order q): a DC motor that only cogs."""
    actuator = spec.add_actuator(name=name)
    actuator.trntype, actuator.target = mujoco.mjtTrn.mjTRN_JOINT, joint
    wave = [math.hypot(sine, cosine), order, math.atan2(cosine, sine)]
    actuator.set_to_dcmotor(
        motorconst=[0.0, 0.0], resistance=1.0, cogging=wave, ctrlspec=NO_INPUT
    )


def _stiffness(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    """Two springs in parallel are one, at rest in between."""
    added = values["joint_stiffness"]
    joint = spec.joint(bench.joint)
    present, rest = float(joint.stiffness[0]), float(joint.springref)
    total = present + added
    if rest != 0.0 and (total == 0.0 or any(joint.stiffness[1:])):
        raise CableError(
            f"joint {bench.joint!r} has a spring about {rest:g} rad that another one "
            "about 0 cannot be added to; take it out of the scene"
        )
    joint.stiffness[0] = total
    joint.springref = present * rest / total if rest != 0.0 else 0.0
    angle = "joint_stiffness_angle"
    spec.add_sensor(
        name=angle,
        type=mujoco.mjtSensor.mjSENS_JOINTPOS,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        objname=bench.joint,
    )
    add_part(spec, JOINT_TORQUE, angle, -added)


def _joint_inertia(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    _inertia(spec, bench.joint, values["joint_inertia"], JOINT_TORQUE, -1.0)


def _motor_inertia(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    _inertia(spec, bench.motor, values["motor_inertia"], MOTOR_TORQUE, 1.0)


def _inertia(
    spec: mujoco.MjSpec, name: str, inertia: float, channel: str, sign: float
) -> None:
    """More armature of a joint, and the torque that accelerates it in a channel."""
    if inertia == 0.0:
        return
    joint = spec.joint(name)
    model = spec.compile()
    present = model.dof_M0[model.joint(name).dofadr[0]]
    if present + inertia <= 0.0:
        raise CableError(
            f"joint {name!r} has an inertia of {present:.3g} kg m^2, so {inertia:.3g} "
            "cannot be added; give the scene's joint its whole inertia"
        )
    joint.armature += inertia - PROBE_INERTIA
    # MuJoCo's sensors do not see armature; they see what turns a body that rides along.
    index = model.joint(name).id
    probe = joint.parent.add_body(
        name=f"{name}_acceleration",
        pos=model.jnt_pos[index],
    )
    _weightless(probe, np.zeros(3), PROBE_INERTIA)
    along = np.empty(4)
    mujoco.mju_quatZ2Vec(along, model.jnt_axis[index])
    site = probe.add_site(name=f"{name}_acceleration", quat=along)
    spec.add_sensor(
        name=site.name,
        type=mujoco.mjtSensor.mjSENS_TORQUE,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=site.name,
    )
    add_part(spec, channel, site.name, sign * inertia / PROBE_INERTIA)


def _weightless(body: mujoco.MjsBody, centre: FloatArray, inertia: float) -> None:
    """Give a body the same inertia about every axis, and a milligram of mass."""
    body.mass, body.ipos, body.inertia = 1e-6, centre, [inertia] * 3
    body.explicitinertial = True


def _zero(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    """Offsets that a baseline has tuned."""
    spec.joint(bench.joint).ref -= values["joint_angle_offset"]
    for channel, name in (
        (MOTOR_TORQUE, "motor_torque_offset"),
        (JOINT_TORQUE, "joint_torque_offset"),
    ):
        if values[name] != 0.0:
            add_part(spec, channel, _one(spec), values[name])


def _gain(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    for channel, name in (
        (MOTOR_TORQUE, "motor_torque_gain"),
        (JOINT_TORQUE, "joint_torque_gain"),
    ):
        gain = 1.0 + values[name]
        scaled = [Part(p.sensor, gain * p.weight) for p in parts(spec, channel)]
        set_parts(spec, channel, scaled)


def _offset(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    for channel, name in (
        (MOTOR_TORQUE, "motor_torque_drift"),
        (JOINT_TORQUE, "joint_torque_drift"),
    ):
        if values[name] != 0.0:
            if spec.sensor(CLOCK) is None:
                spec.add_sensor(name=CLOCK, type=mujoco.mjtSensor.mjSENS_CLOCK)
            add_part(spec, channel, CLOCK, values[name])


def _delay(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    """Delay torques; a torque that comes early delays everything else."""
    delay = {
        MOTOR_TORQUE: values["motor_torque_delay"],
        JOINT_TORQUE: values["joint_torque_delay"],
    }
    common = max(0.0, -min(delay.values()))
    for name in (MOTOR_ANGLE, JOINT_ANGLE):
        if common > 0.0:
            _late(spec, spec.sensor(name), common)
    for channel, own in delay.items():
        if own + common == 0.0:
            continue
        delayed = []
        for part in parts(spec, channel):
            source = spec.sensor(part.sensor)
            if source.name in (CLOCK, ONE):
                delayed.append(part)
                continue
            copy = spec.add_sensor(
                name=f"{channel}_{source.name}",
                type=source.type,
                objtype=source.objtype,
                objname=source.objname,
            )
            _late(spec, copy, own + common)
            delayed.append(Part(copy.name, part.weight))
        set_parts(spec, channel, delayed)


def _late(spec: mujoco.MjSpec, sensor: mujoco.MjsSensor, delay: float) -> None:
    sensor.delay = delay
    sensor.interp = 1
    # Enough to be played at half the time step, too.
    sensor.nsample = 2 * math.ceil(delay / spec.option.timestep) + 4


def _one(spec: mujoco.MjSpec) -> str:
    """Name of a sensor whose last number is always 1: the world's own z axis."""
    if spec.sensor(ONE) is None:
        spec.add_sensor(
            name=ONE,
            type=mujoco.mjtSensor.mjSENS_FRAMEZAXIS,
            objtype=mujoco.mjtObj.mjOBJ_XBODY,
            objname="world",
        )
    return ONE


REALISATIONS: dict[str, Realisation] = {
    "backlash": Realisation(
        ("backlash",),
        "the cables' pulley turns on a hinge of its own and takes the joint along "
        "through a fixed tendon with two limits; the pulley has the least inertia that "
        "the time step allows",
        _backlash,
    ),
    "motor_cogging": Realisation(
        ("cogging_cosine", "cogging_sine", "cogging_order"),
        "the cogging torque of MuJoCo's DC motor, as an actuator without input",
        _cogging,
    ),
    "joint_gravity": Realisation(
        ("gravity_sine", "gravity_cosine"),
        "the same with one period per turn: independent of the joint's axis in space "
        "and of the mass of the scene",
        _gravity,
    ),
    "joint_stiffness": Realisation(
        ("joint_stiffness",),
        "stiffness of the joint, about 0",
        _stiffness,
    ),
    "joint_inertia": Realisation(
        ("joint_inertia",),
        "armature of the joint; a weightless body that rides along shows it",
        _joint_inertia,
    ),
    "motor_inertia": Realisation(
        ("motor_inertia",),
        "armature of the motor; a weightless body that rides along shows it",
        _motor_inertia,
    ),
    "baseline": Realisation(
        ("joint_angle_offset", "motor_torque_offset", "joint_torque_offset"),
        "`ref` of the joint, where the cables are at rest; offsets in the sums that "
        "are the torques",
        _zero,
    ),
    "torque_sensor_gain": Realisation(
        ("motor_torque_gain", "joint_torque_gain"),
        "weights of the sums that are the torques",
        _gain,
    ),
    "torque_sensor_offset": Realisation(
        ("motor_torque_drift", "joint_torque_drift"),
        "a clock in the sums that are the torques",
        _offset,
    ),
    "sensor_delay": Realisation(
        ("motor_torque_delay", "joint_torque_delay"),
        "MuJoCo's own delay of sensors, linear between steps; where a torque comes "
        "early, the angles and the other torque are delayed instead",
        _delay,
    ),
}
"""Every effect outside the cable, and the offsets of a baseline, by id."""
