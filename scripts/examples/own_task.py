"""A task of your own: the torque that the wearer should feel.

python own_task.py
cc-mujoco play wrist --task own_task:Detents --controller predictive
"""

import numpy as np

import cc_mujoco


class Detents(cc_mujoco.Task):
    """A handle that clicks every 0.1 rad."""

    def torque(self, angle, velocity, phase):
        """Return the desired torque at the joint [N m]."""
        return -0.4 * np.sin(2.0 * np.pi * angle / 0.1) - 0.05 * velocity


def run():
    """Return what is felt over the angle of the wrist."""
    log = cc_mujoco.simulate(
        "wrist", "predictive", motion="sine:0.3", task=Detents(), duration=4.0
    )
    angle = log["joint_angle_rad"]
    curves = {
        "felt": (angle, log["joint_torque_nm"]),
        "desired": (angle, log["desired_torque_nm"]),
    }
    return "angle [rad]", "torque at the wrist [N m]", curves


if __name__ == "__main__":
    felt, desired = (torque for _, torque in run()[2].values())
    print(f"felt as desired to {np.sqrt(np.mean((felt - desired) ** 2)):.3f} N m RMS")
