"""Events: a change at one moment of a trial, or between two trials.

Effects hold for all trials. What happens once (a cable comes off, a clamp slips, an
encoder is zeroed, a sensor fails) is looked for first, and left out of what is judged.

An event changes one constant of the tuned scene or one sensor. To first order the error
is then a multiple of that constant's derivative that steps at one moment. Multiples
are fitted to blocks of half a second, and every interval of every trial, and every
division of the trials in two groups, is tested by Student's t on the scatter of the
blocks beside their speed, angle and torque: what follows the motion is no event. A step
counts if it takes most of the error of its part, more of the whole than any effect of
the library, and if a fit to all else misses the part by far. Trials that no single
step explains, but a fit of their own, are of another device.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.datasets._trials import Dataset
from cc_mujoco.diagnosis._fit import problem as fitting
from cc_mujoco.diagnosis._fit.problem import Masks, Problem
from cc_mujoco.diagnosis._phrases import (
    capitalise,
    channel_name,
    format_estimate,
    format_number,
    plain_name,
)
from cc_mujoco.diagnosis._rig.simulation import TORQUE_OFFSETS, change_name
from cc_mujoco.diagnosis._search.candidates import exceeds_effects
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import Event
from cc_mujoco.estimation._least_squares import Estimate, Tuned
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words

CONSTANTS = (
    *("joint_angle_offset", "pretension", "friction", "axial_stiffness"),
    *TORQUE_OFFSETS,
)
"""Parameters of the baseline that an event may change."""
_JUDGED = ("device", *CONSTANTS[: -len(TORQUE_OFFSETS)])
"""Kinds that occasions may explain; a torque's zero is bounded there, too."""
REST = "the other trials"
"""Occasion of the trials that an event does not concern."""
SIZE = "SIZE"
"""Word in place of a size that the final fit gives."""
DRIFT = "drift"
"""End of the signal of a torque's zero that moves steadily from a moment on."""
PULL = "pull"
"""Signal of a change of all torques in proportion."""


