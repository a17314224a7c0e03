"""Trials made ready for comparison: one clock, one band, a run-in that does not count.

Measured and simulated torques pass the same zero-phase low-pass. Angles, the inputs of
the simulation, keep a wider band, as friction responds to the corners of a motion. They
are held where they move by less than a few deviations of noise, which would shake a
sticking cable loose.

The state of the cable before a trial is unknown. So a lead-in moves from rest in
pretension to the first sample, and samples do not count until the motor has moved the
whole cable. A torque that no sensor measures may follow from a declared load.

A replay simulates the cables along a record's angles, each record in a thread. The key
of a cached replay is everything that acts on the cables, so candidates, folds and
derivatives share it; changes of sensors or outer loads need no replay.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from threading import Lock
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from cc_mujoco.cable import Cable, Driven, Transmission
from cc_mujoco.cable._coupled_route import CoupledCables, CoupledPath
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._channels import (
    JOINT_ANGLE,
    JOINT_TORQUE,
    MOTOR_ANGLE,
    other_angle,
)
from cc_mujoco.datasets._coupled_route import RecordedPath
from cc_mujoco.datasets._load_cells import SingleCell
from cc_mujoco.datasets._moment_arm import Lever
from cc_mujoco.datasets._quantization import reconstruct_angle
from cc_mujoco.datasets._rig_table import MomentArm
from cc_mujoco.datasets._trials import Constant, Dataset, Trial
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis.effects._effect import (
    USUAL_CONDITIONS,
    TrialConditions,
    follow_with_play,
)
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray, FloatMatrix, compiled

Indices = Sequence[int]
Arrays = Sequence[FloatArray]
"""Arrays of records, (rows, samples) each if not otherwise said."""
_EDGE_SAMPLES = 9
"""Samples by which a signal is continued, turned over, at either end."""


def compared_band(rate: float) -> float:
    """Return the cut-off [Hz] of the low-pass for torques sampled at a rate [Hz]."""
    return min(Limit.max_band, 0.3 * rate)


def low_pass(signals: FloatArray, band: float, rate: float) -> FloatArray:
    """Apply a zero-phase Butterworth low-pass to signals (..., samples).

    It equals `filtfilt` with `butter(2, band)` of `scipy.signal`, slow to import, to
    rounding. From a band of 0.45 times the rate on signals stay as they are.
    """
    if band >= 0.45 * rate:
        return signals
    first, last = signals[..., :1], signals[..., -1:]
    head = 2.0 * first - signals[..., _EDGE_SAMPLES:0:-1]
    tail = 2.0 * last - signals[..., -2 : -_EDGE_SAMPLES - 2 : -1]
    whole = [head, signals, tail]
    passed: FloatArray = np.concatenate(whole, axis=-1, dtype=np.float64)
    rows = passed.reshape(-1, passed.shape[-1])
    _pass_both_ways(*_coefficients(band / rate), rows)
    return rows.reshape(passed.shape)[..., _EDGE_SAMPLES:-_EDGE_SAMPLES]


@lru_cache(maxsize=16)
def _coefficients(band: float) -> tuple[float, float, float]:
    """Return b0, a1 / a0, a2 / a0 of the filter, by bilinear map; `band` is relative.

    The numerator is b0 (1 + 2 / z + 1 / z^2).
    """
    k = math.tan(math.pi * band)
    whole = 1.0 + math.sqrt(2.0) * k + k * k
    first = k * k / whole
    last = (1.0 - math.sqrt(2.0) * k + k * k) / whole
    return first, 2.0 * (k * k - 1.0) / whole, last


@compiled
def _pass_both_ways(gain: float, a1: float, a2: float, rows: FloatMatrix) -> None:
    """Filter rows (rows, samples) in place both ways, each from a steady state."""
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


def load_values(constants: Mapping[str, Constant]) -> dict[str, float]:
    return {name: constant.value for name, constant in constants.items()}


def load_torque(
    angle: FloatArray, step: float, values: Mapping[str, float], tilt: float = 0.0
) -> FloatArray:
    """Return the torque (samples,) that a declared load takes from the joint [N m].

    `angle` is the joint's (samples,), smooth [rad], every `step` [s]; `values` are
    `RIG_CONSTANTS` in SI units; the rig was turned by the angle `tilt` [rad].
    """
    speed = np.gradient(angle, step)
    stretch = angle - values.get("load_rest_angle", 0.0)
    lift = np.sin(angle + tilt - values.get("load_hanging_angle", 0.0))
    return (
        values.get("load_stiffness", 0.0) * stretch
        + values.get("load_damping", 0.0) * speed
        + values.get("load_inertia", 0.0) * np.gradient(speed, step)
        + values.get("load_weight", 0.0) * lift
    )


def load_noise(
    constants: Mapping[str, Constant],
    deviation: float,
    rate: float,
    bands: tuple[float, float],
) -> float:
    """Return the standard deviation of a load's torque due to angle noise [N m].

    `deviation` is of the angle [rad], `rate` in samples per second; `bands` cut torques
    and angles off [Hz]. The error of a rounded angle is slow and passes every filter.
    """
    values = load_values(constants)
    noise = deviation * np.random.default_rng(0).standard_normal(8192)
    moving = {n: v for n, v in values.items() if n in ("load_inertia", "load_damping")}
    shaken = load_torque(low_pass(noise, bands[1], rate), 1.0 / rate, moving)
    passed = float(np.std(low_pass(shaken, bands[0], rate)))
    slope = values.get("load_stiffness", 0.0) + values.get("load_weight", 0.0)
    return math.hypot(passed, slope * deviation)


LEAD_SAMPLES = 2 * Limit.ramp_samples
"""Samples that lead from rest in the pose 0 to the first sample."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """One stretch of one trial; arrays have one entry per sample kept.

    A record equals only itself, so that results for it can be cached.
    """

    trial: str  # name of the trial
    dt: float  # time between samples [s]
    step: float  # time between samples as recorded [s]
    time: FloatArray  # time of every sample as recorded [s]
    motor_angle: FloatArray  # angle of the motor, without movements by noise [rad]
    joint_angle: FloatArray  # angle of the joint, without movements by noise [rad]
    read: FloatArray  # angles (2, samples) of both with movements by noise [rad]
    measured: FloatArray  # torques (rows, samples) that are known, motor first [N m]
    band: float  # cut-off of the low-pass of the torques [Hz]
    counts: np.ndarray[tuple[int], np.dtype[np.bool_]]  # true where a sample counts
    pretension: float | None  # None if unknown; 0 without the cables [N]
    start: float  # time from the beginning of the trial to the first sample [s]
    split: str | None  # purpose that `dataset.toml` reserves the trial for, else None
    # Name of the trials that repeat each other, always on one side of a division
    group: str
    tilt: float = 0.0  # angle by which the rig was turned about the joint's axis [rad]
    occasion: str = ""  # name of the day or session
    # Paths of the cables along the recording, where other joints move them, too
    path: RecordedPath | None = None
    conditions: TrialConditions = USUAL_CONDITIONS  # conditions of the trial
    # Torques of known weights in place of the cables, at motor and joint [N m]
    known_torques: tuple[float, float] = (0.0, 0.0)
    swapped: bool = False  # true if the torque sensors had changed places
    # Load cell in one cable, compared in place of the torque at its end
    load_cell: SingleCell | None = None
    cell_noise: float = 0.0  # standard deviation of its readings [N m]
    notes: str = ""  # notes on the trial
    # Further columns of the file (samples,), by name, and the temperature
    columns: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def unhooked(self) -> bool:
        """True if the cables were taken off in the trial."""
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
    """Processing that was applied to the recorded signals."""

    band: float  # cut-off of the low-pass of torques [Hz]
    motion_band: float  # cut-off of that of angles [Hz]
    passed: float  # variance that passes of white noise of a torque, over its own
    # Movement that counts as none, of motor, joint and others that are played [rad]
    still: tuple[float, ...]
    load: float = 0.0  # noise of a known load's torque by that of the angle [N m]


def prepare(
    dataset: Dataset, bench: Bench, thinned: bool = False
) -> tuple[tuple[Record, ...], Filtering]:
    """Return the records of a dataset, in order, and the filters applied to them.

    If `thinned`, long trials keep only as many samples as torques of the band need.
    """
    first, slowest = dataset.trials[0], min(trial.rate for trial in dataset.trials)
    bands = compared_band(slowest), min(Limit.max_motion_band, 0.4 * slowest)
    impulse = np.zeros(4001)
    impulse[2000] = 1.0
    passed = [float(np.sum(low_pass(impulse, band, first.rate) ** 2)) for band in bands]
    # Angles that are played, motor and joint first.
    angle_channels = [MOTOR_ANGLE, JOINT_ANGLE, *map(other_angle, bench.others)]
    known = [dataset.noise.get(name) for name in angle_channels]
    sizes = [Limit.still_sigmas * each.deviation if each else 0.0 for each in known]
    still = tuple(size * passed[1] ** 0.5 for size in sizes)
    shaken = 0.0
    if dataset.instruments.joint == "known load":
        noise = dataset.noise[JOINT_ANGLE].deviation
        shaken = load_noise(dataset.constants, noise, first.rate, bands)
    filtering = Filtering(*bands, passed[0], still, shaken)
    records = []
    conditions = _conditions(dataset.trials)
    for trial in dataset.trials:
        for part in trial.segments:
            if part.stop - part.start >= Limit.min_record_samples:
                record = _record(trial, part, dataset, bench, filtering, thinned)
                records.append(replace(record, conditions=conditions[trial.name]))
    return tuple(records), filtering


def _conditions(trials: Sequence[Trial]) -> dict[str, TrialConditions]:
    means, rates = {}, {}
    for trial in trials:
        if trial.temperature is not None and np.isfinite(trial.temperature).any():
            known = np.isfinite(trial.temperature)
            time, celsius = trial.time[known], trial.temperature[known]
            means[trial.name] = float(celsius.mean())
            spread = time - time.mean()
            rates[trial.name] = float(spread @ celsius / max(spread @ spread, 1e-300))
    usual = float(np.mean(list(means.values()))) if means else 0.0
    middle = 0.5 * (len(trials) - 1)
    order = {trial.name: place - middle for place, trial in enumerate(trials)}
    warmth = {name: means.get(name, usual) - usual for name in order}
    rise = {name: rates.get(name, 0.0) for name in order}
    return {n: TrialConditions(order[n], warmth[n], rise[n]) for n in order}


def _record(
    trial: Trial, part: slice, dataset: Dataset, bench: Bench, filtering: Filtering,
    thinned: bool,
) -> Record:  # fmt: skip
    noise, known, facts = dataset.noise, dataset.instruments, trial.facts
    tilt = facts.tilt or 0.0
    thin = max(1, int(trial.rate / Limit.min_kept_rate + 1e-9))
    played = (MOTOR_ANGLE, JOINT_ANGLE, *map(other_angle, bench.others))
    seen = ((trial.channel(name)[part], noise.get(name)) for name in played)
    angles = np.array([reconstruct_angle(values, own) for values, own in seen])
    passed = low_pass(angles, filtering.motion_band, trial.rate)
    if thinned and (part.stop - part.start) * trial.step > Limit.long_trial:
        most = int(trial.rate / (2.0 * filtering.band) + 1e-9)
        thin = _largest_step(passed, range(thin, most + 1, thin)) or thin
    torques = np.array(
        [
            load_torque(passed[1], trial.step, load_values(dataset.constants), tilt)
            if name == JOINT_TORQUE and known.joint == "known load"
            else trial.channel(name)[part]
            for name in known.channels
        ]
    )
    cell, cell_noise = None, 0.0
    if name := facts.load_cell:
        cell = SingleCell.of(name, bench, facts.pretension)
        torques[known.rows.index(cell.row)] = cell.torque(trial.tensions[name][part])
        cell_noise = abs(cell.factor) * noise[name].deviation if name in noise else 0.0
    read = passed[:, ::thin].copy()
    measured = low_pass(torques, filtering.band, trial.rate)[:, ::thin]
    pairs = zip(read, filtering.still, strict=True)
    smooth = np.array([play_filter(angle, width) for angle, width in pairs])
    time = trial.time[part][::thin]
    dt = trial.step * thin
    travel = np.cumsum(np.abs(np.diff(smooth[0], prepend=smooth[0, 0])))
    run_in = 0.0
    if not facts.unhooked:
        run_in = Limit.run_in_travel * wind_up_angle(bench)
    counts = (travel >= run_in) & (time - time[0] > 0.1)
    # Without samples on both sides the filter differs between the signals.
    edge = max(2, round(0.5 / filtering.band / dt))
    if known.motor == "motor current":
        # At rest the motor's friction holds any torque, which the filter spreads.
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
        band=filtering.band,
        counts=counts,
        pretension=0.0 if facts.unhooked else facts.pretension,
        known_torques=(facts.known_motor_torque, facts.known_joint_torque),
        swapped=facts.swapped,
        load_cell=cell,
        cell_noise=cell_noise,
        notes=facts.notes,
        start=float(time[0] - trial.time[0]),
        split=facts.split,
        group=facts.repeat_of or trial.name,
        tilt=tilt,
        occasion=facts.occasion,
        path=bench.recorded_path(smooth[1], smooth[2:], Limit.ramp_samples),
        columns={name: values[part][::thin] for name, values in trial.columns.items()},
    )


def _largest_step(angles: FloatArray, steps: Sequence[int]) -> int:
    """Return the largest step between samples whose lines follow all angles, or 0."""
    place, ranges = np.arange(angles.shape[1]), np.ptp(angles, axis=1)
    moved = np.maximum(ranges, Limit.held_share * ranges.max())
    for step in reversed(steps):
        drawn = [np.interp(place, place[::step], angle[::step]) for angle in angles]
        missed = np.sqrt(np.mean((angles - drawn) ** 2, axis=1))
        if (missed <= Limit.max_missed_motion * moved).all():
            return step
    return 0


def play_filter(angle: FloatArray, width: float) -> FloatArray:
    """Return the angle (samples,) without movements smaller than `width` [rad].

    It is followed with play forwards and backwards in time, whose mean has no lag and
    stands still under noise. At a turn the play is added back, as friction responds to
    it.
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


