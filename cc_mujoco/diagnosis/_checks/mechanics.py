"""Checks of signs, units, clocks and delays by the mechanics of a transmission.

Three things are known of every transmission, whatever its friction: the joint follows
the motor, the torques of motor and joint rise together, and motor power less joint
power is never negative in the long run. Of the seven ways in which signs may be wrong,
each breaks another combination of the three (inverting everything on both sides is a
change of convention that nothing can show). By virtual work the ratio of the angles is
the ratio of the torques, friction aside, if the units are right.

The speeds of motor and joint are correlated in windows. Lost motion makes the joint
late by a time that shrinks with speed; a delay is the same in every window; between two
clocks the delay grows with time. The three are fitted together, so that a motion whose
speed changes is not taken for a clock that drifts.

A cable under tension stretches: the motor turns further than the joint (it leads), and
the more, the larger the tension, whatever the friction. Angles that show the opposite
are swapped: if both pulleys are equal nothing else shows it. A torque that follows this
lead after a time is late by that time.
"""

import itertools
import math
from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.linalg import norm
from numpy.typing import NDArray

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._channels import (
    ANGLE,
    JOINT_ANGLE,
    JOINT_TORQUE,
    MAIN_CHANNELS,
    MOTOR_ANGLE,
    MOTOR_TORQUE,
    TORQUE,
    unit_of,
)
from cc_mujoco.datasets._data_findings import DataFinding, error, warning
from cc_mujoco.datasets._dataset_file import MAX_DELAY
from cc_mujoco.datasets._smoothing import velocity
from cc_mujoco.datasets._trials import Trial
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words

Findings = list[DataFinding]


class Mechanics(NamedTuple):
    """Correlations, ratios and works that relate motor and joint in one trial."""

    ratio: float  # joint speed per motor speed
    follows: float  # correlation of the speeds, 0 if one side stands still
    torque_ratio: float  # motor torque per joint torque, friction aside
    torque_correlation: float  # of both torques while the cable slides, 0 if unknown
    motor_work: float  # work of the motor per its travel, less the stored energy [N m]
    joint_work: float  # the same of the joint; their difference is friction
    doubt: float  # standard deviation of that difference
    scale: float  # summed sizes of both powers per speed of the motor [N m]


def measure_mechanics(trial: Trial) -> Mechanics:
    used = np.concatenate([np.arange(p.start, p.stop) for p in trial.segments])
    omega = velocity(trial.motor_angle, trial.step, trial.segments)[used]
    turn = velocity(trial.joint_angle, trial.step, trial.segments)[used]
    ratio = float(omega @ turn / max(omega @ omega, 1e-300))
    follows = _correlation(omega, turn)
    if trial.motor_torque is None or trial.joint_torque is None:
        return Mechanics(ratio, follows, 0.0, 0.0, 0.0, 0.0, math.inf, 1.0)
    motor, joint = trial.motor_torque[used], trial.joint_torque[used]
    torques = sliding_torque_ratio(motor, joint, omega, trial.step)
    works = _work_per_travel(trial, used, (motor, joint), omega, turn)
    return Mechanics(ratio, follows, *torques, *works)


def _correlation(one: FloatArray, other: FloatArray) -> float:
    scale = math.sqrt(float((one @ one) * (other @ other)))
    return float(one @ other) / scale if scale > 0.0 else 0.0


def sliding_torque_ratio(
    motor: FloatArray, joint: FloatArray, omega: FloatArray, step: float
) -> tuple[float, float]:
    """Return motor over joint torque in sliding, and their correlation; 0 if unsure.

    Friction that grows with load makes the slope of motor over joint torque larger in
    one direction of motion and smaller in the other; the geometric mean of both is the
    ratio without friction. Signals are (samples,), `omega` the motor's speed [rad/s].
    """
    usual = math.sqrt(float(np.mean(omega**2)))
    ways, settled = _sliding(omega, usual, step)
    slopes, matches = [], []
    for way in (1.0, -1.0):
        rows = settled & (ways == way)
        if np.count_nonzero(rows) < 50:
            return 0.0, 0.0
        one, other = (torque[rows] - torque[rows].mean() for torque in (motor, joint))
        pairs = (one, motor), (other, joint)
        least = Limit.min_spread_share
        if not all(part.std() > least * whole.std() for part, whole in pairs):
            return 0.0, 0.0
        slopes.append(float(one @ other) / float(other @ other))
        matches.append(_correlation(one, other))
    if slopes[0] * slopes[1] <= 0.0:
        return 0.0, 0.0
    ratio = math.copysign(math.sqrt(slopes[0] * slopes[1]), slopes[0])
    return ratio, math.copysign(min(map(abs, matches)), slopes[0])


