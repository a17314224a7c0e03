"""Look of the residual if an effect were missing: by formula only.

An effect is a function of what can be read off motion and torque at the same instant,
as in a plot of residual over speed. Where a formula has a scale that the data must
settle, there is one term for each scale tried.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from baselines.signals import Signals
from cc_mujoco.diagnosis import EFFECTS
from cc_mujoco.native import FloatArray

Signal = Callable[[Signals, int], FloatArray]
"""Signal of a record and a channel (0 motor, 1 joint), (samples,)."""
BOTH, MOTOR, JOINT = (0, 1), (0,), (1,)
DISTANCES = (2e-4, 1e-3, 5e-3)
"""Travels over which friction may build up after the motion has turned [m]."""
TURN = 2.0 * math.pi


class Term(NamedTuple):
    """One look of an effect."""

    over: Signal  # what the residual is plotted over
    columns: tuple[Signal, ...]  # whose weighted sum the residual would be


class Family(NamedTuple):
    """An effect and its looks."""

    id: str  # of the effect
    channels: tuple[int, ...]  # whose residual it would show in
    terms: tuple[Term, ...]  # its looks, one for each scale tried


def _plain(signal: Signal) -> tuple[Term, ...]:
    """Return terms of a residual that is proportional to a signal."""
    return (Term(signal, (signal,)),)


def _speed(s: Signals, _: int) -> FloatArray:
    return s.speed


def _greased(power: float) -> Term:
    return Term(_speed, (lambda s, _: s.direction * abs(s.speed) ** power,))


def _stribeck(scale: float) -> Term:
    return Term(_speed, (lambda s, _: s.direction * np.exp(-abs(s.speed) / scale),))


def _building_up(scale: float) -> Term:
    return Term(
        lambda s, _: s.direction * s.travel,
        (lambda s, _: s.direction * np.exp(-s.travel / scale),),
    )


def _aged(scale: float) -> tuple[Term, ...]:
    return _plain(
        lambda s, _: s.direction * np.log1p(s.rested) * np.exp(-s.since_rest / scale)
    )


def _relaxed(scale: float) -> tuple[Term, ...]:
    return _plain(lambda s, _: s.direction * np.exp(-s.time / scale))


def _wave(order: float) -> Term:
    return Term(
        lambda s, _: np.mod(order * s.motor_angle, TURN),
        (
            lambda s, _: np.cos(order * s.motor_angle),
            lambda s, _: np.sin(order * s.motor_angle),
        ),
    )


def _scales(name: str, parameter: str) -> tuple[float, ...]:
    """Return the scales from which the library starts too."""
    return tuple(start[parameter] for start in EFFECTS[name].starts)


def _every(
    of: Callable[[float], tuple[Term, ...]], scales: tuple[float, ...]
) -> tuple[Term, ...]:
    return tuple(term for scale in scales for term in of(scale))


FAMILIES = (
    Family("viscous_friction", BOTH, _plain(_speed)),
    Family(
        "grease_drag",
        BOTH,
        tuple(map(_greased, _scales("grease_drag", "grease_exponent"))),
    ),
    Family(
        "stribeck_friction",
        BOTH,
        tuple(map(_stribeck, _scales("stribeck_friction", "stribeck_speed"))),
    ),
    Family("presliding", BOTH, tuple(map(_building_up, DISTANCES))),
    Family("load_independent_friction", BOTH, _plain(lambda s, _: s.direction)),
    Family(
        "asymmetric_friction", BOTH, _plain(lambda s, _: np.maximum(s.direction, 0.0))
    ),
    Family(
        "tension_dependent_friction",
        BOTH,
        _plain(lambda s, c: s.direction * abs(s.torque[c])),
    ),
    Family(
        "dwell_dependent_stiction",
        BOTH,
        _every(_aged, _scales("dwell_dependent_stiction", "critical_slip_distance")),
    ),
    Family("friction_drift", BOTH, _plain(lambda s, _: s.direction * s.time)),
    Family(
        "configuration_dependent_wrap",
        BOTH,
        _plain(lambda s, _: s.direction * s.joint_angle),
    ),
    Family(
        "pretension_loss",
        BOTH,
        _every(_relaxed, _scales("pretension_loss", "relaxation_time")),
    ),
    Family(
        "cable_stiffening", BOTH, _plain(lambda s, c: s.torque[c] * abs(s.torque[c]))
    ),
    Family("end_compliance", BOTH, _plain(lambda s, _: s.torque[1])),
    Family("backlash", BOTH, _plain(lambda s, _: np.sign(s.torque[1]))),
    Family("pulley_eccentricity", BOTH, (_wave(1.0),)),
    Family(
        "motor_cogging",
        MOTOR,
        tuple(map(_wave, _scales("motor_cogging", "cogging_order"))),
    ),
    Family(
        "joint_gravity",
        JOINT,
        (
            Term(
                lambda s, _: s.joint_angle,
                (
                    lambda s, _: np.sin(s.joint_angle),
                    lambda s, _: np.cos(s.joint_angle),
                ),
            ),
        ),
    ),
    Family("joint_stiffness", JOINT, _plain(lambda s, _: s.joint_angle)),
    Family("joint_inertia", JOINT, _plain(lambda s, _: s.joint_acceleration)),
    Family("motor_inertia", MOTOR, _plain(lambda s, _: s.motor_acceleration)),
    Family("torque_sensor_gain", BOTH, _plain(lambda s, c: s.torque[c])),
    Family("torque_sensor_offset", BOTH, _plain(lambda s, _: s.time)),
    Family("sensor_delay", BOTH, _plain(lambda s, c: np.gradient(s.torque[c], s.dt))),
)
"""Looks of every effect of the library."""


def looks() -> Iterator[tuple[str, int, Term]]:
    """Yield every term of every effect in each of its channels."""
    for family in FAMILIES:
        for channel in family.channels:
            for term in family.terms:
                yield family.id, channel, term