def wind_up_angle(bench: Bench) -> float:
    """Return the motor angle that winds up the whole cable against friction [rad]."""
    cable = bench.cables[0]
    a = min(max(cable.friction * cable.wrap, 1e-6), Limit.max_friction_wrap)
    strain = cable.pretension / cable.axial_stiffness
    slip = 2.0 * strain * cable.length * (math.expm1(a) / a - 1.0)
    return slip / bench.motor_radius


class Setting(NamedTuple):
    cables: tuple[Cable, ...]  # agonist first
    motor_radius: float  # of the motor's pulley [m]
    joint_radius: float  # of the joint's pulley [m]
    backlash: float  # between joint and its pulley [rad]
    late: float  # delay of the recorded joint angle [s]
    offset: float  # added to the recorded joint angle [rad]
    substeps: int  # simulation steps per sample
    # Arm at the joint by its angle; None where a pulley keeps its radius
    profile: Lever | MomentArm | None = None
    courses: tuple[CoupledPath, ...] = ()  # of led cables, see `Bench.courses`
    share: float = 1.0  # factor of the courses' distal displacements
    # Coefficients of `MomentArm` at the motor, where the angle is that by which a cable
    # is wound on: that of the motor, and its negative for the antagonist
    motor_arm: tuple[float, ...] = ()

    def following(self, joint: FloatArray) -> FloatArray:
        """Return the motor angle at which the cables keep their length (samples,)."""
        return self.joint_radius / self.motor_radius * self.turned(joint)

    def turned(self, joint: FloatArray) -> FloatArray:
        """Return the angle by which a round joint pulley winds as much (samples,)."""
        return joint if self.profile is None else self.profile.turned(joint)


