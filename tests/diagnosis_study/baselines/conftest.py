"""Rigs whose only fault is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from baselines.signals import Signals, observed
from cc_mujoco.diagnosis import BaselineFit, CrossValidation, Problem, Record, fit
from cc_mujoco.diagnosis._rig.simulation import SimulatedRig, baseline_parameters
from diagnosis.recorded import BENCH, motions

DT = 0.004
RADIUS = 0.05
NOISE = 0.02

Array = np.ndarray


class Motion:
    """Angles of strokes and rests, and torques that have friction, over 16 s."""

    time = DT * np.arange(4_000)
    motor = 1.5 * np.sin(0.9 * time) + 0.4 * np.sin(5.3 * time + 1.0)
    motor *= np.clip(np.abs(np.mod(time, 8.0) - 4.0) - 0.6, 0.0, 1.0)
    joint = 0.9 * np.sin(1.7 * time + 0.4) + 0.3 * np.sin(7.9 * time)
    load = 2.0 * np.sin(0.37 * time) + 1.5 * np.sin(2.9 * time + 2.0)
    speed = RADIUS * np.gradient(motor, DT)
    torque = np.array([load + 0.3 * np.tanh(speed / 1e-3), load])


def record(motor: Array, joint: Array, measured: Array, run_in: int = 25) -> Record:
    """Return a record of these signals; its first samples do not count."""
    time = DT * np.arange(motor.size)
    counts = np.arange(motor.size) >= run_in
    return Record(
        trial="one",
        dt=DT,
        step=DT,
        time=time,
        motor_angle=motor,
        joint_angle=joint,
        read=np.array([motor, joint]),
        measured=measured,
        band=25.0,
        counts=counts,
        pretension=None,
        start=0.0,
        split=None,
        group="one",
    )


@pytest.fixture(scope="session")
def faulty() -> Callable[[Array | float, Array | float], Signals]:
    """Signals whose residual of motor and joint is this plus noise [N m]."""

    def made(motor: Array | float = 0.0, joint: Array | float = 0.0) -> Signals:
        torque = Motion.torque
        measured = torque + NOISE * np.random.default_rng(0).standard_normal(
            torque.shape
        )
        measured[0] += motor
        measured[1] += joint
        seen = record(Motion.motor, Motion.joint, measured)
        return observed(seen, torque, np.full(torque.shape, NOISE), RADIUS)

    return made


@pytest.fixture(scope="session")
def motion() -> type[Motion]:
    """Return the class `Motion` of `faulty`."""
    return Motion


@pytest.fixture
def there_and_back() -> Signals:
    """1 s forwards at 1 rad/s, 0.8 s of rest, 1 s back, then forwards at once."""
    speed = np.repeat([1.0, 0.0, -1.0, 1.0], [250, 200, 250, 250])
    motor = DT * np.cumsum(speed)
    torque = np.zeros((2, motor.size))
    return observed(record(motor, motor, torque), torque, torque + 1.0, RADIUS)


@pytest.fixture(scope="session")
def baseline_fit() -> Callable[..., BaselineFit]:
    """Return a function that tunes the baseline to a trial with hidden effects."""
    return _tuning


def _tuning(hidden: dict[str, dict[str, float]]) -> BaselineFit:
    motor, joint = (angle - angle[0] for angle in motions(4.0, 0)[2])
    blank = record(motor, joint, np.zeros((2, motor.size)), run_in=100)
    plant = SimulatedRig(BENCH, (blank,), 4)
    values = {
        name: value
        for parameters in hidden.values()
        for name, value in parameters.items()
    }
    measured = plant.simulate(values, tuple(hidden))[0]
    measured += NOISE * np.random.default_rng(1).standard_normal(measured.shape)
    seen = record(motor, joint, measured, run_in=100)
    floor = (np.full(measured.shape, NOISE),)
    free = baseline_parameters(BENCH, (seen,), {})
    problem = Problem(plant.limited([seen]), free, (), floor, floor)
    found = fit(problem, np.zeros(len(free)), [seen.counts])
    return BaselineFit(problem, found, CrossValidation(problem, (found,), ()), 0.0)
