"""Playing an episode of a real environment into a log."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest

import cc_mujoco  # noqa: F401  (registers the environments)
from cc_mujoco import plugin
from cc_mujoco.control import External, controller
from cc_mujoco.device import PERFECT_SENSING, TENSION_COLUMN
from cc_mujoco.device._sensors import MEASURED_COLUMNS, WINDING_COLUMNS
from cc_mujoco.errors import CableError
from cc_mujoco.metrics._formulas import efficiency
from cc_mujoco.metrics._metric import Key
from cc_mujoco.simulation import play
from cc_mujoco.simulation._log_columns import MODEL_XML


@pytest.fixture
def env() -> Any:
    with gymnasium.make("cc_mujoco/WristHandle-v1", duration=0.4) as made:
        yield made


def law(env: Any) -> Any:
    return controller("pi", env.unwrapped.drive)


def test_log_runs_from_the_reset_to_the_end(env: Any) -> None:
    times: list[float] = []
    log = play(env, law(env), seed=5, about={"task": "x"}, progress=times.append)
    assert log["time_s"][0] == 0.0
    assert log["time_s"][-1] == pytest.approx(0.4)
    assert times == log["time_s"][1:].tolist()
    assert log.cables == ("flexor", "extensor")
    about = log.metadata
    assert (about["scene"], about["task"], about["seed"]) == ("wrist", "x", 5)
    # Motor pulley over joint pulley, thesis Table 2.2.
    assert about[Key.RATIO] == pytest.approx(20 / 104)
    assert about["wearer"]["stiffness"] > 0
    assert about["cables"]["flexor"]["pretension"] == "10.0"
    assert "cc_mujoco.cable" in about[MODEL_XML]


def test_columns_belong_together(env: Any) -> None:
    log = play(env, law(env))
    for cable in log.cables:
        nodes = log[f"tension_{cable}_nodes_n"]
        assert np.array_equal(nodes[:, 0], log[f"tension_{cable}_proximal_n"])
        assert np.array_equal(nodes[:, -1], log[f"tension_{cable}_distal_n"])
        assert (np.diff(log[f"dissipated_{cable}_j"]) >= 0.0).all()
        slip = log[f"slip_{cable}_direction"]
        assert np.abs(slip).mean(axis=1) == pytest.approx(
            log[f"moving_{cable}_fraction"]
        )
    pull = log["tension_flexor_distal_n"] - log["tension_extensor_distal_n"]
    assert log["joint_torque_nm"] == pytest.approx(0.104 * pull, abs=1e-9)
    assert 0.0 <= efficiency(log).motor_share <= 1.0


def listener(env: Any, seen: list[dict[str, Any]]) -> External:
    """Return a controller that commands 0.3 N m and records its readings."""

    def torque(told: dict[str, Any]) -> float:
        seen.append(told)
        return 0.3

    return External(env.unwrapped.drive, lambda drive: torque)


def test_the_controller_sees_late_noisy_sensors_and_the_log_holds_the_truth(
    env: Any,
) -> None:
    seen: list[dict[str, Any]] = []
    log = play(env, listener(env, seen), seed=2)
    sensing = env.unwrapped.exo.description.sensing
    assert log.metadata["sensing"] == sensing.to_json()
    assert all(
        told.keys() == {*MEASURED_COLUMNS, *WINDING_COLUMNS, TENSION_COLUMN}
        for told in seen
    )
    late = slice(None, -sensing.delay)
    told = np.array([one["joint_torque_nm"] for one in seen])[sensing.delay :]
    error = told - log["joint_torque_nm"][late]
    assert np.std(error) == pytest.approx(sensing.torque_noise, rel=0.15)
    tension = np.array([one[TENSION_COLUMN][1, 2] for one in seen])[sensing.delay :]
    error = tension - log["tension_extensor_distal_n"][late]
    assert np.std(error) == pytest.approx(sensing.tension_noise, rel=0.15)
    step = 2.0 * np.pi / sensing.motor_steps
    angle = np.array([one["motor_angle_rad"] for one in seen])[sensing.delay :]
    assert angle / step == pytest.approx(np.round(angle / step), abs=1e-6)
    error = angle - log["motor_angle_rad"][late]
    assert 0.2 * step < np.abs(error).max() <= 0.5001 * step


def test_perfect_sensors_tell_what_the_log_holds(env: Any) -> None:
    seen: list[dict[str, Any]] = []
    log = play(env, listener(env, seen), sensing=PERFECT_SENSING)
    for name in MEASURED_COLUMNS:
        assert np.array_equal([told[name] for told in seen], log[name])
    assert log.metadata["sensing"]["cutoff"] is None


def test_divergence_is_an_error(env: Any) -> None:
    class Diverging(gymnasium.Wrapper[Any, Any, Any, Any]):
        def step(self, action: Any) -> Any:
            observation, reward, _, _, info = super().step(action)
            return observation, reward, True, False, info

    with pytest.raises(CableError, match="diverged at"):
        play(Diverging(env), law(env))


def test_a_log_describes_the_cables_that_the_reset_drew() -> None:
    env = gymnasium.make(
        "cc_mujoco/WristHandle-v1", duration=0.05, randomise={"friction": (0.3, 0.4)}
    )
    inner: Any = env.unwrapped
    before = plugin.from_mjcf(inner.model)["flexor"].friction
    about = play(env, law(env), seed=4).metadata["cables"]["flexor"]
    drawn = plugin.from_mjcf(inner.model)["flexor"].friction
    assert drawn >= 0.3 > before
    assert float(about["friction"]) == drawn