class Played(NamedTuple):
    """Signals of a replay, (samples,) each."""

    joint_angle: FloatArray  # as recorded, its delay undone [rad]
    motor: FloatArray  # torque into the motor's pulley [N m]
    joint: FloatArray  # torque into the joint [N m]
    tension_proximal: FloatArray  # of every cable at the motor (cables, samples) [N]
    tension_distal: FloatArray  # of every cable at the joint (cables, samples) [N]


def agonist_less_antagonist(tension: FloatArray) -> FloatArray:
    """Return the net pull (samples,) of cable ends (cables, samples) [N]."""
    return np.array([1.0, -1.0])[: len(tension)] @ tension


REPLAYS: WeakKeyDictionary[Record, dict[Setting, Played]] = WeakKeyDictionary()
"""Cached replays, of every record the last `Limit.max_replays`."""
_LOCK = Lock()


def cached_replay(record: Record, setting: Setting) -> Played:
    with _LOCK:
        kept = REPLAYS.setdefault(record, {})
        found = kept.pop(setting, None)  # to the end
        if found is not None:
            kept[setting] = found
            return found
    found = replay(record, setting)
    with _LOCK:
        kept[setting] = found
        if len(kept) > Limit.max_replays:
            del kept[next(iter(kept))]
    return found


def replay(record: Record, setting: Setting) -> Played:
    joint = shift_signal(record.joint_angle, setting.late / record.dt) + setting.offset
    if record.unhooked:
        nothing = np.zeros(joint.size)
        slack = np.zeros((len(setting.cables), joint.size))
        return Played(joint - setting.offset, nothing, nothing, slack, slack)
    courses, path, substeps = setting.courses, record.path, setting.substeps
    if path is None:
        motor, turned = with_lead_in(
            record.motor_angle, joint, setting.following, substeps
        )
    else:  # its lead-in is known, whatever the joint's, and its courses go by rows
        courses = path.along(joint, setting.cables[0].segments)
        reach = courses[0].reach[: path.ramp + 1]
        along = -setting.share * reach / setting.motor_radius
        motor, _ = with_lead_in(record.motor_angle, joint, lambda _: along, substeps)
        turned = np.arange(motor.size) / substeps
    dt = record.dt / substeps
    if courses:
        drive = CoupledCables(
            setting.cables, courses, setting.motor_radius, setting.share
        )
        torques = drive.replay(dt, motor_angle=motor, joint_angle=turned)
    elif setting.motor_arm:
        torques = _wound(setting, dt, motor, turned)
    else:
        radii = setting.motor_radius, setting.joint_radius
        pulleys = Transmission(setting.cables, *radii, backlash=setting.backlash)
        pulley_angle = setting.turned(turned)
        torques = pulleys.replay(dt, motor_angle=motor, joint_angle=pulley_angle)
        if setting.profile is not None:
            share = setting.profile.share(turned)
            torques = replace(torques, joint_torque=torques.joint_torque * share)
    keep = slice(LEAD_SAMPLES * substeps, None, substeps)
    ends = torques.motor_torque[keep].copy(), torques.joint_torque[keep].copy()
    cables = torques.tension_proximal[:, keep], torques.tension_distal[:, keep]
    return Played(joint - setting.offset, *ends, *(each.copy() for each in cables))


