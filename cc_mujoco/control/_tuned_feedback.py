"""PI with gains that follow from rotor, cables and delay of a drive.

>>> from cc_mujoco.device._drive import Drive, CableDrive
>>> from cc_mujoco.control import TunedFeedback
>>> from cc_mujoco.cable import Cable
>>> pair = CableDrive(Cable(), -0.02, -0.1), CableDrive(Cable(), 0.02, 0.1)
>>> drive = Drive(5.0, -1.0, 1.0, 0.001, cables=pair, inertia=7e-5)
>>> round(TunedFeedback(drive).integral)
150
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.arguments import require_kind
from cc_mujoco.control import _compiled_laws as compiled_laws
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._cable_model import joint_stiffness
from cc_mujoco.control._controller import as_round_pulley, readings
from cc_mujoco.control._full_slip import cable_table, full_slip_balance
from cc_mujoco.control._proportional_integral import ProportionalIntegral
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal

_DAMPING_RATIO = 0.7
_DELAY_SHARE = 0.35
"""Share of what a delay allows that damping and proportional gain take."""
_MAX_PROPORTIONAL = 2.0
_DEAD_SIGMAS = 6.0
"""Error at no desired torque that a single cable does not answer, in standard
deviations of the torque sensor: three times those of its bias in the benchmark."""
_NOISE_TIME = 0.5
"""Time over which the noise of the torque sensor is measured [s]."""
_RATE_FILTER = 0.2
"""Share of a new value in the filtered rate of the desired torque."""

_KNOWN, _DESIRED, _RATE, _TORQUE, _CHANGE, _POWER, SIGNAL_SIZE = range(7)
"""Places in the memory of the signals, and its size: desired torque and its filtered
rate; measured torque, its change in the last step, and the power of its noise."""


class LoopGains(NamedTuple):
    """Gains of a torque loop that is stable with the delay of the drive."""

    settling: float
    """Damping of the motor over the stiffness of the cables [s]."""
    proportional: float
    """K_p [-]."""
    integral: float
    """K_i [1/s]."""


def total_delay(drive: Drive) -> float:
    """Return the time from a torque at the joint to the answer of the motor [s]."""
    return (drive.delay + 1.5) * drive.period + drive.motor_lag


def require_known_motor(drive: Drive) -> None:
    """Refuse a drive whose cables or rotor are not known.

    Raises:
        CableError: They are not.
    """
    require_kind("drive", drive, Drive)
    if not (drive.inertia > 0.0 and drive.cables):
        raise CableError(
            "a controller whose gains follow from rotor and cables needs to know both; "
            "this Drive has no inertia or no cables."
        )


def loop_gains(drive: Drive, integral_share: float = 0.0) -> LoopGains:
    r"""Return the gains of a PI loop with a damper of the motor.

    With the rotor's inertia J, the stiffness k of the cables at the motor and the delay
    T, the damper D is that of a damping ratio of 0.7, at most 0.35 J / T. The
    proportional gain acts as a damping of \(-K_p k T\), so it is at most 0.35 D / (k
    T). The integral has a share of the least of the bandwidths 1 / T, k / D, D / J. The
    shares are the best of `scripts/benchmarks/tune_baselines.py`.

    Raises:
        CableError: Cables or rotor are not known.
    """
    require_known_motor(drive)
    inertia, late = drive.inertia, total_delay(drive)
    stiffness = joint_stiffness(drive.cables) / drive.ratio**2
    damping = 2.0 * _DAMPING_RATIO * math.sqrt(stiffness * inertia)
    damping = min(damping, _DELAY_SHARE * inertia / late)
    proportional = min(_DELAY_SHARE * damping / (stiffness * late), _MAX_PROPORTIONAL)
    bandwidth = min(1.0 / late, stiffness / damping, damping / inertia)
    integral = integral_share * (1.0 + proportional) * bandwidth
    return LoopGains(damping / stiffness, proportional, integral)


class TunedFeedback(ProportionalIntegral):
    r"""`pi` with a damped motor and gains from rotor, cables and delay; no model.

    \[ \tau_m = \frac{1}{\rho} \Bigl( \tau_d + K_p e + K_i \int e \, dt \Bigr)
       - D (\dot\theta_m - \rho \dot\theta_j) \]

    with the gains of `loop_gains`. It is stable on a light winch, where the gains of
    the thesis are not. Where a single cable is to pull nothing, an error e within six
    standard deviations of the sensor, as `Drive` has it or as measured, is none: its
    bias would wind the cable in and out in a limit cycle. The dead zone is gone at a
    desired torque of twice its width.
    """

    integral_share = 0.35
    """Bandwidth of the integral over that of the damped motor."""
    friction_share = 0.0
    """Share of the friction of slipping cables that is fed forward."""
    slip_speed = 0.3
    """Speed of the joint at which the sense of slip is hardly in doubt [rad/s]."""

    def __init__(self, drive: Drive) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device; its `cables` and the motor's inertia must be known.

        Raises:
            CableError: They are not known.
        """
        found = loop_gains(drive, self.integral_share)
        super().__init__(drive, found.proportional, found.integral)
        self.settling = found.settling
        self.dead_sigmas = _DEAD_SIGMAS if drive.one_way else 0.0
        """Error at no desired torque that is none, over the sensor's noise."""
        self.cables = cable_table(drive.cables)
        """See `cable_table`, (cables, numbers)."""
        self._signals: FloatArray = np.zeros((0, SIGNAL_SIZE))

    @property
    def settings(self) -> tuple[float, float, float, float]:
        """Share of friction, speed of slip, dead zone and the sensor's noise."""
        noise = self.drive.torque_noise
        return self.friction_share, self.slip_speed, self.dead_sigmas, noise

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Empty the integral; see `Controller.reset`."""
        super().reset(where)
        if where is None:
            self._signals = np.zeros((0, SIGNAL_SIZE))
        elif len(self._signals):
            self._signals[where] = 0.0

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Return the torque of the motor [N m]; see `Controller.torque`."""
        seen = readings(
            as_round_pulley(observation, self.drive), compiled_laws.LAW_INPUTS
        )
        self.admit(seen)
        found = self.answer(seen)
        numbers = np.ndim(observation["desired_torque_nm"]) == 0
        return float(found[0]) if numbers else found

    def answer(self, seen: FloatArray) -> FloatArray:
        """Return the torque of the motor (rows,) [N m]; see `ProportionalIntegral`."""
        rows = len(seen)
        if len(self._signals) != rows:
            self._signals = np.zeros((rows, SIGNAL_SIZE))
        found = np.empty(rows)
        _torques(
            self.gains.packed,
            self.spring,
            self.cables,
            np.array(self.settings),
            self.memory(rows),
            self._signals,
            seen,
            found,
        )
        return found


