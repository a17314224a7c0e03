"""An episode whose conduit moves with the wearer is played, logged and recorded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest

from cc_mujoco import assets, plugin
from cc_mujoco.control import controller
from cc_mujoco.simulation import play
from cc_mujoco.viz import EPISODE_FILES, conduit_shares, write_episode
from cc_mujoco.viz._cable_lines import CONDUIT, CableLine, cable_lines

CABLE = "plantarflexor"


def conduit_line(model: mujoco.MjModel, cable: str) -> CableLine:
    """Return the line of the conduit of a cable."""
    (line,) = (one for one in cable_lines(model, [cable]) if one.part == CONDUIT)
    return line


@pytest.fixture
def moving_scene(tmp_path: Path) -> Path:
    """Write the ankle scene with a conduit that follows its route."""
    spec = mujoco.MjSpec.from_file(str(assets.scene_path("ankle")))
    cable = plugin.from_mjcf(spec)[CABLE]
    plugin.to_mjcf(spec, CABLE, cable.replace(bend="route"))
    path = tmp_path / "moving.xml"
    path.write_text(spec.to_xml())
    beside = assets.scene_path("ankle").with_suffix(".device.toml")
    path.with_suffix(".device.toml").write_text(beside.read_text())
    return path


def test_an_episode_with_a_moving_route_is_recorded(
    moving_scene: Path, tmp_path: Path
) -> None:
    env = gymnasium.make("cc_mujoco/Device-v1", device=moving_scene, duration=0.6)
    model = env.unwrapped.model
    assert plugin.from_mjcf(model)[CABLE].bend == "route"
    log = play(env, controller("pi", env.unwrapped.drive))
    write_episode(tmp_path / "episode", log, model)
    assert {path.name for path in (tmp_path / "episode").iterdir()} == set(
        EPISODE_FILES
    )
    assert log.metadata["cables"][CABLE]["bend"] == "route"
    tension = log[f"tension_{CABLE}_nodes_n"]
    assert np.isfinite(tension).all()
    shares = conduit_shares(model, CABLE)
    assert shares.size == tension.shape[1]
    points = conduit_line(model, CABLE).all_points(model, log["qpos"][[0, -1]])
    assert np.linalg.norm(points[1] - points[0], axis=1).max() > 1e-3


def test_the_line_of_an_open_cable_is_divided_at_its_bends() -> None:
    """Each of its straight pieces has one tension, hence one colour."""
    model = mujoco.MjModel.from_xml_path(str(assets.scene_path("finger")))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    shares = conduit_shares(model, "extensor")
    line = replace(conduit_line(model, "extensor"), fine=shares)
    points = line.all_points(model, data.qpos[None])[0]
    guide = data.site("guide").xpos
    assert np.linalg.norm(points - guide, axis=1).min() < 1e-3
    straight = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.sum(straight > 0.025) == 4
