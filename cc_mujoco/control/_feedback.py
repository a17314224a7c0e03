"""Controllers of torque by feedback and feed-forward, without a model of the cables.

>>> from cc_mujoco.device._drive import Drive, CableDrive
>>> from cc_mujoco.control import TunedFeedback
>>> from cc_mujoco.cable import Cable
>>> pair = CableDrive(Cable(), -0.02, -0.1), CableDrive(Cable(), 0.02, 0.1)
>>> drive = Drive(5.0, -1.0, 1.0, 0.001, cables=pair, inertia=7e-5)
>>> round(TunedFeedback(drive).integral)
150
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from cc_mujoco._utils.arguments import require_kind
from cc_mujoco._validation import require_number
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.control._cable_model import cable_table, joint_spring
from cc_mujoco.control._controller import (
    WOUND,
    LawTables,
    SteppedController,
    SteppedLaw,
    motor_limits,
    readings,
    total_delay,
)
from cc_mujoco.control._law_steps import FEEDBACK, LAW_INPUTS
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray

_DELAY_SHARE = 0.35
"""Used share of the damping and of the proportional gain at the edge of stability."""


class FeedForward(SteppedController):
    r"""No compensation: the desired torque is commanded as if there were no friction.

    \[ \tau_m = \tau_d / \rho \]

    with the desired joint torque \(\tau_d\) [N m] and the ratio \(\rho\) of the drive
    ("feed-forward only" of the thesis, section 4.3.1). It has no state. A desired
    torque that is no number, or beyond `guard.MAX_READING`, gives no torque.
    """

    stepped = SteppedLaw(
        law_steps.step_forward,
        unread=frozenset(guard.DriveLimits._fields) - {"ratio", "low", "high"},
        fixed=frozenset({"period"}),
        seen=("desired_torque_nm",),
        is_round=False,
        unguarded=frozenset({"desired_torque_nm"}),
    )

    def law_tables(self) -> LawTables:
        return LawTables((), (), law_steps.OWN_MEMORY + guard.LIMITS)


class ProportionalIntegral(SteppedController):
    r"""Feedback of the joint torque, proportional and integral, and feed-forward.

    \[ \tau_m = \frac{1}{\rho} \Bigl( f \tau_d + K_p e + K_i \int e \, dt \Bigr),
       \qquad e = \tau_d - \tau_j \]

    with the desired and the measured joint torque \(\tau_d, \tau_j\) [N m], the ratio
    \(\rho\) of the drive and \(f\) = 1 with feed-forward, 0 without. The gains are
    those of the thesis, section 4.3.1: \(K_p\) = 1, \(K_i\) = 2 / s; with them both
    devices of this package are stable at 1 kHz, inertia and stretch included.

    Anti-windup by clamping: while the motor is at a limit, the integral does not grow
    beyond; and where cables only pull, the integral never takes more than the
    feed-forward. It would pay out cable for as long as friction holds back some
    tension, and the motor would then have to take up the slack at speed.

    Where a safe torque is known, the `guard` releases a joint with too large a torque:
    the motor then follows the joint by a damper, and the integral restarts.
    """

    stepped = SteppedLaw(
        law_steps.step_proportional_integral,
        law_steps.store_gains,
        unread=frozenset({"preview", "tolerance"}),
        gains=FEEDBACK,
        is_round=False,
    )
    preview, tolerance = 0.02, 0.0  # read by `StictionCompensation` alone

    def __init__(
        self,
        drive: Drive,
        proportional: float = 1.0,
        integral: float = 2.0,
        feed_forward: bool = True,
    ) -> None:
        """Prepare for the first episode, with the gains K_p [-] and K_i [1/s].

        With `feed_forward` the desired torque is fed forward.

        Raises:
            CableError: If a gain is negative or not a number.
        """
        super().__init__(drive)
        require_number("proportional", proportional, 0.0, 1e6, "")
        require_number("integral", integral, 0.0, 1e6, "1/s")
        self.proportional, self.integral = proportional, integral
        self.feed_forward = feed_forward
        self.spring = joint_spring(drive.cables, self.limits)
        """All cables as a spring at the joint, see `guard.STIFFNESS`; 0 where they are
        not known."""
        self.settling = stable_settling_time(drive, self.spring)
        """Time in which the motor settles relative to the joint [s]; without a model
        only while the guard releases the joint."""

    @property
    def gains(self) -> dict[str, float]:
        found = self.limits._asdict() | {"feed_forward": float(self.feed_forward)}
        names = "proportional", "integral", "settling", "preview", "tolerance"
        found |= {name: getattr(self, name) for name in names}
        return found | dict(
            zip(law_steps.SPRING_GAINS, self.spring.tolist(), strict=True)
        )

    def law_tables(self) -> LawTables:
        return LawTables((), (), law_steps.CABLES, (law_steps.LAST_COMMAND,))

    def measured(self, observation: Mapping[str, Any]) -> FloatArray:
        if self.stepped.is_round:
            return super().measured(observation)
        # Without a safe torque there is no guard, which alone reads angles.
        is_guarded = self.drive.safe_torque < math.inf
        names = LAW_INPUTS if is_guarded else LAW_INPUTS[guard.TORQUE :]
        if WINDING_COLUMNS[1] in observation:
            # Levers, and cables that other joints wind.
            joint = {name: observation[wound] for name, wound in WOUND.items()}
            observation = {**observation, **joint}
        part = readings(observation, names)
        seen = np.zeros((len(part), len(LAW_INPUTS)))
        seen[:, -len(names) :] = part
        return seen

    def memory(self, rows: int) -> FloatArray:
        """Return the memory of every environment, with the present gains."""
        found = super().memory(rows)
        found[:, law_steps.GAINS : law_steps.CABLES] = list(self.gains.values())
        return found


def stable_settling_time(
    drive: Drive, spring: FloatArray, settling: float = guard.RELEASE_TIME
) -> float:
    """Return the time in which a damped motor settles [s]: `settling` if it is stable.

    Otherwise it is shorter, or 0 for no damper. `spring` is all cables at the joint,
    see `guard.STIFFNESS`.
    """
    stiffness = float(spring[guard.STIFFNESS])
    if not (drive.inertia > 0.0 and stiffness > 0.0):
        return settling
    # A damper sampled this slowly would drive the motor, not calm it.
    most = guard.MAX_DAMPING_SHARE * drive.inertia / (drive.period + drive.motor_lag)
    at_motor = stiffness / drive.ratio**2
    stable = guard.damper_share(motor_limits(drive), spring)
    return stable * min(settling, most / at_motor)


class Feedback(ProportionalIntegral):
    """Feedback alone: proportional and integral, without feed-forward.

    The "model-free linear feedback controller" of the thesis, section 4.3.1.
    """

    stepped = ProportionalIntegral.stepped

    def __init__(
        self, drive: Drive, proportional: float = 1.0, integral: float = 2.0
    ) -> None:
        super().__init__(drive, proportional, integral, feed_forward=False)


class LoopGains(NamedTuple):
    """Gains of a torque loop that is stable with the delay of the drive."""

    settling: float  # damping of the motor over the stiffness of the cables [s]
    proportional: float  # K_p [-]
    integral: float  # K_i [1/s]


def require_known_motor(drive: Drive) -> None:
    """Raise a `CableError` if cables or rotor of a drive are not known."""
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
    T). The bandwidth of the integral is `integral_share` of the least of 1 / T, k / D,
    D / J. These shares were tuned by `scripts/benchmarks/tune_baselines.py`. The damper
    is off if, with its delay, it would feed the oscillation of rotor and cables.
    """
    require_known_motor(drive)
    inertia, late = drive.inertia, total_delay(drive)
    limits = motor_limits(drive)
    spring = joint_spring(drive.cables, limits)
    stiffness = float(spring[guard.STIFFNESS]) / drive.ratio**2
    damping = 2.0 * 0.7 * math.sqrt(stiffness * inertia)  # damping ratio 0.7
    damping = min(damping, _DELAY_SHARE * inertia / late)
    # At most 2: with little delay the share alone would allow any gain.
    proportional = min(_DELAY_SHARE * damping / (stiffness * late), 2.0)
    bandwidth = min(1.0 / late, stiffness / damping, damping / inertia)
    integral = integral_share * (1.0 + proportional) * bandwidth
    damping *= guard.damper_share(limits, spring)
    return LoopGains(damping / stiffness, proportional, integral)


