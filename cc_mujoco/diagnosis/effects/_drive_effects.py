"""Effects of pulleys, motor and joint, and of sensors, which act after all others."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from cc_mujoco.diagnosis.effects._effect import (
    Cables,
    RigGeometry,
    Shape,
    Signals,
    Size,
    Values,
    clamp_to_bounds,
    dry_friction,
    form_key,
)
from cc_mujoco.native import FloatArray


def _eccentric(given: Cables, values: Values, rig: RigGeometry) -> Cables:
    def wave(name: str) -> tuple[float, float]:
        cosine, sine = values[f"{name}_cosine"], values[f"{name}_sine"]
        # A fit may try values that no cable accepts: more than the radius.
        size = min(math.hypot(cosine, sine), 0.45 * rig.motor_radius)
        return size, math.atan2(sine, cosine)

    turn = rig.exit_angle + math.pi * values.get(form_key("pulley_eccentricity"), 0.0)
    size, phase = wave("eccentricity")
    ovality, second = wave("ovality")
    return tuple(
        cable.replace(
            eccentricity=size,
            eccentricity_phase=math.remainder(phase + side * turn, math.tau),
            ovality=ovality,
            ovality_phase=math.remainder(second + 2.0 * side * turn, math.tau),
        )
        for side, cable in enumerate(given)
    )


def _soft_play(given: Cables, values: Values, rig: RigGeometry) -> Cables:
    # In the soft form the pretension presses each cable's part of the edges in by a
    # quarter of the play.
    play = values["backlash"]
    if play == 0.0 or round(values.get(form_key("backlash"), 0.0)) == 0:
        return given
    edge = 0.25 * play * rig.joint_radius
    soft = [c.end_compliance + edge / max(c.pretension, 1e-9) for c in given]
    ends = [clamp_to_bounds("end_compliance", each) for each in soft]
    pairs = zip(given, ends, strict=True)
    return tuple(cable.replace(end_compliance=each) for cable, each in pairs)


def acceleration(angle: FloatArray, dt: float | FloatArray) -> FloatArray:
    """Return the second derivative (samples,) [rad/s^2]; `dt` [s], or all times [s]."""
    return np.gradient(np.gradient(angle, dt), dt)


def _cogging(s: Signals, v: Values) -> Signals:
    at = v["cogging_order"] * s.motor_angle
    wave = v["cogging_cosine"] * np.cos(at) + v["cogging_sine"] * np.sin(at)
    return s.added(motor=wave)


def _gravity(s: Signals, v: Values) -> Signals:
    q = s.joint_angle + s.tilt
    pull = v["gravity_sine"] * np.sin(q) + v["gravity_cosine"] * np.cos(q)
    return s.added(joint=-pull)


def _spring(s: Signals, v: Values) -> Signals:
    moment = v["joint_stiffness"] * s.joint_angle + v["joint_stiffness_moment"]
    return s.added(joint=-moment)


def _far_rest(v: Values) -> str:
    """Return a note if a spring's rest is so far away that it acts as an offset."""
    stiffness, moment = abs(v["joint_stiffness"]), abs(v["joint_stiffness_moment"])
    if moment <= math.tau * stiffness:  # within a turn
        return ""
    angle = moment / max(stiffness, 1e-300)
    return f"a spring that rests {angle:.3g} rad from joint angle 0, over a turn"


class DrumWinding:
    """Cable that winds on itself, so that the drum's radius grows."""

    equation = "r_m (1 + g w), w the angle by which a cable is wound on"
    source = "geometry"
    where = "motor"
    needs = "several radians of the motor, both ways"
    confused_with = ("pulley_eccentricity", "joint_stiffness", "joint_gravity")
    resembles = ("pulley_eccentricity",)

    def parameters(self) -> list[Size | Shape]:
        meaning = "relative growth of the drum's radius per wound angle"
        return [Size("drum_growth", "1/rad", 0.005, meaning, -0.2, 0.2, (0.0, 0.1))]

    def motor_arm(self, values: Values) -> tuple[float, ...]:
        return (values["drum_growth"],)


