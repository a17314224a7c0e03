r"""Noise of every tension sensor, from data and while the cable runs (3.2.2).

    model = trend_model(factors)                   # of the sensors to one tension
    _, variance = autocovariance_least_squares(innovations(model, reading)[50:], model)

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

`SensorNoise` needs no model of the tension and no time to settle:

    noise = SensorNoise(cable, sensors)
    noise.update(measured, direction)        # in every step
    fusion.noise = noise.deviation           # now and then

While the whole cable slips one way all sensors measure one tension, each times a known
capstan factor, :math:`y_i = g_i T + v_i`. So :math:`y_i/g_i - y_j/g_j` holds noise
alone, whatever the tension does. The covariance of these contrasts is linear in the
variances of the sensors; they follow by least squares. Each residual is weighted by its
own statistical error under the last estimate, and old samples fade, so that it follows
sensors that change.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_discrete_lyapunov
from scipy.optimize import nnls

from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.estimation._fusion import tension_gains
from cc_mujoco.native import FloatArray

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
