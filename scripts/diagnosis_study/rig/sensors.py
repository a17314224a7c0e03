"""Sensors and data logger of the rig.

All channels pass the same decimation filter, so it adds no delay between them. The two
channels of the joint are sampled by a card of their own, whose clock has a small
offset. Noise is sampled per trial and channel, independently of the hidden effect.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.signal import bessel, butter, lfilter, sosfilt

from cc_mujoco.native import FloatArray as Array
from rig.engine import COLUMNS, RECORD_TIME
from rig.nominal import Rig
from rig.trials import LEAD

SAMPLE_RATE = 500
CUTOFF = 150.0
"""Corner frequency of the second-order Butterworth decimation filter [Hz]."""


class Channel(NamedTuple):
    """One logged channel: column, standard deviation of its noise, resolution."""

    column: str
    noise: float
    resolution: float
    at_joint: bool

    @property
    def floor(self) -> float:
        """Standard deviation of noise and quantisation together."""
        return math.hypot(self.noise, self.resolution / math.sqrt(12))


_COUNT = 2 * math.pi / 2**16  # the motor's encoder; that of the joint has 14 bits
CHANNELS = {
    "motor_angle": Channel("motor_angle_rad", 5e-5, _COUNT, False),
    "motor_torque": Channel("motor_torque_nm", 0.02, 0.005, False),
    "joint_angle": Channel("joint_angle_rad", 3e-4, 4 * _COUNT, True),
    "joint_torque": Channel("joint_torque_nm", 0.025, 0.005, True),
    "tension_a_proximal": Channel("tension_a_proximal_n", 0.3, 0.1, False),
    "tension_b_proximal": Channel("tension_b_proximal_n", 0.3, 0.1, False),
    "tension_a_distal": Channel("tension_a_distal_n", 0.3, 0.1, True),
    "tension_b_distal": Channel("tension_b_distal_n", 0.3, 0.1, True),
}
BASIC = ("motor_angle", "motor_torque", "joint_angle", "joint_torque")
TORQUES = ("motor_torque", "joint_torque")
COARSE = {"motor_angle": 15, "joint_angle": 13}  # bits of coarse encoders
_SAMPLE_CLOCK = 1e-5  # resolution of time stamps [s]


class Chain(NamedTuple):
    """Imperfections of the sensors and their possible faults, off at 0; SI, radians."""

    # --- what a rig has, whatever is hidden ---------------------------------------
    seed: int = 0  # seed of the jitter
    coarse: bool = False  # encoders round, and have no noise
    motor_offcentre: float = 0.0  # error of the motor's encoder, once a turn [rad]
    motor_phase: float = 0.0
    joint_offcentre: float = 0.0  # error of the joint's encoder, once a turn [rad]
    joint_phase: float = 0.0
    slow: float = 0.0  # time constant of the filter of both torque sensors [s]
    jitter: float = 0.0
    """Standard deviation of the jitter of samples, included in time stamps [s]."""
    other_forms: bool = False  # of delay, gain and offset: those of the finite elements

    # --- what may be hidden -------------------------------------------------------
    delay: float = 0.0
    """Delay of the joint's card: 70 % dead time, 30 % first-order lag; or the group
    delay of a Bessel filter of both channels [s]."""
    gain: float = 0.0
    """Excess gain of the joint's torque sensor at small torque; or at positive torque,
    two thirds at negative."""
    offset: float = 0.0  # offset of the joint's torque sensor once warm [N m]
    hysteresis: float = 0.0  # half width of the joint torque sensor's hysteresis [N m]
    load_delay: float = 0.0  # lag of the joint's torque per torque [s/N m]
    reflex: float = 0.0
    """Gain of a grip reflex that leaks into the joint's torque [N m s/rad]."""
    reflex_latency: float = 0.06
    temperature: float = 0.0
    """Zero drift of the joint's torque sensor with the room's draught [N m]."""
    temperature_phase: float = 0.0
    second_axis: float = 0.0  # cross-talk of a second axis of the handle [N m]
    second_axis_rate: float = 0.9
    second_axis_phase: float = 0.0
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
            signal = _joint_torque(records, self)
        if self.slow and name in TORQUES:
            signal = _lagged(signal, self.slow)
        if self.delay and self.other_forms and name in ("joint_angle", "joint_torque"):
            corner = 1.0 / (2.0 * math.pi * self.delay)
            poles = bessel(2, corner, fs=1.0 / RECORD_TIME, norm="delay")
            signal = _filtered(*poles, signal)
        elif self.delay and not self.other_forms and CHANNELS[name].at_joint:
            signal = _shifted(_lagged(signal, 0.3 * self.delay), 0.7 * self.delay)
        return np.asarray(signal)


def imperfect(rig: Rig) -> Chain:
    """Return sensors with about half of the imperfections that one can have.

    They are sampled from the rig's seed independently of any effect, at sizes that a
    careful experimenter accepts.
    """
    random = np.random.default_rng([rig.seed, 0x105])
    has = random.random(4) < 0.5
    size = random.uniform([2e-5, 5e-5, 3e-4, 2e-5], [8e-5, 2e-4, 8e-4, 1.5e-4])
    phases = random.uniform(-math.pi, math.pi, 2)
    motor, joint, slow, jitter = np.where(has, size, 0.0).tolist()
    coarse = rig.seed % 2 == 1
    return Chain(
        rig.seed, coarse, motor, phases[0], joint, phases[1], slow, jitter, True
    )


