"""Torques of an open tendon on a two-joint arm, piece by piece and with one tension.

    python scripts/figures/open_tendon.py cc_mujoco/plugin/open_tendon.png

The arm is Gymnasium's `reacher`. A cord runs from a winch over two guides to the second
link; the winch pulls with a steady torque while both joints swing. Draws the torques of
the cord, with friction at its guides, beside those of one tension along all of it, that
at the winch, and prints what differs.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import gymnasium
import mujoco
import numpy as np

import cc_mujoco
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.plugin import settle
from cc_mujoco.report import BLUE, ORANGE, figure, figure_path, save, style

FRICTION = 0.3
PULL = 30.0  # tension at the winch [N]
DRUM = 0.02
SITES = {
    "near": ("", (-0.03, 0.03, 0.01)),
    "by": ("body0", (0.03, 0.015, 0.0)),
    "on": ("body0", (0.085, 0.014, 0.0)),
    "tip": ("body1", (0.06, 0.012, 0.0)),
}
JOINTS = {"joint0": (0.6, 1.0), "joint1": (0.8, 1.7)}
"""Amplitude [rad] and frequency [Hz] of both joints."""
SECONDS = 2.0


def arm() -> mujoco.MjModel:
    assets = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"
    spec = mujoco.MjSpec.from_file(str(assets / "reacher.xml"))
    spec.option.timestep = 1e-4
    cord = spec.add_tendon(name="cord")
    for name, (body, place) in SITES.items():
        (spec.body(body) if body else spec.worldbody).add_site(name=name, pos=place)
        cord.wrap_site(name)
    winch = spec.worldbody.add_body(name="winch", mass=0.1, inertia=[2e-5] * 3)
    winch.add_joint(
        name="winch",
        limited=mujoco.mjtLimited.mjLIMITED_FALSE,
        armature=0.0,
        damping=[5e-4, 0, 0],
    )
    cc_mujoco.add_friction(
        spec, "cord", motor=("winch", DRUM), friction=FRICTION,
        axial_stiffness=4000.0, pretension=PULL,
    )  # fmt: skip
    return spec.compile()


def swing(model: mujoco.MjModel) -> tuple[Array, Array, Array]:
    """Simulate prescribed joints and a free winch.

    Returns the time [s], and the torque of the cord on each joint, as it is and with
    one tension along all of the cord, (steps, 2) each [N m].
    """
    data = mujoco.MjData(model)
    places = [int(model.joint(name).qposadr[0]) for name in JOINTS]
    dofs = [int(model.joint(name).dofadr[0]) for name in JOINTS]
    winch = int(model.joint("winch").dofadr[0])
    rest = data.qpos[places].copy()
    settle(model, data)
    bare = mujoco.MjData(model)
    steps = round(SECONDS / model.opt.timestep)
    time = np.arange(steps) * model.opt.timestep
    torque, single = np.empty((steps, 2)), np.empty((steps, 2))
    size, pace = np.array(list(JOINTS.values())).T
    for k, t in enumerate(time):
        phase = 2.0 * np.pi * pace * t
        data.qpos[places] = rest - 0.5 * size * (1.0 - np.cos(phase))
        data.qvel[dofs] = -np.pi * pace * size * np.sin(phase)
        data.qfrc_applied[winch] = PULL * DRUM
        mujoco.mj_forward(model, data)
        bare.qpos[:], bare.qvel[:] = data.qpos, data.qvel
        mujoco.mj_fwdPosition(model, bare)
        mujoco.mj_fwdVelocity(model, bare)
        total = data.qfrc_actuator + data.qfrc_passive - bare.qfrc_passive
        torque[k] = total[dofs]
        arms = np.zeros(model.nv)
        distal = model.actuator("cord_distal").id
        start, count = data.moment_rowadr[distal], data.moment_rownnz[distal]
        part = slice(start, start + count)
        arms[data.moment_colind[part]] = data.actuator_moment[part]
        single[k] = -data.actuator("cord_proximal").force[0] * arms[dofs]
        mujoco.mj_step(model, data)
    return time, torque, single


def draw(path: Path, time: Array, torque: Array, single: Array) -> None:
    with style():
        drawing = figure(7.0, 4.6)
        axes = drawing.subplots(2, 1, sharex=True)
        for axis, name, right, wrong in zip(
            axes, ("Shoulder", "Elbow"), torque.T, single.T, strict=True
        ):
            axis.plot(time, right, color=BLUE, label="each piece its own")
            axis.plot(time, wrong, color=ORANGE, label="one tension")
            axis.set(title=name, ylabel="torque [N m]")
        axes[1].set(xlabel="time [s]", xlim=(0, SECONDS))
        axes[0].legend()
        save(path, drawing)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=figure_path)
    out = parser.parse_args().out
    time, torque, single = swing(arm())
    draw(out, time, torque, single)
    error = np.sqrt(np.mean((single - torque) ** 2, axis=0))
    error /= np.abs(torque).max(axis=0)
    print(
        "With one tension, that at the winch, the torque at the shoulder is off by "
        f"{error[0]:.0%} and at the elbow by {error[1]:.0%} (RMS over the largest)."
    )


if __name__ == "__main__":
    main()
