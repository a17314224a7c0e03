"""The bench with guides as a rig that a host drives: in lockstep, or behind a socket.

    bench = Bench(make_rig(1, make="guides"), {"viscous_friction": 200.0}, 0.002)
    rig = Lockstep(bench, seed=1, swing=lambda time: (0.0, 0.0))
    outcome = play(rig, law, desired, limits, 10.0)
    rig.torques, outcome

Cables in equilibrium at every step, a rotor, a joint with inertia, and a hand that
holds it by a spring and a damper and swings it; encoders and torque sensor with steps
and noise as of the study's logger.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from cc_mujoco import hardware
from cc_mujoco.control import Controller
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray as Array
from rig.dataset import truth_of
from rig.engine import (
    FAR_A,
    FAR_B,
    JOINT,
    JOINT_SPEED,
    MEANS,
    MOTOR,
    MOTOR_SPEED,
    NEAR_A,
    Asked,
    at_rest,
)
from rig.guides import advance, start
from rig.nominal import Rig
from rig.sensors import CHANNELS

STEP = 2e-4  # longest time step of the equations [s]
LEFT_OUT = ("unbalance", "joint_stiffness", "bearing", "catch")
"""Loads on the joint's pulley, which `joint_torque` has not in it."""
HAND = (10.0, 0.3)  # stiffness [N m/rad] and damping [N m s/rad] of the hand


class Instruments:
    """Quantised encoders, velocities from differences, and a noisy torque sensor."""

    def __init__(self, seed: int, period: float) -> None:
        """Begin, with this time between two readings [s]."""
        self._random = np.random.default_rng(seed)
        self._period = period
        self._last: tuple[float, float] | None = None
        self._speeds = [0.0, 0.0]

    def _read(self, name: str, value: float) -> float:
        channel = CHANNELS[name]
        noisy = value + channel.noise * self._random.standard_normal()
        return float(channel.resolution * round(noisy / channel.resolution))

    def readings(
        self, state: Array, torque: float, status: hardware.Status
    ) -> hardware.Readings:
        motor = self._read("motor_angle", state[0])
        joint = self._read("joint_angle", state[2])
        last = self._last or (motor, joint)
        share = -math.expm1(-2.0 * math.pi * 50.0 * self._period)  # a low-pass of 50 Hz
        for k, moved in enumerate((motor - last[0], joint - last[1])):
            self._speeds[k] += share * (moved / self._period - self._speeds[k])
        self._last = motor, joint
        shown = self._read("joint_torque", torque)
        speed, joint_speed = self._speeds
        return hardware.Readings(0.0, motor, speed, joint, joint_speed, shown, status)


