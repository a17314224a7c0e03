"""An episode whose conduit moves with the wearer is played, logged and recorded."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest

from cc_mujoco import assets, engine
from cc_mujoco.control import controller
from cc_mujoco.recording.conduit3d import conduit_points
from cc_mujoco.recording.episode import FILES, play, write_episode
from cc_mujoco.transmission.conduit import node_places

CABLE = "plantarflexor"


@pytest.fixture
def moving_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The ankle's scene with a conduit that follows its route."""
    spec = mujoco.MjSpec.from_file(str(assets.scene_path("ankle")))
    cable = engine.from_mjcf(spec)[CABLE]
    engine.to_mjcf(spec, CABLE, cable.replace(bend="route"))
    path = tmp_path / "moving.xml"
    path.write_text(spec.to_xml())
    monkeypatch.setitem(assets.SCENES, "ankle", str(path))


@pytest.mark.usefixtures("moving_scene")
def test_an_episode_with_a_moving_route_is_recorded(tmp_path: Path) -> None:
    env = gymnasium.make("cc_mujoco/AnkleExo-v0", duration=0.6)
    model = env.unwrapped.model
    assert engine.from_mjcf(model)[CABLE].bend == "route"
    log = play(env, controller("pi", env.unwrapped.drive))
    write_episode(tmp_path / "episode", log, model)
    assert {path.name for path in (tmp_path / "episode").iterdir()} == set(FILES)
    assert log.metadata["cables"][CABLE]["bend"] == "route"
    tension = log[f"tension_{CABLE}_nodes_n"]
    assert np.isfinite(tension).all()
    cable = engine.from_mjcf(model)[CABLE]
    shares = node_places(cable) / cable.length
    assert tension.shape[1] == shares.size
    points = conduit_points(model, CABLE, log["qpos"][[0, -1]], shares)
    assert np.linalg.norm(points[1] - points[0], axis=1).max() > 1e-3
