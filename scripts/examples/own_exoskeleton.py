"""An exoskeleton of your own from an MJCF file, and what only you know of it.

python own_exoskeleton.py
"""

from pathlib import Path

import cc_mujoco

SCENE = Path(__file__).with_name("knee_exo.xml")
KNOWN = {
    "rope": {"strength": 3000.0, "diameter": 2e-3},  # N, m
    "axis": {"safe_torque": 20.0},  # N m
}
"""Facts that no scene states; `knee_exo.device.toml` takes the same keys."""


def run():
    """Hold a torque at a moving knee, without and with a model of friction."""
    device = cc_mujoco.Device.from_mjcf(SCENE, **KNOWN)
    curves = {}
    for name in ("none", "predictive"):
        log = cc_mujoco.simulate(
            device, name, motion="sine:0.4", task="hold:6", duration=2.0
        )
        curves[name] = (log["time_s"], log["joint_torque_nm"])
    curves["desired"] = (log["time_s"], log["desired_torque_nm"])
    return "time [s]", "torque at the knee [N m]", curves


if __name__ == "__main__":
    found = run()[2]
    _, desired = found.pop("desired")
    for name, (_, torque) in found.items():
        print(f"{name}: {((torque - desired) ** 2).mean() ** 0.5:.2f} N m RMS error")
