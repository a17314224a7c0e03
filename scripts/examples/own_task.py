"""A task of your own: the torque that the wearer should feel.

python own_task.py
cc-mujoco play wrist --task own_task:Detents --controller predictive
"""

import matplotlib.pyplot as plt
import numpy as np

import cc_mujoco


class Detents(cc_mujoco.Task):
    """A handle that clicks every 0.1 rad."""

    def torque(self, angle, velocity, phase):
        """Return the desired torque at the joint [N m]."""
        return -0.4 * np.sin(2.0 * np.pi * angle / 0.1) - 0.05 * velocity


if __name__ == "__main__":
    log = cc_mujoco.simulate(
        "wrist", "predictive", trajectory="sine:0.3", task=Detents(), duration=4.0
    )
    angle, delivered = log["joint_angle_rad"], log["joint_torque_nm"]
    desired = log["desired_torque_nm"]
    error = np.sqrt(np.mean((delivered - desired) ** 2))
    print(f"the wrist has the desired torque to {error:.3f} N m RMS")
    plt.plot(angle, delivered, label="delivered")
    plt.plot(angle, desired, label="desired")
    plt.xlabel("angle [rad]")
    plt.ylabel("torque at the wrist [N m]")
    plt.legend()
    plt.savefig("own_task.png")
