"""Data sets with something hidden in them.

rig = make_rig(seed=3)
data = make_dataset(rig, {"viscous_friction": 20.0}, trials="rich", seed=3)
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence

import numpy as np

from cc_mujoco.native import FloatArray as Array
from rig.engine import COLUMNS, Asked, integrate
from rig.makes import MAKES, Truth
from rig.nominal import Rig
from rig.sensors import BASIC, CHANNELS, logged, sampled
from rig.trials import SETS, Trial


def make_trials(trials: str, seed: int) -> list[Trial]:
    return SETS[trials](np.random.default_rng([seed, 0x3A1]))


def truth_of(rig: Rig, effects: Mapping[str, float], seed: int, **mesh: int) -> Truth:
    """Return the rig with these effects (amounts by id); `mesh` goes to `plant_of`."""
    make = MAKES[rig.make]
    truth = Truth(make.plant_of(rig, **mesh), make.chain_of(rig))
    for name, amount in effects.items():
        if amount != 0.0:
            rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
            truth = make.effects[name].hide(truth, float(amount), rng)
    return truth


def run(truth: Truth, rig: Rig, trial: Trial, refine: int = 1) -> Array:
    """Return the records of one trial, with time steps divided by `refine`.

    Cables that are off pull at pulleys of radius 0. A known weight pulls with a
    constant torque; its mass accelerates nothing.
    """
    hangs = truth.plant.bench.unbalance_phase - trial.tilt
    off = {"motor_radius": 0.0, "joint_radius": 0.0} if trial.unhooked else {}
    servo, environment = np.array(trial.servo), np.array(trial.environment)
    records = integrate(
        MAKES[rig.make].law,
        truth.changed(unbalance_phase=hangs, **off).plant,
        rig.pretension * trial.tightness,
        Asked(servo, environment, trial.command, trial.target),
        refine,
    )
    sides = [COLUMNS.index(name) for name in ("motor_torque", "joint_torque")]
    records[:, sides] += trial.known_torques
    return records


def clean_dataset(
    rig: Rig,
    effects: Mapping[str, float],
    trials: Sequence[Trial],
    seed: int,
    names: tuple[str, ...] = BASIC,
) -> list[Array]:
    """Return the readings of a logger without noise, (samples, names) per trial.

    Torque sensors that have changed places read each other's torque under their own
    names.
    """
    truth, torques = truth_of(rig, effects, seed), ("motor_torque", "joint_torque")
    found = []
    for trial in trials:
        records, order = run(truth, rig, trial), list(range(len(names)))
        if trial.swapped:
            one, other = (COLUMNS.index(name) for name in torques)
            records[:, [one, other]] = records[:, [other, one]]
            one, other = (names.index(name) for name in torques)
            order[one], order[other] = other, one
        found.append(sampled(records, rig, truth.chain, names)[:, order])
    return found


def make_dataset(
    rig: Rig,
    effects: Mapping[str, float],
    trials: str = "rich",
    seed: int = 0,
    *,
    tensions: bool = False,
) -> list[dict[str, Array]]:
    """Return the recorded trials of one session.

    `effects` has amounts by id, see `MAKES`; `trials` is a name of `trials.SETS`. The
    seed is that of motions, noise and random choices of effects, not of the rig. With
    `tensions` the four end tensions are recorded too. Each trial is a dict of columns,
    500 Hz, see `sensors.CHANNELS`.
    """
    names = tuple(CHANNELS) if tensions else BASIC
    clean = clean_dataset(rig, effects, make_trials(trials, seed), seed, names)
    chain = MAKES[rig.make].chain_of(rig)
    return [
        logged(signals, chain, names, [seed, rig.seed, k])
        for k, signals in enumerate(clean)
    ]
