"""Sensors between a device and its controller: steps, noise and delay.

Encoders count in steps; velocities are differences of counts through a low-pass. The
joint torque sensor and the tension sensors along the cables have white noise. All that
is measured, the desired torque too, comes late by whole control steps.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control import TENSIONS, Drive
from cc_mujoco.errors import CableError
from cc_mujoco.estimation.sensors import Sensors
from cc_mujoco.human.checks import parameter

Array = NDArray[np.float64]

TOLD = ("desired_torque_nm", "phase_sine", "phase_cosine")
"""What a controller is told rather than measures."""


@dataclass(frozen=True)
class Sensing:
    """How well a device is measured."""

    torque_noise: float
    """Standard deviation of the joint torque sensor [Nm]."""
    tension_noise: float
    """Standard deviation of every tension sensor [N]."""
    motor_steps: float = 16384.0
    """Steps of the motor's encoder in a turn; 0 is a perfect one, of velocity too."""
    joint_steps: float = 131072.0
    """Steps of the joint's encoder in a turn; 0 is a perfect one, of velocity too."""
    cutoff: float = 100.0
    """Of the low-pass of both velocities [Hz]; infinite for none."""
    delay: int = 1
    """Control steps by which measurements are late."""

    def __post_init__(self) -> None:
        """Refuse sensors that cannot be."""
        for name in ("torque_noise", "tension_noise"):
            parameter(self, name, 0.0, 1e6, "")
        for name in ("motor_steps", "joint_steps"):
            parameter(self, name, 0.0, 1e12, "steps")
        parameter(self, "cutoff", 1e-3, math.inf, "Hz")
        if not (isinstance(self.delay, int) and 0 <= self.delay <= 1000):
            raise CableError(
                f"Sensing.delay must be 0 to 1000 whole steps, not {self.delay!r}."
            )

    def equip(self, drive: Drive) -> Drive:
        """A drive with tension sensors at both ends and the middle of every cable."""
        deviation = max(self.tension_noise, 1e-6)
        sensors = tuple(
            Sensors((0, n // 2, n), (deviation,) * 3)
            for n in (strand.cable.segments for strand in drive.cables)
        )
        return dataclasses.replace(drive, sensors=sensors)


class Measuring:
    """Sensors of many environments during one episode."""

    def __init__(
        self,
        sensing: Sensing,
        drive: Drive,
        cables: Sequence[str],
        seeds: Sequence[int],
        steps: int,
    ) -> None:
        """Draw the noise of the episode.

        Args:
            sensing: The sensors.
            drive: With tension sensors.
            cables: Names of the cables, as in the columns.
            seeds: One per environment; each alone determines that one's noise.
            steps: Control steps of the episode.
        """
        self._sensing, self._cables = sensing, tuple(cables)
        self._nodes = [list(s.nodes) for s in drive.sensors]
        self._period = drive.period
        self._share = -math.expm1(-2.0 * math.pi * sensing.cutoff * drive.period)
        width = 1 + sum(len(nodes) for nodes in self._nodes)
        self._noise = np.stack(
            [
                np.random.default_rng([seed, 1]).normal(size=(steps + 1, width))
                for seed in seeds
            ],
            axis=1,
        )
        self._step = 0
        self._last: dict[str, Array] = {}
        self._late: list[dict[str, Any]] = []

    def measure(self, info: Mapping[str, Any]) -> dict[str, Any]:
        """What the controller reads of the columns of this step."""
        sensing = self._sensing
        noise = self._noise[self._step]
        seen: dict[str, Any] = {
            "joint_torque_nm": info["joint_torque_nm"]
            + sensing.torque_noise * noise[:, 0],
            **{name: np.array(info[name]) for name in TOLD},
        }
        for side, steps in (
            ("motor", sensing.motor_steps),
            ("joint", sensing.joint_steps),
        ):
            unit = 2.0 * math.pi / steps if steps else 0.0
            angle = np.array(info[f"{side}_angle_rad"])
            seen[f"{side}_angle_rad"] = unit * np.round(angle / unit) if unit else angle
            true = np.array(info[f"{side}_velocity_rad_s"])
            rate = self._rate(side, seen) if steps else true
            seen[f"{side}_velocity_rad_s"] = self._smoothed(side, rate)
        seen[TENSIONS] = self._tensions(info, noise[:, 1:])
        self._last, self._step = seen, self._step + 1
        self._late.append(seen)
        # Before the first measurement arrives there is the one at rest.
        if len(self._late) > sensing.delay + 1:
            self._late.pop(0)
        return self._late[0]

    def _rate(self, side: str, seen: Mapping[str, Any]) -> Any:
        angle = seen[f"{side}_angle_rad"]
        return (angle - self._last.get(f"{side}_angle_rad", angle)) / self._period

    def _smoothed(self, side: str, rate: Any) -> Any:
        before = self._last.get(f"{side}_velocity_rad_s", rate)
        return before + self._share * (rate - before)

    def _tensions(self, info: Mapping[str, Any], noise: Array) -> Array:
        true = [
            info[f"tension_{name}_nodes_n"][:, nodes]
            for name, nodes in zip(self._cables, self._nodes, strict=True)
        ]
        told = np.stack(true, axis=1)
        told = told + self._sensing.tension_noise * noise.reshape(told.shape)
        seen: Array = np.maximum(told, 0.0)
        return seen
