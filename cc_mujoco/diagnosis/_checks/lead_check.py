"""Checks by the lead of the motor: a cable that pulls is longer.

The motor turns further than the joint by what the cable stretches, and more the more
it pulls, whatever its friction. Angles that show the opposite are those of the other
side: if both pulleys are equal nothing else shows it. A torque that follows the lead
after a time is late by that time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

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
from cc_mujoco.diagnosis._checks.alignment import MAX_PLAUSIBLE_DELAY, correlation
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words

_MIN_CORRELATION = 0.6
"""Correlation of lead and torque from which on it is no accident."""
_MIN_SAMPLES = 200
_RATE_WINDOW = 0.05
"""Time over which rates are averaged, so that noise of the lead is not all [s]."""
_MIN_LATE_GAIN = 0.1
"""Rise of ln(1 / (1 - R²)) of all trials by a delay that makes it certain."""
_MIN_OWN_GAIN, _MIN_OWN_LAG = 0.7, 0.3
"""Rise and delay [s] of a single trial: friction makes a slow one late as well."""
_COLLINEAR, _EXPLAINED = 1e-3, 0.02
"""Share of a torque that the other need not determine; share that is not explained."""


def check_lead(trials: Sequence[Trial], bench: Bench) -> list[DataFinding]:
    """Find channels that come late, and angles that belong to the other side.

    The speeds of both angles, and the rates of each torque and of the lead, are
    correlated over `MAX_DELAY` either way. Friction delays torques as well, by a time
    that differs between motions: what all trials share counts.

    Args:
        trials: of one rig.
        bench: of its scene; where other joints move the cables nothing is checked.
    """
    hooked = [trial for trial in trials if not trial.facts.unhooked]
    if bench.others or not hooked:
        return []
    late: list[DataFinding] = []
    if len(bench.cables) > 1:  # slack lets either side move by itself
        late = _late_channel(hooked, bench, JOINT_ANGLE, MOTOR_ANGLE)
    leads = [(trial, _lead_correlation(trial, bench)) for trial in hooked]
    sure = [each for each in leads if abs(each[1]) > _MIN_CORRELATION]
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
    """Find trials in which the joint leads the motor, by correlations that are sure."""
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
        samples, gain = _peak(np.mean([fits for _, fits in known], axis=0))
        lag = samples * known[0][0].step
        if gain > _MIN_LATE_GAIN and abs(lag) > MAX_PLAUSIBLE_DELAY:
            found.append(("", lag))
    for trial, fits in known if not found else ():
        samples, gain = _peak(fits)
        lag = samples * trial.step
        if gain > _MIN_OWN_GAIN and abs(lag) > _MIN_OWN_LAG:
            found.append((trial.name, lag))
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


def _peak(fits: FloatArray) -> tuple[int, float]:
    """Return the lag of the best fit [samples], and how much better it is than 0."""
    middle, top = fits.size // 2, int(np.argmax(fits))
    return top - middle, float(fits[top] - fits[middle])


def _fits_by_lag(
    trial: Trial, bench: Bench, channel: str, reference: str
) -> FloatArray | None:
    """Return how well a channel fits at lags of it, None where a trial is too short.

    That is -ln(1 - R²) of a regression of the reference: the lead on both torques, as
    the mean tension is between those at the ends, or one angle on the other. Rates are
    compared, and no torque may enter with a negative sign.
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
    left = 1.0 - between**2 + _COLLINEAR
    first, second = (own - beside * between) / left, (beside - own * between) / left
    alone = np.where(first > 0.0, np.maximum(own, 0.0), max(beside, 0.0)) ** 2
    share = np.where(
        (first > 0.0) & (second > 0.0), first * own + second * beside, alone
    )
    found: FloatArray = -np.log(np.maximum(1.0 - share, _EXPLAINED))
    return found


def _mean_rate(signal: FloatArray, step: float) -> FloatArray:
    """Return the change of a signal between means of adjacent windows."""
    width = max(1, round(_RATE_WINDOW / step))
    mean = np.convolve(signal, np.full(width, 1.0 / width), "valid")
    found: FloatArray = mean[width:] - mean[:-width]
    return found


def _lead_correlation(trial: Trial, bench: Bench) -> float:
    """Return the correlation of motor lead and transmitted torque, 0 if unknown.

    Clocks and offsets that differ make a lead as well, and are taken out. A wrong ratio
    may, too: what counts is what is there with and without it.
    """
    if trial.motor_torque is None or trial.joint_torque is None:
        return 0.0
    parts = [p for p in trial.segments if p.stop - p.start >= _MIN_SAMPLES]
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
    """Return the partial correlation of two signals given others."""
    axes, _ = np.linalg.qr(np.column_stack([k / max(_norm(k), 1e-300) for k in known]))
    one, other = (signal - axes @ (axes.T @ signal) for signal in (one, other))
    size = _norm(one) * _norm(other)
    return float(one @ other) / size if size > 0.0 else 0.0


def _norm(signal: FloatArray) -> float:
    return math.sqrt(float(signal @ signal))
