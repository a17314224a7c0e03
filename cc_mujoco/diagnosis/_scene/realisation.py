"""Realisation in MuJoCo of the effects that are not in the cable.

    REALISATIONS["motor_inertia"].apply(spec, bench, {"motor_inertia": 2e-4})

Every entry changes a scene so that its motion and its measured torques show the effect.
The torques of a lever do not show it. All changes are plain MJCF: actuators without
input, hinges, tendons, springs, armature, sensors with delay. To add an effect, write
its entry; entries are applied in the order of the table, mechanics before sensors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.diagnosis._scene import mechanical, sensing
from cc_mujoco.diagnosis._scene.mechanical import Values
from cc_mujoco.diagnosis.effects import EFFECTS


@dataclass(frozen=True)
class _Realisation:
    """Realisation of one effect in MuJoCo.

    Attributes:
        parameters: names of its values; 0 is off, and leaves the scene as it was.
        note: with what, and what a user of the scene should know.
        apply: changes a scene.
        pulley: whether it takes a pulley, or torques that are sums of sensors, which a
            joint with a lever has not.
    """

    parameters: tuple[str, ...]
    note: str
    apply: Callable[[mujoco.MjSpec, Bench, Values], None]
    pulley: bool = True


REALISATIONS: dict[str, _Realisation] = {
    "angle_offset": _Realisation(
        ("joint_angle_offset",),
        "`ref` of the joint: where it is when the cables are at rest",
        sensing.angle_offset,
        pulley=False,
    ),
    "backlash": _Realisation(
        ("backlash",),
        "the cables' pulley turns on a hinge of its own and takes the joint along "
        "through a fixed tendon with two limits; the pulley has the least inertia that "
        "the time step allows",
        mechanical.backlash,
    ),
    "motor_cogging": _Realisation(
        ("cogging_cosine", "cogging_sine", "cogging_order"),
        "the cogging torque of MuJoCo's DC motor, as an actuator without input",
        mechanical.cogging,
        pulley=False,
    ),
    "joint_gravity": _Realisation(
        ("gravity_sine", "gravity_cosine"),
        "the same with one period per turn: independent of the joint's axis in space "
        "and of the mass of the scene, as the rig stands that is not turned",
        mechanical.gravity,
        pulley=False,
    ),
    "joint_stiffness": _Realisation(
        ("joint_stiffness", "joint_stiffness_moment"),
        "stiffness of the joint, about where it rests",
        mechanical.stiffness,
        pulley=False,
    ),
    "joint_inertia": _Realisation(
        ("joint_inertia",),
        "armature of the joint; a weightless body that rides along shows it",
        mechanical.joint_inertia,
        pulley=False,
    ),
    "motor_inertia": _Realisation(
        ("motor_inertia",),
        "armature of the motor; a weightless body that rides along shows it",
        mechanical.motor_inertia,
        pulley=False,
    ),
    "sensor_cross_talk": _Realisation(
        ("motor_torque_cross_talk", "joint_torque_cross_talk"),
        "each torque is also a weighted sum of the sensors of the other one",
        sensing.cross_talk,
    ),
    "torque_sensor_gain": _Realisation(
        ("motor_torque_gain", "joint_torque_gain"),
        "weights of the sums that are the torques",
        sensing.gain,
    ),
    "torque_offset": _Realisation(
        ("motor_torque_offset", "joint_torque_offset"),
        "a constant in the sums that are the torques",
        sensing.torque_offset,
    ),
    "torque_sensor_offset": _Realisation(
        (
            "motor_torque_bias",
            "joint_torque_bias",
            "motor_torque_drift",
            "joint_torque_drift",
        ),
        "a constant and a clock in the sums that are the torques",
        sensing.bias,
    ),
    "sensor_delay": _Realisation(
        ("joint_delay", "motor_torque_delay", "joint_torque_delay"),
        "MuJoCo's own delay of sensors, linear between steps; where a torque comes "
        "early, the angles and the other torque are delayed instead",
        sensing.delay,
    ),
}
"""Every effect outside the cable, and the offsets that a baseline has tuned, by id."""


def realisations() -> dict[str, _Realisation]:
    """Return the table with the effects that edit the scene by themselves.

    Those of the mechanics come before those of sensors.
    """
    own = {
        effect.id: _Realisation(
            tuple(parameter.name for parameter in effect.parameters),
            effect.mujoco,
            effect.edit_spec,
        )
        for effect in EFFECTS.values()
        if effect.edit_spec is not None
    }
    late = {name for name in (*REALISATIONS, *own) if _of_sensor(name)}
    whole = {**REALISATIONS, **own}
    return {name: whole[name] for name in sorted(whole, key=lambda n: n in late)}


def _of_sensor(name: str) -> bool:
    return name == "torque_offset" or (name in EFFECTS and EFFECTS[name].sensor)


def is_realisable(bench: Bench, name: str) -> bool:
    """Return whether a scene can have an effect."""
    return not unrealisable_reason(bench, name)


def unrealisable_reason(bench: Bench, name: str) -> str:
    """Return why a scene cannot have an effect; empty where it can."""
    realisation = realisations().get(name)
    if realisation is not None:
        if bench.lever is None or not realisation.pulley:
            return ""
        return "it takes pulleys at both ends, and the joint of this scene has a lever"
    effect = EFFECTS.get(name)
    if effect is not None and effect.cables is not None:
        if not (effect.torques or effect.joint_arm or effect.motor_arm):
            return ""  # keys of the cables
    return "nothing says how MuJoCo has it (method `edit_spec` of its class)"
