"""A search: little torque error with little motor torque, and no slack.

pip install 'cc_mujoco[search]'
python search.py
"""

import cc_mujoco


def run():
    """Return what 24 designs reach, and the limit."""
    table = cc_mujoco.optimise(
        "wrist",
        {"pretension": "2:40:log", "friction": "0.03:0.2"},
        objectives=["rms_motor_torque", "rms_torque_error"],
        subject_to=["slack_margin>=1"],
        evaluations=24,
        trajectory="sine:0.3",
        duration=1.0,
    )
    rows = table.to_pylist()
    kept = [row for row in rows if (row["slack_margin"] or 0.0) >= 1.0]
    lost = [row for row in rows if row not in kept and row["rms_torque_error"]]
    curves = {
        name: (
            [row["rms_motor_torque"] for row in group],
            [row["rms_torque_error"] for row in group],
        )
        for name, group in (("o keeps the limit", kept), ("x goes slack", lost))
    }
    return "motor torque [N m RMS]", "torque error [N m RMS]", curves


if __name__ == "__main__":
    efforts, errors = run()[2]["o keeps the limit"]
    best = errors.index(min(errors))
    print(f"best: {errors[best]:.3f} N m error with {efforts[best]:.3f} N m of torque")
