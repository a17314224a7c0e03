"""A what-if: how many loops may the conduit make, and how good is its liner?

python what_if.py
"""

import matplotlib.pyplot as plt

import cc_mujoco

FRICTION = [0.05, 0.1, 0.2]

table = cc_mujoco.study(
    "wrist",
    {"friction": FRICTION, "loops": [1, 2, 3]},
    trajectory="sine:0.3",
    duration=1.0,
    metrics=["rms_torque_error", "slack_margin"],
)
rows = table.to_pylist()
for loops in (1, 2, 3):
    errors = [
        row["rms_torque_error"]
        for friction in FRICTION
        for row in rows
        if (row["friction"], row["loops"]) == (friction, loops)
    ]
    print(f"{loops} loops:", *(f"{error:.3f}" for error in errors), "N m")
    plt.plot(FRICTION, errors, label=f"{loops} loops")
plt.xlabel("friction")
plt.ylabel("torque error [N m RMS]")
plt.legend()
plt.savefig("what_if.png")
