"""Effects that can be hidden in a rig of finite elements, by id; forms of their own."""

from __future__ import annotations

from numpy.random import Generator

from rig.effects import TURN, Effect, Truth, chain, plant


def _soft(truth: Truth, amount: float, random: Generator) -> Truth:
    """Return contacts that yield late, by different amounts."""
    plant = truth.plant
    uneven = random.uniform(0.5, 1.5, plant.mass.shape)
    yielding = plant.yielding + amount * uneven
    return truth._replace(plant=plant._replace(yielding=yielding))


NAMED: dict[str, Effect] = {
    "viscous_friction": Effect(
        "force per speed of one cable", "N s/m", 14.0, 600.0, plant("grease")
    ),
    "stribeck_friction": Effect(
        "excess of friction near rest", "1", 0.07, 1.2,
        plant("striction", striction_speed=(0.008, 0.02)),
    ),
    "presliding": Effect("deflection until contacts slide", "m", 8e-5, 5e-3, _soft),
    "load_independent_friction": Effect(
        "friction of a tight liner, one cable", "N", 4.0, 40.0, plant("tight")
    ),
    "asymmetric_friction": Effect(
        "friction against the nap of one liner, less 1", "1", 0.1, 1.0,
        plant("nap", signed=True),
    ),
    "tension_dependent_friction": Effect(
        "loss of friction per tension over 80 N", "1", 0.1, 0.6, plant("polish")
    ),
    "dwell_dependent_stiction": Effect(
        "static friction gained in a second", "1", 0.12, 1.5,
        plant("creep", creep_power=(0.2, 0.4)),
    ),
    "configuration_dependent_wrap": Effect(
        "wrap gained per joint angle", "rad/rad", 0.12, 3.0,
        plant("leaning", signed=True),
    ),
    "pretension_loss": Effect(
        "part of pretension lost in the end", "1", 0.09, 0.7, plant("relaxing")
    ),
    "friction_drift": Effect(
        "change when warm", "1", 0.08, 0.9,
        plant("warming", signed=True, warming_time=(2.5, 6.0)),
    ),
    "backlash": Effect("gap", "rad", 1.5e-3, 0.1, plant("play")),
    "pulley_eccentricity": Effect(
        "axis off the middle, over the radius", "1", 0.012, 0.15,
        plant("offcentre", offcentre_phase=TURN, oval_phase=TURN),
    ),
    "motor_cogging": Effect(
        "amplitude", "N m", 0.07, 1.5,
        plant("slots", slots_order=(8.0, 21.0), slots_phase=TURN),
    ),
    "cable_stiffening": Effect(
        "stiffness that a slack strand lacks", "1", 0.5, 0.97,
        plant("toe", toe_tension=(20.0, 45.0)),
    ),
    "end_compliance": Effect(
        "compliance of one fastening at the motor", "m/N", 1.1e-5, 2e-4,
        plant("ferrule"),
    ),
    "joint_gravity": Effect(
        "unbalance m g l", "N m", 0.125, 6.0,
        plant("unbalance", unbalance_phase=(-0.5, 0.5)),
    ),
    "joint_stiffness": Effect(
        "stiffness at rest", "N m/rad", 0.13, 8.0, plant("band", band_rest=(-0.2, 0.2))
    ),
    "joint_inertia": Effect("extra inertia", "kg m^2", 3e-4, 0.06, plant("disc")),
    "motor_inertia": Effect(
        "inertia behind the sensor", "kg m^2", 3.2e-3, 0.06, plant("drum")
    ),
    "torque_sensor_gain": Effect(
        "excess gain one way", "1", 0.045, 0.5, chain("gain", signed=True)
    ),
    "torque_sensor_offset": Effect(
        "offset", "N m", 0.14, 3.0, chain("offset", signed=True)
    ),
    "sensor_delay": Effect("group delay", "s", 0.003, 0.06, chain("delay")),
    "grease_drag": Effect(
        "force per speed of one slow cable", "N s/m", 25.0, 1200.0,
        plant("grease", grease_thins=(0.02, 0.1)),
    ),
}  # fmt: skip
"""Effects that a library can be expected to know."""

UNKNOWN: dict[str, Effect] = {
    "unknown_worn_liner": Effect(
        "waves of friction", "1", 0.1, 1.0,
        plant("worn", worn_pitch=(0.008, 0.03), worn_phase=TURN),
    ),
    "unknown_felt": Effect(
        "stiffness within its play", "N m/rad", 1.0, 40.0,
        plant("felt", felt_play=(0.08, 0.2)),
    ),
    "unknown_putty": Effect(
        "stiffness at first", "N m/rad", 0.3, 20.0,
        plant("putty", putty_time=(0.2, 0.8)),
    ),
    "unknown_cubic_sensor": Effect(
        "what is lacking at 5 N m", "N m", 0.3, 2.5, chain("cubic", signed=True)
    ),
    "unknown_pressed_sensor": Effect(
        "torque per mean pull", "m", 5e-3, 0.05, chain("pressed", signed=True)
    ),
}  # fmt: skip
"""Effects that no library is expected to know."""

EFFECTS: dict[str, Effect] = NAMED | UNKNOWN
