"""Effects that can be hidden in a rig of massive nodes, by id."""

from __future__ import annotations

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from rig.bristles.plant import BUMPS
from rig.effects import TURN, Effect, Truth, chain, plant, softer


def _tension_power(truth: Truth, amount: float, _random: Generator) -> Truth:
    return truth._replace(plant=truth.plant._replace(tension_power=-amount))


def _poles(random: Generator) -> float:
    return float(random.choice([10, 12, 14, 16, 18, 22]))


def _teeth(random: Generator) -> float:
    return float(random.integers(19, 40))


def _places(random: Generator) -> NDArray[np.float64]:
    return random.uniform(-0.045, 0.045, (2, BUMPS))


_AROUND = (0.0, 2.0 * math.pi)
NAMED: dict[str, Effect] = {
    "viscous_friction": Effect(
        "force per speed of one cable", "N s/m", 14.0, 600.0, plant("viscous")
    ),
    "stribeck_friction": Effect(
        "excess of friction near rest", "1", 0.055, 1.2,
        plant("stribeck", stribeck_speed=(0.015, 0.035)),
    ),
    "presliding": Effect(
        "softening travel of contacts", "m", 6e-05, 5e-3, softer("presliding")
    ),
    "load_independent_friction": Effect(
        "seal friction of one cable", "N", 4.0, 30.0, plant("load_free")
    ),
    "asymmetric_friction": Effect(
        "excess while the joint turns positive", "1", 0.035, 0.6,
        plant("asymmetry", signed=True),
    ),
    "tension_dependent_friction": Effect(
        "one minus the exponent of load", "1", 0.14, 0.6, _tension_power
    ),
    "dwell_dependent_stiction": Effect(
        "static friction gained per e-fold of rest", "1", 0.06, 0.4, plant("ageing")
    ),
    "configuration_dependent_wrap": Effect(
        "wrap gained per joint angle", "rad/rad", 0.12, 3.0,
        plant("wrap_slope", signed=True),
    ),
    "pretension_loss": Effect(
        "part of pretension lost", "1", 0.09, 0.7,
        plant("pretension_loss", loss_time=(2.0, 5.0)),
    ),
    "friction_drift": Effect(
        "change when warm", "1", 0.09, 0.9, plant("heating", signed=True)
    ),
    "backlash": Effect("gap", "rad", 1.5e-3, 0.1, plant("backlash")),
    "pulley_eccentricity": Effect(
        "first harmonic", "1", 0.013, 0.15,
        plant("eccentricity", eccentric_phase=TURN, eccentric_phase_2=TURN),
    ),
    "motor_cogging": Effect(
        "amplitude", "N m", 0.07, 1.5,
        plant("cogging", cogging_order=_poles, cogging_phase=TURN),
    ),
    "cable_stiffening": Effect(
        "change of stiffness, slack to taut", "1", 0.19, 0.85, plant("stiffening")
    ),
    "end_compliance": Effect(
        "compliance at the ends of one cable", "m/N", 1.1e-05, 2e-4,
        plant("end_compliance"),
    ),
    "joint_gravity": Effect(
        "unbalance m g l", "N m", 0.125, 6.0,
        plant("unbalance", unbalance_phase=(-0.5, 0.5)),
    ),
    "joint_stiffness": Effect(
        "stiffness", "N m/rad", 0.12, 8.0,
        plant("joint_stiffness", joint_stiffness_rest=(-0.2, 0.2)),
    ),
    "joint_inertia": Effect(
        "extra inertia", "kg m^2", 3e-4, 0.06, plant("extra_joint_inertia")
    ),
    "motor_inertia": Effect(
        "inertia behind the sensor", "kg m^2", 3.2e-3, 0.06, plant("motor_inertia")
    ),
    "torque_sensor_gain": Effect(
        "excess gain", "1", 0.037, 0.5, chain("gain", signed=True)
    ),
    "torque_sensor_offset": Effect(
        "offset", "N m", 0.14, 3.0, chain("offset", signed=True)
    ),
    "sensor_delay": Effect("delay", "s", 0.003, 0.06, chain("delay")),
}  # fmt: skip
"""Effects that a library can be expected to know."""


UNKNOWN: dict[str, Effect] = {
    "unknown_liner_bumps": Effect(
        "excess of friction", "1", 0.065, 6.0, plant("bumps", bump_places=_places)
    ),
    "unknown_gear_mesh": Effect(
        "ripple torque at the joint", "N m", 0.073, 1.5,
        plant("mesh", mesh_order=_teeth, mesh_phase=TURN),
    ),
    "unknown_end_stop": Effect(
        "stiffness of the bumper", "N m/rad", 0.4, 60.0,
        plant("stop_stiffness", stop_angle=(0.35, 0.55)),
    ),
    "unknown_grip_slip": Effect(
        "slip speed per excess torque", "rad/(N m s)", 0.0005, 0.3, plant("grip_slip")
    ),
    "unknown_sensor_hysteresis": Effect(
        "half width", "N m", 0.14, 2.0, chain("hysteresis")
    ),
    "unknown_load_delay": Effect(
        "lag per torque", "s/N m", 0.004, 0.04, chain("load_delay")
    ),
    "unknown_reflex": Effect(
        "torque per speed", "N m s/rad", 0.12, 4.0,
        chain("reflex", reflex_latency=(0.05, 0.12)),
    ),
    "unknown_temperature": Effect(
        "zero drift", "N m", 0.12, 2.0, chain("temperature", temperature_phase=_AROUND)
    ),
    "unknown_second_axis": Effect(
        "cross-talk", "N m", 0.13, 2.0,
        chain("second_axis", second_axis_rate=(0.6, 1.6), second_axis_phase=_AROUND),
    ),
}  # fmt: skip
"""Effects that no library is expected to know."""

EFFECTS: dict[str, Effect] = NAMED | UNKNOWN
