"""An effect of your own, which competes with those of the library in a diagnosis.

python own_effect.py
cc-mujoco diagnose bench DATA --effects own_effect.py:JointDrag --out DIR
"""

import matplotlib.pyplot as plt
import mujoco
import numpy as np

from cc_mujoco.diagnosis import Signals, Size, add_torque_part


class JointDrag:
    """Viscous drag on the joint."""

    needs = "joint speeds over a decade"
    confused_with = ("viscous_friction", "joint_inertia")

    def parameters(self):
        """Return the parameters to be fitted; the effect is off at 0."""
        return [Size("joint_drag", "N m s/rad", typical=0.05, low=0.0)]

    def signals(self, signals, values):
        """Return the simulated signals with the effect's torque added."""
        return signals.added(joint=-values["joint_drag"] * signals.joint_speed)

    def edit_spec(self, spec, bench, values):
        """Add the effect to the repaired scene's `MjSpec`."""
        spec.joint(bench.joint).damping[0] += values["joint_drag"]
        spec.add_sensor(
            name="joint_speed",
            type=mujoco.mjtSensor.mjSENS_JOINTVEL,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=bench.joint,
        )
        add_torque_part(spec, "joint_torque_nm", "joint_speed", -values["joint_drag"])


if __name__ == "__main__":
    time = np.arange(0.0, 4.0, 0.002)
    angle = 0.5 * np.sin(2.0 * np.pi * 0.2 * time**1.5)
    plain = Signals(0.002, time, angle, angle, 2.0 * angle, 2.0 * angle)
    dragged = JointDrag().signals(plain, {"joint_drag": 0.3})
    drag = np.abs(dragged.joint - plain.joint).max()
    print(f"the drag takes up to {drag:.2f} N m")
    plt.plot(time, plain.joint, label="without")
    plt.plot(time, dragged.joint, label="with the drag")
    plt.xlabel("time [s]")
    plt.ylabel("torque at the joint [N m]")
    plt.legend()
    plt.savefig("own_effect.png")
