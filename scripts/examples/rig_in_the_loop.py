"""A rig in the loop: limits and watchdog around a controller, the rig simulated.

python rig_in_the_loop.py

Replace `SimulatedRig` by a class that talks to your motor, and leave the clock out.
Read the page of `cc_mujoco.hardware` first.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import cc_mujoco
from cc_mujoco import hardware

PERIOD = 0.002


class SimulatedRig:
    """A motor on a spring behind dry friction, a joint that follows it, and a clock."""

    def __init__(self, ratio):
        self.ratio = ratio
        self.time = self.angle = self.speed = self.torque = 0.0
        self.noise = np.random.default_rng(0).normal

    def now(self):
        return self.time

    def wait(self, deadline):
        """Simulate until the deadline [s]."""
        self.time = deadline

    def read(self):
        """Return the newest reading."""
        rub = 0.05 * np.tanh(20.0 * self.speed)
        push = self.torque - rub - 3.0 * self.angle - 0.05 * self.speed
        self.speed += PERIOD * push / 0.01
        self.angle += PERIOD * self.speed
        joint = self.angle / self.ratio, self.speed / self.ratio
        torque = 3.0 * self.ratio * self.angle + self.noise(0.0, 1e-3)
        return hardware.Readings(self.time, self.angle, self.speed, *joint, torque)

    def write(self, torque):
        """Set the motor's torque [N m]."""
        self.torque = torque

    def close(self):
        """Set the motor's torque to 0."""
        self.torque = 0.0


class Rows(list):
    """A log in memory; `cc_mujoco.hardware.RunLog` writes files."""

    def row(self, axes, late, work, cycle):
        """Keep the measurements and desired torques of a cycle, as tuples."""
        seen, desired = axes[0].seen, axes[0].desired
        if np.isfinite(desired):
            self.append((seen.time, seen.joint_torque, desired))


drive = hardware.drive_of("bench", Path(), PERIOD, 2.0)
rig, log = SimulatedRig(drive.ratio), Rows()
limits = hardware.Limits(2.0, 200.0, 60.0, (-1.0, 1.0))
times, torques = np.array([0.0, 1.0, 3.0]), np.array([0.0, 0.3, -0.3])
desired = hardware.TorqueTable(times, torques)
axis = hardware.DrivenAxis(rig, drive, desired, limits, hardware.Watchdog())
law = cc_mujoco.controller("pi", drive)
outcome = hardware.Loop([axis], law, clock=rig, log=log).run(3.0)
print(outcome.sentence)

time, measured, wanted = np.array(log).T
plt.plot(time, measured, label="at the joint")
plt.plot(time, wanted, label="desired")
plt.xlabel("time [s]")
plt.ylabel("torque [N m]")
plt.legend()
plt.savefig("rig_in_the_loop.png")
