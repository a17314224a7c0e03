"""Effects that can be hidden in a rig with guides, by id; forms of their own."""

from __future__ import annotations

import math
from collections.abc import Callable

from numpy.random import Generator

from rig.effects import NAMED as OTHERS
from rig.effects import Effect, Truth


def _field(
    name: str, signed: bool = False
) -> Callable[[Truth, float, Generator], Truth]:
    """Return an effect that is one field of the plant, of either sign if `signed`."""

    def hide(truth: Truth, amount: float, random: Generator) -> Truth:
        size = float(random.choice([-1.0, 1.0])) * amount if signed else amount
        return truth._replace(plant=truth.plant._replace(**{name: size}))

    return hide


def _more(
    name: str, signed: bool = False, **drawn: tuple[float, float]
) -> Callable[[Truth, float, Generator], Truth]:
    """Return the same with other fields drawn evenly between two numbers."""
    plainly = _field(name, signed)

    def hide(truth: Truth, amount: float, random: Generator) -> Truth:
        truth = plainly(truth, amount, random)
        others = {key: random.uniform(*ends) for key, ends in drawn.items()}
        return truth._replace(plant=truth.plant._replace(**others))

    return hide


def _soft(truth: Truth, amount: float, random: Generator) -> Truth:
    travel = truth.plant.yield_travel + amount
    return truth._replace(plant=truth.plant._replace(yield_travel=travel))


_TURN = (-math.pi, math.pi)
NAMED: dict[str, Effect] = {
    "viscous_friction": Effect(
        "force per speed of one cable", "N s/m", 14.0, 600.0, _field("dashpot")
    ),
    "stribeck_friction": Effect(
        "excess of friction near rest", "1", 0.06, 1.2,
        _more("stick_excess", stick_speed=(0.01, 0.03)),
    ),
    "presliding": Effect("softening travel of contacts", "m", 6e-5, 5e-3, _soft),
    "load_independent_friction": Effect(
        "wiper friction of one cable", "N", 4.0, 30.0, _field("wiper")
    ),
    "asymmetric_friction": Effect(
        "excess towards the motor", "1", 0.035, 0.6, _field("lean", signed=True)
    ),
    "tension_dependent_friction": Effect(
        "loss of friction from no tension to much", "1", 0.3, 0.9, _field("adhesion")
    ),
    "dwell_dependent_stiction": Effect(
        "static friction gained in a long rest", "1", 0.15, 1.5,
        _more("bonding", bonding_time=(0.2, 0.6)),
    ),
    "configuration_dependent_wrap": Effect(
        "wrap gained per sine of the joint", "rad", 0.12, 3.0,
        _field("flexing", signed=True),
    ),
    "pretension_loss": Effect(
        "part of pretension lost in 8 s", "1", 0.09, 0.7,
        _more("settling", settling_time=(0.2, 1.0)),
    ),
    "friction_drift": Effect(
        "change by long travel", "1", 0.09, 0.9,
        _more("running_in", signed=True, running_travel=(0.5, 1.5)),
    ),
    "backlash": Effect("gap", "rad", 1.5e-3, 0.1, _field("play")),
    "pulley_eccentricity": Effect(
        "axis off the middle", "m", 6e-4, 8e-3,
        _more("offcentre", offcentre_phase=_TURN),
    ),
    "motor_cogging": Effect(
        "amplitude", "N m", 0.07, 1.5,
        _more("detent", detent_order=(9.0, 23.0), detent_phase=_TURN),
    ),
    "cable_stiffening": Effect(
        "stretch from slack to taut", "m", 1e-3, 6e-3, _field("sag")
    ),
    "end_compliance": Effect(
        "compliance of the anchorage of one cable", "m/N", 1.1e-5, 2e-4,
        _field("anchor"),
    ),
    "joint_gravity": Effect(
        "unbalance m g l", "N m", 0.125, 6.0,
        _more("unbalance", unbalance_phase=(-0.5, 0.5)),
    ),
    "joint_stiffness": Effect(
        "stiffness", "N m/rad", 0.12, 8.0, _more("strap", strap_rest=(-0.2, 0.2))
    ),
    "joint_inertia": Effect("extra inertia", "kg m^2", 3e-4, 0.06, _field("flywheel")),
    "motor_inertia": Effect(
        "inertia behind the sensor", "kg m^2", 3.2e-3, 0.06, _field("gear_inertia")
    ),
    "torque_sensor_gain": OTHERS["torque_sensor_gain"],
    "torque_sensor_offset": OTHERS["torque_sensor_offset"],
    "sensor_delay": OTHERS["sensor_delay"],
    "joint_friction": Effect(
        "friction of the joint's bearing", "N m", 0.1, 3.0, _field("bearing")
    ),
}  # fmt: skip
"""Effects that a library can be expected to know; the sensors are those of `rig`."""

UNKNOWN: dict[str, Effect] = {
    "unknown_notched_ring": Effect(
        "force of the notches", "N", 3.0, 60.0,
        _more("notches", notch_pitch=(4e-3, 9e-3)),
    ),
    "unknown_rubbing": Effect(
        "friction by the other cable's tension", "1", 0.3, 5.0, _field("rubbing")
    ),
    "unknown_snapping_conduit": Effect(
        "length that is given", "m", 3e-4, 1e-2,
        _more("snapping", snap_tension=(95.0, 115.0)),
    ),
    "unknown_catch": Effect(
        "ball catch at one angle of the joint", "N m", 0.3, 6.0,
        _more("catch", signed=True, catch_angle=(-0.3, 0.3)),
    ),
}  # fmt: skip
"""Effects that no library is expected to know."""

EFFECTS: dict[str, Effect] = NAMED | UNKNOWN
