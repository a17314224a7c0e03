"""Wrong models: what a controller believes of the cables differs with every seed."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cc_mujoco.checks import parameter
from cc_mujoco.control import CableDrive, Drive
from cc_mujoco.transmission import Cable

MOST = 3.0
"""Draws beyond this many standard deviations are cut."""


@dataclass(frozen=True)
class Mismatch:
    """Standard deviations of the relative errors of a model, drawn for every cable."""

    friction: float = 0.1
    """Of both friction coefficients."""
    stiffness: float = 0.1
    """Of the axial stiffness."""
    pretension: float = 0.1
    """Of the pretension."""
    bias: float = 0.0
    """Relative error of friction that is the same for all, added to the draw."""

    def __post_init__(self) -> None:
        """Refuse errors that leave nothing of a parameter."""
        for name in ("friction", "stiffness", "pretension"):
            parameter(self, name, 0.0, 0.3, "")
        parameter(self, "bias", -0.9, 5.0, "")

    def believed(self, drive: Drive, seeds: Sequence[int]) -> Drive:
        """The drive with the model that goes with every seed."""
        rows = []
        for seed in seeds:
            random = np.random.default_rng([seed, 2])
            rows.append(
                tuple(
                    CableDrive(
                        self._wrong(s.cable, random.normal(size=3).tolist()),
                        s.proximal,
                        s.distal,
                    )
                    for s in drive.cables
                )
            )
        return dataclasses.replace(drive, cable_drives=tuple(rows))

    def _wrong(self, cable: Cable, draw: list[float]) -> Cable:
        friction, stiffness, pretension = (max(min(d, MOST), -MOST) for d in draw)
        factor = max(1.0 + self.bias + self.friction * friction, 0.05)
        return cable.replace(
            friction=factor * cable.friction,
            static_friction=factor * cable.static_friction,
            axial_stiffness=(1.0 + self.stiffness * stiffness) * cable.axial_stiffness,
            pretension=(1.0 + self.pretension * pretension) * cable.pretension,
        )
