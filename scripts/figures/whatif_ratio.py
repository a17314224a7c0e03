"""Size of drum and lever: ratio against motor torque and motor power.

    python scripts/figures/whatif_ratio.py --out cc_mujoco/design/whatif_ratio.png

The ankle exoskeleton helps a walking wearer, with drums and levers of many sizes, each
driven by a model of its own cable. Draws what the motor must give, prints the result.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from scipy.stats import spearmanr
from whatif_study import grid, studied

from cc_mujoco.design import StudySpec, episodes, make_plan
from cc_mujoco.device import Plant, load_device
from cc_mujoco.report import BLACK, TENSION_COLORS, figure, save, style
from cc_mujoco.simulation import attended
from cc_mujoco.simulation._rollout import play

DRUM = np.linspace(0.01, 0.05, 9)
LEVER = np.linspace(0.06, 0.18, 7)
SHAPE = LEVER.size, DRUM.size
HOW: dict[str, Any] = {
    "duration": 5.0,
    "metrics": (
        "peak_motor_torque",
        "peak_motor_power",
        "rms_torque_error",
        "peak_tension",
    ),
}


def main() -> None:
    table, out = studied(
        __doc__,
        "whatif_ratio",
        DRUM.size * LEVER.size,
        scene="ankle",
        vary={"joint_radius": LEVER, "motor_radius": DRUM},
        **HOW,
    )
    draw(table, out)
    print(conclusion(table))


def draw(table: pa.Table, out: Path) -> None:
    """Draw four metrics over drum and lever."""
    panels = {
        "peak_motor_torque": "Motor torque [N m]",
        "peak_motor_power": "Motor power [W]",
        "peak_tension": "Cable tension [N]",
        "rms_torque_error": "Torque error, RMS [N m]",
    }
    with style():
        drawing = figure(10.0, 7.4)
        for axes, (name, title) in zip(
            drawing.subplots(2, 2).ravel(), panels.items(), strict=True
        ):
            image = axes.pcolormesh(
                1e3 * DRUM, 1e3 * LEVER, grid(table, name, *SHAPE), shading="nearest",
                cmap=TENSION_COLORS,
            )  # fmt: skip
            for ratio in (2, 3, 5, 10):
                x = np.array([9.0, 53.0])
                axes.plot(x, ratio * x, color="white", linewidth=0.7)
                at = min(50.0, 184.0 / ratio)
                axes.text(at, ratio * at, f"{ratio}", color="white", fontsize=8,
                          ha="right", va="bottom")  # fmt: skip
            axes.plot(25.0, 120.0, "o", color=BLACK, markersize=4)
            axes.grid(False)
            axes.set(title=title, xlabel="radius of the drum [mm]",
                     ylabel="lever at the heel [mm]", xlim=(7.5, 52.5),
                     ylim=(50.0, 190.0))  # fmt: skip
            drawing.colorbar(image, ax=axes)
        drawing.suptitle(
            "Ankle assistance: lines of equal ratio; the dot is the scene",
            x=0.012, ha="left", fontsize=11,
        )  # fmt: skip
        save(out, drawing)


def conclusion(table: pa.Table) -> str:
    """Return three sentences, with numbers from the study."""
    torque, power = (
        grid(table, "peak_motor_torque", *SHAPE),
        grid(table, "peak_motor_power", *SHAPE),
    )
    error, tension = (
        grid(table, "rms_torque_error", *SHAPE),
        grid(table, "peak_tension", *SHAPE),
    )
    ratio = LEVER[:, None] / DRUM
    steep = np.polyfit(np.log(ratio).ravel(), np.log(torque).ravel(), 1)[0]
    lever = np.polyfit(np.log(LEVER), np.log(tension.mean(axis=1)), 1)[0]
    alike = spearmanr(ratio.ravel(), power.ravel()).statistic
    most = np.unravel_index(np.argmax(power), power.shape)
    exact = np.unravel_index(np.argmin(error), error.shape)
    return (
        f"Peak motor torque goes with the ratio to the power {steep:.2f}, and tension "
        f"with the lever to the power {lever:.2f}. Peak motor power goes with "
        f"the ratio, too (rank correlation {alike:.2f}), up to "
        f"{power[most]:.0f} W with a drum of {1e3 * DRUM[most[1]]:.0f} mm and a lever "
        f"of {1e3 * LEVER[most[0]]:.0f} mm, where in "
        f"{racing(LEVER[most[0]], DRUM[most[1]]):.0%} of the time above half that "
        f"power the drum races to take up slack. The torque error is least, "
        f"{error[exact]:.2f} N m, with a drum of {1e3 * DRUM[exact[1]]:.0f} mm and a "
        f"lever of {1e3 * LEVER[exact[0]]:.0f} mm."
    )


def racing(lever: float, drum: float) -> float:
    """Return the slack share of the time above half the peak power."""
    design = {"joint_radius": float(lever), "motor_radius": float(drum)}
    plan = make_plan(StudySpec("ankle", designs=[design], **HOW))
    device = load_device("ankle")
    ((_, _, episode),) = episodes(plan.protocol, device)
    columns = play(episode, [attended(Plant(device, design))]).columns
    power = columns["motor_torque_nm"][0] * columns["motor_velocity_rad_s"][0]
    slack = columns["least_tension_n"][0, 0] <= 0.0
    return float(np.mean(slack[power > 0.5 * power.max()]))


if __name__ == "__main__":
    main()
