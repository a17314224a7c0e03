"""Controllers from outside: `module:function`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.control import Controller, controller
from cc_mujoco.device import Drive
from cc_mujoco.errors import CableError

DRIVE = Drive(5.0, -1.0, 1.0, 0.001)

SOURCE = """
import numpy as np
from cc_mujoco.control import FeedForward

number = 3

def doubled(drive):
    return lambda seen: 2.0 * seen["desired_torque_nm"] / drive.ratio

def counting(drive):
    calls = []
    def torque(seen):
        calls.append(1)
        return 0.1 * len(calls) + 0.0 * seen["desired_torque_nm"]
    return torque

def nothing(drive):
    return None

def broken(drive):
    import a_module_that_does_not_exist

def raising(drive):
    return lambda seen: seen["a tension that no one measures"]

def careless():
    return lambda seen: 0.0

def greedy(drive, gain):
    return lambda seen: 0.0

def deaf(drive):
    return lambda: 0.0

def generous(drive, gain=1.0):
    return lambda *seen, **more: gain

class Bare(FeedForward):
    def __init__(self):
        pass

def wordy(drive):
    return lambda seen: "0.5"

def endless(drive):
    return lambda seen: -seen["desired_torque_nm"] * float("inf")
"""


@pytest.fixture(autouse=True)
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own_controllers_of_a_test.py").write_text(SOURCE)
    (tmp_path / "unfinished_module_of_a_test.py").write_text("def f(drive:\n")
    monkeypatch.chdir(tmp_path)


def named(function: str) -> Controller:
    return controller(f"own_controllers_of_a_test:{function}", DRIVE)


def test_a_function_of_the_drive_makes_a_controller_within_the_limits() -> None:
    law = named("doubled")
    assert law.torque({"desired_torque_nm": 1.0}) == 0.4
    assert law.torque({"desired_torque_nm": 9.0}) == 1.0
    many = law.torque({"desired_torque_nm": np.array([1.0, -9.0])})
    assert np.array_equal(many, [0.4, -1.0])


def test_reset_makes_the_function_anew() -> None:
    law, seen = named("counting"), {"desired_torque_nm": 0.0}
    assert [law.torque(seen) for _ in range(2)] == [0.1, 0.2]
    law.reset()
    assert law.torque(seen) == 0.1


def test_a_controller_class_will_do() -> None:
    assert type(named("FeedForward")).__name__ == "FeedForward"


@pytest.mark.parametrize(
    ("function", "words"),
    [
        ("careless", r"'careless' in .*_test.py, line 26, must take .*drive, .* \(\)"),
        ("greedy", r"'greedy' in .*_test.py, line \d+, must take .* \(drive, gain\)"),
        ("deaf", r"what 'deaf' returns in .*_test.py, line \d+, .*measured, .* \(\)"),
        ("Bare", r"'Bare' must take one argument, the drive, but takes \(\)"),
    ],
)
def test_a_function_of_other_arguments_is_told_where_it_is(
    function: str, words: str
) -> None:
    with pytest.raises(CableError, match=words):
        named(function)
    assert named("generous").torque({"desired_torque_nm": 0.0}) == 1.0


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("no_such_module_here:f", "there is no module"),
        ("own_controllers_of_a_test:absent", "has no function 'absent'"),
        ("own_controllers_of_a_test:nothing", "must return a Controller"),
        ("own_controllers_of_a_test:number", "has no function 'number'"),
        (":f", "there is no module ''"),
        ("unfinished_module_of_a_test:f", "SyntaxError in .*, line 1"),
        ("runs/absent.safetensors", "no such file"),
    ],
)
def test_what_is_not_there_is_refused_in_a_sentence(name: str, message: str) -> None:
    with pytest.raises(CableError, match=message):
        controller(name, DRIVE)


def test_an_error_inside_is_told_with_its_place_and_not_hidden() -> None:
    with pytest.raises(CableError, match=r"a_module_that_does_not_exist") as caught:
        named("broken")
    assert isinstance(caught.value.__cause__, ModuleNotFoundError)
    law = named("raising")
    with pytest.raises(CableError, match=r"KeyError in .*own_controllers.*line \d+"):
        law.torque({"desired_torque_nm": 1.0})


def test_what_is_no_torque_is_refused_and_infinity_is_no_number() -> None:
    with pytest.raises(CableError, match="must be a torque"):
        named("wordy").torque({"desired_torque_nm": 1.0})
    found = named("endless").torque({"desired_torque_nm": np.array([1.0, -1.0])})
    assert np.isnan(found).all()
