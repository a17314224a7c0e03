"""Virtual environments."""

from __future__ import annotations

import doctest
import importlib
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cc_mujoco.errors import CableError
from cc_mujoco.human import TASKS, Assist, Hold, Spring, Task, Tunnel, task
from cc_mujoco.human._tasks import task_torque


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
    assert task("impedance:2,damping=0.5").torque(0.3, 1.0, 0.0) == pytest.approx(-1.1)
    assert TASKS["impedance"].about_reference and TASKS["position"].commands_angle
    assert TASKS["position"].torque(-0.3, 5.0, 0.5) == 0.0
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
    torques = ["tunnel", "spring", "transparent", "assist", "swing", "hold"]
    assert list(TASKS) == [*torques, "impedance", "position"]
    assert task("assist") is TASKS["assist"]
    with pytest.raises(CableError, match="unknown task 'tunel': did you mean 'tunnel'"):
        task("tunel")
    with pytest.raises(CableError, match=r"^Tunnel.limit must be a number in \[0, "):
        Tunnel(limit=-0.1)
    with pytest.raises(CableError, match=r"^Assist.peak must be a number"):
        Assist(peak=float("nan"))


@pytest.mark.parametrize(
    "name",
    [
        "by_text",
        "gait",
        "motion",
        "pace",
        "tasks",
        "wearer",
    ],
)
def test_examples_in_the_documentation(name: str) -> None:
    result = doctest.testmod(importlib.import_module(f"cc_mujoco.human._{name}"))
    assert result.attempted > 0 and result.failed == 0


def test_numbers_change_the_parameters() -> None:
    assert task("hold:-12") == Hold(-12.0)
    assert task("spring:2.5") == Spring(2.5)
    assert task("assist:20") == Assist(20.0)
    assert task("tunnel:0.1,limit=2") == Tunnel(0.1, limit=2.0)
    with pytest.raises(CableError, match="'transparent' takes no numbers"):
        task("transparent:1")
    with pytest.raises(CableError, match="unknown task 'hodl': did you mean 'hold'"):
        task("hodl:-12")
    with pytest.raises(CableError, match=r"'spring:-1': Spring\.stiffness must be"):
        task("spring:-1")
    with pytest.raises(CableError, match="must be a name, the path of a table or a Ta"):
        task(3)  # type: ignore[arg-type]


MODULE = """
from cc_mujoco.human import Spring, Task

class Damper(Task):
    def torque(self, angle, velocity, phase):
        return -2.0 * velocity

class Pulse(Task):
    of_phase = True
    def torque(self, angle, velocity, phase):
        return 3.0 * phase

class Broken(Task):
    def torque(self, angle, velocity, phase):
        return angle / 0

class Text(Task):
    def torque(self, angle, velocity, phase):
        return "1"

def stiff():
    return Spring(9.0)

def broken():
    raise KeyError("x")
"""


def test_tasks_of_the_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_tasks.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "my_tasks", raising=False)
    assert task("my_tasks:stiff") == Spring(9.0)
    assert task("my_tasks:Damper").torque(0.0, 2.0, 0.0) == -4.0
    assert not task("my_tasks:Damper").of_phase and task("my_tasks:Pulse").of_phase
    for name in ("Broken", "broken"):
        with pytest.raises(CableError, match=rf"'my_tasks:{name}' raised .* in .*line"):
            task(f"my_tasks:{name}").torque(0.0, 0.0, 0.0)
    with pytest.raises(CableError, match="gave '1' at angles of shape"):
        task_torque(task("my_tasks:Text"), *np.zeros((3, 1)))
    with pytest.raises(CableError, match="there is no module 'my_task'"):
        task("my_task:stiff")


class Answer(Task):
    """Task that gives what it is told to give."""

    def __init__(self, torque: Any) -> None:
        self.answer = torque

    def torque(self, angle: Any, velocity: Any, phase: Any) -> Any:
        return self.answer


