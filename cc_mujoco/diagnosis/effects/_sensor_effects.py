"""Effects of sensors, which act after all others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cc_mujoco.diagnosis.effects._effect import Effect, Signals, Values, sized
from cc_mujoco.diagnosis.effects._effect_class import Size
from cc_mujoco.native import FloatArray

GAIN_BOUNDS = (-0.3, 0.3)
"""Error of a torque sensor's gain that calibration leaves; beyond, it is declared."""
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
        parameters=tuple(
            sized(
                f"{side}_torque_gain", "1",
                f"relative error of the gain of the {side} torque sensor", -0.9, 9.0,
                0.05, GAIN_BOUNDS,
            )
            for side in ("motor", "joint")
        ),
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
            *(
                sized(
                    f"{side}_torque_bias", "N m", f"offset of the {side} torque sensor",
                    -1e3, 1e3, 0.1, (-0.3, 0.3), f"{side}_torque",
                )
                for side in ("motor", "joint")
            ),
            *(
                sized(
                    f"{side}_torque_drift", "N m/s",
                    f"rate at which that of the {side} torque sensor grows", -10.0,
                    10.0, 0.01,
                )
                for side in ("motor", "joint")
            ),
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
        parameters=tuple(
            sized(
                name, "s", f"delay of the {what} sensor", -0.2, 0.2, 0.005, (-0.1, 0.1),
            )
            for name, what in (
                (JOINT_DELAY, "joint angle"), ("motor_torque_delay", "motor torque"),
                ("joint_torque_delay", "joint torque"),
            )
        ),
        required_excitation="fast and slow motion",
        confounded_with=("viscous_friction", "joint_inertia", "motor_inertia"),
        mujoco="`delay` of the sensors that a torque is the sum of",
        source="signal chain",
        torques=_delay,
        sensor=True,
    ),
)  # fmt: skip
"""Effects of sensors in the library."""


class SensorCrossTalk:
    """Torque sensors that also show a share of each other."""

    equation = "tau_m + a tau_j, tau_j + b tau_m"
    source = "calibration"
    sensor = True
    needs = "friction or inertia that makes the two torques differ"
    confused_with = ("torque_sensor_gain", "asymmetric_friction")
    resembles = confused_with

    def parameters(self) -> list[Size]:
        bounds = (-1.0, 1.0, (-0.2, 0.2))
        return [
            Size("motor_torque_cross_talk", "1", 0.02, "share of the joint's", *bounds),
            Size("joint_torque_cross_talk", "1", 0.02, "share of the motor's", *bounds),
        ]

    def signals(self, signals: Signals, values: Values) -> Signals:
        return signals.added(
            motor=values.get("motor_torque_cross_talk", 0.0) * signals.joint,
            joint=values.get("joint_torque_cross_talk", 0.0) * signals.motor,
        )
