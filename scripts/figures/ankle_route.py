"""Ankle assistance over a gait cycle, with a route that is fixed and one that moves.

    python scripts/figures/ankle_route.py cc_mujoco/plugin/ankle_route.png

The motor of the ankle exoskeleton keeps the same tension at its own end twice: what
push-off assistance needs at the heel, and enough to keep the cable taut. Once the
conduit keeps the bends of the neutral pose, once it bends as the leg moves. Draws the
last gait cycle and prints what differs.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from cc_mujoco import plugin, report
from cc_mujoco.assets import scene_path
from cc_mujoco.human import GAIT_ANGLES, GAIT_PERIOD, assistance
from cc_mujoco.native import FloatArray as Array

CABLE = "plantarflexor"
PEAK = 40.0  # largest assistance wanted at the ankle [N m]
TAUT = 30.0  # tension at the motor that keeps the cable taut [N]
BANDWIDTH = 150.0  # bandwidth of the control of the tension at the motor [rad/s]
CYCLES = 3
MOVERS = {"ankle": "wearer", "hip": "wearer_hip", "knee": "wearer_knee"}


class Cycle(NamedTuple):
    """The last gait cycle; arrays have one entry per time step."""

    phase: Array  # fraction of the cycle
    wrap: Array  # wrap angle of the conduit [rad]
    torque: Array  # of the cable on the ankle, plantarflexion positive [N m]
    motor: Array  # tension at the motor [N]
    heel: Array  # tension at the heel [N]
    lost: float  # energy that friction took in the cycle [J]


def scene(bend: str) -> mujoco.MjModel:
    """Return the ankle exoskeleton whose conduit has this `bend` key."""
    spec = mujoco.MjSpec.from_file(str(scene_path("ankle")))
    cable = plugin.from_mjcf(spec)[CABLE]
    plugin.to_mjcf(spec, CABLE, cable.replace(bend=bend))
    return spec.compile()


def lever(model: mujoco.MjModel) -> float:
    """Return the moment arm of the cable at the heel in the neutral pose [m]."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    lengths = []
    for angle in (-1e-5, 1e-5):
        data.joint("ankle").qpos[0] = angle
        mujoco.mj_fwdPosition(model, data)
        lengths.append(data.ten_length[model.tendon(f"{CABLE}_free_distal").id])
    return float(lengths[1] - lengths[0]) / 2e-5


def walk(model: mujoco.MjModel) -> Cycle:
    data = mujoco.MjData(model)
    cable = plugin.from_mjcf(model)[CABLE]
    proximal = model.actuator(f"{CABLE}_proximal")
    distal = model.actuator(f"{CABLE}_distal")
    motor, ankle = model.joint("motor"), model.joint("ankle")
    arm = lever(model)
    drum = abs(float(proximal.gear[0]))
    inertia = float(model.dof_M0[motor.dofadr[0]])
    damping = 2.0 * BANDWIDTH * inertia / drum**2
    gain = BANDWIDTH**2 * inertia * cable.length / cable.axial_stiffness / drum**2
    for joint, profile in GAIT_ANGLES.items():
        data.joint(joint).qpos[0] = profile(0.0)
    mujoco.mj_forward(model, data)
    paid_out = data.actuator_length[distal.id] - model.actuator_length0[distal.id]
    data.joint("motor").qpos[0] = paid_out / proximal.gear[0]
    each = round(GAIT_PERIOD / model.opt.timestep)
    rows = np.empty((each, 5))
    before = 0.0
    for i in range(CYCLES * each):
        phase = (i % each) / each
        for joint, mover in MOVERS.items():
            data.actuator(mover).ctrl[0] = GAIT_ANGLES[joint](phase)
        if i == (CYCLES - 1) * each:
            before = plugin.read(model, data, CABLE).dissipated
        wanted = TAUT + PEAK * assistance(phase) / arm
        lacking = wanted - data.actuator_force[proximal.id]
        stretching = (
            data.actuator_velocity[distal.id] - data.actuator_velocity[proximal.id]
        )
        pull = wanted + gain * lacking - damping * stretching
        data.actuator("motor").ctrl[0] = drum * pull
        mujoco.mj_step(model, data)
        torque = data.qfrc_actuator[ankle.dofadr[0]] - data.actuator("wearer").force[0]
        rows[i % each] = (
            phase, plugin.segment_wrap(model, data, CABLE).sum(), -torque,
            data.actuator_force[proximal.id], -data.actuator_force[distal.id],
        )  # fmt: skip
    lost = plugin.read(model, data, CABLE).dissipated - before
    return Cycle(*rows.T, lost)


def draw(path: Path, fixed: Cycle, moving: Cycle) -> None:
    with report.style():
        drawing = report.figure(7.2, 7.0)
        axes = drawing.subplots(3, 1, sharex=True)
        both = {
            "fixed route": (fixed, report.BLUE),
            "moving route": (moving, report.ORANGE),
        }
        for name, (cycle, color) in both.items():
            percent = 100.0 * cycle.phase
            axes[0].plot(percent, cycle.wrap, color=color, label=name)
            axes[1].plot(percent, cycle.heel / cycle.motor, color=color)
            axes[2].plot(percent, cycle.torque, color=color)
        wanted = PEAK * assistance(fixed.phase)
        axes[2].plot(
            100.0 * fixed.phase, wanted, color=report.BLACK, dashes=report.DASH_PATTERN,
            label="wanted",
        )  # fmt: skip
        axes[0].set(title="Wrap angle of the conduit", ylabel="wrap [rad]")
        axes[1].set(
            title="Tension that arrives at the heel", ylabel="heel / motor tension [-]"
        )
        axes[2].set(
            title="Assistance at the ankle",
            ylabel="plantarflexion torque [N m]",
            xlabel="gait cycle from heel strike [%]",
            xlim=(0, 100),
        )
        axes[0].legend()
        axes[2].legend()
        report.save(path, drawing)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=report.figure_path)
    out = parser.parse_args().out
    fixed, moving = (walk(scene(bend)) for bend in ("fixed", "route"))
    draw(out, fixed, moving)
    print(
        f"wrap {moving.wrap.min():.1f} to {moving.wrap.max():.1f} rad, in the neutral "
        f"pose {fixed.wrap[0]:.1f} rad; friction takes "
        f"{moving.lost / fixed.lost - 1.0:+.0%} energy"
    )


if __name__ == "__main__":
    main()