class Bench:
    """The rig: motor, cables, joint, and the hand that holds it."""

    def __init__(
        self,
        rig: Rig,
        effects: Mapping[str, float],
        period: float,
        *,
        tightness: float = 1.0,
        hand: tuple[float, float] = HAND,
        motor_lag: float = 0.0,
    ) -> None:
        """Begin at rest; `advance` goes on by `period` [s].

        Effects are amounts by id. The hand has stiffness [N m/rad] and damping [N m
        s/rad]; the motor's torque lags behind its command by the time constant
        `motor_lag` [s].
        """
        truth, plain = truth_of(rig, effects, rig.seed), truth_of(rig, {}, rig.seed)
        self.plant = truth.plant
        if any(getattr(self.plant.bench, name) for name in LEFT_OUT) or (
            truth.chain != plain.chain
        ):
            raise CableError(
                f"this rig cannot hide {', '.join(effects)}: it plays what is in the "
                "cables and at the motor, no load on the joint and no sensor's fault."
            )
        self.period = period
        still = Asked(np.zeros(2), np.zeros(2), np.zeros((1, 2)), np.zeros((1, 2)))
        self._steps = math.ceil(period / STEP - 1e-9)
        run = at_rest(self.plant.bench, rig.pretension * tightness, still, 1)
        self._run = run._replace(dt=period / self._steps)
        self._now = 0.0
        self.cables = start(self.plant, run.pretension, (0.0, 0.0))
        self._hand = hand
        self._lag, self._torque = motor_lag, 0.0

    def advance(self, torque: float, swing: float, rate: float) -> None:
        """Advance a period by motor torque [N m] and the hand's motion [rad, rad/s]."""
        hand = np.array([*self._hand, swing, rate])
        if not self._lag:
            self._advance(torque, hand, self._steps)
            return
        step = self.period / self._steps
        passed = -math.expm1(-step / self._lag)
        for _ in range(self._steps):
            behind = self._torque - torque
            self._advance(torque + behind * passed * self._lag / step, hand, 1)
            self._torque = torque + behind * (1.0 - passed)

    def _advance(self, torque: float, hand: Array, steps: int) -> None:
        advance(self.plant, self.cables, self._run, torque, hand, self._now, steps)
        self._now += steps * self._run.dt

    @property
    def state(self) -> Array:
        """Angle and speed of the motor and of the joint [rad, rad/s]."""
        return self._run.shafts[[MOTOR, MOTOR_SPEED, JOINT, JOINT_SPEED]]

    @property
    def ends(self) -> Array:
        """Tensions of both cables at the motor and at the joint (4,) [N]."""
        return self._run.now[NEAR_A:MEANS]

    @property
    def joint_torque(self) -> float:
        """Torque that the cables put into the joint [N m]."""
        now = self._run.now
        return float(self.plant.bench.joint_radius * (now[FAR_A] - now[FAR_B]))


Swing = Callable[[float], tuple[float, float]]
"""Angle that the hand aims at [rad] and its speed [rad/s], by time [s]."""


class Lockstep:
    """Rig and clock in one: the bench advances while the control loop waits."""

    def __init__(self, bench: Bench, seed: int, swing: Swing) -> None:
        self.bench = bench
        self.torques: list[float] = []
        """True torques of the joint, one number a period from the first on [N m]."""
        self._instruments = Instruments(seed, bench.period)
        self._swing = swing
        self._torque = 0.0
        self._new: hardware.Readings | None = None

    def now(self) -> float:
        return len(self.torques) * self.bench.period

    def wait(self, deadline: float) -> None:
        while self.now() < deadline - 0.5 * self.bench.period:
            self.bench.advance(self._torque, *self._swing(self.now()))
            torque = self.bench.joint_torque
            self.torques.append(torque)
            found = self._instruments.readings(
                self.bench.state, torque, hardware.Status.ENABLED
            )
            self._new = found._replace(time=self.now())

    def read(self) -> hardware.Readings | None:
        found, self._new = self._new, None
        return found

    def write(self, torque: float) -> None:
        self._torque = torque

    def close(self) -> None:
        self._torque = 0.0


class Commands:
    """Log of a run that keeps only the commanded motor torques [N m]."""

    def __init__(self) -> None:
        self.torques: list[float] = []

    def row(self, axes: Sequence[hardware.AxisRow], *_: float) -> None:
        self.torques.append(axes[0].command)


def play(
    rig: Lockstep,
    law: Controller,
    desired: Any,
    limits: hardware.Limits,
    seconds: float,
    log: Any = None,
    watchdog: hardware.Watchdog | None = None,
) -> hardware.RunOutcome:
    """Run a controller on the rig through the loop of `cc-mujoco run`; log its rows."""
    axis = hardware.DrivenAxis(
        rig, law.drive, desired, limits, watchdog or hardware.Watchdog()
    )
    loop = hardware.Loop([axis], law, clock=rig, log=Commands() if log is None else log)
    return loop.run(seconds)


def errors(
    rig: Lockstep, desired: hardware.TorqueTable, seconds: float, settled: float
) -> Array:
    """Return the joint's true torque error [N m] in a task, after `settled` [s]."""
    # The first period passes before the first cycle.
    true = np.array(rig.torques[1 : 1 + round(seconds / rig.bench.period)])
    now = rig.bench.period * np.arange(true.size)
    off = true - np.interp(now, desired.times, desired.torques)
    return np.asarray(off[now > settled])


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
