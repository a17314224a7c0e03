"""The four channels of a rig in a scene, as weighted sums of MuJoCo's sensors.

    instrument(spec, bench)
    model = spec.compile()
    ...
    read_channels(model, data).joint_torque

Angles are `jointpos` sensors. No sensor of MuJoCo adds the forces of two cables on a
pulley, so each torque is a `<tuple>` in `<custom>`, named like its column: sensors and
the weights (`prm`) of their sum. Of a sensor with several numbers the last one counts,
the component along z. Delay is an attribute of the sensors themselves, so nothing here
keeps a state: `read_channels` is right in any simulation of the scene.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import mujoco
import numpy as np

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.diagnosis._verdict import PREDICTED_CHANNELS
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray

MOTOR_TORQUE, JOINT_TORQUE = PREDICTED_CHANNELS
MOTOR_ANGLE, JOINT_ANGLE = "motor_angle_rad", "joint_angle_rad"
_SENSOR = mujoco.mjtObj.mjOBJ_SENSOR


class Measured(NamedTuple):
    """Readings of the sensors of a rig at one instant.

    Attributes:
        motor_angle: [rad].
        motor_torque: that the motor puts into its pulley [N m].
        joint_angle: [rad].
        joint_torque: that the transmission puts into the joint [N m].
    """

    motor_angle: float
    motor_torque: float
    joint_angle: float
    joint_torque: float


class SensorShare(NamedTuple):
    """Share of one sensor in a torque: its name and the weight of its last number."""

    sensor: str
    weight: float


def read_channels(model: mujoco.MjModel, data: mujoco.MjData) -> Measured:
    """Return the four channels at the last evaluation of the sensors.

    After `mj_step` that is the configuration at which the step began.

    Raises:
        CableError: the scene has no instruments.
    """
    motor, joint = torque_weights(model) @ data.sensordata
    proximal, distal = (
        data.sensordata[model.sensor_adr[sensor]] for sensor in angle_sensors(model)
    )
    return Measured(float(proximal), float(motor), float(distal), float(joint))


def torque_weights(model: mujoco.MjModel) -> FloatArray:
    """Return the motor and joint torque as sums of sensor data (2, sensordata)."""
    weights = np.zeros((len(PREDICTED_CHANNELS), model.nsensordata))
    for row, channel in enumerate(PREDICTED_CHANNELS):
        index = _index(model, mujoco.mjtObj.mjOBJ_TUPLE, channel, "tuple")
        start = model.tuple_adr[index]
        for item in range(start, start + model.tuple_size[index]):
            sensor = model.tuple_objid[item]
            last = model.sensor_adr[sensor] + model.sensor_dim[sensor] - 1
            weights[row, last] += model.tuple_objprm[item]
    return weights


def angle_sensors(model: mujoco.MjModel) -> tuple[int, int]:
    return (
        _index(model, _SENSOR, MOTOR_ANGLE, "sensor"),
        _index(model, _SENSOR, JOINT_ANGLE, "sensor"),
    )


def has_instruments(spec: mujoco.MjSpec) -> bool:
    return all(spec.tuple(name) is not None for name in PREDICTED_CHANNELS) and all(
        spec.sensor(name) is not None for name in (MOTOR_ANGLE, JOINT_ANGLE)
    )


def add_instruments(spec: mujoco.MjSpec, bench: Bench) -> None:
    """Add the four channels to a scene, except those that it has.

    The radii of the bench are the weights of the cables' tensions.
    """
    if bench.lever is not None:
        raise CableError(
            f"scene {bench.path}: cable {bench.names[0]} pulls a lever, whose torque "
            "is no sum of sensors"
        )
    angle = mujoco.mjtSensor.mjSENS_JOINTPOS
    for name, joint in ((MOTOR_ANGLE, bench.motor), (JOINT_ANGLE, bench.joint)):
        found = spec.sensor(name)
        if found is None:
            spec.add_sensor(
                name=name,
                type=angle,
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
                objname=joint,
            )
        elif (found.type, found.objname) != (angle, joint):
            raise CableError(
                f"scene {bench.path}: the sensor {name!r} must be a <jointpos> of "
                f"joint {joint!r}; rename it"
            )
    signs = (1.0, -1.0)
    for channel, end, radius in (
        (MOTOR_TORQUE, 0, bench.motor_radius),
        (JOINT_TORQUE, 1, -bench.joint_radius),
    ):
        actuators = [_ends(spec, cable)[end] for cable in bench.names]
        ends = [
            SensorShare(force_sensor(spec, actuator), sign * radius)
            for actuator, sign in zip(actuators, signs, strict=False)
        ]
        others = [
            part
            for part in torque_parts(spec, channel)
            if not _shows_force_of(spec.sensor(part.sensor), actuators)
        ]
        set_torque_parts(spec, channel, [*ends, *others])


def force_sensor(spec: mujoco.MjSpec, actuator: str) -> str:
    """Return the plain sensor of an actuator's force, added if missing."""
    for sensor in spec.sensors:
        plain = sensor.delay == 0.0 and sensor.nsample == 0 and sensor.cutoff == 0.0
        usable = sensor.name and sensor.name == sensor_word(sensor.name)
        if _shows_force_of(sensor, [actuator]) and plain and usable:
            return str(sensor.name)
    name = sensor_word(f"{actuator}_force")
    spec.add_sensor(
        name=name,
        type=mujoco.mjtSensor.mjSENS_ACTUATORFRC,
        objtype=mujoco.mjtObj.mjOBJ_ACTUATOR,
        objname=actuator,
    )
    return name


