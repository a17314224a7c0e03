"""Level walking at other speeds and sizes, as ratios to the measured walk of `_gait`.

    >>> from cc_mujoco.human._pace import MEASURED_SPEED, Pace
    >>> round(Pace(1.6).stride, 2)            # strides are shorter in time
    0.78
    >>> Pace(MEASURED_SPEED).stride, Pace(MEASURED_SPEED).phase(0.3)
    (1.0, 0.3)

The numbers are means of 20 adults (22 to 72 years, 1.71 m) in four classes of speed
over height: G. Bovi, M. Rabuffetti, P. Mazzoleni, M. Ferrarin, "A multiple-task gait
analysis approach: kinematic, kinetic and EMG reference data for healthy young and adult
subjects", Gait & Posture 33, 2011, pp. 6-13, electronic addendum. Stride time, stance
time and ranges of motion are those of its sheet Parameters. Moments are the maxima of
the mean curves in its sheet Joint Moments: plantarflexion at the ankle, flexion at the
hip. Numbers are interpolated between the classes as powers of the speed, and
extrapolated to 0.06 m/s below the slowest.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._validation import bounded, require_bounds
from cc_mujoco.errors import CableError

Real = TypeVar("Real", float, NDArray[np.float64])

MIN_SPEED, MAX_SPEED = 0.8, 1.6  # speeds that can be walked [m/s]
MEASURED_SPEED = 1.03
"""Speed of the measured walk [m/s]. Its source does not state it; adults of the
wearer's height have its stride time at this speed."""
WEARER_HEIGHT = 1.75  # height of the wearer, as the scenes have it [m]
TOE_OFF = 0.66
"""Phase of the measured walk at which its ankle moment has fallen to zero."""

_SPEED_CLASSES = {
    "speed": (0.4926, 0.6979, 0.8733, 1.1544),  # over height, 1/s
    "stride": (1.389, 1.098, 0.978, 0.855),  # s
    "stance": (65.36, 62.67, 61.71, 59.13),  # % of the stride
    "hip": (39.15, 42.74, 46.64, 56.04),  # degrees
    "knee": (59.03, 60.60, 62.05, 64.70),  # degrees
    "ankle": (32.41, 32.16, 35.56, 37.26),  # degrees
    "ankle_moment": (1.248, 1.309, 1.325, 1.249),  # N m/kg
    "hip_moment": (0.558, 0.725, 0.807, 1.001),  # N m/kg
}


@dataclass(frozen=True)
class Pace:
    """Gait at a walking speed, as ratios to the measured walk at `MEASURED_SPEED`."""

    speed: float = bounded(MEASURED_SPEED, MIN_SPEED, MAX_SPEED, "m/s")
    """Walking speed [m/s]."""

    def __post_init__(self) -> None:
        require_bounds(self)

    @cached_property
    def stride(self) -> float:
        """Ratio of the stride time to that of the measured walk [-]."""
        return self._ratio("stride")

    @cached_property
    def toe_off(self) -> float:
        """Phase at which the foot leaves the ground [-]."""
        return TOE_OFF * self._ratio("stance")

    def excursion(self, joint: str) -> float:
        """Return the ratio of a joint's range of motion to the measured one [-]."""
        return self._ratio(joint)

    def moment(self, joint: str) -> float:
        """Return the ratio of a joint's largest moment to the measured one [-].

        It is NaN for the knee, except at the measured speed: no data are known.
        """
        name = f"{joint}_moment"
        if name not in _SPEED_CLASSES:
            return 1.0 if self.speed == MEASURED_SPEED else math.nan
        return self._ratio(name)

    def phase(self, phase: Real) -> Real:
        """Return the phase of the measured walk at equal progress, elementwise.

        w(p) = p + s (1 - cos 2 pi p) / 2 for phase p of this walk, with s such that
        w(`toe_off`) = `TOE_OFF`: heel strike and toe-off of both coincide.
        """
        cosine = np.cos(2 * np.pi * phase)
        if not isinstance(phase, np.ndarray):
            cosine = float(cosine)
        return phase + self._shift * (0.5 - 0.5 * cosine)

    def slope(self, phase: Real) -> Real:
        """Return the derivative dw/dp of `phase` [-], shaped as its argument."""
        found: Real = 1.0 + self._shift * np.pi * np.sin(2 * np.pi * phase)
        return found

    def bend(self, phase: Real) -> Real:
        """Return the derivative d2w/dp2 of `phase` [-], shaped as its argument."""
        found: Real = self._shift * 2 * np.pi**2 * np.cos(2 * np.pi * phase)
        return found

    @cached_property
    def _shift(self) -> float:
        turn = 2 * np.pi * self.toe_off
        return (TOE_OFF - self.toe_off) / (0.5 - 0.5 * float(np.cos(turn)))

    def _ratio(self, name: str) -> float:
        return _interpolate(name, self.speed) / _interpolate(name, MEASURED_SPEED)


