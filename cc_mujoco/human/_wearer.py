"""The wearer of a device: a position source of adjustable impedance.

    >>> from cc_mujoco.human import Wearer
    >>> wearer = Wearer(stiffness=200.0, damping=2.0)
    >>> wearer.gains()
    ActuatorGains(gain=200.0, bias=(0.0, -200.0, -2.0))
    >>> wearer.command(angle=0.1, velocity=2.5)
    0.125

The wearer pulls the joint towards a reference motion with

    torque = K (reference - angle) + D (reference velocity - velocity)

which a MuJoCo position actuator gives when its control is `command(reference, reference
velocity)`. Write the command at every physics step: held for several steps, it is
a staircase, which a stiff wearer follows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from cc_mujoco._validation import require_number, require_parameter
from cc_mujoco.human._pace import Real


class ActuatorGains(NamedTuple):
    """Parameters of a MuJoCo actuator with affine bias."""

    gain: float  # first entry of `gainprm` [N m/rad]
    bias: tuple[float, float, float]  # of `biasprm` [N m, N m/rad, N m s/rad]


@dataclass(frozen=True)
class Wearer:
    """Limb as a spring and a damper towards a reference motion."""

    stiffness: float  # K, above 0 [N m/rad]
    damping: float  # D, at least 0 [N m s/rad]

    def __post_init__(self) -> None:
        require_parameter(self, "stiffness", 1e-6, 1e15, "N m/rad")
        require_parameter(self, "damping", 0.0, 1e15, "N m s/rad")

    @classmethod
    def ideal(cls, inertia: float, timestep: float) -> Wearer:
        """Return the wearer nearest to the ideal position source of the thesis.

        With inertia J and step h, semi-implicit Euler with explicit damping carries
        error e and velocity w as w' = (1 - h D / J) w - h K e / J, e' = e + h w'. Its
        characteristic polynomial is z^2 - (2 - d - k) z + (1 - d) with d = h D / J and
        k = h^2 K / J; Jury's criterion (E. I. Jury, Theory and Application of the
        z-Transform Method, 1964) puts both roots inside the unit circle for

            0 < d < 2   and   0 < k < 4 - 2 d.

        At the limit an error oscillates for ever. The stiffest wearer without
        oscillation has both roots at zero, d = k = 1:

            K = J / h^2,   D = J / h

        An error then vanishes in two steps, and K may be doubled, or the inertia
        halved, before the step becomes unstable. MuJoCo's implicit integrators, where k
        < 4 + 2 d, and its RK4 are stable for this wearer too.

        A reference of acceleration a is followed with an error of J a / K = h^2 a. RK4
        holds the command while velocity and angle advance, which adds half a step of
        motion, h / 2 times the velocity. Both vanish with the step: the ideal position
        source is the limit h -> 0.

        J is the least `inertia` that the joint moves with [kg m^2], h the `timestep` of
        the simulation [s].
        """
        require_number("inertia", inertia, 1e-9, 1e6, "kg m^2")
        require_number("timestep", timestep, 1e-7, 1.0, "s")
        return cls(inertia / timestep**2, inertia / timestep)

    def gains(self) -> ActuatorGains:
        """Return the actuator gains of force = K ctrl - K angle - D velocity."""
        return ActuatorGains(self.stiffness, (0.0, -self.stiffness, -self.damping))

    def command(self, angle: Real, velocity: Real) -> Real:
        """Return the control for a reference: angle + D / K velocity [rad].

        Angle [rad] and velocity [rad/s] are those of the reference.
        """
        return angle + self.damping / self.stiffness * velocity

    def torque(
        self,
        reference_angle: Real,
        reference_velocity: Real,
        angle: Real,
        velocity: Real,
    ) -> Real:
        """Return the torque that the wearer puts into the joint [N m], elementwise.

        It is K (reference angle - angle) + D (reference velocity - velocity), with
        angles in rad and velocities in rad/s.
        """
        error, slip = reference_angle - angle, reference_velocity - velocity
        return self.stiffness * error + self.damping * slip
