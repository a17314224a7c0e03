"""A policy from a file: a network that observes and acts as in its environment.

python play_policy.py
cc-mujoco play wrist --controller policy.safetensors

`scripts/train_policy.py` trains one; here the weights are written by hand.
"""

import tempfile
from pathlib import Path

import gymnasium
import numpy as np

import cc_mujoco
from cc_mujoco.control import Network, write_policy


def run():
    """Return the torque at the wrist with the policy."""
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
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "policy.safetensors"
        write_policy(file, network, observed)
        curves = {}
        for name, law in (("none", "none"), ("policy", str(file))):
            log = cc_mujoco.simulate(
                "wrist", law, motion="sine:0.3", task="spring:2.5", duration=1.5
            )
            curves[name] = (log["time_s"], log["joint_torque_nm"])
    curves["desired"] = (log["time_s"], log["desired_torque_nm"])
    return "time [s]", "torque at the wrist [N m]", curves


if __name__ == "__main__":
    found = run()[2]
    _, desired = found.pop("desired")
    for name, (_, torque) in found.items():
        print(f"{name}: {((torque - desired) ** 2).mean() ** 0.5:.2f} N m RMS error")
