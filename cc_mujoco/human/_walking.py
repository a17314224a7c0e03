"""Walking trajectory of the ankle, with hip and knee."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cc_mujoco._validation import require_parameter
from cc_mujoco.human import _gait as gait
from cc_mujoco.human._body import SCENE_WEARER, Body
from cc_mujoco.human._motion import Array, Motion, Scripted, minimum_jerk
from cc_mujoco.human._pace import MEASURED_SPEED, Pace

_PHASE_GRID = np.linspace(0.0, 1.0, 10_001)
ANKLE_PEAK = float(np.abs(gait.GAIT_ANGLES["ankle"](_PHASE_GRID)).max())
"""Largest absolute ankle angle of the measured walk [rad]."""


@dataclass(frozen=True)
class Walk(Scripted):
    """Level walking: the ankle, and as companions all three joints of the leg.

    The cadence grows from standstill at heel strike to its full value in the time
    `start`, as a minimum-jerk step, so that the motion begins at rest. Phase: the gait
    cycle. Angles as in `gait`; all joints scale with the amplitude of the ankle. At
    another speed than the measured one joints move further or less and the foot leaves
    the ground earlier or later, see `Pace`; `Walk.at` has its stride time, too.
    """

    amplitude: float = math.ceil(1e3 * ANKLE_PEAK) / 1e3
    period: float = gait.GAIT_PERIOD
    """Duration of a gait cycle at full cadence [s]."""
    start: float = 1.0
    """Time in which the cadence grows from 0 [s]."""
    speed: float = MEASURED_SPEED
    """Walking speed [m/s]."""

    @classmethod
    def at(cls, speed: float | None, body: Body = SCENE_WEARER) -> Walk:
        """Return the walk at a speed, with the stride time that goes with it.

        Args:
            speed: Of the wearer [m/s]; see `Body.pace`.
            body: Who walks. Of another size than the wearer of the scenes, `speed` of
                the walk is that at which the latter walks similarly.

        Raises:
            CableError: If no data cover walking at that speed.
        """
        pace = body.pace(speed)
        return cls(period=gait.GAIT_PERIOD * pace.stride * body.time, speed=pace.speed)

    @property
    def pace(self) -> Pace:
        """Ratios that change with the speed."""
        return Pace(self.speed)

    def __post_init__(self) -> None:
        """Refuse parameters that describe no motion."""
        super().__post_init__()
        Pace(self.speed)
        require_parameter(self, "period", 0.2, 20.0, "s")
        require_parameter(self, "start", 0.01, 1e4, "s")

    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        step = minimum_jerk(time / self.start)
        cycles = step.integral * self.start / self.period
        rate = step.value / self.period
        acceleration = step.rate / self.start / self.period
        phase = np.asarray(np.mod(cycles, 1.0))
        # The default amplitude is the peak rounded up; it means the angles as measured.
        scale = self.amplitude / Walk.amplitude
        pace = self.pace
        measured = pace.phase(phase)
        slowed = pace.slope(phase)
        acceleration = slowed * acceleration + pace.bend(phase) * rate**2
        rate = slowed * rate

        def joint(name: str, companions: dict[str, Motion]) -> Motion:
            profile = gait.GAIT_ANGLES[name]
            slope = profile.derivative()
            bend = slope.derivative()
            far = scale * pace.excursion(name)
            return Motion(
                time,
                far * profile(measured),
                far * slope(measured) * rate,
                far * (bend(measured) * rate**2 + slope(measured) * acceleration),
                phase,
                companions,
                measured,
            )

        return joint("ankle", {name: joint(name, {}) for name in gait.GAIT_ANGLES})
