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

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.estimation._fusion import fuse, tension_gains
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
    """

    def __init__(
        self,
        cable: Cable,
        sensors: Sensors,
        *,
        choice: Choice = "vote",
        threshold: float = 3.0,
    ) -> None:
        """Start at rest in the cable's pretension.

        Args:
            cable: parameters; friction terms beyond Coulomb's must be off.
            choice: `"vote"` takes the most common directions, as the thesis does,
                `"likeliest"` those that explain all readings together best.
            threshold: by how many of its standard deviations a reading must differ from
                the estimate to tell of motion while the encoder does not; 0 as the
                thesis.
        """
        self.threshold, self.choice = threshold, choice
        self.mesh = mesh = Mesh.of(cable)
        self.noise, self._nodes = np.array(sensors.deviation), sensors.on(cable)
        self.tension = np.full(mesh.segments + 1, float(cable.pretension))
        self.direction = np.zeros(mesh.segments)
        stretch = np.cumsum(cable.pretension * mesh.length / mesh.stiffness)
        self.displacement = np.concatenate([[0.0], stretch])
        self.last_moving = (0, 0)
        self._slip_direction = [0.0, 0.0]

    def update(self, u_proximal: float, reading: ArrayLike) -> FloatArray:
        """Take encoder [m] and sensors (m,) [N]; return the nodes' tensions [N]."""
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
        if proximal + distal > self.mesh.segments and (
            slip_direction != 0.0 or np.any(self._tell(reading))
        ):
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
        if self.choice == "likeliest":
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
