"""Rare effects: searched on request, and where the others leave the error unexplained.

They are written as a user writes an effect, see `_effect_class`.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.cable import Cable
from cc_mujoco.diagnosis.effects._effect import (
    ANTAGONIST,
    WIND_UP_BOUNDS,
    Effect,
    RigGeometry,
    Signals,
    Values,
    clamp_to_bounds,
    dry_friction,
    form_key,
)
from cc_mujoco.diagnosis.effects._effect_class import Shape, Size, effect_of_class

_MAX_FRICTION_FACTOR = 10.0
"""Largest factor of friction between trials of different conditions."""


class ClampCreep:
    """Conduit that slides in its clamps under large tension, and stays there."""

    equation = (
        "ds/dt = c max(T - F, 0), the path shorter by s; s = 0 at a trial's start"
    )
    source = "plastic flow above a yield force, Bingham 1922"
    where = "conduit"
    needs = (
        "trials that begin without load, with loads that grow, and smaller ones later"
    )
    confused_with = ("pretension_loss", "cable_stiffening", "end_compliance")

    def parameters(self) -> list[Size | Shape]:
        sizes: list[Size | Shape] = [
            Size(f"{name}{one}", "m/(N s)", 1e-5, f"{meaning}{of}", 0.0, 1e-2)
            for name, meaning in (
                ("clamp_creep_distal", "creep of the clamp at the joint"),
                ("clamp_creep_proximal", "creep of the clamp at the motor"),
            )
            for one, of in (("", ""), (f"_{ANTAGONIST}", ", antagonist"))
        ]
        forces = [round(10.0 * 1.35**k, 1) for k in range(12)]
        held = "force up to which a clamp holds"
        return [*sizes, Shape("clamp_force", "N", forces, 1.0, 1e4, held)]

    def cables(
        self, cables: tuple[Cable, ...], values: Values, rig: RigGeometry
    ) -> tuple[Cable, ...]:
        return tuple(
            cable.replace(
                clamp_creep_distal=values.get(f"clamp_creep_distal{one}", 0.0),
                clamp_creep_proximal=values.get(f"clamp_creep_proximal{one}", 0.0),
                clamp_force=values["clamp_force"],
            )
            for cable, one in zip(cables, ("", f"_{ANTAGONIST}"), strict=False)
        )


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


def _with_friction(cables: tuple[Cable, ...], change: float) -> tuple[Cable, ...]:
    factor = min(max(1.0 + change, 0.0), _MAX_FRICTION_FACTOR)
    return tuple(
        cable.replace(friction=clamp_to_bounds("friction", factor * cable.friction))
        for cable in cables
    )


class FrictionByOrder:
    """Friction that changes from trial to trial."""

    equation = "mu (1 + d n), n the order of the trial from the middle one"
    source = "running in and wear of liners"
    needs = "like trials at the beginning and the end of a session"
    confused_with = ("friction_drift",)

    def parameters(self) -> list[Size | Shape]:
        meaning = "relative change of friction per trial"
        return [Size("friction_per_trial", "1", 0.02, meaning, -1.0, 1.0)]

    def cables(
        self, cables: tuple[Cable, ...], values: Values, rig: RigGeometry
    ) -> tuple[Cable, ...]:
        change = values["friction_per_trial"] * rig.conditions.order
        return _with_friction(cables, change) if change else cables


class FrictionByTemperature:
    """Friction that changes with the temperature."""

    equation = "mu (1 + c (T - T_mean))"
    source = "greases and polymer liners"
    columns = ("temperature_c",)
    needs = "like trials at two temperatures, declared or in a column temperature_c"
    confused_with = ("friction_drift", "friction_by_order")

    def parameters(self) -> list[Size | Shape]:
        meaning = "relative change of friction per degree"
        return [Size("friction_per_kelvin", "1/K", 0.01, meaning, -1.0, 1.0)]

    def cables(
        self, cables: tuple[Cable, ...], values: Values, rig: RigGeometry
    ) -> tuple[Cable, ...]:
        share = values["friction_per_kelvin"]
        change = share * rig.conditions.temperature
        if change:
            cables = _with_friction(cables, change)
        if rate := share * rig.conditions.warming / max(1.0 + change, 0.1):
            cables = tuple(
                cable.replace(
                    friction_drift=clamp_to_bounds(
                        "friction_drift", cable.friction_drift + rate
                    )
                )
                for cable in cables
            )
        return cables


class SensorCrossTalk:
    """Torque sensors that also show a share of each other."""

    equation = "tau_m + a tau_j, tau_j + b tau_m"
    source = "calibration"
    sensor = True
    needs = "friction or inertia that makes the two torques differ"
    confused_with = ("torque_sensor_gain", "asymmetric_friction")
    resembles = confused_with

    def parameters(self) -> list[Size | Shape]:
        bounds = (-1.0, 1.0, (-0.2, 0.2))
        return [
            Size("motor_torque_cross_talk", "1", 0.02, "share of the joint's", *bounds),
            Size("joint_torque_cross_talk", "1", 0.02, "share of the motor's", *bounds),
        ]

    def signals(self, signals: Signals, values: Values) -> Signals:
        return signals.added(
            motor=values.get("motor_torque_cross_talk", 0.0) * signals.joint,
            joint=values.get("joint_torque_cross_talk", 0.0) * signals.motor,
        )


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
        return [
            Size("joint_friction", "N m", 0.05, meaning, 0.0, 100.0),
            Shape("joint_wind_up", "rad", [3e-4, 5e-3], *WIND_UP_BOUNDS, turn),
        ]

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
        return [
            Size("neighbour_at_joint", "1", 0.05, "share that acts on the joint"),
            Size("neighbour_at_motor", "1", 0.05, "share that acts on the motor"),
        ]

    def signals(self, signals: Signals, values: Values) -> Signals:
        (column,) = self.columns
        other = signals.columns[column]
        return signals.added(
            motor=values["neighbour_at_motor"] * other,
            joint=values["neighbour_at_joint"] * other,
        )


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


RARE_EFFECTS: tuple[Effect, ...] = tuple(
    effect_of_class(kind, rare=True)
    for kind in (
        ClampCreep,
        DrumWinding,
        UpperJointStop,
        LowerJointStop,
        CurrentRipple,
        FrictionByOrder,
        FrictionByTemperature,
        SensorCrossTalk,
        JointFriction,
        CoupledNeighbour,
        LeverGeometry,
    )
)
"""Rare effects of the library."""
