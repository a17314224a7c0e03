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


def scene(bend: str) -> mujoco.MjModel:
    """Return the ankle exoskeleton whose conduit has this `bend` key."""
    spec = mujoco.MjSpec.from_file(str(scene_path("ankle")))
    cable = plugin.from_mjcf(spec)[CABLE]
    plugin.to_mjcf(spec, CABLE, cable.replace(bend=bend))
    return spec.compile()


def walk(model: mujoco.MjModel) -> tuple[Array, float]:
    """Simulate a walk; return rows of the last gait cycle and the energy it lost [J].

    Rows (5, samples) are phase, wrap angle [rad], torque of the cable on the ankle,
    plantarflexion positive [N m], and tension at the motor and at the heel [N].
    """
    data = mujoco.MjData(model)
    cable = plugin.from_mjcf(model)[CABLE]
    proximal = model.actuator(f"{CABLE}_proximal")
    distal = model.actuator(f"{CABLE}_distal")
    motor, ankle = model.joint("motor"), model.joint("ankle")
    lengths = []
    for angle in (-1e-5, 1e-5):  # about the neutral pose
        data.joint("ankle").qpos[0] = angle
        mujoco.mj_fwdPosition(model, data)
        lengths.append(data.ten_length[model.tendon(f"{CABLE}_free_distal").id])
    arm = float(lengths[1] - lengths[0]) / 2e-5
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
    return rows.T, plugin.read(model, data, CABLE).dissipated - before


def draw(path: Path, cycles: dict[str, Array]) -> None:
    panels = {
        "Wrap angle of the conduit": "wrap [rad]",
        "Tension that arrives at the heel": "heel / motor tension [-]",
        "Assistance at the ankle": "plantarflexion torque [N m]",
    }
    with report.style():
        drawing = report.figure(7.2, 7.0)
        axes = drawing.subplots(3, 1, sharex=True)
        for name, (phase, wrap, torque, motor, heel) in cycles.items():
            for own, curve in zip(axes, (wrap, heel / motor, torque), strict=True):
                own.plot(100.0 * phase, curve, label=name)
        looks = {"color": report.BLACK, "dashes": report.DASH_PATTERN}
        wanted = PEAK * assistance(phase)
        axes[2].plot(100.0 * phase, wanted, **looks, label="wanted")
        for own, (title, label) in zip(axes, panels.items(), strict=True):
            own.set(title=title, ylabel=label)
        axes[2].set(xlabel="gait cycle from heel strike [%]", xlim=(0, 100))
        axes[2].legend()
        report.save(path, drawing)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=report.figure_path)
    out = parser.parse_args().out
    (fixed, before), (moving, now) = (walk(scene(bend)) for bend in ("fixed", "route"))
    draw(out, {"fixed route": fixed, "moving route": moving})
    print(
        f"wrap {moving[1].min():.1f} to {moving[1].max():.1f} rad, in the neutral pose "
        f"{fixed[1, 0]:.1f} rad; friction takes {now / before - 1.0:+.0%} energy"
    )


if __name__ == "__main__":
    main()
