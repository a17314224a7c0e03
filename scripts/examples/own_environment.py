"""The Gymnasium environment of a device: cables sampled with every seed.

python own_environment.py
"""

from pathlib import Path

import gymnasium
import numpy as np

SCENE = Path(__file__).with_name("knee_exo.xml")


def run():
    """Return the torque at the knee under a constant action in three plants."""
    env = gymnasium.make(
        "cc_mujoco:cc_mujoco/Device-v1",
        device=str(SCENE),
        trajectory="sine:0.4",
        duration=1.0,
        randomise={"friction": (0.05, 0.3)},
    )
    curves = {}
    for seed in range(3):
        env.reset(seed=seed)
        torques, over = [], False
        while not over:
            _observation, _reward, ended, truncated, info = env.step([0.05])
            torques.append(float(info["joint_torque_nm"]))
            over = ended or truncated
        curves[f"seed {seed}"] = (np.arange(len(torques)) * 1e-3, np.array(torques))
    env.close()
    return "time [s]", "torque at the knee [N m]", curves


if __name__ == "__main__":
    for name, (_, torque) in run()[2].items():
        print(f"{name}: {torque.mean():.2f} N m in the mean")
