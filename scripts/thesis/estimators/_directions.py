r"""Directions of slip by every sensor on its own, and those that all agree on.

    own = own_solutions(mesh, before, u_proximal, reading, sensors.on(cable))
    pattern = majority_directions(own.pattern)

3.2.2 of the thesis: without directions each sensor solves the cable by itself. Given
the encoder's displacement of the proximal end and the tension at its node, a sign
pattern decides all tensions (2.10) and, by the stretch from the encoder on (2.12), all
displacements; it stands if every segment then moves as assumed (2.25), compared with
the displacements of the estimate before. All sensors start from the same estimate
before, the fused one.

The system 2.13 with these two constraints is triangular, so it is solved here by
running sums for all sensors, patterns and instants at once;
`thesis._literal_solver` solves it with matrices, to the same numbers.

How reliable such a solution is at other nodes (Fig. 3.8):

    moment = Moment.of(mesh, CONDITIONS["towards distal"](10), tension=50, motion=5e-4)
    error = own_errors(mesh, moment, sensors, samples=1000, seed=0)
    excess = excess_moment(mesh, moment, sensors, error)          # of the model
    fuse_correlated(estimates, excess[-1] + np.diag(noise_at_output))  # and sensors

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
from numpy.typing import ArrayLike, NDArray

from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.estimation._fusion import tension_gains
from cc_mujoco.native import FloatArray
from thesis._literal_solver import sign_patterns


class OwnSolutions(NamedTuple):
    """Solutions of each sensor on its own."""

    tension: FloatArray  # of the nodes (..., m, n + 1) [N]
    displacement: FloatArray  # of the nodes (..., m, n + 1) [m]
    pattern: FloatArray  # directions of the segments (..., m, n)
    # how many sign patterns are consistent (..., m); the first one stands
    fitting: NDArray[np.intp]
    # motion against the assumed direction (..., m) [m], 0 where a pattern is consistent
    contradiction: FloatArray


def node_displacements(
    mesh: Mesh, pattern: FloatArray, tension: FloatArray, u_proximal: ArrayLike
) -> FloatArray:
    """Return the displacements of the nodes (..., n + 1) from the encoder on (2.12)."""
    stretch = tension[..., :-1] * mesh.compliance(pattern)
    u = np.empty(tension.shape)
    u[..., 0] = u_proximal
    u[..., 1:] = u[..., :1] + np.cumsum(stretch, axis=-1)
    return u


def own_solutions(
    mesh: Mesh,
    before: ArrayLike,
    u_proximal: ArrayLike,
    reading: ArrayLike,
    nodes: NDArray[np.intp],
    first: ArrayLike | None = None,
) -> OwnSolutions:
    """Solve a wholly moving cable once per sensor.

    Args:
        before: displacement of the nodes an instant ago (..., n + 1) [m].
        u_proximal: displacement of the proximal end now (...,) [m].
        reading: tension at every sensor (..., m) [N].
        nodes: of the sensors (m,).
        first: pattern that is tried before all others, the last one found (n,).

    Returns:
        The first consistent pattern of each sensor, else the one whose contradicting
        segments move least.
    """
    patterns = _ordered_patterns(mesh, first)
    ratio = tension_gains(mesh, patterns, nodes, through_rest=True).swapaxes(0, 1)
    # Axes: ..., sensor, pattern, node.
    tension = np.asarray(reading, dtype=float)[..., None, None] * ratio
    proximal = np.asarray(u_proximal, dtype=float)[..., None, None]
    u = node_displacements(mesh, patterns, tension, proximal)
    moved = u - np.asarray(before, dtype=float)[..., None, None, :]
    wrong = np.sum(_opposed_motion(patterns, moved), axis=-1)
    best = np.argmin(wrong, axis=-1)
    pick = best[..., None, None]
    return OwnSolutions(
        tension=np.take_along_axis(tension, pick, axis=-2)[..., 0, :],
        displacement=np.take_along_axis(u, pick, axis=-2)[..., 0, :],
        pattern=patterns[best],
        fitting=np.count_nonzero(wrong == 0.0, axis=-1),
        contradiction=np.take_along_axis(wrong, best[..., None], axis=-1)[..., 0],
    )


def majority_directions(pattern: ArrayLike, otherwise: ArrayLike = 1.0) -> FloatArray:
    """Return the most common direction of every segment (..., n) among the sensors.

    `otherwise` is the direction where votes are equal, (n,) or one for all.
    """
    votes = np.sum(np.asarray(pattern, dtype=float), axis=-2)
    return np.where(votes == 0.0, otherwise, np.sign(votes))


def likeliest_pattern(
    mesh: Mesh,
    before: ArrayLike,
    u_proximal: ArrayLike,
    reading: ArrayLike,
    nodes: NDArray[np.intp],
    deviation: ArrayLike,
    first: ArrayLike | None = None,
) -> FloatArray:
    """Return the pattern that best explains all readings jointly, instead of a vote.

    Each pattern is given the one tension that fits all sensors best. Its cost is what
    the readings miss by, in squared standard deviations, and so counted the farthest
    that a segment then moves against the pattern. Arguments are those of
    `own_solutions`, and the deviation of the sensors (m,) [N].
    """
    patterns = _ordered_patterns(mesh, first)
    level = np.zeros((len(patterns), mesh.segments + 1))
    np.cumsum(mesh.angle * patterns, axis=1, out=level[:, 1:])
    profile = np.exp(level)
    seen = profile[:, nodes]
    weight = seen / np.asarray(deviation, dtype=float) ** 2
    precision = np.sum(weight * seen, axis=1)
    measured = np.asarray(reading, dtype=float)
    common = measured @ weight.T / precision
    lack = (measured[..., None, :] - common[..., None] * seen) / deviation
    proximal = np.asarray(u_proximal, dtype=float)[..., None]
    u = node_displacements(mesh, patterns, common[..., None] * profile, proximal)
    wrong = _opposed_motion(patterns, u - np.asarray(before, dtype=float)[..., None, :])
    # Of a displacement now and one before, both as uncertain as the common tension.
    unit = (
        node_displacements(mesh, patterns, profile, 0.0)
        * np.sqrt(2.0 / precision)[:, None]
    )
    wrong /= 0.5 * (unit[:, :-1] + unit[:, 1:])
    cost = np.sum(lack**2, axis=-1) + np.max(wrong**2, axis=-1)
    return patterns[np.argmin(cost, axis=-1)]


def median_last_moving(last_moving: ArrayLike) -> int:
    """Return the median of the sensors' last-moving nodes (footnote 4).

    Of an even number it is the lower one of the middle two, so that it is always what
    at least one sensor believes.
    """
    ordered = np.sort(np.asarray(last_moving, dtype=int))
    return int(ordered[(ordered.size - 1) // 2])


def _ordered_patterns(mesh: Mesh, first: ArrayLike | None) -> FloatArray:
    """Return all admissible patterns, the wanted one first."""
    patterns = np.array(sign_patterns(mesh.segments))
    if first is None:
        return patterns
    same = np.all(patterns == np.asarray(first, dtype=float), axis=1)
    return patterns[np.argsort(~same, kind="stable")]


def _opposed_motion(patterns: FloatArray, moved: FloatArray) -> FloatArray:
    """Return how far each segment moves against its assumed direction [m]."""
    motion = 0.5 * (moved[..., :-1] + moved[..., 1:])
    return np.where(np.sign(motion) != patterns, np.abs(motion), 0.0)


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
        mesh, moment.before, np.full(samples, moment.displacement[0]),
        moment.tension[nodes] + noise, nodes, first=moment.pattern,
    )  # fmt: skip
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
    estimates: ArrayLike, covariance: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Fuse estimates (..., m) of one tension by generalised least squares.

    Returns the tension (...,) [N] and the weights (m,), which add up to 1.
    """
    values, covariance = np.asarray(estimates, float), np.asarray(covariance, float)
    weight = np.linalg.solve(covariance, np.ones(values.shape[-1]))
    weight /= np.sum(weight)
    return values @ weight, weight
