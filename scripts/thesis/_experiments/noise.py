r"""Section 3.2.2: the noise of every sensor from data, and weights from it.

Chosen, as the text is silent: five sensors with unequal noise on the cable of
Table 2.2 with its kinetic friction, 10 segments. For the statistics of the estimator
the tension is the local trend that its model has; for drifting sensors it is that of
this package's kernel on the same nodes, motor and wearer pulling and letting go. There
the memory of 300 samples is one of four tried on this motion (150 to 1000): a shorter
one follows better here, and is more easily misled by chance where nothing drifts.

After Odelson, Rajamani and Rawlings, *A new autocovariance least-squares method for
estimating noise covariances*, Automatica 42 (2006) 303-308, which the thesis names in
3.2.2: a filter with any fixed gain runs over the readings. Its innovations would be
white if the gain were the best one; how they are correlated in time is linear in the
unknown variances,

.. math:: C_l = C \bar A^l P C^T - C \bar A^{l-1} A L R \ (l > 0), \quad
          C_0 = C P C^T + R, \quad
          P = \bar A P \bar A^T + G Q G^T + A L R L^T A^T,

with :math:`\bar A = A - A L C`; so they follow from measured autocovariances by linear
least squares. Q and R are diagonal here.

On a cable that moves as a whole all sensors measure one tension, each times its known
capstan factor. `trend_model` takes that tension for a local trend, level and rate, the
rate a random walk.

`SensorNoise` needs no model of the tension and no time to settle. While the whole cable
slips one way, a sensor reads :math:`y_i = g_i T + v_i`. So :math:`y_i/g_i - y_j/g_j`
holds noise alone, whatever the tension does. The covariance of these contrasts is
linear in the variances of the sensors; they follow by least squares. Each residual is
weighted by its own statistical error under the last estimate, and old samples fade, so
that it follows sensors that change.
"""

from __future__ import annotations

import time as clock
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_discrete_lyapunov
from scipy.optimize import nnls

from cc_mujoco.cable import Cable, Replay, replay
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.estimation._fusion import tension_gains
from cc_mujoco.native import FloatArray
from thesis._directions import (
    CONDITIONS,
    Moment,
    excess_moment,
    fuse_correlated,
    sensor_votes,
)
from thesis._estimators import TensionFusion
from thesis._outcome import Finding, rms, round_down_ratio
from thesis._rig import PRINTED_CABLE

SEGMENTS = 10
CABLE = PRINTED_CABLE.replace(static_friction=0.0, segments=SEGMENTS, pretension=20.0)
NODES = (0, 2, 5, 8, 10)
DEVIATION = np.array([2.0, 1.0, 0.5, 1.5, 0.0])
"""Noise of the statistics [N]; none in the last sensor, to show what the bound does."""
LENGTHS = (250, 500, 1000, 2000, 4000, 8000)
RUNS = 100
SETTLING_SAMPLES = 50
DT, SECONDS = 0.005, 60.0
MOTION, TENSION = 5e-4, 50.0
"""Instants with unknown directions: motion [m], largest tension [N]."""
LAGS = 5  # autocovariances that are used, from lag 0 on
SMOOTHING = 0.2
"""Share of an innovation that the fixed-gain filter takes into its level."""


class LinearModel(NamedTuple):
    """x' = A x + G w, y = C x + v, and the gain L of x^ + L (y - C x^)."""

    transition: FloatArray  # A (k, k)
    disturbance: FloatArray  # G (k, g)
    output: FloatArray  # C (p, k)
    gain: FloatArray  # L (k, p); A - A L C must be stable


def trend_model(factors: ArrayLike) -> LinearModel:
    """Return one tension with a trend, measured by sensors at known factors (m,)."""
    factor = np.asarray(factors, dtype=float)
    shares = 1.0 / (factor * factor.size)
    root = 1.0 - np.sqrt(1.0 - SMOOTHING)  # critically damped
    return LinearModel(
        transition=np.array([[1.0, 1.0], [0.0, 1.0]]),
        disturbance=np.array([[0.5], [1.0]]),
        output=np.column_stack([factor, np.zeros_like(factor)]),
        gain=np.outer([SMOOTHING, root**2], shares),
    )