def _wound(setting: Setting, dt: float, motor: FloatArray, joint: FloatArray) -> Driven:
    """Replay both angles through cables on a drum whose radius changes.

    A round pulley that winds as much replaces it, at another angle for each cable.
    """
    if setting.backlash or any(c.eccentricity or c.ovality for c in setting.cables):
        raise CableError(
            "a drum whose radius changes cannot be simulated together with play or an "
            "eccentric pulley"
        )
    arm = MomentArm(setting.motor_arm)
    pulleys = Transmission(setting.cables, setting.motor_radius, setting.joint_radius)
    signs = (1.0, -1.0)[: len(setting.cables)]
    wound = [sign * arm.turned(sign * motor) for sign in signs]
    turned = setting.turned(joint)
    parts = [pulleys.replay(dt, motor_angle=w, joint_angle=turned) for w in wound]
    proximal = np.array([p.tension_proximal[k] for k, p in enumerate(parts)])
    distal = np.array([p.tension_distal[k] for k, p in enumerate(parts)])
    levers = np.array([sign * arm.share(sign * motor) for sign in signs])
    lever: FloatArray | float = setting.joint_radius
    if setting.profile is not None:
        lever = lever * setting.profile.share(joint)
    return replace(
        parts[0],
        motor_torque=setting.motor_radius * np.sum(levers * proximal, axis=0),
        joint_torque=lever * agonist_less_antagonist(distal),
        tension_proximal=proximal,
        tension_distal=distal,
    )


