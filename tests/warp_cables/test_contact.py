"""A load that a cable lifts and drops on a hard floor, in steps that are long for it.

Ends that look ahead take the forces of contacts and stops from the step before.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

pytest.importorskip("warp")

import cc_mujoco
from cc_mujoco.cable import Cable, Section
from warp_cables.test_scenes import played, played_on_warp

SCENE = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="{step}" integrator="{integrator}"/>
  <worldbody>
    <geom type="plane" size="1 1 0.1" solref="{hard} 1"/>
    <body pos="0 0 1">
      <joint name="drum" axis="0 1 0" armature="2e-3" damping="0.05" range="-1 2"
             limited="true" solreflimit="{hard} 1"/>
      <geom type="cylinder" size="0.02 0.02" mass="0.2" contype="0" conaffinity="0"/>
    </body>
    <body pos="0 0 0.051">
      <joint name="lift" type="slide" axis="0 0 1"/>
      <geom type="sphere" size="0.05" mass="2" solref="{hard} 1"/>
    </body>
  </worldbody>
  <actuator><motor joint="drum"/></actuator>
</mujoco>
"""
CABLE = Cable(axial_stiffness=2e4, friction=0.1, conduit=(Section(0.6, 0.2),))
SECONDS, HOLD = 2.0, 0.02


def scene(step: float, integrator: str = "implicitfast", hard: float = 4e-3):
    text = SCENE.format(step=step, integrator=integrator, hard=hard)
    spec = mujoco.MjSpec.from_string(text)
    cc_mujoco.plugin.to_mjcf(spec, "cord", CABLE, ("drum", -0.02), ("lift", -1.0))
    return spec


def lifted_and_dropped(time: float) -> list[float]:
    return [0.4 + 0.7 * np.sin(9.0 * time)]


def sampled(play, step: float, **options) -> np.ndarray:
    """Return angle of the drum and height of the load every `HOLD` s."""
    every = round(HOLD / step)
    found = play(scene(step, **options), lifted_and_dropped, SECONDS, HOLD)
    return found[0][every - 1 :: every]


@pytest.mark.study
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("step", [4e-3, 1e-2])
def test_a_hard_contact_adds_no_error(step, integrator):
    right = sampled(played, 2e-4, integrator=integrator)
    height = right[:, 1]
    assert height.max() > 0.02 and height.min() < 0.0  # it flies, and it lands
    theirs, ours = (
        np.sqrt(((sampled(play, step, integrator=integrator) - right) ** 2).mean(0))
        for play in (played, played_on_warp)
    )
    assert (ours < 1.3 * theirs).all()
