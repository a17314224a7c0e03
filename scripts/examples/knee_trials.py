"""Record trials of a knee exoskeleton whose conduit hides an effect, as CSV files.

    python knee_trials.py --out trials
    python knee_trials.py --hide viscous_friction=40 pretension=8 --bits 18 --out trials

It simulates `knee_exo.xml` with other values than the file has, and writes what sensors
of a real device would have read: both angles in steps of their encoders, both torques
with noise. `cc-mujoco diagnose` gets the files and the scene, not the values.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from cc_mujoco import Plant, simulate

TRIALS = {
    "slow": ("sine:0.7", "hold:6"),
    "slow_and_strong": ("sine:0.7", "hold:14"),
    "fast": ("chirp:0.4,high=1.5", "hold:8"),
    "mixed": ("multisine:0.5", "hold:10"),
    "rests": ("reach:0.6", "hold:8"),
    "again": ("multisine:0.4", "hold:6"),
}
"""Motion of the person and torque of the device by trial."""
RATE = 250
"""Readings per second."""
NOISE = {"motor_torque_nm": 2e-3, "joint_torque_nm": 0.02}
"""Standard deviation of both torque sensors [N m]."""


def main() -> None:
    """Simulate and write every trial."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scene", default="knee_exo.xml", help="MJCF file")
    parser.add_argument("--hide", nargs="+", default=["viscous_friction=60"])
    parser.add_argument("--seconds", type=float, default=12.0, help="of each trial")
    parser.add_argument("--bits", type=int, default=16, help="of both encoders")
    parser.add_argument("--out", type=Path, default=Path("trials"))
    options = parser.parse_args()
    digit = 2.0 * np.pi / 2**options.bits
    hidden = {key: float(size) for key, size in (h.split("=") for h in options.hide)}
    plant = Plant(options.scene, hidden)
    cable, radius = next(iter(plant.device.radii.items()))
    options.out.mkdir(parents=True, exist_ok=True)
    for number, (name, (motion, task)) in enumerate(TRIALS.items()):
        log = simulate(
            plant,
            "none",
            trajectory=motion,
            task=task,
            seed=number,
            duration=options.seconds,
        )
        every = round(1.0 / (RATE * log["time_s"][1]))
        noise = np.random.default_rng(number)
        read = {
            "time_s": log["time_s"],
            "motor_angle_rad": digit * np.round(log["motor_angle_rad"] / digit),
            # A sensor between motor and spool: what the rope takes from the motor.
            "motor_torque_nm": radius[0] * log[f"tension_{cable}_proximal_n"],
            "joint_angle_rad": digit * np.round(log["joint_angle_rad"] / digit),
            "joint_torque_nm": log["joint_torque_nm"],
        }
        for column, deviation in NOISE.items():
            read[column] = read[column] + noise.normal(
                0.0, deviation, len(read["time_s"])
            )
        table = np.column_stack(list(read.values()))[::every]
        file, head = options.out / f"{name}.csv", ",".join(read)
        np.savetxt(file, table, "%.6f", delimiter=",", header=head, comments="")
    print(f"wrote {len(TRIALS)} trials to {options.out}")


if __name__ == "__main__":
    main()
