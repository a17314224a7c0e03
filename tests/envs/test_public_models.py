"""Humanoids of other makers with a knee exoskeleton, as devices from files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import cc_mujoco
from cc_mujoco import cli
from cc_mujoco.device import Device
from public_models import with_knee_exoskeleton

DESCRIPTION = """
root = "held"

[axis]
joint = "right_knee"
safe_torque = 40.0
centre = -0.6  # bent further, the lever passes the line of the cable
reach = 0.4

[wearer."*"]  # all other joints are held by springs
stiffness = 200.0
damping = 10.0

[wearer.right_knee]
stiffness = 100.0
damping = 5.0
"""


@pytest.fixture(scope="module", params=["gymnasium", "dm_control"])
def scene(request: pytest.FixtureRequest, tmp_path_factory: Any) -> Path:
    spec = with_knee_exoskeleton(str(request.param))
    spec.option.timestep = 1e-3
    folder = tmp_path_factory.mktemp(str(request.param))
    (folder / "knee.xml").write_text(spec.to_xml(), encoding="utf-8")
    (folder / "knee.device.toml").write_text(DESCRIPTION, encoding="utf-8")
    return Path(folder / "knee.xml")


def test_a_humanoid_is_a_device(scene: Path) -> None:
    found = Device(scene).description
    (axis,) = found.axes
    assert (axis.motor, axis.joint) == ("extensor_motor", "right_knee")
    assert axis.cables == ("extensor",)
    assert axis.torque == 20.0
    assert axis.lever == ("extensor_lever",)
    # The cable stretches the knee, which is bent in the negative sense.
    assert axis.task.startswith("hold:")
    assert float(axis.task.removeprefix("hold:")) > 0.0
    assert set(found.movers) > {"right_knee", "left_knee", "right_hip_y", "abdomen_x"}


def test_its_environment_passes_the_checker(scene: Path) -> None:
    env = gymnasium.make("cc_mujoco/Device-v1", device=str(scene), duration=0.1)
    check_env(env.unwrapped, skip_render_check=True)


def test_an_episode_assists_the_knee(scene: Path) -> None:
    log = cc_mujoco.simulate(scene, "predictive", task="hold:8", duration=2.0)
    late = log["time_s"] > 1.0
    error = log["joint_torque_nm"][late] - 8.0
    assert np.sqrt(np.mean(error**2)) < 0.5
    assert 50.0 < np.mean(log["tension_extensor_distal_n"][late]) < 300.0


@pytest.mark.usefixtures("undrawn")
def test_an_episode_is_recorded(scene: Path, tmp_path: Path) -> None:
    words = ["play", str(scene), "--duration", "0.3", "--out", str(tmp_path / "out")]
    assert cli.main(words) == 0
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"recording.rrd", "log.parquet", "metrics.json", "summary.png"} <= written


def test_a_what_if_ranks_its_friction(scene: Path) -> None:
    table = cc_mujoco.study(
        str(scene),
        {"friction": [0.05, 0.3]},
        controllers=["none"],
        metrics=["rms_torque_error"],
        task="hold:8",
        duration=1.0,
        threads=1,
    )
    assert not any(table["failed"].to_pylist())
    error = table["rms_torque_error"].to_pylist()
    assert error[0] < error[1]
