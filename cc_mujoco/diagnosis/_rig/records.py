"""Trials made ready for comparison: one clock, one band, a run-in that does not count.

Measured and simulated torques pass the same zero-phase low-pass. Angles, which are
played, keep a wider band: friction answers a reversal with a corner, and a corner of
smoothed angles is not a smoothed corner. Angles then stand still where they move by
less than a few deviations of their noise: a cable that sticks turns the slightest
movement of its end into tension, and noise would shake it loose.

The state of the cable before a trial is unknown: a short lead-in from rest in
pretension goes to the first sample, and samples do not count until the motor has moved
the whole cable. Where no sensor measures the joint's torque, it follows from the motion
of a load that `[rig]` declares: a spring, an inertia, a damper, a weight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from cc_mujoco.cable import Parameter
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._channels import (
    JOINT_ANGLE,
    JOINT_TORQUE,
    MOTOR_ANGLE,
    other_angle,
)
from cc_mujoco.datasets._coupled_route import RecordedPath
from cc_mujoco.datasets._load_cells import SingleCell
from cc_mujoco.datasets._quantization import reconstruct_angle
from cc_mujoco.datasets._rig_table import LOAD_CONSTANTS
from cc_mujoco.datasets._trials import Constant, Dataset, Trial
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis.effects import (
    USUAL_CONDITIONS,
    TrialConditions,
    follow_with_play,
)
from cc_mujoco.estimation._least_squares import Tuned
from cc_mujoco.native import FloatArray, FloatMatrix, compiled

_EDGE_SAMPLES = 9
"""Samples by which a signal is continued, turned over, at either end."""


def compared_band(rate: float) -> float:
    """Return the cut-off of torques that are recorded at a rate [Hz]."""
    return min(Limit.max_band, 0.3 * rate)


def low_pass(signals: FloatArray, band: float, rate: float) -> FloatArray:
    """Apply a zero-phase Butterworth low-pass to signals (..., samples).

    It equals `filtfilt` of `scipy.signal` with `butter(2, band)`, to rounding; that
    module takes a second to load, and a call of it longer than the filter.
    """
    if band >= 0.45 * rate:
        return signals
    first, last = signals[..., :1], signals[..., -1:]
    passed: FloatArray = np.concatenate(
        [
            2.0 * first - signals[..., _EDGE_SAMPLES:0:-1],
            signals,
            2.0 * last - signals[..., -2 : -_EDGE_SAMPLES - 2 : -1],
        ],
        axis=-1,
        dtype=np.float64,
    )
    rows = passed.reshape(-1, passed.shape[-1])
    _pass_both_ways(*_coefficients(band / rate), rows)
    return rows.reshape(passed.shape)[..., _EDGE_SAMPLES:-_EDGE_SAMPLES]


@lru_cache(maxsize=16)
def _coefficients(band: float) -> tuple[float, float, float]:
    """Compute the filter's coefficients by bilinear map.

    They are the coefficient of z**0, and over it those of z**-1 and z**-2 of the
    denominator. The numerator is the first times 1, 2, 1.
    """
    k = math.tan(math.pi * band)
    whole = 1.0 + math.sqrt(2.0) * k + k * k
    return (
        k * k / whole,
        2.0 * (k * k - 1.0) / whole,
        (1.0 - math.sqrt(2.0) * k + k * k) / whole,
    )


@compiled
def _pass_both_ways(gain: float, a1: float, a2: float, rows: FloatMatrix) -> None:
    """Filter rows (rows, samples) in place, forwards and then backwards in time.

    Each pass begins at rest in the first value.
    """
    count = rows.shape[1]
    for row in range(rows.shape[0]):
        for way in range(2):
            at, step = (0, 1) if way == 0 else (count - 1, -1)
            # Transposed second direct form, its state in a signal of 1 times the first.
            one = (1.0 - gain) * rows[row, at]
            two = (gain - a2) * rows[row, at]
            for _ in range(count):
                given = rows[row, at]
                out = gain * given + one
                one = 2.0 * gain * given - a1 * out + two
                two = gain * given - a2 * out
                rows[row, at] = out
                at += step


_PARAMETERS = {
    parameter.name: parameter
    for parameter in (
        Parameter("load_stiffness", "N m/rad", "stiffness of the spring", scale="log"),
        Parameter("load_inertia", "kg m^2", "inertia of the load", scale="log"),
        Parameter("load_damping", "N m s/rad", "viscous damping", scale="log"),
        Parameter("load_weight", "N m", "largest moment of the weight", scale="log"),
        Parameter("load_rest_angle", "rad", "joint angle where the spring rests"),
    )
}


def load_values(constants: Mapping[str, Constant]) -> dict[str, float]:
    return {name: constant.value for name, constant in constants.items()}


def load_torque(
    angle: FloatArray, step: float, values: Mapping[str, float], tilt: float = 0.0
) -> FloatArray:
    """Return the torque that moves a load (samples,) [N m].

    `angle` is that of the joint (samples,), smooth [rad]; `values` those of
    `RIG_CONSTANTS` in SI units, without parts that the load does not have; `tilt` the
    angle by which the rig was turned about the joint's axis [rad].
    """
    speed = np.gradient(angle, step)
    stretch = angle - values.get("load_rest_angle", 0.0)
    lift = np.sin(angle + tilt - values.get("load_hanging_angle", 0.0))
    found: FloatArray = (
        values.get("load_stiffness", 0.0) * stretch
        + values.get("load_damping", 0.0) * speed
        + values.get("load_inertia", 0.0) * np.gradient(speed, step)
        + values.get("load_weight", 0.0) * lift
    )
    return found


def load_noise(
    constants: Mapping[str, Constant],
    deviation: float,
    rate: float,
    bands: tuple[float, float],
) -> float:
    """Return the standard deviation of a load's torque due to angle noise [N m].

    Where the angle is rounded, its error is slow and passes every filter. `deviation`
    is that of the angle [rad], `rate` in samples per second; `bands` are the cut-offs
    of torques and angles [Hz].
    """
    values = load_values(constants)
    noise = deviation * np.random.default_rng(0).standard_normal(8192)
    moving = {n: v for n, v in values.items() if n in ("load_inertia", "load_damping")}
    shaken = load_torque(low_pass(noise, bands[1], rate), 1.0 / rate, moving)
    passed = float(np.std(low_pass(shaken, bands[0], rate)))
    slope = values.get("load_stiffness", 0.0) + values.get("load_weight", 0.0)
    return math.hypot(passed, slope * deviation)


def load_parameters(constants: Mapping[str, Constant]) -> list[Tuned]:
    """Return the uncertain quantities of a load, as parameters of a fit."""
    found = []
    for name in LOAD_CONSTANTS:
        known = constants.get(name, Constant(0.0))
        if known.uncertainty > 0.0:
            relative = known.uncertainty / known.value
            found.append(
                Tuned(
                    _PARAMETERS[name],
                    known.value,
                    relative,
                    -10.0,
                    10.0,
                    1.0,
                )
            )
    if "load_stiffness" in constants:
        rest = constants.get("load_rest_angle", Constant(0.0))
        scale = rest.uncertainty or Limit.rest_angle_deviation
        found.append(
            Tuned(_PARAMETERS["load_rest_angle"], rest.value, scale, -10.0, 10.0, 1.0)
        )
    return found


LEAD_SAMPLES = 2 * Limit.ramp_samples
"""Samples that lead from rest in the pose 0 to the first sample."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """One stretch of one trial; arrays have one entry per compared sample.

    A record is equal to itself only, so that results of it can be cached.
    """

    trial: str
    """Name of the trial."""
    dt: float
    """Time between samples [s]."""
    step: float
    """Time between samples as recorded [s]."""
    time: FloatArray
    """Time of every sample as recorded [s]."""
    motor_angle: FloatArray
    """Angle of the motor, without movements by noise [rad]."""
    joint_angle: FloatArray
    """Angle of the joint, without movements by noise [rad]."""
    read: FloatArray
    """Angles (2, samples) of motor and joint with movements by noise [rad]."""
    measured: FloatArray
    """Torques (rows, samples) of motor and joint, those that are known [N m]."""
    band: float
    """Cut-off of the low-pass of the torques [Hz]."""
    counts: np.ndarray[tuple[int], np.dtype[np.bool_]]
    """True where a sample counts."""
    pretension: float | None
    """Pretension of the trial if known [N], else None; 0 without the cables."""
    start: float
    """Time from the beginning of the trial to the first sample [s]."""
    split: str | None
    """Purpose that `dataset.toml` reserves the trial for, else None."""
    group: str
    """Name of the trials that repeat each other; they are never on both sides of a
    division."""
    tilt: float = 0.0
    """Angle by which the rig was turned about the joint's axis [rad]."""
    occasion: str = ""
    """Name of the day or session, see `occasions`."""
    path: RecordedPath | None = None
    """Paths of the cables along the recording, where other joints move them, too."""
    conditions: TrialConditions = USUAL_CONDITIONS
    """Conditions of the trial."""
    known_torques: tuple[float, float] = (0.0, 0.0)
    """Torques of known weights in place of the cables, at motor and joint [N m]."""
    swapped: bool = False
    """True if the torque sensors had changed places."""
    load_cell: SingleCell | None = None
    """Load cell in one cable, compared in place of the torque at its end."""
    notes: str = ""
    """Notes on the trial."""
    columns: Mapping[str, FloatArray] = field(default_factory=dict)
    """Further columns of the file (samples,), by name, and the temperature."""

    @property
    def unhooked(self) -> bool:
        """True if the cables were taken off, so that they pull nothing."""
        return self.pretension == 0.0

    @property
    def free(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """True where a sample counts and is not reserved for the test."""
        return self.counts & (self.split != "test")

    @property
    def reserved(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """True where a sample counts and is reserved for the test."""
        return self.counts & (self.split == "test")


@dataclass(frozen=True)
class Filtering:
    """Processing applied to the recorded signals.

    Attributes:
        motion_band: cut-off of the low-pass of angles [Hz].
        passed: variance that passes of white noise of a torque, over its own.
        still: movement of motor and joint that counts as none [rad].
        load: noise of the torque of a known load by that of the joint's angle [N m].
    """

    motion_band: float
    passed: float
    still: tuple[float, ...]
    load: float = 0.0


def prepare(dataset: Dataset, bench: Bench) -> tuple[tuple[Record, ...], Filtering]:
    """Return the records of a dataset, in order, and how they were filtered."""
    slowest = min(trial.rate for trial in dataset.trials)
    band, motion_band = (
        compared_band(slowest),
        min(Limit.max_motion_band, 0.4 * slowest),
    )
    first = dataset.trials[0]
    bands = (band, motion_band)
    passed = (_passed_share(first, band), _passed_share(first, motion_band))
    still = tuple(
        Limit.still_sigmas * dataset.noise[name].deviation * passed[1] ** 0.5
        if name in dataset.noise
        else 0.0
        for name in _angle_channels(bench)
    )
    records = []
    conditions = _conditions(dataset.trials)
    for trial in dataset.trials:
        for part in trial.segments:
            if part.stop - part.start >= Limit.min_record_samples:
                record = _record(trial, part, bands, bench, still, dataset)
                records.append(replace(record, conditions=conditions[trial.name]))
    shaken = 0.0
    if dataset.instruments.joint == "known load":
        noise = dataset.noise[JOINT_ANGLE].deviation
        shaken = load_noise(dataset.constants, noise, first.rate, bands)
    return tuple(records), Filtering(motion_band, passed[0], still[:2], shaken)


def _conditions(trials: Sequence[Trial]) -> dict[str, TrialConditions]:
    """Return the conditions of trials, which are in the order of recording, by name."""
    means, rates = {}, {}
    for trial in trials:
        if trial.temperature is None or not np.isfinite(trial.temperature).any():
            continue
        known = np.isfinite(trial.temperature)
        time, celsius = trial.time[known], trial.temperature[known]
        means[trial.name] = float(celsius.mean())
        spread = time - time.mean()
        rates[trial.name] = float(spread @ celsius / max(spread @ spread, 1e-300))
    usual = float(np.mean(list(means.values()))) if means else 0.0
    middle = 0.5 * (len(trials) - 1)
    return {
        trial.name: TrialConditions(
            place - middle,
            means.get(trial.name, usual) - usual,
            rates.get(trial.name, 0.0),
        )
        for place, trial in enumerate(trials)
    }


def _angle_channels(bench: Bench) -> list[str]:
    """Return the channels of the angles that are played, motor and joint first."""
    return [MOTOR_ANGLE, JOINT_ANGLE, *map(other_angle, bench.others)]


def _thinning_factor(rate: float) -> int:
    return max(1, int(rate / Limit.min_kept_rate + 1e-9))


def _record(
    trial: Trial,
    part: slice,
    bands: tuple[float, float],
    bench: Bench,
    still: tuple[float, ...],
    dataset: Dataset,
) -> Record:
    noise, known = dataset.noise, dataset.instruments
    tilt = trial.facts.tilt or 0.0
    thin = _thinning_factor(trial.rate)
    band, motion_band = bands
    angles = np.array(
        [
            reconstruct_angle(trial.channel(name)[part], noise.get(name))
            for name in _angle_channels(bench)
        ]
    )
    passed = low_pass(angles, motion_band, trial.rate)
    torques = np.array(
        [
            load_torque(passed[1], trial.step, load_values(dataset.constants), tilt)
            if name == JOINT_TORQUE and known.joint == "known load"
            else trial.channel(name)[part]
            for name in known.channels
        ]
    )
    cell = None
    if trial.facts.load_cell:
        name, pretension = trial.facts.load_cell, trial.facts.pretension
        cell = SingleCell.of(name, bench, pretension)
        torques[known.rows.index(cell.row)] = cell.torque(trial.tensions[name][part])
    read = passed[:, ::thin].copy()
    measured = low_pass(torques, band, trial.rate)[:, ::thin]
    smooth = np.array(
        [play_filter(a, width) for a, width in zip(read, still, strict=True)]
    )
    time = trial.time[part][::thin]
    dt = trial.step * thin
    travel = np.cumsum(np.abs(np.diff(smooth[0], prepend=smooth[0, 0])))
    wind_up_travel = (
        0.0 if trial.facts.unhooked else Limit.run_in_travel * wind_up_angle(bench)
    )
    counts = (travel >= wind_up_travel) & (time - time[0] > 0.1)
    # Without samples on both sides the filter differs between the signals.
    edge = max(2, round(0.5 / band / dt))
    if known.motor == "motor current":
        # At rest the motor's own friction holds any torque, and the filter spreads
        # that to adjacent samples.
        speed = np.abs(np.gradient(smooth[0], dt))
        rests = speed <= Limit.records_rest_speed_share * np.quantile(speed, 0.95)
        counts &= np.convolve(rests, np.ones(2 * edge + 1), "same") < 0.5
    counts[:edge] = False
    counts[-edge:] = False
    return Record(
        trial=trial.name,
        dt=dt,
        step=trial.step,
        time=time,
        motor_angle=smooth[0],
        joint_angle=smooth[1],
        read=read[:2],
        measured=measured,
        band=band,
        counts=counts,
        pretension=0.0 if trial.facts.unhooked else trial.facts.pretension,
        known_torques=(
            trial.facts.known_motor_torque,
            trial.facts.known_joint_torque,
        ),
        swapped=trial.facts.swapped,
        load_cell=cell,
        notes=trial.facts.notes,
        start=float(time[0] - trial.time[0]),
        split=trial.facts.split,
        group=trial.facts.repeat_of or trial.name,
        tilt=tilt,
        occasion=trial.facts.occasion,
        path=bench.recorded_path(smooth[1], smooth[2:], Limit.ramp_samples),
        columns={name: values[part][::thin] for name, values in trial.columns.items()},
    )


def play_filter(angle: FloatArray, width: float) -> FloatArray:
    """Return the angle without movements smaller than `width` (samples,) [rad].

    The angle is followed with this much play, forwards and backwards in time; the mean
    of both has no lag in steady motion, and stands still where only noise moves the
    angle. The play would cut it short where the motion turns, and friction answers
    there: at a turn the play is added back to both, as far as the turn's own level.
    """
    if width == 0.0:
        return angle
    forwards = follow_with_play(angle, width)
    backwards = follow_with_play(angle[::-1].copy(), width)[::-1]
    found: FloatArray = 0.5 * (forwards + backwards)
    gap = backwards - forwards
    moving = np.where(np.abs(gap) > Limit.moving_threshold * width, np.sign(gap), 0.0)
    sure = np.flatnonzero(moving)
    turned, count = np.zeros(angle.size), np.zeros(angle.size)
    for turn in np.flatnonzero(np.diff(moving[sure])):
        side = moving[sure[turn]]
        part = slice(sure[turn], sure[turn + 1] + 1)
        reach = np.minimum(side * forwards[part], side * backwards[part]) + width
        highest = reach >= reach.max() - Limit.turn_level * width
        level = np.median(side * angle[part][highest])
        turned[part] += side * np.minimum(reach, level)
        count[part] += 1.0  # two turns may have a sample in common
    return np.where(count > 0.0, turned / np.maximum(count, 1.0), found)


def _passed_share(trial: Trial, band: float) -> float:
    impulse = np.zeros(4001)
    impulse[2000] = 1.0
    return float(np.sum(low_pass(impulse, band, trial.rate) ** 2))


def wind_up_angle(bench: Bench) -> float:
    """Return the motor rotation that winds up the cable against friction [rad]."""
    cable = bench.cables[0]
    a = min(max(cable.friction * cable.wrap, 1e-6), Limit.max_friction_wrap)
    strain = cable.pretension / cable.axial_stiffness
    slip = 2.0 * strain * cable.length * (math.expm1(a) / a - 1.0)
    return slip / bench.motor_radius
