"""Readings of an axis: one compiled function, for environments, batches and episodes.

A record of dtype `AXIS` has the indices of an axis's parts in MuJoCo's arrays, and its
constants. The function gets the addresses of the arrays in memory.
"""

import ctypes
from typing import Annotated, Any, NamedTuple

import numpy as np

from cc_mujoco.native import FloatArray, IntArray, internal
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.plugin._ffi import MjData, floats, reinterpret, words

MIN_LEVERAGE = 0.1
"""Least leverage that is reported; with less the cable hardly turns the joint."""

AXIS = np.dtype(
    [
        (name, np.int64)
        for name in (
            "motor_control",  # index in `ctrl`
            # see `_model.Places`
            "motor_q", "motor_v", "joint_q", "joint_v", "motor_out", "wearer_out",
            "cuffed",  # 1 where the wearer's torque does not act on the joint itself
            "weightless",  # 1 where gravity compensation or a fluid acts on bodies
            "others",  # number of other actuators at the joint
            "other_outs",  # address of their indices in `actuator_force`, then of the
            # places of their arms in `actuator_moment`, -1 for a constant arm
            "other_arms",  # address of their constant arms
            "wound",  # joints that move the distal end; 0 for a round pulley
            "arms",  # address of the places of its arms, then of the joints in `qvel`
            "own_arm",  # number of the driven joint among them
            "wound_end",  # place of the distal end in `actuator_length`
            "knots",  # number of joint angles in a table of the winding; 0 without one
            "table",  # address of these, then wound angles, then their derivative
            "shared",  # number of joints of other axes that the cable turns
            "shared_arms",  # address of the places of their arms in `actuator_moment`
            "shared_scales",  # address of their torque ratios per arm
        )
    ]
    + [
        (name, np.float64)
        for name in (
            "sense",  # 1 or -1: sign of the motor's angle in the columns
            "motor_gear",
            "motor_scale",  # control of the motor at its largest torque
            "torque_limit",  # largest torque of the motor [N m]
            "wearer_gear",
            "winding_arm",  # arm of the winding in the neutral pose [m/rad]
            "wound_length",  # length of the distal end there [m]
            "timestep",  # of the physics [s]
        )
    ]
)  # fmt: skip
"""Record of an axis: places of its parts in the arrays, and its numbers."""

AXIS_SIZE = AXIS.itemsize

AxisRecord = Annotated[Any, ("AxisRecord", AXIS)]


class Physics(NamedTuple):
    """Arrays of `mjData` for readings, of one simulation or of several as rows."""

    qpos: Array
    qvel: Array
    plugin_state: Array
    # Results, which a step leaves behind and no state has
    actuator_force: Array
    qfrc_actuator: Array
    qfrc_passive: Array
    qfrc_spring: Array
    qfrc_damper: Array
    qfrc_gravcomp: Array
    qfrc_fluid: Array
    actuator_length: Array
    actuator_moment: Array

    def detached(self) -> "Physics":
        """Return a copy with its own arrays from `actuator_force` on, the results."""
        found = {name: getattr(self, name).copy() for name in self._fields[3:]}
        return self._replace(**found)

    def take(self, other: "Physics", row: Any = slice(None)) -> None:
        """Copy the results of `other`, from `actuator_force` on, to all rows or one."""
        for name in self._fields[3:]:
            getattr(self, name)[row] = getattr(other, name)


(
    _QPOS, _QVEL, _, _FORCE, _ACTUATOR, _PASSIVE, _SPRING, _DAMPER, _GRAVITY, _FLUID,
    _LENGTH, MOMENT,
) = range(len(Physics._fields))  # fmt: skip

READING_COLUMNS = (
    "motor_angle_rad", "motor_velocity_rad_s", "motor_torque_nm", "joint_angle_rad",
    "joint_velocity_rad_s", "joint_torque_nm", "wearer_torque_nm", "winding_angle_rad",
    "winding_velocity_rad_s", "leverage_ratio",
)  # fmt: skip
"""Columns of an axis that `read_axis` gives, and their number."""
READINGS = len(READING_COLUMNS)
(
    MOTOR_ANGLE, MOTOR_VELOCITY, MOTOR_TORQUE, JOINT_ANGLE, JOINT_VELOCITY,
    JOINT_TORQUE, WEARER_TORQUE, WINDING_ANGLE, WINDING_VELOCITY, LEVERAGE,
) = range(READINGS)  # fmt: skip


@reinterpret
def axis_at(address: int) -> AxisRecord:
    memory = (ctypes.c_byte * AXIS_SIZE).from_address(address)
    return np.frombuffer(memoryview(memory), AXIS).view(np.recarray)[0]


