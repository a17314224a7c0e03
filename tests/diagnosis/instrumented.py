"""Recorded trials whose torques are known otherwise than from torque sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import mujoco
import numpy as np

from cc_mujoco.assets import scene_path
from cc_mujoco.cable import Transmission
from cc_mujoco.datasets import Bench, Dataset, Noise, Trial
from cc_mujoco.datasets._dataset_file import DatasetFile, Source
from cc_mujoco.datasets._torques import add_derived_torques, derived_noise
from cc_mujoco.datasets._trials import Constant, Instruments
from cc_mujoco.diagnosis import EFFECTS
from cc_mujoco.diagnosis.effects._effect import RigGeometry
from diagnosis.recorded import BENCH, CELL, DT, NOISE, dataset, motions

MOTOR = {"torque_constant": Constant(0.5), "gear_ratio": Constant(5.0)}
FRICTION, DRAG = 0.3, 0.05
"""Coulomb friction [N m] and damping [N m s/rad] of motor and gear, at the pulley."""
SPRING = 4.0
"""Declared stiffness of the load [N m/rad]."""
Hidden = Mapping[str, Mapping[str, float]]


def told_by(
    kind: str,
    effects: Hidden,
    bench: Bench = BENCH,
    duration: float = 1.6,
    changes: Mapping[str, float] | None = None,
    wind_up: float = 0.0,
) -> Dataset:
    """Return trials of `dataset` whose torques are measured by other instruments.

    Args:
        kind: `cells` at both ends, `current`, or one end only: `motor`, `joint`.
        effects: hidden effects.
        bench: bench of the recording.
        duration: duration of each trial [s].
        changes: changes of the cables.
        wind_up: turn of the motor over which its friction builds up [rad].
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
        trials = [driven(trial, wind_up) for trial in trials]
        noise["motor_current_a"] = Noise(0.008, 0.0, "declared")
    else:
        other = {"motor": "joint_torque_nm", "joint": "motor_torque_nm"}[kind]
        columns[other] = Source(measured=False)
    file = DatasetFile(columns=columns, rig=rig)
    made, instruments, _ = add_derived_torques(trials, file, bench)
    noise |= derived_noise(noise, instruments, rig, bench)
    return replace(
        data,
        trials=tuple(made),
        instruments=instruments,
        constants=rig,
        noise=noise,
    )


def driven(trial: Trial, wind_up: float = 0.0) -> Trial:
    """Return a trial with the motor's current in place of its torque."""
    speed = np.gradient(trial.motor_angle, DT)
    smooth = np.convolve(speed, np.ones(9) / 9.0, "same")
    own = FRICTION * np.tanh(smooth / 0.005) + DRAG * smooth
    if wind_up > 0.0:
        own = FRICTION * bent(trial.motor_angle, wind_up) + DRAG * smooth
    constant = MOTOR["torque_constant"].value * MOTOR["gear_ratio"].value
    current = (trial.channel("motor_torque_nm") + own) / constant
    return replace(trial, motor_current=current, motor_torque=None)


def bent(angle: np.ndarray, wind_up: float) -> np.ndarray:
    """Return how far a bristle is bent that slides where it is bent by 1."""
    found = np.zeros(angle.size)
    for k in range(1, angle.size):
        moved = found[k - 1] + (angle[k] - angle[k - 1]) / wind_up
        found[k] = min(max(moved, -1.0), 1.0)
    return found


def loaded(
    cable_changes: Mapping[str, float],
    stiffness: float = SPRING,
    duration: float = 2.0,
    play: float = 0.0,
) -> Dataset:
    """Return trials of a joint that turns a declared spring and has no torque sensor.

    Args:
        cable_changes: changes of both cables.
        stiffness: true stiffness of the spring [N m/rad].
        duration: duration of each trial [s].
        play: between the joint and its pulley [rad].
    """
    cables = tuple(cable.replace(**dict(cable_changes)) for cable in BENCH.cables)
    drive = Transmission(cables, BENCH.motor_radius, BENCH.joint_radius)
    random = np.random.default_rng(5)
    trials = []
    for name, (motor, _) in zip("ab", motions(duration, 0)[::2], strict=True):
        motor = motor - motor[0]
        pulley = 0.9 * motor
        for _ in range(8):  # the spring is soft: this contracts
            joint = pulley - np.clip(pulley, -0.5 * play, 0.5 * play)
            torque = stiffness * joint
            played = drive.replay(DT, motor_angle=motor, joint_torque=torque)
            pulley = played.joint_angle
        joint = pulley - np.clip(pulley, -0.5 * play, 0.5 * play)
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


