"""Friction compensation by plans: the model rolled out, a reversal crossed in one move.

law = PredictiveCompensation(env.unwrapped.drive)
"""

import math
from collections.abc import Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._validation import require_number
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _planner_memory as planner_memory
from cc_mujoco.control import _planner_steps as planner_steps
from cc_mujoco.control import _rollout as rollout
from cc_mujoco.control._cable_model import joint_spring, require_known_cables
from cc_mujoco.control._controller import (
    LawTables,
    SteppedController,
    SteppedLaw,
    cable_shape,
)
from cc_mujoco.control._planner_memory import PLANNER_INPUTS, TUNING
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray


class PredictiveCompensation(SteppedController):
    r"""Model-predictive control that plans the motor's path and rolls it out.

    The cables have no mass, so the angles of motor and joint alone say what torque they
    make; and it grows with the motor's angle. In every control step

    1. an observer updates model, rotor and motion to the time of the measurements, and
       finds their delay: the one whose past torque explains the rotor's motion best;
    2. the kernel predicts them over the delay, with the torques applied meanwhile;
    3. the joint and the desired torque are extrapolated over a short horizon, the joint
       as if a missing torque moved it a little, and the kernel finds for each knot the
       angle \(\theta^*_i\) of the motor that makes the desired torque, if the motor
       does not change its direction;
    4. the accelerations \(a_i\) of the motor minimise

       \[ \sum_i (\theta_i - \theta^*_i)^2 + \omega_c^{-4} a_i^2 \]

       so that a jump of \(\theta^*\), which is a reversal, is crossed in one smooth
       move that begins before it;
    5. if that leaves an error, a plan is made in the other direction, which is adopted
       if it reduces the error by more than a threshold. No model knows the width of
       a backlash to a percent, so the motor stops short of its end and creeps on;
    6. the motor gets the torque of the first acceleration and of the cables on its way,
       less the torque on the rotor that the model does not explain, by its observer.

    A motor that lags (`Drive.motor_lag`) is commanded ahead of that torque, so that
    its mean until the next knot is right. A motor whose command may not change as fast
    as that needs (`Drive.torque_rate`) gets another plan in 4: commands \(u_i\),
    constant between knots, with increments within the rate, that minimise

    \[ \sum_i (\theta_i - \theta^*_i)^2 + \omega_c^{-4}
       \bigl( (u_i - u^*_i) / J \bigr)^2 \]

    with the torque \(u^*_i\) that holds the motor of inertia J at \(\theta^*_i\). The
    first of them is the command.

    The energy that the joint received beyond the desired torque, by torque sensor and
    motion, is observed; while it is positive, a damper reduces the desired torque and
    dissipates it, so that the joint stays quiet in the hands of a passive
    wearer (B. Hannaford, J.-H. Ryu, "Time-domain passivity control of haptic
    interfaces", IEEE Trans. Robotics and Automation 18, 2002). The energy is only as
    accurate as the torque sensor.

    A second model, whose friction builds up over a small motion on `bristles`, follows
    the same measurements. A model errs at the joint, by the torque of the next step,
    and at the rotor, by the torque that it does not explain. If the product of both
    mean squared errors is below a tenth of the first model's, plans are made with
    bristles, until it is the larger one: with friction that acts at once a plan would
    cross a backlash that does not exist, and oscillate. The joint alone does not
    decide, as every step corrects both models there. The choice by their errors is that
    of D. Magill, "Optimal adaptive estimation of sampled stochastic processes", IEEE
    Trans. Automatic Control 10, 1965.

    Friction that falls with speed (Stribeck) or after a rest (ageing; with bristles,
    break-away) is left out of both models. Its feed-forward would release more torque
    than desired, and the joint would hunt (B. Armstrong-Hélouvry, P. Dupont, C. Canudas
    de Wit, "A survey of models, analysis tools and compensation methods for the control
    of machines with friction", Automatica 30, 1994).

    The friction coefficient of every cable follows the unexplained torque while all
    segments slip, and so does the bias of the torque sensor, which unlike friction does
    not reverse with the slip. Preview control of linear systems is that of M. Tomizuka,
    "Optimal continuous finite preview problem", IEEE Trans. Automatic Control 20, 1975.
    """

    stepped = SteppedLaw(
        planner_steps.step_plan,
        planner_steps.store_plan,
        has_model=True,
        fixed=frozenset(
            "period span rotor_0 rotor_1 motion_0 motion_1 motion_2 forgetting leak "
            "late lag creep".split()
        ),
        gains=TUNING,
        seen=PLANNER_INPUTS,
    )

    def __init__(
        self,
        drive: Drive,
        bandwidth: float | None = None,
        horizon: float = 0.024,
        knots: int = 8,
        rotor: float | None = None,
        motion: float = 300.0,
        belief: float = 0.5,
        turning: float = 3.0,
        learning: float = 20.0,
        zeroing: float = 2.0,
        latest: float = 0.015,
        damper: float | None = None,
        yielding: float = 2e-3,
        tolerance: float | None = None,
        bristles: float = 0.2,
        caution: float | None = None,
        iterations: float = math.inf,
    ) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device to be driven; its `cables` and the motor's inertia
                must be known.
            bandwidth: omega_c of the plan [rad/s]; at most 1.5 / delay. By default 300
                for a pair of cables and 200 for a single one.
            horizon: Horizon of the plan [s].
            knots: Number of knots of the plan.
            rotor: Bandwidth of the observer of the rotor [rad/s]; by default 900 for a
                pair of cables and 600 for a single one.
            motion: Bandwidth of the filters of joint and desired torque [rad/s]. An
                encoder of less than 14 bits at the joint needs less, about 200, or the
                motor chatters with its last bit.
            belief: Share of the torque sensor's deviation from the model that is
                adopted in a control step, above 0, to 1.
            turning: RMS error of the torque over the horizon that turning the motor
                must save, in standard deviations of the torque sensor.
            learning: Rate at which friction is learned [1/s].
            zeroing: Rate at which the bias of the torque sensor is learned where
                friction leaves no doubt of it [1/s]; at most twelve of its standard
                deviations.
            latest: Longest delay of measurements that is considered [s]; the search
                begins at the drive's own.
            damper: Strongest damper at the joint that spends energy, over the stiffness
                of the cables there [s]; 0 is none. By default 0.02 for a pair of
                cables and for one that passes joints of other axes, which swing
                together, and 0.001 for another: if the desired torque itself gives
                energy, errors of that torque seem to be a surplus.
            yielding: Time for which a missing torque, once it arrives, is expected to
                accelerate the joint's own inertia [s]; 0 is a joint whose motion is
                prescribed. A few times as much makes the loop unstable if a hand holds
                the joint loosely.
            tolerance: Tolerance of the torque that a knot of the plan makes, in
                standard deviations of the torque sensor. By default 0.5 for a pair of
                cables and 2 for a single one, which would otherwise reverse for too
                little gain.
            bristles: Motion of the joint over which friction builds up in a second
                model [rad], which plans use if it explains joint and rotor better; 0 is
                no such model. A model that has bristles itself has no second one.
            caution: Share of a crossing that the motor stops short of, and makes up
                for within 30 ms unless the torque answers before, from 0 to 1: what
                is crossed too far has to be crossed again. By default 0.12 for a pair
                of cables and 0 for a single one, whose torque it would delay.
            iterations: Most steps of the cables' model for the plans of a control step;
                if a plan might need more, the last plan continues.

        Raises:
            CableError: If cables or inertia are not known, a number is out of range, or
                the motor lags by more than the horizon.
        """
        super().__init__(drive)
        if not drive.inertia > 0.0:
            raise CableError(
                "a controller that plans the motor's path needs to know its inertia; "
                "Drive.inertia is 0."
            )
        require_known_cables(drive)
        pair = len(drive.cables) > 1
        usual = (300.0, 900.0, 0.12, 0.5) if pair else (200.0, 600.0, 0.0, 2.0)
        given = zip((bandwidth, rotor, caution, tolerance), usual, strict=True)
        bandwidth, rotor, caution, tolerance = (
            by_default if own is None else own for own, by_default in given
        )
        require_number("bandwidth", bandwidth, 1.0, 1e5, "rad/s")
        require_number("horizon", horizon, drive.period, 10.0, "s")
        if drive.motor_lag > horizon:
            raise CableError(
                f"Drive.motor_lag is {drive.motor_lag:g} s, longer than the horizon of "
                f"{horizon:g} s that is planned; give a longer horizon."
            )
        require_number("knots", knots, 1, 200, "knots")
        require_number("rotor", rotor, 1.0, 1e5, "rad/s")
        require_number("motion", motion, 1.0, 1e5, "rad/s")
        require_number("belief", belief, 1e-3, 1.0, "")
        require_number("turning", turning, 0.0, 1e6, "standard deviations")
        require_number("learning", learning, 0.0, 1e3, "1/s")
        require_number("zeroing", zeroing, 0.0, 1e3, "1/s")
        require_number("latest", latest, 0.0, 1.0, "s")
        if damper is None:
            damper = 0.02 if pair or drive.shared_ratios else 0.001
        require_number("yielding", yielding, 0.0, 0.1, "s")
        require_number("damper", damper, 0.0, 1.0, "s")
        require_number("caution", caution, 0.0, 1.0, "")
        least = 2 * rollout.MAX_EVALUATIONS + 5 * knots
        if not iterations >= least:
            raise CableError(
                f"iterations is {iterations!r}; {knots} knots need {least} or more."
            )
        require_number("bristles", bristles, 0.0, 10.0, "rad")
        require_number("tolerance", tolerance, 0.0, 1e6, "standard deviations")
        period = drive.period
        delays = np.arange(max(drive.delay, math.ceil(latest / period)) + 1)
        late = np.maximum(delays, 1) * period
        # Bandwidths of plan and observer [rad/s], limited by the delay [s].
        bandwidths = np.minimum(bandwidth, 1.5 / late)
        gains = np.array(
            [optimal_plan(knots, horizon / knots, slowed) for slowed in bandwidths]
        )
        # Else an inertia 30 % below its assumed value oscillates at 10 ms.
        rotors = np.minimum(rotor, 2.5 / late)
        unexplained = np.array([filter_gains(slowed * period)[2] for slowed in rotors])
        # Least noise, as a share of the greatest torque: a sensor without noise is no
        # reason to reverse for nothing.
        noise = max(drive.torque_noise, 1e-5 * max(map(abs, drive.reach)))
        spring = joint_spring(drive.cables, self.limits)
        rotor_0, rotor_1, _ = filter_gains(rotor * period)
        motion_0, motion_1, motion_2 = filter_gains(motion * period)
        self._gains: dict[str, float] = self.limits._asdict() | dict(
            damping=drive.damping,
            span=horizon / knots,
            tolerance=tolerance * noise,
            turning=(turning * noise) ** 2,
            noise=6.0 * noise,  # torque that is significant whatever the bias [N m]
            belief=belief,
            learning=learning,
            zeroing=zeroing,
            least=0.05 * max(abs(drive.low), abs(drive.high)),
            spend=0.02,
            slow=0.1,
            damper=damper * float(spring[guard.STIFFNESS]),
            rotor_0=rotor_0,
            rotor_1=rotor_1,
            motion_0=motion_0,
            motion_1=motion_1,
            motion_2=motion_2,
            forgetting=period / 0.1,  # errors of observers are compared over 0.1 s
            leak=period / 10.0,
            yielding=yielding / known if (known := drive.joint_inertia) else 0.0,
            late=drive.delay,
            lag=drive.motor_lag,
            rate=drive.torque_rate,
            bristles=bristles,
            caution=caution,
            iterations=iterations,
            # Pull of a cable at the motor that paying out keeps where drag leaves more
            # at the joint than desired, in standard deviations of the torque sensor:
            # slack there costs nothing, and a sensor with a bias would leave a pull.
            slack=2.0 * noise,
            # A crossing that stopped short is completed with a time constant of 0.03 s.
            creep=min(period / 0.03, 1.0),
        )
        self.tables = planner_memory.Tables(gains, unexplained, bandwidths**-4.0)
        self._angles = np.zeros((0, 0))

    @property
    def gains(self) -> dict[str, float]:
        return self._gains

    def law_tables(self) -> LawTables:
        shape = *cable_shape(self.drive.cables), *self.tables.gains.shape[:2]
        numbers = map(float, chain(*map(np.ravel, self.tables)))
        return self._laid_out(shape, tuple(numbers))

    @staticmethod
    def _laid_out(shape: tuple[int, ...], numbers: tuple[float, ...]) -> LawTables:
        """Return the `LawTables` of a planner with this shape and these constants."""
        given, states, size = planner_steps.places(np.array(shape, np.int64))
        guarded = planner_steps.LAW + planner_memory.GUARD + guard.COMMAND
        return LawTables(shape, numbers, size, (given - 1, guarded), states)

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        super().reset(where)
        if where is None:
            self._angles = np.zeros((0, 0))

    def rebend(self, angles: Sequence[FloatArray]) -> None:
        """Set another path of the conduits in the model, until all rows are reset.

        `angles` are the wrap angles of the segments of every cable (segments,) [rad].
        The length of the path stays, and so does the factor of friction.

        Raises:
            CableError: other shapes, or an angle that is negative or not finite.
        """
        given = [np.array(angle, dtype=float) for angle in angles]
        segments = [one.cable.segments for one in self.drive.cables]
        if [angle.shape for angle in given] != [(n,) for n in segments]:
            raise CableError(
                f"wrap angles have shapes {[angle.shape for angle in given]}; they "
                f"must be those of {segments} segments."
            )
        self._angles = np.zeros((len(segments), max(segments)))
        for cable, angle in enumerate(given):
            if not (np.all(np.isfinite(angle)) and np.all(angle >= 0.0)):
                raise CableError(
                    f"wrap angles of cable {cable} are {angle.tolist()} rad; all must "
                    "be finite and 0 or more."
                )
            self._angles[cable, : angle.size] = angle
        self._memory = np.array([self._bent(row) for row in self._memory])

    def fresh_memory(self) -> FloatArray:
        return self._bent(super().fresh_memory())

    def _bent(self, memory: FloatArray) -> FloatArray:
        """Return the memory of an environment with the path of `rebend`, if any."""
        if not self._angles.size:
            return memory
        bent = [*memory[: self.law_tables().size], 1.0, *self._angles.ravel()]
        bent[planner_steps.CHANGED] = 1.0
        return np.array(bent)


def optimal_plan(knots: int, span: float, bandwidth: float) -> FloatArray:
    """Return the gains of the optimal accelerations of a double integrator.

    Row i (knots, 2 + knots) multiplies angle [rad], velocity [rad/s] and the wanted
    angles at all knots [rad], and the sum is the acceleration before knot i [rad/s^2].
    Knots are `span` apart [s]; `bandwidth` [rad/s] weights squared accelerations by its
    power -4.
    """
    after = np.arange(1, knots + 1)
    free = np.stack([np.ones(knots), after * span], axis=1)
    driven = span**2 * np.tril(after[:, None] - after[None, :] + 0.5)
    weight = np.vstack([driven, np.eye(knots) / bandwidth**2])
    inverse = np.linalg.pinv(weight)[:, :knots]
    return np.ascontiguousarray(np.hstack([-inverse @ free, inverse]))


def filter_gains(rate: float) -> tuple[float, float, float]:
    """Return the gains of a third-order filter with all poles at exp(-rate), per step.

    They are those of value, rate and acceleration: R. Benedict, G. Bordner, "Synthesis
    of an optimal set of radar track-while-scan smoothing equations", IRE Trans.
    Automatic Control 7, 1962, for a constant acceleration.
    """
    pole = math.exp(-rate)
    gone = 1.0 - pole
    return 1.0 - pole**3, 1.5 * (1.0 - pole**2) * gone, 0.5 * gone**3
