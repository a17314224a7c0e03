"""Effects of motor and joint in a scene: play, ripple, gravity, springs, inertia.

Each function adds an effect to the motion of a scene and to the torques of
`instruments`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np

from cc_mujoco.cable._conduit import end_stiffness
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.diagnosis._scene.instruments import (
    JOINT_TORQUE,
    MOTOR_TORQUE,
    add_torque_part,
    force_sensor,
    sensor_word,
)
from cc_mujoco.diagnosis._scene.sensing import add_constant
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray

Values = Mapping[str, float]

PROBE_INERTIA = 1e-6
"""Inertia of the body whose torque measures an acceleration [kg m^2]."""
PLAY_DAMPING = 0.02
"""Damping ratio of a pulley within its play, on the cables alone."""
GRAVITY_ACTUATOR = "joint_gravity"
"""Name of the actuator that exerts the torque of a weight."""
_PHASE_INDEX = 2
"""Index of the ripple's phase in the bias parameters of a DC motor."""
NO_INPUT = 16
"""`ctrlspec` of an actuator with `input="none"`, which adds no element to `ctrl`."""


def rim_stiffness(bench: Bench, radius: float) -> float:
    """Return the stiffness of all cables' ends about a pulley of this radius [N m/rad].

    Each cable counts with its stiffer end, where only the outermost segment moves.
    """
    return sum(max(end_stiffness(cable)) for cable in bench.cables) * radius**2


def backlash(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    """Separate joint and pulley into two hinges, coupled by a tendon with limits."""
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
    _set_isotropic_inertia(pulley, model.jnt_pos[index], inertia)
    # All attributes are set, because a scene may have defaults.
    hinge = pulley.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        pos=model.jnt_pos[index],
        axis=model.jnt_axis[index],
        ref=joint.ref,
        limited=False,
        armature=0.0,
        frictionloss=0.0,
    )
    hinge.damping[:] = 0.0
    hinge.stiffness[:] = 0.0
    for actuator in spec.actuators:
        if actuator.plugin.name in bench.names and actuator.target == bench.joint:
            actuator.target = name
    tendon = spec.add_tendon(
        name=f"{bench.joint}_backlash",
        limited=True,
        range=[-play / 2.0, play / 2.0],
        margin=0.0,
        solref_limit=[4.0 * step, 1.0],
        solimp_limit=[0.999, 0.9999, play / 1000.0, 0.5, 2.0],
    )
    tendon.frictionloss, tendon.armature = 0.0, 0.0
    tendon.stiffness[:] = 0.0
    tendon.damping[:] = 0.0
    tendon.damping[0] = 2.0 * PLAY_DAMPING * inertia / step
    tendon.wrap_joint(name, 1.0)
    tendon.wrap_joint(bench.joint, -1.0)
    _keep_keyframes(spec, model, bench.joint, name)


def _keep_keyframes(
    spec: mujoco.MjSpec, before: mujoco.MjModel, joint: str, pulley: str
) -> None:
    """Keep every keyframe, with a new pulley at the angle of its joint.

    MuJoCo appends zeros, whichever joint is new.
    """
    after = spec.compile()
    old, new = before.joint(joint), after.joint(pulley)
    for key, pose, speed in zip(
        spec.keys, before.key_qpos, before.key_qvel, strict=True
    ):
        key.qpos = np.insert(pose, new.qposadr[0], pose[old.qposadr[0]])
        key.qvel = np.insert(speed, new.dofadr[0], speed[old.dofadr[0]])


