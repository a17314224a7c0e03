"""Controllers from outside: `module:function` and policy files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.control import MEASURED, Controller, Drive, controller, features
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
"""


@pytest.fixture(autouse=True)
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own_controllers_of_a_test.py").write_text(SOURCE)
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
    ("name", "message"),
    [
        ("no_such_module_here:f", "there is no module"),
        ("own_controllers_of_a_test:absent", "has no 'absent'"),
        ("own_controllers_of_a_test:nothing", "must return a Controller"),
        ("runs/absent.zip", "no such file"),
    ],
)
def test_what_is_not_there_is_refused_in_a_sentence(name: str, message: str) -> None:
    with pytest.raises(CableError, match=message):
        controller(name, DRIVE)


def test_an_error_inside_the_module_is_not_hidden() -> None:
    with pytest.raises(ModuleNotFoundError, match="a_module_that_does_not_exist"):
        named("broken")


def test_features_are_the_same_for_one_and_for_many() -> None:
    random = np.random.default_rng(0)
    many = {name: random.normal(size=4) for name in MEASURED}
    together = features(many, DRIVE)
    assert together.shape == (4, 6)
    for row in range(4):
        one = {name: float(values[row]) for name, values in many.items()}
        assert np.array_equal(features(one, DRIVE), together[row])
