"""Position control: a motor angle for the desired joint angle, and a servo.

    law = controller("none", drive)               # of a drive that commands an angle
    law.torque({"reference_angle_rad": 0.2, "motor_angle_rad": 0.0,
                "motor_velocity_rad_s": 0.0})     # N m

    found = fit_hysteresis(HysteresisTrial.of(motor, joint, drive.ratio), drive)
    law = controller("backlash_inverse", replace(drive, hysteresis=found))

A law maps desired joint angles to motor angles, in order of time; that map may
compensate friction and stretch of the cable. The servo reads the encoder of the motor
alone, as that of an endoscope does.

`cable_inverse` inverts the model of distributed friction: the kernel of the package
(`cable._stepper`) with a spring at the joint. At a joint angle the spring defines the
torque of the cables, and the motor turns to the nearest angle at which they make it.
Partial motion, and a backlash that grows with the load, follow from the friction.
Angles alone determine no force: a spring, a rope and a pretension that are all twice as
strong move alike. So the axial stiffness stays that of the data sheet.
"""

import dataclasses
import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.exclusive import exclusive
from cc_mujoco._validation import require_number, require_parameter
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.control import _controller as controller
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._cable_model import joint_spring, stepper_cables
from cc_mujoco.control._hysteresis import MODELS, HysteresisTrial, Line
from cc_mujoco.control._rollout import joint_torque
from cc_mujoco.device._drive import CableDrive, Drive
from cc_mujoco.device._sensors import REFERENCE_COLUMN
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.native import FloatArray as Array

FITTED = (*MODELS, "cable_inverse")
"""Controllers whose parameters are fitted to a trial."""
BANDWIDTH = 150.0  # bandwidth of the servo without delay [rad/s]


class PositionController(controller.Controller):
    r"""Motor angle for each desired joint angle, held by a servo.

    \[ \tau_m = J \omega^2 \Bigl( e + \tfrac{\omega}{5} \int e \, dt \Bigr)
       + 2 J \omega \, \dot e, \qquad e = \theta^* - \theta_m \]

    with the motor's inertia J, the bandwidth \(\omega\), lower if measurements are
    delayed, and the motor angle \(\theta^*\) of the law, both angles relative to the
    start. The law jumps at a reversal of the joint; the part that would need more than
    a quarter of the motor's torque decays with the time constant of the servo, so that
    the motor does not overshoot. The integral stops while the motor is at its limit.
    The joint angle at the start is measured or, without a sensor there, its neutral
    angle.
    """

    def __init__(self, drive: Drive, bandwidth: float = BANDWIDTH) -> None:
        """Prepare for the first episode, with a bandwidth of the servo [rad/s].

        Raises:
            CableError: The bandwidth is out of range, or the inertia is not known.
        """
        super().__init__(drive)
        require_number("bandwidth", bandwidth, 1.0, 1e4, "rad/s")
        # Inertia below which a servo cannot be tuned [kg m^2].
        if not drive.inertia > 1e-9:
            raise CableError(
                "a position controller needs the inertia of the motor; Drive.inertia "
                f"is {drive.inertia:g} kg m^2."
            )
        # The servo's bandwidth times the delay of the loop is at most 0.4 rad.
        self.bandwidth = min(bandwidth, 0.4 / controller.total_delay(drive))
        most = min(abs(drive.low) or math.inf, abs(drive.high) or math.inf)
        # A quarter of the motor's torque is used to follow a change of rate.
        self._acceleration = 0.25 * most / drive.inertia
        self._rows = 0
        self.reset()

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        if where is None:
            self._rows = 0
        elif self._rows:
            self._fresh |= where

    @abstractmethod
    def begin(self, rows: NDArray[np.intp], count: int) -> None:
        """Begin an episode, at rest, in the environments `rows` out of `count`."""

    @abstractmethod
    def motor_angle(self, joint: Array, observation: Mapping[str, Any]) -> Array:
        """Return the angle of the motor from its start (n,) [rad].

        `joint` is the desired joint angle from its start (n,) [rad]; the observation
        has the measurements of this instant, arrays or numbers.
        """

    def torque(self, observation: Mapping[str, Any]) -> Any:
        names = REFERENCE_COLUMN, "motor_angle_rad", "motor_velocity_rad_s"
        reference, angle, velocity = controller.readings(observation, names).T
        count = reference.size
        if self._rows != count:
            self._rows, self._fresh = count, np.ones(count, dtype=np.bool_)
            self._start, self._memory = np.zeros(count), np.zeros((5, count))
            self.joint_start = np.full(count, self.drive.joint_neutral)
        fresh = self._fresh
        if fresh.any():
            self._start[fresh] = angle[fresh]
            self._memory[:, fresh] = 0.0
            if self.drive.joint_sensor:
                (joint,) = controller.readings(observation, ["joint_angle_rad"]).T
                self.joint_start[fresh] = joint[fresh]
            self.begin(np.flatnonzero(fresh), count)
        wanted = self.motor_angle(reference - self.joint_start, observation)
        self._fresh = np.zeros(count, dtype=np.bool_)
        given = self._servo(wanted, angle - self._start, velocity)
        return float(given[0]) if np.ndim(observation[REFERENCE_COLUMN]) == 0 else given

    def _servo(self, wanted: Array, angle: Array, velocity: Array) -> Array:
        """Return the motor torques (n,) [N m] for motor angles `wanted` (n,) [rad].

        `angle` [rad] and `velocity` [rad/s] (n,) are measured, the angle from the
        start.
        """
        period, omega, inertia = self.drive.period, self.bandwidth, self.drive.inertia
        before, rate, left, leaving, total = self._memory
        demanded_rate, most = (wanted - before) / period, self._acceleration * period
        rate = np.clip(demanded_rate, rate - most, rate + most)
        # The part that is too fast remains, and decays without overshoot.
        left = left + (demanded_rate - rate) * period
        kept, turn = math.exp(-omega * period), omega * period
        left, leaving = (
            kept * ((1.0 + turn) * left + period * leaving),
            kept * ((1.0 - turn) * leaving - turn * omega * left),
        )
        speeding = omega * omega * left + 2.0 * omega * leaving
        error, missing = wanted - left - angle, rate - leaving - velocity
        # Rate of the servo's integral over its bandwidth.
        slow = total + 0.2 * omega * period * error
        demanded = omega * omega * (error + slow) + 2.0 * omega * missing + speeding
        demanded = inertia * demanded + self.drive.damping * (rate - leaving)
        given = np.clip(demanded, self.drive.low, self.drive.high)
        total = np.where(given == demanded, slow, total)
        self._memory = np.stack([wanted, rate, left, leaving, total])
        return np.asarray(given)


