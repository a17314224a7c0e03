"""A metric of your own: a number of an episode's log.

python own_metric.py
cc-mujoco play wrist --metric own_metric:LATE_TENSION
"""

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


def run():
    """Return it beside a metric of the package, over friction."""
    friction = [0.05, 0.1, 0.15, 0.2]
    plants = [cc_mujoco.Plant("wrist", {"friction": each}) for each in friction]
    logs = cc_mujoco.simulate(
        plants, "pi", motion="sine:0.3", task="spring", duration=1.5
    )
    drag = cc_mujoco.METRICS["rms_motor_torque"]
    curves = {
        "late_tension [N]": (friction, [LATE_TENSION.compute(log) for log in logs]),
        "rms_motor_torque [0.01 N m]": (
            friction,
            [100.0 * drag.compute(log) for log in logs],
        ),
    }
    return "friction", "value", curves


if __name__ == "__main__":
    for name, (_, values) in run()[2].items():
        print(name, *(f"{value:.1f}" for value in values))