def test_one_torque_serves_all_angles() -> None:
    assert np.array_equal(task_torque(Answer(2), *np.zeros((3, 4))), np.full(4, 2.0))


@pytest.mark.parametrize("torque", [[1.0, 2.0], None, "1", [[0.0] * 3]])
def test_what_is_no_torque_is_refused(torque: Any) -> None:
    with pytest.raises(CableError, match=r"task 'Answer' gave .* of shape \(3,\)"):
        task_torque(Answer(torque), *np.zeros((3, 3)))


@pytest.mark.parametrize("missing", [np.nan, np.inf, -np.inf])
def test_a_torque_without_a_number_is_refused_but_of_diverged_rows(
    missing: float,
) -> None:
    angle = np.array([0.1, np.nan, 0.3])
    ran = task_torque(Answer([0.0, missing, 0.0]), angle, 0.0 * angle, np.zeros(3))
    assert not np.isfinite(ran[1])
    with pytest.raises(CableError, match=r"N m at angle 0.3 rad, velocity 0 rad/s"):
        task_torque(Answer([0.0, 0.0, missing]), angle, 0.0 * angle, np.zeros(3))


def profile(folder: Path, text: str, name: str = "torque.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("head", ["phase_percent", "phase [%]", "Phase Percent"])
@pytest.mark.parametrize("column", ["torque_nm", "knee_torque_nm", "knee_nm"])
def test_a_profile_over_the_phase_is_periodic(
    tmp_path: Path, head: str, column: str
) -> None:
    path = profile(tmp_path, f"{head},{column}\n10,1\n50,5\n90,3\n")
    found = task(str(path), ("knee",))
    phase = np.array([0.1, 0.3, 0.5, 0.9, 0.95, 0.0, 0.05])
    np.testing.assert_allclose(
        found.torque(0.0 * phase, 0.0 * phase, phase), [1, 3, 5, 3, 2.5, 2, 1.5]
    )
    assert found.of_phase and not found.of_time
    fraction = profile(tmp_path, f"phase,{column}\n0.1,1\n0.5,5\n0.9,3\n", "b.csv")
    assert task(fraction, ("knee",)) == found


@pytest.mark.parametrize(("clock", "factor"), [("time_s", 1.0), ("time_ms", 1e3)])
def test_a_profile_over_time_keeps_its_ends(
    tmp_path: Path, clock: str, factor: float
) -> None:
    rows = [f"{factor * t},{1e3 * m}" for t, m in ((1, 2), (2, 4), (4, 0))]
    path = profile(tmp_path, "\n".join([f"{clock},torque_mnm", *rows]))
    found = task(path)
    times = [0.0, 1.0, 1.5, 3.0, 9.0]
    assert [found.torque(0.0, 0.0, t) for t in times] == [2.0, 2.0, 3.0, 2.0, 0.0]
    assert found.of_phase and found.of_time


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "phase,torque_nm\n0,1\n50,2\n99,1\n",
            "goes from 0 to 99; .* phase_percent if",
        ),
        ("phase_percent,torque_nm\n0,1\n120,2\n", r"goes from 0 to 120; .*\[0, 100\]"),
        ("phase,torque_nm\n0,1\n0.3,2\n", "leaves 70% of the cycle without"),
        ("phase,torque_nm\n0,1\n", "has 1 rows of data"),
        ("phase,torque_nm\n0.5,1\n0.2,2\n", "row 2 of the data: 0.2 must be above"),
        ("phase,torque\n0,1\n0.5,2\n", "no column of the torque on joint 'knee'"),
        ("phase,hip_torque_nm\n0,1\n0.5,2\n", "no column of the torque on joint"),
        ("time,torque_nm\n0,1\n1,2\n", "no column 'time_s'; if it is 'time'"),
        ("time_s,torque_nm,knee_nm,knee_torque_nm\n0,1,1,1\n", "several columns of"),
    ],
)
def test_profiles_that_cannot_be_used(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(CableError, match=message):
        task(profile(tmp_path, text), ("knee",))
