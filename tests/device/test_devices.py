"""The table of devices: what a row names is there."""

from __future__ import annotations

import mujoco
import pytest

from cc_mujoco.assets import scene_path
from cc_mujoco.device import DEVICES
from cc_mujoco.device._sensors import MEASURED_COLUMNS
from cc_mujoco.human import TASKS, TRAJECTORIES


@pytest.mark.parametrize("name", DEVICES)
def test_a_row_names_what_is_in_the_scene_and_what_can_be_played(name: str) -> None:
    device = DEVICES[name]
    assert device.scene == name
    spec = mujoco.MjSpec.from_file(str(scene_path(name)))
    for joint in (device.joint, *device.companions):
        assert spec.joint(joint) is not None
    movers = *device.companions.values(), *device.helpers
    for actuator in ("wearer", "motor", *movers):
        assert spec.actuator(actuator) is not None
    for site in device.lever:
        assert spec.site(site) is not None
    assert device.trajectory in TRAJECTORIES
    assert device.task in TASKS
    assert set(device.units) <= set(MEASURED_COLUMNS)