class IdealRatio(PositionController):
    """No compensation: the cable is assumed without friction and stretch."""

    def begin(self, rows: NDArray[np.intp], count: int) -> None:
        """Do nothing; see `PositionController.begin`."""

    def motor_angle(self, joint: Array, observation: Mapping[str, Any]) -> Array:
        """Return the ratio times the joint angle (n,) [rad]."""
        return self.drive.ratio * joint


def fit_hysteresis(
    trial: HysteresisTrial, drive: Drive, names: Iterable[str] = FITTED
) -> dict[str, dict[str, Any]]:
    """Fit the models of position controllers, names of `FITTED`, to a trial.

    Return parameters by the name of the controller, for `Drive.hysteresis`.
    `cable_inverse` needs the cables of `drive`.

    Raises:
        CableError: A name is unknown, or a model cannot be fitted.
    """
    found: dict[str, dict[str, Any]] = {}
    for name in names:
        look_up("fitted controller", name, dict.fromkeys(FITTED))
        if name in MODELS:
            found[name] = MODELS[name].fit(trial).to_dict()
        else:
            found[name] = dataclasses.asdict(fit_cable(trial, drive))
    return found


def known_parameters(drive: Drive, name: str) -> Mapping[str, Any]:
    if name not in drive.hysteresis:
        raise CableError(
            f"controller {name!r} needs parameters of a trial, which this device does "
            "not have: fit them by `cc-mujoco calibrate`, or take `none`."
        )
    return drive.hysteresis[name]


class HysteresisInverse(PositionController):
    """Inverse of the model of hysteresis `model_name`, with parameters of a trial."""

    model_name: ClassVar[str]  # one of `FITTED`

    def __init__(self, drive: Drive, bandwidth: float = BANDWIDTH) -> None:
        """Prepare for the first episode with the parameters of `Drive.hysteresis`."""
        super().__init__(drive, bandwidth)
        self.model: Any = self.model_of(drive)
        self._state = self.model.rest(0)

    def model_of(self, drive: Drive) -> Any:
        """Return the model, with methods `rest` and `invert` as a `HysteresisModel`."""
        name = self.model_name
        return MODELS[name].from_dict(name, known_parameters(drive, name))

    def begin(self, rows: NDArray[np.intp], count: int) -> None:
        if len(self._state) != count:
            self._state = self.model.rest(count)
        self._state[rows] = self.model.rest(rows.size)

    def motor_angle(self, joint: Array, observation: Mapping[str, Any]) -> Array:
        return np.asarray(self.drive.ratio * self.model.invert(self._state, joint))


