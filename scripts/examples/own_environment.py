"""The Gymnasium environment of a device: cables sampled with every seed.

python own_environment.py
"""

from pathlib import Path

import gymnasium
import matplotlib.pyplot as plt
import numpy as np

SCENE = Path(__file__).with_name("knee_exo.xml")

env = gymnasium.make(
    "cc_mujoco:cc_mujoco/Device-v1",
    device=str(SCENE),
    trajectory="sine:0.4",
    duration=1.0,
    randomise={"friction": (0.05, 0.3)},
)
for seed in range(3):
    env.reset(seed=seed)
    torques, over = [], False
    while not over:
        observation, reward, ended, truncated, info = env.step([0.05])
        torques.append(float(info["joint_torque_nm"]))
        over = ended or truncated
    print(f"seed {seed}: {np.mean(torques):.2f} N m in the mean")
    plt.plot(np.arange(len(torques)) * 1e-3, torques, label=f"seed {seed}")
env.close()
plt.xlabel("time [s]")
plt.ylabel("torque at the knee [N m]")
plt.legend()
plt.savefig("own_environment.png")
