"""A torque sensor that is dead or reversed ends a run, and one that works does not."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from driven import Bench, Lockstep, Swing

from cc_mujoco.control import CONTROLLERS, controller
from cc_mujoco.hardware import (
    DrivenAxis,
    Limits,
    Loop,
    Readings,
    RunOutcome,
    TorqueTable,
    Watchdog,
    drive_of,
)
from cc_mujoco.hardware._watchdog import TorqueSensor
from hardware.fakes import Rows
from rig import make_rig

PERIOD = 0.002
LIMITS = Limits(4.0, 200.0, 300.0, (-1.5, 1.5), soft_start=0.1)
Fault = Callable[[Readings], Readings]
NONE: Fault = lambda seen: seen  # noqa: E731
FAULTS: dict[str, tuple[Fault, str]] = {
    "dead": (
        lambda seen: seen._replace(joint_torque=0.25),
        "the torque sensor is dead: ",
    ),
    "reversed": (
        lambda seen: seen._replace(joint_torque=-seen.joint_torque),
        "the torque sensor is reversed: it falls where",
    ),
}
TIMES = np.arange(0.0, 10.0, 0.01)
MOTIONS: dict[str, tuple[TorqueTable, Swing]] = {
    "hand swings": (
        TorqueTable(TIMES, 0.5 + 0.0 * TIMES),
        lambda t: (0.3 * math.sin(4.0 * t), 1.2 * math.cos(4.0 * t)),
    ),
    "hand holds": (
        TorqueTable(TIMES, 1.5 * np.sin(5.0 * TIMES)),
        lambda _: (0.0, 0.0),
    ),
    "hand yields to a virtual damper": (
        TorqueTable(TIMES, -0.8 * np.cos(4.0 * TIMES)),
        lambda t: (0.3 * math.sin(4.0 * t), 1.2 * math.cos(4.0 * t)),
    ),
}


class Faulty(Lockstep):
    """A rig in lockstep whose readings have a fault."""

    def __init__(self, bench: Bench, swing: Swing, fault: Fault, seed: int) -> None:
        super().__init__(bench, seed, swing)
        self._fault = fault

    def read(self) -> Readings | None:
        found = super().read()
        return found and self._fault(found)


def played(law: str, motion: str, fault: Fault = NONE, seed: int = 1) -> RunOutcome:
    desired, swing = MOTIONS[motion]
    rig = Faulty(Bench(make_rig(seed, make="guides"), {}, PERIOD), swing, fault, seed)
    drive = drive_of("bench", Path(), PERIOD, LIMITS.torque)
    axis = DrivenAxis(rig, drive, desired, LIMITS, Watchdog(twist=10.0))
    loop = Loop([axis], controller(law, drive), clock=rig, log=Rows())
    return loop.run(3.0)


SOME = [("pi", "hand swings")]
"""Pairs of controller and motion that run each time; the study runs all."""
LAWS = [name for name in CONTROLLERS if name not in ("adaptive", "fused")]
"""Without those that need tension sensors, which such a rig has not."""
ALL = [
    pytest.param(*each, marks=[] if each in SOME else pytest.mark.study)
    for each in itertools.product(LAWS, MOTIONS)
]


@pytest.mark.parametrize(
    ("name", "law", "motion"),
    [
        ("dead", "pi", "hand swings"),
        ("dead", "none", "hand holds"),
        ("reversed", "pi", "hand swings"),
    ],
)
def test_a_faulty_torque_sensor_ends_the_run(name: str, law: str, motion: str) -> None:
    fault, why = FAULTS[name]
    outcome = played(law, motion, fault)
    assert why in outcome.sentence
    assert outcome.code == 3


@pytest.mark.parametrize(("law", "motion"), ALL)
def test_one_that_works_does_not(law: str, motion: str) -> None:
    for seed in (1,) if (law, motion) in SOME else (1, 2, 3):
        assert played(law, motion, seed=seed).code == 0


DEVICES_AND_LAWS = [
    pytest.param(*each, marks=[] if each == ("wrist", "pi") else pytest.mark.study)
    for each in itertools.product(("wrist", "ankle", "finger"), LAWS)
]


@pytest.mark.parametrize(("device", "law"), DEVICES_AND_LAWS)
def test_that_of_a_device_in_its_motion_works(device: str, law: str) -> None:
    env = gymnasium.make("cc_mujoco/Device-v1", device=device, disable_env_checker=True)
    inner = env.unwrapped
    drive = inner.drive  # type: ignore[attr-defined]
    own = controller(law, drive)
    swing = Watchdog.frozen_torque * drive.high * abs(drive.ratio)
    sensor = TorqueSensor(drive, Watchdog.frozen_readings, swing)
    _, seen = env.reset(seed=1)
    for _ in range(1500 if (device, law) == ("wrist", "pi") else 4000):
        why = sensor.reading(
            float(seen["motor_angle_rad"]),
            float(seen["winding_angle_rad"]),
            float(seen["joint_torque_nm"]) / float(seen["leverage_ratio"]),
        )
        assert why is None
        _, _, over, late, seen = env.step(inner.action(own.torque(seen)))  # type: ignore[attr-defined]
        if over or late:
            break
    env.close()