class _JointStop:
    """Elastic stop at one end of the joint's range."""

    equation = "tau_j -= k (q - q_stop) beyond the stop"
    source = "statics"
    where = "joint"
    needs = "several motions into the stop"
    confused_with = ("joint_stiffness", "joint_gravity")
    resembles = confused_with
    generalises = ("joint_stiffness",)  # where it never lets go
    side = 1.0
    """1 for the stop at the largest angle, -1 for that at the smallest."""
    name = ""

    def parameters(self) -> list[Size | Shape]:
        starts = self.side * np.array([0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0, 1.3, 1.7])
        return [
            Size(f"{self.name}_stiffness", "N m/rad", 5.0, "stiffness", 0.0, 1e4),
            Shape(
                f"{self.name}_angle",
                "rad",
                [-starts[2], -starts[0], 0.0, *starts],
                -6.3,
                6.3,
                "angle of the joint at which it begins",
                within=1.0,  # a spring that never lets go is no stop
            ),
        ]

    def signals(self, signals: Signals, values: Values) -> Signals:
        beyond = self.side * (signals.joint_angle - values[f"{self.name}_angle"])
        torque = values[f"{self.name}_stiffness"] * np.maximum(beyond, 0.0)
        return signals.added(joint=-self.side * torque)


class UpperJointStop(_JointStop):
    """Stop at the largest angles of the joint."""

    name = "upper_stop"


class LowerJointStop(_JointStop):
    """Stop at the smallest angles of the joint."""

    side = -1.0
    name = "lower_stop"


class CurrentRipple:
    """Torque ripple of the motor in proportion to its current."""

    equation = "tau_m (1 + a cos(n q_m) + b sin(n q_m))"
    source = "harmonics of the back-EMF of brushless motors"
    where = "motor"
    needs = "slow motion over several poles at large and small loads"
    confused_with = ("motor_cogging", "torque_sensor_gain")

    def parameters(self) -> list[Size | Shape]:
        orders = [*range(4, 28, 2), 30, 36, 42, 48]
        return [
            Size("ripple_cosine", "1", 0.02, "relative ripple, cosine", -1.0, 1.0),
            Size("ripple_sine", "1", 0.02, "relative ripple, sine", -1.0, 1.0),
            Shape("ripple_order", "1", orders, 1.0, 200.0, "periods per turn"),
        ]

    def signals(self, signals: Signals, values: Values) -> Signals:
        phase = values["ripple_order"] * signals.motor_angle
        cosine, sine = values["ripple_cosine"], values["ripple_sine"]
        wave = cosine * np.cos(phase) + sine * np.sin(phase)
        return signals.added(motor=signals.motor * wave)


class JointFriction:
    """Dry friction of the joint, as `frictionloss` of MJCF, that may wind up."""

    equation = "tau_j -= F b, b = clip(b + dq/w, -1, 1) or tanh(q' / v)"
    forms = ("wound up", "lubricated")
    source = "Coulomb friction with presliding, Dahl 1968"
    where = "joint"
    needs = "the cables off and the joint moved both ways"
    confused_with = ("load_independent_friction", "asymmetric_friction")
    resembles = confused_with

    def parameters(self) -> list[Size | Shape]:
        meaning = "dry friction of the joint"
        turn = "turn of the joint over which its friction builds up"
        size = Size("joint_friction", "N m", 0.05, meaning, 0.0, 100.0)
        shape = Shape("joint_wind_up", "rad", [3e-4, 5e-3], 1e-5, 0.25, turn)
        return [size, shape]

    def signals(self, signals: Signals, values: Values) -> Signals:
        if round(values.get(form_key("joint_friction"), 0.0)) == 0:
            share = dry_friction(signals.joint_angle, values["joint_wind_up"])
        else:  # nothing at rest; full from a hundredth of the top speed on
            speed = signals.joint_speed
            fast = max(float(np.quantile(np.abs(speed), 0.95)), 1e-9)
            share = np.tanh(100.0 * speed / fast)
        return signals.added(joint=-values["joint_friction"] * share)


