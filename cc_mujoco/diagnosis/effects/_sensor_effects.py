"""Effects of the sensors, which are applied after those of the mechanics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cc_mujoco.diagnosis.effects._effect import Effect, Signals, Values, sized
from cc_mujoco.native import FloatArray

GAIN_BOUNDS = (-0.3, 0.3)
"""Error of a torque sensor's gain that calibration leaves; beyond, it is declared."""
_OFFSET_BOUNDS = (-0.3, 0.3)
"""Offset of a torque sensor over the largest torque, beyond which anybody sees it."""
_DELAY_BOUNDS = (-0.1, 0.1)
"""Delay of a signal chain that would not have been noticed [s]."""
JOINT_DELAY = "joint_delay"
"""Effect that delays the joint's angle and torque together [s]."""


def delay_signal(signal: FloatArray, by: float, dt: float) -> FloatArray:
    """Return the signal delayed by this time, its first value held (samples,)."""
    at = np.arange(signal.size) * dt
    found: FloatArray = np.interp(at - by, at, signal)
    return found


def _gain(s: Signals, v: Values) -> Signals:
    motor, joint = v["motor_torque_gain"], v["joint_torque_gain"]
    return replace(s, motor=s.motor * (1.0 + motor), joint=s.joint * (1.0 + joint))


def _delay(s: Signals, v: Values) -> Signals:
    return replace(
        s,
        motor=delay_signal(s.motor, v["motor_torque_delay"], s.dt),
        joint=delay_signal(s.joint, v["joint_torque_delay"], s.dt),
    )


SENSOR_EFFECTS = (
    Effect(
        id="torque_sensor_gain",
        title="gain of a torque sensor",
        equation="tau (1 + g)",
        where="sensor",
        parameters=(
            sized(
                "motor_torque_gain", "1",
                "relative error of the gain of the motor torque sensor", -0.9, 9.0,
                0.05, GAIN_BOUNDS,
            ),
            sized(
                "joint_torque_gain", "1",
                "relative error of the gain of the joint torque sensor", -0.9, 9.0,
                0.05, GAIN_BOUNDS,
            ),
        ),
        starts=({"motor_torque_gain": 0.05, "joint_torque_gain": 0.05},),
        required_excitation="loads that hold still",
        confounded_with=("joint_gravity", "joint_stiffness"),
        mujoco="weights of the sensors that a torque is the sum of",
        source="calibration",
        torques=_gain,
        sensor=True,
    ),
    Effect(
        id="torque_sensor_offset",
        title="offset of a torque sensor",
        equation="tau + b + d t",
        where="sensor",
        parameters=(
            sized(
                "motor_torque_bias", "N m", "offset of the motor torque sensor", -1e3,
                1e3, 0.1, _OFFSET_BOUNDS, "motor_torque",
            ),
            sized(
                "joint_torque_bias", "N m", "offset of the joint torque sensor", -1e3,
                1e3, 0.1, _OFFSET_BOUNDS, "joint_torque",
            ),
            sized(
                "motor_torque_drift", "N m/s",
                "rate at which that of the motor torque sensor grows", -10.0, 10.0,
                0.01,
            ),
            sized(
                "joint_torque_drift", "N m/s",
                "rate at which that of the joint torque sensor grows", -10.0, 10.0,
                0.01,
            ),
        ),
        starts=(
            {
                "motor_torque_bias": 0.1, "joint_torque_bias": 0.1,
                "motor_torque_drift": 0.01, "joint_torque_drift": 0.01,
            },
        ),
        required_excitation=(
            "loads of both signs; for a drift, trials much longer than a cycle"
        ),
        confounded_with=("asymmetric_friction", "joint_gravity"),
        mujoco="a `clock` sensor in the sum that is the torque",
        source="calibration",
        torques=lambda s, v: s.added(
            v["motor_torque_bias"] + v["motor_torque_drift"] * s.time,
            v["joint_torque_bias"] + v["joint_torque_drift"] * s.time,
        ),
        sensor=True,
    ),
    Effect(
        id="sensor_delay",
        title="readings that are recorded late",
        equation="tau(t - d), q_j(t - d)",
        where="sensor",
        parameters=(
            sized(
                JOINT_DELAY, "s", "delay of the joint angle sensor", -0.2, 0.2, 0.005,
                _DELAY_BOUNDS,
            ),
            sized(
                "motor_torque_delay", "s", "delay of the motor torque sensor", -0.2,
                0.2, 0.005, _DELAY_BOUNDS,
            ),
            sized(
                "joint_torque_delay", "s", "delay of the joint torque sensor", -0.2,
                0.2, 0.005, _DELAY_BOUNDS,
            ),
        ),
        starts=(
            {
                JOINT_DELAY: 0.005, "motor_torque_delay": 0.005,
                "joint_torque_delay": 0.005,
            },
        ),
        required_excitation="fast and slow motion",
        confounded_with=("viscous_friction", "joint_inertia", "motor_inertia"),
        mujoco="`delay` of the sensors that a torque is the sum of",
        source="signal chain",
        torques=_delay,
        sensor=True,
    ),
)  # fmt: skip
"""Those of the library."""