ANKLE = Bench.of(scene_path("ankle"))


def walked(
    effects: Hidden, duration: float = 3.0, changes: Mapping[str, float] | None = None
) -> Dataset:
    """Return trials of the ankle, whose cable pulls a lever: swings, and loaded pulls.

    Args:
        effects: effects hidden in the cable.
        duration: duration of each trial [s].
        changes: changes of the cable.
    """
    lever = ANKLE.lever
    assert lever is not None
    cables = tuple(cable.replace(**dict(changes or {})) for cable in ANKLE.cables)
    for name, values in effects.items():
        change = EFFECTS[name].cables
        assert change is not None
        cables = change(
            cables,
            values,
            RigGeometry(ANKLE.motor_radius, ANKLE.joint_radius, ANKLE.exit_angle),
        )
    drive = Transmission(cables, ANKLE.motor_radius, ANKLE.joint_radius)
    random = np.random.default_rng(6)
    time = DT * np.arange(round(duration / DT))
    trials = []
    for name, rate, wind in (("a", 5.0, 2.3), ("b", 2.6, 6.1), ("c", 8.0, 3.3)):
        joint = 0.3 * np.sin(rate * time)
        pulley = lever.turned(joint)
        motor = drive.ratio * pulley + 0.5 * np.sin(wind * time) ** 2
        played = drive.replay(DT, motor_angle=motor, joint_angle=pulley)
        noise = random.normal(0.0, 1.0, (4, time.size))
        trials.append(
            Trial(
                name,
                time,
                motor + 5e-5 * noise[0],
                played.motor_torque + 0.05 * noise[1],
                joint + 5e-5 * noise[2],
                played.joint_torque * lever.share(joint) + 0.1 * noise[3],
                (slice(0, time.size),),
                DT,
                path=f"{name}.csv",
            )
        )
    return Dataset(
        tuple(trials),
        noise={
            "motor_angle_rad": Noise(5e-5, 0.0, "declared"),
            "joint_angle_rad": Noise(5e-5, 0.0, "declared"),
            "motor_torque_nm": Noise(0.05, 0.0, "declared"),
            "joint_torque_nm": Noise(0.1, 0.0, "declared"),
        },
    )


def played_by_mujoco(
    bench: Bench, step: float, motor: np.ndarray, joint: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the forces at the ends of a single cable [N] and its moment arm [m].

    MuJoCo steps the scene while motor and joint are held to their angles, in the
    scene's signs.
    """
    model = mujoco.MjModel.from_xml_path(str(bench.path))
    data = mujoco.MjData(model)
    model.opt.timestep = step
    angles = np.array([motor, joint])
    speed = np.gradient(angles, step, axis=1)
    force = 1e8 * np.gradient(speed, step, axis=1)
    joints = [model.joint(bench.motor), model.joint(bench.joint)]
    place = [int(each.qposadr[0]) for each in joints]
    dof = [int(each.dofadr[0]) for each in joints]
    model.dof_armature[dof] += 1e8
    model.dof_invweight0[dof] /= 1.0 + 1e8 * model.dof_invweight0[dof]
    model.dof_M0[dof] += 1e8
    name = bench.names[0]
    ends = [model.actuator(f"{name}_{end}").id for end in ("proximal", "distal")]
    tendon = int(model.actuator_trnid[ends[1], 0])
    shown = np.empty((2, motor.size))
    for k in range(motor.size):
        data.qpos[place], data.qvel[dof] = angles[:, k], speed[:, k]
        data.qfrc_applied[dof] = force[:, k]
        mujoco.mj_step(model, data)
        shown[:, k] = data.actuator_force[ends]
    arm = np.array([_arm(model, tendon, place[1], angle) for angle in joint])
    return shown[0], shown[1], arm


def _arm(model: mujoco.MjModel, tendon: int, place: int, angle: float) -> float:
    """Return the change of a tendon's length with a joint, by a difference [m/rad]."""
    data, lengths = mujoco.MjData(model), []
    for side in (-1e-5, 1e-5):
        data.qpos[place] = angle + side
        mujoco.mj_fwdPosition(model, data)
        lengths.append(data.ten_length[tendon])
    return float(lengths[1] - lengths[0]) / 2e-5


def angles_only(data: Dataset) -> Dataset:
    """Return trials of a known load without their torque of the motor."""
    noise = {n: v for n, v in data.noise.items() if n != "motor_torque_nm"}
    trials = tuple(replace(trial, motor_torque=None) for trial in data.trials)
    known = Instruments(None, "known load")
    return replace(data, trials=trials, noise=noise, instruments=known)
