r"""Unscented filter on the parameters of a cable: any of them, from its ends alone.

    estimator = UnscentedEstimator(
        cable, ("friction", "axial_stiffness"), dt=0.005,
        noise={"tension_proximal": 0.5, "tension_distal": 0.5},
    )
    estimator.update(u_proximal=..., u_distal=..., tension_proximal=..., ...)
    estimator.value, estimator.covariance

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
has its own, replayed from the last moment that fixes it (`history`).
The first sample after a reset must be at rest in the pretension. Within a window and
back to that moment parameters are taken as constant: what they drift meanwhile is not
in the deviation that the filter states.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.cable._parameters import PARAMETERS, Cable
from cc_mujoco.estimation._tracks import EstimateTrack, rows
from cc_mujoco.native import FloatArray
from thesis.estimators._linearization import (
    kalman_gain,
    linearize,
    sigma_points,
    square_root,
)
from thesis.estimators._sliding_window import History

CONVERGED_SIGMAS = 0.1
"""Change of the mean, in standard deviations, below which a window is done."""


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
        noise: Mapping[str, float],
        inputs: tuple[str, str] = ("u_proximal", "u_distal"),
        spread: ArrayLike = 0.5,
        drift: ArrayLike = 0.0,
        window: int = 50,
        rounds: int = 8,
        limit: int = 5000,
    ) -> None:
        """Start from the cable's own parameters.

        Args:
            cable: the cable; values of the named parameters are the guess.
            names: of `PARAMETERS`, each greater than 0 in the cable.
            dt: time between samples [s].
            noise: standard deviation of every measured output, see `History` [N].
            inputs: what drives the model, see `History`.
            spread: standard deviation of the logarithms of the guess, or one of each.
            drift: of the random walk, of the logarithms in the root of a second.
            rounds: most linearizations of one window; 1 is the plain filter.
            limit: samples after which replays are shortened without an anchor.
        """
        table = {parameter.name: parameter for parameter in PARAMETERS}
        self.cable, self.names = cable, tuple(names)
        self._noise = np.repeat(list(noise.values()), window)
        self._history = History(cable, dt, inputs, tuple(noise), limit)
        self._dt, self._window, self._rounds = dt, window, rounds
        self._drift = np.asarray(drift, dtype=float)
        self._low = np.log([max(table[name].low, 1e-9) for name in names])
        self._bound = np.array([table[name].high for name in names])
        self._high = np.log(self._bound)
        self.mean = np.log([getattr(self.cable, name) for name in self.names])
        spread = np.broadcast_to(np.asarray(spread, dtype=float), self.mean.shape)
        self.covariance = np.diag(spread**2)
        self._fresh = 0

    @property
    def value(self) -> dict[str, float]:
        """The estimates, medians of their distributions, in SI units."""
        return dict(zip(self.names, np.exp(self.mean).tolist(), strict=True))

    @property
    def deviation(self) -> dict[str, float]:
        """Standard deviation of every estimate's error, in its unit."""
        spread = np.exp(self.mean) * np.sqrt(np.diag(self.covariance))
        return dict(zip(self.names, spread.tolist(), strict=True))

    def update(self, **sample: float) -> dict[str, float]:
        """Take inputs and outputs by name; estimates change at every `window`-th."""
        self._history.add(sample)
        self._fresh += 1
        if self._fresh == self._window:
            self._assimilate()
            self._fresh = 0
        return self.value

    def over(self, recording: Mapping[str, ArrayLike]) -> EstimateTrack:
        """Run over a recording of inputs and outputs by name, (samples,) each."""
        found = []
        for row in rows(**recording):
            value = self.update(**dict(zip(recording, map(float, row), strict=True)))
            found.append((list(value.values()), list(self.deviation.values())))
        track = np.reshape(found, (-1, 2, len(self.names)))
        return EstimateTrack(track[:, 0], track[:, 1])

    def _assimilate(self) -> None:
        """Run one cycle of the filter over the samples of a window."""
        names, count = self._history.outputs, self._window
        told = self._history.measured(count)
        wander = np.broadcast_to(self._drift**2 * count * self._dt, self.mean.shape)
        prior, spread = self.mean, self.covariance + np.diag(wander)
        mean, covariance = prior, spread
        for _ in range(self._rounds):
            points = sigma_points(mean, covariance)
            points = np.clip(points, self._low, self._high)
            cables = [self._cable(point) for point in points]
            played = [self._history.replay(cable) for cable in cables]
            said = [
                [getattr(motion, name)[-count:] for name in names] for motion in played
            ]
            line = linearize(points, np.reshape(said, (len(points), -1)))
            gain = kalman_gain(line, spread, self._noise**2)
            last = mean
            mean = prior + gain @ (told - line.offset - line.slope @ prior)
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
        changes = dict(zip(self.names, values.tolist(), strict=True))
        friction = changes.get("friction", self.cable.friction)
        static = changes.get("static_friction", self.cable.static_friction)
        if static > 0.0:
            changes["static_friction"] = max(static, friction)
        return self.cable.replace(**changes)