def sensor_word(name: str) -> str:
    """Return a sensor name without blanks, which would split a `<tuple>` list."""
    return "_".join(name.split())


def torque_parts(spec: mujoco.MjSpec, channel: str) -> list[SensorShare]:
    """Return the summands of a torque, empty if the scene does not define them."""
    found = spec.tuple(channel)
    if found is None:
        return []
    return [
        SensorShare(str(name), float(weight))
        for name, weight in zip(found.objname, found.objprm, strict=True)
    ]


def set_torque_parts(
    spec: mujoco.MjSpec, channel: str, wanted: list[SensorShare]
) -> None:
    found = spec.tuple(channel)
    if found is None:
        found = spec.add_tuple(name=channel)
    found.objtype = [int(_SENSOR)] * len(wanted)
    found.objname = [part.sensor for part in wanted]
    found.objprm = [part.weight for part in wanted]


def add_torque_part(
    spec: mujoco.MjSpec, channel: str, sensor: str, weight: float
) -> None:
    """Add a sensor to the sum of a torque, as `torque_parts` has it."""
    set_torque_parts(
        spec, channel, [*torque_parts(spec, channel), SensorShare(sensor, weight)]
    )


@contextmanager
def without_delay(model: mujoco.MjModel) -> Iterator[None]:
    """Make all sensors of a model show the present while the block runs."""
    delay = model.sensor_delay.copy()
    model.sensor_delay[:] = 0.0
    try:
        yield
    finally:
        model.sensor_delay[:] = delay


def _ends(spec: mujoco.MjSpec, cable: str) -> tuple[str, str]:
    """Return the names of the actuators at a cable's ends, added if missing."""
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


def _shows_force_of(sensor: mujoco.MjsSensor | None, actuators: list[str]) -> bool:
    """Return whether a sensor shows the force of one of these actuators."""
    force = mujoco.mjtSensor.mjSENS_ACTUATORFRC
    return sensor is not None and sensor.type == force and sensor.objname in actuators


def _index(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str, what: str) -> int:
    index = mujoco.mj_name2id(model, kind, name)
    if index < 0:
        raise CableError(
            f"the scene has no {what} {name!r}; give it the four channels with "
            "`instrument`"
        )
    return int(index)
