"""Sessions of rigs that hide a rare effect, and of a clean one.

The rig shares no code with the package (`rig/`). A drum whose radius grows, a conduit
that creeps in its clamp, textile at the joint and friction that differs between trials
are simulated by it. Everything else is what a rig without the effect shows, with one
exact change of the recorded signals: a stop or a neighbour between transmission and
sensor, sensors that show each other, a joint on a cam.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.random import Generator, default_rng

from cc_mujoco.diagnosis import EFFECTS
from cc_mujoco.native import FloatArray as Array
from rig.dataset import make_dataset, make_trials, run, truth_of
from rig.generate import facts_of
from rig.nominal import Rig
from rig.sensors import BASIC, logged, sampled

Session = list[dict[str, Array]]

TRIALS = "rich"
RARE = tuple(name for name, effect in EFFECTS.items() if effect.rare)


def _simulated(
    rig: Rig, change: Callable[[int], tuple[Rig, dict[str, float]]]
) -> Session:
    """Return a session whose trials have a rig and a changed plant of their own."""
    session = []
    for k, trial in enumerate(make_trials(TRIALS, rig.seed)):
        own, values = change(k)
        truth = truth_of(own, {}, rig.seed).changed(**values)
        signals = sampled(run(truth, own, trial), own, truth.chain, BASIC)
        session.append(logged(signals, truth.chain, BASIC, [rig.seed, rig.seed, k]))
    return session


def _rubbing(rig: Rig, factor: float) -> Rig:
    return replace(
        rig, friction_a=factor * rig.friction_a, friction_b=factor * rig.friction_b
    )


def _drum(rig: Rig, amount: float) -> Session:
    return _simulated(rig, lambda k: (rig, {"drum_growth": amount}))


def _clamp(rig: Rig, amount: float) -> Session:
    values = {"clamp_creep": amount, "clamp_force": 1.5 * rig.pretension}
    return _simulated(rig, lambda k: (rig, values))


def _textile(rig: Rig, amount: float) -> Session:
    return _simulated(rig, lambda k: (rig, {"textile": amount}))


def _order(rig: Rig, amount: float) -> Session:
    middle = 0.5 * (len(make_trials(TRIALS, rig.seed)) - 1)
    return _simulated(rig, lambda k: (_rubbing(rig, 1.0 + amount * (k - middle)), {}))


def _temperature(rig: Rig, amount: float) -> Session:
    count = len(make_trials(TRIALS, rig.seed))
    celsius = 22.0 + default_rng(rig.seed).uniform(-5.0, 5.0, count)
    factors = 1.0 + amount * (celsius - celsius.mean())
    session = _simulated(rig, lambda k: (_rubbing(rig, float(factors[k])), {}))
    for columns, value in zip(session, celsius, strict=True):
        columns["temperature_c"] = np.full(columns["time_s"].size, value)
    return session


def _changed(
    change: Callable[[dict[str, Array], float, Generator], None],
) -> Callable[[Rig, float], Session]:
    """Make the session of a rig without effects, its signals changed in place."""

    def session(rig: Rig, amount: float) -> Session:
        found, random = make_dataset(rig, {}, TRIALS, rig.seed), default_rng(rig.seed)
        for columns in found:
            change(columns, amount, random)
        return found

    return session


def _stop(side: float) -> Callable[[Rig, float], Session]:
    def change(columns: dict[str, Array], amount: float, _: Generator) -> None:
        beyond = np.maximum(side * columns["joint_angle_rad"] - 0.3, 0.0)
        columns["joint_torque_nm"] -= side * amount * beyond

    return _changed(change)


@_changed
def _ripple(columns: dict[str, Array], amount: float, _: Generator) -> None:
    wave = amount * np.cos(9.0 * columns["motor_angle_rad"] + 1.0)
    columns["motor_torque_nm"] *= 1.0 + wave


@_changed
def _cross_talk(columns: dict[str, Array], amount: float, _: Generator) -> None:
    motor, joint = (columns[f"{side}_torque_nm"] for side in ("motor", "joint"))
    columns["motor_torque_nm"] = motor + amount * joint
    columns["joint_torque_nm"] = joint - 0.6 * amount * motor


@_changed
def _neighbour(columns: dict[str, Array], amount: float, random: Generator) -> None:
    time = columns["time_s"]
    phase = random.uniform(0.3, 1.5, 2)[:, None] * 2.0 * np.pi * time
    waves = np.sin(phase + random.uniform(0.0, 6.0, 2)[:, None])
    torque = 2.0 * waves[0] + waves[1]
    columns["neighbour_torque_nm"] = torque + random.normal(0.0, 0.01, time.size)
    columns["joint_torque_nm"] = columns["joint_torque_nm"] + amount * torque


@_changed
def _cam(columns: dict[str, Array], amount: float, _: Generator) -> None:
    """Put the joint on a cam: the pulley turns by q + amount q^2 / 2."""
    pulley = columns["joint_angle_rad"]
    joint = (np.sqrt(1.0 + 2.0 * amount * pulley) - 1.0) / amount
    columns["joint_angle_rad"] = joint
    columns["joint_torque_nm"] = columns["joint_torque_nm"] * (1.0 + amount * joint)


def _clean(rig: Rig, amount: float) -> Session:
    random = default_rng(rig.seed)
    session = _neighbour(rig, 0.0)
    for columns in session:
        warming = 0.01 * columns["time_s"]
        columns["temperature_c"] = 22.0 + random.uniform(-4.0, 4.0) + warming
    return session


SESSIONS: dict[str, tuple[Callable[[Rig, float], Session], float]] = {
    "clamp_creep": (_clamp, 2e-5),
    "soft_anchor": (_textile, 2.5e-5),
    "drum_winding": (_drum, 0.03),
    "upper_joint_stop": (_stop(1.0), 3.0),
    "lower_joint_stop": (_stop(-1.0), 3.0),
    "current_ripple": (_ripple, 0.06),
    "friction_by_order": (_order, -0.05),
    "friction_by_temperature": (_temperature, -0.03),
    "sensor_cross_talk": (_cross_talk, 0.05),
    "coupled_neighbour": (_neighbour, 0.05),
    "lever_geometry": (_cam, 0.06),
    "rare_none": (_clean, 0.0),
}
"""Session and amount by hidden effect."""


def session_of(name: str, rig: Rig) -> tuple[Session, str]:
    """Return the trials of a rig with a rare effect, and the facts of each."""
    session, amount = SESSIONS[name]
    return session(rig, amount), facts_of(TRIALS, rig.seed)
