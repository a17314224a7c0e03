"""Checks of clocks and delays of channels.

The speeds of motor and joint are correlated in windows. Lost motion makes the joint
late by a time that shrinks with speed; a delay is the same in every window; a clock of
its own makes the delay grow with time. The three are fitted together, so that a motion
that grows faster is not taken for a clock that drifts.

A cable under tension stretches: the motor turns further than the joint, and more the
more it pulls, whatever its friction. Angles that show the opposite are those of the
other side: if both pulleys are equal nothing else shows it. A torque that follows the
lead after a time is late by that time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._channels import (
    JOINT_ANGLE,
    JOINT_TORQUE,
    MOTOR_ANGLE,
    MOTOR_TORQUE,
)
from cc_mujoco.datasets._data_findings import DataFinding, error, warning
from cc_mujoco.datasets._dataset_file import MAX_DELAY
from cc_mujoco.datasets._smoothing import velocity
from cc_mujoco.datasets._trials import Trial
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words

_DISTANCE_PENALTY = 0.01


class Alignment(NamedTuple):
    """Timing of the joint's readings against the motor's.

    Attributes:
        delay: delay of the joint [s], NaN if it cannot be seen.
        drift: change of the delay per time [s/s], 0 if none can be seen.
        doubt: standard deviation of the drift; infinite if there are too few windows.
        gain: rise of the correlation of the speeds when the delay is undone.
        drift_gain: further rise when the drift is undone as well.
    """

    delay: float
    drift: float
    doubt: float
    gain: float
    drift_gain: float


def measure_alignment(trial: Trial) -> Alignment:
    """Return the delay between the two sides, and its drift."""
    windows = _windows(trial)
    if not windows:
        return Alignment(math.nan, 0.0, math.inf, 0.0, 0.0)
    times = np.array([window.time for window in windows])
    times -= times.mean()
    delay, drift = _delay_and_drift(windows, times, trial.step)
    found = []
    for window, time in zip(windows, times, strict=True):
        lag = _nearest_peak(window.match, delay + drift * time, trial.step)
        if lag is not None:
            found.append((time, lag, 1.0 / window.speed, window.match))
    if len(found) < max(2, 0.5 * len(windows)):
        return Alignment(math.nan, 0.0, math.inf, 0.0, 0.0)
    now, lags, slow = np.array([entry[:3] for entry in found]).T
    middle = float(np.median(lags))
    matches = np.array([match for *_, match in found])
    none, there = matches.shape[1] // 2, round(middle / trial.step)
    gain = float(np.median(matches[:, none + there] - matches[:, none]))
    if len(found) < 6 or np.ptp(now) == 0.0:
        return Alignment(middle, 0.0, math.inf, gain, 0.0)
    basis = np.column_stack([now - now.mean(), np.ones_like(now), slow])
    scale = np.abs(basis).max(axis=0)
    inverse = np.linalg.pinv((basis / scale).T @ (basis / scale))
    slopes = inverse @ (basis / scale).T @ lags
    rest = lags - basis / scale @ slopes
    spread = float(rest @ rest) / max(1, len(lags) - 3)
    doubt = math.sqrt(spread * inverse[0, 0]) / scale[0]
    drift = float(slopes[0] / scale[0])
    row = np.arange(len(found))
    moved = np.round((middle + drift * (now - np.median(now))) / trial.step)
    moved = np.clip(none + moved.astype(int), 0, matches.shape[1] - 1)
    rise = matches[row, moved] - matches[row, none + there]
    return Alignment(middle, drift, doubt, gain, float(np.mean(rise)))


class _Window(NamedTuple):
    """Correlation of the speeds in a stretch of time.

    Attributes:
        time: its middle [s].
        speed: of the motor, standard deviation [rad/s].
        match: correlation at lags from -REACH to REACH.
    """

    time: float
    speed: float
    match: FloatArray


def _windows(trial: Trial) -> list[_Window]:
    """Return the stretches in which the motor moves."""
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
    """Return the cross-correlation for lags of the first signal, -reach to reach."""
    size = 1 << (2 * early.size).bit_length()
    product = np.fft.rfft(late, size) * np.conj(np.fft.rfft(early, size))
    found: FloatArray = np.fft.irfft(product, size)
    return np.concatenate([found[-reach:], found[: reach + 1]])


def _delay_and_drift(
    windows: list[_Window], times: FloatArray, step: float
) -> tuple[float, float]:
    """Return the delay and drift at which all windows together correlate best.

    A single window of a periodic motion has many peaks; together they have one.
    """
    matches = np.array([window.match for window in windows])
    width = matches.shape[1]
    reach = width // 2
    far = np.abs(np.arange(width) - reach) / max(reach, 1)
    row = np.arange(len(windows))[:, None]
    best, found = -math.inf, (0.0, 0.0)
    span = float(np.ptp(times))
    most = (
        min(Limit.max_drift, 2.0 * Limit.max_searched_delay / span)
        if span > 0.0
        else 0.0
    )
    ways = max(1, int(most * span / Limit.drift_resolution))
    for drift in np.linspace(-most, most, 2 * ways + 1):
        shift = np.round(drift * times / step).astype(int)[:, None]
        lags = np.arange(width)[None, :] + shift
        inside = (lags >= 0) & (lags < width)
        values = np.where(inside, matches[row, np.clip(lags, 0, width - 1)], 0.0)
        # The peak nearest to no delay and no drift wins, unless another is better.
        total = values.mean(axis=0) - _DISTANCE_PENALTY * far
        k = int(np.argmax(total))
        value = float(total[k]) - _DISTANCE_PENALTY * abs(drift) / max(most, 1e-300)
        if value > best:
            best, found = value, ((k - reach) * step, float(drift))
    return found


def _nearest_peak(match: FloatArray, expected: float, step: float) -> float | None:
    """Return the lag of the peak nearest to the expected lag [s], or None."""
    peaks = np.flatnonzero((match[1:-1] >= match[:-2]) & (match[1:-1] >= match[2:])) + 1
    peaks = peaks[match[peaks] > Limit.timing_min_correlation]
    if not len(peaks):
        return None
    lags = (peaks - len(match) // 2) * step
    if not np.min(np.abs(lags - expected)) < 0.1:
        return None
    k = int(peaks[np.argmin(np.abs(lags - expected))])
    left, middle, right = match[k - 1 : k + 2]
    bend = left - 2.0 * middle + right
    offset = 0.5 * float((left - right) / bend) if bend < 0.0 else 0.0
    return (k - len(match) // 2 + offset) * step


def check_alignment(trial: Trial, alone: bool = False) -> list[DataFinding]:
    """Find clocks that drift relative to each other, and implausible delays.

    Where one cable joins the sides `alone`, slack lets either move by itself.
    """
    a = measure_alignment(trial)
    grown = a.drift * (trial.time[-1] - trial.time[0])
    motor, joint = (trial.labels.get(name, name) for name in (MOTOR_ANGLE, JOINT_ANGLE))
    certain = abs(a.drift) > 6.0 * a.doubt and a.drift_gain > (2e-3)
    if certain and abs(grown) > max(Limit.relevant_drift, 5.0 * trial.step):
        message = (
            f"{trial.path}: the delay of {joint} after {motor} changes by "
            f"{1e3 * grown:.3g} ms within the trial ({1e6 * a.drift:.0f} ppm), so "
            "they run on two clocks; record on one, or declare the clock of each."
        )
        return [error(message, trial.name, JOINT_ANGLE)]
    if abs(a.delay) > Limit.max_plausible_delay and a.gain > 0.1 and not alone:
        message = (
            f"{trial.path}: {joint} comes {_delay_text(a.delay)} {motor}; declare its "
            f"delay ([columns.{JOINT_ANGLE}] delay = {a.delay:.2f}), or record on one "
            "clock."
        )
        return [error(message, trial.name, JOINT_ANGLE)]
    if abs(a.delay) > max(0.01, 2.0 * trial.step):
        message = (
            f"{trial.path}: {joint} comes {_delay_text(a.delay)} {motor}, by lost "
            f"motion, {'slack, ' if alone else ''}elasticity or a delay."
        )
        return [warning(message, trial.name, JOINT_ANGLE)]
    return []


def _delay_text(delay: float) -> str:
    return f"{1e3 * abs(delay):.3g} ms {'after' if delay > 0.0 else 'before'}"


def check_lead(trials: Sequence[Trial], bench: Bench) -> list[DataFinding]:
    """Find channels that come late, and angles that belong to the other side.

    The speeds of both angles, and the rates of each torque and of the lead, are
    correlated over `MAX_DELAY` either way. Friction delays torques as well, by a time
    that differs between motions, so only a delay that all trials share counts. Where
    other joints move the cables nothing is checked.
    """
    hooked = [trial for trial in trials if not trial.facts.unhooked]
    if bench.others or not hooked:
        return []
    late: list[DataFinding] = []
    if len(bench.cables) > 1:  # slack lets either side move by itself
        late = _late_channel(hooked, bench, JOINT_ANGLE, MOTOR_ANGLE)
    leads = [(trial, _lead_correlation(trial, bench)) for trial in hooked]
    sure = [each for each in leads if abs(each[1]) > Limit.min_lead_correlation]
    torques = [
        found
        for channel in (MOTOR_TORQUE, JOINT_TORQUE)
        for found in _late_channel(hooked, bench, channel)
    ]
    # A torque that is late in all trials opposes the lead in some.
    mixed = any(lead > 0.0 for _, lead in sure)
    in_all = [found for found in torques if mixed and not found.trial]
    return late or in_all[:1] or _swapped_angles(sure) or torques[:1]


def _swapped_angles(sure: Sequence[tuple[Trial, float]]) -> list[DataFinding]:
    """Find trials in which the joint leads the motor, by significant correlations."""
    reverse = [trial for trial, lead in sure if lead < 0.0]
    if not reverse:
        return []
    names = [reverse[0].labels.get(name, name) for name in (MOTOR_ANGLE, JOINT_ANGLE)]
    others = "" if len(reverse) == len(sure) else ", but not in the other trials"
    message = (
        f"{list_words([trial.path for trial in reverse])}: the joint leads the motor "
        "the more, the more torque passes, as no cable that stretches lets it"
        f"{others}; perhaps {names[0]} and {names[1]} are swapped."
    )
    certain = len(sure) > 1
    one = reverse[0].name if len(reverse) == 1 else ""
    return [(error if certain else warning)(message, one)]


def _late_channel(
    trials: Sequence[Trial], bench: Bench, channel: str, reference: str = ""
) -> list[DataFinding]:
    """Return an error if a channel lags its reference, by default the lead."""
    known = [
        (trial, fits)
        for trial in trials
        if channel in trial.channels
        for fits in [_fits_by_lag(trial, bench, channel, reference)]
        if fits is not None
    ]
    if not known:
        return []
    steps = {round(trial.step, 9) for trial, _ in known}
    found = []
    if len(steps) == 1:
        mean = np.mean([fits for _, fits in known], axis=0)
        samples, gain = _peak(mean, Limit.min_late_fit)
        lag = samples * known[0][0].step
        if gain > Limit.min_late_gain and abs(lag) > Limit.max_plausible_delay:
            found.append(("", lag))
    own = []
    for trial, fits in known:
        samples, gain = _peak(fits, Limit.min_own_fit)
        if gain > Limit.min_own_gain and abs(samples * trial.step) > Limit.min_own_lag:
            own.append((trial.name, samples * trial.step))
    lags = [lag for _, lag in own]
    if len(own) > 0.5 * len(known) and np.ptp(lags) > Limit.max_plausible_delay:
        return []  # play and friction, whose phase is another time in every motion
    found = found or own
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
        for name, lag in found
    ]


def _peak(fits: FloatArray, least: float) -> tuple[int, float]:
    """Return the lag of the best fit [samples], and how much better it is than 0.

    Both are 0 where no lag makes a fit of at `least` this.
    """
    middle, top = fits.size // 2, int(np.argmax(fits))
    if fits[top] < least:
        return 0, 0.0
    return top - middle, float(fits[top] - fits[middle])


def _fits_by_lag(
    trial: Trial, bench: Bench, channel: str, reference: str
) -> FloatArray | None:
    """Return the fit of a channel by lag, None where a trial is too short.

    The fit is -ln(1 - R²) of a regression of the reference: the lead on both torques,
    as the mean tension is between those at the ends, or one angle on the other. Rates
    are compared, and no torque may enter with a negative sign.
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
    share = np.where(
        (first > 0.0) & (second > 0.0), first * own + second * beside, alone
    )
    found: FloatArray = -np.log(np.maximum(1.0 - share, Limit.explained))
    return found