class LinearFit(HysteresisInverse):
    """A straight line fitted to a trial: mean stretch, no hysteresis."""

    model_name = "linear"


class SmoothBacklashInverse(HysteresisInverse):
    """Inverse of a smooth backlash (Tao and Kokotović 1993), fitted to a trial."""

    model_name = "backlash_inverse"


class PrandtlIshlinskiiInverse(HysteresisInverse):
    """Inverse of the modified Prandtl-Ishlinskii operator (Kuhnen 2003), fitted."""

    model_name = "prandtl_ishlinskii"


class BoucWenFeedForward(HysteresisInverse):
    """Feed-forward of a Bouc-Wen model (Do et al. 2014), fitted to a trial."""

    model_name = "bouc_wen"


@dataclass(frozen=True)
class CableParameters:
    """Friction and pretension over the data sheet, and joint spring, of a trial."""

    friction: float  # friction coefficient over that of the data sheet [-]
    pretension: float  # pretension over that of the data sheet [-]
    joint_stiffness: float  # stiffness of the spring at the joint [N m/rad]

    def __post_init__(self) -> None:
        require_parameter(self, "friction", 0.0, 100.0, "")
        require_parameter(self, "pretension", 0.0, 100.0, "")
        require_parameter(self, "joint_stiffness", 1e-9, 1e6, "N m/rad")


class CableCourse:
    """Cables and a joint spring that are moved from rest along joint angles."""

    def __init__(
        self, cables: Sequence[CableDrive], parameters: CableParameters
    ) -> None:
        """Set cables and spring to rest, with motor and joint at angle 0.

        `cables` have the values of the data sheet, which `parameters` scale.
        """
        own = []
        for one in cables:
            cable = one.cable.replace(
                friction=parameters.friction * one.cable.friction,
                static_friction=parameters.friction * one.cable.static_friction,
                pretension=parameters.pretension * one.cable.pretension,
            )
            own.append(dataclasses.replace(one, cable=cable))
        self._cables = stepper_cables(own)
        self._ratio = cables[0].distal / cables[0].proximal
        self._stiffness = parameters.joint_stiffness
        self._state = stepper.rest_states(self._cables, 0.0, 0.0)
        self._preload = stepper.torque(self._cables, self._state, True, 0.0)[0]
        self._new = self._state.copy()
        self._work = stepper.scratch(self._cables)
        self._motor, self._joint, self._reach = 0.0, 0.0, 1e-3

    @exclusive
    def advance(self, joint: float) -> float:
        """Return the motor angle over the ratio for the next joint angle [rad].

        It is the nearest, in the direction of the joint's motion, at which the cables
        make the torque of the spring. If they already make more, the motor rests.
        """
        from scipy.optimize import brentq

        turned = joint - self._joint
        if turned == 0.0:
            return self._motor / self._ratio
        way, sense = float(np.sign(turned * self._ratio)), float(np.sign(turned))
        wanted = self._preload + self._stiffness * joint

        def lack(beyond: float) -> float:
            motor, dt = self._motor + way * beyond, 0.01  # s, for friction at speed
            stepper.move(
                self._cables, self._state, motor, joint, dt, self._new, self._work
            )
            return sense * (wanted - joint_torque(self._cables, self._new, motor))

        low, high = 0.0, self._reach
        if lack(low) > 0.0:
            while lack(high) > 0.0:
                if high > 20.0 * abs(self._ratio):  # rad of the joint
                    raise CableError(
                        f"no motor angle bends the joint to {joint:.4g} rad in the "
                        "model of the cables; its stiffness or friction is wrong."
                    )
                low, high = high, 2.0 * high
            tolerance = 1e-7  # rad of the motor
            beyond = float(brentq(lack, low, high, xtol=tolerance))
            lack(beyond)
            self._motor += way * beyond
            self._reach = max(1.5 * beyond, 2.0 * tolerance)
        else:
            lack(low)
        self._state[:] = self._new
        self._joint = joint
        return self._motor / self._ratio


def course_of(
    cables: Sequence[CableDrive], parameters: CableParameters, joint: Array
) -> Array:
    """Return motor angles over the ratio of a `CableCourse` by joint angles (n,)."""
    course = CableCourse(cables, parameters)
    return np.array([course.advance(float(angle)) for angle in joint])


