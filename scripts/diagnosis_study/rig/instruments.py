"""Logger of a rig of finite elements, and the imperfections of its sensors.

Each rig has about half of them, sampled from its seed independently of any effect, at
sizes that a careful experimenter accepts: eccentric encoders, slow filters of torque
sensors, jitter of the sampling times. Every other rig has coarse encoders without
noise, 13 bits at the joint and 15 bits at the motor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.signal import bessel, lfilter

from cc_mujoco.native import FloatArray as Array
from rig.engine import RECORD_TIME
from rig.nominal import Rig
from rig.sensors import CHANNELS, SAMPLE_RATE, Channel, column

COARSE = {"motor_angle": 15, "joint_angle": 13}  # bits of coarse encoders
_SAMPLE_CLOCK = 1e-5  # resolution of time stamps [s]


class Chain(NamedTuple):
    """Distortions by the sensors, off at 0; SI and radians."""

    # --- what this rig has, whatever is hidden ------------------------------------
    seed: int = 0  # seed of the jitter
    coarse: bool = False
    motor_offcentre: float = 0.0  # error of the motor's encoder, once a turn [rad]
    motor_phase: float = 0.0
    joint_offcentre: float = 0.0  # error of the joint's encoder, once a turn [rad]
    joint_phase: float = 0.0
    slow: float = 0.0  # time constant of the filter of both torque sensors [s]
    jitter: float = 0.0
    """Standard deviation of the jitter of samples, included in time stamps [s]."""

    # --- what may be hidden -------------------------------------------------------
    gain: float = 0.0
    """Excess gain of the joint's torque sensor; two thirds at negative torque."""
    offset: float = 0.0
    """Offset of the joint's torque sensor, which warms up during a trial [N m]."""
    delay: float = 0.0
    """Group delay of a Bessel filter of both channels of the joint [s]."""
    cubic: float = 0.0
    """Deficit of the joint's torque sensor at 5 N m, by the cube of torque [N m]."""
    pressed: float = 0.0
    """Spurious torque of the joint's sensor per mean tension of both cables [m]."""

    def channels(self) -> Mapping[str, Channel]:
        if not self.coarse:
            return CHANNELS
        return CHANNELS | {
            name: CHANNELS[name]._replace(noise=0.0, resolution=2.0 * math.pi / 2**bits)
            for name, bits in COARSE.items()
        }

    def moments(self, count: int) -> Array:
        """Return the sampling times [s]."""
        even = np.arange(count) / SAMPLE_RATE
        if self.jitter == 0.0:
            return even
        random = np.random.default_rng([self.seed, 0x717])
        apart = self.jitter * np.clip(random.standard_normal(count), -3.0, 3.0)
        apart[0] = abs(apart[0])
        return np.asarray(np.round((even + apart) / _SAMPLE_CLOCK) * _SAMPLE_CLOCK)

    def shown(self, records: Array, name: str) -> Array:
        signal = column(records, name)
        if name == "motor_angle" and self.motor_offcentre:
            signal = signal + self.motor_offcentre * np.sin(signal - self.motor_phase)
        if name == "joint_angle" and self.joint_offcentre:
            signal = signal + self.joint_offcentre * np.sin(signal - self.joint_phase)
        if name == "joint_torque":
            signal = _twisted(records, signal, self)
        if self.slow and name in ("motor_torque", "joint_torque"):
            signal = _one_pole(self.slow, signal)
        if self.delay and name in ("joint_angle", "joint_torque"):
            corner = 1.0 / (2.0 * math.pi * self.delay)
            poles = bessel(2, corner, fs=1.0 / RECORD_TIME, norm="delay")
            signal = _filtered(*poles, signal)
        return np.asarray(signal)


def chain_of(rig: Rig) -> Chain:
    random = np.random.default_rng([rig.seed, 0x105])
    has = random.random(4) < 0.5
    size = random.uniform([2e-5, 5e-5, 3e-4, 2e-5], [8e-5, 2e-4, 8e-4, 1.5e-4])
    phases = random.uniform(-math.pi, math.pi, 2)
    motor, joint, slow, jitter = np.where(has, size, 0.0).tolist()
    coarse = rig.seed % 2 == 1
    return Chain(rig.seed, coarse, motor, phases[0], joint, phases[1], slow, jitter)


def _filtered(numerator: Array, denominator: Array, signal: Array) -> Array:
    """Return a filter of gain 1 that starts in steady state."""
    out = lfilter(numerator, denominator, signal - signal[0])
    return np.asarray(out + signal[0])


def _one_pole(seconds: float, signal: Array) -> Array:
    share = RECORD_TIME / (seconds + RECORD_TIME)
    return _filtered(np.array([share]), np.array([1.0, share - 1.0]), signal)


def _twisted(records: Array, torque: Array, chain: Chain) -> Array:
    """Return the reading of the joint's torque sensor with all its faults."""
    out = torque
    if chain.gain:
        out = out + chain.gain * np.where(torque > 0.0, torque, torque / 1.5)
    if chain.cubic:
        out = out - chain.cubic * (torque / 5.0) ** 3
    if chain.offset:
        time = np.arange(torque.size) * RECORD_TIME
        out = out + chain.offset * (1.0 + 0.1 * (time / 8.0 - 0.5))
    if chain.pressed:
        a, b = (column(records, f"tension_{cable}_distal") for cable in "ab")
        out = out + chain.pressed * (0.5 * (a + b) - 80.0)
    return np.asarray(out)
