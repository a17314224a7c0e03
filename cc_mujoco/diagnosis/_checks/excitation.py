"""Content of a dataset: speeds, reversals, rests, loads, repeats."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._smoothing import velocity, velocity_noise
from cc_mujoco.datasets._trials import Dataset, FloatArray, Trial
from cc_mujoco.diagnosis._checks.noise import find_holds
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.errors import CableError


class Excitation(NamedTuple):
    """Coverage of a dataset.

    Attributes:
        duration: time in valid stretches [s].
        speed: slowest and fastest speed of the motor that stands out of the noise
            [rad/s], 2nd and 99th percentile.
        reversals: of the motor.
        dwells: durations of the rests between motions, shortest and longest [s].
        dwell_count: number of rests.
        torque: of the joint, 1st and 99th percentile [N m]; None if it is not known.
        motor_torque: of the motor, 1st and 99th percentile [N m]; None if unknown.
        turns: range of the motor's angle in revolutions.
        joint_turns: range of the joint's angle in revolutions.
        bandwidth: below it lies 99 % of the power of the motor's speed [Hz].
        repeats: trials that repeat another.
        pretensions: the different pretensions declared [N].
        temperature: lowest and highest [degC]; None if not measured.
        tensions: cable ends whose tension is measured.
    """

    duration: float
    speed: tuple[float, float]
    reversals: int
    dwells: tuple[float, float]
    dwell_count: int
    torque: tuple[float, float] | None
    motor_torque: tuple[float, float] | None
    turns: float
    joint_turns: float
    bandwidth: float
    repeats: int
    pretensions: tuple[float, ...]
    temperature: tuple[float, float] | None
    tensions: int

    @property
    def speed_decades(self) -> float:
        """Powers of ten between the slowest and the fastest speed."""
        low, high = self.speed
        return math.log10(high / low) if low > 0.0 else 0.0

    @property
    def statements(self) -> tuple[str, ...]:
        """Coverage in sentences."""
        low, high = self.speed
        sentences = [
            f"{self.duration:.3g} s of valid data.",
            f"The motor moves at {low:.2g} to {high:.2g} rad/s "
            f"({self.speed_decades:.1f} decades) and has "
            f"{_count_text(self.reversals, 'reversal')}.",
            f"{_count_text(self.dwell_count, 'rest')}"
            + (
                f" of {self.dwells[0]:.2g} to {self.dwells[1]:.2g} s."
                if self.dwell_count
                else ", so dwell and break-away cannot be judged."
            ),
            f"Joint torque {_torque_text(self.torque)}, motor torque "
            f"{_torque_text(self.motor_torque)}.",
            f"The motor covers {self.turns:.2g} revolutions, the joint "
            f"{self.joint_turns:.2g}.",
            f"99 % of the motion lies below {self.bandwidth:.2g} Hz.",
            f"{_count_text(self.repeats, 'repeat')}."
            if self.repeats
            else "No trial repeats another.",
            _pretension_text(self.pretensions, self.tensions),
        ]
        if self.temperature is not None:
            cold, warm = self.temperature
            sentences.append(f"Temperature {cold:.3g} to {warm:.3g} degC.")
        return tuple(sentences)


def excitation(dataset: Dataset) -> Excitation:
    """Return the joint excitation of the trials of a dataset.

    Raises:
        CableError: the motor's angle is not measured.
    """
    if not dataset.has_motor_angle:
        raise CableError(
            f"{dataset.path} declares that the motor's angle is not measured, of which "
            "the excitation is; give trials with that angle"
        )
    speeds, rests = [np.empty(0)], []
    reversals = 0
    for trial in dataset.trials:
        speed = np.abs(velocity(trial.motor_angle, trial.step, trial.segments))
        known = dataset.noise.get(channels.MOTOR_ANGLE)
        floor = velocity_noise(known.deviation if known else 0.0, trial.step)
        with np.errstate(invalid="ignore"):
            speeds.append(speed[speed > max(3.0 * floor, 1e-9)])
        rests += [(part.stop - part.start) * trial.step for part in find_holds(trial)]
        reversals += sum(
            count_reversals(trial.motor_angle[part]) for part in trial.segments
        )
    temperatures = [
        trial.temperature for trial in dataset.trials if trial.temperature is not None
    ]
    known_tensions = {
        trial.facts.pretension
        for trial in dataset.trials
        if trial.facts.pretension is not None and not trial.facts.unhooked
    }
    names = {trial.name for trial in dataset.trials}
    return Excitation(
        duration=sum(trial.duration for trial in dataset.trials),
        speed=_percentiles(np.concatenate(speeds), 2, 99),
        reversals=reversals,
        dwells=(min(rests), max(rests)) if rests else (0.0, 0.0),
        dwell_count=len(rests),
        torque=_torques(dataset, channels.JOINT_TORQUE),
        motor_torque=_torques(dataset, channels.MOTOR_TORQUE),
        turns=_revolutions_text(_valid_samples(dataset, channels.MOTOR_ANGLE)),
        joint_turns=_revolutions_text(_valid_samples(dataset, channels.JOINT_ANGLE)),
        bandwidth=max((_bandwidth(trial) for trial in dataset.trials), default=0.0),
        repeats=sum(trial.facts.repeat_of in names for trial in dataset.trials),
        pretensions=tuple(sorted(known_tensions)),
        temperature=_span(temperatures),
        tensions=sum(channels.is_tension(name) for name in dataset.channels),
    )


def count_reversals(angle: FloatArray) -> int:
    """Return the number of reversals of an angle by more than 2 % of its range."""
    band = Limit.reversal_share * float(np.ptp(angle)) if len(angle) else 0.0
    if not band > 0.0:
        return 0
    # Only the extremes between which the angle changes by more than the band count.
    steps = np.diff(angle)
    rows = np.flatnonzero(steps)
    bends = rows[1:][np.sign(steps[rows[1:]]) != np.sign(steps[rows[:-1]])]
    extremes = angle[np.concatenate([[0], bends, [len(angle) - 1]])]
    count, way, best = 0, 0, float(extremes[0])
    for value in extremes[1:]:
        change = float(value) - best
        if way == 0:
            if abs(change) > band:
                way, best = (1 if change > 0 else -1), float(value)
        elif change * way > 0.0:
            best = float(value)
        elif abs(change) > band:
            count, way, best = count + 1, -way, float(value)
    return count


def _bandwidth(trial: Trial) -> float:
    """Return the frequency below which 99 % of the motor speed's power lies [Hz]."""
    from scipy.signal import welch

    part = max(trial.segments, key=lambda part: part.stop - part.start)
    speed = velocity(trial.motor_angle[part], trial.step)
    length = min(len(speed), max(256, round(10.0 / trial.step)))
    frequency, power = welch(speed, trial.rate, nperseg=length, detrend="constant")
    if not power.sum() > 0.0:
        return 0.0
    share = np.cumsum(power) / power.sum()
    return float(frequency[np.searchsorted(share, 0.99)])


