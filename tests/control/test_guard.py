"""The guard: a joint that is pulled far beyond what is planned is let go."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.control import (
    CONTROLLERS,
    Controller,
    Drive,
    PredictiveCompensation,
    controller,
    laws,
    planning,
)
from cc_mujoco.control.guard import UNLIMITED, released
from cc_mujoco.episode import TOO_LONG, unsafe_from
from cc_mujoco.errors import CableError
from cc_mujoco.sensing import MEASURED, TENSIONS, Sensors
from control.devices import pull_pull, single

SAFE = 8.0
GUARDED = "fused", "model", "stiction", "disturbance", "predictive", "adaptive"

torques = st.floats(-50.0, 50.0)


@given(measured=torques, planned=torques, safe=st.floats(0.1, 40.0))
def test_a_joint_is_let_go_before_it_is_unsafe_and_not_where_it_is_as_planned(
    measured: float, planned: float, safe: float
) -> None:
    for before in (0.0, 1.0):
        found = released(before, measured, planned, safe)
        if abs(measured) > safe:
            assert found == 1.0
        elif abs(measured) <= planned * np.sign(measured):
            assert found == 0.0
        assert found == released(before, -measured, -planned, safe)
    # What lets go keeps on until much less is left.
    assert released(1.0, measured, planned, safe) >= released(
        0.0, measured, planned, safe
    )


@given(measured=torques, planned=torques)
def test_without_a_safe_torque_there_is_no_guard(
    measured: float, planned: float
) -> None:
    assert released(0.0, measured, planned, UNLIMITED) == 0.0
    assert released(0.0, np.nan, planned, 1.0) == 0.0


def drive(pair: bool, safe: float) -> Drive:
    plain = pull_pull() if pair else single()
    nodes = Sensors((2, 5, 8), (0.1,) * 3)
    return dataclasses.replace(
        plain,
        safe_torque=safe,
        inertia=1e-3,
        sensors=(nodes,) * len(plain.cables),
    )


def seen(law: Controller, torque: float) -> dict[str, Any]:
    told: dict[str, Any] = dict.fromkeys(MEASURED, 0.0)
    told |= {"joint_torque_nm": torque, "desired_torque_nm": 1.0}
    told[TENSIONS] = np.full((len(law.drive.cables), 3), 12.0)
    return told


@pytest.mark.parametrize("pair", [True, False])
@pytest.mark.parametrize("name", [name for name in GUARDED if name != "fused"])
def test_every_controller_with_a_model_lets_go_of_what_it_should_not_pull(
    name: str, pair: bool
) -> None:
    """A sensor that shows more and more, whatever the motor does about it."""
    for safe in (SAFE, np.inf):
        law: Any = controller(name, drive(pair, safe))
        law.reset()
        torque = 0.0
        for measured in np.linspace(0.0, 1.2 * SAFE, 30):
            torque = law.torque(seen(law, float(measured)))
        if isinstance(law, PredictiveCompensation):
            released_now = law._devices.memory[0, planning.RELEASED] == 1.0
        else:
            # Motor and joint are at rest, so there is nothing to follow.
            released_now = torque == 0.0
        assert released_now == (safe == SAFE) or (not pair and torque == 0.0)


@given(
    torque=st.floats(-20.0, 20.0),
    motor=st.floats(-9.0, 9.0),
    joint=st.floats(-9.0, 9.0),
)
def test_a_motor_that_is_let_go_follows_the_joint(
    torque: float, motor: float, joint: float
) -> None:
    """The law of `fused`; otherwise it is that of `pi`."""
    gains = laws.Gains(ratio=2.0, low=-5.0, high=5.0, safe_torque=SAFE, settling=0.1)
    read = np.array([0.0, motor, joint, torque, 1.0])
    memory, plain = np.zeros(laws.MEMORY), np.zeros(laws.MEMORY)
    found = laws.guarded(gains.packed, 20.0, memory, read)
    usual = laws.proportional_integral(gains.packed, plain, 1.0, torque)
    if released(0.0, torque, 1.0, SAFE) == 0.0:
        assert found == usual
        assert np.array_equal(memory, plain)
    else:
        damped = 0.1 * 20.0 / 2.0**2 * (2.0 * joint - motor)
        assert found == pytest.approx(min(max(damped, -5.0), 5.0), abs=1e-12)
        assert memory[laws.INTEGRAL] == 0.0


def test_the_guarded_are_all_that_have_a_model() -> None:
    made = {name: controller(name, drive(True, SAFE)) for name in CONTROLLERS}
    assert {name for name, law in made.items() if hasattr(law, "model")} == set(GUARDED)


def test_a_safe_torque_is_above_zero() -> None:
    with pytest.raises(CableError, match="safe_torque must be above 0 Nm, not -1"):
        drive(True, -1.0)


@given(
    long=st.integers(1, 40), first=st.integers(0, 50), sign=st.sampled_from([-1.0, 1.0])
)
def test_a_torque_is_unsafe_once_it_was_too_high_for_too_long(
    long: int, first: int, sign: float
) -> None:
    torque = np.zeros(100)
    torque[first : first + long] = sign * 2.0
    period = 1e-3
    found = unsafe_from(torque, 1.0, period)
    assert found == (first if long * period >= TOO_LONG else None)
    assert unsafe_from(torque, 2.0, period) is None
