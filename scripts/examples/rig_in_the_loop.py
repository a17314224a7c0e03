"""A rig in the loop: limits and watchdog around a controller, the rig simulated.

python rig_in_the_loop.py

Replace `SimulatedRig` by a class that talks to your motor, and `SimulatedClock` by
`cc_mujoco.hardware.SystemClock`. Read the page of `cc_mujoco.hardware` first.
"""

from pathlib import Path

import numpy as np

import cc_mujoco
from cc_mujoco.hardware import (
    DrivenAxis,
    Limits,
    Loop,
    Readings,
    TorqueTable,
    Watchdog,
    drive_of,
)

PERIOD = 0.002


class SimulatedClock:
    """Time that passes only while the loop waits."""

    time = 0.0

    def now(self):
        """Return the time [s]."""
        return self.time

    def wait(self, deadline):
        """Let it pass."""
        self.time = deadline


class SimulatedRig:
    """A motor on a spring behind dry friction, with a joint that follows it."""

    def __init__(self, clock, ratio):
        self.clock, self.ratio = clock, ratio
        self.angle = self.speed = self.torque = 0.0
        self.noise = np.random.default_rng(0).normal

    def read(self):
        """Return the newest reading."""
        rub = 0.05 * np.tanh(20.0 * self.speed)
        push = self.torque - rub - 3.0 * self.angle - 0.05 * self.speed
        self.speed += PERIOD * push / 0.01
        self.angle += PERIOD * self.speed
        turned, turning = self.angle / self.ratio, self.speed / self.ratio
        felt = 3.0 * self.ratio * self.angle + self.noise(0.0, 1e-3)
        return Readings(self.clock.now(), self.angle, self.speed, turned, turning, felt)

    def write(self, torque):
        """Take a command."""
        self.torque = torque

    def close(self):
        """Give no torque."""
        self.torque = 0.0


class Rows(list):
    """A log in memory; `cc_mujoco.hardware.RunLog` writes files."""

    def row(self, axes, late, work, cycle):
        """Keep what was measured and desired, until the run ends."""
        seen, desired = axes[0].seen, axes[0].desired
        if np.isfinite(desired):
            self.append((seen.time, seen.joint_torque, desired))


def run():
    """Return the torque at the joint over time, and why the run ended."""
    drive = drive_of("bench", Path(), PERIOD, 2.0)
    clock, log = SimulatedClock(), Rows()
    rig = SimulatedRig(clock, drive.ratio)
    limits = Limits(2.0, 200.0, 60.0, (-1.0, 1.0))
    desired = TorqueTable(np.array([0.0, 1.0, 3.0]), np.array([0.0, 0.3, -0.3]))
    axis = DrivenAxis(rig, drive, desired, limits, Watchdog())
    law = cc_mujoco.controller("pi", drive)
    outcome = Loop([axis], law, clock=clock, log=log).run(3.0)
    time, felt, wanted = np.array(log).T
    curves = {"at the joint": (time, felt), "desired": (time, wanted)}
    return outcome, ("time [s]", "torque [N m]", curves)


if __name__ == "__main__":
    print(run()[0].sentence)
