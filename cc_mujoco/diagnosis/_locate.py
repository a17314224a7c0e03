"""Location of the error: the torque, angle and trials in which it lies.

The first sentence, which always exists, names the torque in error and the structure
that explains most of it; the others give each structure by itself, with its test
statistic. `concepts.md` has the tests.

The squared error that a sine of an angle explains, over that of the adjacent orders
(periods per turn), is exponentially distributed where nothing is periodic (Fisher,
Proc. R. Soc. A 125, 1929): a reversal raises all orders equally, a ripple raises one.
The share that an axis of a map explains is that of a mean per bin, found on one half of
the stretches and tested on the other; chance is the share with the error shifted in
time against the axis, which keeps the autocorrelation of both.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from cc_mujoco.diagnosis._fit import trials
from cc_mujoco.diagnosis._fit.problem import BOOTSTRAP_BLOCK, Problem
from cc_mujoco.diagnosis._fit.trials import TrialDifferences
from cc_mujoco.diagnosis._phrases import (
    channel_name,
    format_number,
    format_share,
    format_signed,
)
from cc_mujoco.diagnosis._rig.records import Arrays
from cc_mujoco.diagnosis._search.candidates import signature_cosine
from cc_mujoco.diagnosis._search.search import Found
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import (
    MODELS,
    Diagnosis,
    Evidence,
    Isolability,
    Map,
    Model,
    TrialTrace,
    Where,
)
from cc_mujoco.diagnosis.effects._drive_effects import acceleration
from cc_mujoco.estimation._least_squares import in_threads
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words


class Samples(NamedTuple):
    """Error of one channel in all records, with motion and torque, by sample."""

    error: FloatArray  # measured minus simulated [N m]
    weight: FloatArray  # inverse square of the noise floor [1/(N m)^2]
    angles: Mapping[str, FloatArray]  # by name, "motor angle" first [rad]
    torque: FloatArray  # simulated, of the same channel [N m]
    speed: FloatArray  # of the motor [rad/s]
    block: NDArray[np.intp]  # stretch of about a second; these are independent
    band: float  # highest frequency that the errors contain [Hz]


class PeriodicError(NamedTuple):
    angle: str  # in which it is periodic
    order: float  # periods per turn
    order_error: float  # standard error of the order
    amplitude: float  # in N m, or in N m per N m of torque where `by_torque`
    # Whether the amplitude is proportional to the torque; None if not determined
    by_torque: bool | None
    share: float  # of the squared error that it explains on samples not fitted to
    statistic: float  # error that it explains, over that of the adjacent orders
    threshold: float  # statistic that chance reaches with `Limit.false_alarm_rate`


class _Candidate(NamedTuple):
    angle: str
    by_torque: bool
    order: float
    left: FloatArray  # squared error by block, of samples it was not fitted to
    share: float
    statistic: float = 0.0
    background: float = 0.0


def strongest_line(samples: Samples) -> PeriodicError | None:
    """Return the periodic error in an angle that explains most; None if by chance."""
    if samples.error.size < 100 or not np.any(samples.error):
        return None
    fit = _Prepared(samples)
    orders = {name: fit.orders(angle) for name, angle in samples.angles.items()}
    families = [(n, by) for n in orders for by in (False, True) if orders[n].size]
    if not families:
        return None
    tried = sum(orders[name].size for name, _ in families)
    threshold = math.log(tried / Limit.false_alarm_rate)
    peaks = in_threads(lambda own: fit.peak(*own, orders[own[0]], threshold), families)
    best = max(filter(None, peaks), key=lambda each: each.share, default=None)
    if best is None or best.share < Limit.min_error_share:
        return None
    other = fit.at(best.angle, not best.by_torque, best.order)
    difference = other.left - best.left
    scatter = np.std(difference) * math.sqrt(difference.size)
    sure = difference.sum() > Limit.decision_sigmas * scatter
    torque = best.by_torque if sure else None
    return PeriodicError(
        *(best.angle, best.order, *fit.details(best), torque),
        *(best.share, best.statistic, threshold),
    )


class _Prepared:
    """Weighted errors of a channel without their smooth dependence on the motion."""

    def __init__(self, samples: Samples) -> None:
        self._samples = samples
        self._root = root = np.sqrt(samples.weight)
        plain = samples.error * root
        middle = float(np.median(np.abs(plain)))
        usual = Limit.clip_sigmas * middle / Limit.normal_median
        if usual > 0.0:
            plain = np.clip(plain, -usual, usual)
        parts = [_smooth_functions(samples, angle) for angle in samples.angles.values()]
        smooth = np.concatenate(parts, axis=1)
        # Collinear columns (both angles of a stiff cable) are dropped.
        left, sizes, _ = np.linalg.svd(smooth * root[:, None], full_matrices=False)
        self._basis = left[:, sizes > 1e-8 * sizes[0]]
        self._error = self._rough(plain)
        self._total = float(plain @ plain)
        self._half = samples.block % 2 == 0

    def _rough(self, columns: FloatArray) -> FloatArray:
        return columns - self._basis @ (self._basis.T @ columns)

    def orders(self, angle: FloatArray) -> FloatArray:
        """Return the orders to test (orders,), in periods per turn; () if too few."""
        span = float(np.ptp(angle))
        if span == 0.0:
            return np.zeros(0)
        speed = np.abs(self._samples.speed)
        moving = speed[speed > 0.05 * speed.max()]  # rests and turns left out
        fastest = math.tau * self._samples.band / max(float(np.median(moving)), 1e-9)
        step = math.tau / span / Limit.order_oversampling
        first, last = 0.5 * math.tau / span, min(Limit.max_order, fastest)
        orders: FloatArray = np.arange(first, last, step)
        least = 2 * Limit.order_oversampling * (Limit.min_background_orders + 1)
        return orders if orders.size >= least else np.zeros(0)

    def peak(
        self, name: str, by_torque: bool, orders: FloatArray, threshold: float
    ) -> _Candidate | None:
        """Return the most significant order of an angle; None below `threshold`."""
        angle = self._samples.angles[name]
        taken = self._spectrum(angle, by_torque, orders, self._error)
        background = np.maximum(_background(taken), 1e-300)
        background[orders < Limit.min_periods * math.tau / np.ptp(angle)] = np.inf
        place = int(np.argmax(taken / background))
        step = orders[1] - orders[0]
        finer = orders[place] + step * np.linspace(-1.0, 1.0, 41)
        near = self._spectrum(angle, by_torque, finer, self._error)
        best = int(np.argmax(near))
        is_weak = near[best] < Limit.min_error_share * self._total
        if is_weak or not np.isfinite(background[place]):
            return None
        # A short motion smears a period, so adjacent orders are judged without it.
        order = float(finer[best])
        pair = self._pair(angle, by_torque, order)
        left = self._error - pair @ np.linalg.lstsq(pair, self._error)[0]
        beside = self._spectrum(angle, by_torque, orders, left)
        level = max(float(_background(beside)[place]), 1e-300)
        if near[best] < threshold * level:
            return None
        found, statistic = self.at(name, by_torque, order), float(near[best]) / level
        return found._replace(statistic=statistic, background=level)

    def at(self, name: str, by_torque: bool, order: float) -> _Candidate:
        pair = self._pair(self._samples.angles[name], by_torque, order)
        left = np.empty(self._error.size)
        for mask in (self._half, ~self._half):
            size = np.linalg.lstsq(pair[mask], self._error[mask])[0]
            left[~mask] = self._error[~mask] - pair[~mask] @ size
        squares = np.bincount(self._samples.block, left**2).astype(np.float64)
        gain = float(self._error @ self._error - squares.sum())
        share = gain / max(self._total, 1e-300)
        return _Candidate(name, by_torque, order, squares, share)

    def details(self, found: _Candidate) -> tuple[float, float]:
        """Return the standard error of a candidate's order, and its amplitude."""
        angle = self._samples.angles[found.angle]
        pair = self._pair(angle, found.by_torque, found.order)
        size = np.linalg.lstsq(pair, self._error)[0]
        turned = np.stack([pair[:, 1], -pair[:, 0]], axis=1) @ size
        slope = -(angle - np.mean(angle)) * turned
        slope = slope - pair @ np.linalg.lstsq(pair, slope)[0]
        # A pair of coefficients explains twice the variance of one by chance.
        spread = math.sqrt(0.5 * found.background / max(float(slope @ slope), 1e-300))
        return spread, float(np.linalg.norm(size))

    def _waves(
        self, angle: FloatArray, by_torque: bool, orders: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return weighted cosines and sines (samples, orders), times torque or not."""
        size = (self._root * (self._samples.torque if by_torque else 1.0))[:, None]
        phase = np.outer(angle, orders)
        return np.cos(phase) * size, np.sin(phase) * size

    def _pair(self, angle: FloatArray, by_torque: bool, order: float) -> FloatArray:
        waves = self._waves(angle, by_torque, np.array([order]))
        return self._rough(np.concatenate(waves, axis=1))

    def _spectrum(
        self, angle: FloatArray, by_torque: bool, orders: FloatArray, error: FloatArray
    ) -> FloatArray:
        """Return the squared error that a sine of each order explains (orders,)."""
        taken, chunk = [], 64
        for first in range(0, orders.size, chunk):
            waves = self._waves(angle, by_torque, orders[first : first + chunk])
            one, two = map(self._rough, waves)
            aa, bb = (one**2).sum(axis=0), (two**2).sum(axis=0)
            ab = (one * two).sum(axis=0)
            a, b = one.T @ error, two.T @ error
            scale = np.maximum(aa * bb - ab**2, 1e-12 * aa * bb + 1e-300)
            taken.append((bb * a**2 - 2.0 * ab * a * b + aa * b**2) / scale)
        return np.concatenate(taken)


def _smooth_functions(samples: Samples, angle: FloatArray) -> FloatArray:
    """Return smooth functions of angle, speed and torque (samples, functions)."""
    span = float(np.ptp(angle)) or 1.0
    u = 2.0 * (angle - np.mean(angle)) / span
    speed = samples.speed / max(float(np.quantile(np.abs(samples.speed), 0.95)), 1e-9)
    way = np.tanh(20.0 * speed)  # a sign, smooth within 5 % of the usual top speed
    size = float(np.max(np.abs(samples.torque))) or 1.0
    torque = samples.torque / size
    one = np.ones(u.size)
    plain, turned = (one, u, u**2, u**3), (way, way * u, way * u**2)
    sized = speed, np.abs(speed), torque, np.abs(torque), torque * u
    return np.stack([*plain, *turned, *sized], axis=1)


def _background(taken: FloatArray) -> FloatArray:
    """Return the level of the spectrum beside each order (orders,), by medians.

    The larger side counts, as errors grow towards low orders; infinite for the lowest.
    """
    below = _lower_medians(taken)
    above = _lower_medians(taken[::-1])[::-1]
    larger: FloatArray = np.fmax(below, above) / math.log(2.0)
    return np.where(np.isnan(below), np.inf, larger)


def _lower_medians(taken: FloatArray) -> FloatArray:
    """Return medians over lower orders but the nearest (orders,); NaN if few."""
    counts = 1, Limit.background_orders, Limit.min_background_orders
    own, width, least = (count * Limit.order_oversampling for count in counts)
    found = np.full(taken.size, np.nan)
    for k in range(own + least, min(own + width, taken.size)):
        found[k] = np.median(taken[: k - own])
    if taken.size > own + width:
        windows = np.lib.stride_tricks.sliding_window_view(taken, width)
        found[own + width :] = np.median(windows[: taken.size - own - width], axis=1)
    return found


BINS = 14


def _speed(trace: TrialTrace) -> FloatArray:
    return np.gradient(trace.motor_angle, trace.time)


def _travel(trace: TrialTrace) -> FloatArray:
    """Return the signed motor travel since the last reversal (samples,) [rad]."""
    speed = _speed(trace)
    # Below 2 % of the top speed a motor rests, by noise to and fro.
    slow = 0.02 * float(np.max(np.abs(speed)) or 1.0)
    way = np.where(np.abs(speed) > slow, np.sign(speed), 0.0)
    out = np.zeros(way.size)
    turned, last = trace.motor_angle[0], 0.0
    for i, now in enumerate(way):
        if now != 0.0 and now != last:
            turned, last = trace.motor_angle[i], now
        out[i] = trace.motor_angle[i] - turned
    return out


_AXES: tuple[tuple[str, str, Callable[[TrialTrace], FloatArray]], ...] = (
    ("motor speed", "rad/s", _speed),
    ("absolute motor speed", "rad/s", lambda t: np.abs(_speed(t))),
    ("motor acceleration", "rad/s^2", lambda t: acceleration(t.motor_angle, t.time)),
    ("joint acceleration", "rad/s^2", lambda t: acceleration(t.joint_angle, t.time)),
    ("motor angle", "rad", lambda t: t.motor_angle),
    ("joint angle", "rad", lambda t: t.joint_angle),
    ("", "N m", lambda t: list(t.measured.values())[-1]),
    ("direction of motion", "1", lambda t: np.sign(_speed(t))),
    ("motor travel since it turned", "rad", _travel),
    ("time in the trial", "s", lambda t: t.time - t.time[0]),
)
"""Quantities along which the error may lie, with units; "" is the last torque."""


def _traces(problem: Problem, before: Arrays, after: Arrays) -> tuple[TrialTrace, ...]:
    names, found = problem.plant.instruments.channels, []
    for record, *torques in zip(problem.plant.records, before, after, strict=True):
        rows = record.measured, *torques
        seen, old, new = (dict(zip(names, each, strict=True)) for each in rows)
        motion = record.time, record.motor_angle, record.joint_angle
        counts = record.counts.astype(float)
        found.append(TrialTrace(record.trial, *motion, seen, old, new, counts))
    return tuple(found)


def error_maps(traces: Sequence[TrialTrace], seed: int = 0) -> tuple[Map, ...]:
    """Return the mean error of channels along axes, most beyond chance first."""
    random = np.random.default_rng(seed)
    last = channel_name(list(traces[0].measured)[-1])
    found = []
    for name, unit, values in _AXES:
        along = [values(trace)[trace.counts > 0.0] for trace in traces]
        found += [
            drawn
            for channel in traces[0].measured
            if (drawn := _map(traces, name or last, unit, along, channel, random))
        ]
    return tuple(sorted(found, key=lambda m: m.chance - m.share))


def _map(
    traces: Sequence[TrialTrace], axis: str, unit: str, values: Arrays, channel: str,
    random: Generator,
) -> Map | None:  # fmt: skip
    """Return the mean error of a channel by bins of an axis; None for few samples."""
    kept = [trace.counts > 0.0 for trace in traces]
    pairs = list(zip(traces, kept, strict=True))
    before, after = ([t.error(channel, m)[k] for t, k in pairs] for m in MODELS)
    whole = np.concatenate(values)
    if whole.size < 10 * BINS or np.ptp(whole) == 0.0:
        return None
    edges = np.unique(np.quantile(whole, np.linspace(0.0, 1.0, BINS + 1)))
    if edges.size < 3:
        edges = np.linspace(whole.min(), whole.max(), 4)
    bins = edges.size - 1
    place = np.clip(np.digitize(whole, edges[1:-1]), 0, bins - 1).astype(np.intp)
    # Stretches of every trial belong to either half in turn.
    half = np.concatenate([(np.arange(v.size) * 8 // v.size) % 2 for v in values])
    cell = place + bins * half
    count = np.bincount(cell, minlength=2 * bins).reshape(2, bins)
    inside = count.sum(axis=0)
    mean = np.bincount(place, weights=whole, minlength=bins) / np.maximum(inside, 1)
    centre = np.where(inside > 0, mean, 0.5 * (edges[:-1] + edges[1:]))

    def sums(error: Arrays) -> FloatArray:
        found = np.bincount(cell, np.concatenate(error), 2 * bins)
        return found.reshape(2, bins).astype(np.float64)

    square = sum(float(e @ e) for e in before)
    own, rest = sums(before), sums(after)
    shares, means = [], []
    for _ in range(30):
        # A random shift along the axis, far from none and all.
        ends = [(e.size // 4, max(3 * e.size // 4, e.size // 4 + 1)) for e in before]
        shifts = [int(random.integers(*each)) for each in ends]
        turned = zip(before, shifts, strict=True)
        moved = sums([part for e, by in turned for part in (e[-by:], e[:-by])])
        shares.append(_share(moved, count, square))
        means.append(_means(moved, count))
    band = Limit.sigmas * np.std(np.nan_to_num(np.array(means)), axis=0)
    lines = _means(own, count), _means(rest, count), band
    both = _share(own, count, square), float(np.quantile(shares, 0.95))
    share, chance = (max(each, 0.0) for each in both)
    return Map(channel, axis, unit, centre, *lines, share, chance)


def _means(sums: FloatArray, count: NDArray[np.intp]) -> FloatArray:
    whole = count.sum(axis=0).astype(float)
    whole[whole == 0.0] = np.nan
    return np.asarray(sums.sum(axis=0) / whole)


def _share(sums: FloatArray, count: NDArray[np.intp], square: float) -> float:
    """Return the share of squared error explained by the other half's bin means."""
    mean = (sums / np.maximum(count, 1))[::-1]
    left = square - 2.0 * np.sum(mean * sums) + np.sum(count * mean**2)
    return 1.0 - float(left) / max(square, 1e-300)


def describe_map(drawn: Map) -> str:
    good = np.isfinite(drawn.before)
    centre, error = drawn.centre[good], drawn.before[good]
    # Centres of bins that are symmetric about 0 miss it by rounding.
    place = np.where(np.abs(centre) < 1e-9 * np.max(np.abs(centre)), 0.0, centre)
    unit, sense = f" {drawn.unit}", ""
    if drawn.unit == "1":
        unit, sense = "", " (1 is forwards, \u22121 backwards)"
    step = float(np.ptp(centre)) / BINS
    first, last = (
        f"{format_signed(error[k])} N m at {format_number(place[k], step)}{unit}"
        for k in (np.argmin(error), np.argmax(error))
    )
    return (
        f"{format_share(drawn.share)} of the squared {channel_name(drawn.channel)} "
        f"error lies along {drawn.axis} (chance gives {format_share(drawn.chance)}): "
        f"measured minus simulated is {first} and {last}{sense}."
    )


def evidence_of(found: Found) -> Evidence:
    before, after = found.held.before, found.held.after
    signs = found.search.signatures
    table = np.array([[signature_cosine(a, b) for b in signs] for a in signs])
    ids, visible = tuple(sign.id for sign in signs), [sign.visible for sign in signs]
    table = table.reshape(len(signs), len(signs))
    isolability = Isolability(ids, table, np.array(visible))
    shown = _traces(found.problem, before, after)
    drawn = error_maps(shown, found.fitted.settings.seed)
    return Evidence(shown, drawn, isolability)


def locate_error(found: Found, judged: Diagnosis, drawn: Sequence[Map]) -> Diagnosis:
    """Return the diagnosis with places, trials and question; `drawn` are error maps."""
    fitted = found.fitted
    baseline, model = (fitted.problem, fitted.whole.x), (found.problem, found.x)
    # Where nothing explains the error, an added effect only stands in for it.
    explaining = baseline if judged.verdict == "unknown" else model
    odd = trials.find_outlier_trial(*explaining, trials.misfits(*baseline))
    question = odd.question if odd else judged.question
    if found.by_trial and odd and odd.rest > Limit.max_explained_error:
        question = ""  # no single trial contradicts the others
    differences = TrialDifferences.of(*explaining, fitted.temperatures)
    places = error_places(found, drawn, differences)
    held = found.held.before, found.held.after
    errors = trials.trial_errors(fitted.problem, *held, model)
    return replace(judged, where=places, trials=errors, question=question)


def error_places(
    result: Found, drawn: Sequence[Map], differences: TrialDifferences
) -> tuple[Where, ...]:
    """Return places of the baseline's and the model's error, the main one first."""
    problem = result.fitted.problem
    before = problem.torques(result.fitted.whole.x)
    after = result.problem.torques(result.x)
    seen = _traces(problem, before, after)
    off, left = (_noise_ratios(problem, played) for played in (before, after))
    ranked = sorted(off, key=lambda name: -off[name])
    worst = ranked[0]
    large = [name for name in off if off[name] > Limit.min_searched_error]
    samples = {name: error_samples(problem, seen, name) for name in large}
    lines = ((n, strongest_line(samples[n])) for n in ranked if n in samples)
    found = [_period_text(line, name) for name, line in lines if line is not None]
    found += _describe_constants(samples)
    if worst in samples:
        found += differences.described(worst)
    found.sort(key=lambda each: -each[1].share_of_error)
    # Maps that chance does not explain.
    real = [each for each in drawn if each.share > max(each.chance, 0.02)][:6]
    mapped = tuple(Where(m.channel, m.axis, m.share, describe_map(m)) for m in real)
    share = off[worst] ** 2 / sum(size**2 for size in off.values())
    first = Where(worst, "channel", share, _main_sentence(off, worst, found, mapped))
    remaining = [
        _period_text(line, name, " that is left with what was added")
        for name, size in left.items()
        if result.problem.effects
        and size > Limit.explained_error
        and (line := strongest_line(error_samples(problem, seen, name, "after")))
        is not None
    ]
    return (first, *(where for _, where in [*found, *remaining]), *mapped)


def _noise_ratios(problem: Problem, played: Arrays) -> dict[str, float]:
    """Return the RMS error of each channel over that of sensor noise."""
    squares = np.zeros((2, len(problem.plant.instruments.channels)))
    for record, torque, sensed, floor in zip(
        problem.plant.records, played, problem.sensed, problem.floor, strict=True
    ):
        kept = record.counts
        for row, error in enumerate((record.measured - torque, sensed)):
            squares[row] += np.sum((error / floor)[:, kept] ** 2, axis=1)
    ratios = np.sqrt(squares[0] / np.maximum(squares[1], 1e-300)).tolist()
    return dict(zip(problem.plant.instruments.channels, ratios, strict=True))


def error_samples(
    problem: Problem, seen: Sequence[TrialTrace], name: str, model: Model = "before"
) -> Samples:
    """Return the error of a channel, thinned to 2.5 samples a period of its band."""
    row = problem.plant.instruments.channels.index(name)
    records = problem.plant.records
    parts, first = [], 0
    for trace, record, floor in zip(seen, records, problem.floor, strict=True):
        thin = max(1, int(1.0 / (record.dt * Limit.samples_per_period * record.band)))
        kept = np.flatnonzero(trace.counts > 0.0)[::thin]
        if not kept.size:
            continue
        block = ((kept - kept[0]) * record.dt / BOOTSTRAP_BLOCK).astype(np.intp) + first
        first = int(block[-1]) + 1
        signals = (
            trace.error(name, model),
            1.0 / floor[row] ** 2,
            trace.motor_angle,
            trace.joint_angle,
            (trace.before if model == "before" else trace.after)[name],
            np.gradient(trace.motor_angle, record.dt),
        )
        parts.append([*(signal[kept] for signal in signals), block])
    error, weight, motor, joint, torque, speed, block = (
        np.concatenate(each) for each in zip(*parts, strict=True)
    )
    angles = {"motor angle": motor, "joint angle": joint}
    band = min(record.band for record in records)
    return Samples(error, weight, angles, torque, speed, block, band)


def _main_sentence(
    off: Mapping[str, float],
    worst: str,
    found: Sequence[tuple[str, Where]],
    mapped: Sequence[Where],
) -> str:
    others = [name for name in off if name != worst]
    over = {  # error over the noise floor, to a tenth of a floor
        name: format_number(size, 1.0 if size < 100.0 else math.nan)
        for name, size in off.items()
    }
    sized = {name: f"{channel_name(name)} {size}" for name, size in over.items()}
    sizes, beside = (list_words([sized[n] for n in names]) for names in (off, others))
    floors = f"({sizes} times the noise floor)"
    beyond = {name: max(size**2 - 1.0, 0.0) for name, size in off.items()}
    mostly = all(beyond[worst] > Limit.dominant_ratio * beyond[name] for name in others)
    channel, close = channel_name(worst), off[worst] <= Limit.layout_error
    if close:
        text = f"No torque is far off {floors}"
    elif not others:
        text = (
            f"Only the {channel} is compared; it is {over[worst]} times the noise "
            "floor off"
        )
    elif not mostly:
        text = f"The error is in both torques {floors}"
    elif all(off[name] <= Limit.explained_error for name in others):
        text = (
            f"The error is in the {channel} only ({over[worst]} times the noise floor; "
            f"{beside})"
        )
    else:
        text = f"The error is mostly in the {channel} {floors}"
    if found:
        return f"{text}: {found[0][0]}."
    if close:
        return f"{text}."
    if mapped:
        most = mapped[0]
        return (
            f"{text}: {format_share(most.share_of_error)} of the squared "
            f"{channel_name(most.channel)} error lies along {most.axis}."
        )
    return (
        f"{text}: it is not periodic in an angle, follows no constant that differs "
        "from trial to trial, and no quantity explains more of it than chance does."
    )


def _period_text(line: PeriodicError, name: str, which: str = "") -> tuple[str, Where]:
    exactly = format_number(line.order, 2.0 * line.order_error)
    whole = abs(line.order - round(line.order)) < max(2.0 * line.order_error, 0.02)
    order = str(round(line.order)) if whole else exactly
    size = "constant or proportional to the torque, which these data do not show"
    if line.by_torque is not None:
        size = f"the same at every torque ({format_number(line.amplitude)} N m)"
    if line.by_torque:
        percent = format_number(100.0 * line.amplitude)
        size = f"proportional to the torque ({percent} % of it)"
    periodic, wide = f"is periodic in the {line.angle}", "with an amplitude that is"
    text = (
        f"{format_share(line.share)} of the squared {channel_name(name)} error{which} "
        f"{periodic}, {exactly} per turn (standard error "
        f"{format_number(line.order_error)}), {wide} {size}. This "
        f"period takes {format_number(line.statistic)} times what the periods beside "
        f"it take; random errors reach {format_number(line.threshold)} in one of "
        f"{round(1 / Limit.false_alarm_rate)} data sets."
    )
    short = f"it {periodic}, {order} per turn, {wide} {size}"
    return short, Where(name, line.angle, line.share, text)


def _describe_constants(seen: Mapping[str, Samples]) -> list[tuple[str, Where]]:
    sizes, found = {}, []
    for name, each in seen.items():
        weights = np.bincount(each.block, each.weight)
        sums = np.bincount(each.block, each.weight * each.error)
        means = sums[weights > 0.0] / weights[weights > 0.0]
        mean = float(np.average(each.error, weights=each.weight))
        square = float(np.average(each.error**2, weights=each.weight))
        takes = mean**2 / max(square, 1e-300)
        if means.size < Limit.location_min_blocks or takes < Limit.min_constant_share:
            continue
        scatter = float(np.std(means, ddof=1)) / math.sqrt(means.size)
        if abs(mean) < Limit.min_constant_sigmas * scatter:
            continue
        sizes[name] = f"{channel_name(name)} {format_signed(mean)} N m"
        text = (
            f"{format_share(takes)} of the squared {channel_name(name)} error is a "
            f"constant, measured minus simulated {format_signed(mean)} N m (standard "
            f"error {format_number(scatter)})."
        )
        found.append(Where(name, "all data", takes, text))
    sized = list_words(sizes.values())
    short = f"it is nearly constant, measured minus simulated {sized}"
    return [(short, each) for each in found]
