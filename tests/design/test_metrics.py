"""Metrics against signals whose numbers are known."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from cc_mujoco.design import study
from cc_mujoco.design._evaluation import CHIRP_TIME, SWING_TIME, ChirpTorque
from cc_mujoco.design._protocol import DEFAULT_METRICS
from cc_mujoco.metrics import METRICS, ArrayLog
from cc_mujoco.metrics._formulas import (
    CHIRP_HIGH,
    CHIRP_LOW,
    SWING_PERIODS,
    held_backlash,
    torque_response,
)

EPISODE = [n for n in DEFAULT_METRICS if METRICS[n].test == "episode"]
Array = NDArray[np.float64]
DT = 1e-3


def _answer(desired: Array, actual: Array) -> ArrayLog:
    time = np.arange(desired.size) * DT
    return ArrayLog(
        {"time_s": time, "desired_torque_nm": desired, "joint_torque_nm": actual}
    )


def bandwidth(desired: Array, actual: Array) -> float:
    return METRICS["bandwidth"].compute(_answer(desired, actual))


def _chirp(bias: float = 0.0) -> Array:
    phase = np.arange(0.0, CHIRP_TIME + DT / 2, DT) / CHIRP_TIME
    return np.asarray(ChirpTorque(1.0, bias).torque(0.0 * phase, 0.0 * phase, phase))


@pytest.mark.parametrize("corner", [5.0, 15.0, 30.0])
def test_bandwidth_of_a_first_order_lag_is_its_corner(corner: float) -> None:
    share = 1.0 - math.exp(-2.0 * math.pi * corner * DT)
    desired = _chirp(bias=1.25)
    actual = lfilter([share], [1.0, share - 1.0], desired)
    # The lag has lost some already at the lowest band, which is the reference.
    assert bandwidth(desired, actual) == pytest.approx(corner, rel=0.15)
    assert bandwidth(desired, 0.1 * actual) == pytest.approx(corner, rel=0.15)


def test_response_is_what_arrives_at_each_frequency() -> None:
    desired = _chirp()
    log = _answer(desired, 0.3 * desired)
    centre, gain = torque_response(log)
    assert gain == pytest.approx(np.full(gain.size, 0.3))
    assert centre[0] == pytest.approx(CHIRP_LOW * math.sqrt(2.0))
    assert np.all(np.diff(centre) > 0.0) and centre[-1] < CHIRP_HIGH
    assert METRICS["response"].compute(log) == gain[0]
    assert METRICS["bandwidth"].compute(log) == CHIRP_HIGH


def test_bandwidth_ends_at_the_chirp_and_begins_at_nothing() -> None:
    desired = _chirp()
    assert bandwidth(desired, desired) == CHIRP_HIGH
    assert bandwidth(desired, 0.01 * desired) == 0.0
    assert bandwidth(desired, 0.0 * desired) == 0.0


@pytest.mark.parametrize("bias", [0.0, 3.0])
def test_backlash_is_the_play_of_a_gear(bias: float) -> None:
    width, stiffness = 0.02, 50.0
    phase = np.arange(0.0, SWING_PERIODS * SWING_TIME + DT / 2, DT) / (
        SWING_PERIODS * SWING_TIME
    )
    twist = 0.1 * np.sin(2.0 * math.pi * SWING_PERIODS * phase)
    # Play: the output follows the input when it is half the width away from it.
    output, found = 0.0, np.empty_like(twist)
    for i, angle in enumerate(twist):
        output = min(max(output, angle - width / 2), angle + width / 2)
        found[i] = output
    torque = stiffness * found + bias
    log = ArrayLog(
        {
            "time_s": phase,
            "motor_angle_rad": 2.0 * twist,
            "joint_angle_rad": 0.0 * twist,
            "joint_torque_nm": torque,
            "desired_torque_nm": stiffness * twist,
        },
        metadata={"ratio": 0.5},
    )
    assert held_backlash(log) == pytest.approx(width, rel=0.01)
    columns = {**log.columns, "joint_torque_nm": 1e-3 * torque}
    stuck = ArrayLog(columns, metadata=log.metadata)
    assert math.isnan(held_backlash(stuck))


def test_numbers_of_an_episode() -> None:
    time = np.arange(0.0, 1.0 + DT / 2, DT)
    tension = np.where(time < 0.25, 0.0, 10.0 + 5.0 * time)
    log = ArrayLog(
        {
            "time_s": time,
            "motor_torque_nm": -2.0 * np.ones_like(time),
            "motor_velocity_rad_s": -3.0 * time,
            "joint_torque_nm": np.ones_like(time),
            "joint_velocity_rad_s": np.full_like(time, 0.5),
            "wearer_torque_nm": -4.0 + 8.0 * time,
            "desired_torque_nm": np.zeros_like(time),
            "dissipated_a_j": 6.0 * time,
            "tension_a_proximal_n": 2.0 * tension,
            "tension_a_distal_n": tension,
            "tension_a_nodes_n": np.stack([2.0 * tension, tension], axis=-1),
        },
        ("a",),
        {"strength": {"a": 100.0}},
    )
    found = {name: METRICS[name].compute(log) for name in EPISODE}
    assert math.isnan(found["efficiency"])
    assert found["rms_torque_error"] == pytest.approx(1.0)
    assert found["peak_motor_torque"] == 2.0
    assert found["peak_motor_power"] == pytest.approx(6.0)
    assert found["peak_wearer_torque"] == pytest.approx(4.0)
    assert found["wearer_power"] == pytest.approx(0.5, rel=0.01)
    assert found["peak_torque_rate"] == 0.0
    assert found["slack_margin"] == 0.0
    assert found["slack_share"] == pytest.approx(0.25, abs=2e-3)
    assert found["peak_tension"] == pytest.approx(30.0)
    assert found["strength_used"] == pytest.approx(0.3)


def test_efficiency_of_a_driven_joint_falls_as_friction_rises() -> None:
    friction = [0.01, 0.1, 0.6]
    about: Any = {"duration": 1.5, "metrics": ("efficiency",), "threads": 1}
    found = study("ankle", {"friction": friction}, controllers=["pi"], **about)
    values = found["efficiency"].to_pylist()
    assert values == sorted(values, reverse=True)
    assert 0.0 < values[-1] < 0.1 < 0.5 < values[0] < 1.0


def test_efficiency_is_no_credit_for_friction_that_swallows_the_task() -> None:
    about: Any = {"duration": 1.5, "metrics": ("efficiency",), "threads": 1}
    found = study("wrist", {"friction": [0.1, 0.6]}, task="tunnel", **about)
    low, high = (value or 0.0 for value in found["efficiency"].to_pylist())
    assert high <= low < 1e-3
    found = study("wrist", {"friction": [0.1, 0.6]}, task="transparent", **about)
    assert found["efficiency"].to_pylist() == [None, None]