def with_lead_in(
    motor: FloatArray,
    joint: FloatArray,
    following: Callable[[FloatArray], FloatArray],
    substeps: int,
) -> tuple[FloatArray, FloatArray]:
    """Return both angles, `substeps` per sample, with a lead-in from rest at pose 0.

    It takes both ends to the joint's first angle, then the motor to its own;
    `following` is the motor angle that keeps the cables' length.
    """
    count = Limit.ramp_samples
    there = np.linspace(0.0, 1.0, count + 1) * joint[0]
    along = following(there)
    settling = np.linspace(along[-1], motor[0], count + 1)[:-1]
    led_motor = np.concatenate([along[:-1], settling, motor])
    led_joint = np.concatenate([there[:-1], np.full(count, joint[0]), joint])
    if substeps == 1:
        return led_motor, led_joint
    size = led_motor.size
    x = np.arange(size * substeps - substeps + 1) / substeps
    old = np.arange(size)
    return np.interp(x, old, led_motor), np.interp(x, old, led_joint)


def shift_signal(signal: FloatArray, samples: float) -> FloatArray:
    """Return the signal (samples,) advanced by `samples`, linearly interpolated."""
    if samples == 0.0:
        return signal
    x = np.arange(signal.size)
    return np.asarray(np.interp(x + samples, x, signal))
