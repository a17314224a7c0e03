"""Effects that can be hidden in a rig with guides, by id; forms of their own."""

from __future__ import annotations

from rig.bristles.effects import NAMED as OTHERS
from rig.effects import TURN, Effect, plant, softer

NAMED: dict[str, Effect] = {
    "viscous_friction": Effect(
        "force per speed of one cable", "N s/m", 14.0, 600.0, plant("dashpot")
    ),
    "stribeck_friction": Effect(
        "excess of friction near rest", "1", 0.06, 1.2,
        plant("stick_excess", stick_speed=(0.01, 0.03)),
    ),
    "presliding": Effect(
        "softening travel of contacts", "m", 6e-5, 5e-3, softer("yield_travel")
    ),
    "load_independent_friction": Effect(
        "wiper friction of one cable", "N", 4.0, 30.0, plant("wiper")
    ),
    "asymmetric_friction": Effect(
        "excess towards the motor", "1", 0.035, 0.6, plant("lean", signed=True)
    ),
    "tension_dependent_friction": Effect(
        "loss of friction from no tension to much", "1", 0.3, 0.9, plant("adhesion")
    ),
    "dwell_dependent_stiction": Effect(
        "static friction gained in a long rest", "1", 0.15, 1.5,
        plant("bonding", bonding_time=(0.2, 0.6)),
    ),
    "configuration_dependent_wrap": Effect(
        "wrap gained per sine of the joint", "rad", 0.12, 3.0,
        plant("flexing", signed=True),
    ),
    "pretension_loss": Effect(
        "part of pretension lost in 8 s", "1", 0.09, 0.7,
        plant("settling", settling_time=(0.2, 1.0)),
    ),
    "friction_drift": Effect(
        "change by long travel", "1", 0.09, 0.9,
        plant("running_in", signed=True, running_travel=(0.5, 1.5)),
    ),
    "backlash": Effect("gap", "rad", 1.5e-3, 0.1, plant("play")),
    "pulley_eccentricity": Effect(
        "axis off the middle", "m", 6e-4, 8e-3, plant("offcentre", offcentre_phase=TURN)
    ),
    "motor_cogging": Effect(
        "amplitude", "N m", 0.07, 1.5,
        plant("detent", detent_order=(9.0, 23.0), detent_phase=TURN),
    ),
    "cable_stiffening": Effect(
        "stretch from slack to taut", "m", 1e-3, 6e-3, plant("sag")
    ),
    "end_compliance": Effect(
        "compliance of the anchorage of one cable", "m/N", 1.1e-5, 2e-4, plant("anchor")
    ),
    "joint_gravity": Effect(
        "unbalance m g l", "N m", 0.125, 6.0,
        plant("unbalance", unbalance_phase=(-0.5, 0.5)),
    ),
    "joint_stiffness": Effect(
        "stiffness", "N m/rad", 0.12, 8.0, plant("strap", strap_rest=(-0.2, 0.2))
    ),
    "joint_inertia": Effect("extra inertia", "kg m^2", 3e-4, 0.06, plant("flywheel")),
    "motor_inertia": Effect(
        "inertia behind the sensor", "kg m^2", 3.2e-3, 0.06, plant("gear_inertia")
    ),
    "torque_sensor_gain": OTHERS["torque_sensor_gain"],
    "torque_sensor_offset": OTHERS["torque_sensor_offset"],
    "sensor_delay": OTHERS["sensor_delay"],
    "joint_friction": Effect(
        "friction of the joint's bearing", "N m", 0.1, 3.0, plant("bearing")
    ),
}  # fmt: skip
"""Effects that a library can be expected to know; the sensors are those of `rig`."""

UNKNOWN: dict[str, Effect] = {
    "unknown_notched_ring": Effect(
        "force of the notches", "N", 3.0, 60.0,
        plant("notches", notch_pitch=(4e-3, 9e-3)),
    ),
    "unknown_rubbing": Effect(
        "friction by the other cable's tension", "1", 0.3, 5.0, plant("rubbing")
    ),
    "unknown_snapping_conduit": Effect(
        "length that is given", "m", 3e-4, 1e-2,
        plant("snapping", snap_tension=(95.0, 115.0)),
    ),
    "unknown_catch": Effect(
        "ball catch at one angle of the joint", "N m", 0.3, 6.0,
        plant("catch", signed=True, catch_angle=(-0.3, 0.3)),
    ),
}  # fmt: skip
"""Effects that no library is expected to know."""

EFFECTS: dict[str, Effect] = NAMED | UNKNOWN
