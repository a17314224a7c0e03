r"""Unscented filter on the parameters of a cable: any of them, from its ends alone.

    estimator = UnscentedEstimator(
        cable, ("friction", "axial_stiffness"), dt=0.005, noise=0.5
    )
    estimator.over(u_proximal, u_distal, tension_proximal, tension_distal)
    estimator.value, estimator.deviation

The thesis names it as the alternative to an update law (3.2.3; Srang and Yamakita,
Proc. ACC 2014; Julier and Uhlmann, Proc. IEEE 92, 2004; Wan and van der Merwe, Proc.
AS-SPCC 2000). The state of the filter are the logarithms of the parameters, a random
walk; the measurement model is the cable itself, driven by what is measured at its ends.
It needs no sensors along the cable and no directions of slip.

Every window is linearized again around what it has just taught, until that settles
(Garcia-Fernandez, Svensson, Morelande and Sarkka, IEEE Trans. Signal Process. 63,
2015). The plain filter, one linearization around what was known before, errs by its
curvature in the first windows, and believes later that it knew better.

The profile of tension that stands in the conduit is not in the state: each sigma point
has its own, replayed from the last moment that fixes it (`History`).
The first sample after a reset must be at rest in the pretension. Within a window and
back to that moment parameters are taken as constant: what they drift meanwhile is not
in the deviation that the filter states.

The unscented transform is read as statistical linear regression: what a function does
to a normal distribution, as a straight line and the covariance of what the line leaves.

A cable has a memory, the profile of tension that stands in its conduit. It ends
whenever the whole cable slips one way: what the profile is then follows from the
cable's length and its parameters alone. The latest such sample, the anchor, is where
replays begin, so a cable that goes to and fro has at most one stroke to replay. Until
there is an anchor they begin at the first sample, which must be at rest in the
pretension. Friction terms beyond Coulomb's, which remember more, must be off.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.cable._cable import PARAMETERS, Cable
from cc_mujoco.cable._conduit import Replay, node_lengths, replay
from cc_mujoco.estimation._tracks import EstimateTrack, wrap_angles
from cc_mujoco.native import FloatArray


def square_root(covariance: FloatArray) -> FloatArray:
    """Return A with A A' = covariance, also if rounding left it slightly indefinite."""
    symmetric = 0.5 * (covariance + covariance.T)
    try:
        return np.linalg.cholesky(symmetric)
    except np.linalg.LinAlgError:
        size, axes = np.linalg.eigh(symmetric)
        return axes * np.sqrt(np.maximum(size, 0.0))