def innovations(model: LinearModel, readings: ArrayLike) -> FloatArray:
    """Compute the innovations of the fixed-gain filter, (samples, p).

    It starts from the smallest state that fits the first reading best; its first
    innovations, until it has settled, are of no use for autocovariances.
    """
    measured = np.asarray(readings, dtype=float)
    state = np.linalg.lstsq(model.output, measured[0], rcond=None)[0]
    rows = []
    for reading in measured:
        rows.append(reading - model.output @ state)
        state = model.transition @ (state + model.gain @ rows[-1])
    return np.array(rows)


def autocovariances(model: LinearModel) -> FloatArray:
    """Return the autocovariances of the innovations per unit of every variance.

    They are (lags * p * p, g + p): columns are the unknown variances, first those of w.
    """
    a, g, c, gain = model
    through = a @ gain
    closed = a - through @ c
    sources = np.concatenate([g.T, through.T])
    columns = []
    for index, source in enumerate(sources):
        error = solve_discrete_lyapunov(closed, np.outer(source, source))
        sensor = index - g.shape[1]
        seen = np.zeros(c.shape[0])
        if sensor >= 0:
            seen[sensor] = 1.0
        column = [c @ error @ c.T + np.diag(seen)]
        # Error of the next prediction, correlated with the innovation of now.
        cross = closed @ error @ c.T - np.outer(source, seen)
        for _ in range(1, LAGS):
            column.append(c @ cross)
            cross = closed @ cross
        columns.append(np.concatenate([part.ravel() for part in column]))
    return np.column_stack(columns)


def autocovariance_least_squares(
    innovation: ArrayLike, model: LinearModel, nonnegative: bool = True
) -> tuple[FloatArray, FloatArray]:
    """Return the variances of process and sensors from one stretch of innovations.

    Innovations (samples, p) are those of the model's filter, which must be stable, in
    its steady state. Variances are kept at or above 0 where `nonnegative`, and those
    near 0 are then a little too large on average; without it they are unbiased.
    """
    rows = np.asarray(innovation, dtype=float)
    measured = [
        (rows[lag:].T @ rows[: len(rows) - lag] / (len(rows) - lag)).ravel()
        for lag in range(LAGS)
    ]
    matrix, right = autocovariances(model), np.concatenate(measured)
    # In columns of unit length: variances differ by orders of magnitude.
    size = np.linalg.norm(matrix, axis=0)
    if nonnegative:
        found = nnls(matrix / size, right)[0] / size
    else:
        found = np.linalg.lstsq(matrix / size, right, rcond=None)[0] / size
    split = model.disturbance.shape[1]
    return found[:split], found[split:]


