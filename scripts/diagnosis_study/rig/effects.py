"""Everything that can be hidden in a rig, by id.

An effect has one amount, off at 0, and turns the truth without it into the truth with
it. What else it needs (phases, signs, places) is drawn from the generator it is given.
The forms differ on purpose from those a model library would choose first.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator

from rig.plant import BUMPS
from rig.sensors import Chain


class Truth(NamedTuple):
    """The physics and the sensors of a rig, hidden effects included."""

    plant: Any
    chain: Chain


class Effect(NamedTuple):
    """One thing that can be hidden.

    Attributes:
        parameter: what `amount` measures.
        unit: of the amount.
        typical: an amount that shows clearly, R about 2 in rich trials.
        limit: the largest amount that is still physics.
        hide: (truth, amount, generator) -> truth with the effect.
    """

    parameter: str
    unit: str
    typical: float
    limit: float
    hide: Callable[[Truth, float, Generator], Truth]


def _plant(truth: Truth, **changes: Any) -> Truth:
    return truth._replace(plant=truth.plant._replace(**changes))


def _chain(truth: Truth, **changes: float) -> Truth:
    return truth._replace(chain=truth.chain._replace(**changes))


def _sign(rng: Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _field(name: str) -> Callable[[Truth, float, Generator], Truth]:
    """Return an effect that is one field of the plant."""
    return lambda truth, amount, _rng: _plant(truth, **{name: amount})


def _signed(name: str) -> Callable[[Truth, float, Generator], Truth]:
    """Return an effect that is one field of the plant, of either sign."""
    return lambda truth, amount, rng: _plant(truth, **{name: _sign(rng) * amount})


def _stribeck(truth: Truth, amount: float, rng: Generator) -> Truth:
    return _plant(truth, stribeck=amount, stribeck_speed=rng.uniform(0.015, 0.035))


def _presliding(truth: Truth, amount: float, _rng: Generator) -> Truth:
    return _plant(truth, presliding=truth.plant.presliding + amount)


def _tension_power(truth: Truth, amount: float, _rng: Generator) -> Truth:
    return _plant(truth, tension_power=-amount)


def _eccentricity(truth: Truth, amount: float, rng: Generator) -> Truth:
    one, two = rng.uniform(-math.pi, math.pi, 2)
    return _plant(
        truth, eccentricity=amount, eccentric_phase=one, eccentric_phase_2=two
    )


def _cogging(truth: Truth, amount: float, rng: Generator) -> Truth:
    return _plant(
        truth,
        cogging=amount,
        cogging_order=float(rng.choice([10, 12, 14, 16, 18, 22])),
        cogging_phase=rng.uniform(-math.pi, math.pi),
    )


def _gravity(truth: Truth, amount: float, rng: Generator) -> Truth:
    return _plant(truth, gravity=amount, gravity_phase=rng.uniform(-0.5, 0.5))


def _joint_stiffness(truth: Truth, amount: float, rng: Generator) -> Truth:
    return _plant(
        truth, joint_stiffness=amount, joint_stiffness_rest=rng.uniform(-0.2, 0.2)
    )


def _pretension_loss(truth: Truth, amount: float, rng: Generator) -> Truth:
    return _plant(truth, pretension_loss=amount, loss_time=rng.uniform(2.0, 5.0))


def _gain(truth: Truth, amount: float, rng: Generator) -> Truth:
    return _chain(truth, gain=_sign(rng) * amount)


def _offset(truth: Truth, amount: float, rng: Generator) -> Truth:
    return _chain(truth, offset=_sign(rng) * amount)


def _delay(truth: Truth, amount: float, _rng: Generator) -> Truth:
    return _chain(truth, delay=amount)


NAMED: dict[str, Effect] = {
    "viscous_friction": Effect(
        "force per speed of one cable", "N s/m", 14.0, 600.0, _field("viscous")
    ),
    "stribeck_friction": Effect(
        "excess of friction near rest", "1", 0.055, 1.2, _stribeck
    ),
    "presliding": Effect("softening travel of contacts", "m", 6e-05, 5e-3, _presliding),
    "load_independent_friction": Effect(
        "seal friction of one cable", "N", 4.0, 30.0, _field("load_free")
    ),
    "asymmetric_friction": Effect(
        "excess while the joint turns positive", "1", 0.035, 0.6, _signed("asymmetry")
    ),
    "tension_dependent_friction": Effect(
        "one minus the exponent of load", "1", 0.14, 0.6, _tension_power
    ),
    "dwell_dependent_stiction": Effect(
        "static friction gained per e-fold of rest", "1", 0.06, 0.4, _field("ageing")
    ),
    "configuration_dependent_wrap": Effect(
        "wrap gained per joint angle", "rad/rad", 0.12, 3.0, _signed("wrap_slope")
    ),
    "pretension_loss": Effect(
        "part of pretension lost", "1", 0.09, 0.7, _pretension_loss
    ),
    "friction_drift": Effect("change when warm", "1", 0.09, 0.9, _signed("heating")),
    "backlash": Effect("gap", "rad", 1.5e-3, 0.1, _field("backlash")),
    "pulley_eccentricity": Effect("first harmonic", "1", 0.013, 0.15, _eccentricity),
    "motor_cogging": Effect("amplitude", "N m", 0.07, 1.5, _cogging),
    "cable_stiffening": Effect(
        "change of stiffness, slack to taut", "1", 0.19, 0.85, _field("stiffening")
    ),
    "end_compliance": Effect(
        "compliance at the ends of one cable", "m/N", 1.1e-05, 2e-4,
        _field("end_compliance"),
    ),
    "joint_gravity": Effect("unbalance m g l", "N m", 0.125, 6.0, _gravity),
    "joint_stiffness": Effect("stiffness", "N m/rad", 0.12, 8.0, _joint_stiffness),
    "joint_inertia": Effect(
        "extra inertia", "kg m^2", 3e-4, 0.06, _field("extra_joint_inertia")
    ),
    "motor_inertia": Effect(
        "inertia behind the sensor", "kg m^2", 3.2e-3, 0.06, _field("motor_inertia")
    ),
    "torque_sensor_gain": Effect("excess gain", "1", 0.037, 0.5, _gain),
    "torque_sensor_offset": Effect("offset", "N m", 0.14, 3.0, _offset),
    "sensor_delay": Effect("delay", "s", 0.003, 0.06, _delay),
}  # fmt: skip
"""Effects that a library can be expected to know."""


def _bumps(truth: Truth, amount: float, rng: Generator) -> Truth:
    places = rng.uniform(-0.045, 0.045, (2, BUMPS))
    return _plant(truth, bumps=amount, bump_places=places)


def _mesh(truth: Truth, amount: float, rng: Generator) -> Truth:
    return _plant(
        truth,
        mesh=amount,
        mesh_order=float(rng.integers(19, 40)),
        mesh_phase=rng.uniform(-math.pi, math.pi),
    )


def _stop(truth: Truth, amount: float, rng: Generator) -> Truth:
    return _plant(truth, stop_stiffness=amount, stop_angle=rng.uniform(0.35, 0.55))


def _hysteresis(truth: Truth, amount: float, _rng: Generator) -> Truth:
    return _chain(truth, hysteresis=amount)


def _load_delay(truth: Truth, amount: float, _rng: Generator) -> Truth:
    return _chain(truth, load_delay=amount)


def _reflex(truth: Truth, amount: float, rng: Generator) -> Truth:
    return _chain(truth, reflex=amount, reflex_latency=rng.uniform(0.05, 0.12))


def _temperature(truth: Truth, amount: float, rng: Generator) -> Truth:
    return _chain(
        truth, temperature=amount, temperature_phase=rng.uniform(0, 2 * np.pi)
    )


def _second_axis(truth: Truth, amount: float, rng: Generator) -> Truth:
    return _chain(
        truth,
        second_axis=amount,
        second_axis_rate=rng.uniform(0.6, 1.6),
        second_axis_phase=rng.uniform(0, 2 * np.pi),
    )


UNKNOWN: dict[str, Effect] = {
    "unknown_liner_bumps": Effect("excess of friction", "1", 0.065, 6.0, _bumps),
    "unknown_gear_mesh": Effect("ripple torque at the joint", "N m", 0.073, 1.5, _mesh),
    "unknown_end_stop": Effect("stiffness of the bumper", "N m/rad", 0.4, 60.0, _stop),
    "unknown_grip_slip": Effect(
        "slip speed per excess torque", "rad/(N m s)", 0.0005, 0.3, _field("grip_slip")
    ),
    "unknown_sensor_hysteresis": Effect("half width", "N m", 0.14, 2.0, _hysteresis),
    "unknown_load_delay": Effect("lag per torque", "s/N m", 0.004, 0.04, _load_delay),
    "unknown_reflex": Effect("torque per speed", "N m s/rad", 0.12, 4.0, _reflex),
    "unknown_temperature": Effect("zero drift", "N m", 0.12, 2.0, _temperature),
    "unknown_second_axis": Effect("cross-talk", "N m", 0.13, 2.0, _second_axis),
}
"""Effects that no library is expected to know."""

EFFECTS: dict[str, Effect] = NAMED | UNKNOWN
