"""Where the tension sensors of a cable are, and how noisy each is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco.errors import CableError
from cc_mujoco.transmission.parameters import Cable


@dataclass(frozen=True)
class Sensors:
    """Tension sensors along a cable.

    Attributes:
        nodes: node of every sensor, 0 is the proximal end.
        deviation: standard deviation of the noise of each [N].

    Raises:
        CableError: not one positive deviation per sensor, or no sensor.
    """

    nodes: tuple[int, ...]
    deviation: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.nodes or len(self.nodes) != len(self.deviation):
            raise CableError(
                f"sensors have {len(self.nodes)} nodes and {len(self.deviation)} "
                "deviations; give one of each per sensor"
            )
        for node, deviation in zip(self.nodes, self.deviation, strict=True):
            if not (np.isfinite(deviation) and deviation > 0.0):
                raise CableError(
                    f"the sensor at node {node} has deviation {deviation!r} N; "
                    "it must be positive and finite"
                )

    @classmethod
    def at(
        cls, cable: Cable, positions: Sequence[float], deviation: ArrayLike
    ) -> Sensors:
        """Sensors at the nodes nearest to these places [m] from the proximal end.

        Args:
            cable: the cable.
            positions: of the sensors along the conduit [m].
            deviation: of each (m,), or one for all [N].

        Raises:
            CableError: a place off the cable.
        """
        for position in positions:
            if not 0.0 <= position <= cable.length:
                raise CableError(
                    f"a sensor is at {position:g} m; the cable has {cable.length:g} m"
                )
        step = cable.length / cable.segments
        nodes = tuple(round(position / step) for position in positions)
        return cls(nodes, tuple(np.broadcast_to(deviation, len(nodes)).tolist()))

    @classmethod
    def everywhere(cls, cable: Cable, deviation: ArrayLike) -> Sensors:
        """One sensor at every node, with deviations (n + 1,) or one for all [N]."""
        nodes = range(cable.segments + 1)
        return cls(tuple(nodes), tuple(np.broadcast_to(deviation, len(nodes)).tolist()))

    def on(self, cable: Cable) -> NDArray[np.intp]:
        """The nodes as an array, when all of them are on the cable.

        Raises:
            CableError: a node that the cable does not have.
        """
        for node in self.nodes:
            if not 0 <= node <= cable.segments:
                raise CableError(
                    f"a sensor is at node {node}; the cable has nodes 0 to "
                    f"{cable.segments}"
                )
        return np.array(self.nodes)