def column(records: Array, name: str) -> Array:
    return records[:, COLUMNS.index(name)]


def _shifted(signal: Array, seconds: float | Array) -> Array:
    at = np.arange(signal.size) - seconds / RECORD_TIME
    return np.asarray(np.interp(at, np.arange(signal.size), signal))


def _filtered(numerator: Array, denominator: Array, signal: Array) -> Array:
    """Return a filter of gain 1 that starts in steady state."""
    return np.asarray(lfilter(numerator, denominator, signal - signal[0]) + signal[0])


def _lagged(signal: Array, seconds: float) -> Array:
    """Return the signal after a first-order lag that starts in steady state."""
    share = RECORD_TIME / (seconds + RECORD_TIME)
    return _filtered(np.array([share]), np.array([1.0, share - 1.0]), signal)


def _hysteresis(torque: Array, width: float) -> Array:
    """Return the error of a smooth hysteresis loop: three plays of different reach."""
    out = np.zeros_like(torque)
    for reach, share in ((0.3, 0.4), (1.0, 0.35), (2.5, 0.25)):
        state, trace = torque[0], np.empty_like(torque)
        for i, value in enumerate(torque):
            state = min(max(state, value - reach), value + reach)
            trace[i] = state
        out -= share * (torque - trace) / reach * width
    return out


def _joint_torque(records: Array, chain: Chain) -> Array:
    """Return the reading of the joint's torque sensor with all its faults."""
    torque = out = column(records, "joint_torque")
    time = np.arange(torque.size) * RECORD_TIME - LEAD
    other = chain.other_forms
    if chain.load_delay:
        out = _shifted(out, chain.load_delay * np.abs(torque))
    if chain.gain and other:
        out = out + chain.gain * np.where(torque > 0.0, torque, torque / 1.5)
    elif chain.gain:
        out = out * (1 + chain.gain * (1 - 0.15 * (torque / 6) ** 2))
    if chain.cubic:
        out = out - chain.cubic * (torque / 5.0) ** 3
    if chain.hysteresis:
        out = out + _hysteresis(torque, chain.hysteresis)
    if chain.offset:
        cold = -0.1 * ((time + LEAD) / 8.0 - 0.5)
        if not other:
            cold = 0.15 * np.exp(-np.maximum(time, 0) / 2)
        out = out + chain.offset * (1 - cold)
    if chain.reflex:
        speed = _shifted(column(records, "joint_speed"), chain.reflex_latency)
        beyond = np.sign(speed) * np.maximum(np.abs(speed) - 0.4, 0)
        out = out + chain.reflex * _lagged(beyond, 0.03)
    if chain.temperature:
        slow = np.sin(2 * np.pi * time / 5.3 + chain.temperature_phase)
        slow += 0.6 * np.sin(2 * np.pi * time / 2.1 + 2.7 * chain.temperature_phase)
        out = out + chain.temperature * slow
    if chain.second_axis:
        turn = 2 * np.pi * chain.second_axis_rate * time + chain.second_axis_phase
        sway = np.sin(turn + 0.7 * np.sin(0.37 * turn))
        out = out + chain.second_axis * sway * (1 + 0.4 * np.sin(0.21 * turn))
    if chain.pressed:
        a, b = (column(records, f"tension_{cable}_distal") for cable in "ab")
        out = out + chain.pressed * (0.5 * (a + b) - 80.0)
    return np.asarray(out)


def sampled(records: Array, rig: Rig, chain: Chain, names: tuple[str, ...]) -> Array:
    """Return the readings (samples, names) of a logger without noise or rounding."""
    sos = butter(2, CUTOFF, fs=1 / RECORD_TIME, output="sos")
    recorded = records.shape[0] * RECORD_TIME - LEAD
    moments = LEAD + chain.moments(round(recorded * SAMPLE_RATE))
    middle = (np.arange(records.shape[0]) + 0.5) * RECORD_TIME
    out = np.empty((moments.size, len(names)))
    for j, name in enumerate(names):
        shown = chain.shown(records, name)
        smooth = sosfilt(sos, shown - shown[0]) + shown[0]
        late = rig.joint_clock_offset if CHANNELS[name].at_joint else 0.0
        offset = getattr(rig, f"{name}_offset", 0.0)
        out[:, j] = np.interp(moments + late, middle, smooth) + offset
    return out


def logged(
    clean: Array, chain: Chain, names: tuple[str, ...], key: list[int]
) -> dict[str, Array]:
    """Return columns as in files: readings with noise of seed `key`, rounded."""
    columns = {"time_s": chain.moments(clean.shape[0])}
    order = list(CHANNELS)
    for j, name in enumerate(names):
        channel = chain.channels()[name]
        rng = np.random.default_rng([*key, order.index(name)])
        noisy = clean[:, j] + channel.noise * rng.standard_normal(clean.shape[0])
        columns[channel.column] = (
            np.round(noisy / channel.resolution) * channel.resolution
        )
    return columns