def _mean_rate(signal: FloatArray, step: float) -> FloatArray:
    """Return the change of a signal between means of adjacent windows."""
    width = max(1, round(Limit.rate_window / step))
    mean = np.convolve(signal, np.full(width, 1.0 / width), "valid")
    found: FloatArray = mean[width:] - mean[:-width]
    return found


def _lead_correlation(trial: Trial, bench: Bench) -> float:
    """Return the correlation of motor lead and transmitted torque, 0 if unknown.

    Different clocks and offsets make a lead as well, and are taken out. A wrong ratio
    may, too, so only a correlation with and without it counts.
    """
    if trial.motor_torque is None or trial.joint_torque is None:
        return 0.0
    parts = [p for p in trial.segments if p.stop - p.start >= 200]
    if not parts:
        return 0.0
    used = np.concatenate([np.arange(p.start, p.stop) for p in parts])
    along = bench.following(trial.joint_angle)[used]
    lead = trial.motor_angle[used] - along
    torque = np.zeros(used.size)
    for shown in (trial.motor_torque[used], trial.joint_torque[used]):
        torque += shown / max(float(np.std(shown)), 1e-300)
    speed = velocity(trial.motor_angle, trial.step, trial.segments)[used]
    usual = [speed] + [
        ((used >= part.start) & (used < part.stop)).astype(np.float64) for part in parts
    ]
    fixed, free = (
        _partial_correlation(lead, torque, usual),
        _partial_correlation(lead, torque, [*usual, along]),
    )
    return min(fixed, free, key=abs) if fixed * free > 0.0 else 0.0


def _partial_correlation(
    one: FloatArray, other: FloatArray, known: Sequence[FloatArray]
) -> float:
    axes, _ = np.linalg.qr(np.column_stack([k / max(_norm(k), 1e-300) for k in known]))
    one, other = (signal - axes @ (axes.T @ signal) for signal in (one, other))
    size = _norm(one) * _norm(other)
    return float(one @ other) / size if size > 0.0 else 0.0


def _norm(signal: FloatArray) -> float:
    return math.sqrt(float(signal @ signal))
