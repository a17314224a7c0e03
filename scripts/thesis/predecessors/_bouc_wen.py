r"""Do's modified Bouc-Wen friction of a whole cable (thesis 1.5, eq. 1.3-1.5).

    model = ModifiedBoucWen.fitted(cable, dt, u_proximal, spring, answer)

The friction of the cable, :math:`F_f = T_p - T_d` for motion x towards the motor, is
one hysteresis curve in x, its velocity and the sign of its acceleration. Cable stretch
is not part of the model: output and motor move equally. Its parameters do not
describe a cable and have to be fitted to a recording. The brackets of (1.4) are taken
as printed, with rho in front of all terms.
"""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from cc_mujoco.cable import Cable
from cc_mujoco.native import FloatArray, compiled
from thesis.predecessors._model import Answer, EndSpring, PublishedModel, ReplayedMotion

_MAX_STATE_CHANGE = 0.05
"""Most that the hysteresis state changes in one step of integration."""


class Hysteresis(NamedTuple):
    """Parameters of (1.3)-(1.5)."""

    position: float  # k_x [N/m]
    state: float  # k_zeta [N]
    viscous: float  # nu [N s/m]
    offset: float  # F_0 [N]
    rho: float  # [1/m]
    sigma: float  # shape, 0 or more
    lead: float  # lambda, speed by which acceleration leads [m/s]
    exponent: float = 1.0  # n, 1 or more


class ModifiedBoucWen(PublishedModel):
    """One hysteresis curve between motor and output tension."""

    name = "Do, modified Bouc-Wen"
    refuses: ClassVar = {
        "a locked output": "output and motor move alike in it",
        "a moved output": "output and motor move alike in it",
        "a tension profile": "it has no inside",
        "bends that change": "its parameters are fitted to one",
    }

    def __init__(self, cable: Cable, hysteresis: Hysteresis) -> None:
        super().__init__(cable)
        self.hysteresis = hysteresis

    @classmethod
    def fitted(
        cls,
        cable: Cable,
        dt: float,
        u_proximal: ArrayLike,
        environment: EndSpring,
        answer: Answer,
    ) -> ModifiedBoucWen:
        """Fit the parameters to a recording of motor and tensions, n = 1."""
        x = -np.asarray(u_proximal, dtype=np.float64)
        friction = answer.tension_proximal - answer.tension_distal

        def columns(shape: FloatArray) -> FloatArray:
            rho, sigma, lead = np.exp(shape)
            parts = _parts(x, dt, float(rho), float(sigma), float(lead), 1.0)
            return np.column_stack([*parts, np.ones(x.size)])

        def gains(shape: FloatArray) -> FloatArray:
            return np.linalg.lstsq(columns(shape), friction, rcond=None)[0]

        span = float(np.ptp(x))
        speed = float(np.max(np.abs(np.gradient(x, dt))))
        fit = least_squares(
            lambda shape: columns(shape) @ gains(shape) - friction,
            np.log([10.0 / span, 1.0, 0.01 * speed]),
            bounds=(
                np.log([0.1 / span, 0.05, 1e-6 * speed]),
                np.log([1e4 / span, 20.0, speed]),
            ),
        )
        position, state, viscous, offset = gains(fit.x).tolist()
        rho, sigma, lead = np.exp(fit.x).tolist()
        return cls(
            cable, Hysteresis(position, state, viscous, offset, rho, sigma, lead)
        )

    def answer(self, motion: ReplayedMotion) -> Answer:
        proximal, has = motion.proximal, self.hysteresis
        position, state, speed = _parts(
            -proximal, motion.dt, has.rho, has.sigma, has.lead, has.exponent
        )
        friction = (
            has.position * position
            + has.state * state
            + has.viscous * speed
            + has.offset
        )
        distal = self.cable.pretension - motion.stiffness * proximal
        return Answer(distal + friction, distal, proximal.copy())


def _parts(
    x: FloatArray, dt: float, rho: float, sigma: float, lead: float, exponent: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the factors of the gains: position with (1.5), zeta, speed (samples,)."""
    speed = np.diff(x, prepend=x[0]) / dt
    turn = np.sign(np.diff(speed, prepend=0.0).round(12))
    fast = np.exp(2.0 * speed)
    position = x * (fast + np.sign(x) * turn) / (fast + 1.0)
    zeta = np.empty(speed.size)
    _hysteresis(speed, turn, dt, rho, sigma, lead, exponent, zeta)
    return position, zeta, speed


@compiled
def _hysteresis(
    speed: FloatArray,
    turn: FloatArray,
    dt: float,
    rho: float,
    sigma: float,
    lead: float,
    exponent: float,
    out: FloatArray,
) -> None:
    """Compute the state zeta of (1.4) over time (samples,), by fine explicit steps."""
    zeta = 0.0
    for row in range(speed.size):
        w = speed[row] + lead * turn[row]
        travel = rho * w * dt
        steps = 1 + int(abs(travel) * (1.0 + sigma) / _MAX_STATE_CHANGE)
        part = travel / steps
        for _ in range(steps):
            size = abs(zeta) ** (exponent - 1.0)
            zeta += (
                part
                - sigma * abs(part) * size * zeta
                + (sigma - 1.0) * part * size * abs(zeta)
            )
        out[row] = zeta