def _sliding(
    omega: FloatArray, usual: float, step: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the direction of motion, and a mask where the cable slides (samples,)."""
    slow = Limit.sliding_speed_share * usual
    moving = np.flatnonzero(np.abs(omega) > 0.2 * Limit.sliding_speed_share * usual)
    last = np.zeros(len(omega), dtype=np.intp)
    last[moving] = moving
    ways = np.sign(omega[np.maximum.accumulate(last)])
    travel = np.cumsum(np.abs(omega)) * step
    turned = np.flatnonzero(np.diff(ways, prepend=ways[0]))
    start = np.zeros(len(omega))
    start[turned] = travel[turned]
    since = travel - np.maximum.accumulate(start)
    span = float(np.ptp(np.cumsum(omega) * step))
    return ways, (since > Limit.signs_settling_share * span) & (np.abs(omega) > slow)


def _work_per_travel(
    trial: Trial, used: np.ndarray, shown: tuple[FloatArray, FloatArray],
    omega: FloatArray, turn: FloatArray,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Return works of motor and joint per motor travel, deviation and power [N m].

    The stored energy is fitted as a function of torques and speeds, so that cycles need
    not be closed; linear terms in the angles absorb offsets of the torques. The
    deviation is that of the difference of the works, the power per speed of the motor.
    """
    motor, joint = shown
    angles = trial.motor_angle[used], trial.joint_angle[used]
    powers = np.column_stack([motor * omega, joint * turn, np.abs(omega)])
    passed = np.cumsum(powers, axis=0) * trial.step
    travel = passed[:, 2]
    span = np.ptp(angles[0])
    if not span > 0.0 or travel[-1] < Limit.min_travel * span:
        return 0.0, 0.0, math.inf, 1.0
    squares = motor**2, joint**2, motor * joint, omega**2, turn**2
    columns = np.column_stack([travel, *angles, *squares, passed[:, :2]])
    ends = np.cumsum([0, *(part.stop - part.start for part in trial.segments)])
    for start, end in itertools.pairwise(ends):
        columns[start:end] -= columns[start:end].mean(axis=0)
    known, works = columns[:, :8], columns[:, 8:]
    scale = np.maximum(np.abs(known).max(axis=0), 1e-300)
    slopes = np.linalg.lstsq(known / scale, works, rcond=None)[0] / scale[:, None]
    lost = (works - known[:, 1:] @ slopes[1:]) @ [1.0, -1.0]
    blocks = [b for b in np.array_split(np.arange(len(used)), 8) if len(b) > 2]
    blocks = [b for b in blocks if np.ptp(travel[b]) > 0.02 * travel[-1]]
    rates = [np.polyfit(travel[b], lost[b], 1)[0] for b in blocks]
    doubt = np.std(rates) / math.sqrt(len(rates)) if len(rates) > 2 else math.inf
    power = float(np.abs(powers[:, :2]).sum() * trial.step / travel[-1])
    return float(slopes[0, 0]), float(slopes[0, 1]), float(doubt), max(power, 1e-300)


_MIN_TORQUE_CORRELATION = 0.7


class Group(NamedTuple):
    """Trials whose angles and torques correlate with equal signs, judged together."""

    trials: list[Trial]
    mechanics: Mechanics


def group_trials(trials: Sequence[Trial], known: Sequence[Mechanics]) -> list[Group]:
    by_signs = defaultdict(list)
    for trial, m in zip(trials, known, strict=True):
        angles = _sign(m.follows, Limit.min_angle_correlation)
        torques = _sign(m.torque_correlation, _MIN_TORQUE_CORRELATION)
        by_signs[angles, torques].append((trial, m))
    pooled = ((members, _pool_mechanics(members)) for members in by_signs.values())
    return [Group([trial for trial, _ in members], m) for members, m in pooled]


def _sign(correlation: float, least: float) -> float:
    return math.copysign(1.0, correlation) if abs(correlation) > least else 0.0


def _pool_mechanics(members: list[tuple[Trial, Mechanics]]) -> Mechanics:
    first = members[0][1]
    if len(members) == 1:
        return first
    torques = first.torque_ratio, first.torque_correlation
    if not any(t.motor_torque is None or t.joint_torque is None for t, _ in members):
        parts = [(trial, part) for trial, _ in members for part in trial.segments]
        omega = [velocity(trial.motor_angle[part], trial.step) for trial, part in parts]
        both = MOTOR_TORQUE, JOINT_TORQUE
        signals = [[trial.channel(n)[part] for trial, part in parts] for n in both]
        motor, joint = map(np.concatenate, signals)
        step = members[0][0].step
        pooled = sliding_torque_ratio(motor, joint, np.concatenate(omega), step)
        torques = max(pooled, torques, key=lambda each: abs(each[1]))
    ratio = float(np.median([m.ratio for _, m in members]))
    found = Mechanics(ratio, first.follows, *torques, *first[4:])
    usable = [m for _, m in members if math.isfinite(m.doubt)]
    if not usable:
        return found
    motor, joint, doubt, scale = np.array([m[4:] for m in usable]).T
    lost = float(np.sqrt((doubt**2).sum())) / len(usable)
    works = float(motor.mean()), float(joint.mean()), lost, float(scale.mean())
    return Mechanics(*found[:4], *works)


def check_signs(group: Group) -> Findings:
    """Return a finding if channels of a group have wrong signs or swapped sides."""
    trials, m = group
    follows = _sign(m.follows, Limit.min_angle_correlation)
    torque_correlation = _sign(m.torque_correlation, _MIN_TORQUE_CORRELATION)
    friction = m.motor_work - m.joint_work
    made = friction < -max(3.0 * m.doubt, Limit.min_generated_share * m.scale)
    contradictions = {
        "the joint turns against the motor": follows < 0.0,
        "motor torque falls where joint torque rises": torque_correlation < 0.0,
        f"more energy leaves the transmission than enters, by "
        f"{-friction / m.scale:.0%} of what passes": made,
    }
    found = [text for text, there in contradictions.items() if there]
    if not found:
        return []
    ways = _fewest_inversions(m, follows, torque_correlation)
    if follows >= 0.0 and torque_correlation >= 0.0:
        ways.append("swap the motor's columns with the joint's")
        # With the torques swapped, each works on the other side's travel.
        if follows and m.joint_work / m.ratio > m.motor_work * m.ratio:
            ways.append(f"swap {{{MOTOR_TORQUE}}} and {{{JOINT_TORQUE}}}")
    advice = " or ".join(ways).format(**_labels(trials[0]))
    if "invert" in advice:
        advice += " (in dataset.toml, `sign` in the table [columns.CHANNEL])"
    sentence = f"{_files(trials)}: {' and '.join(found)}; {advice}."
    if follows < 0.0:
        certain = True
    elif made:
        # A wrong gain of a sensor makes a little power, only a wrong sign much.
        net = abs(m.motor_work) + abs(m.joint_work)
        large = max(Limit.large_generated_share * m.scale, Limit.clear_work_share * net)
        certain = torque_correlation < 0.0 or -friction > large
    else:
        # Torques also oppose each other where both sides drive against friction.
        known = friction < Limit.max_friction_share * m.scale and math.isfinite(m.doubt)
        certain = known or len(trials) >= Limit.signs_min_trials
    return [(error if certain else warning)(sentence, _single_trial_name(trials))]


def _files(trials: list[Trial]) -> str:
    others = [trial.path for trial in trials[1:]]
    more = others[0] if len(others) == 1 else f"{len(others)} other files"
    return f"{trials[0].path} and {more}" if others else trials[0].path


def _single_trial_name(trials: list[Trial]) -> str:
    return trials[0].name if len(trials) == 1 else ""


def _labels(trial: Trial) -> dict[str, str]:
    return {channel: trial.labels.get(channel, channel) for channel in MAIN_CHANNELS}


def wrong_unit(trial: Trial, channel: str) -> str:
    """Name the unit error that makes a channel too large, or its counterpart small."""
    angle = channel in (MOTOR_ANGLE, JOINT_ANGLE)
    pair = (MOTOR_ANGLE, JOINT_ANGLE) if angle else (MOTOR_TORQUE, JOINT_TORQUE)
    # Small unit that a channel may have, and the plain one
    small, plain, kind = ("deg", "radians", ANGLE) if angle else ("mNm", "Nm", TORQUE)
    other = pair[channel == pair[0]]
    label = trial.labels.get(other, other)
    if unit_of(label, kind) == small:
        return f"{label} is in {plain}, whatever its name says"
    unit_name = "degrees" if angle else small
    return f"{trial.labels.get(channel, channel)} is in {unit_name}"


def _fewest_inversions(m: Mechanics, follows: float, torques: float) -> list[str]:
    possible: list[list[str]] = []
    least = -min(2.0 * m.doubt, Limit.min_generated_share * m.scale)
    for flips in itertools.product((1, -1), repeat=4):
        motor_angle, motor_torque, joint_angle, joint_torque = flips
        made = motor_angle * motor_torque * m.motor_work
        friction = made - joint_angle * joint_torque * m.joint_work
        opposed = torques * motor_torque * joint_torque < 0.0
        agrees = follows * motor_angle * joint_angle >= 0.0 and not opposed
        if agrees and friction > least:
            signs = zip(MAIN_CHANNELS, flips, strict=True)
            possible.append([f"{{{name}}}" for name, flip in signs if flip < 0])
    fewest = min(map(len, possible), default=0)
    ways = [f"invert {' and '.join(e)}" for e in possible if len(e) == fewest]
    return ways or ["check the signs"]


def check_units(group: Group) -> Findings:
    """Return a finding if the ratio of the torques contradicts that of the angles."""
    trials, m = group
    # The ratio of two torques means a unit only where both are nearly proportional.
    if not (
        abs(m.follows) > Limit.min_angle_correlation and abs(m.torque_correlation) > 0.9
    ):
        return []
    mismatch, degrees = abs(m.torque_ratio / m.ratio), math.degrees(1.0)
    if 1.0 / Limit.unit_mismatch_ratio < mismatch < Limit.unit_mismatch_ratio:
        return []
    mends = {
        wrong_unit(trials[0], MOTOR_ANGLE): mismatch / degrees,
        wrong_unit(trials[0], JOINT_ANGLE): mismatch * degrees,
        wrong_unit(trials[0], MOTOR_TORQUE): mismatch / 1e3,
        wrong_unit(trials[0], JOINT_TORQUE): mismatch * 1e3,
        "the torque columns are swapped": 1.0 / abs(m.torque_ratio * m.ratio),
        "the angle columns are swapped": abs(m.torque_ratio * m.ratio),
    }
    off = sorted((abs(math.log(left)), text) for text, left in mends.items())
    likely = [text for size, text in off if size < math.log(Limit.unit_match_ratio)]
    advice = " or ".join(likely[:2]).format(**_labels(trials[0]))
    sentence = (
        f"{_files(trials)}: the joint turns {m.ratio:.3g} rad per motor radian, but "
        f"motor torque is {m.torque_ratio:.3g} of joint torque, which cannot be; "
        f"{f'perhaps {advice}' if advice else 'check units and columns'}."
    )
    return [error(sentence, _single_trial_name(trials))]


def check_sizes(trials: Sequence[Trial], known: Sequence[Mechanics]) -> Findings:
    """Find trials with torques hundreds of times as large as in the others.

    Trials under load may exceed those with a free joint by as much, but in both
    torques.
    """
    if any(t.motor_torque is None or t.joint_torque is None for t in trials):
        return []
    ratios = [
        abs(m.ratio) for m in known if abs(m.follows) > Limit.min_angle_correlation
    ]
    ratio = float(np.median(ratios)) if ratios else 1.0
    share = {MOTOR_TORQUE: ratio, JOINT_TORQUE: 1.0 / ratio}
    sizes, leaps = {}, {}  # size below a leap in the sizes of the trials
    for channel in share:
        squares = [np.nanmean(t.channel(channel) ** 2) for t in trials]
        sizes[channel] = np.array([np.sqrt(square) for square in squares])
        ordered = np.sort(sizes[channel])
        below = Limit.torque_leap_ratio * np.maximum(ordered[:-1], 1e-12)
        above = np.flatnonzero(ordered[1:] > below)
        leaps[channel] = float(ordered[above[-1]]) if len(above) else math.inf
    findings = []
    for channel, other in itertools.permutations(sizes):
        own, least = sizes[channel], leaps[channel]
        for k in np.flatnonzero(own > least).tolist():
            most = Limit.torque_leap_ratio * share[channel] * sizes[other][k]
            if own[k] < most and sizes[other][k] <= leaps[other]:
                continue
            trial, usual = trials[k], float(own[own <= least].max())
            message = (
                f"{trial.column(channel)} is {own[k]:.3g} N m RMS, but at "
                f"most {usual:.3g} in other trials; perhaps it is in mNm: call it "
                f"{channel.removesuffix('_nm')}_mnm there."
            )
            findings.append(error(message, trial.name, channel))
    return findings


def check_ratios(trials: Sequence[Trial], known: Sequence[Mechanics]) -> Findings:
    pairs, least = zip(trials, known, strict=True), Limit.min_angle_correlation
    certain = [(trial, m.ratio) for trial, m in pairs if abs(m.follows) > least]
    if len(certain) < 3:
        return []
    usual, odd = float(np.median([abs(ratio) for _, ratio in certain])), 8.0
    return [
        error(
            f"{trial.path}: the joint turns {ratio:.3g} rad per motor radian, but "
            f"{usual:.3g} in the other trials; check the units of its angles.",
            trial.name,
        )
        for trial, ratio in certain
        if not 1.0 / odd < abs(ratio) / usual < odd
    ]


class Alignment(NamedTuple):
    """Timing of the joint's readings against the motor's."""

    delay: float  # delay of the joint [s], NaN if it cannot be seen
    drift: float  # change of the delay per time [s/s], 0 if none can be seen
    doubt: float  # standard deviation of the drift; infinite with too few windows
    gain: float  # rise of the correlation of the speeds when the delay is undone
    drift_gain: float  # further rise when the drift is undone as well


def measure_alignment(trial: Trial) -> Alignment:
    unknown = Alignment(math.nan, 0.0, math.inf, 0.0, 0.0)
    windows = _windows(trial)
    if not windows:
        return unknown
    times = np.array([window.time for window in windows])
    times -= times.mean()
    delay, drift = _delay_and_drift(windows, times, trial.step)
    found = []
    for window, time in zip(windows, times, strict=True):
        lag = _nearest_peak(window.match, delay + drift * time, trial.step)
        if lag is not None:
            found.append((time, lag, 1.0 / window.speed, window.match))
    if len(found) < max(2, 0.5 * len(windows)):
        return unknown
    now, lags, slow = np.array([entry[:3] for entry in found]).T
    middle = float(np.median(lags))
    matches = np.array([match for *_, match in found])
    none, there = matches.shape[1] // 2, round(middle / trial.step)
    gain = float(np.median(matches[:, none + there] - matches[:, none]))
    if len(found) < 6 or np.ptp(now) == 0.0:
        return Alignment(middle, 0.0, math.inf, gain, 0.0)
    basis = np.column_stack([now - now.mean(), np.ones_like(now), slow])
    scale = np.abs(basis).max(axis=0)
    scaled = basis / scale
    inverse = np.linalg.pinv(scaled.T @ scaled)
    slopes = inverse @ scaled.T @ lags
    rest = lags - scaled @ slopes
    spread = float(rest @ rest) / max(1, len(lags) - 3)
    doubt = math.sqrt(spread * inverse[0, 0]) / scale[0]
    drift = float(slopes[0] / scale[0])
    row = np.arange(len(found))
    moved = np.round((middle + drift * (now - np.median(now))) / trial.step)
    moved = np.clip(none + moved.astype(int), 0, matches.shape[1] - 1)
    rise = matches[row, moved] - matches[row, none + there]
    return Alignment(middle, drift, doubt, gain, float(np.mean(rise)))


class _Window(NamedTuple):
    time: float  # its middle [s]
    speed: float  # of the motor, standard deviation [rad/s]
    match: FloatArray  # correlation at lags up to `max_searched_delay` either way


def _windows(trial: Trial) -> list[_Window]:
    """Return the windows in which the motor moves, with their speed correlation."""
    motor = velocity(trial.motor_angle, trial.step, trial.segments)
    joint = velocity(trial.joint_angle, trial.step, trial.segments)
    usual = float(np.nanstd(motor))
    length = max(trial.duration / 40, 2.0)
    reach = round(Limit.max_searched_delay / trial.step)
    windows = []
    for part in trial.segments:
        count = max(1, round((part.stop - part.start) * trial.step / length))
        for rows in np.array_split(np.arange(part.start, part.stop), count):
            one, other = motor[rows], joint[rows]
            one, other = one - one.mean(), other - other.mean()
            speed = float(np.std(one))
            scale = math.sqrt(float((one @ one) * (other @ other)))
            if len(rows) <= 2 * reach or speed < 0.2 * usual or not scale > 0.0:
                continue
            match = correlation(other, one, reach) / scale
            sign = 1.0 if match.max() >= -match.min() else -1.0
            windows.append(_Window(trial.time[rows].mean(), speed, sign * match))
    return windows


def correlation(late: FloatArray, early: FloatArray, reach: int) -> FloatArray:
    """Return the cross-correlation at delays -reach to reach [samples] of `late`."""
    size = 1 << (2 * early.size).bit_length()
    product = np.fft.rfft(late, size) * np.conj(np.fft.rfft(early, size))
    found: FloatArray = np.fft.irfft(product, size)
    return np.concatenate([found[-reach:], found[: reach + 1]])


def _delay_and_drift(
    windows: list[_Window], times: FloatArray, step: float
) -> tuple[float, float]:
    """Return the joint's delay behind the motor [s] and its drift [s/s], of windows."""
    matches = np.array([window.match for window in windows])
    width, penalty = matches.shape[1], 0.01
    reach = width // 2
    far = np.abs(np.arange(width) - reach) / max(reach, 1)
    row = np.arange(len(windows))[:, None]
    best, found = -math.inf, (0.0, 0.0)
    span, most = float(np.ptp(times)), 0.0
    if span > 0.0:
        most = min(Limit.max_drift, 2.0 * Limit.max_searched_delay / span)
    ways = max(1, int(most * span / Limit.drift_resolution))
    for drift in np.linspace(-most, most, 2 * ways + 1):
        shift = np.round(drift * times / step).astype(int)[:, None]
        lags = np.arange(width)[None, :] + shift
        inside = (lags >= 0) & (lags < width)
        values = np.where(inside, matches[row, np.clip(lags, 0, width - 1)], 0.0)
        # The peak nearest to no delay and no drift wins, unless another is better.
        total = values.mean(axis=0) - penalty * far
        k = int(np.argmax(total))
        value = float(total[k]) - penalty * abs(drift) / max(most, 1e-300)
        if value > best:
            best, found = value, ((k - reach) * step, float(drift))
    return found


def _nearest_peak(match: FloatArray, expected: float, step: float) -> float | None:
    """Return the lag [s] of the correlation peak nearest to `expected`, if close."""
    peaks = np.flatnonzero((match[1:-1] >= match[:-2]) & (match[1:-1] >= match[2:])) + 1
    peaks = peaks[match[peaks] > Limit.timing_min_correlation]
    if not len(peaks):
        return None
    lags = (peaks - len(match) // 2) * step
    if not np.min(np.abs(lags - expected)) < 0.1:  # [s]
        return None
    k = int(peaks[np.argmin(np.abs(lags - expected))])
    left, middle, right = match[k - 1 : k + 2]
    bend = left - 2.0 * middle + right
    offset = 0.5 * float((left - right) / bend) if bend < 0.0 else 0.0
    return (k - len(match) // 2 + offset) * step


def check_alignment(trial: Trial, alone: bool = False) -> Findings:
    """Return a finding if the joint comes early or late, or its clock drifts.

    A delay too long to be lost motion is an error, but only a warning if `alone`: the
    one cable may be slack.
    """
    a = measure_alignment(trial)
    grown = a.drift * (trial.time[-1] - trial.time[0])
    motor, joint = (trial.labels.get(name, name) for name in (MOTOR_ANGLE, JOINT_ANGLE))
    # Six standard deviations, and a drift that improves the fit by 0.2 %
    certain = abs(a.drift) > 6.0 * a.doubt and a.drift_gain > 2e-3
    finding = error
    late = f"{1e3 * abs(a.delay):.3g} ms {'after' if a.delay > 0.0 else 'before'}"
    if certain and abs(grown) > max(Limit.relevant_drift, 5.0 * trial.step):
        message = (
            f"the delay of {joint} after {motor} changes by {1e3 * grown:.3g} ms "
            f"within the trial ({1e6 * a.drift:.0f} ppm), so they run on two clocks; "
            "record on one, or declare the clock of each."
        )
    elif abs(a.delay) > Limit.max_plausible_delay and a.gain > 0.1 and not alone:
        message = (
            f"{joint} comes {late} {motor}; declare its delay ([columns."
            f"{JOINT_ANGLE}] delay = {a.delay:.2f}), or record on one clock."
        )
    elif abs(a.delay) > max(0.01, 2.0 * trial.step):
        finding = warning
        message = (
            f"{joint} comes {late} {motor}, by lost motion, "
            f"{'slack, ' if alone else ''}elasticity or a delay."
        )
    else:
        return []
    return [finding(f"{trial.path}: {message}", trial.name, JOINT_ANGLE)]


def check_lead(trials: Sequence[Trial], bench: Bench) -> Findings:
    """Find channels that come late, and motor and joint angles that are swapped.

    The lead is the motor angle beyond the one that keeps the cables' length. Rates are
    correlated at lags up to `MAX_DELAY` either way. As friction delays torques, too,
    swapped angles come before a torque that is not late in all trials.
    """
    hooked = [trial for trial in trials if not trial.facts.unhooked]
    if bench.others or not hooked:
        return []
    late: Findings = []
    if len(bench.cables) > 1:  # slack lets either side move by itself
        late = _late_channel(hooked, bench, JOINT_ANGLE, MOTOR_ANGLE)
    leads = [(trial, _lead_correlation(trial, bench)) for trial in hooked]
    sure = [each for each in leads if abs(each[1]) > Limit.min_lead_correlation]
    torques = _late_channel(hooked, bench, MOTOR_TORQUE)
    torques += _late_channel(hooked, bench, JOINT_TORQUE)
    # A torque that is late in all trials opposes the lead in some.
    mixed = any(lead > 0.0 for _, lead in sure)
    in_all = [found for found in torques if mixed and not found.trial]
    return late or in_all[:1] or _swapped_angles(sure) or torques[:1]


def _swapped_angles(sure: Sequence[tuple[Trial, float]]) -> Findings:
    reverse = [trial for trial, lead in sure if lead < 0.0]
    if not reverse:
        return []
    labels = _labels(reverse[0])
    others = "" if len(reverse) == len(sure) else ", but not in the other trials"
    message = (
        f"{list_words([trial.path for trial in reverse])}: the joint leads the motor "
        "the more, the more torque passes, as no cable that stretches lets it"
        f"{others}; perhaps {labels[MOTOR_ANGLE]} and {labels[JOINT_ANGLE]} are "
        "swapped."
    )
    finding = error if len(sure) > 1 else warning
    return [finding(message, _single_trial_name(reverse))]


def _late_channel(
    trials: Sequence[Trial], bench: Bench, channel: str, reference: str = ""
) -> Findings:
    able = [trial for trial in trials if channel in trial.channels]
    tried = [(trial, _fits_by_lag(trial, bench, channel, reference)) for trial in able]
    known = [(trial, fits) for trial, fits in tried if fits is not None]
    if not known:
        return []
    found, own = [], []
    if len({round(trial.step, 9) for trial, _ in known}) == 1:
        mean = np.mean([fits for _, fits in known], axis=0)
        samples, gain = _peak(mean, Limit.min_late_fit)
        lag = samples * known[0][0].step
        if gain > Limit.min_late_gain and abs(lag) > Limit.max_plausible_delay:
            found.append(("", lag))
    for trial, fits in known:
        samples, gain = _peak(fits, Limit.min_own_fit)
        lag = samples * trial.step
        if gain > Limit.min_own_gain and abs(lag) > Limit.min_own_lag:
            own.append((trial.name, lag))
    lags = [lag for _, lag in own]
    if len(own) > 0.5 * len(known) and np.ptp(lags) > Limit.max_plausible_delay:
        return []  # play and friction, whose phase is another time in every motion
    label = trials[0].labels.get(channel, channel)
    beside = trials[0].labels.get(reference, reference) or "the angles"
    paths = {trial.name: trial.path for trial, _ in known}
    every = next(iter(paths.values())) if len(paths) == 1 else "All trials"
    return [
        error(
            f"{paths.get(name, every)}: {label} comes {abs(lag):.2f} s "
            f"{'later' if lag > 0.0 else 'earlier'} than {beside}; declare its delay "
            f"([columns.{channel}] delay = {lag:.2f}), or record on one clock.",
            name,
            channel,
        )
        for name, lag in found or own
    ]


def _peak(fits: FloatArray, least: float) -> tuple[int, float]:
    """Return lag [samples] of the best fit, and gain over lag 0; 0 below `least`."""
    middle, top = fits.size // 2, int(np.argmax(fits))
    if fits[top] < least:
        return 0, 0.0
    return top - middle, float(fits[top] - fits[middle])


def _fits_by_lag(
    trial: Trial, bench: Bench, channel: str, reference: str
) -> FloatArray | None:
    """Return the goodness of fit by lag of a channel; None for a short trial.

    It is -ln(1 - R²) of a regression of rates of change. The lead is regressed on both
    torques, with no negative coefficient, as the mean tension is between those of the
    ends. With a `reference`, that channel is regressed on `channel` alone.
    """
    reach = round(MAX_DELAY / trial.step)
    parts = [part for part in trial.segments if part.stop - part.start > 2 * reach]
    fixed = trial.motor_torque if channel == JOINT_TORQUE else trial.joint_torque
    if reference:
        target, fixed = trial.channel(reference), None
    else:
        target = trial.motor_angle - bench.following(trial.joint_angle)
    along, sizes, still = np.zeros((2, 2 * reach + 1)), np.zeros(3), 0.0
    for part in parts:
        wanted = _mean_rate(target[part], trial.step)
        moved = _mean_rate(trial.channel(channel)[part], trial.step)
        other = np.zeros_like(wanted)
        if fixed is not None:
            other = _mean_rate(fixed[part], trial.step)
        along += correlation(moved, wanted, reach), correlation(moved, other, reach)
        still += float(other @ wanted)
        sizes += wanted @ wanted, moved @ moved, other @ other
    if not (sizes[0] > 0.0 and sizes[1] > 0.0):
        return None
    scale = np.sqrt(sizes[1] * np.maximum(sizes[[0, 2]], 1e-300))
    own, between = along / scale[:, None]
    beside = still / math.sqrt(max(sizes[0] * sizes[2], 1e-300))
    left = 1.0 - between**2 + Limit.collinear
    first, second = (own - beside * between) / left, (beside - own * between) / left
    alone = np.where(first > 0.0, np.maximum(own, 0.0), max(beside, 0.0)) ** 2
    both = (first > 0.0) & (second > 0.0)
    share = np.where(both, first * own + second * beside, alone)
    return -np.log(np.maximum(1.0 - share, Limit.explained))


def _mean_rate(signal: FloatArray, step: float) -> FloatArray:
    """Return the differences between means of adjacent windows of 0.05 s."""
    width = max(1, round(0.05 / step))
    mean = np.convolve(signal, np.full(width, 1.0 / width), "valid")
    return mean[width:] - mean[:-width]


def _lead_correlation(trial: Trial, bench: Bench) -> float:
    """Return the partial correlation of lead and torque, delays aside; 0 if unsure."""
    parts = [p for p in trial.segments if p.stop - p.start >= 200]
    if trial.motor_torque is None or trial.joint_torque is None or not parts:
        return 0.0
    used = np.concatenate([np.arange(p.start, p.stop) for p in parts])
    along = bench.following(trial.joint_angle)[used]
    lead = trial.motor_angle[used] - along
    torque = np.zeros(used.size)
    for shown in (trial.motor_torque[used], trial.joint_torque[used]):
        torque += shown / max(float(np.std(shown)), 1e-300)
    speed = velocity(trial.motor_angle, trial.step, trial.segments)[used]
    inside = [(used >= part.start) & (used < part.stop) for part in parts]
    usual = [speed, *(part.astype(np.float64) for part in inside)]
    both = usual, [*usual, along]
    fixed, free = (_partial_correlation(lead, torque, known) for known in both)
    return min(fixed, free, key=abs) if fixed * free > 0.0 else 0.0


def _partial_correlation(
    one: FloatArray, other: FloatArray, known: Sequence[FloatArray]
) -> float:
    scaled = [k / max(float(norm(k)), 1e-300) for k in known]
    axes, _ = np.linalg.qr(np.column_stack(scaled))
    one, other = (signal - axes @ (axes.T @ signal) for signal in (one, other))
    size = float(norm(one) * norm(other))
    return float(one @ other) / size if size > 0.0 else 0.0