def _interpolate(name: str, speed: float) -> float:
    """Return a number of the speed classes at a speed [m/s], interpolated log-log."""
    x, y = np.log(_SPEED_CLASSES["speed"]), np.log(_SPEED_CLASSES[name])
    here = np.log(speed / WEARER_HEIGHT)
    left = int(np.clip(np.searchsorted(x, here) - 1, 0, x.size - 2))
    share = (here - x[left]) / (x[left + 1] - x[left])
    return float(np.exp(y[left] + share * (y[left + 1] - y[left])))


@dataclass(frozen=True)
class Body:
    """Wearer of another size, as ratios to the wearer of the scenes.

        >>> tall = Body(mass=90.0, leg=1.0)
        >>> round(tall.time, 3), round(tall.moment, 2)    # strides are longer in time
        (1.038, 1.29)
        >>> tall.pace() == Body().pace()      # the same gait, unless a speed is given
        True

    Two people walk similarly at the same Froude number v^2 / (g l), of speed v and leg
    length l: times then scale with sqrt(l / g), moments with m g l (A. L. Hof, "Scaling
    gait data to body size", Gait & Posture 4, 1996, pp. 222-223). Segments have fixed
    shares of the body's mass and height (D. A. Winter, Biomechanics and Motor Control
    of Human Movement, Fig. 4.1 and Table 4.1, adults), so that inertias scale with m
    l^2. Other proportions, and gaits that differ by more than size, are not modelled.
    All ratios of the scenes' wearer are 1, bit for bit.
    """

    # Shares of the mass of the body [-]
    SEGMENTS: ClassVar = {"thigh": 0.100, "shank": 0.0465, "foot": 0.0145}
    mass: float = bounded(75.0, 40.0, 130.0, "kg")
    """Mass of the whole body [kg]."""
    # By default by Winter for the height; the bounds are of 1.42 and 1.98 m.
    leg: float = bounded(round(0.530 * WEARER_HEIGHT, 4), 0.75, 1.05, "m")
    """Length of a leg from hip to sole [m]."""

    def __post_init__(self) -> None:
        require_bounds(self)

    @property
    def longer(self) -> float:
        """Ratio of the leg's length to that of the scenes' wearer [-]."""
        return self.leg / Body.leg

    @property
    def heavier(self) -> float:
        """Ratio of the mass to that of the scenes' wearer [-]."""
        return self.mass / Body.mass

    @property
    def time(self) -> float:
        """Ratio of the times of a similar gait to those of the scenes' wearer [-]."""
        return math.sqrt(self.longer)

    @property
    def moment(self) -> float:
        """Ratio of the moments of a similar gait to those of the scenes' wearer [-]."""
        return self.heavier * self.longer

    def pace(self, speed: float | None = None) -> Pace:
        """Return the pace at which the wearer of the scenes walks similarly.

        This wearer's times are its times multiplied by `time`, and moments its moments
        by `moment`. `speed` is that of this wearer [m/s]; by default it is similar to
        the measured walk. A speed whose similar gait no data cover is refused.
        """
        if speed is None:
            return Pace(MEASURED_SPEED)
        equivalent_speed = speed / self.time
        is_known = MIN_SPEED <= equivalent_speed <= MAX_SPEED
        if not is_known and self.leg != Body.leg:
            # Rounded inwards, so that the ends in the message can be walked.
            low = math.ceil(1e3 * MIN_SPEED * self.time) / 1e3
            high = math.floor(1e3 * MAX_SPEED * self.time) / 1e3
            raise CableError(
                f"a wearer with legs of {self.leg:g} m cannot walk at {speed:g} m/s; "
                f"the speed must be in [{low:g}, {high:g}] m/s, where adults walk "
                "alike."
            )
        return Pace(equivalent_speed)


SCENE_WEARER = Body()
