"""A policy from a file: a network that observes and acts as in its environment.

python play_policy.py
cc-mujoco play wrist --controller policy.safetensors

`scripts/train_policy.py` trains one; here the weights are written by hand.
"""

import gymnasium
import matplotlib.pyplot as plt
import numpy as np

import cc_mujoco
from cc_mujoco.control import Network, write_policy

env = gymnasium.make("cc_mujoco/WristHandle-v1")
(observed,) = env.unwrapped.exo.observed
size = observed.space.shape[0]
# Of a frame: what is lacking of the desired torque, and the desired torque.
lacking, desired = observed.units[4:6]
weights = np.zeros((1, size))
weights[0, 4] = 1.5 * lacking / (abs(observed.ratio) * observed.torque)
weights[0, 5] = 1.0 * desired / (observed.ratio * observed.torque)
network = Network(
    (weights,), (np.zeros(1),), "tanh", False, np.zeros(size), np.ones(size)
)
write_policy("policy.safetensors", network, observed)

for law in ("none", "policy.safetensors"):
    log = cc_mujoco.simulate(
        "wrist", law, trajectory="sine:0.3", task="spring:2.5", duration=1.5
    )
    name = law.partition(".")[0]
    torque, wanted = log["joint_torque_nm"], log["desired_torque_nm"]
    print(f"{name}: {((torque - wanted) ** 2).mean() ** 0.5:.2f} N m RMS error")
    plt.plot(log["time_s"], torque, label=name)
plt.plot(log["time_s"], wanted, label="desired")
plt.xlabel("time [s]")
plt.ylabel("torque at the wrist [N m]")
plt.legend()
plt.savefig("play_policy.png")
