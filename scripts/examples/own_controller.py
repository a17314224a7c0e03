"""A controller of your own: feed friction forward by the sense of the motion.

python own_controller.py
cc-mujoco benchmark --scene wrist --controllers pi own_controller:lead
"""

import cc_mujoco


def lead(drive):
    """Return the motor's torque as a function of what is measured."""
    gain = 0.15 * drive.high

    def torque(seen):
        moving = seen["joint_velocity_rad_s"] * drive.ratio
        ahead = seen["desired_torque_nm"] / drive.ratio
        return ahead + gain * moving / (abs(moving) + 0.5)

    return torque


def run():
    """Return the torque at the wrist with it, beside two controllers of the package."""
    curves = {}
    for law in ("none", lead, "model"):
        log = cc_mujoco.simulate(
            "wrist", law, motion="sine:0.3", task="spring:2.5", duration=2.0
        )
        name = law if isinstance(law, str) else law.__name__
        curves[name] = (log["time_s"], log["joint_torque_nm"])
    curves["desired"] = (log["time_s"], log["desired_torque_nm"])
    return "time [s]", "torque at the wrist [N m]", curves


if __name__ == "__main__":
    found = run()[2]
    _, desired = found.pop("desired")
    for name, (_, torque) in found.items():
        print(f"{name}: {((torque - desired) ** 2).mean() ** 0.5:.2f} N m RMS error")