class CoupledNeighbour:
    """Torque of a neighbouring joint that acts on this one, by a measured column.

    Args:
        column: name of the column in the files.
    """

    title = "a neighbouring joint whose torque acts on this one"
    equation = "tau_j += a tau_n, tau_m += b tau_n"
    source = "a column of the data"
    where = "joint"
    needs = "motion of the neighbour that is not in step with the joint's"

    def __init__(self, column: str = "neighbour_torque_nm") -> None:
        self.columns = (column,)

    def parameters(self) -> list[Size | Shape]:
        sides = ("joint", "motor")
        names = {side: f"neighbour_at_{side}" for side in sides}
        return [Size(names[s], "1", 0.05, f"share that acts on the {s}") for s in sides]

    def signals(self, signals: Signals, values: Values) -> Signals:
        (column,) = self.columns
        other = signals.columns[column]
        motor, joint = values["neighbour_at_motor"], values["neighbour_at_joint"]
        return signals.added(motor=motor * other, joint=joint * other)


class LeverGeometry:
    """Moment arm at the joint that differs from that of the scene."""

    equation = "r_j (1 + a q + b q^2)"
    source = "geometry"
    where = "joint"
    needs = "loads over the whole range of the joint"
    confused_with = ("joint_stiffness", "joint_gravity", "pulley_eccentricity")
    resembles = ("pulley_eccentricity",)

    def parameters(self) -> list[Size | Shape]:
        return [
            Size("arm_slope", "1/rad", 0.02, "slope of the arm over it", -1.0, 1.0),
            Size("arm_bend", "1/rad^2", 0.02, "bend of the arm over it", -1.0, 1.0),
        ]

    def joint_arm(self, values: Values) -> tuple[float, ...]:
        return values["arm_slope"], values["arm_bend"]


JOINT_DELAY = "joint_delay"
"""Parameter that delays the joint's angle and torque together [s]."""


def delay_signal(signal: FloatArray, by: float, dt: float) -> FloatArray:
    """Return a signal `by` seconds later, interpolated; its ends are held."""
    at = np.arange(signal.size) * dt
    return np.asarray(np.interp(at - by, at, signal))


def _gain(s: Signals, v: Values) -> Signals:
    motor, joint = v["motor_torque_gain"], v["joint_torque_gain"]
    return replace(s, motor=s.motor * (1.0 + motor), joint=s.joint * (1.0 + joint))


def _delay(s: Signals, v: Values) -> Signals:
    motor = delay_signal(s.motor, v["motor_torque_delay"], s.dt)
    joint = delay_signal(s.joint, v["joint_torque_delay"], s.dt)
    return replace(s, motor=motor, joint=joint)


ACTIONS: dict[str, dict[str, Any]] = {
    "backlash": {"cables": _soft_play},
    "pulley_eccentricity": {"cables": _eccentric},
    "motor_cogging": {"torques": _cogging},
    "joint_gravity": {"torques": _gravity},
    "joint_stiffness": {"torques": _spring, "implausible": _far_rest},
    "joint_inertia": {
        "torques": lambda s, v: s.added(
            joint=-v["joint_inertia"] * acceleration(s.joint_angle, s.dt)
        )
    },
    "motor_inertia": {
        "torques": lambda s, v: s.added(
            motor=v["motor_inertia"] * acceleration(s.motor_angle, s.dt)
        )
    },
    "torque_sensor_gain": {"torques": _gain},
    "torque_sensor_offset": {
        "torques": lambda s, v: s.added(
            v["motor_torque_bias"] + v["motor_torque_drift"] * s.time,
            v["joint_torque_bias"] + v["joint_torque_drift"] * s.time,
        )
    },
    "sensor_delay": {"torques": _delay},
}
"""Functions of `Effect` by its id."""


class SensorCrossTalk:
    """Torque sensors that also show a share of each other."""

    equation = "tau_m + a tau_j, tau_j + b tau_m"
    source = "calibration"
    sensor = True
    needs = "friction or inertia that makes the two torques differ"
    scene_note = "each torque is also a weighted sum of the sensors of the other one"
    confused_with = ("torque_sensor_gain", "asymmetric_friction")
    resembles = confused_with

    def parameters(self) -> list[Size]:
        bounds = (-1.0, 1.0, (-0.2, 0.2))
        return [
            Size("motor_torque_cross_talk", "1", 0.02, "share of the joint's", *bounds),
            Size("joint_torque_cross_talk", "1", 0.02, "share of the motor's", *bounds),
        ]

    def signals(self, signals: Signals, values: Values) -> Signals:
        motor = values.get("motor_torque_cross_talk", 0.0) * signals.joint
        joint = values.get("joint_torque_cross_talk", 0.0) * signals.motor
        return signals.added(motor=motor, joint=joint)
