"""Virtual environments."""

from __future__ import annotations

import doctest
import importlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cc_mujoco.errors import CableError
from cc_mujoco.human import TASKS, Assist, Spring, Tunnel, task


def printed_tunnel(angle: float) -> float:
    """Equation 2.29 as printed in the thesis."""
    if angle < -0.05:
        return min(-0.5 * (angle + 0.05), 0.2)
    if angle > 0.05:
        return max(-0.5 * (angle - 0.05), -0.2)
    return 0.0


@pytest.mark.parametrize(
    ("angle", "torque"),
    [
        (0.0, 0.0),
        (0.05, 0.0),
        (-0.05, 0.0),
        (0.25, -0.1),
        (-0.25, 0.1),
        (np.deg2rad(20), -0.1495),
        (0.45, -0.2),
        (-0.45, 0.2),
        (3.0, -0.2),
        (-3.0, 0.2),
    ],
)
def test_tunnel_values(angle: float, torque: float) -> None:
    assert TASKS["tunnel"].torque(angle, 0.0, 0.0) == pytest.approx(torque, abs=4e-5)


@given(st.floats(-5, 5))
def test_tunnel_is_the_printed_equation(angle: float) -> None:
    torque = TASKS["tunnel"].torque(angle, 0.0, 0.0)
    assert torque == pytest.approx(printed_tunnel(angle), abs=1e-15)


def test_swing_helps_around_toe_off_and_hold_always() -> None:
    phase = np.linspace(0.0, 1.0, 1001)
    still = np.zeros(1001)
    torque = TASKS["swing"].torque(still, still, phase)
    assert torque.max() == pytest.approx(10.0)
    assert phase[torque.argmax()] == pytest.approx(0.58)
    assert np.all(torque[np.abs(phase - 0.58) > 0.1801] == 0.0)
    assert np.all(torque[np.abs(phase - 0.58) < 0.1799] > 0.0)
    assert np.all(TASKS["hold"].torque(still, still, phase) == -0.15)


def test_spring_transparent_assist() -> None:
    assert TASKS["spring"].torque(0.3, 1.0, 0.0) == -0.3
    assert Spring(stiffness=2.5).torque(-0.2, 0.0, 0.0) == 0.5
    assert TASKS["transparent"].torque(-0.3, 5.0, 0.5) == 0.0
    phase = np.linspace(0, 1, 1001)
    torque = Assist(peak=40.0).torque(np.zeros(1001), np.zeros(1001), phase)
    assert torque.min() == pytest.approx(-40.0, rel=1e-4)
    assert torque.max() <= 0
    assert 0.5 < phase[torque.argmin()] < 0.55


columns = arrays(np.float64, (3, 17), elements=st.floats(-4, 4))


@pytest.mark.parametrize("name", sorted(TASKS))
@given(values=columns)
def test_scalars_and_arrays_give_the_same_bits(
    name: str, values: np.ndarray[tuple[int, int], np.dtype[np.float64]]
) -> None:
    angle, velocity, phase = values[0], values[1], values[2] % 1.0
    together = TASKS[name].torque(angle, velocity, phase)
    assert together.shape == angle.shape and together.dtype == np.float64
    one_by_one = np.array(
        [
            TASKS[name].torque(*row)
            for row in zip(*(v.tolist() for v in (angle, velocity, phase)), strict=True)
        ]
    )
    assert together.tobytes() == one_by_one.tobytes()


def test_registry_and_errors() -> None:
    assert list(TASKS) == ["tunnel", "spring", "transparent", "assist", "swing", "hold"]
    assert task("assist") is TASKS["assist"]
    with pytest.raises(CableError, match="unknown task 'tunel': did you mean 'tunnel'"):
        task("tunel")
    with pytest.raises(CableError, match=r"^Tunnel.limit must be a number in \[0, "):
        Tunnel(limit=-0.1)
    with pytest.raises(CableError, match=r"^Assist.peak must be a number"):
        Assist(peak=float("nan"))


@pytest.mark.parametrize("name", ["gait", "motion", "tasks", "trajectories", "wearer"])
def test_examples_in_the_documentation(name: str) -> None:
    result = doctest.testmod(importlib.import_module(f"cc_mujoco.human._{name}"))
    assert result.attempted > 0 and result.failed == 0
