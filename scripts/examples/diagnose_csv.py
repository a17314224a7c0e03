"""A diagnosis of CSV files: which effect does the scene lack?

python diagnose_csv.py

The trials are simulated, with drag in the conduit that the scene does not have.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import cc_mujoco

SCENE = Path(__file__).with_name("knee_exo.xml")
HIDDEN = {"viscous_friction": 60.0}  # N s/m^2
SECONDS = 12.0
TRIALS = [("sine:0.7", "hold:6"), ("chirp:0.4,high=1.5", "hold:8")]
TRIALS += [("multisine:0.5", "hold:10"), ("reach:0.6", "hold:8")]
COLUMNS = ("time_s", "motor_angle_rad", "motor_torque_nm")
COLUMNS += ("joint_angle_rad", "joint_torque_nm")


def main():
    """Record trials, diagnose them, and draw one of them."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "data").mkdir()
        angle, torque = record(folder / "data", SECONDS)
        verdict = cc_mujoco.diagnose(SCENE, folder / "data", folder / "out")
    print(verdict.statement)
    plt.plot(angle, torque, label="measured")
    plt.xlabel("angle of the knee [rad]")
    plt.ylabel("torque at the knee [N m]")
    plt.legend()
    plt.savefig("diagnose_csv.png")


def record(folder, seconds):
    """Write simulated readings of trials; return two columns of the fast trial."""
    plant = cc_mujoco.Plant(str(SCENE), HIDDEN)
    for number, (motion, task) in enumerate(TRIALS):
        log = cc_mujoco.simulate(
            plant, "none", trajectory=motion, task=task, seed=number, duration=seconds
        )
        noise = np.random.default_rng(number).normal
        size = len(log["time_s"])
        motor = 0.02 * log["tension_extensor_proximal_n"] + noise(0.0, 2e-3, size)
        read = {
            "time_s": log["time_s"],
            "motor_angle_rad": log["motor_angle_rad"] + noise(0.0, 3e-5, size),
            "motor_torque_nm": motor,
            "joint_angle_rad": log["joint_angle_rad"] + noise(0.0, 3e-5, size),
            "joint_torque_nm": log["joint_torque_nm"] + noise(0.0, 0.02, size),
        }
        table = np.column_stack([read[name] for name in COLUMNS])[::4]
        np.savetxt(
            folder / f"trial_{number}.csv",
            table,
            fmt="%.6f",
            delimiter=",",
            header=",".join(COLUMNS),
            comments="",
        )
        if number == 1:
            fast = table[:, 3], table[:, 4]
    return fast


if __name__ == "__main__":
    main()
