"""What the environment of a device observes: the one definition that all share.

Environments observe it, and a saved policy is fed it wherever it plays.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Space
from numpy.typing import NDArray

Array = NDArray[np.float64]

ACTION = Box(-1.0, 1.0, (1,), dtype=np.float32)
"""What every environment takes: the share of the motor's torque."""


@dataclass(frozen=True)
class Observed:
    """Columns of an episode log in the order in which they are observed, SI units."""

    device: str
    """Name of the device."""
    ranges: tuple[tuple[str, float], ...]
    """Columns, and the range of the sensor of each, plus or minus."""

    @property
    def space(self) -> Space[Array]:
        """The observation space of the environment."""
        space: Space[Any] = Box(-self._most, self._most, dtype=np.float64)
        return space

    @cached_property
    def _most(self) -> Array:
        return np.array([most for _, most in self.ranges])

    def of(self, columns: Mapping[str, Any]) -> Array:
        """The observation, (k,) of numbers and (n, k) of arrays over n environments.

        Args:
            columns: At least those that are observed; sensors saturate at their range.
        """
        measured = np.array([columns[name] for name, _ in self.ranges])
        # `np.clip` takes several times as long for small arrays.
        within: Array = np.minimum(
            np.maximum(np.ascontiguousarray(measured.T), -self._most), self._most
        )
        return within


def alike(one: Space[Any], other: Space[Any]) -> bool:
    """Whether a space has the shape and the bounds of another, of whatever precision.

    Bounds tell devices apart whose observations are of equal shape.
    """
    return (
        isinstance(one, Box)
        and isinstance(other, Box)
        and one.shape == other.shape
        and np.allclose(one.low, other.low)
        and np.allclose(one.high, other.high)
    )


def described(space: Space[Any]) -> str:
    """A space in few words: how many numbers, and how large."""
    if not (isinstance(space, Box) and len(space.shape) == 1):
        return f"{space}"
    least, most = (
        ", ".join(f"{value:g}" for value in bound) for bound in (space.low, space.high)
    )
    if np.array_equal(space.low, -space.high):
        return f"{space.shape[0]} numbers within +-({most})"
    return f"{space.shape[0]} numbers from ({least}) to ({most})"
