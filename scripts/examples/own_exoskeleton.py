"""An exoskeleton of your own from an MJCF file, and what only you know of it.

python own_exoskeleton.py
"""

from pathlib import Path

import matplotlib.pyplot as plt

import cc_mujoco

SCENE = Path(__file__).with_name("knee_exo.xml")
KNOWN = {
    "rope": {"strength": 3000.0, "diameter": 2e-3},  # N, m
    "axis": {"safe_torque": 20.0},  # N m
}
"""Facts that no scene states; `knee_exo.device.toml` takes the same keys."""

device = cc_mujoco.Device.from_mjcf(SCENE, **KNOWN)
for name in ("none", "pi_tuned", "predictive"):
    log = cc_mujoco.simulate(
        device, name, trajectory="sine:0.4", task="hold:6", duration=2.0
    )
    torque, desired = log["joint_torque_nm"], log["desired_torque_nm"]
    print(f"{name}: {((torque - desired) ** 2).mean() ** 0.5:.2f} N m RMS error")
    plt.plot(log["time_s"], torque, label=name)
plt.plot(log["time_s"], desired, label="desired")
plt.xlabel("time [s]")
plt.ylabel("torque at the knee [N m]")
plt.legend()
plt.savefig("own_exoskeleton.png")
