"""Controllers from outside: `module:function` and policy files."""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

from cc_mujoco.control import Controller, Drive, Observed, controller
from cc_mujoco.control.observed import described
from cc_mujoco.devices import DEVICES
from cc_mujoco.errors import CableError
from cc_mujoco.sensing import MEASURED
from control.policies import ACTION, Linear, saved

OBSERVED = Observed(
    "wrist", tuple(zip(MEASURED[:6], (10.0, 500.0, 1.5, 20.0, 50.0, 50.0), strict=True))
)
IDS = [device.environment for device in DEVICES.values()]
DRIVE = Drive(5.0, -1.0, 1.0, 0.001, observed=OBSERVED)

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
    ("name", "message"),
    [
        ("no_such_module_here:f", "there is no module"),
        ("own_controllers_of_a_test:absent", "has no function 'absent'"),
        ("own_controllers_of_a_test:nothing", "must return a Controller"),
        ("own_controllers_of_a_test:number", "has no function 'number'"),
        (":f", "there is no module ''"),
        ("unfinished_module_of_a_test:f", "SyntaxError in .*, line 1"),
        ("runs/absent.zip", "no such file"),
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


class TestPolicies:
    """Policy files; where Stable-Baselines3 is installed."""

    @staticmethod
    def saved(kind: str, path: Path, space: Any = OBSERVED.space) -> str:
        algorithms = pytest.importorskip("stable_baselines3")

        class Still(gymnasium.Env[np.ndarray, np.ndarray]):
            """An environment in which nothing happens."""

            observation_space = space
            action_space = ACTION

        model = getattr(algorithms, kind)("MlpPolicy", Still(), seed=0, device="cpu")
        model.save(path / "saved.zip")
        return str(path / "saved.zip")

    @pytest.mark.parametrize("kind", ["PPO", "A2C", "SAC", "TD3", "DDPG"])
    def test_of_every_algorithm_for_one_and_for_many(
        self, kind: str, tmp_path: Path
    ) -> None:
        law = controller(self.saved(kind, tmp_path), DRIVE)
        random = np.random.default_rng(0)
        many = {name: random.normal(size=3) for name in MEASURED}
        together = law.torque(many)
        assert together.shape == (3,)
        assert np.all(np.abs(together) <= 1.0)
        one = {name: float(values[1]) for name, values in many.items()}
        assert law.torque(one) == together[1]

    def test_for_something_else_is_refused(self, tmp_path: Path) -> None:
        with pytest.raises(CableError, match="4 numbers"):
            controller(self.saved("PPO", tmp_path, Box(-1.0, 1.0, (4,))), DRIVE)
        with zipfile.ZipFile(tmp_path / "other.zip", "w") as file:
            file.writestr("a.txt", "hello")
        (tmp_path / "text.zip").write_text("hello")
        for name in ("other.zip", "text.zip"):
            with pytest.raises(CableError, match="not one that Stable-Baselines3"):
                controller(name, DRIVE)


def test_without_stable_baselines_a_policy_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "policy.zip").write_text("")
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(CableError, match=r"cc_mujoco\[policy\]"):
        controller("policy.zip", DRIVE)


@pytest.mark.parametrize("name", IDS)
def test_a_policy_is_fed_the_observation_of_its_environment(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    env = gymnasium.make(name, disable_env_checker=True, duration=0.2)
    inner: Any = env.unwrapped
    policy = Linear(env.observation_space, 0.0)
    law = controller(saved(policy, tmp_path / "p.zip", monkeypatch), inner.drive)
    fed: list[np.ndarray] = []

    def predict(self: Linear, seen: np.ndarray, deterministic: bool) -> Any:
        fed.append(seen)
        return np.full(1, 0.25, np.float32), None

    monkeypatch.setattr(Linear, "predict", predict)
    observation, info = env.reset(seed=3)
    for _ in range(50):
        action = inner.action(law.torque(info))
        assert action == np.float32(0.25)
        assert np.array_equal(fed[-1], observation)
        observation, *_, info = env.step(action)
    env.close()


def test_a_policy_of_another_device_is_refused_with_both_spaces(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    envs = {name: gymnasium.make(name, disable_env_checker=True) for name in IDS}
    for name, env in envs.items():
        path = saved(Linear(env.observation_space, 0.0), tmp_path / "p", monkeypatch)
        policy = Path(path).rename(tmp_path / "p.zip")
        for other, device in envs.items():
            drive = device.unwrapped.drive  # type: ignore[attr-defined]
            if other == name:
                assert controller(str(policy), drive).torque(device.reset()[1]) == 0.0
                continue
            with pytest.raises(CableError) as caught:
                controller(str(policy), drive)
            spaces = (each.observation_space for each in (env, device))
            for words in (drive.observed.device, *map(described, spaces)):
                assert words in str(caught.value)


@pytest.mark.parametrize(
    ("observation", "action", "words"),
    [
        (Box(-10.0, 10.0, (6,)), ACTION, r"\+-\(10, 10, 10, 10, 10, 10\).*wrist"),
        (Box(-1.0, 1.0, (4,)), ACTION, "4 numbers"),
        (Discrete(3), ACTION, r"Discrete\(3\)"),
        (None, Box(-1.0, 1.0, (2,)), "acts with 2 numbers"),
        (None, Box(0.0, 1.0, (1,)), r"acts with 1 numbers from \(0\) to \(1\)"),
    ],
)
def test_a_policy_of_other_spaces_is_refused(
    observation: Any,
    action: Any,
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    policy = Linear(observation or OBSERVED.space, 0.0, action)
    with pytest.raises(CableError, match=words):
        controller(saved(policy, tmp_path / "p.zip", monkeypatch), DRIVE)


def test_a_policy_needs_a_device_with_an_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = saved(Linear(OBSERVED.space, 0.0), tmp_path / "p.zip", monkeypatch)
    with pytest.raises(CableError, match="observed"):
        controller(path, Drive(5.0, -1.0, 1.0, 0.001))


def test_observations_are_the_same_for_one_and_for_many() -> None:
    random = np.random.default_rng(0)
    many = {name: random.normal(scale=20.0, size=4) for name in MEASURED}
    together = OBSERVED.of(many)
    assert together.shape == (4, 6)
    for row in range(4):
        one = {name: float(values[row]) for name, values in many.items()}
        assert np.array_equal(OBSERVED.of(one), together[row])
        assert OBSERVED.of(one) in OBSERVED.space
