"""Grey marks slack tendons: no other tendon is drawn in that colour."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import cc_mujoco
from cc_mujoco.assets import SCENES, scene_path
from cc_mujoco.viz._cable_lines import SLACK_COLOR, Capsules
from cc_mujoco.viz._scene3d import ROPE_COLOR, visible_tendons

SCENE = """<mujoco>
  <asset><material name="red" rgba="0.8 0.1 0.1 1"/></asset>
  <worldbody><site name="a"/><body><joint name="j" axis="0 1 0"/>
    <geom size="0.1"/><site name="b" pos="1 0 0"/></body></worldbody>
  <tendon>
    <spatial name="plain"><site site="a"/><site site="b"/></spatial>
    <spatial name="blue" rgba="0 0 1 1"><site site="a"/><site site="b"/></spatial>
    <spatial name="red" material="red"><site site="a"/><site site="b"/></spatial>
  </tendon>
</mujoco>"""


def test_a_tendon_without_a_colour_is_brown_and_others_keep_theirs() -> None:
    assert cc_mujoco.__version__
    model = mujoco.MjModel.from_xml_string(SCENE)
    expected = [ROPE_COLOR, (0.0, 0.0, 1.0, 1.0), (0.8, 0.1, 0.1, 1.0)]
    for (_, color), wanted in zip(visible_tendons(model, ()), expected, strict=True):
        assert color == pytest.approx(wanted, abs=1e-6)
    before = model.tendon_rgba.copy()
    Capsules(model, (), 100.0)
    assert model.tendon_rgba[0] == pytest.approx(ROPE_COLOR)
    assert np.array_equal(model.tendon_rgba[1:], before[1:])


@pytest.mark.parametrize("scene", SCENES)
def test_no_tendon_of_a_scene_is_as_grey_as_slack(scene: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(scene_path(scene)))
    for _, color in visible_tendons(model, ()):
        assert np.abs(color[:3] - SLACK_COLOR[:3] / 255.0).max() > 0.1
