"""Faults that stop a run: sensors lost, implausible or frozen, and missed deadlines."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cc_mujoco._validation import bounded, require_bounds
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.control._cable_model import CableModel
from cc_mujoco.control._compensation import Model
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.errors import CableError
from cc_mujoco.hardware._limits import Limits
from cc_mujoco.hardware._packet import Readings, Status
from cc_mujoco.native import compiled


class TorqueSensor:
    """Detection of a joint torque sensor that is dead or has the wrong sign.

    As cables are elastic, the angles of motor and joint predict how their torque at the
    joint changes. Errors in the scene's friction and stiffness change the size of the
    prediction, but not its sign.
    """

    def __init__(self, drive: Drive, readings: int, swing: float) -> None:
        """Compile the model, so that no cycle has to wait for that.

        The sensor counts as dead after `readings` equal values, during which the
        predicted torque has changed by `swing` [N m].
        """
        self._model = CableModel(drive)
        time = 1.0  # time constant of the averages of both torques [s]
        self._share = -math.expm1(-drive.period / time)
        self._settled = max(readings, round(time / drive.period))
        self._readings, self._swing = readings, swing
        self._count = self._equal = 0
        self._joint, self._last, self._range = 0.0, math.nan, (0.0, 0.0)
        self._moments = np.zeros(5)
        self._predicted(0.0, 0.0)
        self._model.reset()

    def reading(self, motor: float, joint: float, torque: float) -> str | None:
        if self._count == 0:
            self._joint = joint
        predicted = self._predicted(motor, joint - self._joint)
        self._count += 1
        return self._is_dead(torque, predicted) or self._is_reversed(torque, predicted)

    def _predicted(self, motor: float, joint: float) -> float:
        """Return the cables' torque at the joint for angles of both ends [N m]."""
        model = self._model
        model.ready(np.array([motor]))
        return _predict_torque(model.models[0], motor, joint, model.drive.period)

    def _is_dead(self, torque: float, predicted: float) -> str | None:
        if torque != self._last:
            self._last, self._equal = torque, 0
            self._range = predicted, predicted
            return None
        self._equal += 1
        self._range = min(self._range[0], predicted), max(self._range[1], predicted)
        swing = self._range[1] - self._range[0]
        if self._equal < self._readings or swing < self._swing:
            return None
        return (
            f"the torque sensor is dead: {self._equal + 1} readings of {torque:.4g} "
            "N m while the angles of motor and joint changed the torque by "
            f"{swing:.3g} N m."
        )

    def _is_reversed(self, torque: float, predicted: float) -> str | None:
        moments = self._moments  # exponential averages
        if self._count == 1:
            moments[:2] = torque, predicted
        off = np.array([torque, predicted]) - moments[:2]
        share, kept = self._share, 1.0 - self._share
        moments[:2] += share * off
        products = np.append(off * off, off[0] * off[1])
        moments[2:] = kept * (moments[2:] + share * products)
        measured, expected = math.sqrt(moments[2]), math.sqrt(moments[3])
        if self._count < self._settled or min(measured, expected) < 0.5 * self._swing:
            return None
        correlation = moments[4] / (measured * expected)
        if correlation > -0.8:
            return None
        return (
            "the torque sensor is reversed: it falls where the angles of motor and "
            f"joint make the torque rise (correlation {correlation:.2f}); mend its "
            "sign."
        )


@compiled
def _predict_torque(model: Model, motor: float, joint: float, dt: float) -> float:
    """Move cables to angles of both ends [rad]; return their joint torque [N m]."""
    cables, state, new = model.cables, model.state, model.new
    stepper.move(cables, state, motor, joint, dt, new, model.work)
    state[:] = new
    return float(stepper.torque(cables, state, True, motor)[0])


@dataclass(frozen=True)
class Watchdog:
    """Consecutive cycles for which a fault may last before a run stops."""

    missed_readings: int = bounded(10, 1, 1e6, "cycles")  # without a new reading
    missed_deadlines: int = bounded(10, 1, 1e6, "cycles")
    """Cycles that were skipped because the host was late."""
    frozen_readings: int = bounded(20, 1, 1e6, "cycles")
    """Equal readings while the torque commands differ."""
    frozen_torque: float = bounded(0.2, 1e-6, 2.0, "of the torque's limit")
    """Range of the torque commands meanwhile, as a share of the torque's limit [-]."""
    frozen_angle: float = bounded(0.2, 1e-6, 1e3, "rad")
    """Largest angle that one encoder may turn, at the joint, while the other is
    constant to the bit [rad]; greater than play, stretch and slack of the cables."""
    twist: float = bounded(0.5, 1e-6, 1e9, "rad")
    """Largest twist between motor and joint, at the joint [rad]; greater than play and
    stretch of a pair of cables. It is not checked for a single cable, which may be
    slack."""

    def __post_init__(self) -> None:
        require_bounds(self)


