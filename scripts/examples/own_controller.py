"""A controller of your own: feed friction forward by the sense of the motion.

python own_controller.py
cc-mujoco benchmark wrist --controllers pi_tuned own_controller:lead
"""

import matplotlib.pyplot as plt

import cc_mujoco


def lead(drive):
    """Return the motor's torque as a function of what is measured."""
    gain = 0.15 * drive.high

    def torque(seen):
        moving = seen["joint_velocity_rad_s"] * drive.ratio
        ahead = seen["desired_torque_nm"] / drive.ratio
        return ahead + gain * moving / (abs(moving) + 0.5)

    return torque


if __name__ == "__main__":
    for law in ("none", lead, "pi_tuned"):
        log = cc_mujoco.simulate(
            "wrist", law, trajectory="sine:0.3", task="spring:2.5", duration=2.0
        )
        name = law if isinstance(law, str) else law.__name__
        torque, desired = log["joint_torque_nm"], log["desired_torque_nm"]
        print(f"{name}: {((torque - desired) ** 2).mean() ** 0.5:.2f} N m RMS error")
        plt.plot(log["time_s"], torque, label=name)
    plt.plot(log["time_s"], desired, label="desired")
    plt.xlabel("time [s]")
    plt.ylabel("torque at the wrist [N m]")
    plt.legend()
    plt.savefig("own_controller.png")
