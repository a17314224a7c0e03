r"""Tensions of a cable with unknown directions of slip (3.2.2).

    consensus = SensorConsensus(cable, sensors)
    consensus.update(encoder, measured)      # in every step
    consensus.tension, consensus.direction, consensus.last_moving

While the whole cable moves, every sensor finds its own directions; the most common ones
are taken, and all sensors are carried by the one matrix of these. To leave out sensors
that disagree would bias the estimate, because those that read too low (or too high)
are the ones that disagree.

During partial motion the encoder alone decides how far the motion from the proximal end
has come. From the distal end every sensor that is known to move (or, when none is, the
most distal one) says how far: 0 if its tension changed against the common direction,
else up to the node where inequality 2.17 stops it. The median counts.

Chosen where the text is silent: an encoder that stands or turns ends mass motion; equal
votes leave a direction as it was; sensors start from the fused estimate before. In the
text a sensor always believes that it moves, because its noise does; but a cable that
has moved as a whole is everywhere about to slip, so that the slightest noise sets all
of a resting cable in motion. So a sensor is silent here while its reading is within
`threshold` standard deviations of the estimate, which holds; 0 is the rule of the text.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco.cable._parameters import Cable
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.estimation._fusion import Weights, fuse, tension_gains
from cc_mujoco.native import FloatArray
from thesis._literal_solver import Constraint, Standing, solve
from thesis.estimators._directions import (
    likeliest_pattern,
    majority_directions,
    median_last_moving,
    node_displacements,
    own_solutions,
)

Choice = Literal["vote", "likeliest"]
"""Method to find directions in mass motion: a vote, or all readings at once."""


class SensorConsensus:
    """Estimate of all tensions from an encoder and noisy tension sensors alone.

    Attributes:
        tension: of every node (n + 1,) [N].
        displacement: of every node (n + 1,) [m], from the unstrained cable.
        direction: of every segment (n,), 0 where at rest.
        last_moving: how many nodes move, from the proximal and from the distal end.
        noise: standard deviation of the sensors (m,) [N]; may be set at any time.
    """

    def __init__(
        self,
        cable: Cable,
        sensors: Sensors,
        *,
        weights: Weights = "variance",
        choice: Choice = "vote",
        threshold: float = 3.0,
    ) -> None:
        """Start at rest in the cable's pretension.

        Args:
            cable: parameters; friction terms beyond Coulomb's must be off.
            sensors: the sensors.
            weights: see `fuse`.
            choice: `"vote"` takes the most common directions, as the thesis does,
                `"likeliest"` those that explain all readings together best.
            threshold: by how many of its standard deviations a reading must differ from
                the estimate to tell of motion while the encoder does not; 0 as the
                thesis.

        Raises:
            CableError: a sensor off the cable, an unknown choice, or a threshold that
                is negative.
        """
        look_up("weights", weights, {name: name for name in get_args(Weights)})
        look_up("choice", choice, {name: name for name in get_args(Choice)})
        if not (np.isfinite(threshold) and threshold >= 0.0):
            raise CableError(f"threshold is {threshold!r}; it must be 0 or more")
        self.threshold = threshold
        self.cable = cable
        self.mesh = Mesh.of(cable)
        self.noise = np.array(sensors.deviation)
        self.weights: Weights = weights
        self.choice: Choice = choice
        self._nodes = sensors.on(cable)
        self.reset()

    def reset(self, tension: ArrayLike | None = None, u_proximal: float = 0.0) -> None:
        """Reset the cable to rest.

        Args:
            tension: of the nodes, a number or (n + 1,) [N]; default the pretension.
            u_proximal: what the encoder says [m].
        """
        n = self.mesh.segments
        start = self.cable.pretension if tension is None else tension
        self.tension = np.array(np.broadcast_to(start, n + 1), dtype=float)
        self.direction = np.zeros(n)
        self.displacement = np.empty(n + 1)
        self.displacement[0] = u_proximal
        mean = 0.5 * (self.tension[:-1] + self.tension[1:])
        stretch = np.cumsum(mean * self.mesh.length / self.mesh.stiffness)
        self.displacement[1:] = u_proximal + stretch
        self.last_moving = (0, 0)
        self._slip_direction = [0.0, 0.0]

    def update(self, u_proximal: float, reading: ArrayLike) -> FloatArray:
        """Take the encoder and the readings of the next instant.

        Args:
            u_proximal: displacement of the proximal end [m].
            reading: of every sensor (m,) [N].

        Returns:
            Tension of every node (n + 1,) [N], also kept as `tension`.

        Raises:
            CableError: not one reading per sensor.
        """
        reading = np.asarray(reading, dtype=float)
        if reading.shape != self._nodes.shape:
            raise CableError(
                f"reading has shape {reading.shape}; it must be {self._nodes.shape}"
            )
        slip_direction = float(np.sign(u_proximal - self.displacement[0]))
        proximal, distal = self.last_moving
        if (
            proximal + distal > self.mesh.segments
            and slip_direction != self._slip_direction[0]
        ):
            proximal = distal = 0
        elif slip_direction != self._slip_direction[0]:
            proximal = 0
        self._slip_direction[0] = slip_direction
        if proximal + distal <= self.mesh.segments:
            distal = self._distal(reading, proximal, distal)
            proximal = self._proximal(u_proximal, proximal, distal)
        self.last_moving = (proximal, distal)
        if proximal + distal > self.mesh.segments and (
            slip_direction != 0.0 or np.any(self._tell(reading))
        ):
            self._whole(u_proximal, reading)
        return self.tension

    def _tell(self, reading: FloatArray) -> NDArray[np.bool_]:
        """Return which sensors read something else than the estimate."""
        change = np.abs(reading - self.tension[self._nodes])
        telling: NDArray[np.bool_] = change > self.threshold * self.noise
        return telling

    def _whole(self, u_proximal: float, reading: FloatArray) -> None:
        """Solve mass motion by consensus directions and one matrix for all sensors."""
        known = (self.mesh, self.displacement, u_proximal, reading, self._nodes)
        last = self.direction
        if self.choice == "likeliest":
            self.direction = likeliest_pattern(*known, self.noise, first=last)
        else:
            self.direction = majority_directions(
                own_solutions(*known, first=last).pattern, last
            )
        gain = tension_gains(self.mesh, self.direction, self._nodes, through_rest=True)
        self.tension = fuse(reading, gain, self.noise, self.weights).tension
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
        nodes, told = self._nodes[voters], reading[voters]
        slip_directions = np.sign(
            told - self.tension[nodes]
        )  # more tension: pulled outwards
        slip_direction = (
            float(np.sign(np.sum(slip_directions))) or self._slip_direction[1]
        )
        if slip_direction == 0.0:
            return distal
        least = distal if slip_direction == self._slip_direction[1] else 0
        votes = [
            self._reach(node, value, slip_direction, least, n + 1 - proximal)
            if own == slip_direction
            else 0
            for node, value, own in zip(nodes, told, slip_directions, strict=True)
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
        fused = fuse(reading[tied], gain[tied], self.noise[tied], self.weights)
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