class Watch:
    """Checks of every cycle; they return a reason to stop, or None."""

    def __init__(
        self,
        limits: Limits,
        watchdog: Watchdog,
        drive: Drive,
        unmeasured: Sequence[str] | None = None,
    ) -> None:
        """Prepare the checks, and the cable model that they need, for the first cycle.

        `unmeasured` are joints that move the cables but that the rig does not measure;
        by default all but the driven one. A limit of tension needs them all measured.
        """
        self._limits, self._watchdog, self._drive = limits, watchdog, drive
        if unmeasured is None:
            unmeasured = drive.crossed
        self._cables: CableModel | None = None
        if math.isfinite(limits.tension):
            most = max(each.cable.pretension for each in drive.cables)
            if limits.tension <= most:
                raise CableError(
                    "[limits] tension must be above the scene's pretension of "
                    f"{most:g} N, not {limits.tension:g}."
                )
            if unmeasured:
                raise CableError(
                    f"[limits] tension needs to know how joint {', '.join(unmeasured)} "
                    "winds the cable too, which the rig does not measure; leave it out."
                )
            self._cables = CableModel(drive)
            self._cables.follow([0.0], [0.0])  # compiled before the first cycle
            self._cables.reset()
        self._twist: float | None = None
        self._late = self._without = self._disabled = self._equal = 0
        self._enabled = False
        self._last: Readings | None = None
        self._commanded = (0.0, 0.0)
        self._still, self._held = [0, 0], [0.0, 0.0]
        self._times: tuple[float, float] | None = None
        self.has_stepped = False
        """True if the rig's clock has jumped, so that times of readings are wrong."""
        self._sensor: TorqueSensor | None = None
        if drive.cables and not unmeasured:
            swing = watchdog.frozen_torque * limits.torque * abs(drive.ratio)
            self._sensor = TorqueSensor(drive, watchdog.frozen_readings, swing)
        # One cable may be slack.
        self._twists = not (unmeasured or drive.one_way)

    def deadline(self, missed: int) -> str | None:
        """Check the cycles missed in a row, `missed` more of them."""
        self._late = self._late + missed if missed else 0
        if self._late < self._watchdog.missed_deadlines:
            return None
        return f"the host was late: {self._late} cycles in a row were missed."

    def reading(self, found: Readings | None, torque: float, now: float) -> str | None:
        """Check a reading after a motor torque [N m], at the time `now` [s]."""
        if found is None:
            self._without += 1
            if self._without < self._watchdog.missed_readings:
                return None
            return f"the rig is silent: no new reading in {self._without} cycles."
        self._without = 0
        return (
            self._check_rig_status(found)
            or self._impossible(found)
            or self._stepped(found.time, now)
            or self._frozen(found, torque)
        )

    def _stepped(self, time: float, now: float) -> str | None:
        before, self._times = self._times, (time, now)
        if before is None:
            return None
        step = (time - before[0]) - (now - before[1])
        if abs(step) < 1.0:
            return None
        self.has_stepped = True
        return (
            f"the rig's clock stepped by {step:+.4g} s; what it measures from there on "
            "is not logged."
        )

    def transmission(self, found: Readings, wound: Mapping[str, float]) -> str | None:
        """Check that motor and joint agree, by the model of the cables between them.

        `found` has passed `reading`; `wound` has `WINDING_COLUMNS` of cables without a
        round pulley, for the model, which has one, see `control.as_round_pulley`.
        """
        motor, angle, torque = found.motor_angle, found.joint_angle, found.joint_torque
        if wound:
            angle, _, leverage = (wound[name] for name in WINDING_COLUMNS)
            torque /= leverage
        return (
            self._twist_fault(motor, angle)
            or self._tension_fault(motor, torque)
            or (self._sensor.reading(motor, angle, torque) if self._sensor else None)
        )

    def _check_rig_status(self, found: Readings) -> str | None:
        status = found.status
        if status is None:
            return None
        if status & Status.FAULT:
            return "the rig reports a fault."
        if status & Status.STOPPED:
            return "the rig was stopped at its own side."
        if status & Status.ENABLED:
            self._enabled = True
            return None
        if self._enabled:
            return "the rig has disabled its motor; did its own watchdog end?"
        self._disabled += 1
        if self._disabled < self._watchdog.missed_readings:
            return None
        return f"the rig does not enable its motor: {self._disabled} readings say so."

    def _impossible(self, found: Readings) -> str | None:
        limits = self._limits
        for name, most, unit in (  # largest size that is no fault, whatever the limits
            ("time", math.inf, "s"),
            ("motor_angle", 1e6, "rad"),
            ("motor_velocity", 1e4, "rad/s"),
            ("joint_angle", math.inf, "rad"),
            ("joint_velocity", 1e3, "rad/s"),
            ("joint_torque", 1e5, "N m"),
        ):
            value = getattr(found, name)
            if not math.isfinite(value):
                return f"the reading of {name} is {value!r}, no finite number."
            if abs(value) > most:
                return (
                    f"the reading of {name} is {value:.4g} {unit}, and no device has "
                    f"more than {most:g}."
                )
        low, high = limits.joint_range
        if not low <= found.joint_angle <= high:
            return (
                f"the joint is at {found.joint_angle:.4g} rad, outside its range of "
                f"{low:g} to {high:g} rad."
            )
        for name, unit, limit in (
            ("motor_velocity", "rad/s", limits.motor_speed),
            ("joint_torque", "N m", limits.joint_torque),
        ):
            if abs(value := getattr(found, name)) > limit:
                return f"{name} is {value:.4g} {unit}, beyond its limit of {limit:g}."
        return None

    def _frozen(self, found: Readings, torque: float) -> str | None:
        last, self._last = self._last, found
        if last is None:
            self._held = [found.motor_angle, found.joint_angle]
            return None
        if found[1:6] == last[1:6]:
            self._equal += 1
            least, most = self._commanded
            self._commanded = min(least, torque), max(most, torque)
        else:
            self._equal, self._commanded = 0, (torque, torque)
        dog, change = self._watchdog, self._commanded[1] - self._commanded[0]
        changed = change >= dog.frozen_torque * self._limits.torque
        if changed and self._equal >= dog.frozen_readings:
            return (
                f"the sensors are frozen: {self._equal} equal readings while the "
                f"torque changed by {change:.3g} N m."
            )
        return self._frozen_encoder_fault(found, last)

    def _frozen_encoder_fault(self, found: Readings, last: Readings) -> str | None:
        dog, now = self._watchdog, (found.motor_angle, found.joint_angle)
        before = last.motor_angle, last.joint_angle
        for one, scale in ((0, 1.0), (1, 1.0 / self._drive.ratio)):
            other = 1 - one
            if now[one] != before[one]:
                # From here on is counted how far the other one turns.
                self._still[one], self._held[other] = 0, now[other]
                continue
            self._still[one] += 1
            turned = abs((now[other] - self._held[other]) * scale)
            if turned > dog.frozen_angle and self._still[one] >= dog.frozen_readings:
                names = ("motor", "joint")
                return (
                    f"the encoder of the {names[one]} is frozen: that of the "
                    f"{names[other]} turned by {turned:.3g} rad at the joint."
                )
        return None

    def _tension_fault(self, motor: float, torque: float) -> str | None:
        model = self._cables
        if model is None:
            return None
        model.follow([motor], [torque])
        for k in range(model.cables.n.size):
            most = float(model.tension(k).max())
            if most > self._limits.tension:
                which = "the cable" if model.cables.n.size == 1 else f"cable {k + 1}"
                return (
                    f"{which} carries {most:.4g} N by the scene's model, beyond its "
                    f"limit of {self._limits.tension:g}."
                )
        return None

    def _twist_fault(self, motor: float, angle: float) -> str | None:
        if not self._twists:
            return None
        ratio = self._drive.ratio
        twist = motor / ratio - angle
        if self._twist is None:
            self._twist = twist
        if (parted := abs(twist - self._twist)) <= self._watchdog.twist:
            return None
        return (
            f"motor and joint have gone {parted:.3g} rad apart, at the joint, "
            f"beyond twist = {self._watchdog.twist:g}: a cable is off, or the sign of "
            f"an encoder or the scene's ratio of {ratio:g} is wrong."
        )
