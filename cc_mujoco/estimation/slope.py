r"""Slope of the logarithm of tension along the moving parts of a cable.

Where neighbouring segments slip in one direction s, (2.6) says
:math:`d \ln T / dx = s \mu / R`: the logarithm of tension is linear in whatever
parameters :math:`\mu/R` is linear in. A reading :math:`y_j = T_j + v_j` gives

.. math::
    \ln y_j + \tfrac12 (\sigma_j/T_j)^2 = c + s\,a_j^T \theta + v_j/T_j,

with the design row :math:`a_j` of its sensor and one unknown level c for every moving
part; the second term takes back, to second order, what the logarithm loses of noise on
average. Equations are weighted by :math:`(T_j/\sigma_j)^2` and freed of c by taking out
their weighted mean. The T in weights and correction is not the reading but the profile
fitted to all readings with the present :math:`\theta`: else readings that happen to be
high would count for more.

Where the motion turns it does so inside a segment, which follows neither sign: the two
segments beside a change of direction are left out. (In the first and the last segment
directions do not show it. Friction then looks smaller, by some tenths of a percent in
the wrist scene, which the deviation does not count.) A sensor whose tension is below
four times its noise is left out too.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco.compiled import FloatArray
from cc_mujoco.errors import CableError
from cc_mujoco.estimation.recursive import RecursiveLeastSquares
from cc_mujoco.estimation.samples import checked_noise, checked_sample
from cc_mujoco.sensing import Sensors
from cc_mujoco.transmission.parameter import Term
from cc_mujoco.transmission.parameters import Cable

CLEAR = 4.0
"""Tension, in standard deviations of its sensor, below which a reading says nothing."""

_FREAK = 0.05
"""Share of the fitted tension below which a reading is left out (no logarithm)."""


class Run(NamedTuple):
    """Neighbouring segments that slip one way; their nodes are first to last."""

    first: int
    last: int
    sign: float


def moving_runs(direction: ArrayLike) -> Iterator[Run]:
    """Parts of a cable in which the capstan law holds with one sign.

    Args:
        direction: slip of every segment, -1, 0 or 1, (n,).
    """
    sign = np.sign(np.asarray(direction, dtype=float))
    edges = [0, *(np.flatnonzero(np.diff(sign)) + 1).tolist(), sign.size]
    for first, last in pairwise(edges):
        slip_direction = float(sign[first])
        if slip_direction == 0.0:
            continue
        begin = first + int(first > 0 and sign[first - 1] == -slip_direction)
        end = last - int(last < sign.size and sign[last] == -slip_direction)
        if begin < end:
            yield Run(begin, end, slip_direction)


def require_slope(cable: Cable) -> None:
    """Refuse a cable whose moving parts do not all have the slope s mu/R.

    A coefficient that changes with time, all along, may be followed.

    Raises:
        CableError: drag that needs no tension, or a coefficient that changes with
            anything but time.
    """
    cable.require_terms(
        _has_slope, "the slope of the logarithm of tension is not that of friction then"
    )


def _has_slope(term: Term) -> bool:
    if term.acts_on == "coefficient":
        return set(term.depends_on) <= {"time"}
    return term.acts_on != "drag"


class SlopeFit:
    """Recursive fit of parameters that the logarithm of tension is linear in.

    Attributes:
        fit: the recursion.
    """

    def __init__(
        self,
        cable: Cable,
        sensors: Sensors,
        design: FloatArray,
        fit: RecursiveLeastSquares,
        memory: float,
    ) -> None:
        """Prepare.

        Args:
            cable: the cable.
            sensors: at least two.
            design: change of the logarithm of tension, from the proximal end to every
                node, per parameter in motion towards distal (n + 1, p).
            fit: the recursion.
            memory: of the misfit, in samples.

        Raises:
            CableError: fewer than two sensors, one off the cable, or as
                `require_slope`.
        """
        if len(set(sensors.nodes)) < 2:
            raise CableError(
                f"sensors are at nodes {list(sensors.nodes)}; a slope takes at least "
                "two different ones"
            )
        require_slope(cable)
        self.fit = fit
        self._segments = cable.segments
        self._nodes: NDArray[np.intp] = sensors.on(cable)
        self.noise = np.array(sensors.deviation)
        self.lay(design)
        self._fading = float(np.exp(-1.0 / memory))
        self.reset()

    def lay(self, design: FloatArray) -> None:
        """Take another path: the design from now on (n + 1, p)."""
        self._design = design[self._nodes]

    def reset(self) -> None:
        """Return to the start; the noise stays."""
        self.fit.reset()
        self._squares, self._count = 0.0, 0.0

    @property
    def misfit(self) -> float:
        """RMS residual over the stated noise: near 1 where law and noise are right.

        NaN before the first informative sample.
        """
        if self._count == 0.0:
            return float("nan")
        return float(np.sqrt(self._squares / self._count))

    @property
    def noise(self) -> FloatArray:
        """Standard deviation of the sensors (m,) [N]; may be set at any time.

        Raises:
            CableError: set to other than one positive number per sensor.
        """
        return self._noise

    @noise.setter
    def noise(self, deviation: ArrayLike) -> None:
        self._noise = checked_noise(deviation, self._nodes.size)

    def update(self, reading: ArrayLike, direction: ArrayLike) -> None:
        """Take the readings of the next instant.

        Args:
            reading: of every sensor (m,) [N].
            direction: slip of every segment, -1, 0 or 1, (n,).

        Raises:
            CableError: shapes that fit neither the sensors nor the cable, or values
                that are not finite.
        """
        told, slip_direction = checked_sample(
            reading, direction, self._nodes.size, self._segments
        )
        width = self._design.shape[1]
        information, target = np.zeros((width, width)), np.zeros(width)
        power, count = 0.0, 0
        for run in moving_runs(slip_direction):
            found = self._equations(run, told)
            if found is not None:
                rows, right = found
                information += rows.T @ rows
                target += rows.T @ right
                power += float(right @ right)
                count += right.size - 1
        if count == 0 or not np.any(information):
            return
        self.fit.update(information, target)
        value = self.fit.value
        squares = power + float(value @ (information @ value - 2.0 * target))
        self._squares = self._fading * self._squares + max(squares, 0.0)
        self._count = self._fading * self._count + count

    def _equations(
        self, run: Run, reading: FloatArray
    ) -> tuple[FloatArray, FloatArray] | None:
        """Rows and right sides of one moving part, noise 1, free of the level."""
        inside = np.flatnonzero((self._nodes >= run.first) & (self._nodes <= run.last))
        if inside.size < 2:
            return None
        rows = run.sign * self._design[inside]
        told, noise = reading[inside], self._noise[inside]
        log_profile = rows @ self.fit.value
        profile = np.exp(log_profile - np.max(log_profile)) / noise
        level = float(profile @ (told / noise)) / float(profile @ profile)
        clear = level * profile  # T over its noise
        good = (clear >= CLEAR) & (told > _FREAK * clear * noise)
        if np.count_nonzero(good) < 2:
            return None
        clear = clear[good]
        weight = clear**2
        right = np.log(told[good]) + 0.5 / weight
        rows = rows[good]
        total = float(np.sum(weight))
        rows = clear[:, None] * (rows - weight @ rows / total)
        return rows, clear * (right - float(weight @ right) / total)


class SlopeEstimator:
    """What estimators that rest on a `SlopeFit` have in common."""

    def __init__(self, slope: SlopeFit) -> None:
        """Start from the fit's guess."""
        self._slope = slope

    def reset(self) -> None:
        """Return to the guess; the noise stays."""
        self._slope.reset()

    @property
    def misfit(self) -> float:
        """RMS residual over the stated noise; near 1 where law and noise are right."""
        return self._slope.misfit

    @property
    def noise(self) -> FloatArray:
        """Standard deviation of the sensors (m,) [N]; may be set at any time."""
        return self._slope.noise

    @noise.setter
    def noise(self, deviation: ArrayLike) -> None:
        self._slope.noise = deviation
