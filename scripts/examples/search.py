"""A search: little torque error with little motor torque, and no slack.

pip install 'cc_mujoco[search]'
python search.py
"""

import matplotlib.pyplot as plt

import cc_mujoco

table = cc_mujoco.optimise(
    "wrist",
    {"pretension": "2:40:log", "friction": "0.03:0.2"},
    objectives=["rms_motor_torque", "rms_torque_error"],
    subject_to=["slack_margin>=1"],
    evaluations=24,
    trajectory="sine:0.3",
    duration=1.0,
)
tried = [row for row in table.to_pylist() if row["rms_torque_error"] is not None]
kept = [row for row in tried if row["slack_margin"] >= 1.0]
lost = [row for row in tried if row["slack_margin"] < 1.0]
best = min(kept, key=lambda row: row["rms_torque_error"])
print(
    f"best: {best['rms_torque_error']:.3f} N m error with "
    f"{best['rms_motor_torque']:.3f} N m of torque"
)

for name, mark, group in (("keeps the limit", "o", kept), ("goes slack", "x", lost)):
    efforts = [row["rms_motor_torque"] for row in group]
    errors = [row["rms_torque_error"] for row in group]
    plt.plot(efforts, errors, mark, label=name)
plt.xlabel("motor torque [N m RMS]")
plt.ylabel("torque error [N m RMS]")
plt.legend()
plt.savefig("search.png")