@internal
def fields_of(data: MjData, at: IntArray) -> None:
    """Write the addresses of the arrays of an `mjData`, in the order of `Physics`."""
    at[_QPOS] = data.qpos.ctypes.data
    at[_QVEL] = data.qvel.ctypes.data
    at[_FORCE] = data.actuator_force.ctypes.data
    at[_ACTUATOR] = data.qfrc_actuator.ctypes.data
    at[_PASSIVE] = data.qfrc_passive.ctypes.data
    at[_SPRING] = data.qfrc_spring.ctypes.data
    at[_DAMPER] = data.qfrc_damper.ctypes.data
    at[_GRAVITY] = data.qfrc_gravcomp.ctypes.data
    at[_FLUID] = data.qfrc_fluid.ctypes.data
    at[_LENGTH] = data.actuator_length.ctypes.data
    at[MOMENT] = data.actuator_moment.ctypes.data


@internal
def real(array: int, index: int) -> float:
    return float(floats(array, index + 1)[index])


@internal
def _interpolated(at: float, knots: FloatArray, values: FloatArray) -> float:
    """Return `np.interp(at, knots, values)` for a number, bit for bit."""
    last = knots.size - 1
    if at < knots[0]:
        return float(values[0])
    if at >= knots[last]:
        return float(values[last])
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        if at >= knots[middle]:
            low = middle
        else:
            high = middle
    if at == knots[low]:
        return float(values[low])
    slope = (values[low + 1] - values[low]) / (knots[low + 1] - knots[low])
    return float(slope * (at - knots[low]) + values[low])


@internal
def _read_winding(axis: AxisRecord, at: IntArray, found: FloatArray) -> None:
    """Write the winding's angle [rad], velocity [rad/s] and leverage into `found`."""
    angle, velocity = found[JOINT_ANGLE], found[JOINT_VELOCITY]
    knots, count = axis.knots, axis.wound
    if knots > 0:
        angles, wounds = floats(axis.table, knots), axis.table + 8 * knots
        share = _interpolated(angle, angles, floats(wounds + 8 * knots, knots))
        found[WINDING_ANGLE] = _interpolated(angle, angles, floats(wounds, knots))
        found[WINDING_VELOCITY] = share * velocity
        found[LEVERAGE] = max(share, MIN_LEVERAGE)
        return
    if count == 0:
        found[WINDING_ANGLE], found[WINDING_VELOCITY] = angle, velocity
        found[LEVERAGE] = 0.0 * angle + 1.0
        return
    arms, nominal = words(axis.arms, 2 * count), axis.winding_arm
    pace = 0.0
    for i in range(count):
        pace = pace + real(at[MOMENT], arms[i]) * real(at[_QVEL], arms[count + i])
    length = real(at[_LENGTH], axis.wound_end) - axis.wound_length
    leverage = real(at[MOMENT], arms[axis.own_arm]) / nominal
    found[WINDING_ANGLE] = (length + axis.timestep * pace) / nominal
    found[WINDING_VELOCITY] = pace / nominal
    found[LEVERAGE] = max(leverage, MIN_LEVERAGE)


@internal
def read_axis(axis: AxisRecord, at: IntArray, found: FloatArray) -> None:
    """Write the values of `READING_COLUMNS` into `found`.

    `at` has the addresses of MuJoCo's arrays, in the order of `Physics`. Angles and
    velocities are those after the last physics step, torques those that acted in it.
    """
    joint = axis.joint_v
    # Cables on open paths pull by passive forces, added to those of the joints.
    own = real(at[_SPRING], joint) + real(at[_DAMPER], joint)
    pieces = real(at[_PASSIVE], joint) - own
    if axis.weightless > 0:
        pieces = pieces - real(at[_GRAVITY], joint)
        pieces = pieces - real(at[_FLUID], joint)
    angle = real(at[_QPOS], axis.joint_q)
    wearer = 0.0 * angle
    if axis.wearer_out >= 0:
        wearer = real(at[_FORCE], axis.wearer_out) * axis.wearer_gear
    # The cables of the axis are all that acts on the joint besides these.
    torque = real(at[_ACTUATOR], joint)
    if axis.cuffed == 0:
        torque = torque - wearer
    others = axis.others
    outs, gears = words(axis.other_outs, 2 * others), floats(axis.other_arms, others)
    for i in range(others):
        arm = gears[i]
        if outs[others + i] >= 0:
            arm = real(at[MOMENT], outs[others + i])
        torque = torque - real(at[_FORCE], outs[i]) * arm
    found[MOTOR_ANGLE] = axis.sense * real(at[_QPOS], axis.motor_q)
    found[MOTOR_VELOCITY] = axis.sense * real(at[_QVEL], axis.motor_v)
    found[MOTOR_TORQUE] = real(at[_FORCE], axis.motor_out) * axis.motor_gear
    found[JOINT_ANGLE], found[JOINT_VELOCITY] = angle, real(at[_QVEL], joint)
    found[JOINT_TORQUE], found[WEARER_TORQUE] = torque + pieces, wearer
    _read_winding(axis, at, found)
