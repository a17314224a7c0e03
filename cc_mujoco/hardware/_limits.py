"""Limits of a run, and the limiter that keeps the motor's torque within them."""

import math
from dataclasses import dataclass

from cc_mujoco._validation import require_parameter
from cc_mujoco.errors import CableError

MAX_PERIOD, MIN_PERIOD = 1.0 / 500.0, 1.0 / 2000.0  # periods of a loop [s]


@dataclass(frozen=True)
class Limits:
    """Limits of a run, which stops when a measured value exceeds one."""

    torque: float  # largest of the motor, either way [N m]
    torque_rate: float  # largest rate of the motor's torque [N m/s]
    motor_speed: float  # [rad/s]
    joint_range: tuple[float, float]  # least and greatest angle [rad]
    joint_torque: float = math.inf  # largest of the transmission, either way [N m]
    tension: float = math.inf
    """Largest tension anywhere in a cable [N], as estimated by the scene's model from
    motor angle and joint torque."""
    soft_start: float = 1.0  # time over which the controller's torque is faded in [s]
    stop_time: float = 0.1  # in which the torque goes to zero after a stop [s]

    def __post_init__(self) -> None:
        for name in ("torque", "torque_rate", "motor_speed"):
            require_parameter(self, name, 1e-9, 1e9, "")
        low, high = self.joint_range
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise CableError(
                "Limits.joint_range must be two finite angles in rad, the lower first, "
                f"not {self.joint_range!r}."
            )
        if max(-low, high) > math.tau:
            raise CableError(
                "Limits.joint_range must lie within a turn to either side, in rad, "
                f"not {self.joint_range!r}; {high:g} degrees are "
                f"{math.radians(high):.3g} rad."
            )
        for name, unit in (("joint_torque", "N m"), ("tension", "N")):
            most = getattr(self, name)
            if not most > 0.0:
                raise CableError(f"Limits.{name} must be above 0 {unit}, not {most!r}.")
        require_parameter(self, "soft_start", 0.0, 600.0, "s")
        require_parameter(self, "stop_time", 0.0, 10.0, "s")

    def stop_steps(self, period: float) -> int:
        """Return the cycles of a stop's ramp; refuse too short a `stop_time`."""
        steps = max(1, math.floor(self.stop_time / period + 1e-9))
        if self.torque > self.torque_rate * period * steps * (1.0 + 1e-9):
            least = self.torque / self.torque_rate
            raise CableError(
                f"stop_time = {self.stop_time:g} s is too short for a torque of "
                f"{self.torque:g} N m that may change by {self.torque_rate:g} N m/s; "
                f"it must be at least {math.ceil(least / period - 1e-9) * period:g} s."
            )
        return steps


class Limiter:
    """Limiter of a motor's torque, in size and rate.

    For any request, two consecutive torques differ by at most rate times period, and
    none exceeds the limit; it starts at zero. Time is counted in cycles, so that a late
    loop makes no larger steps.
    """

    def __init__(self, limits: Limits, period: float) -> None:
        """Start at zero torque; `period` is the time between two torques [s]."""
        self._limit = limits.torque
        self._max_torque_step = limits.torque_rate * period
        self._share = min(1.0, period / limits.soft_start) if limits.soft_start else 1.0
        self._stop_steps = limits.stop_steps(period)
        self._cycles, self._stop_rate = 0, 0.0
        self.torque = 0.0  # the last that was given out [N m]
        self.is_rate_limited = False
        """True if the limit of the rate kept the last torque from its goal."""

    def limited(self, wish: float) -> float:
        """Return the next torque for the controller's finite `wish` [N m]."""
        if not math.isfinite(wish):
            raise CableError(f"the controller gave {wish!r} N m.")
        self._cycles += 1
        self._stop_rate = 0.0
        share = min(1.0, self._cycles * self._share)  # of the soft start
        return self._towards(share * wish)

    def stopping(self) -> float:
        """Return the next torque of a ramp to zero in `stop_time` [N m]."""
        if self._stop_rate == 0.0:
            self._stop_rate = abs(self.torque) / self._stop_steps
        left = abs(self.torque) - self._stop_rate
        # What rounding leaves of the last step is no torque.
        goal = left if left > 1e-9 * self._limit else 0.0
        return self._towards(math.copysign(goal, self.torque))

    def _towards(self, goal: float) -> float:
        within, step = min(max(goal, -self._limit), self._limit), self._max_torque_step
        self.torque = min(max(within, self.torque - step), self.torque + step)
        self.is_rate_limited = self.torque != within
        return self.torque
