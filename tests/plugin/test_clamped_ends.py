"""Force limits of actuators that would clamp the tension of a cable are refused."""

from __future__ import annotations

import mujoco
import pytest

import cc_mujoco  # noqa: F401, registers the plugin

LIMIT = 'actuatorfrcrange="-1 1"'

SCENE = """
<mujoco>
  <compiler autolimits="true"/>
  <extension><plugin plugin="cc_mujoco.cable"><instance name="c">
    <config key="conduit" value="0.5:0.1"/>
    <config key="axial_stiffness" value="4000"/>
    <config key="pretension" value="10"/> <config key="friction" value="0.1"/>
    <config key="segments" value="5"/>
  </instance></plugin></extension>
  <worldbody>
    <body><joint name="motor" axis="0 1 0"/><geom size="0.02"/></body>
    <body><joint name="other" axis="0 1 0"/><geom size="0.02"/></body>
    <body><joint name="base" type="slide"/><geom size="0.02"/>
      <site name="clamp" pos="0 0 0.1"/>
      <body><joint name="arm" axis="0 1 0"/><geom size="0.02" pos="0.1 0 0"/>
        <site name="tip" pos="0.1 0 0"/>
        <body pos="0.1 0 0"><joint name="hand" axis="0 1 0"/><geom size="0.02"/></body>
      </body>
    </body>
  </worldbody>
  <tendon><spatial name="cord"><site site="clamp"/><site site="tip"/></spatial></tendon>
  <actuator>
    <plugin name="near" plugin="cc_mujoco.cable" instance="c" joint="motor"
      gear="-0.02"/>
    <plugin name="far" plugin="cc_mujoco.cable" instance="c" tendon="cord" gear="1"/>
  </actuator>
</mujoco>
"""


def limited(what: str) -> str:
    return SCENE.replace(f'name="{what}"', f'name="{what}" {LIMIT}')


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("motor", "its actuator 'near' pulls a joint that has an `actuatorfrcrange`"),
        ("arm", "its actuator 'far' pulls a joint that has an `actuatorfrcrange`"),
        ("cord", "its actuator 'far' pulls a tendon that has an `actuatorfrcrange`"),
    ],
)
def test_a_limit_that_would_clamp_the_tension_is_refused(what: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        mujoco.MjModel.from_xml_string(limited(what))


@pytest.mark.parametrize("what", ["other", "base", "hand"])
def test_a_limit_of_a_joint_that_the_cable_does_not_pull_is_none_of_its_business(
    what: str,
) -> None:
    mujoco.MjModel.from_xml_string(limited(what))


def test_a_default_limits_as_an_attribute_does() -> None:
    default = f"<default><joint {LIMIT}/></default><worldbody>"
    with pytest.raises(ValueError, match="its own or that of a default"):
        mujoco.MjModel.from_xml_string(SCENE.replace("<worldbody>", default))
