"""Stretch of a trial that a model does not explain, while it explains the rest.

A cable that comes off, a clamp that slips or a sensor that freezes is no effect of the
library: it begins at a moment. It hides in the RMS error of all data, and large errors
count less in fits.

    stretch = worst_stretch(problem, x, torques)
    stretch.statement, stretch.rest
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cc_mujoco.datasets import _channels as channels
from cc_mujoco.diagnosis._fit.fitting import Masks, Problem, fit, huber_residual
from cc_mujoco.diagnosis._fit.folds import BOOTSTRAP_BLOCK
from cc_mujoco.diagnosis._phrases import channel_name, format_number
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.native import FloatArray


class Stretch(NamedTuple):
    """Stretch with an error beyond its limit.

    Attributes:
        trial: its name.
        start: time as recorded [s].
        end: time as recorded [s].
        channel: torque with the largest error.
        size: RMS error over the noise.
        error: RMS error [N m].
        idle: whether both torques are next to nothing, though the model's are not.
        rest: misfit of all other samples.
    """

    trial: str
    start: float
    end: float
    channel: str
    size: float
    error: float
    idle: bool
    rest: float

    @property
    def statement(self) -> str:
        when = f"from {self.start:.1f} s to {self.end:.1f} s"
        verb = "transmits nothing" if self.idle else "is off"
        return (
            f"{self.trial} {verb} {when}: the {channel_name(self.channel)} is "
            f"{format_number(self.error)} N m RMS off, {format_number(self.size)} "
            f"times the noise floor, and all other data {format_number(self.rest)} "
            "times."
        )

    @property
    def question(self) -> str:
        """Question to whoever recorded it."""
        what = "came off" if self.idle else "came off, slipped or was changed"
        return (
            f"{self.statement} Is there a cable or a clamp that {what}, or a sensor "
            "that failed? Judge the rest without these seconds: leave them out of "
            f"`valid` in dataset.toml ([trials.{self.trial!r}])."
        )


def worst_stretch(
    problem: Problem, x: FloatArray, torques: Sequence[FloatArray]
) -> Stretch | None:
    """Return the stretch that exceeds its limit by most, or None.

    Its size, and the misfit of all other data, are those of a fit without it. `torques`
    are predictions (rows, samples) of every record [N m].
    """
    worst: tuple[float, int, int, slice] | None = None
    records, instruments = problem.plant.records, problem.plant.instruments
    swing = Limit.friction_swing * problem.values(x).get("motor_friction", 0.0)
    masks = [record.counts.copy() for record in records]
    for place, (error, noise) in enumerate(_squares(problem, torques, masks)):
        record = records[place]
        if not record.counts.any():
            continue
        window = max(1, round(BOOTSTRAP_BLOCK / record.dt))
        for row, channel in enumerate(instruments.channels):
            own = swing if channel == channels.MOTOR_TORQUE else 0.0
            free = np.where(record.counts, own / problem.floor[place][row], 0.0) ** 2
            over, middle = _largest_ratio(
                error[row],
                noise[row] + free / Limit.stretch_limit**2,
                record.counts,
                window,
            )
            whole = _ratio(error[row], noise[row] + free / Limit.trial_limit**2)
            beyond = max(
                over / Limit.stretch_limit, math.sqrt(whole) / Limit.trial_limit
            )
            if beyond > 1.0 and (worst is None or beyond > worst[0]):
                least = 0.5 * math.hypot(
                    Limit.stretch_limit, math.sqrt(float(free.max()))
                )
                part = _edges(error[row], middle, record.dt, least)
                if over < Limit.stretch_limit:
                    first, last = np.flatnonzero(record.counts)[[0, -1]]
                    part = slice(int(first), int(last) + 1)
                worst = beyond, place, row, part
    if worst is None:
        return None
    _, place, row, part = worst
    masks[place][part] = False
    if not any(mask.any() for mask in masks):
        return None
    there = problem.torques(fit(problem, x, masks).x)
    rest = [
        (huber_residual(np.sqrt(error[:, mask])) ** 2, noise[:, mask])
        for (error, noise), mask in zip(
            _squares(problem, there, masks), masks, strict=True
        )
    ]
    record, shown = records[place], there[place][:, part]
    measured, floor = record.measured[:, part], problem.floor[place][row, part]
    off = (measured - shown)[row]
    idle = np.median(np.abs(measured), axis=1) < Limit.max_idle_share * np.median(
        np.abs(shown), axis=1
    )
    return Stretch(
        record.trial,
        float(record.time[part][0]),
        float(record.time[part][-1]),
        problem.plant.instruments.channels[row],
        math.sqrt(
            _ratio((off / floor) ** 2, (problem.sensed[place][row, part] / floor) ** 2)
        ),
        math.sqrt(float(np.mean(off**2))),
        bool(idle.all()),
        math.sqrt(
            _ratio(*(np.concatenate([e[k].ravel() for e in rest]) for k in (0, 1)))
        ),
    )


def _squares(
    problem: Problem, torques: Sequence[FloatArray], masks: Masks
) -> list[tuple[FloatArray, FloatArray]]:
    """Return squared errors and noise over the floor (rows, samples), 0 if masked."""
    return [
        (
            np.where(mask, (record.measured - torque) / floor, 0.0) ** 2,
            np.where(mask, sensed / floor, 0.0) ** 2,
        )
        for record, torque, floor, sensed, mask in zip(
            problem.plant.records,
            torques,
            problem.floor,
            problem.sensed,
            masks,
            strict=True,
        )
    ]


def _largest_ratio(
    error: FloatArray,
    noise: FloatArray,
    counts: np.ndarray[tuple[int], np.dtype[np.bool_]],
    window: int,
) -> tuple[float, int]:
    """Return the largest RMS error of a window over its noise, and its middle."""
    box = np.ones(min(window, counts.size))
    sums = [
        np.convolve(each, box, "valid")
        for each in (error, noise, counts.astype(np.float64))
    ]
    full = sums[2] > 0.8 * box.size
    if not full.any():
        return 0.0, 0
    ratios = np.where(full, sums[0] / np.maximum(sums[1], 1e-300), 0.0)
    most = int(np.argmax(ratios))
    return math.sqrt(float(ratios[most])), most + box.size // 2


def _edges(error: FloatArray, middle: int, dt: float, smallest: float) -> slice:
    """Return the samples around one in which the error stays large."""
    width = max(1, round(Limit.edge_window / dt))
    local = np.sqrt(np.convolve(error, np.full(width, 1.0 / width), "same"))
    near = slice(max(0, middle - 5 * width), middle + 5 * width)
    least = max(Limit.edge_share * float(local[near].max()), smallest)
    large = np.flatnonzero(local > min(least, float(local[near].max()) * 0.999))
    gaps = np.flatnonzero(np.diff(large) > Limit.bridged / dt)
    starts = large[np.concatenate([[0], gaps + 1])]
    ends = large[np.concatenate([gaps, [large.size - 1]])]
    own = int(np.argmin(np.maximum(starts - middle, 0) + np.maximum(middle - ends, 0)))
    return slice(int(starts[own]), int(ends[own]) + 1)


def _ratio(error: FloatArray, noise: FloatArray) -> float:
    return float(error.sum() / max(float(noise.sum()), 1e-300))