class SensorNoise:
    """Standard deviation of every sensor, followed while the cable runs.

    It learns while the whole cable moves one way. During partial motion the sensors do
    not measure one tension; where the direction changes along the cable, it does so
    inside a segment, whose factor is then neither of the two; and at rest the tension
    of an end may change before its segment slips. Then it waits.
    """

    def __init__(
        self, cable: Cable, sensors: Sensors, *, memory: float = 300.0
    ) -> None:
        """Start from the deviations stated with three sensors or more.

        With less nothing tells whose the noise is. Friction terms beyond Coulomb's must
        be off; what was learnt has faded to 1/e after `memory` samples.
        """
        self._stated = np.array(sensors.deviation)
        self._fading = float(np.exp(-1.0 / memory))
        nodes, segments = sensors.on(cable), cable.segments
        mesh = Mesh.of(cable)
        count = nodes.size
        apart = np.eye(count - 1, count) - np.eye(count - 1, count, 1)
        self._contrast = {
            way: apart * tension_gains(mesh, np.full(segments, way), nodes)[:, -1]
            for way in (-1.0, 1.0)
        }
        size = count - 1
        self._moment = {way: np.zeros((size, size)) for way in self._contrast}
        self._weight = dict.fromkeys(self._contrast, 0.0)

    def update(self, reading: ArrayLike, direction: ArrayLike) -> None:
        """Use the sensors' readings (m,) [N] and the segments' slip (n,)."""
        sign = np.sign(np.asarray(direction, dtype=float))
        slip_direction = float(sign[0])
        if slip_direction == 0.0 or not np.all(sign == slip_direction):
            return
        for each in self._moment:
            self._moment[each] *= self._fading
            self._weight[each] *= self._fading
        contrast = self._contrast[slip_direction] @ np.asarray(reading, dtype=float)
        self._moment[slip_direction] += np.outer(contrast, contrast)
        self._weight[slip_direction] += 1.0

    @property
    def learnt(self) -> float:
        """Effective number of samples behind the estimate, old ones discounted."""
        return sum(self._weight.values())

    @property
    def deviation(self) -> FloatArray:
        """Standard deviation of every sensor (m,) [N].

        It is the stated one until ten times as many samples are learnt as there are
        sensors, and never less than a hundredth of the largest, so that no sensor is
        ever trusted alone.
        """
        stated = self._stated
        if self.learnt < 10.0 * stated.size:
            return stated
        variance = np.full(stated.size, float(np.mean(stated**2)))
        for _ in range(5):  # the weights are renewed
            variance = self._fit(variance)
        return np.sqrt(variance)

    def _fit(self, guess: FloatArray) -> FloatArray:
        """Return the variances by least squares, weighted by `guess`."""
        rows, right = [], []
        for way, weight in self._weight.items():
            if weight == 0.0:
                continue
            contrast = self._contrast[way]
            # In the coordinates in which the contrasts would be white and of unit size.
            root = np.linalg.cholesky((contrast * guess) @ contrast.T)
            white = np.linalg.solve(root, contrast)
            seen = np.linalg.solve(root, self._moment[way] / weight)
            seen = np.linalg.solve(root, seen.T)
            rows.append(np.sqrt(weight) * np.einsum("ai,bi->abi", white, white))
            right.append(np.sqrt(weight) * seen)
        matrix = np.concatenate([row.reshape(-1, guess.size) for row in rows])
        size = np.linalg.norm(matrix, axis=0)
        found = nnls(matrix / size, np.concatenate([s.ravel() for s in right]))[0]
        found = found / size
        return np.maximum(found, 1e-4 * np.max(found))


def statistics(
    lengths: tuple[int, ...] = LENGTHS, runs: int = RUNS, seed: int = 40
) -> tuple[FloatArray, FloatArray]:
    """Estimate variances [N^2] by autocovariance least squares from many recordings.

    Returns them without bounds (lengths, runs, sensors), and kept nonnegative at the
    first length (runs, sensors).
    """
    random = np.random.default_rng(seed)
    factor = _factors(1.0)
    model = trend_model(factor)
    free = np.empty((len(lengths), runs, factor.size))
    bounded = np.empty((runs, factor.size))
    for place in range(runs):
        # Variance of the steps of the rate of the tension [N^2/sample^2].
        step = np.sqrt(1e-4) * random.normal(size=max(lengths) + SETTLING_SAMPLES)
        rate = np.cumsum(step) - step
        tension = 50.0 + np.cumsum(rate + 0.5 * step)
        noise = DEVIATION * random.normal(size=(tension.size, factor.size))
        reading = tension[:, None] * factor + noise
        innovation = innovations(model, reading)[SETTLING_SAMPLES:]
        parts = [innovation[:length] for length in lengths]
        for row, part in enumerate(parts):
            free[row, place] = autocovariance_least_squares(part, model, False)[1]
        bounded[place] = autocovariance_least_squares(parts[0], model)[1]
    return free, bounded


class Drift(NamedTuple):
    """Sensors whose noise drifts, on a moving cable."""

    followed: float  # RMS of the logarithm of estimate over true deviation
    span: float  # largest over smallest true deviation
    rms: dict[str, float]  # weights to RMS error of the output where it moves [N]
    microseconds: float  # a sample takes `SensorNoise`


