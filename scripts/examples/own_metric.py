"""A metric of your own: a number of an episode's log.

python own_metric.py
cc-mujoco play wrist --metric own_metric:LATE_TENSION
"""

import matplotlib.pyplot as plt
import numpy as np

import cc_mujoco


def late_tension(log):
    """Return the largest difference of the tensions at both ends of any cable [N]."""
    return max(
        np.abs(
            log[f"tension_{cable}_proximal_n"] - log[f"tension_{cable}_distal_n"]
        ).max()
        for cable in log.cables
    )


LATE_TENSION = cc_mujoco.Metric(
    "late_tension", "N", "largest loss of tension along a cable", late_tension
)


if __name__ == "__main__":
    friction = [0.05, 0.1, 0.15, 0.2]
    plants = [cc_mujoco.Plant("wrist", {"friction": each}) for each in friction]
    logs = cc_mujoco.simulate(
        plants, trajectory="sine:0.3", task="spring", duration=1.5
    )
    effort = cc_mujoco.METRICS["rms_motor_torque"]
    late = [LATE_TENSION.compute(log) for log in logs]
    efforts = [100.0 * effort.compute(log) for log in logs]
    print("late_tension [N]", *(f"{value:.1f}" for value in late))
    plt.plot(friction, late, label="late_tension [N]")
    plt.plot(friction, efforts, label="rms_motor_torque [0.01 N m]")
    plt.xlabel("friction")
    plt.ylabel("value")
    plt.legend()
    plt.savefig("own_metric.png")