def sigma_points(mean: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the mean and 2 p points around it (2 p + 1, p).

    With the scaling of Wan and van der Merwe (Proc. AS-SPCC 2000) at alpha = 1,
    kappa = 0, where no weight is negative, so that every covariance made of them is
    one. The mean itself then counts for covariances only.
    """
    reach = np.sqrt(mean.size) * square_root(covariance).T
    return np.concatenate([mean[None], mean + reach, mean - reach])


class Linearization(NamedTuple):
    """Linear approximation near a normal distribution: slope x + offset + residual."""

    slope: FloatArray  # (k, p)
    offset: FloatArray  # (k,)
    root: FloatArray  # of the covariance of the residual, root root' (k, 2 p + 1)


def linearize(points: FloatArray, values: FloatArray) -> Linearization:
    """Return a statistical linear regression of values (2 p + 1, k) at sigma points."""
    size = points.shape[1]
    # For a normal distribution.
    weight = np.concatenate([[2.0], np.full(2 * size, 0.5 / size)])
    mean, middle = np.mean(points[1:], axis=0), np.mean(values[1:], axis=0)
    shift, change = points - mean, values - middle
    cross = (weight * change.T) @ shift
    covariance = (weight * shift.T) @ shift
    slope = cross @ np.linalg.pinv(covariance, rcond=1e-12, hermitian=True)
    root = np.sqrt(weight) * (change - shift @ slope.T).T
    return Linearization(slope, middle - slope @ mean, root)


def kalman_gain(
    line: Linearization, covariance: FloatArray, variance: FloatArray
) -> FloatArray:
    """Return the Kalman gain (p, k) of a linearized measurement with noise.

    By Woodbury's identity, so that no matrix of the size of the measurement is solved;
    `covariance` is of the state before, `variance` of the noise (k,).
    """
    scale = np.sqrt(variance)[:, None]
    slope = line.slope / scale
    known = np.concatenate([slope @ square_root(covariance), line.root / scale], axis=1)
    inner = np.eye(known.shape[1]) + known.T @ known
    wanted = slope @ covariance
    gain: FloatArray = wanted - known @ np.linalg.solve(inner, known.T @ wanted)
    gain /= scale
    return gain.T


class History:
    """Displacements [m] and tensions [N] of both ends since the anchor."""

    def __init__(self, cable: Cable, dt: float) -> None:
        """Start empty, for samples `dt` apart [s] of a path and its segments."""
        self._dt = dt
        self._angle, self._share = wrap_angles(cable), node_lengths(cable)
        self._rows: list[tuple[float, ...]] = []
        self._slip_direction = 0.0
        self._origin: float | None = None

    def add(self, *sample: float) -> None:
        """Append displacements [m] and tensions [N] of both ends, proximal first."""
        self._rows.append(sample)
        if self._origin is None:
            self._origin = sample[1] - sample[0]

    def measured(self, count: int) -> FloatArray:
        return np.array(self._rows[-count:])[:, 2:].T.ravel()

    def replay(self, cable: Cable) -> Replay:
        proximal, distal = np.array(self._rows)[:, :2].T
        profile = np.exp(self._slip_direction * cable.friction * self._angle)
        strain = cable.pretension * cable.length / cable.axial_stiffness
        longer = float(distal[0] - proximal[0]) - (self._origin or 0.0)
        stretch = max(strain + longer, 0.0)
        profile *= stretch * cable.axial_stiffness / float(self._share @ profile)
        return replay(
            cable, self._dt, initial_tension=profile, u_proximal=proximal,
            u_distal=distal,
        )  # fmt: skip

    def drop_old_samples(
        self, cables: Sequence[Cable], played: Sequence[Replay]
    ) -> None:
        """Drop the samples before the latest anchor of these replays."""
        slip_direction = _whole_slip_direction(cables, played)
        anchors = np.flatnonzero(slip_direction)
        if anchors.size > 0:
            first = int(anchors[-1])
            self._slip_direction = float(slip_direction[first])
            self._rows = self._rows[first:]


def _whole_slip_direction(
    cables: Sequence[Cable], played: Sequence[Replay]
) -> FloatArray:
    """Return the direction in which the whole cable slips in every sample, or 0.

    It counts where all cables agree and where the tensions of the ends are those of
    the capstan law, so that no change of direction hides in a segment.
    """
    slip_directions = []
    for cable, motion in zip(cables, played, strict=True):
        proximal, distal = motion.tension_proximal, motion.tension_distal
        taut = (proximal > 0.0) & (distal > 0.0) & (motion.moving_fraction == 1.0)
        ratio = np.log(np.where(taut, distal, 1.0) / np.where(taut, proximal, 1.0))
        whole = cable.friction * cable.wrap
        right = taut & (np.abs(np.abs(ratio) - whole) < 1e-6 * whole)
        slip_directions.append(np.where(right, np.sign(ratio), 0.0))
    agreed = np.all(np.array(slip_directions) == slip_directions[0], axis=0)
    return np.where(agreed, slip_directions[0], 0.0)


CONVERGED_SIGMAS, ROUNDS = 0.1, 8
"""Change of the mean, in standard deviations, below which a window is done; most
linearizations of one window."""
SPREAD = 0.5  # standard deviation of the logarithms of the guess


class UnscentedEstimator:
    """Parameters of a cable as a random walk, measured by replaying it.

    Attributes:
        mean: logarithms of the parameters (p,).
        covariance: of their errors (p, p).
    """

    def __init__(
        self,
        cable: Cable,
        names: Sequence[str],
        dt: float,
        *,
        noise: float,
        drift: ArrayLike = 0.0,
        window: int = 50,
    ) -> None:
        """Start from the cable's own values of the named parameters, each above 0.

        Names are of `PARAMETERS`; samples are `dt` apart [s], `window` of them from one
        estimate to the next. The standard deviation of both tensions is `noise` [N],
        that of the random walk of the logarithms in the root of a second `drift`.
        """
        table = {parameter.name: parameter for parameter in PARAMETERS}
        self.cable, self.names = cable, tuple(names)
        self._variance = np.full(2 * window, noise**2)
        self._history = History(cable, dt)
        self._dt, self._window = dt, window
        self._drift = np.asarray(drift, dtype=float)
        self._low = np.log([max(table[name].low, 1e-9) for name in names])
        self._bound = np.array([table[name].high for name in names])
        self._high = np.log(self._bound)
        self.mean = np.log([getattr(self.cable, name) for name in self.names])
        self.covariance = np.diag(np.full(self.mean.size, SPREAD**2))
        self._fresh = 0

    @property
    def value(self) -> FloatArray:
        """Estimates (p,), medians of their distributions, in SI units."""
        return np.exp(self.mean)

    @property
    def deviation(self) -> FloatArray:
        """Standard deviation of every estimate's error (p,), in its unit."""
        return np.exp(self.mean) * np.sqrt(np.diag(self.covariance))

    def over(self, *recording: ArrayLike) -> EstimateTrack:
        """Run over displacements and tensions of both ends (samples,).

        Estimates change at every `window`-th sample.
        """
        found = []
        for sample in zip(
            *(np.asarray(one).tolist() for one in recording), strict=True
        ):
            self._history.add(*sample)
            self._fresh += 1
            if self._fresh == self._window:
                self._assimilate()
                self._fresh = 0
            found.append((self.value, self.deviation))
        track = np.array(found)
        return EstimateTrack(track[:, 0], track[:, 1])

    def _assimilate(self) -> None:
        """Run one cycle of the filter over the samples of a window."""
        count = self._window
        measured = self._history.measured(count)
        wander = np.broadcast_to(self._drift**2 * count * self._dt, self.mean.shape)
        prior, spread = self.mean, self.covariance + np.diag(wander)
        mean, covariance = prior, spread
        for _ in range(ROUNDS):
            points = sigma_points(mean, covariance)
            points = np.clip(points, self._low, self._high)
            cables = [self._cable(point) for point in points]
            played = [self._history.replay(cable) for cable in cables]
            answers = [
                (motion.tension_proximal[-count:], motion.tension_distal[-count:])
                for motion in played
            ]
            line = linearize(points, np.reshape(answers, (len(points), -1)))
            gain = kalman_gain(line, spread, self._variance)
            last = mean
            mean = prior + gain @ (measured - line.offset - line.slope @ prior)
            mean = np.clip(mean, self._low, self._high)
            root = square_root(spread - gain @ line.slope @ spread)
            covariance = root @ root.T
            moved = np.abs(mean - last)
            if np.all(moved < CONVERGED_SIGMAS * np.sqrt(np.diag(covariance))):
                break
        self.mean, self.covariance = mean, covariance
        self._history.drop_old_samples(cables, played)

    def _cable(self, point: FloatArray) -> Cable:
        # Rounding must not take a logarithm at its bound out of bounds.
        values = np.minimum(np.exp(point), self._bound)
        return self.cable.replace(**dict(zip(self.names, values.tolist(), strict=True)))
