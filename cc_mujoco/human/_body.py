"""Size of the wearer of a leg device, relative to the wearer of the scenes.

    >>> from cc_mujoco.human._body import Body
    >>> tall = Body(mass=90.0, leg=1.0)
    >>> round(tall.time, 3), round(tall.moment, 2)    # strides are longer in time
    (1.038, 1.29)
    >>> tall.pace() == Body().pace()      # the same gait, unless a speed is given
    True

Two people walk similarly at the same Froude number v^2 / (g l), of speed v and leg
length l: times are then as sqrt(l / g), moments as m g l (A. L. Hof, "Scaling gait data
to body size", Gait & Posture 4, 1996, pp. 222-223). Segments have fixed shares of the
mass of the body and of its height (D. A. Winter, Biomechanics and Motor Control of
Human Movement, Fig. 4.1 and Table 4.1, adults), so their inertias go as m l^2. Builds
that differ from that, and people who walk otherwise than by size, are not in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from cc_mujoco._validation import bounded, require_bounds
from cc_mujoco.errors import CableError
from cc_mujoco.human import _pace as walking


@dataclass(frozen=True)
class Body:
    """A wearer by size; that of the scenes changes nothing by a bit."""

    # Shares of the mass of the body [-]
    SEGMENTS: ClassVar = {"thigh": 0.100, "shank": 0.0465, "foot": 0.0145}
    mass: float = bounded(75.0, 40.0, 130.0, "kg")
    """Mass of the whole body [kg]."""
    # By default by Winter for the height; the bounds are of 1.42 and 1.98 m.
    leg: float = bounded(round(0.530 * walking.WEARER_HEIGHT, 4), 0.75, 1.05, "m")
    """Length of a leg from hip to sole [m]."""

    def __post_init__(self) -> None:
        require_bounds(self)

    @property
    def longer(self) -> float:
        """Length of leg over that of the scenes' wearer [-]."""
        return self.leg / Body.leg

    @property
    def heavier(self) -> float:
        """Mass over that of the scenes' wearer [-]."""
        return self.mass / Body.mass

    @property
    def time(self) -> float:
        """Times of a similar gait over those of the scenes' wearer [-]."""
        return math.sqrt(self.longer)

    @property
    def moment(self) -> float:
        """Moments of a similar gait over those of the scenes' wearer [-]."""
        return self.heavier * self.longer

    def pace(self, speed: float | None = None) -> walking.Pace:
        """Return the pace at which the wearer of the scenes walks similarly.

        Its times are to be multiplied by `time`, its moments by `moment`. `speed` is of
        this wearer [m/s]; by default it is that similar to the measured walk.

        Raises:
            CableError: If no data cover a similar gait.
        """
        if speed is None:
            return walking.Pace(walking.MEASURED_SPEED)
        equivalent_speed = speed / self.time
        is_known = walking.MIN_SPEED <= equivalent_speed <= walking.MAX_SPEED
        if not is_known and self.leg != Body.leg:
            # Rounded inwards, so that the ends in the message can be walked.
            low = math.ceil(1e3 * walking.MIN_SPEED * self.time) / 1e3
            high = math.floor(1e3 * walking.MAX_SPEED * self.time) / 1e3
            raise CableError(
                f"a wearer with legs of {self.leg:g} m cannot walk at {speed:g} m/s; "
                f"the speed must be in [{low:g}, {high:g}] m/s, where adults walk "
                "alike."
            )
        return walking.Pace(equivalent_speed)


SCENE_WEARER = Body()