def drift(seconds: float = SECONDS, seed: int = 41) -> Drift:
    """Simulate drifting noise, its estimate, and weights by it; directions known."""
    time = np.arange(0.0, seconds, DT)
    true = simulate_motion(time)
    count = len(NODES)
    phase = 2.0 * np.pi * (time[:, None] / 60.0 + np.arange(count) / count)
    deviation = 0.8 * np.exp(1.2 * np.sin(phase))
    random = np.random.default_rng(seed)
    reading = true.tension[:, NODES] + deviation * random.normal(size=deviation.shape)
    sensors = Sensors(NODES, (0.8,) * count)
    noise = SensorNoise(CABLE, sensors)
    names = ("plain mean", "learnt noise", "true noise")
    fusion = {name: TensionFusion(CABLE, sensors, at_rest="hold") for name in names}
    fusion["plain mean"].weights = "mean"
    output = {name: np.empty(time.size) for name in names}
    learnt = np.empty_like(deviation)
    spent = 0.0
    samples = zip(reading, true.direction, strict=True)
    for row, (measured, direction) in enumerate(samples):
        started = clock.perf_counter()
        noise.update(measured, direction)
        if row % 20 == 0:
            fusion["learnt noise"].noise = noise.deviation
        spent += clock.perf_counter() - started
        learnt[row] = fusion["learnt noise"].noise
        fusion["true noise"].noise = deviation[row]
        for name, each in fusion.items():
            output[name][row] = each.update(measured, direction)[-1]
    late = time > 10.0
    moving = (true.direction[:, -1] != 0) & late
    errors = {n: rms((output[n] - true.tension[:, -1])[moving]) for n in names}
    followed = rms(np.log(learnt / deviation)[late])
    span = float(np.max(deviation) / np.min(deviation))
    return Drift(followed, span, errors, 1e6 * spent / time.size)


def simulate_motion(time: FloatArray) -> Replay:
    """Simulate motor and wearer that pull and release every eight seconds."""
    sweep = 0.5 * (1.0 - np.cos(2.0 * np.pi * time / 8.0))
    return replay(
        CABLE, DT, u_proximal=-0.10 * sweep, u_distal=-0.07 * sweep, profile=True
    )


WEIGHTS = (
    "plain mean", "extrapolation", "noise", "both",
    "both, extrapolation at learnt noise",
)  # fmt: skip


def weighted_errors(samples: int = 2000, seed: int = 42) -> dict[str, FloatArray]:
    """Return the RMS error of the output for four weights and movement conditions [N].

    The sensors do not know the directions, and their noise is unequal. That of the
    weights is learnt from one recording; the error of extrapolation is simulated once
    for equal sensors, as Fig. 3.8 has it.
    """
    mesh = Mesh.of(CABLE)
    unequal = np.array([0.4, 1.2, 0.3, 0.8, 2.4])
    equal = Sensors(NODES, (float(np.sqrt(np.mean(unequal**2))),) * len(NODES))
    learnt = _learn(unequal, seed)
    as_learnt = Sensors(NODES, tuple(learnt.tolist()))
    rows: dict[str, list[float]] = {name: [] for name in WEIGHTS}
    for place, directions in enumerate(CONDITIONS.values()):
        moment = Moment.of(mesh, directions(SEGMENTS), TENSION, MOTION)

        def errors(sensors: Sensors, begin: int, moment: Moment = moment) -> FloatArray:
            _, own = sensor_votes(mesh, moment, sensors, samples, seed + begin)
            return own.tension[..., -1] - moment.tension[-1]

        excess, mended = (
            excess_moment(mesh, moment, sensors, errors(sensors, begin + place))
            for sensors, begin in ((equal, 10), (as_learnt, 30))
        )
        gains = tension_gains(mesh, moment.pattern, np.array(NODES), through_rest=True)
        small, noise = (
            np.diag((gains[:, -1] * np.array(sensors.deviation)) ** 2)
            for sensors in (equal, as_learnt)
        )
        covariances = (
            np.eye(len(NODES)), excess + small, noise, excess + noise, mended + noise
        )  # fmt: skip
        error = errors(Sensors(NODES, tuple(unequal.tolist())), 20 + place)
        for name, covariance in zip(WEIGHTS, covariances, strict=True):
            rows[name].append(rms(fuse_correlated(error, covariance)))
    return {name: np.array(values) for name, values in rows.items()}


