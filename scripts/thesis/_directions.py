r"""Directions of slip by every sensor on its own, and those that all agree on (3.2.2).

Without directions each sensor solves the cable by itself. Given the encoder's
displacement of the proximal end and the tension at its node, a sign pattern decides all
tensions (2.10) and, by the stretch from the encoder on (2.12), all displacements; it
stands if every segment then moves as assumed (2.25), compared with the displacements of
the estimate before. All sensors start from the same estimate before, the fused one.

The system 2.13 with these two constraints is triangular, so it is solved here by
running sums for all sensors, patterns and instants at once; `thesis._literal_solver`
solves it with matrices, to the same numbers.

A sensor that does not know the directions of slip carries its reading to another node
by directions that its own noise has bent (Fig. 3.8). The error of that comes on top of
the carried noise itself. Both together weight the sensors at each node: generalised
least squares.

Motion here means one instant of a cable that moves as a whole. Of the four conditions
two are uniform; in the other two the ends move in opposite directions and the middle
stands still: away from each other (stretching) or towards each other (compressing).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.estimation._fusion import fuse, tension_gains
from cc_mujoco.native import FloatArray
from thesis._literal_solver import Constraint, Standing, sign_patterns, solve


class OwnSolutions(NamedTuple):
    """The solution of the cable by each sensor alone."""

    tension: FloatArray  # of the nodes (..., m, n + 1) [N]
    pattern: FloatArray  # directions of the segments (..., m, n)
    # how many sign patterns are consistent (..., m); the first one stands
    fitting: NDArray[np.intp]


def node_displacements(
    mesh: Mesh, pattern: FloatArray, tension: FloatArray, u_proximal: ArrayLike
) -> FloatArray:
    """Return node displacements (..., n + 1) [m], from the encoder on (2.12)."""
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
    """Solve a wholly moving cable once per sensor, at nodes (m,).

    Given are displacements of the nodes an instant ago (..., n + 1) [m], of the
    proximal end now (...,) [m], and the tension at every sensor (..., m) [N]. The
    pattern `first` (n,), the last one found, is tried before all others. Returns the
    first consistent pattern of each sensor, else the one whose contradicting segments
    move least.
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
    return OwnSolutions(
        tension=np.take_along_axis(tension, best[..., None, None], -2)[..., 0, :],
        pattern=patterns[best],
        fitting=np.count_nonzero(wrong == 0.0, axis=-1),
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

    Of an even number it is the lower one of the middle two, so that it is the value of
    at least one sensor.
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
        """Return the moment in which the proximal end moves by `motion` > 0 [m].

        The cable stands still where directions meet. They change once at most; where
        they do not, tensions do not change in time. `tension` is the largest one along
        the cable [N].
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


CHUNK_SIZE = 250  # instants solved at once, which bounds the memory


def sensor_votes(
    mesh: Mesh, moment: Moment, sensors: Sensors, samples: int, seed: int
) -> tuple[FloatArray, OwnSolutions]:
    """Return readings (samples, m) [N] of an instant, and own solutions of sensors."""
    random, nodes = np.random.default_rng(seed), np.array(sensors.nodes)
    noise = random.normal(size=(samples, nodes.size)) * np.array(sensors.deviation)
    reading = moment.tension[nodes] + noise
    parts = [
        own_solutions(
            mesh, moment.before, np.full(len(part), moment.displacement[0]), part,
            nodes, first=moment.pattern,
        )
        for part in np.array_split(reading, -(-samples // CHUNK_SIZE))
    ]  # fmt: skip
    own = OwnSolutions(*map(np.concatenate, zip(*parts, strict=True)))
    return reading, own


def excess_moment(
    mesh: Mesh, moment: Moment, sensors: Sensors, error: FloatArray
) -> FloatArray:
    """Return the second moment (m, m) [N^2] of errors less the carried noise.

    Errors (samples, m) are of the output tension by each sensor's own solution. The
    moment is positive semidefinite; a constant error counts in full.
    """
    nodes = np.array(sensors.nodes)
    gain = tension_gains(mesh, moment.pattern, nodes, through_rest=True)[:, -1]
    found = error.T @ error / len(error)
    found -= np.diag((gain * np.array(sensors.deviation)) ** 2)
    value, vector = np.linalg.eigh(found)
    return (vector * np.maximum(value, 0.0)) @ vector.T


def fuse_correlated(estimates: FloatArray, covariance: FloatArray) -> FloatArray:
    """Fuse estimates (..., m) of one tension by generalised least squares [N]."""
    weight = np.linalg.solve(covariance, np.ones(estimates.shape[-1]))
    return estimates @ (weight / np.sum(weight))


class SensorConsensus:
    """Estimate of all tensions from an encoder and noisy tension sensors alone.

    While the whole cable moves, every sensor finds its own directions; the most common
    ones are taken, and all sensors are carried by the one matrix of these. To leave out
    sensors that disagree would bias the estimate, because those that read too low (or
    too high) are the ones that disagree.

    During partial motion the encoder alone decides how far the motion from the proximal
    end has come. From the distal end every sensor that is known to move (or, when none
    is, the most distal one) says how far: 0 if its tension changed against the common
    direction, else up to the node where inequality 2.17 stops it. The median counts.

    Chosen where the text is silent: an encoder that stands or turns ends mass motion;
    equal votes leave a direction as it was; sensors start from the fused estimate
    before. In the text a sensor always believes that it moves, because its noise does;
    but a cable that has moved as a whole is everywhere about to slip, so that the
    slightest noise sets all of a resting cable in motion. So a sensor is silent here
    while its reading is within `threshold` standard deviations of the estimate, which
    holds; 0 is the rule of the text.

    Attributes:
        tension: of every node (n + 1,) [N].
        displacement: of every node (n + 1,) [m], from the unstrained cable.
        direction: of every segment (n,), 0 where at rest.
        last_moving: how many nodes move, from the proximal and from the distal end.
    """

    def __init__(
        self,
        cable: Cable,
        sensors: Sensors,
        *,
        likeliest: bool = False,
        threshold: float = 3.0,
    ) -> None:
        """Start at rest in the pretension of a cable without friction but Coulomb's.

        It takes the most common directions, as the thesis does, or the `likeliest`,
        those that explain all readings together best. By `threshold` of its standard
        deviations a reading must differ from the estimate to tell of motion while the
        encoder does not; 0 as the thesis.
        """
        self.threshold, self.likeliest = threshold, likeliest
        self.mesh = mesh = Mesh.of(cable)
        self.noise, self._nodes = np.array(sensors.deviation), sensors.on(cable)
        self.tension = np.full(mesh.segments + 1, float(cable.pretension))
        self.direction = np.zeros(mesh.segments)
        stretch = np.cumsum(cable.pretension * mesh.length / mesh.stiffness)
        self.displacement = np.concatenate([[0.0], stretch])
        self.last_moving = (0, 0)
        self._slip_direction = [0.0, 0.0]

    def update(self, u_proximal: float, reading: ArrayLike) -> FloatArray:
        """Return node tensions (n + 1,) [N] by encoder [m] and sensors (m,) [N]."""
        reading = np.asarray(reading, dtype=float)
        slip_direction = float(np.sign(u_proximal - self.displacement[0]))
        proximal, distal = self.last_moving
        if slip_direction != self._slip_direction[0]:
            if proximal + distal > self.mesh.segments:
                distal = 0
            proximal = 0
        self._slip_direction[0] = slip_direction
        if proximal + distal <= self.mesh.segments:
            distal = self._distal(reading, proximal, distal)
            proximal = self._proximal(u_proximal, proximal, distal)
        self.last_moving = (proximal, distal)
        moves = slip_direction != 0.0 or np.any(self._tell(reading))
        if proximal + distal > self.mesh.segments and moves:
            self._whole(u_proximal, reading)
        return self.tension

    def _tell(self, reading: FloatArray) -> NDArray[np.bool_]:
        """Return which sensors read something else than the estimate."""
        change = np.abs(reading - self.tension[self._nodes])
        return change > self.threshold * self.noise

    def _whole(self, u_proximal: float, reading: FloatArray) -> None:
        """Solve mass motion by consensus directions and one matrix for all sensors."""
        known = (self.mesh, self.displacement, u_proximal, reading, self._nodes)
        last = self.direction
        if self.likeliest:
            self.direction = likeliest_pattern(*known, self.noise, first=last)
        else:
            self.direction = majority_directions(
                own_solutions(*known, first=last).pattern, last
            )
        gain = tension_gains(self.mesh, self.direction, self._nodes, through_rest=True)
        self.tension = fuse(reading, gain, self.noise).tension
        self.displacement = node_displacements(
            self.mesh, self.direction, self.tension, u_proximal
        )

    def _proximal(self, u_proximal: float, proximal: int, distal: int) -> int:
        """Move the proximal part by the encoder; how many nodes move."""
        slip_direction, mesh = self._slip_direction[0], self.mesh
        tension, displacement = self.tension, self.displacement
        if slip_direction == 0.0:
            self.direction[: mesh.segments - max(distal - 1, 0)] = 0.0
            return 0
        proximal = max(proximal, 1)
        while proximal + distal <= mesh.segments:
            found = solve(
                mesh.part(0, proximal - 1),
                displacement[:proximal],
                [Constraint("displacement", 0, u_proximal)],
                [np.full(proximal - 1, slip_direction)],
                Standing(
                    tension[proximal], displacement[proximal], mesh.length[proximal - 1]
                ),
            )
            held = found.tension[-1] * np.exp(
                mesh.static_angle[proximal - 1] * slip_direction
            )
            if tension[proximal] * slip_direction < held * slip_direction:
                break
            proximal += 1
        else:
            self.direction[: proximal - 1] = slip_direction
            return proximal
        tension[:proximal], displacement[:proximal] = found.tension, found.displacement
        self.direction[: mesh.segments - max(distal - 1, 0)] = 0.0
        self.direction[: proximal - 1] = slip_direction
        return proximal

    def _distal(self, reading: FloatArray, proximal: int, distal: int) -> int:
        """Move the distal part by consensus of its sensors; how many nodes move."""
        n = self.mesh.segments
        known = max(n + 1 - distal if distal else int(np.max(self._nodes)), proximal, 1)
        voters = (self._nodes >= known) & self._tell(reading)
        if not np.any(voters):
            return distal
        nodes, measured = self._nodes[voters], reading[voters]
        ways = np.sign(measured - self.tension[nodes])  # more tension: pulled outwards
        slip_direction = float(np.sign(np.sum(ways))) or self._slip_direction[1]
        if slip_direction == 0.0:
            return distal
        least = distal if slip_direction == self._slip_direction[1] else 0
        votes = [
            self._reach(node, value, slip_direction, least, n + 1 - proximal)
            if own == slip_direction
            else 0
            for node, value, own in zip(nodes, measured, ways, strict=True)
        ]
        distal = median_last_moving(votes)
        self._slip_direction[1] = slip_direction
        self.direction[max(proximal - 1, 0) :] = 0.0
        if distal == 0:
            return 0
        first = n + 1 - distal
        self.direction[first:] = slip_direction
        gain = tension_gains(self.mesh, self.direction, self._nodes)[:, first:]
        tied = self._nodes >= first
        if not np.any(tied) or first == 0:
            return distal
        fused = fuse(reading[tied], gain[tied], self.noise[tied])
        self.tension[first:] = fused.tension
        last = self.tension[first - 1] + self.tension[first]
        length = self.mesh.length[first - 1]
        start = self.displacement[first - 1] + 0.5 * last * length / self.mesh.stiffness
        self.displacement[first:] = node_displacements(
            self.mesh.part(first, n), self.direction[first:], fused.tension, start
        )
        return distal

    def _reach(
        self, node: int, value: float, slip_direction: float, least: int, most: int
    ) -> int:
        """Return how many nodes from the distal end a sensor takes to move (2.17)."""
        n, mesh = self.mesh.segments, self.mesh
        depth = max(least, n + 1 - node)
        first = n + 1 - depth  # the innermost node that moves
        ahead = float(np.sum(mesh.angle[first:node]))
        tension = value * np.exp(-slip_direction * ahead)
        while depth < most:
            held = tension * np.exp(-slip_direction * mesh.static_angle[first - 1])
            if self.tension[first - 1] * slip_direction > held * slip_direction:
                break
            tension *= np.exp(-slip_direction * mesh.angle[first - 1])
            first, depth = first - 1, depth + 1
        return min(depth, most)