def _valid_samples(dataset: Dataset, channel: str) -> FloatArray:
    return np.concatenate(
        [np.zeros(0)]
        + [
            trial.channel(channel)[part]
            for trial in dataset.trials
            for part in trial.segments
        ]
    )


def _torques(dataset: Dataset, channel: str) -> tuple[float, float] | None:
    if dataset.trials and channel not in dataset.channels:
        return None
    return _percentiles(_valid_samples(dataset, channel), 1, 99)


def _torque_text(ends: tuple[float, float] | None) -> str:
    return f"{ends[0]:.3g} to {ends[1]:.3g} N m" if ends else "not measured"


def _revolutions_text(angle: FloatArray) -> float:
    return float(np.ptp(angle)) / (2.0 * math.pi) if len(angle) else 0.0


def _percentiles(values: FloatArray, low: float, high: float) -> tuple[float, float]:
    if not len(values):
        return 0.0, 0.0
    ends = np.percentile(values, [low, high])
    return float(ends[0]), float(ends[1])


def _span(values: list[FloatArray]) -> tuple[float, float] | None:
    if not values:
        return None
    joined = np.concatenate(values)
    return float(np.nanmin(joined)), float(np.nanmax(joined))


def _count_text(number: int, word: str) -> str:
    return f"{number or 'no'} {word}{'' if number == 1 else 's'}"


def _pretension_text(known: tuple[float, ...], tensions: int) -> str:
    if tensions:
        return f"Tension is measured at {_count_text(tensions, 'cable end')}."
    if len(known) > 1:
        return f"{len(known)} pretensions, {known[0]:.3g} to {known[-1]:.3g} N."
    return (
        "One pretension and no measured tension, so friction and pretension cannot be "
        "distinguished."
    )
