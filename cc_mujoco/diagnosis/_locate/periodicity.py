"""Errors that are periodic in an angle: ripple of a motor, teeth of a gear, a bump.

The error, less smooth functions of angle, speed and torque, is fitted by a sine of
every order (periods per turn) that the range of the angle resolves: once with a
constant amplitude and once with an amplitude proportional to the torque. The squared
error that a sine explains, over that of the adjacent orders, is exponentially
distributed where none is periodic (Fisher, Proc. R. Soc. A 125, 1929). A reversal or
another sharp feature raises all orders equally; a ripple raises one. Errors that depend
on the motion are not random, so a period must also explain a share of the error on
samples to which it was not fitted.

    line = strongest_line(samples)
    line.order, line.statistic, line.share
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.native import FloatArray

_CHUNK = 64


class Samples(NamedTuple):
    """One channel of all records; arrays have one entry per sample.

    Attributes:
        error: measured minus simulated [N m].
        weight: inverse square of the noise floor [1/N m^2].
        angles: by name, "motor angle" first [rad].
        torque: simulated, of the same channel [N m].
        speed: of the motor [rad/s].
        block: index of the stretch of about a second, by which samples are independent.
        band: highest frequency that the errors contain [Hz].
    """

    error: FloatArray
    weight: FloatArray
    angles: Mapping[str, FloatArray]
    torque: FloatArray
    speed: FloatArray
    block: NDArray[np.intp]
    band: float


class PeriodicError(NamedTuple):
    """Period in an error.

    Attributes:
        angle: in which it is periodic.
        order: periods per turn.
        order_error: standard error of the order.
        amplitude: in N m, or in N m per N m of torque where `by_torque`.
        by_torque: whether the amplitude is proportional to the torque; None where these
            data do not determine that.
        share: share of the squared error that it explains on samples it was not fitted
            to.
        statistic: error that it explains, over that of the adjacent orders.
        threshold: largest statistic that chance reaches with `Limit.false_alarm_rate`.
    """

    angle: str
    order: float
    order_error: float
    amplitude: float
    by_torque: bool | None
    share: float
    statistic: float
    threshold: float

    @property
    def whole_order(self) -> bool:
        """True if the order is a whole number within its uncertainty."""
        return abs(self.order - round(self.order)) < max(2.0 * self.order_error, 0.02)


class _Candidate(NamedTuple):
    angle: str
    by_torque: bool
    order: float
    statistic: float
    background: float
    left: FloatArray
    share: float


def strongest_line(samples: Samples) -> PeriodicError | None:
    """Return the period that explains most of an error; None if chance explains all."""
    if samples.error.size < 100 or not np.any(samples.error):
        return None
    fit = _Prepared(samples)
    families = [
        (name, angle, by_torque)
        for name, angle in samples.angles.items()
        for by_torque in (False, True)
        if fit.orders(angle).size
    ]
    tried = sum(fit.orders(angle).size for _, angle, _ in families)
    if not tried:
        return None
    threshold = math.log(tried / Limit.false_alarm_rate)
    found = [
        candidate
        for name, angle, by_torque in families
        if (candidate := fit.peak(name, angle, by_torque, threshold)) is not None
    ]
    best = max(found, key=lambda each: each.share, default=None)
    if best is None or best.share < Limit.min_error_share:
        return None
    angle = samples.angles[best.angle]
    other = fit.at(best.angle, angle, not best.by_torque, best.order)
    difference = other.left - best.left
    sure = difference.sum() > Limit.decision_sigmas * np.std(difference) * math.sqrt(
        difference.size
    )
    order_error, amplitude = fit.details(best, angle)
    return PeriodicError(
        best.angle,
        best.order,
        order_error,
        amplitude,
        best.by_torque if sure else None,
        best.share,
        best.statistic,
        threshold,
    )


class _Prepared:
    """Errors of a channel without their fit by smooth functions of the motion."""

    def __init__(self, samples: Samples) -> None:
        self._samples = samples
        root = np.sqrt(samples.weight)
        plain = samples.error * root
        usual = Limit.clip_sigmas * float(np.median(np.abs(plain))) / 0.6745
        if usual > 0.0:
            plain = np.clip(plain, -usual, usual)
        self._root = root
        smooth = np.concatenate(
            [_smooth_functions(samples, angle) for angle in samples.angles.values()],
            axis=1,
        )
        # Collinear columns (both angles of a stiff cable) are dropped.
        left, sizes, _ = np.linalg.svd(smooth * root[:, None], full_matrices=False)
        self._basis = left[:, sizes > 1e-8 * sizes[0]]
        self._plain = plain
        self._error = plain - self._basis @ (self._basis.T @ plain)
        self._total = float(plain @ plain)
        self._half = samples.block % 2 == 0

    def orders(self, angle: FloatArray) -> FloatArray:
        """Return the candidate orders and adjacent ones, in radians per radian."""
        span = float(np.ptp(angle))
        if span == 0.0:
            return np.zeros(0)
        speed = np.abs(self._samples.speed)
        moving = speed[speed > 0.05 * speed.max()]
        fastest = math.tau * self._samples.band / max(float(np.median(moving)), 1e-9)
        step = math.tau / span / Limit.order_oversampling
        first, last = 0.5 * math.tau / span, min(Limit.max_order, fastest)
        orders: FloatArray = np.arange(first, last, step)
        enough = orders.size >= 2 * Limit.order_oversampling * (
            Limit.min_background_orders + 1
        )
        return orders if enough else np.zeros(0)

    def peak(
        self, name: str, angle: FloatArray, by_torque: bool, threshold: float
    ) -> _Candidate | None:
        """Return the most significant order, or None."""
        orders = self.orders(angle)
        taken = self._spectrum(angle, by_torque, orders)
        background = np.maximum(_background(taken), 1e-300)
        background[orders < Limit.min_periods * math.tau / np.ptp(angle)] = np.inf
        place = int(np.argmax(taken / background))
        step = orders[1] - orders[0]
        finer = orders[place] + step * np.linspace(-1.0, 1.0, 41)
        near = self._spectrum(angle, by_torque, finer)
        best = int(np.argmax(near))
        if near[best] < Limit.min_error_share * self._total or not np.isfinite(
            background[place]
        ):
            return None
        # A short motion smears a period over the adjacent orders, so they are judged
        # without it.
        pair = self._pair(angle, by_torque, float(finer[best]))
        left = self._error - pair @ np.linalg.lstsq(pair, self._error)[0]
        beside = self._spectrum(angle, by_torque, orders, left)
        level = max(float(_background(beside)[place]), 1e-300)
        if near[best] < threshold * level:
            return None
        found = self.at(name, angle, by_torque, float(finer[best]))
        return found._replace(statistic=float(near[best]) / level, background=level)

    def at(
        self, name: str, angle: FloatArray, by_torque: bool, order: float
    ) -> _Candidate:
        pair = self._pair(angle, by_torque, order)
        left = np.empty(self._error.size)
        for mask in (self._half, ~self._half):
            size = np.linalg.lstsq(pair[mask], self._error[mask])[0]
            left[~mask] = self._error[~mask] - pair[~mask] @ size
        blocks = self._samples.block
        squares = np.bincount(blocks, left**2).astype(np.float64)
        gain = float(self._error @ self._error - squares.sum())
        return _Candidate(
            name, by_torque, order, 0.0, 0.0, squares, gain / max(self._total, 1e-300)
        )

    def details(self, found: _Candidate, angle: FloatArray) -> tuple[float, float]:
        """Return standard error of the order and amplitude of a line."""
        pair = self._pair(angle, found.by_torque, found.order)
        size = np.linalg.lstsq(pair, self._error)[0]
        turned = np.stack([pair[:, 1], -pair[:, 0]], axis=1) @ size
        slope = -(angle - np.mean(angle)) * turned
        slope = slope - pair @ np.linalg.lstsq(pair, slope)[0]
        # A pair of coefficients explains twice the variance of one by chance.
        spread = math.sqrt(0.5 * found.background / max(float(slope @ slope), 1e-300))
        return spread, float(np.linalg.norm(size))

    def _pair(self, angle: FloatArray, by_torque: bool, order: float) -> FloatArray:
        """Return weighted cosine and sine without their smooth part (samples, 2)."""
        size = self._root * (self._samples.torque if by_torque else 1.0)
        phase = order * angle
        pair = np.stack([np.cos(phase) * size, np.sin(phase) * size], axis=1)
        found: FloatArray = pair - self._basis @ (self._basis.T @ pair)
        return found

    def _spectrum(
        self,
        angle: FloatArray,
        by_torque: bool,
        orders: FloatArray,
        error: FloatArray | None = None,
    ) -> FloatArray:
        """Return the squared error that a sine of each order explains (orders,)."""
        error = self._error if error is None else error
        size = (self._root * (self._samples.torque if by_torque else 1.0))[:, None]
        taken = []
        for first in range(0, orders.size, _CHUNK):
            phase = np.outer(angle, orders[first : first + _CHUNK])
            both = np.cos(phase) * size, np.sin(phase) * size
            one, two = (each - self._basis @ (self._basis.T @ each) for each in both)
            aa, bb = (one**2).sum(axis=0), (two**2).sum(axis=0)
            ab = (one * two).sum(axis=0)
            a, b = one.T @ error, two.T @ error
            scale = np.maximum(aa * bb - ab**2, 1e-12 * aa * bb + 1e-300)
            taken.append((bb * a**2 - 2.0 * ab * a * b + aa * b**2) / scale)
        return np.concatenate(taken)


def _smooth_functions(samples: Samples, angle: FloatArray) -> FloatArray:
    """Return nonperiodic smooth functions of the motion (samples, functions)."""
    span = float(np.ptp(angle)) or 1.0
    u = 2.0 * (angle - np.mean(angle)) / span
    speed = samples.speed / max(float(np.quantile(np.abs(samples.speed), 0.95)), 1e-9)
    way = np.tanh(20.0 * speed)
    size = float(np.max(np.abs(samples.torque))) or 1.0
    torque = samples.torque / size
    one = np.ones(u.size)
    return np.stack(
        [
            *(one, u, u**2, u**3),
            *(way, way * u, way * u**2),
            *(speed, np.abs(speed), torque, np.abs(torque), torque * u),
        ],
        axis=1,
    )


def _background(taken: FloatArray) -> FloatArray:
    """Return the mean of the spectrum around each order, by medians (orders,).

    The larger side counts, since errors grow towards low orders. It is infinite where
    the lower side is unknown.
    """
    below = _lower_medians(taken)
    above = _lower_medians(taken[::-1])[::-1]
    larger: FloatArray = np.fmax(below, above) / math.log(2.0)
    return np.where(np.isnan(below), np.inf, larger)


def _lower_medians(taken: FloatArray) -> FloatArray:
    """Return the median of lower orders without the nearest (orders,), NaN if few."""
    own, width, least = (
        count * Limit.order_oversampling
        for count in (1, Limit.background_orders, Limit.min_background_orders)
    )
    found = np.full(taken.size, np.nan)
    for k in range(own + least, min(own + width, taken.size)):
        found[k] = np.median(taken[: k - own])
    if taken.size > own + width:
        windows = np.lib.stride_tricks.sliding_window_view(taken, width)
        found[own + width :] = np.median(windows[: taken.size - own - width], axis=1)
    return found
