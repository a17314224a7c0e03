r"""Reliability of a sensor's own solution at other nodes (Fig. 3.8).

    moment = Moment.of(mesh, CONDITIONS["towards distal"](10), tension=50, motion=5e-4)
    error = own_errors(mesh, moment, sensors, samples=1000, seed=0)
    excess = excess_moment(mesh, moment, sensors, error)          # of the model
    fuse_correlated(told, excess[-1] + np.diag(noise_at_output))  # and of the sensors

A sensor that does not know the directions of slip carries its reading to another node
by directions that its own noise has bent. The error of that comes on top of the carried
noise itself. Both together weight the sensors at each node: generalised least squares.

Motion here means one instant of a cable that moves as a whole. Of the four conditions
two are uniform; in the other two the ends move in opposite directions and the middle
stands still: away from each other (stretching) or towards each other (compressing).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.estimation._fusion import tension_gains
from cc_mujoco.native import FloatArray
from thesis.estimators._directions import node_displacements, own_solutions


def _opposed_directions(n: int, near: float) -> FloatArray:
    return near * np.where(np.arange(n) < n // 2, 1.0, -1.0)


CONDITIONS: dict[str, Callable[[int], FloatArray]] = {
    "towards distal": lambda n: np.ones(n),
    "towards proximal": lambda n: -np.ones(n),
    "stretching": lambda n: _opposed_directions(n, -1.0),
    "compressing": lambda n: _opposed_directions(n, 1.0),
}
"""The four movement conditions: number of segments to their directions."""


class Moment(NamedTuple):
    """One instant of mass motion, exact by (2.10) and (2.12)."""

    pattern: FloatArray  # direction of every segment (n,)
    before: FloatArray  # displacement of the nodes an instant ago (n + 1,) [m]
    displacement: FloatArray  # now (n + 1,) [m]
    tension: FloatArray  # now (n + 1,) [N]

    @classmethod
    def of(
        cls, mesh: Mesh, pattern: FloatArray, tension: float, motion: float
    ) -> Moment:
        """Return the moment in which the proximal end moves.

        The cable stands still where directions meet.

        Args:
            pattern: directions, with at most one change; tensions do not change in time
                where there is none.
            tension: the largest one along the cable [N].
            motion: of the proximal end in that instant, > 0 [m].
        """
        profile = tension_gains(mesh, pattern, np.array([0]), through_rest=True)[0]
        profile /= np.max(profile)
        step = motion * pattern[0]
        stretch = node_displacements(mesh, pattern, profile, 0.0)
        turn = int(np.argmax(pattern != pattern[0]))
        growth = -step / stretch[turn] if turn else 0.0
        now = node_displacements(mesh, pattern, tension * profile, step)
        before = node_displacements(mesh, pattern, (tension - growth) * profile, 0.0)
        return cls(pattern, before, now, tension * profile)


def own_errors(
    mesh: Mesh, moment: Moment, sensors: Sensors, samples: int, seed: int
) -> FloatArray:
    """Return errors (samples, m, n + 1) [N] of solutions from the true state before."""
    random = np.random.default_rng(seed)
    nodes = np.array(sensors.nodes)
    noise = random.normal(size=(samples, nodes.size)) * np.array(sensors.deviation)
    own = own_solutions(
        mesh,
        moment.before,
        np.full(samples, moment.displacement[0]),
        moment.tension[nodes] + noise,
        nodes,
        first=moment.pattern,
    )
    return own.tension - moment.tension


def excess_moment(
    mesh: Mesh, moment: Moment, sensors: Sensors, error: FloatArray
) -> FloatArray:
    """Return the second moment of the errors of `own_errors` less the carried noise.

    It is (n + 1, m, m) [N^2], positive semidefinite; a constant error counts in full.
    """
    nodes = np.array(sensors.nodes)
    gain = tension_gains(mesh, moment.pattern, nodes, through_rest=True)
    carried = (gain * np.array(sensors.deviation)[:, None]) ** 2
    found = np.einsum("sik,sjk->kij", error, error) / len(error)
    diagonal = np.arange(gain.shape[0])
    found[:, diagonal, diagonal] -= carried.T
    value, vector = np.linalg.eigh(found)
    return np.einsum("kia,ka,kja->kij", vector, np.maximum(value, 0.0), vector)


def fuse_correlated(
    told: ArrayLike, covariance: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Fuse estimates (..., m) of one tension by generalised least squares.

    Returns the tension (...,) [N] and the weights (m,), which add up to 1.
    """
    told, covariance = np.asarray(told, dtype=float), np.asarray(covariance, float)
    weight = np.linalg.solve(covariance, np.ones(told.shape[-1]))
    weight /= np.sum(weight)
    return told @ weight, weight