class _Track(NamedTuple):
    """Counted samples of one trial, its records one after another."""

    places: tuple[int, ...]  # of its records
    time: FloatArray  # (samples,) [s]
    error: FloatArray  # (rows, samples) measured minus simulated, over the floor
    # Change of the torques by a unit of each signal, over the floor (rows, samples)
    signals: dict[str, FloatArray]
    block: NDArray[np.intp]  # (samples,) number of the block
    conditions: FloatArray  # (blocks, 5): 1, RMS speed, angle, mean and RMS torque

    def error_at(self, problem: Problem, x: FloatArray) -> FloatArray:
        """Return the error over the floor (rows, samples) at a place."""
        errors, masks = problem.plainly(x, self.places), problem.plant.records
        pairs = zip(errors, self.places, strict=True)
        return np.concatenate([e[:, masks[k].counts] for e, k in pairs], axis=1)

    def sums(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Return the square of a signal and its product with the error (blocks,)."""
        signal, count = self.signals[name], len(self.conditions)
        pair = (signal**2).sum(axis=0), (signal * self.error).sum(axis=0)
        square, product = (np.bincount(self.block, each, count) for each in pair)
        return square.astype(np.float64), product.astype(np.float64)


Kept = Mapping[str, NDArray[np.bool_]]
"""Samples (samples,) of trials, by name."""


class _Step(NamedTuple):
    """A signal whose size differs between a part of the data and the rest."""

    name: str  # of the signal
    parts: Mapping[str, tuple[int, int]]  # first and last block by trial, last excluded


def find_events(
    problem: Problem, x: FloatArray, dataset: Dataset, any_motion: bool = False
) -> list[Event]:
    """Return the event that explains most of the error of a fitted model, or nothing.

    A gain that changes gives two events, as either side may be the wrong one. An event
    that moves the fit far is found by one to the trials before or after it. A trial of
    which nothing else has the speed or load may be an event by `any_motion` only: where
    no effect explains it, and one constant of its own all of it.
    """
    if found := _find(problem, x, dataset, any_motion):
        return found
    records = problem.plant.records
    if _ratio(problem, x, [r.counts for r in records]) <= Limit.layout_error:
        return []
    able = [r.trial for r in records if r.free.any() and not r.unhooked]
    names = list(dict.fromkeys(able))
    part = (len(names) - 1) // 2
    for kept in (names[:part], names[-part:]) if part else ():
        half = [r.free & (r.trial in kept) for r in records]
        problem, there = _fitted_alone(problem, x, half)
        if found := _find(problem, there, dataset, any_motion):
            return found
    return []


def _fitted_alone(
    problem: Problem, x: FloatArray, part: Masks
) -> tuple[Problem, FloatArray]:
    """Return a fit to a part; at the floor by the whole it would hardly count."""
    for _ in range(3):
        problem = problem.with_updated_floor(x, part)
        x = fitting.fit(problem, x, part).x
    return problem, x


def _find(
    problem: Problem, x: FloatArray, dataset: Dataset, any_motion: bool
) -> list[Event]:
    tracks = _tracks(problem, x)
    steps = [
        *_steps_within(problem, tracks),
        *_steps_between(problem, tracks, any_motion),
    ]
    each = {(step.name, *step.parts.items()): step for step in steps}
    changes = [_Change.of(problem, x, tracks, step) for step in each.values()]
    changes.sort(key=lambda change: -change.gain)
    unlike: dict[tuple[str, ...], _Change] = {}
    for found in changes[: Limit.max_tried_events]:
        single, part = found.takes_most(), tuple(found.inside)
        if not single and (part in unlike or not found.is_whole):
            continue
        there = found.rest_fit()
        if there is None:
            continue
        if not found.exceeds_effects({found.name} if single else CONSTANTS):
            continue
        if not single:
            unlike[part] = found.at(there)
        elif events := found.at(there).events(dataset):
            return events
    devices = (found.device(dataset) for found in unlike.values())
    return list(filter(None, devices))[:1]


def _ratio(problem: Problem, x: FloatArray, masks: Masks) -> float:
    """Return the RMS error of samples by Huber's loss, over that of sensor noise."""
    off = fitting.kept_samples(problem.errors(x, masks), masks)
    usual = fitting.kept_samples(problem.noise_over_floor, masks)
    return math.sqrt(float(np.mean(off**2)) / float(np.mean(usual**2)))


def _tracks(problem: Problem, x: FloatArray) -> dict[str, _Track]:
    records = problem.plant.records
    parts: dict[str, list[FloatArray]] = {}
    seen = [k for k, record in enumerate(records) if record.counts.any()]
    torques = problem.torques(x, seen)
    slopes = problem.slopes.of(problem, x, seen, torques)
    for k, torque, slope in zip(seen, torques, slopes, strict=True):
        record, floor = records[k], problem.floor[k]
        changes = dict(_signals(problem, torque, slope))
        speed = np.gradient(record.motor_angle, record.dt)
        rows = (
            record.time, *((record.measured - torque) / floor),
            *np.concatenate([change / floor for change in changes.values()]),
            speed**2, record.joint_angle, torque[-1], torque[-1] ** 2,
        )  # fmt: skip
        parts.setdefault(record.trial, []).append(np.stack(rows)[:, record.counts])
    names, count = list(changes), len(torques[0])
    tracks = {}
    for trial, own in parts.items():
        blocks: list[NDArray[np.intp]] = []
        for time in (part[0] - part[0, 0] for part in own):
            few, many = time[-1] / Limit.max_event_blocks, time[-1] / Limit.event_blocks
            length = max(min(max(Limit.event_block, few), many), records[0].dt)
            first = blocks[-1][-1] + 1 if blocks else 0
            blocks.append((time / length).astype(np.intp) + first)
        _, block = np.unique(np.concatenate(blocks), return_inverse=True)
        table = np.concatenate(own, axis=1)
        means = [np.bincount(block, row) / np.bincount(block) for row in table[-4:]]
        sizes = means[0] ** 0.5, means[1], means[2], means[3] ** 0.5
        conditions = np.stack([np.ones(means[0].size), *sizes], axis=1)
        signals = table[1 + count : -4].reshape(len(names), count, -1)
        each = dict(zip(names, signals, strict=True))
        error, places = table[1 : 1 + count], tuple(problem.plant.by_trial[trial])
        tracks[trial] = _Track(places, table[0], error, each, block, conditions)
    return tracks


def _signals(
    problem: Problem, torque: FloatArray, slope: FloatArray
) -> Iterator[tuple[str, FloatArray]]:
    """Yield the changes of a record's torques (rows, samples) [N m] by its signals."""
    for parameter, change in zip(problem.tuned, slope, strict=True):
        if parameter.name in CONSTANTS:
            yield parameter.name, change
    yield PULL, torque
    if len(torque) > 1:
        for row, name in enumerate(problem.plant.instruments.channels):
            own = np.arange(len(torque))[:, None] == row
            yield name, torque * own


def _noise(problem: Problem) -> float:
    """Return the variance by sensor noise of the multiple of a signal of square 1."""
    records = problem.plant.records
    masks = [record.counts for record in records]
    noise = fitting.kept_samples(problem.noise_over_floor, masks)
    # Neighbouring samples have passed the same filter.
    joined = max(1.0, *(0.5 / (record.band * record.dt) for record in records))
    return float(np.mean(noise**2)) * joined


def _tested(
    sizes: FloatArray, weights: FloatArray, design: FloatArray, steps: FloatArray,
    noise: float,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return the square that each step takes (m,), and the probability of as much.

    `sizes` (n,) of inverse variances `weights` (m, n) are regressed on `design` (n, k)
    and one of the `steps` (m, n). Their scatter is `noise` at least.
    """
    from scipy.special import stdtr

    table = design / np.maximum(np.max(np.abs(design), axis=0), 1e-300)
    whole = np.maximum(weights.sum(axis=1), 1e-300)
    square = np.einsum("mn,nk,nl->mkl", weights, table, table)
    square += 1e-9 * whole[:, None, None] * np.eye(table.shape[1])
    both = np.stack([steps, np.broadcast_to(sizes, steps.shape)], axis=2)
    along = np.linalg.solve(square, np.einsum("mn,nk,mnj->mkj", weights, table, both))
    step, rest = np.moveaxis(both - table @ along, 2, 0)
    size, product, left = (
        np.sum(weights * pair, axis=1) for pair in (step**2, step * rest, rest**2)
    )
    gain = product**2 / np.maximum(size, 1e-6 * whole)
    freedom = np.count_nonzero(weights, axis=1) - table.shape[1] - 1
    scatter = np.maximum((left - gain) / np.maximum(freedom, 1), noise)
    t = np.sqrt(gain / scatter)
    enough = freedom >= Limit.min_event_freedom
    return gain, np.where(enough, 2.0 * stdtr(np.maximum(freedom, 1), -t), 1.0)


def _steps_within(problem: Problem, tracks: Mapping[str, _Track]) -> Iterator[_Step]:
    """Yield the best interval of each signal in each trial, if significant."""
    noise, least = _noise(problem), Limit.min_event_blocks
    for trial, track in tracks.items():
        count = len(track.conditions)
        pairs = np.array(list(combinations(range(count + 1), 2)))
        length = pairs[:, 1] - pairs[:, 0]
        pairs = pairs[(length >= least) & (length <= count - least)]
        if not pairs.size:
            continue
        first, last = pairs[:, :1], pairs[:, 1:]
        place = np.arange(count)
        steps = ((first <= place) & (place < last)).astype(np.float64)
        # Blocks in which it may begin or end are of neither side.
        edges = (place == first) & (first > 0) | (place == last - 1) & (last < count)
        for name in track.signals:
            sizes, known = _sizes(*track.sums(name), Limit.min_event_share)
            weights = np.where(edges, 0.0, known)
            gains, chances = _tested(sizes, weights, track.conditions, steps, noise)
            chances *= len(pairs) * len(tracks) * len(track.signals)
            gains[chances > Limit.event_false_alarm_rate] = 0.0
            best = int(np.argmax(gains))
            if gains[best] > 0.0:
                start, stop = pairs[best].tolist()
                start = start if start >= least else 0  # too little to be a side
                stop = stop if count - stop >= least else count
                yield _Step(name, {trial: (start, stop)})


def _sizes(
    square: FloatArray, product: FloatArray, least: float
) -> tuple[FloatArray, FloatArray]:
    """Return multiples of a signal, and their weights; 0 where it hardly shows."""
    able = square > least * np.max(square)
    return np.where(able, product / np.maximum(square, 1e-300), 0.0), square * able


def _steps_between(
    problem: Problem, tracks: Mapping[str, _Track], any_motion: bool
) -> Iterator[_Step]:
    """Yield by signal up to two significant divisions of the trials in two groups."""
    noise, every_name = _noise(problem), list(tracks)
    for signal in dict.fromkeys(n for track in tracks.values() for n in track.signals):
        sums = [np.sum(track.sums(signal), axis=1) for track in tracks.values()]
        square, product = np.array(sums).T
        sizes, weights = _sizes(square, product, Limit.min_trial_share)
        kept = np.flatnonzero(weights)
        names = [every_name[k] for k in kept]
        sizes, weights, count = sizes[kept], weights[kept], kept.size
        if count < Limit.min_outlier_trials:
            continue
        # By order in time, and by size, of which any division may be the one
        place, order = np.arange(count), np.argsort(np.argsort(sizes))
        steps = np.array([rank >= k for rank in (place, order) for k in place[1:]])
        times = np.repeat([count - 1.0, 2.0 ** (count - 1.0)], count - 1)
        every = np.broadcast_to(weights, steps.shape)
        ones = np.ones((count, 1))
        gains, chances = _tested(sizes, every, ones, steps.astype(np.float64), noise)
        chances *= times * len(tracks[names[0]].signals)
        gains[chances > Limit.event_false_alarm_rate] = 0.0
        for k in np.argsort(-gains)[:2]:
            one = [n for n, side in zip(names, steps[k], strict=True) if side]
            smaller, larger = sorted([one, [n for n in names if n not in one]], key=len)
            alone = any_motion and len(smaller) == 1
            able = alone or _is_comparable(problem, tracks, smaller, larger)
            if gains[k] > 0.0 and able:
                whole = {name: (0, len(tracks[name].conditions)) for name in smaller}
                yield _Step(signal, whole)
                # A step may lie within a trial beside a division by time.
                late = steps[k] == steps[k][-1]
                cut = int(np.argmax(late))
                if late[cut:].all():  # the first trials and the last
                    means = [
                        np.average(sizes[m], weights=weights[m]) for m in (~late, late)
                    ]
                    first, last = (
                        every_name.index(n) for n in names[cut - 1 : cut + 1]
                    )
                    for name in every_name[first : last + 1]:
                        yield from _moment(tracks[name], name, signal, noise, *means)


def _moment(
    track: _Track, trial: str, signal: str, noise: float, old: float, new: float
) -> Iterator[_Step]:
    """Yield the step between two multiples well within a trial, if significant."""
    (square, product), count = track.sums(signal), len(track.conditions)
    worse = (new**2 - old**2) * square - 2.0 * (new - old) * product
    first = int(np.argmin(np.append(np.cumsum(worse[::-1])[::-1], 0.0)))
    sizes, weights = _sizes(square, product, Limit.min_event_share)
    step = (np.arange(count) >= first)[None].astype(np.float64)
    ones = np.ones((count, 1))
    _, (chance,) = _tested(sizes, weights[None], ones, step, noise)
    inner = Limit.min_event_blocks <= first <= count - Limit.min_event_blocks
    if inner and count * chance <= Limit.event_false_alarm_rate:
        yield _Step(signal, {trial: (first, count)})


def _is_comparable(
    problem: Problem, tracks: Mapping[str, _Track], one: Sequence[str],
    other: Sequence[str], any_motion: bool = False,
) -> bool:  # fmt: skip
    """Return whether facts and speeds, or only pretensions, of two groups overlap."""
    records = {record.trial: record for record in problem.plant.records}

    def conditions(name: str) -> FloatArray:
        record, means = records[name], tracks[name].conditions.mean(axis=0)
        tight = math.nan if record.unhooked else record.pretension or 0.0
        declared = tight, abs(record.tilt), *record.known_torques
        # An event may change the torques themselves.
        return np.array([*declared, means[1]])[: 1 if any_motion else None]

    groups = (np.array([conditions(n) for n in names]) for names in (one, other))
    each = ((np.fmin.reduce(g), np.fmax.reduce(g)) for g in groups)
    (low, high), (least, most) = each
    return not bool(np.any((low > 1.1 * most) | (least > 1.1 * high)))


class _Change(NamedTuple):
    """A step with its exact place, by samples."""

    problem: Problem
    x: FloatArray
    tracks: Mapping[str, _Track]
    name: str  # of the signal
    inside: Kept  # samples of the part
    outside: Kept  # samples that it is compared with
    reach: float  # by which either end may be off, 95 % [s]
    levels: tuple[float, float]  # multiples of the signal in the part, and otherwise
    gain: float  # squared error that two levels take in place of one

    @classmethod
    def of(
        cls, problem: Problem, x: FloatArray, tracks: Mapping[str, _Track], step: _Step
    ) -> _Change:
        reach, compared = 0.0, tracks
        inside: Kept = {n: np.ones(tracks[n].time.size, bool) for n in step.parts}
        trial, (first, last) = next(iter(step.parts.items()))
        if last - first < len(tracks[trial].conditions):
            noise = _noise(problem)
            within, reach = _locate(tracks[trial], step.name, first, last, noise)
            # The low-pass of the torques spreads a step by as much.
            reach = max(reach, *(0.5 / record.band for record in problem.plant.records))
            inside = _lasting(tracks, step.name, trial, within)
            compared = {trial: tracks[trial]} if len(inside) == 1 else tracks
        every = {n: np.ones(t.time.size, dtype=bool) for n, t in compared.items()}
        outside = {n: kept & ~inside.get(n, ~kept) for n, kept in every.items()}
        place = problem, x, tracks, step.name
        found = cls(*place, inside, outside, reach, (0.0, 0.0), 0.0)
        found = found.of_signal(step.name)
        rest = {n: kept for n, kept in outside.items() if kept.any()}
        other = found._replace(inside=rest, outside=inside, levels=found.levels[::-1])
        return other if not reach and other.is_idle else found

    def at(self, x: FloatArray) -> _Change:
        """Return the change with its place in the error of another fit."""
        tracks = _tracks(self.problem, x)
        if not self.reach:
            return self._replace(x=x, tracks=tracks)
        trial, kept = next(iter(self.inside.items()))
        own = tracks[trial].block[kept]
        step = _Step(self.name, {trial: (int(own[0]), int(own[-1]) + 1)})
        return _Change.of(self.problem, x, tracks, step)

    def of_signal(self, name: str) -> _Change:
        """Return a change of another signal in the same samples."""
        pairs = [_sums(self.tracks, name, k) for k in (self.inside, self.outside)]
        (a, own), (b, rest) = pairs
        levels = a / max(own, 1e-300), b / max(rest, 1e-300)
        gain = own * rest / max(own + rest, 1e-300) * (levels[0] - levels[1]) ** 2
        return self._replace(name=name, levels=levels, gain=gain)

    def drifts(self) -> list[_Change]:
        """Return drifts of torques' zeros in its trial, or the last before a step."""
        tracks, names = self.tracks, list(self.tracks)
        known = [n for n in TORQUE_OFFSETS if n in tracks[names[0]].signals]
        if self.reach:
            able = next(iter(self.inside.values()))[-1]
            return [self.drifting(name) for name in known if able]
        side = self.inside if names[-1] in self.inside else self.outside
        late = [n for n in names if n in side and side[n].any()]
        place = len(names) - len(late) - 1
        if place < 0 or late != names[place + 1 :]:
            return []
        every = {n: np.ones(t.time.size, bool) for n, t in tracks.items()}
        inside = {n: every[n] for n in names[place:]}
        outside = {n: every[n] for n in names[: place + 1]}
        step = self._replace(inside=inside, outside=outside)
        return [step.drifting(name) for name in known]

    def drifting(self, name: str) -> _Change:
        """Return a drift of a signal to the end of its trial, after which it stays."""
        (trial, _), *others = self.inside.items()
        track, drift = self.tracks[trial], name + DRIFT
        time, signal, block = track.time, track.signals[name], track.block
        every = {n: np.ones(t.time.size, dtype=bool) for n, t in self.tracks.items()}
        late, whole = (_sums(self.tracks, name, own) for own in (dict(others), every))
        starts = np.linspace(time[0], time[-1] - Limit.event_block, 400)[1:, None]
        ramps = np.clip((time - starts) / (time[-1] - starts), 0.0, None)
        square, product = (signal**2).sum(axis=0), (signal * track.error).sum(axis=0)
        # Beside a zero of all trials, to which a part of the drift was fitted
        shared = (late[1] + ramps @ square) / whole[1]
        own = late[0] + ramps @ product - shared * whole[0]
        size = own / (late[1] + ramps**2 @ square - shared**2 * whole[1])
        taken = own * size
        best = int(np.argmax(taken))
        usual = whole[0] / whole[1] - size[best] * shared[best]
        ramp, start = ramps[best], float(starts[best, 0])
        left = product - (usual + size[best] * ramp) * square
        along: dict[str, FloatArray] = {trial: ramp}
        off = np.bincount(block, left) ** 2 / np.bincount(block, square)
        scatter = max(float(np.mean(off)), _noise(self.problem))
        least = taken[best] - Limit.sigmas**2 * scatter
        reach = float(np.max(np.abs(starts[taken >= least] - start)))
        tracks = {}
        for n, track in self.tracks.items():
            zero = track.signals[name]
            own_signals = {drift: zero * along.get(n, 1.0)}
            error = track.error - usual * zero
            tracks[n] = track._replace(signals=own_signals, error=error)
        inside = {**self.inside, trial: time >= start}
        outside = {**self.outside, trial: time < start}
        found = self._replace(tracks=tracks, inside=inside, outside=outside)
        return found._replace(reach=max(self.reach, reach)).of_signal(drift)

    @property
    def spans(self) -> dict[str, tuple[float, float]]:
        """Part of every trial that it concerns [s], infinite up to the trial's ends."""
        return {n: _span(self.tracks[n].time, kept) for n, kept in self.inside.items()}

    @property
    def is_whole(self) -> bool:
        """True of whole trials."""
        return all(kept.all() for kept in self.inside.values())

    @property
    def sides(self) -> list[_Change]:
        """The change, and the other side of it where a lasting gain may be wrong."""
        if self.is_idle or not self.is_of_sensor or len(self.inside) < 2:
            return [self]
        kept = {n: own for n, own in self.outside.items() if own.any()}
        rest = dict(sorted(kept.items(), key=lambda pair: bool(pair[1].all())))
        levels = self.levels[::-1]
        return [self, self._replace(inside=rest, outside=self.inside, levels=levels)]

    @property
    def is_of_sensor(self) -> bool:
        return self.name in self.problem.plant.instruments.channels

    @property
    def masks(self) -> Masks:
        """Samples of the part that count, by record."""
        found, spans = [], self.spans
        for record in self.problem.plant.records:
            start, stop = spans.get(record.trial, (math.inf, math.inf))
            found.append(record.counts & (record.time >= start) & (record.time < stop))
        return tuple(found)

    def left(self, kept: Kept, level: float) -> tuple[float, float, float]:
        """Return the squared error at a level, the level's best change, its weight.

        A constant is simulated at its level, as large changes are not in proportion to
        its derivative; a torque's zero, which the fit bounds, is not. The weight is the
        square of the signal.
        """
        product = square = error_square = 0.0
        linear = self.name in TORQUE_OFFSETS
        along = np.array(
            [each == self.name and not linear for each in self.problem.names], float
        )
        for trial, own in kept.items():
            track = self.tracks[trial]
            signal = track.signals[self.name][:, own]
            if along.any():
                error = track.error_at(self.problem, self.x + level * along)[:, own]
            else:
                error = track.error[:, own] - level * signal
            product += float(np.sum(signal * error))
            square += float(np.sum(signal**2))
            error_square += float(np.sum(error**2))
        return error_square, product / max(square, 1e-300), square

    def refined(self) -> tuple[_Change, float]:
        """Return the change with simulated levels, and the squared error it leaves."""
        found, whole = [], 0.0
        for kept, level in zip((self.inside, self.outside), self.levels, strict=True):
            best = level, *self.left(kept, level)[:2]
            for _ in range(6):
                there = best[0] + best[2]
                tried = there, *self.left(kept, there)[:2]
                if tried[1] >= best[1]:
                    break
                best = tried
            found.append(best[0])
            whole += best[1]
        return self._replace(levels=(found[0], found[1])), whole

    def takes_most(self) -> bool:
        """Return whether it leaves less than half of its part's error, or of all."""
        before = after = 0.0
        for kept, level in zip((self.inside, self.outside), self.levels, strict=True):
            errors = (self.tracks[n].error[:, own] for n, own in kept.items())
            before += sum(float(np.sum(error**2)) for error in errors)
            after += self.left(kept, level)[0]
            if after < Limit.max_event_rest * before:
                return True
        return False

    def is_comparable(self) -> bool:
        """Return whether its whole trials have the conditions, or fit, as others do.

        A trial may have another pretension than it declares, but nothing else is known
        of trials that are the only ones with theirs.
        """
        fits = self.fits_part()
        if fits and self.name == "pretension":
            return True
        others = [name for name in self.tracks if name not in self.inside]
        groups = list(self.inside), others
        return _is_comparable(self.problem, self.tracks, *groups, fits)

    def fits_part(self) -> bool:
        """Return whether nothing of the part's error is left."""
        noise, count = self.problem.noise_over_floor, 0.0
        left = self.left(self.inside, self.levels[0])[0]
        for each, kept in zip(noise, self.masks, strict=True):
            count += float(np.sum(each[:, kept] ** 2))
        return left <= Limit.layout_error**2 * count

    @property
    def constant(self) -> Tuned | None:
        """Constant of the tuned scene that changes; None of a torque."""
        name = self.name.removesuffix(DRIFT)
        return next((p for p in self.problem.tuned if p.name == name), None)

    @property
    def is_idle(self) -> bool:
        """True if torques of the part no longer follow the simulation at all."""
        known = self.name == PULL or self.is_of_sensor
        level, usual = self.levels
        return known and 1.0 + level < Limit.max_idle_share * (1.0 + usual)

    def is_plausible(self) -> bool:
        """Return whether it lasts, unless torques were idle, and is no small share."""
        spans, level = self.spans.values(), self.levels[0] - self.levels[1]
        scale, known = 1.0 / (1.0 + self.levels[1]), self.constant
        if known is not None:
            scale = known.scale if known.factor else math.inf
        inner = any(math.isfinite(stop - start) for start, stop in spans)
        large = abs(level) * scale > Limit.min_event_change
        return self.is_idle or (large and not inner)

    def exceeds_effects(self, names: Collection[str]) -> bool:
        """Return whether no effect takes more than steps of signals, to first order."""
        problem, parts = self.problem, self.masks
        masks = [record.counts for record in problem.plant.records]
        seen = [k for k, mask in enumerate(masks) if mask.any()]
        torques = problem.torques(self.x, seen)
        slopes = problem.slopes.of(problem, self.x, seen, torques)
        changes = []
        for k, torque, slope in zip(seen, torques, slopes, strict=True):
            own = _signals(problem, torque, slope)
            changes.append([change * parts[k] for n, change in own if n in names])
        return exceeds_effects(problem, self.x, masks, [np.stack(c) for c in changes])

    def rest_fit(self) -> FloatArray | None:
        """Return a fit of all else; None if it fits the part, or little is left."""
        problem, parts = self.problem, self.masks
        records = problem.plant.records
        rest = [r.free & ~part for r, part in zip(records, parts, strict=True)]
        if sum(int(mask.sum()) for mask in rest) < Limit.min_counted_samples:
            return None
        there = fitting.fit(problem, self.x, rest).x
        off, left = (_ratio(problem, there, masks) for masks in (parts, rest))
        least = max(Limit.outlier_floor_ratio, Limit.outlier_ratio * left)
        return there if off > least else None

    def events(self, dataset: Dataset) -> list[Event]:
        """Return the event, for a gain by both sides; [] if no signal takes most.

        Of all that may have changed there it is that which leaves least by simulation.
        """
        trial = next(iter(self.inside))
        signals = self.tracks[trial].signals
        able = [self.of_signal(name) for name in signals]
        able += self.drifts()
        exact = sorted((each.refined() for each in able), key=lambda pair: pair[1])
        (best, left), *others = exact
        near = [e.name for e, own in others if own * Limit.rival_event_share < left]
        there = best.rest_fit() if best.name.endswith(DRIFT) else None
        if there is not None:  # the rest had a part of the drift
            moved = best._replace(x=there, tracks=_tracks(self.problem, there))
            best = moved.drifting(best.name.removesuffix(DRIFT))
        if not (best.takes_most() and best.is_plausible()):
            return []
        if best.is_whole and not best.is_comparable():
            return []
        return [side.event(dataset, near) for side in best.sides]

    def device(self, dataset: Dataset) -> Event | None:
        """Return the event of trials that fit by themselves, not with the others."""
        problem, part, there = self.problem, self.masks, self.x
        records = problem.plant.records
        hooked = {r.trial for r in records if not r.unhooked}
        inside = len(hooked.intersection(self.inside))
        if min(inside, len(hooked) - inside) < 2:
            return None
        own = [r.free & mask for r, mask in zip(records, part, strict=True)]
        problem, there = _fitted_alone(problem, there, own)
        rest = [r.counts & ~mask for r, mask in zip(records, part, strict=True)]
        left = _ratio(self.problem, self.x, rest), _ratio(problem, there, part)
        if max(left) > Limit.layout_error:
            return None
        size = Estimate(math.nan, "1", (math.nan, math.nan))
        change = "they fit by themselves, and not with the others"
        return self.event(dataset, (), ("device", change, size))

    def event(
        self, dataset: Dataset, rivals: Sequence[str],
        described: tuple[str, str, Estimate] | None = None,
    ) -> Event:  # fmt: skip
        """Return the event in words, with what to declare; `rivals` look the same."""
        spans = self.spans
        (trial, (start, stop)), *others = spans.items()
        whole = math.isinf(start) and math.isinf(stop)
        near = f"(± {self.reach:.2g} s)"
        edges = [
            f"{word} {format_number(edge, self.reach)} s {near}"
            for word, edge in (("from", start), ("until", stop))
            if math.isfinite(edge)
        ]
        where = " ".join([f"Trial {trial}", *edges])
        if whole and others:
            where = f"Trials {list_words(spans)}"
        elif others:
            end = f"to the end of {others[-1][0]}"
            if math.isinf(start):
                end = f"from the start of {others[0][0]} on"
            where = f"{capitalise(edges[0])} of {trial} {end}"
        kind, change, size = described or self._described()
        causes = [_CAUSES[kind], *(_CAUSES[n] for n in rivals if n in _CAUSES)]
        cause = capitalise(", or ".join(dict.fromkeys(causes)))
        gone = list(spans) if whole else [name for name, _ in others]
        occasion = _occasion(dataset, gone) if kind in _JUDGED else ""
        valid = {}
        if not whole:
            time = dataset.trial(trial).time
            low, high = float(time[0]), float(time[-1])
            kept = [(low, min(start, high)), (max(stop, low), high)]
            known = [[round(a, 3), round(b, 3)] for a, b in kept if a < b]
            valid[trial] = f"valid = {known}"
        lines = _declaration(dataset, gone, occasion, valid)
        moment = math.nan if whole else start if math.isfinite(start) else stop
        ends = moment - self.reach, moment + self.reach
        happened = spans, dataset.trial(trial).path, round(moment, 6), ends, size
        statement = f"{where}: {change}. {cause}?"
        return Event(kind, *happened, statement, lines, occasion)

    def _described(self) -> tuple[str, str, Estimate]:
        """Return kind and change in words, and the size of the change."""
        name, (level, usual) = self.name, self.levels
        pairs = (self.inside, level), (self.outside, usual)
        sides = [self.left(kept, own) for kept, own in pairs]
        samples = sum(int(own.sum()) for kept, _ in pairs for own in kept.values())
        rows = len(next(iter(self.tracks.values())).error)
        scatter = sum(side[0] for side in sides) / (rows * samples)
        scatter = max(scatter, 1.0) * _noise(self.problem)
        spread = Limit.sigmas * math.sqrt(sum(scatter / side[2] for side in sides))
        known = self.constant
        unit = 1.0 + level if known is None else abs(level - usual)
        if known is not None and known.factor:
            unit = 1.0 / known.scale
        spread = math.hypot(spread, Limit.event_form_error * unit)

        def value(change: float) -> float:
            if known is None:
                return 1.0 + change / (1.0 + usual)
            size = known.scale * change
            return math.exp(size) if known.factor else size

        low, size, high = (value(level - usual + k * spread) for k in (-1, 0, 1))
        unit_name = "1" if known is None or known.factor else known.unit
        estimate = Estimate(size, unit_name, (min(low, high), max(low, high)))
        if known is not None and not known.factor:
            kind, verb = name, "moves by"
            if name.endswith(DRIFT):
                kind, verb = DRIFT, "drifts to its end by"
            return kind, f"{_SUBJECTS[known.name]} {verb} {SIZE}", estimate
        subject = "both torques" if name == PULL else f"the {channel_name(name)}"
        if known is not None:
            subject = plain_name(name)
        if self.is_idle:
            still = sides[0][0] < Limit.max_idle_share * sides[0][2]
            if name == PULL and still:
                return "silent", "the cables transmit nothing", estimate
            return "dead", f"{subject} no longer follows the motion", estimate
        verb = "are" if name == PULL else "is"
        change = f"{subject} {verb} {SIZE} times that of the rest"
        return name if known or name == PULL else "gain", change, estimate


_ANOTHER = "was it another device, or another pretension"
_CAUSES = {
    "joint_angle_offset": "was an encoder zeroed again, or did a clamp or pulley slip",
    "pretension": "was the cable tightened, or did a clamp give way",
    "friction": "was the cable oiled, routed anew or exchanged",
    "axial_stiffness": "was the cable exchanged",
    "motor_torque_offset": "was the motor's torque sensor zeroed or hit",
    "joint_torque_offset": "was the joint's torque sensor zeroed or hit",
    DRIFT: "does the sensor warm up, or is its amplifier failing",
    PULL: _ANOTHER,
    "device": _ANOTHER,
    "silent": "was the cable off, or slack for good",
    "dead": "is a sensor, its wire or its power broken",
    "gain": "was the sensor's gain changed, or the sensor exchanged",
}
"""Question on the cause, by kind of event."""
_SUBJECTS = {
    "joint_angle_offset": "the zero between motor and joint",
    "motor_torque_offset": "the zero of the motor torque",
    "joint_torque_offset": "the zero of the joint torque",
}


def _declaration(
    dataset: Dataset, names: Sequence[str], occasion: str, known: Mapping[str, str] = {}
) -> tuple[str, ...]:
    """Return tables of `dataset.toml` that make trials an occasion, or exclude them.

    `known` has a line by name of a trial of which a part is left out.
    """
    keys = {name: [line] for name, line in known.items()}
    for trial in dataset.trials:
        own = occasion if trial.name in names else REST
        if occasion:
            keys.setdefault(trial.name, []).append(f"occasion = {own!r}")
        elif trial.name in names:
            keys.setdefault(trial.name, []).append("exclude = true")
    tables = ([f"[trials.{name!r}]", *lines] for name, lines in keys.items())
    return tuple("\n".join(table) for table in tables)


def _occasion(dataset: Dataset, names: Sequence[str]) -> str:
    """Return an occasion for trials; "" if either side has one or any is declared."""
    if any(trial.facts.occasion for trial in dataset.trials):
        return ""
    fewest = min(len(dataset.trials) - len(names), len(names))
    return f"{names[0]} to {names[-1]}" if fewest >= 2 else ""


def leave_out(dataset: Dataset, event: Event) -> Dataset:
    """Return the dataset without the event, or with whole trials of it as an occasion.

    `Event.spans` has their parts.
    """
    trials = []
    for trial in dataset.trials:
        start, stop = event.spans.get(trial.name, (math.inf, math.inf))
        first, last = np.searchsorted(trial.time, (start, stop)).tolist()
        if event.occasion:
            whole = (start, stop) == (-math.inf, math.inf)
            name = event.occasion if whole else REST
            trial = replace(trial, facts=replace(trial.facts, occasion=name))
            if whole:
                trials.append(trial)
                continue
        pieces = [
            slice(*ends)
            for own in trial.segments
            for ends in (
                (own.start, min(own.stop, first)),
                (max(own.start, last), own.stop),
            )
            if ends[1] - ends[0] >= Limit.min_record_samples
        ]
        if pieces:
            trials.append(replace(trial, segments=tuple(pieces)))
    return replace(dataset, trials=tuple(trials))


def sized(event: Event, estimated: Mapping[str, Estimate]) -> Event:
    """Return the event with its size by the final fit, where it has an occasion.

    A fit gives the earlier of two occasions relative to the later.
    """
    size = event.size
    own, rest = (
        estimated.get(change_name(event.kind, name)) for name in (event.occasion, REST)
    )
    if event.occasion and own:
        size = own
    elif event.occasion and rest:
        low, high = rest.ci95
        if event.kind in _SUBJECTS:
            size = Estimate(-rest.value, rest.unit, (-high, -low))
        else:
            size = Estimate(1.0 / rest.value, rest.unit, (1.0 / high, 1.0 / low))
    text = event.statement.replace(SIZE, format_estimate(size, f" {size.unit}"))
    text = text.replace(" 1 (95", " (95")
    return replace(event, size=size, statement=text)


def _sums(tracks: Mapping[str, _Track], name: str, kept: Kept) -> tuple[float, float]:
    """Return the product of a signal with the error, and its square, of samples."""
    product = square = 0.0
    for trial, own in kept.items():
        signal = tracks[trial].signals[name][:, own]
        product += float(np.sum(signal * tracks[trial].error[:, own]))
        square += float(np.sum(signal**2))
    return product, square


def _lasting(
    tracks: Mapping[str, _Track], name: str, trial: str, within: NDArray[np.bool_]
) -> Kept:
    """Return the samples of an event by trial, from an interval of one of them.

    If the interval ends with the trial, the trials after it belong to the event where
    they are like it. Of the two sides of a moment, the event is the one unlike the
    trials before.
    """
    if not within[0] and not within[-1]:
        return {trial: within}
    after = ~within if within[0] else within

    pairs = (_sums(tracks, name, {trial: side}) for side in (~after, after))
    old, new = (product / max(square, 1e-300) for product, square in pairs)
    every = {n: np.ones(t.time.size, dtype=bool) for n, t in tracks.items()}
    sums = {n: _sums(tracks, name, {n: kept}) for n, kept in every.items()}
    least = Limit.min_trial_share * max(square for _, square in sums.values())
    usual = {n: own / square for n, (own, square) in sums.items() if square > least}
    is_new = {n: abs(own - new) < abs(own - old) for n, own in usual.items()}
    names = list(tracks)
    place = names.index(trial)
    earlier = [is_new[n] for n in names[:place] if n in is_new]
    later = [is_new[n] for n in names[place + 1 :] if n in is_new]
    if later and all(later):
        if any(earlier):
            return {trial: ~after}
        return {trial: after} | {n: every[n] for n in names[place + 1 :]}
    return {trial: after}


def _locate(
    track: _Track, name: str, first: int, last: int, noise: float
) -> tuple[NDArray[np.bool_], float]:
    """Return the samples of an interval, its ends as they fit best, and their error.

    The ends lie within two blocks of those of the interval. The error is of the end
    that is known worst, by the likelihood [s].
    """
    count, block = len(track.conditions), track.block
    rough = (block >= first) & (block < last)
    signal, levels = track.signals[name], []
    for kept in (rough, ~rough):
        product, square = _sums({"": track}, name, {"": kept})
        levels.append(product / max(square, 1e-300))
    ends, reach, time = [0, block.size], 0.0, track.time
    for side, edge in enumerate((first, last)):
        if 0 < edge < count:
            near = np.flatnonzero(np.abs(block + 0.5 - edge) < 2.0)
            near = near[near > 0]
            before, after = levels[1 - side], levels[side]
            rest = track.error[:, near] - before * signal[:, near]
            cost = _step_costs(time[near], rest, (after - before) * signal[:, near])
            ends[side] = at = int(near[np.argmin(cost)])
            able = near[cost <= np.min(cost) + Limit.sigmas**2 * noise]
            low, high = time[able[0] - 1], time[able[-1]]
            middle = _middle(time, at)
            reach = max(reach, float(high) - middle, middle - float(low))
    place = np.arange(block.size)
    within = (place >= ends[0]) & (place < ends[1])
    # The ends of a short interval may pass each other.
    return within if within.any() else rough, reach


def _step_costs(time: FloatArray, error: FloatArray, step: FloatArray) -> FloatArray:
    """Return the squared errors (samples,) left by steps that begin at each sample.

    Errors (rows, samples) of the model beside it are a parabola in time for each row.
    """
    smooth = np.linalg.qr(np.vander(time - time[0], 3))[0]
    rest = error - (error @ smooth) @ smooth.T
    shares = np.concatenate(
        [step[..., None] * smooth, (step**2)[..., None], (step * rest)[..., None]], 2
    )
    after = np.cumsum(shares[:, ::-1], axis=1)[:, ::-1]
    own = after[..., -2] - 2.0 * after[..., -1] - (after[..., :-2] ** 2).sum(axis=2)
    return np.asarray(own.sum(axis=0))


def _middle(time: FloatArray, at: int) -> float:
    """Return the moment between a sample and the one before it [s]."""
    return 0.5 * float(time[at - 1] + time[at])


def _span(time: FloatArray, inside: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the ends of a piece of a trial [s], infinite where it ends with it."""
    kept = np.flatnonzero(inside)
    start = -math.inf if kept[0] == 0 else _middle(time, int(kept[0]))
    ends = kept[-1] == time.size - 1
    return start, math.inf if ends else _middle(time, int(kept[-1]) + 1)
