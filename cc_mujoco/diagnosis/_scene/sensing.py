"""Effects of sensors in a scene: offsets, gain, drift, delay."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import mujoco

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.diagnosis._scene.instruments import (
    JOINT_ANGLE,
    JOINT_TORQUE,
    MOTOR_ANGLE,
    MOTOR_TORQUE,
    SensorShare,
    add_torque_part,
    sensor_word,
    set_torque_parts,
    torque_parts,
)
from cc_mujoco.errors import CableError

Values = Mapping[str, float]

CLOCK_SENSOR, UNIT_SENSOR = "instrument_clock", "instrument_one"
"""Sensors that show the time and the number 1; they are never late."""


def angle_offset(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    """Shift the joint: cables rest where motor and joint plus offset agree."""
    sign = 1.0 if bench.lever is None else bench.lever.sign
    offset = sign * values["joint_angle_offset"]
    # A specification keeps the unit of its file.
    unit = math.degrees(1.0) if spec.compiler.degree else 1.0
    spec.joint(bench.joint).ref -= offset * unit


def torque_offset(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    """Add a constant to each torque."""
    add_constant(spec, MOTOR_TORQUE, values["motor_torque_offset"])
    add_constant(spec, JOINT_TORQUE, values["joint_torque_offset"])


def gain(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    """Scale the torque readings by a gain error."""
    for channel, name in (
        (MOTOR_TORQUE, "motor_torque_gain"),
        (JOINT_TORQUE, "joint_torque_gain"),
    ):
        gain = 1.0 + values[name]
        scaled = [
            SensorShare(p.sensor, gain * p.weight) for p in torque_parts(spec, channel)
        ]
        set_torque_parts(spec, channel, scaled)


def cross_talk(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    """Add to each torque reading a share of the other one."""
    both = (MOTOR_TORQUE, JOINT_TORQUE)
    parts = {channel: torque_parts(spec, channel) for channel in both}
    for channel, other, name in (
        (MOTOR_TORQUE, JOINT_TORQUE, "motor_torque_cross_talk"),
        (JOINT_TORQUE, MOTOR_TORQUE, "joint_torque_cross_talk"),
    ):
        for part in parts[other]:
            add_torque_part(spec, channel, part.sensor, values[name] * part.weight)


def bias(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    """Add a constant and a drift to the torque readings."""
    for channel, side in ((MOTOR_TORQUE, "motor"), (JOINT_TORQUE, "joint")):
        add_constant(spec, channel, values[f"{side}_torque_bias"])
        drift = values[f"{side}_torque_drift"]
        if drift != 0.0:
            _ensure_sensor(spec, CLOCK_SENSOR, mujoco.mjtSensor.mjSENS_CLOCK)
            add_torque_part(spec, channel, CLOCK_SENSOR, drift)


def delay(spec: mujoco.MjSpec, bench: Bench, values: Values) -> None:
    """Delay readings; one that comes early delays everything else.

    In MuJoCo a sensor is late by a time step or more; by less than half, it is not.
    """
    side = values["joint_delay"]
    angles = {MOTOR_ANGLE: 0.0, JOINT_ANGLE: side}
    torques = {
        MOTOR_TORQUE: values["motor_torque_delay"],
        JOINT_TORQUE: side + values["joint_torque_delay"],
    }
    common = max(0.0, -min([*angles.values(), *torques.values()]))
    for name, own in angles.items():
        if own + common >= 0.5 * spec.option.timestep:
            _delay_sensor(spec, spec.sensor(name), own + common)
    for channel, own in torques.items():
        if own + common < 0.5 * spec.option.timestep:
            continue
        delayed = []
        for part in torque_parts(spec, channel):
            source = spec.sensor(part.sensor)
            if source.name in (CLOCK_SENSOR, UNIT_SENSOR):
                delayed.append(part)
                continue
            copy = spec.add_sensor(
                name=sensor_word(f"{channel}_{source.name}"),
                type=source.type,
                objtype=source.objtype,
                objname=source.objname,
            )
            _delay_sensor(spec, copy, own + common)
            delayed.append(SensorShare(copy.name, part.weight))
        set_torque_parts(spec, channel, delayed)


def add_constant(spec: mujoco.MjSpec, channel: str, value: float) -> None:
    """Add a constant to a channel [N m]."""
    if value != 0.0:
        add_torque_part(spec, channel, _unit_sensor(spec), value)


def _delay_sensor(spec: mujoco.MjSpec, sensor: mujoco.MjsSensor, delay: float) -> None:
    sensor.delay = delay
    sensor.interp = 1
    # Enough to be played at half the time step, too.
    sensor.nsample = 2 * math.ceil(delay / spec.option.timestep) + 4


def _unit_sensor(spec: mujoco.MjSpec) -> str:
    """Name of a sensor whose last number is always 1: the world's own z axis."""
    _ensure_sensor(
        spec,
        UNIT_SENSOR,
        mujoco.mjtSensor.mjSENS_FRAMEZAXIS,
        objtype=mujoco.mjtObj.mjOBJ_XBODY,
        objname="world",
    )
    return UNIT_SENSOR


def _ensure_sensor(
    spec: mujoco.MjSpec, name: str, kind: mujoco.mjtSensor, **shown: Any
) -> None:
    """Add a sensor unless it is there."""
    found = spec.sensor(name)
    if found is None:
        spec.add_sensor(name=name, type=kind, **shown)
    elif found.type != kind:
        raise CableError(f"the scene has a sensor {name!r} of its own; rename it")
