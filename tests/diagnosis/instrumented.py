"""Recorded trials whose torques are known otherwise than from torque sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cc_mujoco.diagnosis.data.bench import Bench
from cc_mujoco.diagnosis.data.dataset_file import DatasetFile, Source
from cc_mujoco.diagnosis.data.instruments import Instruments
from cc_mujoco.diagnosis.data.torques import completed, derived_noise
from cc_mujoco.diagnosis.data.trials import Constant, Dataset, Noise, Trial
from cc_mujoco.transmission import Transmission
from diagnosis.recorded import BENCH, CELL, DT, NOISE, dataset, motions

MOTOR = {"torque_constant": Constant(0.5), "gear_ratio": Constant(5.0)}
FRICTION, DRAG = 0.3, 0.05
"""Of motor and gear, at the pulley [Nm], [Nm s/rad]."""
SPRING = 4.0
"""Stiffness of a load that is declared [Nm/rad]."""
Hidden = Mapping[str, Mapping[str, float]]


def told_by(
    kind: str,
    effects: Hidden,
    bench: Bench = BENCH,
    duration: float = 1.6,
    changes: Mapping[str, float] | None = None,
) -> Dataset:
    """Trials of `dataset` in which the torques are told by other instruments.

    Args:
        kind: `cells` at both ends, `current`, or one end only: `motor`, `joint`.
        effects: that are hidden.
        bench: on which they were recorded.
        duration: of each [s].
        changes: of the cables.
    """
    data = dataset(effects, duration, 3, changes, bench=bench, cells=kind == "cells")
    columns: dict[str, Source] = {}
    rig: dict[str, Constant] = {}
    noise = dict(data.noise)
    trials = list(data.trials)
    if kind == "cells":
        trials = [replace(t, motor_torque=None, joint_torque=None) for t in trials]
        noise |= {n: Noise(CELL, 0.0, "declared") for n in trials[0].tensions}
    elif kind == "current":
        rig = MOTOR
        trials = [driven(trial) for trial in trials]
        noise["motor_current_a"] = Noise(0.008, 0.0, "declared")
    else:
        other = {"motor": "joint_torque_nm", "joint": "motor_torque_nm"}[kind]
        columns[other] = Source(measured=False)
    file = DatasetFile(columns=columns, rig=rig)
    made, instruments, _ = completed(trials, file, bench)
    noise |= derived_noise(noise, instruments, rig, bench)
    return replace(
        data,
        trials=tuple(made),
        instruments=instruments,
        constants=rig,
        noise=noise,
    )


def driven(trial: Trial) -> Trial:
    """A trial that has the motor's current in place of its torque."""
    speed = np.gradient(trial.motor_angle, DT)
    smooth = np.convolve(speed, np.ones(9) / 9.0, "same")
    own = FRICTION * np.tanh(smooth / 0.005) + DRAG * smooth
    constant = MOTOR["torque_constant"].value * MOTOR["gear_ratio"].value
    current = (trial.channel("motor_torque_nm") + own) / constant
    return replace(trial, motor_current=current, motor_torque=None)


def loaded(
    cable_changes: Mapping[str, float], stiffness: float = SPRING, duration: float = 2.0
) -> Dataset:
    """Trials in which the joint turns a spring, which is declared, and has no sensor.

    Args:
        cable_changes: of both cables.
        stiffness: of the spring that is there [Nm/rad].
        duration: of each trial [s].
    """
    cables = tuple(cable.replace(**dict(cable_changes)) for cable in BENCH.cables)
    drive = Transmission(cables, BENCH.motor_radius, BENCH.joint_radius)
    random = np.random.default_rng(5)
    trials = []
    for name, (motor, _) in zip("ab", motions(duration, 0)[::2], strict=True):
        motor = motor - motor[0]
        joint = 0.9 * motor
        for _ in range(8):  # the spring is soft: this contracts
            torque = stiffness * joint
            played = drive.replay(DT, motor_angle=motor, joint_torque=torque)
            joint = played.joint_angle
        noise = random.normal(0.0, 1.0, (3, motor.size))
        trials.append(
            Trial(
                name,
                DT * np.arange(motor.size),
                motor + 2e-5 * noise[0],
                played.motor_torque + 0.02 * noise[1],
                joint + 2e-5 * noise[2],
                None,
                (slice(0, motor.size),),
                DT,
                path=f"{name}.csv",
            )
        )
    quiet = {n: v for n, v in NOISE.items() if n != "joint_torque_nm"}
    return Dataset(
        tuple(trials),
        {"load_stiffness": Constant(SPRING)},
        quiet,
        instruments=Instruments("torque sensor", "known load"),
    )
