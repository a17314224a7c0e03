r"""Motion of a cable's ends, replayed from where the cable's memory begins.

A cable has a memory, the profile of tension that stands in its conduit. It ends
whenever the whole cable slips one way: what the profile is then follows from the
cable's length and its parameters alone. The latest such sample, the anchor, is where
replays begin, so a cable that goes to and fro has at most one stroke to replay. Until
there is an anchor they begin at the first sample, which must be at rest in the
pretension.

Without an anchor for `limit` samples, and with friction terms beyond Coulomb's, which
remember more, replays begin with a uniform profile of the right length, and they are
wrong until the cable has next slipped as a whole.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cc_mujoco.cable._conduit import Replay, node_lengths, replay
from cc_mujoco.cable._parameters import Cable
from cc_mujoco.estimation._tracks import wrap_angles
from cc_mujoco.native import FloatArray

OUTPUTS = ("tension_proximal", "tension_distal")
"""Outputs in which a model of the cable can be compared."""

_DISPLACEMENTS = ("u_proximal", "u_distal")


class History:
    """Samples of the ends since the anchor.

    Attributes:
        inputs: what drives the cable, one of `END_QUANTITIES` per end.
        outputs: what else is measured, of `OUTPUTS`.
    """

    def __init__(
        self,
        cable: Cable,
        dt: float,
        inputs: tuple[str, str],
        outputs: Sequence[str],
        limit: int,
    ) -> None:
        """Start empty.

        Args:
            cable: the cable; only its path and its segments count.
            dt: time between samples [s].
            inputs: one displacement or tension per end; not both tensions.
            outputs: at least one of `OUTPUTS`, none of them an input.
            limit: samples after which replays are shortened without an anchor.
        """
        self.inputs, self.outputs = inputs, tuple(outputs)
        self._dt, self._limit = dt, limit
        self._angle = wrap_angles(cable)
        self._share = node_lengths(cable)
        self._rows: dict[str, list[float]] = {
            name: [] for name in (*self.inputs, *self.outputs)
        }
        self._slip_direction = 0.0
        self._origin: float | None = None

    def add(self, sample: Mapping[str, float]) -> None:
        """Take the next sample."""
        for name, given in sample.items():
            # A tension that drives the model must be one; noise may make it negative.
            least = 0.0 if name in self.inputs and name in OUTPUTS else -np.inf
            self._rows[name].append(max(float(given), least))
        if self._origin is None:
            self._origin = self._apart(0)

    def measured(self, count: int) -> FloatArray:
        """Return the last `count` samples of each output, concatenated."""
        return np.concatenate([self._rows[name][-count:] for name in self.outputs])

    def replay(self, cable: Cable) -> Replay:
        """Replay the motion of this cable from the anchor on."""
        profile = np.exp(self._slip_direction * cable.friction * self._angle)
        if self.inputs[0] == "tension_proximal":
            profile *= self._rows["tension_proximal"][0] / profile[0]
        elif self.inputs[1] == "tension_distal":
            profile *= self._rows["tension_distal"][0] / profile[-1]
        else:
            strain = cable.pretension * cable.length / cable.axial_stiffness
            stretch = max(strain + self._apart(0) - (self._origin or 0.0), 0.0)
            profile *= stretch * cable.axial_stiffness / float(self._share @ profile)
        driven: dict[str, Any] = {name: self._rows[name] for name in self.inputs}
        return replay(cable, self._dt, initial_tension=profile, **driven)

    def drop_old_samples(
        self, cables: Sequence[Cable], played: Sequence[Replay]
    ) -> None:
        """Drop the samples before the latest anchor.

        Args:
            played: what `replay` says of each.
        """
        slip_direction = _whole_slip_direction(cables, played)
        anchors = np.flatnonzero(slip_direction)
        if anchors.size > 0:
            first = int(anchors[-1])
        elif slip_direction.size > self._limit:
            # The tightest sample of the second quarter: slack has no profile.
            begin = max(slip_direction.size // 4, 1)
            end = max(slip_direction.size // 2, begin + 1)
            first = begin + int(np.argmax(played[0].tension_proximal[begin:end]))
        else:
            return
        self._slip_direction = float(slip_direction[first])
        self._rows = {name: values[first:] for name, values in self._rows.items()}

    def _apart(self, row: int) -> float:
        """Return the distance of ends that are both driven by position [m]."""
        if self.inputs != _DISPLACEMENTS:
            return 0.0
        return self._rows["u_distal"][row] - self._rows["u_proximal"][row]


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