def cogging(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    """Add a torque that loads the motor: cosine cos(order q) + sine sin(order q)."""
    order = values["cogging_order"]
    cosine, sine = values["cogging_cosine"], values["cogging_sine"]
    if cosine == sine == 0.0:
        return
    _add_periodic_torque(spec, "motor_cogging", bench.motor, order, -sine, -cosine)
    if bench.lever is None:
        add_torque_part(spec, MOTOR_TORQUE, force_sensor(spec, "motor_cogging"), -1.0)


def gravity(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    """Add a torque that opposes the joint: sine sin(q) + cosine cos(q)."""
    cosine, sine = values["gravity_cosine"], values["gravity_sine"]
    if bench.lever is not None:
        cosine *= bench.lever.sign  # angle and torque are both turned round
    _add_periodic_torque(spec, GRAVITY_ACTUATOR, bench.joint, 1.0, -sine, -cosine)
    if bench.lever is None:
        add_torque_part(spec, JOINT_TORQUE, force_sensor(spec, GRAVITY_ACTUATOR), 1.0)


def tilt_rig(model: mujoco.MjModel, tilt: float) -> None:
    """Turn a rig about its joint's axis by an angle [rad], which shifts its weight."""
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, GRAVITY_ACTUATOR)
    if number >= 0:
        model.actuator_biasprm[number, _PHASE_INDEX] += tilt


def _add_periodic_torque(
    spec: mujoco.MjSpec,
    name: str,
    joint: str,
    order: float,
    sine: float,
    cosine: float,
) -> None:
    """Add the torque sine sin(order q) + cosine cos(order q) as cogging of a motor."""
    actuator = spec.add_actuator(name=name)
    actuator.trntype, actuator.target = mujoco.mjtTrn.mjTRN_JOINT, joint
    actuator.gear, actuator.forcelimited = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], False
    wave = [math.hypot(sine, cosine), order, math.atan2(cosine, sine)]
    # Without an input the motor constant has no effect, but MuJoCo 3 refuses zero.
    actuator.set_to_dcmotor(
        motorconst=[1e-300, 0.0], resistance=1.0, cogging=wave, ctrlspec=NO_INPUT
    )


def stiffness(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    """Add a spring to the joint, combined with its present spring in parallel."""
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
        _add_periodic_torque(
            spec, "joint_stiffness_moment", bench.joint, 0.0, 0.0, -sign * moment
        )
    if bench.lever is not None:
        return
    angle = "joint_stiffness_angle"
    spec.add_sensor(
        name=angle,
        type=mujoco.mjtSensor.mjSENS_JOINTPOS,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        objname=bench.joint,
    )
    add_torque_part(spec, JOINT_TORQUE, angle, -added)
    add_constant(spec, JOINT_TORQUE, -moment)


def joint_inertia(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    """Add an inertia between transmission and joint sensor."""
    inertia = values["joint_inertia"]
    if _add_armature(spec, bench.joint, inertia) and bench.lever is None:
        _add_inertia_torque(spec, bench.joint, inertia, JOINT_TORQUE, -1.0)


def motor_inertia(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    """Add an inertia between motor sensor and pulley."""
    inertia = values["motor_inertia"]
    if _add_armature(spec, bench.motor, inertia) and bench.lever is None:
        _add_inertia_torque(spec, bench.motor, inertia, MOTOR_TORQUE, 1.0)


def _add_armature(spec: mujoco.MjSpec, name: str, inertia: float) -> bool:
    """Add armature to a joint; return False if there is none to add."""
    if inertia == 0.0:
        return False
    model = spec.compile()
    present = model.dof_M0[model.joint(name).dofadr[0]]
    if present + inertia <= 0.0:
        raise CableError(
            f"joint {name!r} has an inertia of {present:.3g} kg m^2, so {inertia:.3g} "
            "cannot be added; give the scene's joint its whole inertia"
        )
    spec.joint(name).armature += inertia
    return True


def _add_inertia_torque(
    spec: mujoco.MjSpec, name: str, inertia: float, channel: str, sign: float
) -> None:
    """Add the torque that accelerates additional armature to a channel."""
    joint = spec.joint(name)
    model = spec.compile()
    joint.armature -= PROBE_INERTIA
    # MuJoCo's sensors do not see armature; they see what turns a body that rides along.
    index = model.joint(name).id
    probe = joint.parent.add_body(
        name=f"{name}_acceleration",
        pos=model.jnt_pos[index],
    )
    _set_isotropic_inertia(probe, np.zeros(3), PROBE_INERTIA)
    along = np.empty(4)
    mujoco.mju_quatZ2Vec(along, model.jnt_axis[index])
    site = probe.add_site(
        name=sensor_word(f"{name}_acceleration"),
        pos=[0.0] * 3,
        quat=along,
        rgba=[0.0] * 4,
    )
    site.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    spec.add_sensor(
        name=site.name,
        type=mujoco.mjtSensor.mjSENS_TORQUE,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=site.name,
    )
    add_torque_part(spec, channel, site.name, sign * inertia / PROBE_INERTIA)


def _set_isotropic_inertia(
    body: mujoco.MjsBody, centre: FloatArray, inertia: float
) -> None:
    """Give a body the same inertia about every axis, and a milligram of mass."""
    body.mass, body.ipos, body.inertia = 1e-6, centre, [inertia] * 3
    body.explicitinertial = True