def fit_cable(trial: HysteresisTrial, drive: Drive) -> CableParameters:
    """Return the `CableParameters` that fit a trial by least squares."""
    from scipy.optimize import least_squares

    require_cables(drive)
    every = max(1, trial.joint_angle.size // 500)
    motor, joint = trial.motor_angle[::every], trial.joint_angle[::every]
    weights = HysteresisTrial(motor, joint).weights
    cables = joint_spring(drive.cables, controller.motor_limits(drive))[guard.STIFFNESS]

    def parameters(logs: Array) -> CableParameters:
        friction, pretension, spring = np.exp(np.clip(logs, -6.0, 4.0)).tolist()
        return CableParameters(friction, pretension, spring * cables)

    def residual(logs: Array) -> Array:
        found = course_of(drive.cables, parameters(logs), joint)
        return np.asarray(weights * (found - motor))

    # Without friction, slope - 1 is the stiffness of the spring over that of the
    # cables.
    slope = np.polyfit(joint, motor, 1, w=weights)[0]
    start = np.log([1.0, 1.0, min(max(slope - 1.0, 0.02), 5.0)])
    found = least_squares(residual, start, diff_step=1e-3, xtol=1e-4, ftol=1e-5)
    return parameters(found.x)


def require_cables(drive: Drive) -> None:
    if not drive.cables:
        raise CableError(
            "controller 'cable_inverse' needs to know the cables; this Drive has no "
            "cable drives."
        )


class _CableCourses:
    """Inverse of the cables' model, with `rest` and `invert` of a `HysteresisModel`."""

    def __init__(self, drive: Drive, parameters: CableParameters) -> None:
        self._cables, self._parameters = drive.cables, parameters

    def rest(self, count: int) -> NDArray[np.object_]:
        courses = [CableCourse(self._cables, self._parameters) for _ in range(count)]
        return np.array(courses, dtype=object)

    def invert(self, state: NDArray[np.object_], joint: Array) -> Array:
        each = zip(state, joint, strict=True)
        return np.array([course.advance(float(angle)) for course, angle in each])


class CableInverse(HysteresisInverse):
    """Inverse of the model of distributed friction, fitted to a trial."""

    model_name = "cable_inverse"

    def model_of(self, drive: Drive) -> _CableCourses:
        require_cables(drive)
        given = known_parameters(drive, self.model_name)
        kinds = {field.name for field in dataclasses.fields(CableParameters)}
        if set(given) != kinds:
            raise CableError(
                f"{self.model_name!r} needs the parameters {', '.join(sorted(kinds))}, "
                f"not {', '.join(sorted(given))}."
            )
        return _CableCourses(drive, CableParameters(**given))


class DistalFeedback(HysteresisInverse):
    """Inverse of a smooth backlash, and integral feedback of the measured joint angle.

    Without fitted parameters the inverse is the ideal ratio. It needs a joint sensor,
    which an endoscope does not have.
    """

    model_name = "backlash_inverse"

    def __init__(
        self, drive: Drive, bandwidth: float = BANDWIDTH, gain: float = 20.0
    ) -> None:
        """Prepare with an integral gain of the joint angle's error [1/s].

        For the bandwidth of the servo [rad/s] see `PositionController`.

        Raises:
            CableError: The joint is not measured, or the gain is out of range.
        """
        super().__init__(drive, bandwidth)
        if not drive.joint_sensor:
            raise CableError(
                "controller 'distal_feedback' reads the angle of the joint, which this "
                "device does not measure; set joint_sensor = true in [sensors], or "
                "take another controller."
            )
        require_number("gain", gain, 0.0, 1e3, "1/s")
        self.gain = gain
        self._correction = np.zeros(0)

    def model_of(self, drive: Drive) -> Any:
        known = self.model_name in drive.hysteresis
        return super().model_of(drive) if known else Line(1.0, 0.0)

    def begin(self, rows: NDArray[np.intp], count: int) -> None:
        super().begin(rows, count)
        if len(self._correction) != count:
            self._correction = np.zeros(count)
        self._correction[rows] = 0.0

    def motor_angle(self, joint: Array, observation: Mapping[str, Any]) -> Array:
        error = joint + self.joint_start - observation["joint_angle_rad"]
        self._correction = self._correction + self.gain * self.drive.period * error
        ahead = self.model.invert(self._state, joint)
        return np.asarray(self.drive.ratio * (ahead + error + self._correction))
