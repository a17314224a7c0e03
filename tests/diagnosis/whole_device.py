"""Devices whose axes share joints, played whole by MuJoCo while every joint moves.

One cable hides an effect. What sensors would show is written as the log of the device,
at 500 Hz with noise. The torque at a joint is that of all cables that pull there.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from cc_mujoco.datasets import Bench
from cc_mujoco.device import load_device
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.plugin import from_mjcf, settle, to_mjcf

STEP, SUBSTEPS, LEAD = 0.002, 8, 0.5
"""Sampling and substeps of it; time from the pose of the scene to the motion [s]."""
OTHERWISE = {"friction": 1.1, "axial_stiffness": 0.93, "pretension": 1.06}
"""Values of the rig over those of the scene, for the baseline to tune."""
TURNED = ("angle_rad", "torque_nm")
"""Columns that count as the scene, where the cable pulls the other way."""


class Device(NamedTuple):
    """A device of several axes, as the scene has it."""

    scene: str  # its name
    benches: dict[str, Bench]  # of all axes, by name
    # middle and reach of the motion of every joint [rad]
    joints: dict[str, tuple[float, float]]

    @classmethod
    def of(cls, scene: str) -> Device:
        found = load_device(scene).description
        benches = {axis.name: Bench.of(scene, axis.name) for axis in found.axes}
        joints = {}
        for bench in benches.values():
            sign = 1.0 if bench.lever is None else bench.lever.sign
            reach = min(bench.reach, 0.4 * np.ptp(bench.span))
            joints[bench.joint] = (sign * bench.centre, reach)
        return cls(scene, benches, joints)


def hidden_values(bench: Bench, name: str) -> dict[str, float]:
    """Return the cable parameters, in SI, by which the rig has the hidden effect."""
    cable = bench.cables[0]
    values = {key: scale * getattr(cable, key) for key, scale in OTHERWISE.items()}
    sizes = {
        "end_compliance": cable.length / cable.axial_stiffness / 3.0,
        "viscous_friction": 6.0 * cable.pretension / cable.length,
    }
    return {**values, name: sizes[name]}


def motions(
    device: Device, axis: str, seconds: float
) -> list[tuple[str, float, dict[str, Array], float]]:
    """Return trials: name, relative pretension, all joint angles, and the motor's pull.

    Angles are (samples,) in the scene's sign [rad]. The pull is the motor's excursion
    over the cable stretch at pretension, while the motor follows the joints.
    """
    t = STEP * np.arange(round(seconds / STEP))
    driven = device.benches[axis].joint
    shapes = {
        "swept": np.sin(2.0 * np.pi * (0.15 * t + 0.12 * t**2)),
        "slow": np.sin(1.7 * t),
        "stops": 0.7 * np.interp(t % 4.0, [0, 1, 2, 2.4, 2.6, 4], [0, 1, 1, -1, -1, 0]),
        "held": np.full(t.size, 0.3),
        "taut": np.sin(1.7 * t),
        "test": 0.7 * np.sin(2.3 * t + 1.0),
    }
    found = []
    for k, (name, shape) in enumerate(shapes.items()):
        angles = {}
        for row, (joint, (middle, reach)) in enumerate(device.joints.items()):
            own = shape if joint == driven else np.sin((1.1 + 0.23 * row) * t + row + k)
            size = 0.8 if joint == driven else 0.4
            angles[joint] = middle + size * reach * own
        pull = {"held": 1.5, "taut": 1.0}.get(name, 0.8)
        found.append((name, 2.0 if name == "taut" else 1.0, angles, pull))
    return found


def played(
    device: Device,
    axis: str,
    cable: Mapping[str, float],
    tension: float,
    angles: Mapping[str, Array],
    pull: float,
) -> dict[str, Array]:
    """Return the columns (samples,) of the log of the whole device, without noise."""
    own = device.benches[axis]
    spec = mujoco.MjSpec.from_file(str(own.path))
    for name, known in from_mjcf(spec).items():
        if name in own.names:
            values = {**cable, "pretension": tension * cable["pretension"]}
            to_mjcf(spec, name, known.replace(**values))
    spec.option.timestep = STEP / SUBSTEPS
    model = spec.compile()
    size = next(iter(angles.values())).size
    t = STEP * np.arange(size)
    moved = dict(angles)
    for bench in device.benches.values():
        sign = 1.0 if bench.lever is None else bench.lever.sign
        others = np.array([angles[name] for name in bench.others])
        joint = sign * angles[bench.joint]
        along = bench.following(joint, bench.recorded_path(joint, others))
        length = bench.cables[0].length / bench.cables[0].axial_stiffness
        stretch = 12.0 * length * bench.cables[0].pretension / bench.motor_radius
        if bench.axis == axis:
            wave = 0.5 - 0.5 * np.cos(1.3 * t) + 0.15 * np.sin(9.0 * t)
        else:
            wave = 0.3 - 0.2 * np.cos(0.9 * t)
        moved[bench.motor] = along + pull * stretch * wave
    places = [int(model.joint(name).qposadr[0]) for name in moved]
    order = {name: row for row, name in enumerate(moved)}
    dofs = [int(model.joint(name).dofadr[0]) for name in moved]
    lead = round(LEAD / STEP)
    ramp = np.linspace(0.0, 1.0, lead + 1)[:-1]
    rest = model.qpos0[places][:, None]
    coarse = np.array(list(moved.values()))
    coarse = np.concatenate([rest + ramp * (coarse[:, :1] - rest), coarse], axis=1)
    fine = np.arange(SUBSTEPS * (coarse.shape[1] - 1) + 1) / SUBSTEPS
    at = np.arange(coarse.shape[1])
    poses = np.array([np.interp(fine, at, row) for row in coarse])
    speeds = np.gradient(poses, model.opt.timestep, axis=1)
    model.dof_armature[:] += 1e8
    model.dof_invweight0[:] = 1e-8
    model.dof_M0[:] += 1e8
    data = mujoco.MjData(model)
    settle(model, data)
    columns: dict[str, list[float]] = {}

    def put(name: str, value: float) -> None:
        columns.setdefault(name, []).append(value)

    for k in range(fine.size):
        data.qpos[places], data.qvel[dofs] = poses[:, k], speeds[:, k]
        mujoco.mj_step(model, data)
        if k % SUBSTEPS or k < lead * SUBSTEPS:
            continue
        forces = cable_torques(model, data)
        for bench in device.benches.values():
            end = model.actuator(f"{bench.names[0]}_proximal").id
            pulls = [
                data.actuator_force[model.actuator_outadr[e]] for e in (end, end + 1)
            ]
            put(f"{bench.axis}.motor_angle_rad", poses[order[bench.motor], k])
            put(f"{bench.axis}.motor_torque_nm", bench.motor_radius * pulls[0])
            put(f"{bench.axis}.joint_angle_rad", poses[order[bench.joint], k])
            dof = int(model.joint(bench.joint).dofadr[0])
            put(f"{bench.axis}.joint_torque_nm", forces[dof])
            put(f"tension_{bench.names[0]}_proximal_n", pulls[0])
            put(f"tension_{bench.names[0]}_distal_n", -pulls[1])
    return {"time_s": t} | {name: np.array(v) for name, v in columns.items()}


def cable_torques(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Return the torque of all cables on the joints (nv,) [N m]."""
    moment = np.zeros((data.moment_rownnz.size, model.nv))
    mujoco.mju_sparse2dense(
        moment, data.actuator_moment, data.moment_rownnz, data.moment_rowadr,
        data.moment_colind,
    )  # fmt: skip
    ends = model.actuator_outadr[np.flatnonzero(model.actuator_plugin >= 0)]
    open_pieces = data.qfrc_passive - data.qfrc_spring - data.qfrc_damper
    open_pieces -= data.qfrc_gravcomp + data.qfrc_fluid
    return moment[ends].T @ data.actuator_force[ends] + open_pieces


