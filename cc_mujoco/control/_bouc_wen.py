r"""The Bouc-Wen model of a tendon in a sheath, and its feed-forward.

T. N. Do, T. Tjahjowidodo, M. W. S. Lau, T. Yamamoto, S. J. Phee, "Hysteresis modeling
and position control of tendon-sheath mechanism in flexible endoscopic systems",
Mechatronics 24, 2014, and T. N. Do, T. Tjahjowidodo, M. W. S. Lau, S. J. Phee,
"Nonlinear friction modelling and compensation control of hysteresis phenomena for a
pair of tendon-sheath actuated surgical robots", Mechanical Systems and Signal
Processing 60-61, 2015:

\[ q = a \theta - b z + c, \qquad
   \frac{dz}{d\theta} = 1 - |z| \bigl( \beta \operatorname{sign}(z \dot\theta) + \gamma
   \bigr) \]

with the exponent 1 of their model and z scaled to slope 1. The feed-forward turns the
motor by what \(dq\) needs at the present z: \(d\theta = dq / (a - b\, dz/d\theta)\).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco._validation import require_parameter
from cc_mujoco.control._hysteresis import Array, HysteresisModel, HysteresisTrial
from cc_mujoco.errors import CableError

LEAST_SLOPE = 0.02
"""Least slope of the joint against the motor, relative to a."""
SUBSTEPS = 4
"""Steps of the feed-forward from one angle to the next."""


@dataclass(frozen=True)
class BoucWen(HysteresisModel):
    """Linear part and hysteretic part z; see the module."""

    gain: float
    """Joint angle per motor angle while z is constant, a [-]."""
    hysteresis: float
    """Joint angle per z, b [-]; at least 0: the joint lags."""
    offset: float
    """Joint angle at motor angle 0 and z = 0, c [rad]."""
    beta: float
    """Symmetric saturation of z [1/rad]."""
    gamma: float
    """Asymmetric saturation of z [1/rad]; between -beta and beta."""

    def __post_init__(self) -> None:
        """Refuse what is no hysteresis."""
        require_parameter(self, "gain", 1e-6, 1e6, "")
        require_parameter(self, "hysteresis", 0.0, 1e6, "")
        require_parameter(self, "beta", 1e-6, 1e9, "1/rad")
        if not abs(self.gamma) <= self.beta:
            raise CableError(
                f"BoucWen.gamma must be in [-{self.beta:g}, {self.beta:g}] 1/rad, not "
                f"{self.gamma!r}."
            )

    @classmethod
    def fit(cls, trial: HysteresisTrial) -> BoucWen:
        """Return the parameters of least squares; see `HysteresisModel.fit`."""
        from scipy.optimize import least_squares

        motor, joint = trial.motor_angle, trial.joint_angle
        reach = float(np.ptp(motor))

        def linear(rates: Array) -> tuple[Array, Array]:
            beta = float(np.exp(rates[0])) / reach
            z = _hysteretic(motor, beta, beta * float(np.tanh(rates[1])))
            columns = np.stack([motor, -z, np.ones(motor.size)], axis=1)
            found = np.asarray(
                np.linalg.lstsq(columns, joint, rcond=None)[0], dtype=np.float64
            )
            if found[1] < 0.0:
                gain, offset = np.polyfit(motor, joint, 1)
                found = np.array([gain, 0.0, offset])
            return found, np.asarray(columns @ found - joint, dtype=float)

        starts = [np.array([np.log(rate), 0.0]) for rate in (3.0, 10.0, 30.0)]
        start = min(starts, key=lambda one: float(np.sum(linear(one)[1] ** 2)))
        rates = least_squares(lambda one: linear(one)[1], start, diff_step=1e-3).x
        gain, hysteresis, offset = linear(rates)[0].tolist()
        beta = float(np.exp(rates[0])) / reach
        return cls(gain, hysteresis, offset, beta, beta * float(np.tanh(rates[1])))

    def rest(self, count: int) -> Array:
        """Return joint angle, motor angle and z; see `HysteresisModel.rest`."""
        state = np.zeros((count, 3))
        state[:, 0] = self.offset
        return state

    def invert(self, state: Array, joint: Array) -> Array:
        """Return the motor angles [rad]; see `HysteresisModel.invert`."""
        step = (joint - state[:, 0]) / SUBSTEPS
        way = np.sign(step)
        z = state[:, 2]
        for _ in range(SUBSTEPS):
            half = z + 0.5 * self._turned(z, way, step)[1]
            z = z + self._turned(half, way, step)[1]
        # By z alone, so that no error adds up.
        motor: Array = (joint - self.offset + self.hysteresis * z) / self.gain
        state[:, 0], state[:, 1], state[:, 2] = joint, motor, z
        return motor

    def course(self, motor: ArrayLike) -> Array:
        """Return the course of the joint for a course of the motor (samples,) [rad].

        The operator that `invert` inverts, exact for courses that are monotone between
        samples.
        """
        angles = np.asarray(motor, dtype=float)
        z = _hysteretic(angles, self.beta, self.gamma, 0.0)
        found: Array = self.gain * angles - self.hysteresis * z + self.offset
        return found

    def _turned(self, z: Array, way: Array, step: Array) -> tuple[Array, Array]:
        """Return how far the motor turns and z changes for a step of the joint."""
        slope = 1.0 - np.abs(z) * (self.beta * np.sign(z) * way + self.gamma)
        moved = np.maximum(self.gain - self.hysteresis * slope, LEAST_SLOPE * self.gain)
        return step / moved, step / moved * slope


def _hysteretic(
    motor: Array, beta: float, gamma: float, start: float | None = None
) -> Array:
    """Return z along a course of the motor (samples,), in closed form between samples.

    Of one sign of z and of the motion z relaxes exponentially; where z crosses 0, the
    step is parted there.
    """
    first = float(motor[0]) if start is None else start
    moved = np.diff(motor, prepend=first).tolist()
    found, z = np.empty(motor.size), 0.0
    for place, turn in enumerate(moved):
        left, way = abs(turn), 1.0 if turn > 0.0 else -1.0
        if left > 0.0 and z * way < 0.0:
            # z in the sense of the motion rises to 0: dy/ds = 1 + (beta - gamma) |y|.
            rate, size = beta - gamma, abs(z)
            to_zero = np.log1p(rate * size) / rate if rate > 1e-9 else size
            if left < to_zero:
                grown = np.exp(-rate * left) if rate > 1e-9 else 1.0
                size = (
                    (size + 1.0 / rate) * grown - 1.0 / rate
                    if rate > 1e-9
                    else size - left
                )
                z, left = -way * size, 0.0
            else:
                z, left = 0.0, left - to_zero
        if left > 0.0:
            rate, size = beta + gamma, abs(z)
            size = (
                1.0 / rate + (size - 1.0 / rate) * np.exp(-rate * left)
                if rate > 1e-9
                else size + left
            )
            z = way * size
        found[place] = z
    return found
