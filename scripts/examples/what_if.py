"""A what-if: how many loops may the conduit make, and how good is its liner?

python what_if.py
"""

import cc_mujoco

FRICTION = [0.05, 0.1, 0.2]


def run():
    """Return the torque error over friction, for one to three loops."""
    table = cc_mujoco.study(
        "wrist",
        {"friction": FRICTION, "loops": [1, 2, 3]},
        trajectory="sine:0.3",
        duration=1.0,
        metrics=["rms_torque_error", "slack_margin"],
    )
    curves = {}
    for loops in (1, 2, 3):
        rows = [row for row in table.to_pylist() if row["loops"] == loops]
        rows.sort(key=lambda row: row["friction"])
        curves[f"{loops} loops"] = (
            [row["friction"] for row in rows],
            [row["rms_torque_error"] for row in rows],
        )
    return "friction", "torque error [N m RMS]", curves


if __name__ == "__main__":
    for name, (_, errors) in run()[2].items():
        print(name, *(f"{error:.3f}" for error in errors))
