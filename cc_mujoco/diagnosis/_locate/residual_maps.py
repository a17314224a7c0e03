"""Maps of the error: its mean along speed, load, angle and time, and by chance.

The share that an axis explains is that of a mean per bin, found on one half of the
stretches and tried on the other. Chance is the same with the error shifted in time
against the axis, which keeps the memory of both (never a permutation of samples).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis._phrases import format_number, format_share, format_signed
from cc_mujoco.diagnosis._verdict import Map, TrialTrace, Where
from cc_mujoco.native import FloatArray

BINS = 14
_CHANNEL_NAMES = {"motor_torque_nm": "motor torque", "joint_torque_nm": "joint torque"}


class ResidualAxis(NamedTuple):
    """A quantity along which the error may lie.

    Attributes:
        name: of it.
        unit: of it.
        values: (samples,) per trace.
    """

    name: str
    unit: str
    values: tuple[FloatArray, ...]


def map_axes(traces: Sequence[TrialTrace]) -> tuple[ResidualAxis, ...]:

    def of(name: str, unit: str, make: object) -> ResidualAxis:
        return ResidualAxis(name, unit, tuple(make(trace) for trace in traces))  # type: ignore[operator]

    return (
        of("motor speed", "rad/s", _speed),
        of("absolute motor speed", "rad/s", lambda t: np.abs(_speed(t))),
        of("motor acceleration", "rad/s^2", _acceleration),
        of("joint acceleration", "rad/s^2", _joint_acceleration),
        of("motor angle", "rad", lambda t: t.motor_angle),
        of("joint angle", "rad", lambda t: t.joint_angle),
        *(
            of(_CHANNEL_NAMES[name], "N m", lambda t, name=name: t.measured[name])
            for name in list(traces[0].measured)[-1:]
        ),
        of("direction of motion", "1", lambda t: np.sign(_speed(t))),
        of("motor travel since it turned", "rad", _travel),
        of("time in the trial", "s", lambda t: t.time - t.time[0]),
    )


def _speed(trace: TrialTrace) -> FloatArray:
    found: FloatArray = np.gradient(trace.motor_angle, trace.time)
    return found


def _acceleration(trace: TrialTrace) -> FloatArray:
    found: FloatArray = np.gradient(_speed(trace), trace.time)
    return found


def _joint_acceleration(trace: TrialTrace) -> FloatArray:
    speed = np.gradient(trace.joint_angle, trace.time)
    found: FloatArray = np.gradient(speed, trace.time)
    return found


def _travel(trace: TrialTrace) -> FloatArray:
    """Return the signed distance since the last reversal, small ones left out."""
    speed = _speed(trace)
    slow = 0.02 * float(np.max(np.abs(speed)) or 1.0)
    way = np.where(np.abs(speed) > slow, np.sign(speed), 0.0)
    out = np.zeros(way.size)
    turned, last = trace.motor_angle[0], 0.0
    for i, now in enumerate(way):
        if now != 0.0 and now != last:
            turned, last = trace.motor_angle[i], now
        out[i] = trace.motor_angle[i] - turned
    return out


def error_maps(traces: Sequence[TrialTrace], seed: int = 0) -> tuple[Map, ...]:
    """Return the maps of all channels and axes, the most explanatory first."""
    random = np.random.default_rng(seed)
    found = [
        drawn
        for axis in map_axes(traces)
        for channel in traces[0].measured
        if (drawn := _map(traces, axis, channel, random)) is not None
    ]
    return tuple(sorted(found, key=lambda m: m.chance - m.share))


def _map(
    traces: Sequence[TrialTrace],
    axis: ResidualAxis,
    channel: str,
    random: np.random.Generator,
) -> Map | None:
    kept = [trace.counts > 0.0 for trace in traces]
    values = [v[k] for v, k in zip(axis.values, kept, strict=True)]
    before = [t.error(channel)[k] for t, k in zip(traces, kept, strict=True)]
    after = [t.error(channel, "after")[k] for t, k in zip(traces, kept, strict=True)]
    whole = np.concatenate(values)
    if whole.size < 10 * BINS or np.ptp(whole) == 0.0:
        return None
    edges = np.unique(np.quantile(whole, np.linspace(0.0, 1.0, BINS + 1)))
    if edges.size < 3:
        edges = np.linspace(whole.min(), whole.max(), 4)
    bins = edges.size - 1
    place = np.clip(np.digitize(whole, edges[1:-1]), 0, bins - 1).astype(np.intp)
    # Stretches of every trial count for either half by turns.
    half = np.concatenate([(np.arange(v.size) * 8 // v.size) % 2 for v in values])
    cell = place + bins * half
    count = np.bincount(cell, minlength=2 * bins).reshape(2, bins)
    inside = np.where(count.sum(axis=0) > 0, count.sum(axis=0), 1)
    centre = np.where(
        count.sum(axis=0) > 0,
        np.bincount(place, weights=whole, minlength=bins) / inside,
        0.5 * (edges[:-1] + edges[1:]),
    )

    def sums(error: Sequence[FloatArray]) -> FloatArray:
        found = np.bincount(cell, np.concatenate(error), 2 * bins)
        return found.reshape(2, bins).astype(np.float64)

    square = sum(float(e @ e) for e in before)
    own, rest = sums(before), sums(after)
    shares, means = [], []
    for _ in range(30):
        moved = sums([np.roll(e, _shift(e.size, random)) for e in before])
        shares.append(_share(moved, count, square))
        means.append(_means(moved, count))
    return Map(
        channel,
        axis.name,
        axis.unit,
        centre,
        before=_means(own, count),
        after=_means(rest, count),
        band=1.96 * np.std(np.nan_to_num(np.array(means)), axis=0),
        share=max(_share(own, count, square), 0.0),
        chance=max(float(np.quantile(shares, 0.95)), 0.0),
    )


def _shift(size: int, random: np.random.Generator) -> int:
    """Return a random shift of an error along the axis, far from none and all."""
    first = size // 4
    return int(random.integers(first, max(3 * size // 4, first + 1)))


def _means(sums: FloatArray, count: NDArray[np.intp]) -> FloatArray:
    """Return the mean error by bin (bins,), NaN where there is no sample.

    Args:
        sums: of the errors by half and bin (2, bins).
        count: of the samples (2, bins).
    """
    whole = count.sum(axis=0).astype(float)
    whole[whole == 0.0] = np.nan
    found: FloatArray = sums.sum(axis=0) / whole
    return found


def _share(sums: FloatArray, count: NDArray[np.intp], square: float) -> float:
    """Return the share of variance that bin means of one half explain in the other."""
    mean = (sums / np.maximum(count, 1))[::-1]
    left = square - 2.0 * np.sum(mean * sums) + np.sum(count * mean**2)
    return 1.0 - float(left) / max(square, 1e-300)


def map_sentences(drawn: Sequence[Map], most: int = 6) -> tuple[Where, ...]:
    """Return plain sentences of the maps that chance does not explain."""
    return tuple(
        Where(m.channel, m.axis, m.share, describe_map(m))
        for m in drawn
        if m.share > max(m.chance, 0.02)
    )[:most]


def describe_map(drawn: Map) -> str:
    """Describe a map in one sentence."""
    good = np.isfinite(drawn.before)
    centre, error = drawn.centre[good], drawn.before[good]
    low, high = int(np.argmin(error)), int(np.argmax(error))
    # Middles of bins that are even about 0 miss it by rounding.
    place = np.where(np.abs(centre) < 1e-9 * np.max(np.abs(centre)), 0.0, centre)
    unit = "" if drawn.unit == "1" else f" {drawn.unit}"
    step = float(np.ptp(centre)) / BINS
    first, last = (
        f"{format_signed(error[k])} N m at {format_number(place[k], step)}{unit}"
        for k in (low, high)
    )
    sense = " (1 is forwards, \u22121 backwards)" if drawn.unit == "1" else ""
    return (
        f"{format_share(drawn.share)} of the squared {_CHANNEL_NAMES[drawn.channel]} "
        f"error lies along {drawn.axis} (chance gives {format_share(drawn.chance)}): "
        f"measured minus simulated is {first} and {last}{sense}."
    )
