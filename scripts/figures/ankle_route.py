"""Ankle assistance over a gait cycle, with a route that is fixed and one that moves.

    python scripts/figures/ankle_route.py cc_mujoco/plugin/ankle_route.png

The motor of the ankle exoskeleton knows the cable of the scene and assists a walking
wearer twice: once the conduit keeps the bends of the neutral pose, once it bends as the
leg moves. Draws the last gait cycle and prints what differs.
"""

from __future__ import annotations

import argparse
from typing import Any

import gymnasium
import mujoco
import numpy as np
from figure_paths import figure_path

from cc_mujoco import Device, plugin, report, simulate
from cc_mujoco.assets import scene_path
from cc_mujoco.human import GAIT_PERIOD

CABLE = "plantarflexor"
SECONDS = 6.0
PANELS = {
    "wrap": ("Wrap angle of the conduit", "wrap [rad]"),
    "heel": ("Tension that arrives at the heel", "heel / motor tension [-]"),
    "torque": ("Assistance at the ankle", "plantarflexion torque [N m]"),
}


def walk(bend: str) -> dict[str, Any]:
    """Return columns of the last gait cycle with this `bend` key, and energy lost."""
    spec = mujoco.MjSpec.from_file(str(scene_path("ankle")))
    cable = plugin.from_mjcf(spec)[CABLE]
    plugin.to_mjcf(spec, CABLE, cable.replace(bend=bend))
    device = Device.from_spec(spec, axis={"safe_torque": 60.0})
    log = simulate(device, "model", trajectory="walk", task="assist", duration=SECONDS)
    model = gymnasium.make("cc_mujoco/Device-v1", device=device).unwrapped.model
    data, wraps = mujoco.MjData(model), []
    cycle = slice(-round(GAIT_PERIOD / log["time_s"][1]), None, 5)
    for qpos in log["qpos"][cycle]:
        data.qpos = qpos
        mujoco.mj_forward(model, data)
        wraps.append(plugin.segment_wrap(model, data, CABLE).sum())
    phase = np.arctan2(log["phase_sine"], log["phase_cosine"])[cycle]
    heel, motor = (log[f"tension_{CABLE}_{end}_n"] for end in ("distal", "proximal"))
    return {
        "phase": phase / (2.0 * np.pi) % 1.0,
        "wrap": np.array(wraps),
        "heel": (heel / np.where(motor > 0.0, motor, np.nan))[cycle],
        "torque": -log["joint_torque_nm"][cycle],
        "wanted": -log["desired_torque_nm"][cycle],
        "lost": np.ptp(log[f"dissipated_{CABLE}_j"][cycle]),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=figure_path)
    out = parser.parse_args().out
    walks = {name: walk(name) for name in ("fixed", "route")}
    with report.style():
        drawing = report.figure(7.2, 7.0)
        axes = drawing.subplots(3, 1, sharex=True)
        for own, (key, (title, label)) in zip(axes, PANELS.items(), strict=True):
            for name, found in walks.items():
                order = np.argsort(found["phase"])
                phase = 100.0 * found["phase"][order]
                own.plot(phase, found[key][order], label=f"bend {name}")
            own.set(title=title, ylabel=label)
        wanted = found["wanted"][order]
        own.plot(
            phase, wanted, color=report.BLACK, dashes=report.DASH_PATTERN,
            label="wanted",
        )  # fmt: skip
        own.set(xlabel="gait cycle from heel strike [%]", xlim=(0, 100))
        own.legend()
        report.save(out, drawing)
    fixed, moving = walks.values()
    print(
        f"wrap {moving['wrap'].min():.1f} to {moving['wrap'].max():.1f} rad, in the "
        f"neutral pose {fixed['wrap'][0]:.1f} rad; friction takes "
        f"{moving['lost'] / fixed['lost'] - 1.0:+.0%} energy"
    )


if __name__ == "__main__":
    main()