class TunedFeedback(ProportionalIntegral):
    r"""`pi` with a damped motor and gains from rotor, cables and delay; no model.

    \[ \tau_m = \frac{1}{\rho} \Bigl( \tau_d + K_p e + K_i \int e \, dt \Bigr)
       - D (\dot\theta_m - \rho \dot\theta_j) \]

    with the gains of `loop_gains`. It is stable on a light winch, where the gains of
    the thesis are not. While a single cable is to pull nothing, there is a dead zone:
    an error e within six standard deviations of the sensor, given by `Drive` or
    measured, counts as 0. Otherwise a sensor bias would wind the cable in and out in a
    limit cycle. The dead zone shrinks to none at a desired torque of twice its width.
    """

    stepped = dataclasses.replace(
        ProportionalIntegral.stepped, step=law_steps.step_tuned, is_round=True
    )
    integral_share = 0.35  # bandwidth of the integral over that of the damped motor
    friction_share = 0.0  # share of the friction of slipping cables that is fed forward
    slip_speed = 0.3
    """Speed of the joint at which the sense of slip is nearly certain [rad/s]."""
    single_dead_sigmas = 6.0
    """Dead zone of a single cable at no desired torque, in standard deviations of the
    torque sensor: three times those of its bias in the benchmark.
    """

    def __init__(self, drive: Drive) -> None:
        """Prepare for the first episode.

        Raises:
            CableError: `cables` or the motor's inertia are not known.
        """
        found = loop_gains(drive, self.integral_share)
        super().__init__(drive, found.proportional, found.integral)
        self.settling = found.settling
        self.dead_sigmas = self.single_dead_sigmas if drive.one_way else 0.0

    def law_tables(self) -> LawTables:
        cables = cable_table(self.drive.cables, self.limits)
        noise = self.drive.torque_noise
        settings = self.friction_share, self.slip_speed, self.dead_sigmas, noise
        return LawTables(
            cables.shape,
            (*settings, *cables.ravel().tolist()),
            law_steps.CABLES + law_steps.SIGNAL_SIZE,
            (law_steps.LAST_COMMAND,),
        )


class FrictionFeedForward(TunedFeedback):
    r"""`pi_tuned` with the friction of slipping cables fed forward, smoothly.

    The motor torque of cables that slip as a whole (`full_slip_balance`), with a
    quarter of the friction of the controller's model, takes the place of \(\tau_d /
    \rho\). The sense of the slip is the hyperbolic tangent of the speed \(\dot\theta_j
    + \dot\tau_d / k\) that the motor has to follow, over 0.3 rad/s: it is 0 at rest, so
    the motor does not chatter there. More friction would make a light winch oscillate.
    `friction` is all that it knows of friction; the rest is left to the feedback.
    """

    stepped = TunedFeedback.stepped
    integral_share = 0.5
    friction_share = 0.25