class FrictionFeedForward(TunedFeedback):
    r"""`pi_tuned` with the friction of slipping cables fed forward, smoothly.

    The motor torque of cables that slip as a whole (`full_slip_balance`), with a
    quarter of the believed friction, takes the place of \(\tau_d / \rho\). The sense of
    the slip is the hyperbolic tangent of the speed \(\dot\theta_j + \dot\tau_d / k\) at
    which the motor has to follow, over 0.3 rad/s: it is 0 at rest, so that nothing
    chatters there. More friction makes a light winch swing.
    """

    integral_share = 0.5
    friction_share = 0.25


@compiled
def _sense_of_slip(
    gains: FloatArray,
    memory: FloatArray,
    seen: FloatArray,
    stiffness: float,
    slip_speed: float,
) -> float:
    """Return the smooth sense in which the motor has to turn, -1 to 1."""
    desired = seen[compiled_laws.DESIRED]
    rate = (desired - memory[_DESIRED]) / gains[compiled_laws.PERIOD]
    memory[_DESIRED] = desired
    memory[_RATE] += _RATE_FILTER * (rate - memory[_RATE])
    speed = seen[compiled_laws.JOINT_VELOCITY] + memory[_RATE] / stiffness
    return float(np.tanh(speed / slip_speed))


@compiled
def _noise(gains: FloatArray, memory: FloatArray, torque: float) -> float:
    """Return the standard deviation of the noise of the torque sensor [N m].

    It is that of second differences: no motion bends a torque within three samples.
    """
    change = torque - memory[_TORQUE]
    power = (change - memory[_CHANGE]) ** 2 / 6.0
    memory[_TORQUE], memory[_CHANGE] = torque, change
    share = min(gains[compiled_laws.PERIOD] / _NOISE_TIME, 1.0)
    memory[_POWER] += share * (power - memory[_POWER])
    return float(np.sqrt(memory[_POWER]))


@internal
def tuned_torque(
    gains: FloatArray,
    spring: FloatArray,
    cables: FloatMatrix,
    settings: FloatArray,
    memory: FloatArray,
    signals: FloatArray,
    seen: FloatArray,
) -> float:
    """Return the motor torque of `TunedFeedback` [N m].

    Args:
        gains: see `GAINS`.
        spring: see `guard.STIFFNESS`.
        cables: see `cable_table`.
        settings: see `TunedFeedback.settings`.
        memory: of the law.
        signals: (`SIGNAL_SIZE`,), 0 at the start.
        seen: what is measured, after `admit`; changed.
    """
    desired = seen[compiled_laws.DESIRED]
    ahead = compiled_laws.feed_forward(gains, desired)
    if signals[_KNOWN] == 0.0:
        signals[_KNOWN], signals[_DESIRED] = 1.0, desired
        signals[_TORQUE] = seen[compiled_laws.TORQUE]
    friction_share, slip_speed = settings[0], settings[1]
    if friction_share > 0.0:
        stiffness = spring[guard.STIFFNESS]
        sense = friction_share * _sense_of_slip(
            gains, signals, seen, stiffness, slip_speed
        )
        ahead = full_slip_balance(cables, sense, desired)[0]
    off = seen[compiled_laws.TORQUE] - desired
    noise = _noise(gains, signals, seen[compiled_laws.TORQUE])
    width = settings[2] * max(noise, settings[3]) - 0.5 * abs(desired)
    if width > 0.0:
        off = np.sign(off) * max(abs(off) - width, 0.0)
        seen[compiled_laws.TORQUE] = desired + off
    return compiled_laws.damped_feedback(gains, spring, memory, seen, ahead)


@compiled
def _torques(
    gains: FloatArray,
    spring: FloatArray,
    cables: FloatMatrix,
    settings: FloatArray,
    memory: FloatMatrix,
    signals: FloatMatrix,
    seen: FloatMatrix,
    found: FloatArray,
) -> None:
    for row in range(found.size):
        found[row] = tuned_torque(
            gains, spring, cables, settings, memory[row], signals[row], seen[row]
        )  # fmt: skip