def record(
    folder: Path, device: Device, axis: str, hidden: str, seconds: float, seed: int = 1
) -> None:
    random = np.random.default_rng(seed)
    bench = device.benches[axis]
    values = hidden_values(bench, hidden)
    scale = bench.cables[0].pretension
    noise = {
        f"{axis}.motor_torque_nm": 0.01 * scale * bench.motor_radius,
        f"{axis}.joint_torque_nm": 0.01 * scale * bench.joint_radius,
    }
    folder.mkdir(parents=True, exist_ok=True)
    lines = []
    for name, tension, angles, pull in motions(device, axis, seconds):
        columns = played(device, axis, values, tension, angles, pull)
        for column in columns:
            size = noise.get(column, 0.0)
            if column.endswith("angle_rad"):
                size = 1e-5
            elif column.startswith("tension"):
                size = 0.01 * scale
            columns[column] = columns[column] + size * random.standard_normal(
                columns[column].size
            )
        columns["time_s"] = STEP * np.arange(columns["time_s"].size)
        table = np.column_stack(list(columns.values()))
        np.savetxt(
            folder / f"{name}.csv", table, "%.9g", ",", header=",".join(columns),
            comments="",
        )  # fmt: skip
        split = '\nsplit = "test"' if name == "test" else ""
        lines.append(f"[trials.{name}]\npretension = {tension * scale}{split}\n")
    if bench.lever is not None and bench.lever.sign < 0.0:
        lines = [f"[columns.joint_{what}]\nsign = -1\n" for what in TURNED] + lines
    (folder / "dataset.toml").write_text("\n".join(lines), encoding="utf-8")