def run() -> tuple[Finding, ...]:
    free, bounded = statistics()
    drifting, weighted = drift(), weighted_errors()
    variance = DEVIATION**2
    scatter = np.std(free, axis=1)
    offset = np.mean(free - variance, axis=1) / (scatter / np.sqrt(RUNS))
    worst = float(np.max(np.abs(offset)))
    typical = scatter[:, :-1] / variance[:-1]
    slope = float(np.polyfit(np.log(LENGTHS), np.log(np.mean(typical, axis=1)), 1)[0])
    pushed = float(np.mean(bounded[:, -1]))
    off = drifting.rms
    plain, both, ours = (weighted[WEIGHTS[i]] for i in (0, 3, 4))
    others = np.min([weighted[name] for name in WEIGHTS[:3]], axis=0)
    return (
        Finding(
            f"largest mean error is {worst:.1f} standard errors; kept nonnegative, a "
            f"sensor without noise gets {pushed:.2g} N^2 at {LENGTHS[0]} samples",
            "in part" if worst < 4.0 and pushed > 0.0 else "disagrees",
            f"{RUNS} recordings of {len(LENGTHS)} lengths, 5 sensors; a bound at 0 "
            "makes variances near it too large on average",
        ),
        Finding(
            f"scatter falls as samples^{slope:.2f}, to {np.mean(typical[-1]):.1%} at "
            f"{LENGTHS[-1]}",
            "agrees" if abs(slope + 0.5) < 0.1 else "in part",
            "of a tension that follows the model's local trend",
        ),
        Finding(
            f"more than {round_down_ratio(1e3 / drifting.microseconds)} samples of 5 "
            "sensors a millisecond, in Python",
            "agrees" if drifting.microseconds < 1000.0 else "disagrees",
            timed=True,
        ),
        Finding(
            f"noise followed within {drifting.followed:.0%}, {drifting.span:.0f}-fold "
            "drift; output RMS "
            f"{off['plain mean']:.2f} N plain mean, {off['learnt noise']:.2f} N learnt "
            f"weights, {off['true noise']:.2f} N true ones",
            "agrees" if off["learnt noise"] < 0.9 * off["plain mean"] else "disagrees",
        ),
        Finding(
            f"output RMS of 4 conditions: {_listed(both)} N; plain mean "
            f"{_listed(plain)} N; noise alone {_listed(weighted['noise'])} N",
            "agrees" if np.all(both <= 1.05 * others) else "in part",
            "a matrix of equal sensors overrates extrapolation by good ones; made anew "
            f"at the learnt noise: {_listed(ours)} N",
        ),
    )


def _listed(values: FloatArray) -> str:
    return ", ".join(f"{value:.2g}" for value in values)


def _factors(slip_direction: float) -> FloatArray:
    """Return the tension at each sensor per output tension."""
    directions = np.full(SEGMENTS, slip_direction)
    return 1.0 / tension_gains(Mesh.of(CABLE), directions, np.array(NODES))[:, -1]


def _learn(deviation: FloatArray, seed: int) -> FloatArray:
    """Learn the deviations of the sensors from one recording of 4000 samples."""
    random = np.random.default_rng(seed)
    factor = _factors(-1.0)
    time = np.arange(4000) * DT
    tension = 20.0 + 5.0 * np.sin(2.0 * np.pi * time / 8.0)
    noise = deviation * random.normal(size=(time.size, deviation.size))
    model = trend_model(factor)
    innovation = innovations(model, tension[:, None] * factor + noise)
    settled = innovation[SETTLING_SAMPLES:]
    return np.sqrt(autocovariance_least_squares(settled, model)[1])
