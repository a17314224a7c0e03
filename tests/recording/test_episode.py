"""Playing an episode of a real environment into a log."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest

import cc_mujoco  # noqa: F401  (registers the environments)
from cc_mujoco.control import controller
from cc_mujoco.errors import CableError
from cc_mujoco.recording import play
from cc_mujoco.recording.columns import MODEL_XML, RATIO
from cc_mujoco.recording.metrics import efficiency


@pytest.fixture
def env() -> Any:
    with gymnasium.make("cc_mujoco/WristHandle-v0", duration=0.4) as made:
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
    assert about[RATIO] == pytest.approx(20 / 104)
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


def test_divergence_is_an_error(env: Any) -> None:
    class Diverging(gymnasium.Wrapper[Any, Any, Any, Any]):
        def step(self, action: Any) -> Any:
            observation, reward, _, _, info = super().step(action)
            return observation, reward, True, False, info

    with pytest.raises(CableError, match="diverged at"):
        play(Diverging(env), law(env))
